"""Messages of a command."""

from __future__ import annotations

import io
import os
import subprocess
import sys

import pytest

from formats import terminal
from formats.terminal import CLEAR_LINE, ProgressLine, hush, in_words, say, take_streams


def test_a_message_and_the_end_of_its_line_are_written_in_one_piece():
    """Packets keep writes apart, and an unbuffered stream passes each write on."""
    from socket import AF_UNIX, SOCK_SEQPACKET, socketpair

    ours, theirs = socketpair(AF_UNIX, SOCK_SEQPACKET)
    with ours, theirs:
        said = "from formats.terminal import say; say('camera 40 %')"
        words = [sys.executable, "-u", "-c", said]
        subprocess.run(words, stderr=theirs, check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
        assert ours.recv(100) == b"camera 40 %\n"


class Clock:
    """A clock that is set by hand [s]."""

    now = 100.0

    def __call__(self):
        return self.now


def test_codes_go_before_and_behind_a_text_and_none_of_its_own_reaches_the_terminal(capsys):
    say(f"a{CLEAR_LINE}b", begin=CLEAR_LINE, end="\r")
    assert capsys.readouterr().err == f"{CLEAR_LINE}a\\r\\x1b[Kb\r"


def test_progress_shows_the_time_that_is_left_from_the_speed_of_this_process(capsys):
    """It goes on at 40 %; 10 s for 20 % more leave 20 s for the last 40 %."""
    clock = Clock()
    line = ProgressLine("annealing", clock)
    line.show(0.4, "140/350")
    clock.now += 10.0
    line.show(0.6, "210/350")
    said = capsys.readouterr().err.splitlines()
    assert said == ["annealing: 40 %, 140/350", "annealing: 60 %, 210/350, about 20 s left"]


def test_slow_work_has_a_line_a_minute_where_no_terminal_is(capsys):
    clock = Clock()
    line = ProgressLine("fit", clock)
    for share in (0.0, 0.01, 0.02, 0.03):
        line.show(share, "step")
        clock.now += 30.0
    said = capsys.readouterr().err.splitlines()
    assert said == ["fit: 0 %, step", "fit: 2 %, step, about 49 min left"]


def test_progress_shows_no_time_before_it_can_know_it(capsys):
    clock = Clock()
    line = ProgressLine("fit", clock)
    for after, share in ((0.0, 0.0), (1.0, 0.5), (4.0, 1.0)):
        clock.now = 100.0 + after
        line.show(share, "step")
    assert "left" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "1 s"), (89.0, "89 s"), (130.0, "2 min"), (5400.0, "1 h 30 min"), (7500.0, "2 h 5 min")],
)
def test_times_in_words(seconds, words):
    assert in_words(seconds) == words


def test_a_hushed_process_says_its_errors_alone(capsys):
    hush()
    try:
        say("progress")
        say("hangtime: gone", is_error=True)
    finally:
        hush(is_quiet=False)
    say("again")
    assert capsys.readouterr().err == "hangtime: gone\nagain\n"


SWALLOWED = """
import os, signal
from formats import interrupts, terminal

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
interrupts.remember_interruptions()
line = terminal.ProgressLine("fit")
line.show(0.1, "before")
try:
    os.kill(os.getpid(), signal.SIGINT)
    while True:
        pass
except BaseException:  # as a library does that calls Python and forgets its errors
    print("swallowed", flush=True)
try:
    line.show(0.5, "after")
    print("went on")
except KeyboardInterrupt:
    print("ended")
"""


def test_progress_ends_work_whose_interruption_a_library_swallowed():
    made = subprocess.run([sys.executable, "-c", SWALLOWED], capture_output=True, text=True, check=True)
    assert made.stdout.split() == ["swallowed", "ended"]


def test_names_are_printed_byte_for_byte_and_signs_that_the_terminal_lacks_by_their_code(monkeypatch):
    printed, said = io.BytesIO(), io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(printed, encoding="ascii"))
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(said, encoding="ascii"))
    take_streams()
    print("m\u00b2", os.fsdecode(b"\xffname"), flush=True)
    say("m\u00b2 " + os.fsdecode(b"\xffname"))
    assert printed.getvalue() == said.getvalue() == b"m\\xb2 \xffname\n"


