"""Slip and rotation from tracked points on the held edge, for known slips."""

from __future__ import annotations

import numpy as np
import pytest

from fit.recordings.held_edge import HeldEdge, place_along
from tests.fit.scenes import swing

FRAME = 1 / 30
ACROSS = np.linspace(-0.2, 0.2, 5)


def edge(slip=0.0, at=3.0, noise=0.002, across=ACROSS, seed=0):
    """A noisy held edge that swings, with a jerk at 1 s; its right end drops by `slip` [m] at some time."""
    time = np.arange(0, 6, FRAME)
    path = swing(time, amplitude=0.05, hz=0.7, start=0.5)
    path[:, 1] += 0.03 * np.clip((time - 1.0) / 0.1, 0, 1)
    bar = np.array([0.2, 0.0, 0.0])
    ends = np.concatenate([path - bar, path + bar], 1)

    def held(instants):
        return np.stack([np.interp(instants, time, column) for column in ends.T], 1)

    points = path[:, None] + np.stack([across, 0 * across, 0 * across], 1)
    drop = slip * (across + 0.2) / 0.4
    points[:, :, 2] -= drop * (time > at)[:, None]
    return HeldEdge(time, points + np.random.default_rng(seed).normal(0, noise, points.shape), across, held)


@pytest.mark.parametrize("at", [1.7, 4.2])
def test_a_slip_is_where_one_side_drops_and_stays(at):
    assert edge(slip=0.004, at=at).slip_at() == pytest.approx(at, abs=0.1)


def test_one_corner_alone_shows_a_slip():
    assert edge(slip=0.006, at=4.2, across=np.array([-0.2, 0.2])).slip_at() == pytest.approx(4.2, abs=0.1)


def test_without_a_step_or_a_point_it_is_the_hardest_jerk():
    for held in (edge(), edge(seed=1), edge(slip=0.01, across=np.zeros(0))):
        assert held.slip_at() == pytest.approx(1.05, abs=0.1)


def test_gaps_are_passed_over():
    seen = edge(slip=0.004, at=4.2)
    seen.points[50:60] = np.nan
    seen.points[:, 4] = np.nan
    assert seen.slip_at() == pytest.approx(4.2, abs=0.1)


@pytest.mark.parametrize("off", [0.0, 0.02])
@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_the_turn_of_the_edge_is_its_slope_whatever_is_off_or_missing(off, missing):
    """A roll of 20 mrad rms about the middle, 1 mm of noise on nine points 0.13 m from it in rms: 2.6 mrad a frame."""
    across = np.linspace(-0.2, 0.2, 9)
    seen = edge(noise=0.001, across=across)
    roll = 0.02 * np.sqrt(2) * np.sin(2 * np.pi * 0.5 * seen.time)
    seen.points[:, :, 2] += off + roll[:, None] * across
    seen.points[np.random.default_rng(1).uniform(size=seen.points.shape[:2]) < missing] = np.nan
    course, rms = seen.turn()
    turn = course(seen.time)[:, 1]
    assert np.corrcoef(turn, roll)[0, 1] > 0.995
    assert np.sqrt((turn**2).mean()) == pytest.approx(0.02, rel=0.1)
    assert rms[1] == pytest.approx(0.02, rel=0.1)


def test_an_edge_of_which_one_side_alone_is_seen_gives_no_rotation():
    seen = edge(across=np.linspace(-0.2, 0.2, 9))
    seen.points[:, 3:] = np.nan
    course, rms = seen.turn()
    np.testing.assert_array_equal(course(seen.time), np.zeros((len(seen.time), 2)))
    np.testing.assert_array_equal(rms, np.zeros(2))


@pytest.mark.parametrize(("across", "is_told"), [((), False), ((0.1,), False), ((-0.2, 0.2), True)])
def test_two_points_give_a_rotation_and_one_or_none_does_not(across, is_told):
    course, rms = edge(slip=0.02, noise=0.0, across=np.array(across)).turn()
    assert course(np.array([1.0, 4.0])).shape == (2, 2)
    assert bool(rms.any()) == is_told
    assert bool(course(np.array([1.0, 4.0])).any()) == is_told


