"""Calls of the rollout kernel: tasks (`fit.cloth.packing`) as the arrays that it wants, and what comes back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.cloth.kernel_arguments import contact_arguments, single, some, zeros
from fit.cloth.material import RELAXATION_TIME
from fit.cloth.mesh import Integers
from fit.cloth.model import Group
from fit.cloth.packing import Course, Task, plan

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Numbers = TypeVar("Numbers", Floats, Singles, Integers)


def launch(groups: Sequence[Group], observer_hz: float) -> None:
    """Simulate groups of one cloth and one kernel, and fill in their results."""
    lanes, calls = plan(groups, runtime.available_threads(), runtime.lane_widths(), is_pulled=observer_hz > 0)
    for tasks in calls:
        _call(tasks, lanes, observer_hz)


def _call(tasks: list[Task], lanes: int, observer_hz: float) -> None:
    """Run one kernel on tasks of at most `lanes` members."""
    from fit.cloth.rollout import make_rollout

    first, (has_effects, is_viscous, touches) = tasks[0].parts[0].model, tasks[0].parts[0].kernel
    mesh, support = first.mesh, first.support
    filled = [task.filled(lanes) for task in tasks]
    every = [pair for parts in filled for pair in parts]
    amplitudes = np.concatenate([g.candidates.amplitudes[k] for g, k in every])
    courses = [Course(task, parts, observer_hz > 0) for task, parts in zip(tasks, filled, strict=True)]
    frame_step, frame_lag = _padded([c.steps for c in courses]), _padded([c.lags for c in courses])
    targets, trust, first_target = _stacked(courses, lanes)
    count, nodes, bends, points = len(tasks), len(mesh.rest), len(mesh.bends), first.recording.points.shape[1]
    fibres, shears, frames = len(mesh.fibres.area), len(mesh.shear_area), frame_step.shape[1]
    strains = 3 if mesh.is_crossed else 1  # at a sample of shear
    keeps = every[0][0].candidates.kept is not None
    active = first.effects if has_effects else ()
    with_bends, with_added = any(e.bends for e in active), any(e.adds_mass for e in active)
    faces = tuple(
        (c.start, c.stop - c.start, e.face_force)
        for e, c in zip(active, first.columns, strict=False)
        if e.face_force is not None
    )
    rest, added = first.resting(amplitudes, bends, with_bends), first.carried(amplitudes, nodes, with_added)
    needs_normals = bool(faces) or with_bends or with_added
    start = np.concatenate([c.start for c in courses])
    rows = [(g.candidates.materials[k], g.candidates.amplitudes[k]) for g, k in every]
    numbers = [g.model.kernel_rows(*r) for (g, _), r in zip(every, rows, strict=True)]
    masses = [first.masses(m, a) for pair in rows for m, a in zip(*pair, strict=True)]
    places = _in_lanes(start, lanes)
    speeds, forces = (zeros(places.shape) for _ in range(2))
    out = zeros((count, frames, points, 3, lanes))
    whole = zeros((count, frames if keeps else 1, nodes, 3, lanes))
    omega = 2 * np.pi * observer_hz
    settle = np.array([round(support.settle_time / t.dt) for t in tasks], np.int32)
    recorded = np.array([len(c.steps) for c in courses], np.int32)
    path, first_path = _joined(courses, lanes)
    between = np.array([c.every for c in courses], np.int32)
    kernel = make_rollout(
        lanes, faces, fibre_nodes=first.fibre_nodes, bend_lengths=first.bend_lengths,
        handles=support.handles, with_twist=len(mesh.bends.twist_weights) > 0,
        is_crossed=mesh.is_crossed,
        with_bends=with_bends, with_added_mass=with_added, with_viscosity=is_viscous, with_contact=touches,
    )  # fmt: skip
    x, v = zeros((2 * 3 * count * nodes, lanes)), _flat(speeds)  # behind the places, what rounding loses of them
    x[: len(v)] = _flat(places)
    ahead = v if with_bends else _flat(places)
    with runtime.vectors_kept():
        kernel(
            x, v, ahead, _flat(forces), zeros((count, points, 3, lanes)),
            *first.membrane_arguments,
            *(zeros((size * count * fibres, lanes)) for size in (3, 3, 1)),
            zeros((count * shears * strains, lanes)), zeros((3 * count * fibres, lanes)),
            *(zeros((size * count if is_viscous else 1, lanes)) for size in (fibres, shears * strains)),
            np.exp(-np.array([t.dt for t in tasks]) / RELAXATION_TIME).astype(np.float32),
            *first.bending_arguments,
            *(zeros((size * count * nodes if needs_normals else 1, lanes)) for size in (3, 1)),
            _flat(_in_lanes(rest, lanes)), zeros((count * bends if with_bends else 1, lanes)),
            _flat(_in_lanes(added, lanes)),
            *_contact(tasks, amplitudes, nodes, lanes),
            3 * some(support.nodes), single(some(support.shares)), path,
            mesh.points.first, 3 * mesh.points.nodes, single(mesh.points.weights),
            mesh.pull_points, single(mesh.pull_weights),
            targets, trust,
            _in_lanes(np.concatenate(numbers), lanes),
            _flat(_in_lanes(1.0 / np.stack(masses), lanes)),
            _in_lanes(amplitudes if first.effects else np.zeros((len(amplitudes), 1)), lanes),
            frame_step, frame_lag, np.stack([recorded, settle, first_path, first_target, between], 1),
            np.array([t.dt for t in tasks], np.float32), support.settle_damping, omega**2, 2 * omega,
            out, whole,
        )  # fmt: skip
    _hand_back(courses, _from_lanes(out), _from_lanes(whole), _from_lanes(forces), lanes)


def _contact(tasks: list[Task], amplitudes: Floats, nodes: int, lanes: int) -> list[Singles | Integers]:
    """What the kernel wants to know of contact; next to nothing where nothing touches."""
    group = tasks[0].parts[0]
    first = group.model
    if not group.touches:
        memory = zeros((1, lanes))
        return [np.zeros(1, np.int32), memory, memory.reshape(-1)]
    return contact_arguments(first.surface, first.contact, first.thickness(amplitudes).reshape(-1, lanes), nodes)


def _stacked(courses: list[Course], lanes: int) -> tuple[Singles, Singles, Integers]:
    """Targets, (all samples, points, 6, lanes), and trust of all tasks, and where each task's begin.

    A recording that is over is trusted no more.
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
    """One row below the other, zeros behind the shorter ones."""
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


def _joined(courses: list[Course], lanes: int) -> tuple[Singles, Integers]:
    """Handles of all tasks, (all steps, 3 handles, lanes), and where each task's steps begin."""
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
    """(candidates, ...) -> (groups, ..., lanes), contiguous."""
    grouped = np.moveaxis(np.asarray(values, np.float32).reshape(-1, lanes, *values.shape[1:]), 1, -1)
    placed = zeros(grouped.shape)
    placed[...] = grouped
    return placed


def _flat(values: Singles) -> Singles:
    """(..., lanes) -> (all of them, lanes): the same memory."""
    return values.reshape(-1, values.shape[-1])


def _from_lanes(values: Singles) -> Singles:
    """(groups, ..., lanes) -> (candidates, ...)."""
    moved = np.moveaxis(values, -1, 1)
    return moved.reshape(-1, *moved.shape[2:])
