"""Follow the hanger's two fiducial markers from frame to frame and place them in metres.

A marker's centre is where the diagonals of its four sub-pixel corners meet; its depth is that of its plate
(`capture.marker_plates`). The known distance between the markers is a check. Ids are read anew in every frame, so
markers cannot be swapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from capture.errors import UntrackableError
from capture.marker_detection import MarkerDetector, diagonal_crossing, quad_side
from capture.marker_plates import PlatePlacer
from formats.rig import Calibration, Hanger, Rig, Sensor

Floats = NDArray[np.float64]

HARDEST_HAND = 40.0  # m/s^2, acceleration of a hand-held hanger that a search window must allow for
LONGEST_GUESS = 0.3  # s, after this long a loss the whole picture is searched
DISTANCE_TOLERANCE = 0.05  # of the marker distance; wider than a sensor's depth scale error (1-2 %)


@dataclass(frozen=True, kw_only=True)
class HangerSight:
    """What one frame shows of the hanger; row 0 is the rig's first marker id, NaN where it was not found.

    corners [px], (2, 4, 2): sub-pixel corners, clockwise from the pattern's top left
    centres [px], (2, 2); sides [px], (2,); ranges [m], (2,): distance by the marker's size alone
    positions [m], (2, 3), sensor frame; sd [m], (2, 3) per axis; valid, (2,)
    distance_m: between the two markers, NaN unless both were placed (also where the check failed)
    """

    corners: Floats
    centres: Floats
    sides: Floats
    ranges: Floats
    positions: Floats
    sd: Floats
    valid: NDArray[np.bool_]
    distance_m: float

    @property
    def is_found(self) -> bool:
        """Both markers are identified and placed."""
        return bool(self.valid.all())


class HangerTracker(Protocol):
    """Follows a hanger's two markers through a recording."""

    def track(self, colour: NDArray[np.uint8], depth: NDArray[np.uint16], time: float) -> HangerSight:
        """Find both markers in one frame.

        colour RGB, (H, W, 3); depth [mm], (H, W), registered to colour, 0 where missing; time [s], increasing.
        """
        ...


def nothing_seen() -> HangerSight:
    """Return the sight of a frame without any marker."""
    return HangerSight(
        corners=np.full((2, 4, 2), np.nan),
        centres=np.full((2, 2), np.nan),
        sides=np.full(2, np.nan),
        ranges=np.full(2, np.nan),
        positions=np.full((2, 3), np.nan),
        sd=np.full((2, 3), np.nan),
        valid=np.zeros(2, dtype=bool),
        distance_m=float("nan"),
    )


def hanger_and_sensor(rig: Rig) -> tuple[Hanger, Sensor]:
    """Return what a rig says of hanger and sensor.

    Raises:
        UntrackableError: it lacks one of them.
    """
    if rig.hanger is None or rig.sensor is None:
        raise UntrackableError(
            "it has no hanger or no sensor section, so there is nothing to look for",
            where="rig",
            advice="describe both as in docs/file-formats.md",
        )
    return rig.hanger, rig.sensor


class MarkerTracker:
    """Follows the two markers from frame to frame; the first frame needs no help."""

    def __init__(self, rig: Rig) -> None:
        self.hanger, self.sensor = hanger_and_sensor(rig)
        self._detector = MarkerDetector(self.hanger.dictionary, self.hanger.ids)
        offset = (rig.calibration or Calibration()).depth_offset_px
        self._placer = PlatePlacer(self.sensor, self.hanger.marker_size_m, offset)
        self._tracks: list[ImageTrack | None] = [None, None]

    def track(self, colour: NDArray[np.uint8], depth: NDArray[np.uint16], time: float) -> HangerSight:
        """Find both markers in one frame.

        colour RGB, (H, W, 3); depth [mm], (H, W), registered to colour, 0 where missing;
        time [s], increasing.
        """
        corners = self._find_corners(colour, time)
        centres = np.stack([diagonal_crossing(quad) for quad in corners])
        for row in range(2):
            self._remember(row, corners[row], centres[row], time)
        positions = np.full((2, 3), np.nan)
        sd = np.full((2, 3), np.nan)
        for row in range(2):
            if np.isfinite(centres[row, 0]):
                positions[row], sd[row] = self._placer.place(corners[row], centres[row], depth)
        sides = np.array([quad_side(quad) for quad in corners])
        ranges = np.array([self._placer.range_by_size(side) for side in sides])
        distance = check_distance(positions, sd, self.hanger)
        return HangerSight(
            corners=corners, centres=centres, sides=sides, ranges=ranges, positions=positions, sd=sd,
            valid=np.isfinite(positions[:, 2]), distance_m=distance,
        )  # fmt: skip

    def _find_corners(self, colour: NDArray[np.uint8], time: float) -> Floats:
        corners = np.full((2, 4, 2), np.nan)
        for row in range(2):
            track = self._tracks[row]
            if track is not None and time - track.time <= LONGEST_GUESS:
                window = track.window(time, self._pixels_per_metre(track))
                corners[row] = self._detector.in_window(colour, row, *window)
        known = [track is not None and time - track.time <= LONGEST_GUESS for track in self._tracks]
        if all(known):
            return corners
        coarse = self._detector.in_picture(colour)
        for row in range(2):
            if not known[row] and np.isfinite(coarse[row]).all():
                corners[row] = self._detector.refined(colour, row, coarse[row])
        return corners

    def _remember(self, row: int, quad: Floats, centre: Floats, time: float) -> None:
        if not np.isfinite(centre[0]):
            return
        self._tracks[row] = ImageTrack.after(self._tracks[row], time, centre, quad_side(quad))

    def _pixels_per_metre(self, track: ImageTrack) -> float:
        return track.side / self.hanger.marker_size_m


def check_distance(positions: Floats, sd: Floats, hanger: Hanger) -> float:
    """Return how far apart [m] two markers are; where that is not what the rig says, both are made NaN.

    positions, sd [m], (2, 3); NaN where not placed.
    """
    distance = float(np.linalg.norm(positions[1] - positions[0]))
    allowed = DISTANCE_TOLERANCE * hanger.marker_distance_m + 4.0 * float(np.sqrt((sd**2).sum()))
    if abs(distance - hanger.marker_distance_m) > allowed:
        positions[:] = np.nan
        sd[:] = np.nan
    return distance


@dataclass(frozen=True)
class ImageTrack:
    """Where a marker was last read: centre [px], velocity [px/s], side [px]."""

    time: float
    centre: Floats
    velocity: Floats
    side: float

    @classmethod
    def after(cls, before: Self | None, time: float, centre: Floats, side: float) -> Self:
        """Return the track that goes on from an earlier one."""
        velocity = np.zeros(2)
        if before is not None and 0.0 < time - before.time <= LONGEST_GUESS:
            velocity = (centre - before.centre) / (time - before.time)
        return cls(time, centre, velocity, side)

    def window(self, time: float, pixels_per_metre: float) -> tuple[Floats, float, float]:
        """Return centre, half width and marker side [px] of the window to search at `time`."""
        gone = time - self.time
        reach = 1.2 * self.side + 0.5 * HARDEST_HAND * gone**2 * pixels_per_metre
        return self.centre + self.velocity * gone, reach, self.side
