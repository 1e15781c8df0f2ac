"""The words of `hangtime status`."""

from __future__ import annotations

import base64
import contextlib
import threading
from datetime import UTC, datetime
from functools import partial

import pytest

from capture.appliance.cli import _in_one_line
from capture.appliance.control import ControlServer
from capture.appliance.status import lines
from capture.appliance.sync_status import Fault, SyncStatus, sentences
from tests.fit.here import hangtime_here


def told(**changes):
    return {
        "says": "armed", "recording": None, "faults": [], "last_take": None, "frames": 2400, "dropped": 1, "gaps": 1,
        "bytes_kept": 0, "free_bytes": 0, "takes": 1, "waiting": 0, "salvaged": 0, "sync": {"says": []},
        "clock": {"utc": "2026-01-01", "source": "NTP", "uncertainty_s": None}, **changes,
    }  # fmt: skip


def test_one_gap_is_one_gap():
    assert any(line.startswith("since the start: 2400 frames, 1 lost in 1 gap; ") for line in lines(told()))
    assert any(", 3 lost in 2 gaps; " in line for line in lines(told(dropped=3, gaps=2)))


def test_a_last_take_that_was_removed_since_is_said_to_be_removed(tmp_path):
    take = tmp_path / "take-000004.mcap"
    take.touch()
    kept = told(last_take={"kept": str(take), "findings": []})
    assert f"last take: {take}" in lines(kept)
    take.unlink()
    assert any(line.startswith("last take: take-000004, removed from this device since") for line in lines(kept))
    assert "last take: not kept" in lines(told(last_take={"kept": None, "findings": []}))


@pytest.mark.parametrize(
    ("sentence", "line"),
    [
        ("was 0.1 meant?", "was 0.1 meant? Mend that setting"),
        ("the disk is full.", "the disk is full. Mend that setting"),
        ("the disk is full", "the disk is full; mend that setting"),
        ("no such file: a...", "no such file: a...; mend that setting"),
    ],
)
def test_a_fault_and_its_next_step_are_joined_whatever_ends_the_fault(sentence, line):
    fault = {"sentence": sentence, "advice": "mend that setting", "words": sentence}
    last = {"kept": None, "findings": [fault]}
    assert lines(told(faults=[fault], last_take=last)).count(f"! {line}") == 2
    answer = {"state": "fault", "condition": "no frame yet", "lamp": "fault", "faults": [fault]}
    assert _in_one_line(answer) == f"fault: no frame yet; lamp: fault ! {line}"


def test_a_fault_of_sync_that_asks_ends_with_its_question():
    fault = Fault(sentence="is the server on?", advice="look at it", since="", tries=1)
    status = SyncStatus(at="", url="", device="", waiting=0, waiting_bytes=0, safe=0, is_encrypted=False, fault=fault)
    said = sentences(status, datetime(2026, 1, 1, tzinfo=UTC))
    assert said[0] == "Sync fails: is the server on? Next: look at it."


@contextlib.contextmanager
def served(folder, status, preview):
    """The recorder's own socket `s` answers; the recorder's state and picture are given."""
    answers = {"status": status, "preview": preview}
    server, is_over = ControlServer(folder / "s"), threading.Event()

    def serve():
        while not is_over.wait(0.01):
            server.serve(lambda question: answers[question["do"]])

    server_thread = threading.Thread(target=serve)
    server_thread.start()
    try:
        yield partial(hangtime_here, "status", "--socket", str(folder / "s"), folder=folder)
    finally:
        is_over.set()
        server_thread.join()
        server.close()


NO_FRAME = {"line": "no frame yet", "png": ""}


def test_the_command_joins_a_question_and_its_step_in_its_error_too(tmp_path):
    fault = {"sentence": "was 0.1 meant?", "advice": "mend that setting"}
    with served(tmp_path, told(state="fault", faults=[fault]), NO_FRAME) as status:
        done, told_programs = status(), status("--json")
    assert "! was 0.1 meant? Mend that setting\n" in done.stdout
    assert told_programs.stderr == "hangtime: was 0.1 meant? Mend that setting\n"


def test_a_picture_that_is_there_stays_without_overwrite(tmp_path):
    (tmp_path / "x.png").write_bytes(b"mine")
    with served(tmp_path, told(state="armed"), {"line": "seen", "png": base64.b64encode(b"new").decode()}) as status:
        kept = status("--preview", "x.png")
        assert (kept.returncode, kept.stdout, kept.stderr) == (
            2, "", "hangtime: x.png: is already there; give another name, or --overwrite to replace it\n",
        )  # fmt: skip
        assert (tmp_path / "x.png").read_bytes() == b"mine"
        assert status("--preview", "x.png", "--overwrite").returncode == 0
    assert (tmp_path / "x.png").read_bytes() == b"new"


def test_before_the_first_frame_no_picture_is_written_and_the_command_says_so(tmp_path):
    """The file was replaced by an empty one."""
    (tmp_path / "x.png").write_bytes(b"mine")
    none = "hangtime: x.png: is not written, because the sensor sent no picture yet; repeat the command once "
    none += "`hangtime status` says what it sees\n"
    with served(tmp_path, told(state="armed"), NO_FRAME) as status:
        done = status("--preview", "x.png", "--overwrite")
    assert (done.returncode, done.stderr) == (2, none)
    assert "sees: no frame yet" in done.stdout
    fault = {"sentence": "no depth sensor is connected", "advice": "plug it in"}
    with served(tmp_path, told(state="fault", faults=[fault]), NO_FRAME) as status:
        done = status("--preview", "x.png", "--overwrite")
    assert (done.returncode, done.stderr) == (1, none)
    assert "! no depth sensor is connected; plug it in\n" in done.stdout
    assert (tmp_path / "x.png").read_bytes() == b"mine"
