"""Gaussian likelihood of a residual: measured noise plus a model discrepancy with a stated covariance.

    y = f(theta, a) + d + e,    e ~ N(0, R),    d ~ N(0, s^2 K),    K = K_time x K_space x I_3

Noise R of a point has three parts. White noise sigma is measured on the take (`fit.gap.floor.measured_noise`). Slow
noise is SLOW_SHARE of it and decays over SLOW_LASTS. A constant offset of the point is the same in all takes. With the
residual divided by sigma, white and slow noise are one first-order state-space model, whose innovations are white:

    u_k = phi u_(k-1) + w_k,  y_k = u_k + e_k,  phi = exp(-dt / tau);   v_k = (y_k - E y_k) / sd y_k, given all before

(Kalman filter; a frame in which the point is not seen has no innovation). Offsets are one rank-one term per point and
axis, with o the innovations of a constant:

    C_0 = I + sum o o',   C_0^-1 = I - sum o o' / (1 + |o|^2)

The held edge's numbers have noise of SLOW times the variance (`fit.gap.edge_fit`): the hanger's path is smooth, and so
is its error.

In time the discrepancy is the damped oscillator exp(-t / T) cos(2 pi f t) that the residual itself shows
(`fit.gap.correlation.ringing_of`). In space it has the lowest shapes of a hanging sheet: J_0(xi_k sqrt(h)) down and
cos(pi i u) across. Here h is the height above the lower edge as a share of the sheet's. The shapes are zero at the held
edge, each with the variance (i + k)^-2. K is scaled so that s is the root mean square distance [m] of a judged point.
Its square root B, (numbers, modes), holds the modes of K_time that make KEPT of the variance. With
G = B' C_0^-1 B = U L U',

    x' C^-1 y = x' C_0^-1 y - sum_k s^2 / (1 + s^2 L_k) (U' B' C_0^-1 x)_k (U' B' C_0^-1 y)_k
    log |C| = log |C_0| + sum_k log(1 + s^2 L_k)

(Woodbury's identity), so that all scales s cost one decomposition.
Sources: M. Kennedy & A. O'Hagan, J. Royal Stat. Soc. B 63 (2001) (discrepancy); A. C. Harvey, "Forecasting, structural
time series models and the Kalman filter" (1989), section 3.4 (innovations); H. Lamb, "Hydrodynamics" (1932), art. 186,
for J_0 of a hanging chain; G. H. Golub & C. F. Van Loan, "Matrix Computations" (2013), section 2.1.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import j0, jn_zeros

from fit.gap.correlation import Ringing, ringing_of
from fit.gap.edge_fit import SLOW
from fit.observer.edge import NUMBERS_A_FRAME
from fit.observer.residuals import Layout, Observer
from fit.recordings.recording import Recording
from formats.arrays import Booleans, Floats, Integers

SLOW_SHARE, SLOW_LASTS = 1 / 3, 1 / 3  # of the white noise; s: slow noise, as `fit.observer.edge` has it
# Shapes of a hanging sheet: straight, tilted and bent across; three swings down. Our choice: the
# slowest shapes move the most. Other counts were not tried.
SHAPES_ACROSS, SHAPES_DOWN = 3, 3
# Of the variance of K_time; our choice: 3 % of a discrepancy is a sixth of its size. Half and double of the rest were
# not tried.
KEPT_VARIANCE = 0.97
FASTEST_MODE = 4.0  # Hz, of the modes of K_time: cloth that hangs swings below 2 Hz, and its second swing below 4
MOST_ENTRIES = 3e7  # of the square root of K for a take: 240 MB
# Standard deviations: an offset without prior knowledge. Our choice: the prior then weighs 1e-12 of a single frame, so
# half and double change nothing that is shown.
FREE_OFFSET_SD = 1e6


@dataclass(frozen=True)
class Sums:
    """Inner products of rows in the metric of each scale's covariance.

    inner, (scales, rows, rows): x' C^-1 y; log_det, (scales,): log |C| - log |C_0|
    """

    inner: Floats
    log_det: Floats


class Likelihood:
    """Covariance of an observer's residuals, as a metric for inner products of rows."""

    def __init__(self, observer: Observer, noise: list[Floats], residual: Floats, scales: Floats) -> None:
        """Whiten each series of residuals, and decompose the covariance of the discrepancy.

        noise: measured, per axis [m], (points,) a take; residual, (numbers,): gives the discrepancy's oscillation
        scales, (scales,): root mean square discrepancies [m], ascending
        """
        self.scales = scales
        self._series = [
            *_series_of_points(observer.layout, observer.recordings, noise),
            *_series_of_edges(observer.layout, observer.recordings),
        ]
        rate = float(np.median([(len(r.time) - 1) / r.duration for r in observer.recordings]))
        self.ringing = ringing_of(observer.by_place(residual[observer.layout.is_judged]), rate)
        self._offsets = _offsets(self._series)
        self._roots = [
            None if s.place is None else s.whitened(_root(observer.recordings[s.take], self.ringing)[s.place])
            for s in self._series
        ]
        self._decompose()

    def _decompose(self) -> None:
        """Decompose G for one axis; the three axes have the same G."""
        starts = np.cumsum([0, *(0 if r is None else r.shape[-1] for r in self._roots)])
        total = int(starts[-1])
        gram = np.zeros((total, total))
        shadows = np.zeros((len(self._offsets.less), total))
        for series, root, first in zip(self._series, self._roots, starts, strict=False):
            if root is None:
                continue
            mine = slice(first, first + root.shape[-1])
            flat = root.reshape(-1, root.shape[-1])
            gram[mine, mine] = flat.T @ flat
            shadows[series.offset, mine] += np.einsum("fp,fpm->pm", self._offsets.of(series), root)
        gram -= shadows.T @ (self._offsets.less[:, None] * shadows)
        values, self._vectors = np.linalg.eigh(gram)
        self._values = np.maximum(values, 0.0)
        self._shadows, self._starts = shadows, starts

    def of(self, rows: Floats) -> Sums:
        """Return the inner products of rows, (rows, numbers), in every scale's metric."""
        count = len(rows)
        plain = np.zeros((count, count))
        seen = np.zeros((count, 3, len(self._vectors)))
        along = np.zeros((count, 3, len(self._offsets.less)))
        for n, series in enumerate(self._series):
            white = series.innovations(rows)  # (frames, series, rows, axes)
            axes = white.shape[3]
            plain += np.einsum("fpra,fpsa->rs", white, white, optimize=True)
            along[:, :axes, series.offset] += np.einsum("fp,fpra->rap", self._offsets.of(series), white)
            root = self._roots[n]
            if root is not None:
                mine = slice(self._starts[n], self._starts[n] + root.shape[-1])
                seen[:, :, mine] = np.einsum("fpm,fpra->ram", root, white, optimize=True)
        less = self._offsets.less
        plain -= np.einsum("rap,p,sap->rs", along, less, along, optimize=True)
        seen -= np.einsum("rap,p,pm->ram", along, less, self._shadows, optimize=True)
        modes = seen @ self._vectors
        squared = self.scales[:, None] ** 2
        weights = squared / (1 + squared * self._values)
        taken = np.einsum("ram,km,sam->krs", modes, weights, modes, optimize=True)
        return Sums(plain - taken, 3 * np.log1p(squared * self._values).sum(1))


