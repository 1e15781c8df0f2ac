"""Limit a batch's workers on this machine to its processors and its free memory, and say so.

A fit computes on one processor. So more workers than processors finish no sooner, and each takes memory of its own.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from formats.plain_text import counted, sized

NEEDED = 5e8  # bytes; our choice: twice the peak of a worker that fits `si` to the swatch of `tests/fit/batch/night.py`
MEMORY = Path("/proc/meminfo")
GROUPS = Path("/sys/fs/cgroup")  # control groups; in a container, its own group. Version 1 has a folder per controller
OWN_GROUP = Path("/proc/self/cgroup")  # the name of this process' group below `GROUPS`, as of a service with a limit
# The files of a group's limit and use, and the lines of `memory.stat` with the pages of files, which the kernel drops.
VERSION_2 = ("memory.max", "memory.current", ("active_file", "inactive_file"))
VERSION_1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", ("total_active_file", "total_inactive_file"))


@dataclass(frozen=True, kw_only=True)
class Room:
    """Processors that this process may use, and its free memory [bytes]; None where the system does not say."""

    processors: int
    memory: int | None

    def at_most(self, asked: int | None, jobs: int) -> tuple[int, str]:
        """Return how many workers to start for so many jobs, at least one, and why fewer than asked; '' if not fewer.

        asked: None for one worker a processor
        """
        wanted = min(self.processors if asked is None else asked, jobs)
        fitting = wanted if self.memory is None else max(1, int(self.memory / NEEDED))
        count = min(wanted, self.processors, fitting)
        if count == wanted:
            return count, ""
        if count == self.processors:
            cause = f"this machine has {counted(self.processors, 'processor')} for them, and each fit uses one"
        else:
            cause = f"{sized(self.memory or 0)} of memory are free, and a worker needs {sized(int(NEEDED))}"
        return count, f"{counted(count, 'worker')} instead of {wanted}: {cause}."


def room_here() -> Room:
    """Return the room of this machine, container or service."""
    known = [free for ask in (_free_of_machine, _free_of_group) if (free := ask()) is not None]
    return Room(processors=min([len(os.sched_getaffinity(0)), *_shares()]), memory=min(known, default=None))


def _free_of_machine() -> int | None:
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in MEMORY.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])  # the file counts in kB of 1024 bytes
    return None


def _free_of_group() -> int | None:
    """Return what the memory limits of control groups leave; None without a limit.

    The group of this process and those above it count. Cached pages of files are free, as in the machine's own figure.
    """
    found = [_left_of(group, *VERSION_2) for group in _groups("")]
    found += [_left_of(group, *VERSION_1) for group in _groups("memory")]
    return min((left for left in found if left is not None), default=None)


def _shares() -> list[int]:
    """Return the whole processors that each control group may use, one at least; a group without a limit has none."""
    found = []
    for controller, names in (("", ("cpu.max",)), ("cpu", ("cpu.cfs_quota_us", "cpu.cfs_period_us"))):
        for group in _groups(controller):
            with contextlib.suppress(OSError, ValueError, ZeroDivisionError):  # `max` is no number
                quota, period = (int(word) for name in names for word in (group / name).read_text().split())
                found += [max(1, quota // period)] * (quota > 0)
    return found


def _groups(controller: str) -> list[Path]:
    """Return the folders of this process' control group and of those above it; '' for version 2."""
    words = []
    with contextlib.suppress(OSError):
        words = [line.split(":", 2) for line in os.fsdecode(OWN_GROUP.read_bytes()).splitlines()]
    own = [(names, path) for _, names, path in (word for word in words if len(word) == 3)]  # number, names, path
    names, path = next((one for one in own if controller in one[0].split(",")), (controller, "/"))
    group = PurePosixPath("/", path)
    return [GROUPS / names / str(one).lstrip("/") for one in (group, *group.parents)]


def _left_of(group: Path, most: str, used_now: str, reclaimable: tuple[str, ...]) -> int | None:
    with contextlib.suppress(OSError, ValueError):
        limit, used = (int((group / name).read_text()) for name in (most, used_now))
        with contextlib.suppress(OSError, ValueError):
            lines = (line.split() for line in (group / "memory.stat").read_text().splitlines())
            used -= sum(int(size) for name, size in lines if name in reclaimable)
        return min(max(0, limit - used), limit)
    return None
