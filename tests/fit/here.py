"""Run the `hangtime` command inside the test's own process, which saves a second per call."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import signal
import sys
import threading
from dataclasses import dataclass

from formats import command
from formats.interrupts import forget_interruption

whole = functools.cache(command.whole)  # to put a command together takes hundredths of a second


@dataclass(frozen=True)
class Done:
    """The exit code of a command, and its output."""

    returncode: int
    stdout: str
    stderr: str


def hangtime_here(*words: object, folder: object) -> Done:
    """Run the command with these words in a folder, as its own `main` does; only its streams are left as they are."""
    before, arguments, streams, anew = os.getcwd(), sys.argv, command.take_streams, command.whole
    handler = signal.getsignal(signal.SIGINT)
    out, err = io.StringIO(), io.StringIO()
    os.chdir(str(folder))
    sys.argv = ["hangtime", *map(str, words)]
    command.take_streams = lambda: None
    if anew is whole.__wrapped__:  # else a test has put another one in its place
        command.whole = whole
    code: object = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                command.main()
            except SystemExit as end:
                code = end.code
    finally:
        os.chdir(before)
        sys.argv, command.take_streams, command.whole = arguments, streams, anew
        forget_interruption()  # as the end of a process does; else it would end the progress of a later test
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, handler)
    return Done(code if isinstance(code, int) else int(code is not None), out.getvalue(), err.getvalue())
