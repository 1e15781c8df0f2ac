"""The figures of a fit, each computed from the distances of an engine whose every point is known."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.identification import calibrate as calibration
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from formats.fit_records import ErrorFigure, TrivialFigure
from tests.fit.scenes import hung, sheet, swing, take_of

METHOD = find_method("kinect-skirt-weighed")
FRAMES = {"a": 90, "b": 120, "c": 100}  # of two takes to fit to, and of one to judge on
SIZE = {"a": 1.0, "b": 2.0, "c": 5.0}  # times a millimetre of noise


def apart(take, vector):
    """How far the engine puts the points from where they were seen [m], (frames, points, 3)."""
    rng = np.random.default_rng(sorted(FRAMES).index(take))
    shape = (FRAMES[take], len(sheet().points), 3)
    noise, slopes = 1e-3 * SIZE[take] * rng.normal(size=shape), rng.normal(size=(len(METHOD.parameters), *shape))
    share = (vector - METHOD.initial) / (METHOD.maximum - METHOD.minimum) - 0.4
    return noise + 0.01 * np.tensordot(share, slopes, 1)


def expected(take, vector):
    """The mean distance of the points in each frame [m]; the first point was not seen in the first ten frames."""
    lengths = np.linalg.norm(apart(take, vector), axis=2)
    lengths[:10, 0] = np.nan
    return np.nanmean(lengths, axis=1)


class Known:
    """An engine behind the contract of `fit.engines.contract` that counts the candidates of each take."""

    version = "1"
    asked = 0

    def __init__(self, recording, method, effects, resolution):
        self._take, self._points = recording.take_id, np.nan_to_num(recording.points)

    def points(self, vectors):
        Known.asked += len(vectors)
        return np.stack([self._points + apart(self._take, vector) for vector in vectors])


def a_take(name):
    time = np.arange(FRAMES[name]) / 30
    path, garment = swing(time, amplitude=0.05 + 0.01 * sorted(FRAMES).index(name)), sheet()
    take = take_of(garment, time, path, hung(garment, time) + path[:, None], name=name)
    points, seen = take.points.copy(), take.points_valid.copy()
    points[:10, 0], seen[:10, 0] = np.nan, False
    return dataclasses.replace(take, points=points, points_valid=seen)


def fitted_by(search):
    """A fit of a few iterations, what the search was begun with, and the candidates that it asked for."""
    figure = ErrorFigure(mean_m=1.0, max_m=1.0, per_frame_m=[1.0], time_s=[0.0])
    rigid = TrivialFigure(name="vertical", parameters={}, train=figure, held_out=figure)
    begun, counts = [], []
    request = request_of(METHOD, [], iterations=12, seed=2, spacing=0.1, search=search)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "find_engine", lambda name: Known)
        patch.setattr(calibration, "trivial_figures", lambda model, judge: [rigid])
        begin = calibration.begin
        patch.setattr(calibration, "begin", lambda name, task: begun.append(task) or begin(name, task))

        def start():
            Known.asked = 0

        held_out = [a_take("c")]
        result = calibrate(
            [a_take("a"), a_take("b")], held_out, request,
            begun=start, progress=lambda done, total, best: counts.append(Known.asked),
        )  # fmt: skip
    return result, begun[0], counts[-1] - 1  # the held-out take is simulated once before the search


@pytest.fixture(scope="module", params=["annealing", "tempering"])
def fit(request):
    return fitted_by(request.param)


def initial_and_fitted(result):
    return np.array([p.initial for p in result.parameters]), np.array([p.fitted for p in result.parameters])


def test_errors_are_means_over_all_frames_of_the_takes_fitted_to_and_of_the_one_held_out(fit):
    result, _, _ = fit
    for vector, train, held_out in zip(
        initial_and_fitted(result), (result.error.train_before, result.error.train_after),
        (result.error.held_out_before, result.error.held_out_after), strict=True,
    ):  # fmt: skip
        both = np.concatenate([expected("a", vector), expected("b", vector)])
        assert train.per_frame_m == pytest.approx(both.tolist())
        assert (train.mean_m, train.max_m) == pytest.approx((both.mean(), both.max()))
        assert np.diff(train.time_s).max() == pytest.approx(1.0)  # between both takes
        assert np.diff(train.time_s).min() == pytest.approx(1 / 30)
        assert held_out.mean_m == pytest.approx(expected("c", vector).mean())


def test_the_objective_is_the_mean_of_the_takes_distances_and_its_history_ends_at_the_fits(fit):
    result, task, asked = fit
    before, after = (
        np.mean([expected(take, vector).mean() for take in ("a", "b")]) for vector in initial_and_fitted(result)
    )
    assert after < before
    assert (result.objective.before, result.objective.after) == pytest.approx((before, after))
    assert result.objective.parts["distance"] == pytest.approx((before, after))
    assert (result.history[0], result.history[-1]) == pytest.approx((before, after))
    assert result.simulations == asked
    assert task.numbers == pytest.approx((89 + 119) / 30 / 0.5)  # half seconds of both takes


def test_the_note_on_a_trivial_predictor_is_on_the_take_held_out(fit):
    result, _, _ = fit
    _, fitted = initial_and_fitted(result)
    assert f"The fit misses by {1e3 * expected('c', fitted).mean():.1f} mm held out" in " ".join(result.notes)


def test_intervals_reach_to_both_sides_and_degenerate_parameters_are_not_identified(fit):
    """The points depend on all five; Air and Velocity are degenerate by the method's own map."""
    result, _, _ = fit
    assert [p.is_identified for p in result.parameters] == [True, True, True, False, False]
    assert all(p.interval_low < p.fitted < p.interval_high for p in result.parameters)


def test_the_history_of_least_squares_is_the_least_distance_so_far_of_every_candidate(monkeypatch):
    """Of 50 mm at first, a look at 40 and 60 and a descent under a pull, whose end alone is 30: four distances.

    The first candidate and the descent's end are simulated beside the search's own 10, on each of two takes.
    """
    free, pulled = ((0.04, 0.06), ()), iter([0.05, 0.03])
    model = SimpleNamespace(distances=lambda vectors: [next(pulled)], distances_of=None, recordings=[None, None])
    saved = SimpleNamespace(read=lambda: None, save=lambda state: None)

    def run(initial, settings, show, steps):
        for distances in free:
            show(SimpleNamespace(distances=distances, vector=initial, state=dict))
        return SimpleNamespace(simulations=10, vector=initial, intervals=None)

    search = SimpleNamespace(run=run), SimpleNamespace(steps=2)
    monkeypatch.setattr(calibration, "begin_observed", lambda *given: search)
    request = SimpleNamespace(parameters=[SimpleNamespace(initial=1.0)])
    told = []
    found = calibration._least_squares(model, request, saved, lambda *given: told.append(given))
    assert found.history == [0.05, 0.04, 0.04, 0.03]
    assert found.simulations == 10 + 2 * 2
    assert told == [(1, 2, 0.04), (2, 2, 0.03)]
