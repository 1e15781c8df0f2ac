"""The Unix socket by which `hangtime start|stop|status|watch|preview` speak with the daemon.

One line of JSON asks, `{"do": "status"}`; one line answers. `watch` answers with a line at every change until the asker
hangs up. The socket's group decides who may ask. The daemon's side never waits: the daemon calls it once per frame.
"""

from __future__ import annotations

import base64
import contextlib
import grp
import json
import os
import shutil
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from capture.errors import AnotherDaemonError, ControlError

LONGEST_QUESTION = 4096  # bytes
MOST_ASKERS = 16  # at once; one more, and the daemon hangs up on whoever has been silent for longest
MOST_CALLERS = 128  # that the kernel holds until the daemon's next round
MOST_WATCHERS = 64  # one more, and the daemon hangs up on the oldest
ANSWER_PATIENCE = 10.0  # s that an asker waits for a whole answer: a daemon that records answers within one frame
ANSWER_PIECE = 1 << 16  # bytes of an answer that are read at once
LONGEST_PATH = 107  # bytes of a socket's path, Linux, unix(7): 108 with the zero behind it
MODE = 0o660
UNIT = "hangtime-capture"
SEE_UNIT = f"see `systemctl status {UNIT}`"

Answer = Callable[[dict[str, Any]], dict[str, Any]]


class ControlServer:
    """The daemon's end of the socket."""

    def __init__(self, path: Path, group: str = "") -> None:
        """Listen at a path, in the place of a socket that a dead daemon left.

        Raises:
            ControlError: the path cannot be used, another daemon listens there, or there is no such group.
        """
        _check_length(path)
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _remove_left_over(path)
            before = os.umask(0o777 & ~MODE)
            try:
                self._socket.bind(str(path))
            finally:
                os.umask(before)
            if group:
                shutil.chown(path, group=grp.getgrnam(group).gr_gid)
            self._socket.listen(MOST_CALLERS)
        except ControlError:
            self._socket.close()
            raise
        except KeyError as error:
            self.close()
            raise ControlError(
                f"there is no group {group!r}", where=path, advice="give an existing one as control.group"
            ) from error
        except OSError as error:
            self._socket.close()
            reason = error.strerror or str(error)
            raise ControlError(
                f"the socket cannot be made ({reason})", where=path, advice="check its folder"
            ) from error
        self._askers: dict[socket.socket, bytes] = {}
        self._watchers: list[socket.socket] = []

    def serve(self, answer: Answer) -> None:
        """Answer whoever has asked by now; `answer` gets the question and returns the answer."""
        for _ in range(MOST_ASKERS):
            try:
                asker, _ = self._socket.accept()
            except OSError:
                break
            asker.setblocking(False)
            self._askers[asker] = b""
            if len(self._askers) > MOST_ASKERS:  # whoever connects and asks nothing keeps nobody out
                self._hear(next(iter(self._askers)), answer, is_last_word=True)
        for asker in list(self._askers):
            self._hear(asker, answer)

    def tell(self, news: dict[str, Any]) -> None:
        """Send news to every watcher, and drop those that have gone."""
        for watcher in list(self._watchers):
            if not _send(watcher, news):
                self._watchers.remove(watcher)
                watcher.close()

    @property
    def is_watched(self) -> bool:
        """Return whether anybody watches."""
        return bool(self._watchers)

    def close(self) -> None:
        """Stop listening and hang up."""
        for asker in [*getattr(self, "_askers", ()), *getattr(self, "_watchers", ())]:
            asker.close()
        self._socket.close()
        with contextlib.suppress(OSError):
            self._path.unlink()

    def _hear(self, asker: socket.socket, answer: Answer, *, is_last_word: bool = False) -> None:
        try:
            heard = asker.recv(LONGEST_QUESTION)
        except BlockingIOError:
            if not is_last_word:
                return
            heard = b""
        except OSError:
            heard = b""
        said = self._askers[asker] + heard
        if heard and not is_last_word and b"\n" not in said and len(said) < LONGEST_QUESTION:
            self._askers[asker] = said
            return
        del self._askers[asker]
        if b"\n" not in said:
            asker.close()
            return
        try:
            question = json.loads(said.partition(b"\n")[0])
            if not isinstance(question, dict):
                raise ValueError
        except (ValueError, RecursionError):
            question = {}
        if question.get("do") == "watch":
            if _send(asker, answer({"do": "status"})):
                self._watchers.append(asker)
                if len(self._watchers) > MOST_WATCHERS:
                    self._watchers.pop(0).close()
                return
        else:
            _send(asker, answer(question))
        asker.close()


def ask(path: Path, do: str) -> dict[str, Any]:
    """Ask the daemon and return its answer.

    Raises:
        ControlError: no daemon listens there, this user may not ask, or it does not answer.
    """
    return next(listen(path, do))


