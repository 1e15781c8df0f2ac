"""Load the arrays that an importer needs from an `.npz` archive, and refuse other files."""

from __future__ import annotations

import os
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from formats.errors import TakeError
from formats.plain_text import sized
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

BEGINNING = b"PK\x03\x04"  # first bytes of a zip archive (APPNOTE.TXT, 4.3.7)
# Bytes that may unpack from any file: half of what the reader of takes may use beyond a file's share.
FREELY_UNPACKED = 1 << 27
RATIO = 50  # unpacked to packed bytes beyond; our choice: 2 mm of noise pack 1.1 times, and a bomb of zeros 1000 times


def load_arrays(path: Path, names: Collection[str], *, most_bytes: int, advice: str) -> dict[str, NDArray[Any]]:
    """Return the named arrays of an archive; other arrays are not read.

    - `most_bytes`: limit for these arrays together as 64-bit numbers, to which an import converts them
    - `advice`: the next step in the error about an unsuitable file

    Raises:
        TakeError: the file is missing, is no such archive, lacks an array, or its arrays are too large.
    """
    try:
        check_ends(path)
        with path.open("rb") as file:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                if file.read(len(BEGINNING)) == BEGINNING:
                    raise TakeError("is cut off: its archive has no end", where=path, advice="copy or export it again")
                raise TakeError(
                    "is empty" if not path.stat().st_size else "is no .npz archive", where=path, advice=advice
                )
            _refuse_a_bomb(file, path, names, most_bytes)
            file.seek(0)
            archive = np.load(file, allow_pickle=False)
            absent = [name for name in names if name not in archive]
            if absent:
                raise TakeError(f"has no array {absent[0]!r}", where=path, advice=advice)
            found = {name: archive[name] for name in names}
            if any(not isinstance(one, np.ndarray) for one in found.values()):  # bytes, where no array begins
                raise ValueError
        _refuse_too_many(8 * sum(array.size for array in found.values()), path, most_bytes)
        return found
    except OSError as error:
        raise TakeError(
            f"cannot be read ({error.strerror or error})", where=path, advice=step_to_read(error)
        ) from error
    except (
        ValueError, TypeError, EOFError, RuntimeError, MemoryError, SyntaxError, tokenize.TokenError,
        zipfile.BadZipFile, zlib.error,
    ) as error:  # fmt: skip
        raise TakeError("is an .npz archive that is damaged or holds objects", where=path, advice=advice) from error


def _refuse_a_bomb(file: BinaryIO, path: Path, names: Collection[str], most_bytes: int) -> None:
    """Refuse a zip bomb: an archive whose unpacked arrays would take far more memory than any recording."""
    with zipfile.ZipFile(file) as archive:
        wanted = [part for part in archive.infolist() if part.filename.removesuffix(".npy") in names]
    size, packed = sum(part.file_size for part in wanted), sum(part.compress_size for part in wanted)
    packed = min(packed, os.fstat(file.fileno()).st_size)  # the archive may state more
    _refuse_too_many(size, path, most_bytes)
    if size > FREELY_UNPACKED + RATIO * packed:
        raise TakeError(
            f"its arrays grow from {sized(packed)} to {sized(size)}, as those of no recording do", where=path,
            advice="export the recording again",
        )  # fmt: skip


def _refuse_too_many(size: int, path: Path, most_bytes: int) -> None:
    """Refuse arrays above the limit of bytes."""
    if size > most_bytes:
        raise TakeError(f"its arrays have {sized(size)}", where=path, advice="import shorter recordings")
