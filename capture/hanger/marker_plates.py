"""Compute a marker's 3D position from the depth of the plate that carries it.

A point (u, v) on the plate has the depth z of the plane through the plate's depth pixels (`capture.depth.surface`):

    position = z ((u - cx) / fx, (v - cy) / fy, 1)
    sd_x^2 = (z sd_centre / fx)^2 + (x / z sd_z)^2        likewise y,     sd_z from the plane fit

Depth may be shifted by (du, dv) px against colour (`formats.rig.Calibration`); the depth is then at (u+du, v+dv).

The pose from the four corners is a check (solvePnP, IPPE square: Collins and Bartoli, "Infinitesimal Plane-Based Pose
Estimation", IJCV 109, 2014). A marker only 17 pixels wide gives a depth to a few centimetres. The plate's depth pixels
give the depth to a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from capture.depth.surface import CorrelationMeter, fit_surface, pixel_sd
from capture.hanger.marker_detection import quad_side
from capture.hanger.pose import PlateSlope, plate_slope
from formats.arrays import Floats, Unsigned
from formats.rig import Sensor

MARKER_CENTRE_SD = 0.08  # px, rms of the centre against drawn markers of 17 px with noise and 8 ms blur: 0.04-0.08
CORNER_BIAS = 0.5  # px, a small blurred marker appears smaller by up to this at either side


@dataclass(frozen=True)
class Plate:
    """A plate in depth: depth [m] at the requested point and its sd [m]; its slope."""

    depth: float
    sd: float
    slope: PlateSlope


class Placed(NamedTuple):
    """A point on a plate: position and sd [m], (3,) each, sensor frame; the plate's slope."""

    position: Floats
    sd: Floats
    slope: PlateSlope | None


class PlatePlacer:
    """Computes 3D positions of markers of one size; also estimates the correlation of the sensor's depth noise."""

    def __init__(self, sensor: Sensor, marker_size: float, depth_offset: tuple[float, float] = (0.0, 0.0)) -> None:
        self.sensor = sensor
        self.marker_size = marker_size
        self.depth_offset = np.array(depth_offset)
        self.correlation = CorrelationMeter()
        half = marker_size / 2
        self._square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        self._matrix = np.array([[sensor.fx, 0, sensor.cx], [0, sensor.fy, sensor.cy], [0, 0, 1.0]])

    def pose_depth(self, quad: Floats) -> float:
        """Return the depth [m] of a marker with corners [px], (4, 2), by its size alone, or NaN."""
        if not np.isfinite(quad).all():
            return float("nan")
        seen, _, translation = cv2.solvePnP(self._square, quad, self._matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        return float(translation[2, 0]) if seen else float("nan")

    def range_by_size(self, side: float) -> float:
        """Return the distance [m] of a marker that faces the sensor from its side in pixels."""
        return self.sensor.fx * self.marker_size / side

    def place(
        self, quad: Floats, at: Floats, depth: Unsigned, *, in_view: Floats | None = None,
        centre_sd: float = MARKER_CENTRE_SD,
    ) -> Placed:  # fmt: skip
        """Return the 3D position of a point `at` [px] on a marker's plate, and the plate's slope.

        - `quad` [px], (4, 2): the marker's corners
        - `depth` [mm], (H, W)
        - `in_view` [px], (n, 2): outline of the visible part if the marker is partly covered
        - `centre_sd` [px]. NaN where depth is missing or contradicts the marker's size.
        """
        unknown = Placed(np.full(3, np.nan), np.full(3, np.nan), None)
        plate = self.plate_depth(quad if in_view is None else in_view, at, depth)
        if plate is None:
            return unknown
        pose_depth = self.pose_depth(quad)
        pose_sd = pose_depth * CORNER_BIAS / quad_side(quad)
        if not abs(pose_depth - plate.depth) <= 4.0 * float(np.hypot(pose_sd, plate.sd)):
            return unknown
        position, sd = self.on_ray(at, plate, centre_sd)
        return Placed(position, sd, plate.slope)

    def on_ray(self, at: Floats, plate: Plate, centre_sd: float = MARKER_CENTRE_SD) -> tuple[Floats, Floats]:
        """Return position and sd [m], (3,) each, of a point `at` [px] at a depth."""
        s, z = self.sensor, plate.depth
        ray = np.array([(at[0] - s.cx) / s.fx, (at[1] - s.cy) / s.fy, 1.0])
        across = np.array([z * centre_sd / s.fx, z * centre_sd / s.fy, 0.0])
        return z * ray, np.hypot(across, ray * plate.sd)

    def plate_depth(self, outline: Floats, at: Floats, depth: Unsigned) -> Plate | None:
        """Return the depth at a point `at` [px] of the plane within a convex outline [px of colour], (n, 2)."""
        outline, at = outline + self.depth_offset, at + self.depth_offset
        height, width = depth.shape
        left, top = np.maximum(np.floor(outline.min(0)).astype(int), 0)
        right, bottom = np.minimum(np.ceil(outline.max(0)).astype(int) + 1, [width, height])
        if right - left < 3 or bottom - top < 3:
            return None
        patch = depth[top:bottom, left:right]
        inside = np.zeros(patch.shape, dtype=np.uint8)
        cv2.fillConvexPoly(inside, np.rint(outline - [left, top]).astype(np.int32), 1)
        rows, columns = np.nonzero((inside > 0) & (patch > 0))
        fitted = fit_surface(
            columns + (left - at[0]),
            rows + (top - at[1]),
            patch[rows, columns].astype(np.float64) * 1e-3,
            focal_length=self.sensor.fx,
            spread=self.marker_size,
            correlated_pixels=self.correlation.pixels,
        )
        if fitted is None:
            return None
        residuals = np.zeros(patch.shape)
        used = np.zeros(patch.shape, dtype=bool)
        residuals[rows, columns] = fitted.residuals / pixel_sd(fitted.depth, self.sensor.fx)
        used[rows, columns] = fitted.used
        self.correlation.add(residuals, used)
        slope = plate_slope(fitted, at - self.depth_offset, self.sensor, self.correlation.pixels)
        return Plate(fitted.depth, fitted.sd, slope)
