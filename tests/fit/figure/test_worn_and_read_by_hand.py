"""Curves round a body, the hold of a garment, a sheet on growing bones, and the geometry of BVH files, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth.mesh import build_mesh
from fit.errors import FitError
from fit.export.new_motion import hung_still
from fit.figure import bvh
from fit.figure.bvh import (
    _about,
    _check_speeds,
    _end_of,
    _few,
    _Joint,
    _led_in,
    _named,
    _places,
    _plain,
    _upright,
    read_bvh,
)  # fmt: skip
from fit.figure.collar import collar_nodes
from fit.figure.dressing import dressed
from fit.figure.dressmaking import ends_at, girth, is_hem, plain_skirt, sewn_skirt, usual_skirt
from fit.figure.gait import standing, walk
from fit.figure.parts import figure_in
from fit.figure.shirt import arms_out, plain_shirt, sewn_shirt
from fit.figure.wearing import Trouble, _curve, _ends, held_by, wear
from fit.recordings.bodies import capsule
from tests.fit.figure.walking import bvh_of

RADIUS, HALF = 0.1, 0.05
QUARTER = np.pi * RADIUS / 2


def test_a_layer_goes_from_the_right_end_round_a_quarter_along_the_side_and_round_a_quarter_to_the_left():
    way = np.array([0.0, QUARTER / 2, QUARTER, QUARTER + 0.05, QUARTER + 0.1, 1.5 * QUARTER + 0.1, 2 * QUARTER + 0.1])
    half = RADIUS / np.sqrt(2)
    places = [(-0.15, 0), (-0.05 - half, half), (-0.05, 0.1), (0, 0.1), (0.05, 0.1), (0.05 + half, half), (0.15, 0)]
    for is_back, sign in ((True, 1), (False, -1)):
        found = _curve(way, np.full(7, RADIUS), HALF, np.full(7, is_back))
        assert found == pytest.approx(np.array([(x, sign * y, 0) for x, y in places]), abs=1e-12)


@pytest.fixture(scope="module")
def skirt():
    garment = sewn_skirt(plain_skirt(0.2))[0]
    return garment, figure_in(garment, walk(1.0))


def test_a_garment_on_a_figure_has_even_frames_no_points_and_may_touch_only_some_of_its_parts(skirt):
    garment, figure = skirt
    made = wear(hung_still(garment, "skirt"), figure, 0.5, 30.0)
    recording = made.recording
    assert recording.time == pytest.approx(np.arange(16) / 30)
    assert recording.held_seen == pytest.approx(recording.held(recording.time))
    assert np.isnan(recording.points).all()
    assert not recording.valid.any()
    assert recording.points.shape[:2] == recording.valid.shape == (16, 4)
    assert (recording.bodies, recording.windows, recording.held_time) == ((), None, None)
    assert (recording.edge_turn(np.zeros(3)) == np.zeros((3, 2))).all()
    contact = made.contact
    assert (contact.thickness, contact.friction, contact.clearance, contact.spacing) == (2e-3, 0.3, 4e-3, 0.025)
    assert contact.bodies == figure.only(figure.touching)[0]


def test_the_ends_of_a_skirts_band_are_its_half_width_to_either_side(skirt):
    garment, figure = skirt
    radius = (0.8 - 4 * figure.half_side) / (2 * np.pi)
    instants = np.array([0.0, 0.25, 99.0])
    at = np.array([0, 125, len(figure.band) - 1])  # 2 ms apart; after the last one it stays
    aside = (figure.half_side + radius) * figure.band[at, 3:6]
    expected = np.concatenate([figure.band[at, :3] - aside, figure.band[at, :3] + aside], 1)
    assert _ends(garment, figure, instants) == pytest.approx(expected, abs=1e-6)


def test_a_skirts_band_is_held_where_it_begins_and_settles_by_its_first_swing(skirt):
    garment, figure = skirt
    mesh = build_mesh(garment, 0.15)
    support = held_by(garment, figure)(mesh)
    assert (support.nodes == mesh.held_nodes).all()
    start = support.start(np.zeros((3, 12)))
    assert start.shape == (3, len(mesh.rest), 3)
    pose = support.path(np.zeros(1))[0]
    places = pose[:3] + support.shares[:, 1:] @ pose[3:].reshape(3, 3)
    assert (support.shares[:, 0] == 1).all()
    assert places == pytest.approx(start[0, support.nodes])
    assert support.settle_damping == pytest.approx(2 * 1.2024 * np.sqrt(9.80665 / 0.5), rel=1e-3)


def test_trouble_is_cloth_more_than_twelve_millimetres_inside_a_body():
    depths, through = np.full((4, 2), -0.01), np.zeros((4, 2), bool)
    for deep, found in ((0.0119, None), (0.0121, (2, 1))):
        depths[2, 1] = deep
        assert Trouble(depths, through).first() == found


def test_flat_cloth_is_widened_by_a_growing_bone_and_its_held_nodes_go_to_the_collar():
    """Two layers of a square and a bone of 20 mm between them: 7 mm off its surface, and hardly strained."""
    rest = np.array([(x, y) for y in (0.0, -0.1, -0.2) for x in (-0.1, 0.0, 0.1)] * 2)
    square = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [3, 4, 7], [3, 7, 6], [4, 5, 8], [4, 8, 7]])
    mesh = SimpleNamespace(
        rest=rest, triangles=np.concatenate([square, square + 9]), cells=np.concatenate([square, square + 9])
    )
    is_back = np.arange(18) >= 9
    bone = capsule((0.0, 0.0, 0.2), (0.0, 0.0, -0.5), 0.02)
    held = np.array([0, 9])
    collar = np.array([[-0.1, -0.01, 0.01], [-0.1, 0.01, 0.01]])
    places = dressed(mesh, is_back, held, collar, np.zeros(3), (bone,), 0.007)
    assert places[held] == pytest.approx(collar)
    assert bone.distance(places).min() > 0.0069
    assert places[[1, 4, 7], 1].max() < -0.02
    assert places[[10, 13, 16], 1].min() > 0.02
    assert (places[:9, 1] <= -0.004 + 1e-9)[np.arange(9) != 0].all()
    sides = np.concatenate([mesh.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    flat = np.linalg.norm(rest[sides[:, 0]] - rest[sides[:, 1]], axis=1)
    strain = np.linalg.norm(places[sides[:, 0]] - places[sides[:, 1]], axis=1) / flat - 1
    assert np.abs(strain).max() < 0.1
    assert -0.25 < places[[6, 7, 8], 2].min() < -0.15  # the hem sinks by millimetres


def test_girths_beyond_the_skirt_are_those_of_its_ends():
    garment = plain_skirt(0.2)
    assert [ends[0] for ends in ends_at(garment, np.array([-0.1]))] == pytest.approx([-0.2, 0.2])
    assert [ends[0] for ends in ends_at(garment, np.array([0.6]))] == pytest.approx([-0.28, 0.28])
    usual = usual_skirt(0.85)
    assert girth(usual, np.array([0.0, 0.25])) == pytest.approx([0.4, 0.56])  # half as tall, half as wide
    assert [p.at_m for p in usual.points] == list(usual.outline_m)


def test_a_hem_is_a_level_side_at_the_bottom_from_right_to_left():
    outline = ((-0.2, 0.0), (0.2, 0.0), (0.25, -0.5), (0.0, -0.52), (-0.25, -0.5))
    assert [is_hem(outline, (k, (k + 1) % 5)) for k in range(5)] == [False, False, True, True, False]


@pytest.mark.parametrize(("way", "degrees"), [((0.168, -0.089), 62.1), ((0.02, -0.2), 20.0), ((0.2, -0.01), 80.0)])
def test_arms_lie_in_their_sleeves_between_twenty_and_eighty_degrees(way, degrees):
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    outline = np.array(sewn.outline_m)
    tip = int(np.argmax(outline[:, 0]))
    outline[tip] = outline[tip - 1] + way
    outline[np.arange(len(outline)) != tip, 0] = np.minimum(
        outline[np.arange(len(outline)) != tip, 0], outline[tip, 0] - 0.001
    )
    outline[tip - 1] = outline[tip] - way
    garment = SimpleNamespace(outline_m=tuple(map(tuple, outline)))
    assert np.degrees(arms_out(garment)) == pytest.approx(degrees, abs=0.1)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_about_an_axis_takes_the_next_axis_to_the_one_after(axis):
    turn = _about(axis, np.array([np.pi / 2, np.pi / 6]))
    one, two = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
    assert turn[0] @ one == pytest.approx(two)
    assert turn[0] @ two == pytest.approx(-one)
    assert turn[1] @ one == pytest.approx(np.sqrt(0.75) * one + 0.5 * two)
    assert turn[1] @ np.eye(3)[axis] == pytest.approx(np.eye(3)[axis])


def test_joints_are_known_by_many_names_and_a_missing_one_is_named_with_what_there_is():
    assert _plain("mixamorig:Left_Up-Leg1") == "leftupleg"
    parts = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    for make in (
        lambda side, part: {"hip": f"{side}UpLeg", "knee": f"{side}Leg", "ankle": f"{side}Foot",
                            "shoulder": f"{side}Arm", "elbow": f"{side}ForeArm", "wrist": f"{side}Hand"}[part],
        lambda side, part: f"{side[0]}{part}", lambda side, part: f"{part}_{side}",
        lambda side, part: f"{part}.{side[0]}",
    ):  # fmt: skip
        names = ["Hips", "Neck", "Head", *(make(side, part) for side in ("left", "right") for part in parts)]
        index = _named("a.bvh", [_Joint(name, -1, np.zeros(3)) for name in names])
        assert index["pelvis"] == 0
        assert (index["neck"], index["head"]) == (1, 2)
        assert [index[f"{s}_{p}"] for s in ("left", "right") for p in parts] == list(range(3, 15))
    lacking = [_Joint(f"j{k}", -1, np.zeros(3)) for k in range(14)] + [_Joint("Site", -1, np.zeros(3))]
    assert _few(lacking) == [*(f"j{k}" for k in range(12)), "..."]
    assert _few(lacking[2:]) == [f"j{k}" for k in range(2, 14)]
    with pytest.raises(FitError, match="has no joint that is a left hip; name it LeftUpLeg; the file has j0, j1"):
        _named("a.bvh", lacking)


def test_the_end_of_a_limb_is_its_first_child_that_is_apart_or_two_fifths_beyond():
    joints = [_Joint("a", -1, np.zeros(3)), _Joint("b", 0, np.ones(3)), _Joint("c", 1, np.zeros(3)),
              _Joint("d", 1, np.ones(3))]  # fmt: skip
    places = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 2, 0]]], float)
    assert _end_of(joints, places, 1).tolist() == [[1, 2, 0]]
    assert _end_of(joints[:3], places[:, :3], 1) == pytest.approx(np.array([[1.4, 0, 0]]))


def test_a_joint_may_move_at_sixty_metres_a_second_and_no_faster():
    for far, is_refused in ((0.59, False), (0.61, True)):
        places = np.array([[0, 0, 0], [0, 0, 0], [far, 0, 0]], float)
        if is_refused:
            with pytest.raises(FitError, match=r"its left hand leaps by 0\.61 m from frame 1 to frame 2"):
                _check_speeds("a.bvh", {"left_hand": places, "pelvis": 0 * places}, 0.01)
        else:
            _check_speeds("a.bvh", {"left_hand": places, "pelvis": 0 * places}, 0.01)


def test_a_figure_is_set_upright_on_the_floor_facing_minus_y_whatever_axis_is_up():
    """Of a standing figure 2 m tall in other units, with x up and facing y, in the place (300, 200, 100)."""
    joints = {name: place for name, place in standing(2.0).items() if name not in ("pelvis", "chest")}
    turn = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]], float)  # up to x, back to -y, left to z
    found = {name: np.tile(40 * place @ turn.T + [300, 200, 100], (3, 1)) for name, place in joints.items()}
    found["pelvis"] = (found["left_hip"] + found["right_hip"]) / 2
    made = _upright(found, 1.0)
    for name in ("left_knee", "right_wrist", "left_toe"):
        expected = 0.5 * joints[name]
        # The legs are bent a little, so that their length is that of thigh and shank.
        assert made[name][0] == pytest.approx(expected, abs=2e-3), name
    lowest = min(made[f"{s}_{p}"][:, 2].min() for s in ("left", "right") for p in ("ankle", "toe"))
    assert lowest == pytest.approx(0.02, abs=1e-6)
    chest = (made["left_shoulder"] + made["right_shoulder"]) / 2
    assert made["chest"] == pytest.approx(chest)
    assert made["neck"][0] - chest[0] == pytest.approx([0, 0, 0.052], abs=1e-3)
    assert made["head"][0] - made["neck"][0] == pytest.approx([0, 0, 0.13], abs=1e-3)
    bare = {name: place for name, place in found.items() if name not in ("neck", "head")}
    assert _upright(bare, 1.0)["neck"][0] - chest[0] == pytest.approx([0, 0, 0.05], abs=1e-3)


def test_a_motion_is_led_in_from_standing_within_two_seconds_and_one_second_late(tmp_path):
    """The file's clock starts from rest: at 1 s it has gone 2 (2.5 / 16 - 3 / 32 + 1 / 64) s."""
    times = np.arange(0, 5.01, 0.1)
    stood = standing(1.7)
    joints = {name: np.tile(place, (len(times), 1)) + times[:, None] * [0, -1.0, 0] for name, place in stood.items()}
    made = _led_in(joints, times, 4.0, 1.7, bvh.ARM_OUT)
    assert made.seconds == pytest.approx(5.0, abs=2e-3)
    gone = -(made.joints["pelvis"][:, 1] - stood["pelvis"][1])
    early = 2 * (2.5 / 16 - 3 / 32 + 1 / 64)
    assert gone[[0, 500, 1000, 2000]] == pytest.approx([0, early, 1.0, 3.0], abs=1e-6)
    assert made.pelvis == pytest.approx(np.tile(np.eye(3), (len(made.pelvis), 1, 1)), abs=1e-9)
    raised = {name: places + np.array([0, 0, 0.1]) for name, places in joints.items()}
    lifted = _led_in(raised, times, 4.0, 1.7, bvh.ARM_OUT).joints["left_hip"][:, 2] - stood["left_hip"][2]
    assert lifted[[0, 250, 500, 1000, 2000]] == pytest.approx(
        [0, 0.1 * (10 / 64 - 15 / 256 + 6 / 1024), 0.05, 0.1, 0.1], abs=1e-6
    )


