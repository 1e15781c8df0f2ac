"""`hangtime takes`, with `labels`, `hangtime import` and `hangtime swatch`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from formats.anyway import Anyway
from formats.command_groups import TAKES, group_of
from formats.export_cli import export_takes
from formats.takes_cli import add_takes_commands, end_with, refuse_the_same_name, tell_aside
from formats.telling import tell, tell_entry, tell_fault

if TYPE_CHECKING:  # a take needs numpy, and --help does not
    from collections.abc import Mapping

    from formats.errors import HangtimeError
    from formats.take import Take

DESCRIBED_AS = ".toml"
FARTHEST_SHOWN = 1e6  # m; our choice: beyond it a position has no millimetres, and would fill the line


class DecimalSign(StrEnum):
    """Names of the decimal separators."""

    COMMA = "comma"
    POINT = "point"


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    takes = group_of(app, "takes")
    add_takes_commands(takes)
    takes.command("export")(export_takes)
    takes.command("labels", short_help="List the markers of motion capture files.")(list_labels)
    app.command("import", rich_help_panel=TAKES, short_help="Turn other people's recordings into takes.")(
        import_recordings
    )
    app.command("swatch", rich_help_panel=TAKES, short_help="Describe a square swatch with markers.")(describe_swatch)


def import_recordings(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="Motion capture (.c3d, .trc, .csv, .tsv, .txt), or swung cloth or exported takes (.npz).",
        ),
    ],
    garment: Annotated[
        Path | None,
        typer.Option("--garment", metavar="FILE", help="Garment whose points are the markers, or a .npz grid."),
    ] = None,
    up: Annotated[str, typer.Option("--up", help="Axis that points up (motion capture): x, y, z, -x, -y, -z.")] = "z",
    frames: Annotated[
        int | None,
        typer.Option("--frames", help="Frames to keep from the beginning, 20 or more (motion capture).",
                     show_default="all"),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option("--unit", help="Unit of lengths where the file states none: m, dm, cm, mm, um, in, ft (motion "
                     "capture). With --anyway it counts where the file states another.")
    ] = None,
    decimal: Annotated[
        DecimalSign | None,
        typer.Option("--decimal", show_default="as the file shows",
                     help="Decimal separator of a text file; the other character separates thousands. Needed where "
                     "1,234 may be 1234 or 1.234; the import then asks for it."),
    ] = None,
    subject: Annotated[
        str, typer.Option("--subject", help="Subject to import, if several share names of markers (motion capture).")
    ] = "",
    hanger: Annotated[
        Path | None,
        typer.Option("--hanger", metavar="PATH", help="The hanger's path on its own clock (.npz): file or folder.")
    ] = None,
    anyway: Anyway = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the takes; made if absent.")] = Path(
        "takes"
    ),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is already in that folder.")] = False,
) -> None:  # fmt: skip
    """Turn other people's recordings into takes, with a rig and a garment description beside them.

    Exit code 2: at least one recording cannot be imported, or a description cannot be replaced. The last lines name
    each recording that failed.

    Example: `hangtime import swing.csv other.csv --garment swatch.toml --up z`
    """
    from formats.descriptions import load_garment
    from formats.descriptions_beside import check_room_beside, settle
    from formats.errors import HangtimeError, TakeError
    from formats.importers.marker_files import FILE_ENDINGS
    from formats.importers.own_arrays import holds_a_take, import_own_arrays
    from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
    from formats.importers.swung_cloth import import_swung_cloth
    from formats.outputs import check_folder_name, check_name, output_folder, refuse_to_replace
    from formats.plain_text import as_typed, plain
    from formats.unfinished import ANOTHER_FOLDER

    check_folder_name(out, ".mcap")
    for path in paths:
        if path.suffix.lower() == DESCRIBED_AS:
            raise TakeError(
                "is a description, and no recording",
                where=path,
                advice=f"give it as {as_typed(['--garment', str(path)])}",
            )
    described = load_garment(garment, anyway=anyway) if garment is not None else None
    options = MarkerOptions(
        up=up, frames=frames, unit=unit, decimal=decimal or "", subject=subject, anyway=anyway
    )  # fmt: skip
    targets = [out / f"{path.stem}.mcap" for path in paths]
    refuse_the_same_name(paths, targets, "import one of them elsewhere")
    for path in paths:
        if path.suffix.lower() == ".npz":
            given = {"--frames": frames, "--unit": unit, "--decimal": decimal, "--subject": subject or None}
            _refuse_options(path, given, f"is for motion capture, and {path.name} is none")
            if holds_a_take(path):
                own = {"--garment": garment, "--hanger": hanger}
                _refuse_options(path, own, f"is for other recordings, and {path.name} holds a whole take")
        elif path.suffix.lower() in FILE_ENDINGS:
            if described is None:
                raise TakeError(
                    "motion capture needs to know the garment", where=path,
                    advice="give --garment FILE; `hangtime swatch` writes one, and `hangtime takes labels` names the "
                    "markers",
                )  # fmt: skip
            if hanger is not None:
                raise TakeError(
                    "motion capture holds its hanger: the markers on the two top corners",
                    where="--hanger",
                    advice="leave out --hanger",
                )
    lost: dict[Path, HangtimeError] = {}
    is_whole = True
    with output_folder(out):
        for settled in settle(out):
            words = f"{plain(settled)}: now describes a take whose import was interrupted before it wrote this file"
            tell_entry("settled", words, file=str(settled))
        for path, target in zip(paths, targets, strict=True):
            try:
                check_name(path)
                check_room_beside(target)
                refuse_to_replace(target, overwrite=overwrite, instead=ANOTHER_FOLDER)
                if path.suffix.lower() in FILE_ENDINGS and described is not None:
                    take = import_marker_take(path, described, options)
                elif holds_a_take(path):
                    take = import_own_arrays(path)
                else:
                    take = import_swung_cloth(path, described, hanger=hanger, anyway=anyway)
                is_whole &= _write_imported(take, target, overwrite=overwrite)
            except HangtimeError as error:
                is_file = isinstance(error.where, Path)
                if not is_file and str(error.where).startswith("--"):  # an option is wrong for every recording
                    raise
                lost[path] = error
        end_with(lost, len(paths))
    if not is_whole:
        raise typer.Exit(2)


def _refuse_options(path: Path, given: Mapping[str, object], what: str) -> None:
    """Refuse options that the import of a file would ignore, since the take would not be the requested one."""
    from formats.errors import TakeError

    for name, value in given.items():
        if value is not None:
            raise TakeError(what, where=name, advice=f"leave out {name}, or import that file by itself")


def _write_imported(take: Take, target: Path, *, overwrite: bool) -> bool:
    """Write a take with rig and garment beside it, and report it; return whether both descriptions are beside it."""
    from msgspec import to_builtins

    from formats.archive import write_take
    from formats.descriptions_beside import check_description, described_beside, is_of_a_sensor
    from formats.errors import OutputError
    from formats.fault_words import doubts_of, state_of_take
    from formats.judgement import judge
    from formats.left_descriptions import RIG_FILE, is_said, named
    from formats.outputs import unwritable
    from formats.plain_text import plain, with_advice
    from formats.two_clocks import hanger_gap, shows_hanger, shows_points
    from formats.unfinished import ANOTHER_FOLDER

    described = named(take.rig, take.garment)
    rig = target.with_name(RIG_FILE)
    keeps_rig = overwrite and is_of_a_sensor(rig) and not is_said(rig, take.rig)
    if keeps_rig:
        del described[RIG_FILE]
    for name, one in described.items():
        check_description(target.with_name(name), one, overwrite=overwrite)
    left: dict[str, OutputError] = {}
    try:
        write_take(
            target, take, overwrite=overwrite, instead=ANOTHER_FOLDER, tell_aside=tell_aside,
            beside=described_beside(
                target, described, overwrite=overwrite, tell_aside=tell_aside, tell_left=left.__setitem__
            ),
        )  # fmt: skip
    except OSError as error:
        raise unwritable(target, error) from error
    length = float(take.time[-1] - take.time[0])
    front = take.notes.get("front")
    words = f"{plain(target)}: {len(take.time)} frames, {length:.1f} s" + (
        f", its front looks along {front}" * bool(front)
    )
    doubts = doubts_of(take)
    if not shows_points(take).all():
        words += f", {shows_points(take).sum()} with the points and {shows_hanger(take).sum()} with the hanger"
        words += hanger_gap(take)
    findings = judge(take)
    if keeps_rig:
        told = with_advice("describes a sensor's rig, and stays as it is", f"{ANOTHER_FOLDER} for the take's own rig")
        words += f"\nWarning: {plain(rig)}: {told}"
    words += "".join(f"\nWarning: {doubt}" for doubt in (*left.values(), *doubts))
    words += "".join(f"\nWarning: {plain(with_advice(one.words, one.advice))}" for one in findings)
    tell_entry(
        "takes", words, file=str(target), frames=len(take.time), duration_s=length, front=front,
        never_seen=[p.name for k, p in enumerate(take.garment.points) if not take.points_valid[:, k].any()],
        clock=take.notes.get("clock"), file_doubt=take.notes.get("file"), findings=[one.as_fact() for one in findings],
        left=list(left),
        **to_builtins(state_of_take(take)),
    )  # fmt: skip
    for doubt in left.values():
        tell_fault(str(doubt))
    return not left


def list_labels(
    paths: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Motion capture (.c3d, .trc, .csv, .tsv, .txt).")
    ],
    unit: Annotated[
        str | None,
        typer.Option("--unit", help="Unit of lengths where the file states none: m, dm, cm, mm, um, in, ft."),
    ] = None,
    decimal: Annotated[
        DecimalSign | None,
        typer.Option("--decimal", show_default="as the file shows", help="Decimal separator of a text file."),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Let --unit count where the file states another unit.")
    ] = False,
) -> None:  # fmt: skip
    """List the markers of motion capture files before a garment is described: names, how often seen, first position.

    The names are those that the points of garment.toml need. The position is that of the first frame in which the
    marker was seen, in metres along the file's axes.

    Exit code 2: at least one file cannot be read. The others are listed.

    Example: `hangtime takes labels swing.csv`
    """
    from formats.errors import TakeError

    lost: dict[Path, HangtimeError] = {}
    for path in paths:
        try:
            words, facts = _labels_in(path, unit, decimal or "", anyway=anyway)
        except TakeError as error:
            if isinstance(error.where, str) and error.where.startswith("--"):  # an option is wrong for every file
                raise
            lost[path] = error
            continue
        if len(paths) == 1:
            tell(words, **facts)
        else:
            tell_entry("files", f"{words}\n", **facts)
    end_with(lost, len(paths))


def _labels_in(path: Path, unit: str | None, decimal: str, *, anyway: bool) -> tuple[str, dict[str, object]]:
    """Return the markers of a file, in words and as facts.

    Raises:
        TakeError: the file cannot be read.
    """
    import numpy as np

    from formats.importers.marker_files import read_marker_tracks
    from formats.plain_text import counted, plain

    tracks = read_marker_tracks(path, unit, decimal, anyway=anyway)
    seen = np.asarray(np.isfinite(tracks.positions).all(2))
    time = tracks.time
    length = float(time[-1] - time[0]) if len(time) else 0.0
    lines = [f"{plain(path)}: {counted(len(tracks.labels), 'marker')}, {counted(len(time), 'frame')}, {length:.1f} s"]
    markers: list[dict[str, object]] = []
    width = max((len(plain(label)) for label in tracks.labels), default=0)
    for number, label in enumerate(tracks.labels):
        share = float(seen[:, number].mean())
        words, first = "never seen", None
        if share:
            first = tracks.positions[int(np.argmax(seen[:, number])), number].tolist()
            words = f"seen {100 * share:3.0f} %, first at {', '.join(map(_millimetres, first))} m"
        lines.append(f"{plain(label):<{width}}  {words}")
        markers.append({"name": label, "seen": share, "first_m": first})
    for label in tracks.without_path:
        lines.append(f"{plain(label):<{width}}  has no path in the file")
        markers.append({"name": label, "seen": 0.0, "first_m": None})
    if tracks.warning:
        lines.append(f"Warning: {plain(tracks.warning)}")
    return "\n".join(lines), {
        "file": str(path), "frames": len(time), "duration_s": length, "without_path": list(tracks.without_path),
        "file_doubt": tracks.warning or None, "markers": markers,
    }  # fmt: skip


def _millimetres(metres: float) -> str:
    """Return a length [m] to the millimetre, or in few digits where it is no length of a room."""
    return f"{metres:.3f}" if abs(metres) < FARTHEST_SHOWN else f"{metres:.3g}"


def describe_swatch(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="The garment description to write (.toml).")],
    mass: Annotated[float, typer.Option("--mass", metavar="KG", help="Its weight: weigh it.", show_default=False)],
    # m, and 81 markers: "Optimization of Cloth Simulation Parameters by Considering Static and Dynamic Features".
    side: Annotated[float, typer.Option("--side", metavar="METRES", help="Side of the square.")] = 0.5,
    # Of the same paper.
    markers: Annotated[int, typer.Option("--markers", help="Markers along each side, from edge to edge.")] = 9,
    anyway: Anyway = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")] = False,
) -> None:
    """Describe a square swatch with a full grid of markers, held at its two top corners."""
    from formats.descriptions import dump_description
    from formats.outputs import AS_GARMENT, check_name, check_place, refuse_to_replace, write_text
    from formats.plain_text import plain
    from formats.plausible import check_plausible_garment
    from formats.swatch import swatch

    check_name(path)
    refuse_to_replace(path, overwrite=overwrite)
    check_place(path, *AS_GARMENT)
    described = swatch(mass, side=side, markers=markers, name=plain(path.stem))
    if not anyway:
        check_plausible_garment(described, "--mass, --side", offers_anyway=True)
    write_text(path, dump_description(described), overwrite=overwrite)
    apart = 1e3 * side / (markers - 1)
    words = f"{plain(path)}: {markers * markers} markers, {apart:.1f} mm apart"
    tell(words, file=str(path), markers=markers * markers, apart_mm=apart)
