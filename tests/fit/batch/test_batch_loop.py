"""The main loop of a batch on dask in this process: outcomes, second attempts, lost connections, and its end."""

from __future__ import annotations

import contextlib
import threading
from types import SimpleNamespace

import distributed
import pytest

from fit.batch import runner
from fit.batch.cluster import WAITS, Workers
from fit.batch.ending import Ending
from fit.batch.jobs import Outcome, Task
from fit.batch.runner import Survey, run
from fit.errors import BatchError, UnreachableError

ATTEMPTS: list[Task] = []
GOES_ON = threading.Event()
GONE = UnreachableError("cannot be read", where="s3://takes", advice="wait")


def work(job):
    """End as the job's key says, in dask's own thread of this process."""
    ATTEMPTS.append(job)
    attempt = sum(one.key == job.key for one in ATTEMPTS)
    if job.key == "gone" or (job.key == "back" and attempt == 1):
        raise GONE
    if job.key == "wrong":
        raise BatchError("is a folder", where="fits", advice="give another name")
    if job.key == "waits":
        distributed.get_worker().log_event(WAITS, "fits/waits.json: cannot be written; wait")
        GOES_ON.wait(60)
    return "no outcome" if job.key == "odd" else Outcome(key=job.key, state="fitted")


@pytest.fixture
def connections(monkeypatch):
    """How many workers each connection was to have; all reach one worker of this process."""
    counts = []
    ATTEMPTS.clear()
    GOES_ON.clear()
    here = {"processes": False, "n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with distributed.Client(**here) as client:

        @contextlib.contextmanager
        def connect(workers):
            counts.append(workers.count)
            yield client

        monkeypatch.setattr(runner, "connect", connect)
        monkeypatch.setattr(runner, "SCHEDULER_RETRY", 0.0)
        monkeypatch.setattr(runner, "POLL", 0.01)
        yield counts
        GOES_ON.set()


def survey_of(*keys):
    jobs = [Task(key=key, takes_url="takes", results_url="out", physics="") for key in keys]
    return Survey(keys={f"{key}.mcap": key for key in keys}, jobs=jobs, work=work)


def test_every_outcome_is_recorded_and_a_take_that_cannot_be_reached_is_tried_once_more(connections):
    found, shown, told = survey_of("back", "wrong", "plain"), [], []
    run(found, Workers(count=2, patience=60.0), progress=lambda *one: shown.append(one), say=told.append)
    assert connections == [2]
    assert {key: one.state for key, one in found.outcomes.items()} == {
        "back": "fitted", "wrong": "refused", "plain": "fitted",
    }  # fmt: skip
    assert found.outcomes["wrong"].sentence == "fits: is a folder; give another name"
    assert [(one.key, one.patience) for one in ATTEMPTS].count(("back", 60.0)) == 2
    assert len(ATTEMPTS) == 4
    assert (shown[0], shown[-1]) == ((0, 3, "handed out"), (3, 3, "all done"))
    assert sorted(shown) == [(0, 3, "handed out"), (1, 3, ""), (2, 3, ""), (3, 3, "all done")]
    assert told[0].startswith("Dashboard: ")
    assert told[1:] == [f"{GONE}. Waiting for it to come back."]


def test_takes_out_of_reach_for_longer_than_patience_end_the_batch_with_their_error(connections):
    found = survey_of("gone", "plain")
    with pytest.raises(UnreachableError, match=r"s3://takes: cannot be read; wait"):
        run(found, Workers(patience=0.0))
    assert [job.key for job in found.waiting][:1] == ["gone"]


def test_connections_that_bring_no_result_are_counted_from_the_last_result_on(connections, monkeypatch):
    """The first one brings one of two results; the next two are one too many."""
    monkeypatch.setattr(runner, "FRUITLESS", 2)
    found, told = survey_of("plain", "odd"), []
    with pytest.raises(BatchError, match="this machine: 2 connections in a row brought no result; look at the logs"):
        run(found, Workers(count=2), say=told.append)
    assert connections == [2, 1, 1]
    lost = "The scheduler was lost; 1 job left. Waiting for it to come back."
    assert told[1:] == [lost, "Connected again.", lost, "Connected again.", lost]


def test_a_batch_at_its_end_leaves_the_rest_and_says_what_a_worker_waits_for(connections):
    found, told = survey_of("waits"), []
    clock = SimpleNamespace(now=0.0)

    def say(line):
        told.append(line)
        clock.now = 2.0 if "Waiting" in line else 0.0

    run(found, Workers(), say=say, ending=Ending(hours_end=2.0, running=lambda: clock.now))
    assert [job.key for job in found.waiting] == ["waits"]
    assert told[1:] == ["fits/waits.json: cannot be written; wait. Waiting for it to come back."]
    run(found, Workers(), say=told.append, ending=Ending(day_end=0.0))
    assert connections == [1]


@pytest.mark.parametrize(("patience", "limit"), [(0.0, 60.0), (600.0, 600.0)])
def test_workers_have_a_minute_to_arrive_or_as_long_as_patience_lasts(monkeypatch, patience, limit):
    """Asked for every five seconds; the last one was seen after 30 s."""
    clock, asked = SimpleNamespace(now=0.0), []

    def has_workers(client):
        asked.append(clock.now)
        return clock.now == 30.0

    monkeypatch.setattr(runner, "time", SimpleNamespace(monotonic=lambda: clock.now))
    monkeypatch.setattr(runner, "has_workers", has_workers)
    client = SimpleNamespace(subscribe_topic=lambda topic, hear: None)
    loop = runner._Round(client, Survey(), Workers(scheduler="tcp://a:1", patience=patience), print, print)
    for clock.now in (4.9, 5.0, 9.9, 30.0, 29.9 + limit):
        loop._look_for_workers()
    assert asked == [5.0, 30.0, 29.9 + limit]
    clock.now = 35.0 + limit
    with pytest.raises(
        UnreachableError, match=rf"tcp://a:1: there have been no workers for {(limit + 5) / 60:.0f} min"
    ):
        loop._look_for_workers()


def test_a_job_whose_workers_died_is_refused_and_one_whose_message_is_lost_has_no_outcome():
    job = SimpleNamespace(key="k")
    died = SimpleNamespace(status="error", exception=lambda timeout: distributed.KilledWorker("k", "w", 3))
    assert runner._outcome_of(died, job).state == "refused"
    assert "every worker that took it on died" in runner._outcome_of(died, job).sentence

    def lost(timeout):
        raise TimeoutError

    for future in (
        SimpleNamespace(status="error", exception=lost),
        SimpleNamespace(status="finished", result=lost),
        SimpleNamespace(status="finished", result=lambda timeout: None),
    ):
        assert runner._outcome_of(future, job) is None
