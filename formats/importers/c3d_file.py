"""Marker paths of C3D files (https://www.c3d.org), of Intel, DEC and SGI byte order.

ezc3d (https://github.com/pyomeca/ezc3d) reads them, in a process of its own: damaged files make it crash. A point with
a negative residual was not seen. The header tells the file's least length, which ezc3d does not check. Words of the
header, counted from 1:

- 2 and 3: numbers of points and of analogue values a frame
- 4 and 5: first and last frame
- 7 and 8: scale, negative where the data are floats
- 9: block of 512 bytes at which the data begin
- 11 and 12: frame rate, a float
"""

from __future__ import annotations

import importlib.util
import io
import os
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.c3d_process import REFUSED
from formats.importers.marker_tracks import MarkerTracks, as_seen
from formats.importers.units import metres_of

BLOCK_BYTES = 512  # bytes
C3D_KEY = 0x50  # second byte of every C3D file
INTEL, DEC, SGI = 84, 85, 86
LARGEST_C3D = 1 << 30  # bytes
LONGEST_RATE = 10_000.0  # frames a second
MOST_FRAMES = 65535  # that the header can state


def read_c3d(path: Path, unit: str | None) -> MarkerTracks:
    """Read the marker paths of a C3D file; unit: where it states none.

    Raises:
        TakeError: the file is malformed, shorter than its header says, or holds no marker paths; ezc3d is not
            installed.
    """
    size = path.stat().st_size
    if size > LARGEST_C3D:
        raise TakeError(f"has {size / 1e9:.1f} GB, which no C3D file has", where=path, advice="check the path")
    header = _refuse_a_short_file(path, size)
    content = _read_apart(path, size, header.processor)
    labels = [str(label) for label in content["labels"]]
    positions, rate = content["positions"], float(content["rate"])
    points = positions.shape[1]
    if not points or not len(positions):
        raise TakeError(
            f"has no marker paths ({points} points, {len(positions)} frames)", where=path,
            advice="export trajectories, not only analogue data",
        )  # fmt: skip
    if not 0 < rate <= LONGEST_RATE:
        raise TakeError(f"states {rate:g} frames a second", where=path, advice="export it again with its frame rate")
    _refuse_a_long_file(len(positions), int(content["stated"]), header, path)
    # Labels beyond the points name nothing; points beyond the labels have no name.
    labels = [*labels[:points], *(f"unlabelled_{k}" for k in range(len(labels), points))]
    scale = _scale(content["units"].tolist(), points, unit, path)
    positions = as_seen(positions * scale[:, None], content["residuals"] < 0)
    time = np.asarray(np.arange(len(positions)) / rate, float)
    return MarkerTracks(tuple(labels), time, positions, header.rate)


def _scale(units: list[str], points: int, unit: str | None, path: Path) -> Floats:
    """Return metres of each point's unit: a file has one for all, one for each point, or none."""
    stated = [word for word in units if word]
    if len(set(stated)) > 1 and len(units) >= points:
        return np.array([metres_of(word, unit, path) for word in units[:points]])
    return np.full(points, metres_of(stated[0] if stated else "", unit, path))


@dataclass(frozen=True)
class _Header:
    """The processor's number; frames that the file has room for; rate [1/s], None where the header states none.

    is_at_its_most: whether the header counts as many frames as it can
    """

    processor: int
    held: int
    is_at_its_most: bool
    rate: float | None


def _refuse_a_short_file(path: Path, size: int) -> _Header:
    """Refuse a file that ends before the last frame that its header states; return what its header says."""
    with path.open("rb") as file:
        head = file.read(BLOCK_BYTES)
        if len(head) < BLOCK_BYTES or head[1] != C3D_KEY or not head[0]:
            raise TakeError("is no C3D file that can be read (its first block is none)", where=path,
                            advice="export it again")  # fmt: skip
        file.seek(BLOCK_BYTES * (head[0] - 1) + 3)
        processor = (file.read(1) or b"\0")[0]
    order = ">" if processor == SGI else "<"
    points, analogue, first, last = struct.unpack_from(f"{order}HHHH", head, 2)
    start = struct.unpack_from(f"{order}H", head, 16)[0]
    # The sign: the first byte of a big-endian float, the last of a little-endian one, the second of DEC's.
    is_float = bool(head[12 + {SGI: 0, DEC: 1}.get(processor, 3)] & 0x80)
    width = (4 * points + analogue) * (4 if is_float else 2)
    frames = last - first + 1
    held = (size - BLOCK_BYTES * (start - 1)) // width if width and start > 1 else 0
    if width and frames > 0 and start > 1 and held < frames and last < MOST_FRAMES:
        raise _cut_off(max(held, 0), frames, "its header states", path)
    if processor == DEC:
        rate = struct.unpack("<f", head[22:24] + head[20:22])[0] / 4
    else:
        rate = struct.unpack_from(f"{order}f", head, 20)[0]
    return _Header(processor, held, last == MOST_FRAMES and first <= 1, rate if 0 < rate < LONGEST_RATE else None)


