"""Compare the cost of a swung swatch in other engines and ours: CPU seconds per candidate at equal error.

Run: python benchmarks/peers.py [--peer NAME ...]. The swatch measures 0.4 m x 0.4 m and is held along its top edge. It
has 0.2 kg/m^2, stretch 300 N/m, shear 30 N/m and bending 1e-5 N m. It is swung for 4 s with a damping of 0.5 1/s.

Every engine climbs a ladder of meshes and steps. Its error is the root mean square distance of 30 points from its own
finest run, over the points' own swing. The cheapest setting at or below ERROR counts. Without one, the best setting is
shown as a miss. The ratio is the median of REPEATS turns of ours and theirs.

Costs are CPU seconds of the stepping loop in one thread, without settling, start and building. Ours are of a batch of
sixteen candidates, with the packing of their arrays, times the unsettled share of the simulated seconds. Explicit
engines, ours among them, go up to 0.98 of the step that is stable by their linear bound. Shared machines slow all
alike, so only ratios are meaningful.

Each peer runs in a Python that a variable names: HANGTIME_MUJOCO_PYTHON and the same for NEWTON, PYPBD, PYBULLET and
BLENDER. A missing peer is skipped and reported. Newton's steps are recorded as a graph and replayed, without Python in
between (`peer_workers/newton_solvers_worker.py`). Some engines differ for lack of a choice. The only damping of pypbd
and PyBullet is their solvers' and springs'. Blender's cloth has 8 N/m and 0.3 kg a vertex: its solver stops early, and
a stiffer or lighter sheet floats (docs/reference/blind-check.md).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.clamps import steps_of
from fit import runtime
from fit.blind.engine import SAMPLES_A_SECOND, Cloth, Engine, held_fraction, hung, resample
from fit.blind.foreign.engines import MUJOCO
from fit.blind.foreign.jobs import make_job, points_on
from fit.blind.sheet import make_grid
from fit.errors import FitError
from fit.foreign.process import BLENDER, Foreign, ForeignProcess

ERROR = 0.03  # of the swing, rms: the error of the fitter's default mesh of 50 mm
SIZE, DURATION, SETTLE = 0.4, 4.0, 1.0  # m, s, s
CLOTH = Cloth(width=SIZE, height=SIZE, density=0.2, stretch=300.0, shear=30.0, bending=1e-5, damping=0.5)
GRID = 6  # points a side, of which the held row does not count
PLACES = np.array([(x, y) for y in np.linspace(0, -SIZE, GRID)[1:] for x in np.linspace(-0.5, 0.5, GRID) * SIZE])
REPEATS = 5
WORKERS = Path(__file__).with_name("peer_workers")
NEWTON = Foreign("Newton", "newton", "newton", "HANGTIME_NEWTON_PYTHON", WORKERS / "newton_solvers_worker.py")
PYPBD = Foreign("PositionBasedDynamics", "pypbd", "", "HANGTIME_PYPBD_PYTHON", WORKERS / "pypbd_worker.py")
PYBULLET = Foreign("PyBullet", "pybullet", "", "HANGTIME_PYBULLET_PYTHON", WORKERS / "pybullet_worker.py")
CANDIDATES = 16
# Mesh spacing [m], or cells a side, and the step in multiples of 0.7 of the linear bound; the last is the reference.
OUR_RUNGS = (
    (0.1, 1.4), (0.067, 1.0), (0.067, 1.3), (0.067, 1.4), (0.05, 1.4), (0.033, 1.0), (0.02, 0.5),
)  # fmt: skip
THEIR_RUNGS = (
    (6, 1.4), (8, 1.4), (10, 1.4), (11, 1.3), (11, 1.4), (12, 1.0), (12, 1.3), (12, 1.4), (16, 1.3), (32, 1.0),
)  # fmt: skip
FRAMES = 30  # of Blender, per second
BLENDER_STRETCH, BLENDER_MASS = 8.0, 0.3  # N/m; kg per vertex
Run = Callable[[], tuple[np.ndarray, float]]  # points (frames, points, 3) and CPU seconds of one candidate


def path() -> np.ndarray:
    """Return the ends of the held edge [m], (samples, 6): face-on at 0.8 Hz and 60 mm, ramped in over 0.6 s."""
    now = np.arange(round(DURATION * SAMPLES_A_SECOND) + 1) / SAMPLES_A_SECOND
    ramp = np.clip(now / 0.6, 0, 1) ** 3 * (10 - 15 * np.clip(now / 0.6, 0, 1) + 6 * np.clip(now / 0.6, 0, 1) ** 2)
    ends = np.zeros((len(now), 6))
    ends[:, [1, 4]] = (0.06 * np.sin(2 * np.pi * 0.8 * now) * ramp)[:, None]
    ends[:, 0], ends[:, 3] = -SIZE / 2, SIZE / 2
    return ends


def ours() -> Iterator[tuple[str, Run]]:
    """Run our cloth with sixteen candidates in lanes."""
    from fit.cloth.model import Resolution
    from fit.cloth.simulator import Simulator
    from fit.recordings.recording import prepare
    from tests.fit.scenes import hung as hung_points
    from tests.fit.scenes import material, sheet, take_of

    runtime.start(1)
    garment = sheet(SIZE, SIZE, mass=CLOTH.mass, grid=GRID)
    instants, ends = np.arange(0, DURATION + 1e-9, 1 / FRAMES), path()
    moved = np.stack([np.interp(instants, np.arange(len(ends)) / SAMPLES_A_SECOND, ends[:, c]) for c in range(3)], 1)
    recording = prepare(take_of(garment, instants, moved - ends[0, :3], hung_points(garment, instants)))
    row = material(
        garment, stretch_stiffness=CLOTH.stretch, shear_stiffness=CLOTH.shear, bending_stiffness=CLOTH.bending,
        velocity_damping=CLOTH.damping,
    )  # fmt: skip
    rows = np.repeat(row, CANDIDATES, axis=0)
    for spacing, share in OUR_RUNGS:
        usual = Simulator(recording, resolution=Resolution(spacing=spacing))
        step = share * usual.stable_steps(row, np.zeros((1, 0)))[0]
        resolution = Resolution(spacing=spacing, step_share=float(step / steps_of(usual, row)[0]))
        simulator = Simulator(recording, resolution=resolution)
        moving = DURATION / (DURATION + simulator.support.settle_time)

        def run(simulator: Simulator = simulator, moving: float = moving) -> tuple[np.ndarray, float]:
            simulator.run(rows)  # compiled, warm
            began = time.process_time()
            points = simulator.run(rows).points[0, :, GRID:]
            return points, moving * (time.process_time() - began) / CANDIDATES

        yield f"{1e3 * spacing:.0f} mm, {1e3 * step:.2f} ms", run


def explicit(foreign: Foreign, **settings: str | int) -> Iterator[tuple[str, Run]]:
    """An engine with an explicit integrator: meshes, and shares of 0.7 of the linear bound on its step."""
    process = ForeignProcess(foreign)
    for cells, share in THEIR_RUNGS:
        step = share * sheet_of(cells).stable_step
        yield f"{1e3 * SIZE / cells:.0f} mm, {1e3 * step:.2f} ms", job_run(process, cells, step, **settings)


def implicit(solver: str, rungs: Sequence[tuple[int, int, int]]) -> Iterator[tuple[str, Run]]:
    """One of Newton's solvers without a bound on its step: cells a side, steps a second, iterations a step."""
    process = ForeignProcess(NEWTON)
    for cells, hertz, iterations in rungs:
        title = f"{1e3 * SIZE / cells:.0f} mm, {hertz} steps a second of {iterations} iterations"
        yield title, job_run(process, cells, 1 / hertz, solver=solver, iterations=iterations)


