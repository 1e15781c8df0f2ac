"""A power cut after every call of the spool: no promise is broken, and nothing is duplicated."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import pytest

from capture.appliance.receipts import write_receipt
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from formats.archive import read_take, verify_take
from formats.unfinished import UnfinishedFile
from tests.capture.appliance.power_cut import Disk
from tests.capture.appliance.spool_takes import frames, writer_of
from tests.capture.appliance.test_spool import receipt_of

NOW = datetime(2026, 11, 25, 12, tzinfo=UTC)


@dataclass(frozen=True)
class Number:
    """The promise that this number was assigned."""

    number: int


@dataclass(frozen=True)
class Frames:
    """The promise that this number of frames of a take is on the disk."""

    number: int
    count: int


@dataclass(frozen=True)
class MayLeave:
    """The promise that this take is on the server, and may be removed."""

    number: int


def record_a_day(disk, folder):
    """Three takes: the second goes to the server and leaves, the third is still running at the end."""
    with Spool(folder) as spool:
        spool.salvage()
        for count in (40, 50):
            running = spool.begin()
            disk.promise(Number(running.sequence))
            with writer_of(running) as writer:
                for done, frame in enumerate(frames(count), 1):
                    blocks = writer._blocks
                    writer.append(frame)
                    if writer._blocks > blocks:
                        disk.promise(Frames(running.sequence, done))
            kept = spool.keep(running, {"frames": count})
            disk.promise(Frames(running.sequence, count))
        disk.promise(MayLeave(2))
        write_receipt(folder, kept.stem, receipt_of(kept))
        spool.make_room(Retention(quota_bytes=0, least_free_bytes=0), now=NOW)
        running = spool.begin()
        disk.promise(Number(running.sequence))
        writer = writer_of(running)
        for done, frame in enumerate(frames(65), 1):
            blocks = writer._blocks
            writer.append(frame)
            if writer._blocks > blocks:
                disk.promise(Frames(running.sequence, done))
        writer._unfinished.file.close()


def check(folder, promises, word):
    """Restart in a folder as a cut left it, and check the promises."""
    with Spool(folder) as spool:
        spool.salvage()
        takes = {take.sequence: take for take in spool.takes()}
        given = [one.number for one in promises if isinstance(one, Number)]
        may_leave = {one.number for one in promises if isinstance(one, MayLeave)}
        for number in given:
            wanted = max([one.count for one in promises if isinstance(one, Frames) and one.number == number] + [0])
            if number in may_leave and number not in takes:
                continue
            if wanted:
                assert number in takes, f"{word}: take {number} is lost"
        for number, take in takes.items():
            assert verify_take(take.path).is_sound, f"{word}: take {number} is damaged"
            content = read_take(take.path)
            wanted = max([one.count for one in promises if isinstance(one, Frames) and one.number == number] + [0])
            assert len(content.time) >= wanted, f"{word}: {len(content.time)} of {wanted} frames of take {number}"
            assert np.allclose(content.time, np.arange(len(content.time)) / 30, atol=1e-6), word
            assert take.facts["bytes"] == take.size, word
        # Numbers: none that was given is given again.
        assert spool.begin().sequence > max([*given, *takes, 0]), word
        # Nothing is left over, and starting once more changes nothing.
        allowed = {"sequence", "recorder.lock", "receipts"}
        allowed |= {f"{take.stem}.{ending}" for take in takes.values() for ending in ("mcap", "json")}
        allowed |= {path.name for path in folder.glob("*.unreadable")}
        assert {path.name for path in folder.iterdir()} <= allowed, word
        assert spool.salvage() == [], word
        assert {take.sequence for take in spool.takes()} == set(takes), word


def replay(disk, place):
    """Check every cut of a recorded disk; returns how many there were."""
    cuts = 0
    for moment in disk.moments:
        for word, files in moment.cuts():
            check(disk.lay(files, place), disk.promises[: moment.promises], word)
            cuts += 1
    return cuts


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """The recorded calls of a day, with every state of the disk after each."""
    folder = tmp_path_factory.mktemp("disk") / "spool"
    folder.mkdir()
    disk = Disk(folder)
    with pytest.MonkeyPatch.context() as patch, disk.recording(patch):
        record_a_day(disk, folder)
    return disk


def test_every_cut_of_a_day_leaves_what_was_promised_once(day, tmp_path):
    """Three takes, a receipt, a take that leaves: cut after each call, what was not synced is gone, torn or there."""
    cuts = replay(day, tmp_path / "cut")
    print(f"{len(day.moments)} calls and promises, {cuts} states of the disk")
    assert cuts >= 100  # as recorded; far fewer would mean that the shim misses calls


def test_a_cut_while_a_cut_is_being_mended_changes_nothing(day, tmp_path, monkeypatch):
    """The last moment of the day, when a take was running: salvage itself is cut after each of its calls."""
    *_, (_, files) = day.moments[-1].cuts()
    folder = day.lay(files, tmp_path / "spool")
    mending = Disk(folder)
    with mending.recording(monkeypatch), Spool(folder) as spool:
        spool.salvage()
    assert any("salvaged.mcap" in moment.call for moment in mending.moments)
    for moment in mending.moments:
        for word, left in moment.cuts():
            check(mending.lay(left, tmp_path / "cut"), day.promises, word)


def test_the_replay_finds_content_that_was_never_synced(tmp_path, monkeypatch):
    """An archive that is written and not synced is no archive after a cut."""
    folder = tmp_path / "spool"
    folder.mkdir()
    disk = Disk(folder)
    monkeypatch.setattr(UnfinishedFile, "sync", lambda self: self.file.flush())
    with disk.recording(monkeypatch):
        record_a_day(disk, folder)
    with pytest.raises(AssertionError, match="take 1 is lost"):
        replay(disk, tmp_path / "cut")


def test_the_replay_finds_a_number_that_was_never_synced(tmp_path, monkeypatch):
    folder = tmp_path / "spool"
    folder.mkdir()
    disk = Disk(folder)
    monkeypatch.setattr("capture.appliance.spool.write_whole", lambda path, content: path.write_bytes(content))
    with disk.recording(monkeypatch):
        record_a_day(disk, folder)
    with pytest.raises(AssertionError):
        replay(disk, tmp_path / "cut")
