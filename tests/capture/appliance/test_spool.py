"""The spool: unique numbers, complete takes, and the order of removal."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest

from capture.appliance.receipts import READ_BACK, Receipt, read_receipt, receipts, write_receipt
from capture.appliance.retention import Retention
from capture.appliance.spool import CRASHED, UNNAMED, Spool, _is_of, sha256_of
from capture.errors import SpoolError
from formats.archive import read_take, verify_take
from tests.capture.appliance.spool_takes import frames, record, writer_of

NOW = datetime(2026, 11, 25, 12, tzinfo=UTC)
ANY = Retention(quota_bytes=1 << 40, least_free_bytes=0, days=None)


@pytest.fixture
def spool(tmp_path):
    with Spool(tmp_path / "spool") as one:
        yield one


def receipt_of(take, *, at=NOW):
    return Receipt(
        sequence=take.sequence, url="file:///server", key=take.stem, sha256=take.facts["sha256"], bytes=take.size,
        stored_sha256=take.facts["sha256"], stored_bytes=take.size, is_encrypted=False, verified=READ_BACK,
        at=at.isoformat(),
    )  # fmt: skip


def received(spool, take, **named):
    write_receipt(spool.folder, take.stem, receipt_of(take, **named))


def test_a_kept_take_is_sound_under_its_number_with_its_facts(spool):
    kept = record(spool, 75, facts={"dropped": 3})
    (found,) = spool.takes()
    assert (found.sequence, found.stem, found.path.name) == (1, "take-000001", "take-000001.mcap")
    assert found.facts == kept.facts == {
        "dropped": 3, "sequence": 1, "sha256": sha256_of(found.path), "bytes": found.path.stat().st_size,
    }  # fmt: skip
    assert verify_take(found.path).is_sound
    assert found.receipt is None
    assert [take.sequence for take in spool.waiting()] == [1]


def test_numbers_go_on_after_a_restart_and_after_everything_has_left(tmp_path):
    """Third number after two takes, one of which left nothing; a fourth where the counter itself was lost."""
    with Spool(tmp_path) as spool:
        record(spool)
        assert spool.begin().sequence == 2
    with Spool(tmp_path) as spool:
        kept = record(spool)
        assert kept.sequence == 3
        received(spool, kept)
    (tmp_path / "sequence").unlink()
    for path in tmp_path.glob("take-*"):
        path.unlink()
    with Spool(tmp_path) as spool:
        assert spool.begin().sequence == 4


def test_a_crash_in_mid_take_costs_less_than_two_seconds_and_is_named(spool):
    """100 frames at 30 a second, a block a second: 94 are on the disk, the last 6 are lost."""
    running = spool.begin()
    writer = writer_of(running)
    for frame in frames(100):
        writer.append(frame)
    writer._unfinished.file.close()
    (kept,) = spool.salvage()
    assert kept.facts["salvaged"] == CRASHED
    assert verify_take(kept.path).is_sound
    take = read_take(kept.path)
    assert len(take.time) == kept.facts["frames"] == 94
    assert take.notes["salvaged"] == CRASHED
    assert sorted(os.listdir(spool.folder)) == ["recorder.lock", "sequence", "take-000001.json", "take-000001.mcap"]
    assert spool.salvage() == []


def test_a_crash_between_the_last_frame_and_the_name_costs_nothing(spool):
    running = spool.begin()
    with writer_of(running) as writer:
        for frame in frames(50):
            writer.append(frame)
    (kept,) = spool.salvage()
    assert kept.facts["salvaged"] == UNNAMED
    assert len(read_take(kept.path).time) == 50


def test_an_unreadable_file_is_set_aside_and_an_empty_file_is_not(spool):
    running, other = spool.begin(), spool.begin()
    running.partial.with_name(running.partial.name + ".partial").write_bytes(b"\0" * 4096)
    other.partial.with_name(other.partial.name + ".partial").touch()
    assert spool.salvage() == []
    (left,) = list(spool.folder.glob("*.unreadable"))
    assert (left.name, left.read_bytes()) == ("take-000001.unreadable", b"\0" * 4096)
    assert spool.begin().sequence == 3


def test_a_take_whose_writer_gave_up_is_kept_as_far_as_it_came(spool):
    """A writer that meets a full disk closes its file as it is: 31 of 45 frames were on the disk."""
    running = spool.begin()
    writer = writer_of(running)
    for frame in frames(45):
        writer.append(frame)
    writer.keep()
    kept = spool.keep(running, {"fault": "the disk is full"})
    assert (kept.facts["frames"], kept.facts["fault"]) == (31, "the disk is full")
    with pytest.raises(SpoolError, match="nothing was written of this take"):
        spool.keep(spool.begin(), {})


def _is_refused(folder, answers):
    try:
        Spool(folder).begin()
    except SpoolError as error:
        answers.put(str(error))
    else:
        answers.put("it records")


def test_one_process_records_and_another_may_look(spool):
    record(spool)
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    other = context.Process(target=_is_refused, args=(spool.folder, answers))
    other.start()
    assert "another process records here" in answers.get(timeout=600)
    other.join()
    assert len(Spool(spool.folder).takes()) == 1


def test_facts_that_are_no_longer_json_cost_no_take(spool):
    kept = record(spool)
    (spool.folder / "take-000001.json").write_bytes(b"\0\0\0")
    (found,) = spool.takes()
    assert (found.path, found.facts) == (kept.path, {})


def test_names_that_only_resemble_a_take_are_nobodys_and_their_numbers_are_not_given(spool):
    """A renamed take, a folder, links: none counts as a take, none ends the salvage, the next number is past them."""
    record(spool), record(spool)
    (spool.folder / "take-000001.mcap").rename(spool.folder / "take-0000001.mcap")
    for name in ("take-000005.mcap", "take-000006.json", "take-000007.recording.mcap", "take-000008.salvaged.mcap"):
        (spool.folder / name).mkdir()
    (spool.folder / "take-000009.mcap").symlink_to("/nowhere")
    (spool.folder / "take-000010.recording.mcap.partial").symlink_to("/etc/passwd")
    (spool.folder / f"take-{10**30}.mcap").touch()
    assert spool.salvage() == []
    assert [take.sequence for take in spool.takes()] == [2]
    assert spool.begin().sequence == 11
    assert (spool.folder / "take-000010.recording.mcap.partial").is_symlink()


def test_a_disk_that_fails_while_it_is_read_costs_no_take(spool, monkeypatch):
    """An error of reading says nothing of the content: what a crash left stays until the disk reads it."""
    running = spool.begin()
    writer = writer_of(running)
    for frame in frames(100):
        writer.append(frame)
    writer._unfinished.file.close()
    opened = Path.open
    with monkeypatch.context() as bad:

        def fails(path, mode="r", *more, **named):
            if path.name.endswith(".partial") and mode == "rb":
                raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
            return opened(path, mode, *more, **named)

        bad.setattr(Path, "open", fails)
        bad.setattr(Path, "read_bytes", lambda path: fails(path, "rb").read())
        with pytest.raises(OSError, match="Input/output"):
            spool.salvage()
    assert list(spool.folder.glob("*.unreadable")) == []
    assert [len(read_take(take.path).time) for take in spool.salvage()] == [94]


# --- retention ------------------------------------------------------------------------------------


def test_the_oldest_verified_take_leaves_first_and_an_unsynced_one_never(spool):
    """Four takes, the second unsynced, room for two: the first and the third leave."""
    takes = [record(spool) for _ in range(4)]
    for take in (takes[0], takes[2], takes[3]):
        received(spool, take)
    room = spool.make_room(Retention(quota_bytes=2 * takes[0].size + 50, least_free_bytes=0, days=None), now=NOW)
    assert room.left == ("take-000001", "take-000003")
    assert room.is_enough
    assert [take.sequence for take in spool.takes()] == [2, 4]
    room = spool.make_room(Retention(quota_bytes=0, least_free_bytes=0, days=None), now=NOW)
    assert (room.left, room.is_enough, room.used) == (("take-000004",), False, takes[1].size)
    assert [take.sequence for take in spool.waiting()] == [2]
    assert [one.sequence for one in receipts(spool.folder)] == [1, 3, 4]
    assert not list(spool.folder.glob("take-000001*"))


def test_room_is_made_for_what_is_asked_and_for_the_disk(spool, monkeypatch):
    """A disk with 100 bytes less than is to stay free, and a quota 100 bytes short: each time one take leaves."""
    takes = [record(spool) for _ in range(3)]
    for take in takes:
        received(spool, take)
    usage = type("Usage", (), {"free": 1_000_000})
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage)
    short_disk = Retention(quota_bytes=1 << 40, least_free_bytes=1_000_000, days=None)
    assert spool.make_room(short_disk, now=NOW, need=100).left == ("take-000001",)
    short_quota = Retention(quota_bytes=takes[1].size + takes[2].size, least_free_bytes=0, days=None)
    assert spool.make_room(short_quota, now=NOW, need=100).left == ("take-000002",)


@pytest.mark.parametrize(("days", "leaves"), [(29.9, ()), (30.1, ("take-000001",)), (-20_000, ())])
def test_a_verified_take_leaves_after_its_days_and_not_because_the_clock_is_at_1970(spool, days, leaves):
    received(spool, record(spool))
    record(spool)
    room = spool.make_room(Retention(least_free_bytes=0, days=30.0), now=NOW + timedelta(days=days))
    assert room.left == leaves


def test_a_take_whose_receipt_becomes_that_of_another_server_meanwhile_stays(spool, monkeypatch):
    take = record(spool)
    received(spool, take)
    known = read_receipt(spool.folder, take.stem)
    found = iter([known, msgspec.structs.replace(known, url="file:///elsewhere")])
    monkeypatch.setattr("capture.appliance.spool.read_receipt", lambda folder, stem: next(found))
    assert spool.make_room(Retention(quota_bytes=0, least_free_bytes=0), now=NOW).left == ()
    assert take.path.exists()


def test_a_receipt_that_cannot_be_read_is_none(spool):
    take = record(spool)
    received(spool, take)
    path = spool.folder / "receipts/take-000001.json"
    path.write_text(json.dumps({"sequence": 1}))
    assert [take.sequence for take in spool.waiting()] == [1]
    assert spool.make_room(Retention(quota_bytes=0, least_free_bytes=0), now=NOW).left == ()


@pytest.mark.parametrize("spoilt", ["sequence", "take"])
def test_a_number_with_13_digits_is_given_to_no_take_because_it_could_not_be_found(spool, spoilt):
    take = record(spool, 40)
    if spoilt == "sequence":
        (spool.folder / "sequence").write_text("9999999999999")
    else:
        take.path.with_name("take-999999999999.mcap").write_bytes(take.path.read_bytes())
    for fails in (spool.begin, spool.salvage):
        with pytest.raises(SpoolError, match=r"the numbers of takes are used up.*write the true last number"):
            fails()
    (spool.folder / "take-999999999999.mcap").unlink(missing_ok=True)
    (spool.folder / "sequence").write_text("1")
    assert spool.salvage() == []
    assert spool.begin().sequence == 2


@pytest.fixture
def synced(spool, monkeypatch):
    """The names of takes and facts in the spool at each time that its folder is put on the disk."""
    seen = []
    monkeypatch.setattr(
        "capture.appliance.spool.sync_folder",
        lambda folder: seen.append(sorted(path.name for path in folder.glob("take-0*.*") if path.is_file())),
    )
    return seen


def test_a_kept_take_has_its_name_on_the_disk(spool, synced):
    record(spool, 40)
    assert synced[-1:] == [["take-000001.json", "take-000001.mcap"]]


def test_a_take_has_left_the_disk_before_its_facts_leave(spool, synced):
    received(spool, record(spool, 40))
    spool.make_room(Retention(quota_bytes=0, least_free_bytes=0), now=NOW)
    assert synced[-1] == ["take-000001.json"]
    assert not list(spool.folder.glob("take-0*.*"))


def test_room_is_enough_where_the_requested_bytes_leave_the_disk_its_own(spool, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: type("Usage", (), {"free": 1000}))
    limits = Retention(quota_bytes=1 << 30, least_free_bytes=900)
    assert [spool.make_room(limits, now=NOW, need=need).is_enough for need in (100, 101)] == [True, False]


def test_a_take_that_leaves_while_it_is_looked_at_keeps_its_receipt(spool):
    receipt = msgspec.structs.replace(receipt_of(record(spool)), bytes=5)
    assert _is_of(receipt, spool.folder / "take-000009.mcap")
    here = spool.folder / "take-000008.mcap"
    for content, is_its_own in ((b"12345", True), (b"1234", False)):
        here.write_bytes(content)
        assert _is_of(receipt, here) is is_its_own
