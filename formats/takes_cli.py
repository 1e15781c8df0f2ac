"""`hangtime takes`: list, show, verify and recover take archives."""

from __future__ import annotations

import os
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from formats.telling import know, tell, tell_entry, tell_fault

if TYPE_CHECKING:  # reading takes needs numpy, and --help does not
    from collections.abc import Sequence

    from formats.errors import HangtimeError
    from formats.take import Take
    from formats.take_report import TakeReport

TakeFiles = Annotated[list[Path], typer.Argument(metavar="TAKE", help="Take archives (.mcap).")]


def add_takes_commands(takes: typer.Typer) -> None:
    """Add the commands to `hangtime takes`."""
    takes.command("list", short_help="List takes with length, motion and garment.")(list_takes)
    takes.command("show", short_help="Show what a take holds.")(show_takes)
    takes.command("verify")(verify_takes)
    takes.command("recover", short_help="Make a sound file of what a damaged take holds.")(recover_takes)


def list_takes(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder with takes; takes in folders below are listed too.")
    ],
) -> None:
    """List takes, finished and unfinished, with length, motion and garment. Exit code 2: one cannot be read."""
    from msgspec import to_builtins

    from formats.archive import read_with_report
    from formats.errors import TakeError
    from formats.fault_words import RECOVERS_EACH, faults, state_of_take
    from formats.files_below import files_below
    from formats.motion import kind_of
    from formats.plain_text import counted, plain
    from formats.system_causes import step_to_read
    from formats.whole_files import loop_words

    if not folder.is_dir():
        raise TakeError(
            loop_words(folder, "is no folder"), where=folder,
            advice="give a folder; `hangtime takes show` shows one take"
        )  # fmt: skip
    try:
        paths, locked = files_below(folder, ".mcap", ".mcap.partial")
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=folder, advice=step_to_read(error)) from error
    if not paths and not locked:
        raise TakeError("holds no takes", where=folder, advice="`hangtime record` and `hangtime import` make some")
    all_read = True
    for path in sorted([*paths, *locked]):
        try:
            take, report = read_with_report(path)
        except TakeError as error:
            _tell_lost("takes", path, error, is_row=True)
            all_read = False
            continue
        length = float(take.time[-1] - take.time[0])
        state = state_of_take(take)
        damaged = [f"{counted(report.damaged_blocks, 'block')} damaged"] if report.damaged_blocks else []
        rest = "".join(f"; {fault}" for fault in [*damaged, *faults(take, report)])
        rest += f"; {RECOVERS_EACH}" if report.other_takes else ""
        tell_entry(
            "takes",
            f"{state.state:<11} {plain(path.relative_to(folder))}: {length:.1f} s, {kind_of(take)}, "
            f"{plain(take.garment.name)}, {plain(take.created)}{rest}",
            file=str(path), duration_s=length, motion=kind_of(take), garment=take.garment.name, created=take.created,
            left=list(report.left), **to_builtins(state),
        )  # fmt: skip
    if not all_read:
        raise typer.Exit(2)


def show_takes(
    paths: Annotated[
        list[Path], typer.Argument(metavar="TAKE", help="Take archives (.mcap), or interrupted ones (.partial).")
    ],
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE.png", help="Also draw the paths of up to twelve tracked points."),
    ] = None,
    png: Annotated[Path | None, typer.Option("--png", metavar="FILE.png", help="The same as --plot.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")] = False,
) -> None:
    """Show the content of takes: length, rate, garment, how often each point was seen and how noisy it is.

    Exit code 2: at least one take cannot be read. The others are shown.
    """
    from formats.errors import OutputError, TakeError
    from formats.outputs import AS_PICTURE, check_place, refuse_an_input, refuse_to_replace
    from formats.plain_text import plain
    from formats.take_picture import draw_png

    if plot is not None and png is not None:
        raise OutputError("is the same as --plot", where="--png", advice="give one of the two")
    option, plot = ("--plot", plot) if png is None else ("--png", png)
    if plot is not None:
        if len(paths) > 1:
            raise OutputError("draws one take", where=option, advice=f"give one take, or leave out {option}")
        refuse_an_input(plot, paths)
        check_place(plot, *AS_PICTURE)
        refuse_to_replace(plot, overwrite=overwrite)
    is_alone, all_read = len(paths) == 1, True
    for path in paths:
        try:
            take, words, facts = _content(path)
        except TakeError as error:
            if is_alone:
                know(**_lost(path, error))
                raise
            _tell_lost("takes", path, error)
            all_read = False
            continue
        if not is_alone:
            tell_entry("takes", f"{plain(path)}\n{words}\n", file=str(path), **facts)
            continue
        tell(words, **facts)
        if plot is not None:
            draw_png(take, plot, overwrite=overwrite)
            tell(f"\nPicture: {plain(plot)}", plot=str(plot))
    if not all_read:
        raise typer.Exit(2)


