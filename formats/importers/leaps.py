"""Take out single places of a marker that leap away from its path and back, as lost bytes and wrong labels make them.

Three straight lines lead to a place: between those before and after, through the two before, and through the two after.
It leaps where it is farther from each of them than an acceleration and noise carry it:

    |z - line|  >  LEAST_LEAP + HARDEST_PULL r / 2 + BENDS q max(1, r / 2 h^2)
    r  =  h1 h2 between two,  h1 (h1 + h2) ahead of two

It comes back where its neighbours are nearer to each other than it is to the line between them.

- `h1`, `h2`: the steps of time; `h`: the median step
- `q`: half of the places of that marker are no farther than that from the nearest of their lines

The first two places and the last two have only the line through the next two. Such a line carries the noise of three
places, 1, 2 and 1 times. That is sqrt(6) standard deviations. Between two neighbours they are sqrt(3/2), half as much.
So the bound has twice the noise. Its motion elsewhere bounds the place as well:

    |z - line|  >  LEAST_LEAP + HARDEST_PULL r / 2 + AT_ENDS max(BENDS q, f) max(1, r / 2 h^2)

- `f`: no other place of the marker is farther than that from such a line, where r = 2 h^2. A step that stays has a
  large one

No cloth does that. At 100 frames a second, 50 mm off two places ahead takes 500 m/s^2, and at 20
frames 20 m/s^2. Cloth that is flicked may reach the second, so the bound grows with the step. It is
65 mm at 100 frames and 0.43 m at 20, which takes 170 m/s^2, and 6 m at 5 frames. So the rule holds
at every rate, and finds less at low ones and behind gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.importers.number_cells import LONGEST_SHOWN
from formats.importers.strays import straight_lines
from formats.motion import HARDEST_PULL
from formats.plain_text import MOST_TOLD, first_few

LEAST_LEAP = 0.05  # m, stated by us: two diameters of a marker; lost bytes leave most places farther off
AT_ENDS = 2.0  # times the noise between neighbours has a line ahead; and twice as far as anywhere else goes no cloth
BENDS = 20.0  # of normal noise, q is 0.5 standard deviations; of 300 files made honestly two had a place beyond
FEWEST_PLACES = 20  # places of a marker, stated by us: fewer do not tell how its path bends usually
MOST_LEAPS = 0.05  # of a marker's places: one that leaps more often has another cause, which other checks tell


def take_out_leaps(time: Floats, places: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Take out the places that leap away and back; return a sentence on them, '' without any.

    - `time` [s], (frames,); `places` [m], (frames, markers, 3), NaN where not seen
    - `labels`: of the markers; `where`: names the line or the frame of a place in the file
    """
    if len(time) < FEWEST_PLACES or not (np.diff(time) > 0).all():
        return ""
    found = list[_Leap]()
    for marker in range(places.shape[1]):
        leaps = _leaps_of(time, places[:, marker])
        places[[leap.frame for leap in leaps], marker] = np.nan
        found += [replace(leap, marker=marker) for leap in leaps]
    if not found:
        return ""
    found.sort(key=lambda leap: (leap.frame, leap.marker))
    named = [f"{labels[leap.marker].strip()[:LONGEST_SHOWN]}" for leap in found[:MOST_TOLD]]
    if len(found) == 1:
        and_back = " and back" * found[0].comes_back
        return (
            f"{where(found[0].frame)}: {named[0]} leaps {_shown(found[0].off)} m away{and_back}, so it counts as not "
            "seen there"
        )
    each = [f"{name} in {where(leap.frame)} by {_shown(leap.off)} m" for name, leap in zip(named, found, strict=False)]
    return f"{len(found)} places leap away from their paths and count as not seen: {first_few(each, len(found))}"


def _shown(off: float) -> str:
    return f"{off:.2g}" if off < 10 else f"{off:.0f}"


@dataclass(frozen=True)
class _Leap:
    """A place that leaps: its frame, how far [m] it is off its line, and whether places follow to which it returns."""

    frame: int
    off: float
    comes_back: bool
    marker: int = 0


