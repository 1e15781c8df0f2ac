"""Know one recording that was moved to other axes, filtered, rounded or sampled anew: its noise is still there.

Places x of one take and y of another, smoothed over a time tau and read at steps of tau, are fitted to each other:

    y_p(t) = c + R sum_k h_k x_p(t + l + k tau) + e_p(t)

Here p is a point, l a lag, R orthogonal, and h a filter of a few taps. Two recordings do not share the noise of their
sensors, so the residual e holds the noise of both, whatever they have in common. A copy leaves far less:

    q = median_p ( mean_t |e_p|^2 / N_p ) n / (n - m),   q >= 1 for two recordings, q = 0 for a copy
    N_p = ( s_x^2 d_x sum_jk h_j h_k exp(-(j - k)^2 / 4) + s_y^2 d_y ) / (2 sqrt(pi) tau)

N is the power of white noise s of frames d apart, behind the smoothing. The fit takes m of the n independent numbers.
The median of sixth differences of frames measures s, and that of sixth differences behind the smoothing measures N.
Motion hardly shows in them at 20 frames a second, and the smaller N counts. Of slower takes, s is `SAME_PLACE`: their
copies are known in other axes, but not filtered. No s is smaller. The lag has the largest RV coefficient of the second
differences u, v of both,

    RV = |C|^2 / (|A| |B|),   C = sum u v^T, A = sum u u^T, B = sum v v^T,   1 where v = R u, for any R

Sources: Y. Escoufier, Biometrics 29 (1973) (RV); W. Kabsch, Acta Crystallographica A32 (1976) (R).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from formats.arrays import Booleans, Floats, Integers

# m in each axis. Exports round to 0.1 mm, and archives to 0.1 mm at most: half a step of each.
# No two of sixteen recordings of one cloth share ten frames in order within 5 mm.
SAME_PLACE = 1.0e-4
AT_REST = 0.01  # m from its first place: a fit learns next to nothing there, and made takes may start with one noise
# Of the noise of two recordings. Pairs of the synthetic world leave 1.3 times that noise and more, and motions that a
# machine repeats with noise above 0.1 mm leave 0.7. Rounding of noise s to steps of 2 s leaves 0.14.
MOST_LEFT = 0.25
LEAST_TIME = 2.0  # s in common in which the cloth has moved
LEAST_SHARE = 0.2  # of the shorter take in common
FEWEST_NUMBERS = 80  # independent ones in common: chance brings q below `MOST_LEFT` in 1e-10 of fits (chi-squared)
NUMBERS_A_PLACE = 1.2  # independent ones of three: neighbours of places smoothed over one step are alike
SMOOTHING = 2.0  # frames of the slower take: between frames, resampling changes the noise
RUNGS = 4  # of smoothing, per octave: takes of nearly one rate are smoothed once for all
TAPS = 4  # to each side: a filter of 9 steps, half a second at 30 frames a second
LEAST_SEEN = 0.6  # of the frames around an instant
MOST_EMPTY = 10  # times the frames: a clock that jumps so far is not followed
MOST_SLOWER = 20.0  # times the interval of the other take: of a copy, one frame in ten, taken twice as fast
MOST_STEPS = 3000  # that are fitted to: more cost time and tell little more
LAGS = 3  # that are tried: swings look alike a period apart
LONGEST_INTERVAL = 0.05  # s between frames: at 10 a second, half of made pairs that differ by 5 mm passed for copies
NORMAL = 0.6745  # median of the absolute value of normal noise of deviation 1
SHIFTS = np.arange(-TAPS, TAPS + 1)  # steps
WEIGHTS = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])  # of sixth differences


@dataclass(frozen=True)
class _Smoothed:
    """Places [m], (steps, points, 3), and whether they are seen, (steps, points)."""

    places: Floats
    seen: Booleans

    @cached_property
    def moved(self) -> Booleans:
        """Whether the cloth has moved, (steps,)."""
        first = self.places[np.argmax(self.seen, 0), np.arange(self.seen.shape[1])]
        away = np.linalg.norm(self.places - first, axis=2)
        return np.asarray((self.seen & (away > AT_REST)).any(1))


class Motion:
    """The motion of a take's points, to be compared with that of another take."""

    def __init__(self, time: Floats, places: Floats, seen: Booleans) -> None:
        """Keep instants [s], (frames,), places [m], (frames, points, 3), and which were seen, (frames, points)."""
        fresh = np.ones(len(time), bool)  # a slower tracker holds its frames
        fresh[1:] = (seen[1:, :, None] & (places[1:] != places[:-1])).any((1, 2))
        time, self._places, self._seen = time[fresh], places[fresh], seen[fresh]
        steps = np.diff(time)
        self.interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        self._time = time - time[0] if self.interval else np.zeros(0)
        self._noise: dict[tuple[int, float], float] = {}
        self._smoothed: dict[tuple[int, float], tuple[Floats, Booleans]] = {}

    @property
    def can_be_compared(self) -> bool:
        """Whether the clock goes on, without jumps that are far longer than the take."""
        return bool(self.interval) and self._time[-1] < MOST_EMPTY * len(self._time) * self.interval

    def noise(self, points: Integers, step: float) -> Floats:
        """Return the noise that smoothing over a step [s] leaves of points, (n,), of the three axes together [m^2]."""
        return np.array([self._noise_of(int(point), step) for point in points])

    def smoothed(self, points: Integers, step: float) -> _Smoothed:
        """Return the places of points, (n,), smoothed over a step [s] and read once a step."""
        each = [self._smoothed_point(int(point), step) for point in points]
        return _Smoothed(np.stack([places for places, _ in each], 1), np.stack([seen for _, seen in each], 1))

    def _noise_of(self, point: int, step: float) -> float:
        if (point, step) not in self._noise:
            white = self.interval / (2 * np.sqrt(np.pi) * step)
            noise = 3 * SAME_PLACE**2 * white
            if self.interval <= LONGEST_INTERVAL:
                places, seen = self._smoothed_point(point, step)
                behind = _noise_in(np.where(seen[:, None], places, np.nan)) / _power(WEIGHTS)
                frames = _noise_in(self._places[self._seen[:, point], point]) / (WEIGHTS @ WEIGHTS)
                noise = max(noise, min(frames * white, behind))
            self._noise[point, step] = noise
        return self._noise[point, step]

    def _smoothed_point(self, point: int, step: float) -> tuple[Floats, Booleans]:
        if (point, step) not in self._smoothed:
            seen = self._seen[:, point]
            time, width = self._time[seen], step / self.interval
            frames = np.arange(round(self._time[-1] / self.interval) + 1)
            there = np.zeros(len(frames))
            there[np.rint(time / self.interval).astype(int).clip(0, len(frames) - 1)] = 1.0
            there = gaussian_filter1d(there, width, mode="nearest")
            read = np.arange(0.0, self._time[-1], step) / self.interval
            places = np.empty((len(read), 3))
            for axis in range(3):
                even = np.interp(frames * self.interval, time, self._places[seen, point, axis])
                places[:, axis] = np.interp(read, frames, gaussian_filter1d(even, width, mode="nearest"))
            is_seen = np.interp(read, frames, there) >= LEAST_SEEN
            is_seen[:2] = is_seen[-2:] = False  # smoothed over what was not recorded
            self._smoothed[point, step] = places, is_seen
        return self._smoothed[point, step]