def listen(path: Path, do: str) -> Iterator[dict[str, Any]]:
    """Ask the daemon and yield its answers, one unless `do` is "watch".

    Raises:
        ControlError: as `ask`.
    """
    with _connected(path) as connection:
        with contextlib.suppress(ConnectionError):  # it hung up, which the next line tells
            connection.sendall(json.dumps({"do": do}).encode() + b"\n")
        count, heard = 0, bytearray()
        while True:
            try:
                line = _line(connection, heard, may_be_silent=do == "watch" and count > 0)
            except ConnectionError:
                line = b""
            except TimeoutError:
                raise ControlError(
                    f"the daemon has not answered for {ANSWER_PATIENCE:g} s", where=path,
                    advice=SEE_UNIT,
                ) from None  # fmt: skip
            if not line:
                if count == 0 or do == "watch":
                    raise ControlError("the daemon hung up", where=path, advice=SEE_UNIT)
                return
            count += 1
            yield _told(line, path)


def _line(connection: socket.socket, heard: bytearray, *, may_be_silent: bool) -> bytes:
    """Return the next line, or what came of one before the other end hung up, b"" of nothing.

    - `heard`: bytes received before; bytes behind the line stay there
    - `may_be_silent`: wait for the line's first byte for as long as it takes

    Raises:
        TimeoutError: the whole line took longer than `ANSWER_PATIENCE`.
    """
    until = None if may_be_silent and not heard else time.monotonic() + ANSWER_PATIENCE
    while (end := heard.find(b"\n") + 1) == 0:
        if until is not None and time.monotonic() >= until:
            raise TimeoutError
        connection.settimeout(None if until is None else max(until - time.monotonic(), 1e-3))
        if not (piece := connection.recv(ANSWER_PIECE)):
            end = len(heard)
            break
        heard += piece
        until = until or time.monotonic() + ANSWER_PATIENCE
    line = bytes(heard[:end])
    del heard[:end]
    return line


def _told(line: bytes, path: Path) -> dict[str, Any]:
    try:
        told: dict[str, Any] = json.loads(line)
    except ValueError:
        raise ControlError("the daemon ended in mid-answer", where=path, advice=SEE_UNIT) from None
    return told


def picture_in(answer: dict[str, Any]) -> bytes:
    """Return the picture of an answer to "preview"."""
    return base64.b64decode(answer["png"])


def _check_length(path: Path) -> None:
    """Refuse a path that is longer than a socket's can be.

    Raises:
        ControlError: it is.
    """
    if (length := len(os.fsencode(path))) > LONGEST_PATH:
        raise ControlError(
            f"the path of the socket has {length} bytes, Linux takes {LONGEST_PATH}", where=path,
            advice="choose a shorter folder, as control.socket and as --socket",
        )  # fmt: skip


def _connected(path: Path) -> socket.socket:
    _check_length(path)
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(ANSWER_PATIENCE)
    until = time.monotonic() + ANSWER_PATIENCE
    try:
        while True:
            try:
                connection.connect(str(path))
                break
            except BlockingIOError:  # as many as the kernel holds are waiting for the daemon
                if time.monotonic() > until:
                    raise
                time.sleep(0.02)
    except OSError as error:
        connection.close()
        if isinstance(error, PermissionError):
            what, advice = "this user may not speak to the daemon", "join the group of the socket and log in again"
        elif isinstance(error, BlockingIOError):
            what, advice = f"the daemon has let nobody in for {ANSWER_PATIENCE:g} s", SEE_UNIT
        else:
            what, advice = (
                "no daemon listens here",
                f"start it: `systemctl start {UNIT}`, or `hangtime daemon`",
            )
        raise ControlError(what, where=path, advice=advice) from error
    return connection


def _send(to: socket.socket, answer: dict[str, Any]) -> bool:
    """Send a line at once; return whether it went. The daemon waits for no reader."""
    try:
        to.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 21)  # a picture fits
        line = json.dumps(answer).encode() + b"\n"
        return to.send(line) == len(line)
    except OSError:
        return False


def _remove_left_over(path: Path) -> None:
    """Remove a socket that nobody listens at.

    Raises:
        ControlError: somebody does, or something else is in its place.
        OSError: this user may not try it or remove it.
    """
    if not path.is_socket():
        if os.path.lexists(path):
            raise ControlError(
                "the socket cannot be made: something else has this name", where=path,
                advice="remove it, or give another path as control.socket",
            )  # fmt: skip
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as trial:
        try:
            trial.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            path.unlink(missing_ok=True)
            return
        except BlockingIOError:
            pass  # somebody listens, and is too busy to answer
    raise AnotherDaemonError(
        "another daemon listens here", where=path, advice="stop it first: `systemctl stop hangtime-capture`"
    )
