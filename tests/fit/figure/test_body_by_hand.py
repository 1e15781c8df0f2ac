"""The walk's joints by their formulas, and the body's parts by the shares of the height that they are drawn with."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.figure.dressmaking import plain_skirt, sewn_skirt
from fit.figure.gait import check_speed, standing, walk
from fit.figure.parts import figure_in, figure_in_shirt
from fit.figure.shirt import plain_shirt, sewn_shirt
from fit.figure.skeleton import knee_between

HEIGHT = 1.70  # m
STEP = np.sqrt(60 * 1.2 * 0.006)  # m, at 1.2 m/s
SIZE = STEP / 0.75  # of the normal step, with which all of the body's motion grows
DEGREES = np.pi / 180
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def motion():
    return walk(5.0)


def at_phase(motion, phase):
    """The instant in the third stride at which the left leg has this phase, and its angle."""
    k = round((2 + phase) * 2 * STEP / 1.2 / motion.spacing)
    return k, 2 * np.pi * k * motion.spacing * 1.2 / (2 * STEP)


def test_the_figure_is_late_by_half_of_the_time_in_which_its_steps_grow(motion):
    """From 1.6 s on it has gone 1.2 m/s times all but 0.8 s. Instants are 2 ms apart, and the last is after 5 s."""
    late = np.array([900, 1500, 2400])
    assert motion.spacing == 2e-3
    assert motion.joints["pelvis"][late, 1] == pytest.approx(-1.2 * (late * 2e-3 - 0.8), abs=1e-6)
    assert 5.0 <= motion.seconds < 5.01
    assert motion.joints["pelvis"][400, 1] == pytest.approx(-1.2 * 1.6 * (2.5 / 16 - 3 / 32 + 1 / 64), abs=1e-4)


@pytest.mark.parametrize("phase", [0.0, 0.15, 0.3, 0.65, 0.9])
def test_the_pelvis_shifts_rises_turns_and_drops_as_saunders_says(motion, phase):
    """22 mm over the leg that stands at 0.3 of its stride, 4 degrees with the leg ahead, 5 of drop at 0.2."""
    k, gone = at_phase(motion, phase)
    other, _ = at_phase(motion, 0.175)  # between the highest and the lowest place
    pelvis = motion.joints["pelvis"]
    assert pelvis[k, 0] == pytest.approx(SIZE * 0.022 * np.cos(gone - 0.6 * np.pi), abs=1e-9)
    assert pelvis[k, 2] - pelvis[other, 2] == pytest.approx(SIZE**2 * 0.023 * np.cos(2 * gone - 1.2 * np.pi), abs=3e-4)
    turn, drop = SIZE * 4 * DEGREES * np.cos(gone), SIZE * 5 * DEGREES * np.cos(gone - 0.4 * np.pi)
    left = np.array([np.cos(drop) * np.cos(turn), -np.cos(drop) * np.sin(turn), np.sin(drop)])
    back = np.array([np.sin(turn), np.cos(turn), 0.0])
    assert motion.pelvis[k] == pytest.approx(np.stack([left, back, np.cross(left, back)]), abs=1e-9)
    hips = motion.joints["left_hip"][k] - motion.joints["right_hip"][k]
    assert hips == pytest.approx(2 * 0.05 * HEIGHT * left)


@pytest.mark.parametrize("phase", [0.0, 0.2, 0.5, 0.85])
@pytest.mark.parametrize(("arms_out", "out"), [(12.0, 12.0), (60.0, 22.8), (30.0, 12.0)])
def test_arms_swing_against_the_legs_by_sixteen_degrees_about_six_and_forearms_are_bent_by_twenty(phase, arms_out, out):
    """Arms that began in raised sleeves keep 0.38 of their angle; lowered forearms and hands hang nearer."""
    motion = walk(4.5, arms_out=arms_out * DEGREES)
    k, gone = at_phase(motion, phase)
    chest = motion.joints["pelvis"][k] * [0.6, 1, 1] + [0, 0, 0.288 * HEIGHT]
    assert motion.joints["chest"][k] == pytest.approx(chest)
    assert motion.joints["neck"][k] == pytest.approx(chest + 0.052 * HEIGHT * UP)
    assert motion.joints["head"][k] == pytest.approx(chest + 0.182 * HEIGHT * UP)
    turn = -SIZE * 4 * DEGREES * np.cos(gone)
    nearer = min(out / 12 - 1, 1)
    for side, sign in (("left", 1), ("right", -1)):
        place = chest + sign * 0.115 * HEIGHT * np.array([np.cos(turn), -np.sin(turn), 0])
        swing = -sign * SIZE * 16 * np.cos(gone) - 6 * SIZE
        for joint, length, angle, aside in (
            ("shoulder", 0.0, 0.0, 0.0), ("elbow", 0.186, swing, out),
            ("wrist", 0.146, swing + 20, out * (0.6 + 0.4 * nearer)),
            ("finger", 0.108, swing + 20, out * (0.2 + 0.8 * nearer)),
        ):  # fmt: skip
            turned, away = angle * DEGREES, sign * aside * DEGREES
            hanging = [np.sin(away), -np.sin(turned) * np.cos(away), -np.cos(turned) * np.cos(away)]
            place = place + length * HEIGHT * np.array(hanging)
            assert motion.joints[f"{side}_{joint}"][k] == pytest.approx(place, abs=1e-6), joint


def test_arms_begin_at_the_angle_of_their_sleeves():
    joints = standing(1.8, 60 * DEGREES)
    upper, lower = (joints[f"left_{a}"] - joints[f"left_{b}"] for a, b in (("elbow", "shoulder"), ("wrist", "elbow")))
    assert upper / np.linalg.norm(upper) == pytest.approx([np.sin(60 * DEGREES), 0, -0.5], abs=1e-6)
    assert lower / np.linalg.norm(lower) == pytest.approx(
        [np.sin(60 * DEGREES), -0.5 * np.sin(20 * DEGREES), -0.5 * np.cos(20 * DEGREES)], abs=1e-6
    )
    assert joints["pelvis"][2] == pytest.approx(1.8 * (0.039 + 0.999 * 0.491), abs=1e-6)


def test_a_foot_meets_the_ground_with_its_heel_lies_flat_and_leaves_it_with_its_toe(motion):
    """Winter's angles in round numbers: 18 degrees up, flat, 18 down, 52 down, and level again in the swing.

    The smoothing over 1.5 % of a stride and a leg at its full length change them by some degrees.
    """
    pitches, heights = [], []
    for phase in (0.0, 0.25, 0.52, 0.62, 0.84, 0.97):
        k, _ = at_phase(motion, phase)
        way = motion.joints["left_toe"][k] - motion.joints["left_ankle"][k]
        pitches.append(np.degrees(np.arcsin(way[2] / np.linalg.norm(way)) + np.arctan2(0.019, 0.090)))
        heights.append(motion.joints["left_ankle"][k, 2] / HEIGHT)
        assert np.linalg.norm(way) == pytest.approx(HEIGHT * np.hypot(0.019, 0.09))
    assert pitches == pytest.approx([17, 0, -18.5, -50, -4, 18], abs=3)
    # On the heel and on the ball the ankle is above the pivot, by R + (0.039 - R) cos p - pivot sin p.
    by_hand = [0.02 + 0.019 * np.cos(p) - pivot * np.sin(p) for p, pivot in (
        (18 * DEGREES, -0.035), (0, 0), (-18 * DEGREES, 0.09), (-52 * DEGREES, 0.09))]  # fmt: skip
    assert heights[:4] == pytest.approx(by_hand, abs=0.004)
    assert motion.joints["left_ankle"][2000:, 0] == pytest.approx(0.8 * 0.05 * HEIGHT, abs=5e-3)


def test_a_knee_is_ahead_of_the_straight_line_from_hip_to_ankle_and_turns_with_the_pelvis(motion):
    """The figure walks towards -y. Half-way through its swing a leg is bent by more than 10 cm."""
    k, _ = at_phase(motion, 0.75)
    hip, knee, ankle = (motion.joints[f"left_{joint}"][k] for joint in ("hip", "knee", "ankle"))
    along = (ankle - hip) / np.linalg.norm(ankle - hip)
    out = (knee - hip) - ((knee - hip) @ along) * along
    assert out[1] < -0.1
    assert out / np.linalg.norm(out) @ motion.pelvis[k, 0] == pytest.approx(0.0, abs=0.05)


def test_a_foot_in_its_swing_clears_the_ground_by_three_centimetres_more_than_its_turn_lifts_it(motion):
    """Half-way through its swing, at 0.81, a cubic between the ground's places and speeds is 14 cm high."""
    k, _ = at_phase(motion, 0.81)
    assert motion.joints["left_ankle"][k, 2] == pytest.approx(0.142 + 0.03, abs=3e-3)
    toes = motion.joints["left_toe"][slice(at_phase(motion, 0.66)[0], at_phase(motion, 0.98)[0]), 2]
    assert toes.min() > 0.02 * HEIGHT


