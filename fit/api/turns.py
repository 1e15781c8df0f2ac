"""Let one call compute at a time: the solver has one memory for the whole process, and breaks under two threads.

While a function of progress runs for long, its call is paused and another one may begin. So a progress may wait for a
call of another thread. A paused call goes on once every call that began meanwhile has ended, and before any other one
begins. Calls are nested as in one thread, so that settings such as the threads of linear algebra come back in their
order.

A pause can end in a deadlock, which nothing here prevents. The paused thread holds a lock of its own during its call.
The progress of the call that began meanwhile takes that lock. Then each waits for the other.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# s that a progress may take before another call begins. Our choice: a progress that only shows figures is done by then.
# Half and double change only how late a call begins for which a progress waits.
LONGEST_SHOWING = 0.1


class _Call:
    """A call, and since when [s] its progress runs; None while it does not."""

    def __init__(self) -> None:
        self.thread = threading.get_ident()
        self.paused_at: float | None = None


class _Calls:
    """The calls of a process: each began while the one before it was paused."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.running: list[_Call] = []

    def begin(self, own: _Call) -> None:
        with self.changed:
            while (wait := self._wait_of(own)) > 0:
                self.changed.wait(wait if wait < math.inf else None)
            self.running.append(own)

    def end(self, call: _Call) -> None:
        with self.changed:
            if call in self.running:  # Ctrl-C may end a call before it begins
                self.running.remove(call)
                self.changed.notify_all()

    def pause(self) -> _Call | None:
        with self.changed:
            own = next((call for call in reversed(self.running) if call.thread == threading.get_ident()), None)
            if own is not None:
                own.paused_at = time.monotonic()
                self.changed.notify_all()
        return own

    def go_on(self, call: _Call) -> None:
        with self.changed:
            call.paused_at = None
            self.changed.wait_for(lambda: self.running[-1] is call)

    def _wait_of(self, own: _Call) -> float:
        """Return how long [s] a call must wait at least, infinity until another call changes; 0 if it may begin."""
        if not self.running or self.running[-1].thread == own.thread:
            return 0.0
        paused_at = self.running[-1].paused_at
        return math.inf if paused_at is None else max(0.0, paused_at + LONGEST_SHOWING - time.monotonic())


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
    calls, own = _calls, _Call()
    try:
        calls.begin(own)
        yield
    finally:
        if calls is _calls:  # a forked process has no such call
            calls.end(own)


def paused(progress: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of progress that pauses its call where it takes long."""

    def told(*figures: Any) -> Any:
        calls = _calls
        own = calls.pause()
        try:
            return progress(*figures)
        finally:
            if own is not None and calls is _calls:
                calls.go_on(own)

    return told
