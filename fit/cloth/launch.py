"""Calls of the rollout kernel: candidates of one or several recordings of one cloth, packed into groups of lanes.

Every group is one task with its own recording, step and frames; tasks go to the processors longest first. How wide the
groups are is a guess at the least time: processors that work side by side until the last task is done,

    max(longest task, sum of all tasks / processors),  a task's time being its steps times COST of its lanes
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.cloth import spectral
from fit.cloth.contact import Contact, Surface
from fit.cloth.lines import BETWEEN, bends_by_line, fibre_family, twist_scales
from fit.cloth.mesh import ClothMesh, Integers
from fit.effects.stretch_viscosity import RELAXATION_TIME

if TYPE_CHECKING:
    from fit.cloth.simulator import Simulator

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Numbers = TypeVar("Numbers", Floats, Singles, Integers)

COST = {4: 1.0, 8: 1.07, 16: 1.4}  # of a group by its lanes: processors add up to eight numbers as fast as one
ALIGNMENT = 64  # bytes: sixteen lanes of four bytes
TASKS = 8  # per processor and call: a call cannot be interrupted


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidates on one recording and what becomes of them.

    materials, (candidates, parameters), with what effects change in them; amplitudes, (candidates, components)
    seen [m], (candidates, frames, points, 3), and kept, (candidates, frames + 1, nodes, 3) or None: where results go,
    the places of the nodes [m] and, in the last row, the last forces on them [N]
    """

    materials: Floats
    amplitudes: Floats
    seen: Floats
    kept: Singles | None


@dataclass(frozen=True, eq=False)
class Group:
    """Candidates with the same step and the same kernel; members are indices, (n,)."""

    simulator: Simulator
    candidates: Candidates
    members: NDArray[np.int64]
    half_octaves: int
    has_effects: bool
    is_viscous: bool
    touches: bool

    @property
    def kernel(self) -> tuple[bool, bool, bool]:
        """What decides which kernel simulates them."""
        return self.has_effects, self.is_viscous, self.touches

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return self.simulator.step(self.half_octaves)

    @property
    def steps(self) -> float:
        """Steps from the beginning of settling to the last frame."""
        return (self.simulator.recording.duration + self.simulator.support.settle_time) / self.dt

    def split(self, lanes: int) -> list[Group]:
        """Return groups of at most this many members."""
        starts = range(0, len(self.members), lanes)
        return [replace(self, members=self.members[k : k + lanes]) for k in starts]


def launch(groups: Sequence[Group], observer_hz: float) -> None:
    """Simulate groups of one cloth and one kernel, and fill in their results."""
    threads = runtime.available_threads()
    lanes = min(runtime.lane_widths(), key=lambda n: _time(groups, n, threads))
    tasks = sorted((task for g in groups for task in g.split(lanes)), key=lambda g: -g.steps)
    for start in range(0, len(tasks), TASKS * threads):
        _call(tasks[start : start + TASKS * threads], lanes, observer_hz)


