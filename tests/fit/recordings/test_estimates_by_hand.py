"""Noise, robust means, delays and rest of recordings, each against a computation of its own."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from fit.recordings import filtered_copies, point_kind
from fit.recordings import recording as recordings
from fit.recordings.camera import FEWEST_RESTING_FRAMES, STILL_SPEED, Camera, Seen, edge_shown, examined, is_still
from fit.recordings.frame_offsets import FrameOffsets, find_frame_offsets
from fit.recordings.grids import grid_of
from fit.recordings.noise import held_noise
from fit.recordings.outline import find_outline, lean_of
from fit.recordings.robust_line import robust_line
from fit.recordings.timing import LEAST_TRAVEL, _Scan, find_timing
from formats.take import FrameState
from tests.fit.recordings.silhouettes import silhouette_sheet
from tests.fit.recordings.test_timing_by_hand import A_TIMING
from tests.fit.scenes import hung, sheet, swing, take_of

HALF = np.array([0.2, 0.0, 0.0])


def ends_of(across):
    """Held ends 0.4 m apart whose middle lies so far across the cloth [m], (n,) -> (n, 6)."""
    middle = np.stack([0 * across, across, 0 * across], 1)
    return np.concatenate([middle - HALF, middle + HALF], 1)


def test_the_noise_of_a_slow_path_is_the_deviation_of_its_ends_at_rest():
    """Eight frames at ten a second, too slow for differences: n - 1 of them are free."""
    seen = np.random.default_rng(0).normal(0, 0.001, (8, 6))
    recording = SimpleNamespace(
        time=np.arange(8) / 10, duration=0.7, held=lambda t: ends_of(0 * t), held_seen=seen, held_time=None, held_sd=9.0
    )
    assert held_noise(recording) == pytest.approx(np.sqrt(((seen - seen.mean(0)) ** 2).sum(0) / 7))


def test_a_robust_mean_weighs_by_hubers_weights_at_the_median_absolute_deviation():
    """The fixed point m = sum w x / sum w, w = min(1, 1.345 s / |x - m|), s = 1.4826 MAD, by plain iteration."""
    values = np.array([0.0, 1.0, -1.0, 0.5, -0.4, 0.2, 4.0, 7.0])
    mean = values.mean()
    for _ in range(500):
        left = values - mean
        weight = np.minimum(1.0, 1.345 * 1.4826 * np.median(np.abs(left - np.median(left))) / np.abs(left))
        mean = (weight * values).sum() / weight.sum()
    (found,), _ = robust_line(np.ones((8, 1)), values, np.arange(8))
    assert found == pytest.approx(mean, abs=1e-6)
    assert abs(mean - np.median(values)) > 0.1


def a_scan(amplitude=0.1, noise=0.0, seconds=6.0, seed=0):
    """A row 1 cm above a hanger that swings at 0.8 Hz, with noise on each axis [m]."""
    time = np.arange(0, seconds, 1 / 30)

    def path(instants):
        return ends_of(amplitude * np.sin(2 * np.pi * 0.8 * instants))

    row = path(time)[:, :3] + HALF + [0.0, 0.0, 0.01] + np.random.default_rng(seed).normal(0, noise, (len(time), 3))
    return _Scan(time, row, np.zeros(len(time)), path, np.ones(len(time), bool))


def test_half_an_interval_of_a_delay_is_students_of_one_less_than_the_half_swings():
    assert a_scan(seconds=3.0).spread == pytest.approx(student.ppf(0.95, 5))


def test_the_deviation_of_a_delay_is_a_jackknife_over_half_swings():
    """Each left out in turn, from least squares on the delay's slope and three constants."""
    scan = a_scan(noise=0.002)
    latency, _, sd = scan.mended(0.0, 0.0, is_uneven=False)
    across = scan.row[:, 1] - scan.path(scan.time - latency)[:, 1]
    speed = 2 * np.pi * 0.8 * 0.1 * np.cos(2 * np.pi * 0.8 * (scan.time - latency))
    block = np.floor(scan.time / 0.5 + 1e-9)
    design = np.stack([speed, np.ones(len(speed))], 1)  # the other axes know nothing of the delay
    without = [np.linalg.lstsq(design[block != b], across[block != b], rcond=None)[0][0] for b in np.unique(block)]
    count = len(without)
    assert sd[0] == pytest.approx(np.sqrt((count - 1) / count * ((without - np.mean(without)) ** 2).sum()), rel=0.02)
    assert abs(latency) < 5 * sd[0]


