"""BVH files: a walk written and read again, rotations by hand, and refused files."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fit.errors import FitError
from fit.figure.bvh import LEAD, _check_bones, _places, read_bvh
from fit.figure.gait import standing, walk
from tests.fit.figure.walking import bvh_of

TWO_BONES = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Arm
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 5 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.033333
1 2 3 0 0 0 0 0 0
1 2 3 90 0 0 0 90 0
"""


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_motion_in_another_encoding_is_read(tmp_path, encoding):
    path = tmp_path / "two.bvh"
    path.write_text(TWO_BONES)
    plain = _places(path)[2]
    path.write_bytes(TWO_BONES.encode(encoding))
    assert (_places(path)[2] == plain).all()


def test_turns_follow_each_other_in_the_order_of_their_channels(tmp_path):
    """The root turns y to -x; the second bone first turns about x, y to z, and the root leaves z where it is."""
    path = tmp_path / "two.bvh"
    path.write_text(TWO_BONES)
    joints, times, places = _places(path)
    assert [j.name for j in joints] == ["Hips", "Arm", "Site"]
    assert times == pytest.approx([0, 0.033333])
    assert places[0] == pytest.approx(np.array([[1, 2, 3], [1, 12, 3], [1, 17, 3]]))
    assert places[1] == pytest.approx(np.array([[1, 2, 3], [-9, 2, 3], [-9, 2, 8]]))


def test_a_walk_that_is_written_and_read_is_the_walk_after_its_lead(tmp_path):
    """Centimetres, y up, another direction: the figure is in metres, z up, and of the stated height."""
    source = walk(6.0, 1.1, 1.70)
    path = tmp_path / "walk.bvh"
    path.write_text(bvh_of(source))
    found = read_bvh(path, 1.70, 6.0)
    assert found.joints["pelvis"][0, 2] == pytest.approx(source.joints["pelvis"][0, 2], abs=1e-3)
    late = int((LEAD + 0.5) / found.spacing)
    lag = int(LEAD / 2 / found.spacing)
    for joint in ("pelvis", "left_knee", "right_ankle", "left_wrist"):
        expected = source.joints[joint][late - lag : len(found.pelvis) - lag]
        assert np.abs(found.joints[joint][late:] - expected).max() < 3.5e-3
    assert found.length("left_hip", "left_knee") == pytest.approx(1.70 * 0.245, rel=0.01)


def test_twice_as_tall_a_figure_is_twice_as_large(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(bvh_of(walk(3.0), units=39.37))
    small, large = read_bvh(path, 1.0, 3.0), read_bvh(path, 2.0, 3.0)
    assert large.joints["left_knee"] == pytest.approx(2 * small.joints["left_knee"], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("nothing", "is no BVH file"),
        (TWO_BONES, "has no joint that is a left hip; name it LeftUpLeg; the file has Hips, Arm"),
        (TWO_BONES.replace("Frames: 2", "Frames: 3"), "says 3 frames of 9 numbers"),
        (TWO_BONES.replace("90 0 0 0 90", "90 0 nine 0 90"), "something else than numbers"),
        (TWO_BONES.replace("OFFSET 0 10 0", "OFFSET 0 ten 0"), "has a damaged hierarchy"),
        (TWO_BONES.replace("OFFSET 0 10 0", "OFFSET nan 10 0"), "has a damaged hierarchy"),
        (TWO_BONES.replace("CHANNELS 3 Z", "CHANNELS -3 Z"), "has a damaged hierarchy"),
        (TWO_BONES.replace("CHANNELS 3 Z", "CHANNELS 3 Q"), "has a damaged hierarchy"),
        (TWO_BONES.replace("0.033333", "1e-9"), "its frames are 1e-09 s apart.*write its Frame Time in seconds"),
        (TWO_BONES.replace("0.033333", "33"), "its frames are 33 s apart"),
        (TWO_BONES.replace("90 0 0 0 90", "90 0 0 0 1e200"), "holds 1e[+]200 in frame 1, which is no place and no"),
        (TWO_BONES.replace("0.033333", "0.0.3"), "something else than numbers"),
        (TWO_BONES.replace("Frames: 2", f"Frames: {'9' * 5000}"), "is no BVH file"),
    ],
)
def test_files_that_hold_no_person_are_refused(text, reason, tmp_path):
    path = tmp_path / "wrong.bvh"
    path.write_text(text)
    with pytest.raises(FitError, match=reason):
        read_bvh(path, 1.7)


def test_a_joint_that_jumps_is_refused_with_its_frames(tmp_path):
    """Everything 3 m farther from one frame on: 94 m/s at 32 ms."""
    source = walk(3.0)
    for places in source.joints.values():
        places[16 * 20 :] += [3.0, 0.0, 0.0]
    path = tmp_path / "leap.bvh"
    path.write_text(bvh_of(source))
    with pytest.raises(FitError, match=r"leaps by [23].* m from frame 19 to frame 20; mend these frames"):
        read_bvh(path, 1.7)


def test_a_moment_is_no_motion(tmp_path):
    path = tmp_path / "short.bvh"
    path.write_text(bvh_of(walk(0.5)))
    with pytest.raises(FitError, match=r"lasts 0\.\d+ s; at least 1 s are needed"):
        read_bvh(path, 1.7)


def test_a_figure_whose_joints_are_all_at_one_position_is_refused(tmp_path):
    head, step, rows = re.split(r"(Frame Time:.*\n)", bvh_of(walk(3.0)))
    path = tmp_path / "point.bvh"
    path.write_text(re.sub(r"OFFSET .*", "OFFSET 0 0 0", head) + step + re.sub(r"\S+", "0", rows))
    with pytest.raises(FitError, match="left hip and left knee are not two places apart"):
        read_bvh(path, 1.7)


def test_the_ball_of_a_foot_is_what_the_ankle_carries_by_whatever_name(tmp_path):
    text = bvh_of(walk(3.0))
    (tmp_path / "a.bvh").write_text(text)
    (tmp_path / "b.bvh").write_text(text.replace("ToeBase", "Ball"))
    named, other = (read_bvh(tmp_path / f"{name}.bvh", 1.7).joints for name in "ab")
    for joint in ("left_toe", "right_toe", "left_finger"):
        assert other[joint] == pytest.approx(named[joint], abs=1e-9)


def test_joints_of_a_limb_that_coincide_away_from_the_origin_are_refused():
    joints = {name: np.tile(place, (3, 1)) + 5.0 for name, place in standing(1.7).items()}
    _check_bones("a.bvh", joints)
    with pytest.raises(FitError, match="its right elbow and right wrist are not two places apart"):
        _check_bones("a.bvh", joints | {"right_wrist": joints["right_elbow"]})
