"""Find single places that leap away from a path and back, as a wrong marker or a wrong pose makes them.

A place at t[k] is held against the straight line between those before and after it, h1 and h2 seconds away. An
acceleration a leaves it a h1 h2 / 2 beside that line.

A place at the end of a path has none after it. The straight line through the two places before leads to another one,
h1 and h2 seconds later. An acceleration a carries a place so far from there:

    |z2 - z1 - (z1 - z0) h2 / h1|  >  noise + a h2 (h1 + h2) / 2
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats
from formats.errors import ImplausibleError
from formats.meant_units import step_or_anyway
from formats.motion import HARDEST_PULL

MOST_STRAYS = 0.05  # of all instants: of more, the whole path is another, or of another unit, as other checks tell
NOISE = 0.03  # m beside that: corners that cameras saw are some centimetres off


def straight_lines(time: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Return where three straight lines lead, (3, n, ...), NaN without one, and their reaches r [s^2], (3, n).

    They go between the places before and after, through the two before, and through the two after. An acceleration a
    leaves a place a r / 2 off its line.

    - `time` [s], (n,), increasing; `path`, (n, ...), of any unit
    """
    lead, reach = np.full((3, *path.shape), np.nan), np.ones((3, len(time)))
    step = np.diff(time)
    wide = step.reshape(-1, *[1] * (path.ndim - 1))
    slope = np.diff(path, axis=0) / wide
    lead[0, 1:-1] = path[:-2] + (path[2:] - path[:-2]) * wide[:-1] / (wide[:-1] + wide[1:])
    lead[1, 2:] = path[1:-1] + slope[:-1] * wide[1:]
    lead[2, :-2] = path[1:-1] - slope[1:] * wide[:-1]
    before, after = step[:-1], step[1:]
    reach[0, 1:-1] = before * after
    reach[1, 2:] = after * (before + after)
    reach[2, :-2] = before * (before + after)
    return lead, reach


def leaps_ahead(time: Floats, places: Floats) -> Booleans:
    """Return which coordinates leap from the two before as no cloth does, (frames - 2, ...); none that was not seen.

    `time` [s], (frames,), increasing; `places` [m], (frames, ...), NaN where not seen
    """
    before, after = (part.reshape(-1, *[1] * (places.ndim - 1)) for part in (np.diff(time)[:-1], np.diff(time)[1:]))
    ways = np.diff(places, axis=0)
    beside = np.abs(ways[1:] - ways[:-1] * after / before)
    return np.asarray(beside > NOISE + HARDEST_PULL * after * (before + after) / 2)


def refuse_strays(
    time: Floats, ends: Floats, where: object, *, one: str, advice: str, offers_anyway: bool = False
) -> None:
    """Refuse held ends of which one leaps away from its path for a single instant.

    - `time` [s], (n,), increasing; `ends` [m], (n, 2, 3), NaN where not seen
    - `one`: the word for an instant; `advice`: what to do about it

    Raises:
        ImplausibleError: names how many leap, and the first one, when and how far.
    """
    found = dict[int, float]()
    for end in range(2):
        seen = np.flatnonzero(np.isfinite(ends[:, end]).all(1))
        if len(seen) < 3:
            continue
        instants, places = time[seen], ends[seen, end]
        lead, reach = straight_lines(instants, places)
        beside = np.linalg.norm(places - lead[0], axis=1)[1:-1]
        across = np.linalg.norm(places[2:] - places[:-2], axis=1)
        for k in np.flatnonzero((beside > NOISE + HARDEST_PULL * reach[0, 1:-1] / 2) & (beside > across)):
            place = int(seen[1 + k])
            found[place] = max(found.get(place, 0.0), float(beside[k]))
    if not found or len(found) > MOST_STRAYS * len(time):
        return
    first = min(found)
    what = f"1 {one} leaps" if len(found) == 1 else f"{len(found)} {one}s leap"
    raise ImplausibleError(
        f"{what} away from the held edge's path and back, first number {first + 1} at {time[first] - time[0]:.2f} s, "
        f"by {found[first]:.2g} m", where=where, advice=step_or_anyway(advice, offers_anyway),
    )  # fmt: skip
