"""Parts of a page, and of a comparison, that say one thing in two places agree."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from fit.api.said import next_step
from fit.api.shown import OWN_BASE_FIT, diagnosis_tables
from fit.api.tables import as_text
from fit.identification.notes_on_values import (
    LOOKS_FOR_ONE,
    STOPPED_AT_BOUND,
    note_on_start,
    notes_beside,
    notes_on_values,
)
from fit.identification.read_again import read_fit
from fit.recordings.ready import ready
from fit.report import sections, terms
from fit.report.answer import candidates_of
from fit.report.page import packaged, render_report
from fit.report.tables import effect_table
from formats.errors import HangtimeError
from formats.results import save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.fit.test_command_line import a_swung_take

AT_BOUND = STOPPED_AT_BOUND.format(names="bend", cause=LOOKS_FOR_ONE)


def stopped(fit, name="bend"):
    """A fit one of whose parameters is at its bound, as its notes say."""
    ended = [
        msgspec.structs.replace(p, is_identified=p.name != name, is_at_bound=p.name == name) for p in fit.parameters
    ]
    return msgspec.structs.replace(fit, parameters=ended, notes=["Another note.", *notes_on_values(ended)])


def test_only_the_frames_of_a_fit_are_dotted_and_neither_its_worst_point_nor_its_mean():
    dotted = re.findall(r"^(.*?) \{[^}]*stroke-dasharray: 0 7", packaged("page.css"), re.MULTILINE)
    assert dotted == [".plot path.is-fit:not(.largest, .mean)"]


def test_the_force_is_reconciled_with_the_effects_that_the_refits_found():
    force = diagnosis().missing_force
    assert candidates_of(diagnosis()) == ["air_drag"]
    shown = sections.missing_force(force, None, ["air_drag", "hem"])
    assert "the force may look unlike air drag or hem, which the refits found" in shown
    assert "which the refits found" not in sections.missing_force(force)
    assert "unlike air drag, which" in render_report(fit=None, diagnosis=diagnosis())


def test_an_unnamed_effect_that_is_likelier_than_not_is_a_candidate():
    drag, *others = (msgspec.structs.replace(one, probability=0.1) for one in diagnosis().effects)
    for chance, found in ((0.5, ["air_drag"]), (0.49, [])):
        likely = msgspec.structs.replace(drag, probability=chance)
        assert candidates_of(diagnosis(verdict="unknown", named=[], effects=[likely, *others])) == found


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "the diagnosis beside this fit names air drag."),
        (
            {"verdict": "ambiguous", "named": ["air_drag", "air_lift"]},
            "the diagnosis beside this fit names air drag or air lift.",
        ),
        ({"verdict": "several", "named": ["air_drag", "hem"]}, "the diagnosis beside this fit names air drag and hem."),
        ({"verdict": "unknown", "named": []}, "the diagnosis beside this fit names none."),
    ],
)
def test_notes_say_what_the_diagnosis_beside_a_fit_found(changes, said):
    fit = stopped(fit_result())
    assert fit.notes == ["Another note.", AT_BOUND]
    other, note = notes_beside(fit, diagnosis(**changes))
    assert other == "Another note."
    assert note.endswith(f"A missing effect may drive it there: {said}")
    assert AT_BOUND.endswith("hangtime diagnose looks for one.")


def test_a_warning_of_a_fit_worse_than_its_start_says_what_the_diagnosis_found():
    fit = fit_result()
    error = msgspec.structs.replace(fit.error, train_after=fit.error.train_before, train_before=fit.error.train_after)
    worse = note_on_start(error, fit.search)
    assert worse.endswith("`hangtime diagnose` looks for missing physics.")
    fit = msgspec.structs.replace(fit, error=error, notes=[worse, f"Somebody wrote: {LOOKS_FOR_ONE}."])
    told, own = notes_beside(fit, diagnosis())
    assert told.endswith("tell little of the cloth; the diagnosis beside this fit names air drag.")
    assert own == fit.notes[1]  # only what the fit itself worded is worded again


def test_a_page_of_both_and_a_fabric_do_not_send_the_reader_to_the_diagnosis(tmp_path):
    fit = stopped(fit_result())
    assert "looks for one" in render_report(fit=fit, diagnosis=None)
    page = render_report(fit=fit, diagnosis=diagnosis())
    assert "looks for one" not in page
    assert "the diagnosis beside this fit names air drag" in page
    known = msgspec.structs.replace(stopped(a_fit(), "shear_stiffness"), take_contents=["beef"])
    save_fit_result(tmp_path / "fit.json", known)
    found = diagnosis(take_ids=known.take_ids, take_contents=known.take_contents)
    save_diagnosis(tmp_path / "diagnosis.json", found)
    told = read_fit(tmp_path)[0].notes
    assert (
        STOPPED_AT_BOUND.format(names="shear_stiffness", cause="the diagnosis beside this fit names air drag") in told
    )
    assert not [note for note in told if LOOKS_FOR_ONE in note]


def test_a_folder_of_a_diagnosis_alone_is_said_to_be_one_where_a_fabric_is_asked_for(tmp_path):
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    with pytest.raises(HangtimeError, match="holds a diagnosis and no fit, and a diagnosis has no fabric; run `hang"):
        read_fit(tmp_path)


def test_a_folder_of_both_is_compared_by_its_diagnosis_with_one_of_a_diagnosis_alone(tmp_path):
    for name in ("both", "alone", "fit"):
        (tmp_path / name).mkdir()
    for name in ("both", "alone"):
        save_diagnosis(tmp_path / name / "diagnosis.json", diagnosis())
    for name in ("both", "fit"):
        save_fit_result(tmp_path / name / "fit.json", fit_result())
    (tmp_path / "kept.json").write_bytes((tmp_path / "alone/diagnosis.json").read_bytes())
    for pair in (("both", "alone"), ("alone", "both"), ("both", "alone/diagnosis.json"), ("both", "kept.json")):
        assert re.search(r"^verdict +effect +effect$", hangtime_here("compare", *pair, folder=tmp_path).stdout, re.M)
    assert "method" in hangtime_here("compare", "both", "fit", folder=tmp_path).stdout
    assert hangtime_here("compare", "alone", "fit", folder=tmp_path).returncode == 2


def test_the_terminal_says_that_the_bounds_of_a_diagnosis_are_those_of_its_own_fit():
    bounded = msgspec.structs.replace(diagnosis().base_parameters[0], is_at_bound=True, is_identified=False)
    for one, is_said in ((bounded, True), (msgspec.structs.replace(bounded, is_at_bound=False), False)):
        assert (OWN_BASE_FIT in as_text(diagnosis_tables(diagnosis(base_parameters=[one])))) == is_said


def test_terms_say_what_a_probability_and_more_than_all_of_a_gap_mean():
    page = terms.reading(diagnosis())
    assert "It is no test" in page
    assert "more means that less is left than the noise" in page


def test_every_column_of_the_table_of_effects_is_explained_by_its_own_name():
    columns = re.findall(r"<th[^>]*class=number>(.*?)</th>", str(effect_table((), ())))
    assert len(columns) == 5
    assert set(columns) <= {term.casefold() for term in terms.OF_A_DIAGNOSIS}


def test_terms_of_a_verdict_by_evidence_tell_of_masses_and_of_no_test():
    for by, is_tested in (({}, True), ({"--by": "rules"}, True), ({"--by": "evidence"}, False)):
        page = str(terms.reading(diagnosis(options=by)))
        assert ("p-value" in page) == is_tested
        assert ("where the judged takes do not confirm" in page) == is_tested
        assert ("weighed on the takes fitted to" in page) != is_tested
        assert ("It is no test" in page) == is_tested
        assert "An interval that includes zero" in page


def test_after_a_fit_of_takes_without_motion_no_diagnosis_is_proposed():
    time, garment = np.arange(0, 3, 1 / 30), sheet()
    still = take_of(garment, time, swing(time, amplitude=0.0), hung(garment, time), name="still")
    assert next_step(ready([a_swung_take(seconds=3.0)], []), "Next: ...") == "Next: ..."
    said = next_step(ready([still], []), "Next: ...")
    assert said.startswith(
        "`hangtime diagnose` would name no effect from these takes. The hanger's smoothed path spans 0 "
    )


def test_a_page_says_beside_the_base_models_values_that_another_library_may_give_others():
    page = render_report(fit=fit_result(), diagnosis=diagnosis())
    _, _, below = page.partition("Base model of the diagnosis")
    lead, _, _ = below.partition("</table>")
    assert "so another library of effects may end it elsewhere." in lead
