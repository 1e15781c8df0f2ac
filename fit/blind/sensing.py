"""Simulated tracker: planted measurement faults, noise, missing points and the sensor's frame.

    time_offset        y(t) = x(t - tau)                    clock_drift   y(t) = x((1 - d) t)
    filter_lag         (tau/2 d/dt + 1)^2 y = x             two equal low-passes of total delay tau
    corner_erosion     points near the free corners move inwards along the diagonal, a e^(-(r / 20 mm)^2)
    tracker_smoothing  y = x + a (P x - x), P local-linear regression over neighbouring points; flat cloth stays
    depth_scale        y = x (1 + s (1 + (z / z0 - 1) / 2)) along the rays, growing with distance as disparity errors do
    noise              white, plus slow noise: first-order autoregressive, correlated over 0.3 s

Source: W. S. Cleveland, JASA 74 (1979), section 2 (local regression); K. Khoshelham & S. Oude Elberink, Sensors 12
(2012), section 4; G. E. P. Box & G. M. Jenkins, "Time Series Analysis" (1970), section 3.2.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from fit.blind.engine import SAMPLES_A_SECOND
from fit.blind.plants import Planted
from formats.arrays import Booleans, Floats

# of the white noise's deviation. Our choice: slow noise that is seen beside the white one. Half and double were not
# tried.
SLOW_PART = 1 / 3
SLOW_TIME = 0.3  # s; our choice: about the third of a second that a diagnosis assumes, half and double were not tried
HELD_SHARE = 0.3  # of the points' noise: fiducial markers are found better than cloth
CORNER_REACH = 0.02  # m; our choice: 7 px at 1.6 m and f = 576 px, half and double were not tried
GAP_FRAMES = 3  # frames: mean length of a gap of a point
# s of simulation beyond a take's end, for clocks that run ahead. Our choice: room for a clock that is fast. Half and
# double were not tried.
SPARE = 0.15


def reported_points(points: Floats, instants: Floats, flat: Floats, planted: tuple[Planted, ...]) -> Floats:
    """Return the points [m], (frames, points, 3), as reported by a tracker with the planted faults, without noise.

    points [m], (samples, points, 3), at `SAMPLES` a second; instants [s], (frames,); flat [m], (points, 2)
    """
    faults = {one.id: one for one in planted}
    if "filter_lag" in faults:
        points = lagged(points, faults["filter_lag"].amplitude)
    if "time_offset" in faults:
        instants = instants - faults["time_offset"].components[""]
    if "clock_drift" in faults:
        instants = instants * (1 - faults["clock_drift"].components[""])
    last = (len(points) - 1) / SAMPLES_A_SECOND
    seen = CubicSpline(np.arange(len(points)) / SAMPLES_A_SECOND, points)(np.clip(instants, 0.0, last))
    if "tracker_smoothing" in faults:
        smooth = np.einsum("pq,fqc->fpc", smoothing_matrix(flat), seen)
        seen = seen + faults["tracker_smoothing"].amplitude * (smooth - seen)
    if "corner_erosion" in faults:
        seen = eroded(seen, flat, faults["corner_erosion"].amplitude)
    return np.asarray(seen)


def lagged(points: Floats, delay: float) -> Floats:
    """Return points filtered by two equal first-order low-passes of this total delay [s]; at rest before the start.

    The filter is exact for points that move linearly between samples.
    """
    from scipy.signal import lfilter

    kept = np.exp(-2 / (SAMPLES_A_SECOND * delay))
    late = (1 - kept) * SAMPLES_A_SECOND * delay / 2
    columns = points.reshape(len(points), -1)
    for _ in range(2):
        columns = columns[0] + lfilter([1 - late, late - kept], [1.0, -kept], columns - columns[0], axis=0)
    return np.asarray(columns.reshape(points.shape))


def smoothing_matrix(flat: Floats) -> Floats:
    """Return the matrix of local-linear regression of points on their neighbours, (points, points).

    Affine shapes do not change."""
    apart = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    nearest = np.median(np.sort(apart, axis=1)[:, 1])
    weights = np.exp(-0.5 * (apart / (1.5 * nearest)) ** 2)
    rows = np.zeros_like(weights)
    for p in range(len(flat)):
        basis = np.column_stack([np.ones(len(flat)), flat - flat[p]])
        weighted = basis * weights[p][:, None]
        rows[p] = np.linalg.solve(basis.T @ weighted, weighted.T)[0]
    return np.asarray(rows)


def eroded(points: Floats, flat: Floats, amount: float) -> Floats:
    """Return the points [m], (frames, points, 3), with those near the free corners moved inwards by `amount` [m]."""
    low, high = flat.min(0), flat.max(0)
    inside = 0.3 * (high - low)
    moved = points.copy()
    for x, inwards in ((low[0], inside[0]), (high[0], -inside[0])):
        corner = np.array([x, low[1]])
        towards = int(np.argmin(np.linalg.norm(flat - corner - [inwards, inside[1]], axis=1)))
        near = np.exp(-((np.linalg.norm(flat - corner, axis=1) / CORNER_REACH) ** 2))
        way = points[:, towards][:, None] - points
        length = np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-6)
        moved += amount * near[None, :, None] * way / length
    return moved


def scaled(places: Floats, share: float, distance: float) -> Floats:
    """Return positions [m], (..., 3), sensor frame, scaled by an error that grows with the distance along z."""
    return np.asarray(places * (1 + share * (1 + 0.5 * (places[..., 2:] / distance - 1))))


def slow_noise(rng: np.random.Generator, shape: tuple[int, ...], rate: float) -> Floats:
    """Return noise of deviation 1, correlated over `SLOW_TIME` along the first axis."""
    from scipy.signal import lfilter

    kept = np.exp(-1 / (rate * SLOW_TIME))
    drawn = rng.normal(size=shape)
    drawn[1:] *= np.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], drawn, axis=0))


def gaps(rng: np.random.Generator, shape: tuple[int, int], share: float) -> Booleans:
    """Return which points are seen, (frames, points): each is missing for `share` of the time, a few frames at once."""
    away = np.zeros(shape, bool)
    starts = rng.random(shape) < share / GAP_FRAMES
    lengths = rng.geometric(1 / GAP_FRAMES, shape)
    for frame, point in zip(*np.nonzero(starts), strict=True):
        away[frame : frame + lengths[frame, point], point] = True
    return np.asarray(~away)


def sensor_frame(tilt: tuple[float, float]) -> Floats:
    """Return the rotation, (3, 3), from the world (z up) to a pitched and rolled [rad] sensor (y down, z away)."""
    level = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    (cp, cr), (sp, sr) = np.cos(tilt), np.sin(tilt)
    pitch = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    return np.asarray(roll @ pitch @ level)
