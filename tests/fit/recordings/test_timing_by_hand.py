"""Delays of time stamps by hand: a hanger at constant speed, and a row with a known delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm
from scipy.stats import t as student

from fit.recordings.robust_line import robust_line
from fit.recordings.timing import (
    FEWEST_NOISE_FRAMES,
    INTERVAL_SHARES,
    LEAST_NOISE,
    MEDIAN_TELLS,
    SCAN_STEP,
    STILL,
    WIDEST_INTERVAL,
    Timing,
    _Scan,
    find_timing,
    is_sure,
    row_middle,
    uneven_intervals,
)
from formats.held_row import FEWEST_BLOCKS, HALF_SWING, LEAST_EXPLAINED
from formats.sights import LARGEST_SHIFT

SPEED = 0.4  # m/s, across the cloth


def path(instants):
    """Held ends 0.4 m apart that move across the cloth."""
    middle = np.stack([0 * instants, SPEED * instants, 0 * instants + 1.0], 1)
    half = np.array([0.2, 0.0, 0.0])
    return np.concatenate([middle - half, middle + half], 1)


def scan_of(time, lag, *, noise=1e-3, still=1000, used=None):
    """A row that is where the hanger was at its stamp less a lag [s], (frames,)."""
    row = path(time - lag).reshape(-1, 2, 3).mean(1)
    used = np.ones(len(time), bool) if used is None else used
    return _Scan(time, row, uneven_intervals(time), path, used, np.full(3, noise), still)


A_TIMING = Timing(
    latency=0.0, latency_interval=(-0.01, 0.01), share=0.0, share_interval=None, deviation=0.0, explained=1.0,
    shifts=np.zeros(3),
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "is_late", "is_off", "is_of_hanger"),
    [
        ({}, False, False, True),
        ({"latency_interval": (0.001, 0.02)}, True, True, True),
        ({"latency_interval": (-0.02, -0.001)}, True, True, True),
        ({"share_interval": (0.1, 0.5)}, False, True, True),
        ({"share_interval": (-0.5, -0.1)}, False, True, True),
        ({"share_interval": (-0.1, 0.5)}, False, False, True),
        ({"deviation": 0.001}, False, True, True),
        ({"explained": LEAST_EXPLAINED - 0.01}, False, False, False),
        ({"explained": LEAST_EXPLAINED}, False, False, True),
        ({"latency": LARGEST_SHIFT - 0.5 * SCAN_STEP}, False, False, False),
        ({"latency": -LARGEST_SHIFT + 0.5 * SCAN_STEP}, False, False, False),
        ({"latency": LARGEST_SHIFT - 1.5 * SCAN_STEP}, False, False, True),
    ],
)
def test_intervals_of_a_timing(changes, is_late, is_off, is_of_hanger):
    found = replace(A_TIMING, **changes)
    assert (found.is_late, found.is_off, found.is_of_hanger) == (is_late, is_off, is_of_hanger)


@pytest.mark.parametrize(
    ("interval", "is_it"), [((1.0, 2.9), True), ((1.0, 3.1), False), ((-2.9, -1.0), True), ((-1.0, 1.0), False)]
)
def test_a_figure_is_sure_beyond_two_halves_of_its_interval(interval, is_it):
    assert is_sure(interval) is is_it


def test_intervals_are_uneven_by_what_they_are_longer_than_the_median():
    assert uneven_intervals(np.array([5.0, 5.1, 5.2, 5.5, 5.55])) == pytest.approx(
        [0.0, 0.0, 0.0, 0.2, -0.05], abs=0.03
    )


@pytest.mark.parametrize(
    ("frames", "still", "has_one"),
    [(2 * FEWEST_BLOCKS, 1000, True), (2 * FEWEST_BLOCKS - 1, 1000, False), (2 * FEWEST_BLOCKS, 0, False),
     (2 * FEWEST_BLOCKS, 1, False), (2 * (FEWEST_BLOCKS - 1), 1000, False)],
)  # fmt: skip
def test_frames_that_are_early_and_late_by_turns_deviate_by_that(frames, still, has_one):
    """30 ms at 0.4 m/s are 12 mm beside 1 mm of noise: sqrt(30^2 - (1 / 0.4)^2) ms, of ten frames in five blocks."""
    time = np.arange(frames) * HALF_SWING / 2
    lag = 0.03 * np.where(np.arange(frames) % 2, 1.0, -1.0)
    found = scan_of(time, lag, still=still).with_deviation(A_TIMING)
    assert found.deviation == pytest.approx(np.sqrt(0.03**2 - 0.0025**2) if has_one else 0.0, rel=1e-6)


@pytest.mark.parametrize(("latency", "share"), [(0.0, 0.0), (0.1, 0.5)])
def test_a_row_moves_through_the_hangers_frame_as_the_hanger_does_and_later_stamps_put_it_ahead(latency, share):
    """Along the bar's normal, across the cloth, whatever the stamps; 0.2 s late it is 80 mm ahead of its position."""
    time = np.arange(9) * 0.1
    scan = scan_of(time, 0.0)
    assert scan.velocity(latency, share) == pytest.approx(np.tile([0.0, 0.0, SPEED], (9, 1)))
    assert scan.local(0.2, 0.0) == pytest.approx(np.tile([0.0, 0.0, 0.2 * SPEED], (9, 1)), abs=1e-12)


