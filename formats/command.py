"""The `hangtime` command: gathers the commands of every installed package and turns errors into one sentence."""

from __future__ import annotations

import os
import platform
import re
import sys
from copy import copy
from importlib.metadata import entry_points, requires, version
from typing import Any

import typer
from typer.main import get_command, get_command_name

from formats import help_pages, telling
from formats.completion import choose_shell
from formats.errors import HangtimeError, of_system
from formats.interrupts import hold_while_importing, remember_interruptions
from formats.terminal import say, take_streams

# Sums that are split over threads are rounded differently: a result must not depend on the number of processors.
# The variable is read when numpy is loaded, together with the packages' commands.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

INTERRUPTED, CUT_OFF = 130, 141  # exit codes of a shell for what SIGINT and SIGPIPE end
PACKAGES = {
    "cv2": "opencv-python-headless",
    "usb": "pyusb",
    "PIL": "pillow",
    "pxr": "usd-core",
    "rerun": "rerun-sdk",
}  # those that are not named as what they bring
WORDS_ASKED = "_HANGTIME_COMPLETE"  # variable by which a shell asks for all that a word may become
PANIC = "PanicException"  # of libraries written in Rust: no Exception, and its class cannot be imported

app = typer.Typer(
    name="hangtime",
    help="Measure how a real garment moves, fit a cloth simulation to it, and diagnose what it still gets wrong.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"hangtime {version('hangtime')}")
        raise typer.Exit


@app.callback()
def root(
    shows_version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version and end."
    ),
) -> None:
    """Measure how a real garment moves, fit a cloth simulation to it, and diagnose what it still gets wrong."""


def gather_commands() -> None:
    """Add every package's commands to `app`, once; each command imports its libraries when it runs."""
    if app.registered_groups:
        return
    for entry in sorted(entry_points(group="hangtime.commands"), key=lambda e: e.name):
        entry.load()(app)


def whole(name: str | None = None) -> Any:
    """Return the `hangtime` command, with the commands of every installed package and the options that all have.

    - `name`: of the only command or group that is wanted; the others take as long to make as Python to start
    """
    gather_commands()
    help_pages.add_pages(app)
    made = get_command(_with_only(name))
    help_pages.finish(made)
    return made


def _with_only(name: str | None) -> typer.Typer:
    """Return the app with the command or group of this name alone, the whole one where none has it."""
    part = copy(app)
    part.registered_groups = [group for group in app.registered_groups if group.name == name]
    part.registered_commands = [
        command for command in app.registered_commands
        if command.callback is not None and name == (command.name or get_command_name(command.callback.__name__))
    ]  # fmt: skip
    return part if part.registered_groups or part.registered_commands else app


def main() -> None:
    """Run the command line; an error that a user can act on becomes one sentence on stderr and its exit code."""
    try:
        hold_while_importing()
        take_streams()
        remember_interruptions()
        telling.begin()
        command = whole(next(iter(sys.argv[1:]), None) if WORDS_ASKED not in os.environ else None)
        choose_shell()
        try:
            command(prog_name="hangtime")  # also as `python -m hangtime`, of which no shell completes anything
        except BaseException as error:
            if (told := _told(error)) is not None:
                telling.know(error=told)
                telling.ask_json(_asks_json(sys.argv[1:]))
            raise
        finally:  # a command that failed at a part of its work has told the rest
            telling.end()
    except KeyboardInterrupt:
        say("Interrupted.")
        sys.exit(INTERRUPTED)
    except SystemExit as end:  # Typer's own, 1, where a reader of stdout went away
        if end.__context__ is not None and isinstance(end.__context__.__cause__, KeyboardInterrupt):
            say("Interrupted.")  # no command caught it and said more
        sys.exit(CUT_OFF if isinstance(end.__context__, BrokenPipeError) else end.code)
    except BrokenPipeError:  # a reader of the JSON document went away
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
        sys.exit(CUT_OFF)
    except BaseException as error:
        if (spoken := _spoken(error)) is None:
            raise
        say(f"hangtime: {spoken}", is_error=True)
        sys.exit(spoken.exit_code)


def _asks_json(words: list[str]) -> bool:
    """Return whether JSON is asked for, also where the command line is wrong or the command has a form of its own."""
    return "--json" in words[: words.index("--") if "--" in words else None]


def _told(error: BaseException) -> str | None:
    """Return the sentence of an error for the JSON document; None of an end without one."""
    wrong_use = getattr(error.__context__, "format_message", None)  # of an error that Typer showed, and then ended
    if isinstance(error, SystemExit) and wrong_use is not None:
        return str(wrong_use())
    spoken = _spoken(error)
    return None if spoken is None else str(spoken)


def _spoken(error: BaseException) -> HangtimeError | None:
    """Return what to tell of an error that a user can act on; None of one of the program, and of an interruption."""
    if isinstance(error, HangtimeError):
        return error
    if isinstance(error, ModuleNotFoundError):
        library = (error.name or "").split(".")[0]
        if library in {"", "formats", "firmware_host", "capture", "fit"}:
            return None
        return HangtimeError(f"{library} is not installed", advice=_how_to_get(library))
    if isinstance(error, OSError):
        return of_system(error)
    if type(error).__name__ == PANIC:
        cause = str(error).partition("\n")[0]
        return HangtimeError(
            f"a library failed ({cause})", advice="check the addresses, keys and settings it was given"
        )
    return None


def _how_to_get(library: str) -> str:
    """Say how a library is installed that a command imports: with the extra that lists it."""
    package = PACKAGES.get(library, library)
    wanted = re.compile(rf"{re.escape(package)}\b(?!-).*\bextra == ['\"](\w+)", re.IGNORECASE)
    extra = next((found[1] for line in requires("hangtime") or [] if (found := wanted.match(line))), None)
    if extra is None:
        return "in Hangtime's checkout: scripts/setup"
    if extra == "fit" and sys.platform == "linux" and (machine := platform.machine()) != "x86_64":
        return f"Taichi has no package for Linux on {machine}: this computer records takes but cannot fit them"
    return f"in Hangtime's checkout: pip install -e '.[{extra}]'"


if __name__ == "__main__":
    main()
