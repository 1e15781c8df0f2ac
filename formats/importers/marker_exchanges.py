"""Find markers whose labels are exchanged for some frames: each continues the path of another one.

`exchange_candidates` finds where labels go on near other markers' paths. `exchange_evidence` weighs each of these
exchanges by its evidence E, the logarithm of a ratio of likelihoods. Exchanges of the same labels count together where
the two largest E sum to more than `SURE_EXCHANGE`. The others of these labels then count from `WEAK_EXCHANGE` on, as
noise may hide an end. An exchange without a return counts from `WITHOUT_RETURN` on, as it may cost half of the file's
positions.

`benchmarks/exchanges.py` draws honest takes and takes with exchanges: none of 6000 honest ones has a false exchange. An
earlier set of draws chose the thresholds. In its first 6000 honest takes, 16 had exchanges with an E above 5, and none
above 8. No two exchanges of the same labels had a sum above 8.

Behind an exchange, the paths go on under the other labels until the next one. The name that a label's path has in most
frames counts as right. Positions under another name count as not seen.

Labels that are exchanged throughout the file leap nowhere, and those that are exchanged while a marker is hidden leap
unseen. `marker_neighbours` compares them with the garment.
"""

from __future__ import annotations

from bisect import bisect, insort
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers, Singles
from formats.importers.exchange_candidates import LEAST_LEAP, NOISE_ON, Joins, candidates
from formats.importers.exchange_evidence import LED_OVER, Exchanges, Sights, evidence
from formats.importers.number_cells import CELL_SHOWN
from formats.importers.path_roughness import POSITIONS_BESIDE, is_smooth, noise_of, roughness, usual_roughness
from formats.plain_text import MOST_LISTED, first_few

SURE_EXCHANGE, WITHOUT_RETURN, WEAK_EXCHANGE = 11.0, 13.0, 2.0  # E, see above
SOUGHT_EXCHANGE = 5.0  # E of an exchange whose return is sought; our choice: a return then makes it sure
MOST_SOUGHT = 50  # exchanges whose returns are sought; our choice: bounds time, and garments have fewer at once
LONGEST_WHOLE = 2  # frames of an exchange that is weighed as a whole
# m: a path that is smoother has no leap. A leap of 5 mm at an end of the file has half its roughness elsewhere.
LEAST_ROUGH_LEAP = LEAST_LEAP / (2 * NOISE_ON)
FEWEST_FRAMES = 5  # our choice: fewer do not show the usual distance
MARKER_POSITIONS_AT_ONCE = 1 << 13  # our choice: bounds memory, and no result depends on it
FEWEST_AT_ONCE = 64  # frames; our choice: fewer cost more time for those around them


@dataclass(frozen=True)
class _Exchange:
    """An exchange from a frame on, or in `length` frames: each label goes on with the path under another one."""

    frame: int
    length: int
    label: Integers
    path: Integers
    told: float  # E

    @property
    def names(self) -> frozenset[int]:
        """The labels."""
        return frozenset(self.label.tolist())


