"""Rigid bodies at rest and in motion, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.recordings.bodies import HALF_SPACE, Body, BodyMotion, capsule, half_space, placed, sphere


def test_bodies_are_as_far_away_as_by_hand():
    ball = sphere((1.0, 0.0, 0.0), 0.5)
    assert ball.distance(np.array([[3.0, 0, 0], [1, 0, 0], [1, 0.5, 0]])) == pytest.approx([1.5, -0.5, 0.0])
    assert ball.thickness == 1.0
    rod = capsule((0.0, 0, 0), (0.0, 0, 2.0), 0.1)
    assert rod.distance(np.array([[0.4, 0, 1], [0, 0, 2.5], [0.3, 0, -0.4]])) == pytest.approx([0.3, 0.4, 0.4])
    assert rod.half_size == (0.0, 0.0, 1.0)
    plane = half_space((0.0, 0, 1.0), (0.0, 0, 2.0))
    assert plane.distance(np.array([[5.0, 5, 3], [0, 0, 0]])) == pytest.approx([2.0, -1.0])
    assert plane.half_size == (HALF_SPACE,) * 3
    cube = Body(centre=(0.0, 0, 0), half_size=(1.0, 2.0, 3.0), radius=0.1)
    assert cube.distance(np.array([[2.0, 0, 0], [2, 3, 3], [0, 0, 0]])) == pytest.approx([0.9, np.sqrt(2) - 0.1, -1.1])
    assert cube.thickness == pytest.approx(2.2)
    cone = Body(centre=(0, 0, 0), half_size=(0, 0, 1.0), radius=0.5, taper=0.2)
    assert cone.thickness == pytest.approx(0.6)
    assert cone.distance(np.array([[1.0, 0, 1.0], [1, 0, 0]])) == pytest.approx(np.array([0.3, 0.5]) / np.hypot(1, 0.2))
    assert cone.row().tolist() == [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1.0, 0.5, 0.2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"radius": 0.0}, "has no inside"), ({"radius": -1.0}, "has no inside"), ({"radius": np.inf}, "has no inside"),
     ({"centre": (np.nan, 0, 0)}, "has no inside"), ({"axes": ((1, 0, 0), (0, 1, 0))}, "three unit vectors"),
     ({"axes": ((2, 0, 0), (0, 1, 0), (0, 0, 1))}, "three unit vectors"),
     ({"half_size": (0, 0, 1.0), "taper": 0.5}, "has no end"), ({"half_size": (0, 0, 1.0), "taper": -0.5}, "no end")],
)  # fmt: skip
def test_impossible_bodies_are_refused(changes, words):
    with pytest.raises(FitError, match=words):
        Body(**({"centre": (0, 0, 0), "radius": 0.5} | changes))
    Body(centre=(0, 0, 0), radius=0.5, half_size=(0, 0, 1.0), taper=0.49)


def test_a_capsule_and_a_plane_have_a_direction():
    with pytest.raises(FitError, match="is a sphere") as refused:
        capsule((1.0, 1, 1), (1.0, 1, 1), 0.1)
    assert "use sphere(centre, radius)" in str(refused.value)
    with pytest.raises(FitError, match="has no direction"):
        half_space((0.0, 0, 0), (0.0, 0, 0))


def pose(centre, degrees=0.0):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.concatenate([centre, [c, s, 0], [-s, c, 0], [0, 0, 1]])


def test_a_moving_body_is_on_the_straight_line_with_square_axes():
    motion = BodyMotion(0.5, np.stack([[pose([0.0, 0, 0])], [pose([1.0, 0, 0], 60)], [pose([1.0, 2.0, 0], 60)]]))
    found_poses = motion.at(np.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 9.0]))
    assert found_poses.shape == (7, 1, 12)
    assert found_poses[:, 0, 0] == pytest.approx([0, 0, 0.5, 1, 1, 1, 1])
    assert found_poses[:, 0, 1] == pytest.approx([0, 0, 0, 0, 1, 2, 2])
    assert found_poses[2, 0] == pytest.approx(pose([0.5, 0, 0], 30))
    assert placed(sphere((9.0, 9, 9), 0.2), found_poses[3, 0]).centre == pytest.approx((1.0, 0, 0))
    axes = np.array(placed(Body(centre=(0, 0, 0), half_size=(1, 1, 1)), found_poses[3, 0]).axes)
    assert axes == pytest.approx(pose([0, 0, 0], 60)[3:].reshape(3, 3))


def test_a_body_has_gone_as_far_as_its_farthest_corner():
    """A box of 3 x 4 m turns by 90 degrees: its corners, 5 m away, go the chord of 5 sqrt 2; then all go 2 m."""
    motion = BodyMotion(1.0, np.stack([[pose([0.0, 0, 0])], [pose([0.0, 0, 0], 90)], [pose([0.0, 0, 2.0], 90)]]))
    flat = Body(centre=(0.0, 0, 0), half_size=(3.0, 4.0, 0.0))
    assert motion.way((flat,)) == pytest.approx([0.0, 5 * np.sqrt(2), 5 * np.sqrt(2) + 2])
    cone = Body(centre=(0, 0, 0), half_size=(0, 0, 1.0), radius=0.5, taper=0.2)
    assert motion.way((cone,)) == pytest.approx([0.0, 0.7 * 2, 0.7 * 2 + 2])
    other = np.concatenate([motion.poses, motion.poses], axis=1)
    other[1:, 1, 1] = 100.0
    assert BodyMotion(1.0, other).way((flat, flat))[1] > 90.0
