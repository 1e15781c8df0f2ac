"""Handle Ctrl-C, SIGTERM and SIGHUP alike: each asks the recording to end."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from formats.interrupts import ENDING, handled

STOPPING = (signal.SIGINT, *ENDING)


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

    A user presses Ctrl-C twice, and the end of a login sends two signals. `formats.interrupts.handled` tells which
    signals it leaves alone.
    """
    request = StopRequest()

    def stop(number: int, frame: FrameType | None) -> None:
        request.ask()

    with handled(STOPPING, stop):
        yield request
