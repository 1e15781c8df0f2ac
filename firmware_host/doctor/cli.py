"""`hangtime sensor doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from formats.anyway import Anyway
from formats.telling import tell_entry, tell_fault
from formats.terminal import say


def add_commands(sensor: typer.Typer) -> None:
    """Add this command to `hangtime sensor`."""
    sensor.command("doctor", short_help="Check the sensor from USB to markers; say what to do.")(doctor)


def doctor(
    recording: Annotated[
        str | None,
        typer.Argument(
            metavar="SENSOR", help="Check this instead of the live sensor: an .oni recording, or synthetic:MOTION."
        ),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG.toml", help="Rig; its markers must be visible.")
    ] = None,
    device: Annotated[
        str | None,
        typer.Option("--device", metavar="BUS:ADDRESS", help="Sensor to check, as `hangtime sensor list` shows it."),
    ] = None,
    anyway: Anyway = False,
) -> None:
    """Check everything that a recording needs, one line each: `ok`, or what to do.

    Exit code 0 only when every line is ok, 1 when one is not.
    """
    from firmware_host.doctor.checks import Examination, Verdict
    from firmware_host.doctor.doctor import all_checks, examine
    from firmware_host.errors import RecordingError
    from firmware_host.opening import SYNTHETIC
    from formats.descriptions import load_rig

    if recording is not None and ":" not in recording and not Path(recording).is_file():
        raise RecordingError("there is no such recording", where=recording, advice="give a path to an .oni file")
    chosen = None if rig is None else load_rig(rig, anyway=anyway)
    if recording is not None and recording.startswith(SYNTHETIC):
        say("A synthetic world's cloth is simulated first, then 5 s of its frames are rendered, within a minute or so")
    checks = all_checks(is_recording=recording is not None)
    width = max(len(check.name) for check in checks)
    is_well = True
    with Examination(source=recording, rig=chosen, place=device) as examination:
        for check, finding in examine(checks, examination):
            is_well = is_well and finding.verdict is Verdict.OK
            mark = {Verdict.OK: "ok: ", Verdict.PROBLEM: "", Verdict.SKIPPED: "skipped: "}[finding.verdict]
            words = f"{check.name:<{width}}  {mark}{finding.text}"
            tell_entry("checks", words, name=check.name, verdict=finding.verdict.name.lower(), text=finding.text)
            if finding.verdict is not Verdict.OK:
                tell_fault(f"{check.name}: {mark}{finding.text}")
    if not is_well:
        raise typer.Exit(1)
