"""Track the hanger's two fiducial markers from frame to frame and compute their positions in metres.

A marker's centre is the crossing of the diagonals of its four sub-pixel corners; its depth is that of its plate
(`capture.hanger.marker_plates`). The known distance between the markers is a check. Ids are decoded in every frame, so
markers cannot be swapped. If blur or a finger hides the id for a moment, template matching tracks the marker
(`capture.hanger.marker_following`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from capture.depth.surface import CorrelationMeter
from capture.errors import UntrackableError
from capture.hanger.marker_detection import MarkerDetector, diagonal_crossing, quad_side
from capture.hanger.marker_following import LONGEST_FOLLOWED, Followed, Keepsake, follow, keep
from capture.hanger.marker_plates import PlatePlacer
from capture.hanger.pose import PlateSlope, hanger_pitch
from formats.arrays import Booleans, Bytes, Floats, Unsigned
from formats.rig import Calibration, Hanger, Rig, Sensor

# m/s^2, acceleration of a hand-held hanger that a search window allows for. A hanger at 1.4 m/s, the hardest swing of
# `benchmarks/tracking.py`, that turns round in a tenth of a second has 28. Half and double change no
# figure of the scenes that `LONGEST_GUESS` names.
HARDEST_HAND = 40.0
# s without detection after which the whole image is searched. Our choice: nine frames. In this time a hand at 1 m/s
# moves a hanger by 0.3 m. Half and double change no figure of nine scenes at 1.6 m (`benchmarks/tracking.py --set
# development-11`).
LONGEST_GUESS = 0.3
# of the marker distance; wider than a sensor's depth scale error (1-2 %). Half and double change no figure of the same
# scenes.
DISTANCE_TOLERANCE = 0.05


@dataclass(frozen=True, kw_only=True)
class HangerSight:
    """The hanger's markers in one frame; row 0 is the rig's first marker id, NaN where it was not found.

    - `corners` [px], (2, 4, 2): sub-pixel corners, clockwise from the pattern's top left
    - `centres` [px], (2, 2)
    - `sides` [px], (2,)
    - `ranges` [m], (2,): distance from the sensor by the marker's size alone
    - `positions` [m], (2, 3), sensor frame
    - `sd` [m], (2, 3) per axis
    - `valid`, (2,)
    - `distance_m`: between the two markers, also if the check failed; NaN unless both have positions
    - `pitch`, `pitch_sd` [rad]: rotation about the line between the markers (`capture.hanger.pose`), NaN if it cannot
      be measured
    """

    corners: Floats
    centres: Floats
    sides: Floats
    ranges: Floats
    positions: Floats
    sd: Floats
    valid: Booleans
    distance_m: float
    pitch: float = float("nan")
    pitch_sd: float = float("nan")

    @property
    def is_found(self) -> bool:
        """Both markers are identified and have positions."""
        return bool(self.valid.all())


class HangerTracker(Protocol):
    """Tracks a hanger's two markers through a recording; its plates measure the correlation of the depth noise."""

    correlation: CorrelationMeter

    def track(self, colour: Bytes, depth: Unsigned, time: float, colour_late: float = 0.0) -> HangerSight:
        """Detect both markers in one frame, and compute their positions at the instant of its depth image.

        - `colour` RGB, (H, W, 3)
        - `depth` [mm], (H, W), registered to colour, 0 where missing
        - `time` [s], of the depth, increasing
        - `colour_late` [s]: delay of the colour image after the depth image
        """
        ...


def nothing_seen() -> HangerSight:
    """Return the result for a frame without any marker."""
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
    """Return the hanger and the sensor of a rig.

    Raises:
        UntrackableError: it lacks one of them.
    """
    if rig.hanger is None or rig.sensor is None:
        raise UntrackableError(
            "has no hanger or no sensor section, so there is nothing to look for",
            where="rig",
            advice="describe both as in docs/reference/file-formats.md",
        )
    return rig.hanger, rig.sensor


