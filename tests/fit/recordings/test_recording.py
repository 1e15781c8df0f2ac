"""Preparation of takes: frames of reference, deviations, implausible paths, and scored points."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.errors import DriveError, FitError
from fit.recordings.recording import (
    Windows,
    check_path,
    prepare,
    prepare_together,
    world_from_sensor,
)
from tests.fit.scenes import hung, sheet, swing, take_of

FRAMES = 60
TIME = np.arange(FRAMES) / 30


def a_take(*, grid=5, sd=1e-3, name="a", points=None, garment=None):
    garment = garment or sheet(grid=grid)
    path = swing(TIME, amplitude=0.05, hz=0.7)
    there = hung(garment, TIME) + path[:, None] if points is None else points
    return take_of(garment, TIME, path, there, sd=sd, name=name)


def test_the_world_stands_with_z_against_gravity_and_x_as_near_to_the_sensors_as_can_be():
    """Of a sensor with y down: x stays, y of the world is the sensor's z. Rolled by 30 degrees, x is level again."""
    assert world_from_sensor((0.0, 9.8, 0.0)) == pytest.approx(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    half, root = 0.5, np.sqrt(0.75)
    rolled = world_from_sensor((half, root, 0.0))
    assert rolled[0] == pytest.approx([root, -half, 0.0])
    assert rolled[2] == pytest.approx([-half, -root, 0.0])
    assert rolled @ rolled.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rolled) == pytest.approx(1.0)
    aside = world_from_sensor((-1.0, 0.0, 0.0))  # gravity along the sensor's x: y takes its place
    assert aside[0] == pytest.approx([0.0, 1.0, 0.0])
    assert aside[2] == pytest.approx([1.0, 0.0, 0.0])


def test_a_recording_is_in_the_world_frame_from_the_first_sight_of_the_hanger():
    take = a_take()
    held_valid = np.ones((FRAMES, 2), bool)
    held_valid[:5, 0] = held_valid[-3:, 1] = held_valid[20, 0] = False
    seen = prepare(dataclasses.replace(take, held_valid=held_valid, time=TIME + 7.0))
    assert (len(seen.time), seen.time[0], seen.duration) == (52, 0.0, pytest.approx(51 / 30))
    rotation = world_from_sensor(take.rig.gravity)
    assert seen.points == pytest.approx(take.points[5:57] @ rotation.T, nan_ok=True)
    assert np.isnan(seen.held_seen).any(1).nonzero()[0].tolist() == [15]
    assert seen.held_seen[0] == pytest.approx((take.held[5] @ rotation.T).ravel())
    before, after = seen.held(np.array([-1.0, 9.0]))
    assert before == pytest.approx(seen.held(seen.time[:1])[0])
    assert after == pytest.approx(seen.held(seen.time[-1:])[0])


def test_deviations_are_root_mean_squares_of_what_was_seen():
    """3, 4 and 0 mm an axis, of point 7 twice that in half of the frames; 9 m where it was not seen do not count."""
    take = a_take()
    sd = np.tile([0.003, 0.004, 0.0], (FRAMES, 25, 1))
    sd[::2, 7] *= 2
    sd[:10, 8] = 9.0
    valid = np.ones((FRAMES, 25), bool)
    valid[:10, 8] = valid[:, 9] = False
    held_sd = np.tile([0.001, 0.002, 0.002], (FRAMES, 2, 1))
    held_sd[::2] *= 3
    found = prepare(dataclasses.replace(take, points_sd=sd, points_valid=valid, held_sd=held_sd))
    usual = 0.005 / np.sqrt(3)
    assert found.point_sd[[6, 8]] == pytest.approx([usual, usual])
    assert found.point_sd[7] == pytest.approx(usual * np.sqrt((1 + 4) / 2))
    assert found.point_sd[9] == 0.0
    assert found.held_sd == pytest.approx(0.003 / np.sqrt(3) * np.sqrt((1 + 9) / 2))
    assert found.has_curve.tolist() == [k != 9 for k in range(25)]


