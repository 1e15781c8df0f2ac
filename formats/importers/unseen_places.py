"""Find the places of markers that were not seen, in every format: zeros, lacking coordinates, and signs such as -9999.

A marker at exactly (0, 0, 0), or with a coordinate that is no number, was not seen. A sign stands in all three
coordinates, and is a sign wherever it does so. One of two things shows it:

- it lies twice as far out as any other number. It has three nines or more and no other digit, or is 1e6 of any unit or
  more, as NDI's -3.697314e28;
- it is whole or has nines alone, as -1 or 9999, and stands in two places or more. The path of a marker does not lead
  there:

    d  >  LEAST_OFF + LONGER s

`d` is how far it lies from the nearest of the marker's other places. `s` is the longest step between two of them, from
frame to frame. An honest path comes to a place by its neighbours, so `d` is at most as long as a step. The factor
leaves room for a step that is twice as long as all others.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from formats.arrays import Booleans, Floats
from formats.importers.number_cells import LONGEST_SHOWN
from formats.plain_text import MOST_TOLD, counted, first_few

FARTHER_OUT = 2.0  # times as far as any other coordinate lies a number that stands for a marker that was not seen
NINES = re.compile(r"-?9{3,}(\.9+)?")
BEYOND_ALL = 1e6  # of any unit: no place is 1000 m away
MOST_SIGNS = 3  # of a marker that are looked at, and of a file of which each is told
LEAST_OFF = 0.05  # m, stated by us: two diameters of a marker
LONGER = 2.0  # times the longest step between other frames
FEWEST_STEPS = 20  # of a marker, stated by us: fewer do not tell how far it goes in one
FEWEST_SIGNS = 2  # places of one number: a single one may be a place that leaps, of which `leaps` tells


def as_seen(positions: Floats, absent: Booleans | None = None) -> Floats:
    """Return positions, (frames, markers, 3), with NaN for each marker that was not seen."""
    gone = (positions == 0).all(2) | ~np.isfinite(positions).all(2)
    if absent is not None:
        gone |= absent
    return np.where(gone[..., None], np.nan, positions)


def are_zeros(positions: Floats, absent: Booleans | None = None) -> Booleans:
    """Return where three zeros alone say that a marker was not seen, (frames, markers), by positions as `as_seen`."""
    found = (positions == 0).all(2)
    return np.asarray(found if absent is None else found & ~absent)


def doubt_of_zeros(zeros: Booleans, places: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Return a sentence on markers whose path leads to their zeros, which may be places then; '' without any.

    A path leads there where a place beside the zeros is no farther from them than the marker's longest step.

    - `zeros`: where three stand, (frames, markers); `places` [m], (frames, markers, 3), NaN where not seen
    - `labels`: of the markers; `where`: names the line or the frame of a place in the file
    """
    found, first = list[str](), len(zeros)
    for marker in np.flatnonzero(zeros.any(0)).tolist():
        far = np.linalg.norm(places[:, marker], axis=1)
        steps = _steps_of(places[:, marker])
        are_beside = np.zeros(len(zeros), bool)
        are_beside[1:] |= zeros[:-1, marker]
        are_beside[:-1] |= zeros[1:, marker]
        beside = far[are_beside & np.isfinite(far)]
        if len(steps) >= FEWEST_STEPS and len(beside) and beside.min() <= steps.max():
            times = counted(int(zeros[:, marker].sum()), "time")
            near = f"{1e3 * beside.min():.2g} mm"
            found.append(f"{labels[marker].strip()[:LONGEST_SHOWN]} {times}, with places {near} from there beside them")
            first = min(first, int(np.argmax(zeros[:, marker])))
    if not found:
        return ""
    return (
        f"0, 0, 0 counts as not seen, first in {where(first)}: {first_few(found, len(found))}; if markers were there, "
        "move the origin and export again"
    )


def lack_coordinates(positions: Floats) -> Booleans:
    """Return which markers have some of their coordinates alone, (frames, markers), by positions as `as_seen` takes."""
    found = np.isfinite(positions)
    return np.asarray((found & (positions != 0)).any(2) & ~found.all(2))


def doubt_of_lacking(lacking: Booleans, time: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Return a sentence on markers that have some of their coordinates alone, '' without any.

    - `lacking`: which, (frames, markers); `time` [s], (frames,)
    - `labels`: of the markers; `where`: names the line or the frame of a place in the file
    """
    if not lacking.any():
        return ""
    count, some = int(lacking.sum()), np.argwhere(lacking)[:MOST_TOLD].tolist()
    names = [labels[marker].strip()[:LONGEST_SHOWN] for _, marker in some]
    if count == 1:
        frame = some[0][0]
        return f"{where(frame)}: {names[0]} lacks a coordinate at {time[frame]:.2f} s, so it counts as not seen there"
    each = [f"{name} in {where(at)} at {time[at]:.2f} s" for name, (at, _) in zip(names, some, strict=True)]
    return f"{count} places lack a coordinate and count as not seen: {first_few(each, count)}"


def take_out_signs(places: Floats, metres: Floats, name: Callable[[int], str]) -> str:
    """Take out the places that are one number for all coordinates, and a sign; return a sentence on them.

    - `places` [m], (frames, markers, 3), NaN where not seen; `metres`: of the unit that each marker's had, (markers,)
    - `name`: names the line or the frame of a place in the file
    """
    same = (places[..., 0] == places[..., 1]) & (places[..., 1] == places[..., 2])
    if not same.any():
        return ""
    others = [np.abs(places[..., axis][~same & np.isfinite(places[..., axis])]) for axis in range(3)]
    farthest = max(float(one.max(initial=0)) for one in others)
    values, codes = np.unique((places[..., 0] / metres)[same], return_inverse=True)
    numbers = np.full(same.shape, -1)
    numbers[same] = codes
    words = [f"{value:.7g}" for value in values.tolist()]  # all of 4 bytes
    out = same & (np.abs(places[..., 0]) > FARTHER_OUT * farthest) & (farthest > 0)
    far_out = {words[k] for k in np.unique(numbers[out]).tolist()}
    signs = {word for word in far_out if abs(float(word)) >= BEYOND_ALL or NINES.fullmatch(word)}
    times = np.bincount(codes, minlength=len(words))
    for marker in np.flatnonzero(same.any(0)).tolist():
        usual = Counter(numbers[same[:, marker], marker].tolist()).most_common(MOST_SIGNS)
        path = np.where(same[:, marker, None], np.nan, places[:, marker])
        signs |= _off_its_path(path, [words[k] for k, _ in usual if times[k] >= FEWEST_SIGNS], float(metres[marker]))
    frames, markers = np.nonzero(same & np.isin(numbers, [k for k, word in enumerate(words) if word in signs]))
    found = [words[k] for k in numbers[frames, markers].tolist()]
    places[frames, markers] = np.nan
    return "; ".join(
        f"{sign} stands in all three coordinates of a marker {counted(count, 'time')}, first in "
        f"{name(int(frames[found.index(sign)]))}, and counts as not seen"
        for sign, count in Counter(found).most_common(MOST_SIGNS)
    )


def _steps_of(path: Floats) -> Floats:
    """Return the lengths of a path's steps [m] from frame to frame, (steps,); `path` [m], (frames, 3)."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return np.asarray(steps[np.isfinite(steps)])


def _off_its_path(path: Floats, words: list[str], metres: float) -> set[str]:
    """Return those of a marker's numbers to which its path does not lead.

    `path` [m], (frames, 3): its other places, NaN where not seen; `metres`: of the unit of its numbers
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
