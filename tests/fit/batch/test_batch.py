"""A batch of fits survives killed, broken and lost processes at the cost of time only."""

from __future__ import annotations

import csv
import json
import os
import tempfile

import numpy as np
import pytest

from fit import runtime
from fit.batch.cli import SOME_NOT_FITTED
from fit.batch.jobs import Job, digest_of, failure_name, key_of, search_name
from fit.batch.runner import survey
from fit.batch.store import open_store
from fit.batch.summary import rows_of
from fit.batch.worker import run_job
from fit.errors import FitError
from fit.identification.calibrate import calibrate
from fit.identification.request import Plan
from fit.kernel_cache.place import CACHE
from fit.provenance import physics_version
from formats.archive import read_take
from formats.results import load_fit_result
from tests.fit.batch.night import (
    HANGS,
    PROGRAMS,
    SHORT,
    free_port,
    is_listening,
    kill,
    make_takes,
    running,
    said,
    scheduler_at,
    start,
    wait_for,
    worker_pids,
)
from tests.fit.here import hangtime_here

PLAN = Plan(method="kinect-skirt", iterations=8, spacing=0.1)


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    return make_takes(tmp_path_factory.mktemp("takes"), 3)


def fitted_in(folder):
    return sorted(path.name for path in (folder / "fits").glob("*.json"))


def job_of(take, results, plan=PLAN, **changes):
    digest = digest_of(take.read_bytes())
    physics = physics_version()
    values = {
        "key": key_of(digest, plan, physics), "take": take.name, "digest": digest, "takes_url": str(take.parent),
        "results_url": str(results), "plan": plan, "physics": physics,
    }  # fmt: skip
    return Job(**{**values, **changes})