@pytest.mark.parametrize(("share", "is_known"), [(0.95, False), (1.05, True)])
def test_a_scale_is_estimated_from_two_centimetres_of_travel_on(share, is_known):
    """A swing of amplitude A has a deviation of A / sqrt(2) about its middle."""
    scan = a_scan(amplitude=share * LEAST_TRAVEL * np.sqrt(2), seconds=5.0)
    assert (scan.with_scale(A_TIMING).scale_interval is not None) == is_known


def test_the_share_that_a_path_explains_is_of_the_frames_that_count():
    """Half a metre off in one frame, which is left out: the path explains all the same."""
    scan = a_scan(noise=1e-4, seconds=8.0)
    row = scan.row.copy()
    row[100] += 0.5
    found = find_timing(scan.time, row, scan.path, is_per_frame=False)
    assert found.explained == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("share", "rests"), [(0.95, True), (1.05, False)])
def test_a_hanger_rests_below_three_centimetres_a_second_of_either_end(share, rests):
    time = np.arange(10) / 30
    assert is_still(time, lambda t: ends_of(share * STILL_SPEED * t)).tolist() == [rests] * 10


@pytest.mark.parametrize(("speed", "is_found"), [(0.028, False), (0.032, True)])
def test_a_frame_is_off_only_while_the_hanger_moves_faster_than_at_rest(speed, is_found):
    """At rest for two seconds, then at one speed for eight; the row is off by 20 mm in every other frame then."""
    time = np.arange(0, 10, 1 / 10)

    def path(instants):
        return ends_of(speed * np.maximum(instants - 2.0, 0.0))

    off = np.where(time > 2.05, 0.02 * (-1.0) ** np.arange(100), 0.0)
    row = path(time)[:, :3] + HALF + off[:, None] * [0.0, 1.0, 0.0]
    assert (find_frame_offsets(time, row, path) is not None) == is_found


@pytest.mark.parametrize(("resting", "down"), [(FEWEST_RESTING_FRAMES, 0.004), (FEWEST_RESTING_FRAMES - 1, 0.0)])
def test_a_held_edge_is_taken_from_five_frames_at_rest_and_no_fewer(resting, down):
    """A silhouette whose top row hangs 4 mm below the held edge."""
    garment = silhouette_sheet()
    places = np.array([p.at_m for p in garment.points])
    time = np.arange(20) / 30

    def path(instants):
        moved = np.maximum(instants - (resting - 0.8) / 30, 0.0)  # a speed is taken over 4 ms to either side
        middle = np.stack([0 * instants, 0.5 * moved, 0 * instants], 1)
        half = np.array([0.15, 0.0, 0.0])
        return np.concatenate([middle - half, middle + half], 1)

    middle = path(time).reshape(-1, 2, 3).mean(1)
    top = places[:, 1].max()
    hung = np.stack([places[:, 0] - places[:, 0].mean(), 0 * places[:, 0], places[:, 1] - top - 0.004], 1)
    edge = edge_shown(Seen(time, middle[:, None] + hung), path, garment)
    assert (edge.down, edge.out) == pytest.approx((down, 0.0), abs=1e-9)


