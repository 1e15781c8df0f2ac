"""Detect the tracked corners on the outline of a garment, with one strategy per kind of garment.

Panels are skirts and swatches. Their candidates are Harris corners (Harris and Stephens, "A combined corner and edge
detector", 1988). The four wanted corners are the extremes along x and y after a rotation by 45 degrees:

    top left = min(x + y)    top right = max(x - y)    bottom right = max(x + y)    bottom left = min(x - y)

T-shirts: the top corners are the leftmost and rightmost points, the tips of the sleeves; the others as on a panel.
Source of both: "Estimating the clothes characteristics with the image and depth sensors for developing virtual
fitting room", section 2.

A Harris corner of a ragged edge has an error of some pixels. Lines are fitted to the two sides next to the corner,
and their crossing refines it. The top side's line is the held edge itself, known from the markers. A held corner
without a crossing is put on that line. The fitted lines run through the centres of the outermost pixels. These lie
within the garment by 0 to 1 pixel along a row or column. So a line with the unit normal (a, b) is moved outwards by the
mean of their distances, max(|a|, |b|) / 2.

A line is fitted to n pixels, s_k along and y_k across it from their mean. Its deviation at the corner, at s_0, is

    sd^2    = alike sigma^2 v + c^2 + share max(0, bend^2 - 4 alike sigma^2 w)
    sigma^2 = sum y_k^2 / n,    v = 1 / n + s_0^2 / sum s_k^2          noise; neighbouring pixels are alike
    bend    = q(s_0) sum q_k y_k / sum q_k^2,    w = q(s_0)^2 / sum q_k^2      how far a parabola leaves the line

with q(s) = s^2 less its own line. A bend within two deviations of its noise is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.depth.surface import LATERAL_SD
from capture.garment.silhouette import Silhouette
from formats.arrays import Floats

# double px, structure tensor window: ragged edges average out, a panel's corner does not. 3 and 10 move the corners'
# 95 % by at most 0.05 mm on nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`).
HARRIS_BLOCK = 5
HARRIS_K = 0.04  # Harris and Stephens' usual constant
# of the strongest Harris response on the outline. Our choice: half and double find the corners of
# `test_garment_points.py` as well.
STRONG_CORNER = 0.2
# px along x + y or x - y. Our choice: half and double find the corners of `test_garment_points.py` as well.
FAR_OUT = 8.0
# px next to a corner that are rounded off by missing pixels. Our choice: half and double find the corners of
# `test_garment_points.py` as well.
SKIPPED_ARM = 3.0
# px of a side that may count as straight. Our choice: at half, a turned rectangle's corners err by more than a third
# of a pixel; double finds them as well.
LONGEST_ARM = 45.0
# of a side: the rest belongs to the next corner. On nine scenes at 1.6 m (`benchmarks/tracking.py --set
# development-11`) the corners' 95 % are 9.9 mm. They are 10.2 mm with half of this, and 12.0 mm with 0.9.
STRAIGHT = 0.6
# outline pixels; fewer do not make a line. Half and double change no figure of the same scenes.
SHORTEST_ARM = 8
# px between a Harris corner and the crossing that replaces it. Our choice: at half, a corner in a furnished room errs
# by 18 mm; double finds the corners of `test_garment_points.py` as well.
FARTHEST_REFINEMENT = 10.0
# Sine of 20 degrees: there a crossing is 3 times as uncertain across as at right angles. Our choice: at half it is 6
# times; at twice, 43 degrees, corners sharper than that would stay unrefined.
FLATTEST_CROSSING = 0.34
# outline pixels that hold the information of one, (1 + r) / (1 - r). Neighbours' distances from a side's parabola have
# a correlation r of 0.56 on the sets `development` and `development-2` of `benchmarks/stated_noise.py`.
OUTLINE_ALIKE = 3.5
ROUNDED_SD = 1.0 / math.sqrt(12.0)  # px, of an outline in whole pixels: a smoother one tells no more
# px^2 and px^4: a strip one pixel wide may have its pixels at two positions alone, which bend no parabola.
NO_SPREAD = 1e-9
# px, of a side that no pixel shows. On the same sets the left side lies 0.25 px within the cloth: the projector's
# shadow beside it takes the pixels that noise would add. Single recordings state 0.65 to 1.26 of their sides' errors.
# Half of this gives 0.58 to 1.04, and double 0.87 to 1.89.
CURL_SD = 0.3
# of a bend's square beyond its noise, that the true side has beside its line. Half gives 0.61 to 1.25
# there, and double 0.71 to 1.27.
BEND_SHARE = 0.5
# px, of the held edge across, where the markers' own deviation is not known. Our choice: three times what markers give
# at 1.6 m, 0.25 mm.
HELD_LINE_SD = 0.3
# px, of an unrefined Harris corner on a ragged edge. Hardly a corner stays unrefined: half and double change the
# deviation of z on the same scenes by 0.002.
HARRIS_SD = 2.5


@dataclass(frozen=True)
class CornersInView:
    """Corners [px of the image], (4, 2), top left, top right, bottom right, bottom left, and their sd [px], (4, 2).

    NaN where there is none.
    """

    pixels: Floats
    sd: Floats


class CornerFinder(Protocol):
    """Locates the four corners of a kind of garment on its outline; tips: which of them are sleeve tips."""

    tips: tuple[int, ...]

    def flat_corners(self, outline: Floats) -> Floats:
        """Return the corners [m], (4, 2), of a flat garment's outline [m], (n, 2), y up, by the rule for images."""
        ...

    def find(self, silhouette: Silhouette, held: Floats, sides: Floats, held_sd: float = HELD_LINE_SD) -> CornersInView:
        """Locate the corners on a silhouette.

        - `held` [px of the image], (2, 2): the ends of the held edge, left first
        - `sides` [px], (4, 2): projected lengths of the flat garment's sides before and after each corner, clockwise,
          at the garment's distance
        - `held_sd` [px]: of the held edge, across it
        """
        ...


