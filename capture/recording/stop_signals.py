"""Handle Ctrl-C, SIGTERM and SIGHUP alike: each asks the recording to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """A request to end, which raises KeyboardInterrupt at once, except inside `held`."""

    def __init__(self) -> None:
        self.is_asked = False
        self._is_held = False

    def ask(self) -> None:
        """Ask to end; asking again does nothing."""
        was_asked, self.is_asked = self.is_asked, True
        if not (was_asked or self._is_held):
            raise KeyboardInterrupt

    @contextmanager
    def held(self) -> Iterator[None]:
        """Inside this context nothing is interrupted: a request takes effect at the next `released`."""
        self._is_held = True
        try:
            yield
        finally:
            self._is_held = False

    @contextmanager
    def released(self) -> Iterator[None]:
        """A context inside `held` in which an interrupt does no harm.

        Raises:
            KeyboardInterrupt: an end is or was requested.
        """
        self._is_held = False
        try:
            if self.is_asked:
                raise KeyboardInterrupt
            yield
        finally:
            self._is_held = True


@contextmanager
def stopped_like_ctrl_c() -> Iterator[StopRequest]:
    """Turn SIGINT, SIGTERM and SIGHUP into a request to end; signals after the first do nothing.

    A user presses Ctrl-C twice, and the end of a login sends two signals. A signal that is already ignored, as SIGHUP
    under `nohup`, stays ignored. Only the main thread receives signals; in other threads the context does nothing.
    """
    request = StopRequest()

    def stop(number: int, frame: FrameType | None) -> None:
        request.ask()

    before = {one: signal.getsignal(one) for one in STOPPING}
    before = {one: handler for one, handler in before.items() if handler not in (signal.SIG_IGN, None)}
    if threading.current_thread() is not threading.main_thread():
        before = {}
    for one in before:
        signal.signal(one, stop)
    try:
        yield request
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
