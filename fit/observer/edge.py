"""Residuals of the tracked points on the held edge: evidence on how the cloth is held and on the measurement.

Hanger and effects alone place a simulated edge; no parameter of the cloth moves it. In each frame the displacements d_p
= y_p - x_p of the edge's points are split by least squares. The points lie at positions s_p from their middle:

    d_p = m + s_p q,   four numbers: m (3), and the stretch q . b along the bar b, times the rms of s_p

Turning is left out, because it drives `hanger_rotation` (`fit.recordings.held_edge`). Like the cloth's residuals, the
numbers are split in two parts. The noise of points and path limits the varying part. The points' own offsets
(`Recording.offset_sd`) limit the mean over a take:

    dynamic  (d - mean d) / sqrt(sigma^2 + path^2)
    static  mean d / sqrt(offset^2 + ends^2 + (sigma^2 + path^2) / n)

with the error `ends` of the held ends' positions on the hanger, if the rig states one.

The middle of a silhouette's row has an error of its own, which its points share (`fit.recordings.row_and_rest`). It
adds to `path`.

The path's noise is the part of white noise that passes its spline. A steady spline (`fit.recordings.smoothing`) of
cut-off f_c at n frames a second passes this share of the variance:

    (2 / n) integral df / (1 + (f / f_c)^6)^2 = (5 pi / 9) f_c / n

Slow noise of a third of the white noise, lasting a third of a second, makes four times white noise's scores. It adds a
tenth to the squares. So fifteen of these variances in the varying part count as certain. A marker's own offset is the
same in all takes. So a constant error counts once, as the mean over takes of a sum of four squares. Without a constant
error the sum follows chi^2(4), and 25 is exceeded once in 20000 times. Both parts are added in multiples of a certain
error (`shown`).

Source: the integral: I. S. Gradshteyn & I. M. Ryzhik, "Table of Integrals, Series, and Products" (2007), 3.241.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.recordings.noise import held_noise, point_noise
from fit.recordings.recording import Recording
from formats.arrays import Floats, Integers

KEPT_NOISE = 5 * np.pi / 9  # of the variance of white noise, per cut-off over rate
# m: error of a held edge that is taken from its row at rest. Some 30 frames with 3 mm of white noise leave 0.55 mm, and
# slow noise doubles that (four times the scores, above).
FROM_ROW = 1e-3
FEWEST_STRETCH_POINTS = 2  # for one stretch
NUMBERS_A_FRAME = 4  # of a frame: three of the middle, one of the stretch
MOVING_CERTAIN, RESTING_CERTAIN = (
    60.0,
    25.0,
)  # squared deviations that no noise makes: of the varying part, and of the constant one
# Of its count: the largest sum of squares that noise makes of the varying part. Slow noise adds a tenth (above). Our
# choice: a take may also state its noise 2 % too small. Half and double of the 0.15 were not tried.
MOVING_NOISE = 1.15
# Of the edge's error beyond noise: the share that an effect must remove to be seen there. Our choice: most of it.
MOST_REMOVED = 0.5
# Of the edge's error without either of two effects, or of a gap: the share that a sound law may leave. On the two
# development sets of decision 20 every right name stayed below the limits with it, and no wake did.
LEAST_BY_LAW = 0.05


@dataclass(frozen=True)
class EdgeErrors:
    """Error of a model at the held edges of some takes, in squared deviations.

    - `moving`: sum of the `count` squares of the varying part
    - `resting`: the constant part, as a mean over takes
    - `mm`: root mean square over frames of the four numbers together [mm]
    """

    moving: float = 0.0
    count: int = 0
    resting: float = 0.0
    mm: float = 0.0

    @property
    def shown(self) -> float:
        """Sum of both parts, in multiples of an error beyond all noise; only differences of models have a meaning."""
        return self.moving / MOVING_CERTAIN + self.resting / RESTING_CERTAIN

    @property
    def beyond_noise(self) -> float:
        """The part of the error that exceeds the noise, in multiples of an error beyond all noise."""
        moving = max(self.moving - MOVING_NOISE * self.count, 0.0)
        return moving / MOVING_CERTAIN + max(self.resting - NUMBERS_A_FRAME, 0.0) / RESTING_CERTAIN


def is_seen_on_edge(before: EdgeErrors, after: EdgeErrors, by_law: float = 0.0) -> bool:
    """Return whether an effect moves the simulated held edge most of the way to the tracked one.

    `by_law` is the error that laws of earlier effects may leave there, in multiples of a certain error. The effect must
    remove more.
    """
    is_enough = before.shown - after.shown > max(1.0, by_law)
    return is_enough and after.beyond_noise <= (1 - MOST_REMOVED) * before.beyond_noise


def is_favoured_by_edge(one: EdgeErrors, other: EdgeErrors, without: EdgeErrors) -> bool:
    """Return whether the held edge favours the second model's effect; `without` is the error with neither effect."""
    return one.shown - other.shown > max(1.0, LEAST_BY_LAW * (without.shown - other.shown))


