"""Read marker paths from the files that motion capture systems export: C3D, TRC, CSV and TSV of several makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_text import read_marker_text
from formats.importers.marker_tracks import MarkerTracks
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

FILE_ENDINGS = (".c3d", ".trc", ".csv", ".tsv", ".txt")


def read_marker_tracks(path: Path, unit: str | None = None) -> MarkerTracks:
    """Read a file of marker paths; unit: of its lengths, where the file states none.

    Raises:
        TakeError: the file is missing, malformed, of another kind, or shorter than it says; a library is not installed.
    """
    if path.is_dir():
        raise TakeError("is a folder", where=path, advice="give the files in it")
    try:
        check_ends(path)
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    kind = path.suffix.lower()
    if kind not in FILE_ENDINGS:
        raise TakeError(
            f"{kind or 'a file without ending'} is not a marker file", where=path,
            advice=f"give {', '.join(FILE_ENDINGS)}",
        )  # fmt: skip
    tracks = read_c3d(path, unit) if kind == ".c3d" else read_marker_text(path, unit)
    if not np.isfinite(tracks.positions).any():
        raise TakeError("no marker was ever seen", where=path, advice="export the trajectories, not only their names")
    return tracks
