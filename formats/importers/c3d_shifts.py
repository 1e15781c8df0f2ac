"""Detect bytes that were inserted into the frames of a C3D file, or lost within them: all frames behind are shifted.

The markers' positions show the shift. Positions behind it continue the trajectories if the frames are read `s` bytes
later, and leap if they are read from where they should stand:

    LEAP q(s) < m(0),    LEAP q(s) < r

`q(s)` is the distance from the extrapolated position that nine of ten markers keep. `m(0)` is the median distance
without a shift. Both are taken over two frames, since one frame is partly before the shift, and then over three. `r` is
the markers' median distance from the origin. Parts of two floats are mostly a number next to zero, and zero is nearer
than a leap far out. The last frame before the shift must itself lie near the one before. So one frame with exchanged
markers is no shift.

Labels that are exchanged in a cycle leap as a shift by whole markers does; `c3d_cycles` tells them apart. Where it
cannot, the file's other frames do. A shift moves all frames to the end and none before. So there is none if most frames
before show the last frame's shape better if they are read `s` bytes later. Neither is there one if most frames behind
show it better as they stand.

A stale block shifts its own frames alone, so frames with bytes of one are passed over.

A shift by all bytes of a frame leaves every position at its marker, and is not found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from formats.arrays import Floats, Integers, Singles
from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES, Blocks
from formats.importers.c3d_cycles import FRAMES_SHOWING, is_cycle
from formats.importers.c3d_doubled import FrameBytes
from formats.importers.c3d_parameters import numbers_of
from formats.plain_text import counted

LEAP = 3.0  # times; our choice: neighbouring markers lie farther apart than cloth accelerates in three frames
MARKERS_SHOWING = 16  # markers, evenly spread; our choice: bounds time, and a shift moves all of them
MOST_LEAPS = 16  # frames with the largest leaps that are searched; our choice: bounds time, and a shift is the largest
FEWEST_SHOWING = 3  # markers seen before a leap; our choice: fewer may turn into any direction
NEARLY_ALL = 0.9  # of the markers; our choice: a garment that leaps by a row fits a shift but for its rows' ends
UNUSUAL = 4.0  # times the median leap of the frames before; our choice: accelerations of a swing are 2 times theirs
FEWEST_BEFORE = 5  # frames that show a usual leap; our choice: the median of fewer may be of a single leap
NO_NUMBER = float(np.finfo(np.float32).max)  # in any unit: the largest number of 4 bytes stands for one that is none
BEYOND_EARLIER = 1.5  # times the largest leap before; our choice: motion that begins gently leaps a few times farther
SCANNED_AT_ONCE = 1 << 22  # bytes read at once; our choice: bounds memory, and no result depends on it
SHIFTS_AT_ONCE = 1 << 11  # shifts looked at together; our choice: bounds memory, and no result depends on it
FRAMES_VOTING = 16  # frames, evenly spread; our choice: bounds time, and a shift moves all frames to the end
SHOWS_CLEARLY = 2.0  # times; our choice: behind a second shift both readings are of foreign bytes, and neither fits
IS_GONE = 0.5  # of the markers at one place in a frame; our choice: then most were lost or found, and none leaps

Read = Callable[[int, int], bytes]  # reads as many bytes from an offset behind the first frame on


def refuse_shifted_frames(path: Path, frames: FrameBytes, count: int, blocks: Blocks) -> str:
    """Refuse a file with inserted or lost bytes within its first `count` frames.

    Return a warning of labels that are exchanged among markers for some frames, '' without any.

    blocks: blocks of zeros or stale bytes, which shift only their own frames

    Raises:
        TakeError: names the frame, and the number of bytes.
    """
    if frames.points < FEWEST_SHOWING or count < 3:
        return ""
    exchanged, moved = list[int](), 0  # the frames at which a cycle begins or ends, and by how many bytes it moves
    replaced = _frames_of(np.concatenate([blocks.between, blocks.stale]).tolist(), frames.width)
    with path.open("rb") as file:

        def read(at: int, size: int) -> bytes:
            file.seek(frames.begin + at)
            return file.read(min(size, frames.stop - frames.begin - at))

        for before in _candidates(np.concatenate(list(_leaps(read, frames, count)))):
            if not replaced.isdisjoint(range(before - 1, before + 4)):
                continue
            if _shift_behind(read, frames, before, count) is None:
                continue
            # A frame that is partly before the shift may continue the trajectories by another one, less well.
            near = [(one, _shift_behind(read, frames, one, count)) for one in range(before, before + 3)]
            (_, by), last = min((found, -one) for one, found in near if found is not None)
            ends = moved and (moved + by) % frames.width == 0
            if ends or _is_cycle(read, frames, before, -last, by, count):
                if not exchanged or 2 - last > exchanged[-1] + FRAMES_SHOWING:
                    moved = (moved + by) % frames.width
                exchanged.append(2 - last)
                continue
            raise TakeError(
                f"its frames are shifted from about frame {2 - last} on: {counted(by, 'foreign byte')} or "
                f"{counted(frames.width - by, 'lost byte')} would shift them so", where=path,
                advice="copy or export it again",
            )  # fmt: skip
    if not exchanged:
        return ""
    until = f" to about frame {exchanged[-1]}" if exchanged[-1] - exchanged[0] > 1 else ""
    return f"labels seem exchanged in a cycle from about frame {exchanged[0]}{until}; label the markers again there"


def _frames_of(blocks: list[int], width: int) -> set[int]:
    """Return the frames that have bytes in some blocks, counted from the beginning of the frames."""
    return {
        frame for block in blocks
        for frame in range(block * BLOCK_BYTES // width, ((block + 1) * BLOCK_BYTES - 1) // width + 1)
    }  # fmt: skip


def _candidates(leaps: Floats) -> list[int]:
    """Return the frames behind which bytes may be inserted or lost, in order: with the largest leaps, or the first.

    Behind a shift by a part of a number, any frame may leap by more than the shift itself.
    """
    before = np.maximum.accumulate(np.concatenate([[0.0], leaps[:-1]]))
    first = np.flatnonzero(leaps > BEYOND_EARLIER * before)[:MOST_LEAPS]
    largest = np.argsort(-leaps, kind="stable")[:MOST_LEAPS]
    return [
        at for at in np.union1d(first, largest).tolist()
        if leaps[at] > UNUSUAL * (np.median(leaps[:at]) if at >= FEWEST_BEFORE else 0.0)
    ]  # fmt: skip


def _leaps(read: Read, frames: FrameBytes, count: int) -> Iterator[Floats]:
    """Yield how far the markers lie from their extrapolation by two frames, in the median, (frames,).

    The leap is 0 where most markers have the same three numbers: zeros, or a code for missing ones.
    """
    some, at_once = None, max(SCANNED_AT_ONCE // frames.width, 1)
    for first in range(0, count - 2, at_once):
        begin, stop = max(first - 1, 0), min(first + at_once, count - 2) + 2
        raw = read(begin * frames.width, (stop - begin) * frames.width)
        rows = numbers_of(raw, frames.kind, frames.processor).reshape(stop - begin, -1)
        some = _usually_seen(rows, frames.points) if some is None else some
        with np.errstate(invalid="ignore", over="ignore"):  # behind a shift the bytes may be no numbers
            places = rows[:, 4 * some[:, None] + np.arange(3)].astype(float)
            places = places if first else np.concatenate([places[:1], places])
            off = np.abs(places[3:] - 3 * places[1:-2] + 2 * places[:-3]).max(2)
        off[np.isnan(off)] = np.inf
        with np.errstate(invalid="ignore"):  # the mean of two infinities
            are_gone = (places == np.median(places, axis=1, keepdims=True)).all(2).mean(1) > IS_GONE
        yield np.where(are_gone[3:] | are_gone[1:-2], 0.0, np.median(off, axis=1))


def _usually_seen(rows: Singles, points: int) -> Integers:
    """Return some of the markers that are seldom three zeros, else of all; `rows`: numbers, (frames, numbers)."""
    are_zeros = (rows[:, : 4 * points].reshape(len(rows), points, 4)[..., :3] == 0).all(2).mean(0)
    return _spread(np.flatnonzero(are_zeros <= IS_GONE) if (are_zeros <= IS_GONE).any() else np.arange(points))


def _spread(markers: Integers) -> Integers:
    """Return some of the markers, evenly spread."""
    return np.asarray(markers[np.unique(np.linspace(0, len(markers) - 1, MARKERS_SHOWING).astype(int))])


def _shift_behind(read: Read, frames: FrameBytes, before: int, count: int) -> tuple[float, int] | None:
    """Return the shift of the frames from two frames behind `before` on, None without one.

    The result is the distance from the extrapolated positions that most markers keep, and the shift [bytes].
    """
    if before + 2 >= count:
        return None
    every = np.arange(frames.points)
    last = _numbers(read, frames, before, every, [0])[0]
    is_seen = np.asarray(np.isfinite(last).all(1) & ~(last[:, 3] < 0))
    if is_seen.sum() < FEWEST_SHOWING:
        return None
    some = _spread(np.flatnonzero(is_seen))
    last = last[some, :3]
    earlier = _numbers(read, frames, max(before - 1, 0), some, [0])[0, :, :3]
    steady = float(np.median(_off(last[None], [earlier])))
    from_origin = float(np.median(_off(last[None], [np.zeros_like(last)])))
    found, off = 0, 0.0
    for steps in (2, 3):
        if before + steps >= count:
            break
        shifts = [0, found] if found else range(frames.width)
        behind = _numbers(read, frames, before + steps, some, shifts)[..., :3]
        following = behind[0]
        if before + steps + 1 < count:
            following = _numbers(read, frames, before + steps + 1, some, [0])[0, :, :3]
        median, nearest = _continue(behind, following, last, earlier, steps)
        if not len(nearest) or not LEAP * max(nearest.min(), steady) < min(median, from_origin):
            return None
        found, off = found or 1 + int(nearest.argmin()), off + float(nearest.min())
    return off, found


def _is_cycle(read: Read, frames: FrameBytes, before: int, last: int, by: int, count: int) -> bool:
    """Return whether a shift by `by` bytes behind frame `last` is rather an exchange of labels in a cycle.

    A shift by a part of a marker's bytes is no exchange of labels.

    before: the frame that showed the leap, `last` or up to two frames earlier
    """
    each = 4 * frames.kind
    places = [one // each for one in (by, by - frames.width) if one % each == 0 and abs(one) < frames.points * each]
    if not places:
        return False
    if last < 1:
        return not _is_lasting(read, frames, before, by, count)
    every = np.arange(frames.points)
    some = range(last - 1, min(last + 1 + FRAMES_SHOWING, count))
    rows = np.array([_numbers(read, frames, at, every, [0])[0] for at in some])
    found = is_cycle(np.where(rows[..., 3:] < 0, np.nan, rows[..., :3]), min(places, key=abs))
    return not _is_lasting(read, frames, before, by, count) if found is None else found


def _is_lasting(read: Read, frames: FrameBytes, before: int, by: int, count: int) -> bool:
    """Return whether a shift by `by` bytes behind a frame fits the frames far before and far behind as well."""
    last = _numbers(read, frames, before, np.arange(frames.points), [0])[0]
    seen = np.flatnonzero(np.isfinite(last).all(1) & ~(last[:, 3] < 0))
    for first, stop, readings in ((0, before, [by, 0]), (before + 2, count, [0, by])):
        voting = np.unique(np.linspace(first, max(stop - 1, first), FRAMES_VOTING).astype(int))[: stop - first]
        unlike = (_unlike(_numbers(read, frames, int(at), seen, readings)[..., :3], last[seen, :3]) for at in voting)
        if 2 * sum(SHOWS_CLEARLY * against < shifted for against, shifted in unlike) > len(voting):
            return False
    return True


def _unlike(readings: Floats, last: Floats) -> list[float]:
    """Return how far the shape of each reading, (readings, markers, 3), is from that of `last`, (markers, 3).

    The common displacement is removed, which the motion since then may have caused.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        moved = np.clip(np.nan_to_num(readings - last, nan=NO_NUMBER), -NO_NUMBER, NO_NUMBER)
        moved -= np.median(moved, axis=1, keepdims=True)
    return list(np.abs(moved).max(2).mean(1).tolist())


