"""Every figure of the report's text, tables and charts, from records whose numbers all differ."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.cloth import material as mat
from fit.effects import find_effects
from fit.methods import SI
from fit.recordings.recording import prepare
from fit.report import gather, sections
from fit.report.answer import fit_figures, verdict
from fit.report.charts import Curve, axis_top, cloth_map, effect_bars, error_chart, force_map, gap_bars, where_bars
from fit.report.effects import meaning_of
from fit.report.methods import method_figures, search_history
from fit.report.residual_picture import draw_residuals, views_of
from fit.report.tables import effect_table, parameter_table
from fit.report.text import duration, millimetres, probability, unbroken
from formats.diagnosis_records import Figure, ForceAt, Gap, VertexResidual, WhereBin
from formats.fit_records import ErrorFigure, FitParameter, ObjectiveFigure, TrivialFigure
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.scenes import hung, sheet, swing, take_of


def words_on(page):
    """The text of a piece of HTML in one line."""
    return " ".join(re.sub(r"<[^>]*>", " ", str(page)).replace("&#8239;", " ").split())


def error(mean, largest):
    return ErrorFigure(mean_m=mean, max_m=largest, per_frame_m=[mean], time_s=[0.0])


GAP = Gap(
    base_mm=Figure(value=10.0, interval=(9.1, 11.2)), with_effect_mm=Figure(value=6.0, interval=(5.3, 6.8)),
    floor_mm=Figure(value=2.0, interval=(1.7, 2.4)), closure=Figure(value=0.66, interval=(0.51, 0.82)),
    is_held_out=True, raw_mm=17.0, closure_from_raw=0.91, edge_mm=3.3, edge_with_effect_mm=1.1,
    held_by_edge_mm=Figure(value=8.0, interval=(7.5, 8.6)), closure_held_by_edge=Figure(value=0.37, interval=None),
)  # fmt: skip


def test_the_figures_beside_a_verdict_are_those_of_the_gap():
    shown = words_on(verdict(None, diagnosis(gap=GAP)))
    for figure in (
        "base model misses by 10.0 mm root mean square, on motion not used to fit",
        "with air drag 6.0 mm root mean square, on motion",
        "the sensor's noise alone 2.0 mm root mean square; 1.7 to 2.4 mm",
        "base model on the points as tracked 17.0 mm 91 % of the gap from there closed",
        "base model has the held edge off by 3.3 mm 1.1 mm with air drag",
        "held where its edge was tracked 8.0 mm 37 % of the gap closed",
        "share of the gap closed 66 % 51 to 82 %; of squared error above the noise",
        "size of air drag 1.31 1.02 to 1.6; ",
    ):  # fmt: skip
        assert figure in shown.replace("&#39;", "'"), figure


def test_a_fit_without_motion_shows_means_and_largest_of_each_group_before_and_after():
    errors = msgspec.structs.replace(
        fit_result().error, train_before=error(0.050, 0.081), train_after=error(0.020, 0.043),
        held_out_before=error(0.060, 0.092), held_out_after=error(0.030, 0.054),
    )  # fmt: skip
    shown = {name: (value, detail) for name, value, detail in fit_figures(replace_error(errors), [])}
    assert shown["fit, held-out takes"] == (
        "60.0 → 30.0 mm", "mean distance of all points; largest 92 → 54 mm"
    )  # fmt: skip
    assert shown["fit, takes used to fit"] == (
        "50.0 → 20.0 mm", "mean distance of all points; largest 81 → 43 mm"
    )  # fmt: skip
    table = words_on(method_figures(replace_error(errors)))
    for row in (
        "maximum, takes used to fit 81 43 47 %", "mean, takes used to fit 50 20 60 %",
        "maximum, held-out takes 92 54 41 %", "mean, held-out takes 60 30 50 %",
    ):  # fmt: skip
        assert row in table, row
    sentence = words_on(verdict(replace_error(errors), None))
    assert "stays 30.0 mm from the real cloth on average on motion not used to fit, against 60.0 mm before" in sentence


def replace_error(errors, **more):
    return msgspec.structs.replace(fit_result(), error=errors, **more)


def offset_motion(before, after, **more):
    """A motion whose runs are off by so much [m] in every frame."""
    made = motion(names=("before", "after", "fit"), **more)
    runs = {
        name: replace(made.runs[name], points=np.nan_to_num(made.real) + np.array([by, 0.0, 0.0]))
        for name, by in (("before", before), ("after", after), ("fit", 2 * after))
    }
    return replace(made, runs=runs)


def test_errors_of_motions_are_of_held_out_takes_alone_where_there_are_any():
    """Fitted takes from 50 to 20 mm, held-out ones from 60 to 30, and the fit beside a diagnosis at 60."""
    both = [offset_motion(0.05, 0.02), offset_motion(0.06, 0.03, is_held_out=True)]
    sentence = words_on(verdict(fit_result(), None, both))
    assert (
        "misses the real cloth by 30.0 mm (root mean square) on motion not used to fit, against 60.0 mm before the fit"
        in sentence
    )
    shown = {name: value for name, value, _ in fit_figures(fit_result(), both)}
    assert shown == {"fit, held-out takes": "60.0 → 30.0 mm", "fit, takes used to fit": "50.0 → 20.0 mm"}
    beside = words_on(verdict(fit_result(), diagnosis(), both))
    own = "root mean square, on motion not used to fit; with the values that hangtime fit found before"
    assert f"the fit (kinect-skirt) misses by 60.0 mm {own}" in beside


@pytest.mark.parametrize(("base", "is_shown"), [(60.0, False), (57.2, False), (57.1, True), (63.2, True)])
def test_a_fit_that_misses_by_about_as_much_as_the_base_model_has_no_figure_of_its_own(base, is_shown):
    gap = msgspec.structs.replace(GAP, base_mm=Figure(value=base))
    shown = words_on(verdict(fit_result(), diagnosis(gap=gap), [offset_motion(0.06, 0.03, is_held_out=True)]))
    assert f"base model misses by {base:.1f} mm" in shown
    assert ("the fit (kinect-skirt) misses by 60.0 mm" in shown) == is_shown


def test_no_figure_at_the_top_breaks_before_its_unit_or_arrow():
    fitted = str(verdict(fit_result(), None, [offset_motion(0.06, 0.03, is_held_out=True)]))
    assert "<dd>60.0\u00a0\u2192 30.0\u00a0mm<" in fitted
    page = str(verdict(None, diagnosis(gap=GAP)))
    figures = re.findall(r"<dd>(.*?)</dd>", page)
    assert "10.0\u00a0mm<small>" in figures[0]
    assert any("; 1.7 to 2.4\u00a0mm</small>" in figure for figure in figures)
    assert any("66\u00a0%<small>51 to 82\u00a0%;" in figure for figure in figures)
    assert not [figure for figure in figures if re.search(r"\d (mm|%|\u2192)", figure)]
    assert unbroken("2 minutes of 3 mmol; 5 m/s, 4 kg") == "2 minutes of 3 mmol; 5\u00a0m/s, 4\u00a0kg"


def parts_of(page):
    """The bars of a chart: kind, beginning and width [%] of each part."""
    found = re.findall(
        r'class="(?:[a-z]+ )?(?:is-)?([a-z]+)[^"]*" style="left:\s*([\d.]+)%?;\s*width:\s*([\d.]+)%', str(page)
    )
    return [(kind, float(begin), float(width)) for kind, begin, width in found]


def test_bars_of_the_gap_end_at_the_error_that_the_effect_leaves_and_whiskers_at_interval_ends():
    """Of 1.04 x 11.2 mm: the noise to 2, the rest to 6, the removed part to 10; whiskers from 9.1 to 11.2."""
    reach = 1.04 * 11.2
    shown = parts_of(gap_bars(GAP, "air drag"))
    ends = [
        (kind, round(begin * reach / 100, 2), round((begin + width) * reach / 100, 2)) for kind, begin, width in shown
    ]
    assert ends[:4] == [("floor", 0.0, 2.0), ("rest", 2.0, 6.0), ("gone", 6.0, 10.0), ("whisker", 9.1, 11.2)]
    assert ("whisker", 5.3, 6.8) in ends
    assert ("whisker", 1.7, 2.4) in ends


def test_an_effects_bar_ends_where_its_closure_leaves_the_error():
    """Of 10 mm with 2 of noise a closure of 0.66 leaves sqrt(100 - 0.66 x 96) = 6.05 mm."""
    one = msgspec.structs.replace(diagnosis().effects[0], closure=GAP.closure)
    page = effect_bars(GAP, [one], [])
    left = math.sqrt(100 - 0.66 * 96)
    assert f"{left:.1f} mm" in words_on(page)
    assert "66 % closed" in words_on(page)
    ends = [(kind, begin, begin + width) for kind, begin, width in parts_of(page)]
    assert ends == [
        ("floor", 0.0, 20.0), ("rest", 20.0, pytest.approx(10 * left, abs=0.02)),
        ("gone", pytest.approx(10 * left, abs=0.01), pytest.approx(100.0, abs=0.02)),
    ]  # fmt: skip


def test_a_part_of_the_gap_shows_its_error_and_its_share():
    shown = words_on(where_bars("When", [WhereBin(name="turning", value_mm=7.5, share=0.31)]))
    assert "turning" in shown
    assert "7.5 mm" in shown
    assert "31 %" in shown


def test_maps_have_the_top_of_the_cloth_above_and_the_largest_error_in_full_colour():
    """SVG counts downwards: a point 0.4 m below the held edge is at y = 0.4."""
    places = [ForceAt(at_m=(0.1, 0.0), normal=1.0, in_plane=0.5), ForceAt(at_m=(-0.1, -0.4), normal=2.0, in_plane=0.25)]
    discs = re.findall(r'<circle[^>]*cx="([-\d.]+)"[^>]*cy="([-\d.]+)"[^>]*r="([\d.]+)"', str(force_map(places)))
    assert [(float(x), float(y)) for x, y, _ in discs] == [(0.1, 0.0), (-0.1, 0.4)]
    assert float(discs[0][2]) == pytest.approx(float(discs[1][2]) / 2, abs=1e-4)
    vertices = [VertexResidual(at_m=(0.0, -0.1 * k), value_mm=value) for k, value in enumerate((2.0, 6.0, 5.0))]
    shares = re.findall(r"(\d+)%", str(cloth_map(vertices)))
    assert [int(one) for one in shares[:3]] == [0, 100, 75]


def test_the_legend_of_the_gap_names_what_its_bars_hold():
    """An effect that leaves less than the noise leaves nothing unexplained, and none removes nothing."""
    gap = diagnosis().gap
    within = msgspec.structs.replace(gap, with_effect_mm=Figure(value=3.0))
    alone = msgspec.structs.replace(gap, with_effect_mm=None)
    shown = [words_on(gap_bars(one, "drag")) for one in (gap, within, alone)]
    assert ["unexplained" in words for words in shown] == [True, False, True]
    assert ["removed by drag" in words for words in shown] == [True, True, False]


def test_a_chart_says_the_whole_error_and_the_worst_frame_and_draws_both_to_scale():
    """6 mm rms of frames of 2, 8 and 6 mm, on an axis to 8 mm."""
    curve = Curve("after", np.array([0.002, 0.008, 0.006]), None, "after the fit", ("rms", 0.006))
    page = str(error_chart("take", np.array([0.0, 1.0, 2.0]), [curve]))
    assert "after the fit: rms 6.0 mm, worst frame 8.0 mm" in words_on(page)
    top, steps = axis_top(8.0)
    drawn = [100 * (1 - value / top) for value in (2.0, 8.0, 6.0)]
    assert f"M0.00 {drawn[0]:.2f}L50.00 {drawn[1]:.2f}L100.00 {drawn[2]:.2f}" in page
    assert f"M0 {drawn[2]:.2f}H100" in page
    assert {f"{top * k / steps:g}" for k in range(steps + 1)} <= set(words_on(page).split())


def spans(*parameters):
    """Where the table draws the interval, its beginning and its end [%]."""
    return [[float(one) for one in re.findall(r"([\d.]+)%", str(parameter_table([p])))] for p in parameters]


def parameter(low, high, **more):
    given = {"interval_low": 4.0, "interval_high": 8.0, "initial": 2.0, "fitted": 5.0, "is_identified": True}
    return FitParameter(name="struct", unit="1", minimum=low, maximum=high, note="", **(given | more))


def test_a_parameter_is_drawn_on_a_log_scale_from_a_range_of_thirty_times_on():
    """From 1 to 30: 2 lies at ln 2 / ln 30; from 1 to 29 at 1 / 28."""
    logs, plain = spans(parameter(1.0, 30.0), parameter(1.0, 29.0))
    for value in (2.0, 4.0, 5.0):
        assert any(one == pytest.approx(100 * math.log(value) / math.log(30), abs=0.06) for one in logs), value
        assert any(one == pytest.approx(100 * (value - 1) / 28, abs=0.06) for one in plain), value
    width = 100 * (math.log(8) - math.log(4)) / math.log(30)
    assert any(one == pytest.approx(width, abs=0.06) for one in logs)


def test_a_row_of_an_effect_holds_its_own_figures():
    found = diagnosis().effects[0]
    row = words_on(effect_table([msgspec.structs.replace(found, p_value=0.034, absorbed=0.6)], ["air_drag"]))
    for figure in ("94 %", "1.31", "1.02 to 1.6", "87 %", "79 to 93", "0.034", "0.11"):
        assert figure in row, figure
    assert "The base parameters can imitate 60 % of it." in row
    assert "imitate" not in words_on(effect_table([msgspec.structs.replace(found, absorbed=0.4)], ["air_drag"]))


def test_an_objective_falls_by_shares_of_what_it_was_and_a_trivial_predictor_is_judged_on_the_held_out_takes():
    """Parts from 8 to 2 and from 4 to 3 fall by 75 and 25 %, the whole from 12 to 5 by 58 %."""
    objective = ObjectiveFigure(
        name="E/N", unit="1", before=12.0, after=5.0, parts={"position": (8.0, 2.0), "velocity": (4.0, 3.0)}
    )
    rigid = TrivialFigure(name="vertical", parameters={}, train=error(0.071, 0.1), held_out=error(0.083, 0.1))
    shown = words_on(method_figures(replace_error(fit_result().error, objective=objective, trivial=[rigid])))
    for row in ("position 8 2 75 %", "velocity 4 3 25 %", "E/N, the whole 12 5 58 %", "instead, held-out takes 83"):
        assert row in shown, row


def test_the_history_of_a_search_is_in_millimetres_or_in_the_objectives_own_unit():
    """0.04 m are 40 mm; an E of 40 is 40."""
    own = ObjectiveFigure(name="E/N", unit="1", before=40.0, after=20.0, parts={})
    for objective, scale in ((None, 1e-3), (own, 1.0)):
        history = [40.0 * scale, 20.0 * scale]
        page = words_on(search_history(msgspec.structs.replace(fit_result(), history=history, objective=objective)))
        assert " 40 " in f" {page} "
        assert ("mm" in page) == (objective is None)


def test_single_points_are_the_worst_ones_with_their_root_mean_square():
    """Of three free points one is off by 30 mm, and one by 1 and 7 mm by turns: 5 mm."""
    made = motion(names=("before",), noise=0.0)
    off = np.zeros(made.real.shape)
    off[:, 2, 0], off[:, 3, 0], off[::2, 4, 0], off[1::2, 4, 0] = 0.030, 0.001, 0.001, 0.007
    made = replace(made, runs={"before": replace(made.runs["before"], points=np.nan_to_num(made.real) + off)})
    page = words_on(sections.errors(None, [made], 1))
    names = re.findall(r"(bottom right|bottom left|centre), distance of this point", page)
    assert list(dict.fromkeys(names)) == ["bottom right", "centre", "bottom left"]
    assert "rms 5.0 mm, largest 7.0 mm" in page
    assert "rms 30.0 mm" in page


def test_a_missing_force_is_shown_with_its_own_shares_and_the_sign_of_its_power():
    force = diagnosis().missing_force
    for power, does in ((-0.2, "takes energy out"), (0.2, "gives energy to the cloth")):
        shown = words_on(sections.missing_force(msgspec.structs.replace(force, power=power)))
        assert f"({does}) 61 %" in shown
        assert "(stores energy, or is constant) 7 %" in shown
        assert "along the cloth's normal 83 %" in shown.replace("&#39;", "'")
    assert "8.4 standard deviations, against 2.1 now" in words_on(sections.next_experiment(diagnosis()))


def test_sizes_are_put_in_relation_to_what_is_known():
    """A drag of 2.4 is twice a flat plate's 1.2, a lift of pi half of 2 pi."""
    assert "2 times that of a flat plate" in meaning_of("air_drag", 2.4)
    assert "0.5 times that of a thin plate" in meaning_of("air_lift", math.pi)


