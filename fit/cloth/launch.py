"""Call the rollout kernel: convert tasks (`fit.cloth.packing`) into its arrays, and unpack the results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from fit import runtime
from fit.cloth.bundles import (
    COUNTS,
    Candidates,
    Clock,
    Counts,
    Facing,
    Grip,
    Kind,
    Membrane,
    Motion,
    Points,
    Pull,
    Results,
    Stencils,
    Strains,
    Touch,
    by_name,
)
from fit.cloth.kernel_arguments import contact_bundle, facing_bases, single, some, zeros
from fit.cloth.material import RELAXATION_TIME
from fit.cloth.model import Group
from fit.cloth.packing import Course, Task, plan
from formats.arrays import Floats, Indices, Integers, Singles

Numbers = TypeVar("Numbers", Floats, Singles, Indices)


Progress = Callable[[float], None]
PIECES_REPORTED = 100  # parts of a simulation that reports its progress; our choice: a part is one per cent of it
NUMBERS_A_PIECE = 5e7  # coordinates times steps of one part, about a second of one core: Ctrl-C waits for its end


def launch(groups: Sequence[Group], observer_hz: float, progress: Progress | None = None) -> None:
    """Simulate groups of one cloth and one kernel, and fill in their results; `progress` receives the share done."""
    lanes, calls = plan(groups, runtime.available_threads(), runtime.lane_widths(), is_pulled=observer_hz > 0)
    for number, tasks in enumerate(calls):

        def report(share: float, number: int = number) -> None:
            if progress is not None:
                progress((number + share) / len(calls))

        _call(tasks, lanes, observer_hz, PIECES_REPORTED if progress is not None else 0, report)


def _call(tasks: list[Task], lanes: int, observer_hz: float, pieces: int, progress: Progress) -> None:
    """Run one kernel on tasks of at most `lanes` members, in pieces; 0: in as few as let Ctrl-C through in time."""
    from fit.cloth.rollout import make_rollout

    filled = [task.filled(lanes) for task in tasks]
    courses = [Course(task, parts, observer_hz > 0) for task, parts in zip(tasks, filled, strict=True)]
    kind = _kind(tasks[0].parts[0], lanes)
    every = [pair for parts in filled for pair in parts]
    amplitudes = np.concatenate([g.candidates.amplitudes[k] for g, k in every])
    motion, results = _motion(courses, lanes, kind), _results(tasks, courses, lanes)
    driven = _driven(tasks, courses, lanes, observer_hz)
    bundles = (
        motion,
        *_membrane(tasks, kind),
        *_bending(tasks, amplitudes, kind),
        _contact(tasks, amplitudes, lanes),
        *driven,
        _candidates(every, amplitudes, kind),
        results,
    )
    kernel = make_rollout(kind)
    few = pieces_for(int(driven[-1].frame_step.max(initial=0)), motion.f.size)
    for share in _pieces(driven[-1], pieces or few):
        with runtime.vectors_kept():
            kernel(**by_name(bundles))
        progress(share)
    forces = motion.f.reshape(len(tasks), -1, 3, lanes)
    _hand_back(courses, _from_lanes(results.seen), _from_lanes(results.shapes), _from_lanes(forces), lanes)


def pieces_for(steps: int, numbers: int) -> int:
    """Return in how many calls a simulation of some steps and coordinates runs, so that Ctrl-C is soon obeyed."""
    return min(PIECES_REPORTED, 1 + int(steps * numbers / NUMBERS_A_PIECE))


def _pieces(clock: Clock, pieces: int) -> Iterator[float]:
    """Set the counts for one part of the frames after the other, and yield the finished share after each.

    The kernel's arrays hold the whole state of a simulation, so that the result equals that of a single call.
    """
    counts, steps = clock.counts, clock.frame_step
    ends = counts[:, COUNTS.frames].copy()
    most = int(ends.max())
    for piece in range(min(pieces, most)):
        counts[:, COUNTS.first_frame] = counts[:, COUNTS.end_frame]
        counts[:, COUNTS.end_frame] = np.minimum(ends, -(-most * (piece + 1) // min(pieces, most)))
        if piece > 0:
            last = np.maximum(counts[:, COUNTS.first_frame] - 1, 0)
            counts[:, COUNTS.first_step] = np.take_along_axis(steps, last[:, None], 1)[:, 0]
        yield (piece + 1) / min(pieces, most)


def _kind(group: Group, lanes: int) -> Kind:
    """Return the kind of kernel that a group needs."""
    model, mesh = group.model, group.model.mesh
    active = model.effects if group.has_effects else ()
    return Kind(
        lanes=lanes,
        face_forces=tuple(
            (c.start, c.stop - c.start, e.face_force)
            for e, c in zip(active, model.columns, strict=False)
            if e.face_force is not None
        ),
        fibre_nodes=model.fibre_nodes,
        bend_lengths=model.bend_lengths,
        handles=model.support.handles,
        with_twist=len(mesh.bends.twist_weights) > 0,
        is_crossed=mesh.is_crossed,
        with_bends=any(e.bends for e in active),
        with_added_mass=any(e.adds_mass for e in active),
        with_viscosity=group.is_viscous,
        with_contact=group.touches,
    )


def _motion(courses: list[Course], lanes: int, kind: Kind) -> Motion:
    places = _flat(_in_lanes(np.concatenate([c.start for c in courses]), lanes))
    x, v, f = zeros((2 * len(places), lanes)), zeros(places.shape), zeros(places.shape)
    x[: len(places)] = places
    return Motion(x=x, v=v, ahead=v if kind.with_bends else places, f=f)


def _membrane(tasks: list[Task], kind: Kind) -> tuple[Membrane, Strains]:
    model, count, lanes = tasks[0].parts[0].model, len(tasks), kind.lanes
    fibres, shears = len(model.mesh.fibres.area), len(model.mesh.shear_area)
    at_shear = shears * (3 if kind.is_crossed else 1)
    strains = Strains(
        slopes=zeros((3 * count * fibres, lanes)),
        slopes_ahead=zeros((3 * count * fibres, lanes)),
        strains=zeros((count * fibres, lanes)),
        shear_strains=zeros((count * at_shear, lanes)),
        stress=zeros((3 * count * fibres, lanes)),
        fibre_lags=zeros((count * fibres if kind.with_viscosity else 1, lanes)),
        shear_lags=zeros((count * at_shear if kind.with_viscosity else 1, lanes)),
        lag_kept=np.exp(-np.array([t.dt for t in tasks]) / RELAXATION_TIME).astype(np.float32),
    )
    return model.membrane_bundle, strains


def _bending(tasks: list[Task], amplitudes: Floats, kind: Kind) -> tuple[Stencils, Facing]:
    model, count, lanes = tasks[0].parts[0].model, len(tasks), kind.lanes
    bends, nodes = len(model.mesh.bends), count * len(model.mesh.rest)
    cells, basis = facing_bases(model.mesh)
    facing = Facing(
        cells=cells,
        basis=basis,
        normal=zeros((3 * nodes if kind.needs_normals else 1, lanes)),
        faced_area=zeros((nodes if kind.needs_normals else 1, lanes)),
        rest_curvature=_flat(_in_lanes(model.resting(amplitudes, bends, kind.with_bends), lanes)),
        friction=zeros((count * bends if kind.with_bends else 1, lanes)),
    )
    return model.stencil_bundle, facing


def _contact(tasks: list[Task], amplitudes: Floats, lanes: int) -> Touch:
    """Return the kernel's arguments on contact; nearly empty if nothing touches."""
    group = tasks[0].parts[0]
    model = group.model
    if not group.touches:
        memory = zeros((1, lanes))
        return Touch(contact_whole=np.zeros(1, np.int32), contact_memory=memory, contact_alone=memory.reshape(-1))
    thickness = model.thickness(amplitudes).reshape(-1, lanes)
    return contact_bundle(model.surface, model.contact, thickness, len(model.mesh.rest))


