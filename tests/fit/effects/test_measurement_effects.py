"""Every measurement effect against hand calculation."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fit.cloth.effect import Effect, amplitudes_of
from fit.effects import LIBRARY
from fit.effects.sliding_points import slides
from fit.effects.tracker_smoothing import opposite_neighbours
from fit.recordings.recording import prepare
from tests.fit.effects.test_effects import FRAME, driven, effect, observed
from tests.fit.recordings.silhouettes import silhouette_sheet, swung, uneven
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of


def test_time_offset_and_drift_read_the_path_earlier():
    """20 ms late; or, at 3 s, 15 ms late with a clock that loses 0.5 %."""

    def ramp(t):
        return np.stack([0 * t, 0.1 * t, 0 * t], 1)

    _, before, late = driven("time_offset", 0.02, ramp)
    assert (before - late)[50, 0, 1] == pytest.approx(0.1 * 0.02, rel=1e-3)
    instants, before, drifting = driven("clock_drift", 0.005, ramp)
    assert (before - drifting)[75, 0, 1] == pytest.approx(0.1 * 0.005 * instants[75], rel=1e-2)


def test_cloth_on_a_drifting_clock_swings_slower(monkeypatch):
    """On a clock that is 2 % slow, points are where they were 2 % earlier, to 0.1 mm; the path alone misses by 11."""
    garment = sheet(width=0.3, height=0.35, mass=0.02, grid=5)
    time = np.arange(0, 4, FRAME / 2)
    row = material(garment, velocity_damping=0.5)

    def points(drift):
        amplitudes = amplitudes_of(LIBRARY, clock_drift=drift)[None]
        return simulate_take(garment, time, swing(time), row, effects=LIBRARY, amplitudes=amplitudes).points

    true = points(0.0)
    earlier = CubicSpline(time, true)(0.98 * time)
    assert np.abs(points(0.02) - earlier).max() < 1e-4
    monkeypatch.setattr(type(effect("clock_drift")), "material", Effect.material)
    assert np.sqrt(((points(0.02) - earlier) ** 2).mean()) == pytest.approx(0.011, rel=0.1)


def test_depth_scale_lengthens_every_distance_from_the_sensor():
    points = np.tile([0.1, 1.5, -0.3], (40, 25, 1))
    assert observed("depth_scale", (0.01, 0.0), points)[0, 0] == pytest.approx([0.101, 1.515, -0.303])
    _, before, after = driven("depth_scale", (0.0, 0.02))
    assert after == pytest.approx(before / 1.02)


def test_depths_are_scaled_about_the_camera_wherever_the_frame_has_its_origin():
    """From a camera 2 m in front, a point 0.3 m below it and on its axis's plane moves 1 % of 2 m away."""
    garment, time = sheet(grid=5), np.arange(0, 2, FRAME)
    take = take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time))
    rig = msgspec.structs.replace(take.rig, format="hangtime-rig/2", camera_at_m=(0.0, -2.0, 0.0))
    recording = prepare(dataclasses.replace(take, rig=rig))
    points = np.tile([0.0, 0.0, -0.3], (len(time), 25, 1))
    seen = effect("depth_scale").observe(points, recording, np.array([0.01, 0.0]))
    assert seen[0, 0] == pytest.approx([0.0, 0.02, -0.303])
    targets = np.concatenate([seen, 0 * seen], 2)
    assert effect("depth_scale").unobserved(targets, recording, np.array([0.01, 0.0]))[..., :3] == pytest.approx(points)
    after = effect("depth_scale").drive(recording.held, recording, np.array([0.0, 0.02]))(time[:1]).reshape(2, 3)
    assert after[:, 1] == pytest.approx(-2.0 + 2.0 / 1.02)


def test_a_lagging_tracker_trails_by_its_time_constant_times_the_speed():
    """1 m/s behind 30 ms: 30 mm, after a few time constants."""
    ramp = np.zeros((60, 25, 3))
    ramp[:, :, 0] = (np.arange(60) * FRAME)[:, None]
    lagging = observed("filter_lag", 0.03, ramp)
    # The simulated cloth is late already: ahead by 30 mm, and behind by as much once the start is forgotten.
    assert (ramp - lagging)[20:, 0, 0] == pytest.approx(0.0, abs=1e-6)
    assert (lagging - ramp)[0, 0, 0] == pytest.approx(0.03)


