"""Detect blocks that a copy wrote twice into a C3D file, one behind the other.

All behind them is shifted, and the file is longer by them. Positions that rest, and gaps, repeat bytes as well, but a
few of them only. A program that fills lost frames, or doubles the frame rate, repeats whole frames in several places. A
copy repeats them in one place.

Frames may be as long as whole blocks. Then one repeat of n frames is a copy's if the motion goes on behind it from the
last of them:

    s  =  (next position - last position) . d / (d . d),    summed over the markers

`d` is the mean of the steps before the first of the frames and behind the next one. `s` is 1 behind a copy. It is n + 1
where a program repeated a frame for each that it lost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_parameters import numbers_of

COMPARED_AT_ONCE = 1 << 22  # bytes compared at once; our choice: bounds memory, and no result depends on it
FROM_ONE = 0.5  # of a step: half of the difference between a copy's step, 1, and the least of a lost frame, 2

Part = Callable[[int, int], np.ndarray[Any, np.dtype[np.uint8]]]


@dataclass(frozen=True)
class FrameBytes:
    """Place and number format of the frames in a file.

    - `begin`, `end`, `stop` [bytes]: offsets of the frames, behind the last stated frame, and of the file's end or of
      the section behind the frames
    - `width`, `kind` [bytes]: of a frame and of a number; `points`: number of points in a frame
    - `processor`: code of the byte order
    """

    begin: int
    end: int
    stop: int
    width: int
    kind: int
    points: int
    processor: int

    @property
    def stated(self) -> int:
        """Number of frames that the file states."""
        return (self.end - self.begin) // self.width


def refuse_doubled_bytes(path: Path, frames: FrameBytes) -> str:
    """Refuse a file that holds some blocks twice, one behind the other, so that all frames behind are shifted.

    Return a warning of whole frames that come twice where their motion does not show a copy, '' without them.

    Raises:
        TakeError: names the bytes.
    """
    begin, end, stop, width = frames.begin, frames.end, frames.stop, frames.width
    doubled = (stop - end) // BLOCK_BYTES * BLOCK_BYTES
    if not doubled:
        return ""
    with path.open("rb") as file:

        def part(at: int, until: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
            file.seek(begin + at)
            return np.frombuffer(file.read(until - at), np.uint8)

        is_filled = part(end - begin, end - begin + max(width, BLOCK_BYTES)).any()
        longest = 2 * doubled if doubled % width == 0 else stop  # whole frames at rest repeat without end
        repeats = _repeats(part, stop - begin, (doubled, longest), 4 * frames.kind) if is_filled else iter(())
        found = list(islice(repeats, 2))
        if not found or (len(found) > 1 and doubled % width == 0):
            return ""
        first, size = found[0]
        whole = -(-first // width) * width  # the first frame that begins within the repeat
        if doubled % width == 0 and whole + doubled <= first + size:
            first = whole
            if not abs(_step_behind(part, frames, whole // width, doubled // width) - 1.0) < FROM_ONE:
                return _warning_of_repeat(whole // width, doubled // width, frames.stated)
    raise TakeError(
        f"holds the {doubled} bytes from byte {begin + first} on twice, which shifts all frames behind them",
        where=path, advice="copy or export it again",
    )  # fmt: skip


def _repeats(part: Part, length: int, sizes: tuple[int, int], point: int) -> Iterator[tuple[int, int]]:
    """Yield the offsets from which some bytes come twice, one behind the other, and the number of bytes alike.

    Bytes of which half the points or more are alike are no repeat.

    - `part`: reads the bytes from one offset to another; `length` [bytes]: of all
    - `sizes` [bytes]: number of these bytes, and one that the bytes alike do not reach
    - `point` [bytes]: of a point's numbers
    """
    (size, longest), begun = sizes, 0  # where the present run of equal bytes begins
    for at in range(0, length - size, COMPARED_AT_ONCE):
        stop = min(at + COMPARED_AT_ONCE, length - size)
        differ = np.flatnonzero(part(at, stop) != part(at + size, stop + size))
        bounds = np.concatenate([[begun - 1], at + differ, [stop]])
        ended = slice(None) if stop == length - size else slice(-1)  # a run may go on in the next bytes
        counts = np.diff(bounds)[ended] - 1
        is_run = (counts >= size) & (counts < longest)
        for first, count in zip((bounds[:-1][ended][is_run] + 1).tolist(), counts[is_run].tolist(), strict=True):
            points = part(first, first + min(size, COMPARED_AT_ONCE) // point * point).reshape(-1, point)
            if 2 * len(np.unique(points, axis=0)) > len(points):
                yield first, count
        begun = int(bounds[-2]) + 1


def _step_behind(part: Part, frames: FrameBytes, first: int, count: int) -> float:
    """Return the step from the last of the repeated frames to the next one, in usual steps; NaN where no step shows.

    - `first`: index of the first of the frames that come twice; `count`: their number
    """
    held = (frames.stop - frames.begin) // frames.width
    before, last, behind = (
        _positions(part, frames, at, held) for at in ((first - 1, first), (first + 2 * count - 1,),
        (first + 2 * count, first + 2 * count + 1))
    )  # fmt: skip
    usual = np.stack([before[1] - before[0], behind[1] - behind[0]])
    usual = np.where(np.isfinite(usual), usual, usual[::-1])  # one of both is missing at an end of the file
    usual, step = usual.mean(0), behind[0] - last[0]
    both = np.isfinite(usual) & np.isfinite(step)
    length = float((usual[both] ** 2).sum())
    return float((step[both] * usual[both]).sum()) / length if length > 0 else np.nan


def _positions(part: Part, frames: FrameBytes, at: tuple[int, ...], held: int) -> Floats:
    """Return the positions in some frames, (frames, points, 3), in the file's unit, NaN where not seen or not held."""
    found = np.full((len(at), frames.points, 3), np.nan)
    for row, frame in enumerate(at):
        if 0 <= frame < held:
            raw = part(frame * frames.width, (frame + 1) * frames.width).tobytes()
            numbers = numbers_of(raw, frames.kind, frames.processor)[: 4 * frames.points].reshape(-1, 4)
            found[row] = np.where((numbers[:, 3:] < 0) | np.isinf(numbers[:, :3]), np.nan, numbers[:, :3])
    return found


def _warning_of_repeat(first: int, count: int, stated: int) -> str:
    """Return the warning of whole frames that come twice; `first`: their index, `count`: their number."""
    again, before = f"frame {first + 2} repeats frame {first + 1}", f"frames {first + 1} to {first + count}"
    if count > 1:
        again = f"frames {first + count + 1} to {first + 2 * count} repeat {before}"
    return f"{again}, and the file has room for more frames than the {stated} that it states"
