"""Compute the 3D position of a pixel of the garment from the depth of the cloth around it.

    position = z(u, v) ((u - cx) / fx, (v - cy) / fy, 1),    z of the plane through the cloth around (u, v)
    sd_z^2 = sd_plane^2 + (dz/du sd_u)^2 + (dz/dv sd_v)^2    on steep cloth an error of the pixel changes the depth
    sd_x^2 = (z sd_u / fx)^2 + (x / z sd_z)^2                likewise y

The pixels at the rim of the cloth are missing or mixed with the background, so the plane is fitted to the inner ones.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from capture.depth.surface import CorrelationMeter, fit_surface
from capture.garment.silhouette import Silhouette
from formats.arrays import Floats
from formats.rig import Sensor

PATCH_RADIUS = 14  # px around a point whose cloth determines its depth: 39 mm at 1.6 m, flat to 1 mm
# px at the silhouette's edge whose depth may be mixed. Our choice: 1 and 4 place all garments of
# `test_garment_points.py` as well.
MIXED_RIM = 2
# m, how far a steep cloth reaches in depth across the patch. Our choice: half and double place all garments of
# `test_garment_points.py` as well.
PATCH_SPREAD = 0.06
CORE = np.ones((2 * MIXED_RIM + 1, 2 * MIXED_RIM + 1), np.uint8)  # px: erodes by MIXED_RIM


def project(places: Floats, sensor: Sensor) -> Floats:
    """Return the pixels, (..., 2), of positions [m], (..., 3), sensor frame."""
    u = sensor.fx * places[..., 0] / places[..., 2] + sensor.cx
    v = sensor.fy * places[..., 1] / places[..., 2] + sensor.cy
    return np.stack([u, v], axis=-1)


class Placer:
    """Computes 3D positions of pixels of one silhouette."""

    def __init__(self, silhouette: Silhouette, sensor: Sensor, correlation: CorrelationMeter) -> None:
        self._silhouette, self._sensor, self._correlation = silhouette, sensor, correlation

    def place(self, pixel: Floats, sd_px: Floats) -> tuple[Floats, Floats]:
        """Return position and sd [m], (3,) each, of the cloth at a pixel of the image; NaN without depth there.

        sd_px [px], (2,): of the pixel, along u and v.
        """
        if not np.isfinite(pixel).all():
            return np.full(3, np.nan), np.full(3, np.nan)
        window, s = self._silhouette.window, self._sensor
        u, v = pixel[0] - window.left, pixel[1] - window.top
        h, w = self._silhouette.mask.shape
        left, right = (min(max(int(u) + step, 0), w) for step in (-PATCH_RADIUS, PATCH_RADIUS + 1))
        top, bottom = (min(max(int(v) + step, 0), h) for step in (-PATCH_RADIUS, PATCH_RADIUS + 1))
        # A little wider, so that the patch's own border is not taken for the cloth's.
        wide = (slice(max(top - MIXED_RIM, 0), bottom + MIXED_RIM), slice(max(left - MIXED_RIM, 0), right + MIXED_RIM))
        core = cv2.erode(self._silhouette.mask[wide], CORE, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        inner = (slice(top - wide[0].start, None), slice(left - wide[1].start, None))
        patch = self._silhouette.depth[top:bottom, left:right]
        chosen = (core[inner][: bottom - top, : right - left] > 0) & (patch > 0)
        rows, columns = np.nonzero(chosen)
        surface = fit_surface(
            columns + (left - u),
            rows + (top - v),
            patch[chosen].astype(np.float64),
            focal_length=s.fx,
            spread=PATCH_SPREAD,
            correlated_pixels=self._correlation.pixels,
        )
        if surface is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        ray = np.array([(pixel[0] - s.cx) / s.fx, (pixel[1] - s.cy) / s.fy, 1.0])
        across = surface.depth * np.array([sd_px[0] / s.fx, sd_px[1] / s.fy, 0.0])
        along = math.hypot(surface.sd, *(sd_px * surface.slope))
        return surface.depth * ray, np.hypot(across, ray * along)
