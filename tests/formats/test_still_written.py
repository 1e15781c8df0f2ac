"""A take that is read while a recording writes it is called that, and not an interrupted or lost one."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import time

import pytest

from fit.api.takes import say_takes
from formats import take_reader
from formats.archive import read_take
from formats.errors import TakeError
from formats.fault_words import doubts_of
from formats.unfinished import UnfinishedFile, is_being_written
from tests.fit.here import hangtime_here
from tests.formats.test_unfinished import a_writer, add, recorder  # noqa: F401 - a fixture

STILL = "a recording or import is still writing it; wait until it ends"
YET = "wait until the recording or import that writes it has ended"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("verify",), f"incomplete  t.mcap.partial: 63 frames in 2 blocks; missing: from 2.07 s on; {STILL}\n"),
        (("recover",), f"t.recovered.mcap: 63 frames, missing: from 2.07 s on; {STILL}, and recover it again\n"),
        (("export", "--to", "csv", "--out", "o"),
         f"o/t.csv: 63 frames; the take is incomplete; missing: from 2.07 s on; {STILL}\n"),
    ],
)  # fmt: skip
def test_every_command_says_that_a_take_is_still_written(recorder, tmp_path, words, said):  # noqa: F811
    done = hangtime_here("takes", words[0], "t.mcap.partial", *words[1:], folder=tmp_path)
    assert done.stdout == said
    assert STILL in hangtime_here("takes", "show", "t.mcap.partial", folder=tmp_path).stdout
    assert STILL in hangtime_here("takes", "list", ".", folder=tmp_path).stdout
    recorder.communicate("end")
    assert recorder.returncode == 0, "no reader disturbs the recording"
    assert not doubts_of(read_take(tmp_path / "t.mcap"))


def test_a_fit_says_before_its_minutes_that_a_take_is_still_written(recorder, tmp_path, capsys):  # noqa: F811
    """Its table of errors said so at its end."""
    say_takes([read_take(tmp_path / "t.mcap.partial")], [])
    assert capsys.readouterr().err.splitlines() == [
        "Fitting to t; judging on the same, as none is held out.", f"Warning: {tmp_path}/t.mcap.partial: {STILL}",
    ]  # fmt: skip
    recorder.communicate("end")
    say_takes([read_take(tmp_path / "t.mcap")], [])
    assert "Warning" not in capsys.readouterr().err


def test_one_without_a_block_is_not_called_ended(raw, tmp_path):
    partial = tmp_path / "t.mcap.partial"
    writing = UnfinishedFile(tmp_path / "t.mcap", overwrite=False)
    for content, what in ((b"", "is empty yet"), (raw[:60], "holds no readable header yet")):
        partial.write_bytes(content)
        with pytest.raises(TakeError) as refused:
            read_take(partial)
        assert str(refused.value) == f"{partial}: {what}; {YET}"
    writing.discard()
    writer = a_writer(tmp_path)
    add(writer, 1)
    writer._unfinished.file.flush()
    with pytest.raises(TakeError) as refused:
        read_take(partial)
    assert str(refused.value) == f"{partial}: holds no frame yet; {YET}"
    writer.discard()


def test_a_take_whose_writer_ends_while_it_is_read_is_not_called_interrupted(monkeypatch, tmp_path):
    writer, bytes_of = a_writer(tmp_path), take_reader._bytes_of
    add(writer, 60)
    writer._unfinished.sync()

    def read_then_end(path):
        raw = bytes_of(path)
        writer.finish()
        return raw

    monkeypatch.setattr(take_reader, "_bytes_of", read_then_end)
    partial = tmp_path / "t.mcap.partial"
    assert take_reader.verify_take(partial).is_being_written
    assert not partial.exists()


def test_a_pipe_under_an_unfinished_name_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(pipe := tmp_path / "t.mcap.partial")
    with pytest.raises(TakeError, match="is a pipe"):
        read_take(pipe)


def test_a_take_without_a_frame_yet_is_begun_and_not_lost(raw, tmp_path):
    """Its recording runs, and nothing is wrong with it."""
    writing = UnfinishedFile(tmp_path / "t.mcap", overwrite=False)
    (tmp_path / "t.mcap.partial").write_bytes(raw[:60])
    row = f"begun       t.mcap.partial: holds no readable header yet; {YET}\n"
    assert hangtime_here("takes", "list", ".", folder=tmp_path).stdout == row
    assert hangtime_here("takes", "verify", "t.mcap.partial", folder=tmp_path).stdout == row
    told = json.loads(hangtime_here("takes", "verify", "t.mcap.partial", "--json", folder=tmp_path).stdout)
    assert [take["state"] for take in told["takes"]] == ["begun"]
    writing.keep()
    assert hangtime_here("takes", "list", ".", folder=tmp_path).stdout.startswith("lost        t.mcap.partial: ")


def test_a_take_that_nobody_writes_any_more_is_what_its_writer_left(raw, tmp_path):
    (tmp_path / "t.mcap.partial").write_bytes(raw)
    assert not is_being_written(tmp_path / "t.mcap.partial")
    assert not is_being_written(tmp_path / "absent.partial")
    assert doubts_of(read_take(tmp_path / "t.mcap.partial")) == [
        "the file is whole and never got its name; `hangtime takes recover` makes a sound file of it"
    ]


def test_a_writer_waits_for_a_reader_that_looks_whether_one_writes(tmp_path):
    partial = tmp_path / "t.mcap.partial"
    partial.touch()
    with partial.open("rb") as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        leaving = threading.Timer(0.05, lambda: fcntl.flock(reader, fcntl.LOCK_UN))
        leaving.start()
        before = time.monotonic()
        UnfinishedFile(tmp_path / "t.mcap", overwrite=False).discard()
        assert time.monotonic() - before >= 0.04
        leaving.join()
