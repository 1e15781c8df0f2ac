"""Find marker positions that stand for a missing value: zeros, incomplete coordinates, and codes such as -9999.

A marker at exactly (0, 0, 0), or with a coordinate that is not a number, was not seen. A missing-value code is one
number in all three coordinates. A number is a code throughout the file if one of two conditions holds:

- It lies twice as far out as any other number. It also consists of three or more nines, or is at least 1e6 in the
  file's unit, such as NDI's -3.697314e28.
- It is a whole number or consists of nines, such as -1 or 9999. It occurs in two positions or more, and lies off the
  marker's trajectory:

    d  >  LEAST_OFF + LONGER s

`d` is the distance of the code's position to the nearest of the marker's other positions. `s` is the marker's longest
step from one frame to the next. A marker that moves to a position passes close by, so `d` is at most one step. The
factor LONGER leaves room for a step twice as long as all others.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats
from formats.importers.number_cells import CELL_SHOWN
from formats.plain_text import MOST_LISTED, counted, first_few

LOWEST_INTEGER = -(1 << 15)  # of 16 bits
HIGHEST_INTEGER = (1 << 15) - 1  # of 16 bits
# a code that lies far out: times the largest other coordinate. Our choice: half and double change no case of
# `tests/formats/test_missing_value_codes.py` but that of this bound.
FARTHER_THAN_OTHERS = 2.0
NINES = re.compile(r"-?9{3,}(\.9+)?")
BEYOND_ALL = 1e6  # in the file's unit: no position is 1000 m away
MOST_CODES = 3  # candidates checked of each marker, and codes that a warning names
LEAST_OFF = 0.05  # m; our choice: two diameters of a marker
LONGER = 2.0  # times the longest step between other frames
FEWEST_STEPS = 20  # of a marker; our choice: fewer do not show the longest step
FEWEST_REPEATS = 2  # positions with one code: a single one may be an outlier, which `marker_outliers` reports


def as_seen(positions: Floats, absent: Booleans | None = None) -> Floats:
    """Return positions, (frames, markers, 3), with NaN for each marker that was not seen.

    `absent`, (frames, markers): markers that the file flags as not seen
    """
    gone = (positions == 0).all(2) | ~np.isfinite(positions).all(2)
    if absent is not None:
        gone |= absent
    return np.where(gone[..., None], np.nan, positions)


def are_zeros(positions: Floats, absent: Booleans | None = None) -> Booleans:
    """Return whether three zeros alone mark a marker as not seen, (frames, markers); arguments as `as_seen`."""
    found = (positions == 0).all(2)
    return np.asarray(found if absent is None else found & ~absent)


def warning_of_zeros(zeros: Booleans, positions: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Return a warning of markers whose three zeros may be a true position at the origin, '' without any.

    The zeros may be true where the position before or after them is no farther from the origin than the marker's
    longest step.

    - `zeros`: whether three zeros stand there, (frames, markers); `positions` [m], (frames, markers, 3), NaN where not
      seen
    - `labels`: the markers' names; `where`: returns the name of a frame's line or number in the file
    """
    found, first = list[str](), len(zeros)
    for marker in np.flatnonzero(zeros.any(0)).tolist():
        far = np.linalg.norm(positions[:, marker], axis=1)
        steps = _steps_of(positions[:, marker])
        are_beside = np.zeros(len(zeros), bool)
        are_beside[1:] |= zeros[:-1, marker]
        are_beside[:-1] |= zeros[1:, marker]
        beside = far[are_beside & np.isfinite(far)]
        if len(steps) >= FEWEST_STEPS and len(beside) and beside.min() <= steps.max():
            times = counted(int(zeros[:, marker].sum()), "time")
            near = f"{1e3 * beside.min():.2g} mm"
            name = labels[marker].strip()[:CELL_SHOWN]
            found.append(f"{name} {times}, with a position {near} from there in a neighbouring frame")
            first = min(first, int(np.argmax(zeros[:, marker])))
    if not found:
        return ""
    return (
        f"0, 0, 0 counts as not seen, first in {where(first)}: {first_few(found, len(found))}; if markers were there, "
        "move the origin and export again"
    )


def are_lowest(integers: NDArray[Any]) -> Booleans:
    """Return whether all three coordinates are the lowest integer of 16 bits, (frames, markers); as they were read."""
    return np.asarray((integers == LOWEST_INTEGER).all(2))


def warning_of_lowest(lowest: Booleans, where: Callable[[int], str]) -> str:
    """Return a warning of coordinates that are the lowest integer and count as not seen, '' without any.

    - `lowest`: whether all three coordinates are, (frames, markers)
    - `where`: returns the name of a frame's number in the file
    """
    if not lowest.any():
        return ""
    return _told(str(LOWEST_INTEGER), int(lowest.sum()), where(int(np.argmax(lowest.any(1)))))


def are_at_bound(integers: NDArray[Any]) -> Booleans:
    """Return whether a coordinate is at a bound of 16-bit integers, (frames, markers); as they were read.

    The C3D user guide has programs scale the farthest coordinate to 32000 at most.
    """
    return np.asarray((np.abs(integers) >= HIGHEST_INTEGER).any(2))