def test_stamps_of_publishing_show_points_as_they_were_by_a_share_of_the_interval_before():
    """At 1 m/s, a frame that comes 0.05 s later than usual is 0.9 of it behind; never by more than an interval."""
    garment, time = sheet(grid=5), np.arange(0, 4, FRAME)
    time[40:] += 0.02
    time[60:] += 0.5
    ramp = np.zeros((len(time), 25, 3))
    ramp[:, :, 0] = time[:, None]
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    behind = (ramp - effect("frame_timing").observe(ramp, recording, np.array([0.9])))[:, 0, 0]
    assert behind[40] == pytest.approx(0.9 * 0.02, abs=1e-6)
    assert behind[60] == pytest.approx(FRAME, abs=1e-6)
    assert np.abs(np.delete(behind, [40, 60])).max() < 1e-9
    even = np.zeros((40, 25, 3)) + np.arange(40)[:, None, None]
    assert observed("frame_timing", 0.9, even) == pytest.approx(even, abs=1e-9)


def test_a_grid_slides_as_its_length_shows():
    """Laid over 0.82 to 0.98 of the cloth: with all of it the simulated points are where the grid has them."""
    time = uneven()
    share = 0.9 + 0.08 * np.sin(2 * np.pi * 0.9 * time)
    slid = prepare(swung(silhouette_sheet("material"), time, time, seen_length=share))
    stays = prepare(swung(silhouette_sheet("material"), time, time))
    before = np.abs(stays.points - slid.points).max()
    seen = effect("sliding_points").observe(stays.points, slid, np.array([1.0]))
    assert before > 0.04
    assert np.abs(seen - slid.points).max() < 0.004  # the path of the held edge is a spline
    assert (effect("sliding_points").observe(stays.points, stays, np.array([1.0])) == stays.points).all()
    placed = prepare(swung(silhouette_sheet(), time, time, seen_length=share))
    assert (effect("sliding_points").observe(placed.points, placed, np.array([1.0])) is placed.points) is True


def test_an_outline_is_eroded_on_one_side_of_the_swing_and_longer_on_the_other():
    """A flat sheet that leans by 30 degrees loses 0.06 m x 1/2 at its border, half of it in the middle."""
    time = np.arange(40) * FRAME
    flat = hung(sheet(grid=5), time)
    for lean in (30.0, -30.0, 0.0):
        sine, cosine = np.sin(np.radians(lean)), np.cos(np.radians(lean))
        leant = np.stack([flat[..., 0], -sine * flat[..., 2], cosine * flat[..., 2]], 2)
        lost = np.linalg.norm(leant[0], axis=1) - np.linalg.norm(observed("eroded_outline", 0.06, leant)[0], axis=1)
        assert lost[22] == pytest.approx(0.06 * sine, abs=1e-6)
        assert lost[12] == pytest.approx(0.03 * sine, abs=1e-6)
        assert lost[:5] == pytest.approx(0.0)


def test_no_outline_is_eroded_where_the_points_are_stated_as_material():
    time = uneven()
    for stated, stays in (("material", True), (None, False)):
        take = prepare(swung(silhouette_sheet(stated), time, time))
        assert (effect("eroded_outline").observe(take.points, take, np.array([0.06])) is take.points) == stays


def test_a_lag_has_the_cloth_follow_a_path_that_is_as_late():
    late = [driven(name, 0.03, lambda time: swing(time)) for name in ("filter_lag", "time_offset")]
    assert late[0][2] == pytest.approx(late[1][2])
    assert np.abs(late[0][2] - late[0][1]).max() > 0.005