def remove_exchanged(time: Floats, positions: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Mark as not seen the positions that have another marker's label; return a warning of them, '' without any.

    - `time` [s], (frames,); `positions` [m], (frames, markers, 3), NaN where not seen
    - `labels`: the markers' names; `where`: returns the name of a frame's line or number in the file
    """
    seen = np.flatnonzero(np.isfinite(positions[..., 0]).any(0))
    if len(time) < FEWEST_FRAMES or len(seen) < 2 or not (np.diff(time) > 0).all():
        return ""
    steps = (time - time[0]) / np.median(np.diff(time))
    with np.errstate(over="ignore", invalid="ignore"):  # of damaged numbers
        seen = np.array([k for k in seen.tolist() if not is_smooth(steps, positions[:, k], LEAST_ROUGH_LEAP)], int)
    if len(seen) < 2:
        return ""
    turns = _paths(steps, positions, seen)
    frames, paths = [*turns, len(time)], np.array(list(turns.values()))
    usual = np.array([_usual_path(one, np.diff(frames)) for one in paths.T])
    told = list[str]()
    for part, exchanged in enumerate(paths != usual):
        markers, span = seen[exchanged], slice(frames[part], frames[part + 1])
        if not np.isfinite(positions[span, markers]).any():
            continue
        positions[span, markers] = np.nan
        names = first_few([labels[k].strip()[:CELL_SHOWN] for k in markers[:MOST_LISTED]], len(markers))
        told.append(f"{names} {_span(time, span.start, span.stop - 1, where)}")
    if not told:
        return ""
    return f"labels seem exchanged, so these count as not seen: {'; '.join(told[:MOST_LISTED])}{_more(told)}"


def _usual_path(paths: Integers, frames: Integers) -> int:
    """Return the path that a label has in most frames, the first one in half of them; both arguments (spans,)."""
    often = np.bincount(paths, frames)
    return int(paths[0] if 2 * often[paths[0]] >= frames.sum() else often.argmax())


def _span(time: Floats, first: int, last: int, where: Callable[[int], str]) -> str:
    """Return the name of a span of frames, and its seconds from the first frame on."""
    begin, end = (f"{time[at] - time[0]:.2f}" for at in (first, last))
    if first == last:
        return f"in {where(first)} ({begin} s)"
    return f"from {where(first)} to {where(last)} ({begin} to {end} s)"


def _more(told: list[str]) -> str:
    """Return how many spans are not listed."""
    return f" and {len(told) - MOST_LISTED} more times" if len(told) > MOST_LISTED else ""


def _paths(steps: Floats, positions: Floats, seen: Integers) -> dict[int, Integers]:
    """Return the path under each label, (markers seen,), from the first frame on, and from each one that changes it."""
    turns = defaultdict[int, list[tuple[Integers, Integers]]](list)
    for one in _counted(_exchanges(_Paths.of(steps, positions, seen))):
        turns[one.frame].append((one.label, one.path))
        if one.length and one.frame + one.length < len(steps):
            turns[one.frame + one.length].append((one.path, one.label))
    paths = {0: np.arange(len(seen))}
    for frame in sorted(turns):
        path = paths[next(reversed(paths))].copy()
        for label, before in turns[frame]:
            path[label] = path[before]
        paths[frame] = path
    return paths


@dataclass(frozen=True)
class _Paths:
    """All positions, and how rough their paths are.

    - `steps` [usual steps], (frames,); `positions` [m], (frames, markers, 3); `seen`: the markers that are looked at
    - `usual`, `rough`, `noise`: as in `Sights`
    """

    steps: Floats
    positions: Floats
    seen: Integers
    usual: Singles
    rough: Singles
    noise: Floats

    @classmethod
    def of(cls, steps: Floats, positions: Floats, seen: Integers) -> _Paths:
        """Return the paths of the markers `seen`."""
        usual = np.empty((len(steps), len(seen)), np.float32)
        rough, noise = np.full(usual.shape, np.nan, np.float32), np.zeros(len(seen))
        for k, marker in enumerate(seen.tolist()):
            with np.errstate(over="ignore", invalid="ignore"):  # of damaged numbers
                last, one = roughness(steps, positions[:, marker])
                usual[:, k] = usual_roughness(len(steps), (last, one))
                noise[k] = noise_of(steps, positions[:, marker], float(usual[:, k].min()))
                rough[last, k] = one / usual[last, k]
        return cls(steps, positions, seen, usual, rough, noise)

    def stretches(self) -> Iterator[tuple[int, Integers, Sights]]:
        """Yield the first frame of each stretch's sights, which frames of these are looked at, and the sights."""
        around = LED_OVER + LONGEST_WHOLE
        count = max(MARKER_POSITIONS_AT_ONCE // len(self.seen), FEWEST_AT_ONCE)
        for begin in range(0, len(self.steps), count):
            first = max(begin - around, 0)
            some = slice(first, begin + count + around)
            places = self.positions[some][:, self.seen]
            here = np.arange(begin, min(begin + count, len(self.steps))) - first
            yield first, here, Sights.of(self.steps[some], places, self.usual[some], self.rough[some], self.noise)


def _exchanges(paths: _Paths) -> list[_Exchange]:
    """Return all exchanges whose evidence exceeds `WEAK_EXCHANGE`, and returns of any evidence, the surest first."""
    found = list[_Exchange]()
    for first, here, sights in paths.stretches():
        for maybe, lengths in candidates(sights):
            told = np.array([evidence(sights, maybe, length) for length in lengths])
            order = np.argsort(maybe.cycle, kind="stable")
            ends = np.searchsorted(maybe.cycle[order], np.arange(maybe.count + 1))
            for k in np.flatnonzero(told.max(0, initial=-np.inf) > WEAK_EXCHANGE).tolist():
                which = order[ends[k] : ends[k + 1]]
                frame, best = int(maybe.frame[which[0]]), int(told[:, k].argmax())
                if here[0] <= frame <= here[-1]:
                    labels, of_paths = maybe.label[which], maybe.path[which]
                    found.append(_Exchange(first + frame, lengths[best], labels, of_paths, float(told[best, k])))
    return sorted(found + _returns(paths, found), key=lambda one: -one.told)


def _returns(paths: _Paths, found: list[_Exchange]) -> list[_Exchange]:
    """Return all exchanges from a frame on that are as likely as none, of labels that have an odd number of them."""
    of_names, returned = defaultdict[frozenset[int], list[_Exchange]](list), list[_Exchange]()
    for one in sorted(found, key=lambda one: -one.told):
        if not one.length:
            of_names[one.names].append(one)
    ways = [
        (some[0].label, some[0].path) for some in of_names.values() if len(some) % 2 and some[0].told > SOUGHT_EXCHANGE
    ]
    ways = ways[:MOST_SOUGHT]
    ways += [(path, label) for label, path in ways if len(label) > 2]
    for first, here, sights in paths.stretches() if ways else ():
        joins = Joins(sights)
        for label, path in ways:
            frames = here[joins.are_near(_in_each(here, label, path))]
            maybe = _in_each(frames, label, path)
            told = np.where(maybe.any_of(sights.are_seen()[maybe.frame, maybe.label]), evidence(sights, maybe, 0), 0.0)
            for k in np.flatnonzero(told > 0).tolist():
                returned.append(_Exchange(int(frames[k]) + first, 0, label, path, float(told[k])))
    return returned


def _in_each(frames: Integers, label: Integers, path: Integers) -> Exchanges:
    """Return one exchange from each of these frames on."""
    size, count = len(label), len(frames)
    return Exchanges(
        np.repeat(frames, size), np.tile(label, count), np.tile(path, count), np.repeat(np.arange(count), size)
    )


def _counted(found: list[_Exchange]) -> list[_Exchange]:
    """Return the exchanges that count, of all, the surest first."""
    free, of_names = defaultdict[int, list[tuple[int, int]]](list), defaultdict[frozenset[int], list[_Exchange]](list)
    for one in found:
        if all(_are_apart(one, free[name]) for name in one.names):
            of_names[one.names].append(one)
            for name in one.names:
                insort(free[name], (one.frame, one.length))
    counted = list[_Exchange]()
    for some in of_names.values():
        if sum(one.told for one in some[:2]) < SURE_EXCHANGE:
            continue
        told = [one for one in some if one.told > WEAK_EXCHANGE]
        lasting, maybe = [one for one in told if not one.length], [one for one in some if one.told <= WEAK_EXCHANGE]
        if len(lasting) % 2:
            if maybe:
                told.append(maybe[0])
            elif lasting[-1].told < (SURE_EXCHANGE if len(told) > 1 else WITHOUT_RETURN):
                told.remove(lasting[-1])
        counted += told
    return counted


def _are_apart(one: _Exchange, others: list[tuple[int, int]]) -> bool:
    """Return whether enough frames lie between an exchange and others of one label to weigh each by itself.

    `others`: the frames and lengths, in order
    """
    place = bisect(others, (one.frame, one.length))
    return all(
        max(frame - one.frame - one.length, one.frame - frame - length) >= POSITIONS_BESIDE
        for frame, length in others[max(place - 1, 0) : place + 1]
    )