@dataclass(frozen=True)
class _Series:
    """Time series of one take that are filtered together: its points, or the four numbers of its held edge.

    - index, (frames, series, axes): places in the stacked residual, -1 where not seen
    - still, (series, axes): places of the means, -1 without
    - scale, still_scale, (frames, series) or (series,): factors from numbers to units of noise
    - unit [m], (frames, series): unit of the noise
    - phi, (frames,), gain, sd, (frames, series): of the filter
    - offset, (series,): numbers of their offsets; offset_sd [m], (series,)
    - place, (series,): their points of the take's garment; None of a held edge
    """

    take: int
    index: Integers
    still: Integers
    scale: Floats
    still_scale: Floats
    unit: Floats
    phi: Floats
    gain: Floats
    sd: Floats
    offset: Integers
    offset_sd: Floats
    place: Integers | None

    def innovations(self, rows: Floats) -> Floats:
        """Return white innovations of rows, (rows, numbers) -> (frames, series, rows, axes); 0 where not seen."""
        seen = (self.index >= 0)[..., None]
        values = np.where(seen, rows.T[np.maximum(self.index, 0)], 0.0)  # (frames, series, axes, rows)
        values = values * self.scale[..., None, None]
        if (self.still >= 0).any():
            mean = np.where((self.still >= 0)[..., None], rows.T[np.maximum(self.still, 0)], 0.0)
            values = values + np.where(seen, mean * self.still_scale[..., None, None], 0.0)
        return self._filtered(np.swapaxes(values, 2, 3))

    def whitened(self, fields: Floats) -> Floats:
        """Innovations of fields [m], (series, frames, modes) -> (frames, series, modes); 0 where not seen."""
        return self._filtered(np.swapaxes(fields, 0, 1) / self.unit[..., None])

    def constant(self) -> Floats:
        """Return innovations of a constant offset of one deviation, (frames, series)."""
        ones = np.ones(self.sd.shape) * self.offset_sd / self.unit
        return self._filtered(ones)

    def _filtered(self, values: Floats) -> Floats:
        shape = (len(self.sd), self.sd.shape[1], *[1] * (values.ndim - 2))
        phi, gain, sd = self.phi, self.gain.reshape(shape), self.sd.reshape(shape)
        seen = (self.index[..., 0] >= 0).reshape(shape)
        found, mean = np.zeros(values.shape), np.zeros(values.shape[1:])
        for k in range(len(values)):
            mean = phi[k] * mean
            apart = np.where(seen[k], values[k] - mean, 0.0)
            found[k] = apart / sd[k]
            mean = mean + gain[k] * apart
        return found


