"""Watch a sensor until what hangs before it is still, and keep what the still frames show of every marker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.errors import CalibrationError
from capture.marker_detection import MarkerDetector
from firmware_host.depth_sensor import DepthSensor

Floats = NDArray[np.float64]

STILL = 0.7  # px that a marker may stray within still frames: 2 mm at 1.6 m, five times its reading noise
FEWEST_STILL = 15  # frames, half a second: less can be the turning point of a swing
MOST_KEPT = 90  # frames; three seconds, after which the noise that averages out is small beside what does not


@dataclass(frozen=True)
class StillFrames:
    """Markers in frames during which nothing moved.

    corners [px], (frames, ids, 4, 2), in the detector's order, NaN where not found; depth [mm], one (H, W) a frame;
    seen: frames that were looked at
    """

    corners: Floats
    depth: list[NDArray[np.uint16]]
    seen: int

    def sees(self, row: int) -> bool:
        """Whether a marker was found in half of the frames or more."""
        return float(np.isfinite(self.corners[:, row, 0, 0]).mean()) >= 0.5


def watch(sensor: DepthSensor, detector: MarkerDetector, seconds: float) -> StillFrames:
    """Return the longest still part of the next seconds [s] of a sensor.

    Raises:
        CalibrationError: no marker was seen, or everything moved all the time.
    """
    corners: list[Floats] = []
    depth: list[NDArray[np.uint16]] = []
    first: float | None = None
    seen = 0
    for frame in sensor.frames():
        first = frame.time_s if first is None else first
        if frame.time_s - first > seconds:
            break
        if frame.colour is None or frame.depth.shape != frame.colour.shape[:2]:
            continue
        seen += 1
        found = detector.in_picture(frame.colour)
        if np.isnan(found[:, 0, 0]).all():
            continue  # without any marker a frame says nothing, and would pass for a still one
        for row in np.flatnonzero(np.isfinite(found[:, 0, 0])):
            found[row] = detector.refined(frame.colour, int(row), found[row])
        corners.append(found)
        depth.append(frame.depth)
    where = sensor.info.uri
    if not corners:
        raise CalibrationError(
            f"none of the markers {', '.join(map(str, detector.ids))} was seen in {seen} frames", where=where,
            advice="hang the hanger 1.2 to 2.5 m before the sensor, markers towards it, in even light",
        )  # fmt: skip
    everything = np.stack(corners)
    start, end = longest_still(everything)
    if end - start < FEWEST_STILL:
        raise CalibrationError(
            f"nothing hung still for {FEWEST_STILL} frames", where=where,
            advice="put the hanger on a hook, let it and the plumb line come to rest, and do not touch them",
        )  # fmt: skip
    end = min(end, start + MOST_KEPT)
    return StillFrames(everything[start:end], depth[start:end], seen=seen)


def longest_still(corners: Floats) -> tuple[int, int]:
    """Return first and one past the last of the longest run of frames in which no marker strays.

    corners [px], (frames, ids, 4, 2); a frame in which a marker is not found says nothing of it.
    """
    centres = corners.mean(2)
    best, start = (0, 0), 0
    for end in range(1, len(centres) + 1):
        while start < end and _stray(centres[start:end]) > STILL:
            start += 1
        if end - start > best[1] - best[0]:
            best = (start, end)
    return best


def _stray(centres: Floats) -> float:
    """Return how far [px] the centres, (frames, ids, 2), get from one another along an axis."""
    low = np.where(np.isnan(centres), np.inf, centres).min(0)
    high = np.where(np.isnan(centres), -np.inf, centres).max(0)
    return float(np.max(high - low, initial=0.0))
