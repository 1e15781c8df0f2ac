"""Residuals of a simulation run as an observer: a weak pull to the measured points prevents chaotic divergence.

    pull = w^2 (y - x) + 2 zeta w (ydot - v),   w = 2 pi f, zeta = 1        [m/s^2]

With a perfect model and no noise the pull is zero; otherwise the pull is the missing force. f = 0 is a free rollout.
Residuals are y - x at the frames, for points that are not on the held edge. They have two parts. The variation about
each point's mean over a take is divided by the noise. The mean is divided by its standard deviation:

    dynamic  (r - mean r) / sigma          static  mean r / sqrt(offset^2 + sigma^2 / n)

Points on the held edge measure the boundary and the measurement itself. They are not judged. For the search for effects
they are evidence: a third part of the residual (`fit.observer.edge`).

Points of a silhouette (skirts, T-shirts) lie a constant few millimetres beside their material points. For these
garments the static part is no evidence on the cloth and is left out.

Source: D. G. Luenberger, "An introduction to observers", IEEE TAC 16 (1971); synchronisation of chaotic models, H. D.
I. Abarbanel et al., "Dynamical state and parameter estimation", SIAM J. Appl. Dyn. Syst. 8 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fit.cloth.effect import Effect, columns_of
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator, run_together
from fit.errors import FitError
from fit.methods import Parameterisation
from fit.observer.edge import NUMBERS_A_FRAME, EdgeErrors, EdgeResiduals, edge_errors
from fit.recordings.recording import Recording
from formats.arrays import Booleans, Floats, Integers
from formats.sights import BLOCK_SECONDS, half_seconds

# Standard deviations that a candidate is charged per number when it blew up, and at which others are clipped. Our
# choice: 3 m beside 3 mm of noise, which no point of a garment misses by.
BLOWN_UP_CHARGE = 1e3


@dataclass(frozen=True)
class Layout:
    """Layout of a stacked residual vector: take, frame, point and axis of each number; all arrays (numbers,).

    - `sd` [m] turns a number back into metres.
    - `is_judged` marks the varying part of the judged points, which comes first.
    - `frame` is -1 for means over a take, which are not judged.
    - `is_edge` marks numbers of the held edge, which are not judged; their point and axis are -1.
    - `static_of` is the index of the mean that belongs to a judged number, or -1.
    """

    take: Integers
    block: Integers
    frame: Integers
    point: Integers
    axis: Integers
    sd: Floats
    is_judged: Booleans
    is_edge: Booleans
    static_of: Integers

    def metres(self, residuals: Floats) -> Floats:
        """Return y - x [m] of every number that is judged, (..., judged), from whitened residuals, (..., numbers)."""
        whole = residuals * self.sd
        moving = whole[..., self.is_judged]
        at = self.static_of[self.is_judged]
        return np.asarray(np.where(at >= 0, moving + whole[..., at], moving))

    def moving(self, values: Integers) -> Integers:
        """Return the entries of one of the arrays above that belong to numbers that are judged."""
        return values[self.is_judged]


Asked = tuple["Observer", Floats, Floats]  # an observer, parameters (candidates, parameters), and amplitudes


class Observer:
    """Evaluate the residuals of many candidates on one or more recordings."""

    def __init__(
        self,
        recordings: list[Recording],
        parameterisation: Parameterisation,
        effects: tuple[Effect, ...],
        *,
        frequency: float,
        resolution: Resolution | None = None,
    ) -> None:
        self.recordings, self.parameterisation, self.effects = recordings, parameterisation, effects
        self.frequency = frequency
        self.resolution = resolution or Resolution()
        self._simulators = [Simulator(r, effects, resolution=self.resolution) for r in recordings]
        self.densities = [
            r.garment.mass_kg / float(s.mesh.area) for r, s in zip(recordings, self._simulators, strict=True)
        ]
        self.library = {effect.name: effect for effect in effects}
        self.columns = dict(zip(self.library, columns_of(effects), strict=True))
        self._edges = {k: EdgeResiduals(r) for k, r in enumerate(recordings) if effects and has_static(r)}
        self.layout = _layout(recordings, self._edges)
        self.mesh = self._simulators[0].mesh
        self._others: list[Observer] = []

    @property
    def simulations(self) -> int:
        """Number of simulations so far, including those of observers derived from this one."""
        return sum(s.simulations for s in self._simulators) + sum(o.simulations for o in self._others)

    def with_frequency(self, frequency: float) -> Observer:
        """Return the same observer at another frequency [Hz]; simulators are shared."""
        other = object.__new__(Observer)
        other.__dict__.update(self.__dict__)
        other.frequency = frequency
        return other

    def at_resolution(self, resolution: Resolution) -> Observer:
        """Return an observer of the same recordings and pull on another mesh."""
        return self._another(self.recordings, resolution)

    def of(self, recordings: list[Recording]) -> Observer:
        """Return an observer of other recordings with the same pull and mesh."""
        return self._another(recordings, self.resolution)

    def _another(self, recordings: list[Recording], resolution: Resolution) -> Observer:
        other = Observer(
            recordings, self.parameterisation, self.effects, frequency=self.frequency, resolution=resolution
        )
        self._others.append(other)
        return other

    def trajectories(self, vectors: Floats, amplitudes: Floats, *, frequency: float | None = None) -> list[Floats]:
        """Simulated points per recording, each (candidates, frames, points, 3) [m]."""
        return trajectories_together([(self, vectors, amplitudes)], frequency=frequency)[0]

    @property
    def off(self) -> Floats:
        """Amplitudes of no effect, (components,)."""
        return np.zeros(sum(len(effect.components) for effect in self.effects))

    def residuals(self, vectors: Floats, amplitudes: Floats) -> Floats:
        """Whitened residuals, (candidates, numbers), in the order of `layout`."""
        return residuals_together([(self, vectors, amplitudes)])[0]

    def asked(self, vectors: Floats, amplitudes: Floats) -> tuple[list[Simulator], list[Floats], list[Floats]]:
        """Return simulators, material rows and amplitudes of the candidates for every recording."""
        materials = [self.parameterisation.to_materials(vectors, rho) for rho in self.densities]
        return self._simulators, materials, [amplitudes] * len(materials)

    def residuals_of(self, points: list[Floats]) -> Floats:
        """Whitened residuals of simulated points [m], (candidates, frames, points, 3) a take."""
        moving, static, candidates = [], [], len(points[0])
        for recording, simulated in zip(self.recordings, points, strict=True):
            seen = recording.counted
            apart = np.where(seen[..., None], recording.points - simulated, 0.0)
            count = np.maximum(seen.sum(0), 1)[:, None]
            mean = apart.sum(1) / count
            scaled = (apart - mean[:, None]) / _deviations(recording)[:, None]
            moving.append(scaled[:, seen].reshape(candidates, -1))
            if has_static(recording):
                chosen = recording.judged & seen.any(0)
                known = mean / np.sqrt(recording.offset_sd**2 + _deviations(recording)[:, None] ** 2 / count)
                static.append(known[:, chosen].reshape(candidates, -1))
        edges = [part for k, edge in self._edges.items() for part in edge.of(points[k])]
        whole = np.concatenate([*moving, *static, *edges], axis=1)
        return np.where(np.isfinite(whole), np.clip(whole, -BLOWN_UP_CHARGE, BLOWN_UP_CHARGE), BLOWN_UP_CHARGE)

    def sound_residuals_of(self, points: list[Floats]) -> Floats:
        """Return whitened residuals as `residuals_of`, not finite where a simulation blew up."""
        is_sound = np.all([np.isfinite(p).reshape(len(p), -1).all(1) for p in points], axis=0)
        return np.where(is_sound[:, None], self.residuals_of(points), np.nan)

    def by_place(self, values: Floats) -> list[Floats]:
        """Arrange values of the judged numbers, (judged,), per take as (frames, points, 3), nan elsewhere."""
        take, frame, point, axis = (
            self.layout.moving(a) for a in (self.layout.take, self.layout.frame, self.layout.point, self.layout.axis)
        )
        grids = []
        for number, recording in enumerate(self.recordings):
            mine = take == number
            grid = np.full(recording.points.shape, np.nan)
            grid[frame[mine], point[mine], axis[mine]] = values[mine]
            grids.append(grid)
        return grids

    def edge_errors(self, residual: Floats) -> EdgeErrors:
        """Return a model's error at the held edges, from a whitened residual, (numbers,)."""
        layout = self.layout
        chosen = layout.is_edge
        return edge_errors(layout.take[chosen], layout.frame[chosen], residual[chosen], layout.sd[chosen])

    def in_mm(self, residuals: Floats) -> Floats:
        """Root mean square distance of a point [mm] from whitened residuals, (..., numbers) -> (...,)."""
        return np.asarray(1e3 * np.sqrt(3 * (self.layout.metres(residuals) ** 2).mean(-1)))


