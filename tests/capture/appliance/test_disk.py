"""The disk thread: it reports errors, and continues."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import capture.appliance.disk
from capture.appliance.__main__ import _retention
from capture.appliance.config_tables import Config, SensorPart
from capture.appliance.disk import Disk, _Running
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from formats.archive import read_take
from formats.judgement import judge
from tests.capture.appliance.spool_takes import frames, record, writer_of

LONGEST = 600.0  # s that the thread is waited for, on a busy machine


@pytest.fixture
def disk(tmp_path):
    one = Disk(tmp_path / "takes", least_free=0, retention=Retention(), clock=time.monotonic)
    one.start()
    yield one
    one.close(LONGEST)


def news_of(disk):
    until = time.monotonic() + LONGEST
    while not disk.is_idle and time.monotonic() < until:
        time.sleep(0.001)
    assert disk.is_idle
    return disk.news()


def test_a_defect_is_named_and_the_thread_does_its_next_work(disk, monkeypatch):
    """Were the thread to end, the lamp would show green and no frame would reach the disk."""
    with monkeypatch.context() as broken:
        broken.setattr(disk._spool, "salvage", lambda: [][0])
        disk.salvage()
        (said,) = [one.failure for one in news_of(disk) if one.failure]
    assert str(said).startswith(f"{disk._folder}: the recorder has a defect (IndexError: list index out of range); ")
    disk.salvage()
    assert any(one.is_sound for one in news_of(disk))
    assert record(disk._spool).sequence == 1


def test_the_minute_that_a_slow_processor_judges_is_not_the_disks(tmp_path, monkeypatch):
    """A take is judged for 50 s: the disk is 0 s behind then, and 3 s once it hangs for 3 s afterwards."""
    now, behind = [100.0], []
    disk = Disk(tmp_path, least_free=0, retention=Retention(), clock=lambda: now[0])
    running = disk._spool.begin()
    disk._take = _Running(running, writer_of(running))
    for frame in frames(75):
        disk._take.writer.append(frame)

    def passing(seconds, then, *given):
        now[0] += seconds
        behind.append(disk.behind(now[0]))
        return then(*given)

    monkeypatch.setattr(capture.appliance.disk, "judge", lambda take: passing(50, judge, take))
    monkeypatch.setattr(disk._spool, "keep", lambda *given: passing(3, Spool.keep, disk._spool, *given))
    disk._put(lambda: disk._do_end({}, True))
    disk.start()
    assert [one.kept.sequence for one in news_of(disk) if one.kept] == [1]
    assert behind == [0.0, 3.0]
    disk.close(LONGEST)


@pytest.mark.parametrize("is_kept", [True, False])
def test_a_take_that_is_not_worth_keeping_leaves_nothing_and_another_stays_whole(disk, is_kept):
    """75 frames."""
    running = disk._spool.begin()
    disk._take = _Running(running, writer_of(running))
    for frame in frames(75):
        disk._take.writer.append(frame)
    disk.end({}, is_worth_keeping=is_kept)
    (news,) = [one for one in news_of(disk) if one.is_over]
    assert (news.failure, news.kept is not None) == (None, is_kept)
    assert not running.partial.exists()
    assert [len(read_take(path).time) for path in disk._folder.rglob("*.mcap")] == [75] * is_kept


def test_a_folder_where_the_counter_should_be_is_named_by_its_path(disk):
    (disk._folder / "sequence").mkdir(parents=True)
    disk.begin(None)
    (said,) = [one.failure for one in news_of(disk) if one.failure]
    assert str(said) == (
        f"{disk._folder / 'sequence'}: the disk cannot be written (Is a directory); remove what bears this name"
    )


def test_retention_that_does_not_hold_lets_no_take_leave_for_its_age(tmp_path):
    """Of `day = 900` instead of `days = 900`, which sync itself refuses: the defaults would let it leave after 30."""
    sensor = SensorPart(rig=Path("rig.toml"), garment=Path("garment.toml"))
    retention = _retention(Config(sensor=sensor, sync={"retention": {"day": 900}}))
    assert (retention.days, retention.quota_bytes > 1 << 60) == (None, True)
