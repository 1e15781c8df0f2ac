"""Choice of the folder of compiled kernels: Taichi's own, mended, or a temporary one."""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fit.errors import FitError
from fit.kernel_cache.mending import mend_cache
from fit.kernel_cache.notes import note_kernels
from fit.kernel_cache.writers import CACHE, claim_writing, open_writers


def mended_cache(ti: Any) -> dict[str, str]:
    """Return a temporary kernel cache for `ti.init` if its own cannot be written, which would end the process."""
    own = Path(os.environ.get(CACHE) or ti.lang.impl.default_cfg().offline_cache_file_path)
    try:
        own.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=own):
            mend_cache(own)
            with contextlib.suppress(OSError):  # on a full disk, or of another user: the cache works without it
                note_kernels(own)
            atexit.register(_note_own_kernels, ti, own, time.time(), open_writers(own))
            return {}
    except OSError:
        os.environ.pop(CACHE, None)  # Taichi would warn that it is overridden
    try:
        folder = tempfile.mkdtemp(prefix="hangtime-kernels-")
    except OSError as error:
        raise FitError(
            f"compiled kernels cannot be kept ({error.strerror})", where=own,
            advice="set TMPDIR to a folder that can be written",
        ) from error  # fmt: skip

    def forget() -> None:
        ti.reset()  # it writes, and must find the folder
        shutil.rmtree(folder, ignore_errors=True)

    atexit.register(forget)
    return {"offline_cache_file_path": folder}


class _Work:
    is_counted = False  # whether this process simulates within `at_work` alone
    running = 0


@contextlib.contextmanager
def at_work() -> Iterator[None]:
    """Context of every simulation of a worker, whose other threads then never simulate.

    So a worker notes its kernels at its end, in spite of the threads in which it talks to its scheduler.
    """
    _Work.is_counted = True
    _Work.running += 1
    try:
        yield
    finally:
        _Work.running -= 1


def _note_own_kernels(ti: Any, folder: Path, since: float, writers: int | None = None) -> None:
    """Note the kernels of this process at its end; with other threads, which may simulate, the next process does.

    writers: the descriptor of `open_writers`, by which this process claims that it may be writing until it has ended
    """
    claim_writing(writers)
    if _Work.running or (not _Work.is_counted and threading.active_count() > 1):
        return
    ti.reset()  # it writes the kernels
    with contextlib.suppress(OSError):
        note_kernels(folder, since)
