"""A file has one writer at a time, and no take replaces a file that the user did not name for it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import signal
import subprocess
import sys

import pytest

from formats.archive import TakeWriter, read_take, verify_take, write_take
from formats.errors import OutputError
from formats.outputs import refuse_to_replace
from formats.unfinished import put_aside
from tests.formats.test_archive import GARMENT, RIG, a_take, frame_of
from tests.formats.test_whole_files import synced

RECORDER = """
import sys
from pathlib import Path
from tests.formats.test_unfinished import a_writer, add
writer = a_writer(Path(sys.argv[1]))
add(writer, 70)
print("two blocks are written", flush=True)
sys.stdin.read()
add(writer, 150, first=70)
writer.finish()
"""


def a_writer(folder, **options):
    return TakeWriter(folder / "t.mcap", take_id="t", created="now", rig=RIG, garment=GARMENT, **options)


def add(writer, frames, first=0):
    take = a_take()
    for k in range(first, frames):
        writer.append(frame_of(take, k))


@pytest.fixture
def recorder(tmp_path):
    """Another process that has written two blocks of a take, and ends on request."""
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "two blocks are written\n"
        yield process
        process.kill()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("overwrite", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_take_that_another_process_is_recording_is_not_touched(recorder, tmp_path, overwrite):
    """With and without `overwrite`, the other recording ends with all its 150 frames."""
    with pytest.raises(
        OutputError, match=r"t\.mcap\.partial: another recording or import is writing this; give another name"
    ):
        a_writer(tmp_path, overwrite=overwrite)
    recorder.communicate("")
    assert recorder.returncode == 0
    assert (verify_take(tmp_path / "t.mcap").frames, verify_take(tmp_path / "t.mcap").is_sound) == (150, True)
    assert names(tmp_path) == ["t.mcap"]


def test_a_name_that_a_killed_recording_left_is_free_and_replaced_only_when_asked_to(recorder, tmp_path):
    """Two blocks of a second and a little are on the disk: more than 60 frames at 30 a second."""
    recorder.send_signal(signal.SIGKILL)
    recorder.wait()
    with pytest.raises(OutputError, match=r"t\.mcap\.partial: is what an interrupted recording or import left"):
        a_writer(tmp_path, overwrite=False)
    assert 60 < len(read_take(tmp_path / "t.mcap.partial").time) < 70
    with a_writer(tmp_path, overwrite=True) as writer:
        add(writer, 20)
    assert len(read_take(tmp_path / "t.mcap").time) == 20
    assert names(tmp_path) == ["t.left-1.mcap.partial", "t.mcap"], "what can be read is put aside, not replaced"
    assert 60 < len(read_take(tmp_path / "t.left-1.mcap.partial").time) < 70


def test_a_file_that_is_too_large_to_be_read_is_put_aside_as_well(tmp_path):
    """300 GB without a block in sight."""
    partial = tmp_path / "t.mcap.partial"
    with partial.open("wb") as file:
        file.truncate(300 << 30)
    write_take(tmp_path / "t.mcap", a_take())
    assert verify_take(tmp_path / "t.mcap").is_sound
    assert (tmp_path / "t.left-1.mcap.partial").stat().st_size == 300 << 30


def test_a_long_name_gives_way_where_what_is_left_of_it_is_put_aside(tmp_path):
    """Of 241 bytes 8 are given up for .left-10, and no letter is cut; without an end of its own it is whole."""
    name = "é" * 120 + "n"
    for number in range(1, 11):
        left = tmp_path / f"{name}.mcap.partial"
        left.write_bytes(b"what is left")
        aside = put_aside(left, tmp_path / f"{name}.mcap")
        assert aside.name == f"{'é' * 117}.left-{number}.mcap.partial"
    assert len(names(tmp_path)) == 10


def test_a_name_whose_ending_alone_is_too_long_is_refused_at_once(tmp_path):
    left = tmp_path / "t.partial"
    left.write_bytes(b"what is left")
    with pytest.raises(OSError, match="File name too long"):
        put_aside(left, tmp_path / f"t.{'m' * 250}")
    assert left.read_bytes() == b"what is left"


def test_a_writer_whose_folder_fails_leaves_no_empty_file_and_keeps_what_was_left(tmp_path, monkeypatch):
    def fail(folder):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("formats.unfinished.sync_folder", fail)
    with pytest.raises(OSError, match="Input"):
        a_writer(tmp_path)
    assert names(tmp_path) == []
    (tmp_path / "t.mcap.partial").write_bytes(b"what is left")
    with pytest.raises(OSError, match="Input"):
        a_writer(tmp_path, overwrite=True)
    assert names(tmp_path) == ["t.left-1.mcap.partial"]


def test_a_take_replaces_no_pipe_whether_it_is_there_before_or_comes_while_the_take_is_written(tmp_path):
    writer = a_writer(tmp_path, overwrite=True)
    add(writer, 20)
    os.mkfifo(tmp_path / "t.mcap")
    with pytest.raises(OutputError, match="a pipe or a socket is no place for a file"):
        writer.finish()
    assert (tmp_path / "t.mcap").is_fifo()
    writer.discard()
    with pytest.raises(OutputError, match="a pipe or a socket is no place for a file"):
        a_writer(tmp_path, overwrite=True)
    assert names(tmp_path) == ["t.mcap"]


def test_a_second_recording_that_was_left_is_put_aside_under_the_next_name(tmp_path):
    for count in (40, 50):
        writer = a_writer(tmp_path)
        add(writer, count)
        writer.keep()
    a_writer(tmp_path).keep()
    assert names(tmp_path) == ["t.left-1.mcap.partial", "t.left-2.mcap.partial", "t.mcap.partial"]


def test_a_link_at_the_path_of_a_partial_file_is_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "t.mcap.partial").symlink_to(tmp_path / "mine")
    with pytest.raises(OutputError, match=r"t\.mcap\.partial: is a link to another file"):
        a_writer(tmp_path, overwrite=True)
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_link_at_the_path_of_a_take_is_replaced_and_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "t.mcap").symlink_to(tmp_path / "mine")
    with a_writer(tmp_path, overwrite=True) as writer:
        add(writer, 20)
    assert (tmp_path / "mine").read_text() == "mine"
    assert not (tmp_path / "t.mcap").is_symlink()


def test_of_two_writers_in_one_process_the_second_is_refused(tmp_path):
    with a_writer(tmp_path) as writer:
        add(writer, 70)
        with pytest.raises(OutputError, match="another recording or import is writing this"):
            a_writer(tmp_path)
        add(writer, 150, first=70)
    assert verify_take(tmp_path / "t.mcap").frames == 150


def test_a_take_that_is_there_stays_and_the_refused_writer_leaves_nothing(tmp_path):
    before = write_take(tmp_path / "t.mcap", a_take()).read_bytes()
    with pytest.raises(OutputError, match=r"t\.mcap: is already there"):
        write_take(tmp_path / "t.mcap", a_take(20), overwrite=False)
    assert (tmp_path / "t.mcap").read_bytes() == before
    assert names(tmp_path) == ["t.mcap"]


def test_a_file_that_came_while_a_take_was_written_stays_and_so_does_what_was_written(tmp_path):
    writer = a_writer(tmp_path, overwrite=False)
    add(writer, 70)
    (tmp_path / "t.mcap").write_text("mine")
    with pytest.raises(OutputError, match=r"t\.mcap: is already there"):
        writer.finish()
    writer.keep()
    assert (tmp_path / "t.mcap").read_text() == "mine"
    assert len(read_take(tmp_path / "t.mcap.partial").time) == 70


def test_a_writer_that_gave_up_does_not_remove_the_next_ones_file(tmp_path):
    first = a_writer(tmp_path)
    first.keep()
    with a_writer(tmp_path) as second:
        first.discard()
        add(second, 20)
    assert len(read_take(tmp_path / "t.mcap").time) == 20


def test_a_lock_on_a_file_that_was_finished_meanwhile_does_not_count(tmp_path, monkeypatch):
    """The first ends between the second's opening and its lock: the second then has the finished take in hand."""
    first = a_writer(tmp_path)
    add(first, 70)
    lock = fcntl.flock

    def late(file, operation):
        monkeypatch.undo()
        first.finish()
        lock(file, operation)

    monkeypatch.setattr("fcntl.flock", late)
    second = a_writer(tmp_path)
    assert len(read_take(tmp_path / "t.mcap").time) == 70
    add(second, 20)
    second.finish()
    assert len(read_take(tmp_path / "t.mcap").time) == 20


