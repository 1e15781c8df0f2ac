"""Words and figures of the report on constructed records, against texts written by hand."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from fit.folders import PARTIAL
from fit.report import sections
from fit.report.again import results_in
from fit.report.answer import run_names, verdict
from fit.report.charts import cloth_map, gap_bars
from fit.report.compare import SideBySide, compare
from fit.report.effects import SHOWN_EFFECTS
from fit.report.gather import _motion
from fit.report.methods import method_figures
from fit.report.packing import POINT_STEP, _without_meshes, pack
from fit.report.plot import COLOURS, draw_plot
from fit.report.residual_picture import draw_residuals, views_of
from fit.report.sketches import _ticks
from fit.report.tables import effect_table
from formats.diagnosis_records import VertexResidual
from formats.fit_records import ObjectiveFigure
from formats.results import save_fit_result
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.report.test_residual_picture import shifted
from tests.fit.report.test_shown_figures import GAP, error, offset_motion, words_on


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_a_result_is_shown_though_another_command_on_its_folder_is_unfinished(tmp_path, command):
    save_fit_result(tmp_path / "fit.json", fit_result())
    (tmp_path / PARTIAL[command]).write_bytes(b"")
    assert results_in(tmp_path).fit == fit_result()


def test_the_size_of_a_named_effect_and_both_ends_of_it_are_in_its_unit():
    shown = words_on(verdict(None, diagnosis(named=["hem"])))
    assert re.search(r"size of hem 0\.004 kg/m .0\.001 to 0\.009 kg/m; ", shown)


def test_a_fit_without_held_out_motion_says_its_errors_on_what_it_was_fitted_to():
    errors = msgspec.structs.replace(
        fit_result().error, train_before=error(0.050, 0.081), train_after=error(0.020, 0.043), held_out_before=None,
        held_out_after=None,
    )  # fmt: skip
    sentence = words_on(verdict(msgspec.structs.replace(fit_result(), error=errors), None))
    assert (
        "stays 20.0 mm from the real cloth on average on the motion it was fitted to, against 50.0 mm before the fit."
    ) in sentence


def test_each_bar_of_the_gap_says_its_own_error():
    shown = words_on(gap_bars(GAP, "air drag"))
    for row in (
        "base model 10.0 mm", "with air drag 6.0 mm", "held by its tracked edge 8.0 mm", "noise floor 2.0 mm",
    ):  # fmt: skip
        assert row in shown, row


def test_the_figures_beside_the_spots_of_a_map_are_inside_it():
    """A swatch of 0.4 m: spots of 0.024 m, 1.5 of them on either side, and figures that take 7 more on the right."""
    outline = np.array([(-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4)])
    page = str(cloth_map([VertexResidual(at_m=(0.2, -0.1), value_mm=3.0)], outline))
    (box,) = re.findall(r'viewBox="([^"]*)"', page)
    assert [float(one) for one in box.split()] == pytest.approx([-0.236, -0.036, 0.4 + 10 * 0.024, 0.472], abs=1e-3)


def test_a_report_is_written_where_the_help_text_says(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    assert hangtime_here("report", ".", folder=tmp_path).stdout.split()[-1] == "report.html"
    assert "[default: (DIR/report.html)]" in " ".join(hangtime_here("report", "--help", folder=tmp_path).stdout.split())


def test_a_page_of_a_comparison_holds_its_remarks_and_no_list_without_one():
    shown = SideBySide("fits", ("a", "b"), (("seed", "1", "2"),), ({}, {}), ("the rig was not measured",))
    assert "the rig was not measured" in words_on(shown.page())
    bare = SideBySide("fits", ("a", "b"), (("seed", "1", "2"),), ({}, {})).page()
    assert shown.page().count("<ul") == bare.count("<ul") + 1


def test_a_comparison_shows_each_groups_own_errors(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_fit_result(tmp_path / name / "fit.json", fit_result())
    rows = {row[0]: row[1] for row in compare([tmp_path / "a", tmp_path / "b"]).rows}
    shown = [re.findall(r"[\d.]+", rows[f"mean distance of all points, takes {group}"])[:2]
             for group in ("fitted to", "held out")]  # fmt: skip
    assert shown == [["127.6", "46.7"], ["131.0", "51.2"]]


def test_simulated_cloth_moved_freely_unless_a_pull_is_stated():
    recording, _ = shifted((0.0, 0.0, 0.0))
    assert (_motion(recording, False, np.zeros((0, 3), int), {}).pull_hz, motion().pull_hz) == (0.0, 0.0)


def test_the_measure_of_publications_and_the_columns_of_an_objective_are_named():
    parts = {"position": (8.0, 2.0), "velocity": (4.0, 3.0)}
    objective = ObjectiveFigure(name="E/N", unit="1", before=12.0, after=5.0, parts=parts)
    shown = words_on(method_figures(msgspec.structs.replace(fit_result(), objective=objective)))
    assert "Publications, and the tables of hangtime fit , state the mean distance of all points, held" in shown
    assert "part of the objective manual optimised down by" in shown
    assert "position 8 2 75 %" in shown


def test_effects_are_described_by_what_they_do_to_the_cloth():
    assert "does not spring back whole" in str(SHOWN_EFFECTS["bending_hysteresis"])
    assert "The more the cloth is stretched, the stiffer it becomes." in str(SHOWN_EFFECTS["strain_stiffening"])


def test_the_player_holds_the_points_of_each_run_beside_the_real_ones():
    made = offset_motion(0.05, 0.02)
    packed = _without_meshes(made)
    for name in made.runs:
        assert packed["points"][name] == pack(made.compared(name), POINT_STEP)
        assert packed["points"][name] != packed["real"]


def test_an_error_that_grows_rises_in_its_plot(monkeypatch, tmp_path):
    pytest.importorskip("PIL")
    drawn = []
    monkeypatch.setattr(
        "fit.report.plot.SoftLines.draw",
        lambda self, line, colour, width=1: drawn.append(line) if colour == COLOURS["after"] else None,
    )
    made = offset_motion(0.0, 0.0)
    growing = np.linspace(0.0, 0.05, len(made.time))[:, None, None] * np.array([1.0, 0.0, 0.0])
    made.runs["after"].points[:] = np.nan_to_num(made.real) + growing
    draw_plot([made], run_names(fit_result(), None), tmp_path / "a.png")
    (line,) = drawn
    across, down = np.array(line).T
    assert (np.diff(across) > 0).all()
    assert (np.diff(down) < 0).all()


def test_residuals_out_of_the_cloth_count_along_bar_times_down_and_each_view_says_its_instant(monkeypatch, tmp_path):
    """The bar along x, down against z: x times down is y. Six instants of a take, one in each sixth of it."""
    pytest.importorskip("PIL")
    from PIL.ImageDraw import ImageDraw

    recording, simulated = shifted((0.0, 0.004, 0.0))
    views = views_of(recording, simulated)
    assert np.median(views.along[views.counted][:, 2]) == pytest.approx(0.004, abs=1e-3)
    said = []
    monkeypatch.setattr(ImageDraw, "text", lambda self, at, text, **more: said.append(text))
    draw_residuals(recording, simulated, tmp_path / "a.png")
    instants = {
        name: [one.split(", ")[1] for one in said if one.startswith(f"{name}, ")]
        for name in ("front", "side", "in plane")
    }
    assert len(set(instants["front"])) > 2
    assert instants["in plane"] == instants["side"] == instants["front"]


def test_errors_over_time_are_those_of_the_motions_and_of_the_fit_only_without_one():
    shown = words_on(sections.errors(fit_result(), [offset_motion(0.05, 0.02)], 0))
    assert "swing-01 (used to fit)" in shown
    assert "rms 20.0 mm" in shown
    assert "takes used to fit" not in shown
    bare = words_on(sections.errors(fit_result(), [], 0))
    assert "takes used to fit" in bare
    assert "the mean over the points, and dashed of all" in bare


def test_a_named_effect_is_marked_in_bars_and_table_and_no_other_is():
    (found, other) = diagnosis().effects[:2]
    assert words_on(sections.effects(diagnosis())).count("air drag named") == 2
    assert "hem named" not in words_on(sections.effects(diagnosis()))
    assert "named" in words_on(effect_table([found], ["air_drag"]))
    assert "named" not in words_on(effect_table([other], ["air_drag"]))


def test_places_of_errors_and_forces_say_whose_and_what_share():
    assert "Root mean square error of the base model; small, the part's share" in words_on(
        sections.where(diagnosis())
    ).replace("&#39;", "'")
    force = msgspec.structs.replace(diagnosis().missing_force, spatial_share={"bottom left": 0.62, "top left": 0.07})
    assert "place bottom left 62 %, top left 7 %" in words_on(sections.missing_force(force))


def test_a_tick_is_as_long_above_its_line_as_below():
    assert _ticks("hot", 20.0, 5.0) == ("hot", "M5 14v12")
