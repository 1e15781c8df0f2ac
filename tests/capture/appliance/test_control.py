"""The control socket: stale sockets and other files in its place, silent clients, and malformed requests."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import threading
import time

import pytest

from capture.appliance.control import (
    LONGEST_QUESTION,
    MOST_ASKERS,
    MOST_CALLERS,
    MOST_WATCHERS,
    ControlServer,
    ask,
    listen,
)
from capture.errors import ControlError
from tests.conftest import STILL


@pytest.fixture
def path(tmp_path):
    return tmp_path / "control.sock"


@pytest.fixture
def server(path):
    one = ControlServer(path)
    yield one
    one.close()


def connected(path):
    one = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    one.settimeout(STILL)
    one.connect(str(path))
    return one


def serve(server):
    server.serve(lambda question: {"ok": True, "asked": question.get("do")})


@pytest.mark.parametrize("question", [b"[" * (LONGEST_QUESTION - 1), b"\xff\xfe", b"5", b'{"do": ["x"]}', b"1" * 4095])
def test_a_malformed_request_is_answered_and_ends_nothing(server, path, question):
    """Of these, 4095 brackets once were deeper than Python reads, and ended the daemon."""
    with connected(path) as asker:
        asker.sendall(question + b"\n")
        serve(server)
        assert json.loads(asker.recv(4096))["ok"]


def test_forty_idle_connections_keep_no_other_program_out(server, path):
    silent = []
    for _ in range(40):
        silent.append(connected(path))
        serve(server)
    assert len(server._askers) == MOST_ASKERS
    with connected(path) as asker:
        asker.sendall(b'{"do": "status"}\n')
        serve(server)
        assert json.loads(asker.recv(4096)) == {"ok": True, "asked": "status"}
    for one in silent:
        one.close()


def test_a_file_where_the_socket_should_be_is_named_as_such_and_stays(path):
    path.write_text("mine")
    with pytest.raises(ControlError, match="something else has this name"):
        ControlServer(path)
    assert path.read_text() == "mine"


def test_a_socket_that_a_dead_daemon_left_is_replaced(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    ControlServer(path).close()
    assert not path.exists()


def test_a_daemon_too_busy_to_answer_does_not_count_as_dead(path):
    """Its queue is full; a further connection would wait for ever."""
    waiting = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as busy:
        busy.bind(str(path))
        busy.listen(0)
        while not waiting or not waiting[-1].connect_ex(str(path)):
            waiting.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK))
            assert len(waiting) < 5
        with pytest.raises(ControlError, match="another recorder listens here"):
            ControlServer(path)
        assert path.is_socket()
    for one in waiting:
        one.close()


def test_an_answer_that_breaks_off_is_named(path):
    """The daemon is killed while it answers: half a line comes."""

    def answer():
        with listener.accept()[0] as asker:
            asker.recv(100)
            asker.sendall(b'{"state": "rea')

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen(1)
        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(ControlError, match="ended in mid-answer"):
            ask(path, "status")
        thread.join()


@pytest.mark.parametrize(("do", "lines"), [("status", 0), ("watch", 1)])
def test_an_answer_that_arrives_slowly_times_out_like_a_silent_one(path, monkeypatch, do, lines):
    """A byte every 50 ms, and never a whole line: 0.4 s, where each byte would begin the time anew.

    Who waits for every byte meets the end of the answer instead, after a hundred of them. Between the lines of
    "watch" there may be any silence.
    """
    monkeypatch.setattr("capture.appliance.control.ANSWER_PATIENCE", 0.4)
    is_over = threading.Event()

    def answer():
        with listener.accept()[0] as asker, contextlib.suppress(OSError):
            asker.recv(100)
            asker.sendall(b'{"news": 1}\n' * lines)
            is_over.wait(0.6 * lines)
            for _ in range(100):
                if is_over.wait(0.05):
                    break
                asker.sendall(b" ")

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen(1)
        thread = threading.Thread(target=answer)
        thread.start()
        answers = listen(path, do)
        assert [next(answers) for _ in range(lines)] == [{"news": 1}] * lines
        with pytest.raises(ControlError, match=r"the recorder has not answered for 0\.4 s"):
            next(answers)
        is_over.set()
        thread.join()


def test_lines_that_come_together_are_answers_of_their_own(path):
    def answer():
        with listener.accept()[0] as asker:
            asker.recv(100)
            asker.sendall(b'{"a": 1}\n{"a": 2}\n{"a"')
            asker.sendall(b": 3}\n")

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen(1)
        thread = threading.Thread(target=answer)
        thread.start()
        assert [one["a"] for one in listen(path, "several")] == [1, 2, 3]
        thread.join()


def test_a_path_that_is_too_long_for_a_socket_is_reported_with_its_length(tmp_path):
    """107 bytes are taken: `bind` and `connect` say no more than that it is too long."""
    fits = tmp_path / ("\u00fc" * ((106 - len(os.fsencode(tmp_path))) // 2))
    ControlServer(fits).close()
    long = tmp_path / ("a" * (107 - len(os.fsencode(tmp_path))))
    for use in (ControlServer, lambda path: ask(path, "status")):
        with pytest.raises(ControlError, match=r"the path of the socket has 108 bytes, Linux takes 107; choose a"):
            use(long)


def test_whoever_finds_the_line_full_waits_and_gets_no_error_that_no_daemon_is_there(server, path, monkeypatch):
    """The kernel refuses a caller at once when as many wait as the daemon lets wait; once it did so after 16."""
    monkeypatch.setattr("capture.appliance.control.ANSWER_PATIENCE", 0.3)
    waiting = [socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) for _ in range(300)]
    refused = [one.connect_ex(str(path)) == errno.EAGAIN for one in waiting]
    assert refused.index(True) > MOST_CALLERS
    with pytest.raises(ControlError, match=r"the recorder has accepted no connection for 0\.3 s"):
        ask(path, "status")
    monkeypatch.setattr("capture.appliance.control.ANSWER_PATIENCE", STILL)
    told = []
    asker = threading.Thread(target=lambda: told.append(ask(path, "status")))
    asker.start()
    until = time.monotonic() + STILL
    while asker.is_alive() and time.monotonic() < until:
        serve(server)
    asker.join()
    assert told == [{"ok": True, "asked": "status"}]
    for one in waiting:
        one.close()


def test_a_hundred_programs_that_watch_hold_64_connections_and_the_last_one_is_reported(server, path):
    watchers = []
    for _ in range(100):
        watchers.append(connected(path))
        watchers[-1].sendall(b'{"do": "watch"}\n')
        serve(server)
    assert len(server._watchers) == MOST_WATCHERS
    server.tell({"news": 1})
    with watchers[-1].makefile("rb") as said:
        assert [json.loads(said.readline()) for _ in range(2)] == [{"ok": True, "asked": "status"}, {"news": 1}]
    for one in watchers:
        one.close()


def test_a_group_that_is_not_there_is_named_and_leaves_no_socket(path):
    with pytest.raises(
        ControlError, match=r"there is no group 'nobodys-group'; give an existing one as control\.group"
    ):
        ControlServer(path, "nobodys-group")
    assert not path.exists()


def test_who_watches_waits_in_silence_for_the_next_change_as_long_as_it_takes(server, path, monkeypatch):
    """0.2 s of patience for an answer; the next change comes 0.6 s after the first one, and the one after at once."""
    monkeypatch.setattr("capture.appliance.control.ANSWER_PATIENCE", 0.2)
    over = threading.Event()

    def run():
        begun = None
        while not over.wait(0.01):
            server.serve(lambda question: {"state": "ready"})
            begun = begun or (time.monotonic() if server.is_watched else None)
            if begun is not None and time.monotonic() - begun > 0.6:
                server.tell({"state": "armed"})
                server.tell({"state": "recording"})
                return

    thread = threading.Thread(target=run)
    thread.start()
    heard = listen(path, "watch")
    try:
        assert [next(heard)["state"] for _ in range(3)] == ["ready", "armed", "recording"]
    finally:
        over.set()
        thread.join()
        heard.close()
