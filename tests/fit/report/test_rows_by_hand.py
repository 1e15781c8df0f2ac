"""The tables of the report and of comparisons: column heads, every row, and which of them are left out."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.report import sections
from fit.report.again import _is_together, results_in
from fit.report.compare import _agree, _columns, _diagnosis_rows, _fit_rows, _in_order, _short, _take_rows
from fit.report.methods import method_figures
from fit.report.places import may_draw
from fit.report.tables import effect_table, parameter_table
from formats.errors import OutputError
from formats.fit_records import Combination, ErrorFigure, FitParameter, ObjectiveFigure
from formats.results import save_diagnosis, save_fit_result
from formats.summary import summarise
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.report.test_shown_figures import words_on
from tests.fit.scenes import hung, sheet, swing, take_of

COMBINATION = Combination(
    name="stretch stiffness / density", unit="m2/s2", initial=1500.0, fitted=1000.0, interval_low=800.0,
    interval_high=1250.0, is_identified=True,
)  # fmt: skip


def heads_of(page):
    """The column heads of each table."""
    return [re.findall(r"<th[^>]*>(.*?)</th>", row) for row in re.findall(r"<thead>(.*?)</thead>", str(page), re.S)]


def test_every_column_of_a_table_is_called_what_it_holds():
    parts = {"place": (8.0, 2.0), "speed": (4.0, 3.0)}
    objective = ObjectiveFigure(name="E/N", unit="1", before=12.0, after=5.0, parts=parts)
    page = method_figures(msgspec.structs.replace(fit_result(), objective=objective, combinations=[COMBINATION]))
    found = [[words_on(head) for head in heads] for heads in heads_of(page)]
    assert found == [
        ["mean distance of all points, over the frames", "before, mm", "after, mm", "down by"],
        ["part of the objective", "manual", "optimised", "down by"],
        ["combination of parameters", "before", "fitted", "90 % interval", "verdict"],
    ]
    (effects,) = heads_of(effect_table(diagnosis().effects, []))
    assert [words_on(head) for head in effects] == [
        "effect", "probability", "size", "gap closed", "p-value", "smallest that would show",
    ]  # fmt: skip
    (parameters,) = heads_of(parameter_table(fit_result().parameters))
    assert [words_on(head) for head in parameters] == [
        "parameter", "initial", "fitted", "90 % interval", "from minimum to maximum", "meaning",
    ]  # fmt: skip
    row = "stretch stiffness / density 1500 m²/s² 1000 m²/s² 800 to 1250 m²/s² identified"
    assert row in words_on(page)
    assert "part of the objective" not in words_on(method_figures(fit_result()))
    one = msgspec.structs.replace(objective, parts={"place": (8.0, 2.0)})
    assert "part of the objective" not in words_on(method_figures(msgspec.structs.replace(fit_result(), objective=one)))


def test_a_part_of_an_objective_that_was_nothing_falls_by_nothing():
    objective = ObjectiveFigure(name="E/N", unit="1", before=4.0, after=3.0, parts={"a": (0.0, 0.0), "b": (4.0, 3.0)})
    shown = words_on(method_figures(msgspec.structs.replace(fit_result(), objective=objective)))
    assert " a 0 0 b 4 3 25 %" in shown


def test_an_error_without_a_held_out_take_flatters_and_says_so():
    flatters = "No held-out take was given"
    errors = msgspec.structs.replace(fit_result().error, held_out_before=None, held_out_after=None)
    assert flatters in words_on(method_figures(msgspec.structs.replace(fit_result(), error=errors)))
    assert flatters not in words_on(method_figures(fit_result()))


def test_an_effect_that_was_not_tested_has_its_note_and_no_figure():
    untested = diagnosis().effects[3]
    row = words_on(effect_table([untested], []))
    assert row.endswith("Not built yet. – – – – –")
    assert "Not tested. –" in words_on(effect_table([msgspec.structs.replace(untested, note="")], []))
    near = msgspec.structs.replace(diagnosis().effects[0], group="air_lift", closure=None, minimum_detectable=None)
    row = words_on(effect_table([near], []))
    assert "Not told apart from air lift. Best effect in 99 % of bootstrap draws" in row
    assert row.endswith("– &lt; 0.001 –")


def test_a_parameter_with_half_an_interval_or_no_width_is_drawn_without_one():
    given = {"name": "a", "unit": "1", "initial": 2.0, "fitted": 3.0, "minimum": 1.0, "maximum": 5.0, "note": ""}
    half = FitParameter(**given, interval_low=2.0, interval_high=None, is_identified=None)
    assert " 2 3 – " in words_on(parameter_table([half]))
    same = FitParameter(**(given | {"minimum": 3.0, "maximum": 3.0}), is_identified=True)
    assert "50" in str(parameter_table([same]))
    beyond = FitParameter(**(given | {"fitted": 9.0}), interval_low=-1.0, interval_high=9.0, is_identified=True)
    assert "-" not in "".join(re.findall(r"(?:left|width):\s*(-)", str(parameter_table([beyond]))))


def test_labels_of_several_lists_keep_their_neighbours():
    assert _in_order([["a", "b", "c"], ["a", "x", "b", "d"], ["e", "a"]]) == ["e", "a", "x", "b", "d", "c"]


def test_paths_are_told_apart_by_their_least():
    def short(*paths):
        return _short([Path(path) for path in paths])

    assert short("x/a/fit.json", "x/b/fit.json") == ["a", "b"]
    assert short("x/a/1/fit.json", "x/b/2/fit.json") == ["a/1", "b/2"]
    assert short("a.json", "b.json") == ["a.json", "b.json"]
    assert short("a", "a") == ["a", "a"]
    assert short("demo", "/data/r1") == ["demo", "/data/r1"]


def with_intervals(*ends):
    """Fits of one parameter with these intervals."""
    first = a_fit().parameters[0]
    return [
        msgspec.structs.replace(
            a_fit(), parameters=[msgspec.structs.replace(first, interval_low=a, interval_high=b)], combinations=[]
        )
        for a, b in ends
    ]  # fmt: skip


def test_intervals_overlap_where_all_of_them_share_a_value():
    label = "stretch stiffness [N/m]"
    assert _agree(label, with_intervals((1.0, 3.0), (3.0, 5.0))) == "yes"
    assert _agree(label, with_intervals((1.0, 2.9), (3.0, 5.0))) == "no"
    assert _agree(label, with_intervals((1.0, 4.0), (3.0, 6.0), (5.0, 7.0))) == "no"
    assert _agree(label, with_intervals((1.0, 4.0), (None, None))) == ""
    assert _agree("seed", with_intervals((1.0, 4.0), (1.0, 4.0))) == ""
    both = [msgspec.structs.replace(a_fit(), parameters=[], combinations=[COMBINATION])] * 2
    assert _agree("stretch stiffness / density [m2/s2]", both) == "yes"


def test_the_rows_of_a_fit_in_a_comparison():
    rows = _fit_rows(msgspec.structs.replace(fit_result(), combinations=[COMBINATION]))
    assert rows["method"] == "kinect-skirt"
    assert rows["search"] == "annealing"
    assert rows["takes fitted to"] == "swing-01"
    assert rows["takes held out"] == "swing-02"
    assert (rows["mesh spacing"], rows["seed"]) == ("–", "7")
    assert rows["mass [x weighed]"] == "not identified (1.36 to 2.04)"
    assert rows["spring [Blender]"] == "11.9"  # without an interval
    assert rows["stretch stiffness / density [m2/s2]"] == "1000 (800 to 1250)"
    assert rows["mean distance of all points, takes fitted to"] == "127.6 → 46.7 mm"
    assert rows["simulations"] == "368 in 41 s"
    errors = msgspec.structs.replace(fit_result().error, held_out_before=None, held_out_after=None)
    bare = _fit_rows(msgspec.structs.replace(fit_result(), error=errors, held_out_ids=[], spacing=0.025))
    assert (bare["takes held out"], bare["mesh spacing"]) == ("none", "25 mm")
    assert bare["mean distance of all points, takes held out"] == "–"


def test_the_rows_of_a_diagnosis_are_its_gap_then_what_it_names_or_holds_for_likely_then_its_base():
    """A probability of a tenth is shown, and less of it only where the effect is named."""
    drag, hem, offset, slip = diagnosis().effects
    likely = msgspec.structs.replace(hem, probability=0.1)
    less = msgspec.structs.replace(offset, probability=0.09)
    rows = _diagnosis_rows(diagnosis(effects=[less, likely, drag, slip]))
    assert list(rows)[:8] == [
        "verdict", "names", "takes fitted to", "takes held out", "base model, rms", "with what is named, rms",
        "sensor's noise, rms", "share of the gap closed",
    ]  # fmt: skip
    assert list(rows)[8:] == ["air drag", "hem", "struct [Blender]", "bend [Blender]"]
    assert [rows[name] for name in list(rows)[:8]] == [
        "effect", "air drag", "swing-01", "swing-02", "12.3 mm", "5.2 mm", "4.1 mm", "87 %",
    ]  # fmt: skip
    assert rows["air drag"] == "1.31 (1.02 to 1.6), probability 94 %"
    assert rows["hem"] == "0.004 kg/m (−0.001 to 0.009), probability 10 %"
    assert rows["struct [Blender]"] == "61.2 (49 to 73.4)"
    gap = msgspec.structs.replace(diagnosis().gap, with_effect_mm=None, closure=None)
    bare = _diagnosis_rows(diagnosis(gap=gap, named=[], effects=[], held_out_ids=[], base_parameters=[]))
    assert [bare[name] for name in ("names", "takes held out", "with what is named, rms")] == ["–", "none", "–"]
    assert bare["share of the gap closed"] == "–"
    unlikely = _diagnosis_rows(diagnosis(named=["time_offset"], effects=[offset]))
    assert unlikely["time offset"] == "−0.0021 s (−0.006 to 0.002)"


def test_the_rows_of_a_take_are_its_summary():
    time = np.arange(0, 3, 1 / 30)
    moved = swing(time, amplitude=0.05)
    points = hung(sheet(), time) + moved[:, None]
    points[:9, 4] = np.nan
    rows = _take_rows(summarise(take_of(sheet(), time, moved, points)))
    assert rows["garment"] == "sheet, 36.0 g"
    assert rows["length"].endswith("s, 90 frames, 30 a second")
    assert rows["motion"] == "face-on"
    assert rows["hanger travels"] == "0 x 100 x 0 mm"
    assert rows["hanger seen"] == "100 %"
    assert rows["rig"] == "test"
    assert rows["centre"] == "seen 90 %, noise 1 mm a coordinate"
    assert rows["top left"] == "seen 100 %, noise 1 mm a coordinate"


def test_only_things_of_one_kind_are_compared_and_two_of_them(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    with pytest.raises(FitError, match="name two or more"):
        _columns([tmp_path / "fit.json"])
    with pytest.raises(FitError, match=r"diagnosis\.json: is a diagnosis, and .*fit\.json is a fit"):
        _columns([tmp_path / "fit.json", tmp_path / "diagnosis.json"])
    assert [one.fit for one in _columns([tmp_path / "fit.json"] * 2)] == [fit_result()] * 2


def test_a_fit_and_a_diagnosis_are_together_by_the_content_of_their_takes_or_else_by_name(tmp_path):
    fit, found = fit_result(), diagnosis()
    assert _is_together(fit, found)
    one = msgspec.structs.replace(fit, take_contents=["aa"])
    assert _is_together(one, found)  # of which no content is known
    assert not _is_together(one, msgspec.structs.replace(found, take_contents=["bb"]))
    renamed = msgspec.structs.replace(found, take_contents=["aa"], take_ids=["else"])
    assert _is_together(one, renamed)
    assert not _is_together(fit, msgspec.structs.replace(found, take_ids=["else"]))
    save_fit_result(tmp_path / "fit.json", one)
    save_diagnosis(tmp_path / "diagnosis.json", msgspec.structs.replace(found, take_contents=["bb"]))
    told = results_in(tmp_path)
    assert (told.fit, told.diagnosis is None) == (None, False)
    assert "(under the same names)" in told.left_out


def test_costs_inputs_and_notes_of_both_results_are_told_once():
    """Names of parameters in notes are shown as words, the longest first."""
    fit = msgspec.structs.replace(
        a_fit(), notes=["At its bound: bending_stiffness.", "Both."], created="2026-03-01T12:00:00+00:00", seed=3
    )
    shown = words_on(sections.cost(fit, diagnosis(notes=["Both.", "One more."])))
    for said in (
        "fit 10 simulations in 1.0 s, seed 3", "diagnosis 912 simulations in 1.7 min", "takes of the fit swing-01",
        "held-out takes of the fit none", "held-out takes of the diagnosis swing-02", "fit made 2026-03-01 12:00 UTC",
        "At its bound: bending stiffness.", "One more.",
    ):  # fmt: skip
        assert said in shown, said
    assert shown.count("Both.") == 1
    assert str(sections.cost(None, None)) == ""


def error(values, stamps):
    known = [v for v in values if v is not None]
    return ErrorFigure(mean_m=float(np.mean(known)), max_m=max(known), per_frame_m=values, time_s=stamps)


def test_errors_of_a_fit_alone_run_on_from_take_to_take_without_the_way_back():
    """Two takes of two seconds, each from 0 on: the chart runs from 0 to 4 s, the second from where the first ends."""
    stamps = [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]
    before, after = error([0.04] * 6, stamps), error([0.02, 0.01, None, 0.02, 0.02, 0.02], stamps)
    errors = msgspec.structs.replace(
        fit_result().error, train_before=before, train_after=after, held_out_before=None, held_out_after=None
    )
    page = str(sections.errors(msgspec.structs.replace(fit_result(), error=errors), [], 0))
    assert page.count("<figure") == 1
    assert "takes used to fit" in page
    assert "mean 40.0\u00a0mm" in page
    (line,) = re.findall(r'class="is-after" d="([^"]*)"', page)
    across = [float(x) for x in re.findall(r"[ML]([\d.]+) ", line)]
    assert across == pytest.approx([0, 25, 50, 75, 100], abs=0.01)  # the third frame is missing
    assert line.count("M") == 2
    wrong = msgspec.structs.replace(after, per_frame_m=[0.02] * 5)
    errors = msgspec.structs.replace(errors, train_after=wrong)
    assert str(sections.errors(msgspec.structs.replace(fit_result(), error=errors), [], 0)) == ""


def test_six_of_the_points_have_a_curve_each_of_four_hundred_vertices_at_most():
    time = np.arange(1000) / 30
    names = tuple(f"p_{k}" for k in range(8))
    real = np.zeros((1000, 8, 3))
    real[:, 7] = np.nan
    made = motion(seconds=6.0)
    run = type(made.runs["fit"])(points=np.ones((1000, 8, 1)) * 1e-3 * np.arange(8)[:, None] * [1.0, 0.0, 0.0])
    made = type(made)(
        take_id="a", is_held_out=False, time=time, real=real, point_names=names, runs={"before": run}
    )  # fmt: skip
    page = str(sections.errors(None, [made], 1))
    assert "a: point by point (the 6 worst of 7 free points)" in words_on(page)
    shown = re.findall(r"(p \d), distance of this point", words_on(page))
    assert list(dict.fromkeys(shown)) == [f"p {k}" for k in (6, 5, 4, 3, 2, 1)]
    lines = re.findall(r'class="is-before" d="([^"]*)"', page)
    assert [len(re.findall("[ML]", line)) for line in lines] == [1000, *[334] * 6]
    assert str(sections.errors(None, [made], 0)).count("<figure") == 1  # charts that the player does not know


def test_where_no_figure_is_known_a_section_is_empty():
    assert [str(part) for part in (
        sections.gap(None), sections.player([], 0, ""), sections.camera(fit_result(), None), sections.effects(None),
        sections.where(None), sections.missing_force(None), sections.gates(None), sections.next_experiment(None),
        sections.origin(None), sections.method(None), sections.parameters(None, None),
    )] == [""] * 11  # fmt: skip
    bare = diagnosis(gap=msgspec.structs.replace(diagnosis().gap, is_held_out=False))
    assert "so it flatters: give a held-out take" in words_on(sections.gap(bare))
    force = msgspec.structs.replace(diagnosis().missing_force, power=None, spatial_share={})
    assert "place –" in words_on(sections.missing_force(force))
    next_one = msgspec.structs.replace(diagnosis().next_experiment, sigmas_now=None, separates=[])
    shown = words_on(sections.next_experiment(diagnosis(next_experiment=next_one)))
    assert "tells apart –" in shown
    assert "8.4 standard deviations" in shown
    assert "against" not in shown
    unknown = msgspec.structs.replace(next_one, sigmas_next=None)
    assert "standard deviations" not in words_on(sections.next_experiment(diagnosis(next_experiment=unknown)))


def test_effects_with_a_closure_or_a_name_are_refitted_and_the_others_are_counted():
    drag, hem, offset, slip = diagnosis().effects
    hem = msgspec.structs.replace(hem, closure=None)
    page = words_on(sections.effects(diagnosis(effects=[drag, hem, offset, slip], named=["hem"])))
    assert "1 effect not chosen for a refit" in page
    page = words_on(sections.effects(diagnosis(effects=[drag, hem, offset, slip], named=[])))
    assert "2 effects not chosen for a refit" in page
    alone = sections.effects(diagnosis(effects=[slip], named=[]))
    assert "everything fitted again" not in words_on(alone)
    assert "<details open" in str(alone)
    assert "<details open" not in str(sections.effects(diagnosis(effects=[drag, slip], named=[])))


def test_a_player_says_how_its_cloth_was_pulled_and_how_far_its_points_were_shifted():
    pulled = motion(pull_hz=1.5)
    page = words_on(sections.player([motion(), pulled], 2, "A note."))
    assert "1.5" in page
    assert "A note." in page
    beside = motion(is_material=False)
    moved = max(np.linalg.norm(beside.offset(run), axis=1).max() for run in beside.shown)
    assert f"{1e3 * moved:.0f} mm" in words_on(sections.player([beside], 1, ""))
    assert "swing-02 (held out)" in words_on(sections.player([motion(), motion("swing-02", is_held_out=True)], 2, ""))


def test_a_picture_that_is_there_is_replaced_only_where_that_is_asked_for(tmp_path):
    pytest.importorskip("PIL")
    (tmp_path / "a.png").write_bytes(b"mine")
    may_draw(tmp_path / "a.png", overwrite=True)
    may_draw(tmp_path / "b.png", overwrite=False)
    with pytest.raises(OutputError, match="already there"):
        may_draw(tmp_path / "a.png", overwrite=False)


def test_an_effect_that_no_draw_favours_is_not_impossible_in_any_table():
    """A probability of 0.002 is less than 1 %, and one of 0.998 more than 99 %, as in the sentence."""
    for value, shown in ((0.002, "less than 1 %"), (0.998, "more than 99 %"), (0.2, "20 %")):
        found = diagnosis()
        first = msgspec.structs.replace(found.effects[0], probability=value)
        found = msgspec.structs.replace(found, effects=[first, *found.effects[1:]])
        assert f" {shown} " in words_on(effect_table([first], found.named))
        assert _diagnosis_rows(found)[first.id.replace("_", " ")].endswith(f"probability {shown}")
