"""Write marker trajectories as a C3D file in pieces: Intel byte order, 32-bit floats in millimetres.

A frame has four floats for each point: the position, and a residual that is -1 where the point was not seen. Then all
three coordinates are zero. `formats.importers.c3d_parameters` describes the parameter section.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from formats.arrays import Floats
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_header import C3D_KEY
from formats.importers.c3d_parameters import FLOAT, INTEL, SECTION_HEAD, SHORT, TEXT

POINT_BYTES = 16  # of a point in a frame: three coordinates and a residual as floats (C3D user guide)
BYTES_AT_ONCE = 1 << 22  # bytes that are written at once; our choice: bounds memory, and the file is the same
MOST_LABELS_OF_ONE = 255  # labels that one parameter can hold; LABELS2 holds the next (C3D user guide)
MOST_BLOCKS = 255  # of parameters, counted in a byte
MILLIMETRES = 1e3  # in a metre
POINT, ANALOG, FORCE_PLATFORM = 1, 2, 3  # numbers of the groups


def c3d_pieces(labels: Sequence[str], positions: Floats, rate: float) -> Iterable[bytes]:
    """Return the bytes of a C3D file, in pieces.

    - `positions` [m], (frames, points, 3), NaN where not seen; 65534 frames at most
    - `rate` [1/s]

    Raises:
        ValueError: the labels take more bytes than the parameters of a file can hold.
    """
    frames, points = positions.shape[:2]
    blocks = -(-len(_section(labels, frames, rate, 0)) // BLOCK_BYTES)
    if blocks > MOST_BLOCKS:
        raise ValueError(f"the names of its {points} points take more than {BLOCK_BYTES * MOST_BLOCKS} bytes")
    start = 2 + blocks
    words = struct.pack("<BBHHHHHfHHf", 2, C3D_KEY, points, 0, 1, frames, 0, -1.0, start, 1, rate)
    section = _section(labels, frames, rate, start).ljust(BLOCK_BYTES * blocks, b"\0")
    return chain([words.ljust(BLOCK_BYTES, b"\0"), section], _frames(positions))


def _frames(positions: Floats) -> Iterator[bytes]:
    """Yield the frames, filled to whole blocks; `positions` as in `c3d_pieces`."""
    frames, points = positions.shape[:2]
    at_once = max(BYTES_AT_ONCE // max(POINT_BYTES * points, 1), 1)
    for begin in range(0, frames, at_once):
        places = positions[begin : begin + at_once]
        is_seen = np.asarray(np.isfinite(places).all(2))
        values = np.full((*is_seen.shape, 4), -1.0, "<f4")
        values[..., :3] = np.where(is_seen[..., None], MILLIMETRES * places, 0.0)
        values[is_seen, 3] = 0.0
        yield values.tobytes()
    yield bytes(-frames * points * POINT_BYTES % BLOCK_BYTES)


def _section(labels: Sequence[str], frames: int, rate: float, start: int) -> bytes:
    """Return the parameters of a file whose frames begin at block `start`."""
    named = [labels[k : k + MOST_LABELS_OF_ONE] for k in range(0, max(len(labels), 1), MOST_LABELS_OF_ONE)]
    records = [
        _record("POINT", -POINT), _record("ANALOG", -ANALOG), _record("FORCE_PLATFORM", -FORCE_PLATFORM),
        _words("USED", POINT, len(labels)), _floats("SCALE", POINT, -1.0), _floats("RATE", POINT, rate),
        _words("DATA_START", POINT, start), _words("FRAMES", POINT, frames),
        *(_texts(f"LABELS{k + 1 if k else ''}", POINT, some) for k, some in enumerate(named)),
        *(_texts(f"DESCRIPTIONS{k + 1 if k else ''}", POINT, [""] * len(some)) for k, some in enumerate(named)),
        _texts("UNITS", POINT, ["mm"]),
        _words("USED", ANALOG, 0), _floats("GEN_SCALE", ANALOG, 1.0), _floats("RATE", ANALOG, rate),
        _texts("LABELS", ANALOG, []), _texts("UNITS", ANALOG, []), _texts("DESCRIPTIONS", ANALOG, []),
        _record("SCALE", ANALOG, FLOAT, (0,)), _record("OFFSET", ANALOG, SHORT, (0,)),
        _words("USED", FORCE_PLATFORM, 0),
    ]  # fmt: skip
    content = b"".join(records) + bytes(2)
    blocks = -(-(len(content) + SECTION_HEAD) // BLOCK_BYTES)
    return bytes([1, C3D_KEY, min(blocks, MOST_BLOCKS), INTEL]) + content


def _words(name: str, group: int, number: int) -> bytes:
    return _record(name, group, SHORT, (), struct.pack("<H", number))


def _floats(name: str, group: int, number: float) -> bytes:
    return _record(name, group, FLOAT, (), struct.pack("<f", number))


def _texts(name: str, group: int, texts: Sequence[str]) -> bytes:
    raw = [text.encode() for text in texts]
    width = max(map(len, raw), default=0)
    return _record(name, group, TEXT, (width, len(raw)), b"".join(text.ljust(width) for text in raw))


def _record(name: str, group: int, kind: int = 0, sides: tuple[int, ...] = (), data: bytes = b"") -> bytes:
    """Return a group, whose number is negative, or a parameter; neither has a description."""
    body = b"" if group < 0 else struct.pack("<bB", kind, len(sides)) + bytes(sides) + data
    return struct.pack("<bb", len(name), group) + name.encode() + struct.pack("<H", len(body) + 3) + body + b"\0"