def test_frames_of_one_lag_do_not_deviate():
    time = np.arange(20) * 0.1
    assert scan_of(time, np.full(20, 0.1)).with_deviation(replace(A_TIMING, latency=0.1)).deviation == 0.0


def test_noise_is_that_of_frames_in_which_the_row_stands_still_and_at_least_half_a_millimetre():
    """Median absolute deviations of 3 mm along the bar and 0.1 mm down; the row moves afterwards."""
    frames = 4 * FEWEST_NOISE_FRAMES
    time = np.arange(frames) * 0.1
    rests = np.arange(frames) < FEWEST_NOISE_FRAMES + 1

    def begins(instants):
        return path(np.maximum(instants - time[FEWEST_NOISE_FRAMES] - 0.05, 0.0))

    row = begins(time).reshape(-1, 2, 3).mean(1)
    row += (np.arange(frames) % 3 - 1)[:, None] * np.array([0.003, 0.0, 1e-4])
    scan = _Scan(time, row, 0 * time, begins, np.ones(frames, bool))
    found = scan.by_noise(0.0, 0.0)
    assert found.still == rests.sum()
    assert found.noise == pytest.approx([1.4826 * 0.003, LEAST_NOISE, LEAST_NOISE])
    assert replace(scan, used=np.arange(frames) >= 1).by_noise(0.0, 0.0).still == FEWEST_NOISE_FRAMES
    few = replace(scan, used=np.arange(frames) >= 2).by_noise(0.0, 0.0)
    assert (few.still, few.noise.tolist()) == (0, [1.0, 1.0, 1.0])
    assert np.linalg.norm(scan.velocity(0.0, 0.0), axis=1)[rests].max() < STILL


@pytest.mark.parametrize("late", [-0.2, 0.0, 0.16])
def test_the_scan_finds_the_latency_on_its_grid_and_steps_find_it_between(late):
    time = np.arange(0, 6, 0.1) ** 1.05  # uneven, at one speed

    def swings(instants):
        middle = np.stack([0 * instants, 0.1 * np.sin(4 * instants), 0 * instants], 1)
        half = np.array([0.2, 0.0, 0.0])
        return np.concatenate([middle - half, middle + half], 1)

    row = swings(time - late - 0.007).reshape(-1, 2, 3).mean(1)
    scan = _Scan(time, row, uneven_intervals(time), swings, np.ones(len(time), bool))
    assert scan.best(0.3, np.zeros(1)) == (pytest.approx(late), 0.0)
    latency, share, sd = scan.mended(late, 0.0, is_uneven=False)
    assert (latency, share, sd[1]) == (pytest.approx(late + 0.007, abs=1e-6), 0.0, 0.0)
    assert sd[0] < 1e-4


def test_frames_three_times_as_far_off_as_the_median_are_left_out():
    time = np.arange(9) * 0.1
    scan = scan_of(time, np.array([*4 * (0.1, -0.1), 1.2]))
    assert scan.without_outliers(0.0, 0.0).used.tolist() == [*8 * [True], False]
    scan = scan_of(time, np.array([*4 * (0.1, -0.1), 0.3]))
    assert scan.without_outliers(0.0, 0.0).used.all()
    away = np.linalg.norm(scan.residual(0.0, 0.0), axis=1) / SPEED
    assert away == pytest.approx([*4 * (0.1 - 0.3 / 9, 0.1 + 0.3 / 9), 0.3 - 0.3 / 9])


