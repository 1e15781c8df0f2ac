"""Read marker trajectories from C3D files (https://www.c3d.org), in Intel, DEC and SGI byte order.

A frame has four numbers for each point, 16-bit integers or floats. Three are the position. The fourth is negative where
the point was not seen. The frame's analogue values follow and are skipped. `c3d_layout` finds the frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.errors import TakeError
from formats.importers.c3d_blocks import (
    Blocks,
    find_blocks,
    refuse_lost_bytes,
    remove_blocks,
)
from formats.importers.c3d_doubled import FrameBytes, refuse_doubled_bytes
from formats.importers.c3d_header import first_of
from formats.importers.c3d_layout import FASTEST_RATE, Header, Layout, read_header
from formats.importers.c3d_more_frames import warning_of_more_frames
from formats.importers.c3d_moved_frames import warning_of_moved_frames
from formats.importers.c3d_parameters import FLOAT, SHORT, Parameters, numbers_of
from formats.importers.c3d_shifts import refuse_shifted_frames
from formats.importers.c3d_wraps import remove_wrapped
from formats.importers.marker_exchanges import remove_exchanged
from formats.importers.marker_outliers import remove_jumps
from formats.importers.marker_tracks import ALL, MarkerTracks, Wanted
from formats.importers.missing_values import (
    are_at_bound,
    are_incomplete,
    are_lowest,
    are_zeros,
    as_seen,
    remove_missing_value_codes,
    warning_of_bound,
    warning_of_incomplete,
    warning_of_lowest,
    warning_of_zeros,
)
from formats.importers.number_cells import CELL_SHOWN
from formats.importers.units import GivenUnit, metres_of
from formats.plain_text import counted, first_few, sized
from formats.plausible import USABLE_RATES

LARGEST_C3D = 1 << 30  # bytes; our choice: memory; two hours of 40 markers at 200 frames a second have 0.9 GB
# bytes of the data that are converted to positions at once. Our choice: bounds memory, and the positions are the
# same.
CONVERTED_AT_ONCE = 1 << 22
TEXTS = ("LABELS", "UNITS")  # of each point
CONTINUED_BY = ("", *map(str, range(2, 10)))  # behind the name of a parameter that would be longer than 255 texts


def read_c3d(path: Path, unit: GivenUnit | str | None, wanted: Wanted = ALL) -> MarkerTracks:
    """Read the marker trajectories of a C3D file.

    - `unit`: unit of lengths, needed where the file states none
    - `wanted`: markers and frames to check and convert

    Raises:
        TakeError: the file is malformed, shorter than its header says, or holds no marker trajectories.
    """
    size = path.stat().st_size
    if size > LARGEST_C3D:
        raise TakeError(f"has {sized(size)}, which no C3D file has", where=path, advice="check the path")
    header, parameters = read_header(path, size)
    layout, rate = header.layout, _rate(parameters, header)
    labels, units = (
        [text for part in CONTINUED_BY for text in parameters.texts("POINT", name + part)] for name in TEXTS
    )
    _refuse_two_values(parameters, path)
    points = layout.points
    frames = min(header.held, layout.frames)
    if header.lacking is not None and not (points and frames > 0):
        raise header.lacking
    if points and frames <= 0 and header.held:
        raise TakeError(
            f"states {frames} frames and has room for {header.held} of its {points} points", where=path,
            advice="export it again",
        )  # fmt: skip
    if not points or frames <= 0:
        raise _without_paths(layout, parameters, path)
    if not 0 < rate <= FASTEST_RATE:
        states = f"states {rate:g} frames a second; {USABLE_RATES}" if rate > 0 else "states no frame rate above 0"
        raise TakeError(states, where=path, advice="export it again with its frame rate")
    end, kind = layout.data_at + frames * layout.width, FLOAT if layout.is_float else SHORT
    blocks = find_blocks(path, layout.data_at, frames * layout.width, layout.width)
    within = FrameBytes(layout.data_at, end, header.end, layout.width, kind, points, header.processor)
    repeated, cycle, more = _refuse_moved_bytes(path, size, header, within, wanted, blocks)
    has_labels, without_name = any(labels), points - sum(map(bool, labels[:points]))
    # Labels beyond the number of points name no point, and may be empty. Points beyond the labels have no name.
    without_path = tuple(filter(None, labels[points:]))
    labels = [*labels[:points], *(f"unlabelled_{k}" for k in range(len(labels), points))]
    if wanted.names and not has_labels and not set(wanted.names) & set(labels):  # `takes labels` lists those made up
        raise TakeError(
            f"has the trajectories of {counted(points, 'point')} and no label", where=path,
            advice="label the markers, and export it again",
        )  # fmt: skip
    others = np.setdiff1d(np.arange(points), wanted.markers(labels))
    scale, doubt = _scale(units, points, unit, path, others)
    time = np.asarray(np.arange(frames)[: wanted.frames] / rate, float)
    positions, gaps = _places(path, header, len(time), scale)
    positions[:, others] = np.nan
    gaps.forget(others)
    _refuse_infinity(gaps.infinite, labels, path)

    def frame_of(at: int) -> str:
        return f"frame {at + 1}"

    warnings = [header.doubts, doubt, repeated]
    if wanted.frames is None or wanted.frames > frames:
        warnings.append(more)
    if not wanted.names or any(label.rpartition(":")[2] in wanted.names for label in without_path):
        warnings.append(_warning_of_names(points, without_path))
    warnings += [
        warning_of_lowest(gaps.lowest, frame_of),
        warning_of_bound(gaps.bound, labels, frame_of),
        remove_missing_value_codes(positions, scale, frame_of),
    ]
    warnings.append(remove_blocks(positions, blocks, kind, layout.width, others))
    if not layout.is_float:
        warnings.append(remove_wrapped(positions, scale * abs(header.scale), labels, frame_of))
    warnings += [
        warning_of_incomplete(gaps.lacking, time, labels, frame_of),
        remove_exchanged(time, positions, labels, frame_of) or cycle,
        remove_jumps(time, positions, labels, frame_of),
        warning_of_moved_frames(positions, rate, frame_of),
    ]
    warnings.append(warning_of_zeros(gaps.zeros, positions, labels, frame_of))
    return MarkerTracks(
        tuple(labels), time, positions, header.rate, "; ".join(filter(None, warnings)), has_times=False,
        without_path=without_path, without_name=without_name, zeros=gaps.zeros.sum(0),
    )  # fmt: skip


def _without_paths(layout: Layout, parameters: Parameters, path: Path) -> TakeError:
    """Return the error of a file without points or without frames; `layout`: of its frames."""
    counts = [counted(layout.points, "point"), counted(max(layout.frames, 0), "frame")]
    rotations = int(max(first_of(parameters.numbers("ROTATION", "USED")), 0))
    if rotations:
        counts.append(counted(rotations, "rotation"))
    others = ["analogue data"] * (layout.analogue > 0) + ["rotations"] * (rotations > 0)
    return TakeError(
        f"has no marker paths ({', '.join(counts)})", where=path,
        advice="export trajectories" + f", not only {' and '.join(others)}" * bool(others),
    )  # fmt: skip


def _refuse_moved_bytes(
    path: Path, size: int, header: Header, frames: FrameBytes, wanted: Wanted, blocks: Blocks
) -> tuple[str, str, str]:
    """Refuse a file whose frames are shifted, or which lacks bytes.

    Return warnings of frames that come twice, of labels exchanged in a cycle, and of frames behind the last stated one.
    """
    repeated = "" if header.lacking is not None else refuse_doubled_bytes(path, frames)
    cycle = refuse_shifted_frames(path, frames, min(frames.stated, wanted.frames or frames.stated), blocks)
    if header.lacking is not None:
        raise header.lacking
    more = "" if repeated else warning_of_more_frames(path, frames, header.held)
    if header.end == size and not (more and (size - frames.end) % frames.width == 0):
        refuse_lost_bytes(path, size, frames.end)
    return repeated, cycle, more


def _refuse_two_values(parameters: Parameters, path: Path) -> None:
    """Refuse two values of a parameter that the header does not repeat, and that changes names, lengths or times."""
    names = {name + part for name in TEXTS for part in CONTINUED_BY} | {"RATE"}
    if twice := sorted(name for group, name in parameters.differ if group == "POINT" and name in names):
        raise TakeError(
            f"states POINT:{twice[0]} twice, with two values", where=path,
            advice="export it again, or remove the parameter that is not valid",
        )  # fmt: skip


def _warning_of_names(points: int, without_path: tuple[str, ...]) -> str:
    """Return a warning of labels for which the file has no point, '' without any."""
    if not without_path:
        return ""
    count = len(without_path)
    named = first_few([repr(label[:CELL_SHOWN]) for label in without_path], count)
    return (
        f"the file names {points + count} markers and has the paths of {points}; {named} "
        f"{'has' if count == 1 else 'have'} none"
    )


def _refuse_infinity(infinite: Booleans, labels: list[str], path: Path) -> None:
    """Refuse positions with an infinite coordinate, as in a text; `infinite`: whether one has, (frames, points)."""
    if infinite.any():
        frame, point = np.argwhere(infinite)[0].tolist()
        more = f", the first of {infinite.sum()} such positions" if infinite.sum() > 1 else ""
        raise TakeError(
            f"frame {frame + 1} holds inf, which is no number, for {labels[point][:CELL_SHOWN]}{more}", where=path,
            advice="export it again, with markers that were not seen as NaN or with a negative residual",
        )  # fmt: skip


@dataclass(frozen=True)
class _Gaps:
    """Why positions count as not seen, or are refused, without a flag of the file; each (frames, points).

    - `lacking`: one or two coordinates are missing; `zeros`: all three are zero
    - `lowest`: all three are the lowest integer; `infinite`: one is infinite
    - `bound`: one of three, which are not all the lowest, is at a bound of the integers
    """

    lacking: Booleans
    zeros: Booleans
    lowest: Booleans
    infinite: Booleans
    bound: Booleans

    def forget(self, points: Integers) -> None:
        """Forget the gaps of unused points."""
        for found in (self.lacking, self.zeros, self.lowest, self.infinite, self.bound):
            found[:, points] = False


def _places(path: Path, header: Header, frames: int, scale: Floats) -> tuple[Floats, _Gaps]:
    """Return the points' positions [m], (frames, points, 3), NaN where not seen, and their gaps.

    The file is read in pieces of `CONVERTED_AT_ONCE` bytes.

    scale: metres of each point's unit, (points,)
    """
    layout = header.layout
    positions = np.empty((frames, layout.points, 3))
    gaps = _Gaps(*np.zeros((5, frames, layout.points), bool))
    at_once = max(CONVERTED_AT_ONCE // layout.width, 1)
    kind = FLOAT if layout.is_float else SHORT
    unit = scale if layout.is_float else scale * abs(header.scale)
    with path.open("rb") as file:
        file.seek(layout.data_at)
        for first in range(0, frames, at_once):
            some = slice(first, min(first + at_once, frames))
            raw = file.read((some.stop - first) * layout.width)
            rows = numbers_of(raw, kind, header.processor).reshape(some.stop - first, -1)[:, : 4 * layout.points]
            rows = rows.reshape(some.stop - first, -1, 4)
            flagged = rows[..., 3] < 0
            if not layout.is_float:
                gaps.lowest[some] = are_lowest(rows[..., :3]) & ~flagged
                gaps.bound[some] = are_at_bound(rows[..., :3]) & ~flagged & ~gaps.lowest[some]
            with np.errstate(invalid="ignore", over="ignore"):  # a damaged number is a gap
                where = rows[..., :3] * unit[:, None]
                positions[some] = as_seen(where, flagged | gaps.lowest[some] | gaps.bound[some])
            gaps.lacking[some] = are_incomplete(where) & ~flagged
            gaps.zeros[some] = are_zeros(where, flagged)
            gaps.infinite[some] = np.isinf(rows[..., :3]).any(2) & ~flagged
    return positions, gaps


def _rate(parameters: Parameters, header: Header) -> float:
    """Return the frame rate [1/s]: POINT:RATE, else its copy in the header, else TRIAL:CAMERA_RATE, else 0."""
    rates = (
        first_of(parameters.numbers("POINT", "RATE")),
        header.rate or 0.0,
        first_of(parameters.numbers("TRIAL", "CAMERA_RATE")),
    )
    return next((rate for rate in rates if rate > 0), rates[0])


def _scale(
    units: list[str], points: int, unit: GivenUnit | str | None, path: Path, others: Integers | None = None
) -> tuple[Floats, str]:
    """Return the metres of each point's unit, (points,), and a warning of units that contradict, '' without them.

    A file states one unit for all points, one for each point, or none. Points without a length, such as angles, have
    units of their own.

    others: indices of unused points, whose units do not count
    """
    stated = [word for word in units if word]
    if len(set(stated)) < 2:
        return np.full(points, metres_of(stated[0] if stated else "", unit, path)), ""
    if len(units) >= points:
        unused = set() if others is None else set(others.tolist())
        each = [1.0 if k in unused else metres_of(word, unit, path) for k, word in enumerate(units[:points])]
        return np.array(each), ""
    metres = metres_of(stated[0], unit, path)
    kinds = list(dict.fromkeys(repr(word[:CELL_SHOWN]) for word in stated))
    told = f"the file states the units {first_few(kinds, len(kinds))} for {points} points; the first was taken for all"
    return np.full(points, metres), told