def test_points_count_below_the_held_edge_and_where_they_move_freely():
    """A second free and half a second caught, by turns."""
    windows = Windows(free=1.0, caught=0.5)
    assert windows.is_free(np.array([0.0, 0.99, 1.0, 1.49, 1.5, 2.49, 2.5])).tolist() == [1, 1, 0, 0, 1, 1, 0]
    take = a_take()
    take.points_valid[3, 12] = False
    found = prepare(take)
    assert found.counted.sum() == FRAMES * 20 - 1
    assert not found.counted[3, 12]
    pulled = dataclasses.replace(found, windows=windows)
    assert pulled.counted.any(1).tolist() == [*[True] * 30, *[False] * 15, *[True] * 15]
    _, trust = pulled.targets(np.array([0.5, 1.2]))
    assert trust[:, 7].tolist() == [0.0, 1.0]


def test_a_target_is_trusted_for_a_quarter_of_a_second_around_a_sight():
    """Not seen from frame 10 to 39, 0.33 to 1.3 s; before the first and after the last sight as well."""
    take = a_take()
    take.points_valid[10:40, 12] = False
    take.points_valid[53:, 13] = False
    found = prepare(take)
    instants = np.array([0.3, 0.54, 0.56, 1.07, 1.09, 1.33])
    assert found.targets(instants)[1][:, 12].tolist() == [1, 1, 0, 0, 1, 1]
    assert found.targets(np.array([52 / 30 + 0.24, 52 / 30 + 0.26]))[1][:, 13].tolist() == [1, 0]
    assert found.targets(instants)[1][:, 11].tolist() == [1] * 6


def test_targets_are_positions_and_their_velocities():
    """A point that moves at 0.2 m/s."""
    garment = sheet(grid=5)
    moving = hung(garment, TIME) + 0.2 * TIME[:, None, None] * [0.0, 1.0, 0.0]
    wanted, _ = prepare(a_take(points=moving)).targets(np.array([1.0]))
    assert wanted[0, 12, 3:] == pytest.approx([0.0, 0.2, 0.0], abs=1e-3)
    assert wanted[0, 12, :3] == pytest.approx(moving[30, 12], abs=1e-4)


def level_path(places):
    """Held ends 0.4 m apart whose middle is at these positions along x [m], (n,)."""
    ends = np.zeros((len(places), 6))
    ends[:, 0], ends[:, 3] = places - 0.2, places + 0.2
    return ends


@pytest.mark.parametrize(("frames", "words"), [(20, None), (19, "seen in 19 frames only")])
def test_a_path_has_twenty_frames(frames, words):
    times = np.arange(frames) / 30
    if words is None:
        check_path("a", times, level_path(0 * times))
    else:
        with pytest.raises(DriveError, match=words):
            check_path("a", times, level_path(0 * times))


@pytest.mark.parametrize(("speed", "is_possible"), [(7.9, True), (8.1, False)])
def test_a_hanger_moves_at_eight_metres_a_second_at_most(speed, is_possible):
    times = np.arange(60) / 30
    path = level_path(speed * times)
    if is_possible:
        check_path("a", times, path)
    else:
        with pytest.raises(DriveError, match=r"jumps at \d\.\d\d s \(8 m/s\)"):
            check_path("a", times, path)


@pytest.mark.parametrize(("pull", "is_possible"), [(149.0, True), (151.0, False)])
@pytest.mark.parametrize("end", [0, 1])
def test_an_end_is_accelerated_by_fifteen_times_gravity_at_most(pull, is_possible, end):
    """One frame in which the speed changes by the acceleration times a thirtieth of a second."""
    times = np.arange(60) / 30
    path = level_path(0 * times)
    path[:, 3 * end + 1] = np.maximum(times - 1.0, 0.0) * pull / 30
    if is_possible:
        check_path("a", times, path)
    else:
        with pytest.raises(DriveError, match=r"jumps at 1\.00 s \(151 m/s2\)"):
            check_path("a", times, path)