def test_a_take_gives_no_estimate_of_time_that_is_short_or_seen_too_little():
    """A block is half a second: two seconds and more, less a quarter of the take at either end."""
    time = np.arange(0, 6, 0.1)
    row = path(time - 0.1).reshape(-1, 2, 3).mean(1)

    def swings(instants):
        ends = path(0 * instants)
        ends[:, [1, 4]] += 0.1 * np.sin(4 * instants)[:, None]
        return ends

    row[:, 1] = 0.1 * np.sin(4 * (time - 0.1))
    assert find_timing(time, row, swings).latency == pytest.approx(0.1, abs=1e-3)
    # A clock that begins a minute before or after the take is as good.
    for ahead in (60.0, -60.0):
        moved = find_timing(time + ahead, row, lambda instants, ahead=ahead: swings(instants - ahead))
        assert moved.latency == pytest.approx(0.1, abs=1e-3)
    for count in (4, 30):
        assert find_timing(time[:count], row[:count], swings) is None
    hidden = np.where((np.arange(60) % 60 < 45)[:, None], np.nan, row)
    assert find_timing(time, hidden, swings) is None
    assert find_timing(time, 0 * row + 1.0, lambda instants: path(0 * instants)) is None


@pytest.mark.parametrize(("seen", "is_known"), [((0, 1), False), ((1, 3), False), ((0, 3), True), ((1, 2, 3), True)])
def test_a_row_has_a_middle_where_a_tenth_of_its_spread_is_seen(seen, is_known):
    """Of points 1 apart n sum a^2 - (sum a)^2 is 1, 4, 9 and 6; a tenth of 5 times 10 is 5, and three have it."""
    across = np.arange(5) - 2.0
    points = np.full((1, 5, 3), np.nan)
    points[0, list(seen)] = np.column_stack([across, 0.2 * across + 1.0, 0 * across])[list(seen)]
    found = row_middle(points, across)[0]
    assert found == pytest.approx([0.0, 1.0, 0.0] if is_known else [np.nan] * 3, nan_ok=True)


def test_of_six_points_the_outermost_do_not_count_and_of_five_they_do():
    across = np.array([0.3, -0.3, 0.1, -0.1, 0.2, -0.2])
    points = np.zeros((1, 6, 3))
    points[0, :, 0], points[0, :2, 2] = across, 9.0
    assert row_middle(points, across)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert row_middle(points[:, :5], across[:5])[0, 2] > 1.0


