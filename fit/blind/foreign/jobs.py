"""Exchange of cloth and motions with a third-party simulator: job arrays, and points from its answer.

- `rest` [m], (nodes, 2); `triangles`, (faces, 3), of an even grid; `mass` [kg], (nodes,)
- `start` [m], (takes, nodes, 3)
- `held`, (held,): nodes of the held edge; `fraction`, (held,): position along it
- `spot`, (nodes,): shares of a magnet's pull
- `path` [m], (takes, steps + 1, 6): the held edge's ends at every step of `dt` [s]; `every`: steps a sample
- `settle_steps`, `settle_damping` [1/s]: hanging still before the take
- `rate` [1/s]: samples of the answer
- `names`; `numbers` [SI], (takes, names): those of `fit.blind.engine.Engine.numbers`, `POLES`, and `bending_warp`,
  `bending_weft` and `hem_from` [m], below which bending is `hem_bending` times as stiff

The answer is `nodes` [m], (takes, samples, nodes, 3), and `seconds`, (takes,), of one process, settling left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.blind.engine import (
    HANGING_DAMPING,
    HANGING_TIME,
    HEM_BENDING,
    HEM_WIDTH,
    POLES,
    SAMPLES_A_SECOND,
    Engine,
    held_fraction,
    hung,
    magnet_spot,
    resample,
)
from fit.blind.sheet import Sheet, place_on
from formats.arrays import Floats


@dataclass(frozen=True)
class Job:
    """Input arrays for an engine, and the sheet that its answer refers to."""

    arrays: dict[str, NDArray[np.generic]]
    sheet: Sheet


def make_job(engine: Engine, ends: Floats, duration: float, *, step: float, settle: float = HANGING_TIME) -> Job:
    """Return the job of one cloth in several takes.

    - `engine`: our engine of the cloth, on the mesh of the job
    - `ends` [m], (takes, n, 6), evenly spaced over `duration` [s]
    - `step` [s]: largest time step of the other engine
    """
    sheet, cloth = engine.sheet, engine.cloth
    every = int(np.ceil(1 / (SAMPLES_A_SECOND * step)))
    dt = 1 / (SAMPLES_A_SECOND * every)
    steps = round(duration * SAMPLES_A_SECOND) * every
    path = resample(ends, duration, np.linspace(0.0, steps * dt, steps + 1))
    start = hung(path[:, 0], sheet)
    bending = {
        "bending_warp": float(cloth.bending * np.exp(cloth.bending_ratio / 2)),
        "bending_weft": float(cloth.bending * np.exp(-cloth.bending_ratio / 2)),
        "hem_from": HEM_WIDTH - sheet.height if cloth.hem > 0 else -np.inf,
        "hem_bending": HEM_BENDING,
    }
    shared = {**engine.numbers(), **bending}
    rows = [{**shared, **dict(zip(POLES, row, strict=True))} for row in engine.poles(start)]
    return Job(
        {
            "rest": sheet.rest, "triangles": sheet.triangles, "mass": engine.node_mass, "start": start,
            "held": sheet.held, "fraction": held_fraction(sheet), "spot": magnet_spot(sheet), "path": path,
            "dt": np.array(dt), "every": np.array(every), "settle_steps": np.array(round(settle / dt)),
            "settle_damping": np.array(HANGING_DAMPING), "rate": np.array(float(SAMPLES_A_SECOND)),
            "names": np.array(list(rows[0])), "numbers": np.array([list(row.values()) for row in rows]),
        },
        sheet,
    )  # fmt: skip


def points_on(sheet: Sheet, nodes: Floats, places: Floats) -> Floats:
    """Return the points [m], (takes, samples, points, 3), at positions [m], (points, 2), of the flat sheet."""
    corners, weights = place_on(sheet, places)
    return np.asarray(np.einsum("pc,tspcx->tspx", weights, nodes[:, :, corners]))
