"""Each motion of the synthetic hand against its sines, its jitter against its size, and an edge against its jump."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.synthetic.depth_noise import spoil
from firmware_host.synthetic.motion import HANGER_MOTIONS, hanger_pose
from firmware_host.synthetic.scene import CAMERA

SECONDS = 11.0  # s: the hand moves from 1 s to 0.65 of it, 7.15 s
MOVING = 6.15  # s
# axis: hertz, amplitude [m or degrees], first and last share of the moving time
SINES = {
    "swing": [("z", 0.6, 0.05, 0, 0.55), ("z", 0.85, 0.09, 0.45, 1)],
    "mixed": [
        ("z", 0.5, 0.1, 0, 1), ("z", 1.1, 0.03, 0.3, 1), ("x", 0.7, 0.03, 0, 1), ("yaw", 0.4, 5, 0, 1),
        ("roll", 0.6, 1, 0, 1),
    ],
    "gentle": [("z", 0.7, 0.04, 0, 1)],
    "twist": [("yaw", 0.6, 20, 0, 1), ("z", 0.5, 0.03, 0, 1)],
    "hard": [("z", 1.1, 0.18, 0, 1), ("x", 0.9, 0.12, 0, 1), ("yaw", 0.8, 15, 0, 1)],
}  # fmt: skip
MOST_JITTER = 3 * np.sqrt(2 / 9) * 1e-3  # m: three waves at their tops


def test_every_motion_is_the_sum_of_its_sines_away_from_their_ends():
    """A sine is whole from 0.5 s after its begin to 0.3 s before its end."""
    assert set(SINES) == set(HANGER_MOTIONS)
    time = np.linspace(0, SECONDS, 1101)
    for motion, sines in SINES.items():
        pose = hanger_pose(motion, time, seed=3, seconds=SECONDS)
        found = dict(zip("xyz", pose.displacement.T, strict=True)) | {"yaw": pose.yaw, "roll": pose.roll}
        for axis, values in found.items():
            wanted, is_plain = np.zeros_like(time), (time > 1.51) & (time < 6.84)
            for of, hertz, amplitude, first, last in sines:
                if of == axis:
                    begin, end = 1 + first * MOVING, 1 + last * MOVING
                    size = np.radians(amplitude) if axis in ("yaw", "roll") else amplitude
                    wanted += np.where((time > begin) & (time < end), size, 0) * np.sin(
                        2 * np.pi * hertz * (time - begin)
                    )
                    is_plain &= ~((time >= begin) & (time <= begin + 0.51)) & ~((time >= end - 0.31) & (time <= end))
            assert is_plain.sum() > 300
            bound = 1e-9 if axis in ("yaw", "roll") else MOST_JITTER
            assert np.abs(values - wanted)[is_plain].max() < bound, (motion, axis)


def test_a_hand_jitters_by_a_millimetre_and_rests_before_and_after():
    """Root mean square of all three axes, over 200 s, at 2 to 4 hertz."""
    time = np.arange(0, 320, 0.02)
    place = hanger_pose("gentle", time, seed=5, seconds=320.0).displacement
    sine = 0.04 * np.sin(2 * np.pi * 0.7 * (time - 1))
    inside = (time > 2) & (time < 202)
    rest = place[inside] - np.outer(sine[inside], [0, 0, 1])
    assert np.sqrt((rest**2).sum(1).mean()) == pytest.approx(1e-3, rel=0.02)  # waves of other frequencies, 200 s
    assert not place[(time < 1) | (time > 0.65 * 320)].any()
    spectrum = np.abs(np.fft.rfft(rest[:, 1]))
    hertz = np.fft.rfftfreq(len(rest), 0.02)[spectrum > 0.3 * spectrum.max()]
    assert (hertz.min(), hertz.max()) == pytest.approx((2.94, 2.96), abs=1.06)


@pytest.mark.parametrize("motion", sorted(HANGER_MOTIONS))
def test_a_hand_that_rests_longer_stops_at_the_same_time(motion):
    """From 3 s on, a recording that rests for 3 s has a second's sines later and in a shorter moving time."""
    time = np.linspace(0, 12, 1201)
    pose = hanger_pose(motion, time, seed=3, seconds=12.0, rest=3.0)
    whole = np.column_stack([pose.displacement, pose.yaw, pose.roll])
    assert not whole[(time <= 3.0) | (time >= 0.65 * 12)].any()
    assert whole[(time > 3.0) & (time < 3.6)].any(axis=1).all()
    first = next(sine for sine in HANGER_MOTIONS[motion] if sine.first == 0)
    column = ["x", "y", "z", "yaw", "roll"].index(first.axis)
    at = np.array([3.0 + 0.75 / first.hertz])
    others = sum(
        sine.amplitude * np.sin(2 * np.pi * sine.hertz * (at - 3.0 - sine.first * 4.8))
        for sine in HANGER_MOTIONS[motion]
        if sine.axis == first.axis and 3.0 + sine.first * 4.8 + 0.5 < at < 3.0 + sine.last * 4.8 - 0.3
    )
    found = hanger_pose(motion, at, seed=3, seconds=12.0, rest=3.0)
    value = np.column_stack([found.displacement, found.yaw, found.roll])[0, column]
    assert value == pytest.approx(float(others[0]), abs=MOST_JITTER)


def test_the_ramps_are_quintic():
    """A quarter of the rise of 0.5 s: 0.25^3 (10 - 3.75 + 0.375) is 0.1035; of the fall of 0.3 s too."""
    time = np.array([1 + 0.125, 7.15 - 0.075])
    twist = hanger_pose("twist", time, seed=1, seconds=SECONDS).yaw
    whole = np.radians(20) * np.sin(2 * np.pi * 0.6 * (time - 1))
    assert twist / whole == pytest.approx([0.1035, 0.1035], abs=1e-4)


@pytest.mark.parametrize(("jump", "missing"), [(0.04, 0.0), (0.06, 1 / 3)])
def test_a_third_of_the_pixels_beside_a_jump_of_more_than_5_cm_are_missing(jump, missing):
    """One above the other, so that no shadow falls; two rows of 640 pixels, a standard deviation of 0.013."""
    scene = np.full((CAMERA.height, CAMERA.width), 1.6)
    scene[240:] += jump
    seen = spoil(scene, CAMERA, np.random.default_rng(3)) == 0
    assert seen[239:241].mean() == pytest.approx(missing, abs=0.05)
    assert not seen[:239].any()
    assert not seen[241:].any()