def _content(path: Path) -> tuple[Take, str, dict[str, Any]]:
    """Return a take, and its content in words and as facts.

    Raises:
        TakeError: it cannot be read.
    """
    from formats.archive import read_with_report
    from formats.fault_words import RECOVERS, RECOVERS_EACH, behind, lost_scans, of_another, unread, unsettled
    from formats.plain_text import counted
    from formats.summary import describe, summarise
    from formats.take_picture import draw_in_letters

    take, report = read_with_report(path)
    summary = summarise(take)
    lost = f"\nlost      {lost_scans(report)}" if report.missing_scans else ""
    lost += f"\nnot read  {unread(report)}" if report.unread_blocks else ""
    lost += f"\ndamaged   {counted(report.damaged_blocks, 'block')}; {RECOVERS}" if report.damaged_blocks else ""
    lost += f"\nother     {of_another(report)}; {RECOVERS_EACH}" if report.other_takes else ""
    lost += f"\nbehind    {behind(report)}" if report.trailing_bytes else ""
    lost += "".join(f"\nleft      {one}" for one in unsettled(report))
    return take, f"{describe(summary)}{lost}\n\n{draw_in_letters(take)}", {**summary, "left": list(report.left)}


def verify_takes(paths: TakeFiles) -> None:
    """Read takes whole, checksums and all. Exit code 0: all sound; 2: at least one is damaged or incomplete."""
    from msgspec import to_builtins

    from formats.archive import read_with_report
    from formats.errors import TakeError
    from formats.fault_words import RECOVERS, RECOVERS_EACH, faults, state_of_take
    from formats.plain_text import counted, plain

    all_sound = True
    for path in paths:
        try:
            take, report = read_with_report(path)
        except TakeError as error:
            _tell_lost("takes", path, error, is_row=True)
            all_sound = False
            continue
        rest = f", {report.damaged_blocks} damaged" if report.damaged_blocks else ""
        rest += "".join(f"; {fault}" for fault in faults(take, report))
        state = state_of_take(take)
        if state.state in ("damaged", "incomplete") and not report.is_being_written:
            rest += f"; {RECOVERS_EACH if report.other_takes else RECOVERS}"
        held = f"{counted(report.frames, 'frame')} in {counted(report.blocks, 'block')}"
        words = f"{plain(path)}: {held}{rest}"
        tell_entry(
            "takes", f"{state.state:<11} {words}", file=str(path), frames=report.frames,
            blocks=report.blocks, left=list(report.left), **to_builtins(state),
        )  # fmt: skip
        if not report.is_sound:
            tell_fault(words)
            all_sound = False
    if not all_sound:
        raise typer.Exit(2)


def recover_takes(
    paths: TakeFiles,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the sound files.", show_default="beside each take"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")] = False,
) -> None:
    """Make a sound file, NAME.recovered.mcap, of every frame that a damaged or interrupted take still holds.

    A file may hold several takes, such as joined files. The other takes become NAME.recovered-2.mcap and so on.

    Exit code 2: at least one take cannot be read, or its sound file cannot be written. The others are still recovered.
    """
    from formats.outputs import check_folder_name, output_folder

    if out is not None:
        check_folder_name(out, ".mcap")
    names = [path.name.removesuffix(".partial").removesuffix(".mcap") for path in paths]
    targets = [(out or path.parent) / f"{name}.recovered.mcap" for path, name in zip(paths, names, strict=True)]
    refuse_the_same_name(paths, targets, "recover one of them into another --out")
    with output_folder(out) if out is not None else nullcontext():
        if not _recover_each(paths, targets, overwrite=overwrite):
            raise typer.Exit(2)


def _recover_each(paths: list[Path], targets: list[Path], *, overwrite: bool) -> bool:
    """Recover takes and report each; return whether all were written."""
    from formats.errors import HangtimeError
    from formats.take_reader import read_every_take

    all_written, is_alone = True, len(paths) == 1
    for path, target in zip(paths, targets, strict=True):
        try:
            refuse_a_target(target, paths, overwrite=overwrite)
            takes = read_every_take(path)
            free = [target, *(target.with_name(f"{target.stem}-{k}.mcap") for k in range(2, takes.count + 1))]
            for one in free[1:]:
                refuse_a_target(one, paths, overwrite=overwrite)
        except HangtimeError as error:
            _tell_not_recovered(path, error, is_alone=is_alone)
            all_written = False
            continue
        free.reverse()
        for number, found in enumerate(takes.each):
            try:
                if isinstance(found, HangtimeError):
                    raise found
                _recover(*found, free[-1], overwrite=overwrite, is_another=number > 0)
                free.pop()
            except HangtimeError as error:
                _tell_not_recovered(path, error, is_alone=is_alone)
                all_written = False
            del found  # before the next one is read
    return all_written


