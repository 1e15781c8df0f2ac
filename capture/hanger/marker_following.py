"""Track a marker by template matching while its id cannot be decoded, because of blur or partial occlusion.

The template, the marker's image at its last decoding, is matched in two ways:

    blurred    the template is blurred along the marker's velocity by some shares of its motion per frame; the marker is
               at the maximum of the normalised correlation in the window, which a parabola refines below a pixel
    covered    single points of the template are tracked (pyramidal Lucas-Kanade, forward and backward); the points that
               agree on one rotation, scale and shift (RANSAC) are the visible part

Tracking never updates the template, so errors do not accumulate. After `LONGEST_FOLLOWED` without a decoded id the
marker is lost. The callers check a tracked marker's size against its depth and its distance to the other one. Sources:
J. P. Lewis, "Fast normalized cross-correlation" (1995); B. D. Lucas, T. Kanade, IJCAI 1981; forward-backward: Z. Kalal,
K. Mikolajczyk, J. Matas, ICPR 2010; M. A. Fischler, R. C. Bolles, Comm. ACM 24 (1981).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from capture.hanger.marker_detection import quad_side
from formats.arrays import Booleans, Bytes, Floats, Singles

Picture = Singles

LONGEST_FOLLOWED = 0.5  # s since the id was decoded; a template tolerates a hand's few degrees of rotation
RIM_MARGIN = 0.15  # of the marker's side, margin of the template: the white border
BLURS = (0.0, 0.125, 0.25, 0.5, 0.75)  # of the motion per frame: exposures of up to 25 ms at 30 frames a second
# correlation from which a match is accepted. Our choice: at half a marker beside a finger gets too small a deviation
# (`test_following.py`); 0.9 changes none of its tests.
SURE_MATCH = 0.8
# points along each side of the tracked grid. Our choice: with 5, a marker a third of which a finger hides is lost
# (`test_following.py`); 14 follow as well.
POINTS_ALONG = 7
# px, bound on a point's forward-backward error. Our choice: at half and double, all markers of `test_following.py`
# are followed as well.
BACK = 0.5
# points of 49 that must agree: a quarter of the marker. Half and double change no figure of nine scenes at 1.6 m
# (`benchmarks/tracking.py --set development-11`), in which every marker is found.
FEWEST_AGREEING = 12
# px, of a point from the common motion; our choice: above `BACK`. Half and double change no figure of the same scenes.
AGREE = 0.7
LEAST_PICTURE_CORRELATION = (
    0.6  # correlation of the visible part with the template: plain skin has points that agree, but correlates less
)
# of the marker's area, spanned by points that agree. Our choice: half and double change no test of
# `test_following.py`.
LEAST_IN_VIEW = 0.15
FLOW: dict[str, Any] = {"winSize": (9, 9), "maxLevel": 1, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
TURNED, SCALED = 0.25, 0.12  # rad and share; bounds for half a second
BLURRED_SD, COVERED_SD = (
    0.25,
    0.45,
)  # px, error of a tracked centre against drawn markers (`tests/capture/hanger/test_following.py`)


@dataclass(frozen=True)
class Followed:
    """A marker found without its id: corners [px], (4, 2), visible part [px], (n, 2), sd of the centre [px]."""

    corners: Floats
    in_view: Floats
    centre_sd: float


@dataclass(frozen=True)
class Keepsake:
    """The template of a marker: its image at its last decoding.

    time [s]; corners [px], (4, 2); colour, (h, w, 3), its upper left corner `origin` [px], (2,) in the whole picture
    """

    time: float
    corners: Floats
    colour: Bytes
    origin: Floats

    @cached_property
    def picture(self) -> Picture:
        """The template in grey, (h, w); computed on demand, since template matching is rarely needed."""
        return _grey(self.colour)


def keep(colour: Bytes, corners: Floats, time: float) -> Keepsake | None:
    """Return the template of a marker with corners [px], (4, 2), or None if the image's border cuts it off."""
    margin = RIM_MARGIN * quad_side(corners)
    left, top = np.floor(corners.min(0) - margin).astype(int)
    right, bottom = np.ceil(corners.max(0) + margin).astype(int) + 1
    height, width = colour.shape[:2]
    if left < 0 or top < 0 or right > width or bottom > height:
        return None
    return Keepsake(time, corners, colour[top:bottom, left:right].copy(), np.array([left, top], float))


def follow(
    colour: Bytes, kept: Keepsake, expected: Floats, reach: float, step: Floats
) -> Followed | None:  # fmt: skip
    """Return the marker that matches a template, or None if no match is good enough.

    - `colour` RGB, (H, W, 3)
    - `expected` [px], (2,): the expected centre
    - `reach` [px]: largest distance from the expected centre
    - `step` [px], (2,): the marker's motion between two frames, along which it is blurred
    """
    height, width = kept.picture.shape
    start = kept.origin + expected - kept.corners.mean(0)
    slack = int(np.ceil(reach))
    left, top = np.maximum(np.rint(start).astype(int) - slack, 0)
    right = min(colour.shape[1], round(start[0]) + width + slack)
    bottom = min(colour.shape[0], round(start[1]) + height + slack)
    if right - left < width + 3 or bottom - top < height + 3:
        return None
    window = _grey(colour[top:bottom, left:right])
    pictures = [_blurred(kept.picture, share * step) for share in BLURS]
    found = [(*_best_place(window, picture), picture) for picture in pictures]
    best, place, picture = max(found, key=lambda one: one[0])
    corner = np.array([left, top], float)
    shift = place + corner - kept.origin
    if best >= SURE_MATCH:
        moved = kept.corners + shift
        return Followed(moved, moved, BLURRED_SD)
    return _follow_points(window, corner, kept, picture, [shift, start - kept.origin])


