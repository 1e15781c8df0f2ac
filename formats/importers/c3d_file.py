"""Read marker trajectories from C3D files (https://www.c3d.org), in Intel, DEC and SGI byte order.

A frame has four numbers for each point, 16-bit integers or floats. Three are the position. The fourth is negative where
the point was not seen. The frame's analogue values follow and are skipped. The header's words, counted from 1, are:

- 2 and 3: numbers of points and of analogue values a frame
- 4 and 5: first and last frame
- 7 and 8: scale, negative where the data are floats
- 9: block of 512 bytes at which the data begin
- 11 and 12: frame rate, a float
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats
from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES, find_blocks, refuse_lost_bytes, remove_blocks
from formats.importers.c3d_parameters import FLOAT, SGI, SHORT, NoParametersError, Parameters, numbers_of
from formats.importers.marker_outliers import remove_jumps
from formats.importers.marker_tracks import ALL, MarkerTracks, Wanted
from formats.importers.missing_values import (
    are_incomplete,
    are_zeros,
    as_seen,
    remove_missing_value_codes,
    warning_of_incomplete,
    warning_of_zeros,
)
from formats.importers.number_cells import CELL_SHOWN
from formats.importers.units import metres_of
from formats.plain_text import first_few, sized
from formats.plausible import RATES

TEXT_BYTES = bytes(range(32, 256)) + b"\t\r\n"  # bytes of text without zeros
C3D_KEY = 0x50  # second byte of every C3D file
LARGEST_C3D = 1 << 30  # bytes
FASTEST_RATE = 10_000.0  # frames a second
MOST_FRAMES = 65535  # that the header can state
PIECE = 1 << 22  # bytes of the data that are converted to positions at once
LARGEST_SECTION = 1 << 24  # bytes of parameters
SAME_SCALE = 1e-3  # relative difference: a copy has the same digits
LABELS = ("LABELS", *(f"LABELS{k}" for k in range(2, 10)))


def read_c3d(path: Path, unit: str | None, wanted: Wanted = ALL) -> MarkerTracks:
    """Read the marker trajectories of a C3D file.

    - `unit`: unit of lengths, needed where the file states none
    - `wanted`: markers and frames to check and convert

    Raises:
        TakeError: the file is malformed, shorter than its header says, or holds no marker trajectories.
    """
    size = path.stat().st_size
    if size > LARGEST_C3D:
        raise TakeError(f"has {sized(size)}, which no C3D file has", where=path, advice="check the path")
    header = _header(path, size)
    _refuse_a_short_file(header, path)
    parameters = _parameters(path, header.data_at)
    labels, points = [label for name in LABELS for label in parameters.texts("POINT", name)], header.points
    rate, stated = _rate(parameters, header), _stated_frames(parameters)
    frames = min(header.held, max(header.frames, stated) if header.is_at_its_most else header.frames)
    if points and frames <= 0 and header.held:
        raise TakeError(
            f"states {frames} frames and has room for {header.held} of its {points} points", where=path,
            advice="export it again",
        )  # fmt: skip
    if not points or frames <= 0:
        raise TakeError(
            f"has no marker paths ({points} points, {max(frames, 0)} frames)", where=path,
            advice="export trajectories, not only analogue data",
        )  # fmt: skip
    if not 0 < rate <= FASTEST_RATE:
        states = f"states {rate:g} frames a second; {RATES}" if rate > 0 else "states no frame rate above 0"
        raise TakeError(states, where=path, advice="export it again with its frame rate")
    _refuse_two_scales(_first(parameters.numbers("POINT", "SCALE")), header, path)
    _refuse_a_long_file(frames, stated, header, path)
    if header.parameters_at < header.data_at:
        refuse_lost_bytes(path, size, header.data_at + frames * header.width)
    # Labels beyond the number of points name no point, and may be empty. Points beyond the labels have no name.
    without_path = tuple(filter(None, labels[points:]))
    labels = [*labels[:points], *(f"unlabelled_{k}" for k in range(len(labels), points))]
    scale = _scale(parameters.texts("POINT", "UNITS"), points, unit, path)
    time = np.asarray(np.arange(frames)[: wanted.frames] / rate, float)
    positions, lacking, zeros, infinite = _places(path, header, len(time), scale)
    others = np.setdiff1d(np.arange(points), wanted.markers(labels))
    infinite[:, others] = False
    _refuse_infinity(infinite, labels, path)
    positions[:, others], lacking[:, others], zeros[:, others] = np.nan, False, False

    def frame_of(at: int) -> str:
        return f"frame {at + 1}"

    warnings = [header.doubts]
    if wanted.frames is None or wanted.frames > frames:
        warnings.append(_warning_of_length(path, size, header, frames))
    if not wanted.names or any(label.rpartition(":")[2] in wanted.names for label in without_path):
        warnings.append(_warning_of_names(points, without_path))
    warnings.append(remove_missing_value_codes(positions, scale, frame_of))
    blocks = find_blocks(path, header.data_at, frames * header.width, header.width)
    kind = FLOAT if header.is_float else SHORT
    warnings.append(remove_blocks(positions, blocks, kind, header.width, others))
    warnings += [
        warning_of_incomplete(lacking, time, labels, frame_of),
        remove_jumps(time, positions, labels, frame_of),
    ]
    warnings.append(warning_of_zeros(zeros, positions, labels, frame_of))
    return MarkerTracks(
        tuple(labels), time, positions, header.rate, "; ".join(filter(None, warnings)), has_times=False,
        without_path=without_path, zeros=zeros.sum(0),
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


def _warning_of_length(path: Path, size: int, header: _Header, frames: int) -> str:
    """Return a warning of a file with room for more frames than it states.

    Return '' where zeros fill the room. A parameter section behind the frames is no frame.
    """
    end = header.data_at + frames * header.width
    if size - end < BLOCK_BYTES + header.width or header.parameters_at > header.data_at:
        return ""
    with path.open("rb") as file:
        file.seek(end)
        if not any(file.read(header.width)):
            return ""
    return f"the file states {frames} frames and has room for {header.held}; the first {frames} were read"


def _refuse_infinity(infinite: Booleans, labels: list[str], path: Path) -> None:
    """Refuse positions with an infinite coordinate, as in a text; `infinite`: whether one has, (frames, points)."""
    if infinite.any():
        frame, point = np.argwhere(infinite)[0].tolist()
        more = f", the first of {infinite.sum()} such positions" if infinite.sum() > 1 else ""
        raise TakeError(
            f"frame {frame + 1} holds inf, which is no number, for {labels[point][:CELL_SHOWN]}{more}", where=path,
            advice="export it again, with markers that were not seen as NaN or with a negative residual",
        )  # fmt: skip


def _places(path: Path, header: _Header, frames: int, scale: Floats) -> tuple[Floats, Booleans, Booleans, Booleans]:
    """Return the points' positions [m], (frames, points, 3), NaN where not seen.

    Also return whether one or two coordinates are missing, whether all three are zero, and whether one is infinite, all
    (frames, points). The file is read in pieces of `PIECE` bytes.

    scale: metres of each point's unit, (points,)
    """
    positions = np.empty((frames, header.points, 3))
    lacking, zeros, infinite = np.empty((3, frames, header.points), bool)
    at_once = max(PIECE // header.width, 1)
    kind = FLOAT if header.is_float else SHORT
    with path.open("rb") as file:
        file.seek(header.data_at)
        for first in range(0, frames, at_once):
            piece = positions[first : first + at_once]
            raw = file.read(len(piece) * header.width)
            rows = numbers_of(raw, kind, header.processor).reshape(len(piece), -1)[:, : 4 * header.points]
            rows = rows.reshape(len(piece), -1, 4)
            unit = scale if header.is_float else scale * abs(header.scale)
            with np.errstate(invalid="ignore", over="ignore"):  # a damaged number is a gap
                where = rows[..., :3] * unit[:, None]
                piece[:] = as_seen(where, rows[..., 3] < 0)
            lacking[first : first + at_once] = are_incomplete(where) & ~(rows[..., 3] < 0)
            zeros[first : first + at_once] = are_zeros(where, rows[..., 3] < 0)
            infinite[first : first + at_once] = np.isinf(rows[..., :3]).any(2) & ~(rows[..., 3] < 0)
    return positions, lacking, zeros, infinite


def _parameters(path: Path, data_at: int) -> Parameters:
    """Return the parameters of a file whose data begin at byte `data_at`; the section may be longer than it states.

    Raises:
        TakeError: the parameters are malformed.
    """
    with path.open("rb") as file:
        begin = BLOCK_BYTES * (file.read(1)[0] - 1)
        file.seek(begin + 2)
        blocks = (file.read(1) or b"\0")[0]
        file.seek(begin)
        section = file.read(min(max(BLOCK_BYTES * blocks, data_at - begin, 0), LARGEST_SECTION))
    try:
        return Parameters(section)
    except NoParametersError as error:
        raise TakeError(
            "is no C3D file that can be read (its parameters are malformed)", where=path,
            advice="export it again",
        ) from error  # fmt: skip


def _stated_frames(parameters: Parameters) -> int:
    """Return the number of frames by the parameters that count beyond the header's 16 bits, 0 without such parameters.

    TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD hold two words of 16 bits, the lower first. POINT:LONG_FRAMES is a
    float. Source: the C3D file format, user guide.
    """
    begin, end = (parameters.numbers("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END"))
    if len(begin) == len(end) == 2:
        first, last = (int(low) % 65536 + 65536 * (int(high) % 65536) for low, high in (begin, end))
        return max(last - first + 1, 0)
    return max(int(_first(parameters.numbers("POINT", "LONG_FRAMES"))), 0)


def _rate(parameters: Parameters, header: _Header) -> float:
    """Return the frame rate [1/s]: POINT:RATE, else its copy in the header, else TRIAL:CAMERA_RATE, else 0."""
    rates = (
        _first(parameters.numbers("POINT", "RATE")),
        header.rate or 0.0,
        _first(parameters.numbers("TRIAL", "CAMERA_RATE")),
    )
    return next((rate for rate in rates if rate > 0), rates[0])


def _refuse_two_scales(scale: float, header: _Header, path: Path) -> None:
    """Refuse a file whose header and parameter state different scales, since either may be the true one.

    scale: POINT:SCALE, 0 where there is none; for floats only its sign counts
    """
    is_one = header.is_float if scale < 0 else not header.is_float and abs(scale / header.scale - 1) < SAME_SCALE
    if scale and not is_one:
        raise TakeError(
            f"its header states a scale of {header.scale:g}, its parameter POINT:SCALE {scale:g}", where=path,
            advice="export it again",
        )  # fmt: skip


def _first(numbers: Floats) -> float:
    """Return the first finite number, 0 where there is none."""
    return next((float(number) for number in numbers if np.isfinite(number)), 0.0)


def _scale(units: list[str], points: int, unit: str | None, path: Path) -> Floats:
    """Return the metres of each point's unit, (points,).

    A file states one unit for all points, one for each point, or none.
    """
    stated = [word for word in units if word]
    if len(set(stated)) > 1 and len(units) >= points:
        return np.array([metres_of(word, unit, path) for word in units[:points]])
    return np.full(points, metres_of(stated[0] if stated else "", unit, path))


@dataclass(frozen=True)
class _Header:
    """The header of a file.

    - `processor`: code of the byte order
    - `points`, `frames`: their numbers; `width` [bytes]: of a frame; `data_at` [bytes]: offset of the first frame
    - `is_float`, `scale`: number format of positions
    - `held`: number of frames for which the file has room
    - `parameters_at` [bytes]: offset of the parameters
    - `first`, `last`: numbers of the first and the last frame
    - `rate` [1/s]: None where the header states none
    - `doubts`: warnings of parameters that contradict the header, '' without any
    """

    processor: int
    points: int
    frames: int
    width: int
    data_at: int
    is_float: bool
    scale: float
    held: int
    parameters_at: int
    first: int
    last: int
    rate: float | None
    doubts: str

    @property
    def is_at_its_most(self) -> bool:
        """Whether the header states the largest number of frames that it can."""
        return self.last == MOST_FRAMES and self.first <= 1


def _header(path: Path, size: int) -> _Header:
    """Return the header, with the parameters' copies of its numbers where it states none.

    Raises:
        TakeError: the file has no header, or the header and the parameters contradict each other.
    """
    with path.open("rb") as file:
        head = file.read(BLOCK_BYTES)
        if len(head) < BLOCK_BYTES or head[1] != C3D_KEY or not head[0]:
            is_text = bool(head) and not head.translate(None, TEXT_BYTES)
            advice = "it is text: give it the ending .trc, .csv or .tsv" if is_text else "export it again"
            raise TakeError("is no C3D file that can be read (it lacks a C3D header)", where=path, advice=advice)
        file.seek(BLOCK_BYTES * (head[0] - 1) + 3)
        processor = (file.read(1) or b"\0")[0]
    order = ">" if processor == SGI else "<"
    points, analogue, first, last = struct.unpack_from(f"{order}HHHH", head, 2)
    start = struct.unpack_from(f"{order}H", head, 16)[0]
    scale, rate = (float(numbers_of(head[at : at + 4], FLOAT, processor)[0]) for at in (12, 20))
    parameters = _copies(path, BLOCK_BYTES * (start - 1))
    if not np.isfinite(scale) or scale == 0.0:
        copy = parameters.get("SCALE", 0.0)
        if not np.isfinite(scale) and not copy:
            raise TakeError(f"states a scale of {scale:g}", where=path, advice="export it again")
        scale = scale if scale and np.isfinite(scale) else copy or -1.0
    is_float = scale < 0
    width = (4 * points + analogue) * (4 if is_float else 2)
    frames, doubts = last - first + 1, list[str]()
    if (copy := int(parameters.get("FRAMES", 0.0))) > 0 >= frames:
        doubts.append(f"its header states frames {first} to {last}, and its parameter POINT:FRAMES {copy} frames")
        frames = copy
    start, other = _begin(size, start, int(parameters.get("DATA_START", 0.0)), width * max(frames, 0))
    if other:
        doubts.append(f"its header and its parameter POINT:DATA_START state blocks {other[0]} and {other[1]} as the "
                      f"first of its frames; they were read from block {start}")  # fmt: skip
    held = (size - BLOCK_BYTES * (start - 1)) // width if width and start > 1 else 0
    if (used := int(parameters.get("USED", points))) != points:
        counts = f"its header states {points} points, and its parameter POINT:USED {used}"
        if held != frames and not 0 <= size - BLOCK_BYTES * (start - 1) - frames * width < BLOCK_BYTES:
            raise TakeError(f"{counts}, and its size agrees with neither", where=path, advice="export it again")
        doubts.append(f"{counts}; {points} were read")
    return _Header(
        processor, points, frames, width, BLOCK_BYTES * (start - 1), is_float, scale, held,
        BLOCK_BYTES * (head[0] - 1), first, last, rate if 0 < rate < FASTEST_RATE else None,
        "; ".join(doubts),
    )  # fmt: skip


def _copies(path: Path, data_at: int) -> dict[str, float]:
    """Return the parameters of points that the header has copies of, by name; {} where the section is malformed."""
    try:
        parameters = _parameters(path, data_at)
    except TakeError:  # reported where the parameters themselves are needed
        return {}
    found = {name: parameters.numbers("POINT", name) for name in ("SCALE", "FRAMES", "DATA_START", "USED")}
    return {name: _first(numbers) for name, numbers in found.items() if len(numbers)}


def _begin(size: int, stated: int, copy: int, length: int) -> tuple[int, tuple[int, int] | None]:
    """Return the block at which the frames begin, and the two stated blocks where they contradict each other.

    The header's block counts, unless the file's size agrees with the parameter's block only.

    - `size` [bytes]: of the file; `length` [bytes]: of all frames
    - `stated`, `copy`: the block by the header and by POINT:DATA_START, 0 where it is not stated
    """
    if not stated or copy < 2 or copy == stated:
        return stated or copy, None
    rest, other = (size - BLOCK_BYTES * (block - 1) - length for block in (stated, copy))
    is_copy = stated < 2 or rest < 0 <= other or (0 <= other < BLOCK_BYTES <= rest)
    return (copy if is_copy else stated), (stated, copy)


def _refuse_a_short_file(header: _Header, path: Path) -> None:
    """Refuse a file that ends before the last frame that the header states."""
    has_frames = header.width and header.frames > 0 and header.data_at > 0
    if has_frames and header.held < header.frames and header.last < MOST_FRAMES:
        raise _cut_off(max(header.held, 0), header.frames, "its header states", path)


def _refuse_a_long_file(read: int, stated: int, header: _Header, path: Path) -> None:
    """Refuse a file that may hold more frames than its header can state, if some were not read.

    read: number of frames read; stated: number by the parameters, 0 where they state none
    """
    if not header.is_at_its_most:
        return
    if read < (stated or MOST_FRAMES):
        raise _cut_off(read, stated or MOST_FRAMES, f"its {'parameters state' if stated else 'header states'}", path)
    if header.held > read + BLOCK_BYTES // 8:  # the last block's rest may look like frames, of a 16-bit point each
        raise TakeError(
            f"has room for {header.held} frames and states {read}: its header counts no further", where=path,
            advice="export it in shorter parts, or as text",
        )  # fmt: skip


def _cut_off(found: int, stated: int, what: str, path: Path) -> TakeError:
    return TakeError(
        f"holds {found} of the {stated} frames that {what}", where=path,
        advice="it is cut off: copy or export it again",
    )  # fmt: skip
