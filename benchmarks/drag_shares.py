"""Measure by elimination why the fitted air drag of synthetic takes is below the planted coefficient.

    benchmarks/drag_shares.py [SEEDS]

SEEDS sets (3 unless given) of two takes, a mixed and a gentle swing of the demo's skirt, are simulated with drag 1.2.
The demo's own set comes first. Then the fit's sources of error are added one at a time:

    law      a constant coefficient, or the planted one, which falls with the angle of attack
    points   exact; with white noise of points or held ends; as the camera shows them
    free     the drag alone, all parameters, or all parameters but velocity damping, the rest at the truth

Fits are least squares from the truth and from softer, more viscous cloth; the lower cost counts. Every row states the
fitted drag over 1.2 as mean with its standard error over the sets, and of every set. The shares at the end are
differences of two rows within each set, since the sets' own scatter is common to both.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.demo_seeds import PLANTED, equivalent_drag
from benchmarks.tracking_scenes import Scene, Shown, ShownSensor
from capture.recording.session import record
from firmware_host.synthetic import cloth
from firmware_host.synthetic.scene import RIG
from firmware_host.synthetic.world import FIRST_STAMP, World, make_world
from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from fit.search.least_squares import BoundedSpace, LeastSquaresSettings, Prior, minimise
from formats.archive import read_take
from formats.arrays import Floats
from formats.nature import AIR_DENSITY
from formats.take import Take

MOTIONS = ("mixed", "gentle")  # those that the demo is fitted to
DEMO_SEEDS = (2, 3)  # of these motions in `scripts/demo`
SECONDS = 6.0  # of a recording, as in `scripts/demo`
SPACING, FINER = 0.05, 0.025  # m, mesh of the fit: the default, and half of it
POINT_NOISE = 4.7e-3 / np.sqrt(3)  # m a coordinate: a point's noise by the demo's diagnosis at first; 4.3 today
HELD_NOISE = 1.2e-3 / np.sqrt(3)  # m a coordinate: the markers' error in benchmarks/tracking.py
EXACT_SD = 1e-3  # m, stated of exact points: weights all alike
# si's parameters and the drag. Stretch is the threads' 300 N/m and the diagonals' 40; the planted cloth has no damping
# in bending, and si's least stands for it. The second start is an end of fits to the demo's takes.
TRUTH = np.array([340.0, 40.0, 3e-5, 1.0001e-4, 0.25, PLANTED])
SOFTER = np.array([310.0, 39.0, 1.7e-5, 4e-3, 0.37, 1.08])
DRAG, VELOCITY = 5, 4
PRIOR_SHARE = 0.5  # of the box, deviation of the prior: so weak that the takes decide
EXACT, HELD_NOISY = "planted law: all parameters", "with noise of the held ends: all"
CAMERA = "camera: all parameters"
SHARES = ((HELD_NOISY, EXACT), (CAMERA, EXACT))  # rows whose difference counts
NEAR = LeastSquaresSettings(step=0.01, max_iterations=10, cost_tolerance=1e-4, step_tolerance=1e-4)


def constant_drag(body: cloth._Cloth) -> Floats:
    """Return the drag [N] at each corner of each cell, (3, cells), with one coefficient for all angles of attack."""
    a, b, c, d = (body._all.take(nodes, axis=1) for nodes in body.corners)
    normal = np.cross((d[:3] - a[:3]).T, (c[:3] - b[:3]).T).T
    along = (0.25 * (a[3:] + b[3:] + c[3:] + d[3:]) * normal).sum(0) / (np.linalg.norm(normal, axis=0) + 1e-15)
    return np.asarray(-0.0625 * AIR_DENSITY * body.drag * np.abs(along) * along * normal)


@cache
def worlds(number: int, is_constant: bool) -> tuple[World, ...]:
    """Simulate a set's motions under the constant or the planted law."""
    seeds = [1000 * number + place for place in range(2)] if number else DEMO_SEEDS
    law = constant_drag if is_constant else cloth._Cloth._drag_of_cells
    with patch.object(cloth._Cloth, "_drag_of_cells", law):
        return tuple(
            make_world(motion=motion, effect="air_drag", amplitude=PLANTED, seconds=SECONDS, seed=seed)
            for motion, seed in zip(MOTIONS, seeds, strict=True)
        )


def exact(number: int, is_constant: bool, point_noise: float = 0.0, held_noise: float = 0.0) -> list[Take]:
    """Return a set's takes with the true points and held ends, and white noise [m a coordinate]."""
    takes = []
    for motion, world in zip(MOTIONS, worlds(number, is_constant), strict=True):
        rng = np.random.default_rng([number, 77])
        count, points = world.points.shape[:2]
        takes.append(Take(
            take_id=motion, created="now", rig=RIG, garment=world.garment, time=world.time,
            held=world.hanger.held + held_noise * rng.standard_normal((count, 2, 3)),
            held_valid=np.ones((count, 2), bool), held_sd=np.full((count, 2, 3), max(held_noise, 1e-4)),
            points=world.points + point_noise * rng.standard_normal((count, points, 3)),
            points_valid=np.ones((count, points), bool),
            points_sd=np.full((count, points, 3), max(point_noise, EXACT_SD)), state=np.zeros(count, np.uint16),
            markers=world.hanger.markers,
        ))  # fmt: skip
    return takes