def sheet_of(cells: int) -> Engine:
    """Return the cloth on a grid with this number of cells a side."""
    return Engine(CLOTH, side=SIZE / cells, mesh=make_grid)


def job_run(process: ForeignProcess, cells: int, step: float, **settings: str | int) -> Run:
    """One run of an engine that takes the blind check's jobs."""

    def run() -> tuple[np.ndarray, float]:
        job = make_job(sheet_of(cells), path()[None], DURATION, step=step, settle=SETTLE)
        answer = process.answer(**job.arrays, **{name: np.array(value) for name, value in settings.items()})
        seen = points_on(job.sheet, answer["nodes"].astype(float), PLACES)[0]
        at = np.arange(0, DURATION + 1e-9, 1 / FRAMES)
        return at_frames(seen, np.arange(len(seen)) / SAMPLES_A_SECOND, at), float(answer["seconds"].sum())

    return run


def at_frames(seen: np.ndarray, time: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """Return points at other instants, by linear interpolation."""
    columns = seen.reshape(len(seen), -1).T
    return np.stack([np.interp(instants, time, c) for c in columns], 1).reshape(len(instants), -1, 3)


def pypbd() -> Iterator[tuple[str, Run]]:
    """XPBD: meshes and substeps per frame of 1/30 s."""
    process = ForeignProcess(PYPBD)
    for cells, substeps in ((6, 20), (8, 20), (12, 33), (16, 33), (16, 67), (24, 67), (24, 133), (32, 533)):
        title = f"{1e3 * SIZE / cells:.0f} mm, {substeps} substeps a frame"
        yield title, job_run(process, cells, 1 / (FRAMES * substeps))


def pybullet() -> Iterator[tuple[str, Run]]:
    """Mass-spring soft bodies: meshes and steps a second."""
    process = ForeignProcess(PYBULLET)
    for cells, hertz in ((6, 1200), (8, 2400), (12, 2400), (16, 4800)):
        yield f"{1e3 * SIZE / cells:.0f} mm, {hertz} steps a second", job_run(process, cells, 1 / hertz)


def blender() -> Iterator[tuple[str, Run]]:
    """Blender's cloth: meshes and quality steps per frame."""
    process = ForeignProcess(BLENDER)
    for cells, quality in ((6, 5), (8, 5), (12, 5), (12, 10), (16, 10), (24, 40)):
        yield f"{1e3 * SIZE / cells:.0f} mm, quality {quality}", blender_run(process, cells, quality)


def blender_run(process: ForeignProcess, cells: int, quality: int) -> Run:
    """One run of Blender, masses and forces scaled up together."""

    def run() -> tuple[np.ndarray, float]:
        sheet = make_grid(SIZE, SIZE, SIZE / cells)
        frames = round((DURATION + SETTLE) * FRAMES) + 1
        ends = resample(path()[None], DURATION, np.clip(np.arange(frames) / FRAMES - SETTLE, 0, None))[0]
        places = np.repeat(hung(ends[:1], sheet), frames, 0)
        share = held_fraction(sheet)[None, :, None]
        places[:, sheet.held] = (1 - share) * ends[:, None, :3] + share * ends[:, None, 3:]
        node = np.arange(len(sheet.rest)).reshape(cells + 1, cells + 1)
        quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], -1).reshape(-1, 4)
        scale = BLENDER_MASS / (CLOTH.density * (SIZE / cells) ** 2)
        tension = BLENDER_STRETCH * scale * SIZE / cells
        settings = np.array([[BLENDER_MASS, tension, 0.05, 0.0, 0.0, 0.1 * tension]])
        answer = process.answer(
            quads=quads,
            pinned=sheet.held,
            fps=np.array(FRAMES),
            path=places,
            settings=settings,
            quality=np.array(quality),
        )
        nodes = answer["nodes"].astype(float)[:, round(SETTLE * FRAMES) :]
        # one second of settling, a fifth of the frames
        return points_on(sheet, nodes, PLACES)[0], float(answer["seconds"]) * DURATION / (DURATION + SETTLE)

    return run


