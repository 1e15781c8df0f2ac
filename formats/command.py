"""The `hangtime` command: gathers the commands of every installed package and turns errors into one sentence."""

from __future__ import annotations

import os
import sys
from importlib.metadata import entry_points

import typer

from formats.errors import HangtimeError

# Sums that are split over threads are rounded differently: what a command finds must not depend on how many processors
# there are. It is read when numpy is loaded, which is when the packages' commands are.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

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
    """Run the command line; a HangtimeError becomes one sentence on stderr and its exit code."""
    absent = gather_commands()
    if absent:
        app.info.epilog = "Not available here: " + ", ".join(absent)
    try:
        app()
    except HangtimeError as error:
        print(f"hangtime: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        sys.exit(141)


if __name__ == "__main__":
    main()