def _refuse_a_long_file(read: int, stated: int, header: _Header, path: Path) -> None:
    """Refuse a file of as many frames as its header can state, or more, of which some were not read.

    read: frames that were; stated: by the parameters, 0 where they state none
    """
    if not header.is_at_its_most:
        return
    if read < (stated or MOST_FRAMES):
        raise _cut_off(read, stated or MOST_FRAMES, f"its {'parameters state' if stated else 'header states'}", path)
    if header.held > read + BLOCK_BYTES // 8:  # the last block's rest may look like frames, of a 16-bit point each
        raise TakeError(
            f"has room for {header.held} frames and states {read}: its header counts no further", where=path,
            advice="export it in shorter parts, or as text",
        )  # fmt: skip


def _cut_off(found: int, stated: int, what: str, path: Path) -> TakeError:
    return TakeError(
        f"holds {found} of the {stated} frames that {what}", where=path,
        advice="it is cut off: copy or export it again",
    )  # fmt: skip


def _read_apart(path: Path, size: int, processor: int) -> dict[str, NDArray[Any]]:
    """Return what ezc3d finds in a file; it reads it in a process of its own, through a link of an ASCII name."""
    if importlib.util.find_spec("ezc3d") is None:
        raise TakeError(
            "C3D files need ezc3d, which is not installed", where=path,
            advice="in Hangtime's checkout: pip install -e '.[mocap]'",
        )  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="hangtime-") as folder:
        link = Path(folder) / "file.c3d"
        if processor == SGI:  # ezc3d reads the two other byte orders
            link.write_bytes(_in_intel_order(path.read_bytes()))
        else:
            link.symlink_to(path.resolve())
        words = [sys.executable, "-m", "formats.importers.c3d_process", os.fspath(link), str(size)]
        root = os.fspath(Path(__file__).parents[2])
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
        done = subprocess.run(words, capture_output=True, env=environment, check=False)
    if done.returncode == 0:
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
            return dict(archive)
    told = "its content does not hold together" if done.returncode == REFUSED else "the library that reads it crashed"
    raise TakeError(f"is no C3D file that can be read ({told})", where=path, advice="export it again")


def _in_intel_order(raw: bytes) -> bytes:
    """Return a C3D file of SGI byte order with its numbers turned round; what does not hold stays as it is."""
    out = bytearray(raw)

    def turn(begin: int, end: int, width: int) -> None:
        end = begin + (min(end, len(out)) - begin) // width * width
        if 0 <= begin < end:
            part = np.frombuffer(bytes(out[begin:end]), f">u{width}")
            out[begin:end] = part.astype(f"<u{width}").tobytes()

    parameters = BLOCK_BYTES * (raw[0] - 1)
    start, is_float = struct.unpack_from(">H", raw, 16)[0], bool(raw[12] & 0x80)
    for begin, end, width in ((2, 12, 2), (12, 16, 4), (16, 20, 2), (20, 24, 4)):
        turn(begin, end, width)
    out[parameters + 3 : parameters + 4] = bytes([INTEL])
    at = parameters + 4
    while at + 4 < len(raw) and raw[at]:  # each: length of its name, group, name, offset of the next, and its data
        name, group = (
            abs(int.from_bytes(raw[at : at + 1], signed=True)),
            int.from_bytes(raw[at + 1 : at + 2], signed=True),
        )
        offset_at = at + 2 + name
        if offset_at + 4 > len(raw):
            break
        offset = struct.unpack_from(">H", raw, offset_at)[0]
        turn(offset_at, offset_at + 2, 2)
        if group > 0:
            kind, count = int.from_bytes(raw[offset_at + 2 : offset_at + 3], signed=True), raw[offset_at + 3]
            data = offset_at + 4 + count
            size = abs(kind) * int(np.prod([int(side) for side in raw[offset_at + 4 : data]], dtype=object))
            if kind in (2, 4):
                turn(data, min(data + size, len(raw)), kind)
        if not offset:
            break
        at = offset_at + offset
    turn(BLOCK_BYTES * (start - 1), len(out), 4 if is_float else 2)
    return bytes(out)