def test_units_of_text_are_converted():
    assert millimetres(0.0123) == "12.3 mm"
    assert [probability(value) for value in (0.0009, 0.0012, 0.034, 0.25)] == ["< 0.001", "0.001", "0.034", "0.25"]
    assert (duration(89.0), duration(150.0)) == ("89.0 s", "2.5 min")


class Drawn:
    """Stands in for the simulator: the cloth's area, and the materials and amplitudes that it was asked for."""

    asked: tuple = ()

    def __init__(self, recording, effects, resolution):
        self.mesh = SimpleNamespace(area=0.25, triangles=np.zeros((0, 3), int))
        self._points = recording.points

    def run(self, materials, amplitudes, **more):
        Drawn.asked = materials, amplitudes
        return SimpleNamespace(points=np.stack([self._points] * len(materials)), shapes=None)


def a_recording():
    garment, time = sheet(mass=0.05), np.arange(0, 2, 1 / 30)
    return prepare(take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None]))


def test_the_motion_of_a_report_is_of_the_weighed_garment_and_of_the_fits_effects(monkeypatch, tmp_path):
    """50 g on 0.25 m^2 are 0.2 kg/m^2; a hem of 0.012 kg/m of the fit is drawn with the fit alone."""
    monkeypatch.setattr(gather, "Simulator", Drawn)
    monkeypatch.setattr(gather, "_written", lambda path, fitted, findings, motions, origin: motions)
    monkeypatch.setattr(gather, "origin_of", lambda *given: None)
    takes = SimpleNamespace(training=[a_recording()], held_out=[])
    fit = a_fit(effects={"hem": 0.012})
    effects = find_effects(["hem", "air_drag"])
    findings = SimpleNamespace(
        effects=effects, best=None, diagnosis=diagnosis(named=[], verdict="none"), takes=takes, resolution=None,
        model=SI, base=SimpleNamespace(vector=SI.initial), frequency=0.0,
    )  # fmt: skip
    (drawn,) = gather.write_diagnosis_report(tmp_path / "report.html", findings, fit)
    materials, amplitudes = Drawn.asked
    assert list(drawn.runs) == ["base", "fit"]
    assert materials[:, mat.DENSITY] == pytest.approx([0.2, 0.2])
    assert amplitudes.tolist() == [[0.0, 0.0], [0.012, 0.0]]
    request = SimpleNamespace(method=SI, engine="own", effects=effects[:1], resolution=None)
    gather.write_fit_report(tmp_path / "report.html", fit, takes, request)
    materials, amplitudes = Drawn.asked
    assert materials[:, mat.DENSITY] == pytest.approx([0.2, 0.2])
    assert amplitudes.tolist() == [[0.0], [0.012]]