def test_a_scales_interval_is_that_of_the_travel_and_not_of_the_velocity_beside_it():
    """A row that moves a tenth less than its hanger; the line over travel and velocity is drawn here anew."""
    time = np.arange(0, 12, 1 / 15)

    def swings(instants):
        ends = path(0 * instants)
        ends[:, [1, 4]] = 0.1 * np.sin(4 * instants)[:, None]
        return ends

    row = 0.9 * 0.1 * np.sin(4 * time) + 0.002 * np.random.default_rng(0).normal(size=len(time))
    middle = np.stack([0 * time, row, 0 * time + 1.0], 1)
    found = _Scan(time, middle, 0 * time, swings, np.ones(len(time), bool)).with_scale(A_TIMING)
    out, travel = row - 0.1 * np.sin(4 * time), 0.1 * np.sin(4 * time)
    design = np.stack([np.ones(len(time)), travel - travel.mean(), 0.4 * np.cos(4 * time)], 1)
    line, half = robust_line(design, out, (time // HALF_SWING).astype(int))
    assert found.scale == pytest.approx(line[1], abs=1e-4)
    assert found.scale == pytest.approx(-0.1, abs=0.01)
    assert np.ptp(found.scale_interval) == pytest.approx(2 * half[1], rel=0.01)
    assert min(half[0], half[2]) < 0.5 * half[1]


def test_a_shares_interval_is_students_times_its_own_jackknife_over_half_swings():
    """Stamps of a hanger at changing speed, late by half of what their interval is longer than the median."""
    rng = np.random.default_rng(2)
    time = np.cumsum(np.where(rng.uniform(size=120) < 0.3, 0.15, 0.05))
    step = uneven_intervals(time)

    def swings(instants):
        ends = path(0 * instants)
        ends[:, [1, 4]] = 0.1 * np.sin(4 * instants)[:, None]
        return ends

    row = swings(time - 0.5 * step).reshape(-1, 2, 3).mean(1)
    row[:, 1] += 0.002 * rng.normal(size=len(time))
    scan = _Scan(time, row, step, swings, np.ones(len(time), bool))
    latency, share, sd = scan.mended(0.0, 0.5, is_uneven=True)
    at = time - latency - share * step
    speed = 0.4 * np.cos(4 * at)
    design = np.stack([speed, speed * step, np.ones(len(time))], 1)
    off = row[:, 1] - 0.1 * np.sin(4 * at)
    block = scan.block
    without = np.stack([np.linalg.lstsq(design[block != b], off[block != b], rcond=None)[0] for b in np.unique(block)])
    count = len(without)
    expected = np.sqrt((count - 1) / count * ((without - without.mean(0)) ** 2).sum(0))
    assert sd == pytest.approx(expected[:2], rel=0.02)
    found = find_timing(time, row, swings, is_per_frame=False)
    assert np.ptp(found.latency_interval) < 0.5 * np.ptp(found.share_interval)


@pytest.mark.parametrize(("share", "has_one"), [(0.99, False), (1.01, True)])
def test_frames_that_deviate_alike_in_every_block_are_judged_by_the_noise_alone(share, has_one):
    """Of 500 frames at rest three axes give the noise's variance, as a median gives it: less of it at three errors."""
    freedom = 3 * MEDIAN_TELLS * 500
    most = freedom / chi2.ppf(norm.cdf(-3.0), freedom)
    lag = 1e-3 / SPEED * np.sqrt(share * most)
    time = np.arange(20) * HALF_SWING / 2
    found = scan_of(time, lag * np.where(np.arange(20) % 2, 1.0, -1.0), still=500).with_deviation(A_TIMING)
    assert found.deviation == pytest.approx(1e-3 / SPEED * np.sqrt(share * most - 1) if has_one else 0.0, rel=1e-6)


def swinging(instants):
    """Held ends of a swing of 0.1 m across the cloth at 4 rad/s."""
    ends = path(0 * instants)
    ends[:, [1, 4]] = 0.1 * np.sin(4 * instants)[:, None]
    return ends


def test_the_scan_for_a_latency_alone_takes_the_stamps_as_they_are():
    """Every third interval is three times as long, which would shift a scan by shares of the intervals."""
    time = np.cumsum(np.tile([0.05, 0.05, 0.15], 40))
    row = swinging(time - 0.1).reshape(-1, 2, 3).mean(1)
    scan = _Scan(time, row, uneven_intervals(time), swinging, np.ones(len(time), bool))
    assert scan.best(0.3, np.zeros(1)) == (pytest.approx(0.1), 0.0)
    assert scan.best(0.3, INTERVAL_SHARES) == (pytest.approx(0.1), 0.0)


@pytest.mark.parametrize(("late", "is_known"), [(0.06, True), (0.08, False)])
def test_a_latency_known_worse_than_five_hundredths_of_a_second_is_none(late, is_known):
    """A row that is early and late by turns of half a second; half its interval is that of a jackknife over them."""
    time = np.arange(0, 6, 1 / 20)
    row = swinging(time - late * np.where(time // HALF_SWING % 2, 1.0, -1.0)).reshape(-1, 2, 3).mean(1)
    used = (time > LARGEST_SHIFT) & (time < time[-1] - LARGEST_SHIFT)
    design, off = np.stack([0.4 * np.cos(4 * time), 1 + 0 * time], 1), row[:, 1] - 0.1 * np.sin(4 * time)
    block = (time // HALF_SWING).astype(int)
    names = np.unique(block[used])
    without = [np.linalg.lstsq(design[used & (block != b)], off[used & (block != b)], rcond=None)[0][0] for b in names]
    half = student.ppf(0.95, len(names) - 1) * np.std(without) * np.sqrt(len(names) - 1)
    found = find_timing(time, row, swinging, is_per_frame=False)
    assert (half < WIDEST_INTERVAL) == (found is not None) == is_known
    if found is not None:
        assert np.ptp(found.latency_interval) == pytest.approx(2 * half, rel=0.1)  # slopes at another latency
