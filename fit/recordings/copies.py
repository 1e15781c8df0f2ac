"""Know takes that hold frames of one recording: to judge on frames that were fitted to would flatter the fit.

A copy may have another name, clock and number of frames, lost or edited points, and rounded places. It keeps most
places of a frame's points, and the order of its frames. `fit.recordings.filtered_copies` knows copies whose every place
has changed, by their noise.

Recordings of a motion that a machine repeats with less noise than `SAME_PLACE` count as copies.

Two recordings of a garment at rest have single places in common by chance. With noise s of a coordinate, a place lies
within r of one of the other's in about (r / s)^3 / 5.6 of the frames. Such frames have no order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from fit.recordings.filtered_copies import AT_REST, MOST_LEFT, SAME_PLACE, Motion, noise_left
from formats.arrays import Booleans, Floats, Integers
from formats.sights import on_held_edge
from formats.take import Take

MOST_POINTS = 12  # that are compared: more cost time and tell little more
MOST_STEP = 10  # frames from one shared frame to the next: a copy may keep one frame in ten
FEWEST_SHARED = 10  # steps from one shared frame to the next: fewer do not flatter a fit
MOST_SHARED = 0.2  # of the frames that tell something: chance leaves none in order, a copied piece more
MOST_ASKED, RUN = 2000, 20  # frames of a long take, in runs of so many: as many tell a fifth of them to one per cent


@dataclass(frozen=True)
class _Tree:
    """The different places of one point: the tree of them, and the first and the last frame of each."""

    tree: KDTree
    first: Integers
    last: Integers


class Track:
    """The places of a take's free points, to be compared with those of another take of the garment."""

    def __init__(self, take: Take) -> None:
        self.free = np.flatnonzero(~on_held_edge(take.garment))
        self.places = take.points
        self.seen = np.asarray(take.points_valid & np.isfinite(take.points).all(2))
        self.counts: Integers = self.seen.sum(0)
        self.motion = Motion(take.time, self.places, self.seen)
        self._trees: dict[int, _Tree] = {}

    def tree(self, point: int) -> _Tree:
        """Return the different places of a point that was seen."""
        if point not in self._trees:
            rows = np.flatnonzero(self.seen[:, point])
            different, at = np.unique(self.places[rows, point], axis=0, return_inverse=True)
            first, last = np.full(len(different), len(self.seen)), np.zeros(len(different), int)
            np.minimum.at(first, at.ravel(), rows)
            np.maximum.at(last, at.ravel(), rows)
            self._trees[point] = _Tree(KDTree(different), first, last)
        return self._trees[point]

    @cached_property
    def telling(self) -> Integers:
        """The frames, of a long take some, in which the cloth has moved and that do not come again in the take."""
        points = _best_seen(self.free, self.counts)
        if not len(points):
            return np.zeros(0, int)
        first = self.places[np.argmax(self.seen[:, points], 0), points]
        away = np.linalg.norm(self.places[:, points] - first, axis=2)
        moved = np.flatnonzero((self.seen[:, points] & (away > AT_REST)).any(1))
        if len(moved) > MOST_ASKED:
            begins = np.linspace(0, len(moved) - RUN, MOST_ASKED // RUN).astype(int)
            moved = moved[np.unique(begins[:, None] + np.arange(RUN))]
        return moved[_partners(self, self, moved, points) < 0]


def are_copies(one: Track, other: Track) -> bool:
    """Whether two takes of a garment hold frames of one recording."""
    if share_places(one, other):
        return True
    return noise_left(one.motion, other.motion, _best_seen_in(one, other)) < MOST_LEFT


def share_places(one: Track, other: Track) -> bool:
    """Whether two takes of a garment hold frames of one recording whose places are the same."""
    points = _best_seen_in(one, other)
    return max(_share(one, other, points), _share(other, one, points)) >= MOST_SHARED


def _best_seen_in(one: Track, other: Track) -> Integers:
    return _best_seen(one.free, np.minimum(one.counts, other.counts))


def _best_seen(free: Integers, counts: Integers) -> Integers:
    """Return the free points that were seen in most frames, at most `MOST_POINTS`."""
    best = free[np.argsort(counts[free], kind="stable")[::-1][:MOST_POINTS]]
    return np.asarray(best[counts[best] > 0])


def _share(one: Track, other: Track, points: Integers) -> float:
    """Return the share of the frames of a take that tell something which the other has in its order."""
    found = _partners(one, other, one.telling, points)
    met = one.telling[found >= 0]
    steps = np.diff(found[found >= 0])
    follows = (steps > 0) & (steps <= MOST_STEP) & (np.diff(met) <= MOST_STEP)
    shared = int(np.count_nonzero(follows))
    return shared / len(one.telling) if shared >= FEWEST_SHARED else 0.0


def _partners(one: Track, other: Track, rows: Integers, points: Integers) -> Integers:
    """Return for frames of a take, (rows,), a frame of the other, or another of its own, with its places; -1 for none.

    Each point proposes the frame in which it was nearest. A frame is the same where most of the points that both show
    are at their places.
    """
    best, most = np.full(len(rows), -1), np.zeros(len(rows), int)
    for point in points:
        asked = np.flatnonzero(one.seen[rows, point])
        frames = rows[asked]
        proposed = _proposed(other.tree(int(point)), one.places[frames, point], frames if one is other else None)
        both: Booleans = one.seen[frames][:, points] & other.seen[proposed][:, points]
        apart = np.abs(one.places[frames][:, points] - other.places[proposed][:, points])
        count = (both & (apart <= SAME_PLACE).all(2)).sum(1)
        better = (2 * count > both.sum(1)) & (count > most[asked])
        if one is other:
            better &= proposed != frames
        best[asked[better]], most[asked[better]] = proposed[better], count[better]
    return best


def _proposed(known: _Tree, places: Floats, own: Integers | None) -> Integers:
    """Return the frame of the nearest of the known places for each of some, (n, 3) [m].

    own: the frames of the places themselves where they are among the known ones, (n,): others are wanted
    """
    if own is None:
        return np.asarray(known.first[known.tree.query(places)[1]])
    same, next_one = np.minimum(known.tree.query(places, k=2)[1].T, len(known.first) - 1)
    again = np.where(known.first[same] == own, known.last[same], known.first[same])
    return np.asarray(np.where(again == own, known.first[next_one], again))
