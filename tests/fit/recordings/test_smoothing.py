"""Smooth curves through noisy frames against their transfer functions, and what they leave of noise in the cloth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.hanger_noise import cubic
from fit.cloth.simulator import Simulator
from fit.gap.floor import noise_floor
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.noise import held_noise
from fit.recordings.recording import prepare
from fit.recordings.smoothing import best_cut_off, low_pass, smoothing_spline, steady_spline
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
    """Points without noise under a hanger with noise: the floor is what the noise shakes, within a third."""
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
    floor = noise_floor(observer, vector, observer.off, np.random.default_rng(2)).mm
    assert error > 0.5
    assert floor == pytest.approx(error, rel=0.35)