def warning_of_bound(bound: Booleans, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Return a warning of coordinates at a bound of the integers, which count as not seen, '' without any.

    - `bound`: whether a coordinate is, (frames, markers); `labels`: the markers' names
    - `where`: returns the name of a frame's number in the file
    """
    if not bound.any():
        return ""
    count, some = int(bound.sum()), np.argwhere(bound)[:MOST_LISTED].tolist()
    each = [f"{labels[marker].strip()[:CELL_SHOWN]} in {where(frame)}" for frame, marker in some]
    return (
        f"{counted_out(count)}, with a coordinate at a bound of 16-bit integers: {first_few(each, count)}; export "
        "floats, or a larger scale"
    )


def counted_out(count: int) -> str:
    """Return in words that so many positions count as not seen."""
    return f"{count} positions count as not seen" if count > 1 else "1 position counts as not seen"


def _told(code: str, count: int, first: str) -> str:
    """Return the warning of one code; `first`: where it stands first."""
    return (
        f"{code} is all three coordinates of a marker {counted(count, 'time')}, first in {first}, and is read as a "
        "missing-value code"
    )


def are_incomplete(positions: Floats) -> Booleans:
    """Return whether one or two of a marker's three coordinates are missing, (frames, markers), before `as_seen`."""
    found = np.isfinite(positions)
    return np.asarray((found & (positions != 0)).any(2) & ~found.all(2))


def warning_of_incomplete(lacking: Booleans, time: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Return a warning of positions with one or two missing coordinates, '' without any.

    - `lacking`: whether coordinates are missing, (frames, markers); `time` [s], (frames,)
    - `labels`: the markers' names; `where`: returns the name of a frame's line or number in the file
    """
    if not lacking.any():
        return ""
    count, some = int(lacking.sum()), np.argwhere(lacking)[:MOST_LISTED].tolist()
    names = [labels[marker].strip()[:CELL_SHOWN] for _, marker in some]
    if count == 1:
        frame = some[0][0]
        return f"{where(frame)}: {names[0]} lacks a coordinate at {time[frame]:.2f} s, so it counts as not seen there"
    each = [f"{name} in {where(at)} at {time[at]:.2f} s" for name, (at, _) in zip(names, some, strict=True)]
    return f"{count} positions lack a coordinate and count as not seen: {first_few(each, count)}"


def remove_missing_value_codes(positions: Floats, metres: Floats, name: Callable[[int], str]) -> str:
    """Mark as not seen the positions that are a missing-value code; return a warning that names the codes.

    - `positions` [m], (frames, markers, 3), NaN where not seen; `metres`: of each marker's unit in the file, (markers,)
    - `name`: returns the name of a frame's line or number in the file
    """
    same = (positions[..., 0] == positions[..., 1]) & (positions[..., 1] == positions[..., 2])
    if not same.any():
        return ""
    others = [np.abs(positions[..., axis][~same & np.isfinite(positions[..., axis])]) for axis in range(3)]
    farthest = max(float(one.max(initial=0)) for one in others)
    values, codes = np.unique((positions[..., 0] / metres)[same], return_inverse=True)
    numbers = np.zeros(same.shape, int)  # read only where all three are the same
    numbers[same] = codes
    words = [f"{value:.7g}" for value in values.tolist()]  # all of 4 bytes
    out = same & (np.abs(positions[..., 0]) > FARTHER_THAN_OTHERS * farthest) & (farthest > 0)
    far_out = {words[k] for k in np.unique(numbers[out]).tolist()}
    signs = {word for word in far_out if abs(float(word)) >= BEYOND_ALL or NINES.fullmatch(word)}
    times = np.bincount(codes)
    for marker in np.flatnonzero(same.any(0)).tolist():
        usual = Counter(numbers[same[:, marker], marker].tolist()).most_common(MOST_CODES)
        path = np.where(same[:, marker, None], np.nan, positions[:, marker])
        signs |= _off_its_path(path, [words[k] for k, _ in usual if times[k] >= FEWEST_REPEATS], float(metres[marker]))
    frames, markers = np.nonzero(same & np.isin(numbers, [k for k, word in enumerate(words) if word in signs]))
    found = [words[k] for k in numbers[frames, markers].tolist()]
    positions[frames, markers] = np.nan
    return "; ".join(
        _told(code, count, name(int(frames[found.index(code)])))
        for code, count in Counter(found).most_common(MOST_CODES)
    )


def _steps_of(path: Floats) -> Floats:
    """Return the lengths of a trajectory's steps [m] from frame to frame, (steps,); `path` [m], (frames, 3)."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return np.asarray(steps[np.isfinite(steps)])


def _off_its_path(path: Floats, words: list[str], metres: float) -> set[str]:
    """Return the numbers, among `words`, whose position lies off a marker's trajectory.

    `path` [m], (frames, 3): the marker's other positions, NaN where not seen; `metres`: of the unit of the numbers
    """
    steps = _steps_of(path)
    if len(steps) < FEWEST_STEPS:
        return set()
    bound, found = LEAST_OFF + LONGER * float(steps.max()), set[str]()
    for word in words:
        if float(word).is_integer() or NINES.fullmatch(word):
            nearest = float(np.nanmin(np.linalg.norm(path - metres * float(word), axis=1)))
            found |= {word} if nearest > bound else set()
    return found