def _driven(
    tasks: list[Task], courses: list[Course], lanes: int, observer_hz: float
) -> tuple[Grip, Points, Pull, Clock]:
    """Return handles, pull, bodies and clock of the tasks: the inputs that drive the cloth over time."""
    model = tasks[0].parts[0].model
    support, points, omega = model.support, model.mesh.points, 2 * np.pi * observer_hz
    path, first_path = _joined(courses, lanes)
    targets, trust, first_target = _stacked(courses, lanes)
    grip = Grip(
        held=3 * some(support.nodes),
        shares=single(some(support.shares)),
        path=path,
        settle_damping=support.settle_damping,
    )
    pull = Pull(
        pull=zeros((len(tasks), model.recording.points.shape[1], 3, lanes)),
        pull_points=model.mesh.pull_points,
        pull_weights=single(model.mesh.pull_weights),
        targets=targets,
        trust=trust,
        gain=omega**2,
        damping=2 * omega,
    )
    settle_steps = np.array([round(support.settle_time / t.dt) for t in tasks], np.int32)
    counts = Counts(
        frames=np.array([len(c.steps) for c in courses], np.int32),
        first_frame=np.zeros(len(tasks), np.int32),
        end_frame=np.zeros(len(tasks), np.int32),
        first_step=-settle_steps,
        settle_steps=settle_steps,
        first_path=first_path,
        first_target=first_target,
        steps_per_target=np.array([c.every for c in courses], np.int32),
    )
    clock = Clock(
        time_step=np.array([t.dt for t in tasks], np.float32),
        frame_step=_padded([c.steps for c in courses]),
        frame_lag=_padded([c.lags for c in courses]),
        counts=np.stack(counts, 1),
    )
    tracked = Points(point_first=points.first, point_nodes=3 * points.nodes, point_weights=single(points.weights))
    return grip, tracked, pull, clock


