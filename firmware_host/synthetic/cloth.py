"""The cloth simulation of the synthetic world: masses and springs on a grid, Verlet's leapfrog, double precision.

The discretisation deliberately differs from the fitter's, from which it imports nothing:
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

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.pattern import lay
from formats.arrays import Floats, Integers
from formats.garment import Garment
from formats.nature import AIR_DENSITY, GRAVITY

Nodes = tuple[slice, slice]  # of the grid

ROWS, COLUMNS = 18, 17  # nodes of a panel; our choice: near 30 mm apart on half a metre
# s and 1/s that the cloth hangs before a take, and is damped. Our choice: 1.1 % of the first motion are left, by
# e^(-6 x 1.5 / 2). At half of either 11 % are left; twice the time costs 1.5 s more of simulation.
HANGS_FOR, SETTLE_DAMPING = 1.5, 6.0
# Of the stable step, by the bound below. Our choice: on the demo's skirt in a swing, 1.2 was finite, and 1.4 was not
# (measured). Half takes twice the time.
STEP_SHARE = 0.6
MOST_DRAG = 100.0  # 1: a plate across the air has 1.2; up to here the hardest motion and silk stay finite
HEM_SHARE = 0.8  # of the weight at most: the lighter the remaining cloth, the shorter the stable step


@dataclass(frozen=True, kw_only=True)
class ClothPhysics:
    """Membrane and shear stiffness [N/m], bending stiffness [N m], linear damping [1/s], thread damping time [s]."""

    stretch_stiffness: float = 300.0  # our choice: of the order of medium weaves
    shear_stiffness: float = 40.0  # our choice: within the 11 to 220 N/m of KES shear tests
    bending_stiffness: float = 3e-5  # our choice: twice the median of 618 fabrics, ClothDrapeTester (2022)
    linear_damping: float = 0.25  # our choice: a swing's amplitude falls by an eighth in a second
    thread_damping_time: float = 2e-5  # our choice: so short that it hardly shortens the step


def simulate(
    garment: Garment, held_ends: Callable[[Floats], Floats], times: Floats, *, physics: ClothPhysics,
    effects: dict[str, float], progress: Callable[[float], None] = lambda share: None, rows: int = ROWS,
    columns: int = COLUMNS, unevenness: Floats | None = None,
) -> Floats:  # fmt: skip
    """Return the nodes [m], (times, rows, columns, 3), sensor frame, of a garment.

    The garment is held along its whole top edge, or at its two top corners, as its description says.

    `rows` and `columns` count the nodes of a panel or of a T-shirt's body, whose sleeves have columns of their own.
    - `held_ends`: maps times [s], (n,), to left and right end of the top edge [m], (n, 2, 3); the cloth rests at time 0
    - `unevenness`: initial depth [m], (rows, columns), from which the cloth settles, so that slack cloth can fold

    Raises:
        SensorAddressError: an unknown effect, an amplitude that no cloth can have, or times that are not numbers.
    """
    _check_effects(garment, effects)
    if not np.isfinite(times).all():
        raise SensorAddressError("not all are finite numbers", where="frame times", advice="give a finite time offset")
    cloth = _Cloth(garment, physics, effects, rows, columns)
    step = cloth.stable_step()
    count = int(np.ceil(times[-1] / step)) + 2
    settle = round(HANGS_FOR / step)
    ends = held_ends(np.asarray(np.arange(count + 1) * step, float))
    cloth.hang(ends[0])
    if unevenness is not None:
        cloth.x[2] += unevenness.ravel()
    for _ in range(settle):
        cloth.advance(ends[0], step, SETTLE_DAMPING)
    out = np.empty((len(times), *cloth.pattern.rest.shape))
    frame = 0
    for number in range(count):
        while frame < len(times) and times[frame] < (number + 1) * step:
            out[frame] = (cloth.x + (times[frame] - number * step) * cloth.v).T.reshape(out.shape[1:])
            frame += 1
        if number % 500 == 0:
            progress(number / count)
        cloth.advance(ends[number + 1], step, 0.0)
    progress(1.0)
    return out


def _check_effects(garment: Garment, effects: dict[str, float]) -> None:
    highest = {"air_drag": MOST_DRAG}
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
            unit = " kg/m" if name == "hem" else ""
            raise SensorAddressError(
                f"{name} cannot have the amplitude {amplitude:g}", where="--amplitude",
                advice=f"choose 0 to {highest[name]:.3g}{unit}",
            )  # fmt: skip


class _Cloth:
    """The cloth's masses and springs, and its state.

    Nodes count along the grid's rows. Springs of one kind are arrays, so that a step costs few calls of numpy.

    - `x` [m], `v` [m/s], (3, nodes)
    - `threads`: the nodes at both ends, (2, threads), and rest length [m] and stiffness [N/m], (threads,)
    - `bends`: three nodes in a row, (3, bends), and stiffness [N/m], (bends,)
    - `corners`: nodes of each cell of cloth, (4, cells): across from the first is the last
    """

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
        self.mass = np.where(self.is_node, density * area + extra * hem, 1.0)
        self.cell = cell
        self.weight = np.where(self.is_node, GRAVITY * self.mass, 0.0).ravel()
        self.node = node = np.arange(rows * columns).reshape(rows, columns)
        self.threads = self._threads()
        self.bends = self._bends()
        corners = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]])
        self.corners = corners[:, self.pattern.is_cloth]
        pulled = [self.threads[0], self.bends[0], *([self.corners] if self.drag else [])]
        self._pulled = np.concatenate([nodes.ravel() for nodes in pulled])  # the node of each force in a step
        places = np.arange(columns)[self.pattern.held]
        self.held_share = np.linspace(0, 1, len(places))
        if garment.held == "corners":
            places, self.held_share = places[[0, -1]], self.held_share[[0, -1]]
        self.held = places  # of the first row
        self._all = np.zeros((6, rows * columns))
        self.x, self.v = self._all[:3], self._all[3:]

    def _threads(self) -> tuple[Integers, Floats, Floats]:
        rest, cell, physics = self.rest, self.cell, self.physics
        whole, low, high = slice(None), slice(None, -1), slice(1, None)
        ends: list[list[Integers]] = []
        springs: list[tuple[Floats, Floats]] = []

        def add(a: Nodes, b: Nodes, length: Floats, stiffness: Floats) -> None:
            ends.append([self.node[a].ravel(), self.node[b].ravel()])
            springs.append((length.ravel(), stiffness.ravel()))

        for a, b, across in (((whole, low), (whole, high), 0), ((low, whole), (high, whole), 1)):
            length = np.linalg.norm(rest[b] - rest[a], axis=-1)
            # A thread's width is half of the area on both its sides, over its length.
            share = np.zeros(length.shape)
            if across == 0:
                share[:-1] += cell / 2
                share[1:] += cell / 2
            else:
                share[:, :-1] += cell / 2
                share[:, 1:] += cell / 2
            add(a, b, length, physics.stretch_stiffness * share / length**2)
        for a, b in (((low, low), (high, high)), ((low, high), (high, low))):
            length = np.linalg.norm(rest[b] - rest[a], axis=-1)
            add(a, b, length, physics.shear_stiffness * length**2 / (2 * np.where(cell > 0, cell, np.inf)))
        lengths, stiffness = np.concatenate(springs, axis=1)
        return np.concatenate(ends, axis=1), lengths, stiffness

    def _bends(self) -> tuple[Integers, Floats]:
        rest, cell, stiffness = self.rest, self.cell, self.physics.bending_stiffness
        whole = slice(None)
        before, at, after = slice(None, -2), slice(1, -1), slice(2, None)
        mean = float(cell[cell > 0].mean())
        nodes, found = [], []
        for row in (((whole, before), (whole, at), (whole, after)), ((before, whole), (at, whole), (after, whole))):
            length = 0.5 * np.linalg.norm(rest[row[2]] - rest[row[0]], axis=-1)
            is_whole = np.all([self.is_node[part] for part in row], axis=0)
            nodes.append([self.node[part].ravel() for part in row])
            found.append(np.where(is_whole, stiffness * mean / length**4, 0.0).ravel())
        return np.concatenate(nodes, axis=1), np.concatenate(found)

    def stable_step(self) -> float:
        """Return a step [s] below 2 / omega of the stiffest node (sum of its springs over its mass)."""
        (ends, _, threads), (rows, bends) = self.threads, self.bends
        nodes, stiffness = [*ends, *rows], [threads, threads, bends, 4 * bends, bends]
        total = np.bincount(np.concatenate(nodes), np.concatenate(stiffness), self.mass.size)
        return float(STEP_SHARE * 2 / np.sqrt((2 * total / self.mass.ravel()).max()))

    def hang(self, ends: Floats) -> None:
        """Place the cloth flat and straight down from the held ends, (2, 3)."""
        held = self.rest[0, self.pattern.held, 0]
        along = (self.rest[..., 0] - held[0]) / np.ptp(held)
        place = ends[0] + along[..., None] * (ends[1] - ends[0])
        place[..., 1] += self.rest[..., 1].max() - self.rest[..., 1]
        place[..., 2] += self.pattern.bulge
        self.x[:] = place.reshape(-1, 3).T
        self.v[:] = 0.0

    def advance(self, ends: Floats, step: float, extra_damping: float) -> None:
        """Advance by one kick and drift; move the held edge to the ends, (2, 3)."""
        x, v = self.x, self.v
        (begin, end), length, stiffness = self.threads
        both = self._all.take(end, axis=1) - self._all.take(begin, axis=1)
        apart, closing = both[:3], both[3:]
        now = np.sqrt(np.einsum("ij,ij->j", apart, apart))
        rate = np.einsum("ij,ij->j", apart, closing) / now
        pull = stiffness * (now - length + self.physics.thread_damping_time * rate) / now * apart
        (before, at, after), stiffness = self.bends
        bend = stiffness * (x.take(before, axis=1) - 2 * x.take(at, axis=1) + x.take(after, axis=1))
        forces = [pull, -pull, -bend, 2 * bend, -bend]
        if self.drag:
            forces += [self._drag_of_cells()] * 4
        f = np.stack([np.bincount(self._pulled, part, x.shape[1]) for part in np.concatenate(forces, axis=1)])
        f[1] += self.weight
        damping = 0.5 * step * (self.physics.linear_damping + extra_damping)
        v[:] = ((1 - damping) * v + step * f / self.mass.ravel()) / (1 + damping)
        place = np.outer(ends[0], 1 - self.held_share) + np.outer(ends[1], self.held_share)
        v[:, self.held] = (place - x[:, self.held]) / step
        x += step * v
        x[:, self.held] = place

    def _drag_of_cells(self) -> Floats:
        """Return the drag [N] at each corner of each cell, (3, cells)."""
        a, b, c, d = (self._all.take(nodes, axis=1) for nodes in self.corners)
        (ax, ay, az), (bx, by, bz) = d[:3] - a[:3], c[:3] - b[:3]
        normal = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
        doubled = np.sqrt(np.einsum("ij,ij->j", normal, normal)) + 1e-15
        wind = 0.25 * (a[3:] + b[3:] + c[3:] + d[3:])
        across = np.einsum("ij,ij->j", wind, normal) / doubled
        speed = np.sqrt(np.einsum("ij,ij->j", wind, wind)) + 1e-12
        sine = np.minimum(np.abs(across) / speed, 1.0)
        coefficient = self.drag * (0.05 + 0.95 * sine * np.sqrt(sine))
        return np.asarray(-0.125 * AIR_DENSITY * 0.5 * coefficient * np.abs(across) * across * normal)