def test_a_picture_of_residuals_is_signed_and_says_the_whole_distance(monkeypatch, tmp_path):
    """Tracked 3, 4 and 12 mm from the simulated points are 13 mm of distance; along the bar they lie ahead."""
    pytest.importorskip("PIL")
    from PIL.ImageDraw import ImageDraw

    recording = a_recording()
    simulated = recording.points - np.array([0.003, 0.004, 0.012])
    ahead = views_of(recording, simulated)
    assert np.nanmean(ahead.along[ahead.counted][:, 0]) == pytest.approx(0.003, abs=1e-4)
    said = []
    monkeypatch.setattr(ImageDraw, "text", lambda self, at, text, **more: said.append(text))
    draw_residuals(recording, simulated, tmp_path / "left.png", "thirteen")
    assert said[0] == "thirteen: 13.0 mm, root mean square distance of the free points"


def test_the_ticks_of_a_chart_stand_at_their_instants():
    """Of a take from 10 to 12 s the first tick stands at the left end, and 11 in the middle."""
    curve = Curve("after", np.array([0.002, 0.008, 0.006]), None, "after the fit")
    page = str(error_chart("take", np.array([10.0, 11.0, 12.0]), [curve]))
    assert re.search(r"left:\s*0.00%[^>]*>\s*10\s*<", page)
    assert re.search(r"left:\s*50.00%[^>]*>\s*11\s*<", page)
