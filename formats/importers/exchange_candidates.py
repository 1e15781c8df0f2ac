"""Find the frames in which markers may have exchanged their labels: each label goes on where another one's path leads.

Two rules predict where a path goes on. Both are exact for constant acceleration:

- **From a frame on**: the two positions before it, and the two from it on, lead to one place halfway between. So label
  `j` misses the path of label `k` by `d = |b + (v + u) h / 2 - a|`. `b` and `v` are the path's last position and its
  velocity, `a` and `u` the label's next ones, and `h` is the time between them.
- **In one frame alone**: the cubic through the two positions before it and the two behind it.

A label leaps where it misses its own path by more than `LEAST_LEAP` and `LEAPS` times what is usual. It may go on with
the nearest path whose own label leaps too, if it misses that path by less. Labels that form a cycle by these rules may
have exchanged their markers. The rules let much honest motion pass, and `exchange_evidence` weighs what they find.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from formats.arrays import Booleans, Floats, Indices, Integers
from formats.importers.exchange_evidence import LED_OVER, Exchanges, Sights

LEAST_LEAP = 0.005  # m; our choice: markers of cloth have diameters of 6 mm or more, and their centres are as far apart
LEAPS = 2.0  # times the usual; our choice: the evidence that counts needs twice as much
# Noise of the two predictions over the noise of a row. Their weights are 0.5, 1.5, 1.5, 0.5, and 1, 4, 6, 4, 1 over 6.
NOISE_ON, NOISE_ALONE = 2.24, 1.39
NEARER = 1.3  # times; our choice: the evidence is what tells, and 1 would weigh four times as many
MISSED_BY_MORE = 2.0  # times; our choice: beyond, no return of a sure exchange has evidence
MOST_PAIRS = 1 << 14  # leaping labels squared, in one frame; our choice: bounds time, and garments have fewer
LABEL_PAIRS_AT_ONCE = 1 << 14  # our choice: bounds memory, and no result depends on it
NO_PATH = -1  # of a label that goes on with no other path


class _Side(NamedTuple):
    """The two positions next to each frame on one side, (frames, markers, 3), and their times [usual steps]."""

    near: Floats
    far: Floats
    near_time: Floats
    far_time: Floats

    def velocity(self) -> Floats:
        """Return the velocity between them [m/step], NaN where one is missing."""
        return np.asarray((self.near - self.far) / (self.near_time - self.far_time)[..., None])


class Joins:
    """Where each path leads from before a frame, and each label from that frame on."""

    def __init__(self, sights: Sights) -> None:
        self.before, self.behind = _before(sights), _behind(sights, 0)
        with np.errstate(all="ignore"):  # of places without a position, and of damaged numbers
            self.pace, self.back = self.before.velocity(), self.behind.velocity()

    def missed(self, frame: Integers, label: Integers, path: Integers) -> Floats:
        """Return by how much labels miss the paths of labels from frames on [m]; all of one shape."""
        with np.errstate(all="ignore"):
            of_path, of_label = self.pace[frame, path], self.back[frame, label]
            both = np.where(np.isnan(of_path), of_label, of_path) + np.where(np.isnan(of_label), of_path, of_label)
            halfway = (self.behind.near_time[frame, label] - self.before.near_time[frame, path])[..., None] / 2
            off = self.before.near[frame, path] + np.nan_to_num(both) * halfway - self.behind.near[frame, label]
            return np.asarray(np.linalg.norm(off, axis=-1))

    def are_near(self, found: Exchanges) -> Booleans:
        """Return whether no label of exchanges misses the other path by much more than its own, (exchanges,)."""
        own = self.missed(found.frame, found.label, found.label)
        return ~found.any_of(~(self.missed(found.frame, found.label, found.path) < MISSED_BY_MORE * own))


def candidates(sights: Sights) -> Iterator[tuple[Exchanges, tuple[int, ...]]]:
    """Yield the exchanges that the predictions let pass, and how many frames may have them, 0 for all from one on."""
    yield _from_on(sights), (0, 2)
    yield _alone(sights), (1,)


def _from_on(sights: Sights) -> Exchanges:
    """Return the exchanges from a frame on."""
    joins = Joins(sights)
    frame, label = _all_of(sights)
    own = joins.missed(frame, label, label)
    leaping = own > np.maximum(LEAST_LEAP, LEAPS * NOISE_ON * sights.usual)
    leaping &= (leaping & sights.are_seen()).any(1)[:, None]
    return _cycles(leaping, own, joins.missed)


def _alone(sights: Sights) -> Exchanges:
    """Return the exchanges in one frame alone."""
    before, behind = _before(sights), _behind(sights, 1)
    times = [before.far_time, before.near_time, behind.near_time, behind.far_time]
    places = [before.far, before.near, behind.near, behind.far]
    now, across = sights.time[:, None], np.zeros(sights.positions.shape)
    with np.errstate(all="ignore"):  # of places without a position, and of damaged numbers
        for k, (time, place) in enumerate(zip(times, places, strict=True)):
            weight = np.prod([(now - one) / (time - one) for j, one in enumerate(times) if j != k], axis=0)
            across += weight[..., None] * place

    def missed(frame: Integers, label: Integers, path: Integers) -> Floats:
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.norm(sights.positions[frame, label] - across[frame, path], axis=-1))

    frame, label = _all_of(sights)
    own = missed(frame, label, label)
    return _cycles(own > np.maximum(LEAST_LEAP, LEAPS * NOISE_ALONE * sights.usual), own, missed)


def _all_of(sights: Sights) -> tuple[Integers, Integers]:
    """Return the frame and the label of each position, both (frames, markers)."""
    frame, label = np.indices(sights.usual.shape)
    return np.asarray(frame, np.int64), np.asarray(label, np.int64)


def _before(sights: Sights) -> _Side:
    """Return the two positions before each frame, NaN where they are too far before it."""
    frames, which = len(sights.time), np.arange(sights.positions.shape[1])
    near = sights.before[:frames]
    return _side(sights, near, np.where(near >= 0, sights.before[near, which], -1))


def _behind(sights: Sights, ahead: int) -> _Side:
    """Return the two positions behind each frame, its own among them if not `ahead`; NaN where they are too far."""
    frames, which = len(sights.time), np.arange(sights.positions.shape[1])
    near = sights.behind[ahead : frames + ahead]
    far = sights.behind[np.minimum(near + 1, frames), which]
    return _side(sights, np.where(near < frames, near, -1), np.where(far < frames, far, -1))


def _side(sights: Sights, near: Indices, far: Indices) -> _Side:
    """Return the positions of the frames `near` and `far`, -1 where there is none."""
    found, now = list[Floats](), np.arange(len(sights.time))[:, None]
    for at in (near, far):
        is_near = (at >= 0) & (np.abs(at - now) <= LED_OVER)
        found.append(np.where(is_near[..., None], sights.positions[at, np.arange(at.shape[1])], np.nan))
    return _Side(found[0], found[1], sights.time[near], sights.time[far])


def _cycles(leaping: Booleans, own: Floats, missed: Callable[[Integers, Integers, Integers], Floats]) -> Exchanges:
    """Return the exchanges among the labels that leap.

    - `leaping`: which labels do; `own`: by how much each misses its own path [m]; both (frames, markers)
    - `missed`: returns by how much labels miss the paths of labels [m], from frames, labels, paths of one shape
    """
    count = leaping.sum(1)
    leaping[(count < 2) | (count**2 > MOST_PAIRS)] = False
    went = np.full(leaping.shape, NO_PATH, np.int32)
    frame, label = np.nonzero(leaping)
    first = np.searchsorted(frame, frame)
    pairs = np.searchsorted(frame, frame, side="right") - first
    begin = 0
    for end in _parts(pairs):
        some, width = np.arange(begin, end), pairs[begin:end]
        one, start = np.repeat(some, width), np.cumsum(width) - width
        other = np.arange(len(one)) + np.repeat(first[begin:end] - start, width)
        far = missed(frame[one], label[one], label[other])
        far[(other == one) | np.isnan(far)] = np.inf
        least = np.minimum.reduceat(far, start)
        is_fit = NEARER * least < own[frame[some], label[some]]
        fit = np.flatnonzero((far == np.repeat(least, width)) & np.repeat(is_fit, width))
        went[frame[one[fit]], label[one[fit]]] = label[other[fit]]
        begin = end
    _keep_cycles(went)
    return _numbered(went)


def _parts(pairs: Integers) -> list[int]:
    """Return the ends of stretches of at most `LABEL_PAIRS_AT_ONCE` pairs, or of one label."""
    total = np.cumsum(pairs)
    ends, done = list[int](), 0
    while done < len(pairs):
        before = total[done - 1] if done else 0
        done = max(int(np.searchsorted(total, before + LABEL_PAIRS_AT_ONCE, side="right")), done + 1)
        ends.append(done)
    return ends


def _keep_cycles(went: Indices) -> None:
    """Drop all labels that form no cycle."""
    rows = np.flatnonzero((went != NO_PATH).any(1))
    paths = went[rows]
    while True:
        row, label = np.nonzero(paths != NO_PATH)
        path = paths[row, label]
        taken = np.bincount(row * paths.shape[1] + path, minlength=paths.size).reshape(paths.shape)
        is_loose = (paths[row, path] == NO_PATH) | (taken[row, path] != 1)
        if not is_loose.any():
            break
        paths[row[is_loose], label[is_loose]] = NO_PATH
    went[rows] = paths


def _numbered(went: Indices) -> Exchanges:
    """Return the cycles, each numbered by its frame and its first label."""
    frame, label = np.nonzero(went != NO_PATH)
    path, markers = went[frame, label].astype(np.int64), went.shape[1]
    place = np.zeros(went.shape, np.int64)
    place[frame, label] = np.arange(len(frame))
    following, first = place[frame, path], label.astype(np.int64)
    while (lower := np.minimum(first, first[following])).tobytes() != first.tobytes():
        first = lower
    return Exchanges(frame, label, path, np.unique(frame * markers + first, return_inverse=True)[1])
