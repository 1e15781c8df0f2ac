"""The Unix socket through which `hangtime start|stop|status|watch|preview` send requests to the recorder.

A request is one line of JSON, `{"do": "status"}`, and so is the answer. `watch` sends a line at every change until the
client disconnects. Members of the socket's group may connect. The server never blocks. The recorder polls it each
frame.
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

LONGEST_QUESTION = 4096  # bytes; our choice: a hundred times `{"do": "preview"}`, and 16 askers take 64 kB
MOST_ASKERS = 16  # clients at once; one more, and the recorder disconnects the client that has been silent for longest
MOST_CALLERS = 128  # connections that the kernel queues until the next poll; our choice: beyond askers and watchers
MOST_WATCHERS = 64  # watchers at once; one more, and the recorder disconnects the oldest
ANSWER_PATIENCE = 10.0  # s that a client waits for a whole answer: a busy one answers within one frame
# bytes of an answer that are read at once. Our choice: bounds a read, and a longer answer takes further reads.
ANSWER_PIECE = 1 << 16
LONGEST_PATH = 107  # bytes of a socket's path, Linux, unix(7): 108 with the zero behind it
MODE = 0o660  # of the socket: its user and its group may speak to the recorder, nobody else
UNIT = "hangtime-capture"
SEE_UNIT = f"see `systemctl status {UNIT}`"

Answer = Callable[[dict[str, Any]], dict[str, Any]]


class ControlServer:
    """The server side of the control socket."""

    def __init__(self, path: Path, group: str = "") -> None:
        """Listen at a path; replace a stale socket that a dead recorder left there.

        Raises:
            ControlError: the path cannot be used, another recorder listens there, or there is no such group.
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
        """Answer the requests that have arrived; `answer` maps a request to its answer."""
        for _ in range(MOST_ASKERS):
            try:
                asker, _ = self._socket.accept()
            except OSError:
                break
            asker.setblocking(False)
            self._askers[asker] = b""
            if len(self._askers) > MOST_ASKERS:  # an idle client must not lock others out
                self._hear(next(iter(self._askers)), answer, is_last_word=True)
        for asker in list(self._askers):
            self._hear(asker, answer)

    def tell(self, news: dict[str, Any]) -> None:
        """Send a status to every watcher, and drop the disconnected ones."""
        for watcher in list(self._watchers):
            if not _send(watcher, news):
                self._watchers.remove(watcher)
                watcher.close()

    @property
    def is_watched(self) -> bool:
        """Return whether any watcher is connected."""
        return bool(self._watchers)

    def close(self) -> None:
        """Stop listening and disconnect all clients."""
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
    """Send a request to the recorder and return its answer.

    Raises:
        ControlError: no recorder listens there, this user may not connect, or the recorder does not answer.
    """
    return next(listen(path, do))


def listen(path: Path, do: str) -> Iterator[dict[str, Any]]:
    """Send a request and yield the recorder's answers; only "watch" has more than one.

    Raises:
        ControlError: as `ask`.
    """
    with _connected(path) as connection:
        with contextlib.suppress(ConnectionError):  # disconnected: the next read reports it
            connection.sendall(json.dumps({"do": do}).encode() + b"\n")
        count, heard = 0, bytearray()
        while True:
            try:
                line = _line(connection, heard, may_be_silent=do == "watch" and count > 0)
            except ConnectionError:
                line = b""
            except TimeoutError:
                raise ControlError(
                    f"the recorder has not answered for {ANSWER_PATIENCE:g} s", where=path,
                    advice=SEE_UNIT,
                ) from None  # fmt: skip
            if not line:
                if count == 0 or do == "watch":
                    raise ControlError("the recorder hung up", where=path, advice=SEE_UNIT)
                return
            count += 1
            yield _decoded(line, path)


def _line(connection: socket.socket, heard: bytearray, *, may_be_silent: bool) -> bytes:
    """Return the next line; after a disconnection, the part of a line that arrived, b"" if none.

    - `heard`: buffer of received bytes; the bytes after the line stay in it
    - `may_be_silent`: wait for the line's first byte without a time limit

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


def _decoded(line: bytes, path: Path) -> dict[str, Any]:
    try:
        answer: dict[str, Any] = json.loads(line)
    except ValueError:
        raise ControlError("the recorder ended in mid-answer", where=path, advice=SEE_UNIT) from None
    return answer


def picture_in(answer: dict[str, Any]) -> bytes:
    """Return the image in an answer to "preview"."""
    return base64.b64decode(answer["png"])


def _check_length(path: Path) -> None:
    """Check that a path is no longer than a socket's may be.

    Raises:
        ControlError: the path is too long.
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
            except BlockingIOError:  # the kernel's queue of connections is full
                if time.monotonic() > until:
                    raise
                time.sleep(0.02)
    except OSError as error:
        connection.close()
        if isinstance(error, PermissionError):
            what, advice = "this user may not speak to the recorder", "join the group of the socket and log in again"
        elif isinstance(error, BlockingIOError):
            what, advice = f"the recorder has accepted no connection for {ANSWER_PATIENCE:g} s", SEE_UNIT
        else:
            what, advice = (
                "no recorder listens here",
                f"start it: `systemctl start {UNIT}`, or `hangtime daemon`; docs/how-to/appliance.md installs it",
            )
        raise ControlError(what, where=path, advice=advice) from error
    return connection


def _send(to: socket.socket, answer: dict[str, Any]) -> bool:
    """Send a line without blocking; return whether all of it was sent."""
    try:
        to.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 21)  # an image fits
        line = json.dumps(answer).encode() + b"\n"
        return to.send(line) == len(line)
    except OSError:
        return False


def _remove_left_over(path: Path) -> None:
    """Remove a stale socket, at which no process listens.

    Raises:
        ControlError: a process listens, or the path is not a socket.
        OSError: this user may not connect to it or remove it.
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
            pass  # a process listens, and is too busy to answer
    raise AnotherDaemonError(
        "another recorder listens here", where=path, advice="stop it first: `systemctl stop hangtime-capture`"
    )