def is_edge_explained(errors: EdgeErrors, by_law: float = 0.0) -> bool:
    """Return whether the held edge agrees with a model, within noise and the spread of laws."""
    return errors.beyond_noise <= max(1.0, by_law)


def edge_errors(take: Integers, frame: Integers, whitened: Floats, sd: Floats) -> EdgeErrors:
    """Sum the residuals at held edges; all arrays (numbers,), `frame` -1 for means over a take, sd in metres."""
    if not len(whitened):
        return EdgeErrors()
    still = frame < 0
    takes = np.unique(take)
    apart = whitened * sd
    squares, frames = 0.0, 0
    for k in takes:
        moving = apart[(take == k) & ~still].reshape(-1, NUMBERS_A_FRAME)
        squares += float(((moving + apart[(take == k) & still]) ** 2).sum())
        frames += len(moving)
    return EdgeErrors(
        moving=float((whitened[~still] ** 2).sum()), count=int((~still).sum()),
        resting=float((whitened[still] ** 2).sum()) / len(takes), mm=1e3 * float(np.sqrt(squares / frames)),
    )  # fmt: skip


class EdgeResiduals:
    """Residuals of one recording's held edge; empty if the edge is not tracked or its points are judged as cloth.

    - `frame`, (frames,): indices of the frames that count
    - `sd` [m], (frames, NUMBERS_A_FRAME): of the numbers
    - `static_sd` [m]: of their means, (NUMBERS_A_FRAME,), or (0,) if no frame counts
    """

    def __init__(self, recording: Recording) -> None:
        on_edge = np.flatnonzero(~recording.judged)
        across = np.array([recording.garment.points[k].at_m[0] for k in on_edge])
        arm = across - across.mean() if len(across) else across
        seen = recording.valid[:, on_edge]
        weight = seen.astype(float)
        count, first, second = weight.sum(1), weight @ arm, weight @ arm**2
        determinant = count * second - first**2
        spread = float((arm**2).sum())
        self.frame = np.flatnonzero((count >= FEWEST_STRETCH_POINTS) & (determinant > 0.1 * count * spread))
        if not len(self.frame):
            self.sd, self.static_sd = np.zeros((0, NUMBERS_A_FRAME)), np.zeros(0)
            return
        weight, determinant = weight[self.frame], determinant[self.frame, None]
        self._points = on_edge
        self._middle = weight * (second[self.frame, None] - first[self.frame, None] * arm) / determinant
        self._slope = weight * (count[self.frame, None] * arm - first[self.frame, None]) / determinant
        self._arm = float(np.sqrt(spread / len(arm)))
        held = recording.held(recording.time[self.frame]).reshape(-1, 2, 3)
        self._bar = held[:, 1] - held[:, 0]
        self._bar /= np.linalg.norm(self._bar, axis=1, keepdims=True)
        self._measured = np.nan_to_num(recording.points[self.frame][:, on_edge])
        rate = (len(recording.time) - 1) / recording.duration
        path = float(np.sqrt((held_noise(recording) ** 2).mean() * KEPT_NOISE * recording.held_cut_off / rate / 2))
        path = float(np.hypot(path, recording.camera.row_off))
        squared = point_noise(recording)[on_edge] ** 2
        weights = np.stack([*[self._middle] * 3, self._arm * self._slope], 1)
        self.sd = np.sqrt(weights**2 @ squared + path**2)
        # An edge that was estimated from its own row has no offset from this row.
        own = FROM_ROW if recording.camera.edge is not None else recording.offset_sd
        offsets = own * np.linalg.norm(weights.sum(0) / len(weights), axis=1)
        width = float(np.linalg.norm(held[:, 1] - held[:, 0], axis=1).mean())
        # Independent errors e of two ends leave an error e / sqrt(2) of the middle and sqrt(2) e of the distance.
        ends = recording.held_error * np.array([*[np.sqrt(0.5)] * 3, np.sqrt(2.0) * self._arm / width])
        self.static_sd = np.sqrt(offsets**2 + ends**2 + (self.sd**2).sum(0) / len(weights) ** 2)

    def of(self, simulated: Floats) -> tuple[Floats, Floats]:
        """Return dynamic and static residuals, (candidates, 4 frames) and (candidates, 4), of (..., points, 3) [m]."""
        if not len(self.frame):
            return np.zeros((len(simulated), 0)), np.zeros((len(simulated), 0))
        apart = self._measured - simulated[:, self.frame][:, :, self._points]
        middle = np.einsum("fp,cfpx->cfx", self._middle, apart)
        stretch = self._arm * np.einsum("fp,cfpx,fx->cf", self._slope, apart, self._bar)
        numbers = np.concatenate([middle, stretch[..., None]], 2)
        mean = numbers.mean(1)
        return ((numbers - mean[:, None]) / self.sd).reshape(len(simulated), -1), mean / self.static_sd
