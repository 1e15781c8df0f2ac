"""`hangtime takes show`, `hangtime takes verify` and `hangtime import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    takes = typer.Typer(help="Look at take archives and check them.", no_args_is_help=True)
    takes.command("show")(show_take)
    takes.command("verify")(verify_takes)
    app.add_typer(takes, name="takes")
    app.command("import", short_help="Turn other people's recordings into takes.")(import_recordings)


def show_take(
    path: Annotated[Path, typer.Argument(metavar="TAKE", help="A take archive (.mcap).")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what a take holds: length, rate, garment, how often each point was seen and how noisy it is."""
    import json

    from formats.archive import read_take
    from formats.summary import describe, summarise

    summary = summarise(read_take(path))
    typer.echo(json.dumps(summary, indent=2) if as_json else describe(summary))


def verify_takes(
    paths: Annotated[list[Path], typer.Argument(metavar="TAKE...", help="Take archives (.mcap).")],
) -> None:
    """Read takes whole, checksums and all. Exit code 0: all sound; 2: at least one is damaged or incomplete."""
    from formats.archive import verify_take
    from formats.errors import TakeError

    all_sound = True
    for path in paths:
        try:
            report = verify_take(path)
        except TakeError as error:
            typer.echo(f"lost        {error}")
            all_sound = False
            continue
        word = "sound" if report.is_sound else "damaged" if report.damaged_blocks else "incomplete"
        rest = "" if report.is_sound else f", {report.damaged_blocks} damaged blocks; what was read can be used"
        typer.echo(f"{word:<11} {path}: {report.frames} frames in {report.blocks} blocks{rest}")
        all_sound &= report.is_sound
    if not all_sound:
        raise typer.Exit(2)


def import_recordings(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Swung-cloth recordings (.npz).")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the takes; made if absent.")] = Path(
        "takes"
    ),
) -> None:
    """Turn other people's recordings into takes, with a rig and a garment description beside them."""
    from formats.archive import write_take
    from formats.descriptions import dump_description
    from formats.importers.swung_cloth import import_swung_cloth

    out.mkdir(parents=True, exist_ok=True)
    for path in paths:
        take = import_swung_cloth(path)
        target = write_take(out / f"{take.take_id}.mcap", take)
        (out / "rig.toml").write_text(dump_description(take.rig))
        (out / "garment.toml").write_text(dump_description(take.garment))
        typer.echo(f"{target}: {len(take.time)} frames, {take.time[-1]:.1f} s")
