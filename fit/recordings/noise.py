"""White noise of a recording's points and hanger path: the stated noise, or the measured one if this is surely larger.

Sixth differences of the frames measure the noise. Below 20 frames a second, swings contribute to them as well. There
the noise is the deviation of points at rest, before the hanger first moves.

A short take measures each point's noise poorly, and the larger of two poor estimates is too large. So the variances v_p
of P points are drawn towards their mean, by the share of their spread S^2 that chance alone makes,

    v_p' = mean + (1 - B) (v_p - mean),   B = min(1, (P - 3) / (P - 1) t mean^2 / S^2)

with the relative variance t of one estimate. A point that is noisier than chance allows keeps its noise. Measured noise
replaces the stated one where chance seldom makes all points, or one of them, so much noisier (chi square).

Sources: C. N. Morris, "Parametric empirical Bayes inference: theory and applications", J. American Statistical
Association 78 (1983), section 1 (drawing together); T. A. Bancroft, "On biases in estimation due to the use of
preliminary tests of significance", Annals of Mathematical Statistics 15 (1944), section 2.
"""

from __future__ import annotations

import numpy as np

from fit.recordings.camera import FEWEST_RESTING_FRAMES, is_still
from fit.recordings.recording import Recording
from fit.recordings.smoothing import noise_of
from formats.arrays import Floats

SLOWEST_RATE = 20.0  # frames/s: below, swings contribute to sixth differences
FEWEST_FOR_DIFFERENCES = 11  # five sixth differences
DIFFERENCED, AXES_OF_A_POINT = 6, 3  # frames less than differences; axes of a point
FEWEST_TOGETHER = 3  # points, up to which the formula of Morris draws none of them
# Of the squared median of m sixth differences of white noise. Its mean exceeds the variance by the first number over m.
# Its relative variance is the second number over m. Simulated with 20,000 columns of 11 to 300 frames each: 4.4 to 5.5,
# and 12 to 15 from 40 frames on.
MEDIAN_BIAS, MEDIAN_VARIANCE = 5.0, 13.5
NOISIER_BY_CHANCE = 0.05  # probability that chance makes a take, or one of its points, noisier than stated; as is usual


def point_noise(recording: Recording) -> Floats:
    """Return each point's standard deviation per axis [m], (points,)."""
    stated, seen = recording.point_sd, white_noise(recording)
    if seen is None:
        return stated
    chance = by_chance(recording)
    whole = (seen**2).sum() > _largest(chance.mean() / len(seen), NOISIER_BY_CHANCE) * (stated**2).sum()
    one = seen**2 > _largest(chance, NOISIER_BY_CHANCE / len(seen)) * stated**2
    return np.where(whole | one, np.maximum(stated, seen), stated)


def white_noise(recording: Recording) -> Floats | None:
    """Return each point's noise per axis [m], (points,); None for a slow take that does not begin at rest."""
    chance = by_chance(recording)
    if _is_fast(recording):
        every = [_white(recording.points[recording.valid[:, k], k]) for k in range(len(chance))]
        return _drawn_together(np.array(every), chance)
    count = _at_rest(recording, recording.time)
    points = np.where(recording.valid[:count, :, None], recording.points[:count], np.nan)
    known = np.isfinite(points[..., 0]).sum(0) >= FEWEST_RESTING_FRAMES
    if not known.any():
        return None
    found = _drawn_together(np.sqrt(np.nanvar(points[:, known], axis=0, ddof=1).mean(1)), chance[known])
    noise = np.full(len(known), np.median(found))  # for points that are not seen at rest
    noise[known] = found
    return noise


def by_chance(recording: Recording) -> Floats:
    """Return the relative variance of each point's squared white noise by chance, (points,)."""
    if _is_fast(recording):
        return np.asarray(MEDIAN_VARIANCE / AXES_OF_A_POINT / np.maximum(recording.valid.sum(0) - DIFFERENCED, 1))
    resting = recording.valid[: _at_rest(recording, recording.time)].sum(0)
    return np.asarray(2 / AXES_OF_A_POINT / np.maximum(resting - 1.0, 1.0))


def held_noise(recording: Recording) -> Floats:
    """Return the standard deviation of each coordinate of the held ends [m], (6,): depth is noisier than the others."""
    if _is_fast(recording):
        seen = recording.held_seen[np.isfinite(recording.held_seen[:, 0])]
        return np.array([_white(column[:, None]) for column in seen.T])
    count = _at_rest(recording, recording.time if recording.held_time is None else recording.held_time)
    seen = recording.held_seen[:count]
    seen = seen[np.isfinite(seen[:, 0])]
    if len(seen) < FEWEST_RESTING_FRAMES:
        return np.full(6, recording.held_sd)
    return np.asarray(seen.std(0, ddof=1))


def _is_fast(recording: Recording) -> bool:
    """Return whether the frame rate is high enough for sixth differences to be free of motion."""
    return (len(recording.time) - 1) / recording.duration >= SLOWEST_RATE


def _at_rest(recording: Recording, time: Floats) -> int:
    """Return the number of instants [s] before the hanger first moves."""
    moves = np.flatnonzero(~is_still(time, recording.held))
    return int(moves[0]) if len(moves) else len(time)


def _white(columns: Floats) -> float:
    """Return the root mean square deviation of white noise in columns, (frames, n); 0 for too few frames."""
    if len(columns) < FEWEST_FOR_DIFFERENCES:
        return 0.0
    excess = 1 + MEDIAN_BIAS / (len(columns) - DIFFERENCED)
    return float(np.sqrt(np.mean([noise_of(column) ** 2 for column in columns.T]) / excess))


def _largest(variance: Floats, probability: float) -> Floats:
    """Return the limit that a squared noise over the stated one exceeds by chance with a probability.

    variance: its relative variance, as chi square's over its k degrees of freedom, 2 / k
    """
    from scipy.special import chdtri

    return np.asarray(chdtri(2 / variance, probability) * variance / 2)


def _drawn_together(noise: Floats, spread: Floats) -> Floats:
    """Return deviations, (points,), whose squares are drawn towards their mean as far as chance explains their spread.

    spread, (points,): relative variance of each square by chance; a deviation of 0 is unknown and stays
    """
    known = noise > 0
    count = int(known.sum())
    if count <= FEWEST_TOGETHER:
        return noise
    squares = noise[known] ** 2
    mean = float(squares.mean())
    by_chance = float(spread[known].mean()) * mean**2
    share = min(1.0, (count - 3) / (count - 1) * by_chance / max(float(squares.var(ddof=1)), 1e-30 * mean**2))
    drawn = noise.copy()
    drawn[known] = np.sqrt(mean + (1 - share) * (squares - mean))
    return drawn