class PanelCorners:
    """The extremes of the Harris corners after a rotation by 45 degrees; the held edge is the top side."""

    tips: tuple[int, ...] = ()

    def flat_corners(self, outline: Floats) -> Floats:
        """Return the four points [m], (4, 2), of the outline that lie outermost along the diagonals."""
        x, y = outline[:, 0], -outline[:, 1]
        return outline[[(x + y).argmin(), (x - y).argmax(), (x + y).argmax(), (x - y).argmin()]]

    def find(self, silhouette: Silhouette, held: Floats, sides: Floats, held_sd: float = HELD_LINE_SD) -> CornersInView:
        """Locate the strong Harris corners that lie outermost along the diagonals; the held edge is one side."""
        x, y = silhouette.outline.T
        strong = _strong_corners(silhouette)
        if strong.size < 4:
            return _none()
        starts = [_extreme(value, strong) for value in (-x - y, x - y, x + y, y - x)]
        return _refine(silhouette, starts, (held, held_sd), sides)


class ShirtCorners:
    """The leftmost and rightmost points are the sleeve tips; the lower corners are as on a panel."""

    tips: tuple[int, ...] = (0, 1)

    def flat_corners(self, outline: Floats) -> Floats:
        """Return the leftmost and rightmost points [m], and the lowest along both diagonals, (4, 2)."""
        x, y = outline[:, 0], -outline[:, 1]
        return outline[[x.argmin(), x.argmax(), (x + y).argmax(), (x - y).argmin()]]

    def find(self, silhouette: Silhouette, held: Floats, sides: Floats, held_sd: float = HELD_LINE_SD) -> CornersInView:
        """Locate the leftmost and rightmost points, and the Harris corners lowest along both diagonals."""
        x, y = silhouette.outline.T
        strong = _strong_corners(silhouette)
        if strong.size < 2:
            return _none()
        starts = [int(x.argmin()), int(x.argmax()), _extreme(x + y, strong), _extreme(y - x, strong)]
        return _refine(silhouette, starts, None, sides)


