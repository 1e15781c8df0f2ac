"""The noise floor: measured on the takes, whatever they state, and never larger because a model is wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.floor import Floor, measured_noise, noise_floor, own_noise_mm
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, truth_vector

NOISE = 0.0011  # m, per axis: 1.9 mm of distance


def observer_of(*, stated=NOISE, grid=5, slow=0.0, rate=30, seed=2):
    """A take of the model itself with white noise and, where asked for, noise that lasts a second."""
    take = a_take(noise=NOISE, grid=grid, seed=seed)
    rng = np.random.default_rng(seed)
    shape = take.points.shape
    lasting = np.repeat(rng.normal(0, slow, (4, *shape[1:])), 30, axis=0)[: shape[0]]
    given = dataclasses.replace(take, points=take.points + lasting, points_sd=np.full(shape, stated))
    return Observer([prepare(given)], SI, (), frequency=0.0, resolution=COARSE)


def floor_of(observer, seed=7):
    return noise_floor(observer, truth_vector(), observer.off, np.random.default_rng(seed))


@pytest.mark.parametrize(("stated", "is_contradicted"), [(0.0025, True), (NOISE, False), (0.0003, True)])
def test_the_floor_is_what_a_grid_shows_and_not_what_a_take_states(stated, is_contradicted):
    """2.5 or 0.3 mm stated where it is 1.1 per axis, 1.9 mm of distance: a perfect model leaves that."""
    observer = observer_of(stated=stated)
    floor = floor_of(observer)
    error = float(observer.in_mm(observer.residuals(truth_vector()[None], observer.off[None])[0]))
    assert floor.mm == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.1)
    assert error == pytest.approx(floor.mm, rel=0.1)
    assert floor.stated_mm == pytest.approx(1e3 * stated * np.sqrt(3), rel=0.01)
    assert floor.measured_mm == pytest.approx(floor.mm, rel=0.1)
    assert floor.is_contradicted == is_contradicted
    assert 0.0 <= floor.error_mm < 0.1 * floor.mm


def test_a_stated_noise_is_what_there_is_to_go_by_where_points_are_few():
    """Five points have no neighbours, and what is slow in them no difference of frames shows."""
    (noise,) = measured_noise(*seen(observer_of(stated=0.0025, grid=None)))
    assert noise == pytest.approx(np.full(5, 0.0025))
    (noise,) = measured_noise(*seen(observer_of(stated=0.0003, grid=None)))
    assert noise == pytest.approx(np.full(5, NOISE), rel=0.35)


def test_slow_noise_counts_and_wrinkles_that_the_mesh_lacks_do_not():
    """1.1 mm of white noise and 1 mm that lasts a second are 1.49 mm; 5 mm that last are taken for 1.5 times 1.1."""
    (noise,) = measured_noise(*seen(observer_of(slow=0.001)))
    assert np.median(noise) == pytest.approx(0.00149, rel=0.12)
    (noise,) = measured_noise(*seen(observer_of(slow=0.005)))
    assert np.median(noise) == pytest.approx(1.5 * NOISE, rel=0.12)
    (noise,) = measured_noise(*seen(observer_of(slow=0.005, stated=0.004)))
    assert np.median(noise) == pytest.approx(0.004, rel=0.01)  # as much as is stated is believed


def seen(observer):
    return observer, observer.residuals(truth_vector()[None], observer.off[None])[0]


def test_the_points_own_noise_is_that_of_the_points_that_are_judged():
    """Of 25 points the five on the edge are not: with 2 mm there and 1 mm below, sqrt(3) mm."""
    observer = observer_of()
    noise = np.where(observer.recordings[0].judged, 0.001, 0.002)
    assert own_noise_mm(observer, [noise]) == pytest.approx(np.sqrt(3))
    mixed = np.where(np.arange(25) < 15, 0.001, 0.002)
    assert own_noise_mm(observer, [mixed]) == pytest.approx(np.sqrt(3 * (1 + 4) / 2))


def test_the_floor_of_a_model_that_is_far_off_is_no_less_than_the_points_own_noise():
    """Errors of 50 mm beside noise of 1.1: what more noise adds to them is chance, and may be negative."""
    observer = observer_of()
    (recording,) = observer.recordings
    moved = recording.points + 0.05 * np.sin(7.0 * recording.time)[:, None, None]
    far = Observer([recording.with_points(moved)], SI, (), frequency=0.0, resolution=COARSE)
    own = own_noise_mm(far, measured_noise(far, far.residuals(truth_vector()[None], far.off[None])[0]))
    for seed in range(3):
        assert floor_of(far, seed).mm >= 0.999 * own
    assert own == pytest.approx(1e3 * NOISE * np.sqrt(3), rel=0.1)


@pytest.mark.parametrize(("stated", "is_contradicted"), [(2.49, False), (2.51, True), (1.59, True)])
def test_a_stated_noise_is_contradicted_by_a_quarter(stated, is_contradicted):
    assert Floor(9.0, 0.1, 2.0, stated).is_contradicted == is_contradicted
