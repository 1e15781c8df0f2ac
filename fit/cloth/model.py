"""Model of one recording's cloth: mesh, stable steps, paths of the support, and the kernel's input."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from fit import runtime
from fit.cloth import material as mat
from fit.cloth.bundles import Row
from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, Contact, Surface, contact_rate, surface_of, touching
from fit.cloth.effect import Effect, columns_of
from fit.cloth.kernel_arguments import membrane_bundle, stencil_bundle
from fit.cloth.lines import bends_by_line, fibre_family
from fit.cloth.material import REFERENCE_CURVATURE, RELAXATION_TIME
from fit.cloth.mesh import build_mesh, check_spacing
from fit.cloth.stability import unit_frequencies
from fit.cloth.support import Support, Supporting, clamped, hanger
from fit.errors import FitError
from fit.recordings.recording import Recording
from formats.arrays import Booleans, Floats, Integers, Singles

# Of the linear limit: stretched and folded cloth is stiffer than flat cloth. Six sheets of 0.45 m were swung 0.25 m to
# each side at 1.2 Hz. None blew up at 0.7 and 0.85, two did at 1, three at 1.1 and at twice. Half doubles the time.
SAFETY = 0.7
# s; our choice: half to 1.4 times moved a soft, slow sheet by 0.02 mm (measured). Twice is beyond its stable step.
COARSEST_STEP = 1e-3
# s between the observer's targets, linear between them; our choice: that errs by (omega h)^2 / 8 of a motion, 0.1 % at
# 3 Hz. At twice it errs by 0.4 %; at half the targets need twice the memory.
TARGET_SPACING = 5e-3
# Strain up to which stiffening cloth stays stable. Our choice: its own weight stretches 0.45 m of the softest base
# model by 3 %, a swing further. At half, that cloth is beyond it at rest; at twice, stiffening cloth takes more steps.
LARGEST_STRAIN = 0.05


@dataclass(frozen=True)
class Rollouts:
    """Results of a batch of simulations.

    - `points` [m], (candidates, frames, points, 3), world frame; NaN for a candidate that blew up
    - `shapes` [m], (candidates, frames, nodes, 3), or None
    - `forces` [N], (candidates, nodes, 3): of the cloth and the air on each node in the last step, or None. The support
      carries the forces and the weight of a node that is held at rest.
    """

    points: Floats
    shapes: Singles | None
    forces: Singles | None


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """Mesh spacing [m] and the step as a share of the stable one; a FitError refuses a spacing that is no distance."""

    spacing: float = 0.05  # our choice: all cases of `benchmarks/validation.py` but one meet their limits with it
    step_share: float = 1.0  # the whole stable step

    def __post_init__(self) -> None:
        check_spacing(self.spacing)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates on one recording, and arrays for their results.

    - `materials`, (candidates, parameters), as changed by effects
    - `amplitudes`, (candidates, components)
    - `seen` [m], (candidates, frames, points, 3): the simulated points
    - `kept`, (candidates, frames + 1, nodes, 3), or None: positions of the nodes [m] and, in the last row, the last
      forces on them [N]
    """

    materials: Floats
    amplitudes: Floats
    seen: Floats
    kept: Singles | None


@dataclass(frozen=True, eq=False)
class Group:
    """Candidates with the same step and the same kernel; members are indices, (n,)."""

    model: ClothModel
    candidates: Candidates
    members: Integers
    half_octaves: int
    has_effects: bool
    is_viscous: bool
    touches: bool

    @property
    def kernel(self) -> tuple[bool, bool, bool]:
        """Return the three properties that decide which kernel simulates the group."""
        return self.has_effects, self.is_viscous, self.touches

    @property
    def dt(self) -> float:
        """Return the time step [s]."""
        return self.model.step(self.half_octaves)

    @property
    def steps(self) -> float:
        """Return the steps from the beginning of settling to the last frame."""
        return (self.model.recording.duration + self.model.support.settle_time) / self.dt


