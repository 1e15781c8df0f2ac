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
GROUPS = Path("/sys/fs/cgroup")  # control groups, version 2; in a container, its own group
OWN_GROUP = Path("/proc/self/cgroup")  # the name of this process' group below `GROUPS`, as of a service with a limit
RECLAIMABLE = ("active_file", "inactive_file")  # lines of `memory.stat`: pages of files, which the kernel drops at need


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
    return Room(processors=len(os.sched_getaffinity(0)), memory=min(known, default=None))


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
    own = PurePosixPath("/")
    with contextlib.suppress(OSError):
        names = [line[3:] for line in OWN_GROUP.read_text().splitlines() if line.startswith("0::")]
        own = PurePosixPath("/", *names)
    found = [_left_of(GROUPS / str(group).lstrip("/")) for group in (own, *own.parents)]
    return min((left for left in found if left is not None), default=None)


def _left_of(group: Path) -> int | None:
    with contextlib.suppress(OSError, ValueError):
        limit, used = (int((group / name).read_text()) for name in ("memory.max", "memory.current"))
        with contextlib.suppress(OSError, ValueError):
            lines = (line.split() for line in (group / "memory.stat").read_text().splitlines())
            used -= sum(int(size) for name, size in lines if name in RECLAIMABLE)
        return min(max(0, limit - used), limit)
    return None
