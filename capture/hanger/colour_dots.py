"""Track the hanger's two coloured dots from frame to frame and compute their positions in metres.

A pixel at the edge of a dot mixes the dot's colour c with the background's b; so does every pixel of a moving dot. The
dot's share of a pixel p is

    w = clip((p - b) . (c - b) / |c - b|^2, 0, 1)        centre = sum(w x) / sum(w),    diameter = sqrt(4 sum(w) / pi)

The sum is the dot's area at any blur, and the mean is its position in the middle of the exposure. A sum
that differs from pi / 4 (f D / z)^2 by more than `AREA_TOLERANCE` is a partly covered dot, or another object. It gets
no position, because its centre would be wrong. Depth and position: `capture.hanger.marker_plates`. Without a recent
detection, dots are searched for as in `capture.hanger.colour_dot_search`.

Source: mixed pixels, J. B. Adams, M. O. Smith, P. E. Johnson, J. Geophys. Res. 91 (1986).
"""

from __future__ import annotations

import cv2
import numpy as np

from capture.errors import UntrackableError
from capture.hanger.colour_dot_search import Dot, find_pair
from capture.hanger.fiducial_tracker import LONGEST_GUESS, HangerSight, ImageTrack, check_distance, hanger_and_sensor
from capture.hanger.marker_plates import PlatePlacer
from formats.arrays import Bytes, Floats, Singles, Unsigned
from formats.rig import Calibration, Rig

AREA_TOLERANCE = 0.3  # of the dot's area: a quarter of a dot covered moves its centre by a tenth of its diameter
# share of the dot's colour from which a pixel belongs to the dot's region. Our choice: half and double find the dots
# of `test_colour_dots.py` as well.
LEAST_COLOUR_SHARE = 0.25
FAINTEST = 40.0  # of 255, distance between the colours of dot and background: 20 times a pixel's noise
INNER = 0.8  # of the diameter: depth pixels farther out may be mixed with the background
# Twelve points on a circle of diameter 1, in diameters of a dot.
CIRCLE = 0.5 * np.stack([np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6)], 1)


class DotTracker:
    """Tracks two dots, found automatically or at `picks` [px], (2, 2), left one first."""

    def __init__(self, rig: Rig, picks: Floats | None = None) -> None:
        self.hanger, self.sensor = hanger_and_sensor(rig)
        self._placer = PlatePlacer(
            self.sensor, self.hanger.marker_size_m, (rig.calibration or Calibration()).depth_offset_px
        )
        self.correlation = self._placer.correlation
        self._picks = picks
        known = self.hanger.dot_colours
        self._colours: list[Floats | None] = [None, None] if known is None else [np.array(c, float) for c in known]
        self._tracks: list[ImageTrack | None] = [None, None]

    def track(self, colour: Bytes, depth: Unsigned, time: float, colour_late: float = 0.0) -> HangerSight:
        """Locate both dots in one frame; see `capture.hanger.fiducial_tracker.HangerTracker.track`.

        Raises:
            UntrackableError: in the first frame, a pick is not on a dot.
        """
        time += colour_late
        is_picked, before = self._picks is not None, (list(self._tracks), list(self._colours))
        dots = self._dots(colour, depth, time)
        centres, sides = np.full((2, 2), np.nan), np.full(2, np.nan)
        positions, sd = np.full((2, 3), np.nan), np.full((2, 3), np.nan)
        for row, dot in enumerate(dots):
            if dot is None:
                continue
            track = ImageTrack.after(self._tracks[row], time, dot.centre, dot.diameter)
            place = dot.centre - colour_late * track.velocity  # px, position of the dot when the depth was taken
            plate = self._placer.plate_depth(place + INNER * dot.diameter * CIRCLE, place, depth)
            if plate is None or not self._is_whole(dot.diameter, plate.depth):
                continue
            centres[row], sides[row] = dot.centre, dot.diameter
            positions[row], sd[row] = self._placer.on_ray(place, plate)
            self._tracks[row] = track
            self._colours[row] = dot.colour if self._colours[row] is None else self._colours[row]
        distance = check_distance(positions, sd, self.hanger)
        if np.isfinite(distance) and np.isnan(positions).any() and not is_picked:
            self._tracks, self._colours = before  # a wrong pair is not tracked: a new search follows soon
        return HangerSight(
            corners=np.full((2, 4, 2), np.nan), centres=centres, sides=sides,
            ranges=np.array([self._placer.range_by_size(side) for side in sides]), positions=positions, sd=sd,
            valid=np.isfinite(positions).all(1), distance_m=distance,
        )  # fmt: skip

    def _dots(self, colour: Bytes, depth: Unsigned, time: float) -> list[Dot | None]:
        if self._picks is not None:
            picks, self._picks = self._picks, None
            return [self._picked(colour, depth, place) for place in picks]
        dots: list[Dot | None] = [None, None]
        known = [track is not None and time - track.time <= LONGEST_GUESS for track in self._tracks]
        for row, track in enumerate(self._tracks):
            mark = self._colours[row]
            if track is not None and mark is not None and known[row]:
                centre, reach, side = track.window(time, track.side / self.hanger.marker_size_m)
                dots[row] = dot_near(colour, centre, reach, side, mark)
        self._drop_doubled(dots, time)
        if all(known):
            return dots
        found = find_pair(colour, depth, self.hanger, self.sensor, self._colours)
        for row, dot in enumerate(found or ()):
            if dots[row] is None:
                finer = dot_near(colour, dot.centre, 1.5 * dot.diameter, dot.diameter, dot.colour)
                dots[row] = finer or dot
        return dots

    def _drop_doubled(self, dots: list[Dot | None], time: float) -> None:
        """Assign a dot in both windows to the track that was updated last, or to the track that expected the dot
        there.
        """
        one, other = dots
        if one is None or other is None or np.linalg.norm(one.centre - other.centre) > 0.5 * one.diameter:
            return
        faults = []
        for track in self._tracks:
            assert track is not None  # it gave the dot
            expected = track.centre + track.velocity * (time - track.time)
            faults.append((time - track.time, float(np.linalg.norm(one.centre - expected))))
        dots[0 if faults[0] > faults[1] else 1] = None

    def _picked(self, colour: Bytes, depth: Unsigned, place: Floats) -> Dot:
        height, width = depth.shape
        x, y = (int(part) for part in np.rint(place))
        where = f"--pick {x},{y}"
        if not (2 <= x < width - 2 and 2 <= y < height - 2):
            raise UntrackableError(
                "lies outside the picture", where=where, advice=f"pick within its {width} x {height} pixels"
            )
        near = depth[y - 2 : y + 3, x - 2 : x + 3]
        if not near.any():
            raise UntrackableError("there is no depth", where=where, advice="pick the middle of a dot")
        diameter = self.sensor.fx * self.hanger.marker_size_m / (1e-3 * float(np.median(near[near > 0])))
        mark = np.median(colour[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3), axis=0).astype(float)
        dot = dot_near(colour, np.array([x, y], float), 1.2 * diameter, diameter, mark)
        if dot is None or not self._is_whole(dot.diameter, self.sensor.fx * self.hanger.marker_size_m / diameter):
            raise UntrackableError(
                f"there is no dot of {1e3 * self.hanger.marker_size_m:g} mm", where=where,
                advice="pick the middle of a dot that is one colour, unlike what is behind it",
            )  # fmt: skip
        return dot

    def _is_whole(self, diameter: float, distance: float) -> bool:
        expected = self.sensor.fx * self.hanger.marker_size_m / distance
        return bool(abs((diameter / expected) ** 2 - 1.0) <= AREA_TOLERANCE)


