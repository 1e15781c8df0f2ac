"""Run batches of candidates on one recording: chooses the stable step, packs lanes, unpacks trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.cloth import material as mat
from fit.cloth import spectral
from fit.cloth.mesh import ClothMesh, Integers, build_mesh
from fit.cloth.stability import unit_frequencies
from fit.cloth.support import Support, Supporting, clamped, hanger
from fit.effects.base import Effect, columns_of
from fit.effects.bending_hysteresis import REFERENCE_CURVATURE
from fit.errors import FitError
from fit.recording import Recording

Floats = NDArray[np.float64]
Numbers = TypeVar("Numbers", Floats, NDArray[np.float32], Integers)

SAFETY = 0.7  # of the linear limit: stretched and folded cloth is a little stiffer than flat cloth
COARSEST_STEP = 1e-3  # s: swings, pulls and samples stay well resolved even for soft cloth
TARGET_SPACING = 5e-3  # s between the observer's targets; linear between them
LANES = (4, 8, 16)  # candidates side by side; few candidates go narrow so that every thread has some
ALIGNMENT = 64  # bytes: sixteen lanes of four bytes
LARGEST_STRAIN = 0.05  # strain up to which stiffening cloth stays stable
SETTLE_DAMPING = 6.0  # 1/s while the cloth settles


@dataclass(frozen=True)
class Rollouts:
    """What a batch did.

    points [m], (candidates, frames, points, 3), world frame; NaN for a candidate that blew up
    shapes [m], (candidates, frames, nodes, 3), or None
    forces [N], (candidates, nodes, 3): of the cloth and the air on each node in the last step, or None; where a node is
    held at rest the support carries them, with its weight
    """

    points: Floats
    shapes: NDArray[np.float32] | None
    forces: NDArray[np.float32] | None


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Mesh spacing [m] and the step as a share of the stable one."""

    spacing: float = 0.05
    step_share: float = 1.0


@dataclass(frozen=True)
class _Work:
    """What the candidates of one call of the kernel share; materials with effects and amplitudes of all candidates."""

    lanes: int
    half_octaves: int
    has_effects: bool
    materials: Floats
    amplitudes: Floats
    observer_hz: float


