"""The `hangtime` command: gathers the commands of every installed package and turns errors into one sentence."""

from __future__ import annotations

import errno
import os
import sys
from importlib.metadata import entry_points
from typing import NoReturn

import typer

from formats.errors import HangtimeError
from formats.terminal import say, take_streams

# Sums that are split over threads are rounded differently: what a command finds must not depend on how many processors
# there are. It is read when numpy is loaded, which is when the packages' commands are.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

INTERRUPTED, CUT_OFF = 130, 141  # exit codes of a shell for what SIGINT and SIGPIPE end
UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES}
MAKE_ROOM = (
    "make room on the disk, or choose another place; what was whole before stays, and `fit`, `diagnose`, `blind` and "
    "`batch` go on from it"
)

app = typer.Typer(
    name="hangtime",
    help="Measure how a real garment moves, fit a cloth simulation to it, and diagnose what it still gets wrong.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def root() -> None:
    """Measure how a real garment moves, fit a cloth simulation to it, and diagnose what it still gets wrong."""


def gather_commands() -> list[str]:
    """Add every package's commands to `app`; return the names of packages whose libraries are not installed."""
    absent = []
    for entry in sorted(entry_points(group="hangtime.commands"), key=lambda e: e.name):
        try:
            add_commands = entry.load()
        except ModuleNotFoundError as error:
            if error.name is None or error.name.split(".")[0] in {"formats", "firmware_host", "capture", "fit"}:
                raise
            absent.append(f"{entry.name} ({error.name} is not installed)")
        else:
            add_commands(app)
    return absent


def main() -> None:
    """Run the command line; an error that a user can act on becomes one sentence on stderr and its exit code."""
    try:
        take_streams()
        absent = gather_commands()
        if absent:
            app.info.epilog = "Not available here: " + ", ".join(absent)
        app()
    except HangtimeError as error:
        _refuse(error)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except SystemExit as end:  # Typer's own, 1, where a reader of stdout went away
        sys.exit(CUT_OFF if isinstance(end.__context__, BrokenPipeError) else end.code)
    except OSError as error:
        if error.errno not in UNWRITABLE and error.filename is None:
            raise
        what = "cannot be written" if error.errno in UNWRITABLE else "cannot be used"
        where = error.filename or "output"  # what stdout raises names nothing
        _refuse(HangtimeError(f"{what} ({error.strerror})", where=where, advice=MAKE_ROOM))


def _refuse(error: HangtimeError) -> NoReturn:
    say(f"hangtime: {error}")
    sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
