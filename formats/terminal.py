"""Print a command's messages and progress; the work continues even if nobody reads them any more."""

from __future__ import annotations

import codecs
import io
import os
import sys
import time as clock
from collections.abc import Callable

from formats.interrupts import raise_swallowed
from formats.plain_text import lines_of

CLEAR_LINE = "\r\x1b[K"  # ECMA-48: carriage return, erase to the end of the line
BAR_WIDTH = 24  # characters of a progress bar; our choice: with words it fits 80 columns; a wider bar would be wrapped
BAR_OF_80 = 10  # characters, below 100 columns; our choice: leaves room for the words
LEAST_WORDS = 20  # characters beside a bar; our choice: room for a number with its unit, or for the remaining time
SURE_AFTER, SURE_SHARE = 3.0, 0.02  # s, and share done, from which the remaining time is estimated
SLOW_AFTER = 60.0  # s: from then on, any share done gives an estimate, and each such time a line where no terminal is


class _Hushed:
    is_on = False


def hush(*, is_quiet: bool = True) -> None:
    """From now on, print errors only (`--quiet`), or print everything again."""
    _Hushed.is_on = is_quiet


def is_hushed() -> bool:
    """Return whether only errors are printed."""
    return _Hushed.is_on


def say(text: str, end: str = "\n", *, begin: str = "", is_error: bool = False) -> None:
    """Print to stderr; if stderr is closed, this and all later messages are dropped.

    - `begin`, `end`: terminal codes, such as `CLEAR_LINE`; codes within the text are escaped
    - `is_error`: print even under `--quiet`
    """
    if sys.stderr is None or (_Hushed.is_on and not is_error):  # closed before us
        return
    try:
        # One write call, since lines of parallel processes would otherwise mix.
        sys.stderr.write(begin + lines_of(text) + end)
        if hasattr(sys.stderr, "flush"):  # a caller's own stream may only write
            sys.stderr.flush()
    except (OSError, ValueError):  # full, a pipe that was closed, or closed by this process
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - open as long as the process


def is_watched() -> bool:
    """Return whether stderr is a terminal."""
    try:
        return sys.stderr.isatty()
    except (AttributeError, ValueError):  # None, a caller's own stream that only writes, or a closed one
        return False


def is_in_notebook() -> bool:
    """Return whether stderr is the output of a notebook's cell."""
    return type(sys.stderr).__module__.partition(".")[0] == "ipykernel"


def is_displayed() -> bool:
    """Return whether a person probably watches stderr: a terminal or a notebook."""
    return is_watched() or is_in_notebook()


def take_streams() -> None:
    """Replace closed standard streams, so that no file takes their number; print file names byte for byte."""
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    codecs.register_error("hangtime", _in_bytes)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="hangtime")


def _in_bytes(error: UnicodeError) -> tuple[bytes, int]:
    """Return a file name's byte unchanged, and an escape such as \\xb2 for a character that the encoding lacks.

    Raises:
        UnicodeError: the error is not one of encoding.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    is_byte = "\udc80" <= letter <= "\udcff"
    return letter.encode("utf-8" if is_byte else "ascii", "surrogateescape" if is_byte else "backslashreplace"), (
        error.start + 1
    )


class ProgressLine:
    """A line on a terminal or in a notebook that shows the progress of a long job; elsewhere, a few whole lines.

    The remaining time is estimated from the speed since this process began. Work of an earlier process does not count.
    """

    def __init__(self, title: str, now: Callable[[], float] = clock.monotonic) -> None:
        """Begin the line; now: a clock [s]."""
        self._title, self._now = title, now
        self._is_terminal = is_displayed()
        self._last, self._last_said = -1.0, now()
        self._begun: tuple[float, float] | None = None  # when, and at which share

    def show(self, share: float, text: str) -> None:
        """Show the share done, 0 to 1, and a few words.

        Raises:
            KeyboardInterrupt: the work was interrupted, and something went on all the same (`formats.interrupts`).
        """
        raise_swallowed()
        left = self._left(share)
        if self._is_terminal:
            columns = min(100, _columns())
            length = BAR_WIDTH if columns == 100 else BAR_OF_80
            filled = round(length * share)
            bar = f"[{'#' * filled}{'.' * (length - filled)}] "
            if columns - 1 - len(head := f"{self._title} {bar}{100 * share:3.0f} %  ") < LEAST_WORDS:
                head = f"{self._title} {100 * share:3.0f} %  "
            # A full line would begin a new one, which no later line is written over.
            width = max(0, columns - 1 - len(head))
            # A narrow terminal leaves out words and never the remaining time.
            words = ", ".join(filter(None, (_whole_words(text, width - len(left) - 2 * bool(left)), left)))
            say(f"{head}{words[:width]:<{width}}"[: columns - 1], begin="\r", end="")
        elif share >= self._last + 0.1 or self._now() - self._last_said >= SLOW_AFTER:
            say(f"{self._title}: {100 * share:.0f} %, {text}{f', {left}' if left else ''}")
            self._last, self._last_said = share, self._now()

    def end(self) -> None:
        """End the line of progress."""
        if self._is_terminal:
            say("")

    def _left(self, share: float) -> str:
        """Return the remaining time in words, '' while it cannot be estimated."""
        now = self._now()
        if self._begun is None or share < self._begun[1]:
            self._begun = (now, share)
        begun, first = self._begun
        is_sure = now - begun >= SURE_AFTER and share - first >= SURE_SHARE
        if not (is_sure or (now - begun >= SLOW_AFTER and share > first)) or share >= 1.0:
            return ""
        return f"about {in_words((now - begun) * (1.0 - share) / (share - first))} left"


def in_words(seconds: float) -> str:
    """Return a duration as `40 s`, `3 min` or `2 h 5 min`."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


def _whole_words(text: str, room: int) -> str:
    """Return as many clauses of a text as there is room for, or as many words of its first clause."""
    for separator in (", ", " "):
        parts = text.split(separator)
        for count in range(len(parts), 0, -1):
            if len(kept := separator.join(parts[:count])) <= room:
                return kept
    return text[: max(room, 0)]


def _columns() -> int:
    try:
        return os.get_terminal_size(2).columns or 80  # of stderr; a terminal may state none
    except OSError:
        return 80
