"""Detect fiducial markers of given ids in a colour image, with sub-pixel corners.

ArUco and AprilTag alike: both are dictionaries of OpenCV's detector (`DICT_4X4_50`, `DICT_APRILTAG_36h11`).
Source: Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial markers under
occlusion", Pattern Recognition 47 (2014). Small markers are enlarged first: corners twice as fine as at 17 px.

The detector compares each pixel with the mean of a square around it. For a marker of roughly known size, one square
suffices. A square of a third of the marker's side gives the finest corners. A square of two thirds also works with
blur. OpenCV's own three squares, tried together, cost twice as much and merge the outlines of one black border. On
drawn swings they read 93 % of the ids, and these two squares read 99.9 % with equally good corners.

The detector fits its sides through the centres of the outermost dark pixels. These lie within the marker by 0 to 1
pixel along a row or column. So a side with the unit normal (a, b) is moved outwards by the mean of their distances,

    max(|a|, |b|) / 2    [px of the image that was searched]
"""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np

from capture.errors import UntrackableError
from formats.arrays import Bytes, Floats

APART_WITHIN = 0.15  # of the stated distance: a marker's side of 20 px is measured to a pixel
# px, windows are enlarged until a marker side is about this: corners twice as fine as at 17 px. On nine scenes at 1.6 m
# (`benchmarks/tracking.py --set development-11`) moving markers are off by 0.64 mm, by 0.67 mm with half of it. Double
# gives 0.64 mm.
WANTED_SIDE = 64.0
# of the marker's side, one after the other; the module says why. Half and double leave the markers within 0.65 mm as
# well on the same scenes.
SQUARES = (0.35, 0.7)
LARGEST_ENLARGEMENT = 4  # times, for sides of 18 px or less; our choice: more only interpolates
ENLARGEMENT = 2  # of whole images: markers of 6 cm at 2 m are 17 px at 640 px; 34 px are detected more reliably
SMALLEST_WINDOW = 12  # px, a smaller window, cut off by the border of the image, cannot hold a marker


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's marker dictionary of this name, such as `DICT_4X4_50`."""
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if number is None:
        raise UntrackableError(
            f"hanger.dictionary {name!r} is not known",
            where="rig",
            advice="use an OpenCV name as DICT_4X4_50",
        )
    return cv2.aruco.getPredefinedDictionary(number)


def ids_in(colour: Bytes, dictionary: str) -> set[int]:
    """Return the ids of all markers of a dictionary in an RGB picture, (H, W, 3)."""
    return set(times_seen(colour, dictionary))


def times_seen(colour: Bytes, dictionary: str) -> Counter[int]:
    """Return how often each marker of a dictionary appears in an RGB picture, (H, W, 3), by its id.

    Two outlines of one marker, one within the other, count once.
    """
    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    larger = cv2.resize(grey, None, fx=ENLARGEMENT, fy=ENLARGEMENT, interpolation=cv2.INTER_CUBIC)
    quads, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(dictionary)).detectMarkers(larger)
    kept: dict[int, list[Floats]] = {}
    for quad, number in zip(quads, [] if ids is None else np.ravel(ids), strict=True):
        corners = np.asarray(quad, dtype=np.float64).reshape(4, 2)
        others = kept.setdefault(int(number), [])
        if all(np.linalg.norm(corners.mean(0) - other.mean(0)) > quad_side(corners) for other in others):
            others.append(corners)
    return Counter({number: len(corners) for number, corners in kept.items()})


