"""Kills of sync and power cuts of the device: no take is lost or duplicated."""

from __future__ import annotations

import logging

import pytest

from benchmarks import sync as benchmark
from capture.appliance.receipts import receipts
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from capture.sync.rounds import Sync
from capture.sync.settings import SyncSettings, SyncSetup
from tests.capture.appliance.power_cut import Disk
from tests.capture.appliance.spool_takes import record
from tests.capture.sync.servers import CREDENTIALS
from tests.capture.sync.syncing import check_server, on_server


def setup_of(spool, server, quota=1 << 30):
    """Return the setup of sync for a folder as a server."""
    retention = Retention(quota_bytes=quota, least_free_bytes=0, days=None)
    return SyncSetup(SyncSettings(url=f"file://{server}", device="box", retention=retention), spool)


def test_every_power_cut_of_a_sync_ends_with_each_take_on_the_server_once(tmp_path, monkeypatch):
    """Two takes, of which one leaves: a cut after each call, with what was not synced gone, torn or there."""
    folder, server = tmp_path / "spool", tmp_path / "server"
    server.mkdir()
    with Spool(folder) as spool:
        takes = [record(spool, 40 + k, seed=k) for k in range(2)]
    disk = Disk(folder, beside=server)
    quota = takes[1].size
    with disk.recording(monkeypatch):
        assert Sync(setup_of(folder, server, quota), CREDENTIALS).once() is None
    assert [take.sequence for take in Spool(folder).takes()] == [2]
    calls = [moment.call for moment in disk.moments]
    assert sum(call.startswith("rename to take-") for call in calls) == 2  # two receipts
    assert any(call == "unlink take-000001.mcap" for call in calls)
    cuts = 0
    for moment in disk.moments:
        for word, files in moment.cuts():
            cuts += 1
            place = disk.lay(files, tmp_path / "cut/spool")
            held = tmp_path / "cut/server"
            for name, content in moment.beside.items():
                (held / name).parent.mkdir(parents=True, exist_ok=True)
                (held / name).write_bytes(content)
            with Spool(place) as spool:
                spool.salvage()
                assert spool.begin().sequence >= 3, word
            assert Sync(setup_of(place, held, quota), CREDENTIALS).once() is None, word
            check_server(on_server(tmp_path / "cut"), takes)
            assert [one.sequence for one in receipts(place)] == [1, 2], word
            for path in sorted(held.rglob("*"), reverse=True):
                path.unlink() if path.is_file() else path.rmdir()
    print(f"{len(disk.moments)} calls, {cuts} states of the disk")
    assert cuts >= 40  # as recorded; far fewer would mean that the shim misses calls


@pytest.mark.slow
@pytest.mark.processor_time(600)
def test_ten_kills_lose_double_and_damage_nothing(tmp_path):
    """Ten runs ended by SIGKILL, five against a bucket; `benchmarks/sync.py` does it 500 times."""
    found = benchmark.killed(10, tmp_path)
    assert found["killed"] == 10
    assert found["recorded"] >= 20
    assert [found[key] for key in ("lost", "doubled", "damaged", "waiting", "receipts missing", "last exit code")] == [
        0
    ] * 6


@pytest.mark.slow
@pytest.mark.processor_time(3600)
def test_five_hundred_kills_lose_double_and_damage_nothing(tmp_path):
    found = benchmark.killed(500, tmp_path)
    assert found["killed"] == 500
    assert [found[key] for key in ("lost", "doubled", "damaged", "waiting", "receipts missing", "last exit code")] == [
        0
    ] * 6


@pytest.mark.slow
def test_every_fault_of_a_server_is_named_and_costs_no_take(tmp_path):
    """One round of each fault against rclone and moto; `benchmarks/sync.py` does 200 rounds."""
    said: list[str] = []
    logging.getLogger("hangtime.sync").setLevel(logging.CRITICAL)
    found = benchmark.storms(28, tmp_path, say=said.append)
    assert found["recorded"] == 28
    assert [found[key] for key in ("lost", "doubled", "damaged", "waiting")] == [0] * 4
    assert {line.split(":")[0].strip() for line in said} >= {"500", "403", "full", "skewed", "busy", "killed", "silent"}


@pytest.mark.slow
@pytest.mark.processor_time(3600)
def test_two_hundred_rounds_of_faults_cost_no_take(tmp_path):
    found = benchmark.storms(200, tmp_path, say=lambda line: None)
    assert found["recorded"] == 200
    assert [found[key] for key in ("lost", "doubled", "damaged", "waiting")] == [0] * 4


@pytest.mark.slow
@pytest.mark.processor_time(3600)
def test_a_week_offline_with_500_takes_arrives_in_order_with_memory_flat(tmp_path):
    found = benchmark.week(500, tmp_path)
    assert (found["recorded"], found["exit code"]) == (500, 0)
    assert [found[key] for key in ("lost", "doubled", "damaged", "out of order")] == [0] * 4
    assert found["MB, all"] - found["MB, tenth"] <= benchmark.MOST_GROWTH