def _time(groups: Sequence[Group], lanes: int, threads: int) -> float:
    times = [COST[lanes] * g.steps for g in groups for _ in range(-(-len(g.members) // lanes))]
    return max(max(times), sum(times) / threads)


def _call(tasks: list[Group], lanes: int, observer_hz: float) -> None:
    """Run one kernel on tasks of at most `lanes` members; what is left of a task's lanes repeats its last member."""
    from fit.cloth.rollout import make_rollout

    first, (has_effects, is_viscous, touches) = tasks[0].simulator, tasks[0].kernel
    mesh, support = first.mesh, first.support
    chosen = [np.concatenate([t.members, np.repeat(t.members[-1:], lanes - len(t.members))]) for t in tasks]
    both = list(zip(tasks, chosen, strict=True))
    amplitudes = np.concatenate([t.candidates.amplitudes[k] for t, k in both])
    paths, frame_step, frame_lag = _courses(both)
    targets = _Targets(tasks)
    count, nodes, bends, points = len(tasks), len(mesh.rest), len(mesh.bends), first.recording.points.shape[1]
    fibres, shears, frames = len(mesh.fibres.area), len(mesh.shear_area), frame_step.shape[1]
    keeps = tasks[0].candidates.kept is not None
    active = first.effects if has_effects else ()
    with_bends, with_added = any(e.bends for e in active), any(e.adds_mass for e in active)
    faces = tuple(
        (c.start, c.stop - c.start, e.face_force)
        for e, c in zip(active, first.columns, strict=False)
        if e.face_force is not None
    )
    rest, added = first.resting(amplitudes, bends, with_bends), first.carried(amplitudes, nodes, with_added)
    needs_normals = bool(faces) or with_bends or with_added
    start = np.concatenate([t.simulator.support.start(path[:, 0]) for t, path in zip(tasks, paths, strict=True)])
    rows = [(t.candidates.materials[k], t.candidates.amplitudes[k]) for t, k in both]
    masses = [first.masses(m, a) for pair in rows for m, a in zip(*pair, strict=True)]
    state = [_in_lanes(start, lanes), *(_zeros((count, nodes, 3, lanes)) for _ in range(2))]
    out = _zeros((count, frames, points, 3, lanes))
    whole = _zeros((count, frames if keeps else 1, nodes, 3, lanes))
    omega = 2 * np.pi * observer_hz
    settle = np.array([round(t.simulator.support.settle_time / t.dt) for t in tasks], np.int32)
    recorded = np.array([len(t.simulator.recording.time) for t in tasks], np.int32)
    kernel = make_rollout(
        lanes, faces, fibre_nodes=first.fibre_nodes, bend_lengths=first.bend_lengths,
        handles=support.handles, with_twist=len(mesh.bends.twist_weights) > 0,
        with_bends=with_bends, with_added_mass=with_added, with_viscosity=is_viscous, with_contact=touches,
    )  # fmt: skip
    x, v = _flat(state[0]), _flat(state[1])
    ahead = v if with_bends else _flat(_in_lanes(start, lanes))
    with runtime.vectors_kept():
        kernel(
            x, v, ahead, _flat(state[2]), _zeros((count, points, 3, lanes)),
            *first.membrane_arguments,
            *(_zeros((size * count * fibres, lanes)) for size in (3, 3, 1)),
            _zeros((count * shears, lanes)), _zeros((3 * count * fibres, lanes)),
            *(_zeros((size * count if is_viscous else 1, lanes)) for size in (fibres, shears)),
            np.exp(-np.array([t.dt for t in tasks]) / RELAXATION_TIME).astype(np.float32),
            *first.bending_arguments,
            *(_zeros((size * count * nodes if needs_normals else 1, lanes)) for size in (3, 1)),
            _flat(_in_lanes(rest, lanes)), _zeros((count * bends if with_bends else 1, lanes)),
            _flat(_in_lanes(added, lanes)),
            *_contact(tasks, amplitudes, nodes, lanes),
            3 * _some(support.nodes), _single(_some(support.shares)), _joined(paths, lanes),
            mesh.points.first, 3 * mesh.points.nodes, _single(mesh.points.weights),
            mesh.pull_points, _single(mesh.pull_weights),
            targets.places, targets.trust,
            _in_lanes(np.concatenate([t.simulator.kernel_rows(*r) for t, r in zip(tasks, rows, strict=True)]), lanes),
            _flat(_in_lanes(1.0 / np.stack(masses), lanes)),
            _in_lanes(amplitudes if first.effects else np.zeros((len(amplitudes), 1)), lanes),
            frame_step, frame_lag, np.stack([recorded, settle, _firsts(paths), targets.first, targets.every], 1),
            np.array([t.dt for t in tasks], np.float32), support.settle_damping, omega**2, 2 * omega,
            out, whole,
        )  # fmt: skip
    _hand_back(tasks, _from_lanes(out), _from_lanes(whole), _from_lanes(state[2]), lanes)


def _contact(tasks: list[Group], amplitudes: Floats, nodes: int, lanes: int) -> list[Singles | Integers]:
    """What the kernel wants to know of contact; next to nothing where nothing touches."""
    first = tasks[0].simulator
    if not tasks[0].touches:
        memory = _zeros((1, lanes))
        return [np.zeros(1, np.int32), memory, memory.reshape(-1)]
    return contact_arguments(first.surface, first.contact, first.thickness(amplitudes).reshape(-1, lanes), nodes)


def contact_arguments(surface: Surface, contact: Contact, thickness: Floats, nodes: int) -> list[Singles | Integers]:
    """What the kernel wants to know of contact and the memory it works in, in the order of `fit.cloth.nearby`.

    thickness [m], (groups, lanes): distances at which layers are kept apart
    """
    from fit.cloth.nearby import COUNTS, PANEL, SPOT

    samples, quads, bodies = len(surface.area), len(surface.quads), contact.bodies
    groups, lanes = thickness.shape
    most = (int(surface.may_meet.sum()) if thickness.any() else 0) + samples * len(bodies)
    numbers = np.concatenate(
        [
            surface.samples.weights[:, 0], surface.area, surface.reach, surface.windows.ravel(),
            *(body.row() for body in bodies),
            [surface.carried, contact.friction, contact.clearance], thickness.max(1),
        ]
    )  # fmt: skip
    front = -(-len(numbers) // lanes)
    memory = _zeros((front + groups * (SPOT * samples + PANEL * quads + 6 * nodes + 1), lanes))
    alone = memory.reshape(-1)
    alone[: len(numbers)] = numbers
    sizes = np.array([samples, quads, len(bodies), most, front])
    known = np.concatenate([sizes, 3 * surface.samples.nodes, SPOT * surface.quads.ravel(), surface.words()])
    # Room for every pair there is, hardly any of which is ever touched.
    whole = np.zeros(len(known) + groups * (COUNTS + 2 * (samples + quads + most)), np.int32)
    whole[: len(known)] = known
    return [whole, memory, alone]


def _hand_back(tasks: list[Group], seen: Singles, kept: Singles, forces: Singles, lanes: int) -> None:
    for number, task in enumerate(tasks):
        candidates, count = task.candidates, len(task.members)
        frames, mine = candidates.seen.shape[1], slice(number * lanes, number * lanes + count)
        candidates.seen[task.members] = seen[mine, :frames]
        if candidates.kept is not None:
            candidates.kept[task.members, :-1] = kept[mine, :frames]
            candidates.kept[task.members, -1] = forces[mine]


def _courses(tasks: list[tuple[Group, NDArray[np.int64]]]) -> tuple[list[Floats], Integers, Singles]:
    """Handles of every task, each (lanes, steps, 3 handles); whole steps and the rest [s] to every frame, padded."""
    frames = max(len(t.simulator.recording.time) for t, _ in tasks)
    steps, lags = np.zeros((len(tasks), frames), np.int32), np.zeros((len(tasks), frames), np.float32)
    paths = []
    for number, (task, chosen) in enumerate(tasks):
        time = task.simulator.recording.time
        whole = np.floor(time / task.dt + 1e-9).astype(np.int32)
        steps[number, : len(time)], lags[number, : len(time)] = whole, time - whole * task.dt
        paths.append(task.simulator.paths(task.candidates.amplitudes[chosen], int(whole[-1]) + 3, task.dt))
    return paths, steps, lags


class _Targets:
    """What the observer pulls to, one recording and step after the other: where each task's begin, and how fine."""

    def __init__(self, tasks: list[Group]) -> None:
        known: dict[tuple[int, int], int] = {}
        places, trust, first, every = [], [], [], []
        length = 0
        for task in tasks:
            name = id(task.simulator), task.half_octaves
            wanted, believed, steps = task.simulator.observer_targets(task.half_octaves)
            if name not in known:
                known[name] = length
                places.append(wanted)
                trust.append(believed)
                length += len(wanted)
            first.append(known[name])
            every.append(steps)
        self.places, self.trust = np.concatenate(places), np.concatenate(trust)
        self.first, self.every = np.array(first, np.int32), np.array(every, np.int32)


def _firsts(paths: list[Floats]) -> Integers:
    """Where each task's steps begin in the joined paths."""
    return np.cumsum([0, *(p.shape[1] for p in paths[:-1])]).astype(np.int32)


def _joined(paths: list[Floats], lanes: int) -> Singles:
    """(lanes, steps, 3 handles) each -> (all steps, 3 handles, lanes)."""
    joined = _zeros((sum(p.shape[1] for p in paths), max(paths[0].shape[2], 1), lanes))
    done = 0
    for path in paths:
        joined[done : done + path.shape[1], : path.shape[2]] = np.moveaxis(path, 0, -1)
        done += path.shape[1]
    return joined


def _zeros(shape: tuple[int, ...]) -> Singles:
    """Zeros whose vectors of lanes lie where the processor loads them whole: a misaligned one ends the process."""
    size = 4 * int(np.prod(shape))
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(np.float32).reshape(shape)


def _in_lanes(values: Floats, lanes: int) -> Singles:
    """(candidates, ...) -> (groups, ..., lanes), contiguous."""
    grouped = np.moveaxis(np.asarray(values, np.float32).reshape(-1, lanes, *values.shape[1:]), 1, -1)
    placed = _zeros(grouped.shape)
    placed[...] = grouped
    return placed


def _flat(values: Singles) -> Singles:
    """(..., lanes) -> (all of them, lanes): the same memory."""
    return values.reshape(-1, values.shape[-1])


def _from_lanes(values: Singles) -> Singles:
    """(groups, ..., lanes) -> (candidates, ...)."""
    moved = np.moveaxis(values, -1, 1)
    return moved.reshape(-1, *moved.shape[2:])


def _some(values: Numbers) -> Numbers:
    """The same, or a single zero of as many dimensions in place of nothing, which Taichi cannot take."""
    return values if values.size else np.zeros_like(values, shape=[max(n, 1) for n in values.shape])


def _single(values: Floats) -> Singles:
    return np.ascontiguousarray(values, np.float32)


def membrane_arguments(mesh: ClothMesh) -> list[Singles | Integers | int]:
    """What the kernel wants to know of the membrane, in its order."""
    families = [fibre_family(mesh, k) for k in range(2)]
    return [
        3 * np.concatenate([nodes for _, nodes, _ in families]), np.concatenate([w for _, _, w in families]),
        len(families[0][1]), _single(mesh.fibres.area), mesh.fibres_across,
        3 * mesh.shear_across.ravel(), 3 * mesh.shear_down.ravel(), BETWEEN,
        _single(mesh.shear_area),
    ]  # fmt: skip


def bending_arguments(mesh: ClothMesh) -> list[Singles | Integers]:
    """What the kernel wants to know of bending and of normals, in its order."""
    bends, plain = mesh.bends, len(mesh.bends.stencils)
    root = _single(np.sqrt(bends.area))
    basis = np.vstack([spectral.slopes(spectral.NODES), spectral.WEIGHTS])
    return [
        bends.stencils.first, 3 * bends.stencils.nodes, bends_by_line(mesh)[1],
        bends.kind[:plain], 3 * bends.centre[:plain], root[:plain], bends.counts[bends.counts > 0],
        _some(twist_scales(mesh)), 3 * _some(bends.centre[plain:]), _some(root[plain:]),
        3 * mesh.cells, _single(basis),
    ]  # fmt: skip