def dot_near(colour: Bytes, centre: Floats, reach: float, diameter: float, mark: Floats) -> Dot | None:
    """Return the dot of a colour nearest to a pixel [px], (2,), within `reach` [px], or None.

    colour RGB, (H, W, 3); diameter [px]: its approximate size; mark, (3,): its colour, 0 to 255
    """
    height, width = colour.shape[:2]
    left, top = (max(0, int(c - reach)) for c in centre)
    right, bottom = min(width, int(centre[0] + reach) + 2), min(height, int(centre[1] + reach) + 2)
    if right - left < diameter or bottom - top < diameter:
        return None
    window = colour[top:bottom, left:right].astype(np.float32)
    behind = _background(window, mark, diameter)
    toward = mark - behind
    length = float(np.linalg.norm(toward))
    if length < FAINTEST:
        return None
    share = (window - behind.astype(np.float32)) @ (toward / length**2).astype(np.float32)
    # A colour off the line between the dot's colour and the background's is not a mixture of both.
    off = np.linalg.norm(window - behind - share[..., None] * toward, axis=2)
    share = np.where(off < 0.5 * length, np.clip(share, 0.0, 1.0), 0.0)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(
        (share > LEAST_COLOUR_SHARE).astype(np.uint8), connectivity=4
    )
    large = np.flatnonzero(stats[1:count, cv2.CC_STAT_AREA] >= 0.2 * diameter**2) + 1
    if large.size == 0:
        return None
    away = np.linalg.norm(middles[large] + [left, top] - centre, axis=1)
    piece = (labels == large[int(away.argmin())]).astype(np.uint8)
    rim = cv2.dilate(piece, np.ones((3, 3), np.uint8)) > 0
    weights = np.where(rim, share, 0.0)
    total = float(weights.sum())
    v, u = np.mgrid[top:bottom, left:right]
    found = np.array([(weights * u).sum(), (weights * v).sum()]) / total
    return Dot(found, float(np.sqrt(4.0 * total / np.pi)), mark)


def _background(window: Singles, mark: Floats, diameter: float) -> Floats:
    """Return the median colour, (3,), of the pixels in a window that do not have the dot's colour."""
    pixels = window.reshape(-1, 3)
    far = np.linalg.norm(pixels - mark, axis=1)
    others = pixels[far >= np.quantile(far, min(0.8, diameter**2 / len(pixels)))]
    return np.asarray(np.median(others, axis=0), float)
