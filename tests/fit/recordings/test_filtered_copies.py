"""Copies of a recording whose every place has changed, and other recordings of the same motion."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, median_filter

from fit.recordings.copies import Track, are_copies, share_places
from fit.recordings.filtered_copies import LEAST_TIME, Motion, noise_left
from formats.archive import read_take, write_take
from formats.importers.swung_cloth import import_swung_cloth
from tests.fit.recordings.test_copies import part, recorded, with_lost
from tests.fit.scenes import sheet
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
def test_a_recording_whose_every_place_has_changed_is_known_by_its_noise(change):
    take = recorded(noise=2e-3)
    copy = COPIES[change](take)
    assert are_copies(Track(take), Track(copy))
    assert are_copies(Track(copy), Track(take))
    assert not share_places(Track(take), Track(copy))


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 3e-3])
def test_recordings_of_one_motion_leave_the_noise_of_both(noise):
    """q is 1, by chance within a quarter of it: some 160 independent numbers have a deviation of sqrt(2 / 160)."""
    one, other = recorded(noise=noise), recorded(noise=noise, seed=7)
    assert left(one, other) == pytest.approx(1.0, abs=0.35)
    assert left(one, turned(other)) == pytest.approx(1.0, abs=0.35)
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


def test_frames_that_are_held_are_one_frame_and_slow_takes_are_known_in_other_axes_alone():
    """At 15 frames a second, each of them twice, a swing would pass for noise."""
    one, other = (part(recorded(noise=2e-3, seed=seed), np.repeat(np.arange(0, 150, 2), 2)) for seed in (1, 2))
    held = [dataclasses.replace(take, time=recorded().time) for take in (one, other)]
    assert Track(held[0]).motion.interval == pytest.approx(1 / 15)
    assert left(held[0], turned(held[0])) < 0.25
    assert left(held[0], smoothed(held[0], 1.0)) > 0.25
    assert left(*held) > 100


def test_cloth_at_rest_and_short_pieces_tell_nothing():
    still = recorded(amplitude=0.0)
    assert left(still, turned(still)) == math.inf
    take = recorded(garment=sheet(grid=4))
    for seconds, is_known in ((LEAST_TIME - 0.2, False), (LEAST_TIME + 1.0, True)):
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
    assert noise_left(own, own, points) < 1e-9


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
