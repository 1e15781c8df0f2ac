"""`import hangtime` gives the same numbers as the commands to the last digit."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re

import msgspec
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import hangtime
from fit.cli import fit_command
from fit.recordings import recording, selection
from formats.results import load_fit_result
from tests.api_takes import command, written_takes
from tests.fit.here import hangtime_here

QUICK = {"method": "si", "search": "annealing", "iterations": 12, "spacing": 0.1, "seed": 3}


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    return written_takes(tmp_path_factory.mktemp("api") / "demo")


def here(*words, folder):
    done = hangtime_here(*words, folder=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def fitted(takes):
    return hangtime.fit(takes / "gentle.mcap", held_out=[takes / "swing.mcap"], **QUICK)


def without_time(result):
    """Return a result without its time of creation and its duration."""
    return msgspec.structs.replace(result, created="", **({"seconds": 0.0} if hasattr(result, "seconds") else {}))


def noting(names, call):
    """Return a wrapper of the call that records the name of each take."""
    return lambda take: names.append(take.take_id) or call(take)


def test_a_fit_and_its_report_hash_and_prepare_each_take_once(takes, fitted, tmp_path, monkeypatch):
    """Also where the folder holds a fit of other takes, which the command compares with these."""
    counts = {"content_of": [], "prepare": []}
    for module, name in ((selection, "content_of"), (recording, "prepare")):
        own = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda take, own=own, name=name: counts[name].append(take.take_id) or own(take)
        )
    fitted.save(tmp_path / "fit.json")
    options = {"iterations": 1, "search": "annealing", "spacing": 0.2}
    fit_command([takes / "mixed.mcap"], [takes / "swing.mcap"], out=tmp_path, **options)
    assert counts == {"content_of": ["mixed", "swing"], "prepare": ["mixed", "swing"]}
    assert (tmp_path / "fit.1.json").exists()
    outcome = hangtime.fit(takes / "gentle.mcap", **options)
    hangtime.report(outcome, tmp_path / "again.html")
    assert counts == {"content_of": ["mixed", "swing", "gentle"], "prepare": ["mixed", "swing", "gentle"]}


@pytest.mark.parametrize("run", [here, pytest.param(command, marks=pytest.mark.slow)])
def test_a_fit_is_the_commands_to_the_last_digit(takes, fitted, tmp_path, run):
    """Also of a command in a process of its own; here linear algebra may use as many threads as there are."""
    words = ("--search", "annealing", "--iterations", 12, "--spacing", 0.1, "--seed", 3, "--out", "out")
    said = run("fit", takes / "gentle.mcap", "--held-out", takes / "swing.mcap", *words, folder=tmp_path)
    assert without_time(fitted.result) == without_time(load_fit_result(tmp_path / "out/fit.json"))
    assert said.startswith(str(fitted))


def test_a_simulation_with_a_fit_has_its_errors_to_the_last_digit(takes, fitted):
    held_out = hangtime.simulate(takes / "swing.mcap", fitted)
    assert held_out.error == fitted.result.error.held_out_after
    start = hangtime.simulate(hangtime.load(takes / "gentle.mcap"), method="si", spacing=0.1)
    assert start.error == fitted.result.error.train_before


@pytest.mark.parametrize("threads", [1, 2])
def test_linear_algebra_has_one_thread_in_a_fit_and_the_callers_number_after_it(takes, monkeypatch, threads):
    from fit.identification import free_intervals as fitting

    import scipy.linalg  # noqa: F401  isort: skip - brings its own library, whose threads count as well

    seen, own = [], fitting.block_intervals

    def look(*words, **options):
        seen.extend(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
        return own(*words, **options)

    monkeypatch.setattr(fitting, "block_intervals", look)
    with threadpool_limits(limits=threads, user_api="blas"):
        hangtime.fit(takes / "gentle.mcap", method="lean", search="annealing", iterations=1, spacing=0.2)
        after = {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}
    assert set(seen) == {1}
    assert len(seen) >= 1
    assert after == {threads}


def test_a_parameter_that_is_not_identified_is_shown_as_an_interval_and_never_as_a_number(fitted):
    free = dataclasses.replace(fitted, result=with_first(fitted.result, is_identified=False, fitted=123.456789))
    shown = f"{free.result.parameters[0].interval_low:.0f} to {free.result.parameters[0].interval_high:.0f}"
    for text in (str(free), free._repr_html_(), free.to_csv()):
        assert "123.4" not in text
    assert f"-  {shown}" in re.sub(r" {2,}", "  ", str(free))
    assert "not identified" in str(free)
    row = next(csv.DictReader(io.StringIO(free.to_csv())))
    assert (row["fitted"], row["is_identified"]) == ("", "False")


def test_a_parameter_that_is_identified_is_shown_with_its_value(fitted):
    known = dataclasses.replace(fitted, result=with_first(fitted.result, is_identified=True, fitted=123.456789))
    assert "123.5" in str(known)
    assert "123.5" in known._repr_html_()
    assert next(csv.DictReader(io.StringIO(known.to_csv())))["fitted"] == "123.456789"


def with_first(result, **changes):
    first, *others = result.parameters
    return msgspec.structs.replace(result, parameters=[msgspec.structs.replace(first, **changes), *others])


def test_the_result_file_says_which_parameters_are_not_identified(fitted):
    free = [p.name for p in fitted.result.parameters if not p.is_identified]
    assert free  # 12 steps on 2.5 s of one take never identify all five
    (note,) = (note for note in fitted.result.notes if note.startswith("Not identified: "))
    each = " of each" if len(free) > 1 else ""
    assert note.startswith(f"Not identified: {', '.join(free)}. Read the 90 % interval{each}.")


def test_a_table_in_a_notebook_shows_a_name_as_text_and_not_as_html(fitted):
    named = dataclasses.replace(fitted, result=with_first(fitted.result, name="<b>stretch</b>"))
    assert "&lt;b&gt;stretch&lt;/b&gt;" in named._repr_html_()
    assert "<b>" not in named._repr_html_()


def test_a_result_is_the_same_after_its_file(fitted, tmp_path):
    assert hangtime.load(fitted.save(tmp_path / "fit.json")).result == fitted.result
    written = json.loads((tmp_path / "fit.json").read_text())
    assert re.fullmatch("[0-9a-f]{64}", written.pop("digest"))  # the file's own
    assert written == json.loads(json.dumps(fitted.to_dict()))


def test_positions_of_a_simulation_are_written_point_by_point(takes, fitted, tmp_path):
    """78 frames of five points; the first row is the first frame's first point."""
    simulation = hangtime.simulate(takes / "swing.mcap", fitted)
    rows = list(csv.DictReader(io.StringIO(simulation.to_csv(tmp_path / "places.csv"))))
    assert len(rows) == 78 * 5
    assert [float(rows[0][axis]) for axis in "xyz"] == simulation.takes[0].simulated[0, 0].tolist()
    assert (tmp_path / "places.csv").read_text() == simulation.to_csv()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"bend": 1.0}, "there is no parameter named 'bend'; known parameters: stretch_stiffness,"),
        ({"shear_stiffness": 1e4}, r"shear_stiffness = 10000 is outside its range; stay within 10 to 220 N/m"),
    ],
)
def test_values_that_cannot_be_simulated_are_refused_with_what_to_do(takes, given, sentence):
    with pytest.raises(hangtime.HangtimeError, match=sentence):
        hangtime.simulate(takes / "swing.mcap", given, method="si")