def _leaps_of(time: Floats, path: Floats) -> list[_Leap]:
    """Return the leaps of a path [m], (frames, 3)."""
    seen = np.flatnonzero(np.isfinite(path).all(1))
    instants, places, step = time[seen], path[seen], float(np.median(np.diff(time)))
    # Most markers never go so far in a step.
    if len(seen) < FEWEST_PLACES or np.abs(np.diff(places, axis=0)).max() < LEAST_LEAP / 2:
        return []
    off, reach = _beside_lines(instants, places)
    noise = float(np.median(off.min(0)))
    leaps = 2 + np.flatnonzero(_is_beyond(off, reach, noise, step))
    good = np.setdiff1d(np.arange(len(seen)), leaps)
    kept = list[_Leap]()
    for k in leaps.tolist():  # by others that leap, a place between may seem to leap as well
        at = int(np.searchsorted(good, k))
        if not 2 <= at <= len(good) - 2:
            continue
        some = np.array([*good[at - 2 : at], k, *good[at : at + 2]])
        off, reach = _beside_lines(instants[some], places[some])
        across = float(np.linalg.norm(places[some[3]] - places[some[1]]))
        if _is_beyond(off, reach, noise, step)[0] and off[0, 0] > across:
            kept.append(_Leap(int(seen[k]), float(off[0, 0]), comes_back=True))
    kept += [
        _Leap(int(seen[good[k]]), far, comes_back=False)
        for k, far in _leaps_at_ends(instants[good], places[good], noise, step)
    ]
    return kept if len(kept) <= max(1, MOST_LEAPS * len(seen)) else []


def _leaps_at_ends(time: Floats, places: Floats, noise: float, step: float) -> list[tuple[int, float]]:
    """Return which of the first two and the last two places leap, and how far [m] they are off their line.

    `time` [s], (n,); `places` [m], (n, 3), of which no other leaps
    """
    if len(time) < FEWEST_PLACES:
        return []
    lead, reach = straight_lines(time, places)
    ahead = (np.linalg.norm(places - lead, axis=2) / np.maximum(1.0, reach / (2 * step**2)))[1:]
    elsewhere = float(max(ahead[0, 4:-2].max(initial=0.0), ahead[1, 2:-4].max(initial=0.0)))
    bend, found = AT_ENDS * max(BENDS * noise, elsewhere), list[tuple[int, float]]()
    for order in (np.arange(4), len(time) - 1 - np.arange(4)):
        line = order[2:4]
        for k in order[1::-1].tolist():
            if far := _beyond_line(time, places, np.array([k, *line]), bend, step):
                found.append((k, far))
            else:
                line = np.array([k, line[0]])
    return found


def _beyond_line(time: Floats, places: Floats, some: Integers, bend: float, step: float) -> float:
    """Return how far [m] the first of three places is off the line through the others, 0 where it may be."""
    near, far = np.abs(np.diff(time[some])).tolist()
    reach = near * (near + far)
    lead = places[some[1]] + (places[some[1]] - places[some[2]]) * near / far
    off = float(np.linalg.norm(places[some[0]] - lead))
    bound = LEAST_LEAP + HARDEST_PULL * reach / 2 + bend * max(1.0, reach / (2 * step**2))
    return off if off > bound else 0.0


def _beside_lines(time: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return how far places are from their three lines [m], (3, n - 4), and the reaches r [s^2] of these lines.

    `time` [s], (n,); `places` [m], (n, 3); the first two and the last two lack lines
    """
    lead, reach = straight_lines(time, places)
    return np.linalg.norm(places - lead, axis=2)[:, 2:-2], reach[:, 2:-2]


def _is_beyond(off: Floats, reach: Floats, noise: float, step: float) -> Booleans:
    """Return which places are off all lines by more than an acceleration and noise carry them."""
    bound = LEAST_LEAP + HARDEST_PULL * reach / 2 + BENDS * noise * np.maximum(1.0, reach / (2 * step**2))
    return np.asarray((off > bound).all(0))
