"""Renaming of a damaged index of compiled kernels, and removal of a stale lock."""

from __future__ import annotations

import contextlib
import stat
import time
from pathlib import Path

from fit.kernel_cache.index import INDEX, LARGEST_INDEX, TAICHI_LOCK, sizes_of_kernels
from fit.kernel_cache.notes import NOTED, hash_of, noted_hashes
from fit.kernel_cache.writers import remove_abandoned_lock
from formats.plain_text import plain

# s; our choice: Taichi holds its lock for milliseconds, and other processes give up after 0.2 s. So the lock of a
# process that still writes stays, even on a disk that is 1000 times as slow. Until then each process compiles every
# kernel again. This holds for locks that a living process may hold. Half and double were not tried.
STALE_LOCK = 60.0
# s; our choice: a thousand times what Taichi needs. Younger locks are those of processes at work. Half and double were
# not tried.
TOLD_LOCK = 5.0
# s; our choice: another process may be writing the index. In all this is less than the 0.2 s that Taichi itself waits.
REREADING = (0.05, 0.1, 0.0)


def mend_cache(folder: Path) -> None:
    """Rename a damaged index of compiled kernels, and remove the stale lock of a killed process.

    Taichi 1.7.4 trusts its index: a damaged one ends the process, or requests more memory than exists. Another kernel's
    file under a kernel's name ends the process, or computes something else. With a stale lock, or without a file of the
    index, every process compiles again. The damaged index becomes `ticache.tcb.damaged`, and Taichi writes all anew.
    So does an index of which a file differs from what `note_kernels` noted. A lock that no living process can hold
    goes at once (`remove_abandoned_lock`).

    Raises:
        OSError: a file cannot be read, renamed or removed.
    """
    index, lock = folder / INDEX, folder / TAICHI_LOCK
    remove_abandoned_lock(folder)
    with contextlib.suppress(FileNotFoundError):
        age = abs(time.time() - lock.stat().st_mtime)  # the clock may have been put back since
        if age > STALE_LOCK:
            lock.unlink()
        elif age > TOLD_LOCK:
            from formats.terminal import say  # a result does not depend on the modules of the terminal

            say(
                f"Another program seems to write compiled kernels, and has locked them for {age:.0f} s. So this one "
                f"compiles its own anew. If no other Hangtime runs, remove {plain(lock)}."
            )
    for patience in REREADING:
        try:
            if lock.exists() or _is_sound_cache(index):
                return
        except FileNotFoundError:
            return
        time.sleep(patience)
    with contextlib.suppress(FileNotFoundError):
        (folder / NOTED).unlink(missing_ok=True)
        for kernel in folder.glob("*.tic"):
            if not kernel.is_file():  # Taichi would write into a pipe for ever, and end for a folder or a dead link
                kernel.rename(kernel.with_name(kernel.name + ".damaged"))
        index.rename(index.with_name(INDEX + ".damaged"))


def _is_sound_cache(index: Path) -> bool:
    """Return whether an index is undamaged, and the file of each kernel is as long as stated and as noted."""
    state = index.stat()
    if not stat.S_ISREG(state.st_mode) or state.st_size > LARGEST_INDEX:
        return False
    sizes = sizes_of_kernels(index.read_bytes())
    if sizes is None:
        return False
    noted = noted_hashes(index.parent)
    try:
        for name, size in sizes.items():
            kernel = index.parent / f"{name}.tic"
            if (
                not kernel.is_file()
                or kernel.stat().st_size != size
                or (name in noted and hash_of(kernel) != noted[name])
            ):
                return False
        return True
    except FileNotFoundError:
        return False
