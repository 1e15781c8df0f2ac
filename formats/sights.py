"""Find when hanger and garment of a take were seen, and motion that no hand and no cloth makes.

A sight is a frame in which both held ends were seen. A fit interpolates the hanger's path between sights at most
`LONGEST_GAP` apart. After a longer gap the fit ignores the cloth for `SETTLING`. These rules are those of
`fit.recordings`, so that the recording already reports a take that a fit refuses.

The line from one held end to the other, b, turns by an angle a in the time dt between two sights. The ends are
exchanged from one sight to the next where

    a > 90 degrees   and   a / dt > FASTEST_TURN

A held end jumps where its speed exceeds `FASTEST_END`, or its acceleration exceeds

    sqrt(HARDEST_PULL^2 + (10 sd)^2)

with sd the median standard deviation of a second difference that noise causes (`accelerations`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.garment import Garment
from formats.motion import HARDEST_PULL
from formats.take import LONGEST_GAP, Take
from formats.two_clocks import at_times, shows_hanger, shows_points

SETTLING = 2.5  # s after a gap of the hanger: 4 % are left of a swing that decays with 1.25 /s, as a real cloth's did
# of the garment's height, within which of the held edge a point is on it. Our choice: 1 cm of half a metre. Half and
# double were not tried.
ON_EDGE = 0.02
FEWEST_FREE = 3  # points off the held edge: fewer show no shape, so a fit also uses points on the edge
FASTEST_END = 8.0  # m/s of a held end, twice the speed that a hand reaches with a hanger
FASTEST_TURN = 10.0  # rad/s of the held edge: the peak of a twist by 45 degrees to each side at 2 Hz
NOISIER = 10.0  # times the median noise of a path, since stated deviations may be too small
SAME_PLACE = 1e-5  # m: an archive's steps are 1e-4 m, and the noise of markers is as large or larger
FEWEST_TELLING = 5  # sights: fewer do not show an outlier among its neighbours
JUMPS = 3.0  # times the neighbours' own steps that an outlier is off: swings of 2 Hz have 0.9 at 9 sights a second
BLOCK_SECONDS = 0.5  # s: residuals further apart than half a swing count as independent
FEWEST_HALVES = 3  # half-seconds of motion, at least, for intervals; our choice: the spread of fewer is unknown
LARGEST_SHIFT = 0.5  # s, largest offset of the hanger's clock either way: live cameras are late by 0.05 to 0.35 s
MOST_SHIFTED = 1000  # frames, evenly spaced, for which all clock offsets are tried: 1 s for 64 points
CLOCKS_APART = np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + 0.01, 0.02)  # s; our choice: half and double were not tried


@dataclass(frozen=True)
class Sights:
    """When hanger and garment were seen.

    - `held`, (frames,): both held ends were seen
    - `within`, (frames,): points could be seen, and the frame lies between the first and the last sight of the hanger
    - `is_known`, (frames,): as `within`, and the hanger's path is known
    - `free`, (points,): the points by which the cloth is judged (`judged_points`)
    - `cloth`, (frames,): a point below the held edge was seen (`below_held_edge`)
    """

    held: Booleans
    within: Booleans
    is_known: Booleans
    free: Booleans
    cloth: Booleans


def sights_of(take: Take) -> Sights:
    """Return when hanger and garment of a take were seen."""
    held = np.asarray(
        np.isfinite(take.markers).all((1, 2)) & take.held_valid.all(1) & np.isfinite(take.held).all((1, 2))
    )
    seen, within = take.time[held], shows_points(take)
    within &= (take.time >= seen[0]) & (take.time <= seen[-1]) if len(seen) else np.zeros(len(within), bool)
    known = within.copy()
    for k in np.flatnonzero(np.diff(seen) > LONGEST_GAP):
        known &= (take.time <= seen[k]) | (take.time >= seen[k + 1] + SETTLING)
    cloth = np.asarray(take.points_valid[:, below_held_edge(take.garment)].any(1))
    return Sights(held, within, known, judged_points(take.garment), cloth)


def on_held_edge(garment: Garment) -> Booleans:
    """Return the points, (points,), that move with the hanger: all on a clamped edge, or those at two held corners.

    An edge between two held corners sags and swings, and so do the points on it.
    """
    return _near_edge(garment, is_whole=garment.held == "edge")


def below_held_edge(garment: Garment) -> Booleans:
    """Return the points, (points,), that are not on the held edge, however it is held; all if every point is on it.

    Points between two held corners count as on the edge: they stay visible where the rest of the cloth is lost.
    """
    below = ~_near_edge(garment, is_whole=True)
    return below if below.any() else np.ones(len(below), bool)


def _near_edge(garment: Garment, *, is_whole: bool) -> Booleans:
    """Return the points, (points,), near the held edge, or near its two ends alone."""
    places = np.array([point.at_m for point in garment.points], float).reshape(-1, 2)
    left, right = np.asarray(garment.outline_m[:2], float)
    share = (places - left) @ (right - left) / ((right - left) @ (right - left))
    share = np.clip(share if is_whole else np.round(share), 0.0, 1.0)
    apart = np.linalg.norm(places - left - share[:, None] * (right - left), axis=1)
    return np.asarray(apart < ON_EDGE * float(np.ptp(np.asarray(garment.outline_m)[:, 1])))


def judged_points(garment: Garment) -> Booleans:
    """Return the points, (points,), by which the cloth is judged: those off the held edge.

    All points count where those off the held edge are fewer than `FEWEST_FREE`.
    """
    free = ~on_held_edge(garment)
    return free if free.sum() >= FEWEST_FREE else np.ones(len(free), bool)


def fitted_sights(take: Take, sights: Sights) -> int:
    """Return the number of sightings of free points that a fit uses, those while the hanger's path is known."""
    return int(take.points_valid[sights.is_known][:, sights.free].sum())