def _continue(behind: Floats, following: Floats, last: Floats, earlier: Floats, steps: int) -> tuple[float, Floats]:
    """Return how well positions continue the trajectories: the median of the first reading, nearest of the others.

    - `behind`: positions some steps behind the last one in several readings, (readings, markers, 3)
    - `following`, `last`, `earlier`: positions one step behind the first reading, and the last two, (markers, 3)
    """
    off = _off(behind, [last, last + steps * (last - earlier)])
    with np.errstate(invalid="ignore", over="ignore"):
        back = _off(behind[:1] - steps * (following - behind[0]), [last])
    median = min(float(np.quantile(off[:, 0], 0.5, axis=1).min()), float(np.quantile(back[0, 0], 0.5)))
    return median, np.quantile(off[:, 1:], NEARLY_ALL, axis=2).min(0)


def _numbers(read: Read, frames: FrameBytes, at: int, markers: Integers, shifts: Sequence[int]) -> Floats:
    """Return the four numbers of some markers in a frame, read later by each shift [bytes], (shifts, markers, 4).

    Numbers behind the end of the file are zeros.
    """
    size = frames.width + max(shifts)
    raw = np.frombuffer(read(at * frames.width, size).ljust(size, b"\0"), np.uint8)
    places = frames.kind * (4 * markers[:, None] + np.arange(4))[..., None] + np.arange(frames.kind)
    found = [
        numbers_of(raw[np.asarray(some)[:, None, None, None] + places].tobytes(), frames.kind, frames.processor)
        for some in (shifts[first : first + SHIFTS_AT_ONCE] for first in range(0, len(shifts), SHIFTS_AT_ONCE))
    ]  # fmt: skip
    with np.errstate(invalid="ignore"):  # bytes that are no number
        return np.concatenate(found).reshape(len(shifts), len(markers), 4).astype(float)


def _off(positions: Floats, predicted: list[Floats]) -> Floats:
    """Return how far positions, (shifts, markers, 3), are from each prediction, (predictions, shifts, markers)."""
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(np.stack([positions - one for one in predicted])).max(-1)
    return np.asarray(np.minimum(np.nan_to_num(off, nan=NO_NUMBER, posinf=NO_NUMBER), NO_NUMBER))
