"""`hangtime takes export`: write takes for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from formats.takes_cli import TakeFiles, end_with, refuse_a_target, refuse_the_same_name, refuse_twice
from formats.telling import tell, tell_entry

if TYPE_CHECKING:  # reading takes needs numpy, and --help does not
    from collections.abc import Callable

    from formats.errors import HangtimeError
    from formats.take import Take


class ExportKind(StrEnum):
    """File formats for the export of takes to other programs."""

    CSV = "csv"
    C3D = "c3d"
    NPZ = "npz"
    PARQUET = "parquet"
    RRD = "rrd"


def export_takes(
    paths: TakeFiles,
    to: Annotated[ExportKind, typer.Option("--to", help="File format.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="PATH", help="Folder for the files; with parquet, one file of all takes.")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")] = False,
) -> None:
    """Write takes for other programs.

    Marker trajectories become CSV or C3D, arrays NPZ. All takes become one Parquet table. The viewer Rerun plays RRD.
    Parquet needs the extra `parquet`, RRD the extra `rerun`.

    Exit code 2: at least one take cannot be exported. The others are exported, and the last lines name each lost take.
    """
    from msgspec import to_builtins

    from formats.archive import read_take
    from formats.errors import HangtimeError, TakeError
    from formats.exporters.arrays import write_npz, write_parquet
    from formats.exporters.marker_files import write_c3d, write_csv
    from formats.exporters.rerun_file import write_rrd
    from formats.fault_words import doubts_of, state_of_take
    from formats.missing import incomplete_words
    from formats.outputs import (
        AS_PARQUET,
        check_ending,
        check_folder_name,
        check_place,
        output_folder,
        refuse_an_input,
        refuse_to_replace,
    )
    from formats.plain_text import counted, plain

    writers: dict[ExportKind, Callable[..., str | None]] = {
        ExportKind.CSV: write_csv, ExportKind.C3D: write_c3d, ExportKind.NPZ: write_npz, ExportKind.RRD: write_rrd,
    }  # fmt: skip
    stems = [Path(path.name.removesuffix(".partial")).stem for path in paths]
    targets = [out if to is ExportKind.PARQUET else out / f"{stem}.{to.value}" for stem in stems]
    if to is not ExportKind.PARQUET:
        check_folder_name(out, f".{to.value}")
        refuse_the_same_name(paths, targets, "export one of them elsewhere")
    lost: dict[Path, HangtimeError] = {}
    if to is ExportKind.PARQUET:
        refuse_twice(paths)
        refuse_an_input(out, paths)
        check_ending(out, *AS_PARQUET, may_lack=True)
        check_place(out)
        refuse_to_replace(out, overwrite=overwrite)
        read: list[tuple[Path, Take]] = []
        for path in paths:
            try:
                read.append((path, read_take(path)))
            except TakeError as error:
                lost[path] = error
        if read:
            write_parquet(out, [take for _, take in read], overwrite=overwrite)
            lacking = {str(path): words for path, take in read if (words := incomplete_words(take))}
            notes = "".join(f"\n{plain(path)} {words}" for path, words in lacking.items())
            doubted = {str(path): found for path, take in read if (found := doubts_of(take))}
            notes += "".join(f"\n{plain(path)}: {doubt}" for path, found in doubted.items() for doubt in found)
            records = [
                {"file": str(path), "frames": len(take.time), **to_builtins(state_of_take(take))} for path, take in read
            ]
            tell(
                f"{plain(out)}: {counted(len(read), 'take')}{notes}", files=[str(out)], takes=records,
                incomplete=lacking, doubts=doubted,
            )  # fmt: skip
        end_with(lost, len(paths))
        return
    with output_folder(out):
        for path, target in zip(paths, targets, strict=True):
            try:
                refuse_a_target(target, paths, overwrite=overwrite)
                take = read_take(path)
                moved = writers[to](target, take, overwrite=overwrite)
            except HangtimeError as error:
                lost[path] = error
                continue
            notes = f"; {moved}" if moved else ""
            notes += f"; the take {words}" if (words := incomplete_words(take)) else ""
            notes += "".join(f"; {doubt}" for doubt in doubts_of(take))
            tell_entry(
                "files", f"{plain(target)}: {len(take.time)} frames{notes}", file=str(target), frames=len(take.time),
                moved=moved or None, **to_builtins(state_of_take(take)),
            )  # fmt: skip
        end_with(lost, len(paths))
