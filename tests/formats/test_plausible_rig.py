"""Numbers of a rig with a wrong unit, position or sign are refused with the cause; correct numbers pass.

The rig is the one that `hangtime sensor synthesise` writes.
"""

from __future__ import annotations

import cv2
import msgspec
import pytest

from firmware_host.synthetic.scene import RIG
from formats.descriptions import check_rig, dump_description, load_rig
from formats.errors import DescriptionError, ImplausibleError
from formats.plausible_rig import (
    DICTIONARIES,
    LARGEST_MARKER,
    SMALLEST_MARKER,
    check_plausible_hold,
    check_plausible_marker,
    check_plausible_rig,
)
from formats.rig import RigBody
from tests.formats.test_plausible import panel


def rig(**changes):
    """The rig with other numbers of its hanger, its sensor or itself."""
    parts = {
        name: msgspec.structs.replace(part, **{k: v for k, v in changes.items() if k in part.__struct_fields__})
        for name, part in (("hanger", RIG.hanger), ("sensor", RIG.sensor), ("calibration", RIG.calibration))
    }
    rest = {k: v for k, v in changes.items() if k in RIG.__struct_fields__}
    return msgspec.structs.replace(RIG, **parts, **rest)


def near(kind, at_m, **more):
    """Changes to the rig that put one body near it."""
    return {"format": "hangtime-rig/2", "bodies": (RigBody(kind=kind, at_m=at_m, **more),)}


def ends(left, right, down=0.09, away=0.0):
    return (left, down, away), (right, down, away)


