"""Segment the garment in a depth image.

The silhouette is the connected region below the held edge, near the hanger's depth. Behind every jump in
depth the farther surface is removed, two pixels wide, so that furniture behind the garment is a separate region.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from formats.arrays import Bytes, Floats, Indices, Singles, Unsigned

# px kept around the garment: they show whether it ends or continues behind an object. As `LOOK_AROUND` of
# `capture.garment.occlusion`, which looks so far.
CROP_BORDER = 12
SQUARE_3, SQUARE_5 = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)  # px: closes gaps; erodes by 2 px
# px below the held edge in which the garment must be present: 33 mm at 1.6 m with a focal length of 576 px.
# Our choice: clips or a waistband without depth take less. Half and double change no figure of nine scenes at that
# distance (`benchmarks/tracking.py --set development-11`).
EDGE_BAND = 12


@dataclass(frozen=True)
class Window:
    """A part of the image: first column and row, one past the last."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def is_empty(self) -> bool:
        """No garment fits into it."""
        return self.right - self.left < 2 * EDGE_BAND or self.bottom - self.top < 2 * EDGE_BAND


@dataclass(frozen=True)
class Silhouette:
    """The garment segmented in one depth image, in the smallest window around it.

    - `mask`, (h, w): 1 on the garment, holes filled
    - `depth` [m], (h, w): 0 where missing or off the garment
    - `raw` [mm], (h, w): the sensor's depth in the window, 0 where missing
    - `outline` [px of the window], (n, 2): its outermost pixels in order
    - `touches_rim`: the garment may continue to the left, to the right or below the window that was searched
    """

    window: Window
    mask: Bytes
    depth: Singles
    raw: Unsigned
    outline: Floats
    touches_rim: bool


def cut_out(
    depth: Unsigned, window: Window, held: Floats, *, nearest: float, farthest: float, jump: float
) -> Silhouette | None:
    """Return the garment inside the window, or None where nothing hangs below the held edge.

    - `depth` [mm], (H, W)
    - `held` [px], (2, 2): left and right end of the held edge
    - `nearest`, `farthest` [m]
    - `jump` [m]: a difference in depth between neighbours that marks another surface
    """
    patch = depth[window.top : window.bottom, window.left : window.right]
    ends = held - [window.left, window.top]
    mask = cv2.inRange(patch, max(1, int(nearest * 1e3)), int(farthest * 1e3))
    mask &= _before_jumps(patch, round(jump * 1e3))
    _cut_above(mask, ends)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_16U)
    label = _hanging_piece(labels, stats, count, ends)
    if label is None:
        return None
    left, top, width, height, _ = (int(v) for v in stats[label])
    touches = left == 0 or left + width == mask.shape[1] or top + height == mask.shape[0]
    rows, columns = _around(top, height, mask.shape[0]), _around(left, width, mask.shape[1])
    piece = cv2.compare(labels[rows, columns], label, cv2.CMP_EQ)
    closed = cv2.morphologyEx(piece, cv2.MORPH_CLOSE, SQUARE_3)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = outlines[0]  # one piece has one outline
    filled = np.zeros(piece.shape, dtype=np.uint8)
    cv2.drawContours(filled, [outline], -1, 1, thickness=cv2.FILLED)
    raw = patch[rows, columns]
    metres = cv2.multiply(cv2.bitwise_and(raw, raw, mask=piece), 1e-3, dtype=cv2.CV_32F)
    inner = Window(
        window.left + columns.start, window.top + rows.start, window.left + columns.stop, window.top + rows.stop
    )
    return Silhouette(inner, filled, metres, raw, outline.reshape(-1, 2).astype(np.float64), touches)


def _around(start: int, length: int, limit: int) -> slice:
    return slice(max(0, start - CROP_BORDER), min(limit, start + length + CROP_BORDER))


def _before_jumps(patch: Unsigned, jump: int) -> Bytes:
    """Mark pixels that do not lie just behind a nearer surface, 255; this separates surfaces at different depths.

    Two pixels to every side: one beside a jump may be missing, and the closing of holes bridges one.
    """
    deep = patch - np.uint16(1)  # missing pixels (0) wrap around to the farthest value
    step = cv2.subtract(deep, cv2.erode(deep, SQUARE_5))
    return np.asarray(cv2.inRange(step, 0, jump), dtype=np.uint8)


def _cut_above(mask: Bytes, ends: Floats) -> None:
    """Clear the pixels above the held edge: the bar, the marker plates, the hand."""
    (x0, y0), (x1, y1) = ends
    slope = (y1 - y0) / (x1 - x0) if abs(x1 - x0) > 1e-6 else 0.0
    edge = np.ceil(y0 + slope * (np.arange(mask.shape[1]) - x0)).astype(int)
    last = int(np.clip(edge.max(), 0, mask.shape[0]))
    mask[:last][np.arange(last)[:, None] < edge[None, :]] = 0


def _hanging_piece(labels: Unsigned, stats: Indices, count: int, ends: Floats) -> int | None:
    """Return the label of the largest region that begins right below the held edge."""
    x0, x1 = sorted(int(x) for x in ends[:, 0])
    y0, y1 = int(ends[:, 1].min()), int(ends[:, 1].max())
    band = labels[max(0, y0) : max(0, y1 + EDGE_BAND), max(0, x0) : max(0, x1)]
    if count < 2:
        return None
    present = np.bincount(band.ravel(), minlength=count)[1:] > 0
    areas = np.where(present, stats[1:, cv2.CC_STAT_AREA], 0)
    return int(areas.argmax()) + 1 if areas.max() > 0 else None


def square_around(silhouette: Silhouette, pixel: Floats, reach: int) -> tuple[slice, slice]:
    """Return the rows and columns of the silhouette's window up to `reach` [px] from a pixel of the image, (2,)."""
    u, v = int(pixel[0]) - silhouette.window.left, int(pixel[1]) - silhouette.window.top
    return slice(max(0, v - reach), max(0, v + reach + 1)), slice(max(0, u - reach), max(0, u + reach + 1))
