"""Find the hanger's two fiducial markers in colour and place them in metres with the depth behind them.

A marker's centre is where the diagonals of its four sub-pixel corners meet, (u, v); its depth z is that of
the plane through the depth pixels of the marker plate (`capture.depth_surface`), so

    position = z ((u - cx) / fx, (v - cy) / fy, 1)
    sd_x^2 = (z sd_centre / fx)^2 + (x / z sd_z)^2        likewise y,     sd_z from the plane fit

The pose from the four corners (solvePnP, IPPE square: Collins and Bartoli, "Infinitesimal Plane-Based Pose
Estimation", IJCV 109, 2014) and the known distance between the markers are checks: a marker only 17 pixels
wide gives a depth to a few centimetres, the plate's depth pixels give it to a millimetre.
Ids: Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial markers under
occlusion", Pattern Recognition 47 (2014). They are read anew in every frame, so markers cannot be swapped.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.depth_surface import CorrelationMeter, SurfaceDepth, fit_surface, pixel_sd
from capture.errors import UntrackableError
from formats.rig import Hanger, Rig, Sensor

Floats = NDArray[np.float64]

CENTRE_SD = 0.08  # px, rms of the centre against drawn markers of 17 px with noise and 8 ms blur: 0.04-0.08
CORNER_BIAS = 0.5  # px, a small blurred marker looks smaller by up to this at either side
WANTED_SIDE = 52.0  # px, windows are enlarged until a marker side is about this: corners twice as fine as at 17 px
LARGEST_ENLARGEMENT = 4
HARDEST_HAND = 40.0  # m/s^2, acceleration of a hand-held hanger that a search window must allow for
LONGEST_GUESS = 0.3  # s, after this long a loss the whole picture is searched
DISTANCE_TOLERANCE = 0.05  # of the marker distance; wider than a sensor's depth scale error (1-2 %)
SMALLEST_WINDOW = 12  # px, a window cut off by the picture's border below this cannot hold a marker


@dataclass(frozen=True, kw_only=True)
class HangerSight:
    """What one frame shows of the hanger; row 0 is the rig's first marker id, NaN where it was not found.

    corners [px], (2, 4, 2): sub-pixel corners, clockwise from the pattern's top left
    centres [px], (2, 2); positions [m], (2, 3), sensor frame; sd [m], (2, 3) per axis; valid, (2,)
    distance_m: between the two markers, NaN unless both were placed (also where the check failed)
    """

    corners: Floats
    centres: Floats
    positions: Floats
    sd: Floats
    valid: NDArray[np.bool_]
    distance_m: float

    @property
    def is_found(self) -> bool:
        """Both markers are identified and placed."""
        return bool(self.valid.all())


def nothing_seen() -> HangerSight:
    """Return the sight of a frame without any marker."""
    return HangerSight(
        corners=np.full((2, 4, 2), np.nan),
        centres=np.full((2, 2), np.nan),
        positions=np.full((2, 3), np.nan),
        sd=np.full((2, 3), np.nan),
        valid=np.zeros(2, dtype=bool),
        distance_m=float("nan"),
    )


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's marker dictionary of this name, as `DICT_4X4_50`."""
    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if number is None:
        raise UntrackableError(
            f"hanger.dictionary {name!r} is not known",
            where="rig",
            advice="use an OpenCV name as DICT_4X4_50",
        )
    return cv2.aruco.getPredefinedDictionary(number)


