"""Messages of a command: its work goes on also where nobody reads them any more."""

from __future__ import annotations

import io
import os
import sys


def say(text: str, end: str = "\n") -> None:
    """Print to stderr; where nobody reads it any more, this and all that follows goes nowhere."""
    if sys.stderr is None:  # closed before us
        return
    try:
        sys.stderr.write(text + end)  # in one piece, or lines of processes side by side run into each other
        sys.stderr.flush()
    except (OSError, ValueError):  # full, a pipe that was closed, or closed by this process
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - open as long as the process


def is_watched() -> bool:
    """Return whether what is said appears on a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


def take_streams() -> None:
    """Lead streams that were closed before us nowhere, lest a file become one; print names of files byte for byte."""
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")


class ProgressLine:
    """One line on a terminal that shows how far a long job is; a few whole lines where output is not a terminal."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._is_terminal = is_watched()
        self._last = -1.0

    def show(self, share: float, text: str) -> None:
        """Show the share done, 0 to 1, and a few words."""
        if self._is_terminal:
            filled = round(24 * share)
            bar = "#" * filled + "." * (24 - filled)
            say(f"\r{self._title} [{bar}] {100 * share:3.0f} %  {text[:60]:<60}", end="")
        elif share >= self._last + 0.1:
            say(f"{self._title}: {100 * share:.0f} %, {text}")
            self._last = share

    def end(self) -> None:
        """Leave the line."""
        if self._is_terminal:
            say("")