def test_a_film_shorter_than_the_file_ends_where_it_is_asked_to(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(bvh_of(walk(4.0)))
    assert read_bvh(path, 1.7, 2.5).seconds == pytest.approx(2.5, abs=3e-3)
    assert read_bvh(path, 1.7).seconds == pytest.approx(5.0, abs=0.04)  # with its lead
    assert read_bvh(path, 1.7, 60.0).seconds == pytest.approx(5.0, abs=0.04)


def with_frames(step, rows, channels="6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"):
    return (
        f"HIERARCHY\nROOT Hips\n{{\n  OFFSET 1 2 3\n  CHANNELS {channels}\n}}\nMOTION\nFrames: {len(rows)}\n"
        f"Frame Time: {step}\n" + "\n".join(rows) + "\n"
    )


@pytest.mark.parametrize(("step", "is_refused"), [(0.0009, True), (0.001, False), (0.2, False), (0.21, True)])
def test_frames_are_a_thousandth_to_a_fifth_of_a_second_apart(tmp_path, step, is_refused):
    path = tmp_path / "a.bvh"
    path.write_text(with_frames(step, ["0 0 0 0 0 0"] * 2))
    if is_refused:
        with pytest.raises(FitError, match="frames are"):
            _places(path)
    else:
        assert _places(path)[1] == pytest.approx([0, step])


def test_positions_replace_an_offset_and_turns_leave_it(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text(with_frames(0.1, ["4 5 6 0 0 0"] * 2))
    assert _places(path)[2][0, 0].tolist() == [4, 5, 6]
    path.write_text(with_frames(0.1, ["90 0 0"] * 2, "3 Zrotation Xrotation Yrotation"))
    assert _places(path)[2][0, 0].tolist() == [1, 2, 3]
    path.write_text(with_frames(0.1, ["7"] * 2, "1 Yposition"))
    assert _places(path)[2][0, 0].tolist() == [0, 7, 0]
    path.write_text(with_frames(0.1, ["4 5 6 0 0 0"]))
    with pytest.raises(FitError, match="says 1 frames of 6 numbers"):
        _places(path)
    path.write_text(with_frames(0.1, ["4 5 6 0 0 0", "4 5 6 0 0 10000001"]))
    with pytest.raises(FitError, match="in frame 1, which is no place and no angle"):
        _places(path)
    path.write_text(with_frames(0.1, ["0 0 0 0 0 0"] * 2, "7 Xposition Yposition Zposition Xrotation Yrotation " * 1))
    with pytest.raises(FitError, match="damaged hierarchy"):
        _places(path)


def test_a_file_that_is_too_large_or_has_too_many_joints_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.bvh"
    path.write_text("HIERARCHY\n" + "JOINT a\n" * 1001)
    with pytest.raises(FitError, match="has more than 1000 joints"):
        _places(path)
    path.write_text(with_frames(0.1, ["0 0 0 0 0 0"] * 2))
    monkeypatch.setattr(bvh, "LARGEST_BVH", path.stat().st_size)
    _places(path)
    monkeypatch.setattr(bvh, "LARGEST_BVH", path.stat().st_size - 1)
    with pytest.raises(FitError, match="the file is too large"):
        _places(path)


def test_a_collars_nodes_know_their_arc_length_along_the_neck():
    """The neckline's three sides are 81, 110 and 81 mm long: a node's place is where its way along them leads."""
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    mesh = build_mesh(sewn, 0.06)
    nodes, way = collar_nodes(sewn, mesh)
    corners = np.array(sewn.outline_m[:4])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    expected = np.stack([np.interp(way, along, corners[:, axis]) for axis in range(2)], 1)
    assert mesh.rest[nodes] == pytest.approx(expected, abs=1e-9)
    assert len(np.unique(way.round(6))) > 6
