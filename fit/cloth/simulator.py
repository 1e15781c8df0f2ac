"""Run batches of candidates on one recording: chooses the stable step, packs lanes, unpacks trajectories.

Stable step of explicit leapfrog with Kelvin-Voigt damping: with the highest frequency omega and damping ratio
zeta = omega tau / 2,  dt < (2 / omega) (sqrt(1 + zeta^2) - zeta).
omega^2 is bounded by k lambda_k + G lambda_G + B lambda_B, the largest eigenvalues of each energy alone on this mesh at
unit stiffness and unit density (the maximum of a sum is at most the sum of the maxima).
Source: T. Belytschko, W. K. Liu, B. Moran, "Nonlinear Finite Elements for Continua and Structures", section 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.cloth import material as mat
from fit.cloth.mesh import ClothMesh, build_mesh
from fit.effects.base import Effect
from fit.errors import FitError
from fit.recording import Recording

Floats = NDArray[np.float64]

SAFETY = 0.7  # of the linear limit: stretched and folded cloth is a little stiffer than flat cloth
COARSEST_STEP = 1e-3  # s: swings, pulls and samples stay well resolved even for soft cloth
TARGET_SPACING = 5e-3  # s between the observer's targets; linear between them
SETTLE_TIME = 2.0  # s that the cloth hangs at the first hanger pose before the take begins
WIDE_LANES, NARROW_LANES = 8, 4  # candidates side by side; few candidates go narrow so that every thread has some
SETTLE_DAMPING = 6.0  # 1/s during that time


@dataclass(frozen=True)
class Rollouts:
    """What a batch did.

    points [m], (candidates, frames, points, 3), world frame; NaN for a candidate that blew up
    shapes [m], (candidates, frames, nodes, 3), or None
    """

    points: Floats
    shapes: NDArray[np.float32] | None


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Mesh spacing [m] and the step as a share of the stable one."""

    spacing: float = 0.05
    step_share: float = 1.0


