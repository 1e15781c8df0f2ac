"""The slant of the cloth at its visible edge: at a fold, cloth bends away from the sensor.

For the plane through the cloth around a point at the edge (`capture.depth.surface`)

    outwards = atan(slope of depth away from the cloth's middle there)     [rad], positive where it recedes
    across   = |atan(slope along the edge)|                                [rad]

A corner that is bent towards the sensor comes nearer outwards: it is in view, however short it looks. A corner that is
folded away lies behind cloth that recedes, and mostly straight outwards.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from capture.depth.surface import fit_surface
from capture.garment.silhouette import Silhouette
from formats.arrays import Floats
from formats.rig import Sensor

FITTED_AROUND = 0.05  # m: the best of 20, 30, 35, 40, 50 and 70 mm on development cloths left out of the fit
# m, how far steep cloth reaches in depth from the middle of these. Our choice: half and double place all garments of
# `test_garment_points.py` as well.
SPREAD = 0.06


class Slant(NamedTuple):
    """Angles [rad] of the cloth at its edge, see above; 0 if too few of its pixels have depth."""

    outwards: float
    across: float


UPRIGHT = Slant(0.0, 0.0)


def rim_slant(silhouette: Silhouette, pixel: Floats, depth: float, sensor: Sensor) -> Slant:
    """Return the slant at a pixel [px of the image], (2,), of the silhouette's edge, whose cloth is at a depth [m]."""
    u, v = pixel[0] - silhouette.window.left, pixel[1] - silhouette.window.top
    far = FITTED_AROUND * sensor.fx / depth
    top, left = max(0, int(v - far)), max(0, int(u - far))
    around = slice(top, max(0, int(v + far) + 1)), slice(left, max(0, int(u + far) + 1))
    rows, columns = np.nonzero(silhouette.mask[around])
    down, across = rows + (top - v), columns + (left - u)
    inside = down**2 + across**2 <= far**2
    down, across = down[inside], across[inside]
    z = silhouette.depth[around][rows[inside], columns[inside]].astype(np.float64)
    known = z > 0
    surface = fit_surface(
        across[known], down[known], z[known], focal_length=sensor.fx, spread=SPREAD, correlated_pixels=1.0
    )
    if surface is None:
        return UPRIGHT
    out = -np.array([across.mean(), down.mean()])
    out /= max(float(np.linalg.norm(out)), 1e-9)
    slope = surface.slope * sensor.fx / depth
    return Slant(math.atan(float(slope @ out)), abs(math.atan(float(slope[1] * out[0] - slope[0] * out[1]))))