def _power(weights: Floats) -> float:
    """Return the variance of a weighted sum of neighbours of white noise, smoothed over a step to variance 1."""
    steps = np.arange(len(weights))
    return float(weights @ np.exp(-((steps[:, None] - steps) ** 2) / 4) @ weights)


def _noise_in(places: Floats) -> float:
    """Return the variance of sixth differences of places, (n, 3), NaN where not seen, of the axes together."""
    sixth = np.abs(np.diff(places, 6, axis=0))
    sixth = sixth[np.isfinite(sixth).all(1)]
    return float(((np.median(sixth, 0) / NORMAL) ** 2).sum()) if len(sixth) else 0.0


def noise_left(one: Motion, other: Motion, points: Integers) -> float:
    """Return the share q of the noise of two recordings that a fit of either to the other leaves; infinite for no fit.

    points: that both takes show, (n,)
    """
    if not (len(points) and one.can_be_compared and other.can_be_compared):
        return np.inf
    if not 1 / MOST_SLOWER <= one.interval / other.interval <= MOST_SLOWER:
        return np.inf
    step = float(2 ** (np.ceil(RUNGS * np.log2(SMOOTHING * max(one.interval, other.interval))) / RUNGS))
    x, y = one.smoothed(points, step), other.smoothed(points, step)
    fewest = max(LEAST_TIME / step, LEAST_SHARE * min(len(x.seen), len(y.seen)))
    noises = one.noise(points, step), other.noise(points, step)
    either = (
        min(_left(x, y, lag, fewest, noises), _left(y, x, -lag, fewest, noises[::-1])) for lag in _lags(x, y, fewest)
    )
    return min(either, default=np.inf)


