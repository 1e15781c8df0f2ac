"""Numbers of a rig in another unit, place or sign, each refused with its cause, and the same number where it is right.

The rig is the one that `hangtime sensor synthesise` writes.
"""

from __future__ import annotations

import cv2
import msgspec
import pytest

from firmware_host.synthetic.scene import RIG
from formats.descriptions import check_rig, dump_description, load_rig
from formats.errors import DescriptionError, ImplausibleError
from formats.plausible_rig import DICTIONARIES, check_plausible_hold, check_plausible_rig
from tests.formats.test_plausible import panel


def rig(**changes):
    """The rig with other numbers of its hanger, its sensor or itself."""
    parts = {
        name: msgspec.structs.replace(part, **{k: v for k, v in changes.items() if k in part.__struct_fields__})
        for name, part in (("hanger", RIG.hanger), ("sensor", RIG.sensor))
    }
    rest = {k: v for k, v in changes.items() if k in RIG.__struct_fields__}
    return msgspec.structs.replace(RIG, **parts, **rest)


def ends(left, right, down=0.09, away=0.0):
    return (left, down, away), (right, down, away)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_m": ends(-2.0, 2.0)}, "hanger.held_m: its ends are 4 m apart and the markers 0.3 m; measure held_m"),
        ({"held_m": ends(0.2, -0.2)}, "its first end, at x = 0.2, is not left of its second, at x = -0.2; give the"),
        ({"held_m": ends(-0.2, 0.2, down=-0.9)}, "an end is 0.9 m off the line through the markers, a hanger's at"),
        ({"held_m": ends(-0.2, 0.2, away=0.51)}, "an end is 0.51 m off the line through the markers"),
        ({"held_m": ends(-20, 20)}, "hanger.held_m is 20 m, a hanger has 0.01 to 3 m; were millimetres or centimetres"),
        ({"cx": 0.3}, "sensor.cx = 0.3 px is far from the middle of 640 pixels, where sensors have it; is that a share "
         "of the picture, 192 px?"),
        ({"cy": 100.0}, "sensor.cy = 100 px is far from the middle of 480 pixels, where sensors have it; give"),
        ({"fx": 4.7, "fy": 4.7}, "span 178 degrees, a sensor's picture 10 to 150; is that millimetres?"),
        ({"fx": 300.0}, "sensor.fx = 300 and sensor.fy = 575.8 px are of no square pixels"),
        ({"gravity": (0.0, -1.0, 0.0)}, "gravity = [0, -1, 0] points up in the picture: x is to the right, y down"),
        ({"gravity": (0.0, 0.0, 1.0)}, "gravity = [0, 0, 1] points along the view"),
        ({"gravity": (1.0, 0.0, 0.0)}, "gravity = [1, 0, 0] points to a side"),
        ({"marker_size_m": 0.006}, "hanger.marker_size_m = 0.006 m is 6.9 px wide at 0.5 m, and no marker is read below"
         " 12 px"),
    ],
)  # fmt: skip
def test_a_rig_of_no_hanger_or_sensor_says_which_number_and_why_and_is_accepted_anyway(tmp_path, changes, says):
    check_rig(rig(**changes), "r")
    (tmp_path / "rig.toml").write_text(dump_description(rig(**changes)))
    with pytest.raises(ImplausibleError) as refused:
        load_rig(tmp_path / "rig.toml", anyway=False)
    assert says in str(refused.value)
    assert str(refused.value).endswith(", or --anyway to accept it")
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
    ],
)
def test_a_rig_just_within_the_bounds_is_one(changes):
    check_plausible_rig(rig(**changes), "r")


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
