"""Start the `hangtime` command, so that Ctrl-C during the import of its libraries ends it in one line.

Python has loaded the modules that are imported here by itself; `main` imports everything else.
"""

import os
import sys


def main() -> None:
    """Import the command line, then run it."""
    try:
        from formats.interrupts import end_undisturbed, hold_while_importing

        hold_while_importing()
        from formats.command import main as run
    except KeyboardInterrupt:
        _tell_interruption()
        sys.exit(128 + 2)  # a shell's exit code of a command that signal 2, SIGINT, ended
    try:
        run()
    finally:
        end_undisturbed()


def _tell_interruption() -> None:
    """Print one line without any library, and without the streams, which may be closed."""
    try:  # noqa: SIM105 - `contextlib` may not be loaded yet
        os.write(2, b"Interrupted.\n")
    except OSError:
        pass
