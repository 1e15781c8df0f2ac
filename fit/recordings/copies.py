"""Know takes that hold frames of one recording: to judge on frames that were fitted to would flatter the fit.

A copy may have another name, clock and number of frames, lost or edited points, and rounded places. It keeps most
places of a frame's points, and the order of its frames.

Two recordings of a garment at rest have single places in common by chance. With noise s of a coordinate, a place lies
within r of one of the other's in about (r / s)^3 / 5.6 of the frames. Such frames have no order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from fit.recordings.held_edge import is_held
from formats.arrays import Booleans, Floats, Integers
from formats.take import Take

# m in each axis. Exports round to 0.1 mm, and archives to 0.1 mm at most: half a step of each.
# No two of sixteen recordings of one cloth share ten frames in order within 5 mm.
SAME_PLACE = 1.0e-4
AT_REST = 0.01  # m from its first place: a fit learns next to nothing there, and made takes may start with one noise
MOST_POINTS = 12  # that are compared: more cost time and tell little more
MOST_STEP = 10  # frames from one shared frame to the next: a copy may keep one frame in ten
FEWEST_SHARED = 10  # shared ones, in order: fewer do not flatter a fit
MOST_SHARED = 0.1  # of the frames that tell something: chance leaves none in order, a copied piece more


@dataclass(frozen=True)
class _Frames:
    """The free points of a take.

    places: (frames, points, 3), m; seen: (frames, points), of at least one point in each frame
    """

    places: Floats
    seen: Booleans


def are_copies(one: Take, other: Take) -> bool:
    """Whether two takes of a garment hold frames of one recording."""
    flat = np.array([point.at_m for point in one.garment.points]).reshape(-1, 2)
    free = np.flatnonzero(~is_held(one.garment, flat))
    both_seen = [int(min(one.points_valid[:, at].sum(), other.points_valid[:, at].sum())) for at in free]
    chosen = free[np.argsort(both_seen, kind="stable")[::-1][:MOST_POINTS]]
    first, second = _frames(one, chosen), _frames(other, chosen)
    return max(_share(first, second), _share(second, first)) >= MOST_SHARED


def _frames(take: Take, chosen: Integers) -> _Frames:
    places = take.points[:, chosen]
    seen = np.asarray(take.points_valid[:, chosen] & np.isfinite(places).all(2))
    shown = seen.any(1)
    return _Frames(places[shown], seen[shown])


def _share(one: _Frames, other: _Frames) -> float:
    """Return the share of the frames of a take that tell something which the other has in its order.

    Frames that come again in the take, and those of cloth that has not moved yet, tell nothing.
    """
    if not len(one.seen) or not len(other.seen):
        return 0.0
    first = one.places[np.argmax(one.seen, 0), np.arange(one.seen.shape[1])]
    moved = (one.seen & (np.linalg.norm(one.places - first, axis=2) > AT_REST)).any(1)
    telling = np.flatnonzero(moved & (_partners(one, one, is_one_take=True) < 0))
    found = _partners(one, other)[telling]
    met = np.flatnonzero(found >= 0)
    steps = np.diff(found[met])
    follows = (steps > 0) & (steps <= MOST_STEP) & (np.diff(met) <= MOST_STEP)
    shared = int(np.count_nonzero(np.append(follows, False) | np.append(False, follows)))
    return shared / len(telling) if shared >= FEWEST_SHARED else 0.0


def _partners(one: _Frames, other: _Frames, *, is_one_take: bool = False) -> Integers:
    """Return for each frame of a take the frame of the other, or another of its own, with its places; -1 for none.

    Each point proposes the frame in which it was nearest. A frame is the same where most of the points that both show
    are at their places.
    """
    count = len(one.seen)
    best, most = np.full(count, -1), np.zeros(count, int)
    for at in range(one.seen.shape[1]):
        asked, there = np.flatnonzero(one.seen[:, at]), np.flatnonzero(other.seen[:, at])
        if len(there) < 1 + is_one_take:
            continue
        tree = KDTree(other.places[there, at])
        reach, near = tree.query(one.places[asked, at], k=1 + is_one_take, p=np.inf, distance_upper_bound=SAME_PLACE)
        if is_one_take:
            own = there[np.minimum(near, len(there) - 1)] == asked[:, None]
            column = own[:, 0].astype(int)  # of two that are equally near, either may come first
            rows = np.arange(len(asked))
            reach, near = reach[rows, column], near[rows, column]
        near_enough = np.isfinite(reach)
        asked, proposed = asked[near_enough], there[near[near_enough]]
        both = one.seen[asked] & other.seen[proposed]
        same = both & (np.abs(one.places[asked] - other.places[proposed]) <= SAME_PLACE).all(2)
        points = same.sum(1)
        better = (2 * points > both.sum(1)) & (points > most[asked])
        best[asked[better]], most[asked[better]] = proposed[better], points[better]
    return best