@dataclass(frozen=True)
class _Offsets:
    """Constant offsets: directions of length 1 per series, and 1 - 1 / (1 + |o|^2), (offsets,)."""

    directions: dict[int, Floats]
    less: Floats

    def of(self, series: _Series) -> Floats:
        return self.directions[id(series)]


def _offsets(every: list[_Series]) -> _Offsets:
    count = 1 + max(int(s.offset.max(initial=-1)) for s in every)
    constants = {id(s): s.constant() for s in every}
    squared = np.zeros(count)
    for s in every:
        np.add.at(squared, s.offset, (constants[id(s)] ** 2).sum(0))
    length = np.sqrt(np.maximum(squared, 1e-30))
    directions = {id(s): constants[id(s)] / length[s.offset] for s in every}
    return _Offsets(directions, squared / (1 + squared))


def _filter(time: Floats, seen: Booleans) -> tuple[Floats, Floats, Floats]:
    """Return the Kalman filter's gains and deviations, (frames, series), and decay factors, (frames,)."""
    phi = np.exp(-np.diff(time, prepend=time[0]) / SLOW_LASTS)
    variance = np.full(seen.shape[1], SLOW_SHARE**2)
    gain, sd = np.zeros(seen.shape), np.ones(seen.shape)
    for k in range(len(time)):
        variance = phi[k] ** 2 * variance + SLOW_SHARE**2 * (1 - phi[k] ** 2)
        sd[k] = np.sqrt(variance + 1.0)
        gain[k] = np.where(seen[k], variance / (variance + 1.0), 0.0)
        variance = variance * (1 - gain[k])
    return phi, gain, sd


