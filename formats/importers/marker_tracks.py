"""Marker paths of a motion capture system in memory, and as a plain CSV file.

One header line, then one line per frame, metres and seconds, an empty cell where a marker was not seen:

    time_s,row1_column1_x_m,row1_column1_y_m,row1_column1_z_m,row1_column2_x_m,...
    0.000000,0.0123,-0.2500,1.4800,...
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from formats.arrays import Floats, Integers
from formats.importers.units import axes_of
from formats.outputs import write_bytes
from formats.rows import spreadsheet_cell
from formats.unfinished import ANOTHER_FOLDER

MARKER_SD = 3e-4  # m, stated by us: optical systems with a dozen cameras keep 0.1 to 0.5 mm

EXPORT_MEASURED = "export it again with `Markers`, whose places cameras measured"


@dataclass(frozen=True)
class MarkerTracks:
    """Named marker paths: time [s], (frames,); positions [m], (frames, markers, 3), NaN where not seen.

    - `labels`: as the file has them, a subject's name before a colon included
    - `rate` [1/s]: what the file states besides the times, None where it states none
    - `has_times`: whether the file has a time for each frame, and not a frame rate alone
    - `doubt`: a sentence about a file that contradicts itself and was read all the same, '' where there is none
    - `without_path`: further names, of which the file has no path
    - `zeros`: how often three zeros stand for each marker, (markers,), which count as not seen; None if unknown
    - `expected`: further names, of which the file has no measured path, and another that a program computed
    """

    labels: tuple[str, ...]
    time: Floats
    positions: Floats
    rate: float | None = None
    doubt: str = ""
    has_times: bool = True
    without_path: tuple[str, ...] = ()
    expected: tuple[str, ...] = ()
    zeros: Integers | None = None

    def columns_named(self, name: str, subject: str = "") -> list[int]:
        """Return which markers have this name, of any subject where none is given."""
        return _columns_named(self.labels, name, subject)


@dataclass(frozen=True)
class Wanted:
    """The markers and frames of a file that somebody uses: damage to others matters to nobody.

    - `names`: of the markers, without their subjects; () for all
    - `subject`: whose markers, '' for any
    - `frames`: so many from the beginning, None for all
    """

    names: tuple[str, ...] = ()
    subject: str = ""
    frames: int | None = None

    def markers(self, labels: Sequence[str]) -> list[int]:
        """Return which markers are wanted; all where none of them has a wanted name."""
        plain = [label.strip() for label in labels]
        found = sorted({k for name in self.names for k in _columns_named(plain, name, self.subject)})
        return found or list(range(len(labels)))


ALL = Wanted()


def _columns_named(labels: Sequence[str], name: str, subject: str) -> list[int]:
    found = [k for k, label in enumerate(labels) if label == name and not subject]
    if found:
        return found
    return [
        k for k, label in enumerate(labels)
        if label.rpartition(":")[2] == name and (not subject or label.rpartition(":")[0] == subject)
    ]  # fmt: skip


def write_marker_csv(path: Path, tracks: MarkerTracks, *, overwrite: bool = True) -> Path:
    """Write marker paths as CSV, to 1 µm, whole or not at all; return the path.

    Raises:
        OutputError: it is there and may not be replaced, or cannot be written.
    """
    columns = ["time_s", *(spreadsheet_cell(label + axis) for label in tracks.labels for axis in axes_of("m"))]
    flat = tracks.positions.reshape(len(tracks.time), -1)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    numbers = ",".join(["%.6f"] * (1 + flat.shape[1])) + "\n"  # in one step: a step a number takes five times as long
    for time, row in zip(tracks.time, flat, strict=True):
        text.write((numbers % (time, *row.tolist())).replace("nan", ""))
    write_bytes(path, text.getvalue().encode(), overwrite=overwrite, instead=ANOTHER_FOLDER)
    return path
