"""`hangtime sync run|now|prove|status` and `hangtime takes prune`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from formats.help_pages import OUTPUT
from formats.plain_text import counted, first_few, plain, sized
from formats.telling import know, tell

if TYPE_CHECKING:
    from capture.sync.settings import Range

Config = Annotated[Path, typer.Option("--config", metavar="FILE", help="The appliance's configuration.")]
SpoolFolder = Annotated[
    Path | None,
    typer.Option("--spool", metavar="DIR", help="The folder of takes.", show_default="the configuration's"),
]
CONFIG_FILE = Path("/etc/hangtime/appliance.toml")


def add_commands(app: typer.Typer) -> None:
    """Add the commands of sync to the `hangtime` command."""
    from formats.command_groups import APPLIANCE, group_of

    sync = group_of(app, "sync", "Upload kept takes, and verify them on the server.", APPLIANCE)
    sync.command("run", short_help="Upload takes until none waits.")(run_sync)
    sync.command("now", short_help="Upload the waiting takes once.")(sync_now)
    sync.command("prove", short_help="Fetch one take at random and check it.")(prove_sync)
    sync.command("status", short_help="Show which takes wait for upload and which are safe.")(show_sync)
    group_of(app, "takes").command("prune")(prune_takes)


def run_sync(config: Config = CONFIG_FILE, spool: SpoolFolder = None) -> None:
    """Upload takes until none waits; after failures of the server, retry at growing intervals.

    Exit code 0: all takes are safe; 2: settings, credentials or disk; 75: the server did not accept them. Follow the
    sentence, then run the command again.
    """
    _start("run", config, spool)


def sync_now(config: Config = CONFIG_FILE, spool: SpoolFolder = None) -> None:
    """Upload the waiting takes once, without retries after a failure of the server.

    Exit code 0: all takes are safe; 2: settings, credentials or disk; 75: the server did not accept them.
    """
    _start("now", config, spool)


def prove_sync(config: Config = CONFIG_FILE, spool: SpoolFolder = None) -> None:
    """Fetch a random take from the server, check its hash and open it.

    Exit code 0: the fetched take is right; 2: it is damaged or missing; 75: the server is unreachable.
    """
    _start("prove", config, spool)


def show_sync(
    config: Config = CONFIG_FILE,
    spool: SpoolFolder = None,
    json: Annotated[bool, typer.Option("--json", rich_help_panel=OUTPUT, help="Print JSON instead of words.")] = False,
) -> None:
    """Show the state of sync: waiting takes, safe takes, faults, and the last proof."""
    from capture.appliance.sync_status import FILE, is_syncing, read_status, sentences
    from capture.sync.rounds import now_here
    from capture.sync.settings import load_settings
    from formats.whole_files import read_bounded

    folder = spool or load_settings(config).spool
    _check_folder(folder)
    status = read_status(folder)
    if json:
        typer.echo("null" if status is None else read_bounded(folder / FILE).decode().strip())
        return
    if is_syncing(folder):
        tell("Syncing now.")
    for sentence in sentences(status, now_here()):
        tell(sentence)
    _tell_strays(folder)


def prune_takes(
    config: Config = CONFIG_FILE,
    spool: SpoolFolder = None,
    keep_days: Annotated[
        float | None,
        typer.Option(
            "--keep-days", min=0.0, help="Remove verified takes older than this.", show_default="the configuration's"
        ),
    ] = None,
    quota_mb: Annotated[
        int | None,
        typer.Option("--quota-mb", min=0, help="Takes may fill so many MB.", show_default="the configuration's"),
    ] = None,
) -> None:  # fmt: skip
    """Remove verified takes from this device, the oldest first. A take that is not safe on the server stays."""
    import msgspec

    from capture.appliance.spool import Spool
    from capture.sync.rounds import now_here
    from capture.sync.settings import MB, RANGES_OF_RETENTION, SyncSettings, SyncSetup, load_settings

    days, quota = RANGES_OF_RETENTION["days"], RANGES_OF_RETENTION["quota_bytes"]
    _check_option("--keep-days", keep_days, days)
    _check_option(
        "--quota-mb", quota_mb, replace(quota, least=quota.least / MB, most=quota.most / MB, unit="MB", others=())
    )
    setup = load_settings(config, spool) if spool is None or config.exists() else SyncSetup(SyncSettings(), spool)
    _check_folder(setup.spool)
    retention = setup.settings.retention
    if keep_days is not None:
        retention = msgspec.structs.replace(retention, days=keep_days)
    if quota_mb is not None:
        retention = msgspec.structs.replace(retention, quota_bytes=quota_mb * MB)
    room = Spool(setup.spool).make_room(retention, now=now_here(), url=setup.settings.url)
    for stem in room.left:
        tell(f"{stem} is removed from this device; its receipt says where it is")
    for stem in room.changed:
        tell(f"{stem} stays: the file differs from the one that the server verified; replace this device's disk")
    unsafe = sum(1 for _ in Spool(setup.spool).waiting(setup.settings.url))
    know(
        left=list(room.left),
        changed=list(room.changed),
        used_bytes=room.used,
        free_bytes=room.free,
        is_enough=room.is_enough,
        unsafe=unsafe,
    )
    tell(f"{counted(len(room.left), 'take')} removed, {sized(room.used)} of takes stay, {sized(room.free)} are free")
    stay = "is not safe on the server and stays" if unsafe == 1 else "are not safe on the server and stay"
    unsafe_stay = f": {counted(unsafe, 'take')} {stay}" if unsafe else ""
    if room.used > retention.quota_bytes:
        asked = "--quota-mb" if quota_mb is not None else "the configuration"
        tell(f"these takes exceed what {asked} allows{unsafe_stay}")
    if room.free < retention.least_free_bytes:
        least = sized(retention.least_free_bytes)
        tell(
            f"the disk has {sized(room.free)} free, and least_free_bytes asks for {least}"
            f"{unsafe_stay or ': other files fill it'}"
        )
    _tell_strays(setup.spool)


def _tell_strays(spool: Path) -> None:
    """Name takes that stand in the spool under names of their own, which neither sync nor removal counts."""
    from capture.appliance.spool import Spool

    if names := Spool(spool).strays():
        shown = first_few(list(map(plain, names)))
        are = "is no take" if len(names) == 1 else "are no takes"
        tell(f"{counted(len(names), 'file')} here {are} of the recorder, and nothing sends or removes: {shown}")


def _start(command: str, config: Path, spool: Path | None) -> None:
    from capture.sync.process import start

    code = start(command, config, spool)
    know(exit_code=code)
    raise typer.Exit(code)


def _check_option(name: str, value: float | None, limits: Range) -> None:
    """Refuse a number outside the range that the configuration's own key has."""
    from capture.errors import SyncError

    try:
        if value is not None:
            limits.check("it", value)
    except ValueError as error:
        what, _, advice = str(error).partition("; ")
        raise SyncError(what, where=name, advice=advice) from error


def _check_folder(folder: Path) -> None:
    """Check that a path is a folder of takes."""
    from capture.errors import SyncError
    from formats.whole_files import loop_words

    if not folder.is_dir():
        what = loop_words(folder, "is no folder, so that no take is in it")
        raise SyncError(what, where=folder, advice="give the folder of takes with --spool, or as folder in [spool]")
