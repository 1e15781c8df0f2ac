"""Damaged results are computed again, and an oversized take or a full disk affects no other take."""

from __future__ import annotations

import os
import re
import stat
import subprocess
from dataclasses import replace

import msgspec
import pytest
from msgspec.structs import replace as replace_fields

from fit.batch.jobs import diagnosis_name, failure_name, report_name, result_name
from fit.batch.kept import CHECKSUM_SUFFIX, has_diagnosis, has_fit, keep
from fit.batch.runner import survey
from fit.batch.summary import as_csv, as_facts, as_html, rows_of
from fit.batch.worker import Errand, run_errand
from fit.errors import FitError, UnreachableError
from fit.identification.request import Plan
from fit.recordings.intact import describe_flaws
from formats.archive import write_take
from formats.fault_words import state_of_take
from formats.results import result_bytes
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.damage import a_report
from tests.formats.full_disk import no_file_beyond
from tests.formats.test_archive import a_take

PLAN = Plan(method="kinect-skirt", iterations=1)


def state_of(night):
    found = survey(*night, PLAN)
    (key,) = found.keys.values()
    return found.outcomes[key].state if key in found.outcomes else "waiting"


@pytest.mark.parametrize(
    ("spacing", "sentence"),
    [
        (1e-308, "more than 1000000 nodes"),
        (0.0005, r"gives it about \d+ nodes where 40000 are the most; choose a spacing from 0\.00"),
        (0.05, None),
    ],
)
def test_a_spacing_that_gives_a_take_no_mesh_is_reported_before_the_night(night, spacing, sentence):
    (night[0].path("") / "torn.mcap").write_bytes(b"torn")
    found = survey(*night, replace(PLAN, spacing=spacing))
    assert [job.take for job in found.jobs] == (["torn.mcap"] if sentence else ["torn.mcap", "a.mcap"])
    assert all(o.state == "refused" and re.search(sentence, o.sentence) for o in found.outcomes.values())


def test_a_spacing_that_suits_no_take_is_refused_before_the_night(night):
    """50 mm as 50 m, for one take and for two."""
    for count in (1, 2):
        with pytest.raises(FitError) as refused:
            survey(*night, replace(PLAN, spacing=50.0))
        assert ("suits none of the 2 takes: " in str(refused.value)) == (count == 2)
        assert str(refused.value).startswith("--spacing: ")
        assert str(refused.value).endswith("the spacing is in metres: 0.05 for 50 millimetres")
        write_take(night[0].path("") / "b.mcap", replace(a_take(30), take_id="b"))


@pytest.mark.parametrize(
    ("anyway", "sentence"),
    [
        (False, r"outline_m is 400 m long, .* were millimetres meant\? [A-Z]"),
        (True, "mesh spacing 0.05 m does not fit .* gives it more than 1000000 nodes where"),
    ],
)
def test_a_take_in_millimetres_is_refused_as_such_and_its_spacing_only_where_it_is_accepted(night, anyway, sentence):
    take = a_take(30)
    large = msgspec.structs.replace(take.garment, outline_m=[[1000 * x for x in row] for row in take.garment.outline_m])
    write_take(night[0].path("") / "a.mcap", replace(take, garment=large), overwrite=True)
    (night[0].path("") / "torn.mcap").write_bytes(b"torn")
    found = survey(*night, replace(PLAN, spacing=0.05), anyway=anyway)
    (outcome,) = found.outcomes.values()
    assert re.search(sentence, outcome.sentence), outcome.sentence


@pytest.mark.parametrize(
    ("damage", "state"),
    [
        (lambda path: None, "known"),
        (lambda path: path.write_text(path.read_text().replace('"simulations": ', '"simulations": 1')), "waiting"),
        (lambda path: path.write_bytes(path.read_bytes()[:-40]), "waiting"),
        (lambda path: path.write_bytes(b""), "waiting"),
        (lambda path: path.unlink(), "waiting"),
        (lambda path: path.with_name(path.name + CHECKSUM_SUFFIX).unlink(), "waiting"),
        (lambda path: path.with_name(path.name + CHECKSUM_SUFFIX).write_bytes(b""), "waiting"),
    ],
    ids=["untouched", "one digit", "cut", "empty", "lost", "no checksum", "empty checksum"],
)
def test_a_result_that_is_not_what_was_written_is_made_again(night, damage, state):
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    path = results.path(result_name(key))
    keep(results, result_name(key), result_bytes(fit_result(), path))
    damage(path)
    assert state_of(night) == state
    assert has_fit(results, key) is (state == "known")