def _extreme(value: Floats, strong: NDArray[np.intp]) -> int:
    """Return the Harris corner with the largest value [px], (outline,), unless another point is much farther out.

    A corner that is bent away looks round, so the Harris detector misses it.
    """
    best, anywhere = int(strong[value[strong].argmax()]), int(value.argmax())
    return anywhere if value[anywhere] > value[best] + FAR_OUT else best


def _none() -> CornersInView:
    return CornersInView(np.full((4, 2), np.nan), np.full((4, 2), np.nan))


def _strong_corners(silhouette: Silhouette) -> NDArray[np.intp]:
    """Return the Harris corners on the silhouette's outline, found at half the resolution to save time."""
    mask = cv2.resize(silhouette.mask, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    rim = HARRIS_BLOCK
    padded = cv2.copyMakeBorder(mask, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=0)
    response = cv2.cornerHarris(padded, HARRIS_BLOCK, 3, HARRIS_K)
    x, y = (silhouette.outline.astype(int) // 2 + rim).T
    strength = response[y, x]  # the rim holds what an odd length has beyond its half
    return np.flatnonzero(strength > STRONG_CORNER * strength.max())


def _refine(
    silhouette: Silhouette, starts: list[int], held: tuple[Floats, float] | None, sides: Floats
) -> CornersInView:
    """Refine four corners on the outline; if the held edge is the top side, its line and sd [px] are used there."""
    if len(set(starts)) < 4:
        return _none()
    corners, sd = np.full((4, 2), np.nan), np.full((4, 2), np.nan)
    outline = silhouette.outline
    middle = outline.mean(0)
    offset = np.array([silhouette.window.left, silhouette.window.top], dtype=np.float64)
    ends = None if held is None else held[0] - offset
    top = None if ends is None else _line_through(ends)
    for i in range(4):
        lines: list[tuple[Floats, float] | None] = []
        for neighbour, side in (((i - 1) % 4, sides[i, 0]), ((i + 1) % 4, sides[i, 1])):
            if held is not None and top is not None and {i, neighbour} == {0, 1}:
                lines.append((top, held[1]))
            else:
                longest = min(LONGEST_ARM, STRAIGHT * side)
                lines.append(_side_line(outline, starts[i], starts[neighbour], middle, longest, top))
        near = outline[[starts[i]]]
        if ends is not None and top is not None and i < 2 and abs(_across(top, near[0])) <= FARTHEST_REFINEMENT:
            near = np.vstack([near, ends[i]])  # the start may be the bar's end, farther out along the held edge
        corners[i], sd[i] = _refined(near, lines)
        if held is not None and top is not None and len(near) > 1 and (sd[i] == HARRIS_SD).all():
            corners[i], sd[i] = _on_held_edge(corners[i], top, held[1])
    return CornersInView(corners + offset, sd)


def _side_line(
    outline: Floats, start: int, end: int, middle: Floats, longest: float, top: Floats | None
) -> tuple[Floats, float] | None:
    """Fit a line to the outline next to `start` towards `end`, up to `longest` [px]; return it and its sd [px].

    top: line of the held edge, if known; the outline beside it is the bar's end and not the garment's
    """
    n = len(outline)
    forward, backward = (end - start) % n, (start - end) % n
    step, length = (1, forward) if forward <= backward else (-1, backward)
    (x0, y0), (x1, y1) = outline[start].tolist(), outline[end].tolist()
    longest = min(longest, STRAIGHT * math.hypot(x1 - x0, y1 - y0))
    # A ragged outline has up to two pixels per pixel of length.
    way = outline.take(start + step * np.arange(min(length, int(2 * longest)) + 1), axis=0, mode="wrap")
    x, y = way[:, 0] - x0, way[:, 1] - y0
    far = np.hypot(x, y)
    arm = (far >= SKIPPED_ARM) & (far <= longest)
    if top is not None:
        arm &= np.abs(_across(top, way)) >= SKIPPED_ARM
    for _ in range(2):
        x, y = x[arm], y[arm]
        if x.size < SHORTEST_ARM:
            return None
        middle_x, middle_y = float(x.sum()) / x.size, float(y.sum()) / x.size
        away_x, away_y = x - middle_x, y - middle_y
        # The direction of least scatter of a 2 x 2 covariance.
        turn = math.atan2(2.0 * float(away_x @ away_y), float(away_x @ away_x - away_y @ away_y))
        a, b = math.cos(0.5 * (turn + math.pi)), math.sin(0.5 * (turn + math.pi))
        off = np.abs(a * away_x + b * away_y)
        scatter = max(LATERAL_SD, 1.5 * float(np.partition(off, off.size // 2)[off.size // 2]))
        arm = off < 2.5 * scatter
    sd = _sd_at_corner(
        away_x[arm] * b - away_y[arm] * a, away_x[arm] * a + away_y[arm] * b, a * middle_y - b * middle_x
    )
    middle_x, middle_y = middle_x + x0, middle_y + y0
    if a * (middle_x - middle[0]) + b * (middle_y - middle[1]) < 0.0:
        a, b = -a, -b
    line = np.array([a, b, -(a * middle_x + b * middle_y) - 0.5 * max(abs(a), abs(b))])
    return line, sd


def _sd_at_corner(along: Floats, across: Floats, corner: float) -> float:
    """Return the sd [px] of a side's line at its corner: see the module.

    along, across [px], (n,): the side's pixels from its line's middle; corner [px]: of the corner, along the line
    """
    along, corner = along - float(along.mean()), corner - float(along.mean())
    across = across - float(across.mean())
    square = along * along
    length = max(float(square.sum()), NO_SPREAD)
    lean, level = float(along @ square) / length, length / along.size
    arch = square - lean * along - level
    arches = max(float(arch @ arch), NO_SPREAD)
    weight = (corner**2 - lean * corner - level) ** 2 / arches
    noise = OUTLINE_ALIKE * max(float(across @ across) / along.size, ROUNDED_SD**2)
    bent = float(arch @ across) ** 2 / arches
    variance = noise * (1.0 / along.size + corner**2 / length) + CURL_SD**2
    return math.sqrt(variance + BEND_SHARE * weight * max(0.0, bent - 4.0 * noise))


def _line_through(ends: Floats) -> Floats:
    """Return the line (a, b, c), a x + b y + c = 0 with a unit normal, through two points."""
    along = ends[1] - ends[0]
    normal = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
    return np.array([normal[0], normal[1], -(normal @ ends[0])])


def _on_held_edge(pixel: Floats, line: Floats, held_sd: float) -> tuple[Floats, Floats]:
    """Return the pixel of the held edge's line nearest to an unrefined corner, and its sd [px], (2,) each."""
    sd = np.hypot(HARRIS_SD * np.abs(line[[1, 0]]), held_sd * np.abs(line[:2]))
    return pixel - float(_across(line, pixel)) * line[:2], sd


def _across(line: Floats, pixels: Floats) -> Floats:
    """Return the distances [px], (...,), of pixels, (..., 2), from a line (a, b, c), positive on its normal's side."""
    return np.asarray(pixels @ line[:2] + line[2])


def _refined(near: Floats, lines: list[tuple[Floats, float] | None]) -> tuple[Floats, Floats]:
    """Return the crossing of two lines and its sd [px], (2,), if it is near one of some pixels, (n, 2) or (2,).

    Otherwise the first of these, the Harris corner.

    With the lines' unit normals as rows of N and deviations s across them its covariance is N^-1 diag(s^2) N^-T.
    """
    first, second = lines
    near = np.atleast_2d(near)
    start = near[0]
    unrefined = np.full(2, HARRIS_SD)
    if first is None or second is None:
        return start, unrefined
    (a, sd_a), (b, sd_b) = first, second
    sine = float(a[0] * b[1] - a[1] * b[0])
    if abs(sine) < FLATTEST_CROSSING:
        return start, unrefined
    crossing = np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]]) / sine
    if np.linalg.norm(near - crossing, axis=1).min() > FARTHEST_REFINEMENT:
        return start, unrefined
    return crossing, np.hypot([b[1], b[0]] * np.array(sd_a), [a[1], a[0]] * np.array(sd_b)) / abs(sine)