class Simulator:
    """Simulate one recording for any number of candidates.

    A candidate is a row of material parameters (`fit.cloth.material.NAMES`) and a row of effect amplitudes.
    Its result does not depend on its company in the batch.
    """

    def __init__(
        self,
        recording: Recording,
        effects: tuple[Effect, ...] = (),
        *,
        resolution: Resolution | None = None,
    ) -> None:
        runtime.start()
        from fit.cloth.rollout import make_rollout

        self.recording, self.effects = recording, effects
        self.resolution = resolution or Resolution()
        self.mesh: ClothMesh = build_mesh(recording.garment, self.resolution.spacing)
        self.simulations = 0
        self._make_rollout = make_rollout
        self._frequencies = _unit_frequencies(self.mesh)
        self._targets: dict[int, tuple[Floats, Floats, int]] = {}
        self._threads = runtime.available_threads()

    def run(
        self, materials: Floats, amplitudes: Floats | None = None, *, observer_hz: float = 0.0, shapes: bool = False
    ) -> Rollouts:
        """Simulate candidates.

        materials, (candidates, 7); amplitudes, (candidates, effects), 0 where None;
        observer_hz: natural frequency of the pull towards the measured points, 0 for a free rollout.

        Raises:
            FitError: the shapes of the arguments do not fit together.
        """
        count = len(materials)
        if amplitudes is None:
            amplitudes = np.zeros((count, len(self.effects)))
        if amplitudes.shape != (count, len(self.effects)) or materials.shape[1] != len(mat.NAMES):
            raise FitError(f"candidates of shape {materials.shape} and {amplitudes.shape} do not fit together")
        recording, mesh = self.recording, self.mesh
        frames, points = recording.points.shape[:2]
        seen = np.full((count, frames, points, 3), np.nan)
        kept = np.zeros((count, frames, len(mesh.rest), 3), np.float32) if shapes else None
        halvings = self._halvings(materials, amplitudes)
        for level in np.unique(halvings):
            members = np.flatnonzero(halvings == level)
            lanes = WIDE_LANES if len(members) > NARROW_LANES * self._threads else NARROW_LANES
            width = lanes * self._threads
            for start in range(0, len(members), width):
                chosen = members[start : start + width]
                self._run_group(chosen, lanes, int(level), materials, amplitudes, observer_hz, seen, kept)
        self.simulations += count
        blown = ~(np.abs(seen).max((1, 2, 3)) < 100.0)  # metres: far outside any room
        seen[blown] = np.nan
        return Rollouts(seen, kept)

    def step(self, halvings: int = 0) -> float:
        """Return the time step [s] after this many halvings."""
        return COARSEST_STEP * self.resolution.step_share / 2.0**halvings

    def _halvings(self, materials: Floats, amplitudes: Floats) -> NDArray[np.int64]:
        """Per candidate, how often the coarsest step must be halved to be stable."""
        by_stretch, by_shear, by_bending = self._frequencies
        stretch, shear = materials[:, mat.STRETCH] * by_stretch, materials[:, mat.SHEAR] * by_shear
        bend = materials[:, mat.BENDING] * by_bending
        light = np.ones(len(materials))
        for k, effect in enumerate(self.effects):
            for i in np.flatnonzero(amplitudes[:, k]):
                light[i] *= effect.stiffest(materials[i, mat.DENSITY], self.mesh, amplitudes[i, k])
        density = materials[:, mat.DENSITY] * np.maximum(light, 1e-3)
        omega2 = (stretch + shear + bend) / density
        omega = np.sqrt(omega2)
        damping = (stretch + shear) * materials[:, mat.MEMBRANE_TIME] + bend * materials[:, mat.BENDING_TIME]
        zeta = damping / density / (2 * omega)
        limit = SAFETY * 2 / omega * (np.sqrt(1 + zeta**2) - zeta)
        wanted = np.ceil(np.log2(COARSEST_STEP / limit))
        return np.clip(wanted, 0, 7).astype(np.int64)

    def _observer_targets(self, halvings: int) -> tuple[Floats, Floats, int]:
        """Targets and trust on a grid of whole steps, and the number of steps between two of them."""
        if halvings not in self._targets:
            dt = self.step(halvings)
            every = max(round(TARGET_SPACING / dt), 1)
            count = int(np.ceil(self.recording.duration / (every * dt))) + 3
            wanted, trust = self.recording.targets(np.asarray(np.arange(count) * every * dt, float))
            self._targets[halvings] = wanted.astype(np.float32), trust.astype(np.float32), every
        return self._targets[halvings]

    def _run_group(
        self, chosen: NDArray[np.int64], lanes: int, halvings: int, materials: Floats, amplitudes: Floats,
        observer_hz: float, seen: Floats, kept: NDArray[np.float32] | None,
    ) -> None:  # fmt: skip
        recording, mesh = self.recording, self.mesh
        dt = self.step(halvings)
        groups = -(-len(chosen) // lanes)
        padded = np.concatenate([chosen, np.repeat(chosen[-1:], groups * lanes - len(chosen))])
        nodes, (frames, points) = len(mesh.rest), recording.points.shape[:2]
        frame_step = np.floor(recording.time / dt + 1e-9).astype(np.int32)
        frame_lag = (recording.time - frame_step * dt).astype(np.float32)
        path = self._paths(padded, amplitudes, int(frame_step[-1]) + 3, dt)
        inverse_mass = np.empty((len(padded), nodes))
        for row, i in enumerate(padded):
            mass = materials[i, mat.DENSITY] * mesh.node_area
            for k, effect in enumerate(self.effects):
                mass = effect.node_mass(mass, mesh, amplitudes[i, k])
            inverse_mass[row] = 1.0 / mass
        wanted, trust, every = self._observer_targets(halvings)
        omega = 2 * np.pi * observer_hz
        start = _starting_shape(mesh, path[:, 0])
        state = [_in_lanes(start, lanes), *(np.zeros((groups, nodes, 3, lanes), np.float32) for _ in range(2))]
        out = np.zeros((groups, frames, points, 3, lanes), np.float32)
        whole = np.zeros((groups, frames if kept is not None else 1, nodes, 3, lanes), np.float32)
        single = lambda a: np.ascontiguousarray(a, np.float32)  # noqa: E731
        kernel = self._make_rollout(lanes, tuple(e.face_force for e in self.effects))
        kernel(
            *state, np.zeros((groups, points, 3, lanes), np.float32),
            mesh.triangles, single(mesh.inverse), single(mesh.area),
            mesh.bends, single(mesh.bend_weights),
            mesh.held_nodes, single(mesh.held_fraction), _in_lanes(path, lanes),
            mesh.point_nodes, single(mesh.point_weights), mesh.pull_points, single(mesh.pull_weights),
            wanted, trust, every,
            _in_lanes(materials[padded], lanes), _in_lanes(inverse_mass, lanes),
            _in_lanes(amplitudes[padded] if self.effects else np.zeros((len(padded), 1)), lanes),
            frame_step, frame_lag, dt, round(SETTLE_TIME / dt), SETTLE_DAMPING, omega**2, 2 * omega,
            out, whole, int(kept is not None),
        )  # fmt: skip
        seen[chosen] = _from_lanes(out)[: len(chosen)]
        if kept is not None:
            kept[chosen] = _from_lanes(whole)[: len(chosen)]

    def _paths(self, padded: NDArray[np.int64], amplitudes: Floats, steps: int, dt: float) -> Floats:
        """Held ends per candidate and step, (candidates, steps, 6); equal clocks are evaluated once."""
        instants = np.asarray(np.arange(steps) * dt, float)
        known: dict[tuple[float, ...], Floats] = {}
        rows = []
        for i in padded:
            shifted = instants
            key = []
            for k, effect in enumerate(self.effects):
                moved = effect.held_times(shifted, amplitudes[i, k])
                key.append(amplitudes[i, k] if moved is not shifted else 0.0)
                shifted = moved
            name = tuple(key)
            if name not in known:
                known[name] = self.recording.held(shifted)
            rows.append(known[name])
        return np.stack(rows)


def _in_lanes(values: Floats, lanes: int) -> NDArray[np.float32]:
    """(candidates, ...) -> (groups, ..., lanes), contiguous."""
    grouped = np.asarray(values, np.float32).reshape(-1, lanes, *values.shape[1:])
    return np.ascontiguousarray(np.moveaxis(grouped, 1, -1))


def _from_lanes(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(groups, ..., lanes) -> (candidates, ...)."""
    moved = np.moveaxis(values, -1, 1)
    return moved.reshape(-1, *moved.shape[2:])


def _starting_shape(mesh: ClothMesh, ends: Floats) -> Floats:
    """Flat cloth hanging straight down from the held ends, (candidates, nodes, 3); ends (candidates, 6)."""
    left, right = ends[:, :3], ends[:, 3:]
    held = mesh.rest[mesh.held_nodes]
    along = (mesh.rest[:, 0] - held[0, 0]) / (held[-1, 0] - held[0, 0])
    below = held[:, 1].max() - mesh.rest[:, 1]
    shape = (1 - along)[None, :, None] * left[:, None] + along[None, :, None] * right[:, None]
    shape[:, :, 2] -= below
    return shape


def _unit_frequencies(mesh: ClothMesh) -> tuple[float, float, float]:
    """Largest eigenvalues of stretch, shear and bending alone at unit stiffness and density [m^-2, m^-2, m^-4]."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import eigsh

    nodes, faces = len(mesh.rest), len(mesh.triangles)
    b00, b01, b10, b11 = mesh.inverse.T
    gradient_u = np.stack([-b00 - b10, b00, b10], 1)
    gradient_v = np.stack([-b01 - b11, b01, b11], 1)
    root = np.sqrt(mesh.area)[:, None]
    rows, columns = np.repeat(np.arange(faces), 3), mesh.triangles.ravel()

    def largest(parts: list[tuple[Floats, int]], size: int, index: NDArray[np.int64], cols: NDArray[np.int32],
                axes: int) -> float:  # fmt: skip
        values = np.concatenate([p.ravel() for p, _ in parts])
        r = np.concatenate([index for _ in parts])
        c = np.concatenate([cols * axes + axis for _, axis in parts])
        scale = np.repeat(1 / np.sqrt(mesh.node_area), axes)
        strain = coo_array((values * scale[c], (r, c)), shape=(size, nodes * axes)).tocsr()
        start = np.random.default_rng(0).standard_normal(nodes * axes)
        return float(
            eigsh((strain.T @ strain).tocsc(), 1, which="LA", v0=start, return_eigenvectors=False, tol=1e-3)[0]
        )

    face_index = rows.astype(np.int64)
    stretch = max(
        largest([(root * gradient_u, 0)], faces, face_index, columns, 1),
        largest([(root * gradient_v, 0)], faces, face_index, columns, 1),
    )
    shear = largest([(root * gradient_v, 0), (root * gradient_u, 1)], faces, face_index, columns, 2)
    bend_index = np.repeat(np.arange(len(mesh.bends)), 4).astype(np.int64)
    bending = largest([(mesh.bend_weights, 0)], len(mesh.bends), bend_index, mesh.bends.ravel(), 1)
    return stretch, shear, bending
