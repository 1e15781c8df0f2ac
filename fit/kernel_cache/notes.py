"""Notes on which compiled kernel has which name, from which exchanged files of one size are detected."""

from __future__ import annotations

import math
import os
from pathlib import Path

import msgspec

from fit.kernel_cache.index import INDEX, LARGEST_INDEX, TAICHI_LOCK, sizes_of_kernels
from formats.whole_files import read_bounded, write_whole

NOTED = "hangtime-kernels.json"  # this program's own file in Taichi's cache, see `note_kernels`
HASH = 64  # letters of the SHA-256 with which Taichi ends the file of a kernel


def note_kernels(folder: Path, since: float = math.inf) -> None:
    """Note which compiled kernel has which name, so that `mend_cache` finds exchanged files of one size.

    Taichi checks each file by the hash at the end of the file, and never whether the file is that of the name.

    since [s since 1970]: files changed after this time are noted anew; other files only where they are not noted yet

    Raises:
        OSError: a file cannot be read or written.
    """
    if (folder / TAICHI_LOCK).exists() or not (folder / INDEX).is_file():
        return
    before, now = noted_hashes(folder), {}
    for name in sizes_of_kernels(read_bounded(folder / INDEX, LARGEST_INDEX)) or {}:
        file = folder / f"{name}.tic"
        if file.is_file():
            is_known = name in before and file.stat().st_mtime < since
            now[name] = before[name] if is_known else hash_of(file)
    if now != before:
        write_whole(folder / NOTED, msgspec.json.encode(now))


def noted_hashes(folder: Path) -> dict[str, str]:
    """Return the noted hashes of kernels by name; a damaged note holds none.

    A note holds 135 bytes for each kernel, fewer than the index does, and so has the limit of the index.
    """
    file = folder / NOTED
    try:
        if not file.is_file() or file.stat().st_size > LARGEST_INDEX:
            return {}
        return msgspec.json.decode(file.read_bytes(), type=dict[str, str])
    except (msgspec.MsgspecError, FileNotFoundError):
        return {}


def hash_of(kernel: Path) -> str:
    """Return the letters at the end of a kernel's file, which are the hash that Taichi writes."""
    with kernel.open("rb") as file:
        file.seek(-min(HASH, kernel.stat().st_size), os.SEEK_END)
        return file.read(HASH).decode("latin-1")