@pytest.mark.slow  # the faults one by one are quick tests of their own
def test_a_night_with_a_killed_worker_and_two_poisoned_takes(takes, tmp_path):
    """Three sound takes, one cut off in its header, one of random bytes; the only worker is killed once."""
    night = tmp_path / "takes"
    night.mkdir()
    for path in takes.glob("*.mcap"):
        (night / path.name).write_bytes(path.read_bytes())
    (night / "cut.mcap").write_bytes((takes / "swing0.mcap").read_bytes()[:200])
    (night / "noise.mcap").write_bytes(np.random.default_rng(0).bytes(4000))
    words = ("batch", night, "--out", "out", "--workers", 1, "--dashboard-port", 0, *SHORT)

    process = start(*words, folder=tmp_path)
    wait_for(lambda: fitted_in(tmp_path / "out"))
    victims = worker_pids(process)
    assert victims or process.poll() is not None  # on a busy machine the batch may have ended by now
    for victim in victims:
        kill(victim)
    assert process.wait(HANGS) == SOME_NOT_FITTED, said(tmp_path)
    assert "5 takes: 3 fitted, 2 failed." in said(tmp_path)
    assert "cut.mcap: holds no readable header" in said(tmp_path)
    assert "noise.mcap: is not a take archive" in said(tmp_path)
    assert "http://127.0.0.1:" in said(tmp_path)

    # The results are those of the same fits done one after the other.
    with (tmp_path / "out/summary.csv").open() as file:
        table = {row["take"]: row for row in csv.DictReader(file)}
    alone = calibrate([read_take(takes / "swing1.mcap")], [], PLAN.request())
    kept = load_fit_result(tmp_path / "out/fits" / f"{table['swing1.mcap']['key']}.json")
    assert [p.fitted for p in kept.parameters] == [p.fitted for p in alone.parameters]
    assert float(table["swing1.mcap"]["struct_low"]) == kept.parameters[1].interval_low
    assert table["swing1.mcap"]["struct"] == ""  # eight iterations identify nothing
    assert float(table["swing1.mcap"]["error_after_mm"]) == pytest.approx(1e3 * kept.error.train_after.mean_m, abs=1e-3)

    # The second night starts no worker: everything is known, also what fails.
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out/fits").iterdir()}
    again = start(*words, folder=tmp_path)
    assert again.wait(HANGS) == SOME_NOT_FITTED
    assert "5 takes, 0 to fit." in said(tmp_path)
    assert "3 fitted before, 2 failed" in said(tmp_path)
    assert "Dashboard" not in said(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out/fits").iterdir()} == before


@pytest.mark.slow
def test_a_scheduler_that_is_killed_and_comes_back_loses_no_take(takes, tmp_path):
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    scheduler = scheduler_at(port)
    worker = (PROGRAMS / "dask", "worker", address, "--nthreads", 1, "--no-dashboard", "--no-nanny")
    with running(*scheduler) as first, running(*worker):
        wait_for(lambda: is_listening(port))
        process = start("batch", takes, "--out", "out", "--scheduler", address, *SHORT, folder=tmp_path)
        wait_for(lambda: fitted_in(tmp_path / "out"))
        kill(first.pid)
        first.wait()
        wait_for(lambda: "The scheduler was lost" in said(tmp_path))
        with running(*scheduler), running(*worker):
            assert process.wait(HANGS) == 0, said(tmp_path)
    assert "Connected again." in said(tmp_path)
    assert len(fitted_in(tmp_path / "out")) == 3


@pytest.mark.slow
def test_a_take_that_ends_its_workers_is_given_up_and_tried_again_the_next_night(takes, tmp_path):
    """With no second chance allowed to a take, one killed worker is enough."""
    night = tmp_path / "takes"
    night.mkdir()
    (night / "swing0.mcap").write_bytes((takes / "swing0.mcap").read_bytes())
    process = start(
        "batch", night, "--out", "out", "--workers", 1, "--dashboard-port", 0, "--method",
        "kinect-skirt", "--iterations", 4000, folder=tmp_path,
        DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0",
    )  # fmt: skip
    wait_for(lambda: (tmp_path / "out/unfinished").exists())
    kill(worker_pids(process)[0])
    assert process.wait(HANGS) == SOME_NOT_FITTED
    assert "swing0.mcap: every worker that took it on died" in said(tmp_path)
    assert not (tmp_path / "out/failed").exists()
    found = survey(
        open_store(str(night)), open_store(str(tmp_path / "out")), Plan(method="kinect-skirt", iterations=4000)
    )
    assert [job.take for job in found.waiting] == ["swing0.mcap"]


def test_a_cluster_that_is_not_there_is_one_sentence(takes, tmp_path):
    done = hangtime_here("batch", takes, "--out", "out", "--scheduler", "gone.json", "--patience", 0, folder=tmp_path)
    assert done.returncode == 75
    assert "gone.json: no scheduler answers there (there is no file gone.json)" in done.stderr
    assert "3 waiting" in (tmp_path / "out/summary.html").read_text()


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("tls://127.0.0.1:9", "tls://127.0.0.1:9: TLS needs certificates, and none are set"),
        ("127.0.0.1:9", "127.0.0.1:9: is neither an address nor a scheduler file; write tcp://127.0.0.1:9 or"),
        ("http://127.0.0.1:9", "no scheduler answers there (unknown address scheme 'http'"),
    ],
)
def test_an_impossible_address_is_reported_at_once(takes, tmp_path, address, sentence):
    done = hangtime_here("batch", takes, "--out", "out", "--scheduler", address, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert sentence in done.stderr


@pytest.mark.parametrize("text", ["what?", "[]", '{"adress": "tcp://127.0.0.1:9"}'])
def test_a_file_that_is_no_scheduler_file_is_reported_at_once(takes, tmp_path, text):
    (tmp_path / "s.json").write_text(text)
    done = hangtime_here("batch", takes, "--out", "out", "--scheduler", "s.json", folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "s.json: is no scheduler file; give the file that dask scheduler" in done.stderr


def test_a_pipe_is_no_scheduler_file(takes, tmp_path):
    os.mkfifo(tmp_path / "s.json")
    done = hangtime_here("batch", takes, "--out", "out", "--scheduler", "s.json", folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "s.json: is no scheduler file; give the file that dask scheduler" in done.stderr


def test_a_night_too_short_for_its_takes_says_so_in_its_status(takes, tmp_path):
    done = hangtime_here("batch", takes, "--out", "out", "--hours", 0, *SHORT, "--json", "--quiet", folder=tmp_path)
    assert done.returncode == SOME_NOT_FITTED
    assert json.loads(done.stdout)["error"].endswith("out/summary.html: 3 takes: 3 waiting.")
    assert "out/summary.html: 3 takes: 3 waiting." in done.stderr


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("batch", "nowhere"), "nowhere: is no folder that is there"),
        (("batch", "ftp://example.org/takes"), "is neither a folder nor a bucket"),
        (("batch", ".", "--method", "guess"), "there is no method named 'guess'"),
        (("batch", ""), "the text is empty; give URL, or set the variable that stands for it"),
        (("batch", ".", "--spacing", "-1"), "the mesh spacing is -1 m; give metres"),
        (("batch", ".", "--hours", "-1"), "--hours"),
        (("batch", ".", "--hours", "nan"), "--hours"),
        (
            ("batch", ".", "--dashboard-port", "65536"),
            "65536 is outside the range: the value must be at most 65535",
        ),
        (("batch", ".", "--dashboard-port", "-1"), "-1 is outside the range: the value must be at least 0"),
        *(
            (("batch", ".", "--until", bad), f"--until: {bad!r} is no time of the day; give hours and minutes, such as")
            for bad in ("7pm", "24:00", "07:60", "7", "-1:00", "07:00:00")
        ),
        (("batch", ".", "--until", ""), "'--until': the text is empty; give --until HH:MM, or leave it out"),
    ],
)
def test_bad_input_gives_one_sentence_and_exit_code_2(tmp_path, words, sentence):
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


