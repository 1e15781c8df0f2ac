"""Estimate the offset between the clock of a hanger's trajectory and the clock of pictures of the same hanger.

Pictures at times t_f show the positions c_fk of two points k of the hanger. The trajectory has these points at h_k, on
its own clock:

    c_fk = h_k(t_f + s) + o_k + noise

- s: the clock offset, positive where the trajectory's clock is ahead
- o_k: a constant displacement, since a camera sees a corner beside the point where the hand holds it

Every offset on a grid of 20 ms, up to 5 s, is scored by the median over pictures and points of the distance

    r_fk(s) = |c_fk - h_k(t_f + s) - median_f(c_fk - h_k(t_f + s))|

Gauss-Newton steps refine each local minimum. The residuals e and the trajectory's velocities v have their means over
the pictures subtracted. Positions farther off than three times the median do not count.

    s <- s + sum (e_fk . v_fk) / sum v_fk^2

A minimum counts where the trajectory explains 0.7 of the squared motion. Its standard error is a jackknife over half
seconds, within which errors are correlated. For white noise of deviation sigma, the error is about sigma / sqrt(sum
v_fk^2). With 10 mm of noise and 90 pictures at 0.3 m/s, the error is 2.5 ms.

A periodic swing fits nearly as well after each period. So the squared distances of each minimum are compared with those
of the best minimum, in half-second blocks. A minimum is equally good in two cases. The mean difference is below 3.5 of
its standard errors, or the root mean squares differ by less than 3 mm. The smallest of the equally good offsets is
returned. An offset is significant above 3.5 of its standard errors and 5 ms.

Sources: Gauss-Newton with the displacement projected out, G. H. Golub & V. Pereyra, SIAM J. Numer. Anal. 10 (1973);
jackknife, B. Efron & C. Stein, Ann. Statist. 9 (1981).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from formats.arrays import Booleans, Floats
from formats.held_row import FEWEST_BLOCKS, HALF_SWING, LEAST_EXPLAINED, OUTLIER

Path = Callable[[Floats], Floats]

FARTHEST_SHIFT, SHIFT_STEP = 5.0, 0.02  # s, limit and step of the grid; a step is 10 mm at 0.5 m/s
# share of positions for which the shifted trajectory must be known. Our choice: below, most of a comparison would be
# missing. Half and double were not tried.
SEEN_AT_ALL = 0.5
# Pictures, evenly spread over the recording. Our choice: 67 s at 30 a second are whole, a million positions on the grid
# of 501 shifts. Half and double were not tried.
MOST_LOOKED_AT = 2000
POSITIONS_AT_ONCE = 50_000  # pictures times shifts: 2 MB of positions
WORTH_REFINING = 2.0  # times the least median distance
SURELY = 3.5  # standard errors: exceeded by chance once in 300, with 15 degrees of freedom
LEAST_NEARER = 3e-3  # m: less is noise, and a hanger that hardly moves determines no offset
LEAST_SHIFT = 5e-3  # s: a hanger at 0.5 m/s moves 2.5 mm meanwhile, as much as the noise of a point
SAME_MINIMUM = 0.1  # s: nearer minima count as one; a swing of 2 Hz has a minimum every 0.25 s
STEPS = 6  # of Gauss-Newton, each at most `SHIFT_STEP`; our choice: half and double were not tried


@dataclass(frozen=True)
class ClockShift:
    """An estimated offset between a trajectory's clock and the pictures' clock.

    - `seconds`: offset [s], positive where the trajectory's clock is ahead
    - `error` [s]: its standard error
    - `others` [s]: larger offsets that fit equally well, as after a period of the motion, the smallest first
    """

    seconds: float
    error: float
    others: tuple[float, ...] = ()

    @property
    def is_significant(self) -> bool:
        """Whether the offset is significantly different from zero."""
        return abs(self.seconds) > max(SURELY * self.error, LEAST_SHIFT)


@dataclass(frozen=True)
class _Minimum:
    """A local minimum: offset [s] and standard error [s], residuals [m], (pictures, points, 3), which of them count."""

    seconds: float
    error: float
    left: Floats
    counts: Booleans


def find_clock_shift(time: Floats, seen: Floats, path: Path) -> ClockShift | None:
    """Return the smallest offset that fits as well as the best one; None where the motion determines none.

    - `time` [s], (pictures,); `seen` [m], (pictures, 2, 3), NaN where not seen
    - `path`: returns the positions of the same points [m], (n, 2, 3), NaN where unknown, at times [s], (n,), on its
      clock
    """
    some = slice(None, None, -(-len(time) // MOST_LOOKED_AT))
    time, seen = time[some], seen[some]
    known = int(np.isfinite(seen).all(2).sum())
    block = ((time - time[0]) // HALF_SWING).astype(int)
    if len(np.unique(block[np.isfinite(seen).any((1, 2))])) < FEWEST_BLOCKS:
        return None
    count = round(FARTHEST_SHIFT / SHIFT_STEP)
    shifts = np.asarray(SHIFT_STEP * np.arange(-count, count + 1), float)
    at_once = max(POSITIONS_AT_ONCE // len(time), 1)
    pieces = [shifts[k : k + at_once] for k in range(0, len(shifts), at_once)]
    apart = np.concatenate([_apart(time, seen, path, piece, max(SEEN_AT_ALL * known, 1)) for piece in pieces])
    inner = apart[1:-1]
    least = (inner <= apart[:-2]) & (inner <= apart[2:]) & (inner <= WORTH_REFINING * inner.min() + LEAST_NEARER)
    minima = [
        found for k in np.flatnonzero(least & np.isfinite(inner))
        if (found := _refined(float(shifts[k + 1]), time, block, seen, path)) is not None
    ]  # fmt: skip
    if not minima:
        return None
    smallest, *larger = sorted(_as_good(minima, block), key=lambda one: abs(one.seconds))
    others = list[float]()
    for one in larger:
        if all(abs(one.seconds - other) > SAME_MINIMUM for other in (smallest.seconds, *others)):
            others.append(one.seconds)
    return ClockShift(smallest.seconds, smallest.error, tuple(others))


def _apart(time: Floats, seen: Floats, path: Path, shifts: Floats, fewest: float) -> Floats:
    """Return the median distance [m] at each offset, (shifts,), infinite where fewer positions are known."""
    found = path((shifts[:, None] + time).ravel()).reshape(len(shifts), *seen.shape)
    away = _away(_residual(seen, found)).reshape(len(shifts), -1)
    return np.where(np.isfinite(away).sum(1) >= fewest, _median(away, 1)[:, 0], np.inf)


def _residual(seen: Floats, path: Floats) -> Floats:
    """Return seen positions less those of the trajectory, about their median over the pictures.

    The shape is (..., pictures, points, 3).
    """
    left = seen - path
    left = np.where(np.isfinite(left).all(axis=-1, keepdims=True), left, np.nan)
    return np.asarray(left - _median(left, left.ndim - 3))


def _median(values: Floats, axis: int) -> Floats:
    """Return the medians of many rows at once, ignoring NaN; the axis stays, with length 1."""
    ordered, count = np.sort(values, axis=axis), np.isfinite(values).sum(axis, keepdims=True)
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[axis] - 1)
    return np.asarray((np.take_along_axis(ordered, low, axis) + np.take_along_axis(ordered, high, axis)) / 2)


def _away(left: Floats) -> Floats:
    return np.asarray(np.linalg.norm(left, axis=-1))


def _refined(
    shift: float, time: Floats, block: Floats, seen: Floats, path: Path
) -> _Minimum | None:  # fmt: skip
    """Return the local minimum near an offset; None where it explains too little, or the hanger does not move."""
    for _ in range(STEPS):
        left = _residual(seen, path(time + shift))
        ahead, behind = (path(time + shift + step) for step in (SHIFT_STEP, -SHIFT_STEP))
        velocity = (ahead - behind) / (2 * SHIFT_STEP)
        away = _away(left)
        counts = np.isfinite(velocity).all(2) & (away <= OUTLIER * np.nanmedian(away) + LEAST_NEARER)
        errors, moves = _about_mean(left, counts), _about_mean(velocity, counts)
        if (weight := float((moves**2).sum())) <= 0:
            return None
        shift += float(np.clip((errors * moves).sum() / weight, -SHIFT_STEP, SHIFT_STEP))
    motion = _about_mean(seen, counts)
    names = np.unique(block[counts.any(1)])
    if len(names) < FEWEST_BLOCKS or (errors**2).sum() > (1 - LEAST_EXPLAINED) * (motion**2).sum():
        return None
    without = []
    for name in names:
        rest = counts & (block != name)[:, None]
        moves = _about_mean(velocity, rest)
        without.append((_about_mean(left, rest) * moves).sum() / max(float((moves**2).sum()), 1e-12))
    error = np.sqrt((len(names) - 1) * np.var(without))
    return _Minimum(shift, float(error), left, counts)


def _about_mean(values: Floats, counts: Booleans) -> Floats:
    """Return values less their mean over the pictures in which they count, 0 elsewhere."""
    whole = np.where(counts[..., None], values, 0.0)
    mean = whole.sum(0) / np.maximum(counts.sum(0), 1)[:, None]
    return np.where(counts[..., None], whole - mean, 0.0)


def _as_good(minima: Sequence[_Minimum], block: Floats) -> list[_Minimum]:
    """Return the local minima that fit as well as the best one."""
    nearest = min(minima, key=lambda one: float(np.nanmedian(_away(one.left))))
    good = [nearest]
    for one in minima:
        both = nearest.counts & np.isfinite(one.left).all(2)
        if one is nearest or not both.any():
            continue
        squares = [np.where(both, _away(m.left) ** 2, 0.0) for m in (one, nearest)]
        roots = [float(np.sqrt(square.sum() / both.sum())) for square in squares]
        names = np.unique(block[both.any(1)])
        more = np.array([
            (squares[0] - squares[1])[block == name].sum() / max(both[block == name].sum(), 1) for name in names
        ])  # fmt: skip
        error = more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else np.inf
        if roots[0] - roots[1] < LEAST_NEARER or more.mean() < SURELY * error:
            good.append(one)
    return good
