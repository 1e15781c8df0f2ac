"""The disk thread: it reports errors, and continues."""

from __future__ import annotations

import errno
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import capture.appliance.disk
from capture.appliance.__main__ import _retention
from capture.appliance.config_tables import Config, SensorPart
from capture.appliance.disk import Disk, _named, _Running
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


def test_a_take_whose_frame_could_not_be_written_is_kept_as_far_as_it_came_and_says_why(disk, monkeypatch):
    """75 frames, then a disk that is full: the frames after the failure are not written."""
    running = disk._spool.begin()
    disk._take = _Running(running, writer_of(running))
    *whole, last = frames(76)
    for frame in whole:
        disk._take.writer.append(frame)
    tried = []

    def fail(frame):
        tried.append(frame)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(disk._take.writer, "append", fail)
    for _ in range(2):
        disk.add(SimpleNamespace(frame=last, scan=None))
    disk.end({"begun_by": "button"}, is_worth_keeping=True)
    news = news_of(disk)
    (failure,) = [one.failure for one in news if one.failure]
    assert "the disk cannot be written (No space left on device); make room" in str(failure)
    (kept,) = [one.kept for one in news if one.kept]
    assert (kept.facts["begun_by"], kept.facts["ended_by"]) == ("button", str(failure))
    assert len(tried) == 1
    assert 0 < len(read_take(kept.path).time) <= 75
    assert [one.counts for one in news if one.counts] == [(1, 1)]


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.ENOSPC, "make room, or let `hangtime sync`"), (errno.EFBIG, "make room on the disk"),
        (errno.EDQUOT, "make room in the quota"), (errno.EROFS, "replace the card, which is worn out"),
        (errno.EIO, "replace the card, which fails"), (errno.EACCES, "give it to the account"),
        (errno.ENOTDIR, "remove what bears"), (errno.EEXIST, "remove what bears"), (errno.EBUSY, "check the disk"),
    ],
)  # fmt: skip
def test_each_error_of_the_disk_has_its_step(tmp_path, number, advice):
    error = _named(OSError(number, "so"), tmp_path)
    assert (error.what, error.where) == ("the disk cannot be written (so)", tmp_path)
    assert error.advice.startswith(advice)


def test_a_look_says_how_much_room_there_is_and_counts_every_ten_seconds(tmp_path):
    now = [100.0]
    disk = Disk(tmp_path, least_free=0, retention=Retention(), clock=lambda: now[0])
    disk.start()
    counts = []
    for seconds in (0.0, 9.9, 0.1):
        now[0] += seconds
        disk.look()
        news = news_of(disk)
        assert [one.room > 0 for one in news if one.room is not None] == [True]
        counts.append([one.counts for one in news if one.counts])
    assert counts == [[(0, 0)], [], [(0, 0)]]
    disk.close(LONGEST)


def test_a_busy_thread_looks_once_however_often_it_was_asked_and_again_later(disk):
    """A disk that hangs for an hour would otherwise have 3600 looks to make up for."""
    hangs = threading.Event()
    disk.salvage()
    news_of(disk)
    disk._put(hangs.wait)
    for _ in range(5):
        disk.look()
    hangs.set()
    assert [one.room > 0 for one in news_of(disk) if one.room is not None] == [True]
    disk.look()
    assert [one.room > 0 for one in news_of(disk) if one.room is not None] == [True]


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
