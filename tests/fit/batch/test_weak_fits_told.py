"""A batch says of each fit and each left-out take what `hangtime fit` and the rules of a diagnosis say."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import msgspec
import pytest

from fit.api.shown import fit_tables
from fit.api.tables import as_text
from fit.batch import runner
from fit.batch.garments import Wardrobe, wardrobe_of, wardrobes
from fit.batch.jobs import Outcome, diagnosis_name, result_name
from fit.batch.kept import keep
from fit.batch.morning import as_html, morning_of
from fit.batch.morning import as_text as as_mail
from fit.batch.runner import Survey, survey
from fit.batch.store import open_store
from fit.batch.summary import Row, lines_of
from fit.identification.calibrate import TOO_SHORT
from formats.fit_records import CameraFinding
from formats.results import result_bytes
from tests.fit.batch.test_batch_command import PLAN, Night
from tests.fit.batch.test_night_of_diagnoses import a_take, night_of, seen
from tests.fit.report.report_scene import diagnosis, fit_result

HARDLY = "Warning: the fit hardly beats a trivial predictor: 9.0 mm held out. Its parameters tell little of the cloth."
CLOCK = "The clock of the points cannot be the hanger's in front."
LATE = "The stamps of front are 40 ms late; they were corrected."


def weak_fit():
    """A fit by a search with short intervals, which hardly beats a rigid sheet, of a take with a foreign clock."""
    first, second, *others = fit_result().parameters
    found = [
        CameraFinding(name="clocks", take_ids=["front"], unit="1", sentence=CLOCK, is_fault=True),
        CameraFinding(name="latency", take_ids=["front"], unit="s", sentence=LATE),
    ]
    at_bound = msgspec.structs.replace(first, is_at_bound=True, is_identified=False)
    free = msgspec.structs.replace(second, is_at_bound=False, is_identified=False)
    others = [msgspec.structs.replace(one, is_at_bound=False, is_identified=True) for one in others]
    return msgspec.structs.replace(
        fit_result(), notes=["A note.", TOO_SHORT, HARDLY], camera=found, parameters=[at_bound, free, *others]
    )


def one_row(result=None, state="known"):
    return Row(take="front.mcap", key="k", state=state, sentence="", result=result or weak_fit())


@pytest.fixture
def weak_night(tmp_path):
    """A night whose one fit is weak."""
    night = Night(tmp_path, "front")
    (key,) = survey(night.takes, night.results, PLAN).keys.values()
    keep(night.results, result_name(key), result_bytes(weak_fit(), tmp_path / "k"))
    return night, key


@pytest.mark.parametrize("words", [(), ("--diagnose",)])
def test_a_batch_says_of_a_weak_fit_what_a_single_fit_says(tmp_path, monkeypatch, words):
    night = Night(tmp_path, to_fit=["front"])

    def fits(found, *others, **more):
        for job in found.jobs:
            keep(night.results, result_name(job.key), result_bytes(weak_fit(), tmp_path / "k"))
            found.outcomes[job.key] = Outcome(key=job.key, state="fitted")

    monkeypatch.setattr(runner, "run", fits)
    single = as_text(fit_tables(weak_fit()))
    done = night.run("--json", *words)
    (told,) = json.loads(done.stdout)["takes"]
    summary = (night.folder / "out/summary.html").read_text()
    (line,) = csv.DictReader(io.StringIO((night.folder / "out/summary.csv").read_text()))
    for said in (f"Camera: {CLOCK}", f"Camera: {LATE}", HARDLY):
        assert said in single
        assert said in told["sentence"]
        assert said in line["remark"]
        assert said.replace("'", "&#39;") in summary
        assert done.stderr.count(said) == 1
    assert TOO_SHORT in single
    assert TOO_SHORT in line["remark"]
    assert done.stderr.count(TOO_SHORT) == 1
    assert told["warnings"] == [TOO_SHORT, HARDLY]
    first, second, *_ = weak_fit().parameters
    assert (told["at_bound"], told["not_identified"]) == ([first.name], [second.name])
    assert told["file"] == result_name(*survey(night.takes, night.results, PLAN).keys.values())
    assert 'class="verdict is-warn"' in summary


def test_a_night_that_fits_nothing_new_says_no_finding_again_and_keeps_all_in_its_files(weak_night):
    night, _ = weak_night
    done = night.run("--json")
    (told,) = json.loads(done.stdout)["takes"]
    summary = (night.folder / "out/summary.html").read_text()
    for said in (f"Camera: {CLOCK}", f"Camera: {LATE}", HARDLY):
        assert said not in done.stderr
        assert said in told["sentence"]
        assert said.replace("'", "&#39;") in summary
    assert TOO_SHORT not in done.stderr
    assert done.stderr.count("1 take fitted before: the summary has the remarks again.\n") == 1


def test_a_finding_on_several_takes_is_said_once_with_the_takes():
    rows = [replace(one_row(state="fitted"), take=f"{name}.mcap") for name in "abcdef"]
    other = replace(one_row(state="fitted"), take="b.mcap")
    needs = {("f.mcap", HARDLY)}
    assert lines_of(rows, needs) == [
        f"a.mcap, b.mcap, c.mcap, d.mcap and 2 more: Camera: {CLOCK}",
        f"a.mcap, b.mcap, c.mcap, d.mcap and 2 more: Camera: {LATE}",
        f"a.mcap, b.mcap, c.mcap, d.mcap and 1 more: {HARDLY}",
    ]
    assert lines_of([other])[0] == f"b.mcap: Camera: {CLOCK}"
    assert lines_of([replace(one_row(fit_result()), take="a")]) == []


def test_a_fit_without_doubts_is_told_by_its_figures_alone(tmp_path):
    done = Night(tmp_path, "front").run("--json")
    (told,) = json.loads(done.stdout)["takes"]
    assert (told["sentence"], told["warnings"]) == ("", [])
    assert "front.mcap:" not in done.stderr
    assert 'class="verdict is-good"' in (tmp_path / "out/summary.html").read_text()


def test_a_camera_fault_that_stays_needs_a_person_and_a_corrected_one_does_not(tmp_path):
    page = morning_of([one_row()], [], Survey(), open_store(str(tmp_path)))
    assert page.needs == (("front.mcap", f"Camera: {CLOCK}"), ("front.mcap", HARDLY))


@pytest.mark.parametrize(
    ("take", "cause"),
    [
        (seen("x.mcap", seconds=2.499), "it lasts 2.49 s, and a diagnosis needs 2.5 s"),
        (seen("x.mcap", "still"), "its hanger stands still"),
        (seen("x.mcap", is_calibrated=False), "its rig was never calibrated"),
    ],
)
@pytest.mark.parametrize("others", [[seen("a.mcap"), seen("b.mcap", "sideways")], [seen("a.mcap")]])
def test_a_take_that_is_left_out_has_its_cause_on_the_page_and_in_the_mail(tmp_path, take, cause, others):
    rows = [replace(one_row(fit_result()), take=one.name) for one in (*others, take)]
    skirt = wardrobe_of("skirt", [*others, take])
    found = Survey(keys={"skirt": "k"}, outcomes={"k": Outcome(key="k", state="failed", sentence="in vain")})
    page = morning_of(rows, [skirt], found, open_store(str(tmp_path)))
    said = f"Left out of the diagnosis: {cause}."
    assert [line.why_left_out for line in page.takes] == ["", *[""] * (len(others) - 1), said]
    assert page.takes[-1].verdict == ("left out" if len(others) == 2 else "lacking")
    assert as_html(page).count(said) == 1
    assert as_mail(page).splitlines()[-1].endswith(said)


def test_a_copy_of_a_take_is_left_out_as_the_same_recording(tmp_path):
    rows, found = night_of(tmp_path, [a_take("a"), a_take("b", sideways=0.2, amplitude=0.0), a_take("again")])
    found.digests["again.mcap"] = found.digests["a.mcap"]
    every = wardrobes(rows, found, open_store(str(tmp_path)))
    survey_of = Survey(keys={every[0].name: "k"})
    page = morning_of(rows, every, survey_of, open_store(str(tmp_path)))
    assert page.takes[-1].verdict == "left out"
    assert page.takes[-1].why_left_out == "Left out of the diagnosis: a.mcap is the same recording."


def test_inconclusive_diagnoses_are_counted_apart(tmp_path):
    results = open_store(str(tmp_path))
    verdicts = {"skirt": "inconclusive", "shirt": "none", "towel": "inconclusive"}
    for name, verdict in verdicts.items():
        kept = msgspec.structs.replace(diagnosis(), verdict=verdict, named=[], alternatives={})
        keep(results, f"diagnoses/{name}.html", b"")
        keep(results, diagnosis_name(name), result_bytes(kept, tmp_path / "k"))
    found = Survey(keys={name: name for name in verdicts})
    found.outcomes = {name: Outcome(key=name, state="diagnosed") for name in verdicts}
    every = [Wardrobe(name=name, takes=()) for name in verdicts]
    assert morning_of([], every, found, results).headline == "0 takes: . 3 garments: 1 diagnosed, 2 inconclusive."
