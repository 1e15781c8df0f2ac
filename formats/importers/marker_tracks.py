"""Marker trajectories of a motion capture system: in memory, and as a plain CSV file.

The CSV has one header line, then one line per frame, in metres and seconds. A cell is empty where a marker was not
seen:

    time_s,row1_column1_x_m,row1_column1_y_m,row1_column1_z_m,row1_column2_x_m,...
    0.000000,0.0123,-0.2500,1.4800,...
"""

from __future__ import annotations

import csv
import io
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from formats.arrays import Floats, Integers
from formats.importers.units import axes_of
from formats.outputs import write_bytes
from formats.rows import spreadsheet_cell
from formats.unfinished import ANOTHER_FOLDER

MARKER_SD = 3e-4  # m; our choice: optical systems with a dozen cameras keep 0.1 to 0.5 mm

EXPORT_MEASURED = "export it again with `Markers`, whose positions cameras measured"


@dataclass(frozen=True)
class MarkerTracks:
    """Named marker trajectories: time [s], (frames,); positions [m], (frames, markers, 3), NaN where not seen.

    - `labels`: names as in the file, including a subject's name before a colon
    - `rate` [1/s]: frame rate that the file states besides the times, None where it states none
    - `has_times`: whether the file has a time for each frame, rather than a frame rate only
    - `warning`: warnings about contradictions in a file that was read all the same, '' without any
    - `without_path`: names for which the file has no trajectory
    - `without_name`: number of trajectories for which the file has no name
    - `zeros`: how often each marker has three zero coordinates, read as not seen, (markers,); None if unknown
    - `expected`: names for which the file has only a computed trajectory, and no measured one
    - `overridden`: symbols of the units that the file states and that did not count
    - `has_unit`: whether the file states a unit of lengths
    - `named_unit` [s]: unit that the times' column states in Hangtime's own CSV, None in other files
    """

    labels: tuple[str, ...]
    time: Floats
    positions: Floats
    rate: float | None = None
    warning: str = ""
    has_times: bool = True
    without_path: tuple[str, ...] = ()
    without_name: int = 0
    expected: tuple[str, ...] = ()
    zeros: Integers | None = None
    named_unit: float | None = None
    overridden: tuple[str, ...] = ()
    has_unit: bool = True

    def columns_named(self, name: str, subject: str = "") -> list[int]:
        """Return the indices of the markers with this name, of one subject or, by default, of any."""
        return _columns_named(self.labels, name, subject)


@dataclass(frozen=True)
class Wanted:
    """The markers and frames of a file that are used; damage to the others is not reported.

    - `names`: names of the markers, without their subjects; () for all
    - `subject`: subject whose markers are used, '' for any
    - `frames`: number of frames from the beginning, None for all
    """

    names: tuple[str, ...] = ()
    subject: str = ""
    frames: int | None = None

    def markers(self, labels: Sequence[str]) -> list[int]:
        """Return the indices of the wanted markers, or of all markers where no label matches."""
        plain = [label.strip() for label in labels]
        found = sorted({k for name in self.names for k in _columns_named(plain, name, self.subject)})
        return found or list(range(len(labels)))


ALL = Wanted()


def composed(name: str) -> str:
    """Return a name with each accent in its letter: macOS writes letter and accent as two characters."""
    return unicodedata.normalize("NFC", name)


def nearest_label(labels: Sequence[str], name: str) -> str:
    """Return the first label that has the letters and digits of a name, without its subject; '' where none has."""
    return next((label for label in labels if _letters_of(label) == _letters_of(name)), "")


def _letters_of(label: str) -> str:
    """Return the letters and digits of a label without its subject, in one case."""
    return "".join(filter(str.isalnum, composed(label).rpartition(":")[2].casefold()))


def _columns_named(labels: Sequence[str], name: str, subject: str) -> list[int]:
    """Return the indices of labels that are the name, else of those that differ from it in subject or composition."""
    found = [k for k, label in enumerate(labels) if label == name and not subject]
    if found:
        return found
    name, subject = composed(name), composed(subject)
    parts = [composed(label).rpartition(":") for label in labels]
    whole = [k for k, part in enumerate(parts) if "".join(part) == name and not subject]
    return whole or [k for k, part in enumerate(parts) if part[2] == name and (not subject or part[0] == subject)]


def write_marker_csv(path: Path, tracks: MarkerTracks, *, overwrite: bool = True) -> Path:
    """Write marker trajectories as CSV, rounded to 1 µm and 1 µs, whole or not at all; return the path.

    Raises:
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    columns = ["time_s", *(spreadsheet_cell(label + axis) for label in tracks.labels for axis in axes_of("m"))]
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(columns)
    lines = chain([head.getvalue().encode()], _csv_lines(tracks))
    write_bytes(path, lines, overwrite=overwrite, instead=ANOTHER_FOLDER)
    return path


def _csv_lines(tracks: MarkerTracks) -> Iterator[bytes]:
    flat = tracks.positions.reshape(len(tracks.time), -1)
    numbers = ",".join(["%.6f"] * (1 + flat.shape[1])) + "\n"  # one format a row: five times faster than one a number
    for time, row in zip(tracks.time, flat, strict=True):
        yield (numbers % (time, *row.tolist())).replace("nan", "").encode()
