"""A temporary outage of bucket, network or workers costs a batch time and no take."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from fit.batch import cluster, runner, worker
from fit.batch.cli import SOME_NOT_FITTED
from fit.batch.cluster import Workers, connect
from fit.batch.diagnosing import heard
from fit.batch.jobs import Outcome
from fit.batch.runner import Outage, Survey, _outcome_of, run, survey
from fit.batch.store import Bucket, Folder, open_store
from fit.batch.summary import rows_of
from fit.errors import BatchError, UnreachableError
from fit.identification.request import Plan
from tests.fit.batch.night import (
    HANGS,
    PROGRAMS,
    SHORT,
    free_port,
    is_listening,
    keys_for,
    make_takes,
    running,
    said,
    scheduler_at,
    serving,
    start,
    wait_for,
)
from tests.fit.here import hangtime_here


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    return make_takes(tmp_path_factory.mktemp("takes"), 1)


TAKEN = """
import socket
from fit.batch.cluster import Workers, connect
with socket.create_server(("127.0.0.1", 0)) as held:
    port = held.getsockname()[1]
    with connect(Workers(count=0, dashboard_port=port)) as client:
        assert f":{port}/" not in client.dashboard_link
"""


def test_a_dashboard_whose_port_is_taken_has_another_one_without_a_word_of_the_library():
    done = subprocess.run([sys.executable, "-c", TAKEN], capture_output=True, text=True)
    assert (done.returncode, "UserWarning" in done.stderr) == (0, False)


# --- workers ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_scheduler_that_has_no_workers_is_not_waited_for_without_end(takes, tmp_path, monkeypatch):
    """One second of patience, and none for workers to start."""
    monkeypatch.setattr(runner, "ARRIVAL", 0.0)
    monkeypatch.setattr(runner, "WORKER_INTERVAL", 0.2)
    port = free_port()
    found = survey(open_store(str(takes)), open_store(str(tmp_path)), Plan())
    with running(*scheduler_at(port)):
        wait_for(lambda: is_listening(port))
        with pytest.raises(UnreachableError, match=r"have been no workers .* start workers") as told:
            run(found, Workers(scheduler=f"tcp://127.0.0.1:{port}", patience=1.0))
    assert told.value.exit_code == 75
    assert len(found.waiting) == 1


@pytest.mark.slow
def test_workers_that_start_after_the_batch_are_waited_for_without_any_patience(takes, tmp_path):
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    with running(*scheduler_at(port)):
        wait_for(lambda: is_listening(port))
        words = ("batch", takes, "--out", "out", "--scheduler", address, "--patience", 0, *SHORT)
        process = start(*words, folder=tmp_path)
        wait_for(lambda: "Dashboard: " in said(tmp_path))
        with running(PROGRAMS / "dask", "worker", address, "--nthreads", 1, "--no-dashboard", "--no-nanny"):
            assert process.wait(HANGS) == 0, said(tmp_path)


@pytest.mark.slow
def test_a_batch_stops_at_its_time_of_the_day(takes, tmp_path):
    """The minute after the next, without a worker; the wait is up to two minutes long."""
    port = free_port()
    until = time.strftime("%H:%M", time.localtime(time.time() + 70))
    with running(*scheduler_at(port)):
        wait_for(lambda: is_listening(port))
        words = ("batch", takes, "--out", "out", "--scheduler", f"tcp://127.0.0.1:{port}", "--until", until, *SHORT)
        process = start(*words, folder=tmp_path)
        assert process.wait(HANGS) == SOME_NOT_FITTED, said(tmp_path)
    assert "1 take: 1 waiting." in said(tmp_path)
    assert time.strftime("%H:%M") == until


# --- buckets ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("minutes", "status"),
    [
        pytest.param(None, 75, marks=pytest.mark.slow),
        pytest.param(20, 75, marks=pytest.mark.slow),
        (10, SOME_NOT_FITTED),
    ],
    ids=["no-end", "in-time", "too-late"],
)
def test_a_bucket_that_cannot_be_reached_may_be_tried_again_where_that_is_before_the_end(
    tmp_path, monkeypatch, minutes, status
):
    """The port is closed, as without a network; the options are right. The second try is a quarter of an hour later."""
    until = () if minutes is None else ("--until", time.strftime("%H:%M", time.localtime(time.time() + 60 * minutes)))
    for name, value in (
        ("ENDPOINT_URL", "http://127.0.0.1:9"), ("ALLOW_HTTP", "true"), ("ACCESS_KEY_ID", "a"),
        ("SECRET_ACCESS_KEY", "b"), ("REGION", "r"),
    ):  # fmt: skip
        monkeypatch.setenv(f"AWS_{name}", value)
    done = hangtime_here("batch", "s3://takes", "--out", "out", *until, folder=tmp_path)
    assert done.returncode == status, done.stderr
    assert "cannot be listed" in done.stderr
    assert "Traceback" not in done.stderr


class Listed(Bucket):
    """A bucket whose network goes once its takes are listed."""

    def names(self, below, suffix):
        return ["a.mcap", "b.mcap"] if suffix == ".mcap" else []


def test_a_network_that_is_lost_while_takes_are_read_is_no_fault_of_theirs(tmp_path, monkeypatch):
    for name, value in keys_for(free_port()).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(UnreachableError, match=r"a\.mcap: cannot be read"):
        survey(Listed("s3://takes"), open_store(str(tmp_path)), Plan())


@pytest.mark.slow
@pytest.mark.parametrize("is_back", [pytest.param(True, id="back"), pytest.param(False, id="gone")])
def test_a_bucket_that_workers_lose_is_waited_for_and_costs_no_take(tmp_path, is_back):
    """Takes in a bucket, results in a folder; the server goes before a worker has read its take."""
    root, port = tmp_path / "s3", free_port()
    (root / "takes").mkdir(parents=True)
    make_takes(root / "takes", 1)
    words = ("batch", "s3://takes", "--out", "out", "--workers", 1, "--dashboard-port", 0, *SHORT)
    patience = 10 if is_back else 0.05
    with serving(root, port):
        process = start(*words, "--patience", patience, folder=tmp_path, **keys_for(port))
        wait_for(lambda: "1 take, 1 to fit." in said(tmp_path))
    wait_for(lambda: "Waiting for it to come back." in said(tmp_path))
    with serving(root, port) if is_back else contextlib.nullcontext():
        assert process.wait(HANGS) == (0 if is_back else 75), said(tmp_path)
    assert "swing0.mcap: cannot be read" in said(tmp_path)
    assert "Traceback" not in said(tmp_path)
    assert not (tmp_path / "out/failed").exists()
    assert ("1 fitted" if is_back else "1 waiting") in (tmp_path / "out/summary.html").read_text()


def test_results_that_cannot_be_read_back_now_are_not_considered_broken(tmp_path, monkeypatch):
    for name, value in keys_for(free_port()).items():
        monkeypatch.setenv(name, value)
    found = Survey(keys={"a.mcap": "k"}, outcomes={"k": Outcome(key="k", state="known")})
    with pytest.raises(UnreachableError, match=r"k\.json: cannot be read"):
        rows_of(found, open_store("s3://takes"))


class GoneTwice(Folder):
    """A folder that is not reached the first two times that something is written to it."""

    def __init__(self, root):
        super().__init__(root)
        self.attempts = 0

    def write(self, name, content):
        self.attempts += 1
        if self.attempts <= 2:
            raise UnreachableError("cannot be written", where=name, advice="make room")
        super().write(name, content)


def test_a_finished_fit_waits_for_a_bucket_that_is_gone_as_long_as_patience_lasts(tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "SCHEDULER_RETRY", 0.0)
    worker.write_patiently(GoneTwice(tmp_path), "fits/a.json", b"{}", patience=60.0)
    assert (tmp_path / "fits/a.json").read_bytes() == b"{}"
    with pytest.raises(UnreachableError):
        worker.write_patiently(GoneTwice(tmp_path), "fits/b.json", b"{}", patience=0.0)


class Gone(Folder):
    """A folder that is never reached."""

    def write(self, name, content):
        raise UnreachableError("cannot be written", where=name, advice="make room")


@pytest.mark.parametrize(("patience", "limit"), [(0.0, 0.0), (60.0, 65.0)])
def test_a_worker_gives_up_five_seconds_after_the_batch_did(tmp_path, monkeypatch, patience, limit):
    """The batch hears of the outage up to five seconds later; a try takes two seconds here."""
    clock = SimpleNamespace(now=1000.0)

    def sleep(seconds):
        assert seconds == 2.0
        clock.now += seconds

    monkeypatch.setattr(worker, "time", SimpleNamespace(monotonic=lambda: clock.now, sleep=sleep))
    with pytest.raises(UnreachableError):
        worker.write_patiently(Gone(tmp_path), "fits/a.json", b"{}", patience=patience)
    assert limit <= clock.now - 1000.0 < limit + 2.0


def keeps_late(job):
    """Finish a fit whose folder is not reached at first."""
    results = open_store(job.results_url)
    worker.write_patiently(GoneTwice(results.root), "fits/a.json", b"{}", patience=job.patience)
    return Outcome(key=job.key, state="fitted")


@pytest.mark.slow
def test_a_batch_says_at_once_that_a_worker_waits_with_a_finished_result(takes, tmp_path):
    found, told = survey(open_store(str(takes)), open_store(str(tmp_path)), Plan()), []
    found.work = keeps_late
    run(found, Workers(count=1, dashboard_port=0, patience=60.0), say=told.append)
    assert not found.waiting
    assert [line for line in told if not line.startswith("Dashboard")] == [
        "fits/a.json.sha256: cannot be written; make room. Waiting for it to come back."
    ]


def test_an_error_of_a_worker_is_reported_in_its_own_words_without_the_name_of_its_class():
    job = SimpleNamespace(key="k")
    for error, sentence in (
        (BatchError("cannot be written (Is a directory)", where="fits", advice="give another name"),
         "fits: cannot be written (Is a directory); give another name"),
        (KeyError("a"), "KeyError: 'a'"),
    ):  # fmt: skip
        future = SimpleNamespace(status="error", exception=lambda timeout, error=error: error)
        assert _outcome_of(future, job).sentence == sentence


def test_an_outage_lasts_from_its_first_word_to_its_last_and_five_minutes_of_silence_end_it():
    outage = Outage()
    assert [outage.goes_on(now) for now in (1000.0, 1200.0, 1499.0)] == [(True, 0.0), (False, 200.0), (False, 499.0)]
    assert outage.goes_on(1800.0) == (True, 0.0)


def test_ctrl_c_while_the_workers_start_waits_closes_the_cluster_and_meets_none_of_them(monkeypatch):
    """A thread of a cluster that begins has SIGINT blocked, and what the thread starts inherits that."""
    seen, closed, begun = [], [], {}

    def begin(**options):
        begun.update(options)
        thread = threading.Thread(target=lambda: seen.append(signal.pthread_sigmask(signal.SIG_BLOCK, ())))
        thread.start()
        os.kill(os.getpid(), signal.SIGINT)
        thread.join()
        return SimpleNamespace(close=lambda timeout: closed.append("cluster"))

    def connected(cluster):
        return SimpleNamespace(cluster=cluster, close=lambda timeout: closed.append("client"))

    security = SimpleNamespace(temporary=lambda: None)
    monkeypatch.setitem(
        sys.modules, "distributed", SimpleNamespace(LocalCluster=begin, Client=connected, Security=security)
    )
    with pytest.raises(KeyboardInterrupt), connect(Workers(count=3, dashboard_port=9)):
        pytest.fail("the interruption is raised before work is handed out")
    own = {"n_workers": 3, "threads_per_worker": 1, "processes": True}
    reach = {"host": "127.0.0.1", "protocol": "tls://", "dashboard_address": "127.0.0.1:9"}
    assert begun.items() >= {**own, **reach}.items()
    assert closed == ["client", "cluster"]
    assert signal.SIGINT in seen[0]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_scheduler_is_tried_again_where_dasks_own_thread_did_not_begin_in_time(monkeypatch):
    """`distributed.utils.LoopRunner` waits for it 10 s, and then asserts that it has begun."""
    tries = iter((AssertionError(), None))

    def client(address, timeout):
        if error := next(tries):
            raise error
        return SimpleNamespace(cluster=None, close=lambda timeout: None)

    slept = []
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=client))
    monkeypatch.setattr(cluster, "time", SimpleNamespace(monotonic=time.monotonic, sleep=slept.append))
    with connect(Workers(scheduler="tcp://127.0.0.1:9")):
        assert not list(tries)
    assert slept == [2.0]


def test_a_batch_shows_the_stage_and_share_of_the_garment_at_work():
    """One garment of two is done, the other one at 40 %: 1.4 of 2."""
    heard, shown = {}, []
    client = SimpleNamespace(subscribe_topic=heard.__setitem__)
    jobs = [SimpleNamespace(key="k"), SimpleNamespace(key="l")]
    found = Survey(keys={"skirt": "k", "shirt": "l"}, outcomes={"l": Outcome(key="l", state="diagnosed")}, jobs=jobs)
    at_work = runner._Round(client, found, Workers(), lambda *told: shown.append(told), print)
    at_work._show_stages()
    assert shown == []
    for key, share in (("l", 0.9), ("k", 0.4)):  # the message on the finished garment came late
        heard[cluster.STAGES]((0.0, [key, "refitting air_drag", share]))
    at_work._show_stages()
    at_work._show_stages()
    assert shown == [(1.4, 2, "skirt: refitting air_drag")]


def test_a_worker_reports_on_its_diagnosis_every_few_seconds_and_nobody_outside_of_a_worker(monkeypatch):
    told, clock = [], SimpleNamespace(now=100.0)
    heard_by = SimpleNamespace(log_event=lambda topic, message: told.append((topic, message)))
    monkeypatch.setattr("fit.batch.diagnosing.time", SimpleNamespace(monotonic=lambda: clock.now))
    heard("k")("base fit", 0.1)  # no worker here, no error
    monkeypatch.setattr("distributed.get_worker", lambda: heard_by)
    hear = heard("k")
    for after, share in ((0.0, 0.1), (4.9, 0.2), (5.0, 0.3)):
        clock.now = 200.0 + after
        hear("refits", share)
    assert told == [(cluster.STAGES, ["k", "refits", 0.1]), (cluster.STAGES, ["k", "refits", 0.3])]