# --- keys ---------------------------------------------------------------------------------------


def test_the_same_take_under_two_names_is_fitted_once(takes, tmp_path):
    for name in ("one.mcap", "two.mcap"):
        (tmp_path / name).write_bytes((takes / "swing0.mcap").read_bytes())
    results = open_store(str(tmp_path / "out"))
    found = survey(open_store(str(tmp_path)), results, PLAN)
    assert len(found.jobs) == 1
    found.outcomes[found.jobs[0].key] = run_job(found.jobs[0])
    rows = rows_of(found, results)
    assert [row.state for row in rows] == ["fitted", "fitted"]
    assert rows[0].result == rows[1].result


# --- one job ------------------------------------------------------------------------------------


def test_a_job_is_done_once_and_a_broken_unfinished_search_is_begun_anew(takes, tmp_path):
    job = job_of(takes / "swing0.mcap", tmp_path)
    unfinished = tmp_path / search_name(job.key)
    unfinished.parent.mkdir()
    unfinished.write_text('{"key":')
    assert run_job(job).state == "fitted"
    assert not unfinished.exists()
    (path,) = (tmp_path / "fits").glob("*.json")
    written = path.stat().st_mtime_ns
    assert run_job(job).state == "fitted"
    assert path.stat().st_mtime_ns == written


