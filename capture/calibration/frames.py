"""Watch a sensor until the scene is still, and collect the marker corners and depth of the still frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from capture.errors import CalibrationError
from capture.hanger.marker_detection import MarkerDetector
from firmware_host.depth_sensor import MOST_FRAMES_OF_DUE, DepthSensor
from formats.arrays import Bytes, Floats, Unsigned

STILL_PIXELS = 0.7  # px that a marker may move within still frames: 2 mm at 1.6 m, five times its detection noise
FEWEST_STILL_FRAMES = 15  # frames, half a second: less can be the turning point of a swing
MOST_KEPT = 90  # frames; three seconds, after which random noise is small beside the systematic errors


@dataclass(frozen=True)
class StillFrames:
    """Markers in frames during which nothing moved.

    - `corners` [px], (frames, ids, 4, 2), in the detector's order, NaN where not found
    - `depth` [mm], one (H, W) a frame
    - `seen`: number of processed frames
    """

    corners: Floats
    depth: list[Unsigned]
    seen: int

    def sees(self, row: int) -> bool:
        """Return whether a marker was detected in at least half of the frames."""
        return float(np.isfinite(self.corners[:, row, 0, 0]).mean()) >= 0.5


def watch(
    sensor: DepthSensor, detector: MarkerDetector, seconds: float,
    otherwise: Callable[[Bytes | None], str] = lambda colour: "",
) -> StillFrames:  # fmt: skip
    """Return the last frames of the longest still period within the next seconds [s] of a sensor.

    otherwise: diagnoses an image without the markers: returns how they appear in it (mirrored, for one) and the remedy

    Raises:
        CalibrationError: no marker was detected, or the scene was never still.
    """
    run = StillRun()
    recent: deque[tuple[Floats, Unsigned]] = deque(maxlen=MOST_KEPT)
    best: list[tuple[Floats, Unsigned]] = []
    first: float | None = None
    colour: Bytes | None = None
    seen = longest = 0
    most = MOST_FRAMES_OF_DUE * seconds * sensor.info.fps
    for number, frame in enumerate(sensor.frames()):
        first = frame.time_s if first is None else first
        if frame.time_s - first > seconds or number >= most:
            break
        if frame.colour is None or frame.depth.shape != frame.colour.shape[:2]:
            continue
        seen, colour = seen + 1, frame.colour
        found = detector.in_picture(frame.colour)
        if np.isnan(found[:, 0, 0]).all():
            continue  # a frame without any marker would count as still
        for row in np.flatnonzero(np.isfinite(found[:, 0, 0])):
            found[row] = detector.refined(frame.colour, int(row), found[row])
        recent.append((found, frame.depth))
        length = run.add(found)
        if length > longest:
            longest, best = length, list(recent)[-length:]
    where = sensor.info.uri
    if not recent:
        raise CalibrationError(
            f"none of the markers {', '.join(map(str, detector.ids))} was seen in {seen} frames", where=where,
            advice=otherwise(colour)
            or "hang the hanger 1.2 to 2.5 m before the sensor, markers towards it, in even light",
        )  # fmt: skip
    if longest < FEWEST_STILL_FRAMES:
        raise CalibrationError(
            f"nothing hung still for {FEWEST_STILL_FRAMES} frames", where=where,
            advice="put the hanger on a hook, let it and the plumb line come to rest, and do not touch them",
        )  # fmt: skip
    return StillFrames(np.stack([corners for corners, _ in best]), [depth for _, depth in best], seen=seen)


class StillRun:
    """The latest run of frames in which no marker moves."""

    def __init__(self) -> None:
        self._centres: list[Floats] = []

    def add(self, corners: Floats) -> int:
        """Add a frame's corners [px], (ids, 4, 2), NaN where not found; return the number of still frames.

        A frame in which a marker is missing leaves the test of that marker unchanged.
        """
        self._centres.append(corners.mean(1))
        while _stray(np.stack(self._centres)) > STILL_PIXELS:
            del self._centres[0]
        return len(self._centres)


def _stray(centres: Floats) -> float:
    """Return the largest distance [px] between the centres, (frames, ids, 2), of one marker along an axis."""
    low = np.where(np.isnan(centres), np.inf, centres).min(0)
    high = np.where(np.isnan(centres), -np.inf, centres).max(0)
    return float(np.max(high - low, initial=0.0))
