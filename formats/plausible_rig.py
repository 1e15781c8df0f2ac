"""Check the numbers that a person typed in a rig, alone and against the garment that is to hang from the hanger.

Only a recording shows smaller errors (`formats.judgement`), such as a distance that is off by a tenth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

import numpy as np

from formats.errors import ImplausibleError
from formats.garment import Garment
from formats.meant_units import step_or_anyway, unit_of
from formats.rig import Calibration, Hanger, Rig, Sensor, Vector
from formats.rig_bodies import distances_from

Refuse = Callable[[str, str], NoReturn]  # with the words and the next step
AT_A_BOUND = 1e-9  # relative, of numbers that are exactly at a bound
# m. Our choice: at a focal length of 576 px and the nearest view, 5 mm are 6 px, half of what a fiducial needs. Markers
# of 0.5 m are wider than the printed hanger. Half and twice would tell wrong units as well.
SMALLEST_MARKER, LARGEST_MARKER = 0.005, 0.5
# m between the markers, and to the held ends. Our choice: a tenth of the printed hanger, and the widest garment.
SHORTEST_BAR, LONGEST_BAR = 0.03, 3.0
# Degrees, field of view of a depth sensor: 40 to 90 for sensors of rooms. Our choice: wide of these. Half
# and double were not tried.
NARROWEST, WIDEST = 10.0, 150.0
LONGEST_LENS = 50.0  # mm: a focal length below this number was taken from a data sheet, which gives millimetres
SQUARE_WITHIN = 1.2  # times: fx over fy of square pixels is 1; Kinect's calibrations differ by 1.005
MIDDLE_FROM, MIDDLE_TO = 0.25, 0.75  # of the picture's side: calibrated Kinects and Xtions have 0.48 to 0.53
USUALLY_WITHIN = 0.06  # of the picture's side, from its middle: twice what calibrated Kinects and Xtions have
STEEPEST_VIEW = 60.0  # degrees between gravity and down in the picture: beyond, hanging cloth is seen from its edge
DEEPEST_HOLD = 0.5  # m, largest distance of a held end from the bar, vertically or in depth: clips are a hand long
WIDEST_HOLD = 10.0  # held width over the markers' distance: LONGEST_BAR over the 0.3 m of the printed hanger
EDGE_LEAST, EDGE_MOST = 0.25, 1.15  # held width over the garment's held edge: cloth sags, and hardly stretches
EDGE_TOLERANCE = 0.06  # m more: both are measured by hand (`fit.recordings.geometry` allows as much)
FARTHEST_BODY = 10.0  # m from the camera: the PS1080's largest depth (`firmware_host.oni_writer`), and cloth is nearer
FARTHEST_CAMERA = 100.0  # m from the origin of a motion capture's frame: a hall's length
WIDEST_GRAVITY_SD = 30.0  # degrees: fifteen times gravity judged by eye (`capture.calibration.session`)
WIDEST_SCALE_SD = 0.1  # of depth: scales beyond 0.8 and 1.25 are refused, and calibration finds 0.0025
WIDEST_OFFSET_SD = 30.0  # px: larger offsets are refused (`formats.descriptions`)
WIDEST_HELD_SD = 0.05  # m per axis of a held end: a tape finds it to some millimetres, and clips are a hand long
FINEST_SD = 1e-5  # m: no tape and no camera measures a position to a hundredth of a millimetre
MODULES, NEAREST_VIEW = 12.0, 0.5  # px over six modules, two each; m: depth sensors see nothing nearer
# Markers of OpenCV's dictionaries by name: https://docs.opencv.org/4.x/de/d67/group__objdetect__aruco.html
OF_TAGS = {"16h5": 30, "25h9": 35, "36h10": 2320, "36h11": 587}
DICTIONARIES = {
    **{f"DICT_{side}X{side}_{count}": count for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    **{f"DICT_APRILTAG_{name}": count for name, count in OF_TAGS.items()},
    **{f"DICT_APRILTAG_{name.upper()}": count for name, count in OF_TAGS.items()},  # OpenCV knows both spellings
    "DICT_ARUCO_ORIGINAL": 1024, "DICT_ARUCO_MIP_36h12": 250, "DICT_ARUCO_MIP_36H12": 250,
}  # fmt: skip


def check_plausible_rig(rig: Rig, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse implausible sizes, deviations and optics, and bodies out of sight; name the unit that fits.

    offers_anyway: whether the command has the option --anyway, which the error then names

    Raises:
        ImplausibleError: names the number, its range and the unit that fits.
    """

    def refuse(what: str, step: str) -> NoReturn:
        raise ImplausibleError(what, where=where, advice=step_or_anyway(step, offers_anyway))

    if rig.sensor is not None:
        _check_sensor(rig.sensor, refuse)
        _check_gravity(rig, refuse)
    if rig.hanger is not None:
        _check_sizes(rig.hanger, refuse)
        _check_hold(rig.hanger, refuse)
        if rig.sensor is not None and rig.hanger.marker == "fiducial":
            _check_visible(rig.hanger, rig.sensor, refuse)
    _check_bodies(rig, refuse)
    if rig.calibration is not None:
        _check_deviations(rig.calibration, refuse)