def test_a_result_of_another_take_under_this_name_is_made_again(night):
    """Someone copied a result together with its checksum, whose line still has the other name."""
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    keep(results, result_name("other"), result_bytes(fit_result(), results.path("k")))
    for suffix in ("", CHECKSUM_SUFFIX):
        results.write(result_name(key) + suffix, results.read(result_name("other") + suffix))
    assert state_of(night) == "waiting"


def test_a_result_with_a_number_of_another_unit_is_made_again_though_its_checksum_fits(night):
    """As every command refuses it: a parameter of the fit, an effect of the diagnosis."""
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    fit, found = fit_result(), diagnosis()
    odd = [replace_fields(fit.parameters[0], unit="kN/m"), *fit.parameters[1:]]
    keep(results, result_name(key), result_bytes(replace_fields(fit, parameters=odd), results.path("k")))
    assert state_of(night) == "waiting"
    other = [replace_fields(found.effects[0], unit="N"), *found.effects[1:]]
    keep(results, diagnosis_name("k"), result_bytes(replace_fields(found, effects=other), results.path("k")))
    keep(results, report_name("k"), b"<html>whole</html>")
    assert not has_diagnosis(results, "k")


def test_a_checksum_is_one_that_sha256sum_checks(night):
    _, results = night
    keep(results, "fits/k.json", b"{}")
    folder = results.path("fits")
    done = subprocess.run(
        ["sha256sum", "--check", f"k.json{CHECKSUM_SUFFIX}"], cwd=folder, capture_output=True, text=True
    )
    assert done.stdout == "k.json: OK\n"


def test_a_diagnosis_without_its_report_or_with_a_damaged_one_is_made_again(night):
    _, results = night
    keep(results, diagnosis_name("k"), result_bytes(diagnosis(), results.path("k")))
    assert not has_diagnosis(results, "k")
    keep(results, report_name("k"), b"<html>whole</html>")
    assert has_diagnosis(results, "k")
    results.path(report_name("k")).write_bytes(b"<html>wh")
    assert not has_diagnosis(results, "k")


def test_a_reason_that_cannot_be_read_is_no_reason(night):
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    results.write(failure_name(key), b'{"sentence": "the take has 3 frames"}')
    assert state_of(night) == "failed"
    results.write(failure_name(key), b'{"sentence": "the ta')
    assert state_of(night) == "waiting"


def test_a_worker_makes_a_damaged_result_again_and_keeps_a_sound_one(night):
    _, results = night
    (job,) = survey(*night, PLAN).jobs
    made = []

    def make(contents):
        made.append(sorted(contents))
        return result_bytes(fit_result(), results.path("k"))

    errand = Errand(
        result=result_name(job.key), is_kept=lambda: has_fit(results, job.key), digests={job.take: job.digest},
        done="fitted", make=make, tidy=lambda: None,
    )  # fmt: skip
    for _ in range(2):
        assert run_errand(job, errand, results).state == "fitted"
    assert made == [["a.mcap"]]
    results.path(result_name(job.key)).write_bytes(b"{")
    assert run_errand(job, errand, results).state == "fitted"
    assert made == 2 * [["a.mcap"]]


