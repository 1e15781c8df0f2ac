"""The procedural walk: feet that do not slide, knees that bend forwards, and a pelvis that rises and falls."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.figure.gait import NORMAL_SPEED, walk
from fit.figure.skeleton import ANKLE_HEIGHT, FOOT_RADIUS, SHANK, THIGH

HEIGHT = 1.70
STRIDE = 2 * np.sqrt(60 * NORMAL_SPEED * 0.006)  # m


@pytest.fixture(scope="module")
def motion():
    return walk(7.0)


def phase(motion, *, begin=0.0, end=1.0, strides=3):
    """The instants of the left leg's phase from begin to end, in the stride that follows the third one."""
    time = np.arange(len(motion.pelvis)) * motion.spacing
    at = time * NORMAL_SPEED / STRIDE - strides
    return (at >= begin) & (at < end)


def test_it_stands_first_and_then_walks_at_its_speed(motion):
    pelvis = motion.joints["pelvis"]
    assert pelvis[0] == pytest.approx([0, 0, HEIGHT * (ANKLE_HEIGHT + 0.999 * (THIGH + SHANK))], abs=1e-3)
    one = pelvis[phase(motion)]
    assert one[0, 1] - one[-1, 1] == pytest.approx(STRIDE, rel=0.01)


def test_the_foot_that_stands_does_not_slide_and_no_toe_is_in_the_floor(motion):
    flat = motion.joints["left_ankle"][phase(motion, begin=0.15, end=0.32)]
    assert np.ptp(flat[:, 1]) < 1e-3
    assert flat[:, 2] == pytest.approx(HEIGHT * ANKLE_HEIGHT, abs=1e-3)
    for side in ("left", "right"):
        assert motion.joints[f"{side}_toe"][:, 2].min() > 0.7 * FOOT_RADIUS * HEIGHT


def test_steps_are_as_long_as_the_walk_ratio_says(motion):
    """1.2 m/s: sqrt(60 x 1.2 x 0.006) = 0.657 m from the left foot to the right one."""
    left = motion.joints["left_ankle"][phase(motion, begin=0.2, end=0.3), 1].mean()
    right = motion.joints["right_ankle"][phase(motion, begin=0.7, end=0.8), 1].mean()
    assert left - right == pytest.approx(0.657, abs=0.002)


def test_thighs_and_shanks_keep_their_lengths_and_knees_bend_as_knees_do(motion):
    """Winter (2009): some 60 degrees in the swing, and less than 30 under the body's weight."""
    hip, knee, ankle = (motion.joints[f"left_{j}"] for j in ("hip", "knee", "ankle"))
    assert np.linalg.norm(knee - hip, axis=1) == pytest.approx(HEIGHT * THIGH, rel=1e-6)
    assert np.linalg.norm(ankle - knee, axis=1) == pytest.approx(HEIGHT * SHANK, rel=1e-6)
    cosine = ((knee - hip) * (ankle - knee)).sum(1) / (HEIGHT**2 * THIGH * SHANK)
    bend = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert 50 < bend[phase(motion, begin=0.62)].max() < 70
    assert bend[phase(motion, begin=0.05, end=0.4)].max() < 30


def test_the_pelvis_rises_twice_a_stride_by_some_centimetres(motion):
    high = motion.joints["pelvis"][phase(motion), 2]
    assert np.ptp(high) == pytest.approx(0.046 * (0.657 / 0.75) ** 2, abs=1e-3)
    rising = np.diff(high) > 0
    assert (rising[1:] & ~rising[:-1]).sum() == 2


def test_bodies_and_skirts_are_spared_jerks(motion):
    """Nothing is faster than a heel that meets the ground, over 8 g at the knee."""
    for joint in ("left_knee", "right_knee", "pelvis"):
        change = np.diff(motion.joints[joint], 2, axis=0) / motion.spacing**2
        assert np.linalg.norm(change, axis=1).max() < 90


def test_nobody_walks_at_a_runners_speed():
    with pytest.raises(FitError, match=r"nobody walks at 4 m/s; were kilometres an hour meant\? Give 0\.4 to 1\.8"):
        walk(3.0, 4.0)
