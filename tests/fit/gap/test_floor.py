"""The noise floor: measured on the takes whatever they state, and not increased by a wrong model."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap import floor as floors
from fit.gap.floor import Floor, measured_noise, neighbour_noise, noise_floor, noisier, own_noise_mm
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.noise import held_noise
from fit.recordings.recording import prepare
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, truth_vector
from tests.fit.gap.test_gap_statistics import a_still_take

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
    assert np.median(noise) == pytest.approx(0.004, rel=0.01)  # as much as is stated is accepted


def seen(observer):
    return observer, observer.residuals(truth_vector()[None], observer.off[None])[0]


def test_the_points_own_noise_is_that_of_the_points_that_are_judged():
    """Of 25 points the five on the edge are not: with 2 mm there and 1 mm below, sqrt(3) mm."""
    observer = observer_of()
    noise = np.where(observer.recordings[0].judged, 0.001, 0.002)
    assert own_noise_mm(observer, [noise]) == pytest.approx(np.sqrt(3))
    mixed = np.where(np.arange(25) < 15, 0.001, 0.002)
    assert own_noise_mm(observer, [mixed]) == pytest.approx(np.sqrt(3 * (1 + 4) / 2))


@pytest.mark.parametrize(("own", "expected"), [(3.0, 9.0), (2.0, (16 + 7 + 0.61) / 3)])
def test_the_floor_is_the_growth_of_squares_or_the_points_own_noise_and_what_a_silhouettes_row_keeps(
    monkeypatch, own, expected
):
    """Noise makes 3 mm 5, 4 and 3.1: 7.87 mm^2 on average, or the points' own 9 or 4. The row is off by 4 mm."""
    shaken = [np.array([5.0]), np.array([4.0]), np.array([3.1])]
    off = SimpleNamespace(
        counted=np.ones((2, 1), bool), camera=SimpleNamespace(row_off=0.004), point_sd=np.array([1.0])
    )
    observer = SimpleNamespace(
        recordings=[off], residuals=lambda vectors, amplitudes: np.array([[3.0]]), in_mm=lambda row: float(row[0]),
        of=lambda recordings: observer,
    )  # fmt: skip
    monkeypatch.setattr(floors, "measured_noise", lambda observer, residual: [np.array([1e-3 * own / np.sqrt(3)])])
    monkeypatch.setattr(floors, "noisier", lambda recording, noise, rng: recording)
    monkeypatch.setattr(floors, "residuals_together", lambda asked: [row[None] for row in shaken])
    found = noise_floor(observer, np.zeros(1), np.zeros(1), np.random.default_rng(1))
    each = np.sqrt(np.maximum([16.0, 7.0, 0.61], own**2) + 16.0)
    assert found.mm == pytest.approx(np.sqrt(expected + 16.0))
    assert found.error_mm == pytest.approx(np.sqrt(((each - each.mean()) ** 2).sum() / 2 / 3))
    assert found.measured_mm == pytest.approx(own)


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


@pytest.mark.parametrize(("stated", "is_contradicted"), [(2.49, False), (2.51, True), (1.61, False), (1.59, True)])
def test_a_stated_noise_is_contradicted_by_a_quarter(stated, is_contradicted):
    assert Floor(9.0, 0.1, 2.0, stated).is_contradicted == is_contradicted


def stilled(monkeypatch, places):
    """A model whose cloth hangs still at positions [m], (points, 3): nothing is simulated."""

    def still(asked, *, frequency=None):
        return [
            [np.repeat(places[None, None], len(r.time), 1).repeat(len(vectors), 0) for r in observer.recordings]
            for observer, vectors, _ in asked
        ]

    monkeypatch.setattr("fit.observer.residuals.trajectories_together", still)


def test_the_floor_is_the_mean_over_three_replicas_and_has_their_standard_error(monkeypatch):
    """Each replica says |r + n|^2 - |r|^2, with the noise drawn again as it is drawn there; the own noise is less."""
    recording = a_still_take(NOISE, rate=30, seconds=1.0)
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    stilled(monkeypatch, recording.points.mean(0))
    judged, sd = recording.judged, recording.point_sd
    (noise,) = measured_noise(observer, observer.residuals(truth_vector()[None], observer.off[None])[0])
    own = 1e3 * np.sqrt(3 * (noise[judged] ** 2).mean())
    rng, apart = np.random.default_rng(3), recording.points - recording.points.mean(0)
    floors, shown = [], []
    for _ in range(3):
        more = apart + rng.normal(size=apart.shape) * noise[:, None]
        rng.normal(size=recording.held_seen.shape)
        grown = [1e6 * (a[:, judged] ** 2).sum(2).mean() for a in (more, apart)]
        shown.append(grown[0] - grown[1])
        floors.append(np.sqrt(max(shown[-1], own**2)))
    assert len(set(floors)) == 3  # none of this seed is no more than the own noise
    found = floor_of(observer, seed=3)
    assert np.mean(shown) != pytest.approx(own**2, rel=0.01)
    assert found.mm == pytest.approx(np.sqrt(max(np.mean(shown), own**2)), rel=1e-6)
    assert found.error_mm == pytest.approx(np.std(floors, ddof=1) / np.sqrt(3), rel=1e-6)
    assert found.measured_mm == pytest.approx(own, rel=1e-6)
    assert found.stated_mm == pytest.approx(1e3 * np.sqrt(3 * (sd[judged] ** 2).mean()), rel=1e-6)


