"""Load the arrays that an importer needs from an `.npz` archive, and refuse other files."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from formats.errors import TakeError
from formats.importers.foreign_files import DOWNLOADED, refuse_foreign
from formats.plain_text import counted, sized
from formats.system_causes import step_to_read
from formats.whole_files import check_ends
from formats.zip_members import members_of

BEGINNING = b"PK\x03\x04"  # first bytes of a zip archive (APPNOTE.TXT, 4.3.7)
END_RECORD = b"PK\x05\x06"  # first bytes of the record at the end of a zip archive (APPNOTE.TXT, 4.3.16)
AT_END = struct.Struct("<4s4H2LH")  # of that record: signature, disks, members; list's bytes and offset; comment
SEARCHED = 1 << 24  # bytes of a file's end in which an archive's end is sought; our choice: 16 MiB are read at once
# Bytes that may unpack from any file: half of what the reader of takes may use beyond a file's share.
FREELY_UNPACKED = 1 << 27
RATIO = 50  # unpacked to packed bytes beyond; our choice: 2 mm of noise pack 1.1 times, and a bomb of zeros 1000 times

# Kinds of arrays by numpy's letters, in words.
KINDS = {"b": "true and false", "U": "text", "S": "text", "c": "complex numbers", "M": "dates", "m": "times of day"}


def kind_of(array: NDArray[Any]) -> str:
    """Return what an array holds, in words."""
    return "numbers" if array.dtype.kind in "iuf" else KINDS.get(array.dtype.kind, "records")


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
                    raise TakeError(_without_end(file), where=path, advice="copy or export it again")
                refuse_foreign(path, DOWNLOADED)
                raise TakeError(
                    "is empty" if not path.stat().st_size else "is no .npz archive", where=path, advice=advice
                )
            _check_members(file, path, names, most_bytes)
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


def _without_end(file: BinaryIO) -> str:
    """Return what is known of an archive without an end in its last bytes, where Python looks for one."""
    size = os.fstat(file.fileno()).st_size
    begin = max(size - SEARCHED, 0)
    file.seek(begin)
    raw = file.read(SEARCHED)
    at = raw.rfind(END_RECORD)
    while at >= 0:
        if at + AT_END.size <= len(raw):
            *_, bytes_of_list, list_at, bytes_of_comment = AT_END.unpack_from(raw, at)
            behind = size - (begin + at + AT_END.size + bytes_of_comment)
            if list_at + bytes_of_list == begin + at and behind > 0:
                return f"{counted(behind, 'byte')} follow the end of its archive"
        at = raw.rfind(END_RECORD, 0, at)
    return "no end of its archive was found: it is cut off, or damaged at its end"


def _check_members(file: BinaryIO, path: Path, names: Collection[str], most_bytes: int) -> None:
    """Refuse an archive that holds a needed array twice, and a zip bomb.

    The unpacked arrays of a zip bomb would take far more memory than any recording.
    """
    wanted = [part for part in members_of(file) if part.filename.removesuffix(".npy") in names]
    name, count = next(iter(Counter(part.filename.removesuffix(".npy") for part in wanted).most_common(1)), ("", 0))
    if count > 1:
        raise TakeError(
            f"holds the array {name!r} {count} times, and which of them counts is unknown", where=path,
            advice="export it again",
        )  # fmt: skip
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