@cache
def seen(number: int) -> tuple[Take, ...]:
    """Return a set's takes as the camera shows them and as they are tracked."""
    takes = []
    with tempfile.TemporaryDirectory() as folder:
        for motion, world in zip(MOTIONS, worlds(number, False), strict=True):
            renderer, count = world.renderer(), len(world.time)
            depth, colour = (np.stack(i) for i in zip(*(world.frame(n, renderer) for n in range(count)), strict=True))
            unknown = np.zeros((count, len(world.garment.points)))
            shown = Shown(
                Scene("skirt", motion, 1.6, "plain", False, number), world.time + FIRST_STAMP, depth, colour,
                world.hanger.markers, world.points, unknown, unknown, unknown,
            )  # fmt: skip
            path = Path(folder) / f"{motion}.mcap"
            record(ShownSensor(shown), RIG, world.garment, path, take_id=motion, created="now")
            takes.append(read_take(path))
    return tuple(takes)


def fitted(takes: Sequence[Take], free: Sequence[int] = range(6), spacing: float = SPACING) -> tuple[Floats, float]:
    """Return the parameters that fit takes best, and the rms error [mm]; those that are not free are the true ones."""
    observer = Observer(
        [prepare(take) for take in takes], SI, find_effects(["air_drag"]), frequency=0.0,
        resolution=Resolution(spacing=spacing),
    )  # fmt: skip
    chosen = list(free)
    box = BoundedSpace(
        minimum=np.array([*(p.minimum for p in SI.parameters), 0.01])[chosen],
        maximum=np.array([*(p.maximum for p in SI.parameters), 3.0])[chosen],
        is_log=np.array([*(p.is_log for p in SI.parameters), False])[chosen],
    )
    prior = Prior(mean=TRUTH[chosen], precision=np.diag((PRIOR_SHARE * box.scale) ** -2))

    def whole(rows: Floats) -> Floats:
        every = np.repeat(TRUTH[None], len(rows), axis=0)
        every[:, chosen] = rows
        return every

    def residuals(rows: Floats) -> Floats:
        every = whole(rows)
        return observer.sound_residuals_of(observer.trajectories(every[:, :DRAG], every[:, DRAG:]))

    starts = (TRUTH, SOFTER) if len(chosen) > 1 else (TRUTH,)
    ends = [minimise(residuals, start[chosen], box, prior=prior, settings=NEAR) for start in starts]
    best = min(ends, key=lambda end: end.cost)
    return whole(best.parameters[None])[0], float(observer.in_mm(best.residuals[None])[0])


def main(count: int) -> None:
    """Print a row for each step of the elimination."""
    for number in range(count):
        pairs = [(world.time, world.nodes) for world in worlds(number, False)]
        print(f"set {number}: the planted law pushes like {equivalent_drag(pairs) / PLANTED:.3f} of it", flush=True)
    but_velocity = [k for k in range(6) if k != VELOCITY]
    steps: dict[str, Callable[[int], tuple[Floats, float]]] = {
        "constant law, exact points: drag alone": lambda n: fitted(exact(n, True), [DRAG]),
        "the same on a mesh of 25 mm": lambda n: fitted(exact(n, True), [DRAG], FINER),
        "constant law: all but velocity damping": lambda n: fitted(exact(n, True), but_velocity),
        "constant law: all parameters": lambda n: fitted(exact(n, True)),
        "planted law, exact points: drag alone": lambda n: fitted(exact(n, False), [DRAG]),
        "planted law: all but velocity damping": lambda n: fitted(exact(n, False), but_velocity),
        EXACT: lambda n: fitted(exact(n, False)),
        "with noise of the points: all": lambda n: fitted(exact(n, False, POINT_NOISE)),
        HELD_NOISY: lambda n: fitted(exact(n, False, 0.0, HELD_NOISE)),
        "camera: drag alone": lambda n: fitted(seen(n), [DRAG]),
        CAMERA: lambda n: fitted(seen(n)),
    }
    rows = dict[str, Floats]()
    for name, step in steps.items():
        found = [step(number) for number in range(count)]
        drags = rows[name] = np.array([parameters[DRAG] for parameters, _ in found]) / PLANTED
        middle = np.mean([parameters for parameters, _ in found], axis=0)
        print(
            f"{name:42s} {drags.mean():.3f} +- {standard_error(drags):.3f} ({', '.join(f'{d:.3f}' for d in drags)}); "
            f"bending {middle[2]:.1e} N m, {1e3 * middle[3]:.1f} ms; damping {middle[VELOCITY]:.2f} 1/s; "
            f"{np.mean([mm for _, mm in found]):.1f} mm", flush=True,
        )  # fmt: skip
    for of, beside in SHARES:
        share = 100 * (rows[of] - rows[beside])
        print(f"{of}, beside {beside}: {share.mean():+.1f} +- {standard_error(share):.1f} %")


def standard_error(values: Floats) -> float:
    """Return the standard error of the mean of some values; nan of one."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


if __name__ == "__main__":
    main(*[int(value) for value in (sys.argv[1:] or ["3"])])