def test_the_name_of_a_recording_is_on_the_disk_before_its_first_block(tmp_path, monkeypatch):
    """Else a power cut may leave no name that leads to what was synced (`man 2 fsync`)."""
    seen = synced(monkeypatch)
    writer = a_writer(tmp_path / "new")
    assert seen == [str(tmp_path), str(tmp_path / "new")]
    add(writer, 40)
    assert seen[2:] == [str(writer.partial)]
    writer.keep()


def test_a_take_is_whole_on_the_disk_before_the_descriptions_beside_it_are_replaced(tmp_path, monkeypatch):
    """`man 2 fsync`: what a power cut leaves is what the file had at the last call."""
    sizes = {}
    monkeypatch.setattr("os.fsync", lambda handle: sizes.update({os.fstat(handle).st_ino: os.fstat(handle).st_size}))
    writer = a_writer(tmp_path)
    add(writer, 40)
    before = []

    @contextlib.contextmanager
    def beside():
        before.append(sizes[writer.partial.stat().st_ino])
        yield

    size = writer.finish(beside()).stat().st_size
    assert before == [size]


def test_a_recording_that_ended_before_its_first_block_blocks_no_name(tmp_path):
    (tmp_path / "t.mcap.partial").touch()
    refuse_to_replace(tmp_path / "t.mcap")
    writer = a_writer(tmp_path, overwrite=False)
    add(writer, 40)
    writer.finish()
    assert names(tmp_path) == ["t.mcap"]


def test_a_file_that_appears_while_a_take_gets_its_name_is_not_replaced(tmp_path, monkeypatch):
    """It appears after the last look at the name, and before the take is renamed."""
    writer = a_writer(tmp_path, overwrite=False)
    add(writer, 40)
    monkeypatch.setattr("formats.unfinished.is_device", lambda path: path.write_text("mine") and False)
    with pytest.raises(
        OutputError, match=r"t\.mcap: is already there; give another name, or --overwrite to replace it"
    ):
        writer.finish()
    monkeypatch.undo()
    writer.keep()
    assert (tmp_path / "t.mcap").read_text() == "mine"
    assert names(tmp_path) == ["t.mcap", "t.mcap.partial"]


def test_the_new_name_of_a_file_that_is_put_aside_is_on_the_disk(tmp_path, monkeypatch):
    partial = tmp_path / "t.mcap.partial"
    partial.write_bytes(b"left")
    seen = synced(monkeypatch)
    assert put_aside(partial, tmp_path / "t.mcap").name == "t.left-1.mcap.partial"
    assert seen == [str(tmp_path)]
