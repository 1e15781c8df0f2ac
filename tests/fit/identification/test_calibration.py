"""The loop around a search, with an engine that only adds a millimetre of noise to the measurements."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import typer

from fit.cli import fit_command
from fit.errors import BlowUpError, FitError
from fit.identification import calibrate as calibration
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from fit.recordings.recording import prepare
from formats.archive import write_take
from tests.fit.scenes import hung, sheet, swing, take_of


class Noise:
    """An engine behind the contract of `fit.engines.contract`.

    Every point of the takes in `broken` is NaN, of those in `broken_later` from the second simulation on.
    """

    version = "1"
    broken: tuple[str, ...] = ()
    broken_later: tuple[str, ...] = ()

    def __init__(self, recording, method, effects, resolution):
        shift = np.random.default_rng(0).normal(0, 1e-3, recording.points.shape)
        self._points = recording.points + (np.nan if recording.take_id in self.broken else shift)
        self._later = np.nan if recording.take_id in self.broken_later else 0.0

    def points(self, vectors):
        points, self._points = self._points, self._points + self._later
        return np.repeat(points[None], len(vectors), axis=0)


@pytest.fixture(autouse=True)
def engine(monkeypatch):
    monkeypatch.setattr(calibration, "find_engine", lambda name: Noise)
    return Noise


def a_take(name="a", seconds=3.0, grid=None):
    time = np.arange(0, seconds, 1 / 30)
    path, garment = swing(time, amplitude=0.05 if name == "a" else 0.06), sheet() if grid is None else sheet(grid=grid)
    return take_of(garment, time, path, hung(garment, time) + path[:, None], name=name)


def asked(search="annealing", method="lean", effects=(), bounds=()):
    return request_of(
        find_method(method), list(effects), iterations=6, seed=1, spacing=0.1, search=search, bounds=list(bounds)
    )


def never(done, total, best):
    raise AssertionError("the search was not to be begun")


@pytest.mark.parametrize("search", ["annealing", "restarts", "tempering", "cma-es"])
def test_a_finished_search_outlives_a_held_out_take_that_blows_up(engine, monkeypatch, tmp_path, search):
    file = tmp_path / "c.json"
    whole = calibrate([a_take()], [], asked(search))
    with monkeypatch.context() as patch:
        patch.setattr(engine, "broken_later", ("b",))
        with pytest.raises(BlowUpError, match=r"^b: the simulation of this take blew up; use a coarser mesh"):
            calibrate([a_take()], [a_take("b")], asked(search), checkpoint=file)
    file.write_text(json.dumps(json.loads(file.read_text()) | {"seconds": 1000.0}))
    result = calibrate([a_take()], [a_take("b")], asked(search), checkpoint=file, progress=never)
    assert 1000.0 < result.seconds < 1100.0  # what was spent before counts
    assert result.history == whole.history
    assert result.parameters == whole.parameters


def test_a_held_out_take_that_blows_up_from_the_first_is_refused_before_the_search(engine, monkeypatch):
    monkeypatch.setattr(engine, "broken", ("b",))
    with pytest.raises(BlowUpError, match=r"^b: the simulation of this take blew up; use a coarser mesh"):
        calibrate([a_take()], [a_take("b")], asked(), progress=never)


def test_a_method_asks_nothing_of_takes_that_are_only_judged_on():
    """The motion capture method needs 100 frames of what it is fitted to; distances need none."""
    long, short = (a_take(n, seconds=s, grid=4) for n, s in (("a", 4.0), ("b", 2.5)))
    with pytest.raises(FitError, match="needs 100"):
        calibrate([short], [], asked(method="mocap-swatch"), progress=never)
    assert calibrate([long], [short], asked(method="mocap-swatch")).error.held_out_after is not None


@pytest.mark.slow
def test_an_interruption_of_the_report_keeps_the_search(monkeypatch, tmp_path):
    write_take(tmp_path / "a.mcap", a_take())
    out = tmp_path / "out"

    def interrupt(*args):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("fit.report.gather.write_fit_report", interrupt)
        with pytest.raises(typer.Exit) as ended:
            fit_command([tmp_path / "a.mcap"], method="lean", spacing=0.1, out=out)
    assert ended.value.exit_code == 130
    assert (out / "fit.partial.json").exists()
    monkeypatch.setattr("fit.report.gather.write_fit_report", lambda path, *rest: path)
    fit_command([tmp_path / "a.mcap"], method="lean", spacing=0.1, out=out)
    assert not (out / "fit.partial.json").exists()


def test_an_interrupted_fit_says_from_where_it_continues(monkeypatch, tmp_path, capsys):
    """It is interrupted where the first of its forty iterations are shown."""
    write_take(tmp_path / "a.mcap", a_take())
    asked = {"method": "lean", "search": "annealing", "iterations": 40, "spacing": 0.15, "out": tmp_path / "out"}

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("formats.terminal.ProgressLine.show", interrupt)
        with pytest.raises(typer.Exit):
            fit_command([tmp_path / "a.mcap"], **asked)
    assert "Continuing" not in capsys.readouterr().err
    fit_command([tmp_path / "a.mcap"], **asked)
    assert re.search(r"^Continuing from \d+ of 40\.$", capsys.readouterr().err, re.MULTILINE)


def test_a_saved_search_of_another_version_of_the_engine_is_refused(engine, monkeypatch, tmp_path):
    calibrate([a_take()], [], asked(), checkpoint=tmp_path / "c.json")
    monkeypatch.setattr(engine, "version", "2")
    with pytest.raises(FitError, match=r"c\.json: the saved search is of"):
        calibrate([a_take()], [], asked(), checkpoint=tmp_path / "c.json", progress=never)


def test_a_saved_search_of_another_version_is_refused(monkeypatch, tmp_path):
    file = tmp_path / "c.json"
    calibrate([a_take()], [], asked(), checkpoint=file)
    monkeypatch.setattr("fit.identification.calibrate.physics_version", lambda: "another")
    with pytest.raises(FitError, match="is of another version of Hangtime or of its libraries"):
        calibrate([a_take()], [], asked(), checkpoint=file, progress=never)


@pytest.mark.parametrize("search", ["annealing", "restarts", "tempering", "cma-es"])
@pytest.mark.parametrize("state", [{}, [], {"seed": 2}])
def test_a_saved_search_that_does_not_replay_is_named_with_its_file(tmp_path, search, state):
    """Nothing saved, something else saved, another seed."""
    file = tmp_path / "c.json"
    calibrate([a_take()], [], asked(search), checkpoint=file)
    saved = json.loads(file.read_text())
    saved["search"] = {**saved["search"], "chains": 0, "settings": 0, **state} if state else state
    file.write_text(json.dumps(saved))
    with pytest.raises(FitError, match="cannot be continued here") as caught:
        calibrate([a_take()], [], asked(search), checkpoint=file)
    assert caught.value.where == file
    assert caught.value.advice == "delete it to start anew"


@pytest.mark.parametrize("search", ["annealing", "cma-es"])
def test_a_take_of_under_three_half_seconds_is_refused_before_the_search(search):
    with pytest.raises(
        FitError, match="intervals need 3 half-seconds of motion, and there are 2; record a longer take"
    ):
        calibrate([a_take(seconds=0.9)], [], asked(search), progress=never)


def test_viscosity_that_was_diagnosed_beyond_the_base_models_range_can_be_kept_beside_it():
    result = calibrate([a_take()], [], asked(method="si", effects=["bending_viscosity"]))
    assert {"bending_damping_time", "bending_viscosity"} <= {p.name for p in result.parameters}


def test_combinations_count_effects_that_change_the_cloth():
    """At 0.2 kg/m^2 a trace of 0.3 N/m, a thousandth of the stretch stiffness, and the effect's 10 N/m: 51.5 m2/s2."""
    result = calibrate(
        [a_take()], [], asked(effects=["air_drag", "shear_stiffness"], bounds=["shear_stiffness=10:100"])
    )
    shear = next(c for c in result.combinations if c.name == "shear stiffness / density")
    assert shear.initial == pytest.approx(51.5)
    assert shear.fitted == pytest.approx(result.material["shear_stiffness"] / 0.2)
    # The engine knows no parameter. No motion tells the effect's size, so its whole range of 10 to 100 N/m stays.
    assert shear.interval_low == pytest.approx(1.5 + 10 / 0.2)
    assert shear.interval_high == pytest.approx(1.5 + 100 / 0.2)
    assert not shear.is_identified


