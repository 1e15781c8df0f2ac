"""Run the generator: from a plan of one take to the true positions of its points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.blind.sheet import Sheet, locate
from fit.errors import BlowUpError

Floats = NDArray[np.float64]

SETTLE = 1.5  # s at the first pose, strongly damped
SAMPLES = 500.0  # per second of the path
SAFETY = 0.35  # of the time a membrane wave takes across the thinnest triangle


@dataclass
class Plan:
    """Everything about the cloth of one case that does not change from take to take.

    warp, weft, shear [N/m], poisson [1], bending [N m] (down, across), density [kg/m^2], damping [1/s]
    node_mass [kg], (nodes,), or None for even cloth; added [kg], (nodes,); rest_curvature [1/m]: function of the
    unit vector square to each hinge, (hinges, 2) -> (hinges,); extra: further numbers of `fit.blind.swing.PARAMETERS`
    """

    warp: float
    weft: float
    shear: float
    poisson: float
    bending: tuple[float, float]
    density: float
    damping: float
    node_mass: Floats | None = None
    added: Floats | None = None
    rest_curvature: tuple[float, float] = (0.0, 0.0)
    extra: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Drive:
    """One take: path of the held nodes [m], (samples, held, 3), at SAMPLES per second, and when points are seen [s]."""

    path: Floats
    frames: Floats


def simulate(sheet: Sheet, plan: Plan, drives: list[Drive], places: Floats) -> list[Floats]:
    """Return the true points of every take [m], each (frames, points, 3).

    Raises:
        BlowUpError: a take became unstable.
    """
    runtime.start()
    from fit.blind.swing import PARAMETERS, swing

    takes, nodes = len(drives), len(sheet.rest)
    numbers = {
        "warp": plan.warp, "weft": plan.weft, "poisson": plan.poisson, "shear": plan.shear, "damping": plan.damping,
        "gz": -9.80665, **plan.extra,
    }  # fmt: skip
    row = np.array([numbers.get(name, 0.0) for name in PARAMETERS])
    mass = sheet.node_area * plan.density if plan.node_mass is None else plan.node_mass
    added = np.zeros(nodes) if plan.added is None else plan.added
    squared = sheet.across**2
    stiffness = squared @ np.array([plan.bending[1], plan.bending[0]])
    rest = squared @ np.array([plan.rest_curvature[1], plan.rest_curvature[0]])
    dt = _step(sheet, plan, row, stiffness, mass)
    longest = max(d.path.shape[0] for d in drives)
    path = np.stack([np.concatenate([d.path, np.repeat(d.path[-1:], longest - len(d.path), 0)]) for d in drives])
    frames = max(len(d.frames) for d in drives)
    times = np.stack([np.concatenate([d.frames, np.full(frames - len(d.frames), 1e9)]) for d in drives])
    point_nodes, point_weights = locate(sheet, places)
    held = np.zeros(nodes, np.int32)
    held[sheet.top] = 1
    seen = np.zeros((takes, frames, len(places), 3))
    steps = int(np.ceil(max(d.frames[-1] for d in drives) / dt)) + 2
    repeat = lambda a: np.ascontiguousarray(np.repeat(a[None], takes, 0))  # noqa: E731
    swing(
        _hung(sheet, path[:, 0]), np.zeros((takes, nodes, 3)), np.zeros((takes, nodes, 3)), np.zeros((takes, nodes, 3)),
        repeat(rest), np.zeros((takes, nodes)), sheet.triangles, sheet.inverse, sheet.area, sheet.hinges,
        sheet.hinge_weights, repeat(stiffness), repeat(rest), sheet.hinge_scale, repeat(mass), repeat(added),
        repeat(row), sheet.top, path, SAMPLES, held, point_nodes, point_weights, times, seen, dt, int(SETTLE / dt),
        steps, int(numbers.get("friction", 0) > 0 or any(plan.rest_curvature)),
        int(any(numbers.get(k, 0.0) > 0 for k in ("magnet", "wall", "wake"))),
    )  # fmt: skip
    found = [seen[k, : len(d.frames)] for k, d in enumerate(drives)]
    if not all(np.isfinite(f).all() and np.abs(f).max() < 50 for f in found):
        raise BlowUpError("the generator's cloth became unstable", where="blind case", advice="use another seed")
    return found


def _step(sheet: Sheet, plan: Plan, row: Floats, stiffness: Floats, mass: Floats) -> float:
    """Return a stable step [s]: membrane waves, membrane viscosity, and bending by Gershgorin's bound."""
    corners = sheet.rest[sheet.triangles]
    longest = np.max(
        [np.linalg.norm(corners[:, a] - corners[:, b], axis=1) for a, b in ((0, 1), (1, 2), (2, 0))], axis=0
    )
    thinnest = float((2 * sheet.area / longest).min())
    density = float((mass / sheet.node_area).min())
    modulus = (max(plan.warp, plan.weft) * (1 + plan.poisson) + plan.shear) * (1 + 0.05 * float(row[4]))
    wave = SAFETY * 2 * thinnest / np.sqrt(modulus / density)
    rows = np.zeros(len(mass))
    size = np.abs(sheet.hinge_weights)
    extra = stiffness + float(row[8]) / 6.0
    np.add.at(rows, sheet.hinges, size * (size.sum(1) * extra)[:, None])
    bend = 1.2 / np.sqrt((rows / mass).max())
    slow = np.zeros(len(mass))
    np.add.at(slow, sheet.hinges, size * (size.sum(1) * float(row[6]))[:, None])
    bending_viscous = 0.5 / max(float((slow / mass).max()), 1e-9)
    membrane_viscous = 0.15 * thinnest**2 * density / max(modulus * float(row[5]), 1e-12)
    return float(min(wave, bend, bending_viscous, membrane_viscous, 5e-4))


def _hung(sheet: Sheet, first: Floats) -> Floats:
    """Flat cloth hanging from the first held pose, (takes, nodes, 3)."""
    shape = np.empty((len(first), len(sheet.rest), 3))
    x = sheet.rest[sheet.top, 0]
    for t, held in enumerate(first):
        for c in range(3):
            shape[t, :, c] = np.interp(sheet.rest[:, 0], x, held[:, c])
        shape[t, :, 2] += sheet.rest[:, 1]
    return shape