def _candidates(every: list[tuple[Group, Integers]], amplitudes: Floats, kind: Kind) -> Candidates:
    model = every[0][0].model
    rows = [(g.model, g.candidates.materials[k], g.candidates.amplitudes[k]) for g, k in every]
    masses = [model.masses(m, a) for _, materials, row in rows for m, a in zip(materials, row, strict=True)]
    carried = model.carried(amplitudes, len(model.mesh.rest), kind.with_added_mass)
    columns = amplitudes if model.effects else np.zeros((len(amplitudes), 1))
    return Candidates(
        material=_in_lanes(np.concatenate([m.kernel_rows(materials, row) for m, materials, row in rows]), kind.lanes),
        amplitude=_in_lanes(columns, kind.lanes),
        inverse_mass=_flat(_in_lanes(1.0 / np.stack(masses), kind.lanes)),
        added_mass=_flat(_in_lanes(carried, kind.lanes)),
    )


def _results(tasks: list[Task], courses: list[Course], lanes: int) -> Results:
    group = tasks[0].parts[0]
    frames, points = max(len(c.steps) for c in courses), group.model.recording.points.shape[1]
    nodes, keeps = len(group.model.mesh.rest), group.candidates.kept is not None
    return Results(
        seen=zeros((len(tasks), frames, points, 3, lanes)),
        shapes=zeros((len(tasks), frames if keeps else 1, nodes, 3, lanes)),
    )


def _stacked(courses: list[Course], lanes: int) -> tuple[Singles, Singles, Indices]:
    """Return targets, (all samples, points, 6, lanes), and trust of all tasks, and where each task's begin.

    After a recording's end its targets have trust 0.
    """
    samples = [max(len(places) for places, _, _ in c.targets) for c in courses]
    points = courses[0].targets[0][1].shape[1]
    firsts = np.cumsum([0, *samples]).astype(np.int32)
    targets, trust = zeros((firsts[-1], points, 6, lanes)), zeros((firsts[-1], points, lanes))
    for course, first in zip(courses, firsts, strict=False):
        lane = 0
        for places, believed, count in course.targets:
            mine = slice(first, first + len(places)), ..., slice(lane, lane + count)
            targets[mine], trust[mine] = places, believed[..., None]
            lane += count
    return targets, trust, firsts[:-1]


def _padded(rows: list[Numbers]) -> Numbers:
    """Stack rows of different lengths, padded with zeros."""
    padded = np.zeros((len(rows), max(len(r) for r in rows)), rows[0].dtype)
    for whole, row in zip(padded, rows, strict=True):
        whole[: len(row)] = row
    return padded


def _hand_back(courses: list[Course], seen: Singles, kept: Singles, forces: Singles, lanes: int) -> None:
    for number, course in enumerate(courses):
        lane = number * lanes
        for part in course.task.parts:
            candidates, mine = part.candidates, slice(lane, lane + len(part.members))
            frames = np.searchsorted(course.time, part.model.recording.time)
            candidates.seen[part.members] = seen[mine][:, frames]
            if candidates.kept is not None:
                candidates.kept[part.members, :-1] = kept[mine][:, frames]
                candidates.kept[part.members, -1] = forces[mine]
            lane += len(part.members)


def _joined(courses: list[Course], lanes: int) -> tuple[Singles, Indices]:
    """Return the handles of all tasks, (all steps, 3 handles, lanes), and where each task's steps begin."""
    firsts = np.cumsum([0, *(len(c.paths[0]) for c in courses)]).astype(np.int32)
    handles = courses[0].paths[0].shape[1]
    joined = zeros((int(firsts[-1]), max(handles, 1), lanes))
    for course, first in zip(courses, firsts, strict=False):
        lane = 0
        for way in course.paths:
            joined[first : first + len(way), :handles, lane : lane + way.shape[2]] = way
            lane += way.shape[2]
    return joined, firsts[:-1]


def _in_lanes(values: Floats, lanes: int) -> Singles:
    """Reorder (candidates, ...) into (groups, ..., lanes), contiguous."""
    grouped = np.moveaxis(np.asarray(values, np.float32).reshape(-1, lanes, *values.shape[1:]), 1, -1)
    placed = zeros(grouped.shape)
    placed[...] = grouped
    return placed


def _flat(values: Singles) -> Singles:
    """Reshape (..., lanes) to (n, lanes) in the same memory."""
    return values.reshape(-1, values.shape[-1])


def _from_lanes(values: Singles) -> Singles:
    """Reorder (groups, ..., lanes) into (candidates, ...)."""
    moved = np.moveaxis(values, -1, 1)
    return moved.reshape(-1, *moved.shape[2:])