def half_seconds(time: Floats) -> Integers:
    """Return the half second to which each instant [s] belongs, counted from time 0."""
    return (time / BLOCK_SECONDS).astype(np.int64)


def shown_halves(take: Take, sights: Sights) -> int:
    """Return the number of half seconds with a point while the hanger's path is known, as a fit counts them.

    Where frames are missing, a fit may use more of them: it then begins after the hole (`fit.recordings.intact`).
    """
    seen = sights.is_known & np.asarray(take.points_valid.any(1))
    return len(np.unique(half_seconds((take.time - take.time[np.argmax(sights.within)])[seen])))


def too_few_halves(count: int) -> str:
    """Return why this number of half seconds with motion is too small for a fit, '' if it is not."""
    if count >= FEWEST_HALVES:
        return ""
    return f"intervals need {FEWEST_HALVES} half-seconds of motion, and there are {count}"


def exchanged(time: Floats, ends: Floats) -> Booleans:
    """Return the sights, (sights,), in which the held ends are exchanged; of the two orders, the rarer one is wrong.

    time [s], (sights,); ends [m], (sights, 2, 3)
    """
    bar = ends[:, 1] - ends[:, 0]
    bar = bar / np.maximum(np.linalg.norm(bar, axis=1, keepdims=True), 1e-9)
    turned = np.arccos(np.clip((bar[1:] * bar[:-1]).sum(1), -1.0, 1.0))
    is_exchange = (turned > np.pi / 2) & (turned > FASTEST_TURN * np.diff(time))
    found = np.concatenate([[0], np.cumsum(is_exchange)]) % 2 == 1
    return np.asarray(found if 2 * found.sum() <= len(found) else ~found)


def first_jump(time: Floats, ends: Floats) -> int | None:
    """Return the first sight to which, or from which, a held end jumps; None where no end jumps.

    time [s], (sights,); ends [m], (sights, 2, 3)
    """
    if len(time) < 3:
        return None
    pull, most = accelerations(time, ends)
    speed = np.linalg.norm(np.diff(ends, axis=0), axis=2) / np.diff(time)[:, None]
    is_jump = np.zeros(len(time), bool)
    is_jump[1:-1] = (pull > most).any(1)
    is_jump[1:] |= (speed > FASTEST_END).any(1)
    return int(np.argmax(is_jump)) if is_jump.any() else None


