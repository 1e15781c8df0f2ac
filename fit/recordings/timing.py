"""Estimate the delay of each frame's time stamp from the held row, which follows the hanger whatever the cloth does.

The middle y of the tracked held row has time stamps t_f. It is compared with the hanger's path. The hanger's frame A
has x along the bar and y down, about the middle m of the held ends:

    A(w_f)' (y_f - m(w_f)) = o + noise,   w_f = t_f - tau - s (d_f - median d) - delta_f

- tau: the latency
- o: a constant offset of the row, as a silhouette is eroded there
- d_f: the interval to the frame before
- s: a share of that interval. Stamps made when a frame is published are late by the processing time.

tau is scanned over half a second each way, together with s for uneven frames. Gauss-Newton steps follow. Outliers
beyond three times the median distance are left out. Each axis counts by its noise sigma while the hanger stands still.
Intervals are jackknives over half seconds.

The remaining delay delta_f differs in each frame. Only its deviation is estimated here. With the row's velocity v and
the residual r, both over sigma,

    a_f = -(r . v) / v^2,   deviation^2 = sum (a_f^2 v^2 - 1) / sum v^2

It counts if it is certain: three standard errors over half seconds beyond the noise. Few frames at rest determine the
noise poorly, so sigma is the same for the three axes here. Median absolute deviations of m frames are as precise as a
mean square of n = 3 * 0.37 m numbers. Then sigma^2 may be n / q times the measured one, with q the chi-squared number
of n degrees of freedom at 1 in 740.

These delays are corrected by moving frames across the cloth, and not in time (`fit.recordings.frame_offsets`). Source:
least squares with variable projection, G. H. Golub & V. Pereyra, SIAM J. Numer. Anal. 10 (1973).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fit.recordings.hanger_path import Curve, hanger_axes, in_hanger_frame
from fit.recordings.robust_line import interval_of, robust_line
from formats.arrays import Booleans, Floats, Integers
from formats.held_row import FEWEST_BLOCKS, HALF_SWING, LEAST_EXPLAINED, OUTLIER
from formats.sights import LARGEST_SHIFT

# s of the scan: a swing of 2 Hz turns by 14 degrees. Half and double change the delays of the 16 public recordings
# of swung cloth by at most 0.02 of the interval. They find shifted frames in the same 11.
SCAN_STEP = 0.02
INTERVAL_SHARES = np.round(np.arange(-0.6, 1.61, 0.2), 1)  # shares of the preceding interval in the scan
UNEVEN = 0.1  # of the median interval: spread of intervals from which a share is identifiable
SHORTEST_PART = 0.25  # of the take's duration: largest latency of the scan
# m: standard deviation of the hanger's travel across the cloth, from which a scale is estimated. Half and double
# change no finding on the public recordings.
LEAST_TRAVEL = 0.02
# m/s of the row: faster frames show delays, and slower frames noise. Half and double change the delays of the public
# recordings by at most 0.06 of the interval. They find shifted frames in 11 and 10 of them, in place of 11.
MOVING, STILL = 0.1, 0.03
# m of an axis. Our choice: below a camera's 2 mm; without a bound, an axis without noise would count for everything.
# Half and double change the delays of the public recordings by at most 0.04 of the interval.
LEAST_NOISE = 5e-4
# frames for an estimate of noise. Our choice: its relative error is then a quarter. Of the 16 public recordings,
# offsets of frames are found in 15, with half as well, and with double in 11.
FEWEST_NOISE_FRAMES = 8
MEDIAN_TELLS = 0.37  # efficiency of a median absolute deviation relative to a mean square
# s: largest half interval; a wider one means that the hanger hardly moved. Half and double change no finding on the
# public recordings.
WIDEST_INTERVAL = 0.05
# Half 90 % intervals: 3.5 standard errors. Student's t with 15 degrees of freedom, as for a take of 8 s, exceeds this 1
# time in 300. Then one of six findings is false in hardly one of fifty takes.
HALF_INTERVALS = 2.0
CERTAIN_FRAMES = 3.0  # standard errors of the frames' own deviation; our choice: noise exceeds them once in 740
# s, a difference for slopes. Our choice: at 10 m/s^2 the velocity errs by 5 mm/s, a twentieth of `MOVING`. At half by
# 2.5 mm/s, at twice by 10.
NEXT = 1e-3
INSTANTS_AT_ONCE = 1 << 16  # frames times latencies in one batch: 14 MB, by tracemalloc
CLOSEST = 4e-3  # s between frames: nearer ones count as simultaneous


@dataclass(frozen=True)
class Timing:
    """Delays of a take's time stamps, estimated from the held row.

    - `latency` [s]: positive for late stamps
    - `share`: of the interval to the frame before, added to the latency
    - `latency_interval`, `share_interval`: 90 %; the latter is None for even frames
    - `deviation` [s]: of each frame's own delay; 0 if not certain
    - `explained`: share of the row's squared motion that the hanger's path explains at the best delay
    - `shifts` [s], (frames,): the delay of each stamp by latency and share
    - `scale`: share by which the row travels farther across the cloth than the path
    - `scale_interval`: 90 %; None where the hanger hardly travels that way
    """

    latency: float
    latency_interval: tuple[float, float]
    share: float
    share_interval: tuple[float, float] | None
    deviation: float
    explained: float
    shifts: Floats
    scale: float = 0.0
    scale_interval: tuple[float, float] | None = None

    @property
    def is_late(self) -> bool:
        """Whether the 90 % interval of the latency excludes zero; `is_sure` is stricter."""
        low, high = self.latency_interval
        return low > 0.0 or high < 0.0

    @property
    def is_off(self) -> bool:
        """Whether time stamps are probably wrong: the 90 % interval of latency or share excludes zero."""
        known = [self.latency_interval, *([self.share_interval] if self.share_interval is not None else [])]
        return self.deviation > 0 or any(low > 0.0 or high < 0.0 for low, high in known)

    @property
    def follows(self) -> bool:
        """Whether the row follows the hanger at any delay."""
        return self.explained >= LEAST_EXPLAINED

    @property
    def is_of_hanger(self) -> bool:
        """Whether the points' clock can be the hanger's: the row follows at a delay within the scan."""
        return self.follows and not self.is_at_end

    @property
    def is_at_end(self) -> bool:
        """Whether the latency lies at the end of the scan."""
        return abs(self.latency) >= LARGEST_SHIFT - SCAN_STEP


def why_foreign(timing: Timing) -> str:
    """Return the reason why a take's points cannot have the hanger's clock, with distinguishable percentages."""
    least, best = 100 * LEAST_EXPLAINED, 100 * max(timing.explained, 0.0)
    if timing.explained >= LEAST_EXPLAINED:
        return (
            f"the hanger's path explains most of the held row's motion, {best:.0f} %, at a shift of "
            f"{timing.latency:+.2f} s, and none beyond {LARGEST_SHIFT:g} s is looked at"
        )
    stated = f"{best:.0f}" if round(best) < round(least) else f"{np.floor(10 * best) / 10:.1f}"
    return (
        f"at no shift within {LARGEST_SHIFT:g} s does the hanger's path explain {least:.0f} % of the held row's motion "
        f"(best: {stated} %)"
    )


def is_sure(interval: tuple[float, float]) -> bool:
    """Return whether a value with this 90 % interval is certainly not zero."""
    low, high = interval
    return abs(low + high) / 2 > HALF_INTERVALS * (high - low) / 2


def find_timing(time: Floats, row: Floats, path: Curve, *, is_per_frame: bool = True) -> Timing | None:
    """Estimate the delays of a take's time stamps; None if the take is too short or the hanger moves too little.

    - `time` [s], (frames,)
    - `row` [m], (frames, 3): its middle, NaN where not seen
    - `path`: of the held ends, on the same clock
    - `is_per_frame`: whether to estimate the delays of single frames
    """
    seen = np.isfinite(row).all(1)
    reach = min(LARGEST_SHIFT, SHORTEST_PART * float(time[-1] - time[0]))
    step = uneven_intervals(time)
    inside = (time > time[0] + reach) & (time < time[-1] - reach)
    scan = _Scan(time, row, step, path, seen & inside)
    if scan.blocks < FEWEST_BLOCKS or reach < SCAN_STEP:
        return None
    is_uneven = float(np.std(step)) > UNEVEN * float(np.median(np.diff(time)))
    shares = INTERVAL_SHARES if is_uneven else np.zeros(1)
    for _ in range(2):
        latency, share = scan.best(reach, shares)
        scan = scan.without_outliers(latency, share).by_noise(latency, share)
    if (np.linalg.norm(scan.velocity(latency, share), axis=1)[scan.used] > MOVING).sum() < FEWEST_BLOCKS:
        return None
    latency, share, sd = scan.mended(latency, share, is_uneven=is_uneven)
    spread = scan.spread
    half = np.where(np.isfinite(sd), spread * sd, np.inf)
    left = scan.residual(latency, share)
    timing = Timing(
        latency=latency, latency_interval=(latency - half[0], latency + half[0]), share=share,
        share_interval=(share - half[1], share + half[1]) if is_uneven else None, deviation=0.0,
        explained=1 - float((left[scan.used] ** 2).sum() / max(scan.motion, 1e-12)), shifts=latency + share * step,
    )  # fmt: skip
    if half[0] > WIDEST_INTERVAL:  # the hanger's motion shows no delay, or belongs to another take
        return None if timing.is_of_hanger else timing
    timing = scan.with_scale(timing)
    return scan.with_deviation(timing) if is_per_frame else timing


@dataclass(frozen=True)
class _Scan:
    """Scan of delays for one take's held row and hanger path; used: counted frames; noise per axis [m], (3,)."""

    time: Floats
    row: Floats
    step: Floats
    path: Curve
    used: Booleans
    noise: Floats = field(default_factory=lambda: np.ones(3))
    still: int = 0  # frames that estimate the noise

    @property
    def block(self) -> Integers:
        return np.asarray((self.time - self.time[0]) // HALF_SWING, np.int64)

    @property
    def blocks(self) -> int:
        return len(np.unique(self.block[self.used]))

    @property
    def spread(self) -> float:
        """Half a 90 % interval, in standard deviations."""
        from scipy.special import stdtrit

        return float(stdtrit(self.blocks - 1, 0.95))

    @property
    def motion(self) -> float:
        """Sum of the row's squared distances from its mean position [m^2]."""
        row = self.row[self.used]
        return float(((row - row.mean(0)) ** 2).sum())

    def local(self, latency: float, share: float) -> Floats:
        """Return the row in the hanger's frame [m], (frames, 3), for these delays of the stamps."""
        return in_hanger_frame(self.row, self.path(self.time - latency - share * self.step))

    def residual(self, latency: float, share: float) -> Floats:
        """Return `local` minus its mean over the used frames."""
        local = self.local(latency, share)
        return np.asarray(local - local[self.used].mean(0))

    def whitened(self, latencies: Floats, shares: Floats) -> Floats:
        """Return the root mean square residual in units of noise, (n,), for latencies [s] and shares, (n,)."""
        time, step, row = self.time[self.used], self.step[self.used], self.row[self.used]
        found = []
        for begin in range(0, len(latencies), at_once := max(INSTANTS_AT_ONCE // len(time), 1)):
            late, share = (part[begin : begin + at_once, None] for part in (latencies, shares))
            ends = self.path((time - late - share * step).ravel())
            local = in_hanger_frame(np.tile(row, (len(late), 1)), ends).reshape(len(late), -1, 3)
            left = (local - local.mean(1, keepdims=True)) / self.noise
            found.append(np.sqrt((left**2).sum(2).mean(1)))
        return np.concatenate(found)

    def velocity(self, latency: float, share: float) -> Floats:
        """Return the change of the row in the hanger's frame per second of delay [m/s], (frames, 3)."""
        return (self.local(latency + NEXT, share) - self.local(latency, share)) / NEXT

    def by_noise(self, latency: float, share: float) -> _Scan:
        """Return the scan with the noise of each axis from frames in which the hanger is at rest."""
        still = self.used & (np.linalg.norm(self.velocity(latency, share), axis=1) < STILL)
        if still.sum() < FEWEST_NOISE_FRAMES:
            return self
        local = self.local(latency, share)[still]
        spread = 1.4826 * np.median(np.abs(local - np.median(local, axis=0)), axis=0)
        return replace(self, noise=np.maximum(spread, LEAST_NOISE), still=int(still.sum()))

    def best(self, reach: float, shares: Floats) -> tuple[float, float]:
        """Return the latency and share of the smallest residual on the grid."""
        count = 2 * int(np.floor(reach / SCAN_STEP)) + 1
        latencies = np.asarray(SCAN_STEP * (np.arange(count) - count // 2), float)
        coarse = float(latencies[np.argmin(self.whitened(latencies, np.zeros(count)))])
        if len(shares) == 1:
            return coarse, 0.0
        near = latencies[np.abs(latencies - coarse) < 2.5 * SCAN_STEP]
        late, share = (each.ravel() for each in np.meshgrid(near, shares, indexing="ij"))
        least = np.argmin(self.whitened(late, share))
        return float(late[least]), float(share[least])

    def without_outliers(self, latency: float, share: float) -> _Scan:
        """Return the scan without the frames whose row is far off."""
        away = np.linalg.norm(self.residual(latency, share), axis=1)
        most = OUTLIER * float(np.median(away[self.used]))
        return replace(self, used=self.used & (away <= max(most, 1e-6)))

    def mended(self, latency: float, share: float, *, is_uneven: bool) -> tuple[float, float, Floats]:
        """Return refined latency and share with deviations, (2,), by Gauss-Newton steps and a block jackknife."""
        names = np.unique(self.block[self.used])
        place = np.repeat(np.searchsorted(names, self.block[self.used]), 3)
        found = np.array([latency, share])
        for _ in range(6):
            base = self.local(*found)[self.used] / self.noise
            slopes = [(self.local(found[0] + NEXT, found[1])[self.used] / self.noise - base) / NEXT]
            if is_uneven:
                slopes.append((self.local(found[0], found[1] + NEXT)[self.used] / self.noise - base) / NEXT)
            design = np.concatenate([np.stack(slopes, 2), -np.broadcast_to(np.eye(3), (len(base), 3, 3))], 2)
            design = design.reshape(-1, design.shape[2])
            whole, side = design.T @ design, design.T @ base.ravel()
            change = -np.linalg.lstsq(whole, side, rcond=None)[0][: len(slopes)]
            found[: len(slopes)] += np.clip(change, -SCAN_STEP, SCAN_STEP)
        without = []
        for block in range(len(names)):
            part = design[place == block]
            rest = whole - part.T @ part
            without.append(np.linalg.lstsq(rest, side - part.T @ base.ravel()[place == block], rcond=None)[0])
        apart = np.stack(without)[:, : len(slopes)]
        variance = (len(names) - 1) / len(names) * ((apart - apart.mean(0)) ** 2).sum(0)
        sd = np.zeros(2)
        sd[: len(slopes)] = np.sqrt(variance)
        return float(found[0]), float(found[1]), sd

    def with_scale(self, timing: Timing) -> Timing:
        """Return a timing with the scale of the row's travel across the cloth, before single frames get own delays.

        Own delays of single frames would hide a scale. Besides the scale k, the line contains the row's velocity v, for
        the latency: o + k (w - mean w) + e v.
        """
        ends = self.path(self.time - timing.latency - timing.share * self.step)[self.used]
        normal = hanger_axes(ends)[:, :, 2].mean(0)
        travel = ends.reshape(-1, 2, 3).mean(1) @ normal / np.linalg.norm(normal)
        block = self.block[self.used]
        if travel.std() < LEAST_TRAVEL or len(np.unique(block)) < FEWEST_BLOCKS:
            return timing
        out = self.local(timing.latency, timing.share)[self.used, 2]
        velocity = self.velocity(timing.latency, timing.share)[self.used, 2]
        design = np.stack([np.ones(len(out)), travel - travel.mean(), velocity], 1)
        line, half = robust_line(design, out, block)
        return replace(timing, scale=float(line[1]), scale_interval=interval_of(line[1], half[1]))

    def with_deviation(self, timing: Timing) -> Timing:
        """Return a timing with the deviation of single frames' delays, if certain."""
        velocity = self.velocity(timing.latency, timing.share)
        moving = self.used & (np.linalg.norm(velocity, axis=1) > MOVING)
        noise = float(np.sqrt((self.noise**2).mean()))
        left, velocity = self.residual(timing.latency, timing.share) / noise, velocity / noise
        weight = (velocity**2).sum(1)
        if moving.sum() < 2 * FEWEST_BLOCKS or not self.still:
            return timing
        own = -(left * velocity).sum(1) / np.maximum(weight, 1e-9)
        square, weighed, block = own[moving] ** 2 * weight[moving], weight[moving], self.block[moving]
        sure = (square - _most_noise(self.still)).sum() / weighed.sum()
        variance = float((square - 1).sum() / weighed.sum())
        parts = np.array([(square - variance * weighed - 1)[block == b].sum() for b in np.unique(block)])
        if len(parts) < FEWEST_BLOCKS or not sure > CERTAIN_FRAMES * float(np.sqrt((parts**2).sum())) / weighed.sum():
            return timing
        return replace(timing, deviation=float(np.sqrt(variance)))


def _most_noise(still: int) -> float:
    """Return the upper limit of the true noise variance over its estimate from three axes of frames at rest."""
    from scipy.special import gammaincinv, ndtr

    freedom = 3 * MEDIAN_TELLS * still
    return float(freedom / (2 * gammaincinv(freedom / 2, ndtr(-CERTAIN_FRAMES))))


def uneven_intervals(time: Floats) -> Floats:
    """Return the excess of the interval before each frame over the median interval [s], (frames,), 0 for the first."""
    steps = np.diff(time)
    return np.asarray(np.concatenate([[0.0], steps - np.median(steps)]))


def row_middle(points: Floats, across: Floats) -> Floats:
    """Return the middle of a straight row in each frame [m], (frames, 3), NaN where too little of it is seen.

    points [m], (frames, points, 3), NaN where not seen; across [m], (points,): their positions from the row's middle.
    Among six points or more the outermost do not count, because silhouettes lose them.
    """
    if len(across) >= 6:
        inner = np.argsort(across)[1:-1]
        points, across = points[:, inner], across[inner]
    seen = np.isfinite(points).all(2)
    weight = seen.astype(float)
    count, first, second = weight.sum(1), weight @ across, weight @ across**2
    determinant = count * second - first**2
    usable = determinant > 0.1 * len(across) * float((across**2).sum())
    share = weight * (second[:, None] - first[:, None] * across) / np.where(usable, determinant, 1.0)[:, None]
    middle = np.einsum("fp,fpx->fx", share, np.nan_to_num(points))
    middle[~usable] = np.nan
    return np.asarray(middle)


def in_order(time: Floats) -> Booleans:
    """Return which frames, (frames,), are later than all earlier ones by `CLOSEST` at least."""
    kept = np.zeros(len(time), bool)
    last = -np.inf
    for k, instant in enumerate(time):
        if instant >= last + CLOSEST:
            kept[k], last = True, instant
    return kept