def test_narrow_bounds_identify_nothing_that_the_points_do_not():
    """The engine knows no parameter, so every deviation is the box's own, however narrow that is."""
    result = calibrate([a_take()], [], asked(bounds=["stretch_stiffness=299:301"]))
    stretch = next(c for c in result.combinations if c.name == "stretch stiffness / density")
    assert not stretch.is_identified
    assert not any(p.is_identified for p in result.parameters)


@pytest.mark.parametrize(
    ("search", "shown"),
    [
        ("least-squares", "least-squares: 10 %, 9.0 mm mean distance on fitted takes, step 13 of at most 130"),
        ("annealing", "annealing: 10 %, 9.0 mm mean distance on fitted takes, 13/130"),
    ],
)
@pytest.mark.parametrize(
    ("is_there", "sentence"),
    [
        (False, "Interrupted; nothing is kept."),
        (True, "the search is kept in out/fit.partial.json. The same command continues."),
    ],
)
def test_the_file_that_an_interruption_names_exists(
    monkeypatch, tmp_path, capsys, search, shown, is_there, sentence
):  # fmt: skip
    """And so is what was shown before it."""

    def interrupt(*words, **options):
        options["progress"](13, 130, 0.009)
        raise KeyboardInterrupt

    monkeypatch.setattr(calibration, "calibrate", interrupt)
    monkeypatch.chdir(tmp_path)
    take = write_take(tmp_path / "a.mcap", a_take())
    (tmp_path / "out").mkdir()
    if is_there:
        (tmp_path / "out/fit.partial.json").write_text("{}")
    with pytest.raises(typer.Exit):
        fit_command([take], search=search, out=tmp_path.relative_to(tmp_path) / "out")
    told = capsys.readouterr().err
    assert shown in told
    assert sentence in told
    assert (tmp_path / "out/fit.partial.json").exists() == is_there


