"""Let one call compute at a time: the solver has one memory for the whole process, and breaks under two threads.

While a function of progress runs, its call is paused and another one may begin. A paused call goes on once every call
that began meanwhile has ended. So a progress may wait for a call of another thread. Calls are nested as in one thread,
so that settings such as the threads of linear algebra come back in their order.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class _Call:
    """A running call, and whether its progress runs."""

    def __init__(self) -> None:
        self.thread = threading.get_ident()
        self.is_paused = False


class _Calls:
    """The calls of a process: each began while the one before it was paused."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.running: list[_Call] = []

    def begin(self) -> _Call:
        with self.changed:
            own = _Call()
            self.changed.wait_for(
                lambda: not self.running or self.running[-1].is_paused or self.running[-1].thread == own.thread
            )
            self.running.append(own)
        return own

    def end(self, call: _Call) -> None:
        with self.changed:
            self.running.remove(call)
            self.changed.notify_all()

    def pause(self) -> _Call | None:
        with self.changed:
            own = next((call for call in reversed(self.running) if call.thread == threading.get_ident()), None)
            if own is not None:
                own.is_paused = True
                self.changed.notify_all()
        return own

    def go_on(self, call: _Call) -> None:
        with self.changed:
            self.changed.wait_for(lambda: self.running[-1] is call)
            call.is_paused = False


_calls = _Calls()


def _begin_anew() -> None:
    """Forget the calls in a new process: the other threads do not run there."""
    global _calls
    _calls = _Calls()


if hasattr(os, "register_at_fork"):  # Unix
    os.register_at_fork(after_in_child=_begin_anew)


@contextmanager
def own_turn() -> Iterator[None]:
    """Context of a call, which begins once no call of another thread computes."""
    calls = _calls
    own = calls.begin()
    try:
        yield
    finally:
        if calls is _calls:  # a forked process has no such call
            calls.end(own)


def paused(progress: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of progress during which a call of another thread may begin and end."""

    def told(*figures: Any) -> Any:
        calls = _calls
        own = calls.pause()
        try:
            return progress(*figures)
        finally:
            if own is not None and calls is _calls:
                calls.go_on(own)

    return told
