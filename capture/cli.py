"""`hangtime record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    app.command("record", short_help="Track hanger and garment and keep them as a take.")(record_command)


def record_command(
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="FILE|URI", help="An .oni recording, openni2: or synthetic:MOTION.")
    ],
    rig: Annotated[Path, typer.Option("--rig", metavar="RIG.toml", help="Sensor, gravity and hanger.")],
    garment: Annotated[Path, typer.Option("--garment", metavar="GARMENT.toml", help="Outline, weight and points.")],
    out: Annotated[Path, typer.Option("--out", metavar="TAKE.mcap", help="The take to write.")],
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=1.0, help="Stop after so long.", show_default="the end")
    ] = None,
) -> None:
    """Track the hanger and the garment in every frame and keep them as a take.

    Nothing has to be clicked: the two markers are found by themselves. Ctrl-C ends the take cleanly.
    """
    import sys
    from datetime import UTC, datetime

    from capture.recording import record
    from firmware_host.opening import open_sensor
    from formats.descriptions import load_garment, load_rig

    described_rig, described_garment = load_rig(rig), load_garment(garment)
    is_terminal = sys.stderr.isatty()

    def show(frames: int, total: int | None, hanger_share: float) -> None:
        if is_terminal and frames % 5 == 0:
            of = f" of {total}" if total else ""
            text = f"\r{frames}{of} frames, hanger seen in {100 * hanger_share:.0f} %"
            print(text, end="", file=sys.stderr, flush=True)

    with open_sensor(sensor) as source:
        report = record(
            source, described_rig, described_garment, out, take_id=out.stem,
            created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=seconds, progress=show,
        )  # fmt: skip
    if is_terminal:
        print(file=sys.stderr)
    points = ", ".join(
        f"{name} {100 * share:.0f} %"
        for name, share in zip(described_garment.point_names, report.point_share, strict=True)
    )
    typer.echo(f"{report.path}: {report.frames} frames{', stopped by hand' if report.is_interrupted else ''}")
    typer.echo(f"hanger seen in {100 * report.with_hanger / max(report.frames, 1):.0f} %; {points}")
