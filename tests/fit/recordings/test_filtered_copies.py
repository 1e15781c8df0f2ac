"""Copies of a recording in which every position has changed, and different recordings of one motion."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, median_filter

from fit.recordings.copies import Track, are_copies, share_positions
from fit.recordings.filtered_copies import Motion, noise_left
from formats.archive import read_take, write_take
from formats.importers.swung_cloth import import_swung_cloth
from tests.fit.recordings.test_copies import part, recorded, with_lost
from tests.fit.scenes import hung, sheet, take_of
from tests.shared_data import SHARED_DATA

REAL = sorted((SHARED_DATA / "swung-cloth").glob("*.npz"))

TURNED = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def other_places(take, points):
    return dataclasses.replace(take, points=np.where(take.points_valid[..., None], points, np.nan))


def turned(take):
    return other_places(take, (take.points @ TURNED.T + 0.3).round(4))


def smoothed(take, frames=2.0):
    return other_places(take, gaussian_filter1d(take.points, frames, axis=0))


def at_rate(take, rate):
    """The take at so many frames a second, led straight from frame to frame."""
    time = np.arange(take.time[0], take.time[-1], 1 / rate)
    frames = part(take, np.searchsorted(take.time, time, side="right") - 1)
    columns = [np.interp(time, take.time, column) for column in take.points.reshape(len(take.time), -1).T]
    return dataclasses.replace(frames, time=time, points=np.stack(columns, 1).reshape(frames.points.shape))


def left(one, other):
    one, other = Track(one), Track(other)
    return noise_left(one.motion, other.motion, one.free)


COPIES = {
    "moved by 1 mm": lambda take: other_places(take, (take.points + 1e-3).round(4)),
    "other axes": turned,
    "mirrored": lambda take: other_places(take, take.points[..., [1, 0, 2]]),
    "other axes and clock, cut": lambda take: dataclasses.replace(part(turned(take), slice(40, None)),
                                                                  time=take.time[40:] + 100.0),
    "other axes, other points lost": lambda take: with_lost(turned(take), 0.05, 2),
    "rounded to 1 mm": lambda take: other_places(take, take.points.round(3)),
    "smoothed": smoothed,
    "smoothed by a median": lambda take: other_places(take, median_filter(take.points, (5, 1, 1))),
    "25 frames a second": lambda take: at_rate(take, 25.0),
    "29.97 frames a second": lambda take: at_rate(take, 29.97),
    "all of them": lambda take: other_places(part(at_rate(smoothed(turned(take)), 25.0), slice(20, None)),
                                             at_rate(smoothed(turned(take)), 25.0).points[20:].round(3)),
}  # fmt: skip


@pytest.mark.parametrize("change", COPIES)
def test_a_recording_whose_every_position_has_changed_is_known_by_its_noise(change):
    take = recorded(noise=2e-3)
    copy = COPIES[change](take)
    assert are_copies(Track(take), Track(copy))
    assert are_copies(Track(copy), Track(take))
    assert not share_positions(Track(take), Track(copy))


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 3e-3])
def test_recordings_of_one_motion_leave_the_noise_of_both(noise):
    """q is 1, by chance within a quarter of it: some 160 independent numbers have a deviation of sqrt(2 / 160)."""
    one, other = recorded(noise=noise), recorded(noise=noise, seed=7)
    assert left(one, other) == pytest.approx(1.0, abs=0.35)
    assert left(one, turned(other)) == pytest.approx(1.0, abs=0.35)
    if noise > 1e-4:  # smoothed, noise of 0.1 mm is below what counts
        assert left(one, smoothed(other)) > 0.65
        assert left(smoothed(one), smoothed(other)) > 0.65
    assert left(at_rate(one, 25.0), other) > 0.65


def test_the_noise_that_rounding_leaves_is_a_twenty_fifth():
    """Rounding to 1 mm adds 1/12 mm^2; two recordings would leave 1 mm^2 and 1 + 1/12 mm^2."""
    take = recorded(noise=1e-3, garment=sheet(grid=4))
    assert left(take, other_places(take, take.points.round(3))) == pytest.approx(1 / 25, rel=0.3)


@pytest.mark.parametrize(("noise", "found"), [(1e-3, 1e-3), (0.0, 1e-4), (1e-5, 1e-4)])
def test_noise_is_measured_on_moving_cloth(noise, found):
    """Of the three axes, smoothed over 3 frames: 3 s^2 / (2 sqrt(pi) 3). No noise is below 0.1 mm."""
    track = Track(recorded(noise=noise, garment=sheet(grid=4)))
    left = np.median(track.motion.noise(track.free, 0.1))
    assert left == pytest.approx(found**2 / (2 * math.sqrt(math.pi)), rel=0.25)


def test_frames_that_are_held_are_one_frame_and_slow_takes_are_known_in_other_axes():
    """At 15 frames a second, each of them twice, a swing would pass for noise."""
    one, other = (part(recorded(noise=2e-3, seed=seed), np.repeat(np.arange(0, 150, 2), 2)) for seed in (1, 2))
    held = [dataclasses.replace(take, time=recorded().time) for take in (one, other)]
    assert Track(held[0]).motion.interval == pytest.approx(1 / 15)
    assert left(held[0], turned(held[0])) < 0.25
    assert left(*held) > 100


def lively(rate, seed=0, noise=1e-3, hz=2.2, flutter=0.03):
    """A take of 10 s whose points swing fast and flutter four times a second, the lower ones more."""
    garment, time = sheet(grid=4), np.arange(0, 10, 1 / rate)
    begins, below = np.clip(time, 0, 1), [0.4 - point.at_m[1] for point in garment.points]
    points = hung(garment, time)
    for at, (point, low) in enumerate(zip(garment.points, below, strict=True)):
        points[:, at, 1] += begins * 0.1 * np.sin(2 * np.pi * hz * (time - 0.3 * low))
        points[:, at, 1] += begins * flutter * low * np.sin(27 * time + 9 * point.at_m[0] + 5 * low)
    points += np.random.default_rng(seed).normal(0, noise, points.shape)
    return take_of(garment, time, np.zeros((len(time), 3)), points.round(5))


@pytest.mark.parametrize("rate", [20, 30])
def test_a_copy_in_other_axes_whose_beginning_is_cut_off_is_known(rate):
    """Its smoothed positions are interpolated between those of the other, where quick motion is curved."""
    take = lively(rate, hz=0.9)
    assert left(take, part(turned(take), slice(41, None))) < 0.1
    assert left(take, part(turned(take), slice(rate * 10 // 3, None))) < 0.1


def test_a_copy_in_other_axes_is_known_whatever_its_frames_are_on_the_clock():
    """The clock of a slow camera jitters. A part that is cut off moves the instants at which the copy is read."""
    whole = lively(60, hz=0.7)
    take = part(whole, np.sort(np.random.default_rng(5).choice(600, 150, replace=False)))
    assert left(take, part(turned(take), slice(33, None))) < 0.25


@pytest.mark.parametrize("step", [3e-4, 1e-3])
def test_a_copy_of_a_slow_take_is_known_when_it_is_rounded(step):
    """Rounding leaves a twelfth of the noise that counts, whatever the axes were before."""
    take = lively(10, hz=0.7)
    for copy in (take, turned(take)):
        copy = other_places(copy, (copy.points / step).round() * step)
        assert left(take, copy) == pytest.approx(1 / 12, rel=0.4)


def test_rounding_to_more_than_1_mm_counts_as_1_mm():
    """Rounded to 5 mm, two recordings of one motion leave (25 + 25) / 12 of the noise that counts, and theirs."""
    one, other = (lively(10, seed, hz=0.7) for seed in (1, 2))
    rounded = [other_places(take, (take.points * 200).round() / 200) for take in (one, other)]
    assert left(*rounded) > 0.7


@pytest.mark.parametrize("rate", [10, 20, 25, 30])
def test_lively_motion_that_a_machine_repeats_is_no_copy(rate):
    """Motion passes for noise in sixth differences of up to 25 frames a second."""
    for noise in (3e-4, 1e-3):
        one, other = lively(rate, 1, noise), lively(rate, 2, noise)
        assert left(one, other) > 0.25
        assert left(one, turned(other)) > 0.25


def test_noise_that_taps_magnify_is_no_noise_of_a_copy():
    """Motion of low frequency leaves the taps free to undo a filter, which magnifies the noise that counts."""
    one, other = (lively(10, seed, 3e-4, hz=0.5, flutter=0.0) for seed in (1, 2))
    assert left(one, smoothed(other, 4.0)) > 0.5


def test_positions_beside_a_gap_of_the_copy_do_not_count():
    take = lively(30, hz=0.9)
    gap = (np.arange(300) > 150) & (np.arange(300) < 185)
    copy = turned(take)
    points = np.where(gap[:, None, None], np.nan, copy.points)
    copy = dataclasses.replace(copy, points=points, points_valid=copy.points_valid & ~gap[:, None])
    assert left(take, copy) < 0.25


def test_positions_are_smoothed_as_lines_from_frame_to_frame_whatever_the_clock():
    """Against sums over a fine clock; a straight motion stays straight."""
    random = np.random.default_rng(8)
    time = np.sort(random.uniform(0, 3, 60))
    time[0] = 0.0
    places = random.normal(size=(60, 1, 3))
    motion, fine = Motion(time, places, np.ones((60, 1), bool)), np.arange(-2, 6, 1e-3)
    found = motion.smoothed(np.array([0]), 0.2).positions[:, 0]
    at = 0.1 * np.arange(len(found))
    bells = np.exp(-((at[:, None] - fine) ** 2) / (2 * 0.2**2))
    wanted = bells @ np.stack([np.interp(fine, time, places[:, 0, k]) for k in range(3)], 1)
    assert found == pytest.approx(wanted / bells.sum(1)[:, None], abs=2e-3)
    straight = Motion(time, time[:, None, None] * np.ones(3), np.ones((60, 1), bool))
    inner = straight.smoothed(np.array([0]), 0.2)
    middle = (at > 0.8) & (at < time[-1] - 0.8)
    assert inner.positions[middle, 0, 0] == pytest.approx(at[middle], abs=1e-5)


def test_a_pause_may_last_ten_times_as_long_as_the_frames():
    take = recorded()
    for pause, is_known in ((8, True), (11, False)):
        later = take.time + np.where(take.time > 0.5, pause * take.time[-1], 0.0)
        assert Motion(later, take.points, take.points_valid).can_be_compared == is_known


def test_a_point_seen_in_no_frame_of_a_rising_clock_is_not_compared():
    take = recorded()
    time, seen = take.time.copy(), take.points_valid.copy()
    time[50] = time[10]
    seen[:, 1] = np.arange(len(time)) == 50
    motion = Motion(time, take.points, seen)
    assert noise_left(motion, motion, np.arange(3)) < 1e-6


def test_cloth_at_rest_and_short_pieces_give_no_evidence():
    still = recorded(amplitude=0.0)
    assert left(still, turned(still)) == math.inf
    take = recorded(garment=sheet(grid=4))
    for seconds, is_known in ((1.8, False), (3.0, True)):
        assert (left(take, part(turned(take), slice(60, 60 + int(30 * seconds)))) < 0.25) == is_known


@pytest.mark.parametrize("time", [np.zeros(0), np.zeros(1), np.zeros(20), np.r_[np.arange(40) / 30, 1e9]])
def test_takes_whose_clock_does_not_go_on_are_not_compared(time):
    motion = Motion(time, np.zeros((len(time), 1, 3)), np.ones((len(time), 1), bool))
    assert noise_left(motion, motion, np.array([0])) == math.inf


@pytest.mark.parametrize("times", [1e-9, 0.9 / 20, 21.0, 1e9])
def test_takes_of_far_apart_rates_are_not_compared(times):
    """A clock in other units than stated would ask for memory without bound."""
    take, points = recorded(), np.arange(3)
    other = Motion(take.time * times, take.points, take.points_valid)
    own = Motion(take.time, take.points, take.points_valid)
    assert noise_left(other, own, points) == noise_left(own, other, points) == math.inf
    assert noise_left(own, own, points) < 1e-6


def test_a_few_frames_are_not_compared():
    for count in (2, 3, 5, 9):
        piece = part(recorded(), slice(60, 60 + count))
        assert left(piece, piece) == math.inf


def test_a_copy_in_other_axes_is_known_after_the_archive(tmp_path):
    take = read_take(write_take(tmp_path / "a.mcap", recorded()))
    copy = read_take(write_take(tmp_path / "b.mcap", turned(take)))
    assert are_copies(Track(take), Track(copy))


@pytest.mark.skipif(not REAL, reason="the real recordings are not here")
@pytest.mark.parametrize("files", [REAL[::5], pytest.param(REAL, marks=pytest.mark.slow)])
def test_real_takes_of_one_cloth_are_no_copies_and_are_known_in_other_axes(files):
    takes = [import_swung_cloth(file) for file in files]
    assert all(left(*pair) > 100 for pair in itertools.combinations(takes, 2))
    assert all(are_copies(Track(take), Track(turned(take))) for take in takes)