def test_a_loaded_result_cannot_draw_takes_that_it_does_not_hold(fitted, tmp_path):
    loaded = hangtime.load(fitted.save(tmp_path / "fit.json"))
    with pytest.raises(hangtime.HangtimeError, match=r"holds no takes to draw; .*; or fit or diagnose the takes again"):
        hangtime.report(loaded, tmp_path / "report.html")


def test_a_loaded_fit_is_simulated_with_its_own_method_and_effects(takes, fitted, tmp_path):
    """And on its own mesh, unless another is asked for."""
    loaded = hangtime.load(fitted.save(tmp_path / "fit.json"))
    simulation = hangtime.simulate(takes / "swing.mcap", loaded)
    assert (simulation.values, simulation.remarks) == (fitted.values, ())
    assert simulation.error.mean_m == fitted.result.error.held_out_after.mean_m
    finer = hangtime.simulate(takes / "swing.mcap", loaded, spacing=0.05)
    assert finer.error == hangtime.simulate(takes / "swing.mcap", fitted, spacing=0.05).error != simulation.error


def test_an_old_fit_is_simulated_on_the_usual_mesh_and_says_so(takes, fitted):
    """Results did not always hold the spacing of their mesh."""
    old = hangtime.FitOutcome(result=msgspec.structs.replace(fitted.result, spacing=None))
    simulation = hangtime.simulate(takes / "swing.mcap", old)
    assert simulation.error == hangtime.simulate(takes / "swing.mcap", old, spacing=0.05).error
    assert "does not say its mesh spacing. The simulation has the method's own, 0.05 m." in str(simulation)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda take: hangtime.fit(take, methud="si"), "^fit: .* named 'methud'; did you mean method"),
        (lambda take: hangtime.fit(take, iterations=0), "iterations is 0; give a whole number from 1 to 1000000"),
        (lambda take: hangtime.fit(take, iterations=10**6 + 1), "iterations is 1000001; give a whole number from 1"),
        (lambda take: hangtime.fit(take, iterations=2.5), r"iterations is 2\.5"),
        (lambda take: hangtime.fit(take, seed=-1), "seed is -1; give a whole number from 0 on"),
        (lambda take: hangtime.fit(take, effects="drag"), "there is no effect named 'drag'"),
        (lambda take: hangtime.fit(take, held_out_motion="slow"), "there is no kind of motion named 'slow'"),
        (lambda take: hangtime.diagnose(take, add="drag"), "there is no effect named 'drag'"),
        (lambda take: hangtime.diagnose([]), "no take was given; name at least one"),
        (lambda take: hangtime.simulate([]), "no take was given; name at least one"),
        (lambda take: hangtime.load(None), "^path: is None; give the path of a file"),
        (lambda take: hangtime.load(7), "^path: is of the kind int; give the path of a file"),
        (lambda take: hangtime.load("a\0b"), r"^path: 'a\\x00b' is the name of no file; give the path of a file"),
        (lambda take: hangtime.fit(""), "^takes: '' is the name of no file; give a take or the path of one"),
        (lambda take: hangtime.fit(take, progress=7), "^progress: cannot be called; give a function"),
        (lambda take: hangtime.diagnose(take, progress=7), "^progress: cannot be called; give a function"),
        (lambda take: hangtime.fit(None), "^takes: is None; give a take, the path of one, or a list of them"),
        (lambda take: hangtime.fit([take, 7]), "^takes: holds a value of the kind int; give a take or the path"),
        (lambda take: hangtime.fit({7: take}), "^takes: is of the kind dict; give a take, the path of one, or a list"),
        (lambda take: hangtime.fit(take, held_out=7), "^held_out: is of the kind int; give a take"),
        (
            lambda take: hangtime.fit(take, held_out_motion=[7]),
            "^held_out_motion: holds a value of the kind int; give a",
        ),
        (lambda take: hangtime.fit(take, iterations="7"), "^iterations: iterations is '7'; give a whole number"),
        (lambda take: hangtime.fit(take, iterations=True), "^iterations: iterations is True; give a whole number"),
        (lambda take: hangtime.fit(take, spacing="0.1"), "^spacing: is of the kind str; give a number"),
        (lambda take: hangtime.fit(take, spacing=-1), "^spacing: the mesh spacing is -1 m; give metres"),
        (lambda take: hangtime.fit(take, gamma="x"), "^gamma: is of the kind str; give a number"),
        (lambda take: hangtime.fit(take, gamma=0), "^gamma: gamma is 0; give a number above 0"),
        (lambda take: hangtime.fit(take, method=7), "^method: is of the kind int; give a text"),
        (lambda take: hangtime.fit(take, search=None), "^search: is None; give a text"),
        (lambda take: hangtime.fit(take, fabric=7), "^fabric: is of the kind int; give a text"),
        (lambda take: hangtime.fit(take, effects=None), "^effects: is None; give a text or a list of texts"),
        (lambda take: hangtime.fit(take, bounds="x=1:2"), "^bounds: there is no parameter named 'x'"),
        (lambda take: hangtime.fit(take, bounds={"velocity": (1, 2)}), "^bounds: .* dict; give NAME=LOW:HIGH, one"),
        (lambda take: hangtime.fit(take, bounds=[("velocity", 1, 2)]), "^bounds: .* tuple; give NAME=LOW:HIGH, one"),
        (lambda take: hangtime.fit(take, effects=["shear_stiffness"]), "^effects: .*; bounds .*=LOW:HIGH narrows it"),
        (lambda take: hangtime.fit(take, checkpoint=7), "^checkpoint: is of the kind int; give the path"),
        (lambda take: hangtime.fit(take, checkpoint=f"{take}/kept.json"), r"swing\.mcap: cannot be made or written"),
        (lambda take: hangtime.diagnose(take, checkpoint=f"{take}/kept"), r"swing\.mcap/kept: cannot be used"),
        (lambda take: hangtime.diagnose(take, seed=-3), "^seed: seed is -3; give a whole number from 0 on"),
        (lambda take: hangtime.diagnose(take, spacing=0), "^spacing: the mesh spacing is 0 m; give metres"),
        (lambda take: hangtime.diagnose(take, without=7), "^without: is of the kind int; give a text or a list"),
        (lambda take: hangtime.diagnose(take, add=["hem"], without="hem"), "^without: hem is to be added and left out"),
        (lambda take: hangtime.diagnose(take, model=7), "^model: is of the kind int; give a text"),
        (lambda take: hangtime.diagnose(take, by="votes"), "^by: votes is no way to decide; choose one of"),
        (
            lambda take: hangtime.simulate(take, "fit.json"),
            "^parameters: .* str; give values by name, or a fit",
        ),
        (lambda take: hangtime.simulate(take, {7: 1.0}), "^parameters: there is no parameter named 7; known"),
        (lambda take: hangtime.simulate(take, {"velocity_damping": "a"}), "^velocity_damping: is of the kind str"),
        (lambda take: hangtime.simulate(take, {"velocity_damping": math.nan}), "= nan is outside its range"),
        (
            lambda take: hangtime.report(hangtime.load(take), "r.html"),
            "^outcome: is of the kind Take; give a result of",
        ),
        (lambda take: hangtime.export(take, "csv", "a.csv"), "is a binary file, and no result"),
        (lambda take: hangtime.export(None, "csv", "a.csv"), "^outcome: is None; give the path of a file"),
    ],
)
def test_a_careless_call_is_refused_with_what_to_do(takes, call, sentence):
    with pytest.raises(hangtime.HangtimeError, match=sentence):
        call(takes / "swing.mcap")


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda fit, take: hangtime.report(fit, None), "^path: is None; give the path of a file"),
        (lambda fit, take: hangtime.report(fit, take.parent / "r.pdf"), r"pdf: pages are written as HTML; give a name"),
        (lambda fit, take: hangtime.report(fit, take / "r.html"), r"swing\.mcap: cannot be made"),
        (lambda fit, take: fit.save(None), "^path: is None; give the path of a file"),
        (lambda fit, take: fit.save(take / "fit.json"), r"swing\.mcap: cannot be used"),
        (lambda fit, take: fit.save(take.parent), "cannot be used"),
        (lambda fit, take: fit.to_csv(take / "a.csv"), r"swing\.mcap: cannot be made"),
        (lambda fit, take: hangtime.export(fit, 7, "a"), "^to: is of the kind int; give a text"),
        (lambda fit, take: hangtime.export(fit, "usd", "a.usdc", take=[take, take]), "^take: is of the kind list"),
        (lambda fit, take: hangtime.export(fit, "usd", "a.usdc"), "^take: a fit alone holds no motion"),
        (
            lambda fit, take: hangtime.export(fit, "usd-physics", "a.usda", thickness="1"),
            "^thickness: .* give metres",
        ),
        (lambda fit, take: hangtime.export(fit, "csv", "a.csv", thickness=0.001), "^thickness: changes nothing here"),
        (lambda fit, take: hangtime.export(fit, "newton", "a.json", spacing="1"), "^spacing: .* str; give a number"),
        (
            lambda fit, take: hangtime.export(fit, "table", "a.txt", spacing=0.1),
            "^spacing: .*; leave it out",
        ),
    ],
)
def test_a_careless_use_of_a_fit_is_refused_with_what_to_do(takes, fitted, call, sentence):
    with pytest.raises(hangtime.HangtimeError, match=sentence):
        call(fitted, takes / "swing.mcap")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda take: {"time": take.time[::-1]}, r"^swing, frame 1: time goes from .* s to .* s; frames must come in"),
        (lambda take: {"time": take.time[:-1]}, "^swing, frame 0: markers has shape .*; give one row a frame"),
        (lambda take: {"held": np.nan * take.held}, "^swing, frame 0: held end 0 is marked valid but is not a number"),
        (lambda take: {"points_sd": -take.points_sd}, "^swing, frame 0: points_sd has a standard deviation of -"),
        (lambda take: {"points": None}, "^swing: points is None; give an array"),
        (
            lambda take: {"garment": msgspec.structs.replace(take.garment, mass_kg=-1.0)},
            "^swing: mass_kg must be above 0",
        ),
    ],
)
@pytest.mark.parametrize("call", [hangtime.fit, hangtime.diagnose, hangtime.simulate])
def test_a_take_changed_in_memory_to_what_no_file_holds_is_refused_by_its_wrong_field(takes, call, change, sentence):
    take = hangtime.load(takes / "swing.mcap")
    with pytest.raises(hangtime.HangtimeError, match=sentence):
        call(dataclasses.replace(take, **change(take)))


