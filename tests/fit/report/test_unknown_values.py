"""No page, table or file shows a number for what the takes do not identify, and each error names its measure."""

from __future__ import annotations

import csv
import io

import msgspec
import pytest

import hangtime
from fit.api.shown import diagnosis_tables, effect_table, fit_tables
from fit.api.tables import as_html, as_text
from fit.report import sections, terms
from fit.report.again import WHY_LARGER, errors_of_report
from fit.report.kept import created_of, save_motions
from fit.report.origin import Origin
from fit.report.page import render_report
from fit.report.text import unit_words
from formats.fit_records import FitParameter
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.report.test_shown_figures import words_on

BENT = FitParameter(
    name="bend", unit="Blender", initial=20.0, fitted=77.7, minimum=0.1, maximum=150.0, interval_low=60.0,
    interval_high=90.0, is_identified=True,
)  # fmt: skip


def with_fit(is_identified):
    found = [
        msgspec.structs.replace(p, is_identified=is_identified) if p.name == "bend" else p
        for p in fit_result().parameters
    ]
    return msgspec.structs.replace(fit_result(), parameters=found)


def test_a_base_model_has_no_value_for_what_the_fit_above_it_does_not_identify():
    """The diagnosis' own interval, 60 to 90, leaves out the other minima that the fit's search met."""
    found = diagnosis(base_parameters=[BENT])
    assert "77.7" in words_on(sections.parameters(None, found))
    assert "77.7" in words_on(sections.parameters(with_fit(True), found))
    page = words_on(sections.parameters(with_fit(False), found))
    assert "77.7" not in page
    assert "Not identified. The fit above found other values that follow the takes as well." in page
    assert "77.7 Blender" in words_on(render_report(fit=with_fit(True), diagnosis=found, motions=[]))
    assert "77.7 Blender" not in words_on(render_report(fit=with_fit(False), diagnosis=found, motions=[]))


def test_an_effect_of_a_fit_that_is_not_identified_has_no_size_on_the_page():
    """0.987 kg/m of hem, and 1.234 of drag, which are 1.03 flat plates."""
    drag = msgspec.structs.replace(BENT, name="air_drag", unit="1", fitted=1.234, is_identified=False)
    hem = msgspec.structs.replace(BENT, name="hem", unit="kg/m", fitted=0.987, is_identified=False)
    fit = msgspec.structs.replace(fit_result(), parameters=[drag, hem], effects={"air_drag": 1.234, "hem": 0.987})
    page = words_on(sections.parameters(fit, None))
    for number in ("1.23", "1.03", "0.987"):
        assert number not in page
    assert "hem not identified; extra mass per length of the bottom edge" in page
    known = [msgspec.structs.replace(p, is_identified=True) for p in (drag, hem)]
    page = words_on(sections.parameters(msgspec.structs.replace(fit, parameters=known), None))
    assert "hem 0.987 kg/m: extra mass" in page
    assert "1.03 times that of a flat plate" in page


@pytest.fixture
def stopped():
    effects = [
        msgspec.structs.replace(e, amplitude=0.0481, amplitude_interval=None, note="at its bound, so that its size ...")
        if e.id == "hem"
        else e
        for e in diagnosis().effects
    ]
    return diagnosis(effects=effects)


def test_an_effect_at_its_bound_has_no_size_in_any_table(stopped):
    shown = [
        words_on(sections.effects(stopped)), as_text([effect_table(stopped)]), as_html([effect_table(stopped)]),
        as_text(diagnosis_tables(stopped, ("hem",))), hangtime.DiagnosisOutcome(result=stopped).to_csv(),
    ]  # fmt: skip
    for text in shown:
        assert "0.0481" not in text
    assert "With hem: closes 8 % of the gap [-2 to 15 %] (p = 0.210)." in shown[3]
    rows = {row["effect"]: row["amplitude"] for row in csv.DictReader(io.StringIO(shown[4]))}
    assert (rows["air_drag"], rows["hem"], rows["clip_slip"]) == ("1.31", "", "")


def test_a_share_of_the_gap_is_told_to_be_of_squares_where_bars_are_lengths():
    for shown in (sections.gap(diagnosis()), sections.effects(diagnosis()), terms.reading(diagnosis())):
        assert "of squared errors" in words_on(shown)


def test_a_fits_terminal_names_the_measure_of_the_report_and_why_its_figures_are_larger(tmp_path):
    motions = [motion("a", names=("before", "after")), motion("b", True, names=("before", "after"))]
    save_motions(tmp_path / "report.html", motions, Origin(), created_of(fit_result(), None))
    lines = errors_of_report(tmp_path / "report.html", fit_result())
    assert [line.split()[:5] for line in lines[:3]] == [
        ["root", "mean", "square", "of", "free"], ["as", "in", "the", "report,", "training"],
        ["as", "in", "the", "report,", "held"],
    ]  # fmt: skip
    assert lines[3] == WHY_LARGER


def test_an_effect_that_was_asked_for_and_may_be_absent_is_told_by_its_interval_alone():
    """A hem of -0.001 to 0.009 kg/m about 0.004."""
    told = as_text(diagnosis_tables(diagnosis(), ("hem", "air_drag")))
    assert "With hem (-0.001 to 0.009 kg/m, 90 % interval): closes 8 % of the gap [-2 to 15 %] (p = 0.210)." in told
    assert "With air_drag at 1.31: closes 87 % of the gap" in told
    drag = next(e for e in diagnosis().effects if e.id == "air_drag")
    for p_value, words in ((0.0004, "(p < 0.001)."), (0.001, "(p = 0.001)."), (1.0, "(p = 1.000).")):
        tested = diagnosis(effects=[msgspec.structs.replace(drag, p_value=p_value)])
        assert words in as_text(diagnosis_tables(tested, ("air_drag",)))


@pytest.mark.parametrize(
    ("amplitude", "least", "is_told"), [(0.02, 0.01, True), (0.005, 0.01, False), (0.0, None, False)]
)
def test_a_screened_effect_has_a_size_only_where_the_takes_could_have_shown_one_so_large(amplitude, least, is_told):
    """None of these has an interval: they were not refitted."""
    hem = diagnosis().effects[1]
    screened = msgspec.structs.replace(
        hem, amplitude=amplitude, amplitude_interval=None, closure=None, minimum_detectable=least, note="screened only"
    )
    refitted = diagnosis().effects[2]  # without a gap no effect has a probability
    found = diagnosis(effects=[screened, refitted], verdict="unknown", named=[])
    size = as_text([effect_table(found)]).splitlines()[1].split()[3]
    assert size == ("0.02" if is_told else "-")
    page = words_on(sections.effects(found))
    assert "Screened only." in page
    assert ("0.02 kg/m" in page) == is_told


def test_units_of_the_page_are_set_and_not_typed():
    typed = ("1/s", "1/m", "m2/s2", "m4/s2", "kg/m^2", "s^2", "N m", "Blender")
    assert [unit_words(unit) for unit in typed] == [
        "per s", "per m", "m²/s²", "m⁴/s²", "kg/m²", "s²", "N m", "Blender",
    ]  # fmt: skip


def test_a_fits_table_says_what_the_mean_and_the_worst_are_of():
    text = as_text(fit_tables(fit_result()))
    for row in ("all frames, training", "worst frame, training", "all frames, held out", "worst frame, held out"):
        assert row in text