class ClothModel:
    """One recording and its cloth, prepared for simulation with any number of candidates; runs no simulation itself.

    A candidate is a row of material parameters (`fit.cloth.material.MATERIAL_NAMES`) and a row of the effects'
    amplitudes, with their components in turn (`columns`). A candidate's result does not depend on the other candidates
    of the batch.
    """

    def __init__(
        self,
        recording: Recording,
        effects: tuple[Effect, ...] = (),
        *,
        resolution: Resolution | None = None,
        support: Supporting | None = None,
        contact: Contact | None = None,
    ) -> None:
        """Mesh the recording's garment; without a `support` it hangs from the recording's hanger.

        contact: contact of the cloth; by default with the recording's bodies, and with itself if an effect adds that.

        Raises:
            FitError: the garment cannot be meshed, or an effect moves a hanger that is not there.
        """
        runtime.start()
        self.recording, self.effects = recording, effects
        self.contact = contact or touching(recording.bodies)
        self.resolution = resolution or Resolution()
        mesh = build_mesh(recording.garment, self.resolution.spacing)
        self.support: Support = (support or hanger(recording))(mesh)
        self.mesh = clamped(mesh, self.support)
        moving = [e.name for e in effects if type(e).drive is not Effect.drive]
        if support is not None and moving:
            raise FitError(
                f"the effect {moving[0]} moves a hanger's ends, and this cloth hangs from none",
                where=recording.take_id,
                advice="leave out the effects on the boundary and on time",
            )
        self.simulations = 0
        self.columns = columns_of(effects)
        self._frequencies = unit_frequencies(self.mesh)
        self.membrane_bundle, self.stencil_bundle = membrane_bundle(self.mesh), stencil_bundle(self.mesh)
        self.fibre_nodes = fibre_family(self.mesh, 0)[0], fibre_family(self.mesh, 1)[0]
        self.bend_lengths = bends_by_line(self.mesh)[0]
        self._targets: dict[int, tuple[Floats, Floats, int]] = {}
        self._undriven: dict[float, Floats] = {}  # the longest path so far for each time step

    def groups(self, materials: Floats, amplitudes: Floats | None, *, shapes: bool) -> tuple[Candidates, list[Group]]:
        """Group candidates by time step and by kernel, plain or with effects; arguments as for `run`.

        Raises:
            FitError: the shapes of the arguments do not fit together.
        """
        count, width = len(materials), self.columns[-1].stop if self.columns else 0
        if amplitudes is None:
            amplitudes = np.zeros((count, width))
        if amplitudes.shape != (count, width) or materials.shape[1] != len(mat.MATERIAL_NAMES):
            raise FitError(
                f"shapes {materials.shape} and {amplitudes.shape} do not fit together", where="candidates",
                advice=f"give {len(mat.MATERIAL_NAMES)} material parameters and {width} amplitudes to each",
            )  # fmt: skip
        frames, points = self.recording.points.shape[:2]
        candidates = Candidates(
            materials=self._with_effects(materials, amplitudes),
            amplitudes=amplitudes,
            seen=np.full((count, frames, points, 3), np.nan),
            kept=np.zeros((count, frames + 1, len(self.mesh.rest), 3), np.float32) if shapes else None,
        )
        steps = self._half_octaves(candidates.materials, amplitudes)
        is_viscous = candidates.materials[:, mat.VISCOSITY] > 0
        kinds = np.stack([self._needs_effects(amplitudes), is_viscous, self._touches(amplitudes), steps], 1)
        return candidates, [
            Group(self, candidates, np.flatnonzero((kinds == kind).all(1)), int(kind[3]), *(kind[:3] > 0).tolist())
            for kind in np.unique(kinds, axis=0)
        ]

    def finish(self, candidates: Candidates) -> Rollouts:
        """Convert the kernel's output into trajectories as the sensor sees them."""
        seen, kept, amplitudes = candidates.seen, candidates.kept, candidates.amplitudes
        self.simulations += len(seen)
        blown = ~(np.abs(seen).max((1, 2, 3)) < 100.0)  # metres: far outside any room
        seen[blown] = np.nan
        for k, effect in enumerate(self.effects):
            if type(effect).observe is not Effect.observe:
                for i in np.flatnonzero(amplitudes[:, self.columns[k]].any(1)):
                    seen[i] = effect.observe(seen[i], self.recording, amplitudes[i, self.columns[k]])
        return Rollouts(seen, kept if kept is None else kept[:, :-1], kept if kept is None else kept[:, -1])

    def is_like(self, other: ClothModel) -> bool:
        """Return whether one kernel call can simulate both models: the same cloth with the same effects."""
        if self is other:
            return True
        return (
            self.effects == other.effects
            and self.resolution == other.resolution
            and self.contact == other.contact
            and self.recording.garment == other.recording.garment
            and self.support.settle_time == other.support.settle_time
            and np.array_equal(self.support.nodes, other.support.nodes)
            and np.array_equal(self.support.shares, other.support.shares)
        )

    def _with_effects(self, materials: Floats, amplitudes: Floats) -> Floats:
        """Return the material rows, changed by the effects."""
        changed = materials.copy()
        for k, effect in enumerate(self.effects):
            for i in np.flatnonzero(amplitudes[:, self.columns[k]].any(1)):
                changed[i] = effect.material(changed[i], amplitudes[i, self.columns[k]])
        return changed

    def _needs_effects(self, amplitudes: Floats) -> Booleans:
        """Return which candidates have an effect that needs the kernel with effects."""
        needed = np.zeros(len(amplitudes), bool)
        for effect, columns in zip(self.effects, self.columns, strict=True):
            if effect.in_kernel:
                needed |= amplitudes[:, columns].any(1)
        return needed

    @functools.cached_property
    def surface(self) -> Surface:
        """Return the surface on which contact acts."""
        return surface_of(self.mesh, self.contact.spacing)

    def thickness(self, amplitudes: Floats) -> Floats:
        """Return the distance [m] at which each candidate's layers are kept apart, (candidates,), 0 for none."""
        found = np.full(len(amplitudes), self.contact.thickness)
        for effect, columns in zip(self.effects, self.columns, strict=True):
            if effect.touches:
                found += [effect.contact_thickness(row) for row in amplitudes[:, columns]]
        return found

    def _touches(self, amplitudes: Floats) -> Booleans:
        """Return which candidates need contact with themselves or with bodies."""
        return (self.thickness(amplitudes) > 0) | bool(self.contact.bodies)

    def step(self, half_octaves: int = 0) -> float:
        """Return the time step [s] after this many half octaves."""
        return COARSEST_STEP * self.resolution.step_share / 2.0 ** (half_octaves / 2)

    def _half_octaves(self, materials: Floats, amplitudes: Floats) -> Integers:
        """Return each candidate's stable step, in half octaves below the coarsest step, (candidates,)."""
        wanted = np.ceil(2 * np.log2(COARSEST_STEP / self.stable_steps(materials, amplitudes)))
        return np.clip(wanted, 0, 14).astype(np.int64)

    def stable_steps(self, materials: Floats, amplitudes: Floats) -> Floats:
        """Return SAFETY of the longest step [s] that is stable by the linear bound, (candidates,)."""
        by_stretch, by_shear, by_bending = self._frequencies
        stiffest = np.exp(0.5 * np.abs(materials[:, mat.STRETCH_RATIO])) * (
            1 + LARGEST_STRAIN * materials[:, mat.STIFFENING]
        )
        stretch, shear = materials[:, mat.STRETCH] * stiffest * by_stretch, materials[:, mat.SHEAR] * by_shear
        bending = materials[:, mat.BENDING] * np.exp(0.5 * np.abs(materials[:, mat.BENDING_RATIO]))
        light = np.ones(len(materials))
        thickness = self.thickness(amplitudes)
        contact = np.zeros(len(materials))
        for i in np.flatnonzero(self._touches(amplitudes)):
            rate = contact_rate(self.surface, is_layered=bool(thickness[i] > 0), has_bodies=bool(self.contact.bodies))
            contact[i] = materials[i, mat.DENSITY] * rate
        for i in np.flatnonzero(amplitudes.any(1)):
            even = materials[i, mat.DENSITY] * self.mesh.node_area
            light[i] = float(np.min(self.masses(materials[i], amplitudes[i]) / even))
            bending[i] += self._friction(amplitudes[i]) / REFERENCE_CURVATURE
        bend, membrane = bending * by_bending, stretch + shear
        density = materials[:, mat.DENSITY] * np.maximum(light, 1e-3)
        viscous = 1 + materials[:, mat.VISCOSITY] / RELAXATION_TIME
        omega = np.sqrt((membrane * viscous + bend + contact) / density)
        damping = membrane * materials[:, mat.MEMBRANE_TIME] + bend * materials[:, mat.BENDING_TIME]
        damping += contact * 2 * CONTACT_DAMPING / CONTACT_OMEGA
        zeta = damping / density / (2 * omega)
        return np.asarray(SAFETY * 2 / omega * (np.sqrt(1 + zeta**2) - zeta))

    def observer_targets(self, half_octaves: int) -> tuple[Floats, Floats, int]:
        """Return the targets and trust on a grid of whole steps, and the number of steps between two of them."""
        if half_octaves not in self._targets:
            dt = self.step(half_octaves)
            every = max(round(TARGET_SPACING / dt), 1)
            count = int(np.ceil(self.recording.duration / (every * dt))) + 3
            wanted, trust = self.recording.targets(np.asarray(np.arange(count) * every * dt, float))
            self._targets[half_octaves] = wanted.astype(np.float32), trust.astype(np.float32), every
        return self._targets[half_octaves]

    def aimed(self, targets: Floats, amplitudes: Floats) -> Floats:
        """Return targets, (samples, points, 6), for each candidate, (samples, points, 6, candidates or 1 for all)."""
        changing = [k for k, e in enumerate(self.effects) if type(e).unobserved is not Effect.unobserved]
        if not any(amplitudes[:, self.columns[k]].any() for k in changing):
            return targets[..., None]
        each = []
        for row in amplitudes:
            aim = targets
            for k in reversed(changing):
                if row[self.columns[k]].any():
                    aim = self.effects[k].unobserved(aim, self.recording, row[self.columns[k]])
            each.append(aim)
        return np.stack(each, -1)

    def masses(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the masses of the nodes [kg] of one candidate."""
        mass = row[mat.DENSITY] * self.mesh.node_area
        for effect, columns in zip(self.effects, self.columns, strict=True):
            mass = effect.node_mass(mass, self.mesh, amplitude[columns])
        return mass

    def _friction(self, amplitude: Floats) -> float:
        """Return the largest frictional moment per width [N] of one candidate."""
        return sum(e.friction_moment(amplitude[c]) for e, c in zip(self.effects, self.columns, strict=True))

    def kernel_rows(self, materials: Floats, amplitudes: Floats) -> Floats:
        """Return the numbers of each candidate's material as columns of `Row`, (candidates, 19)."""
        warp, weft = np.exp(0.5 * materials[:, mat.STRETCH_RATIO]), np.exp(0.5 * materials[:, mat.BENDING_RATIO])
        x, y = np.sin(materials[:, mat.TILT_X]), np.sin(materials[:, mat.TILT_Y])
        stretch, bending = materials[:, mat.STRETCH], materials[:, mat.BENDING]
        gravity = self.support.gravity * np.exp(materials[:, mat.GRAVITY_LOG])
        fibres = np.stack([stretch * warp, stretch / warp])  # down, across
        at_shear = np.maximum(fibres - materials[:, mat.SHEAR], 0.0) if self.mesh.is_crossed else np.zeros_like(fibres)
        down, across = fibres - at_shear
        row = Row(
            stretch_down=down,
            stretch_across=across,
            shear=materials[:, mat.SHEAR],
            bending_down=bending * weft,
            bending_across=bending / weft,
            bending_mixed=bending,
            membrane_time=materials[:, mat.MEMBRANE_TIME],
            bending_time=materials[:, mat.BENDING_TIME],
            velocity_damping=materials[:, mat.VELOCITY],
            stiffening=materials[:, mat.STIFFENING],
            gravity_x=gravity * x,
            gravity_y=gravity * y,
            gravity_z=-gravity * np.sqrt(1 - x**2 - y**2),
            friction_limit=np.array([self._friction(a) for a in amplitudes]),
            viscosity_time=materials[:, mat.VISCOSITY],
            thickness=self.thickness(amplitudes),
            density=materials[:, mat.DENSITY],
            shear_down=at_shear[0],
            shear_across=at_shear[1],
        )
        return np.stack(row, axis=1)

    def resting(self, amplitudes: Floats, bends: int, is_needed: bool) -> Floats:
        """Return the curvature at rest per candidate and bend [1/m]."""
        rest = np.zeros((len(amplitudes), bends if is_needed else 1))
        for effect, columns in zip(self.effects if is_needed else (), self.columns, strict=False):
            for i in np.flatnonzero(amplitudes[:, columns].any(1)):
                rest[i] += effect.rest_curvature(self.mesh, amplitudes[i, columns])
        return rest

    def carried(self, amplitudes: Floats, nodes: int, is_needed: bool) -> Floats:
        """Return the added mass per candidate and node [kg]."""
        added = np.zeros((len(amplitudes), nodes if is_needed else 1))
        for effect, columns in zip(self.effects if is_needed else (), self.columns, strict=False):
            for i in np.flatnonzero(amplitudes[:, columns].any(1)):
                added[i] += effect.added_mass(self.mesh, amplitudes[i, columns])
        return added

    def paths(self, amplitudes: Floats, steps: int, dt: float) -> Floats:
        """Return the handles per step and candidate, (steps, 3 handles, candidates); equal drives are evaluated once.

        Candidates with one drive share the same memory, which must not be written to.
        """
        drivers = [k for k, e in enumerate(self.effects) if type(e).drive is not Effect.drive]
        names = [b"".join(row[self.columns[k]].tobytes() for k in drivers) for row in amplitudes]
        known: dict[bytes, Floats] = {}
        for name, row in zip(names, amplitudes, strict=True):
            if name not in known:
                known[name] = self._driven(row, drivers, steps, dt) if any(name) else self._path(steps, dt)
        if len(known) == 1:
            way = known[names[0]][..., None]
            return np.broadcast_to(way, (*way.shape[:-1], len(names)))
        return np.stack([known[name] for name in names], -1)

    def _driven(self, row: Floats, drivers: list[int], steps: int, dt: float) -> Floats:
        """Return the handles as effects drive them, (steps, 3 handles)."""
        curve = self.support.path
        for k in drivers:
            if row[self.columns[k]].any():
                curve = self.effects[k].drive(curve, self.recording, row[self.columns[k]])
        return curve(_instants(steps, dt))

    def _path(self, steps: int, dt: float) -> Floats:
        """Return handles that no effect drives, (steps, 3 handles), kept from one call to the next."""
        if len(self._undriven.get(dt, ())) < steps:
            self._undriven[dt] = self.support.path(_instants(steps, dt))
        return self._undriven[dt][:steps]


def _instants(steps: int, dt: float) -> Floats:
    return np.asarray(np.arange(steps) * dt, float)
