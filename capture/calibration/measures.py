"""Gravity, depth scale, depth offset and held ends of a rig from still frames, each with its standard deviation.

A quantity seen in n still frames is their median, with the standard deviation of a median of correlated normal values:

    sd(median)^2 = (pi / 2) sigma^2 / n_eff,    sigma = 1.4826 median|x - median|,    n_eff = n (1 - r) / (1 + r)

with r the correlation of neighbouring frames. Averaging does not remove errors that are the same in every frame. So
these are added:

    depth       step(z) / sqrt(12), step(z) = z^2 / (8 f b): rounded disparity     a position     CENTRE_SD z / f
    plumb line  g = (p_b - p_a) / L,       sd(g)^2 = (s_a^2 + s_b^2 + 2 MOUNTING_SD^2) / L^2       about either axis
    scale       s = d / D,                 sd(s)^2 = s^2 ((sd(d) / d)^2 + (DISTANCE_SD / D)^2)
    held ends   h = R^T (p - m),           sd(h)^2 = s_p^2 + s_m^2 + MOUNTING_SD^2 + (sd(g) |h|)^2
    offset      du = mean_k (centre of plate k in depth - of its marker in colour)
                                           sd(du)^2 = sum_k (s_k^2 + (f CUT_SD / z_k)^2) / k^2

The plumb line's two markers are at p_a and p_b. The hanger's markers are d apart as measured and D apart by the rig; m
is midway between them. R is the hanger's frame (`formats.hanger`).
Sources: median and its deviation: P. J. Huber, "Robust Statistics" (1981), chapters 3 and 5; correlated samples:
G. V. Bayley, J. M. Hammersley, J. R. Statist. Soc. Suppl. 8 (1946); rounding: `capture.depth.surface`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.depth.surface import DISPARITY_STEPS
from capture.hanger.marker_plates import MARKER_CENTRE_SD
from firmware_host.depth_sensor import BASELINE
from formats.arrays import Floats
from formats.hanger import hanger_frame
from formats.rig import Rig, Sensor

MOUNTING_SD = 1e-3  # m, a printed marker stuck by eye to a plumb line or held by a clip at its black edge
DISTANCE_SD = 0.5e-3  # m, a distance read off a ruler with millimetres
CUT_SD = 0.7e-3  # m, middle of a plate whose two edges are each cut to a millimetre; 1 mm / sqrt(2)


@dataclass(frozen=True)
class Estimate:
    """A measured quantity and its standard deviation, in the same unit and shape."""

    value: Floats
    sd: Floats


def median_of_frames(values: Floats) -> Estimate:
    """Return the median over frames, and its sd, of values, (frames, ...), NaN where missing; NaN below two frames."""
    flat = values.reshape(len(values), -1)
    middle, sd = np.full(flat.shape[1], np.nan), np.full(flat.shape[1], np.nan)
    for column in range(flat.shape[1]):
        seen = flat[np.isfinite(flat[:, column]), column]
        if seen.size < 2:
            continue
        middle[column] = np.median(seen)
        away = seen - middle[column]
        sigma = 1.4826 * float(np.median(np.abs(away)))
        power = float(away @ away)
        correlation = np.clip(float(away[1:] @ away[:-1]) / power, 0.0, 0.95) if power > 0.0 else 0.0
        effective = seen.size * (1.0 - correlation) / (1.0 + correlation)
        sd[column] = np.sqrt(0.5 * np.pi / max(effective, 1.0)) * sigma
    return Estimate(middle.reshape(values.shape[1:]), sd.reshape(values.shape[1:]))


def place_of_frames(positions: Floats, sensor: Sensor) -> Estimate:
    """Return the position of a still marker [m], (3,), from (frames, 3); the sd includes the systematic errors."""
    place = median_of_frames(positions)
    z = float(place.value[2])
    rounding = z**2 / (DISPARITY_STEPS * BASELINE * sensor.fx) / np.sqrt(12.0)
    along_ray = place.value / z * rounding
    across = np.array([z * MARKER_CENTRE_SD / sensor.fx, z * MARKER_CENTRE_SD / sensor.fy, 0.0])
    return Estimate(place.value, np.sqrt(place.sd**2 + along_ray**2 + across**2))


def gravity_of_plumb_line(upper: Estimate, lower: Estimate) -> Estimate:
    """Return gravity's unit vector, (3,), from the line's two markers [m]; sd [rad], (), about either axis."""
    line = lower.value - upper.value
    length = float(np.linalg.norm(line))
    direction = line / length
    square = np.eye(3) - np.outer(direction, direction)
    variance = 0.5 * float(np.trace(square @ np.diag(upper.sd**2 + lower.sd**2))) + 2.0 * MOUNTING_SD**2
    return Estimate(direction, np.asarray(np.sqrt(variance) / length))


def depth_scale(left: Estimate, right: Estimate, distance: float) -> Estimate:
    """Return measured over true depth, (), from the hanger's two markers [m] and their true distance [m]."""
    line = right.value - left.value
    measured = float(np.linalg.norm(line))
    along = float(np.sqrt((line / measured) ** 2 @ (left.sd**2 + right.sd**2)))
    # The markers lie across the view, so an error of depth scales both positions alike.
    mean_depth = 0.5 * float(left.value[2] + right.value[2])
    common = measured / mean_depth * float(np.hypot(left.sd[2], right.sd[2])) / 2.0
    scale = measured / distance
    return Estimate(
        np.asarray(scale),
        np.asarray(scale * np.sqrt((along**2 + common**2) / measured**2 + (DISTANCE_SD / distance) ** 2)),
    )


def held_ends_seen(left: Estimate, right: Estimate, ends: list[Estimate], gravity_sd: float, rig: Rig) -> Estimate:
    """Return the ends of the held edge in the hanger's frame [m], (2, 3), from positions in the sensor's frame.

    left, right: the hanger's markers; ends: the clips' holding points, left first; gravity_sd [rad].
    """
    frame = hanger_frame(np.stack([left.value, right.value]), rig)
    middle = 0.5 * (left.value + right.value)
    middle_variance = 0.25 * (left.sd**2 + right.sd**2)
    offsets, deviations = [], []
    for end in ends:
        offset = frame.T @ (end.value - middle)
        variance = (frame.T**2) @ (end.sd**2 + middle_variance)
        offsets.append(offset)
        deviations.append(np.sqrt(variance + MOUNTING_SD**2 + (gravity_sd * np.linalg.norm(offset)) ** 2))
    return Estimate(np.stack(offsets), np.stack(deviations))


def mean_offset(offsets: list[Estimate], depths: list[float], sensor: Sensor) -> Estimate:
    """Return the offset of depth against colour [px], (2,), from offsets of single plates and their depths [m]."""
    value, sd = np.full(2, np.nan), np.full(2, np.nan)
    focal = np.array([sensor.fx, sensor.fy])
    for axis in range(2):
        seen = [k for k in range(len(offsets)) if np.isfinite(offsets[k].value[axis])]
        if not seen:
            continue
        value[axis] = np.mean([offsets[k].value[axis] for k in seen])
        cut = [focal[axis] * CUT_SD / depths[k] for k in seen]
        stray = [float(offsets[k].sd[axis]) for k in seen]
        sd[axis] = np.sqrt(np.sum(np.square(cut) + np.square(stray))) / len(seen)
    return Estimate(value, sd)
