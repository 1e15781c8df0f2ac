"""Cut the garment out of the depth image and find the four corners of its silhouette.

The silhouette is what lies below the held edge, around the hanger's depth and in one piece. Its corners are
found as in "Estimating the clothes characteristics with the image and depth sensors for developing virtual
fitting room", section 2: Harris corners (Harris and Stephens, "A combined corner and edge detector", 1988),
of which the extremes along x and y after a turn by 45 degrees are the four wanted,

    top left = min(x + y)    top right = max(x - y)    bottom right = max(x + y)    bottom left = min(x - y)

A Harris corner of a ragged edge is good to some pixels. It is refined by the crossing of straight lines fitted to
the two sides next to it; the top side's line is the held edge itself, known from the markers. The fitted lines run
through the centres of the outermost pixels and are moved outwards by half a pixel to the rim of these pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.depth_surface import LATERAL_SD

Floats = NDArray[np.float64]

DEPTH_JUMP = 0.05  # m between neighbouring pixels: beyond a slope of 18 at 1.6 m, so another surface behind
HARRIS_BLOCK = 9  # px, structure tensor window: ragged edges average out, a panel's corner does not
HARRIS_K = 0.04  # Harris and Stephens' usual constant
STRONG_CORNER = 0.2  # of the strongest Harris response on the outline
SKIPPED_ARM = 3.0  # px next to a corner that are rounded off by missing pixels
LONGEST_ARM = 45.0  # px of a side that may be taken for straight
SHORTEST_ARM = 8  # outline pixels; fewer do not make a line
FARTHEST_REFINEMENT = 10.0  # px between a Harris corner and the crossing that replaces it
FLATTEST_CROSSING = 0.34  # sine of 20 degrees
CURL_SD = 0.6  # px, a side is not quite straight near its end
HARRIS_SD = 2.5  # px, of an unrefined Harris corner on a ragged edge
EDGE_BAND = 12  # px below the held edge in which the garment must be present


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
    """The garment cut out of one depth image.

    mask, (h, w): 1 on the garment, holes filled; depth [m], (h, w): 0 where missing or off the garment;
    outline [px of the window], (n, 2): its outermost pixels in order
    """

    window: Window
    mask: NDArray[np.uint8]
    depth: NDArray[np.float32]
    outline: Floats

    @property
    def touches_rim(self) -> bool:
        """The garment may go on to the left, to the right or below the window."""
        h, w = self.mask.shape
        x, y = self.outline[:, 0], self.outline[:, 1]
        return bool(x.min() <= 0 or x.max() >= w - 1 or y.max() >= h - 1)

    @property
    def bounds(self) -> Window:
        """The smallest window, in the image, around the garment."""
        low, high = self.outline.min(0).astype(int), self.outline.max(0).astype(int) + 1
        left, top = self.window.left, self.window.top
        return Window(left + int(low[0]), top + int(low[1]), left + int(high[0]), top + int(high[1]))


def cut_out(
    depth: NDArray[np.uint16], window: Window, held: Floats, *, nearest: float, farthest: float
) -> Silhouette | None:
    """Return the garment inside the window, or None where nothing hangs below the held edge.

    depth [mm], (H, W); held [px], (2, 2): left and right end of the held edge; nearest, farthest [m].
    """
    patch = depth[window.top : window.bottom, window.left : window.right]
    ends = held - [window.left, window.top]
    mask = cv2.inRange(patch, max(1, int(nearest * 1e3)), int(farthest * 1e3))
    _cut_behind_jumps(mask, patch)
    _cut_above(mask, ends)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _cut_above(closed, ends)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=4)
    label = _hanging_piece(labels, stats, count, ends)
    if label is None:
        return None
    outlines, _ = cv2.findContours((labels == label).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=len)
    filled = np.zeros(patch.shape, dtype=np.uint8)
    cv2.drawContours(filled, [outline], -1, 1, thickness=cv2.FILLED)
    metres = np.where((filled > 0) & (mask > 0), patch, 0).astype(np.float32) * np.float32(1e-3)
    return Silhouette(window, filled, metres, outline.reshape(-1, 2).astype(np.float64))


def _cut_behind_jumps(mask: NDArray[np.uint8], patch: NDArray[np.uint16]) -> None:
    """Clear the farther pixel at every jump in depth, so that what is behind falls into another piece."""
    deep = np.where(mask > 0, patch, 0).astype(np.int32)
    jump = int(DEPTH_JUMP * 1e3)
    for surface, marks in ((deep, mask), (deep.T, mask.T)):
        step = np.diff(surface, axis=0)
        step[(surface[1:] == 0) | (surface[:-1] == 0)] = 0
        marks[1:][step > jump] = 0
        marks[:-1][step < -jump] = 0


def _cut_above(mask: NDArray[np.uint8], ends: Floats) -> None:
    """Clear everything above the held edge: the bar, the marker plates, the hand."""
    (x0, y0), (x1, y1) = ends
    slope = (y1 - y0) / (x1 - x0) if abs(x1 - x0) > 1e-6 else 0.0
    edge = np.ceil(y0 + slope * (np.arange(mask.shape[1]) - x0))
    mask[np.arange(mask.shape[0])[:, None] < edge[None, :]] = 0


def _hanging_piece(labels: NDArray[np.int32], stats: NDArray[np.int32], count: int, ends: Floats) -> int | None:
    """Return the label of the largest piece that begins right below the held edge."""
    x0, x1 = sorted(int(x) for x in ends[:, 0])
    y0, y1 = int(ends[:, 1].min()), int(ends[:, 1].max())
    band = labels[max(0, y0) : max(0, y1 + EDGE_BAND), max(0, x0) : max(0, x1)]
    if count < 2 or band.size == 0:
        return None
    present = np.bincount(band.ravel(), minlength=count)[1:] > 0
    areas = np.where(present, stats[1:, cv2.CC_STAT_AREA], 0)
    return int(areas.argmax()) + 1 if areas.max() > 0 else None


def find_corners(silhouette: Silhouette, held: Floats) -> tuple[Floats, Floats]:
    """Return the corners and their standard deviation across the view.

    held [px], (2, 2): the held edge in the image.
    Returns corners [px of the image], (4, 2): top left, top right, bottom right, bottom left; and
    sd [px], (4,); NaN where there is none.
    """
    corners, sd = np.full((4, 2), np.nan), np.full(4, np.nan)
    outline = silhouette.outline
    starts = _harris_extremes(silhouette)
    if starts is None:
        return corners, sd
    middle = outline.mean(0)
    offset = np.array([silhouette.window.left, silhouette.window.top], dtype=np.float64)
    top = _line_through(held - offset)
    for i in range(4):
        lines: list[tuple[Floats, float] | None] = []
        for neighbour in ((i - 1) % 4, (i + 1) % 4):
            if {i, neighbour} == {0, 1}:
                lines.append((top, 0.0))
            else:
                lines.append(_side_line(outline, starts[i], starts[neighbour], middle))
        corners[i], sd[i] = _refined(outline[starts[i]], lines)
    return corners + offset, sd


def _harris_extremes(silhouette: Silhouette) -> list[int] | None:
    """Return the places on the outline of the four extreme Harris corners, or None where two fall together."""
    mask, outline = silhouette.mask, silhouette.outline
    rim = HARRIS_BLOCK
    padded = cv2.copyMakeBorder(mask, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=0)
    response = cv2.cornerHarris(padded.astype(np.float32), HARRIS_BLOCK, 3, HARRIS_K)
    x, y = outline[:, 0].astype(int), outline[:, 1].astype(int)
    strength = response[y + rim, x + rim]
    strong = np.flatnonzero(strength > STRONG_CORNER * strength.max())
    if strong.size < 4:
        return None
    total, difference = x[strong] + y[strong], x[strong] - y[strong]
    found = [int(strong[k]) for k in (total.argmin(), difference.argmax(), total.argmax(), difference.argmin())]
    return found if len(set(found)) == 4 else None


def _side_line(outline: Floats, start: int, end: int, middle: Floats) -> tuple[Floats, float] | None:
    """Fit a line to the outline next to `start` on the way to `end`; return it and its sd at the corner [px]."""
    n = len(outline)
    forward = (end - start) % n
    backward = (start - end) % n
    step, length = (1, forward) if forward <= backward else (-1, backward)
    way = outline[(start + step * np.arange(length + 1)) % n]
    far = np.linalg.norm(way - way[0], axis=1)
    arm = way[(far >= SKIPPED_ARM) & (far <= min(LONGEST_ARM, 0.6 * far[-1]))]
    for _ in range(2):
        if len(arm) < SHORTEST_ARM:
            return None
        centre = arm.mean(0)
        spread = (arm - centre).T @ (arm - centre)
        normal = np.linalg.eigh(spread)[1][:, 0]
        away = (arm - centre) @ normal
        scatter = max(LATERAL_SD, 1.5 * float(np.median(np.abs(away))))
        arm = arm[np.abs(away) < 2.5 * scatter]
    if normal @ (centre - middle) < 0:
        normal = -normal
    line = np.array([normal[0], normal[1], -(normal @ centre) - 0.5])
    return line, 2.0 * scatter / float(np.sqrt(len(arm)))


def _line_through(ends: Floats) -> Floats:
    """Return the line (a, b, c), a x + b y + c = 0 with a unit normal, through two places."""
    along = ends[1] - ends[0]
    normal = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
    return np.array([normal[0], normal[1], -(normal @ ends[0])])


def _refined(start: Floats, lines: list[tuple[Floats, float] | None]) -> tuple[Floats, float]:
    """Return the crossing of two lines, or the Harris corner where they make none near it, with the sd [px]."""
    first, second = lines
    if first is None or second is None:
        return start, HARRIS_SD
    (a, sd_a), (b, sd_b) = first, second
    sine = float(a[0] * b[1] - a[1] * b[0])
    if abs(sine) < FLATTEST_CROSSING:
        return start, HARRIS_SD
    crossing = np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]]) / sine
    if np.linalg.norm(crossing - start) > FARTHEST_REFINEMENT:
        return start, HARRIS_SD
    return crossing, float(np.sqrt((sd_a**2 + sd_b**2) / 2 / sine**2 + CURL_SD**2))