@pytest.mark.parametrize(("speed", "is_refused"), [(0.39, True), (0.4, False), (1.8, False), (1.81, True)])
def test_people_walk_at_four_tenths_to_one_metre_eighty_a_second(speed, is_refused):
    if not is_refused:
        check_speed(speed)
        return
    with pytest.raises(FitError, match="nobody walks at"):
        check_speed(speed)


def test_a_knee_lies_ahead_of_the_leg_by_the_sides_of_a_triangle():
    """Sides of 0.3 and 0.4 m over 0.5 m: 0.18 m down and 0.24 ahead; a leg that is too short is straight."""
    hips, ahead = np.zeros((2, 3)), np.tile([0.0, -1.0, -0.5], (2, 1))
    knees = knee_between(hips, np.array([[0, 0, -0.5], [0, 0, -0.9]]), ahead, 0.3, 0.4)
    assert knees[0] == pytest.approx([0, -0.24, -0.18])
    assert knees[1] == pytest.approx([0, 0, -0.3], abs=2e-3)


def test_the_parts_of_a_body_in_a_skirt_are_as_long_and_as_wide_as_their_shares_of_the_height():
    """A skirt of 0.8 m round: r = 0.8 / (4 / 0.58 - 4 + 2 pi) = 87.1 mm, and 4 mm of clearance.

    At the hips it is 0.854 m round, 8.7 mm wider in radius; the hips widen by 0.6 of that.
    """
    figure = figure_in(sewn_skirt(plain_skirt(0.2))[0], walk(0.01))
    joints = standing(HEIGHT)
    radius = 0.8 / (4 / 0.58 - 4 + 2 * np.pi)
    half = radius * (1 / 0.58 - 1)
    top = radius - 0.004
    hips = top + 0.6 * ((2 * (0.4 + 0.16 * 0.085 / 0.5) - 4 * half) / (2 * np.pi) - radius)
    size, high = hips / (0.05 * HEIGHT), HEIGHT
    pelvis, chest, neck, head = (joints[name] for name in ("pelvis", "chest", "neck", "head"))
    expected = {
        "hips": (pelvis, pelvis + 0.05 * high * UP, half, hips, top),
        "belly": (pelvis + 0.05 * high * UP, pelvis + 0.11 * high * UP, half, top, 0.92 * top),
        "trunk": (pelvis + 0.11 * high * UP, chest - 0.07 * high * UP, half, 0.92 * top, 1.12 * top),
        "shoulders": (chest - 0.035 * high * UP, chest - 0.03 * high * UP, 0.075 * high, 0.04 * high, 0.04 * high),
        "neck": (chest, neck + 0.02 * high * UP, 0.0, 0.03 * high, 0.03 * high),
        "head": (0.64 * neck + 0.36 * head, 0.36 * neck + 0.64 * head, 0.0, 0.92 * 0.047 * high, 0.047 * high),
    }
    for side, sign in (("left", 1), ("right", -1)):
        knee, ankle, toe, shoulder, elbow, wrist, finger = (
            joints[f"{side}_{part}"] for part in ("knee", "ankle", "toe", "shoulder", "elbow", "wrist", "finger")
        )
        arm = (shoulder - elbow) / np.linalg.norm(shoulder - elbow)
        expected |= {
            f"{side}_thigh": (pelvis + sign * half * np.array([1, 0, 0]), knee, 0.0, hips, size * 0.033 * high),
            f"{side}_shank": (knee, ankle, 0.0, 1.03 * size * 0.032 * high, min(size, 1.2) * 0.021 * high),
            f"{side}_shoulder": (chest + np.array([sign * 0.025, 0, 0.016]) * high, shoulder - 0.008 * high * UP, 0.0,
                                 0.02 * high, 0.022 * high),
            f"{side}_upper_arm": (shoulder - 0.03 * high * arm, elbow, 0.0, 0.028 * high, 0.022 * high),
            f"{side}_forearm": (elbow, wrist, 0.0, 0.022 * high, 0.016 * high),
            f"{side}_hand": (wrist, wrist + 0.7 * (finger - wrist), 0.0, 0.018 * high, 0.012 * high),
        }  # fmt: skip
        ahead = (toe - ankle) / np.linalg.norm(toe - ankle)
        sole = -UP + (ahead @ UP) * ahead
        heel = ankle - 0.015 * high * ahead + 0.35 * 0.02 * high * sole / np.linalg.norm(sole)
        expected[f"{side}_foot"] = (heel, toe, 0.012 * high, 1.05 * 0.02 * high, 0.7 * 0.02 * high)
    assert set(figure.names) == set(expected)
    for name, body in zip(figure.names, figure.bodies, strict=True):
        low, high_end, wide, first, last = expected[name]
        axis = np.array(body.axes[2])
        assert np.array(body.centre) - body.half_size[2] * axis == pytest.approx(low, abs=2e-4), name
        assert np.array(body.centre) + body.half_size[2] * axis == pytest.approx(high_end, abs=2e-4), name
        assert body.half_size[0] == pytest.approx(wide), name
        ends = body.radius + np.array([-1, 1]) * body.taper * body.half_size[2]
        assert ends == pytest.approx([first, last]), name
    assert figure.half_side == pytest.approx(half)
    assert figure.band[0, :3] == pytest.approx(pelvis + 0.05 * high * UP)
    assert figure.band[0, 3:].reshape(3, 3) == pytest.approx(np.eye(3), abs=1e-3)


def test_a_t_shirts_collar_sits_above_the_shoulders_and_is_lower_in_front_by_twelve_degrees():
    shirt = sewn_shirt(plain_shirt(0.2))[0]
    figure = figure_in_shirt(shirt, walk(0.01))
    chest = standing(HEIGHT)["chest"]
    assert figure.band[0, :3] == pytest.approx(chest + 0.034 * HEIGHT * UP)
    tilt = 12 * DEGREES
    assert figure.band[0, 3:].reshape(3, 3) == pytest.approx(
        np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]]), abs=1e-3
    )
    assert set(figure.touching) == {
        "hips", "belly", "trunk", "shoulders", "neck",
        *(f"{s}_{p}" for s in ("left", "right") for p in ("thigh", "shoulder", "upper_arm", "forearm", "hand")),
    }  # fmt: skip
