"""The synthetic world's own cloth: masses and springs on a grid, Verlet's leapfrog, double precision.

On purpose another discretisation than the fitter's, from which nothing is imported:
    threads    along rows and columns, k = E w / l (E membrane stiffness [N/m], w the width it stands for, l its length)
    shear      both diagonals of every cell. Sheared by gamma, a diagonal of length d of an h_x x h_y cell changes by
               gamma h_x h_y / d, so k_d = G d^2 / (2 h_x h_y) per diagonal gives 1/2 G gamma^2 per area. Stretched,
               diagonals pull too: along x the membrane stiffness is E + G (h_x / h_y)^2, so keep the cells near square
    bending    second differences along both threads, energy 1/2 B w / l^3 |x_- - 2 x + x_+|^2
    drag       -1/2 rho_air C(a) A |v_n| v_n n, C falling with the angle of attack a, sin(a) = |v_n| / |v|:
               C = c (0.05 + 0.95 sin(a)^1.5)
    damping    c v per mass, and of every thread in proportion to its stiffness
Sources: X. Provot, "Deformation constraints in a mass-spring model", GI 1995 (threads and diagonals); L. Verlet, Phys.
Rev. 159 (1967); plates at an angle: S. F. Hoerner, "Fluid-Dynamic Drag" (1965), chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.pattern import lay
from formats.arrays import Floats
from formats.garment import Garment
from formats.nature import AIR_DENSITY, GRAVITY

ROWS, COLUMNS = 18, 17
SETTLE_TIME, SETTLE_DAMPING = 1.5, 6.0  # s, 1/s
STEP_SHARE = 0.6  # of the stable step
HEM_SHARE = 0.8  # of the weight at most: the lighter the rest, the shorter the stable step


@dataclass(frozen=True, kw_only=True)
class ClothPhysics:
    """Membrane and shear stiffness [N/m], bending stiffness [N m], linear damping [1/s], thread damping time [s]."""

    stretch_stiffness: float = 300.0
    shear_stiffness: float = 40.0
    bending_stiffness: float = 3e-5
    linear_damping: float = 0.25
    thread_damping_time: float = 2e-5


def simulate(
    garment: Garment, held_ends: Callable[[Floats], Floats], times: Floats, *, physics: ClothPhysics,
    effects: dict[str, float], progress: Callable[[float], None] = lambda share: None, rows: int = ROWS,
    columns: int = COLUMNS, unevenness: Floats | None = None,
) -> Floats:  # fmt: skip
    """Return the nodes [m], (times, rows, columns, 3), sensor frame, of a garment.

    The garment is held along its whole top edge, or at its two top corners, as its description says.

    `rows` and `columns` count the nodes of a panel or of a T-shirt's body, whose sleeves have columns of their own.
    - `held_ends`: maps times [s], (n,), to left and right end of the top edge [m], (n, 2, 3); the cloth rests at time 0
    - `unevenness`: depth [m], (rows, columns), from which the cloth settles, so that slack cloth finds its folds

    Raises:
        SensorAddressError: an unknown effect, an amplitude that no cloth can have, or times that are not numbers.
    """
    _check_effects(garment, effects)
    if not np.isfinite(times).all():
        raise SensorAddressError("not all are finite numbers", where="frame times", advice="give a finite time offset")
    cloth = _Cloth(garment, physics, effects, rows, columns)
    step = cloth.stable_step()
    count = int(np.ceil(times[-1] / step)) + 2
    settle = round(SETTLE_TIME / step)
    ends = held_ends(np.asarray(np.arange(count + 1) * step, float))
    cloth.hang(ends[0])
    if unevenness is not None:
        cloth.x[..., 2] += unevenness
    for _ in range(settle):
        cloth.advance(ends[0], step, SETTLE_DAMPING)
    out = np.empty((len(times), *cloth.x.shape))
    frame = 0
    for number in range(count):
        while frame < len(times) and times[frame] < (number + 1) * step:
            out[frame] = cloth.x + (times[frame] - number * step) * cloth.v
            frame += 1
        if number % 500 == 0:
            progress(number / count)
        cloth.advance(ends[number + 1], step, 0.0)
    progress(1.0)
    return out


def _check_effects(garment: Garment, effects: dict[str, float]) -> None:
    highest = {"air_drag": np.inf}
    if len(garment.outline_m) == 4:
        *_, bottom_right, bottom_left = garment.outline_m
        hem_length = float(np.hypot(bottom_right[0] - bottom_left[0], bottom_right[1] - bottom_left[1]))
        highest["hem"] = HEM_SHARE * garment.mass_kg / hem_length
    for name, amplitude in effects.items():
        if name not in highest:
            raise SensorAddressError(
                f"the synthetic cloth has no effect {name!r}",
                where="--effect",
                advice=f"choose one of {', '.join(highest)}",
            )
        if not (np.isfinite(amplitude) and 0.0 <= amplitude <= highest[name]):
            limits = "a finite number of at least 0" if name == "air_drag" else f"0 to {highest[name]:.3g} kg/m"
            raise SensorAddressError(
                f"{name} cannot have the amplitude {amplitude:g}", where="--amplitude", advice=f"choose {limits}"
            )


class _Cloth:
    def __init__(
        self, garment: Garment, physics: ClothPhysics, effects: dict[str, float], rows: int, columns: int
    ) -> None:
        self.pattern = lay(garment, rows, columns)
        self.rest = rest = self.pattern.rest[..., :2]
        rows, columns, _ = rest.shape
        self.physics = physics
        self.drag = effects.get("air_drag", 0.0)
        first, second = rest[1:, 1:] - rest[:-1, :-1], rest[1:, :-1] - rest[:-1, 1:]
        cell = 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
        cell = np.where(self.pattern.is_cloth, cell, 0.0)
        area = np.zeros((rows, columns))
        for i in (slice(None, -1), slice(1, None)):
            for j in (slice(None, -1), slice(1, None)):
                area[i, j] += cell / 4
        bottom = np.where(self.pattern.is_cloth[-1], np.linalg.norm(np.diff(rest[-1], axis=0), axis=1), 0.0)
        hem = np.zeros((rows, columns))
        hem[-1, :-1] += bottom / 2
        hem[-1, 1:] += bottom / 2
        extra = effects.get("hem", 0.0)
        density = (garment.mass_kg - extra * bottom.sum()) / cell.sum()
        self.is_node = self.pattern.is_node
        self.mass = np.where(self.is_node, density * area + extra * hem, 1.0)[..., None]
        self.threads = self._threads(cell)
        self.bends = self._bends(cell)
        self.cell = cell
        self.weight = np.where(self.is_node, GRAVITY * self.mass[..., 0], 0.0)
        places = np.arange(columns)[self.pattern.held]
        self.held_share = np.linspace(0, 1, len(places))[:, None]
        if garment.held == "corners":
            places, self.held_share = places[[0, -1]], self.held_share[[0, -1]]
        self.held = (0, places)
        self.x = np.zeros((rows, columns, 3))
        self.v, self.f = np.zeros_like(self.x), np.zeros_like(self.x)

    def _threads(self, cell: Floats) -> list[tuple[Any, Any, Floats, Floats]]:
        """Springs as (from, to, length, stiffness)."""
        rest, physics = self.rest, self.physics
        whole, low, high = slice(None), slice(None, -1), slice(1, None)
        springs = []
        for a, b, across in (((whole, low), (whole, high), 0), ((low, whole), (high, whole), 1)):
            length = np.linalg.norm(rest[b] - rest[a], axis=-1)
            # The area on both sides of a thread, half each, over its length is the width it stands for.
            share = np.zeros(length.shape)
            if across == 0:
                share[:-1] += cell / 2
                share[1:] += cell / 2
            else:
                share[:, :-1] += cell / 2
                share[:, 1:] += cell / 2
            springs.append((a, b, length, physics.stretch_stiffness * share / length**2))
        for a, b in (((low, low), (high, high)), ((low, high), (high, low))):
            length = np.linalg.norm(rest[b] - rest[a], axis=-1)
            stiffness = physics.shear_stiffness * length**2 / (2 * np.where(cell > 0, cell, np.inf))
            springs.append((a, b, length, stiffness))
        return springs

    def _bends(self, cell: Floats) -> list[tuple[Any, Any, Any, Floats]]:
        rest, stiffness = self.rest, self.physics.bending_stiffness
        whole = slice(None)
        before, at, after = slice(None, -2), slice(1, -1), slice(2, None)
        mean = float(cell[cell > 0].mean())
        found = []
        for a, b, c in (((whole, before), (whole, at), (whole, after)), ((before, whole), (at, whole), (after, whole))):
            length = 0.5 * np.linalg.norm(rest[c] - rest[a], axis=-1)
            is_whole = self.is_node[a] & self.is_node[b] & self.is_node[c]
            found.append((a, b, c, np.where(is_whole, stiffness * mean / length**4, 0.0)))
        return found

    def stable_step(self) -> float:
        """Return a step [s] below 2 / omega of the stiffest node (sum of its springs over its mass)."""
        total = np.zeros(self.mass.shape[:2])
        for a, b, _, k in self.threads:
            total[a] += k
            total[b] += k
        for a, b, c, k in self.bends:
            total[a] += k
            total[b] += 4 * k
            total[c] += k
        return float(STEP_SHARE * 2 / np.sqrt((2 * total / self.mass[..., 0]).max()))

    def hang(self, ends: Floats) -> None:
        """Hang flat and straight down from the ends, (2, 3)."""
        held = self.rest[0, self.pattern.held, 0]
        along = (self.rest[..., 0] - held[0]) / np.ptp(held)
        self.x[:] = ends[0] + along[..., None] * (ends[1] - ends[0])
        self.x[..., 1] += self.rest[..., 1].max() - self.rest[..., 1]
        self.x[..., 2] += self.pattern.bulge
        self.v[:] = 0.0

    def advance(self, ends: Floats, step: float, extra_damping: float) -> None:
        """One kick and drift; the held edge goes to the ends, (2, 3)."""
        x, v, f = self.x, self.v, self.f
        f[:] = 0.0
        f[..., 1] = self.weight
        time = self.physics.thread_damping_time
        for a, b, length, stiffness in self.threads:
            apart, closing = x[b] - x[a], v[b] - v[a]
            now = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
            rate = np.einsum("ijk,ijk->ij", apart, closing) / now
            pull = (stiffness * (now - length + time * rate) / now)[..., None] * apart
            f[a] += pull
            f[b] -= pull
        for a, b, c, stiffness in self.bends:
            bend = stiffness[..., None] * (x[a] - 2 * x[b] + x[c])
            f[a] -= bend
            f[b] += 2 * bend
            f[c] -= bend
        if self.drag:
            self._add_drag()
        damping = 0.5 * step * (self.physics.linear_damping + extra_damping)
        v[:] = ((1 - damping) * v + step * f / self.mass) / (1 + damping)
        place = (1 - self.held_share) * ends[0] + self.held_share * ends[1]
        v[self.held] = (place - x[self.held]) / step
        x += step * v
        x[self.held] = place

    def _add_drag(self) -> None:
        x, v, f = self.x, self.v, self.f
        first, second = x[1:, 1:] - x[:-1, :-1], x[1:, :-1] - x[:-1, 1:]
        normal = np.cross(first, second)
        doubled = np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-15
        normal /= doubled
        wind = 0.25 * (v[1:, 1:] + v[:-1, :-1] + v[1:, :-1] + v[:-1, 1:])
        across = np.einsum("ijk,ijk->ij", wind, normal)[..., None]
        speed = np.linalg.norm(wind, axis=-1, keepdims=True) + 1e-12
        coefficient = self.drag * (0.05 + 0.95 * np.minimum(np.abs(across) / speed, 1.0) ** 1.5)
        force = -0.125 * AIR_DENSITY * coefficient * (0.5 * doubled) * np.abs(across) * across * normal
        force *= self.pattern.is_cloth[..., None]
        for i in (slice(None, -1), slice(1, None)):
            for j in (slice(None, -1), slice(1, None)):
                f[i, j] += force
