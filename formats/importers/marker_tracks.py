"""Marker paths of a motion capture system, from C3D or CSV files.

C3D is read with ezc3d (https://github.com/pyomeca/ezc3d; format: https://www.c3d.org): labels `POINT:LABELS`, rate
`POINT:RATE`, unit `POINT:UNITS`; a point with a negative residual, or at exactly zero, was not seen. A subject's name
before a colon (`Swatch:row1_column1`) is left out.

CSV: one header line, then one line per frame, metres and seconds, an empty cell where a marker was not seen:

    time_s,row1_column1_x_m,row1_column1_y_m,row1_column1_z_m,row1_column2_x_m,...
    0.000000,0.0123,-0.2500,1.4800,...
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.whole_files import write_whole

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
AXES = ("_x_m", "_y_m", "_z_m")


@dataclass(frozen=True)
class MarkerTracks:
    """Named marker paths: time [s], (frames,); positions [m], (frames, markers, 3), NaN where not seen."""

    labels: tuple[str, ...]
    time: Floats
    positions: Floats


def read_marker_tracks(path: Path) -> MarkerTracks:
    """Read a `.c3d` or `.csv` file.

    Raises:
        TakeError: the file is missing, malformed, or of another kind; ezc3d is not installed.
    """
    if not path.is_file():
        raise TakeError("cannot be read (no such file)", where=path, advice="check the path")
    kind = path.suffix.lower()
    if kind not in (".c3d", ".csv"):
        raise TakeError(f"{kind or 'a file without ending'} is not a marker file", where=path, advice="give .c3d, .csv")
    tracks = _read_c3d(path) if kind == ".c3d" else _read_csv(path)
    doubled = sorted({label for label in tracks.labels if tracks.labels.count(label) > 1})
    if doubled:
        raise TakeError(f"the marker {doubled[0]!r} comes twice", where=path, advice="rename one and export again")
    return tracks


def write_marker_csv(path: Path, tracks: MarkerTracks) -> Path:
    """Write marker paths as CSV, to 10 µm, whole or not at all; return the path.

    Raises:
        OSError: it cannot be written.
    """
    columns = ["time_s", *(label + axis for label in tracks.labels for axis in AXES)]
    flat = tracks.positions.reshape(len(tracks.time), -1)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for time, row in zip(tracks.time, flat, strict=True):
        writer.writerow([f"{time:.6f}", *("" if np.isnan(value) else f"{value:.5f}" for value in row)])
    write_whole(path, text.getvalue().encode())
    return path


def _read_csv(path: Path) -> MarkerTracks:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for line in csv.reader(file) if line]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TakeError(f"cannot be read ({error})", where=path, advice="export it as comma-separated text") from error
    head = lines[0] if lines else []
    labels = tuple(name.removesuffix(AXES[0]) for name in head[1::3])
    if not labels or head != ["time_s", *(label + axis for label in labels for axis in AXES)]:
        raise TakeError(
            "the first line does not name the columns",
            where=path,
            advice="it must be time_s,NAME_x_m,NAME_y_m,NAME_z_m,... for each marker",
        )
    values = np.full((len(lines) - 1, len(head)), np.nan)
    for number, line in enumerate(lines[1:]):
        if len(line) != len(head):
            raise TakeError(
                f"line {number + 2} has {len(line)} columns, not {len(head)}", where=path, advice="mend that line"
            )
        try:
            values[number] = [float(cell) if cell.strip() else np.nan for cell in line]
        except ValueError as error:
            raise TakeError(f"line {number + 2}: {error}", where=path, advice="mend that line") from error
    return MarkerTracks(labels, values[:, 0], values[:, 1:].reshape(len(values), len(labels), 3))


def _read_c3d(path: Path) -> MarkerTracks:
    try:
        import ezc3d
    except ModuleNotFoundError as error:
        raise TakeError(
            "C3D files need ezc3d, which is not installed",
            where=path,
            advice="in Hangtime's checkout: pip install -e '.[mocap]'",
        ) from error
    try:
        data: Any = ezc3d.c3d(str(path))
        points = data["parameters"]["POINT"]
        unit = str(points["UNITS"]["value"][0]).strip() if points["UNITS"]["value"] else ""
        rate = float(points["RATE"]["value"][0])
        labels = [str(label).strip().split(":")[-1] for label in points["LABELS"]["value"]]
        values = np.asarray(data["data"]["points"][:3], float)
        residuals = np.asarray(data["data"]["meta_points"]["residuals"][0], float)
    except (OSError, KeyError, IndexError, ValueError, RuntimeError) as error:
        raise TakeError(f"is no C3D file that can be read ({error})", where=path, advice="export it again") from error
    if unit not in METRES:
        raise TakeError(f"the unit of its points is {unit!r}", where=path, advice=f"export in {', '.join(METRES)}")
    if not rate > 0 or not labels or len(labels) != values.shape[1]:
        raise TakeError("has no marker paths", where=path, advice="export trajectories, not only analogue data")
    positions = np.moveaxis(values, 0, -1).swapaxes(0, 1) * METRES[unit]
    is_absent = (residuals.T < 0) | (positions == 0).all(2) | ~np.isfinite(positions).all(2)
    positions[is_absent] = np.nan
    return MarkerTracks(tuple(labels), np.asarray(np.arange(len(positions)) / rate, float), positions)
