"""Pack candidates of one or several recordings of one cloth into tasks: groups of SIMD lanes.

Candidates of several recordings with the same step share groups. A group has the frames of all its recordings, and each
recording keeps its own frames. Every group is one task, and the longest task goes to a processor first. The width of
the groups minimises an estimate of the time until the last processor is done:

    max(longest task, sum of all tasks / processors),  a task's time being its steps times COST of its lanes
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fit import runtime
from fit.cloth.model import Group
from formats.arrays import Integers

# Relative time of a step by lanes, a guess: an AMD EPYC with AVX-512 took 1, 1.24 and 1.86 for plain cloth.
# Only how candidates are packed depends on it, no result.
COST = {1: 1.0, 8: 1.15, 16: 1.5}
# Per processor and call. Our choice: with fewer, processors wait for the last task. With more, Ctrl-C waits longer,
# since a call cannot be interrupted. Half and double were not tried.
TASKS = 8
MOST_NUMBERS_OF_CALL = 2**28  # single-precision numbers in a call, 1 GB; limits calls and lanes where possible
FRAME_COPIES, HANDLE_COPIES = 2, 3  # copies of the results, and of the handles, which start in double precision


@dataclass(frozen=True, eq=False)
class Task:
    """One group of lanes: candidates of one or several recordings with the same time step.

    parts: a group for each recording, whose members lie side by side in this order
    """

    parts: tuple[Group, ...]

    @property
    def steps(self) -> float:
        """Return the steps of the longest of its recordings."""
        return max(part.steps for part in self.parts)

    @property
    def dt(self) -> float:
        """Return the time step [s]."""
        return self.parts[0].dt

    def numbers(self, *, is_pulled: bool) -> int:
        """Estimate of the single-precision numbers per lane: frames and their copies, handles, targets."""
        first = self.parts[0].model
        points = first.recording.points.shape[1]
        handles = 3 * HANDLE_COPIES * first.support.handles * self.steps
        frames = 3 * FRAME_COPIES * points * sum(len(part.model.recording.time) for part in self.parts)
        sizes = [part.model.observer_targets(part.half_octaves)[:2] for part in self.parts] if is_pulled else []
        return int(handles + frames + max((places.size + trust.size for places, trust in sizes), default=0))

    def filled(self, lanes: int) -> list[tuple[Group, Integers]]:
        """Return every part and its members; copies of the last member fill the remaining lanes."""
        members = [part.members for part in self.parts]
        missing = lanes - sum(len(m) for m in members)
        members[-1] = np.concatenate([members[-1], np.repeat(members[-1][-1:], missing)])
        return list(zip(self.parts, members, strict=True))


def pack(groups: Sequence[Group], lanes: int) -> list[Task]:
    """Return tasks of at most `lanes` candidates; candidates with stored shapes share no task with other recordings."""
    tasks = []
    for octaves in sorted({g.half_octaves for g in groups}):
        # The longest first: a task takes as long as the longest of its recordings.
        alike = sorted((g for g in groups if g.half_octaves == octaves), key=lambda g: -g.steps)
        apart = any(g.candidates.kept is not None for g in alike)
        for together in [[g] for g in alike] if apart else [alike]:
            tasks += _shared(together, lanes)
    return tasks


def _shared(groups: list[Group], lanes: int) -> list[Task]:
    parts: list[list[Group]] = [[]]
    room = lanes
    for group in groups:
        taken = 0
        while taken < len(group.members):
            if room == 0:
                parts.append([])
                room = lanes
            parts[-1].append(replace(group, members=group.members[taken : taken + room]))
            room -= len(parts[-1][-1].members)
            taken += len(parts[-1][-1].members)
    return [Task(tuple(p)) for p in parts if p]


def plan(
    groups: Sequence[Group], threads: int, widths: Sequence[int], *, is_pulled: bool
) -> tuple[int, list[list[Task]]]:
    """Return the number of lanes per task, and the tasks of every kernel call.

    threads: processors that share a call; widths: numbers of lanes to choose from; is_pulled: whether an observer pulls
    """
    packed = {lanes: sorted(pack(groups, lanes), key=lambda t: -t.steps) for lanes in widths}
    largest = {lanes: lanes * max(t.numbers(is_pulled=is_pulled) for t in tasks) for lanes, tasks in packed.items()}
    small = [lanes for lanes in widths if threads * largest[lanes] <= MOST_NUMBERS_OF_CALL] or [min(widths)]
    lanes = min(small, key=lambda n: _time(packed[n], n, threads))
    at_once = threads * int(np.clip(MOST_NUMBERS_OF_CALL // largest[lanes] // threads, 1, TASKS))
    tasks = packed[lanes]
    return lanes, [tasks[start : start + at_once] for start in range(0, len(tasks), at_once)]


def _time(tasks: list[Task], lanes: int, threads: int) -> float:
    times = [COST[lanes] * t.steps for t in tasks]
    return max(max(times), sum(times) / threads)


class Course:
    """Time course of one task: frames and their steps, handle paths, and observer targets.

    - `time` [s], (frames,): of every frame of any of its recordings
    - `steps`, `lags` [s], (frames,): whole steps to a frame, and the rest
    - `paths`: of each part, (steps, 3 handles, its lanes)
    - `start` [m], (lanes, nodes, 3)
    - `targets`: of each part positions and velocities, (samples, points, 6, lanes or 1), trust, (samples, points), and
      its number of lanes
    - `every`: steps between two targets
    """

    def __init__(self, task: Task, parts: list[tuple[Group, Integers]], is_pulled: bool) -> None:
        self.task = task
        self.time = np.unique(np.concatenate([part.model.recording.time for part in task.parts]))
        whole = np.floor(self.time / task.dt + 1e-9).astype(np.int32)
        self.steps, self.lags = whole, (self.time - whole * task.dt).astype(np.float32)
        self.paths = [g.model.paths(g.candidates.amplitudes[k], int(whole[-1]) + 3, task.dt) for g, k in parts]
        starts = [g.model.support.start(way[0].T) for (g, _), way in zip(parts, self.paths, strict=True)]
        self.start = runtime.jittered(np.concatenate(starts))
        # Settling without a pull needs two targets: the first positions of the points, and the next ones.
        asked = slice(None if is_pulled else 2)
        self.targets = []
        for group, members in parts:
            places, trust, self.every = group.model.observer_targets(group.half_octaves)
            aimed = group.model.aimed(places[asked], group.candidates.amplitudes[members])
            self.targets.append((aimed, trust[asked], len(members)))
