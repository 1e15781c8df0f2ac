"""The folder of takes under a recorder that runs: it stays the one that was locked, or the recorder says so."""

from __future__ import annotations

import errno
import time
from pathlib import Path

import pytest

from capture.appliance.disk import Disk, _named
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from capture.errors import SpoolError
from tests.capture.appliance.real_daemon import small_disk
from tests.capture.appliance.spool_takes import record
from tests.capture.appliance.test_disk import LONGEST, news_of

GONE = "this is not the folder of takes that the recorder began with; mount its disk again or move it back"


@pytest.mark.parametrize("is_replaced", [False, True])
def test_no_number_is_given_in_another_folder_and_the_next_one_once_it_is_back(tmp_path, is_replaced):
    """Two takes lie on the disk that goes; in its place is nothing, or the empty folder that it was mounted over."""
    folder, elsewhere = tmp_path / "takes", tmp_path / "elsewhere"
    with Spool(folder) as spool:
        record(spool)
        record(spool)
        folder.rename(elsewhere)
        if is_replaced:
            folder.mkdir()
        for act in (spool.begin, spool.salvage, spool.check_in_place):
            with pytest.raises(SpoolError, match=f"{folder}: {GONE}"):
                act()
        assert not folder.exists() or not list(folder.iterdir())
        if is_replaced:
            folder.rmdir()
        elsewhere.rename(folder)
        assert record(spool).sequence == 3


def test_a_disk_that_is_unmounted_under_the_recorder_is_a_fault_until_it_is_back(tmp_path):
    """A real mount, taken away lazily, as of a plug that is pulled: the folder below would take every write."""
    folder = tmp_path / "takes"
    with small_disk(folder, "4m"):
        disk = Disk(folder, least_free=0, retention=Retention(), clock=time.monotonic)
        disk.start()
        disk.salvage()
        assert any(one.is_sound for one in news_of(disk))
        record(disk._spool)
    assert not list(folder.iterdir())
    for ask in (disk.look, disk.salvage):
        ask()
        news = news_of(disk)
        assert [str(one.failure).startswith(f"{folder}: {GONE}") for one in news if one.failure] == [True]
        assert not any(one.is_sound for one in news)
    assert not list(folder.iterdir())
    disk.close(LONGEST)


def test_the_disk_thread_makes_no_folder_where_the_one_of_the_takes_was(tmp_path):
    """It would hide that the disk is gone, and the next program would write there."""
    folder = tmp_path / "takes"
    disk = Disk(folder, least_free=0, retention=Retention(), clock=time.monotonic)
    disk.start()
    disk.salvage()
    assert any(one.is_sound for one in news_of(disk))
    folder.rename(tmp_path / "elsewhere")
    disk.salvage()
    assert [str(one.failure).startswith(f"{folder}: {GONE}") for one in news_of(disk)] == [True]
    assert not folder.exists()
    disk.close(LONGEST)


def test_after_a_restart_the_folder_that_is_there_counts(tmp_path):
    with Spool(tmp_path / "takes") as spool:
        record(spool)
        (tmp_path / "takes").rename(tmp_path / "old")
        spool.close()
        assert record(spool).sequence == 1


@pytest.mark.parametrize(
    ("state", "advice"),
    [
        ("", "replace the card, which is worn out"),
        ("/var/lib/hangtime", "if the card is sound, the unit may not write here: give spool.folder a place below "),
        ("/var/lib/hangtime:/media/stick", "replace the card, which is worn out"),
    ],
)
def test_a_place_that_the_unit_may_not_write_blames_no_sound_card(tmp_path, monkeypatch, state, advice):
    """systemd shows a unit every folder but its own as read-only (`man 5 systemd.exec`, ProtectSystem=strict)."""
    monkeypatch.setenv("STATE_DIRECTORY", state)
    folder = Path("/media/stick/takes")
    error = _named(OSError(errno.EROFS, "Read-only file system"), folder)
    assert error.advice.startswith(advice)
    assert ("ReadWritePaths=/media/stick/takes" in error.advice) == ("may not write" in advice)
