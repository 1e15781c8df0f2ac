"""Prepare raw recordings of swung cloth step by step, and print the held-out error after each step.

    benchmarks/real_cloth_steps.py FOLDER [--pictures DIR] [TAKE ...]

FOLDER holds the `.npz` recordings (docs/notebook/real-cloth.md). The named takes are fitted to, four of them unless
named. All others are held out. Each row adds one step to the row above and fits the cloth anew. It prints two errors
of the held-out takes, root mean square in millimetres:

- `points`: from the simulated points to the points as this step prepares them
- `surface`: from the raw points to the simulated cloth, wherever along it they are

With `--pictures`, each row draws what it leaves of one held-out take, as `DIR/step-N.png`.
Only `surface` uses the same points in every row, except for timestamps and skewed grids.
"""

from __future__ import annotations

import dataclasses
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.gap.fitting import Task, fit
from fit.identification.trivial import fitted_pendulum, pendulum
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.camera import CameraSteps
from fit.recordings.grids import grid_of
from fit.recordings.recording import Recording, prepare
from fit.report.residual_picture import draw_residuals
from formats.arrays import Floats
from formats.importers.swung_cloth import import_swung_cloth
from formats.take import Take

FITTED = ("range30_rep1", "range60_rep4", "range90_rep2", "range120_rep1")  # one of each size of swing
DRAWN = "range90_rep3"  # the held-out take of the pictures
SPACING = 0.033  # m, a ninth of the cloth: the diagnosis' own mesh
FINE = 10  # samples of the simulated surface between neighbours of the grid: 4 mm
RAW = CameraSteps(stamps=False, skew=False, edge=False, frames=False, places=False)
PLACED = CameraSteps(stamps=False, skew=False, frames=False)
TIMED = CameraSteps(frames=False)
ROWS: tuple[tuple[str, CameraSteps, tuple[str, ...]], ...] = (
    ("fitted cloth", RAW, ()),
    ("+ points at their material position, edge from the points", PLACED, ()),
    ("+ stamps, without skewed grids", TIMED, ()),
    ("+ added mass", TIMED, ("added_mass",)),
    ("+ a constant tilt", TIMED, ("added_mass", "gravity_tilt")),
    ("+ frames moved back by their held row", CameraSteps(), ("added_mass", "gravity_tilt")),
    ("+ drag", CameraSteps(), ("added_mass", "gravity_tilt", "air_drag")),
)


def prepared(paths: list[Path], steps: CameraSteps) -> list[Recording]:
    """Return recordings with these steps; without material positions the points count as fixed to the cloth."""
    takes = [import_swung_cloth(path) for path in paths]
    if not steps.places:
        takes = [_as_material(take) for take in takes]
    return [prepare(take, steps) for take in takes]


def _as_material(take: Take) -> Take:
    return dataclasses.replace(take, garment=replace(take.garment, points_are="material"))


def to_points(recordings: list[Recording], simulated: list[Floats]) -> float:
    """Return the root mean square distance of the judged points [mm]."""
    apart = [np.linalg.norm(s - r.points, axis=2)[r.counted] for r, s in zip(recordings, simulated, strict=True)]
    return 1e3 * float(np.sqrt((np.concatenate(apart) ** 2).mean()))


def to_surface(recordings: list[Recording], simulated: list[Floats]) -> float:
    """Root mean square distance of the raw points below the held row from the simulated surface [mm]."""
    from scipy.interpolate import RegularGridInterpolator
    from scipy.spatial import KDTree

    squares = []
    for recording, points in zip(recordings, simulated, strict=True):
        grid = grid_of(recording.garment)
        assert grid is not None
        rows, columns = grid.at.shape
        fine = np.stack(
            np.meshgrid(
                np.linspace(0, rows - 1, FINE * (rows - 1) + 1), np.linspace(0, columns - 1, FINE * (columns - 1) + 1),
                indexing="ij",
            ), -1,
        )  # fmt: skip
        for frame, seen in enumerate(recording.seen_points[:, grid.at[1:].ravel()]):
            there = seen[np.isfinite(seen).all(1)]
            if len(there):
                surface = RegularGridInterpolator((np.arange(rows), np.arange(columns)), points[frame][grid.at])(fine)
                squares.append(KDTree(surface.reshape(-1, 3)).query(there)[0] ** 2)
    return 1e3 * float(np.sqrt(np.concatenate(squares).mean()))


def shown(name: str, recordings: list[Recording], simulated: list[Floats], more: str = "") -> None:
    """Print one row."""
    frames = sum(int(r.valid.any(1).sum()) for r in recordings)
    errors = to_points(recordings, simulated), to_surface(recordings, simulated)
    print(f"{name:56s} {errors[0]:6.1f} {errors[1]:8.1f} {frames:7d}  {more}")
    sys.stdout.flush()


def main(folder: Path, names: tuple[str, ...], pictures: Path | None) -> None:
    """Print the table, and draw each row's residuals of the held-out take `DRAWN`, or of the first."""
    every = sorted(folder.glob("*.npz"))
    training = [path for path in every if path.stem in names]
    testing = [path for path in every if path.stem not in names]
    print(f"fitted to {', '.join(path.stem for path in training)}; judged on {len(testing)} others")
    print(f"{'':56s} {'points':>6s} {'surface':>8s} {'frames':>7s}  fitted")
    before: CameraSteps | None = None
    train: list[Recording] = []
    test: list[Recording] = []
    start = SI.initial
    drawn = [path.stem for path in testing].index(DRAWN) if DRAWN in {path.stem for path in testing} else 0
    for number, (name, steps, effects) in enumerate(ROWS, 1):
        if steps != before:
            train, test, before = prepared(training, steps), prepared(testing, steps), steps
            numbers = fitted_pendulum(train)
            about = f"L {numbers[0]:.2f} m, c {numbers[1]:g} 1/s"
            shown("  (a pendulum of two numbers)", test, [pendulum(r, *numbers) for r in test], about)
        resolution = Resolution(spacing=SPACING)
        observer = Observer(train, SI, find_effects(list(effects)), frequency=0.0, resolution=resolution)
        judge = observer.of(test)
        if not effects and steps == RAW:
            free = judge.trajectories(SI.initial[None], judge.off[None])
            shown("default parameters", test, [points[0] for points in free])
        starts = (start, SI.initial)
        best = min(fit(observer, [Task(v, observer.off, effects) for v in starts]), key=lambda one: one.cost)
        start = best.vector
        free = judge.trajectories(best.vector[None], best.amplitudes[None])
        sizes = [f"{p.name} {value:.3g}" for p, value in zip(SI.parameters, best.vector, strict=True)]
        columns = observer.columns
        sizes += [f"{effect} {np.round(best.amplitudes[columns[effect]], 3).tolist()}" for effect in effects]
        shown(name, test, [points[0] for points in free], ", ".join(sizes))
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            draw_residuals(
                test[drawn], free[drawn][0], pictures / f"step-{number}.png", f"{test[drawn].take_id}, {name}"
            )


if __name__ == "__main__":
    given = sys.argv[1:]
    where = Path(given.pop(given.index("--pictures") + 1)) if "--pictures" in given else None
    rest = [one for one in given if one != "--pictures"]
    main(Path(rest[0]), tuple(rest[1:]) or FITTED, where)