def _best_place(window: Picture, picture: Picture) -> tuple[float, Floats]:
    """Return the largest correlation and the position [px], (2,), of the template's corner in the window."""
    scores = cv2.matchTemplate(window, picture, cv2.TM_CCOEFF_NORMED)
    _, best, _, (x, y) = cv2.minMaxLoc(scores)
    fine = [
        value + _peak(scores[y, x - 1 : x + 2] if axis == 0 else scores[y - 1 : y + 2, x])
        for axis, value in enumerate((x, y))
    ]
    return float(best), np.array(fine)


def _peak(three: Singles) -> float:
    """Return the vertex of the parabola through three neighbouring values, relative to the middle one."""
    if three.size < 3:
        return 0.0
    before, middle, after = (float(value) for value in three)
    bend = before - 2.0 * middle + after
    return 0.0 if bend >= 0.0 else float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))


def _follow_points(
    window: Picture, origin: Floats, kept: Keepsake, picture: Picture, shifts: list[Floats]
) -> Followed | None:
    """Track the template's points into the window, from the first initial shift [px] that succeeds."""
    share = (np.arange(POINTS_ALONG) + 0.5) / POINTS_ALONG
    across, down = np.meshgrid(share, share)
    a, b, _, d = kept.corners
    grid = a + across.reshape(-1, 1) * (b - a) + down.reshape(-1, 1) * (d - a)
    side = quad_side(kept.corners)
    height, width = picture.shape
    for shift in shifts:
        x, y = np.clip(np.rint(kept.origin + shift - origin), 0, np.subtract(window.shape[::-1], picture.shape[::-1]))
        laid = np.full_like(window, picture.mean())
        laid[int(y) : int(y) + height, int(x) : int(x) + width] = picture
        source = grid - kept.origin + [x, y]
        target, true = _there_and_back(laid, window, source)
        if np.count_nonzero(true) < FEWEST_AGREEING:
            continue
        turn, agreed = cv2.estimateAffinePartial2D(
            grid[true], target[true] + origin, method=cv2.RANSAC, ransacReprojThreshold=AGREE
        )
        if turn is None or np.count_nonzero(agreed) < FEWEST_AGREEING:
            continue
        scale, angle = float(np.hypot(turn[0, 0], turn[1, 0])), float(np.arctan2(turn[1, 0], turn[0, 0]))
        if abs(scale - 1.0) > SCALED or abs(angle) > TURNED:
            continue
        in_view = target[true][agreed[:, 0] > 0] + origin
        rim = cv2.convexHull(in_view.astype(np.float32))[:, 0]
        if cv2.contourArea(rim) < LEAST_IN_VIEW * side**2:
            continue
        hull = rim.astype(float)
        if _likeness(window, picture, turn, kept.origin, origin, hull) >= LEAST_PICTURE_CORRELATION:
            return Followed(kept.corners @ turn[:, :2].T + turn[:, 2], hull, COVERED_SD)
    return None


def _there_and_back(first: Picture, second: Picture, points: Floats) -> tuple[Floats, Booleans]:
    """Return the positions in the second image of points [px], (n, 2), and which of them pass the backward check."""
    one, other = (np.clip(part, 0, 255).astype(np.uint8) for part in (first, second))
    start = points.astype(np.float32)[:, None]
    there, seen, _ = cv2.calcOpticalFlowPyrLK(one, other, start, start.copy(), **FLOW)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(other, one, there, start.copy(), **FLOW)
    true = (seen[:, 0] > 0) & (returned[:, 0] > 0) & (np.linalg.norm((back - start)[:, 0], axis=1) < BACK)
    return there[:, 0].astype(np.float64), true


def _likeness(
    window: Picture, picture: Picture, turn: Floats, picture_origin: Floats, window_origin: Floats, hull: Floats
) -> float:
    """Return the correlation of the window and the transformed template within a hull [px of the image], (n, 2)."""
    moved = turn.copy()
    moved[:, 2] = turn[:, :2] @ picture_origin + turn[:, 2] - window_origin
    laid = cv2.warpAffine(picture, moved, window.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    mask = np.zeros(window.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(hull - window_origin).astype(np.int32), 1)
    seen, expected = window[mask > 0], laid[mask > 0]
    if seen.std() < 1.0 or expected.std() < 1.0:
        return 0.0
    return float(np.corrcoef(seen, expected)[0, 1])


def _blurred(picture: Picture, way: Floats) -> Picture:
    """Return the image blurred along a motion [px], (2,), with its middle fixed."""
    length = float(np.linalg.norm(way))
    if length < 0.5:
        return picture
    half = int(np.ceil(length / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for part in (np.arange(8 * half) + 0.5) / (8 * half) - 0.5:
        x, y = half + part * way
        i, j = int(np.floor(x)), int(np.floor(y))
        u, v = x - i, y - j
        for di, dj, weight in ((0, 0, (1 - u) * (1 - v)), (1, 0, u * (1 - v)), (0, 1, (1 - u) * v), (1, 1, u * v)):
            if j + dj < len(kernel) and i + di < len(kernel):
                kernel[j + dj, i + di] += np.float32(weight)
    return np.asarray(cv2.filter2D(picture, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))


def _grey(colour: Bytes) -> Picture:
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(colour), cv2.COLOR_RGB2GRAY), np.float32)
