"""Take out single places of a marker that leap away from its path and back, as lost bytes and wrong labels make them.

Three straight lines lead to a place: between those before and after, through the two before, and through the two after.
It leaps where it is farther from each of them than an acceleration and noise carry it:

    |z - line|  >  LEAST_LEAP + HARDEST_PULL r / 2 + BENDS q max(1, r / 2 h^2)
    r  =  h1 h2 between two,  h1 (h1 + h2) ahead of two

It comes back where its neighbours are nearer to each other than it is to the line between them.

- `h1`, `h2`: the steps of time; `h`: the median step
- `q`: half of the places of that marker are no farther than that from the nearest of their lines

No cloth does that. At 100 frames a second, 50 mm off two places ahead takes 500 m/s^2, and at 20
frames 20 m/s^2. Cloth that is flicked may reach the second, so the bound grows with the step. It is
65 mm at 100 frames and 0.43 m at 20, which takes 170 m/s^2, and 6 m at 5 frames. So the rule holds
at every rate, and finds less at low ones and behind gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.importers.number_cells import LONGEST_SHOWN
from formats.importers.strays import straight_lines
from formats.motion import HARDEST_PULL

LEAST_LEAP = 0.05  # m, stated by us: two diameters of a marker; lost bytes leave most places farther off
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
    found = list[tuple[int, int, float]]()
    for marker in range(places.shape[1]):
        leaps, far = _leaps_of(time, places[:, marker])
        places[leaps, marker] = np.nan
        found += [(frame, marker, off) for frame, off in zip(leaps.tolist(), far.tolist(), strict=True)]
    if not found:
        return ""
    frame, marker, off = min(found)
    label, far_off = labels[marker].strip()[:LONGEST_SHOWN], f"{off:.2g}" if off < 10 else f"{off:.0f}"
    if len(found) == 1:
        return f"{where(frame)}: {label} leaps {far_off} m away and back, so it counts as not seen there"
    return (
        f"{len(found)} places leap away and back, first {label} in {where(frame)} by {far_off} m, so they count as not "
        "seen"
    )


def _leaps_of(time: Floats, path: Floats) -> tuple[Integers, Floats]:
    """Return the frames in which a path [m], (frames, 3), leaps, and how far [m] from between its neighbours."""
    seen = np.flatnonzero(np.isfinite(path).all(1))
    none = np.zeros(0, int), np.zeros(0)
    instants, places, step = time[seen], path[seen], float(np.median(np.diff(time)))
    # Most markers never go so far in a step.
    if len(seen) < FEWEST_PLACES or np.abs(np.diff(places, axis=0)).max() < LEAST_LEAP / 2:
        return none
    off, reach = _beside_lines(instants, places)
    noise = float(np.median(off.min(0)))
    leaps = 2 + np.flatnonzero(_is_beyond(off, reach, noise, step))
    good = np.setdiff1d(np.arange(len(seen)), leaps)
    kept, far = list[int](), list[float]()
    for k in leaps.tolist():  # by others that leap, a place between may seem to leap as well
        at = int(np.searchsorted(good, k))
        if not 2 <= at <= len(good) - 2:
            continue
        some = np.array([*good[at - 2 : at], k, *good[at : at + 2]])
        off, reach = _beside_lines(instants[some], places[some])
        across = float(np.linalg.norm(places[some[3]] - places[some[1]]))
        if _is_beyond(off, reach, noise, step)[0] and off[0, 0] > across:
            kept.append(int(seen[k]))
            far.append(float(off[0, 0]))
    return (np.array(kept, int), np.array(far)) if len(kept) <= max(1, MOST_LEAPS * len(seen)) else none


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
