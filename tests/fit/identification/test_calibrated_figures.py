"""The figures of a fit, each computed from the distances of an engine whose every point is known."""

from __future__ import annotations

import dataclasses
import itertools
import re
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.errors import BlowUpError
from fit.identification import calibrate as calibration
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from fit.search.intervals import Intervals
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
    """A fit of a few iterations, the arguments of its search, and the candidates that the search requested."""
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


def a_known_fit(monkeypatch, changed=lambda take: take, method="lean", **more):
    """A fit of one take to an engine that knows the points, with any request."""
    figure = ErrorFigure(mean_m=1.0, max_m=1.0, per_frame_m=[1.0], time_s=[0.0])
    rigid = TrivialFigure(name="vertical", parameters={}, train=figure, held_out=figure)
    monkeypatch.setattr(calibration, "find_engine", lambda name: Noisy)
    monkeypatch.setattr(calibration, "trivial_figures", lambda model, judge: [rigid])
    given = {"iterations": 6, "seed": 2, "spacing": 0.1, "search": "annealing", "effects": []} | more
    request = request_of(find_method(method), given.pop("effects"), **given)
    return calibrate([changed(a_take("a"))], [], request)


class Noisy:
    """An engine whose points are a millimetre off, and infinite for one candidate in `broken`."""

    version, broken = "1", ()

    def __init__(self, recording, method, effects, resolution):
        self._points = recording.points + 1e-3 * np.random.default_rng(0).normal(size=recording.points.shape)
        self._asked = 0

    def points(self, vectors):
        points = np.repeat(self._points[None], len(vectors), axis=0)
        for k in range(len(vectors)):
            self._asked += 1
            if self._asked in self.broken:
                points[k] = np.nan
        return points


def test_a_fit_states_what_it_was_asked_and_what_came_of_it(monkeypatch):
    result = a_known_fit(monkeypatch, method="lean", effects=["hem"], spacing=0.12)
    assert (result.method, result.engine, result.search, result.seed) == ("lean", "own", "annealing", 2)
    assert (result.spacing, result.take_ids, result.held_out_ids) == (0.12, ["a"], [])
    assert (result.garment, result.layers, result.format) == ("sheet", 1, "hangtime-fit/1")
    assert list(result.effects) == ["hem"]
    assert result.effects["hem"] == result.parameters[-1].fitted
    lean = find_method("lean")
    for shown, asked in zip(result.parameters, lean.parameters, strict=False):
        assert (shown.name, shown.unit, shown.note) == (asked.name, asked.unit, asked.meaning)
        assert (shown.initial, shown.minimum, shown.maximum) == (asked.initial, asked.minimum, asked.maximum)
    weighed = a_take("a").garment.areal_density
    assert result.material["areal_density"] == pytest.approx(weighed)
    assert result.error.held_out_after is None
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", result.created)


def test_annealing_says_that_its_gamma_is_a_choice_in_the_unit_of_its_objective(monkeypatch):
    (told,) = [note for note in a_known_fit(monkeypatch, gamma=5e4).notes if "gamma" in note]
    assert told == "gamma = 50000 per metre is our choice; the paper gives none."
    assert not [note for note in a_known_fit(monkeypatch, search="cma-es").notes if "gamma" in note]
    assert [note for note in a_known_fit(monkeypatch, search="restarts").notes if "gamma" in note]


def test_candidates_that_blew_up_are_counted(monkeypatch):
    monkeypatch.setattr(Noisy, "broken", (3, 5))
    assert "2 candidates blew up and were rejected." in a_known_fit(monkeypatch, iterations=12, search="cma-es").notes
    monkeypatch.setattr(Noisy, "broken", ())
    assert not [note for note in a_known_fit(monkeypatch, search="cma-es").notes if "blew up" in note]


def test_the_layers_of_a_t_shirt_are_noted_unless_the_method_knows_them(monkeypatch):
    def shirt(take):
        return dataclasses.replace(take, garment=msgspec.structs.replace(take.garment, kind="t-shirt"))

    for method, is_noted in (("si", True), ("si-sewn", False)):
        notes = a_known_fit(monkeypatch, shirt, method=method).notes
        assert any(note.startswith("Sleeves and hems are layers") for note in notes) == is_noted
    assert not any(note.startswith("Sleeves") for note in a_known_fit(monkeypatch, method="si").notes)


def test_another_simulators_numbers_claim_no_material(monkeypatch):
    result = a_known_fit(monkeypatch, method="kinect-skirt", engine="blender")
    assert (result.material, result.combinations, result.engine) == ({}, [], "blender")
    (told,) = [note for note in result.notes if note.startswith("Simulated by")]
    assert told == "Simulated by blender; its numbers have no SI values, so no combinations are given."
    own = a_known_fit(monkeypatch, method="kinect-skirt-weighed")
    assert own.material
    assert own.combinations
    assert not any(note.startswith("Simulated by") for note in own.notes)


