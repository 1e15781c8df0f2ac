"""Detect a copy of a recording that was transformed, filtered, rounded or resampled, by the noise that both share.

Positions x of one take and y of another are smoothed over a time tau and sampled at steps of tau / 2. A fit relates
them:

    y_p(t) = c + R sum_k h_k x_p(t + l + k tau / 2) + e_p(t)

Here p is a point, l a lag, R orthogonal, and h a filter of a few taps. Two recordings have independent sensor noise, so
the residual e contains the noise of both, however similar their
motions are. A copy leaves far less:

    q = median_p ( mean_t |e_p|^2 / N_p ) n / (n - m),   q >= 1 for two recordings, q = 0 for a copy
    N_p = ( s_x^2 d_x g + s_y^2 d_y ) / (2 sqrt(pi) tau),   g = min(1, sum_jk h_j h_k exp(-(j - k)^2 / 16))

N is the power of white noise s of frames d apart, after the smoothing. The gain g of a copy's filter is 1 at most: the
taps may amplify only noise that a filter removed from x. The fit uses m of the n independent numbers.

The median of sixth differences of frames measures s, and that of sixth differences after the smoothing measures N.
Motion hardly contributes to them at 30 frames a second, and the smaller N counts. In slower takes, s is not measured.

No s is below `SAME_POSITION`. No s is below the step, of 1 mm at most, to which a take's numbers are rounded. So takes
of a motion that a machine repeats with noise below 0.4 of that step count as copies.

The lag has the largest RV coefficient of the second differences u, v of both,

    RV = |C|^2 / (|A| |B|),   C = sum u v^T, A = sum u u^T, B = sum v v^T,   1 where v = R u, for any R

Two takes that hold alternate frames of one recording share no noise, and are not detected.

Sources: Y. Escoufier, Biometrics 29 (1973) (RV); W. Kabsch, Acta Crystallographica A32 (1976) (R).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.sparse import csr_array
from scipy.special import ndtr

from formats.arrays import Booleans, Floats, Integers

# m in each axis. Exports round to 0.1 mm, and archives to 0.1 mm at most: half a step of each.
# No two of sixteen recordings of one cloth share ten frames in order within 5 mm.
SAME_POSITION = 1.0e-4
AT_REST = 0.01  # m from its first position: nearer frames hardly inform a fit, and synthetic takes may share noise
# Share of the noise of two recordings. Pairs of synthetic takes leave 1.3 times that noise and more, and motions that a
# machine repeats with noise above 0.1 mm leave 0.7. Rounding to steps s leaves a twelfth.
MOST_NOISE_LEFT = 0.25
LEAST_TIME = 2.0  # s in common in which the cloth has moved; our choice: a swing or two, half and double untried
LEAST_COMMON_SHARE = 0.2  # of the shorter take in common; our choice: it also limits the lags that are tried
FEWEST_NUMBERS = 80  # independent numbers in common: chance reduces q below `MOST_NOISE_LEFT` in 1e-10 of fits
NUMBERS_A_PLACE = 0.6  # independent numbers of a position's three, as neighbouring smoothed positions are correlated
SMOOTHING_REACH = 4.0  # tau: corners farther away contribute 1e-5 of those nearby to the Gaussian smoothing
SMOOTHING = 2.0  # frames of the slower take: between frames, resampling changes the noise
RUNGS = 4  # smoothing times per octave: takes of nearly equal rates share one smoothing time
READS = 2  # samples per tau: with one, copies of fast motion with clocks half a step apart are not detected
TAPS = 4 * READS  # to each side: a filter of 8 tau, half a second at 30 frames a second
LEAST_SEEN_NEARBY = 0.6  # of the frames around an instant: least share that is seen
MOST_EMPTY = 10  # times the frames: a take with longer clock jumps is not compared
MOST_SLOWER = 20.0  # times the other take's interval: a copy with one frame in ten at twice the speed
MOST_STEPS = 3000  # steps used in the fit at most: more cost time and add little
LEAST_PRODUCT = 1e-12  # of the largest product; our choice: parts of 1e-6 of the motion are rounding
POINT_SETS_KEPT = 4  # of a take; our choice: bounds memory, and takes of a garment mostly show the same points
LAGS = 3  # lags that are tried, as swings are similar one period apart
# s between frames, below which motion hardly affects sixth differences. At 25 frames a second, flutter of 3 cm at 4 Hz
# measures as 1.2 mm of noise.
LONGEST_INTERVAL = 0.036
# Frames whose numbers show the step to which they are rounded. Our choice: a limit on the cost, as a few frames of
# many points show a step. Half and double were not tried.
FRAMES_OF_STEP = 2000
LEAST_STEP, MOST_ROUNDED = 1e-9, 1e-3  # m: smallest and largest rounding step of marker files
MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of normal noise of deviation 1
SHIFTS = np.arange(-TAPS, TAPS + 1)  # steps of the filter, either side of the middle
WEIGHTS = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])  # of sixth differences


@dataclass(frozen=True)
class _Smoothed:
    """Smoothed positions [m], (steps, points, 3), and whether they are seen, (steps, points)."""

    positions: Floats
    seen: Booleans
    spectra: dict[int, NDArray[np.complex128]] = field(default_factory=dict)  # of accelerations, the last one by length

    def spectrum(self, length: int) -> NDArray[np.complex128]:
        """Return the spectrum of the accelerations over so many steps, (length // 2 + 1, points, 3)."""
        if length not in self.spectra:
            self.spectra.clear()
            self.spectra[length] = rfft(self.accelerations, length, axis=0)
        return self.spectra[length]

    @cached_property
    def moved(self) -> Booleans:
        """Whether the cloth has moved from its first position, (steps,)."""
        first = self.positions[np.argmax(self.seen, 0), np.arange(self.seen.shape[1])]
        away = np.linalg.norm(self.positions - first, axis=2)
        return np.asarray((self.seen & (away > AT_REST)).any(1))

    @cached_property
    def accelerations(self) -> Floats:
        """Second differences of positions, (steps, points, 3), 0 where not seen, with clipped jumps."""
        positions, seen = self.positions, self.seen
        known = np.zeros_like(seen)
        known[1:-1] = seen[:-2] & seen[1:-1] & seen[2:]
        second = np.zeros_like(positions)
        second[1:-1] = np.diff(positions, 2, axis=0)
        size = np.linalg.norm(second, axis=2)
        most = np.quantile(size[known], 0.95) if known.any() else 0.0
        second *= (known * np.minimum(1.0, most / np.maximum(size, 1e-12)))[..., None]
        return second

    @cached_property
    def sums(self) -> Floats:
        """Sums of u u^T over the steps before each, of the accelerations u, (steps + 1, 3, 3)."""
        sums = np.cumsum(self.accelerations.transpose(0, 2, 1) @ self.accelerations, axis=0)
        return np.concatenate([np.zeros((1, 3, 3)), sums])


class Motion:
    """Motion of a take's points, for the comparison with another take."""

    def __init__(self, time: Floats, positions: Floats, seen: Booleans) -> None:
        """Store instants [s], (frames,), positions [m], (frames, points, 3), and which were seen, (frames, points)."""
        fresh = np.ones(len(time), bool)  # a slower tracker repeats its frames
        fresh[1:] = (seen[1:, :, None] & (positions[1:] != positions[:-1])).any((1, 2))
        fresh[1:] &= time[1:] > np.maximum.accumulate(time)[:-1]
        time, self._positions, self._seen = time[fresh], positions[fresh], seen[fresh]
        steps = np.diff(time)
        self.interval = float(np.median(steps)) if len(steps) else 0.0
        self._time = time - time[0] if self.interval else np.zeros(0)
        self._rounding = _step_of(self._positions[:: -(-len(time) // FRAMES_OF_STEP)]) if len(time) else 0.0
        self._noise: dict[tuple[int, float], float] = {}
        self._smoothed: dict[tuple[int, float], tuple[Floats, Booleans]] = {}
        self._near: dict[float, _Near] = {}
        self._of_points: dict[tuple[bytes, float], _Smoothed] = {}

    @property
    def can_be_compared(self) -> bool:
        """Whether the clock advances without jumps much longer than the take."""
        return bool(self.interval) and self._time[-1] < MOST_EMPTY * len(self._time) * self.interval

    def noise(self, points: Integers, tau: float) -> Floats:
        """Return the points' noise variance after smoothing over tau [s], (n,), summed over the three axes [m^2]."""
        return np.array([self._noise_of(int(point), tau) for point in points])

    def smoothed(self, points: Integers, tau: float) -> _Smoothed:
        """Return the positions of points, (n,), smoothed over tau [s] and sampled every tau / 2."""
        key = points.tobytes(), tau
        if key not in self._of_points:
            each = [self._smoothed_point(int(point), tau) for point in points]
            positions, seen = (np.stack(one, 1) for one in zip(*each, strict=True))
            while len(self._of_points) >= POINT_SETS_KEPT:
                del self._of_points[next(iter(self._of_points))]
            self._of_points[key] = _Smoothed(positions, seen)
        return self._of_points[key]

    def _noise_of(self, point: int, tau: float) -> float:
        if (point, tau) not in self._noise:
            white = self.interval / (2 * np.sqrt(np.pi) * tau)
            noise = 3 * max(SAME_POSITION, self._rounding) ** 2 * white
            if self.interval <= LONGEST_INTERVAL:
                positions, seen = self._smoothed_point(point, tau)
                behind = _noise_in(np.where(seen[:, None], positions, np.nan)[::READS]) / _power(WEIGHTS, 1.0)
                frames = _noise_in(self._positions[self._seen[:, point], point]) / (WEIGHTS @ WEIGHTS)
                noise = max(noise, min(frames * white, behind))
            self._noise[point, tau] = noise
        return self._noise[point, tau]

    def _smoothed_point(self, point: int, tau: float) -> tuple[Floats, Booleans]:
        if (point, tau) not in self._smoothed:
            if tau not in self._near:
                self._near[tau] = _Near(self._time, np.arange(0.0, self._time[-1], tau / READS), tau)
            seen, near = self._seen[:, point], self._near[tau]
            is_seen = near.share_seen(seen) * self.interval >= LEAST_SEEN_NEARBY
            is_seen[: 2 * READS] = is_seen[-2 * READS :] = False  # the smoothing would cover unrecorded time
            self._smoothed[point, tau] = near.smoothed(self._positions[seen, point], seen), is_seen
        return self._smoothed[point, tau]


class _Near:
    """Gaussian smoothing of unevenly sampled motion, with deviation tau, at given instants.

    Positions f are linear between frames, which may be uneven in time. With the change c_i of velocity at frame i, and
    the rounding D of a corner by the Gaussian,

        smoothed f(t) = f(t) + sum_i c_i D(t - t_i),   D(u) = tau phi(u / tau) - |u| Phi(-|u| / tau)
    """

    def __init__(self, time: Floats, read: Floats, tau: float) -> None:
        """Prepare the smoothing: rising frame times [s], (frames,), rising output times [s], (steps,), tau [s]."""
        begin, end = (np.searchsorted(time, read + side * SMOOTHING_REACH * tau) for side in (-1, 1))
        ends = np.concatenate([[0], np.cumsum(end - begin)])
        at = np.arange(ends[-1]) - np.repeat(ends[:-1] - begin, end - begin)
        away = np.abs(np.repeat(read, end - begin) - time[at]) / tau
        bell = np.exp(-(away**2) / 2) / np.sqrt(2 * np.pi)
        self._time, self._read, shape = time, read, (len(read), len(time))
        self._corners = csr_array((tau * (bell - away * ndtr(-away)), at, ends), shape=shape)
        self._bells = csr_array((bell / tau, at, ends), shape=shape)

    def share_seen(self, seen: Booleans) -> Floats:
        """Return the local rate of frames that saw a point around each step, (steps,)."""
        return np.asarray(self._bells @ seen.astype(float))

    def smoothed(self, positions: Floats, seen: Booleans) -> Floats:
        """Return smoothed positions, (steps, 3), from a point's positions in the frames that saw it, (n, 3)."""
        time = self._time[seen]
        if not len(time):
            return np.zeros((len(self._read), 3))
        speeds = np.zeros((len(time) + 1, 3))
        speeds[1:-1] = np.diff(positions, axis=0) / np.diff(time)[:, None]
        corners = np.zeros((len(seen), 3))
        corners[seen] = np.diff(speeds, axis=0)
        straight = np.stack([np.interp(self._read, time, along) for along in positions.T], 1)
        return np.asarray(straight + self._corners @ corners)


def _step_of(positions: Floats) -> float:
    """Return the rounding step [m] of coordinates, (frames, points, 3): their least difference."""
    steps = np.diff(np.sort(positions.reshape(len(positions), -1), axis=0), axis=0)
    return float(steps[steps > LEAST_STEP].min(initial=MOST_ROUNDED))


def _power(weights: Floats, apart: float) -> float:
    """Return the variance of a weighted sum of smoothed white noise of variance 1, sampled at a spacing in tau."""
    at = apart * np.arange(len(weights))
    return float(weights @ np.exp(-((at[:, None] - at) ** 2) / 4) @ weights)


def _noise_in(positions: Floats) -> float:
    """Return the variance of sixth differences of positions, (n, 3), NaN where not seen, summed over the axes."""
    sixth = np.abs(np.diff(positions, 6, axis=0))
    sixth = sixth[np.isfinite(sixth).all(1)]
    return float(((np.median(sixth, 0) / MEDIAN_OF_NORMAL) ** 2).sum()) if len(sixth) else 0.0


def noise_left(one: Motion, other: Motion, points: Integers) -> float:
    """Return q, the residual noise of the better fit between two takes over their noise; infinite without a fit.

    points, (n,): points that both takes show
    """
    if not (len(points) and one.can_be_compared and other.can_be_compared):
        return np.inf
    if not 1 / MOST_SLOWER <= one.interval / other.interval <= MOST_SLOWER:
        return np.inf
    tau = float(2 ** (np.ceil(RUNGS * np.log2(SMOOTHING * max(one.interval, other.interval))) / RUNGS))
    x, y = one.smoothed(points, tau), other.smoothed(points, tau)
    fewest = max(LEAST_TIME / tau * READS, LEAST_COMMON_SHARE * min(len(x.seen), len(y.seen)))
    noises = one.noise(points, tau), other.noise(points, tau)
    either = (
        min(_left(x, y, lag, fewest, noises), _left(y, x, -lag, fewest, noises[::-1])) for lag in _lags(x, y, fewest)
    )
    return min(either, default=np.inf)


def _lags(x: _Smoothed, y: _Smoothed, fewest: float) -> list[int]:
    """Return the most probable lags of the second take's clock [steps], with at least `fewest` common steps."""
    u, v = x.accelerations, y.accelerations
    length = next_fast_len(len(u) + len(v))
    spectra = x.spectrum(length).conj().transpose(0, 2, 1) @ y.spectrum(length)
    lags = np.arange(1 - len(u), len(v))
    both = irfft(spectra, length, axis=0)[lags % length]
    begin, end = np.maximum(0, -lags), np.minimum(len(u), len(v) - lags)
    own = _norm(x.sums[end] - x.sums[begin]) * _norm(y.sums[end + lags] - y.sums[begin + lags])
    # Sums of rounding errors do not count as motion.
    known = (end - begin >= fewest) & (own > 1e-9 * own.max(initial=0.0))
    likeness = np.where(known, _norm(both) ** 2 / np.where(known, own, 1.0), 0.0)
    found: list[int] = []
    while len(found) < LAGS and likeness.max(initial=0.0) > 0:
        best = int(likeness.argmax())
        found.append(int(lags[best]))
        likeness[max(best - TAPS, 0) : best + TAPS + 1] = 0.0
    return found


def _norm(matrices: Floats) -> Floats:
    return np.asarray(np.linalg.norm(matrices, axis=(1, 2)))


def _left(x: _Smoothed, y: _Smoothed, lag: int, fewest: float, noises: tuple[Floats, Floats]) -> float:
    """Return q at a lag, with noises of both [m^2], (points,)."""
    at = np.arange(max(0, -lag) + TAPS, min(len(x.seen), len(y.seen) - lag) - TAPS)
    at = at[x.moved[at] & y.moved[at + lag]] if len(at) else at
    used = y.seen[at + lag] & x.seen[at[:, None] + SHIFTS[2 * READS : len(SHIFTS) - 2 * READS]].all(1)
    if used.any(1).sum() < fewest:
        return np.inf
    stride = -(-len(at) // MOST_STEPS)
    at, used = at[::stride], used[::stride]
    numbers = NUMBERS_A_PLACE * used.sum()
    if numbers < FEWEST_NUMBERS:
        return np.inf
    shifted = np.stack([x.positions[at + shift][used] for shift in SHIFTS])
    error, taps = _residual(shifted, y.positions[at + lag][used])
    gain = min(_power(taps, 1 / READS), 1.0)
    power = np.bincount(np.nonzero(used)[1], (error**2).sum(1), used.shape[1])
    counts = used.sum(0)
    known = counts > 0
    left = np.median((power / np.maximum(counts, 1) / (noises[0] * gain + noises[1]))[known])
    return float(left * numbers / (numbers - len(taps) - 6))  # three turns, three displacements


def _residual(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return residual e, (n, 3), and taps h of the best fit of y, (n, 3), by shifted x, (taps, n, 3) [m].

    The products of shifted positions with each other are those of turned ones, so that they are summed once.
    """
    x, y = x - x.mean(1, keepdims=True), y - y.mean(0)
    flat = x.reshape(len(x), -1)
    own, both = flat @ flat.T, x.transpose(0, 2, 1) @ y
    values, vectors = np.linalg.eigh(own)
    known = values > LEAST_PRODUCT * values[-1]
    taps = np.zeros(len(x))
    taps[len(x) // 2] = 1.0
    for _ in range(2):  # a filter hardly turns a motion
        left, _, right = np.linalg.svd(np.tensordot(taps, both, 1))
        turn = left @ right
        along = vectors[:, known].T @ np.einsum("kab,ab->k", both, turn)
        taps = vectors[:, known] @ (along / values[known])
    return y - np.tensordot(taps, x, 1) @ turn, taps
