"""Find bytes that a C3D file has lost: by its size, and by blocks of zeros that a copy left in their place.

A C3D file is made of blocks of 512 bytes. Most programs fill the last one, and others end with the last frame. Bytes
that are lost within the frames shift all behind them. Of a filled block up to 511 bytes can be lost before a frame is.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.arrays import Floats, Integers
from formats.errors import TakeError
from formats.plain_text import counted

BLOCK_BYTES = 512  # bytes
BLOCKS_AT_ONCE = 1 << 12  # of which the bytes are looked at
MOST_RUNS = 3  # of blocks, stated by us: more are the gaps of a program that writes zeros for them


def refuse_lost_bytes(path: Path, size: int, end: int) -> None:
    """Refuse a file that ends neither with its last frame nor with a block.

    `size` [bytes]: of the file; `end` [bytes]: where its frames end

    Raises:
        TakeError: names both.
    """
    if size % BLOCK_BYTES and end < size < end + BLOCK_BYTES:
        raise TakeError(
            f"has {size} bytes, which is no multiple of {BLOCK_BYTES}, and its frames end at {end}: bytes are lost",
            where=path, advice="copy or export it again",
        )  # fmt: skip


def zero_blocks(path: Path, begin: int, size: int) -> Integers:
    """Return the numbers of blocks of zeros between others, (blocks,), counted from where the frames begin.

    `begin`, `size` [bytes]: of all frames in the file
    """
    is_zero = [np.zeros(0, bool)]
    with path.open("rb") as file:
        file.seek(begin)
        for at in range(0, size, BLOCKS_AT_ONCE * BLOCK_BYTES):
            raw = file.read(min(size - at, BLOCKS_AT_ONCE * BLOCK_BYTES))
            raw += bytes(-len(raw) % BLOCK_BYTES)
            is_zero.append(np.asarray(~np.frombuffer(raw, np.uint64).reshape(-1, BLOCK_BYTES // 8).any(1)))
    whole = np.concatenate(is_zero)
    others, found = np.flatnonzero(~whole), np.flatnonzero(whole)
    return np.asarray(found[(found > others.min(initial=len(whole))) & (found < others.max(initial=-1))])


def take_out_zero_blocks(places: Floats, blocks: Integers, kind: int, width: int, others: Integers) -> str:
    """Take out the markers whose numbers lie in blocks of zeros; return a sentence on them, '' without any.

    - `places` [m], (frames, points, 3), NaN where not seen
    - `blocks`: their numbers, (blocks,); `kind` [bytes]: of a number; `width` [bytes]: of a frame
    - `others`: points that nobody looks at; blocks in them alone, and behind the frames, are not told
    """
    touched = np.zeros(places.shape[:2], bool)
    is_other = np.isin(np.arange(places.shape[1]), others)
    numbers, count = width // kind, 0
    for block in blocks.tolist():
        first, behind = block * BLOCK_BYTES // kind, (block + 1) * BLOCK_BYTES // kind
        is_told = False
        for frame in range(first // numbers, min((behind - 1) // numbers + 1, len(places))):
            begin, end = max(first - frame * numbers, 0), min(behind - frame * numbers, numbers)
            points = slice((begin + 1) // 4, -(-end // 4))  # a point's fourth number is no place
            touched[frame, points] = ~is_other[points]
            is_told |= bool(touched[frame, points].any())
        count += is_told
    was_seen = bool(np.isfinite(places[touched]).any())
    places[touched] = np.nan
    runs = int((np.diff(blocks) > 1).sum()) + 1
    frames = np.flatnonzero(touched.any(1))
    if not len(frames) or (runs > MOST_RUNS and not was_seen):
        return ""
    first, last = int(frames[0]) + 1, int(frames[-1]) + 1
    which = f"frame {first} holds" if first == last else f"frames {first} to {last} hold"
    return f"{which} {counted(count, 'block')} of {BLOCK_BYTES} zero bytes, and markers in them count as not seen"