def trajectories_together(asked: Sequence[Asked], *, frequency: float | None = None) -> list[list[Floats]]:
    """Simulate the candidates of several observers together; return `Observer.trajectories` of each.

    Observers of one garment and one mesh share calls of the kernel. frequency [Hz]: of the pull, instead of the
    observers' own

    Raises:
        FitError: the observers pull differently.
    """
    own = {observer.frequency for observer, _, _ in asked}
    if frequency is None and len(own) != 1:
        raise FitError(
            f"pulls of {sorted(own)} Hz cannot be simulated side by side", where="observers",
            advice="give one frequency for all",
        )  # fmt: skip
    simulators: list[Simulator] = []
    materials: list[Floats] = []
    amplitudes: list[Floats | None] = []
    for observer, vectors, sizes in asked:
        own_simulators, own_materials, own_amplitudes = observer.asked(vectors, sizes)
        simulators += own_simulators
        materials += own_materials
        amplitudes += own_amplitudes
    hertz = own.pop() if frequency is None else frequency
    found = iter(run_together(simulators, materials, amplitudes, observer_hz=hertz))
    return [[next(found).points for _ in observer.recordings] for observer, _, _ in asked]


def residuals_together(asked: Sequence[Asked]) -> list[Floats]:
    """Return `Observer.residuals` of several observers, simulated together as by `trajectories_together`."""
    points = trajectories_together(asked)
    return [observer.residuals_of(seen) for (observer, _, _), seen in zip(asked, points, strict=True)]