@pytest.mark.parametrize(
    ("white", "independent", "stated", "expected"),
    [
        ([2.0, 2.0, 8.0], 4.0, 0.5, [3.0, 3.0, 8.0]),  # at most 1.5 times the white noise, at least that
        ([2.0, 2.0, 8.0], 2.4, 0.5, [2.4, 2.4, 8.0]),
        ([2.0, 2.0, 8.0], 4.0, 3.6, [3.6, 3.6, 8.0]),  # as much as is stated is accepted
        (None, 2.0, 1.8, [1.8, 1.8, 1.8]),  # frames too slow to show white noise
        ([1.0, 2.0, 3.0], None, 1.8, [1.8, 2.0, 3.0]),  # too few neighbours
    ],
)
def test_the_noise_of_a_point_lies_between_its_white_noise_and_half_as_much_again(
    monkeypatch, white, independent, stated, expected
):
    seen = None if white is None else np.array(white)
    for place in ("fit.gap.floor.white_noise", "fit.recordings.noise.white_noise"):
        monkeypatch.setattr(place, lambda recording: seen)
    monkeypatch.setattr("fit.gap.floor.neighbour_noise", lambda observer, residual: [independent])
    seen_for = np.ones((9000, 3), bool)  # five minutes: no chance is left
    take = SimpleNamespace(point_sd=np.full(3, stated), valid=seen_for, time=np.arange(9000) / 30, duration=300.0)
    observer = SimpleNamespace(recordings=[take])
    assert measured_noise(observer, np.zeros(3))[0] == pytest.approx(expected)


def test_a_take_that_shows_no_noise_has_that_of_the_others(monkeypatch):
    """Two slow takes, one of which does not begin at rest: the median of the other, and what neighbours show."""
    white = {"rests": np.array([1.0, 2.0, 3.0]), "moves": None}
    monkeypatch.setattr("fit.gap.floor.white_noise", lambda recording: white[recording.take_id])
    monkeypatch.setattr("fit.gap.floor.neighbour_noise", lambda observer, residual: [2.5, 2.5])
    takes = [SimpleNamespace(take_id=name, point_sd=np.full(3, 0.5)) for name in white]
    found = measured_noise(SimpleNamespace(recordings=takes), np.zeros(3))
    assert found[0] == pytest.approx([1.5, 2.5, 3.0])
    assert found[1] == pytest.approx([2.5, 2.5, 2.5])


def test_the_points_own_noise_is_weighed_by_how_often_each_was_seen():
    """1 mm in 10 sightings, 2 in 30 and 3 in 20 of another take: sqrt(3 (10 + 120 + 180) / 60) mm."""
    first = np.stack([np.arange(30) < 10, np.ones(30, bool)], 1)
    observer = SimpleNamespace(recordings=[SimpleNamespace(counted=c) for c in (first, np.ones((20, 1), bool))])
    noise = [np.array([0.001, 0.002]), np.array([0.003])]
    assert own_noise_mm(observer, noise) == pytest.approx(np.sqrt(3 * 310 / 60))


def gridded(values, places):
    """An observer of points at positions of a flat grid whose residuals are these, (frames, points, 3) [m]."""
    points = [SimpleNamespace(at_m=at) for at in places]
    recording = SimpleNamespace(judged=np.ones(len(places), bool), garment=SimpleNamespace(points=points))
    return SimpleNamespace(
        recordings=[recording], layout=SimpleNamespace(metres=lambda r: r), by_place=lambda r: [values]
    )


def test_noise_is_what_a_point_has_that_the_middle_of_its_neighbours_has_not():
    """2 mm of noise beside an error that is linear over the grid; frames without a neighbour say nothing."""
    places = [(0.1 * x, -0.1 * y) for y in range(5) for x in range(5)]
    rng = np.random.default_rng(0)
    smooth = 0.05 * np.array(places).sum(1)[None, :, None] * np.sin(np.arange(400))[:, None, None]
    values = smooth + rng.normal(0, 0.002, (400, 25, 3))
    assert neighbour_noise(gridded(values, places), values)[0] == pytest.approx(0.002, rel=0.03)
    values[rng.random((400, 25)) < 0.2] = np.nan
    assert neighbour_noise(gridded(values, places), values)[0] == pytest.approx(0.002, rel=0.03)
    values[1:, :10] = np.nan
    assert neighbour_noise(gridded(values, places), values)[0] == pytest.approx(0.002, rel=0.05)


def test_at_least_nine_points_with_neighbours_say_how_noisy_they_are():
    """Of eleven points in a row nine are between two others; of ten eight."""
    values = np.random.default_rng(0).normal(0, 0.002, (900, 11, 3))
    row = [(0.1 * k, 0.0) for k in range(11)]
    assert neighbour_noise(gridded(values, row), values)[0] == pytest.approx(0.002, rel=0.1)
    assert neighbour_noise(gridded(values[:, 1:], row[1:]), values) == [None]


def test_a_take_without_noise_states_more_than_is_measured():
    assert Floor(1.0, 0.0, 0.0, 1.0).is_contradicted
    assert Floor(1.0, 0.0, 1.0, 0.0).is_contradicted


def test_points_and_hanger_have_their_noise_once_more():
    recording = a_still_take(NOISE, rate=30, seconds=1.0)
    seen = recording.held_seen + np.random.default_rng(1).normal(0, 1e-3, recording.held_seen.shape)
    noisy = recording.with_held(seen)
    found = noisier(noisy, np.linspace(0.001, 0.002, 25), np.random.default_rng(5))
    rng = np.random.default_rng(5)
    points = rng.normal(size=recording.points.shape) * np.linspace(0.001, 0.002, 25)[:, None]
    assert found.points - noisy.points == pytest.approx(points)
    assert found.held_seen - seen == pytest.approx(rng.normal(size=seen.shape) * held_noise(noisy))
    assert held_noise(noisy).mean() == pytest.approx(1e-3, rel=0.3)
