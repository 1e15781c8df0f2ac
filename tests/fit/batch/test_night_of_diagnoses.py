"""`hangtime batch --diagnose`: takes grouped by garment, garments diagnosed, and one summary page."""

from __future__ import annotations

import csv
import dataclasses
import io
from datetime import UTC, datetime

import msgspec
import numpy as np
import pytest

from fit.batch.cli import SOME_NOT_FITTED
from fit.batch.diagnosing import run_diagnosis
from fit.batch.garments import ERROR_REMOVED, Seen, diagnoses_of, wardrobe_of, wardrobes
from fit.batch.jobs import Outcome, diagnosis_name, failure_name, report_name, unfinished_diagnosis
from fit.batch.kept import keep
from fit.batch.morning import as_html, as_text, morning_of
from fit.batch.runner import Survey
from fit.batch.store import open_store
from fit.batch.summary import Row
from formats.archive import write_take
from formats.findings import SHORTEST_DIAGNOSED
from formats.motion import MOTION_KINDS
from formats.results import load_diagnosis, result_bytes
from tests.fit.batch.night import SHORT, make_takes, said, start, wait_for
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of


def seen(name, kind="face-on", *, reach=0.03, seconds=8.0, is_calibrated=True):
    return Seen(
        name=name, digest=f"sha of {name}", kind=kind, reach=reach, seconds=seconds, is_calibrated=is_calibrated
    )


def a_take(name, garment=None, *, sideways=0.0, amplitude=0.06):
    """A take whose cloth hangs still below a hanger that swings: enough to be sorted, not to be diagnosed."""
    time = np.arange(0, 3.0, 1 / 30)
    garment = garment or sheet()
    path = swing(time, amplitude=amplitude, sideways=sideways)
    return take_of(garment, time, path, hung(garment, time) + path[:, None], name=name)


def night_of(folder, takes):
    """A folder of takes with the rows and the survey of a night that has fitted them all."""
    rows, found = [], Survey()
    for take in takes:
        name = f"{take.take_id}.mcap"
        write_take(folder / name, take)
        found.digests[name] = f"sha of {name}"
        rows.append(Row(take=name, key=f"key of {name}", state="fitted", sentence="", result=fit_result()))
    return rows, found


# --- which garments can be diagnosed --------------------------------------------------------------


def kept(results, key, found):
    """Keep a diagnosis and its report, as a worker does."""
    keep(results, report_name(key), b"<html>its report</html>")
    keep(results, diagnosis_name(key), result_bytes(found, "diagnosis"))


def test_the_kind_of_motion_that_shows_least_is_judged_on():
    """Three face-on and one sideways: fitted to three, judged on one."""
    takes = [seen("a"), seen("b", "sideways"), seen("c"), seen("d")]
    skirt = wardrobe_of("skirt", takes)
    assert [take.name for take in skirt.training] == ["a", "c", "d"]
    assert [take.name for take in skirt.held_out] == ["b"]
    assert skirt.missing == ""


@pytest.mark.parametrize(("judged", "fitted"), [("sideways", "face-on"), ("twist", "mixed"), ("mixed", "face-on")])
def test_of_two_kinds_with_as_many_takes_the_one_that_bends_the_cloth_more_is_fitted_to(judged, fitted):
    for takes in ([seen("a", judged), seen("b", fitted)], [seen("b", fitted), seen("a", judged)]):
        assert [take.name for take in wardrobe_of("skirt", takes).held_out] == ["a"]


@pytest.mark.parametrize(
    ("takes", "judged"),
    [
        # Two twists, one of them cut off, tell less than one swing.
        ([("a", "twist", 8.0), ("b", "twist", 4.1), ("c", "face-on", 8.0)], ["a", "b"]),
        # Half a minute of twists tells more than a fragment of a swing.
        ([("a", "twist", 30.0), ("c", "face-on", 4.1)], ["c"]),
        ([("a", "mixed", 8.0), ("b", "mixed", 8.0), ("c", "face-on", 8.0)], ["c"]),
        ([("a", "mixed", 8.0), ("b", "mixed", 2.5), ("c", "face-on", 8.0)], ["a", "b"]),
    ],
)
def test_kinds_count_by_their_seconds_and_by_what_they_show(takes, judged):
    skirt = wardrobe_of("skirt", [seen(name, kind, seconds=seconds) for name, kind, seconds in takes])
    assert [take.name for take in skirt.held_out] == judged
    assert {take.kind for take in skirt.held_out}.isdisjoint(take.kind for take in skirt.training)


