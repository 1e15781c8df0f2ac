"""Marker paths of a motion capture system in memory, and as a plain CSV file.

One header line, then one line per frame, metres and seconds, an empty cell where a marker was not seen:

    time_s,row1_column1_x_m,row1_column1_y_m,row1_column1_z_m,row1_column2_x_m,...
    0.000000,0.0123,-0.2500,1.4800,...

In every format, a marker at exactly (0, 0, 0), or with a coordinate that is no number, was not seen. A sign such
as -9999 or NDI's -3.697314e28 stands in all three coordinates. It has three nines or more and no other digit, or is
1e6 of any unit or more. It lies twice as far out as any other number.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats
from formats.importers.units import axes_of
from formats.outputs import write_bytes
from formats.plain_text import counted
from formats.rows import spreadsheet_cell
from formats.unfinished import ANOTHER_FOLDER

MARKER_SD = 3e-4  # m, stated by us: optical systems with a dozen cameras keep 0.1 to 0.5 mm
FARTHER_OUT = 2.0  # times as far as any other coordinate lies a number that stands for a marker that was not seen
NINES = re.compile(r"-?9{3,}(\.9+)?")
BEYOND_ALL = 1e6  # of any unit: no place is 1000 m away
MOST_SIGNS = 3  # of which each is told


@dataclass(frozen=True)
class MarkerTracks:
    """Named marker paths: time [s], (frames,); positions [m], (frames, markers, 3), NaN where not seen.

    - `labels`: as the file has them, a subject's name before a colon included
    - `rate` [1/s]: what the file states besides the times, None where it states none
    - `has_times`: whether the file has a time for each frame, and not a frame rate alone
    - `doubt`: a sentence about a file that contradicts itself and was read all the same, '' where there is none
    """

    labels: tuple[str, ...]
    time: Floats
    positions: Floats
    rate: float | None = None
    doubt: str = ""
    has_times: bool = True

    def columns_named(self, name: str, subject: str = "") -> list[int]:
        """Return which markers have this name, of any subject where none is given."""
        found = [k for k, label in enumerate(self.labels) if label == name and not subject]
        if found:
            return found
        return [
            k for k, label in enumerate(self.labels)
            if label.rpartition(":")[2] == name and (not subject or label.rpartition(":")[0] == subject)
        ]  # fmt: skip


def as_seen(positions: Floats, absent: Booleans | None = None) -> Floats:
    """Return positions, (frames, markers, 3), with NaN for each marker that was not seen."""
    gone = (positions == 0).all(2) | ~np.isfinite(positions).all(2)
    if absent is not None:
        gone |= absent
    return np.where(gone[..., None], np.nan, positions)


def take_out_signs(places: Floats, metres: Floats, name: Callable[[int], str]) -> str:
    """Take out the places that are one number for all coordinates, far out; return a sentence on them.

    - `places` [m], (frames, markers, 3), NaN where not seen; `metres`: of the unit that each marker's had, (markers,)
    - `name`: names the line or the frame of a place in the file
    """
    same = (places[..., 0] == places[..., 1]) & (places[..., 1] == places[..., 2])
    if not same.any():
        return ""
    others = [np.abs(places[..., axis][~same & np.isfinite(places[..., axis])]) for axis in range(3)]
    farthest = max(float(one.max(initial=0)) for one in others)
    frames, markers = np.nonzero(same & (np.abs(places[..., 0]) > FARTHER_OUT * farthest) & (farthest > 0))
    words = [f"{number:.7g}" for number in (places[frames, markers, 0] / metres[markers]).tolist()]  # all of 4 bytes
    found = [k for k, word in enumerate(words) if abs(float(word)) >= BEYOND_ALL or NINES.fullmatch(word)]
    frames, signs = frames[found], [words[k] for k in found]
    places[frames, markers[found]] = np.nan
    return "; ".join(
        f"{sign} stands in all three coordinates of a marker {counted(count, 'time')}, first in "
        f"{name(int(frames[signs.index(sign)]))}, and counts as not seen"
        for sign, count in Counter(signs).most_common(MOST_SIGNS)
    )


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