def stepped(drop, frames=180, alternating=1e-3):
    """An edge whose points tremble by 1 mm from frame to frame, 3.12 mm of noise, and drop on the right after 3 s."""
    seen = edge(slip=drop, noise=0.0)
    sign = np.tile([1.0, -1.0], 90)
    seen.points[..., 2] += alternating * sign[:, None]
    seen.points[frames:] = np.nan
    return seen


@pytest.mark.parametrize(("errors", "is_told"), [(7.8, False), (8.2, True)])
def test_a_step_of_eight_standard_errors_is_a_slip(errors, is_told):
    """The outer two points drop by 0.75 and 1 of it, 0.875; of 91 and 89 frames the error is s sqrt(180 / 91 / 89)."""
    noise = 1e-3 * 64 / 0.6745 / np.sqrt(924)
    found = stepped(errors * noise * np.sqrt(180 / 91 / 89) / 0.875).slip_at()
    assert found == pytest.approx(3.0 if is_told else 1.05, abs=1e-6 if is_told else 0.1)


@pytest.mark.parametrize(("frames", "is_told"), [(111, True), (95, False)])
def test_a_step_is_not_reported_at_the_end_of_a_take(frames, is_told):
    """In the last five frames no step is reported."""
    assert (stepped(0.05, frames).slip_at() == pytest.approx(3.0, abs=1e-6)) == is_told


def test_of_few_frames_no_step_is_reported():
    """Ten before and nine after it."""
    for last, is_told in ((101, True), (100, False)):
        few = stepped(0.05, last)
        few.points[:81] = np.nan
        assert (few.slip_at() == pytest.approx(3.0, abs=1e-6)) == is_told


def test_the_left_end_may_slip_as_well():
    mirrored = edge(slip=0.01, noise=1e-4)
    turned = HeldEdge(mirrored.time, mirrored.points[:, ::-1] * [1.0, 1.0, 1.0], -ACROSS[::-1], mirrored.held)
    turned.points[..., 2] = mirrored.points[..., 2]  # the same heights at the mirrored places
    assert turned.slip_at() == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("at", [0.4, 1.7])
def test_a_slip_follows_the_hardest_jerk_by_three_hundredths_of_a_second(at):
    """A pulse of 20 mm and a tenth of a second is hardest in its middle."""

    def held(instants):
        moved = 0.02 * np.exp(-(((instants - at) / 0.1) ** 2))
        ends = np.zeros((len(instants), 6))
        ends[:, 0], ends[:, 3] = -0.2, 0.2
        ends[:, [1, 4]] = moved[:, None]
        return ends

    time = np.arange(0, 4, FRAME)
    found = HeldEdge(time, np.zeros((len(time), 0, 3)), np.zeros(0), held).slip_at()
    assert found == pytest.approx(at + 0.03, abs=0.004)


def test_yaw_and_roll_are_separated_on_a_bar_that_hangs_askew():
    """A bar that rises by 0.1 rad in the yz plane: yaw is about the vertical, roll against the bar's own slope."""
    time = np.arange(0, 6, FRAME)
    bar = 0.2 * np.array([0.0, np.cos(0.1), np.sin(0.1)])
    level = np.array([-1.0, 0.0, 0.0])  # z x bar
    yaw = 0.03 * np.sin(2 * np.pi * 0.5 * time)
    roll = 0.02 * np.cos(2 * np.pi * 0.5 * time)
    points = ACROSS[:, None] * bar / 0.2 + yaw[:, None, None] * ACROSS[:, None] * level
    points[..., 2] += roll[:, None] * ACROSS
    ends = np.concatenate([1.0 - bar, 1.0 + bar])
    turn, rms = HeldEdge(time, points + 1.0, ACROSS, lambda instants: np.tile(ends, (len(instants), 1))).turn()
    assert rms == pytest.approx([0.03 * np.sqrt(0.5), 0.02 * np.sqrt(0.5)], rel=0.006)  # 1 - cos 0.1
    assert turn(time)[20:-20] == pytest.approx(np.stack([yaw, roll], 1)[20:-20], abs=3e-4)
    assert turn(np.array([-1.0, 9.0])) == pytest.approx(turn(np.array([0.0, time[-1]])))  # held before and after