@pytest.mark.parametrize(
    ("takes", "judged"),
    [
        ([("a", "face-on", 0.021), ("b", "face-on", 0.036), ("c", "face-on", 0.056), ("d", "face-on", 0.020)], ["b"]),
        # The middle strength of the kind that shows most; the twist is fitted to as well.
        ([("a", "face-on", 0.02), ("b", "face-on", 0.03), ("c", "face-on", 0.05), ("t", "twist", 0.03)], ["b"]),
        # Two takes of one strength are judged on together, and two strengths are too few.
        ([("a", "face-on", 0.02), ("b", "face-on", 0.03), ("c", "face-on", 0.033), ("d", "face-on", 0.05)], ["b", "c"]),
        ([("a", "face-on", 0.02), ("b", "face-on", 0.03), ("t", "twist", 0.03)], ["t"]),
    ],
)
def test_of_three_strengths_of_one_kind_the_middle_one_is_judged_on(takes, judged):
    skirt = wardrobe_of("skirt", [seen(name, kind, reach=reach) for name, kind, reach in takes])
    assert [take.name for take in skirt.held_out] == judged
    assert len(skirt.training) == len(takes) - len(judged)


def test_every_kind_of_motion_has_a_rank_in_that_order():
    assert sorted(ERROR_REMOVED) == sorted(set(MOTION_KINDS) - {"still"})


def test_takes_that_stand_still_or_were_never_calibrated_are_neither_fitted_to_nor_judged_on():
    takes = [seen("a"), seen("b", "still"), seen("c", "sideways"), seen("d", "twist", is_calibrated=False)]
    skirt = wardrobe_of("skirt", takes)
    assert [take.name for take in (*skirt.training, *skirt.held_out)] == ["a", "c"]
    assert len(skirt.takes) == 4


def test_one_take_that_is_too_short_does_not_end_the_diagnosis_of_the_others():
    long = [seen("gentle", reach=0.02), seen("middle", reach=0.03), seen("wide", reach=0.05)]
    cut = seen("cut", reach=0.03, seconds=SHORTEST_DIAGNOSED - 0.1)
    skirt = wardrobe_of("skirt", [*long, cut])
    assert ([take.name for take in skirt.training], [take.name for take in skirt.held_out]) == (
        ["gentle", "wide"], ["middle"]
    )  # fmt: skip
    assert cut in skirt.takes


@pytest.mark.parametrize(
    ("takes", "sentence"),
    [
        (
            [seen("a", seconds=2.4), seen("b", "twist", seconds=2.4)],
            "no take in which its hanger moves lasts 2.5 s; record longer",
        ),
        ([seen("a")], "its only take moves face-on, and none is left to judge on; swing it face-on gently"),
        (
            [seen("a"), seen("b")],
            "its 2 takes all move face-on, and none is left to judge on; swing it face-on gently, widely",
        ),
        ([seen("a", "still")], "in no take does its hanger move; swing it face-on gently"),
        ([seen("a", is_calibrated=False)], "its rig was never calibrated; run `hangtime calibrate`"),
    ],
)
def test_a_garment_without_enough_takes_says_what_is_missing(takes, sentence):
    skirt = wardrobe_of("skirt", takes)
    assert skirt.missing.startswith(sentence)
    assert (skirt.training, skirt.held_out) == ((), ())


def test_a_take_and_the_file_that_was_recovered_from_it_count_once(tmp_path):
    """`takes recover` writes beside a take a file of other bytes that holds the same frames."""
    rows, found = night_of(tmp_path, [a_take("a"), a_take("b", sideways=0.2, amplitude=0.0)])
    assert hangtime_here("takes", "recover", "a.mcap", folder=tmp_path).returncode == 0
    name = "a.recovered.mcap"
    assert (tmp_path / name).read_bytes() != (tmp_path / "a.mcap").read_bytes()
    found.digests[name] = f"sha of {name}"
    rows.insert(1, Row(take=name, key="k", state="fitted", sentence="", result=fit_result()))
    (swatch,) = wardrobes(rows, found, open_store(str(tmp_path)))
    assert [take.name for take in swatch.takes] == ["a.mcap", "b.mcap"]


def test_takes_are_sorted_by_their_whole_garment_and_garments_of_one_name_are_numbered(tmp_path):
    """Two sheets of one name, one 36 g and one 50 g; a take under a second name counts once."""
    heavy = sheet(mass=0.05)
    takes = [a_take("a"), a_take("b", heavy), a_take("c", sideways=0.2, amplitude=0.0), a_take("again")]
    rows, found = night_of(tmp_path, takes)
    found.digests["again.mcap"] = found.digests["a.mcap"]
    rows.append(Row(take="broken.mcap", key="k", state="failed", sentence="is cut off", result=None))
    first, second = wardrobes(rows, found, open_store(str(tmp_path)))
    assert (first.name, second.name) == ("sheet (1)", "sheet (2)")
    assert [(take.name, take.kind) for take in first.takes] == [("a.mcap", "face-on"), ("c.mcap", "sideways")]
    assert [take.name for take in second.takes] == ["b.mcap"]
    assert second.missing