@pytest.mark.parametrize(("excess", "is_found"), [(1.4, False), (1.75, True)])
def test_frames_are_off_where_the_noise_of_few_frames_at_rest_cannot_be_the_cause(excess, is_found):
    """Of 20 frames at rest the noise's square is known to sqrt(2 / (0.37 x 20)), and three of those are 1.56 of it."""
    time = np.arange(0, 10, 1 / 10)
    noise = 1.4826 * 0.002  # 2 mm to and fro are their own median absolute deviation

    def path(instants):
        return ends_of(0.2 * np.maximum(instants - 1.95, 0.0))

    size = np.where(time > 1.95, np.sqrt(1.0 + excess) * noise, 0.002)
    row = path(time)[:, :3] + HALF + (size * (-1.0) ** np.arange(100))[:, None] * [0.0, 1.0, 0.0]
    assert (find_frame_offsets(time, row, path) is not None) == is_found


def test_the_rows_error_holds_what_the_frames_offsets_leave():
    """A row that is 2 mm off to and fro, of which 3 mm of every frame's own are not known: a hypotenuse."""
    garment = silhouette_sheet()
    places = np.array([p.at_m for p in garment.points])
    time = np.arange(30) / 30
    points = np.stack([places[:, 0], 0 * places[:, 0], places[:, 1] - places[:, 1].max()], 1)
    points = points + (0.002 * (-1.0) ** np.arange(30))[:, None, None] * [0.0, 1.0, 0.0]
    half = np.array([0.15, 0.0, 0.0])
    middle = np.array([places[:, 0].mean(), 0.0, 0.0])

    def path(instants):
        return np.tile(np.concatenate([middle - half, middle + half]), (len(instants), 1))

    offsets = FrameOffsets(moved=np.zeros((30, 3)), rms=0.0, left=0.003)
    for camera, off in ((Camera(), 0.002), (Camera(offsets=offsets), np.hypot(0.002, 0.003))):
        assert examined(Seen(time, points, camera), path, garment).row_off == pytest.approx(off)


def leaning(angles, inwards=0.0):
    """A sheet that leans by angles [rad], (frames,), below a level held edge; its sides are seen further in [m]."""
    garment = silhouette_sheet()
    places = np.array([p.at_m for p in garment.points])
    below, x = places[:, 1] - places[:, 1].max(), places[:, 0] - places[:, 0].mean()
    x = x * (1 - 2 * inwards / np.ptp(x))
    points = np.stack(
        [np.tile(x, (len(angles), 1)), -below * np.sin(angles)[:, None], below * np.cos(angles)[:, None]], 2
    )
    half = np.array([0.15, 0.0, 0.0])
    return points, np.tile(np.concatenate([-half, half]), (len(angles), 1)), grid_of(garment)


@pytest.mark.parametrize(("columns", "is_known"), [(4, True), (3, False)])
def test_twelve_segments_down_the_cloth_show_how_it_leans(columns, is_known):
    """Four points below each other are three segments; they lean by sin 0.2."""
    points, ends, grid = leaning(np.array([0.2]))
    shown = np.full_like(points, np.nan)
    kept = grid.at[:4, :columns].ravel()
    if not is_known:
        kept = np.append(kept, grid.at[:3, 3])  # eleven
    shown[:, kept] = points[:, kept]
    assert lean_of(shown, ends, grid) == pytest.approx([np.sin(0.2) if is_known else np.nan], nan_ok=True)


def test_an_outline_loses_what_length_and_width_lack_about_the_usual_lean():
    """7 mm at the bottom at the median lean, 30 mm per unit of lean, and 5 mm at each of both sides."""
    time = np.arange(0, 6, 1 / 10)
    angles = 0.2 + 0.1 * np.sin(2 * np.pi * 0.7 * time)
    points, ends, grid = leaning(angles, inwards=0.005)
    leans = np.sin(angles)
    length = grid.down[-1] - 0.007 - 0.03 * (leans - np.median(leans))
    found = find_outline(time, points, ends, length, grid)
    assert (found.bottom, found.side, found.by_pose) == pytest.approx((0.007, 0.005, 0.03), abs=1e-9)
    # Sides that vary leave the length as certain as it is, and the width less.
    points[:, :, 0] *= 1 + 0.02 * np.random.default_rng(0).normal(size=(len(time), 1))
    found = find_outline(time, points, ends, length, grid)
    assert np.ptp(found.bottom_interval) < 1e-6
    assert np.ptp(found.side_interval) > 1e-4