def test_a_range_of_six_times_identifies_nothing_that_the_points_do_not():
    """At the lower end of a logarithm's range its flat prior is narrow in N/m; the points still say nothing."""
    result = calibrate([a_take()], [], asked(method="si", bounds=["shear_stiffness=36:216"]))
    assert {p.name: p.fitted for p in result.parameters}["shear_stiffness"] < 60
    assert not any(c.is_identified for c in result.combinations)


def test_a_clock_that_runs_fast_is_no_property_of_the_cloth():
    result = calibrate([a_take()], [], asked(effects=["clock_drift"]))
    plain = calibrate([a_take()], [], asked())
    assert result.effects["clock_drift"] is not None
    drifting = calibration.Model([prepare(a_take())], asked(effects=["clock_drift"]))
    vector = np.array([*asked().method.initial, 0.03])
    assert drifting.material(vector) == pytest.approx(plain.material | drifting.material(np.append(vector[:-1], 0.0)))


def test_a_parameter_at_its_bound_is_noted_as_such_and_not_among_those_that_many_values_fit():
    """The start of the damping, 1 /s, is the lower end of its range, and no other candidate is better."""
    result = calibrate([a_take()], [], asked(bounds=["velocity_damping=1:4"]))
    stopped = [p.name for p in result.parameters if p.is_at_bound]
    free = [p.name for p in result.parameters if not (p.is_identified or p.is_at_bound)]
    assert "velocity_damping" in stopped
    assert free
    assert any(note.startswith(f"At its bound: {', '.join(stopped)}. ") for note in result.notes)
    assert any(note.startswith(f"Not identified: {', '.join(free)}. ") for note in result.notes)
