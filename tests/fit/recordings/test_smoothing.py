"""Smoothing splines against their transfer functions, and the remaining noise in the cloth's motion."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from benchmarks.hanger_noise import cubic
from fit.cloth.simulator import Simulator
from fit.gap.floor import noise_floor
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.noise import held_noise, point_noise, white_noise
from fit.recordings.recording import prepare
from fit.recordings.smoothing import best_cut_off, low_pass, noise_of, smoothing_spline, steady_spline
from tests.fit.scenes import hung, material, sheet, swing, take_of

FRAME = 1 / 30
SD = 1.5e-3  # m, of the noisy hanger's path
VECTOR = np.array([300.0, 40.0, 3e-5, 1e-3, 1.0])  # SI parameters


def hand(seconds=5.0):
    time = np.arange(0, seconds, FRAME)
    return time, swing(time, amplitude=0.05, hz=0.7)


def take_with(noise, seed=0):
    """A take of a hand's motion with noise on the hanger's path, and points that hang still."""
    time, displacement = hand()
    garment = sheet()
    take = take_of(garment, time, displacement, hung(garment, time))
    held = take.held + np.random.default_rng(seed).normal(0, noise, take.held.shape)
    return dataclasses.replace(take, held=held)


def amplitude_at(hertz, seconds=20.0, **smoothed):
    """What the steady spline leaves of a wave, in its middle."""
    time = np.arange(0, seconds, FRAME)
    wave = np.sin(2 * np.pi * hertz * time)[:, None]
    middle = slice(len(time) // 4, 3 * len(time) // 4)
    left = steady_spline(time, wave, **smoothed)(time)
    return float((left[middle] * wave[middle]).sum() / (wave[middle] ** 2).sum())


def test_low_pass_keeps_a_swing_and_stops_noise():
    """At 1 Hz the 6 Hz filter keeps 99.9 % of the amplitude; of what is at 14 Hz it leaves 5 %."""
    time = np.arange(0, 10, FRAME)
    kept = low_pass(time, np.sin(2 * np.pi * time)[:, None], 6.0)[60:-60, 0]
    assert np.abs(kept - np.sin(2 * np.pi * time)[60:-60]).max() < 2e-3
    assert np.abs(low_pass(time, np.sin(2 * np.pi * 14 * time)[:, None], 6.0)[60:-60]).max() < 0.06


@pytest.mark.parametrize(("hertz", "passed"), [(2.0, 64 / 65), (4.0, 0.5), (8.0, 1 / 65)])
def test_a_steady_spline_passes_waves_as_its_transfer_function_says(hertz, passed):
    """1 / (1 + (f / 4 Hz)^6)."""
    assert amplitude_at(hertz, cut_off=4.0) == pytest.approx(passed, abs=0.02)


def test_a_noisier_path_is_cut_off_lower_and_a_clean_one_hardly_at_all():
    time, displacement = hand()
    rng = np.random.default_rng(3)
    cuts = [best_cut_off(time, displacement + rng.normal(0, sd, displacement.shape)) for sd in (1e-5, 3e-4, 3e-3)]
    assert cuts[0] > 6.0
    assert cuts[0] > cuts[1] > cuts[2] >= 2.0


def test_the_chosen_cut_off_follows_an_acceleration_better_than_the_cubic_does():
    time, displacement = hand()
    true = np.gradient(np.gradient(displacement[:, 1], FRAME), FRAME)[5:-5]
    noisy = displacement + np.random.default_rng(1).normal(0, SD, displacement.shape)

    def error(spline):
        return float(np.sqrt(np.mean((spline.derivative(2)(time)[5:-5, 1] - true) ** 2)))

    steady = steady_spline(time, noisy, best_cut_off(time, noisy))
    assert error(steady) < 0.5 * error(smoothing_spline(time, noisy))


def test_a_gap_is_bridged_as_the_hand_went_on():
    time, displacement = hand()
    keep = np.abs(time - 2.0) > 0.15
    spline = steady_spline(time[keep], displacement[keep], 6.0)
    assert np.abs(spline(time) - displacement)[~keep].max() < 2e-3


def cloth_under(recording):
    """Simulated points of one cloth on a recording's hanger path."""
    return Simulator(recording, ()).run(material(sheet(), velocity_damping=2.0, bending_stiffness=3e-5)).points[0]


def test_noise_of_the_hanger_moves_cloth_much_less_far_than_through_a_cubic_at_six_hertz():
    clean = cloth_under(prepare(take_with(0.0)))

    def off(recording):
        return float(np.sqrt(np.mean((cloth_under(recording) - clean) ** 2)))

    noisy = prepare(take_with(SD))
    assert off(noisy) < 0.6 * off(cubic(noisy))