@pytest.mark.parametrize(("sliding", "is_told"), [(1, False), (2, True)])
def test_points_slide_where_more_than_half_of_the_takes_show_it(monkeypatch, sliding, is_told):
    """Of three takes of points that the garment states to be material."""
    takes = [SimpleNamespace(take_id=f"take-{k}", is_imported=False) for k in range(3)]
    shown = {f"take-{k}": ("silhouette", 0.03) if k < sliding else ("material", 0.005) for k in range(3)}
    monkeypatch.setattr(point_kind, "kind_shown", lambda recording: shown[recording.take_id])
    garment = SimpleNamespace(point_kind="material", points_are="material")
    assert bool(point_kind.describe_contradiction(garment, takes)) == is_told


def test_the_rotation_of_takes_is_measured_by_that_of_the_takes_fitted_to(monkeypatch):
    """Slopes of 3 and 4, and of 30 in the take held out: sqrt(12.5) in all of them."""
    turns = iter([3.0, 4.0, 30.0])

    def prepared(take):
        size = next(turns)
        turned = lambda instants: np.tile([size, 2 * size], (len(instants), 1))  # noqa: E731
        return dataclasses.replace(recording, edge_turn=turned)

    garment = sheet(grid=5)
    time = np.arange(0, 2, 1 / 30)
    recording = recordings.prepare(take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None]))
    monkeypatch.setattr(recordings, "prepare", prepared)
    train, test = recordings.prepare_together([None, None], [None])
    for one in (*train, *test):
        assert one.turn_rms == pytest.approx(np.array([1.0, 2.0]) * np.sqrt(12.5))


def test_a_recording_begins_with_its_first_picture():
    """A hanger with a clock of its own is seen three frames before the points: 0.1 s."""
    garment, time = sheet(grid=5), np.arange(0, 2, 1 / 30)
    take = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None])
    alone = np.where(np.arange(len(time)) < 3, int(FrameState.HANGER_ALONE), 0).astype(take.state.dtype)
    found = recordings.prepare(dataclasses.replace(take, state=alone))
    assert (found.begin, found.time[0], len(found.time)) == pytest.approx((0.1, 0.0, len(time) - 3))


@pytest.mark.parametrize(("tap", "gain"), [(0.5, 0.25), (2.0, 1.0)])
def test_the_noise_left_between_two_takes_is_in_units_of_both_and_of_the_numbers_that_are_free(monkeypatch, tap, gain):
    """Of 184 steps of three points six tenths count, of which 17 taps and 6 of position and turn are fitted.

    One tap passes its square of the first take's noise, and no more than all. Of three points one has ten times the
    error.
    """
    positions = np.ones((200, 3, 3))
    positions[0] = 0.0
    take = filtered_copies._Smoothed(positions, np.ones((200, 3), bool))
    taps = np.zeros(17)
    taps[8] = tap
    size = np.tile([1.0, 1.0, 10.0], 184)[:, None] * np.full(3, 0.002)
    monkeypatch.setattr(filtered_copies, "_residual", lambda x, y: (size, taps))
    noises = np.full(3, 5e-6), np.full(3, 3e-6)
    numbers = 0.6 * 3 * 184
    expected = 3 * 0.002**2 / (gain * 5e-6 + 3e-6) * numbers / (numbers - 17 - 6)
    assert filtered_copies._left(take, take, 0, 10.0, noises) == pytest.approx(expected)


def test_a_recording_shows_its_name_frames_and_points():
    garment, time = sheet(), np.arange(0, 2, 1 / 10)
    take = take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time), name="still")
    shown = f"Recording('still', {len(time)} frames of {len(garment.points)} points)"
    assert repr(recordings.prepare(take)) == shown
    assert len(time) != len(garment.points)