class Simulator:
    """Simulate one recording for any number of candidates.

    A candidate is a row of material parameters (`fit.cloth.material.NAMES`) and a row of the effects' amplitudes, their
    components one after the other (`columns`).
    Its result does not depend on its company in the batch.
    """

    def __init__(
        self,
        recording: Recording,
        effects: tuple[Effect, ...] = (),
        *,
        resolution: Resolution | None = None,
        support: Supporting | None = None,
    ) -> None:
        """Prepare a mesh of the recording's garment; without a `support` it hangs from the recording's hanger.

        Raises:
            FitError: the garment cannot be meshed, or an effect moves a hanger that is not there.
        """
        runtime.start()
        from fit.cloth.rollout import make_rollout

        self.recording, self.effects = recording, effects
        self.resolution = resolution or Resolution()
        mesh = build_mesh(recording.garment, self.resolution.spacing)
        self.support: Support = (support or hanger(recording))(mesh)
        self.mesh = clamped(mesh, self.support)
        moving = [e.name for e in effects if type(e).drive is not Effect.drive]
        if support is not None and moving:
            raise FitError(
                f"the effect {moving[0]} moves a hanger's ends, and this cloth hangs from none",
                advice="leave out the effects on the boundary and on time",
            )
        self.simulations = 0
        self.columns = columns_of(effects)
        self._make_rollout = make_rollout
        self._frequencies = unit_frequencies(self.mesh)
        self._membrane, self._bending = _membrane_arguments(self.mesh), _bending_arguments(self.mesh)
        self._targets: dict[int, tuple[Floats, Floats, int]] = {}
        self._threads = runtime.available_threads()

    def run(
        self, materials: Floats, amplitudes: Floats | None = None, *, observer_hz: float = 0.0, shapes: bool = False
    ) -> Rollouts:
        """Simulate candidates; `shapes` keeps the nodes of every frame and the last forces on them.

        materials, (candidates, parameters); amplitudes, (candidates, components of all effects), 0 where None;
        observer_hz: natural frequency of the pull towards the measured points, 0 for a free rollout.

        Raises:
            FitError: the shapes of the arguments do not fit together.
        """
        count = len(materials)
        width = self.columns[-1].stop if self.columns else 0
        if amplitudes is None:
            amplitudes = np.zeros((count, width))
        if amplitudes.shape != (count, width) or materials.shape[1] != len(mat.NAMES):
            raise FitError(f"candidates of shape {materials.shape} and {amplitudes.shape} do not fit together")
        recording, mesh = self.recording, self.mesh
        frames, points = recording.points.shape[:2]
        seen = np.full((count, frames, points, 3), np.nan)
        kept = np.zeros((count, frames + 1, len(mesh.rest), 3), np.float32) if shapes else None
        changed = self._with_effects(materials, amplitudes)
        kinds = self._half_octaves(changed, amplitudes) + 100 * self._needs_effects(amplitudes)
        for kind in np.unique(kinds):
            members = np.flatnonzero(kinds == kind)
            lanes = next((n for n in LANES if n * self._threads >= len(members)), LANES[-1])
            together = lanes * self._threads
            for start in range(0, len(members), together):
                chosen = members[start : start + together]
                work = _Work(lanes, int(kind) % 100, kind >= 100, changed, amplitudes, observer_hz)
                self._run_group(chosen, work, seen, kept)
        self.simulations += count
        blown = ~(np.abs(seen).max((1, 2, 3)) < 100.0)  # metres: far outside any room
        seen[blown] = np.nan
        for k, effect in enumerate(self.effects):
            if type(effect).observe is not Effect.observe:
                for i in np.flatnonzero(amplitudes[:, self.columns[k]].any(1)):
                    seen[i] = effect.observe(seen[i], recording, amplitudes[i, self.columns[k]])
        return Rollouts(seen, kept if kept is None else kept[:, :-1], kept if kept is None else kept[:, -1])

    def _with_effects(self, materials: Floats, amplitudes: Floats) -> Floats:
        """Material rows with what the effects change in them."""
        changed = materials.copy()
        for k, effect in enumerate(self.effects):
            for i in np.flatnonzero(amplitudes[:, self.columns[k]].any(1)):
                changed[i] = effect.material(changed[i], amplitudes[i, self.columns[k]])
        return changed

    def _needs_effects(self, amplitudes: Floats) -> NDArray[np.bool_]:
        """Which candidates have an effect that the plain kernel does not know."""
        needed = np.zeros(len(amplitudes), bool)
        for effect, columns in zip(self.effects, self.columns, strict=True):
            if effect.in_kernel:
                needed |= amplitudes[:, columns].any(1)
        return needed

    def step(self, half_octaves: int = 0) -> float:
        """Return the time step [s] after this many half octaves."""
        return COARSEST_STEP * self.resolution.step_share / 2.0 ** (half_octaves / 2)

    def steps_of(self, materials: Floats) -> Floats:
        """Return the time step [s] of each candidate without effects, (candidates,)."""
        none = np.zeros((len(materials), self.columns[-1].stop if self.columns else 0))
        return np.array([self.step(int(n)) for n in self._half_octaves(materials, none)])

    def _half_octaves(self, materials: Floats, amplitudes: Floats) -> NDArray[np.int64]:
        """Per candidate, by how many half octaves the coarsest step must be shorter to be stable."""
        by_stretch, by_shear, by_bending = self._frequencies
        stiffest = np.exp(0.5 * np.abs(materials[:, mat.STRETCH_RATIO])) * (
            1 + LARGEST_STRAIN * materials[:, mat.STIFFENING]
        )
        stretch, shear = materials[:, mat.STRETCH] * stiffest * by_stretch, materials[:, mat.SHEAR] * by_shear
        bending = materials[:, mat.BENDING] * np.exp(0.5 * np.abs(materials[:, mat.BENDING_RATIO]))
        light = np.ones(len(materials))
        for i in np.flatnonzero(amplitudes.any(1)):
            even = materials[i, mat.DENSITY] * self.mesh.node_area
            light[i] = float(np.min(self._masses(materials[i], amplitudes[i]) / even))
            bending[i] += self._friction(amplitudes[i]) / REFERENCE_CURVATURE
        bend = bending * by_bending
        density = materials[:, mat.DENSITY] * np.maximum(light, 1e-3)
        omega2 = (stretch + shear + bend) / density
        omega = np.sqrt(omega2)
        damping = (stretch + shear) * materials[:, mat.MEMBRANE_TIME] + bend * materials[:, mat.BENDING_TIME]
        zeta = damping / density / (2 * omega)
        limit = SAFETY * 2 / omega * (np.sqrt(1 + zeta**2) - zeta)
        wanted = np.ceil(2 * np.log2(COARSEST_STEP / limit))
        return np.clip(wanted, 0, 14).astype(np.int64)

    def _observer_targets(self, half_octaves: int) -> tuple[Floats, Floats, int]:
        """Targets and trust on a grid of whole steps, and the number of steps between two of them."""
        if half_octaves not in self._targets:
            dt = self.step(half_octaves)
            every = max(round(TARGET_SPACING / dt), 1)
            count = int(np.ceil(self.recording.duration / (every * dt))) + 3
            wanted, trust = self.recording.targets(np.asarray(np.arange(count) * every * dt, float))
            self._targets[half_octaves] = wanted.astype(np.float32), trust.astype(np.float32), every
        return self._targets[half_octaves]

    def _masses(self, row: Floats, amplitude: Floats) -> Floats:
        """Masses of the nodes [kg] of one candidate."""
        mass = row[mat.DENSITY] * self.mesh.node_area
        for effect, columns in zip(self.effects, self.columns, strict=True):
            mass = effect.node_mass(mass, self.mesh, amplitude[columns])
        return mass

    def _friction(self, amplitude: Floats) -> float:
        """Largest frictional moment per width [N] of one candidate."""
        return sum(e.friction_moment(amplitude[c]) for e, c in zip(self.effects, self.columns, strict=True))

    def _run_group(
        self, chosen: NDArray[np.int64], work: _Work, seen: Floats, kept: NDArray[np.float32] | None
    ) -> None:
        recording, mesh, lanes = self.recording, self.mesh, work.lanes
        dt = self.step(work.half_octaves)
        groups = -(-len(chosen) // lanes)
        padded = np.concatenate([chosen, np.repeat(chosen[-1:], groups * lanes - len(chosen))])
        materials, amplitudes = work.materials[padded], work.amplitudes[padded]
        nodes, bends, (frames, points) = len(mesh.rest), len(mesh.bends), recording.points.shape[:2]
        frame_step = np.floor(recording.time / dt + 1e-9).astype(np.int32)
        frame_lag = (recording.time - frame_step * dt).astype(np.float32)
        path = self._paths(amplitudes, int(frame_step[-1]) + 3, dt)
        inverse_mass = np.stack([1.0 / self._masses(m, a) for m, a in zip(materials, amplitudes, strict=True)])
        wanted, trust, every = self._observer_targets(work.half_octaves)
        omega = 2 * np.pi * work.observer_hz
        start = self.support.start(path[:, 0])
        state = [_in_lanes(start, lanes), *(_zeros((groups, nodes, 3, lanes)) for _ in range(2))]
        out = _zeros((groups, frames, points, 3, lanes))
        whole = _zeros((groups, frames if kept is not None else 1, nodes, 3, lanes))
        active = self.effects if work.has_effects else ()
        with_bends, with_added = any(e.bends for e in active), any(e.adds_mass for e in active)
        faces = tuple(
            (c.start, c.stop - c.start, e.face_force)
            for e, c in zip(active, self.columns, strict=False)
            if e.face_force is not None
        )
        rest, added = self._resting(amplitudes, bends, with_bends), self._carried(amplitudes, nodes, with_added)
        needs_normals = bool(faces) or with_bends or with_added
        fibres = len(mesh.fibres.area)
        kernel = self._make_rollout(
            lanes, faces, fibre_nodes=mesh.fibre_nodes, bend_lengths=mesh.bends.lengths,
            handles=self.support.handles, with_twist=len(mesh.bends.twist_weights) > 0,
            with_bends=with_bends, with_added_mass=with_added,
        )  # fmt: skip
        with runtime.vectors_kept():
            kernel(
                *state, _zeros((groups, points, 3, lanes)),
                *self._membrane,
                *(_zeros((groups, count, 3, lanes)) for count in (fibres, fibres, fibres)),
                *self._bending,
                *(_zeros((groups, nodes if needs_normals else 1, *shape, lanes)) for shape in ((3,), ())),
                _in_lanes(rest, lanes), _zeros((groups, bends if with_bends else 1, lanes)),
                _in_lanes(added, lanes),
                _some(self.support.nodes), _single(_some(self.support.shares)), _in_lanes(_some(path), lanes),
                mesh.points.first, mesh.points.nodes, _single(mesh.points.weights),
                mesh.pull_points, _single(mesh.pull_weights),
                wanted, trust, every,
                _in_lanes(self._kernel_rows(materials, amplitudes), lanes), _in_lanes(inverse_mass, lanes),
                _in_lanes(amplitudes if self.effects else np.zeros((len(padded), 1)), lanes),
                frame_step, frame_lag, dt, round(self.support.settle_time / dt), SETTLE_DAMPING, omega**2, 2 * omega,
                out, whole, int(kept is not None),
            )  # fmt: skip
        seen[chosen] = _from_lanes(out)[: len(chosen)]
        if kept is not None:
            kept[chosen, :-1] = _from_lanes(whole)[: len(chosen)]
            kept[chosen, -1] = _from_lanes(state[2])[: len(chosen)]

    def _kernel_rows(self, materials: Floats, amplitudes: Floats) -> Floats:
        """What the kernel wants to know of each candidate, (candidates, 14)."""
        warp, weft = np.exp(0.5 * materials[:, mat.STRETCH_RATIO]), np.exp(0.5 * materials[:, mat.BENDING_RATIO])
        x, y = np.sin(materials[:, mat.TILT_X]), np.sin(materials[:, mat.TILT_Y])
        stretch, bending = materials[:, mat.STRETCH], materials[:, mat.BENDING]
        gravity = self.support.gravity
        return np.stack(
            [
                stretch * warp, stretch / warp, materials[:, mat.SHEAR], bending * weft, bending / weft, bending,
                materials[:, mat.MEMBRANE_TIME], materials[:, mat.BENDING_TIME], materials[:, mat.VELOCITY],
                materials[:, mat.STIFFENING], gravity * x, gravity * y, -gravity * np.sqrt(1 - x**2 - y**2),
                np.array([self._friction(a) for a in amplitudes]),
            ],
            axis=1,
        )  # fmt: skip

    def _resting(self, amplitudes: Floats, bends: int, is_needed: bool) -> Floats:
        """Curvature at rest per candidate and bend [1/m]."""
        rest = np.zeros((len(amplitudes), bends if is_needed else 1))
        for effect, columns in zip(self.effects if is_needed else (), self.columns, strict=False):
            for i in np.flatnonzero(amplitudes[:, columns].any(1)):
                rest[i] += effect.rest_curvature(self.mesh, amplitudes[i, columns])
        return rest

    def _carried(self, amplitudes: Floats, nodes: int, is_needed: bool) -> Floats:
        """Added mass per candidate and node [kg]."""
        added = np.zeros((len(amplitudes), nodes if is_needed else 1))
        for effect, columns in zip(self.effects if is_needed else (), self.columns, strict=False):
            for i in np.flatnonzero(amplitudes[:, columns].any(1)):
                added[i] += effect.added_mass(self.mesh, amplitudes[i, columns])
        return added

    def _paths(self, amplitudes: Floats, steps: int, dt: float) -> Floats:
        """Handles per candidate and step, (candidates, steps, 3 handles); equal drives are evaluated once."""
        instants = np.asarray(np.arange(steps) * dt, float)
        drivers = [k for k, e in enumerate(self.effects) if type(e).drive is not Effect.drive]
        known: dict[bytes, Floats] = {}
        rows = []
        for row in amplitudes:
            name = b"".join(row[self.columns[k]].tobytes() for k in drivers)
            if name not in known:
                curve = self.support.path
                for k in drivers:
                    if row[self.columns[k]].any():
                        curve = self.effects[k].drive(curve, self.recording, row[self.columns[k]])
                known[name] = curve(instants)
            rows.append(known[name])
        return np.stack(rows)


def _zeros(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Zeros whose vectors of lanes lie where the processor loads them whole: a misaligned one ends the process."""
    size = 4 * int(np.prod(shape))
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(np.float32).reshape(shape)


def _in_lanes(values: Floats, lanes: int) -> NDArray[np.float32]:
    """(candidates, ...) -> (groups, ..., lanes), contiguous."""
    grouped = np.moveaxis(np.asarray(values, np.float32).reshape(-1, lanes, *values.shape[1:]), 1, -1)
    placed = _zeros(grouped.shape)
    placed[...] = grouped
    return placed


def _from_lanes(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(groups, ..., lanes) -> (candidates, ...)."""
    moved = np.moveaxis(values, -1, 1)
    return moved.reshape(-1, *moved.shape[2:])


def _some(values: Numbers) -> Numbers:
    """The same, or a single zero of as many dimensions in place of nothing, which Taichi cannot take."""
    return values if values.size else np.zeros_like(values, shape=[max(n, 1) for n in values.shape])


def _single(values: Floats) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, np.float32)


def _membrane_arguments(mesh: ClothMesh) -> list[NDArray[np.float32] | Integers | int]:
    """What the kernel wants to know of the membrane, in its order."""
    stencils = mesh.fibres.stencils
    return [
        stencils.nodes, _single(stencils.weights), _single(mesh.fibres.area), mesh.fibres_across,
        mesh.shear_across, mesh.shear_down, _single(mesh.shear_weights), _single(mesh.shear_area),
    ]  # fmt: skip


def _bending_arguments(mesh: ClothMesh) -> list[NDArray[np.float32] | Integers]:
    """What the kernel wants to know of bending and of normals, in its order."""
    bends, plain = mesh.bends, len(mesh.bends.stencils)
    root = _single(np.sqrt(bends.area))
    basis = np.vstack([spectral.slopes(spectral.NODES), spectral.WEIGHTS])
    return [
        bends.stencils.first, bends.stencils.nodes, _single(bends.stencils.weights),
        bends.kind[:plain], bends.centre[:plain], root[:plain], bends.counts[bends.counts > 0],
        _single(_some(bends.twist_weights)), _some(bends.centre[plain:]), _some(root[plain:]),
        mesh.cells, _single(basis),
    ]  # fmt: skip
