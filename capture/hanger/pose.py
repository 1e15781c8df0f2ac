"""The hanger's pitch about its bar, from the planes of its two marker plates in depth.

Two points fix a pose except for the rotation about the line between them. A plate's plane n . X = d is linear in
inverse depth,

    1/z = (n_x (u - cx) / fx + n_y (v - cy) / fy + n_z) / d

and in the hanger's axes y (down) and z (`formats.hanger`) the pitch is

    pitch = atan2(n . y, n . z),        sd = (s / z) fy sqrt(pixels / sum (v - v_mean)^2)

with the pixel noise s and its correlated pixels (`capture.depth.surface`). Positive: the plate's lower edge is nearer
than its upper one. The plates' pitches are averaged by their variances. A plate that is mounted askew adds its angle:
compare with the still beginning of a take.

Source: a plane in inverse depth, as in `capture.depth.surface`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from capture.depth.surface import SurfaceDepth, pixel_sd
from formats.arrays import Floats
from formats.hanger import hanger_frame
from formats.rig import Rig, Sensor


@dataclass(frozen=True)
class PlateSlope:
    """A plate's normal over its distance to the sensor [1/m], (3,), pointing away, and the sd of its pitch [rad]."""

    normal: Floats
    sd: float


def plate_slope(plate: SurfaceDepth, at: Floats, sensor: Sensor, correlated_pixels: float) -> PlateSlope:
    """Return the slope of a plate whose depth was fitted at a point `at` [px], (2,)."""
    b, c = plate.slope / -(plate.depth**2)
    nz = 1.0 / plate.depth + b * (sensor.cx - at[0]) + c * (sensor.cy - at[1])
    sd = pixel_sd(plate.depth, sensor.fx) / plate.depth * sensor.fy * math.sqrt(correlated_pixels) / plate.height
    return PlateSlope(np.array([b * sensor.fx, c * sensor.fy, nz]), sd)


def hanger_pitch(positions: Floats, slopes: list[PlateSlope | None], rig: Rig) -> tuple[float, float]:
    """Return the hanger's pitch and its sd [rad] from its markers' positions [m], (2, 3); NaN if not measurable."""
    known = [slope for slope in slopes if slope is not None]
    if not known or not np.isfinite(positions).all():
        return float("nan"), float("nan")
    _, y, z = hanger_frame(positions, rig).T
    weights = [slope.sd**-2 for slope in known]
    pitches = [math.atan2(slope.normal @ y, slope.normal @ z) for slope in known]
    mean = sum(weight * pitch for weight, pitch in zip(weights, pitches, strict=True)) / sum(weights)
    return mean, sum(weights) ** -0.5
