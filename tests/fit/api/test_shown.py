"""Tables of results in the terminal."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import pytest

from fit.api.results import DiagnosisOutcome, Simulation
from fit.api.shown import diagnosis_tables, effect_table, fit_tables
from fit.api.tables import Table, as_html, as_text
from fit.recordings.intact import describe_missing
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.test_archive import a_take


def test_a_fit_and_a_diagnosis_name_the_seconds_that_their_takes_lack():
    """A second is missing in the middle: 2.25 to 3.25 s after the first frame."""
    (note,) = describe_missing([replace(a_take(150), is_complete=False, missing=((2.5, 3.5),))])
    for tables, result in ((fit_tables, fit_result()), (diagnosis_tables, diagnosis())):
        damaged = msgspec.structs.replace(result, notes=["Another note.", note])
        shown = as_text(tables(damaged))
        assert "missing: 2.25 to 3.25 s" in shown
        assert "Another note." not in shown


def test_a_parameter_at_its_bound_shows_its_interval_and_says_so():
    result = a_fit(unknown=("stretch_stiffness",))
    stopped = [msgspec.structs.replace(p, is_at_bound=p.is_identified is False) for p in result.parameters]
    line = next(x for x in as_text(fit_tables(msgspec.structs.replace(result, parameters=stopped))).splitlines()
                if x.startswith("stretch_stiffness"))  # fmt: skip
    assert line.split() == [
        "stretch_stiffness",
        "[N/m]",
        "300",
        "-",
        "80",
        "to",
        "125",
        "not",
        "identified,",
        "at",
        "its",
        "bound",
    ]


def test_the_effects_have_intervals_and_no_unit_one():
    """As in the report: an effect without evidence has an interval and no size."""
    found = diagnosis()
    drag = msgspec.structs.replace(
        found.effects[0],
        id="air_drag",
        tested=True,
        unit="1",
        amplitude=1.08,
        amplitude_interval=(0.9, 1.2),
        probability=0.9,
    )
    curl = msgspec.structs.replace(
        drag, id="rest_curvature", unit="1/m", amplitude=0.0, amplitude_interval=(-2.0, 1000.2), probability=0.1
    )
    rows = effect_table(msgspec.structs.replace(found, effects=[drag, curl], named=["air_drag"])).rows
    assert [row[:4] for row in rows] == [
        ("air_drag", "90 %", "1.08", "0.9 to 1.2"), ("rest_curvature", "10 %", "-", "-2 to 1000 per m")
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("probability", "said"),
    [
        (1.0, "more than 99 %"),
        (0.99, "99 %"),
        (0.5, "50 %"),
        (0.004, "less than 1 %"),
        (0.0, "less than 1 %"),
        (None, ""),
    ],
)
def test_a_table_of_effects_gives_probabilities_in_the_verdicts_words(probability, said):
    """Draws are never so sure that nothing or everything is left."""
    found = diagnosis()
    drag = msgspec.structs.replace(found.effects[0], probability=probability)
    (row,) = effect_table(msgspec.structs.replace(found, effects=[drag])).rows
    assert row[1] == said
    assert f" {said} " in str(DiagnosisOutcome(result=msgspec.structs.replace(found, effects=[drag])))


def test_an_effect_that_was_screened_only_says_so_with_a_size_or_without():
    found = diagnosis()
    drag = msgspec.structs.replace(
        found.effects[0], id="air_drag", tested=True, unit="1", amplitude=1.08, amplitude_interval=(0.9, 1.2)
    )
    large = msgspec.structs.replace(drag, id="anisotropy", amplitude=2.42, minimum_detectable=0.5, note="screened only")
    large = msgspec.structs.replace(large, amplitude_interval=None, closure=None)
    small = msgspec.structs.replace(large, id="hem", amplitude=0.1)
    rows = effect_table(msgspec.structs.replace(found, effects=[drag, large, small], named=["air_drag"])).rows
    assert {row[0]: (*row[2:4], row[5]) for row in rows} == {
        "air_drag": ("1.08", "0.9 to 1.2", "named"), "anisotropy": ("2.42", "", "screened only"),
        "hem": ("-", "", "screened only"),
    }  # fmt: skip


def test_each_sentence_below_the_parameters_stands_by_itself():
    """It began with "That of an effect's size", below a sentence on several intervals."""
    kept = msgspec.structs.replace(a_fit(), effects={"air_drag": 1.0})
    remarks = fit_tables(kept)[0].remarks
    assert remarks[1].startswith("The interval of an effect's size covers mesh, solver and ")
    assert fit_tables(a_fit())[0].remarks == (remarks[0], "`hangtime diagnose` finds missing physics.")


def test_a_simulation_with_a_fit_prints_no_value_that_the_fit_does_not_identify():
    result = a_fit(unknown=("stretch_stiffness",))
    values = {p.name: p.fitted for p in result.parameters}
    shown = Simulation(
        takes=(), values=values, fitted=tuple(result.parameters), error=result.error.train_after, by_take=()
    )
    rows = {line.split()[0]: line.split()[1:] for line in str(shown).splitlines()}
    assert rows["stretch_stiffness"] == ["80", "to", "125,", "not", "identified"]
    assert rows["shear_stiffness"] == ["30"]
    assert shown.to_dict()["not_identified"] == ["stretch_stiffness"]
    assert shown.to_dict()["parameters"]["stretch_stiffness"] == 100.0


def test_a_cell_of_html_shows_markup_and_control_codes_as_text():
    """A notebook shows names of old takes, which may hold codes of a terminal."""
    shown = as_html([Table(heads=("<b>",), rows=(("a\x1b[31m",),), remarks=("r\x07 & s",))])
    assert re.findall(r"<(?:th|td|p)>(.*?)</", shown) == ["&lt;b&gt;", r"a\x1b[31m", r"r\x07 &amp; s"]
