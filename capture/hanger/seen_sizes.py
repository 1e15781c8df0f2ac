"""Measure a hanger's markers in one frame by depth, beside the sizes that its rig states: which of them is wrong?

    size = side in pixels x depth / focal length

Depth is that of the sensor, so that neither stated length is needed. Both lengths are off alike where the focal length
is: then the rig's markers are right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from capture.hanger.marker_detection import MarkerDetector
from formats.arrays import Floats
from formats.rig import Hanger, Rig, Sensor

OFF = 0.1  # of a length: a side of 17 px is seen to a pixel, and a plate turned by 20 degrees is 6 % narrower
NEAREST_DEPTH = 0.3  # m: what sensors give below is no distance
ALIKE = 0.1  # of each other: so near are two lengths that are off because of the focal length


def sizes_seen(colour: NDArray[np.uint8], depth: NDArray[np.uint16], rig: Rig) -> tuple[float, float] | None:
    """Return side and distance [m] of both markers in an RGB picture, (H, W, 3), with depth [mm], (H, W).

    None where a marker or its depth is not seen, or where the hanger has dots: these have no side of their own.
    """
    if rig.hanger is None or rig.sensor is None or rig.hanger.marker == "dot":
        return None
    if not colour.shape[:2] == depth.shape == (rig.sensor.height, rig.sensor.width):
        return None
    corners = MarkerDetector(rig.hanger.dictionary, rig.hanger.ids).in_picture(colour)
    if not np.isfinite(corners).all():
        return None
    away = np.array([_depth_within(quad, depth) for quad in corners])
    if not np.isfinite(away).all():
        return None
    places = [_placed(quad, metres, rig.sensor) for quad, metres in zip(corners, away, strict=True)]
    sides = [np.linalg.norm(place - np.roll(place, 1, axis=0), axis=1).max() for place in places]  # turned: narrower
    return float(np.mean(sides)), float(np.linalg.norm(places[1].mean(0) - places[0].mean(0)))


def wrong_size(hanger: Hanger, sensor: Sensor, seen: tuple[float, float]) -> str:
    """Return which number of the rig contradicts the sizes that are seen [m], and nothing where none does."""
    size, distance = seen[0] / hanger.marker_size_m, seen[1] / hanger.marker_distance_m
    if max(abs(size - 1), abs(distance - 1)) <= OFF:
        return ""
    told = f"depth shows markers of {1e3 * seen[0]:.0f} mm that are {1e3 * seen[1]:.0f} mm apart"
    if abs(size / distance - 1) <= ALIKE:
        return f"{told}: sensor.fx and fy are {sensor.fx:g}, and about {sensor.fx * distance:.0f} would fit"
    wrong = "marker_size_m" if abs(size - 1) > abs(distance - 1) else "marker_distance_m"
    return f"{told}: measure hanger.{wrong} again"


def _depth_within(quad: Floats, depth: NDArray[np.uint16]) -> float:
    """Return the median depth [m] in the upright square round the corners [px], (4, 2); NaN where none is measured."""
    (left, top), (right, bottom) = quad.min(0).astype(int), quad.max(0).astype(int) + 1
    part = depth[max(top, 0) : bottom, max(left, 0) : right]
    measured = part[part > 1e3 * NEAREST_DEPTH]
    return float(np.median(measured)) / 1e3 if measured.size else np.nan


def _placed(quad: Floats, away: float, sensor: Sensor) -> Floats:
    """Return corners [px], (4, 2), as places [m], (4, 3), at one depth."""
    rays = (quad - (sensor.cx, sensor.cy)) / (sensor.fx, sensor.fy)
    return np.asarray(away * np.column_stack([rays, np.ones(len(quad))]))
