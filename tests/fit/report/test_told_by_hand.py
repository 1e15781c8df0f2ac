"""What the report tells of made-up records, word by word and figure by figure."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from fit.folders import PARTIAL
from fit.report.again import results_in
from fit.report.answer import verdict
from fit.report.charts import cloth_map, gap_bars
from fit.report.compare import SideBySide, compare
from formats.diagnosis_records import VertexResidual
from formats.results import save_fit_result
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.report.test_shown_figures import GAP, error, words_on


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
