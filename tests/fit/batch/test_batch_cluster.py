"""Connections to a running cluster: its address, how long it is waited for, and how it is left."""

from __future__ import annotations

import json
import os
import sys
from types import SimpleNamespace

import distributed
import pytest

from fit.batch import cluster
from fit.batch.cluster import Workers, connect, has_workers
from fit.batch.room import Room
from fit.errors import BatchError, UnreachableError


@pytest.fixture
def dask(monkeypatch):
    """Dask with a scheduler that answers as told, on a clock that only sleep moves."""
    told = SimpleNamespace(errors=[], asked=[], closed=[], now=0.0, on_sleep=lambda: None, cluster=None)

    def client(address, timeout):
        told.asked.append((address, timeout, told.now))
        if told.errors:
            error = told.errors[0] if len(told.errors) == 1 else told.errors.pop(0)
            if error is not None:
                raise error
        return SimpleNamespace(cluster=told.cluster, close=lambda timeout: told.closed.append(timeout))

    def sleep(seconds):
        told.now += seconds
        told.on_sleep()

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=client))
    monkeypatch.setattr(cluster, "time", SimpleNamespace(monotonic=lambda: told.now, sleep=sleep))
    return told


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_scheduler_file_gives_the_address_in_any_usual_encoding(dask, tmp_path, encoding):
    path = tmp_path / "s.json"
    path.write_text(json.dumps({"type": "Scheduler", "address": "tcp://10.0.0.1:8786"}), encoding=encoding)
    with connect(Workers(scheduler=str(path))) as client:
        assert client.cluster is None
    assert dask.asked == [("tcp://10.0.0.1:8786", 5.0, 0.0)]
    assert dask.closed == [5.0]


@pytest.mark.parametrize(("patience", "tries"), [(0.0, 1), (3.9, 3), (4.0, 3), (4.1, 4)])
def test_a_scheduler_is_tried_every_two_seconds_until_patience_ends(dask, patience, tries):
    dask.errors = [OSError("connection refused\nby the peer")]
    words = r"tcp://a:1: no scheduler answers there \(connection refused\); start it and run the batch again"
    with pytest.raises(UnreachableError, match=words), connect(Workers(scheduler="tcp://a:1", patience=patience)):
        pass
    assert [now for *_, now in dask.asked] == [2.0 * k for k in range(tries)]


def test_a_scheduler_that_says_nothing_timed_out_and_one_that_comes_back_is_used(dask):
    dask.errors = [TimeoutError()]
    with pytest.raises(UnreachableError, match=r"\(timed out\)"), connect(Workers(scheduler="tcp://a:1", patience=0.0)):
        pass
    dask.errors = [OSError("refused"), TimeoutError(), AssertionError(), None]
    with connect(Workers(scheduler="tcp://a:1", patience=60.0)):
        assert len(dask.asked) == 1 + 4


def test_a_scheduler_file_that_is_not_there_yet_is_waited_for(dask, tmp_path):
    path = tmp_path / "late.json"
    dask.on_sleep = lambda: path.write_text('{"address": "tcp://a:1"}') if dask.now >= 4.0 else None
    with connect(Workers(scheduler=str(path), patience=10.0)):
        assert dask.asked == [("tcp://a:1", 5.0, 4.0)]


def test_an_address_without_its_scheme_is_one_unless_a_file_has_this_name(dask, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BatchError, match="write tcp://a:1 or tls://a:1"), connect(Workers(scheduler="a:1")):
        pass
    (tmp_path / "a:1").write_text('{"address": "tcp://b:2"}')
    with connect(Workers(scheduler="a:1")):
        assert dask.asked[0][0] == "tcp://b:2"


def test_certificates_are_asked_for_only_where_the_address_needs_them(dask):
    dask.errors = [TypeError("no context")]
    with pytest.raises(BatchError, match="TLS needs certificates"), connect(Workers(scheduler="tls://a:1")):
        pass
    with pytest.raises(TypeError, match="no context"), connect(Workers(scheduler="tcp://a:1")):
        pass
    dask.errors = [ValueError("unknown address scheme")]
    with pytest.raises(BatchError, match="unknown address scheme"), connect(Workers(scheduler="x://a:1")):
        pass
    assert dask.now == 0.0


def test_a_cluster_is_closed_after_an_error_and_whatever_its_own_end_says(dask):
    dask.cluster = SimpleNamespace(close=lambda timeout: dask.closed.append("cluster"))
    with pytest.raises(KeyError), connect(Workers(scheduler="tcp://a:1")):
        raise KeyError
    assert dask.closed == [5.0, "cluster"]
    with connect(Workers(scheduler="tcp://a:1")) as client:
        del client.cluster


def test_a_missing_library_is_named_with_the_step_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BatchError, match=r"batch: distributed is not installed; .* pip install -e '\.\[batch\]'"), \
            connect(Workers()):  # fmt: skip
        pass


def test_a_cluster_without_workers_is_known_and_one_that_does_not_answer_counts_as_having_some():
    for count in (0, 1):
        here = {"processes": False, "n_workers": count, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
        with distributed.Client(**here) as client:
            assert has_workers(client) == (count > 0)
    assert has_workers(SimpleNamespace(scheduler=SimpleNamespace(ncores=None)))


def test_one_worker_a_core_is_started_where_there_are_as_many_jobs():
    cores = len(os.sched_getaffinity(0))
    room = Room(processors=cores, memory=None)
    assert [Workers().at_most(jobs, room)[0].count for jobs in (cores + 1, cores, 1)] == [cores, cores, 1]
    assert Workers(scheduler="tcp://a:1", patience=3.0).at_most(1, room)[0].patience == 3.0