# --- jobs -----------------------------------------------------------------------------------------


def skirt_with_two_motions():
    return wardrobe_of("skirt", [seen("a.mcap"), seen("b.mcap", "sideways")])


def test_a_diagnosis_is_made_once_and_again_when_a_take_or_the_seed_changes(tmp_path):
    results, takes = open_store(str(tmp_path)), open_store("takes")
    found = diagnoses_of([skirt_with_two_motions()], takes, results, 0)
    (job,) = found.jobs
    assert (job.training, job.held_out) == (("a.mcap",), ("b.mcap",))
    kept(results, job.key, diagnosis())
    again = diagnoses_of([skirt_with_two_motions()], takes, results, 0)
    assert (again.jobs, again.outcomes[job.key].state) == ([], "diagnosed")
    other_take = wardrobe_of("skirt", [seen("a.mcap"), dataclasses.replace(seen("b.mcap", "twist"), digest="other")])
    for changed in (
        diagnoses_of([other_take], takes, results, 0),
        diagnoses_of([skirt_with_two_motions()], takes, results, 1),
    ):
        assert len(changed.jobs) == 1
        assert changed.jobs[0].key != job.key


def test_a_diagnosis_that_failed_is_tried_again_only_when_asked_to(tmp_path):
    results, takes = open_store(str(tmp_path)), open_store("takes")
    (job,) = diagnoses_of([skirt_with_two_motions()], takes, results, 0).jobs
    results.write(failure_name(job.key), b'{"sentence": "the garment is too small"}')
    kept = diagnoses_of([skirt_with_two_motions()], takes, results, 0)
    assert kept.jobs == []
    assert kept.outcomes[job.key].sentence == "the garment is too small"
    assert len(diagnoses_of([skirt_with_two_motions()], takes, results, 0, retry_failed=True).jobs) == 1


def jobs_of(folder, takes):
    """The diagnoses of takes, by the real digests of their files."""
    from fit.batch.jobs import digest_of

    rows, found = night_of(folder, takes)
    for name in found.digests:
        found.digests[name] = digest_of((folder / name).read_bytes())
    store = open_store(str(folder))
    return diagnoses_of(wardrobes(rows, found, store), store, open_store(str(folder / "out")), 0).jobs


def test_takes_that_cannot_be_diagnosed_are_noted_and_a_take_that_changed_is_not(tmp_path):
    """The points of `b` leave only 1 s of sight of the garment: intervals and gates need more."""
    short = a_take("b", sideways=0.2, amplitude=0.0)
    short = dataclasses.replace(short, points_valid=np.zeros_like(short.points_valid))
    (job,) = jobs_of(tmp_path, [a_take("a"), short])
    changed = run_diagnosis(dataclasses.replace(job, digests=(job.digests[0], "another")))
    assert changed.state == "refused"
    assert "was changed while the batch ran" in changed.sentence
    failed = run_diagnosis(job)
    assert failed.state == "failed"
    assert failed.sentence.startswith("hardly any point of the garment below the held edge was seen")
    assert "hardly any point" in (tmp_path / "out" / failure_name(job.key)).read_text()


# --- the page -------------------------------------------------------------------------------------


@pytest.fixture
def morning(tmp_path):
    """Two garments: a skirt with a named effect, a towel with one take; a take that failed."""
    rows = [
        Row(take="a.mcap", key="k1", state="fitted", sentence="", result=fit_result()),
        Row(take="b.mcap", key="k2", state="known", sentence="", result=fit_result()),
        Row(take="t.mcap", key="k3", state="fitted", sentence="", result=fit_result()),
        Row(take="<x>.mcap", key="k4", state="failed", sentence="the hanger is lost; record again", result=None),
    ]
    every = [skirt_with_two_motions(), wardrobe_of("towel", [seen("t.mcap")])]
    results = open_store(str(tmp_path))
    found = diagnoses_of(every, open_store("takes"), results, 0)
    key = found.keys["skirt"]
    found.outcomes[key] = Outcome(key=key, state="diagnosed")
    kept(results, key, diagnosis())

    def made(**changes):
        kept(results, key, msgspec.structs.replace(diagnosis(), **changes))
        return morning_of(rows, every, found, results, made=datetime(2026, 1, 2, 7, tzinfo=UTC))

    return made, key


