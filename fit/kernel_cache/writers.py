"""Whether a living process may be writing compiled kernels, so that the lock of a killed one goes at once."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from pathlib import Path

from fit.kernel_cache.index import TAICHI_LOCK

CACHE = "TI_OFFLINE_CACHE_FILE_PATH"  # Taichi's own variable
WRITERS = "hangtime-writers.lock"  # this program's own file in Taichi's cache, which the system unlocks at a death
TAICHI_LIBRARY = "taichi_python"  # in the memory map of each process that has loaded Taichi
# s; our choice: who removes a lock holds the writers' file for 0.03 ms a process that lives, 2.3 ms for 73 processes.
# In all this is the 0.2 s for which Taichi itself waits.
CLAIMING = (0.05, 0.05, 0.1)


def open_writers(folder: Path) -> int | None:
    """Return a descriptor of the file that shows this process as one that tells when it writes; None without one."""
    try:
        return os.open(folder / WRITERS, os.O_RDWR | os.O_CREAT | os.O_NONBLOCK | os.O_NOFOLLOW, 0o666)
    except OSError:  # on a full disk, or of another user: the cache works without it
        return None


def claim_writing(writers: int | None) -> None:
    """Claim, from now until this process ends in any way, that it may be writing kernels into the folder.

    Taichi writes only while its program ends, and keeps no lock that the system would free: its lock is a plain file.
    """
    if writers is None:
        return
    for patience in (*CLAIMING, 0.0):
        try:
            fcntl.flock(writers, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            time.sleep(patience)
        except OSError:  # a file system without such locks
            return


def remove_abandoned_lock(folder: Path) -> None:
    """Remove Taichi's lock at once where no living process can hold it.

    A process of this program that writes has claimed so. Another program with Taichi and the same choice of folder may
    write at any time. So may another user and, without Linux' list of processes, anybody.

    Raises:
        OSError: the lock cannot be removed.
    """
    lock = folder / TAICHI_LOCK
    if not os.path.lexists(lock) or (writers := open_writers(folder)) is None:
        return
    try:
        fcntl.flock(writers, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # a process claims to write, or the file system has no such locks
        return
    else:
        with contextlib.suppress(FileNotFoundError):
            if lock.lstat().st_uid == os.getuid() and not _another_program_writes(folder):
                lock.unlink()
    finally:
        os.close(writers)


def _another_program_writes(folder: Path) -> bool:
    """Return whether a process of another program with Taichi, and with this folder of kernels, lives."""
    processes = [int(entry.name) for entry in Path("/proc").glob("[0-9]*")]
    if os.getpid() not in processes:
        return True  # unknown
    others = (Path("/proc") / str(process) for process in processes if process != os.getpid())
    return any(_is_another_program(process, folder) for process in others)


def _is_another_program(process: Path, folder: Path) -> bool:
    try:
        if TAICHI_LIBRARY not in (process / "maps").read_text(errors="replace"):
            return False
        for descriptor in (process / "fd").iterdir():
            with contextlib.suppress(FileNotFoundError):
                if os.path.basename(os.readlink(descriptor)) == WRITERS:
                    return False
        stated = dict(entry.partition(b"=")[::2] for entry in (process / "environ").read_bytes().split(b"\0"))
        chosen = os.fsdecode(stated.get(CACHE.encode(), b""))
        if not chosen:
            return not os.environ.get(CACHE)
        return os.path.realpath(process / "cwd" / chosen) == os.path.realpath(folder)
    except OSError:  # it has ended, or belongs to another user, whose lock would be no lock of this user
        return False