def test_a_coordinate_that_is_noisier_is_known_to_be():
    take = take_with(0.0)
    noise = np.random.default_rng(4).normal(0, 1, take.held.shape) * [1e-4, 1e-3, 2e-4]
    found = held_noise(prepare(dataclasses.replace(take, held=take.held + noise)))
    assert found == pytest.approx(np.tile([1e-4, 1e-3, 2e-4], 2), rel=0.3)


def test_the_floor_counts_what_noise_of_the_hanger_does_to_the_cloth():
    """Points without noise under a hanger with noise: three floors are on average what that shakes, within a third."""
    clean = prepare(take_with(0.0))
    take = take_with(SD)
    points = cloth_under(clean)
    take = dataclasses.replace(take, points=points, points_sd=np.full(points.shape, 1e-5))
    noisy = prepare(take)
    assert np.sqrt(np.mean(held_noise(noisy) ** 2)) == pytest.approx(SD, rel=0.15)
    observer = Observer([noisy], SI, (), frequency=0.0)
    row = material(sheet(), velocity_damping=2.0, bending_stiffness=3e-5)[0]
    vector = np.array([row[1], row[2], row[3], row[5], row[6]])
    error = float(observer.in_mm(observer.residuals(vector[None], observer.off[None])[0]))
    floor = np.mean([noise_floor(observer, vector, observer.off, np.random.default_rng(k)).mm for k in (2, 3, 4)])
    assert error > 0.5
    assert floor == pytest.approx(error, rel=0.35)


def test_the_noise_of_a_column_is_in_its_sixth_differences():
    """1, -1, 1 ... has sixth differences of 64, of white noise those of a deviation of 64 / (0.6745 sqrt(924))."""
    turns = np.tile([1.0, -1.0], 10)
    assert noise_of(turns) == pytest.approx(64 / 0.6745 / np.sqrt(924), rel=1e-9)
    assert noise_of(np.arange(20.0) ** 5) == pytest.approx(0.0, abs=1e-6)
    assert noise_of(np.random.default_rng(0).normal(0, 0.3, 20000)) == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("cut_off", [2.0, 4.0])
def test_a_cubic_spline_halves_a_wave_at_its_cut_off(cut_off):
    time = np.arange(0, 20, FRAME)
    wave = np.sin(2 * np.pi * cut_off * time)[:, None]
    left = smoothing_spline(time, wave, cut_off)(time)[150:450]
    assert (left * wave[150:450]).sum() / (wave[150:450] ** 2).sum() == pytest.approx(0.5, abs=0.02)


def test_a_cut_off_is_at_most_four_tenths_of_the_frame_rate():
    time = np.arange(40) / 10
    values = np.random.default_rng(0).normal(size=(40, 2))
    fast, most, less = (smoothing_spline(time, values, hertz)(time) for hertz in (6.0, 4.0, 3.9))
    assert fast == pytest.approx(most)
    assert np.abs(fast - less).max() > 1e-3


@pytest.mark.parametrize(("rate", "noise"), [(30.0, 1e-3), (30.0, 3e-3), (60.0, 1e-3)])
def test_the_chosen_cut_off_has_the_least_score_of_cross_validation(rate, noise):
    """log |y - f|^2 - 2 log(1 - tr H / n), with H as it stands above the module, tried one by one."""
    time = np.arange(0, 4, 1 / rate)
    values = swing(time, amplitude=0.05, hz=0.7)[:, 1:2] + np.random.default_rng(2).normal(0, noise, (len(time), 1))
    count, turns = len(time), np.pi * np.arange(len(time)) / len(time)

    def halves(angle):
        return ((66 + 52 * np.cos(angle) + 2 * np.cos(2 * angle)) / 120) ** 2 / (2 * np.sin(angle / 2)) ** 6

    def score(hertz):
        left = values - steady_spline(time, values, hertz)(time)
        passed = 1 + (1 / (1 + halves(2 * np.pi * hertz / rate) / halves(turns[1:]))).sum()
        return np.log((left**2).sum()) - 2 * np.log(1 - passed / count)

    tried = np.geomspace(2.0, 0.4 * rate, 120)
    best = tried[int(np.argmin([score(hertz) for hertz in tried]))]
    assert 2.1 < best < 0.39 * rate
    assert best_cut_off(time, values) == pytest.approx(best, rel=0.03)


