"""The `hangtime` command: gathers the commands of every installed package, and reports an error as one sentence."""

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

# Threads change the rounding of sums, and a result must not depend on the number of processors.
# Numpy reads the variable when it is loaded, together with the packages' commands.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

INTERRUPTED, PIPE_CLOSED = 130, 141  # a shell's exit codes of commands that SIGINT and SIGPIPE ended
PACKAGES = {
    "cv2": "opencv-python-headless",
    "usb": "pyusb",
    "PIL": "pillow",
    "pxr": "usd-core",
    "rerun": "rerun-sdk",
}  # import names that differ from the package's name
FOR_DEVELOPERS = {"dev", "docs"}  # extras that no command of a user needs
WORDS_ASKED = "_HANGTIME_COMPLETE"  # variable by which a shell asks for the completions of a word
PANIC = "PanicException"  # of libraries in Rust: not a subclass of Exception, and not importable

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
    """Return the `hangtime` command, with the commands of every installed package and the common options.

    - `name`: the only command or group to build, None for all; building the others takes as long as Python's start
    """
    gather_commands()
    help_pages.add_pages(app)
    made = get_command(_with_only(name))
    help_pages.finish(made)
    return made


def _with_only(name: str | None) -> typer.Typer:
    """Return the app with only the command or group of this name, or the whole app where no command has it."""
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
        if next(iter(sys.argv[1:]), None) in help_pages.JSON_IN_LINES:
            telling.ask_lines()
        command = whole(next(iter(sys.argv[1:]), None) if WORDS_ASKED not in os.environ else None)
        choose_shell()
        try:
            command(prog_name="hangtime")  # also as `python -m hangtime`, of which no shell completes anything
        except BaseException as error:
            if (sentence := _sentence_of(error)) is not None:
                telling.know(error=sentence)
                telling.ask_json(_asks_json(sys.argv[1:]))
            raise
        finally:  # a command that failed in part has reported the rest
            telling.end()
    except KeyboardInterrupt:
        say("Interrupted.")
        sys.exit(INTERRUPTED)
    except SystemExit as end:  # Typer's own, 1, where a reader of stdout went away
        if end.__context__ is not None and isinstance(end.__context__.__cause__, KeyboardInterrupt):
            say("Interrupted.")  # no command caught it and said more
        sys.exit(PIPE_CLOSED if isinstance(end.__context__, BrokenPipeError) else end.code)
    except BrokenPipeError:  # a reader of the JSON document went away
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - open as long as the process
        sys.exit(PIPE_CLOSED)
    except BaseException as error:
        if (spoken := _spoken(error)) is None:
            raise
        say(f"hangtime: {spoken}", is_error=True)
        sys.exit(spoken.exit_code)


def _asks_json(words: list[str]) -> bool:
    """Return whether the command line asks for JSON, even where it is wrong or its command prints its own JSON."""
    return "--json" in words[: words.index("--") if "--" in words else None]


def _sentence_of(error: BaseException) -> str | None:
    """Return an error's sentence for the JSON document, None for an end without an error."""
    wrong_use = getattr(error.__context__, "format_message", None)  # of an error that Typer showed, and then ended
    if isinstance(error, SystemExit) and wrong_use is not None:
        return str(wrong_use())
    spoken = _spoken(error)
    return None if spoken is None else str(spoken)


def _spoken(error: BaseException) -> HangtimeError | None:
    """Return the user's error for an exception; None for a defect of the program or an interruption."""
    if isinstance(error, HangtimeError):
        return error
    if isinstance(error, ModuleNotFoundError):
        library = (error.name or "").split(".")[0]
        if library in {"", "formats", "firmware_host", "capture", "fit"}:
            return None
        return HangtimeError(f"{library} is not installed", where=None, advice=_how_to_get(library))
    if isinstance(error, OSError):
        return of_system(error)
    if type(error).__name__ == PANIC:
        cause = str(error).partition("\n")[0]
        return HangtimeError(
            f"a library failed ({cause})", where=None, advice="check the addresses, keys and settings it was given"
        )
    return None


def _how_to_get(library: str) -> str:
    """Return how to install a missing library: the extra of Hangtime that lists it, a user's before a developer's."""
    package = PACKAGES.get(library, library)
    wanted = re.compile(rf"{re.escape(package)}\b(?!-).*\bextra == ['\"](\w+)", re.IGNORECASE)
    extras = [found[1] for line in requires("hangtime") or [] if (found := wanted.match(line))]
    extra = min(extras, key=FOR_DEVELOPERS.__contains__, default=None)
    if extra is None:
        return "in Hangtime's checkout: scripts/setup"
    if extra == "fit" and sys.platform == "linux" and (machine := platform.machine()) != "x86_64":
        return f"Taichi has no package for Linux on {machine}: this computer records takes but cannot fit them"
    return f"in Hangtime's checkout: pip install -e '.[{extra}]'"


if __name__ == "__main__":
    main()