@pytest.mark.parametrize(("jump", "is_possible"), [(0.11, True), (0.12, False)])
def test_noise_that_is_everywhere_in_a_path_is_no_jump(jump, is_possible):
    """Trembling by 4 mm is 16 mm 30^2 = 14.4 m/s^2 everywhere: ten times that beside 150 are 208, or 0.115 m."""
    times = np.arange(60) / 30
    path = level_path(0.004 * np.tile([1.0, -1.0], 30))
    path[30, [1, 4]] += jump
    if is_possible:
        check_path("a", times, path)
    else:
        with pytest.raises(DriveError, match=r"jumps at 1\.00 s \(216 m/s2\)"):
            check_path("a", times, path)


def test_turns_are_measured_over_the_takes_that_show_one():
    """0.02 rad rms of yaw in one take, none in another that shows no edge: 0.02, and 1 for a roll of nothing."""
    garment = sheet(grid=5)
    rolled = hung(garment, TIME) + swing(TIME, amplitude=0.05, hz=0.7)[:, None]
    wave = 0.02 * np.sqrt(2) * np.sin(2 * np.pi * 0.5 * TIME)
    rolled[..., 2] += wave[:, None] * hung(garment, TIME)[..., 0]
    turning, still = a_take(points=rolled), a_take(grid=None)
    (one,), (other,) = prepare_together([turning], [still])
    assert one.turn_rms == pytest.approx(other.turn_rms)
    assert one.turn_rms[1] == pytest.approx(prepare(turning).turn_rms[1], rel=0.05)
    alone = prepare_together([still])[0][0]
    assert alone.turn_rms.tolist() == [1.0, 1.0]


def test_what_cannot_be_simulated_is_refused():
    short = a_take()
    arrays = ("time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers")
    few = {name: getattr(short, name)[:19] for name in arrays}
    with pytest.raises(FitError, match="the take has 19 frames, at least 20"):
        prepare(dataclasses.replace(short, **few))
    hidden = a_take()
    hidden.points_valid[:, 5:] = False
    hidden.points_valid[:19, 12] = True
    with pytest.raises(FitError, match="hardly any point of the garment below the held edge"):
        prepare(hidden)
    hidden.points_valid[19, 12] = True
    assert prepare(hidden).counted.sum() == 20


def test_a_point_is_held_within_a_fiftieth_of_the_garments_height_of_the_edge():
    """0.45 m high: 9 mm."""
    garment = sheet(grid=5)
    for down, is_judged in ((0.0089, False), (0.0091, True)):
        points = list(garment.points)
        points[2] = msgspec.structs.replace(points[2], at_m=(points[2].at_m[0], points[2].at_m[1] - down))
        lower = msgspec.structs.replace(garment, points=tuple(points))
        assert prepare(a_take(garment=lower)).judged[2] == is_judged


def test_a_recording_with_other_points_has_their_positions_and_velocities_and_no_windows():
    seen = dataclasses.replace(prepare(a_take()), windows=Windows(free=1.0, caught=0.5))
    lifted = seen.points + [0.0, 0.0, 0.5] + 0.2 * seen.time[:, None, None] * [1.0, 0.0, 0.0]
    other = seen.with_points(lifted)
    assert other.points is lifted
    assert (other.windows, other.held, other.take_id) == (None, seen.held, seen.take_id)
    instants = np.array([0.4, 1.1])
    (before, _), (after, _) = seen.targets(instants), other.targets(instants)
    moved = np.stack([0.2 * instants, 0 * instants, 0 * instants + 0.5, *np.tile([[0.2], [0.0], [0.0]], 2)], 1)
    assert after - before == pytest.approx(np.repeat(moved[:, None], before.shape[1], 1), abs=1e-6)
