"""Path of the held ends: plausibility checks, and a spline through it that is interpolated across gaps.

Piecewise cubic Hermite polynomials interpolate the path across gaps longer than `LONGEST_GAP`. They keep the monotony
of each coordinate, so they never overshoot. The true motion there is not known. The cloth is simulated, but it is not
judged in the gap and until the gap no longer affects its motion (`FORGOTTEN`). Source: F. N. Fritsch & R. E. Carlson,
"Monotone piecewise cubic interpolation", SIAM J. Numer. Anal. 17 (1980).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from fit.errors import DriveError, FitError, ImpossiblePathError
from fit.recordings.smoothing import steady_spline
from formats.arrays import Booleans, Floats
from formats.findings import FEWEST_SEEN
from formats.sights import FASTEST_END, SETTLING, accelerations, exchanged
from formats.take import LONGEST_GAP

Curve = Callable[[Floats], Floats]

NO_HAND = "no hand moves like that: check the markers' ids and the depth there"


def held_curve(time: Floats, held_seen: Floats, cut_off: float) -> Curve:
    """Return the path of the held ends, (n,) instants [s] -> (n, 6) [m], constant before its begin and after its end.

    time [s], (m,); held_seen [m], (m, 6), NaN where not seen; cut_off [Hz] of its spline
    """
    valid = np.isfinite(held_seen).all(1)
    splines = steady_spline(*led_across(time[valid], held_seen[valid]), cut_off)
    first, last = time[valid][0], time[valid][-1]

    def held_at(instants: Floats) -> Floats:
        inside = np.clip(instants, first, last)
        return np.asarray(splines(inside))

    return held_at


def led_across(seen: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return instants [s] and positions [m], (n, 6), with interpolated ones in every gap longer than `LONGEST_GAP`."""
    from scipy.interpolate import PchipInterpolator

    steps = np.diff(seen)
    gaps = np.flatnonzero(steps > LONGEST_GAP)
    if not len(gaps):
        return seen, places
    usual = float(np.median(steps))
    missing = [np.linspace(seen[k], seen[k + 1], max(round(steps[k] / usual), 2) + 1)[1:-1] for k in gaps]
    time = np.sort(np.concatenate([seen, *missing]))
    whole = np.asarray(PchipInterpolator(seen, places)(time))
    whole[np.searchsorted(time, seen)] = places
    return time, whole


def hanger_axes(ends: Floats) -> Floats:
    """Return the hanger's axes, (n, 3, 3), columns x (along the bar), y (down), z, from held ends (n, 6)."""
    x = ends[:, 3:] - ends[:, :3]
    x = x / np.sqrt(np.einsum("ij,ij->i", x, x))[:, None]
    y = x[:, 2:] * x - [0.0, 0.0, 1.0]
    y = y / np.sqrt(np.einsum("ij,ij->i", y, y))[:, None]
    (ax, ay, az), (bx, by, bz) = x.T, y.T
    return np.stack([x, y, np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], 1)], 2)


def in_hanger_frame(places: Floats, ends: Floats) -> Floats:
    """Return positions [m], (n, 3), in the hanger's frame, about the middle of held ends [m], (n, 6)."""
    return np.asarray(np.einsum("fij,fi->fj", hanger_axes(ends), places - ends.reshape(-1, 2, 3).mean(1)))


def level_normal(ends: Floats) -> Floats:
    """Return level unit vectors perpendicular to the line between held ends, (n, 3), from held ends (n, 6)."""
    normal = np.cross([0.0, 0.0, 1.0], ends[:, 3:] - ends[:, :3])
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9))


def gaps_of(seen: Floats) -> list[tuple[float, float]]:
    """Return begin and end [s] of the gaps in which the hanger's path is unknown, from the instants seen, (n,)."""
    return [(float(a), float(b)) for a, b in pairwise(seen) if b - a > LONGEST_GAP]


def is_known(instants: Floats, gaps: list[tuple[float, float]]) -> Booleans:
    """Return which instants, (n,), have a cloth motion that a seen path determines: not in gaps nor soon after them."""
    known = np.ones(len(instants), bool)
    for begin, end in gaps:
        known &= ~((instants > begin) & (instants < end + SETTLING))
    return known


def check_sights(name: str, seen: int, left: int, *, has_gaps: bool) -> None:
    """Refuse a recording with too few judged sightings of the garment, and name the gaps where they are the cause.

    seen: sightings in the whole take; left: those that `is_known` leaves

    Raises:
        FitError: fewer than a fit needs are left.
    """
    if left >= FEWEST_SEEN:
        return
    if has_gaps and seen >= FEWEST_SEEN:
        raise FitError(
            f"no stretch between its gaps is long enough: {SETTLING:g} s after each gap are not judged",
            where=name, advice="record again with both held ends in view from beginning to end",
        )  # fmt: skip
    raise FitError(
        "hardly any point of the garment below the held edge was seen", where=name,
        advice="check with `hangtime takes show`, then record again with all of the garment in view",
    )  # fmt: skip


def check_path(name: str, seen: Floats, places: Floats, *, is_whole: bool = True) -> None:
    """Refuse an implausible path of the held ends, seen at instants (n,) [s] and positions (n, 6) [m].

    is_whole: whether gaps longer than `LONGEST_GAP` are refused

    Raises:
        DriveError: the ends were seen in too few frames, or are lost for too long.
        ImpossiblePathError: they jump, or are exchanged.
    """
    if len(seen) < FEWEST_SEEN:
        raise DriveError(
            f"the hanger was seen in {len(seen)} frames only",
            where=name,
            advice="keep both markers in view; check with `hangtime takes show`",
        )
    gaps = np.diff(seen)
    if is_whole and gaps.max() > LONGEST_GAP:
        at = seen[int(np.argmax(gaps))]
        raise DriveError(
            f"the hanger is lost for {gaps.max():.2f} s at {at:.2f} s",
            where=name,
            advice=f"gaps above {LONGEST_GAP} s cannot be bridged; record again with both markers in view",
        )
    speed = np.linalg.norm(np.diff(places.reshape(-1, 2, 3), axis=0), axis=2) / np.diff(seen)[:, None]
    if speed.max() > FASTEST_END:
        at = seen[int(np.argmax(speed.max(1)))]
        raise ImpossiblePathError(
            f"the hanger jumps at {at:.2f} s ({speed.max():.0f} m/s)",
            where=name,
            advice=NO_HAND,
        )
    pull, most = accelerations(seen, places.reshape(-1, 2, 3))
    jumps = np.flatnonzero((pull > most).any(1))
    if len(jumps):
        first = int(jumps[0])
        raise ImpossiblePathError(
            f"the hanger jumps at {seen[1 + first]:.2f} s ({pull[first].max():.0f} m/s2)", where=name, advice=NO_HAND
        )
    swapped = exchanged(seen, places.reshape(-1, 2, 3))
    if swapped.any():
        raise ImpossiblePathError(
            f"left and right held end are exchanged in {swapped.sum()} of {len(seen)} frames, first at "
            f"{seen[int(np.argmax(swapped))]:.2f} s",
            where=name,
            advice="check which is which there, then correct the labels or record again",
        )
