"""Find frames of a C3D file behind the last one that it states.

The rest of the last block may hold such frames, zeros, or bytes that a program's memory held before. A further frame
continues the markers' trajectories p from the stated frames:

    median_j | p_j(n + 1) - 2 p_j(n) + p_j(n - 1) |  <  CONTINUES x the usual value

A frame that repeats the bytes one block before is none, as memory holds the bytes of the last block.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_doubled import FrameBytes
from formats.importers.c3d_parameters import numbers_of
from formats.plain_text import counted

CONTINUES = 4.0  # times the usual second difference; our choice: a swing's largest is twice its usual one
# frames that show the usual second difference; our choice: a few tenths of a second, at 100 a second
FRAMES_OF_USUAL = 30
FEWEST_STATED = 3  # frames that show a second difference


def warning_of_more_frames(path: Path, frames: FrameBytes, held: int) -> str:
    """Return a warning of a file that holds more frames than the `frames` that it states, '' without any.

    held: number of frames for which the file has room
    """
    stated, room = frames.stated, frames.stop - frames.end
    if room < frames.width:
        return ""
    before = min(stated, max(FRAMES_OF_USUAL, -(-BLOCK_BYTES // frames.width)))
    with path.open("rb") as file:
        file.seek(frames.end - before * frames.width)
        raw = file.read(before * frames.width + min(room, BLOCK_BYTES + frames.width))
    behind = raw[before * frames.width :]
    if room >= BLOCK_BYTES + frames.width:  # more than the last block's rest
        if not any(behind[: frames.width]):
            return ""
        return f"the file states {stated} frames and has room for {held}; the first {stated} were read"
    if not (more := _continuing(raw, frames, before)):
        return ""
    stand = "stands" if more == 1 else "stand"
    return (
        f"the file states {stated} frames, and {counted(more, 'frame')} more {stand} behind them; "
        f"the first {stated} were read"
    )


def _continuing(raw: bytes, frames: FrameBytes, before: int) -> int:
    """Return how many frames in `raw`, behind the first `before` ones, continue their trajectories."""
    width = frames.width
    if before < FEWEST_STATED:
        return 0
    numbers = numbers_of(raw[: len(raw) // width * width], frames.kind, frames.processor)
    rows = numbers.reshape(-1, width // frames.kind)[:, : 4 * frames.points].reshape(-1, frames.points, 4)
    with np.errstate(invalid="ignore", over="ignore"):  # what is no frame may be no number
        seen = np.isfinite(rows).all(2) & (rows[..., 3] >= 0)
        places = np.where(seen[..., None], rows[..., :3], np.nan).astype(float)
        off = np.abs(np.diff(places, 2, axis=0)).max(2)
    usual = off[: before - 2]
    if not np.isfinite(usual).any():
        return 0
    most = CONTINUES * float(np.nanmedian(usual))
    found = 0
    for at in range(before, len(rows)):
        begin, stop = at * width, (at + 1) * width
        known = off[at - 2][np.isfinite(off[at - 2])]
        is_old = begin >= BLOCK_BYTES and raw[begin:stop] == raw[begin - BLOCK_BYTES : stop - BLOCK_BYTES]
        if is_old or not any(raw[begin:stop]) or not len(known) or not np.median(known) <= most:
            break
        found += 1
    return found
