"""Compare the marker sizes that depth shows in one frame with the rig's, and name the rig's wrong value.

    size = side in pixels x depth / focal length

Depth comes from the sensor, so this needs neither of the rig's lengths. If both lengths deviate alike, the focal length
is wrong and the rig's marker sizes are right.
"""

from __future__ import annotations

import numpy as np

from capture.hanger.marker_detection import MarkerDetector
from formats.arrays import Bytes, Floats, Unsigned
from formats.plausible_rig import NARROWEST, WIDEST
from formats.rig import Hanger, Rig, Sensor

OFF = 0.1  # of a length: a side of 17 px is measured to a pixel, and a plate rotated by 20 degrees is 6 % narrower
NEAREST_DEPTH = 0.3  # m: smaller values of a sensor are not distances
SATURATED = 65_000  # of 65535, the largest depth value
DEPTH_UNITS = {  # mm of each
    "metres": 1000.0, "decimetres": 100.0, "inches": 25.4, "centimetres": 10.0,
    "units of 8 mm, as after three bits too many of a Kinect's player were cut off": 8.0,
    "tenths of a millimetre": 0.1, "eighths of a millimetre, above the three bits of a Kinect's player": 0.125,
}  # fmt: skip
UNIT_WITHIN = 0.25  # of depth: a rotated or badly measured marker; other units than eighths and 8 mm differ 2.5-fold
ROUNDED_DOWN, ROUNDED_UP = 0.5, 1.0  # units: a whole number is rounded by half a unit, or cut off by one
ALIKE = 0.1  # of each other: two lengths that are wrong because of the focal length agree so closely


def sizes_seen(colour: Bytes, depth: Unsigned, rig: Rig) -> tuple[float, float] | None:
    """Return side and distance [m] of both markers in an RGB picture, (H, W, 3), with depth [mm], (H, W).

    None if a marker or its depth is missing, or if the hanger has dots, which have no side.
    """
    corners = _corners(colour, depth, rig)
    if corners is None or rig.sensor is None:
        return None
    away = np.array([_depth_within(quad, depth) for quad in corners])
    if not np.isfinite(away).all():
        return None
    places = [_placed(quad, metres, rig.sensor) for quad, metres in zip(corners, away, strict=True)]
    sides = [np.linalg.norm(place - np.roll(place, 1, axis=0), axis=1).max() for place in places]  # rotated: narrower
    return float(np.mean(sides)), float(np.linalg.norm(places[1].mean(0) - places[0].mean(0)))


def wrong_unit(colour: Bytes, depth: Unsigned, rig: Rig) -> str:
    """Return why depth in one frame is not in millimetres, by the markers' size in the picture; "" if it may be.

    As for `sizes_seen`. Both of the rig's lengths must put the markers at one distance:

        distance = focal length x length / length in pixels
    """
    corners = _corners(colour, depth, rig)
    if corners is None or rig.sensor is None or rig.hanger is None:
        return ""
    away = float(np.median([_depth_within(quad, depth, nearest=0.0) for quad in corners])) * 1e3
    if not np.isfinite(away):
        return ""  # no depth at all says nothing of its unit
    pixels = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    between = np.linalg.norm(corners[1].mean(0) - corners[0].mean(0))
    by_size = 1e3 * rig.hanger.marker_size_m * rig.sensor.fx / pixels
    by_distance = 1e3 * rig.hanger.marker_distance_m * rig.sensor.fx / between
    shown = f"depth at the markers is {away:.0f} mm, and by their size they are {by_size:.0f} mm away"
    if away >= SATURATED:
        return (
            f"depth at the markers is {away:.0f}, the end of its 16 bits and no distance; record depth in millimetres"
        )
    if abs(by_distance / by_size - 1) > UNIT_WITHIN:
        return ""
    off = {name: _share_off(by_size / count, away) for name, count in DEPTH_UNITS.items()}
    nearest = min(off, key=off.__getitem__)
    if off[nearest] > UNIT_WITHIN or _share_off(by_size, away) <= UNIT_WITHIN:
        return ""
    return f"{shown}: depth is probably in {nearest}; record it in millimetres"


def _share_off(expected: float, whole: float) -> float:
    """Return by what share an expected depth lies outside of those that a whole number stands for, both in one unit."""
    return max(whole - ROUNDED_DOWN - expected, expected - whole - ROUNDED_UP, 0.0) / whole


def wrong_size(hanger: Hanger, sensor: Sensor, seen: tuple[float, float]) -> str:
    """Return the rig's value that contradicts the measured sizes [m], "" if none does."""
    size, distance = seen[0] / hanger.marker_size_m, seen[1] / hanger.marker_distance_m
    if max(abs(size - 1), abs(distance - 1)) <= OFF:
        return ""
    measured = f"depth shows markers of {1e3 * seen[0]:.0f} mm that are {1e3 * seen[1]:.0f} mm apart"
    fitting = distance * sensor.fx
    span = float(np.degrees(2 * np.arctan(sensor.width / (2 * fitting))))
    if abs(size / distance - 1) <= ALIKE and not NARROWEST <= span <= WIDEST:
        return f"{measured}: depth is {distance:.2g} times what the rig's sizes say; record depth in millimetres"
    if abs(size / distance - 1) <= ALIKE:
        return f"{measured}: sensor.fx and fy are {sensor.fx:g}, and about {fitting:.0f} would fit"
    wrong = "marker_size_m" if abs(size - 1) > abs(distance - 1) else "marker_distance_m"
    return f"{measured}: measure hanger.{wrong} again"


def _corners(colour: Bytes, depth: Unsigned, rig: Rig) -> Floats | None:
    """Return the corners [px], (2, 4, 2), of both fiducials in a picture; None where one is missing."""
    if rig.hanger is None or rig.sensor is None or rig.hanger.marker == "dot":
        return None
    if not colour.shape[:2] == depth.shape == (rig.sensor.height, rig.sensor.width):
        return None
    corners = MarkerDetector(rig.hanger.dictionary, rig.hanger.ids).in_picture(colour)
    return corners if np.isfinite(corners).all() else None


def _depth_within(quad: Floats, depth: Unsigned, *, nearest: float = NEAREST_DEPTH) -> float:
    """Return the median depth [m] in the bounding box of the corners [px], (4, 2); NaN without measurements.

    nearest [m]: only larger depth counts
    """
    (left, top), (right, bottom) = quad.min(0).astype(int), quad.max(0).astype(int) + 1
    part = depth[max(top, 0) : bottom, max(left, 0) : right]
    measured = part[part > 1e3 * nearest]
    return float(np.median(measured)) / 1e3 if measured.size else np.nan


def _placed(quad: Floats, away: float, sensor: Sensor) -> Floats:
    """Return the 3D positions [m], (4, 3), of corners [px], (4, 2), at one depth."""
    rays = (quad - (sensor.cx, sensor.cy)) / (sensor.fx, sensor.fy)
    return np.asarray(away * np.column_stack([rays, np.ones(len(quad))]))
