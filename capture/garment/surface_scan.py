"""Sample the visible surface: a grid of points on it and the contour of the silhouette.

The silhouette's four sides are T(s), B(s) from left to right and L(t), R(t) from top to bottom. Each is sampled at
equal steps of its length in the image. The grid is the Coons patch between them:

    P(s, t) = (1 - t) T(s) + t B(s) + (1 - s) L(t) + s R(t)
              - (1 - s)(1 - t) T(0) - s (1 - t) T(1) - (1 - s) t B(0) - s t B(1)

Source: S. A. Coons, "Surfaces for computer-aided design of space forms", MIT Project MAC TR-41 (1967). A place's depth
is the mean of the cloth within `SMOOTHED_PIXELS` pixels. These are not material points: see `formats.surface`.
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.garment.silhouette import Silhouette
from formats.arrays import Floats, Singles
from formats.rig import Sensor
from formats.surface import SurfaceScan

SMOOTHED_PIXELS = 5  # px to every side: 1.6 mm of noise are left at 1.6 m
# share of averaged pixels that must be cloth. Two pixels beyond a right-angled corner along both axes, the corner
# without its edge fills 2 x 2 of 121. Half of that is enough; half and double leave the lower corners as they are.
FEWEST_CLOTH = 0.015
RIM_KERNEL = np.ones((5, 5), np.uint8)  # pixels nearer to the edge may be mixed with the background
# px: dilates by two, which a ragged edge may lack. With one, and the share before, 26 of 120 lower corners of panels at
# 1.2 and 1.6 m have no place. With two or three none is without, and they err by 3.3 mm (median of the larger).
RAGGED_KERNEL = np.ones((5, 5), np.uint8)
CORNER_REACH_PIXELS = 12.0  # px: a bar that ends 20 mm beyond the cloth at 1.2 m
CONTOUR_SMOOTHING = 7  # outline pixels: a ragged edge is longer than the hem


def scan_surface(
    silhouette: Silhouette, corners: Floats, sensor: Sensor, time: float, *, grid: int, contour: int
) -> SurfaceScan:
    """Return a scan with a grid of `grid` x `grid` points and `contour` points around it.

    corners [px of the image], (4, 2), clockwise from the top left; where one is NaN the grid is NaN as a whole.
    """
    offset = np.array([silhouette.window.left, silhouette.window.top], float)
    outline = _smoothed(silhouette.outline)
    local = corners - offset
    first = int(np.linalg.norm(outline - (local[0] if np.isfinite(local[0]).all() else [0.0, 0.0]), axis=1).argmin())
    outline = np.roll(outline, -first, axis=0)
    depth = _smooth_depth(silhouette)
    around = _along(np.vstack([outline, outline[:1]]), contour + 1)[:-1]
    patch = np.full((grid, grid, 2), np.nan)
    if np.isfinite(local).all():
        patch = _patch(outline, local, grid)
    return SurfaceScan(
        time=time, grid=_in_metres(patch, depth, offset, sensor), contour=_in_metres(around, depth, offset, sensor)
    )


def _smoothed(outline: Floats) -> Floats:
    """Return the outline, clockwise in the image, smoothed over some neighbours."""
    x, y = outline.T
    clockwise = x @ np.roll(y, -1) - y @ np.roll(x, -1) > 0.0  # y points down
    ordered = outline if clockwise else outline[::-1]
    reach = CONTOUR_SMOOTHING // 2
    return np.asarray(np.mean([np.roll(ordered, k, axis=0) for k in range(-reach, reach + 1)], axis=0))


def _along(way: Floats, count: int) -> Floats:
    """Return points at equal steps along a path, (n, 2), from its first to its last point, (count, 2)."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    at = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(at, length, way[:, 0]), np.interp(at, length, way[:, 1])], axis=1)


def _patch(outline: Floats, corners: Floats, grid: int) -> Floats:
    """Return the Coons patch [px of the window], (grid, grid, 2); NaN if the corners are not in clockwise order."""
    n = len(outline)
    at = [int(np.linalg.norm(outline - corner, axis=1).argmin()) for corner in corners]
    if not at[0] < at[1] < at[2] < at[3]:
        return np.full((grid, grid, 2), np.nan)
    at.append(at[0] + n)
    sides = [
        _along(_side(outline[np.arange(at[i], at[i + 1] + 1) % n], corners[i], corners[(i + 1) % 4]), grid)
        for i in range(4)
    ]
    top, right, bottom, left = sides[0], sides[1], sides[2][::-1], sides[3][::-1]
    s, t = np.linspace(0, 1, grid)[None, :, None], np.linspace(0, 1, grid)[:, None, None]
    ruled = (1 - t) * top[None] + t * bottom[None] + (1 - s) * left[:, None] + s * right[:, None]
    corner = (1 - t) * ((1 - s) * top[0] + s * top[-1]) + t * ((1 - s) * bottom[0] + s * bottom[-1])
    return np.asarray(ruled - corner)


def _side(way: Floats, start: Floats, end: Floats) -> Floats:
    """Return a side from corner to corner, without the rounded parts or the bar's end beside the corners."""
    far = np.minimum(np.hypot(*(way - start).T), np.hypot(*(way - end).T)) > CORNER_REACH_PIXELS
    return np.vstack([start, way[far], end])


def _smooth_depth(silhouette: Silhouette) -> Singles:
    """Return the cloth's depth [m], (h, w), averaged over neighbours; 0 if these are too few."""
    inner = cv2.erode(silhouette.mask, RIM_KERNEL, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    cloth = ((inner > 0) & (silhouette.depth > 0)).astype(np.float32)
    size = (2 * SMOOTHED_PIXELS + 1, 2 * SMOOTHED_PIXELS + 1)
    share = cv2.blur(cloth, size, borderType=cv2.BORDER_CONSTANT)
    total = cv2.blur(silhouette.depth * cloth, size, borderType=cv2.BORDER_CONSTANT)
    near = cv2.dilate(silhouette.mask, RAGGED_KERNEL) > 0
    return np.where((share > FEWEST_CLOTH) & near, total / np.maximum(share, 1e-6), 0.0).astype(np.float32)


def _in_metres(places: Floats, depth: Singles, offset: Floats, sensor: Sensor) -> Floats:
    """Return the 3D positions [m], (..., 3), of pixels of the window, (..., 2); NaN where the cloth has no depth."""
    h, w = depth.shape
    pixel = np.rint(np.nan_to_num(places)).astype(int)
    inside = np.isfinite(places).all(-1) & (pixel >= 0).all(-1) & (pixel[..., 0] < w) & (pixel[..., 1] < h)
    z = np.where(inside, depth[np.clip(pixel[..., 1], 0, h - 1), np.clip(pixel[..., 0], 0, w - 1)], 0.0)
    z = np.where(z > 0.0, z, np.nan)
    u, v = (places + offset)[..., 0], (places + offset)[..., 1]
    return np.stack([z * (u - sensor.cx) / sensor.fx, z * (v - sensor.cy) / sensor.fy, z], axis=-1)
