"""The problem that least squares gets: its observer, its pulls, its distances, and the settings of each search."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from fit.errors import FitError
from fit.identification import observed, problem, saved_search
from fit.identification.observed import SHORT_WINDOWS, begin_observed
from fit.identification.problem import ObservedProblem
from fit.identification.request import request_of
from fit.identification.saved_search import SavedSearch
from fit.identification.trials import ObservedSettings
from fit.methods import SI


@dataclasses.dataclass
class Seen:
    """A recording as far as a problem knows one."""

    name: str
    windows: object = None


class Watching:
    """An observer that records its pull, the vectors and the amplitudes, and what it was made with."""

    def __init__(self, recordings, method, effects, *, frequency, resolution):
        self.made, self.pull, self.asked = (recordings, method, effects, frequency, resolution), frequency, []
        self.layout = SimpleNamespace(block=np.arange(4))

    def with_frequency(self, pull):
        self.pull = pull
        return self

    def trajectories(self, vectors, amplitudes):
        self.asked.append((self.pull, vectors.shape, amplitudes.shape))
        return "points"

    def sound_residuals_of(self, points):
        assert points == "points"
        return np.ones((3, 7))


@pytest.fixture
def watching(monkeypatch):
    monkeypatch.setattr(problem, "Observer", Watching)


def test_a_problem_simulates_parameters_and_amplitudes_under_a_pull_and_knows_distances_of_free_cloth_alone(watching):
    told = []
    search = ObservedProblem(
        [Seen("a")], SI, ("hem",), "space", "mesh", windows="cut",
        distances=lambda points: told.append(points) or np.arange(3.0),
    )  # fmt: skip
    assert search.free.made == ([Seen("a", "cut")], SI, ("hem",), 0.0, "mesh")
    assert search.count == len(SI.parameters)
    vectors = np.zeros((3, len(SI.parameters) + 1))
    residuals, distances = search.simulate(vectors, 0.0)
    assert (residuals.shape, distances.tolist(), told) == ((3, 7), [0.0, 1.0, 2.0], ["points"])
    assert search.simulate(vectors, 1.5)[1].shape == (0,)
    assert search.free.asked == [(pull, (3, len(SI.parameters)), (3, 1)) for pull in (0.0, 1.5)]
    bare = ObservedProblem([Seen("a")], SI, (), "space", "mesh")
    assert bare.free.made[0] == [Seen("a")]
    assert bare.simulate(vectors[:, :-1], 0.0)[1].shape == (0,)


@pytest.mark.parametrize("name", ["least-squares", "short-windows"])
def test_each_search_has_its_windows_pulls_and_samples(watching, name):
    """Least squares samples 80 candidates in three trials at most; short windows descend under a pull of 3 Hz."""
    request = request_of(SI, ["hem"], iterations=1, seed=5, spacing=0.1, search=name)
    search, settings = begin_observed(request, [Seen("a")], "distances")
    is_short = name == "short-windows"
    (recordings, method, effects, frequency, resolution) = search.free.made
    assert recordings == [Seen("a", SHORT_WINDOWS if is_short else None)]
    assert (method, effects, frequency, resolution) == (SI, request.effects, 0.0, request.resolution)
    assert search.space is not None
    assert search._distances == (None if is_short else "distances")
    assert settings == (
        ObservedSettings(pulls=(3.0,), seed=5) if is_short else ObservedSettings(samples=80, trials=3, seed=5)
    )
    assert (SHORT_WINDOWS.free, SHORT_WINDOWS.caught) == (2.0, 0.5)


def test_a_search_is_run_with_what_it_is_given_and_refused_where_takes_are_short(watching, monkeypatch):
    given = []
    monkeypatch.setattr(observed, "Run", lambda *words: given.append(words) or SimpleNamespace(run=lambda: "found"))
    request = request_of(SI, [], iterations=1, seed=5, spacing=0.1, search="least-squares")
    search, settings = begin_observed(request, [Seen("a")], None)
    assert search.run("start", settings, "progress", ("known",)) == "found"
    assert given == [(search, "start", settings, "progress", ("known",))]
    search.run("start")
    assert given[1][2] == ObservedSettings()
    search.free.layout.block = np.array([0, 0, 1, 1])
    with pytest.raises(FitError, match="intervals need 3 half-seconds"):
        search.run("start")


def test_a_saved_search_counts_the_time_of_all_its_parts(monkeypatch, tmp_path):
    """Begun at 100 s and saved at 130 s, then begun again at 500 s and asked at 507 s."""
    instants = iter([100.0, 130.0, 500.0, 507.0, 600.0, 610.0])
    monkeypatch.setattr(saved_search, "clock", SimpleNamespace(monotonic=lambda: next(instants)))
    file = tmp_path / "c.json"
    SavedSearch(file, {"seed": 1}).save({"n": 3})
    assert json.loads(file.read_text()) == {"key": {"seed": 1}, "seconds": 30.0, "search": {"n": 3}}
    again = SavedSearch(file, {"seed": 1})
    assert again.read() == {"n": 3}
    assert again.seconds == pytest.approx(37.0)
    fresh = SavedSearch(tmp_path / "none.json", {})
    assert fresh.read() is None
    assert fresh.seconds == pytest.approx(10.0)


def test_without_a_file_nothing_is_saved_and_an_unreadable_or_foreign_one_is_refused(tmp_path):
    nowhere = SavedSearch(None, {})
    nowhere.save({"n": 3})
    assert nowhere.read() is None
    file = tmp_path / "c.json"
    for text in ("nothing", "[]", '{"search": {}}', '{"key": {}}', '{"key": {}, "search": {}, "seconds": "x"}'):
        file.write_text(text)
        with pytest.raises(FitError, match=r"c\.json: the saved search cannot be read; delete it to start anew"):
            SavedSearch(file, {}).read()
    file.write_text('{"key": {"seed": 2}, "search": {}}')
    with pytest.raises(FitError, match=r"the saved search is of .*; delete it or choose another --out"):
        SavedSearch(file, {"seed": 1}).read()
    assert SavedSearch(file, {"seed": 2}).read() == {}
    for error in (FitError("a", where="b", advice="c"), KeyError("a"), TypeError(), ValueError(), AttributeError()):
        with pytest.raises(FitError, match="cannot be continued here"), SavedSearch(file, {}).continuing():
            raise error
    with pytest.raises(ZeroDivisionError), SavedSearch(file, {}).continuing():
        raise ZeroDivisionError