def test_a_cut_off_is_never_below_a_hands_own_motion_nor_beyond_what_frames_show():
    """2 Hz, and four tenths of 30 frames a second; of 4 frames a second just above 2 Hz."""
    time, displacement = hand()
    noise = np.random.default_rng(4).normal(0, 0.03, displacement.shape)
    assert best_cut_off(time, 0.01 * displacement + noise) == pytest.approx(2.0, rel=0.02)
    assert best_cut_off(time, displacement) == pytest.approx(12.0, rel=0.02)
    slow = np.arange(20) / 4
    assert 2.0 <= best_cut_off(slow, noise[:20]) <= 2.02


def test_a_spline_of_few_frames_has_ten_spans_at_least():
    """Four frames pass a steady spline as they are: there are more coefficients than frames."""
    time = np.arange(4) * FRAME
    assert len(steady_spline(time, np.ones((4, 1)), 6.0).t) == 2 * 5 + 10 + 1


def frames_of(rate, count, noise, *, stated=1e-9):
    """What noise is measured on: two points and a path of six coordinates that stand still but for noise."""
    rng = np.random.default_rng(6)
    time = np.arange(count) / rate
    return SimpleNamespace(
        time=time, duration=float(np.ptp(time)), points=noise * rng.normal(size=(count, 2, 3)),
        valid=np.ones((count, 2), bool), held_seen=noise * rng.normal(size=(count, 6)), held_sd=stated,
        point_sd=np.full(2, stated), held_time=None, held=lambda instants: np.zeros((len(instants), 6)),
    )  # fmt: skip


def test_noise_is_measured_from_twenty_frames_a_second_and_eleven_frames_on():
    slow, fast = (moving_from(0.1, frames_of(rate, 900, 0.002, stated=0.001)) for rate in (19.9, 20.1))  # at 2 frames
    assert white_noise(slow) is None
    assert point_noise(slow) == pytest.approx([0.001, 0.001])
    assert held_noise(slow) == pytest.approx(np.full(6, 0.001))
    assert white_noise(fast) == pytest.approx([0.002, 0.002], rel=0.1)
    assert held_noise(fast) == pytest.approx(np.full(6, 0.002), rel=0.15)
    assert white_noise(frames_of(30, 10, 0.002)) == pytest.approx([0.0, 0.0])
    assert white_noise(frames_of(30, 11, 0.002)).min() > 0.0


def moving_from(start, recording):
    """The same where the hanger moves on at 0.1 m/s from an instant [s] on, and takes the points with it."""
    recording.held = lambda instants: np.repeat(0.1 * np.maximum(instants - start, 0.0)[:, None], 6, 1)
    away = recording.held(recording.time)
    recording.held_seen += away
    recording.points += away[:, None, :3]
    return recording


def test_a_slow_take_shows_its_noise_at_rest():
    """At 10 frames a second, 4 s at rest and 6 s of motion: 40 frames of 2 mm."""
    slow = moving_from(4.0, frames_of(10, 100, 0.002, stated=0.001))
    assert white_noise(slow) == pytest.approx([0.002, 0.002], rel=0.15)
    assert np.sqrt((held_noise(slow) ** 2).mean()) == pytest.approx(0.002, rel=0.15)
    slow.valid[:, 1] = False  # a point that is not seen at rest is as noisy as the others
    slow.points[:, 1] = np.nan
    assert white_noise(slow)[1] == white_noise(slow)[0]


@pytest.mark.parametrize(("seen", "is_measured"), [(4, False), (5, True)])
def test_noise_at_rest_takes_five_frames(seen, is_measured):
    slow = moving_from(4.0, frames_of(10, 100, 0.002, stated=0.001))
    slow.valid[seen:40] = False
    slow.held_seen[seen:40] = np.nan
    assert (white_noise(slow) is not None) == is_measured
    assert (held_noise(slow)[0] != 0.001) == is_measured


def test_a_points_noise_is_no_less_than_stated_and_that_of_its_axes_together():
    """3, 4 and 0 mm a frame's axis: sqrt(25 / 3) mm; what was not seen does not count."""
    found = frames_of(30, 3000, 1.0, stated=0.002)
    found.points *= [0.003, 0.004, 0.0]
    found.points[1000:, 1] = np.nan
    found.valid[1000:, 1] = False
    assert white_noise(found) == pytest.approx(np.full(2, 0.005 / np.sqrt(3)), rel=0.1)
    found.point_sd[:] = [0.002, 0.004]
    assert point_noise(found) == pytest.approx([0.005 / np.sqrt(3), 0.004], rel=0.1)
    found.held_seen[::7] = np.nan
    assert np.isfinite(held_noise(found)).all()