def _series_of_points(layout: Layout, recordings: list[Recording], noise: list[Floats]) -> list[_Series]:
    found = []
    judged = np.flatnonzero(layout.is_judged)
    for number, recording in enumerate(recordings):
        mine = judged[layout.take[judged] == number]
        if not len(mine):
            continue
        points = np.unique(layout.point[mine])
        column = np.searchsorted(points, layout.point[mine])
        index = np.full((len(recording.time), len(points), 3), -1)
        index[layout.frame[mine], column, layout.axis[mine]] = mine
        still = np.full((len(points), 3), -1)
        still[column, layout.axis[mine]] = layout.static_of[mine]
        unit = np.broadcast_to(noise[number][points], index.shape[:2])
        stated = np.zeros(len(points))
        stated[column] = layout.sd[mine]
        has_mean = still[:, 0] >= 0
        mean_sd = np.where(has_mean, layout.sd[np.maximum(still[:, 0], 0)], 0.0)
        phi, gain, sd = _filter(recording.time, index[..., 0] >= 0)
        found.append(
            _Series(
                number, index, still, stated / unit, mean_sd / unit[0], unit, phi, gain, sd, points,
                np.where(has_mean, recording.offset_sd, FREE_OFFSET_SD * unit[0]), points,
            )
        )  # fmt: skip
    return found


def _series_of_edges(layout: Layout, recordings: list[Recording]) -> list[_Series]:
    found = []
    first = int(layout.point.max(initial=-1)) + 1
    for number, recording in enumerate(recordings):
        mine = np.flatnonzero(layout.is_edge & (layout.take == number))
        moving, still = mine[layout.frame[mine] >= 0], mine[layout.frame[mine] < 0]
        if not len(moving):
            continue
        frames = layout.frame[moving].reshape(-1, NUMBERS_A_FRAME)[:, 0]
        index = np.full((len(recording.time), NUMBERS_A_FRAME, 1), -1)
        index[frames, :, 0] = moving.reshape(-1, NUMBERS_A_FRAME)
        sd = np.sqrt(SLOW) * layout.sd[moving].reshape(-1, NUMBERS_A_FRAME)
        unit = np.ones((len(recording.time), NUMBERS_A_FRAME))
        unit[frames] = sd
        of_noise = (sd**2).sum(0) / SLOW / len(sd) ** 2
        offset = np.sqrt(np.maximum(layout.sd[still] ** 2 - of_noise, 0.0))
        phi, gain, deviation = _filter(recording.time, index[..., 0] >= 0)
        found.append(
            _Series(
                number, index, still[:, None], np.full(unit.shape, 1 / np.sqrt(SLOW)), layout.sd[still] / unit, unit,
                phi, gain, deviation, first + np.arange(NUMBERS_A_FRAME), offset, None,
            )
        )  # fmt: skip
    return found


def shapes_of(recording: Recording) -> Floats:
    """The lowest shapes of a hanging sheet at the points of a garment, (points, shapes), of mean square 1 in all.

    The mean is over judged points, of which a series has one at least.
    """
    at = np.array([point.at_m for point in recording.garment.points], float)
    outline = np.array(recording.garment.outline_m, float)
    low, high = outline.min(0), outline.max(0)
    across, height = ((at - low) / np.maximum(high - low, 1e-9)).T
    rows = [
        np.cos(np.pi * i * across) * j0(zero * np.sqrt(np.clip(height, 0.0, 1.0))) / (i + k)
        for i in range(SHAPES_ACROSS)
        for k, zero in enumerate(jn_zeros(0, SHAPES_DOWN), 1)
    ]
    shapes = np.array(rows).T
    size = float((shapes[recording.judged] ** 2).sum(1).mean())
    return np.asarray(shapes / np.sqrt(max(size, 1e-12)))


def _root(recording: Recording, ringing: Ringing) -> Floats:
    """Square root of K in one axis at the points of a take [m per m], (points, frames, modes)."""
    time, shapes = recording.time, shapes_of(recording)
    apart = np.abs(time[:, None] - time)
    values, vectors = np.linalg.eigh(np.exp(-apart / ringing.decay) * np.cos(2 * np.pi * ringing.hertz * apart))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    enough = int(np.searchsorted(np.cumsum(values) / values.sum(), KEPT_VARIANCE)) + 1
    most = int(min(MOST_ENTRIES / (len(time) * shapes.size), 2 * FASTEST_MODE * float(np.ptp(time)))) + 1
    swings = (vectors * np.sqrt(values))[:, : min(enough, most)]
    root = shapes[:, None, :, None] * swings[None, :, None, :] / np.sqrt(3.0)
    return np.asarray(root.reshape(len(shapes), len(time), -1))
