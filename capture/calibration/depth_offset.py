"""The offset between colour and depth in one frame: a marker's plate in depth against the marker in colour.

A marker sits in the middle of its plate. In depth the plate is a connected region near its plane. Each row of the
region with a free end on both sides gives the offset along u by its middle. Each column gives the offset along v:

    du = mean over rows (mean of the row's columns) - u_marker,         v likewise

Noise of the edge (`capture.depth.surface.LATERAL_SD`) is equal on both sides and averages out. Rows and columns in
which the region continues (a bar behind the plate, a clip) have no free end and do not count.
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.depth.surface import OUTLIER_SD, pixel_sd
from capture.hanger.marker_detection import diagonal_crossing, quad_side
from capture.hanger.marker_plates import PlatePlacer
from formats.arrays import Booleans, Floats, Unsigned

PLATE_REACH = 1.1  # of the marker's side, from its centre: plates with a quiet zone of one bit end at 0.6 to 0.7
WHOLE_ROWS = 0.5  # of the marker's side: fewer rows with two free ends do not count as an outline


def plate_offset(placer: PlatePlacer, quad: Floats, depth: Unsigned) -> Floats:
    """Return the offset of a marker's plate in depth against colour [px], (2,); NaN along an axis without free ends.

    quad [px], (4, 2): the marker's corners in colour; depth [mm], (H, W).
    """
    centre, side = diagonal_crossing(quad), quad_side(quad)
    nothing = np.full(2, np.nan)
    if not np.isfinite(centre).all():
        return nothing
    left, top = np.rint(centre - PLATE_REACH * side).astype(int)
    size = round(2 * PLATE_REACH * side) + 1
    if left < 0 or top < 0 or left + size > depth.shape[1] or top + size > depth.shape[0]:
        return nothing
    patch = depth[top : top + size, left : left + size]
    inside = patch[(size // 4) : -(size // 4), (size // 4) : -(size // 4)]
    if np.count_nonzero(inside) < inside.size // 2:
        return nothing
    middle = 1e-3 * float(np.median(inside[inside > 0]))
    band = OUTLIER_SD * pixel_sd(middle, placer.sensor.fx) + 0.5 * placer.marker_size
    near = (np.abs(1e-3 * patch.astype(float) - middle) < band).astype(np.uint8)
    closed = cv2.morphologyEx(near, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(closed, connectivity=4)
    label = labels[size // 2, size // 2]
    if count < 2 or label == 0:
        return nothing
    piece = (labels == label) & (near > 0)
    across, down = _middle_of_rows(piece, side), _middle_of_rows(piece.T, side)
    return np.array([across + left - centre[0], down + top - centre[1]])


def _middle_of_rows(piece: Booleans, side: float) -> float:
    """Return the mean middle [px] of the rows with a free end on both sides, NaN if these are too few."""
    whole = piece.any(1) & ~piece[:, 0] & ~piece[:, -1]
    # Rows that merely touch the edge of the region are mostly noise.
    whole &= piece.sum(1) > 0.5 * side
    if np.count_nonzero(whole) < WHOLE_ROWS * side:
        return float("nan")
    columns = np.arange(piece.shape[1])
    return float(np.mean([columns[row].mean() for row in piece[whole]]))