def test_behind_a_lag_swings_are_late_and_smaller():
    """At 2 Hz and 30 ms: a gain of 1 / sqrt(1 + (w tau)^2) = 0.936 and w tau - atan(w tau) ahead of the late cloth."""
    time, turns, tau = np.arange(0, 4, FRAME), 2 * np.pi * 2.0, 0.03
    late = np.sin(turns * (time - tau))[:, None, None] * np.ones((1, 25, 3))
    lagging = observed("filter_lag", tau, late)[:, 0, 0]
    gain, phase = 1 / np.hypot(1, turns * tau), np.arctan(turns * tau)
    assert lagging[20:-3] == pytest.approx(gain * np.sin(turns * time - phase)[20:-3], abs=0.02)


def test_an_eroded_corner_is_seen_nearer_to_the_middle():
    flat = hung(sheet(grid=5), np.zeros(40))
    moved = observed("corner_erosion", (0.01, 0.0), flat) - flat
    assert np.linalg.norm(moved[0, 24]) == pytest.approx(0.01)  # bottom right
    assert moved[0, 12] == pytest.approx([0, 0, 0])
    assert moved[0, 0] == pytest.approx([0, 0, 0])  # held corners keep their place
    border = observed("corner_erosion", (0.0, 0.01), flat) - flat
    assert abs(border[0, 14, 0]) == pytest.approx(0.01)  # middle of the right border, half a width from the middle


def test_corners_at_the_shoulders_are_held_and_not_eroded():
    """Of a sheet of 0.4 m whose shoulders slope by 2 cm no corner above the middle is free."""
    outline = ((-0.1, 0.0), (0.1, 0.0), (0.2, -0.02), (0.2, -0.4), (-0.2, -0.4), (-0.2, -0.02))
    places = [(-0.2, -0.02), (0.2, -0.02), (-0.2, -0.4), (0.2, -0.4)]
    garment = SimpleNamespace(outline_m=outline, points=[SimpleNamespace(at_m=at) for at in places])
    points = np.array([[[x, 0.0, y] for x, y in places]])
    moved = effect("corner_erosion").observe(points, SimpleNamespace(garment=garment), np.array([0.01, 0.0])) - points
    assert np.linalg.norm(moved, axis=2)[0] == pytest.approx([0.0, 0.0, 0.01, 0.01])


def test_targets_have_the_smoothing_taken_back_to_first_order():
    """Of a bump of 10 mm a share of 0.3 was smoothed away: 3 mm more, and its neighbours' halves of it back."""
    places = [(x, y) for y in (0.0, 0.1, 0.2) for x in (0.0, 0.1, 0.2)]
    garment = SimpleNamespace(points=[SimpleNamespace(at_m=at) for at in places])
    recording = SimpleNamespace(garment=garment, has_curve=np.ones(9, bool))
    targets = np.zeros((1, 9, 6))
    targets[0, 4, 1] = 0.01
    found = effect("tracker_smoothing").unobserved(targets, recording, np.array([0.3]))
    assert found[0, 4, 1] == pytest.approx(0.013)


def test_a_grid_of_one_length_does_not_slide_however_long_it_is():
    """A tenth too short in every frame, or by turns a tenth and not at all."""
    grid = SimpleNamespace(down=np.array([0.0, 0.2, 0.4]))
    time = np.arange(6) / 30
    recording = SimpleNamespace(time=time, grid_length=np.full(6, 0.36))
    assert slides(recording, grid) is None
    recording.grid_length = np.array([0.36, 0.4] * 3)
    assert slides(recording, grid) == pytest.approx([-0.1, 0.0] * 3)


def test_smoothing_leaves_flat_cloth_and_lowers_a_bump():
    flat = hung(sheet(grid=5), np.zeros(40))
    assert observed("tracker_smoothing", 0.4, flat) == pytest.approx(flat)
    bumpy = flat.copy()
    bumpy[:, 12, 1] += 0.01
    assert observed("tracker_smoothing", 0.4, bumpy)[0, 12, 1] == pytest.approx(0.006)