def test_progress_on_a_terminal_is_one_line_that_is_written_over(capsys, monkeypatch):
    """Of 100 columns a bar takes 24, below 10; where 20 are not left for whole clauses or words, there is no bar."""
    monkeypatch.setattr(terminal, "is_watched", lambda: True)
    columns = {"are": 120}
    monkeypatch.setattr(terminal, "_columns", lambda: columns["are"])
    clock = Clock()
    line = ProgressLine("annealing", clock)
    line.show(0.25, "88/350")
    columns["are"] = 80
    clock.now += 10.0
    line.show(0.5, "a word that is far longer than its place")
    line.show(0.5, "31.7 mm on fitted takes, step 27 of at most 130")
    columns["are"] = 30
    line.show(1.0, "done, and this is longer than twenty letters")
    line.show(1.0, "a-name-that-is-longer-than-twenty-letters")
    line.end()
    assert capsys.readouterr().err == (
        f"\rannealing [######..................]  25 %  {'88/350':<55}"
        f"\rannealing [#####.....]  50 %  {'a word that is far longer than, about 20 s left':<49}"
        f"\rannealing [#####.....]  50 %  {'31.7 mm on fitted takes, about 20 s left':<49}"
        f"\rannealing 100 %  {'done':<12}"
        f"\rannealing 100 %  a-name-that-\n"
    )
    columns["are"] = 500
    ProgressLine("fit", clock).show(0.0, "x")
    assert len(capsys.readouterr().err) == len("\rfit [] ") + 24 + len("  0 %  ") + 100 - 3 - 24 - 12


@pytest.mark.parametrize("columns", [1, 5, 20, 40, 50, 51, 60, 79, 80, 99, 100])
def test_progress_never_fills_the_last_column_where_a_terminal_begins_a_new_line(capsys, monkeypatch, columns):
    monkeypatch.setattr(terminal, "is_watched", lambda: True)
    monkeypatch.setattr(terminal, "_columns", lambda: columns)
    clock = Clock()
    line = ProgressLine("least-squares", clock)
    for share in (0.0, 0.5, 1.0):
        line.show(share, "31.7 mm on fitted takes, step 27 of at most 130")
        clock.now += 10.0
    shown = capsys.readouterr().err.split("\r")[1:]
    assert {len(one) for one in shown} == {columns - 1}


class OnlyWrites:
    """What a notebook, a logger or an editor may put in the place of stderr."""

    def __init__(self):
        self.text = ""

    def write(self, text):
        self.text += text


def test_a_stderr_that_only_writes_or_is_closed_ends_no_work(monkeypatch):
    plain = OnlyWrites()
    monkeypatch.setattr(sys, "stderr", plain)
    ProgressLine("fit").show(0.5, "half")
    assert plain.text == "fit: 50 %, half\n"
    assert sys.stderr is plain
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    assert not terminal.is_displayed()
    ProgressLine("fit").show(0.5, "half")
    sys.stderr.close()  # what `say` has put in its place


def test_a_terminal_that_states_no_size_counts_as_one_of_80_columns(monkeypatch):
    monkeypatch.setattr(os, "get_terminal_size", lambda stream: os.terminal_size((0, 0)))
    assert terminal._columns() == 80


def test_progress_elsewhere_is_a_whole_line_for_every_tenth(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "is_watched", lambda: False)
    line = ProgressLine("fit", Clock())
    for share in (0.0, 0.05, 0.11, 0.2, 0.22, 1.0):
        line.show(share, "step")
    line.end()
    assert capsys.readouterr().err.splitlines() == [f"fit: {share} %, step" for share in (0, 11, 22, 100)]


def test_the_width_of_no_terminal_is_eighty_columns(monkeypatch):
    def gone(handle):
        raise OSError

    monkeypatch.setattr(os, "get_terminal_size", gone)
    assert terminal._columns() == 80
    monkeypatch.setattr(os, "get_terminal_size", lambda handle: os.terminal_size((61 + handle, 20)))
    assert terminal._columns() == 63  # of stderr


@pytest.mark.parametrize(
    ("after", "share", "words"),
    [(2.9, 0.5, ""), (3.0, 0.5, "about 3 s left"), (9.0, 0.019, ""), (9.0, 0.02, "about 7 min left"), (9.0, 1.0, ""),
     (59.0, 0.01, ""), (60.0, 0.01, "about 1 h 39 min left"), (60.0, 0.0, "")],
)  # fmt: skip
def test_the_time_that_is_left_is_reported_after_three_seconds_and_a_fiftieth_of_the_work(after, share, words):
    clock = Clock()
    line = ProgressLine("fit", clock)
    assert line._left(0.0) == ""
    clock.now += after
    assert line._left(share) == words
    assert line._left(0.0) == ""  # another work begins
