"""The effects that cases contain, with the generator's own laws, and their sizes.

Each plant changes the plan of the cloth, the path of the held nodes, or what the tracker makes of the true points.
Sizes are
drawn log-uniformly from half to three times the typical one, independently of everything else in a case. Equations,
ranges and sources: KES handbooks, Hoerner (drag), Brennen (added mass), Khoshelham & Elberink (depth), as in
`docs/diagnosis.md`; what differs from the diagnosis' own laws is said at each plant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fit.blind.engine import SAMPLES, Plan
from fit.blind.motions import minimum_jerk
from fit.blind.sheet import Sheet

Floats = NDArray[np.float64]


@dataclass
class Case:
    """What plants work on. paths [m]: per take (samples, held, 3); times [s]: per take when its points are seen."""

    sheet: Sheet
    plan: Plan
    paths: list[Floats]
    times: list[Floats]
    places: Floats
    rng: np.random.Generator
    observers: list[Callable[[Floats, Floats], Floats]] = field(default_factory=list)
    hanger_scale: float = 1.0


@dataclass(frozen=True)
class Plant:
    """One effect of the generator: its id, typical size, unit, place (if it is local) and what it does to a case."""

    name: str
    typical: float
    unit: str
    apply: Callable[[Case, float], None]
    place: str = ""


def _direction(rng: np.random.Generator, count: int) -> Floats:
    way = rng.normal(size=count)
    return np.asarray(way / np.linalg.norm(way))


def _extra(case: Case, **numbers: float) -> None:
    case.plan = replace(case.plan, extra={**case.plan.extra, **numbers})


def _mass(case: Case) -> Floats:
    even = case.sheet.node_area * case.plan.density
    return even if case.plan.node_mass is None else case.plan.node_mass


def _hysteresis(case: Case, size: float) -> None:
    """Prandtl's elastic-sliding element instead of Dahl's curve."""
    _extra(case, friction=size)


def _rest_curvature(case: Case, size: float) -> None:
    down, across = size * _direction(case.rng, 2)
    case.plan = replace(case.plan, rest_curvature=(float(down), float(across)))


def _hem(case: Case, size: float) -> None:
    """A band of 15 mm at the bottom instead of a line."""
    mass, y = _mass(case), case.sheet.rest[:, 1]
    band = np.clip(1 - (y - y.min()) / 0.03, 0, None) * case.sheet.node_area
    length = float(np.ptp(case.sheet.rest[:, 0]))
    extra = band / band.sum() * size * length
    total = mass.sum()
    case.plan = replace(case.plan, node_mass=mass * (1 - extra.sum() / total) + extra)


def _anisotropy(case: Case, size: float) -> None:
    half = np.exp(0.5 * size * case.rng.choice([-1, 1]))
    plan = case.plan
    case.plan = replace(
        plan, warp=plan.warp * half, weft=plan.weft / half, bending=(plan.bending[0] * half, plan.bending[1] / half)
    )


def _mass_distribution(case: Case, size: float) -> None:
    """A smooth step instead of a slope."""
    rest, mass = case.sheet.rest, _mass(case)
    place = (rest - rest.mean(0)) / (np.ptp(rest, axis=0) / 2) @ (_direction(case.rng, 2) * [1, -1])
    tilted = mass * np.clip(1 + size * np.tanh(1.3 * place) / np.tanh(1.3), 0.1, None)
    case.plan = replace(case.plan, node_mass=tilted * mass.sum() / tilted.sum())


def _moved(case: Case, change: Callable[[Floats, Floats], Floats]) -> None:
    case.paths = [change(path, np.arange(len(path)) / SAMPLES) for path in case.paths]


def _compliance(case: Case, size: float) -> None:
    """A two-stage rod: the same static compliance, integrated step by step, damped by 15 % instead of 10 %."""
    omega, dt = 1 / np.sqrt(size), 1 / SAMPLES

    def bend(path: Floats, t: Floats) -> Floats:
        middle = path.mean(1)
        acceleration = np.gradient(np.gradient(middle, dt, axis=0), dt, axis=0)
        e, rate = np.zeros(3), np.zeros(3)
        out = np.zeros_like(middle)
        for k, a in enumerate(acceleration):
            for _ in range(4):
                rate = rate + dt / 4 * (-a - omega**2 * e - 2 * 0.15 * omega * rate)
                e = e + dt / 4 * rate
            out[k] = e
        return np.asarray(path + out[:, None])

    _moved(case, bend)


def _rotation(case: Case, size: float) -> None:
    """The bar turns in the hand, unseen by the hanger's markers, at a pace of its own."""
    hertz, phase = case.rng.uniform(0.3, 1.2), case.rng.uniform(0, 2 * np.pi)
    yaw, roll = size * np.sqrt(2) * _direction(case.rng, 2)

    def turn(path: Floats, t: Floats) -> Floats:
        course = np.sin(2 * np.pi * hertz * t + phase) * minimum_jerk(t / 0.5)
        middle = path.mean(1, keepdims=True)
        arm = path - middle
        a, b = (yaw * course)[:, None], (roll * course)[:, None]
        x = arm[..., 0] * np.cos(a) * np.cos(b)
        return np.asarray(
            middle + np.stack([x, arm[..., 1] + arm[..., 0] * np.sin(a), arm[..., 2] + arm[..., 0] * np.sin(b)], 2)
        )

    _moved(case, turn)