def test_a_point_that_nobody_saw_is_not_smoothed_back_into_its_neighbours():
    """Its target is the origin, 1.5 m away: the pull on its neighbours takes no part of it."""
    time = np.arange(0, 2, FRAME)
    garment = sheet(grid=5)
    points = hung(garment, time) + np.array([0.0, 1.5, 0.0])
    blind = points.copy()
    blind[:, 12] = np.nan
    aims = []
    for seen in (points, blind):
        recording = prepare(take_of(garment, time, np.tile([0.0, 1.5, 0.0], (len(time), 1)), seen))
        targets, _ = recording.targets(time)
        aims.append(effect("tracker_smoothing").unobserved(targets, recording, np.array([0.4])))
    others = np.arange(25) != 12
    assert aims[1][:, others] == pytest.approx(aims[0][:, others], abs=1e-6)  # flat cloth has no wrinkles


@pytest.mark.parametrize("pitch", [(0.075, 0.075), (0.075, 0.0763), (0.04, 0.053), (0.075, 0.05)])
def test_inner_points_of_any_grid_have_four_neighbours(pitch):
    """Nine columns and five rows: columns' and rows' folds shrink alike, whatever the pitches."""
    across, down = np.meshgrid(np.arange(9), np.arange(5))
    places = np.stack([across.ravel(), -down.ravel()], 1) * np.array(pitch)
    mixing = opposite_neighbours(places)
    inner = np.flatnonzero((across % 8 > 0).ravel() & (down % 4 > 0).ravel())
    assert (np.count_nonzero(mixing[inner], axis=1) == 4).all()
    assert mixing[inner].max() == pytest.approx(0.25)
    border = np.flatnonzero((across % 8 > 0).ravel() & (down == 0).ravel())
    assert (np.count_nonzero(mixing[border], axis=1) == 2).all()


def test_corners_have_no_opposite_neighbours():
    places = np.array([(x, y) for y in (0, 1, 2) for x in (0, 1, 2)], float)
    mixing = opposite_neighbours(places)
    assert mixing[0, 0] == 1.0
    assert mixing[4] == pytest.approx([0, 0.25, 0, 0.25, 0, 0.25, 0, 0.25, 0])


@pytest.mark.parametrize(("across", "neighbours"), [(1.8, 4), (2.2, 2)])
def test_a_pair_across_is_a_neighbour_up_to_twice_as_far_as_the_nearest_pair(across, neighbours):
    places = np.array([(across * x, y) for y in (0, 1, 2) for x in (0, 1, 2)])
    assert np.count_nonzero(opposite_neighbours(places)[4]) == neighbours


def test_a_pair_within_45_degrees_of_the_nearest_pair_is_no_pair_across_it():
    """Pairs at 40 and at 50 degrees to the nearest one, half as far again."""
    for degrees, neighbours in ((40.0, 2), (50.0, 4)):
        leaning = 1.5 * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        places = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), leaning, -leaning])
        assert np.count_nonzero(opposite_neighbours(places)[0]) == neighbours


def test_smoothing_beyond_all_of_it_is_taken_back_as_all_of_it():
    places = [(x, y) for y in (0.0, 0.1, 0.2) for x in (0.0, 0.1, 0.2)]
    recording = SimpleNamespace(
        garment=SimpleNamespace(points=[SimpleNamespace(at_m=at) for at in places]), has_curve=np.ones(9, bool)
    )
    targets = np.zeros((1, 9, 6))
    targets[0, 4, 1] = 0.01
    assert effect("tracker_smoothing").unobserved(targets, recording, np.array([1.4]))[0, 4, 1] == pytest.approx(0.02)
    assert targets[0, 4, 1] == 0.01  # of the caller


def test_points_of_a_lag_go_straight_on_after_the_last_frame():
    """At 1 m/s and 50 ms, one and a half frames: the last points are 50 mm ahead, of the straight line as well."""
    ramp = np.zeros((60, 25, 3))
    ramp[:, :, 0] = (np.arange(60) * FRAME)[:, None]
    lagging = observed("filter_lag", 0.05, ramp)
    assert lagging[-1, :, 0] == pytest.approx(ramp[-1, :, 0], abs=1e-6)
    unseen = ramp.copy()
    unseen[5, 3] = np.nan
    assert observed("filter_lag", 0.05, unseen) is unseen