class MarkerTracker:
    """Follows the two markers from frame to frame; the first frame needs no help."""

    def __init__(self, rig: Rig) -> None:
        if rig.hanger is None or rig.sensor is None:
            raise UntrackableError(
                "it has no hanger or no sensor section, so there is nothing to look for",
                where="rig",
                advice="describe both as in docs/file-formats.md",
            )
        self.hanger: Hanger = rig.hanger
        self.sensor: Sensor = rig.sensor
        self.correlation = CorrelationMeter()
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        self._detector = cv2.aruco.ArucoDetector(marker_dictionary(self.hanger.dictionary), parameters)
        half = self.hanger.marker_size_m / 2
        self._square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        self._matrix = np.array([[self.sensor.fx, 0, self.sensor.cx], [0, self.sensor.fy, self.sensor.cy], [0, 0, 1.0]])
        self._tracks: list[_ImageTrack | None] = [None, None]

    def track(self, colour: NDArray[np.uint8], depth: NDArray[np.uint16], time: float) -> HangerSight:
        """Find both markers in one frame.

        colour RGB, (H, W, 3); depth [mm], (H, W), registered to colour, 0 where missing;
        time [s], increasing.
        """
        corners = self._find_corners(colour, time)
        centres = np.stack([_diagonal_crossing(quad) for quad in corners])
        for row in range(2):
            self._remember(row, corners[row], centres[row], time)
        positions = np.full((2, 3), np.nan)
        sd = np.full((2, 3), np.nan)
        for row in range(2):
            if np.isfinite(centres[row, 0]):
                positions[row], sd[row] = self._place(corners[row], centres[row], depth)
        valid = np.isfinite(positions[:, 2])
        distance = float(np.linalg.norm(positions[1] - positions[0]))
        if valid.all():
            allowed = DISTANCE_TOLERANCE * self.hanger.marker_distance_m + 4.0 * float(np.sqrt((sd**2).sum()))
            if abs(distance - self.hanger.marker_distance_m) > allowed:
                valid[:] = False
        positions[~valid] = np.nan
        sd[~valid] = np.nan
        return HangerSight(
            corners=corners, centres=centres, positions=positions, sd=sd, valid=valid, distance_m=distance
        )

    def _find_corners(self, colour: NDArray[np.uint8], time: float) -> Floats:
        corners = np.full((2, 4, 2), np.nan)
        for row in range(2):
            track = self._tracks[row]
            if track is not None and time - track.time <= LONGEST_GUESS:
                corners[row] = self._search_window(colour, row, *track.window(time, self._pixels_per_metre(track)))
        known = [track is not None and time - track.time <= LONGEST_GUESS for track in self._tracks]
        if all(known):
            return corners
        coarse = self._search_picture(colour)
        for row in range(2):
            if not known[row] and np.isfinite(coarse[row]).all():
                side = _side(coarse[row])
                fine = self._search_window(colour, row, coarse[row].mean(0), 1.2 * side, side)
                corners[row] = fine if np.isfinite(fine).all() else coarse[row]
        return corners

    def _search_picture(self, colour: NDArray[np.uint8]) -> Floats:
        grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
        corners = self._detect(grey, 1)
        if not np.isfinite(corners).all():
            finer = self._detect(grey, 2)
            corners = np.where(np.isfinite(corners), corners, finer)
        return corners

    def _search_window(self, colour: NDArray[np.uint8], row: int, centre: Floats, reach: float, side: float) -> Floats:
        height, width = colour.shape[:2]
        left, top = (max(0, int(c - reach)) for c in centre)
        right, bottom = min(width, int(centre[0] + reach) + 2), min(height, int(centre[1] + reach) + 2)
        if right - left < SMALLEST_WINDOW or bottom - top < SMALLEST_WINDOW:
            return np.full((4, 2), np.nan)
        grey = cv2.cvtColor(np.ascontiguousarray(colour[top:bottom, left:right]), cv2.COLOR_RGB2GRAY)
        enlargement = int(np.clip(round(WANTED_SIDE / side), 1, LARGEST_ENLARGEMENT))
        return np.asarray(self._detect(grey, enlargement)[row] + [left, top])

    def _detect(self, grey: NDArray[np.uint8], enlargement: int) -> Floats:
        """Return the corners [px], (2, 4, 2), of the two ids; NaN where an id is absent or seen twice."""
        corners = np.full((2, 4, 2), np.nan)
        if enlargement > 1:
            grey = cv2.resize(grey, None, fx=enlargement, fy=enlargement, interpolation=cv2.INTER_CUBIC)
        quads, ids, _ = self._detector.detectMarkers(grey)
        if ids is None:
            return corners
        flat = list(np.ravel(ids))
        for row, wanted in enumerate(self.hanger.ids):
            if flat.count(wanted) == 1:
                quad = np.asarray(quads[flat.index(wanted)], dtype=np.float64).reshape(4, 2)
                corners[row] = (quad + 0.5) / enlargement - 0.5
        return corners

    def _remember(self, row: int, quad: Floats, centre: Floats, time: float) -> None:
        if not np.isfinite(centre[0]):
            return
        before = self._tracks[row]
        velocity = np.zeros(2)
        if before is not None and 0.0 < time - before.time <= LONGEST_GUESS:
            velocity = (centre - before.centre) / (time - before.time)
        self._tracks[row] = _ImageTrack(time, centre, velocity, _side(quad))

    def _pixels_per_metre(self, track: _ImageTrack) -> float:
        return track.side / self.hanger.marker_size_m

    def _place(self, quad: Floats, centre: Floats, depth: NDArray[np.uint16]) -> tuple[Floats, Floats]:
        """Return a marker's position and sd [m]; both NaN where depth is missing or contradicts the pose."""
        unknown = np.full(3, np.nan)
        plate = self._plate_depth(quad, centre, depth)
        if plate is None:
            return unknown, unknown
        seen, _, translation = cv2.solvePnP(self._square, quad, self._matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        if not seen:
            return unknown, unknown
        pose_depth = float(translation[2, 0])
        pose_sd = pose_depth * CORNER_BIAS / _side(quad)
        if abs(pose_depth - plate.depth) > 4.0 * float(np.hypot(pose_sd, plate.sd)):
            return unknown, unknown
        s, z = self.sensor, plate.depth
        ray = np.array([(centre[0] - s.cx) / s.fx, (centre[1] - s.cy) / s.fy, 1.0])
        across = np.array([z * CENTRE_SD / s.fx, z * CENTRE_SD / s.fy, 0.0])
        return z * ray, np.hypot(across, ray * plate.sd)

    def _plate_depth(self, quad: Floats, centre: Floats, depth: NDArray[np.uint16]) -> SurfaceDepth | None:
        height, width = depth.shape
        left, top = np.maximum(np.floor(quad.min(0)).astype(int), 0)
        right, bottom = np.minimum(np.ceil(quad.max(0)).astype(int) + 1, [width, height])
        if right - left < 3 or bottom - top < 3:
            return None
        patch = depth[top:bottom, left:right]
        inside = np.zeros(patch.shape, dtype=np.uint8)
        cv2.fillConvexPoly(inside, np.rint(quad - [left, top]).astype(np.int32), 1)
        chosen = (inside > 0) & (patch > 0)
        rows, columns = np.nonzero(chosen)
        fitted = fit_surface(
            columns + (left - centre[0]),
            rows + (top - centre[1]),
            patch[rows, columns].astype(np.float64) * 1e-3,
            focal_length=self.sensor.fx,
            spread=self.hanger.marker_size_m,
            correlated_pixels=self.correlation.pixels,
        )
        if fitted is not None:
            residuals = np.zeros(patch.shape)
            used = np.zeros(patch.shape, dtype=bool)
            residuals[rows, columns] = fitted.residuals / pixel_sd(fitted.depth, self.sensor.fx)
            used[rows, columns] = fitted.used
            self.correlation.add(residuals, used)
        return fitted


@dataclass(frozen=True)
class _ImageTrack:
    """Where a marker was last read: centre [px], velocity [px/s], side [px]."""

    time: float
    centre: Floats
    velocity: Floats
    side: float

    def window(self, time: float, pixels_per_metre: float) -> tuple[Floats, float, float]:
        """Return centre, half width and marker side [px] of the window to search at `time`."""
        gone = time - self.time
        reach = 1.2 * self.side + 0.5 * HARDEST_HAND * gone**2 * pixels_per_metre
        return self.centre + self.velocity * gone, reach, self.side


def _side(quad: Floats) -> float:
    return float(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).mean())


def _diagonal_crossing(quad: Floats) -> Floats:
    """Return where a quadrilateral's diagonals [px], (4, 2), cross: the projection of a square's centre."""
    a, b, c, d = quad
    first, second = c - a, d - b
    cross = first[0] * second[1] - first[1] * second[0]
    if not np.isfinite(cross) or abs(cross) < 1e-9:
        return np.full(2, np.nan)
    along = ((b - a)[0] * second[1] - (b - a)[1] * second[0]) / cross
    return np.asarray(a + along * first)