def test_a_job_has_no_temporary_folder_that_a_killed_worker_would_leave(takes, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    job = job_of(takes / "swing0.mcap", tmp_path)
    assert run_job(job).state == "fitted"
    take = read_take(takes / "swing0.mcap")
    assert load_fit_result(tmp_path / "fits" / f"{job.key}.json").take_ids == [take.take_id]


@pytest.mark.parametrize("change", [{"settings": {}}, {"steps": 0}])
def test_an_unfinished_search_that_does_not_go_on_here_is_begun_anew(takes, tmp_path, change):
    """Of other settings, or not as this version writes them."""
    job = job_of(takes / "swing0.mcap", tmp_path)
    unfinished = tmp_path / search_name(job.key)
    unfinished.parent.mkdir()
    calibrate([read_take(takes / "swing0.mcap")], [], job.plan.request(), checkpoint=unfinished)
    saved = json.loads(unfinished.read_text())
    saved["search"].update(change)
    unfinished.write_text(json.dumps(saved))
    assert run_job(job).state == "fitted"
    assert not unfinished.exists()


def test_a_folder_that_a_worker_cannot_make_is_no_fault_of_the_take(takes, tmp_path):
    """A file lies where the folder of unfinished searches is to be made."""
    job = job_of(takes / "swing0.mcap", tmp_path)
    (tmp_path / search_name(job.key)).parent.write_text("")
    outcome = run_job(job)
    assert outcome.state == "refused"
    assert outcome.sentence == f"this worker cannot do it (File exists: {(tmp_path / search_name(job.key)).parent})"
    assert not (tmp_path / "failed").exists()
    found = survey(open_store(str(takes)), open_store(str(tmp_path)), PLAN)
    assert job.key in [waiting.key for waiting in found.waiting]


def test_a_worker_that_can_keep_no_kernels_is_no_fault_of_the_take(takes, tmp_path, monkeypatch):
    """Taichi's own folder cannot be made, nor a temporary one."""
    (tmp_path / "file").touch()
    monkeypatch.setenv(CACHE, str(tmp_path / "file/kernels"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    monkeypatch.setattr(runtime, "_started", {})
    outcome = run_job(job_of(takes / "swing0.mcap", tmp_path / "out"))
    assert outcome.state == "refused"
    assert "this worker cannot do it (" in outcome.sentence
    assert "compiled kernels cannot be kept" in outcome.sentence
    assert not (tmp_path / "out/failed").exists()


def test_an_unfinished_search_goes_on_where_its_worker_died(takes, tmp_path):
    """A mark of 1000 simulations that only the unfinished search carries is in the result."""
    job = job_of(takes / "swing0.mcap", tmp_path, plan=Plan(method="kinect-skirt", iterations=60, spacing=0.1))
    unfinished = tmp_path / search_name(job.key)
    unfinished.parent.mkdir()
    take = read_take(takes / "swing0.mcap")

    def interrupt(done, total, best):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        calibrate([take], [], job.plan.request(), checkpoint=unfinished, progress=interrupt)
    saved = json.loads(unfinished.read_text())
    saved["search"]["evaluations"] += 1000
    unfinished.write_text(json.dumps(saved))
    assert run_job(job).state == "fitted"
    whole = calibrate([take], [], job.plan.request())
    kept = load_fit_result(tmp_path / "fits" / f"{job.key}.json")
    assert kept.history == whole.history
    assert kept.simulations == whole.simulations + 1000


def test_a_worker_with_another_hangtime_and_a_take_that_changed_meanwhile_are_refused(takes, tmp_path):
    refused = run_job(job_of(takes / "swing0.mcap", tmp_path, physics="another"))
    assert refused.state == "refused"
    assert "install the same version" in refused.sentence
    changed = run_job(job_of(takes / "swing0.mcap", tmp_path, digest="another"))
    assert changed.state == "refused"
    assert not (tmp_path / "failed").exists()


def test_a_take_that_failed_is_tried_again_only_when_asked_to(takes, tmp_path):
    (tmp_path / "cut.mcap").write_bytes((takes / "swing0.mcap").read_bytes()[:200])
    store, results = open_store(str(tmp_path)), open_store(str(tmp_path / "out"))
    (job,) = survey(store, results, PLAN).waiting
    assert run_job(job).state == "failed"
    assert survey(store, results, PLAN).waiting == []
    assert len(survey(store, results, PLAN, retry_failed=True).waiting) == 1


@pytest.mark.slow
def test_the_command_tries_what_failed_again_only_with_its_option(takes, tmp_path):
    """A take under whose key a failure is kept that it would not end with any more."""
    night = tmp_path / "takes"
    night.mkdir()
    (night / "swing0.mcap").write_bytes((takes / "swing0.mcap").read_bytes())
    job = job_of(night / "swing0.mcap", tmp_path / "out")
    kept = tmp_path / "out" / failure_name(job.key)
    kept.parent.mkdir(parents=True)
    kept.write_text('{"sentence": "was not understood"}')
    words = ("batch", night, "--out", "out", "--workers", 1, "--dashboard-port", 0, *SHORT)
    assert start(*words, folder=tmp_path).wait(HANGS) == SOME_NOT_FITTED
    assert "swing0.mcap: was not understood" in said(tmp_path)
    assert start(*words, "--retry-failed", folder=tmp_path).wait(HANGS) == 0, said(tmp_path)
    assert "1 take: 1 fitted." in said(tmp_path)
    assert not kept.exists()


def test_a_takes_name_with_an_end_of_line_forges_no_line_of_a_batch(takes, tmp_path):
    night = tmp_path / "takes"
    night.mkdir()
    (night / "two\nlines.mcap").write_bytes((takes / "swing0.mcap").read_bytes())
    kept = tmp_path / "out" / failure_name(job_of(night / "two\nlines.mcap", tmp_path / "out").key)
    kept.parent.mkdir(parents=True)
    kept.write_text('{"sentence": "was not\\nunderstood"}')
    done = hangtime_here("batch", night, "--out", "out", "--workers", 1, "--dashboard-port", 0, *SHORT, folder=tmp_path)
    assert done.returncode == SOME_NOT_FITTED
    assert "two\\nlines.mcap: was not\\nunderstood\n" in done.stderr


def test_a_plan_that_does_not_hold_is_refused_before_the_night():
    with pytest.raises(FitError, match="no effect named"):
        Plan(effects=("gremlins",)).request()