def test_the_page_names_every_take_its_fit_its_verdict_and_what_needs_a_person(morning):
    made, key = morning
    page = made()
    assert page.headline == (
        "4 takes: 2 fitted, 1 fitted before, 1 failed. 2 garments: 1 diagnosed, 1 without enough takes."
    )
    assert [who for who, _ in page.needs] == ["<x>.mcap", "towel"]
    html, text = as_html(page), as_text(page)
    for shown in (html, text):
        assert diagnosis().sentence[:30] in shown
        assert report_name(key) in shown
        assert "record another kind of motion" in shown
        assert "2026-01-02 07:00 UTC" in shown
    assert "&lt;x&gt;.mcap" in html
    assert "<x>" not in html
    assert html.count("<tr>") == 5
    by_take = {line.take: line for line in page.takes}
    assert (by_take["a.mcap"].garment, by_take["a.mcap"].motion) == ("skirt", "face-on")
    assert by_take["a.mcap"].verdict == diagnosis().verdict
    assert by_take["a.mcap"].after == f"{1e3 * fit_result().error.train_after.mean_m:.1f}"


@pytest.mark.parametrize(
    ("verdict", "named", "is_needed"),
    [("none", [], False), ("unknown", [], True), ("inconclusive", [], True), ("numerics", [], True)],
)
def test_a_verdict_that_settles_nothing_needs_a_person(morning, verdict, named, is_needed):
    made, _ = morning
    page = made(verdict=verdict, named=named, next_experiment=None, alternatives={})
    assert ("skirt" in [who for who, _ in page.needs]) == is_needed


def test_a_warning_about_a_take_needs_a_person_and_one_about_the_search_does_not(tmp_path):
    from fit.identification.calibrate import TOO_SHORT

    noted = msgspec.structs.replace(fit_result(), notes=["Warning: 7 % of the points are impossible.", TOO_SHORT])
    rows = [Row(take="a.mcap", key="k", state="fitted", sentence="", result=noted)]
    page = morning_of(rows, [], Survey(), open_store(str(tmp_path)))
    assert page.needs == (("a.mcap", "Warning: 7 % of the points are impossible."),)


# --- a whole night --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.processor_time(1800)
def test_a_night_that_is_killed_goes_on_and_ends_with_the_page(tmp_path):
    """Two motions of one swatch and one take of another: one diagnosis, one garment that lacks a motion.

    The command and its worker are killed once the diagnosis has finished its first fit, and started again.
    """
    night, out = tmp_path / "takes", tmp_path / "out"
    night.mkdir()
    time, garment = np.arange(0, 2.6, 1 / 30), sheet()
    for name, sideways, amplitude in (("front", 0.0, 0.06), ("side", 0.06, 0.0)):
        path = swing(time, amplitude=amplitude, sideways=sideways)
        row = material(garment, velocity_damping=3.0)
        write_take(night / f"{name}.mcap", simulate_take(garment, time, path, row, noise=0.002, name=name))
    make_takes(night, 1)
    other = a_take("other", sheet(mass=0.05))
    (night / "swing0.mcap").unlink()
    write_take(night / "other.mcap", other)
    words = ("batch", night, "--out", "out", "--workers", 1, "--dashboard-port", 0, "--diagnose", *SHORT)

    first = start(*words, folder=tmp_path)
    wait_for(lambda: list((out / "unfinished").glob("*/*")), seconds=900)
    first.kill()
    first.wait()
    again = start(*words, folder=tmp_path)
    assert again.wait(1800) == 0, said(tmp_path)
    assert "3 takes, 0 to fit." in said(tmp_path)
    assert "2 garments, 1 to diagnose." in said(tmp_path)
    (path,) = (out / "diagnoses").glob("*.json")
    found = load_diagnosis(path)
    assert (found.take_ids, found.held_out_ids) == (["front"], ["side"])
    text = (out / "morning.txt").read_text()
    assert found.sentence in text
    assert "its only take moves face-on" in text
    assert (out / report_name(path.stem)).read_text().startswith("<!doctype html>")
    assert not (out / unfinished_diagnosis(path.stem)).exists()
    assert len(list(csv.DictReader(io.StringIO((out / "summary.csv").read_text())))) == 3

    third = start(*words, folder=tmp_path)
    assert third.wait(120) == 0, said(tmp_path)
    assert "2 garments, 0 to diagnose." in said(tmp_path)
    assert SOME_NOT_FITTED == 3