def _offset(case: Case, size: float) -> None:
    way = size * _direction(case.rng, 3)
    _moved(case, lambda path, t: path + way)


def _slip(case: Case, size: float) -> None:
    """The slip takes 30 ms and tapers along the bar."""
    left, right = np.abs(_direction(case.rng, 2)) * size

    def slip(path: Floats, t: Floats) -> Floats:
        middle = path.mean(1)
        hardest = np.linalg.norm(np.gradient(np.gradient(middle, axis=0), axis=0), axis=1)
        at = t[2:-2][int(np.argmax(hardest[2:-2]))] + 0.02
        share = np.linspace(0, 1, path.shape[1])
        down = (left * (1 - share) + right * share)[None] * minimum_jerk((t - at) / 0.03)[:, None]
        return np.asarray(path - np.stack([0 * down, 0 * down, down], 2))

    _moved(case, slip)


def _slack(case: Case, size: float) -> None:
    sign = case.rng.choice([-1.0, 1.0])

    def closer(path: Floats, t: Floats) -> Floats:
        middle = path.mean(1, keepdims=True)
        length = np.linalg.norm(path[:, -1] - path[:, 0], axis=1)[:, None, None]
        return np.asarray(middle + (path - middle) * (1 - sign * size / length))

    _moved(case, closer)


def _added_mass(case: Case, size: float) -> None:
    """Even over the sheet but for a border of 50 mm, instead of an ellipse."""
    rest = case.sheet.rest
    edge = np.min(np.concatenate([rest - rest.min(0), rest.max(0) - rest], 1), axis=1)
    case.plan = replace(case.plan, added=0.8 * size * case.sheet.node_area * minimum_jerk(edge / 0.05))


def _draught(case: Case, size: float) -> None:
    way = case.rng.uniform(0, 2 * np.pi)
    _extra(case, wx=float(size * np.cos(way)), wy=float(size * np.sin(way)))


def _tilt(case: Case, size: float) -> None:
    way = case.rng.uniform(0, 2 * np.pi)
    down = 9.80665 * np.cos(size)
    _extra(
        case, gx=float(9.80665 * np.sin(size) * np.cos(way)), gy=float(9.80665 * np.sin(size) * np.sin(way)), gz=-down
    )


def _late(case: Case, size: float) -> None:
    late = size * case.rng.choice([-1.0, 1.0])
    case.times = [t - late for t in case.times]


def _drift(case: Case, size: float) -> None:
    case.times = [t * (1 - size) for t in case.times]


def _observed(case: Case, change: Callable[[Floats, Floats], Floats]) -> None:
    case.observers.append(change)


def _depth(case: Case, size: float) -> None:
    """Everything the sensor sees, or the points alone, scaled about a sensor at the origin."""
    scale = 1 + size * case.rng.choice([-1.0, 1.0])
    if case.rng.random() < 0.5:
        case.hanger_scale = scale
    _observed(case, lambda points, t: points * scale)


def _lag(case: Case, size: float) -> None:
    """Exponential smoothing frame by frame."""

    def smooth(points: Floats, t: Floats) -> Floats:
        out = points.copy()
        for k in range(1, len(points)):
            out[k] = out[k - 1] + (1 - np.exp(-(t[k] - t[k - 1]) / size)) * (points[k] - out[k - 1])
        return out

    _observed(case, smooth)