class MarkerTracker:
    """Tracks the two fiducial markers from frame to frame, without manual initialisation."""

    def __init__(self, rig: Rig, *, is_sparing: bool = False) -> None:
        self.rig = rig
        self.hanger, self.sensor = hanger_and_sensor(rig)
        apart = self.hanger.marker_distance_m / self.hanger.marker_size_m
        self._detector = MarkerDetector(self.hanger.dictionary, self.hanger.ids, apart=apart, is_sparing=is_sparing)
        offset = (rig.calibration or Calibration()).depth_offset_px
        self._placer = PlatePlacer(self.sensor, self.hanger.marker_size_m, offset)
        self.correlation = self._placer.correlation
        self._tracks: list[ImageTrack | None] = [None, None]
        self._kept: list[Keepsake | None] = [None, None]

    def track(self, colour: Bytes, depth: Unsigned, time: float, colour_late: float = 0.0) -> HangerSight:
        """Detect both markers in one frame: see `HangerTracker.track`."""
        time += colour_late
        corners = self._find_corners(colour, time)
        followed: list[Followed | None] = [None, None]
        slopes: list[PlateSlope | None] = [None, None]
        for row in range(2):
            if np.isfinite(corners[row]).all():
                self._kept[row] = keep(colour, corners[row], time)
            else:
                found = followed[row] = self._follow(colour, row, time)
                corners[row] = np.nan if found is None else found.corners
        centres = np.stack([diagonal_crossing(quad) for quad in corners])
        positions = np.full((2, 3), np.nan)
        sd = np.full((2, 3), np.nan)
        for row in range(2):
            if not np.isfinite(centres[row]).all():
                continue
            part = followed[row]
            track = ImageTrack.after(self._tracks[row], time, centres[row], quad_side(corners[row]))
            moved = -colour_late * track.velocity  # px, from the colour's instant to the depth's
            if part is None:
                placed = self._placer.place(corners[row] + moved, centres[row] + moved, depth)
            else:
                placed = self._placer.place(
                    corners[row] + moved, centres[row] + moved, depth, in_view=part.in_view + moved,
                    centre_sd=part.centre_sd,
                )  # fmt: skip
            positions[row], sd[row], slopes[row] = placed
            if part is not None and np.isnan(positions[row]).any():
                # A marker of this size cannot be at the tracked position.
                corners[row] = centres[row] = np.nan
                continue
            self._tracks[row] = track
        sides = np.array([quad_side(quad) for quad in corners])
        ranges = np.array([self._placer.range_by_size(side) for side in sides])
        distance = check_distance(
            positions, sd, self.hanger, doubtful=np.array([part is not None for part in followed])
        )
        pitch, pitch_sd = hanger_pitch(positions, slopes, self.rig)
        return HangerSight(
            corners=corners, centres=centres, sides=sides, ranges=ranges, positions=positions, sd=sd,
            valid=np.isfinite(positions).all(1), distance_m=distance, pitch=pitch, pitch_sd=pitch_sd,
        )  # fmt: skip

    def _find_corners(self, colour: Bytes, time: float) -> Floats:
        corners = np.full((2, 4, 2), np.nan)
        known = [track is not None and time - track.time <= LONGEST_GUESS for track in self._tracks]
        for row, track in enumerate(self._tracks):
            if track is not None and known[row]:
                window = track.window(time, self._pixels_per_metre(track))
                corners[row] = self._detector.in_window(colour, row, *window)
        if all(known):
            return corners
        coarse = self._detector.in_picture(colour)
        for row in range(2):
            if not known[row] and np.isfinite(coarse[row]).all():
                corners[row] = self._detector.refined(colour, row, coarse[row])
        return corners

    def _follow(self, colour: Bytes, row: int, time: float) -> Followed | None:
        """Search for a recently decoded marker by template matching."""
        kept, track = self._kept[row], self._tracks[row]
        if kept is None or track is None or time - kept.time > LONGEST_FOLLOWED or time - track.time > LONGEST_GUESS:
            return None
        expected, reach, side = track.window(time, self._pixels_per_metre(track))
        return follow(colour, kept, expected, reach - 0.7 * side, track.velocity * (time - track.time))

    def _pixels_per_metre(self, track: ImageTrack) -> float:
        return track.side / self.hanger.marker_size_m


def check_distance(
    positions: Floats, sd: Floats, hanger: Hanger, doubtful: Booleans | None = None
) -> float:  # fmt: skip
    """Return the distance [m] between two markers; set both to NaN if it contradicts the rig.

    positions, sd [m], (2, 3), NaN if unknown; doubtful, (2,): if exactly one marker is doubtful, only it is set to NaN.
    """
    distance = float(np.linalg.norm(positions[1] - positions[0]))
    allowed = DISTANCE_TOLERANCE * hanger.marker_distance_m + 4.0 * float(np.sqrt((sd**2).sum()))
    if abs(distance - hanger.marker_distance_m) > allowed:
        wrong = doubtful if doubtful is not None and doubtful.any() else np.ones(2, dtype=bool)
        positions[wrong] = np.nan
        sd[wrong] = np.nan
    return distance


@dataclass(frozen=True)
class ImageTrack:
    """The last detection of a marker: centre [px], velocity [px/s], side [px]."""

    time: float
    centre: Floats
    velocity: Floats
    side: float

    @classmethod
    def after(cls, before: Self | None, time: float, centre: Floats, side: float) -> Self:
        """Return the track that continues an earlier one."""
        velocity = np.zeros(2)
        if before is not None and 0.0 < time - before.time <= LONGEST_GUESS:
            velocity = (centre - before.centre) / (time - before.time)
        return cls(time, centre, velocity, side)

    def window(self, time: float, pixels_per_metre: float) -> tuple[Floats, float, float]:
        """Return centre, half width and marker side [px] of the window to search at `time`."""
        gone = time - self.time
        reach = 1.2 * self.side + 0.5 * HARDEST_HAND * gone**2 * pixels_per_metre
        return self.centre + self.velocity * gone, reach, self.side
