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
from formats.exporters.c3d_writer import c3d_pieces
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.outputs import write_bytes
from formats.take import Take
from formats.unfinished import ANOTHER_FOLDER

HELD = ("held_left", "held_right")
FRAMES_AT_ONCE = 1 << 12  # compared at once: 8 MB for 81 points
# m within which a held end is a tracked point. Our choice: rounding alone; a marker's position is known to 0.1 mm at
# best.
ON_POINT = 1e-9
LATE = 0.25  # of an interval: largest move of a frame in a file with one rate
LEAST_MOVED = 1e-4  # s: smaller moves of frames are not reported
FROM_ORIGIN = 1e-6  # m, the last digit of a coordinate in CSV
LONGEST_LABEL = 127  # bytes of UTF-8: readers that take the length for a signed byte lose a longer label
# Frames. A header of 65535 says that a file may hold more, so ezc3d reads the rest of the last block as a frame.
MOST_C3D_FRAMES = 65534


def marker_tracks(take: Take) -> MarkerTracks:
    """Return the paths of a take's tracked points, from its first frame at 0 s.

    Raises:
        TakeError: the take has no frame.
    """
    if len(take.time) == 0:
        raise TakeError("holds no frame", where=_whence(take), advice="export a take with a frame or more")
    labels, positions = list(take.garment.point_names), take.points
    ends = [end for end, name in enumerate(HELD) if name not in labels and not _is_a_point(take, end)]
    if ends:
        labels += [HELD[end] for end in ends]
        positions = np.concatenate([positions, take.held[:, ends]], axis=1)
    return MarkerTracks(tuple(labels), take.time - take.time[0], positions)


def _is_a_point(take: Take, end: int) -> bool:
    """Return whether a held end, wherever it was seen, is one of the tracked points; one not seen is not alike."""
    seen = np.flatnonzero(take.held_valid[:, end])
    may_be = np.full(take.points.shape[1], len(seen) > 0)
    for begin in range(0, len(seen), FRAMES_AT_ONCE):
        some = seen[begin : begin + FRAMES_AT_ONCE]
        apart = np.abs(take.points[some][:, may_be] - take.held[some, end][:, None])
        may_be[may_be] = (apart < ON_POINT).all(axis=(0, 2))
    return bool(may_be.any())


def write_csv(path: Path, take: Take, *, overwrite: bool = True) -> None:
    """Write a take's marker trajectories as CSV (`hangtime import` reads it).

    Raises:
        TakeError: the take has no frame, or a name cannot be written so that the import returns it.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    tracks = marker_tracks(take)
    _refuse_odd_names(tracks, _whence(take))
    write_marker_csv(path, replace(tracks, positions=off_origin(tracks.positions)), overwrite=overwrite)


def off_origin(positions: Floats) -> Floats:
    """Return positions [m], (frames, markers, 3), without any that would be written as the three zeros of a gap."""
    at_origin = ((positions < FROM_ORIGIN / 2) & (positions > -FROM_ORIGIN / 2)).all(axis=2)
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
        TakeError: the take has no frame, its frames have no steady rate, or a name is longer than a C3D file can hold.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
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
    try:
        pieces = c3d_pieces(tracks.labels, positions, rate)
    except ValueError as error:
        raise TakeError(f"{error}, which no C3D file holds", where=_whence(take), advice="export it as CSV") from error
    write_bytes(path, pieces, overwrite=overwrite, instead=ANOTHER_FOLDER)
    return f"C3D has one rate, so frames were moved by up to {1e3 * moved:.1f} ms" if moved > LEAST_MOVED else ""


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
    if number[-1] + 1 == len(number):
        return 1 / interval, tracks.positions, float(off.max())
    positions = np.full((number[-1] + 1, *tracks.positions.shape[1:]), np.nan)
    positions[number] = tracks.positions
    return 1 / interval, positions, float(off.max())
