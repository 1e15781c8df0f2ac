"""Detect takes that share frames of one recording, since an error on fitted frames underestimates the held-out error.

A copy may have another name, clock and number of frames, lost or edited points, and rounded positions. It keeps most
point positions of a frame, and the order of its frames. `fit.recordings.filtered_copies` detects copies in which every
position has changed, by their noise.

Recordings of a motion that a machine repeats with less noise than `SAME_POSITION` count as copies.

Two recordings of a garment at rest have single positions in common by chance. With noise s of a coordinate, a position
lies within r of one of the other's in about (r / s)^3 / 5.6 of the frames. Such frames have no order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from fit.recordings.filtered_copies import AT_REST, MOST_NOISE_LEFT, SAME_POSITION, Motion, noise_left
from formats.arrays import Booleans, Floats, Integers
from formats.sights import on_held_edge
from formats.take import Take

MOST_COMPARED = 12  # points compared at most: more cost time and add little
MOST_STEP = 10  # frames between shared frames at most: a copy may keep one frame in ten
FEWEST_SHARED = 10  # shared frames in order at least: fewer hardly affect the held-out error
MOST_SHARED = 0.2  # of the informative frames: chance leaves none in order, and a copied part more
MOST_ASKED, RUN = 2000, 20  # frames of a long take, in runs: they estimate a share of a fifth to one per cent


@dataclass(frozen=True)
class _Tree:
    """Search tree of one point's distinct positions, with the first and the last frame of each."""

    tree: KDTree
    first: Integers
    last: Integers


class Track:
    """Positions of a take's free points, for the comparison with another take of the garment."""

    def __init__(self, take: Take) -> None:
        self.free = np.flatnonzero(~on_held_edge(take.garment))
        self.positions = take.points
        self.seen = np.asarray(take.points_valid & np.isfinite(take.points).all(2))
        self.counts: Integers = self.seen.sum(0)
        self.motion = Motion(take.time, self.positions, self.seen)
        self._trees: dict[int, _Tree] = {}

    def tree(self, point: int) -> _Tree:
        """Return the distinct positions of one observed point."""
        if point not in self._trees:
            rows = np.flatnonzero(self.seen[:, point])
            different, at = np.unique(self.positions[rows, point], axis=0, return_inverse=True)
            first, last = np.full(len(different), len(self.seen)), np.zeros(len(different), int)
            np.minimum.at(first, at.ravel(), rows)
            np.maximum.at(last, at.ravel(), rows)
            self._trees[point] = _Tree(KDTree(different), first, last)
        return self._trees[point]

    @cached_property
    def informative(self) -> Integers:
        """Informative frames, sampled in a long take: the cloth has moved, and the take does not repeat the frame."""
        points = _best_seen(self.free, self.counts)
        if not len(points):
            return np.zeros(0, int)
        first = self.positions[np.argmax(self.seen[:, points], 0), points]
        away = np.linalg.norm(self.positions[:, points] - first, axis=2)
        moved = np.flatnonzero((self.seen[:, points] & (away > AT_REST)).any(1))
        if len(moved) > MOST_ASKED:
            begins = np.linspace(0, len(moved) - RUN, MOST_ASKED // RUN).astype(int)
            moved = moved[np.unique(begins[:, None] + np.arange(RUN))]
        return moved[_equal_frames(self, self, moved, points) < 0]


def are_copies(one: Track, other: Track) -> bool:
    """Return whether two takes of a garment share frames of one recording."""
    if share_positions(one, other):
        return True
    return noise_left(one.motion, other.motion, _best_seen_in(one, other)) < MOST_NOISE_LEFT


def share_positions(one: Track, other: Track) -> bool:
    """Return whether two takes of a garment share frames of one recording with unchanged positions."""
    points = _best_seen_in(one, other)
    return max(_share(one, other, points), _share(other, one, points)) >= MOST_SHARED


def _best_seen_in(one: Track, other: Track) -> Integers:
    return _best_seen(one.free, np.minimum(one.counts, other.counts))


def _best_seen(free: Integers, counts: Integers) -> Integers:
    """Return the most frequently observed free points, at most `MOST_COMPARED`."""
    best = free[np.argsort(counts[free], kind="stable")[::-1][:MOST_COMPARED]]
    return np.asarray(best[counts[best] > 0])


def _share(one: Track, other: Track, points: Integers) -> float:
    """Return the share of a take's informative frames that the other take contains in the same order."""
    found = _equal_frames(one, other, one.informative, points)
    met = one.informative[found >= 0]
    steps = np.diff(found[found >= 0])
    follows = (steps > 0) & (steps <= MOST_STEP) & (np.diff(met) <= MOST_STEP)
    shared = int(np.count_nonzero(follows))
    return shared / len(one.informative) if shared >= FEWEST_SHARED else 0.0


def _equal_frames(one: Track, other: Track, rows: Integers, points: Integers) -> Integers:
    """Return for frames of a take, (rows,), an equal frame of the other take; -1 for none.

    If both takes are the same, it is another frame. Each point proposes the frame with its nearest position. Two frames
    are equal if most of their common points have equal positions.
    """
    best, most = np.full(len(rows), -1), np.zeros(len(rows), int)
    for point in points:
        asked = np.flatnonzero(one.seen[rows, point])
        frames = rows[asked]
        proposed = _nearest_frames(
            other.tree(int(point)), one.positions[frames, point], frames if one is other else None
        )
        both: Booleans = one.seen[frames][:, points] & other.seen[proposed][:, points]
        apart = np.abs(one.positions[frames][:, points] - other.positions[proposed][:, points])
        count = (both & (apart <= SAME_POSITION).all(2)).sum(1)
        better = (2 * count > both.sum(1)) & (count > most[asked])
        if one is other:
            better &= proposed != frames
        best[asked[better]], most[asked[better]] = proposed[better], count[better]
    return best


def _nearest_frames(known: _Tree, positions: Floats, own: Integers | None) -> Integers:
    """Return the frame of the nearest known position for each query position [m], (n, 3).

    own, (n,): the frames of the queries, which are excluded if the queries are among the known positions
    """
    if own is None:
        return np.asarray(known.first[known.tree.query(positions)[1]])
    same, next_one = np.minimum(known.tree.query(positions, k=2)[1].T, len(known.first) - 1)
    again = np.where(known.first[same] == own, known.last[same], known.first[same])
    return np.asarray(np.where(again == own, known.first[next_one], again))