def of_seeds(seconds, stated, *, points=5, loud=1.0, hertz=30, count=150):
    """Mean squares of the points' noise over the true ones: as stated or measured, and of the last point alone."""
    found, frames = [], round(seconds * hertz)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        noise = np.full(points, 0.001)
        noise[-1] *= loud
        take = frames_of(hertz, frames, 0.0)
        take.points = rng.normal(size=(frames, points, 3)) * noise[:, None]
        take.valid, take.point_sd = np.ones((frames, points), bool), np.full(points, 0.001 * stated)
        shares = [of(take) ** 2 / noise**2 for of in (point_noise, white_noise)]
        found.append([shares[0].mean(), shares[1].mean(), shares[0][-1]])
    return np.array(found)


@pytest.mark.parametrize("points", [5, 25])
@pytest.mark.parametrize("seconds", [2, 3, 5, 10])
def test_short_takes_measure_as_much_noise_as_there_is(seconds, points):
    """Of 150 takes of 5 points the mean square has an error of 2.1 % at 2 s; without the mend it is 10 % too large."""
    stated, measured, _ = of_seeds(seconds, 1.0, points=points).mean(0)
    assert measured == pytest.approx(1.0, abs=0.05)
    assert stated == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize(("stated", "expected"), [(0.3, 1.0), (0.8, 0.97), (2.0, 4.0)])
def test_noise_that_is_surely_larger_than_stated_is_measured_and_no_other(stated, expected):
    """A take of 3 s shows 1 mm where 0.3 or 0.8 are stated; where 2 are stated it may have slow noise."""
    assert of_seeds(3, stated).mean(0)[0] == pytest.approx(expected, abs=0.06)


def test_a_point_that_is_noisier_than_chance_allows_keeps_its_noise():
    """Four times as noisy as the other 24, beside which no mean counts; as stated it would be a sixteenth."""
    assert of_seeds(3, 1.0, points=25, loud=4.0, count=40).mean(0)[2] == pytest.approx(1.0, abs=0.1)


def test_points_are_drawn_together_at_rest_too():
    """Of 25 points that rest for 40 frames at 10 a second, each square varies by chance by 13 %, and S^2 by no more."""
    slow = moving_from(4.0, frames_of(10, 100, 0.0))
    rng = np.random.default_rng(3)
    slow.points = slow.points[:, :1] + 0.002 * rng.normal(size=(100, 25, 3))
    slow.valid, slow.point_sd = np.ones((100, 25), bool), np.full(25, 1e-9)
    squares = slow.points[:40].var(0, ddof=1).mean(1)
    drawn = white_noise(slow) ** 2
    assert drawn.mean() == pytest.approx(squares.mean())
    share = min(1.0, 22 / 24 * 2 / 3 / 39 * squares.mean() ** 2 / squares.var(ddof=1))
    assert 0.5 < share <= 1.0
    assert drawn - drawn.mean() == pytest.approx((1 - share) * (squares - squares.mean()))


def test_a_take_may_begin_at_any_time():
    time = np.arange(30) * FRAME
    values = np.random.default_rng(8).normal(size=(30, 2)) + np.sin(4 * time)[:, None]
    assert smoothing_spline(time, values)(time) == pytest.approx(smoothing_spline(time, values, 6.0)(time))
    later = time + 50.0
    for smoothed in (smoothing_spline, steady_spline):
        assert smoothed(later, values, 4.0)(later) == pytest.approx(smoothed(time, values, 4.0)(time), abs=1e-6)
    assert best_cut_off(later, values) == pytest.approx(best_cut_off(time, values), rel=1e-3)
    assert best_cut_off(later, np.sin(4 * time)[:, None]) == pytest.approx(12.0, abs=0.15)  # 29 intervals


@pytest.mark.parametrize("begin", [0.0, 50.0])
@pytest.mark.parametrize("cut_off", [3.0, 8.0])
def test_a_short_steady_spline_is_the_least_of_its_own_sum_whenever_it_begins(begin, cut_off):
    """|y - B a|^2 + lambda |D a|^2 of twelve frames, eleven spans, solved as it stands above the module."""
    time = begin + np.arange(12) * FRAME
    values = np.random.default_rng(3).normal(size=(12, 2))
    knots = begin + FRAME * np.arange(-5, 17)
    basis = BSpline.design_matrix(np.clip(time, knots[5], knots[-6]), knots, 5).toarray()
    differences = np.diff(np.eye(basis.shape[1]), 3, axis=0)
    angle = 2 * np.pi * cut_off * FRAME
    halves = ((66 + 52 * np.cos(angle) + 2 * np.cos(2 * angle)) / 120) ** 2 / (2 * np.sin(angle / 2)) ** 6
    expected = np.linalg.solve(basis.T @ basis + halves * differences.T @ differences, basis.T @ values)
    found = steady_spline(time, values, cut_off)
    assert found.t == pytest.approx(knots)
    assert found(time) == pytest.approx(basis @ expected, abs=1e-6)
