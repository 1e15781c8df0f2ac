"""Read marker trajectories from the files of motion capture systems: C3D, TRC, and CSV and TSV of several makes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from formats.importers.folders import refuse_folder
from formats.importers.foreign_files import refuse_foreign
from formats.importers.marker_text import read_marker_text
from formats.importers.marker_tracks import ALL, MarkerTracks, Wanted
from formats.importers.number_cells import DECIMALS
from formats.importers.units import GivenUnit
from formats.plain_text import counted
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

FILE_ENDINGS = (".c3d", ".trc", ".csv", ".tsv", ".txt")
COMMANDS_FOR = {
    ".mcap": "`hangtime takes show` shows what a take holds",
    ".partial": "`hangtime takes show` shows what an interrupted recording holds",
    ".npz": "`hangtime import` makes a take of arrays, and `hangtime takes show` shows it",
}


def read_marker_tracks(
    path: Path, unit: str | None = None, decimal: str = "", wanted: Wanted = ALL, *, anyway: bool | None = None
) -> MarkerTracks:
    """Read the marker trajectories of one file.

    - `unit`: unit of the file's lengths, needed where the file states none
    - `anyway`: whether `unit` counts where the file states another; None: refuse it, and offer no --anyway
    - `decimal`: decimal separator of a text file, `comma` or `point`; '' to detect it
    - `wanted`: markers and frames to check and convert; the other markers keep their names only

    Raises:
        TakeError: the file is missing, malformed, of another kind, or shorter than it says; a library is not installed.
    """
    refuse_folder(path, FILE_ENDINGS)
    try:
        check_ends(path)
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    kind = path.suffix.lower()
    if kind not in FILE_ENDINGS:
        advice = f"give {', '.join(FILE_ENDINGS)}"
        raise TakeError(
            f"{kind or 'a file without ending'} is not a marker file", where=path,
            advice="; ".join([*([COMMANDS_FOR[kind]] if kind in COMMANDS_FOR else []), advice]),
        )  # fmt: skip
    if decimal not in ("", *DECIMALS):
        raise TakeError(f"there is no decimal separator {decimal!r}", where="--decimal", advice="give comma or point")
    if decimal and kind == ".c3d":
        raise TakeError(
            f"is for text, and {path.name} is none", where="--decimal",
            advice="leave out --decimal, or import that file by itself",
        )  # fmt: skip
    try:
        refuse_foreign(path)
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    given = None if unit is None else GivenUnit(unit, anyway)
    if kind == ".c3d":
        tracks = read_c3d(path, given, wanted)
    else:
        tracks = read_marker_text(path, given, DECIMALS.get(decimal, ""), wanted)
    if not np.isfinite(tracks.positions).any():
        whose = "none of the garment's markers" if wanted.names else "no marker"
        when = "ever seen" if wanted.frames is None else f"seen in the first {counted(len(tracks.time), 'frame')}"
        because = f": {tracks.warning}" if tracks.warning else ""
        paths = "export their trajectories" if wanted.names else "export the trajectories, not only their names"
        raise TakeError(
            f"{whose} was {when}{because}", where=path,
            advice="export all their coordinates" if tracks.warning else paths,
        )  # fmt: skip
    if given is not None and given.overridden:
        box = np.nanmax(tracks.positions, (0, 1)) - np.nanmin(tracks.positions, (0, 1))
        told = given.warning_of(float(box.max()))
        warning = "; ".join(filter(None, [told, tracks.warning]))
        return replace(tracks, warning=warning, overridden=tuple(given.overridden))
    return tracks if given is None else replace(tracks, has_unit=not given.is_alone)