class MarkerDetector:
    """Detects markers of given ids of one dictionary; all results are in the order of the ids."""

    def __init__(
        self, dictionary: str, ids: tuple[int, ...], *, apart: float | None = None, is_sparing: bool = False
    ) -> None:
        """Prepare the detector of markers with these ids.

        `apart` is the distance of the two markers' centres over their side. An id may appear twice, for example on a
        printed sheet in view. `apart` then identifies the hanger's own.
        A sparing detector searches only every second whole image for small markers, which costs six times as much.
        """
        self.ids, self._apart = ids, apart
        self._is_sparing, self._has_looked_finely = is_sparing, False
        known = marker_dictionary(dictionary)
        self._anywhere = cv2.aruco.ArucoDetector(known, _parameters())
        self._near = cv2.aruco.ArucoDetector(known)  # `in_window` sets its parameters

    def in_picture(self, colour: Bytes) -> Floats:
        """Return the corners [px], (ids, 4, 2), in a whole RGB picture, (H, W, 3); NaN where an id is not found."""
        grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
        corners = self._detect(self._anywhere, grey, 1)
        self._has_looked_finely = not (self._is_sparing and self._has_looked_finely)
        if self._has_looked_finely and not np.isfinite(corners).all():
            finer = self._detect(self._anywhere, grey, 2)
            corners = np.where(np.isfinite(corners), corners, finer)
        return corners

    def in_window(self, colour: Bytes, row: int, centre: Floats, reach: float, side: float) -> Floats:
        """Return the corners [px], (4, 2), of the id in `row`, looked for up to `reach` [px] around `centre` [px].

        side [px]: how long the marker's side is about; NaN where it is not found.
        """
        height, width = colour.shape[:2]
        left, top = (max(0, int(c - reach)) for c in centre)
        right, bottom = min(width, int(centre[0] + reach) + 2), min(height, int(centre[1] + reach) + 2)
        if right - left < SMALLEST_WINDOW or bottom - top < SMALLEST_WINDOW:
            return np.full((4, 2), np.nan)
        grey = cv2.cvtColor(np.ascontiguousarray(colour[top:bottom, left:right]), cv2.COLOR_RGB2GRAY)
        enlargement = int(np.clip(round(WANTED_SIDE / side), 1, LARGEST_ENLARGEMENT))
        corners = np.full((4, 2), np.nan)
        for share in SQUARES:
            self._near.setDetectorParameters(_parameters(square=share * side * enlargement))
            corners = self._detect(self._near, grey, enlargement)[row]
            if np.isfinite(corners).all():
                break
        return np.asarray(corners + np.array([left, top]))

    def refined(self, colour: Bytes, row: int, coarse: Floats) -> Floats:
        """Return the refined corners [px], (4, 2), of the id in `row`; if refinement fails, the given ones."""
        side = quad_side(coarse)
        fine = self.in_window(colour, row, coarse.mean(0), 1.2 * side, side)
        return fine if np.isfinite(fine).all() else coarse

    def _detect(self, detector: cv2.aruco.ArucoDetector, grey: Bytes, enlargement: int) -> Floats:
        """Return the corners [px], (ids, 4, 2); NaN if an id is absent, or appears twice and no pair fits."""
        corners = np.full((len(self.ids), 4, 2), np.nan)
        if enlargement > 1:
            grey = cv2.resize(grey, None, fx=enlargement, fy=enlargement, interpolation=cv2.INTER_CUBIC)
        quads, ids, _ = detector.detectMarkers(grey)
        if ids is None:
            return corners
        flat = np.ravel(ids)
        found = [
            [np.asarray(quads[k], dtype=np.float64).reshape(4, 2) for k, number in enumerate(flat) if number == wanted]
            for wanted in self.ids
        ]
        if self._apart is not None and len(found) == 2 and max(map(len, found)) > 1:
            found = _pair(found[0], found[1], self._apart)
        for row, seen in enumerate(found):
            if len(seen) == 1:
                corners[row] = (_with_outermost_pixels(seen[0]) + 0.5) / enlargement - 0.5
        return corners


def _with_outermost_pixels(quad: Floats) -> Floats:
    """Return a quadrilateral, (4, 2) [px], whose sides are moved outwards by half a pixel: see the module."""
    along = np.roll(quad, -1, axis=0) - quad
    turned = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    outwards = np.sign(np.einsum("ij,ij->i", normal, quad - quad.mean(0)))[:, None]
    normal *= outwards
    place = np.einsum("ij,ij->i", normal, quad) + 0.5 * np.abs(normal).max(1)
    before, placed = np.roll(normal, 1, axis=0), np.roll(place, 1)
    sine = before[:, 0] * normal[:, 1] - before[:, 1] * normal[:, 0]
    u = (placed * normal[:, 1] - before[:, 1] * place) / sine
    v = (before[:, 0] * place - placed * normal[:, 0]) / sine
    return np.stack([u, v], axis=1)


def _pair(first: list[Floats], second: list[Floats], apart: float) -> list[list[Floats]]:
    """Return the pair of markers, each (4, 2) [px], at the expected distance in sides; none unless exactly one fits.

    Distance and side are foreshortened alike, so that their ratio hardly depends on the hanger's pose.
    """
    fitting = []
    for one in first:
        for other in second:
            distance = float(np.linalg.norm(one.mean(0) - other.mean(0)))
            relation = distance / (0.5 * (quad_side(one) + quad_side(other))) / apart
            if 1 - APART_WITHIN < relation < 1 + APART_WITHIN:
                fitting.append([[one], [other]])
    return fitting[0] if len(fitting) == 1 else [[], []]


def _parameters(square: float | None = None) -> cv2.aruco.DetectorParameters:
    """Return the detector's parameters: OpenCV's three threshold windows, or one window of the given size [px]."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    if square is not None:
        odd = max(3, int(square) | 1)
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = odd
    return parameters


def quad_side(quad: Floats) -> float:
    """Return the mean length [px] of a quadrilateral's sides, (4, 2)."""
    return float(np.hypot(*(quad - quad[[3, 0, 1, 2]]).T).mean())


def diagonal_crossing(quad: Floats) -> Floats:
    """Return the crossing of a quadrilateral's diagonals [px], (4, 2): the projection of a square's centre."""
    a, b, c, d = quad
    first, second = c - a, d - b
    cross = first[0] * second[1] - first[1] * second[0]
    if not np.isfinite(cross) or abs(cross) < 1e-9:
        return np.full(2, np.nan)
    along = ((b - a)[0] * second[1] - (b - a)[1] * second[0]) / cross
    return np.asarray(a + along * first)