OFF_BAR = "measure from the middle between the marker centres: x to the right, y down, z away, in metres"
AXES = (
    ": x is to the right, y down and z away from the sensor; give [0, 1, 0] for a level sensor; `hangtime calibrate` "
    "measures it"
)
PLACE = "Give metres in the sensor frame"
MEASURE = "easure again with `hangtime calibrate`, or leave out what was never measured"
PLAY = "; `hangtime sensor play` tells"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_m": ends(-2.0, 2.0)}, "hanger.held_m: its ends are 4 m apart and the markers 0.3 m; measure held_m and "
         "marker_distance_m again, both in metres"),
        ({"held_m": ends(0.2, -0.2)}, "hanger.held_m: its first end, at x = 0.2, is not left of its second, at x = "
         "-0.2; give the left end first, as the sensor sees it; x is to the right"),
        ({"held_m": ends(-0.2, 0.2, down=-0.9)}, "hanger.held_m: an end is 0.9 m off the line through the markers, a "
         f"hanger's at most 0.5 m; {OFF_BAR}"),
        ({"held_m": ends(-0.2, 0.2, away=0.51)}, "hanger.held_m: an end is 0.51 m off the line through the markers, a "
         f"hanger's at most 0.5 m; {OFF_BAR}"),
        ({"held_m": ends(-20, 20)}, "hanger.held_m is 20 m, a hanger has 0.01 to 3 m; were millimetres or centimetres "
         "or inches meant? Measure it again and give metres"),
        ({"cx": 0.3}, "sensor.cx = 0.3 px is far from the middle of 640 pixels, where sensors have it; is that a share "
         f"of the picture, 192 px? Give the principal point in pixels{PLAY} it"),
        ({"cx": 1.5}, "sensor.cx = 1.5 px is far from the middle of 640 pixels, where sensors have it; give the "
         f"principal point in pixels{PLAY} it"),
        ({"cx": 1.0}, "sensor.cx = 1 px is far from the middle of 640 pixels, where sensors have it; is that a share "
         f"of the picture, 640 px? Give the principal point in pixels{PLAY} it"),
        ({"cx": 239.5, "cy": 319.5}, "sensor.cx = 239.5 and sensor.cy = 319.5 px are far from the middle of 640 x 480 "
         f"pixels, where sensors have it; are they exchanged? Give the principal point in pixels{PLAY} it"),
        ({"cy": 100.0}, "sensor.cy = 100 px is far from the middle of 480 pixels, where sensors have it; give the "
         f"principal point in pixels{PLAY} it"),
        ({"fx": 4.7, "fy": 4.7}, "sensor.fx = 4.7 px lets 640 pixels span 178 degrees, a sensor's picture 10 to 150; "
         f"is that millimetres? Give the focal length in pixels{PLAY} it"),
        ({"fx": 50.0, "fy": 50.0}, "sensor.fx = 50 px lets 640 pixels span 162 degrees, a sensor's picture 10 to 150; "
         f"give the focal length in pixels{PLAY} it"),
        ({"fx": 300.0}, "sensor.fx = 300 and sensor.fy = 575.8 px do not give square pixels; give both focal lengths "
         f"in pixels{PLAY} them"),
        ({"fx": 575.8 * 1.21}, "sensor.fx = 696.718 and sensor.fy = 575.8 px do not give square pixels; give both "
         f"focal lengths in pixels{PLAY} them"),
        ({"gravity": (0.0, -1.0, 0.0)}, f"gravity = [0, -1, 0] points up in the picture{AXES}"),
        ({"gravity": (0.0, -0.51, 0.86)}, f"gravity = [0, -0.51, 0.86] points up in the picture{AXES}"),
        ({"gravity": (0.0, 0.0, 1.0)}, f"gravity = [0, 0, 1] points along the view{AXES}"),
        ({"gravity": (0.0, 0.49, -0.87)}, f"gravity = [0, 0.49, -0.87] points along the view{AXES}"),
        ({"gravity": (1.0, 0.0, 0.0)}, f"gravity = [1, 0, 0] points to a side{AXES}"),
        ({"gravity": (-0.8, 0.0, 0.6)}, f"gravity = [-0.8, 0, 0.6] points to a side{AXES}"),
        ({"marker_size_m": 0.006}, "hanger.marker_size_m = 0.006 m is 6.9 px wide at 0.5 m, and no marker is read below"
         " 12 px; measure the black square's side and give metres"),
        (near("plane", (0, 0, 210), normal=(0, 0, -1)), "bodies: the plane through at_m = [0, 0, 210] of body 1 is 210 "
         f"m from the camera, a body that cloth may touch at most 10 m; were centimetres or inches meant? {PLACE}"),
        (near("capsule", (300, -500, 1900), to_m=(300, 1000, 1900), radius_m=0.03), "bodies: at_m = [300, -500, 1900] "
         "of body 1 is 1987.46 m from the camera, a body that cloth may touch at most 10 m; were millimetres meant? "
         f"{PLACE}"),
        (near("capsule", (0, 0, 2), to_m=(0, 0, 12.0), radius_m=0.03), "bodies: to_m = [0, 0, 12] of body 1 is 12 m "
         "from the camera, a body that cloth may touch at most 10 m; give metres in the sensor frame"),
        (near("sphere", (0, 0, 2.0), radius_m=3.0), "bodies: the camera is 1 m inside body 1, a sphere; give metres in "
         "the sensor frame, and a plane's normal towards the cloth"),
        (near("plane", (0, 0, 2.1), normal=(0, 0, 1)), "bodies: the camera is 2.1 m inside body 1, a plane; give metres"
         " in the sensor frame, and a plane's normal towards the cloth"),
        ({"held_sd_m": ((1.5, 1.6, 3.0), (1.5, 1.6, 3.0))}, "calibration.held_sd_m is 3 m, a measurement's at most 0.05"
         f" m; were millimetres or centimetres meant? M{MEASURE}"),
        ({"held_sd_m": ((0.0, 0.0, 0.06), (0.0,) * 3)}, "calibration.held_sd_m is 0.06 m, a measurement's at most 0.05 "
         f"m; m{MEASURE}"),
        ({"gravity_sd_degrees": 400.0}, "calibration.gravity_sd_degrees is 400 degrees, a measurement's at most 30 "
         f"degrees; m{MEASURE}"),
        ({"depth_scale_sd": 2.0}, "calibration.depth_scale_sd is 2, a measurement's at most 0.1; was 2 per cent meant, "
         f"0.02? M{MEASURE}"),
        ({"depth_scale_sd": 20.0}, f"calibration.depth_scale_sd is 20, a measurement's at most 0.1; m{MEASURE}"),
        ({"depth_offset_sd_px": (float("inf"), 1000.0)}, "calibration.depth_offset_sd_px is 1000 px, a measurement's "
         f"at most 30 px; m{MEASURE}"),
    ],
)  # fmt: skip
def test_a_rig_of_no_hanger_or_sensor_says_which_number_and_why_and_is_accepted_anyway(tmp_path, changes, says):
    check_rig(rig(**changes), "r")
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_rig(rig(**changes), "r")
    assert str(refused.value) == f"r: {says}"
    (tmp_path / "rig.toml").write_text(dump_description(rig(**changes)))
    with pytest.raises(ImplausibleError) as refused:
        load_rig(tmp_path / "rig.toml", anyway=False)
    assert str(refused.value).startswith(f"{tmp_path}/rig.toml, line ")
    assert str(refused.value).endswith(f": {says}, or --anyway to accept it")
    load_rig(tmp_path / "rig.toml", anyway=True)


@pytest.mark.parametrize(
    "changes",
    [
        {"held_m": ends(-1.5, 1.5)},
        {"held_m": ends(-0.2, 0.2, down=0.5)},
        {"cx": 160.0, "cy": 360.0},
        {"fx": 575.8 * 1.19},
        {"gravity": (0.0, 0.51, 0.86)},
        {"gravity": (0.86, 0.51, 0.0)},
        {"marker_size_m": 0.0105},
        {"marker_size_m": 0.006, "marker": "dot"},
        near("sphere", (0, 0, 13.0), radius_m=3.0),
        near("plane", (1, 0, 2), normal=(0, -1, 0)),
        near("plane", (0, 0.01, 0), normal=(0, -1, 0)),
        near("plane", (-3000, 1, 4000), normal=(0, -1, 0)),
        {"gravity_sd_degrees": 30.0, "depth_scale_sd": 0.1, "held_sd_m": ((0.05,) * 3,) * 2},
        {"depth_offset_sd_px": (float("inf"), 30.0)},
    ],
)
def test_a_rig_just_within_the_bounds_is_one(changes):
    check_plausible_rig(rig(**changes), "r")