def has_static(recording: Recording) -> bool:
    """Return whether the points are material points: their constant offset from the simulation is a model-form
    error.
    """
    return recording.has_material_points


def _deviations(recording: Recording) -> Floats:
    """Standard deviation per point [m], never below a tenth of a millimetre."""
    return np.maximum(recording.point_sd, 1e-4)


def _layout(recordings: list[Recording], edges: dict[int, EdgeResiduals]) -> Layout:
    columns: list[list[Integers]] = [[], [], [], [], []]
    still: list[list[Integers]] = [[], [], [], [], []]
    deviations, still_deviations, static_of = [], [], []
    first_block, first_static, first = 0, 0, []
    for number, recording in enumerate(recordings):
        seen = recording.counted
        frame, point = np.nonzero(seen)
        frame, point = np.repeat(frame, 3), np.repeat(point, 3)
        block = half_seconds(recording.time[frame]) + first_block
        first.append(first_block)
        first_block = int(block.max(initial=first_block)) + 1
        axis = np.tile(np.arange(3), len(frame) // 3)
        for column, values in zip(columns, (np.full(len(frame), number), block, frame, point, axis), strict=True):
            column.append(values)
        deviations.append(_deviations(recording)[point])
        chosen = np.flatnonzero(recording.judged & seen.any(0)) if has_static(recording) else np.zeros(0, np.int64)
        place = np.full(seen.shape[1], -1)
        place[chosen] = first_static + 3 * np.arange(len(chosen))
        static_of.append(np.where(place[point] >= 0, place[point] + axis, -1))
        first_static += 3 * len(chosen)
        third = _thirds(recording)[np.repeat(chosen, 3)]
        ones = np.ones(3 * len(chosen), np.int64)
        rows = (number * ones, third + 3 * number, -ones, np.repeat(chosen, 3), np.tile(np.arange(3), len(chosen)))
        for column, one in zip(still, rows, strict=True):
            column.append(one)
        count = np.maximum(seen.sum(0), 1)
        known = np.sqrt(recording.offset_sd**2 + _deviations(recording) ** 2 / count)
        still_deviations.append(np.repeat(known[chosen], 3))
    moving = [np.concatenate(c) for c in columns]
    static = [np.concatenate(c) for c in still]
    static[1] = static[1] + first_block
    count = len(moving[0])
    at = np.concatenate(static_of)
    known = int(static[1].max(initial=first_block)) + 1
    aside = [_edge_rows(k, recordings[k], edge, first[k], known + k) for k, edge in edges.items()]
    every = [moving, static, *(rows for rows, _ in aside)]
    take, block, frame, point, axis = (np.concatenate(parts) for parts in zip(*every, strict=True))
    return Layout(
        take, block, frame, point, axis,
        sd=np.concatenate([*deviations, *still_deviations, *(sd for _, sd in aside)]),
        is_judged=np.arange(len(take)) < count,
        is_edge=np.arange(len(take)) >= count + len(static[0]),
        static_of=np.concatenate([np.where(at >= 0, at + count, -1), np.full(len(take) - count, -1)]),
    )  # fmt: skip


def _edge_rows(
    number: int, recording: Recording, edge: EdgeResiduals, first_block: int, block_of_means: int
) -> tuple[list[Integers], Floats]:
    """Return the origin of one held edge's numbers, in the order of `Layout`, and their deviations [m]."""
    frame = np.repeat(edge.frame, NUMBERS_A_FRAME)
    means = len(edge.static_sd)
    last = first_block + int(recording.time[recording.counted.any(1)].max(initial=0.0) / BLOCK_SECONDS)
    block = np.minimum(half_seconds(recording.time[frame]) + first_block, last)
    count = len(frame) + means
    nowhere = np.full(count, -1)
    rows = [
        np.full(count, number), np.append(block, np.full(means, block_of_means)),
        np.append(frame, np.full(means, -1)), nowhere, nowhere,
    ]  # fmt: skip
    return rows, np.append(edge.sd, edge.static_sd)


def _thirds(recording: Recording) -> Integers:
    """Top, middle or bottom third of the garment, (points,)."""
    height = np.array([p.at_m[1] for p in recording.garment.points])
    down = 3 * (height.max() - height) / max(float(np.ptp(height)), 1e-9)
    return np.asarray(np.minimum(down, 2), np.int64)
