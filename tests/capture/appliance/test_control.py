"""The control socket: what is in its place, who is silent, and questions that are none."""

from __future__ import annotations

import json
import socket
import threading

import pytest

from capture.appliance.control import LONGEST_QUESTION, MOST_ASKERS, ControlServer, ask
from capture.errors import ControlError


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
    one.settimeout(10)
    one.connect(str(path))
    return one


def serve(server):
    server.serve(lambda question: {"ok": True, "asked": question.get("do")})


@pytest.mark.parametrize("question", [b"[" * (LONGEST_QUESTION - 1), b"\xff\xfe", b"5", b'{"do": ["x"]}', b"1" * 4095])
def test_a_question_that_is_none_is_answered_and_ends_nothing(server, path, question):
    """Of these, 4095 brackets once were deeper than Python reads, and ended the daemon."""
    with connected(path) as asker:
        asker.sendall(question + b"\n")
        serve(server)
        assert json.loads(asker.recv(4096))["ok"]


def test_forty_programs_that_connect_and_ask_nothing_keep_nobody_out(server, path):
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


def test_a_file_in_the_sockets_place_is_named_as_such_and_stays(path):
    path.write_text("mine")
    with pytest.raises(ControlError, match="something else has this name"):
        ControlServer(path)
    assert path.read_text() == "mine"


def test_a_socket_that_a_dead_daemon_left_is_replaced(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(path))
    ControlServer(path).close()
    assert not path.exists()


def test_a_daemon_too_busy_to_answer_is_not_taken_for_a_dead_one(path):
    """Its queue is full; a further connection would wait for ever."""
    waiting = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as busy:
        busy.bind(str(path))
        busy.listen(0)
        while not waiting or not waiting[-1].connect_ex(str(path)):
            waiting.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK))
            assert len(waiting) < 5
        with pytest.raises(ControlError, match="another daemon listens here"):
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