def refuse_a_target(target: Path, paths: list[Path], *, overwrite: bool) -> None:
    """Refuse an output file that is an input, or that exists and may not be replaced.

    Raises:
        OutputError: it is or does.
    """
    from formats.outputs import refuse_an_input, refuse_to_replace
    from formats.unfinished import ANOTHER_FOLDER

    refuse_an_input(target, paths, instead=ANOTHER_FOLDER)
    refuse_to_replace(target, overwrite=overwrite, instead=ANOTHER_FOLDER)


def tell_aside(partial: Path, aside: Path) -> None:
    """Report a file in the way of a take or its descriptions that was renamed out of the way."""
    from formats.plain_text import plain

    words = f"{plain(partial)}: was in the way, and is put aside as {plain(aside.name)}"
    tell_entry("put_aside", words, file=str(partial), put_aside=str(aside))


def _tell_not_recovered(path: Path, error: HangtimeError, *, is_alone: bool) -> None:
    """Report why a take is not recovered; raise the error where its file is the only one and cannot be written."""
    from formats.errors import OutputError

    if is_alone and isinstance(error, OutputError):
        know(takes=[_lost(path, error)])
        raise error
    _tell_lost("takes", path, error)


def _tell_lost(name: str, path: Path, error: HangtimeError, *, is_row: bool = False) -> None:
    """Report a take that cannot be read or written; is_row: as a row below the states of others."""
    entry = _lost(path, error)
    tell_entry(name, f"{entry['state']:<11} {error}" if is_row else f"{entry['state']}: {error}", **entry)
    tell_fault(str(error))


def _lost(path: Path, error: HangtimeError) -> dict[str, str | None]:
    """Return the record of a take that cannot be read or written; one that is still being written is not `lost`."""
    from formats.errors import OutputError, TakeBegunError

    state = "not written" if isinstance(error, OutputError) else "lost"
    state = "begun" if isinstance(error, TakeBegunError) else state
    return {"file": str(path), "state": state, "error": str(error)}


def _recover(take: Take, report: TakeReport, target: Path, *, overwrite: bool, is_another: bool) -> None:
    from msgspec import to_builtins

    from formats.archive import write_take
    from formats.fault_words import EARLIER, STILL_WRITTEN, lost_scans, state_of_take, unread
    from formats.outputs import no_empty_folder, unwritable
    from formats.plain_text import plain, shortened
    from formats.take_writer import with_room
    from formats.unfinished import ANOTHER_FOLDER

    try:
        with no_empty_folder(target.parent):
            kept = with_room(take)
            write_take(target, kept, overwrite=overwrite, instead=ANOTHER_FOLDER, tell_aside=tell_aside)
    except OSError as error:
        raise unwritable(target, error) from error
    state = state_of_take(take)
    notes = f"missing: {state.missing}" if state.missing else "nothing is missing"
    notes += f"; lost: {lost_scans(report)}" if report.missing_scans else ""
    notes += f"; {unread(report)}" if report.unread_blocks else ""
    notes += "".join(f"; {doubt}" for doubt in report.doubts)
    notes += f"; {STILL_WRITTEN}, and recover it again" if report.is_being_written else ""
    notes += "; its longest note is cut, since a header has no more room" if kept is not take else ""
    notes += f"; {EARLIER}{report.earlier_doubts}" if report.earlier_doubts else ""
    of = f" of another take in this file, {plain(shortened(take.take_id))}" if is_another else ""
    tell_entry(
        "takes", f"{plain(target)}: {len(take.time)} frames{of}, {notes}", file=str(target), frames=len(take.time),
        **to_builtins(state),
    )  # fmt: skip


def refuse_the_same_name(paths: Sequence[Path], targets: Sequence[Path], advice: str) -> None:
    """Before anything is written, refuse output files of which one would replace another.

    Raises:
        OutputError: two files would have one name.
    """
    from formats.errors import OutputError

    for target in dict.fromkeys(targets):
        same = [path for path, one in zip(paths, targets, strict=True) if one == target]
        refuse_twice(same)
        if len(same) > 1:
            raise OutputError(f"two takes would become {target.name}", where=same[0], advice=advice)


def refuse_twice(paths: Sequence[Path]) -> None:
    """Refuse a file that was given twice, whatever its names.

    Raises:
        OutputError: one was.
    """
    from formats.errors import OutputError

    files = [os.path.realpath(path) for path in paths]
    for path, file in zip(paths, files, strict=True):
        if files.count(file) > 1:
            raise OutputError("was given twice", where=path, advice="give it once")


def end_with(lost: dict[Path, HangtimeError], asked: int) -> None:
    """Name the takes that failed, and end with exit code 2 if there are any.

    Raises:
        HangtimeError: the only take failed.
        typer.Exit: some failed.
    """
    for path, error in lost.items():
        if asked == 1:
            know(lost=[_lost(path, error)])
            raise error
        _tell_lost("lost", path, error)
    if lost:
        raise typer.Exit(2)