def test_stamps_of_publishing_move_no_point_by_more_than_an_interval_either_way():
    """At 1 m/s: after a pause of 0.5 s with a share of -0.4 the point is one interval ahead, not 0.2 s."""
    garment, time = sheet(grid=5), np.arange(0, 4, FRAME)
    time[60:] += 0.5
    ramp = np.zeros((len(time), 25, 3))
    ramp[:, :, 0] = time[:, None]
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    ahead = (effect("frame_timing").observe(ramp, recording, np.array([-0.4])) - ramp)[:, 0, 0]
    assert ahead[60] == pytest.approx(FRAME, abs=1e-6)
    unseen = np.where(np.arange(25)[:, None] == 3, np.nan, ramp)
    assert effect("frame_timing").observe(unseen, recording, np.array([0.4])) is unseen


def test_a_stamp_that_is_early_shows_nothing_that_comes_after_the_last_frame():
    """A pause of 0.5 s before the last frame and a share of -0.4 point 33 ms beyond it."""
    garment, time = sheet(grid=5), np.arange(0, 4, FRAME)
    time[-1] += 0.5
    ramp = np.zeros((len(time), 25, 3))
    ramp[:, :, 0] = time[:, None]
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    seen = effect("frame_timing").observe(ramp, recording, np.array([-0.4]))
    assert seen[-1] == pytest.approx(ramp[-1], abs=1e-9)


def test_a_grid_slides_as_one_that_was_seen_twice_at_least_and_changed_by_a_hundredth():
    """Lengths between are interpolated; a change of 0.8 % is none, one of 1.2 % is."""
    grid = SimpleNamespace(down=np.array([0.0, 0.2, 0.4]))
    recording = SimpleNamespace(time=np.arange(3.0), grid_length=np.array([0.36, np.nan, 0.44]))
    assert slides(recording, grid) == pytest.approx([-0.1, 0.0, 0.1])
    recording.grid_length = np.array([np.nan, 0.3, np.nan])
    assert slides(recording, grid) is None
    for change, is_still in ((0.008, True), (0.012, False)):
        recording.grid_length = 0.4 * (1 + np.array([change, -change, change]))
        assert (slides(recording, grid) is None) == is_still


def test_a_border_is_eroded_in_half_widths_and_a_corner_is_seen_within_a_tenth_of_a_width_of_it():
    """Of 0.4 x 0.8 m: points 45 mm from the corner sit at it, points 51 mm from it do not; 12 % are 48 mm."""
    outline = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.8), (-0.2, -0.8))
    places = [(0.2, -0.755), (0.2, -0.749), (0.0, -0.4), (-0.2, -0.27)]
    recording = SimpleNamespace(
        garment=SimpleNamespace(outline_m=outline, points=[SimpleNamespace(at_m=at) for at in places])
    )
    points = np.array([[[x, 0.0, y] for x, y in places]])
    border = effect("corner_erosion").observe(points, recording, np.array([0.0, 0.01])) - points
    assert border == pytest.approx(0.01 * (points.mean(1, keepdims=True) - points) / 0.2)
    corner = effect("corner_erosion").observe(points, recording, np.array([0.01, 0.0])) - points
    assert np.linalg.norm(corner, axis=2)[0] == pytest.approx([0.01, 0.0, 0.0, 0.0])


def test_a_scaled_depth_of_points_and_of_the_scene_multiply():
    points = np.tile([0.1, 1.5, -0.3], (40, 25, 1))
    seen = observed("depth_scale", (0.1, 0.2), points)
    assert seen[0, 0] == pytest.approx(1.1 * 1.2 * np.array([0.1, 1.5, -0.3]))
    targets = np.concatenate([seen, seen], 2)
    back = effect("depth_scale").unobserved(targets, SimpleNamespace(viewpoint=np.zeros(3)), np.array([0.1, 0.2]))
    assert back == pytest.approx(np.concatenate([points, points], 2))