def _erosion(case: Case, size: float) -> None:
    """Free corners, and half as much their neighbours within 60 mm."""
    places = case.places
    low = places[:, 1].min()
    corners = np.array([[places[:, 0].min(), low], [places[:, 0].max(), low]])
    reach = np.exp(-((np.linalg.norm(places[:, None] - corners[None], axis=2).min(1) / 0.03) ** 2))

    def erode(points: Floats, t: Floats) -> Floats:
        way = points.mean(1, keepdims=True) - points
        return np.asarray(
            points + size * reach[:, None] * way / np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-9)
        )

    _observed(case, erode)


def _ironed(case: Case, size: float) -> None:
    """Gaussian smoothing over the grid, mirrored at the border."""
    side = round(np.sqrt(len(case.places)))

    def iron(points: Floats, t: Floats) -> Floats:
        if side * side != len(case.places):
            return points
        grid = points.reshape(len(points), side, side, 3)
        for axis in (1, 2):
            ends = [np.take(grid, [k], axis) for k in (0, 1, -2, -1)]
            before, after = 2 * ends[0] - ends[1], 2 * ends[3] - ends[2]
            wide = np.concatenate([before, grid, after], axis)
            left, right = np.take(wide, range(side), axis), np.take(wide, range(2, side + 2), axis)
            grid = (1 - size / 2) * grid + size / 4 * (left + right)
        return np.asarray(grid.reshape(points.shape))

    _observed(case, iron)


def _magnet(case: Case, size: float) -> None:
    rest = case.sheet.rest
    _extra(case, magnet=size, mx=float(case.rng.uniform(-0.3, 0.3) * np.ptp(rest[:, 0])),
           my=float(case.paths[0][0, :, 1].mean() + case.rng.choice([-1, 1]) * 0.04),
           mz=float(case.paths[0][0, :, 2].mean() + 0.8 * rest[:, 1].min()))  # fmt: skip


def _wall(case: Case, size: float) -> None:
    _extra(case, wall=size, wall_y=float(case.paths[0][0, :, 1].mean() + 0.015))


PLANTS = {
    p.name: p
    for p in (
        Plant("bending_hysteresis", 3e-4, "N", _hysteresis),
        Plant("rest_curvature", 6.0, "1/m", _rest_curvature),
        Plant("hem", 0.012, "kg/m", _hem, place="bottom"),
        Plant("anisotropy", 0.8, "1", _anisotropy),
        Plant("strain_stiffening", 40.0, "1", lambda c, a: _extra(c, stiffening=a)),
        Plant("stretch_viscosity", 1.5e-3, "s", lambda c, a: _extra(c, membrane_viscosity=a)),
        Plant("mass_distribution", 0.35, "1", _mass_distribution),
        Plant("hanger_compliance", 8e-4, "s^2", _compliance),
        Plant("hanger_rotation", 0.04, "rad", _rotation),
        Plant("attachment_offset", 0.01, "m", _offset),
        Plant("clip_slip", 0.006, "m", _slip),
        Plant("clip_slack", 0.006, "m", _slack),
        Plant("air_drag", 1.0, "1", lambda c, a: _extra(c, drag=a)),
        Plant("added_mass", 0.1, "kg/m^2", _added_mass),
        Plant("draught", 0.3, "m/s", _draught),
        Plant("air_lift", 3.0, "1", lambda c, a: _extra(c, lift=a)),
        Plant("time_offset", 0.015, "s", _late),
        Plant("gravity_tilt", 0.025, "rad", _tilt),
        Plant("depth_scale", 0.01, "1", _depth),
        Plant("filter_lag", 0.02, "s", _lag),
        Plant("corner_erosion", 0.008, "m", _erosion, place="bottom"),
        Plant("clock_drift", 0.006, "1", _drift),
        Plant("tracker_smoothing", 0.5, "1", _ironed),
    )
}

# What no library has: the air's memory of its wake, a magnet beside the cloth, a wall that it touches.
STRANGERS = {
    p.name: p
    for p in (
        Plant("wake_memory", 0.6, "1", lambda c, a: _extra(c, wake=a)),
        Plant("magnet", 6.0, "m/s^2", _magnet, place="bottom"),
        Plant("wall", 2000.0, "1/s^2", _wall, place="bottom"),
    )
}