def cheapest(name: str, ladder: Iterator[tuple[str, Run]]) -> tuple[Run, bool]:
    """Run the settings of a ladder, of which the last is the reference; print every result.

    Return the cheapest run within ERROR and True, or the run of the least error and False.
    """
    rungs = []
    for title, run in ladder:
        points, cost = run()
        rungs.append((title, points, cost, run))
        print(f"  {name}: {title}: {cost:.4f} s", flush=True)
    reference = rungs[-1][1]
    swing = np.sqrt(((reference - reference.mean(0)) ** 2).sum(2).mean())
    found = []
    for title, points, cost, run in rungs[:-1]:
        error = np.sqrt(((points - reference) ** 2).sum(2).mean()) / swing
        found.append((cost, error, title, run))
        print(f"  {name}: {title}: error {100 * error:.1f} % of {1e3 * swing:.0f} mm")
    good = [rung for rung in found if rung[1] <= ERROR]
    if good:
        cost, error, title, run = min(good, key=lambda rung: rung[0])
        print(f"{name:<12} {cost:8.4f} s a candidate, error {100 * error:.1f} %: {title}")
    else:
        cost, error, title, run = min((r for r in found if np.isfinite(r[1])), key=lambda rung: rung[1])
        print(f"{name:<12} never within {100 * ERROR:.0f} %: best {100 * error:.1f} % for {cost:.3f} s: {title}")
    return run, bool(good)