def test_a_file_larger_than_any_take_is_refused_unread_and_the_others_wait(night):
    takes, _ = night
    with takes.path("huge.mcap").open("wb") as file:
        file.truncate(300 * 10**9)
    found = survey(*night, PLAN)
    assert [job.take for job in found.jobs] == ["a.mcap"]
    assert "has 300.0 GB, and a take 1.1 GB at most" in found.outcomes[found.keys["huge.mcap"]].sentence


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda path: path.symlink_to("nowhere.mcap"), "No such file or directory"),
        (os.mkfifo, "the path is a pipe or a device, and no file"),
        (lambda path: path.symlink_to("/dev/zero"), "the path is a pipe or a device, and no file"),
        (lambda path: os.mknod(path, stat.S_IFSOCK | 0o600), "the path is a pipe or a device, and no file"),
    ],
    ids=["link to nowhere", "pipe", "device", "socket"],
)
def test_a_name_of_a_take_that_is_no_file_is_refused_and_not_left_out(night, make, why):
    takes, _ = night
    make(takes.path("odd.mcap"))
    found = survey(*night, PLAN)
    assert [job.take for job in found.jobs] == ["a.mcap"]
    assert f"odd.mcap: cannot be read ({why})" in found.outcomes[found.keys["odd.mcap"]].sentence


def test_the_smallest_take_is_fitted_first(night):
    takes, _ = night
    write_take(takes.path("0-long.mcap"), replace(a_take(600), take_id="long"))
    assert [job.take for job in survey(*night, PLAN).jobs] == ["a.mcap", "0-long.mcap"]


def test_a_full_disk_is_waited_for_as_a_bucket_out_of_reach_is(night):
    """Exit status 75: the night goes on when somebody has made room."""
    _, results = night
    (job,) = survey(*night, PLAN).jobs

    def make(contents):
        with no_file_beyond(0), results.path("unfinished").open("wb") as file:
            file.write(b"search")
            file.flush()
        raise AssertionError

    errand = Errand(
        result=result_name(job.key), is_kept=lambda: False, digests={job.take: job.digest}, done="fitted", make=make,
        tidy=lambda: None,
    )  # fmt: skip
    with no_file_beyond(8), pytest.raises(UnreachableError, match="raise the limit") as told:
        results.write("fits/a.json", b"nine bytes")
    assert told.value.exit_code == 75
    with pytest.raises(UnreachableError, match="raise the limit"):
        run_errand(job, errand, results)
    assert not results.has(failure_name(job.key))


def test_a_take_that_lacks_seconds_is_named_in_the_nights_table_and_page(night):
    """From 2.50 to 3.50 s of the sensor's clock, whose first frame is at 0.25 s."""
    take = replace(
        a_take(150), is_complete=False, missing=((2.5, 3.5),),
        report=a_report(trailing_bytes=10, missing_frames=29),
    )  # fmt: skip
    note, behind = describe_flaws([take])
    state = state_of_take(take)
    assert "missing: 2.25 to 3.25 s" in note
    _, results = night
    found = survey(*night, PLAN)
    (key,) = found.keys.values()
    damaged = msgspec.structs.replace(fit_result(), notes=["Another note.", note, behind], take_states=[state])
    keep(results, result_name(key), result_bytes(damaged, results.path("k")))
    rows = rows_of(survey(*night, PLAN), results)
    assert [row.own_remarks for row in rows] == [[note, behind]]
    for shown in (as_csv(rows), as_html(rows, PLAN)):
        assert "missing: 2.25 to 3.25 s" in shown
        assert "10 bytes follow its end." in shown
    (told,) = as_facts(rows)
    assert (told["state"], told["sentence"]) == ("fitted before", f"{note} {behind}")
    assert told["take_states"] == [msgspec.to_builtins(state)]
    assert (state.state, state.missing, state.trailing_bytes) == ("damaged", "2.25 to 3.25 s", 10)
    (waiting,) = as_facts([replace(rows[0], state="waiting", result=None)])
    assert waiting["take_states"] == []


@pytest.mark.parametrize("ending", ["", CHECKSUM_SUFFIX])
def test_a_folder_in_a_results_place_is_refused_before_the_take_is_fitted(night, ending):
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    place = results.path(result_name(key) + ending)
    place.mkdir(parents=True)
    found = survey(*night, PLAN)
    assert not found.jobs
    assert (found.outcomes[key].state, found.outcomes[key].sentence) == (
        "refused", f"{place}: a folder is in the place of its result; move it away, then run the batch again",
    )  # fmt: skip
    place.rmdir()
    assert [job.take for job in survey(*night, PLAN).jobs] == ["a.mcap"]
