"""Find bytes that a C3D file has lost: by its size, and by blocks that a copy left in their place, of zeros or stale.

A C3D file is made of blocks of 512 bytes. Most programs fill the last one, and others end with the last frame. Bytes
that are lost within the frames shift all behind them. Of a filled block up to 511 bytes can be lost before a frame is.

A stale block holds the bytes of an earlier one. Markers at rest, a motion that recurs and a frame that is written twice
repeat theirs a whole number of frames later. So a block is surely stale that does so once, by another number of bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats, Integers
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


@dataclass(frozen=True)
class Blocks:
    """Numbers of blocks, counted from where the frames begin.

    - `of_zeros`: all of them, (blocks,); `between`: those of them between others
    - `stale`: repeat earlier ones
    """

    of_zeros: Integers
    between: Integers
    stale: Integers


def find_blocks(path: Path, begin: int, size: int, width: int) -> Blocks:
    """Return the blocks that a copy may have left.

    - `begin`, `size` [bytes]: of all frames in the file; `width` [bytes]: of a frame
    """
    factors = np.random.default_rng(0).integers(1, 1 << 63, BLOCK_BYTES // 8, dtype=np.uint64) | np.uint64(1)
    zeros, found_sums = [np.zeros(0, bool)], [np.zeros(0, np.uint64)]
    with path.open("rb") as file:
        file.seek(begin)
        for at in range(0, size, BLOCKS_AT_ONCE * BLOCK_BYTES):
            raw = file.read(min(size - at, BLOCKS_AT_ONCE * BLOCK_BYTES))
            raw += bytes(-len(raw) % BLOCK_BYTES)
            words = np.frombuffer(raw, np.uint64).reshape(-1, BLOCK_BYTES // 8)
            zeros.append(np.asarray(~words.any(1)))
            found_sums.append((words * factors).sum(1))
    is_zero, sums = np.concatenate(zeros), np.concatenate(found_sums)
    others, of_zeros = np.flatnonzero(~is_zero), np.flatnonzero(is_zero)
    is_between = (of_zeros > others.min(initial=len(is_zero))) & (of_zeros < others.max(initial=-1))
    _, kinds, counts = np.unique(sums, return_inverse=True, return_counts=True)
    twice = np.flatnonzero((counts[kinds] == 2) & ~is_zero)  # more are a habit
    earlier, stale = twice[np.argsort(kinds[twice], kind="stable")].reshape(-1, 2).T
    by_other_bytes = (stale - earlier) * BLOCK_BYTES % width != 0
    return Blocks(of_zeros, of_zeros[is_between], np.sort(stale[by_other_bytes]))


def take_out_blocks(places: Floats, blocks: Blocks, kind: int, width: int, others: Integers) -> str:
    """Take out the markers whose numbers lie in blocks of zeros or stale ones; return a sentence on them.

    Zeros at either end and in many places are the gaps of a program, of which nothing is told.

    - `places` [m], (frames, points, 3), NaN where not seen
    - `kind` [bytes]: of a number; `width` [bytes]: of a frame
    - `others`: points that nobody looks at; blocks in them alone, and behind the frames, are not told
    """
    is_looked_at = ~np.isin(np.arange(places.shape[1]), others)
    stale = [
        block for block in blocks.stale.tolist()
        if any(np.isfinite(places[span]).any() for span in _spans(places, block, kind, width))
    ]  # fmt: skip
    told = list[str]()
    for numbers, what in ((blocks.between.tolist(), "zero bytes"), (stale, "bytes of earlier frames")):
        touched, count = _touched(is_looked_at, places, numbers, kind, width)
        was_seen = bool(np.isfinite(places[touched]).any())
        places[touched] = np.nan
        frames = np.flatnonzero(touched.any(1))
        if not len(frames) or (_runs(numbers) > MOST_RUNS and not was_seen):
            continue
        first, last = int(frames[0]) + 1, int(frames[-1]) + 1
        which = f"frame {first} holds" if first == last else f"frames {first} to {last} hold"
        hold = f"{counted(count, 'block')} of {BLOCK_BYTES} {what}"
        told.append(f"{which} {hold}, and markers in them count as not seen")
    touched, _ = _touched(is_looked_at, places, blocks.of_zeros.tolist(), kind, width)
    places[touched] = np.nan
    return "; ".join(told)


def _runs(blocks: list[int]) -> int:
    """Return how many times some of the blocks follow each other."""
    return int((np.diff(blocks) > 1).sum()) + 1


def _touched(is_looked_at: Booleans, places: Floats, blocks: list[int], kind: int, width: int) -> tuple[Booleans, int]:
    """Return which places have a number in some blocks, (frames, points), and how many blocks hold one.

    is_looked_at: points that count, (points,)
    """
    touched, count = np.zeros(places.shape[:2], bool), 0
    for block in blocks:
        spans = list(_spans(places, block, kind, width))
        for frame, points in spans:
            touched[frame, points] |= is_looked_at[points]
        count += any(is_looked_at[points].any() for _, points in spans)
    return touched, count


def _spans(places: Floats, block: int, kind: int, width: int) -> Iterator[tuple[int, slice]]:
    """Yield each frame that has numbers in a block, and its points of which places are in there."""
    first, behind, numbers = block * BLOCK_BYTES // kind, (block + 1) * BLOCK_BYTES // kind, width // kind
    for frame in range(first // numbers, min((behind - 1) // numbers + 1, len(places))):
        begin, end = max(first - frame * numbers, 0), min(behind - frame * numbers, numbers)
        yield frame, slice((begin + 1) // 4, -(-end // 4))  # a point's fourth number is no place