@pytest.mark.parametrize(("seen", "is_told"), [((0, 2), False), ((0, 3), True)])
def test_points_that_have_a_quarter_of_the_edges_spread_give_its_rotation(seen, is_told):
    """0.2 m apart two of five have 0.02 of 0.1 m^2, 0.3 m apart 0.045."""
    some = edge(noise=1e-3)
    hidden = [k for k in range(5) if k not in seen]
    some.points[:, hidden] = np.nan
    assert bool(some.turn()[1].any()) == is_told


@pytest.mark.parametrize(("frames", "is_told"), [(19, False), (20, True)])
def test_twenty_frames_give_a_rotation(frames, is_told):
    some = edge(noise=1e-3)
    some.points[frames:] = np.nan
    assert bool(some.turn()[1].any()) == is_told


def test_a_position_is_on_the_line_between_two_ends_within_a_millionth():
    ends = np.array([[1.0, 0.0], [3.0, 0.0]])
    places = np.array([[1.5, 0.0], [1.0, 0.0], [3.0, 0.0], [3.1, 0.0], [0.9, 0.0], [2.0, 1e-3], [2.0, 1e-6]])
    share, is_on = place_along(places, ends)
    assert share == pytest.approx([0.25, 0.0, 1.0, 1.05, -0.05, 0.5, 0.5])
    assert is_on.tolist() == [True, True, True, False, False, False, True]


def test_positions_along_the_edge_may_count_from_anywhere():
    seen = edge(slip=0.006, at=4.2, noise=0.001)
    aside = HeldEdge(seen.time, seen.points, ACROSS + 0.3, seen.held)
    assert aside.slip_at() == seen.slip_at() == pytest.approx(4.2, abs=0.1)
    (one, one_rms), (other, other_rms) = seen.turn(), aside.turn()
    assert other(seen.time) == pytest.approx(one(seen.time), abs=1e-9)
    assert other_rms == pytest.approx(one_rms)


def test_an_edge_that_is_lifted_with_its_hanger_does_not_slip():
    """By 0.1 m, from 3 to 3.5 s, as gently as a hand does; the hardest jerk is still that at 1 s."""
    still = edge(noise=0.001)
    lift = 0.1 * np.interp(still.time, [3.0, 3.5], [0.0, 1.0])
    points = still.points + lift[:, None, None] * [0.0, 0.0, 1.0]

    def held(instants):
        raised = still.held(instants)
        raised[:, [2, 5]] += np.interp(instants, [3.0, 3.5], [0.0, 0.1])[:, None]
        return raised

    assert HeldEdge(still.time, points, ACROSS, held).slip_at() == pytest.approx(still.slip_at(), abs=0.1)


@pytest.mark.parametrize(("errors", "is_told"), [(7.8, False), (8.2, True)])
def test_a_step_of_the_left_end_is_measured_on_the_two_points_there(errors, is_told):
    """The mirror image of a step on the right: a third point, or all five, would show less of it."""
    right = stepped(errors * 1e-3 * 64 / 0.6745 / np.sqrt(924) * np.sqrt(180 / 91 / 89) / 0.875)
    left = HeldEdge(right.time, right.points.copy(), ACROSS, right.held)
    left.points[..., 2] = right.points[:, ::-1, 2]
    assert left.slip_at() == pytest.approx(3.0 if is_told else 1.05, abs=1e-6 if is_told else 0.1)
