"""`hangtime daemon`, `start`, `stop`, `status` and `watch`: the appliance's commands."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from formats import terminal
from formats.command_groups import APPLIANCE
from formats.errors import HangtimeError
from formats.help_pages import OUTPUT
from formats.plain_text import with_advice
from formats.telling import tell, tell_fault

CONFIG_OPTION = Annotated[Path, typer.Option("--config", metavar="FILE.toml", help="The appliance's configuration.")]
SOCKET = Annotated[
    Path, typer.Option("--socket", metavar="PATH", envvar="HANGTIME_SOCKET", help="Where the recorder listens.")
]
DEFAULT_CONFIG, DEFAULT_SOCKET = Path("/etc/hangtime/appliance.toml"), Path("/run/hangtime/control.sock")


def add_commands(app: typer.Typer) -> None:
    """Add the appliance's commands to the `hangtime` command."""
    for name, command, words in (
        ("daemon", daemon_command, "Run the appliance: record at the press of a button."),
        ("start", start_command, "Let the appliance begin a take."),
        ("stop", stop_command, "Let the appliance end its take."),
        ("status", status_command, "Show the state of the appliance, and the next steps."),
        ("watch", watch_command, "Show the state of the appliance at every change."),
    ):
        app.command(name, rich_help_panel=APPLIANCE, short_help=words)(command)


def daemon_command(config: CONFIG_OPTION = DEFAULT_CONFIG) -> None:
    """Run the appliance: wait for the hanger, record at the press of a button, keep every take.

    The process is replaced by one that holds no command line: `python -m capture.appliance`.
    """
    os.execv(sys.executable, [sys.executable, "-m", "capture.appliance", "--config", str(config)])


def start_command(socket: SOCKET = DEFAULT_SOCKET) -> None:
    """Let the appliance begin a take, with the seconds before this command."""
    _do(socket, "start")
    tell("recording", doing="recording")


def stop_command(socket: SOCKET = DEFAULT_SOCKET) -> None:
    """Let the appliance end its take and keep it."""
    _do(socket, "stop")
    tell("saving", doing="saving")


def status_command(
    socket: SOCKET = DEFAULT_SOCKET,
    preview: Annotated[
        Path | None, typer.Option("--preview", metavar="FILE.png", help="Also write the picture that the sensor sees.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the picture FILE.png.")] = False,
) -> None:
    """Show the state of the appliance: each fault with its next step, and the counts.

    Exits with 1 while nothing can be recorded.
    """
    from capture.appliance.control import ask, picture_in
    from capture.appliance.status import lines
    from formats.outputs import AS_PICTURE, check_place, refuse_to_replace, write_bytes

    if preview is not None:
        check_place(preview, *AS_PICTURE)
        refuse_to_replace(preview, overwrite=overwrite)
    answer = ask(socket, "status")
    seen = ask(socket, "preview")
    answer["sees"] = seen["line"]
    tell("\n".join([*lines(answer), f"sees: {seen['line']}"]), **answer)
    unseen = None
    if preview is not None and not seen["png"]:
        unseen = _no_picture(preview)
    elif preview is not None:
        write_bytes(preview, picture_in(seen), overwrite=overwrite)
    if answer["state"] == "fault":
        for fault in answer["faults"]:
            tell_fault(with_advice(fault["sentence"], fault["advice"]))
        if unseen is not None:
            terminal.say(f"hangtime: {unseen}", is_error=True)
        raise typer.Exit(1)
    if unseen is not None:
        raise unseen


def _no_picture(preview: Path) -> HangtimeError:
    """Return the error of a picture that was asked for before the sensor sent one."""
    from capture.errors import ControlError

    return ControlError(
        "is not written, because the sensor sent no picture yet", where=preview,
        advice="repeat the command once `hangtime status` says what it sees",
    )  # fmt: skip


def watch_command(
    socket: SOCKET = DEFAULT_SOCKET,
    as_json: Annotated[
        bool, typer.Option("--json", rich_help_panel=OUTPUT, help="Print one object a line, for programs.")
    ] = False,
) -> None:
    """Show the state of the appliance at every change, until Ctrl-C."""
    from capture.appliance.control import listen

    for answer in listen(socket, "watch"):
        typer.echo(json.dumps(answer) if as_json else _in_one_line(answer))


def _in_one_line(answer: dict[str, Any]) -> str:
    faults = "".join(f" ! {with_advice(fault['sentence'], fault['advice'])}" for fault in answer["faults"])
    return f"{answer['state']}: {answer['condition']}; lamp: {answer['lamp']}{faults}"


def _do(socket: Path, do: str) -> None:
    """Ask the recorder to do something.

    Raises:
        ControlError: it does not.
    """
    from capture.appliance.control import ask
    from capture.errors import ControlError

    answer = ask(socket, do)
    if not answer["ok"]:
        raise ControlError(answer["what"], where=socket, advice=answer["advice"])
