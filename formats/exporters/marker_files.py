"""Export a take's marker trajectories as CSV or C3D: its tracked points, and the held ends unless points sit there.

CSV has each frame's own time, exact to 1 µs, and positions exact to 1 µm. C3D has one frame rate for the whole file.
The writer moves a take's frames to the nearest multiple of the median interval, and reports the largest move. Missing
frames become gaps. Positions in C3D are 32-bit floats in millimetres.

In both formats three zeros stand for a marker that was not seen. So a point at the origin is written 1 µm beside it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.exporters.by_library import bytes_by_library
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.outputs import write_bytes
from formats.take import Take
from formats.unfinished import ANOTHER_FOLDER

HELD = ("held_left", "held_right")
ON_POINT = 1e-9  # m within which a held end is a tracked point
LATE = 0.25  # of an interval: largest move of a frame in a file with one rate
POINT_BYTES = 16  # of a point in a frame: three coordinates and a residual as floats (C3D user guide)
MOVED = 1e-4  # s: smaller moves of frames are not reported
FROM_ORIGIN = 1e-6  # m, the last digit of a coordinate in CSV
LONGEST_LABEL = 127  # bytes of UTF-8: ezc3d omits a longer label
MOST_C3D_FRAMES = 65535  # frames that a C3D file's header can state


def marker_tracks(take: Take) -> MarkerTracks:
    """Return the paths of a take's tracked points, from its first frame at 0 s."""
    labels, positions = list(take.garment.point_names), take.points
    apart = np.abs(take.held[:, :, None] - take.points[:, None]).max(3)
    alike = np.where(take.held_valid[:, :, None], apart < ON_POINT, True)  # a point that was not seen is not alike
    is_a_point = np.asarray(alike.all(axis=0)).any(axis=1) & np.asarray(take.held_valid.any(axis=0))
    for end, name in enumerate(HELD):
        if not is_a_point[end] and name not in labels:
            labels.append(name)
            positions = np.concatenate([positions, take.held[:, end : end + 1]], axis=1)
    return MarkerTracks(tuple(labels), take.time - take.time[0], positions)


def write_csv(path: Path, take: Take, *, overwrite: bool = True) -> None:
    """Write a take's marker trajectories as CSV (`hangtime import` reads it).

    Raises:
        TakeError: a name cannot be written so that the import returns it.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    tracks = marker_tracks(take)
    _refuse_odd_names(tracks, _whence(take))
    write_marker_csv(path, replace(tracks, positions=off_origin(tracks.positions)), overwrite=overwrite)


def off_origin(positions: Floats) -> Floats:
    """Return positions [m], (frames, markers, 3), without any that would be written as the three zeros of a gap."""
    at_origin = (np.abs(positions) < FROM_ORIGIN / 2).all(axis=2)
    if not at_origin.any():
        return positions
    moved = positions.copy()
    moved[at_origin, 2] = FROM_ORIGIN
    return moved


def _whence(take: Take) -> str:
    """Return the name of a take's file, or of the take where it has none."""
    return take.report.file if take.report and take.report.file else take.take_id


def _refuse_odd_names(tracks: MarkerTracks, where: str) -> None:
    """Refuse names that a marker file cannot store: with line breaks, control codes, or surrounding spaces."""
    for label in tracks.labels:
        if not label.isprintable() or label != label.strip():
            raise TakeError(
                f"the name {ascii(label)[:40]} has characters that no marker file keeps", where=where,
                advice="export it as NPZ",
            )  # fmt: skip


def write_c3d(path: Path, take: Take, *, overwrite: bool = True) -> str:
    """Write a take's marker trajectories as C3D, in millimetres; return a note on moved frames, '' for none.

    Raises:
        TakeError: the frames have no steady rate, or a name is longer than a C3D file can hold.
        ModuleNotFoundError: ezc3d is not installed.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    import ezc3d

    tracks = marker_tracks(take)
    rate, positions, moved = at_one_rate(tracks, _whence(take))
    positions = off_origin(positions)
    _refuse_odd_names(tracks, _whence(take))
    for label in tracks.labels:
        if len(label.encode()) > LONGEST_LABEL:
            raise TakeError(
                f"the name {label[:20]!r}... has {len(label.encode())} bytes, a C3D file holds {LONGEST_LABEL}",
                where=_whence(take), advice="export it as CSV",
            )  # fmt: skip
    file = ezc3d.c3d()
    points = file["parameters"]["POINT"]
    points["UNITS"]["value"], points["RATE"]["value"] = ["mm"], [rate]
    points["LABELS"]["value"] = list(tracks.labels)
    seen = np.asarray(np.isfinite(positions).all(2))
    values = np.ones((4, positions.shape[1], len(positions)))
    values[:3] = 1e3 * np.moveaxis(np.where(seen[..., None], positions, 0.0), (0, 1, 2), (2, 1, 0))
    file["data"]["points"] = values
    file["data"]["meta_points"]["residuals"] = np.where(seen.T[None], 0.0, -1.0)
    least = positions[..., 0].size * POINT_BYTES  # ezc3d says nothing of a disk that is full
    raw = bytes_by_library(lambda plain: file.write(str(plain)), "file.c3d", least=least)
    write_bytes(path, raw, overwrite=overwrite, instead=ANOTHER_FOLDER)
    return f"C3D has one rate, so frames were moved by up to {1e3 * moved:.1f} ms" if moved > MOVED else ""


def at_one_rate(tracks: MarkerTracks, where: str) -> tuple[float, Floats, float]:
    """Return a rate [1/s], positions, (frames, markers, 3), and how far a frame was moved at most [s].

    Positions are NaN for frames that are missing between the others.

    Raises:
        TakeError: a frame lies too far off a multiple of the median interval.
    """
    if len(tracks.time) < 2:
        raise TakeError("has one frame, and so no rate", where=where, advice="export it as CSV")
    interval = float(np.median(np.diff(tracks.time)))
    number = np.concatenate([[0], np.cumsum(np.rint(np.diff(tracks.time) / interval))]).astype(int)
    if len(number) > 2:
        interval = float(np.polyfit(number, tracks.time, 1)[0])
        number = np.rint((tracks.time - tracks.time[0]) / interval).astype(int)
    off = np.abs(tracks.time - tracks.time[0] - number * interval)
    if number[-1] >= MOST_C3D_FRAMES:
        raise TakeError(
            f"has {number[-1] + 1} frames, a C3D file {MOST_C3D_FRAMES} at most", where=where, advice="export it as CSV"
        )
    if (off > LATE * interval).any() or (np.diff(number) < 1).any():
        raise TakeError(
            f"its frames come at no steady rate (frame {int(off.argmax())} is {1e3 * off.max():.1f} ms off)",
            where=where, advice="export it as CSV, which has each frame's own time",
        )  # fmt: skip
    positions = np.full((number[-1] + 1, *tracks.positions.shape[1:]), np.nan)
    positions[number] = tracks.positions
    return 1 / interval, positions, float(off.max())