def test_a_camera_of_motion_capture_is_in_a_hall_and_its_origin_may_be_in_a_body():
    elsewhere = {"sensor": None, "hanger": None, "format": "hangtime-rig/2"}
    far = msgspec.structs.replace(RIG, **elsewhere, camera_at_m=(0.0, 0.0, 2100.0))
    with pytest.raises(ImplausibleError, match=r"camera_at_m is 2100 m .* at most 100 m; were millimetres or"):
        check_plausible_rig(far, "r")
    check_plausible_rig(msgspec.structs.replace(far, camera_at_m=(0.0, 0.0, 99.0)), "r")
    floor = near("plane", (0, 0, 0.1), normal=(0, 0, 1))
    check_plausible_rig(msgspec.structs.replace(RIG, **{**elsewhere, **floor}), "r")


def test_a_depth_scale_in_per_cent_says_so():
    with pytest.raises(DescriptionError, match=r"\(got 101\.78\); were per cent meant, 1\.0178\? See"):
        check_rig(rig(depth_scale=101.78), "r")


def test_the_radius_of_a_body_says_the_unit_that_was_meant():
    with pytest.raises(DescriptionError, match=r"\(body 1 has 30\); were millimetres or centimetres or inches meant\?"):
        check_rig(rig(**near("sphere", (0, 0, 2), radius_m=30.0)), "r")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"ids": (0, 77)}, "hanger.ids: DICT_4X4_50 has the markers 0 to 49 (got 77)"),
        ({"ids": (-1, 3)}, "hanger.ids: DICT_4X4_50 has the markers 0 to 49 (got -1)"),
        ({"dictionary": "DICT_4X4_5O"}, "'DICT_4X4_5O' is none of OpenCV's; did you mean DICT_4X4_50?"),
        ({"marker_distance_m": 0.03}, "hanger.marker_distance_m, 0.03, must be above hanger.marker_size_m, 0.06; was "
         "0.3 meant?"),
        ({"marker_size_m": 0.6}, "hanger.marker_size_m must be above 0 and below hanger.marker_distance_m (got 0.6)"),
    ],
)  # fmt: skip
def test_markers_that_cannot_be_there_are_refused_by_their_number(changes, says):
    with pytest.raises(DescriptionError) as refused:
        check_rig(rig(**changes), "r")
    assert says in str(refused.value)


def test_the_dictionaries_are_opencvs_and_as_large():
    known = {name: getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}
    assert {name: len(cv2.aruco.getPredefinedDictionary(k).bytesList) for name, k in known.items()} == {
        name: count for name, count in DICTIONARIES.items() if name in known
    }


@pytest.mark.parametrize(("edge", "is_one"), [(0.27, False), (0.3, True), (1.59, True), (1.61, False), (0.04, False)])
def test_a_garment_hangs_from_ends_that_are_a_quarter_to_a_little_more_than_its_edge_apart(edge, is_one):
    """The rig's ends are 0.4 m apart; cloth may be 0.06 m and 15 % shorter, and four times longer."""
    if is_one:
        check_plausible_hold(RIG, panel(edge, 0.5, 0.05), "g")
        return
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_hold(RIG, panel(edge, 0.5, 0.05), "g", offers_anyway=True)
    assert f"hanger.held_m: its ends are 0.4 m apart, the garment's held edge is {edge:g} m long" in str(refused.value)
    check_plausible_hold(msgspec.structs.replace(RIG, hanger=None), panel(edge, 0.5, 0.05), "g")


@pytest.mark.parametrize("size", [SMALLEST_MARKER, 0.06, LARGEST_MARKER])
def test_a_printed_marker_of_a_hangers_size_is_one(size):
    check_plausible_marker(size, "--size")


@pytest.mark.parametrize(
    ("size", "meant"), [(0.004, ""), (0.51, ""), (6.0, "; were millimetres or centimetres or inches meant?")]
)
def test_a_printed_marker_that_no_hanger_has_is_refused_with_the_unit_that_fits(size, meant):
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_marker(size, "--size", offers_anyway=True)
    step = "ive metres, as in --size 0.06, or --anyway to accept it"
    assert str(refused.value) == f"--size: a hanger's marker has 0.005 to 0.5 m (got {size:g}){meant}" + (
        f" G{step}" if meant else f"; g{step}"
    )


def test_ends_of_one_place_have_no_left_one():
    with pytest.raises(ImplausibleError, match=r"its first end, at x = 0.1, is not left of its second, at x = 0.1; "):
        check_plausible_rig(rig(held_m=ends(0.1, 0.1)), "r")


def test_a_body_far_from_an_unknown_camera_is_measured_from_the_origin():
    bare = msgspec.structs.replace(rig(**near("sphere", (0, 0, 13.1), radius_m=3.0)), sensor=None)
    with pytest.raises(ImplausibleError, match=r"at_m = \[0, 0, 13\.1\] of body 1 is 13\.1 m from the origin, "):
        check_plausible_rig(bare, "r")
