"""How far the hanger pitches about its bar, from the planes of its two marker plates in depth.

Two places say everything of a pose but the turn about the line between them. A plate's plane n . X = d is linear in
inverse depth,

    1/z = (n_x (u - cx) / fx + n_y (v - cy) / fy + n_z) / d

and in the hanger's axes y (down) and z (`formats.hanger`) the pitch is

    pitch = atan2(n . y, n . z),        sd = (s / z) fy sqrt(pixels / sum (v - v_mean)^2)

with the pixel noise s and its correlated pixels (`capture.depth_surface`). Positive: the plate's lower edge is nearer
than its upper one. Both plates are averaged by their variances. A plate that is mounted askew adds its own angle:
compare with the still beginning of a take. Source: a plane in inverse depth, as in `capture.depth_surface`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.depth_surface import pixel_sd
from formats.hanger import hanger_frame
from formats.rig import Rig, Sensor

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PlateSlope:
    """A plate's normal over its distance to the sensor [1/m], (3,), pointing away, and the sd of its pitch [rad]."""

    normal: Floats
    sd: float


def plate_slope(u: Floats, v: Floats, z: Floats, sensor: Sensor, correlated_pixels: float) -> PlateSlope | None:
    """Fit a plane to a plate's pixels: u, v [px], z [m], (pixels,); None where they lie on a line."""
    columns = np.stack([np.ones_like(z), (u - sensor.cx) / sensor.fx, (v - sensor.cy) / sensor.fy])
    spread = float(((v - v.mean()) ** 2).sum()) if v.size else 0.0
    if v.size < 12 or spread < 1.0 or np.ptp(u) < 1.0:
        return None
    nz, nx, ny = np.linalg.lstsq(columns.T, 1.0 / z, rcond=None)[0]
    middle = float(np.median(z))
    sd = pixel_sd(middle, sensor.fx) / middle * sensor.fy * np.sqrt(correlated_pixels / spread)
    return PlateSlope(np.array([nx, ny, nz]), float(sd))


def hanger_pitch(positions: Floats, slopes: list[PlateSlope | None], rig: Rig) -> tuple[float, float]:
    """Return the hanger's pitch and its sd [rad] from its markers' places [m], (2, 3); NaN where it cannot be seen."""
    known = [slope for slope in slopes if slope is not None]
    if not known or not np.isfinite(positions).all():
        return float("nan"), float("nan")
    _, y, z = hanger_frame(positions, rig).T
    pitches = np.array([np.arctan2(slope.normal @ y, slope.normal @ z) for slope in known])
    weights = np.array([slope.sd**-2 for slope in known])
    return float(weights @ pitches / weights.sum()), float(weights.sum() ** -0.5)
