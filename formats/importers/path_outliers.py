"""Find isolated outliers of a path: positions that jump away and back, as from a mislabelled marker or a wrong pose.

The position at t[k] is compared with the straight line between the positions before and after it, h1 and h2 seconds
away. An acceleration a moves the position a h1 h2 / 2 off that line.

The last position of a path has none after it. The straight line through the two positions before it is extrapolated, h1
and h2 seconds later. An acceleration a moves the position off the extrapolation by a h2 (h1 + h2) / 2. So a coordinate
z2 jumps where

    |z2 - z1 - (z1 - z0) h2 / h1|  >  noise + a h2 (h1 + h2) / 2
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats
from formats.errors import ImplausibleError
from formats.meant_units import step_or_anyway
from formats.motion import HARDEST_PULL

LARGEST_OUTLIER_SHARE = 0.05  # of all instants: more mean a wrong path or unit, which other checks report
NOISE = 0.03  # m: camera positions of corners are off by some centimetres


def straight_lines(time: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Return the positions that three straight lines predict, (3, n, ...), and r [s^2] of each line, (3, n).

    A position is NaN where a line does not exist. The lines interpolate between the positions before and after, and
    extrapolate the two before and the two after. An acceleration a moves a position a r / 2 off its line.

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


def are_jumps(time: Floats, positions: Floats) -> Booleans:
    """Return which coordinates jump from the extrapolation of the two before, (frames - 2, ...).

    A jump takes a harder acceleration than cloth has. Coordinates that were not seen are no jumps.

    `time` [s], (frames,), increasing; `positions` [m], (frames, ...), NaN where not seen
    """
    before, after = (part.reshape(-1, *[1] * (positions.ndim - 1)) for part in (np.diff(time)[:-1], np.diff(time)[1:]))
    ways = np.diff(positions, axis=0)
    beside = np.abs(ways[1:] - ways[:-1] * after / before)
    return np.asarray(beside > NOISE + HARDEST_PULL * after * (before + after) / 2)


def refuse_jumps(
    time: Floats, ends: Floats, where: object, *, one: str, advice: str, offers_anyway: bool = False
) -> None:
    """Refuse a path of held ends of which some jump away and back for a single instant.

    - `time` [s], (n,), increasing; `ends` [m], (n, 2, 3), NaN where not seen
    - `one`: the noun for an instant, such as frame; `advice`: the next step in the error
    - `offers_anyway`: the command has the option --anyway, which the error then names

    Raises:
        ImplausibleError: names how many instants jump, and the number, time and distance of the first.
    """
    found = dict[int, float]()
    for end in range(2):
        seen = np.flatnonzero(np.isfinite(ends[:, end]).all(1))
        if len(seen) < 3:
            continue
        instants, positions = time[seen], ends[seen, end]
        lead, reach = straight_lines(instants, positions)
        beside = np.linalg.norm(positions - lead[0], axis=1)[1:-1]
        across = np.linalg.norm(positions[2:] - positions[:-2], axis=1)
        for k in np.flatnonzero((beside > NOISE + HARDEST_PULL * reach[0, 1:-1] / 2) & (beside > across)):
            place = int(seen[1 + k])
            found[place] = max(found.get(place, 0.0), float(beside[k]))
    if not found or len(found) > LARGEST_OUTLIER_SHARE * len(time):
        return
    first = min(found)
    what = f"1 {one} jumps" if len(found) == 1 else f"{len(found)} {one}s jump"
    raise ImplausibleError(
        f"{what} away from the held edge's path and back, first number {first + 1} at {time[first] - time[0]:.2f} s, "
        f"by {found[first]:.2g} m", where=where, advice=step_or_anyway(advice, offers_anyway),
    )  # fmt: skip
