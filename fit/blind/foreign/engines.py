"""Registry of the generators, our own and third-party simulators, with the effects that each can plant.

Effects of boundary and measurement act on the held edge's path and on the points, so that every engine supports them.
Other effects need access to an engine's masses, damping or forces at the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit.blind.engine import TRIANGLE_SIDE, Cloth, Engine
from fit.blind.foreign.jobs import make_job, points_on
from fit.blind.plants import PLANTS, UNKNOWNS, Plant, choose_plants
from fit.blind.sheet import make_grid
from fit.errors import BlowUpError, unknown_name
from fit.foreign.process import Foreign, ForeignProcess
from formats.arrays import Floats

WORKERS = Path(__file__).with_name("workers")
FARTHEST_NODE = 100.0  # m: far outside any room
# effects that every engine supports: of path, tracker and gravity's direction
ANYWHERE = (*(p.id for p in PLANTS if p.acts_on in {"boundary", "measurement"}),)
OUTSIDE = ("air_drag", "draught", "air_lift")  # forces at the nodes


@dataclass(frozen=True)
class Generator:
    """A generator of blind cases; `foreign` is None for our own. side [m]: default side of its mesh."""

    name: str
    side: float
    effects: tuple[str, ...]
    unknowns: tuple[str, ...]
    foreign: Foreign | None = None

    def plants(self, names: list[str]) -> tuple[Plant, ...]:
        """Return the library's effects of these names; without names, all that this generator supports.

        Raises:
            FitError: a name that cannot be planted.
        """
        return choose_plants(names, self.effects, f"with the generator {self.name}")

    def unknown_plants(self) -> tuple[Plant, ...]:
        """Return the effects outside the library that this generator supports."""
        return tuple(plant for plant in UNKNOWNS if plant.id in self.unknowns)

    def points(
        self, cloth: Cloth, ends: Floats, duration: float, places: Floats, *, side: float, share: float = 1.0
    ) -> Floats:
        """Return the points [m], (takes, samples, points, 3), of a swung cloth, `engine.SAMPLES` a second.

        ends [m], (takes, n, 6), evenly spaced over duration [s]; places [m], (points, 2); side [m] of the mesh;
        share: of the usual step

        Raises:
            BlowUpError: the simulation did not stay finite. FitError: the engine is not there.
        """
        if self.foreign is None:
            return Engine(cloth, side=side, step_share=share).run(ends, duration, places).points
        engine = Engine(cloth, side=side, mesh=make_grid)
        job = make_job(engine, ends, duration, step=share * engine.stable_step)
        process = ForeignProcess(self.foreign)
        try:
            nodes = process.answer(**job.arrays)["nodes"].astype(float)
        finally:
            process.close()
        if not (np.abs(nodes) < FARTHEST_NODE).all():
            raise BlowUpError(
                f"{self.foreign.name}'s cloth flew apart",
                where=f"side {side} m",
                advice="make the case with another seed",
            )
        return points_on(job.sheet, nodes, places)


MUJOCO = Generator(
    "mujoco", 0.02, (*ANYWHERE, *OUTSIDE, "hem", "mass_distribution", "anisotropy", "stretch_viscosity"),
    tuple(p.id for p in UNKNOWNS),
    Foreign("MuJoCo", "mujoco", "mujoco", "HANGTIME_MUJOCO_PYTHON", WORKERS / "mujoco_worker.py"),
)  # fmt: skip
NEWTON = Generator(
    "newton", 0.02, (*ANYWHERE, *OUTSIDE, "hem", "mass_distribution", "anisotropy", "stretch_viscosity"),
    tuple(p.id for p in UNKNOWNS),
    Foreign("Newton", "newton", "newton", "HANGTIME_NEWTON_PYTHON", WORKERS / "newton_worker.py"),
)  # fmt: skip
OWN_GENERATOR = Generator("own", TRIANGLE_SIDE, tuple(p.id for p in PLANTS), tuple(p.id for p in UNKNOWNS))
GENERATORS: tuple[Generator, ...] = (OWN_GENERATOR, MUJOCO, NEWTON)


def find_generator(name: str, where: str | None = None) -> Generator:
    """Return the generator of a name.

    Raises:
        FitError: there is none.
    """
    known = {generator.name: generator for generator in GENERATORS}
    if name not in known:
        raise unknown_name("generator", name, known, where=where, listed="known")
    return known[name]