def check_plausible_hold(rig: Rig, garment: Garment, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse held ends whose distance does not fit the garment's held edge.

    Raises:
        ImplausibleError: names both lengths.
    """
    if rig.hanger is None:
        return
    apart = float(np.linalg.norm(np.subtract(*rig.hanger.held_m)))
    edge = float(np.hypot(*np.subtract(garment.outline_m[1], garment.outline_m[0])))
    if EDGE_LEAST * edge <= apart <= EDGE_MOST * edge + EDGE_TOLERANCE:
        return
    raise ImplausibleError(
        f"hanger.held_m: its ends are {apart:g} m apart, the garment's held edge is {edge:g} m long", where=where,
        advice=step_or_anyway(
            "measure both, and give held_m in metres from the middle between the markers", offers_anyway
        ),
    )  # fmt: skip


def check_plausible_marker(size_m: float, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse an implausible side length [m] of a printed marker.

    Raises:
        ImplausibleError: names the range and the unit that fits.
    """
    if not SMALLEST_MARKER <= size_m <= LARGEST_MARKER:
        raise ImplausibleError(
            f"a hanger's marker has {SMALLEST_MARKER:g} to {LARGEST_MARKER:g} m (got {size_m:g})"
            f"{unit_of(size_m, SMALLEST_MARKER, LARGEST_MARKER)}", where=where,
            advice=step_or_anyway("give metres, as in --size 0.06", offers_anyway),
        )  # fmt: skip


def _check_sensor(sensor: Sensor, refuse: Refuse) -> None:
    for name, focal, pixels in (("fx", sensor.fx, sensor.width), ("fy", sensor.fy, sensor.height)):
        span = float(np.degrees(2 * np.arctan(pixels / (2 * focal))))
        if not NARROWEST <= span <= WIDEST:
            meant = "; is that millimetres?" if focal < LONGEST_LENS else ""
            refuse(
                f"sensor.{name} = {focal:g} px lets {pixels} pixels span {span:.3g} degrees, a sensor's picture "
                f"{NARROWEST:g} to {WIDEST:g}{meant}",
                "give the focal length in pixels; `hangtime sensor play` tells it",
            )
    if not 1 / SQUARE_WITHIN <= sensor.fx / sensor.fy <= SQUARE_WITHIN:
        refuse(
            f"sensor.fx = {sensor.fx:g} and sensor.fy = {sensor.fy:g} px do not give square pixels",
            "give both focal lengths in pixels; `hangtime sensor play` tells them",
        )
    as_given = sensor.cx / sensor.width, sensor.cy / sensor.height
    exchanged = sensor.cx / sensor.height, sensor.cy / sensor.width
    if all(
        abs(share - 0.5) <= USUALLY_WITHIN < abs(given - 0.5) for share, given in zip(exchanged, as_given, strict=True)
    ):
        refuse(
            f"sensor.cx = {sensor.cx:g} and sensor.cy = {sensor.cy:g} px are far from the middle of {sensor.width} x "
            f"{sensor.height} pixels, where sensors have it; are they exchanged?",
            "give the principal point in pixels; `hangtime sensor play` tells it",
        )
    for name, at, pixels in (("cx", sensor.cx, sensor.width), ("cy", sensor.cy, sensor.height)):
        if not MIDDLE_FROM * pixels <= at <= MIDDLE_TO * pixels:
            meant = f"; is that a share of the picture, {at * pixels:g} px?" if at <= 1 else ""
            refuse(
                f"sensor.{name} = {at:g} px is far from the middle of {pixels} pixels, where sensors have it{meant}",
                "give the principal point in pixels; `hangtime sensor play` tells it",
            )


def _check_gravity(rig: Rig, refuse: Refuse) -> None:
    right, down, away = rig.gravity
    angle = float(np.degrees(np.arctan2(np.hypot(right, away), down)))  # off straight down
    if angle <= STEEPEST_VIEW:
        return
    if angle > 180 - STEEPEST_VIEW:
        seems = "points up in the picture"
    else:
        seems = "points along the view" if abs(away) > abs(right) else "points to a side"
    refuse(
        f"gravity = {_as_text(rig.gravity)} {seems}: x is to the right, y down and z away from the sensor",
        "give [0, 1, 0] for a level sensor; `hangtime calibrate` measures it",
    )


def _check_sizes(hanger: Hanger, refuse: Refuse) -> None:
    reach = float(np.abs(np.array(hanger.held_m)).max())
    for name, value, least, most in (
        ("marker_size_m", hanger.marker_size_m, SMALLEST_MARKER, LARGEST_MARKER),
        ("marker_distance_m", hanger.marker_distance_m, SHORTEST_BAR, LONGEST_BAR),
        ("held_m", reach, 0.01, LONGEST_BAR),
    ):
        if not least <= value <= most:
            refuse(
                f"hanger.{name} is {value:g} m, a hanger has {least:g} to {most:g} m{unit_of(value, least, most)}",
                "measure it again and give metres",
            )


def _check_hold(hanger: Hanger, refuse: Refuse) -> None:
    (left, *left_off), (right, *right_off) = hanger.held_m
    if left >= right:
        refuse(
            f"hanger.held_m: its first end, at x = {left:g}, is not left of its second, at x = {right:g}",
            "give the left end first, as the sensor sees it; x is to the right",
        )
    farthest = max(map(abs, (*left_off, *right_off)))
    if farthest > DEEPEST_HOLD:
        refuse(
            f"hanger.held_m: an end is {farthest:g} m off the line through the markers, a hanger's at most "
            f"{DEEPEST_HOLD:g} m",
            "measure from the middle between the marker centres: x to the right, y down, z away, in metres",
        )
    apart = float(np.linalg.norm(np.subtract(*hanger.held_m)))
    if apart > WIDEST_HOLD * hanger.marker_distance_m * (1 + AT_A_BOUND):
        refuse(
            f"hanger.held_m: its ends are {apart:g} m apart and the markers {hanger.marker_distance_m:g} m",
            "measure held_m and marker_distance_m again, both in metres",
        )


def _check_visible(hanger: Hanger, sensor: Sensor, refuse: Refuse) -> None:
    pixels = hanger.marker_size_m * sensor.fx / NEAREST_VIEW
    if pixels < MODULES:
        refuse(
            f"hanger.marker_size_m = {hanger.marker_size_m:g} m is {pixels:.2g} px wide at {NEAREST_VIEW:g} m, and no "
            f"marker is read below {MODULES:g} px",
            "measure the black square's side and give metres",
        )


def _check_bodies(rig: Rig, refuse: Refuse) -> None:
    """Check that the camera can see each body, and stands in none."""
    from_origin = float(np.linalg.norm(rig.viewpoint))
    if from_origin > FARTHEST_CAMERA:
        refuse(
            f"camera_at_m is {from_origin:g} m from the origin, a camera at most {FARTHEST_CAMERA:g} m"
            f"{unit_of(from_origin, NEAREST_VIEW, FARTHEST_CAMERA)}",
            "give metres in the frame of the take",
        )
    is_known = rig.sensor is not None or from_origin > 0  # else the origin may be anywhere in a room
    viewer = "camera" if is_known else "origin"
    for number, body in enumerate(rig.near, 1):
        depth = -float(distances_from(body, np.array(rig.viewpoint)))
        for name, place in (("at_m", body.at_m), ("to_m", body.to_m)):
            if place is None:
                continue
            if body.normal is not None:  # its point may lie anywhere on a plane
                name, away = f"the plane through {name}", abs(depth)
            else:
                away = float(np.linalg.norm(np.subtract(place, rig.viewpoint)))
            if not away - (body.radius_m or 0.0) <= FARTHEST_BODY:
                refuse(
                    f"bodies: {name} = {_as_text(place)} of body {number} is {away:g} m from the {viewer}, a body that "
                    f"cloth may touch at most {FARTHEST_BODY:g} m{unit_of(away, NEAREST_VIEW, FARTHEST_BODY)}",
                    "give metres in the sensor frame",
                )
        if is_known and depth > 0:
            refuse(
                f"bodies: the camera is {depth:g} m inside body {number}, a {body.kind}",
                "give metres in the sensor frame, and a plane's normal towards the cloth",
            )


def _check_deviations(calibration: Calibration, refuse: Refuse) -> None:
    """Check standard deviations; one above its limit means that the quantity was not measured and must be left out."""
    right, down = calibration.depth_offset_sd_px or (0.0, 0.0)
    offset = max(part for part in (0.0, right, down) if np.isfinite(part))  # inf: that axis was never measured
    held = max(map(max, calibration.held_sd_m or ((0.0,),)))
    scale = calibration.depth_scale_sd or 0.0
    percent = f"; was {scale:g} per cent meant, {scale / 100:g}?" if scale / 100 <= WIDEST_SCALE_SD else ""
    for name, value, most, unit, meant in (
        ("gravity_sd_degrees", calibration.gravity_sd_degrees or 0.0, WIDEST_GRAVITY_SD, " degrees", ""),
        ("depth_scale_sd", scale, WIDEST_SCALE_SD, "", percent),
        ("depth_offset_sd_px", offset, WIDEST_OFFSET_SD, " px", ""),
        ("held_sd_m", held, WIDEST_HELD_SD, " m", unit_of(held, FINEST_SD, WIDEST_HELD_SD)),
    ):
        if value > most:
            refuse(
                f"calibration.{name} is {value:g}{unit}, a measurement's at most {most:g}{unit}{meant}",
                "measure again with `hangtime calibrate`, or leave out what was never measured",
            )


def _as_text(place: Vector) -> str:
    return f"[{', '.join(f'{part:g}' for part in place)}]"