def accelerations(time: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """Return the accelerations of both ends from sight to sight, and their limits, both (n - 2, 2) [m/s^2].

    time [s], (n,); ends [m], (n, 2, 3). Noise contributes more between close sights. Over h1 and h2 seconds, the
    standard deviation of a second difference of positions is their own deviation times

        2 / (h1 + h2) sqrt(1/h1^2 + (1/h1 + 1/h2)^2 + 1/h2^2)
    """
    before, after = np.diff(time)[:-1, None], np.diff(time)[1:, None]
    slopes = np.diff(ends, axis=0) / np.diff(time)[:, None, None]
    pull = 2 * np.linalg.norm(np.diff(slopes, axis=0), axis=2) / (before + after)
    gain = 2 / (before + after) * np.sqrt(1 / before**2 + (1 / before + 1 / after) ** 2 + 1 / after**2)
    return pull, np.hypot(HARDEST_PULL, NOISIER * gain * np.median(pull / gain, axis=0))


def reach(places: Floats) -> float:
    """Return the largest travel of one of several points [m], as the diagonal of its bounding box.

    places: positions [m], (sights, n, 3)

    A sight that jumps off both neighbours, while the neighbours move regularly, is an outlier and no motion. The first
    and the last sight have no such neighbours, and do not count.

    A swing may turn between sights. At r sights a second, a swing of f Hz appears smaller by 1 - cos(pi f / r) at most.
    At 9 sights a second that is 6 % at 1 Hz and 13 % at 1.5 Hz; at 30 it is 1 %.
    """
    if len(places) < FEWEST_TELLING:
        return float(np.linalg.norm(np.ptp(places, axis=0), axis=1).max())
    middle = (places[:-2] + places[2:]) / 2
    steps, none = np.linalg.norm(np.diff(places, axis=0), axis=2), np.zeros((1, places.shape[1]))
    around = np.maximum(np.concatenate([none, steps[:-2]]), np.concatenate([steps[2:], none]))
    is_bad = np.linalg.norm(places[1:-1] - middle, axis=2) > JUMPS * around
    kept = np.where(is_bad[..., None], middle, places[1:-1])
    return float(np.linalg.norm(np.ptp(kept, axis=0), axis=1).max())


def standing(take: Take, sights: Sights, moved: float) -> list[tuple[int, float, float]]:
    """Return the points that keep exactly one position while the hanger moves, each with its longest such time.

    Each is an index with begin and end [s]. Times below `LONGEST_GAP` are ignored.

    moved [m]: least travel of the centre of the held ends meanwhile, since a point may lie on the axis of a twist
    """
    held, middle, found = np.flatnonzero(sights.held), take.held.mean(1, keepdims=True), []
    for point in range(take.points.shape[1]):
        rows = np.flatnonzero(take.points_valid[:, point])
        stays = (np.abs(np.diff(take.points[rows, point], axis=0)) < SAME_PLACE).all(1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], stays, [False]]).astype(int)))
        spells = []
        for first, last in zip(rows[edges[::2]], rows[edges[1::2]], strict=True):
            within = held[(held >= first) & (held <= last)]
            if take.time[last] - take.time[first] > LONGEST_GAP and len(within) and reach(middle[within]) > moved:
                spells.append((point, float(take.time[first]), float(take.time[last])))
        found += sorted(spells, key=lambda spell: spell[1] - spell[2])[:1]
    return found


def shifts_of(take: Take) -> Floats:
    """Return the clock offsets of the hanger to try [s]; only 0 where hanger and points share a clock.

    Only a hanger of the rig is seen in the pictures of the points. A fit corrects late stamps of all other takes.
    """
    has_two_clocks = take.rig.hanger is None or not (shows_hanger(take) & shows_points(take)).all()
    return CLOCKS_APART if has_two_clocks else np.zeros(1)


def spread(frames: Integers, most: int) -> Integers:
    """Return at most `most` of the frames, evenly spaced."""
    return frames if len(frames) <= most else frames[np.linspace(0, len(frames) - 1, most).astype(int)]


def away_from_held(take: Take, sights: Sights) -> Floats:
    """Return the median distance of each point from both held ends [m], (points, 2), NaN where it was never seen.

    Where the hanger may have its own clock, the distances are those at the one offset that makes their sum smallest.
    The sum is over the points that every offset shows. A point that this offset does not show has an offset of its own.
    A fit moves the clock only where the held row determines an offset. So a fit may refuse a short take that is near at
    some offset.
    """
    shifts, frames = shifts_of(take), np.flatnonzero(sights.is_known)
    frames = spread(frames, MOST_SHIFTED if len(shifts) > 1 else len(frames))
    seen, places = take.points_valid[frames], take.points[frames]
    found = []
    for shift in shifts:
        ends = at_times(take.time[frames] + shift, take.time[sights.held], take.held[sights.held])
        apart = np.linalg.norm(places[:, :, None] - ends[:, None], axis=3)
        found.append(_medians(np.where(seen[..., None], apart, np.nan)))
    known = np.isfinite(found)  # a short take shows nothing at a large offset, nor a point seen only near an end
    best = int(np.argmin(np.where(known.all(0), found, 0.0).sum((1, 2))))
    return np.where(known[best], found[best], np.fmin.reduce(found))


def _medians(apart: Floats) -> Floats:
    """Return the medians over the frames, (points, 2), ignoring NaN."""
    whole = np.full(apart.shape[1:], np.nan)
    is_there = np.isfinite(apart).any(0)
    whole[is_there] = np.nanmedian(apart[:, is_there], axis=0)
    return whole


def longest_without_cloth(take: Take, sights: Sights) -> tuple[float, float]:
    """Return begin and end [s] of the longest time without a free point while the hanger was seen, else 0 and 0."""
    rows, held = np.flatnonzero(sights.within & sights.cloth), np.cumsum(sights.held)
    begins, ends = rows[:-1], rows[1:]
    with_hanger = held[np.maximum(ends - 1, 0)] > held[begins]
    spans = np.where(with_hanger, take.time[ends] - take.time[begins], 0.0)
    longest = int(np.argmax(spans)) if len(spans) else 0
    return (float(take.time[begins[longest]]), float(take.time[ends[longest]])) if spans.any() else (0.0, 0.0)
