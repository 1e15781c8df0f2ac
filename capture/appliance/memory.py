"""Return memory that only the program's start needed to the operating system.

Loading Python and its libraries reads far more pages of their files than a waiting recorder needs. The
kernel counts every page that a process has read: about 20 MB of code after loading. The heap keeps freed memory of
the start as well. Both are released once the modules are loaded, and again when the sensor is open.

An unmodified page of a read-only mapping can be dropped at any time. The next read loads the
page from the file again (`man 2 madvise`, MADV_DONTNEED on a private mapping).

A thread that loads a library maps the whole library first and writes its data later. Hence a mapping is dropped
only if two checks, half a second apart, find the same mapping without a private page.
"""

from __future__ import annotations

import ctypes
import re
from contextlib import suppress
from pathlib import Path

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8  # `man 3 mallopt`
MADV_DONTNEED = 4  # `man 2 madvise`
PICTURE = 256 * 1024  # bytes; larger pieces of memory go back to the system when they are freed
LOOKS_APART = 0.5  # s; a library is mapped within milliseconds, before any of its pages is read
SMAPS, THREADS = Path("/proc/self/smaps"), Path("/proc/self/task")
# `man 5 proc_pid_maps`: from, to, rights, offset in the file, device, inode, path
MAPPING = re.compile(rb"^([0-9a-f]+)-([0-9a-f]+) (\S{4}) [0-9a-f]+ \S+ ([0-9]+) +(/.*)$")
ITS_OWN = re.compile(rb"^Anonymous: +([0-9]+) kB$")


def share_one_heap() -> None:
    """Set malloc to return freed images to the system and to share one heap among threads: less fragmentation."""
    with suppress(OSError, AttributeError):  # another C library
        library = ctypes.CDLL(None)
        library.mallopt(M_ARENA_MAX, 1)
        library.mallopt(M_MMAP_THRESHOLD, PICTURE)


def unwritten_mappings(smaps: bytes) -> set[tuple[int, int]]:
    """Return begin and end of the read-only mappings of files that hold no private page.

    smaps: content of /proc/PID/smaps
    """
    found: set[tuple[int, int]] = set()
    mapping: tuple[int, int] | None = None
    for line in smaps.splitlines():
        if head := MAPPING.match(line):
            is_fixed = head[3][:1] == b"r" and head[3][1:2] == b"-" and head[3][3:] == b"p" and int(head[4]) != 0
            mapping = (int(head[1], 16), int(head[2], 16)) if is_fixed else None
        elif b"-" in line.partition(b" ")[0]:  # a mapping of no file
            mapping = None
        elif mapping is not None and (own := ITS_OWN.match(line)) and int(own[1]) == 0:
            found.add(mapping)
    return found


class StartingMemory:
    """Releases the memory of the start; the loop calls `let_go` in every iteration."""

    def __init__(self) -> None:
        """Release the pages that loading left; one check suffices while no other thread runs."""
        self._seen = _look()
        if len(list(THREADS.glob("*"))) == 1:
            _drop(self._seen)
        self._looked_at: float | None = None
        self._was_started = False
        self.is_over = False

    def let_go(self, now: float, *, is_started: bool) -> None:
        """Check twice a second and drop mappings that two checks found, until the second check after the start.

        now [s]: monotonic; is_started: whether the recorder waits for the hanger
        """
        if self._looked_at is None:
            self._looked_at = now
        if self.is_over or now - self._looked_at < LOOKS_APART:
            return
        seen = _look()
        _drop(seen & self._seen)
        self._seen, self._looked_at = seen, now
        self.is_over, self._was_started = self._was_started, is_started


def _look() -> set[tuple[int, int]]:
    try:
        return unwritten_mappings(SMAPS.read_bytes())
    except OSError:  # a kernel without it, or it may not be read
        return set()


def _drop(mappings: set[tuple[int, int]]) -> None:
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.malloc_trim(0)
        library.madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
        for begin, end in mappings:
            library.madvise(begin, end - begin, MADV_DONTNEED)