def _lags(x: _Smoothed, y: _Smoothed, fewest: float) -> list[int]:
    """Return the steps by which the second take's clock is likely to be ahead, with so many steps in common."""
    u, v = _accelerations(x), _accelerations(y)
    length = next_fast_len(len(u) + len(v))
    spectra = rfft(u, length, axis=0).conj().transpose(0, 2, 1) @ rfft(v, length, axis=0)
    lags = np.arange(1 - len(u), len(v))
    both = irfft(spectra, length, axis=0)[lags % length]
    begin, end = np.maximum(0, -lags), np.minimum(len(u), len(v) - lags)
    own = _norm(_sums(u, begin, end)) * _norm(_sums(v, begin + lags, end + lags))
    # Sums of rounding errors are no motion.
    known = (end - begin >= fewest) & (own > 1e-9 * own.max(initial=0.0))
    likeness = np.where(known, _norm(both) ** 2 / np.where(known, own, 1.0), 0.0)
    found: list[int] = []
    while len(found) < LAGS and likeness.max(initial=0.0) > 0:
        best = int(likeness.argmax())
        found.append(int(lags[best]))
        likeness[max(best - TAPS, 0) : best + TAPS + 1] = 0.0
    return found


def _accelerations(smoothed: _Smoothed) -> Floats:
    """Return second differences of places, (steps, points, 3), 0 where not seen, and jumps cut off."""
    places, seen = smoothed.places, smoothed.seen
    known = np.zeros_like(seen)
    known[1:-1] = seen[:-2] & seen[1:-1] & seen[2:]
    second = np.zeros_like(places)
    second[1:-1] = np.diff(places, 2, axis=0)
    size = np.linalg.norm(second, axis=2)
    most = np.quantile(size[known], 0.95) if known.any() else 0.0
    second *= (known * np.minimum(1.0, most / np.maximum(size, 1e-12)))[..., None]
    return second


def _sums(vectors: Floats, begin: Integers, end: Integers) -> Floats:
    """Return the sums of u u^T between steps, (lags, 3, 3), of vectors u, (steps, points, 3)."""
    sums = np.cumsum(vectors.transpose(0, 2, 1) @ vectors, axis=0)
    sums = np.concatenate([np.zeros((1, 3, 3)), sums])
    return np.asarray(sums[end] - sums[begin])


def _norm(matrices: Floats) -> Floats:
    return np.asarray(np.linalg.norm(matrices, axis=(1, 2)))


def _left(x: _Smoothed, y: _Smoothed, lag: int, fewest: float, noises: tuple[Floats, Floats]) -> float:
    """Return q at a lag, with noises of both [m^2], (points,)."""
    at = np.arange(max(0, -lag) + TAPS, min(len(x.seen), len(y.seen) - lag) - TAPS)
    at = at[x.moved[at] & y.moved[at + lag]] if len(at) else at
    used = y.seen[at + lag] & x.seen[at[:, None] + SHIFTS[2:-2]].all(1)
    if used.any(1).sum() < fewest:
        return np.inf
    stride = -(-len(at) // MOST_STEPS)
    at, used = at[::stride], used[::stride]
    numbers = NUMBERS_A_PLACE * used.sum()
    if numbers < FEWEST_NUMBERS:
        return np.inf
    shifted = np.stack([x.places[at + shift][used] for shift in SHIFTS])
    error, taps = _residual(shifted, y.places[at + lag][used])
    gain = _power(taps)
    power = np.bincount(np.nonzero(used)[1], (error**2).sum(1), used.shape[1])
    counts = used.sum(0)
    known = counts > 0
    left = np.median((power / np.maximum(counts, 1) / (noises[0] * gain + noises[1]))[known])
    return float(left * numbers / (numbers - len(taps) - 6))  # three turns, three displacements


def _residual(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return e, (n, 3), and the taps h of the best fit of y, (n, 3), by shifted x, (taps, n, 3) [m]."""
    x, y = x - x.mean(1, keepdims=True), y - y.mean(0)
    taps = np.zeros(len(x))
    taps[len(x) // 2] = 1.0
    for _ in range(2):  # a filter hardly turns a motion
        left, _, right = np.linalg.svd(np.tensordot(taps, x, 1).T @ y)
        turned = x @ (left @ right)
        taps = np.linalg.lstsq(turned.reshape(len(x), -1).T, y.ravel(), rcond=1e-6)[0]
    return y - np.tensordot(taps, turned, 1), taps