def test_the_command_names_the_option_where_python_names_the_argument(takes, tmp_path):
    done = hangtime_here("fit", takes / "swing.mcap", "--bounds", "x=1:2", "--out", "out", folder=tmp_path)
    assert done.returncode == 2
    assert "--bounds: there is no parameter named 'x'" in done.stderr


def test_a_fit_keeps_its_search_and_its_numbers_in_folders_that_it_makes(takes, fitted, tmp_path):
    """And a result is read again whatever its name is."""
    kept = tmp_path / "search/kept.json"
    hangtime.fit(takes / "gentle.mcap", checkpoint=kept, **{**QUICK, "iterations": 1, "spacing": 0.2})
    assert kept.exists()
    fitted.to_csv(tmp_path / "tables/fit.csv")
    assert (tmp_path / "tables/fit.csv").read_text() == fitted.to_csv()
    assert hangtime.load(fitted.save(tmp_path / "results/noext")).result == fitted.result


def test_a_fit_that_is_refused_leaves_no_folder_for_its_search(takes, tmp_path):
    with pytest.raises(hangtime.HangtimeError, match="this take is given twice"):
        hangtime.fit([takes / "gentle.mcap"] * 2, checkpoint=tmp_path / "search/kept.json", **QUICK)
    assert not (tmp_path / "search").exists()


def test_a_file_that_is_no_result_is_named(tmp_path):
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(hangtime.HangtimeError, match=r"other\.json: is not a fit result"):
        hangtime.load(tmp_path / "other.json")


def test_a_simulation_with_a_fit_uses_every_parameter_of_the_fit(takes, fitted):
    """Each value in turn goes to the farther end of its bounds, which must change the motion."""
    take, mesh = takes / "gentle.mcap", {"spacing": 0.2}
    usual = hangtime.simulate(take, fitted, **mesh).takes[0].simulated
    assert len(fitted.result.parameters) == 5
    for number, parameter in enumerate(fitted.result.parameters):
        far = max((parameter.minimum, parameter.maximum), key=lambda end, p=parameter: abs(math.log(end / p.fitted)))
        parameters = list(fitted.result.parameters)
        parameters[number] = msgspec.structs.replace(parameter, fitted=far)
        result = msgspec.structs.replace(fitted.result, parameters=parameters)
        moved = hangtime.simulate(take, dataclasses.replace(fitted, result=result), **mesh).takes[0].simulated
        assert np.abs(moved - usual).max() > 1e-6, parameter.name