def test_a_first_candidate_that_blows_up_ends_the_search_and_a_later_one_does_not(monkeypatch):
    monkeypatch.setattr(Noisy, "broken", (1,))
    with pytest.raises(BlowUpError, match=r"^a: the simulation of the initial parameters blew up; use a coarser mesh"):
        a_known_fit(monkeypatch)


def test_a_saved_search_is_of_all_that_decides_its_path(monkeypatch):
    model = SimpleNamespace(
        request=request_of(find_method("lean"), ["hem"], iterations=6, seed=2, spacing=0.12, bounds=["hem=0:0.02"]),
        engines=[SimpleNamespace(version="5")],
    )
    monkeypatch.setattr(calibration, "physics_version", lambda: "p")
    assert calibration._key(["c"], model) == {
        "takes": ["c"], "method": "lean", "seed": 2, "search": "annealing", "effects": ["hem"], "spacing": 0.12,
        "bounds": [["hem", 0.0, 0.02]], "initial": [*find_method("lean").initial, 0.0], "engine": "own",
        "engine_version": "5", "physics": "p",
    }  # fmt: skip


def test_a_search_is_saved_every_ten_seconds(monkeypatch):
    """A clock that goes 4 s a candidate: saved after the third batch, the sixth and so on, and at the end."""
    instants, saves = itertools.count(0.0, 4.0), []
    monkeypatch.setattr(calibration, "clock", SimpleNamespace(monotonic=lambda: next(instants)))
    steps = iter(range(1, 8))
    search = SimpleNamespace(
        is_finished=False, is_started=True, ask=lambda width: np.zeros((1, 1)), iteration=1, best_distance=1.0,
        state=lambda: len(saves), best=np.zeros(1), best_history=[1.0], evaluations=7, non_finite=0,
    )  # fmt: skip

    def tell(candidates, distances):
        search.is_finished = next(steps) == 7

    search.tell = tell
    monkeypatch.setattr(calibration, "begin", lambda name, task: search)
    monkeypatch.setattr(calibration, "free_intervals", lambda *given: None)
    request = SimpleNamespace(parameters=[SimpleNamespace(initial=1.0, interval=1.0)], space=None, seed=0, width=1,
                              settings=SimpleNamespace(iterations=7), search="annealing")  # fmt: skip
    recording = SimpleNamespace(duration=3.0, take_id="a")
    model = SimpleNamespace(recordings=[recording] * 2, distances=lambda vectors: np.ones(1), points=None)
    saved = SimpleNamespace(read=lambda: None, save=saves.append)
    told = []
    found = calibration._ask_and_tell(model, request, saved, lambda *given: told.append((len(saves), given)))
    # The clock is read after each batch, and once more where it is set anew.
    assert [count for count, _ in told] == [0, 0, 0, 1, 1, 1, 2]
    assert len(saves) == 3
    assert told[0][1] == (1, 7, 1.0)
    assert found.simulations == 7 * 2


@pytest.mark.parametrize(("method", "name"), [("mocap-swatch", "E/N"), ("lean", "D")])
def test_least_squares_say_what_they_do_not_minimise_and_that_they_count_no_iterations(monkeypatch, method, name):
    """With what a search found: every second parameter is not identified, and the first is at its bound."""

    def found(model, request, saved, progress):
        initial = np.array([p.initial for p in request.parameters])
        count = len(initial)
        ends = np.stack([0.9 * initial, 1.1 * initial], 1)
        known = Intervals(ends, np.arange(count) % 2 == 1, np.eye(count), np.zeros(count), 2.0, np.arange(count) < 1)
        return calibration._Found(initial, known, [0.02, 0.01], 321, 4)

    monkeypatch.setattr(calibration, "_least_squares", found)
    grid = sheet(grid=4)

    def longer(take):
        time = np.arange(120) / 30
        path = swing(time, amplitude=0.05)
        return take_of(grid, time, path, hung(grid, time) + path[:, None], name="a")

    result = a_known_fit(monkeypatch, longer, method=method, search="least-squares", iterations=7)
    told = " ".join(result.notes)
    assert ("least-squares minimises the points' residuals; " in told) == (name != "D")
    assert (f"{name} is reported, not minimised." in told) == (name != "D")
    assert "4 candidates blew up and were rejected." in told
    assert (result.simulations, result.history) == (321, [0.02, 0.01])
    first, second, third, *_ = result.parameters
    assert (first.is_at_bound, second.is_at_bound) == (True, False)
    is_known = second.name not in find_method(method).degenerate
    assert (first.is_identified, second.is_identified, third.is_identified) == (False, is_known, False)
    assert (second.interval_low, second.interval_high) == pytest.approx((0.9 * second.initial, 1.1 * second.initial))
    assert f"At its bound: {first.name}." in told
    free = [p.name for p in result.parameters if not (p.is_identified or p.is_at_bound)]
    assert third.name in free
    assert f"Not identified: {', '.join(free)}." in told
    assert "gamma" not in told
    usual = a_known_fit(monkeypatch, longer, method=method, search="least-squares", iterations=350)
    assert "number of iterations" not in " ".join(usual.notes)