def in_turns(one: Run, other: Run) -> tuple[float, float, float]:
    """Return lower quartile, median and upper quartile of the ratio of the other's cost to the first one's."""
    ratios = [other()[1] / one()[1] for _ in range(REPEATS)]
    low, middle, high = np.percentile(ratios, [25, 50, 75])
    return float(low), float(middle), float(high)


# Single precision limits XPBD above 5000 steps a second, so its reference is not on the finest mesh.
XPBD_RUNGS = (
    (6, 1000, 1), (8, 1200, 1), (10, 1600, 1), (11, 1600, 1), (12, 1600, 1), (12, 1600, 2), (13, 1600, 1),
    (13, 2000, 1), (13, 2000, 2), (14, 2000, 1), (16, 2400, 1), (24, 3200, 2),
)  # fmt: skip
VBD_RUNGS = (
    (8, 1200, 3), (12, 800, 10), (12, 1200, 5), (12, 1200, 6), (12, 1200, 8), (12, 1600, 4), (12, 1600, 5),
    (12, 2400, 2), (12, 2400, 3), (13, 1600, 4), (24, 2400, 8),
)  # fmt: skip
PEERS: dict[str, tuple[Foreign, Callable[[], Iterator[tuple[str, Run]]]]] = {
    "pypbd": (PYPBD, pypbd),
    "mujoco": (MUJOCO.foreign or BLENDER, lambda: explicit(MUJOCO.foreign or BLENDER)),
    "newton": (NEWTON, lambda: explicit(NEWTON, solver="semi-implicit")),
    "newton-xpbd": (NEWTON, lambda: implicit("xpbd", XPBD_RUNGS)),
    "newton-vbd": (NEWTON, lambda: implicit("vbd", VBD_RUNGS)),
    "pybullet": (PYBULLET, pybullet),
    "blender": (BLENDER, blender),
}


def main() -> None:
    """Print the cost of every engine at equal error, and its ratio to ours."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--peer", action="append", choices=sorted(PEERS), help="only this one; may be repeated")
    asked = parser.parse_args().peer or list(PEERS)
    os.environ["OMP_NUM_THREADS"] = "1"  # of the peers' processes, and of Taichi too
    base, _ = cheapest("ours", ours())
    for name in asked:
        foreign, ladder = PEERS[name]
        if not foreign.is_installed():
            print(
                f"{name:<12} skipped: {foreign.module} is in neither this Python nor the one {foreign.variable} names"
            )
            continue
        try:
            best, is_good = cheapest(name, ladder())
            low, middle, high = in_turns(base, best)
        except FitError as error:
            print(f"{name:<12} failed: {error}")
            continue
        least = "" if is_good else ", at an error that is larger than ours"
        print(f"{name:<12} {middle:.0f} times ours (quartiles {low:.0f} to {high:.0f}){least}", flush=True)


if __name__ == "__main__":
    main()
