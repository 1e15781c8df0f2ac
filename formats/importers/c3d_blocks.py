"""Detect bytes that a C3D file has lost, by its size and by blocks of zeros or of stale bytes that a faulty copy left.

A C3D file consists of blocks of 512 bytes. Most programs fill the last block, others end with the last frame. Bytes
lost within the frames shift everything behind them. In a filled last block, up to 511 bytes can be lost before a frame
is.

A stale block repeats the bytes of an earlier block. Markers at rest, a periodic motion and a frame written twice also
repeat bytes, but after a whole number of frames. So a block is surely stale where its bytes repeat once, after another
number of bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.errors import TakeError
from formats.plain_text import counted

BLOCK_BYTES = 512  # bytes; C3D user guide
BLOCKS_AT_ONCE = 1 << 12  # blocks read at once; our choice: 2 MB, and no result depends on it
MOST_RUNS = 3  # of zero blocks; our choice: more are gaps for which a program writes zeros


def refuse_lost_bytes(path: Path, size: int, end: int) -> None:
    """Refuse a file that ends neither with its last frame nor at a multiple of the block size.

    `size` [bytes]: of the file; `end` [bytes]: offset at which its frames end

    Raises:
        TakeError: names both.
    """
    if size % BLOCK_BYTES and end < size < end + BLOCK_BYTES:
        raise TakeError(
            f"has {size} bytes, which is no multiple of {BLOCK_BYTES}, and its frames end at {end}: bytes are lost or "
            "foreign", where=path, advice="copy or export it again",
        )  # fmt: skip


@dataclass(frozen=True)
class Blocks:
    """Indices of suspicious blocks, counted from the beginning of the frames.

    - `of_zeros`: blocks of zero bytes, (blocks,); `between`: the zero blocks between other blocks
    - `stale`: blocks that repeat an earlier one
    """

    of_zeros: Integers
    between: Integers
    stale: Integers


def find_blocks(path: Path, begin: int, size: int, width: int) -> Blocks:
    """Return the zero and stale blocks, which a faulty copy may have left.

    - `begin`, `size` [bytes]: offset and size of all frames in the file; `width` [bytes]: of a frame
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
    twice = np.flatnonzero((counts[kinds] == 2) & ~is_zero)  # more repeats are intended by the program
    earlier, stale = twice[np.argsort(kinds[twice], kind="stable")].reshape(-1, 2).T
    by_other_bytes = (stale - earlier) * BLOCK_BYTES % width != 0
    return Blocks(of_zeros, of_zeros[is_between], np.sort(stale[by_other_bytes]))


def remove_blocks(positions: Floats, blocks: Blocks, kind: int, width: int, others: Integers) -> str:
    """Mark as not seen the markers whose numbers lie in zero or stale blocks; return a warning of them.

    Zero blocks at either end, or in many places, are gaps that a program wrote, and cause no warning.

    - `positions` [m], (frames, points, 3), NaN where not seen
    - `kind` [bytes]: of a number; `width` [bytes]: of a frame
    - `others`: indices of unused points; blocks that lie only in them, or behind the frames, cause no warning
    """
    is_looked_at = ~np.isin(np.arange(positions.shape[1]), others)
    stale = [
        block for block in blocks.stale.tolist()
        if any(np.isfinite(positions[span]).any() for span in _spans(positions, block, kind, width))
    ]  # fmt: skip
    warnings = list[str]()
    for numbers, what in ((blocks.between.tolist(), "zero bytes"), (stale, "bytes of earlier frames")):
        touched, count = _touched(is_looked_at, positions, numbers, kind, width)
        was_seen = bool(np.isfinite(positions[touched]).any())
        positions[touched] = np.nan
        frames = np.flatnonzero(touched.any(1))
        if not len(frames) or (_runs(numbers) > MOST_RUNS and not was_seen):
            continue
        first, last = int(frames[0]) + 1, int(frames[-1]) + 1
        which = f"frame {first} holds" if first == last else f"frames {first} to {last} hold"
        hold = f"{counted(count, 'block')} of {BLOCK_BYTES} {what}"
        warnings.append(f"{which} {hold}, and markers in them count as not seen")
    touched, _ = _touched(is_looked_at, positions, blocks.of_zeros.tolist(), kind, width)
    positions[touched] = np.nan
    return "; ".join(warnings)


def _runs(blocks: list[int]) -> int:
    """Return the number of runs of consecutive blocks."""
    return int((np.diff(blocks) > 1).sum()) + 1


def _touched(
    is_looked_at: Booleans, positions: Floats, blocks: list[int], kind: int, width: int
) -> tuple[Booleans, int]:
    """Return which positions have a number in the blocks, (frames, points), and how many blocks hold one.

    is_looked_at: whether a point is used, (points,)
    """
    touched, count = np.zeros(positions.shape[:2], bool), 0
    for block in blocks:
        spans = list(_spans(positions, block, kind, width))
        for frame, points in spans:
            touched[frame, points] |= is_looked_at[points]
        count += any(is_looked_at[points].any() for _, points in spans)
    return touched, count


def _spans(positions: Floats, block: int, kind: int, width: int) -> Iterator[tuple[int, slice]]:
    """Yield each frame that has numbers in a block, and the slice of points with a position in that block."""
    first, behind, numbers = block * BLOCK_BYTES // kind, (block + 1) * BLOCK_BYTES // kind, width // kind
    for frame in range(first // numbers, min((behind - 1) // numbers + 1, len(positions))):
        begin, end = max(first - frame * numbers, 0), min(behind - frame * numbers, numbers)
        yield frame, slice((begin + 1) // 4, -(-end // 4))  # a point's fourth number is no coordinate
