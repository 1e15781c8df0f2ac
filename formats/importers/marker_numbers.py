"""Convert the cells of a marker text file to times and positions, a batch of lines at a time."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.errors import TakeError
from formats.importers.broken_numbers import broken_lines, is_near
from formats.importers.cut_numbers import Ending, ending_of, is_part, lines_around
from formats.importers.decimal_separators import DecimalSeparators, are_too_far, fewer_jump, may_be_motion
from formats.importers.lost_lines import remove_joined_lines
from formats.importers.marker_exchanges import remove_exchanged
from formats.importers.marker_lines import Rows
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
from formats.importers.number_cells import are_grouped, is_number, may_be_grouped, number_of
from formats.importers.number_formats import Writing, remove_odd_numbers, writing_of
from formats.importers.short_lines import last_may_be_cut, refuse_a_cut_time, within_a_number
from formats.plain_text import first_few

WHOLE = re.compile(r"\s*[+-]?\d*\s*", re.ASCII)
FLOAT_BYTES = b"0123456789+-.eE "  # on these characters `float` and `NUMBER` accept the same numbers
MOST_NUMBERS_OF_FILE = 1 << 25  # of a file: 19 minutes of 81 markers at 120 frames a second
SAY_WHICH = "say which with --decimal comma or --decimal point"
WITHIN_ITS_LAST = "may be cut off within its last number, so its last marker counts as not seen there"
NO_THOUSANDS = "export numbers without a thousands separator"
MOST_WRONG = 100  # unreadable lines that an error counts; our choice: bounds the time on a file of another kind
LINES_AT_ONCE = 64  # lines converted to positions together; our choice: bounds memory, and the positions are the same


@dataclass(frozen=True)
class Table:
    """The layout of a table of marker positions.

    - `width`: number of cells in a line
    - `markers`: column of each marker's x, before its y and z; `labels`: the markers' names
    - `metres`: length of the positions' unit [m]
    - `clock`: computes each line's time [s] from the first two numbers of the lines, (rows, 2)
    - `is_exact`: whether every line must have as many cells as the header. If so, the first numbers of lines need not
      be frame numbers. Otherwise a line may leave out its last cells, except a last line that has no line end
    - `kept`: indices of the markers to convert, None for all
    """

    width: int
    markers: Sequence[int]
    labels: Sequence[str]
    metres: float
    clock: Callable[[Floats], Floats]
    is_exact: bool = False
    kept: Sequence[int] | None = None

    def columns(self) -> Integers:
        """Return the column indices of each kept marker's x, y and z, (markers, 3)."""
        begin = np.asarray(self.markers, int)
        return (begin if self.kept is None else begin[list(self.kept)])[:, None] + np.arange(3)


@dataclass(frozen=True)
class Frames:
    """The times and positions of the lines of a table.

    - `time` [s], (rows,)
    - `positions` [m], (rows, markers, 3), NaN where not seen
    - `warning`: warnings, separated by semicolons, '' without any
    - `zeros`: how often each marker has three zero coordinates, (markers,)
    """

    time: Floats
    positions: Floats
    warning: str
    zeros: Integers

    def tracks(
        self, labels: tuple[str, ...], *, rate: float | None = None, warning: str = "", has_times: bool = True,
        expected: tuple[str, ...] = (),
    ) -> MarkerTracks:  # fmt: skip
        """Return the frames as `MarkerTracks`.

        The arguments are its fields; `warning` stands before the frames' own warnings.
        """
        return MarkerTracks(
            labels, self.time, self.positions, rate, "; ".join(filter(None, [warning, self.warning])),
            has_times=has_times, zeros=self.zeros, expected=expected,
        )  # fmt: skip


def read_frames(rows: Rows, table: Table, path: Path, wanted: Wanted = ALL) -> Frames:
    """Convert the wanted lines of a table to times and positions of the wanted markers.

    Raises:
        TakeError: a line holds something other than numbers, or the table is too large.
    """
    width, rows, kept = table.width, rows[: wanted.frames].frames(), wanted.markers(table.labels)
    table, labels = replace(table, kept=kept), [table.labels[k] for k in kept]
    if len(rows) * width > MOST_NUMBERS_OF_FILE:
        raise TakeError(
            f"holds {len(rows)} frames of {width} numbers", where=path, advice="export fewer markers or frames"
        )
    columns, begin = table.columns(), min(table.markers, default=width)
    found = _numbers(rows, table, path, signs := DecimalSeparators(begin))
    first, positions, cells = found.first, found.positions, found.cells
    time = table.clock(first)
    metres = np.full(len(columns), table.metres)

    def line(frame: int) -> str:
        return f"line {rows.numbers[frame]}"

    codes = remove_missing_value_codes(positions, metres, line)
    refuse_a_cut_time(rows, cells, first, time, begin, width, path)
    if not rows.decimal:
        _refuse_thousands(rows, table, path, signs, time, positions)
    writing = writing_of(rows, [first + axis for first in table.markers for axis in range(3)])
    broken = broken_lines(rows, cells, columns, time, positions, table.metres, writing)
    last = _check_the_last(rows, columns, width, writing, time, positions, path, is_broken=bool(broken[-1:].any()))
    farthest = int(columns.max(initial=-1))
    has_last = bool(len(cells)) and farthest >= cells[-1] - 1
    if not last and rows.is_cut and farthest >= cells[-1]:
        last = (
            f"line {rows.numbers[-1]} has no end and may be cut off after {cells[-1]} of its {width} cells, so the "
            "markers behind count as not seen there"
        )
    elif not last and has_last and last_may_be_cut(rows, cells, width):
        last = (
            f"line {rows.numbers[-1]} may be cut off after {cells[-1]} of its {width} cells, so the markers from the "
            "last one on count as not seen there"
        )
        _take_out_the_last(positions, len(rows) - 1, cells, columns)
    if last:
        found.lacking[-1, (columns == min(cells[-1] - 1, farthest)).any(1)] = False
    within = np.flatnonzero(broken[:-1]).tolist()
    for at in within:
        _take_out_the_last(positions, at, cells, columns)
    warnings = [codes, _warning_of_lines([rows.numbers[at] for at in within]), last]
    warnings.append(warning_of_incomplete(found.lacking, time, labels, line))
    if min(table.markers, default=0):  # without a clock, a line begins with a position
        # Scripts that leave out rows keep the numbers of the others.
        numbers = time if table.is_exact else first[:, 0]
        warnings.append(remove_joined_lines(numbers, time, positions, line))
    warnings.append(remove_exchanged(time, positions, labels, line))
    warnings.append(remove_jumps(time, positions, labels, line))
    warnings.append(remove_odd_numbers(rows, columns, positions, labels, line, writing.form))
    warnings.append(warning_of_zeros(found.zeros, positions, labels, line))
    return _of_all(
        Frames(time, positions, "; ".join(filter(None, warnings)), found.zeros.sum(0)), kept, len(table.labels)
    )


def _of_all(frames: Frames, kept: list[int], count: int) -> Frames:
    """Return the frames with all `count` markers; markers that were not kept count as not seen."""
    if len(kept) == count:
        return frames
    positions, zeros = np.full((len(frames.time), count, 3), np.nan), np.zeros(count, int)
    positions[:, kept], zeros[kept] = frames.positions, frames.zeros
    return replace(frames, positions=positions, zeros=zeros)


def _refuse_thousands(
    rows: Rows, table: Table, path: Path, signs: DecimalSeparators, time: Floats, positions: Floats
) -> None:
    """Refuse numbers whose separators may be decimal or thousands separators.

    `time` [s], (rows,); `positions` [m], (rows, markers, 3), NaN where not seen; both as read with decimal separators
    """
    number, is_usual = signs.of_thousands, signs.are_usual(rows.separator)
    if not number or not (is_usual or fewer_jump(time, positions, np.zeros_like(positions))):
        return
    sign, name = (",", "commas") if "," in number else (".", "points")
    as_thousands = DecimalSeparators(parts_thousands=sign)
    found = _numbers(rows, table, path, as_thousands)
    large = np.where(np.isnan(positions), np.nan, found.positions)
    clock = time if signs.has_clock_of_decimals else table.clock(found.first)
    is_motion = is_usual and may_be_motion(clock, large)
    if not are_too_far(large) and (is_motion or fewer_jump(time, positions, large)):
        raise TakeError(
            f"{name} may separate decimals or thousands: {number!r} is {number.replace(sign, '.')} or "
            f"{number.replace(sign, '')}", where=path,
            advice=NO_THOUSANDS if signs.has_clock_of_decimals else SAY_WHICH,
        )  # fmt: skip


def _take_out_the_last(positions: Floats, at: int, cells: Integers, columns: Integers) -> None:
    """Mark as not seen the marker to which a line's last cell belongs."""
    positions[at, (columns == cells[at] - 1).any(1)] = np.nan


def _warning_of_lines(lines: list[int]) -> str:
    """Return a warning that lines may end within a number, '' without such lines."""
    if not lines:
        return ""
    if len(lines) == 1:
        return f"line {lines[0]} {WITHIN_ITS_LAST}"
    named = first_few(list(map(str, lines)), len(lines))
    return f"lines {named} may be cut off within their last numbers, so the last marker of each counts as not seen"


@dataclass(frozen=True)
class _Numbers:
    """The numbers of lines, before outliers and missing-value codes are removed.

    - `first`: the first two numbers of each line, (rows, 2); `cells`: number of cells of each line, (rows,)
    - `positions` [m], (rows, markers, 3), NaN where not seen
    - `lacking`: whether some coordinates are missing, (rows, markers); `zeros`: whether all three are 0, (rows,
      markers)
    """

    first: Floats
    cells: Integers
    positions: Floats
    lacking: Booleans
    zeros: Booleans


def _numbers(rows: Rows, table: Table, path: Path, signs: DecimalSeparators) -> _Numbers:
    """Convert lines to numbers; `signs` records the decimal and thousands separators in them."""
    width, columns = table.width, table.columns()
    shape = len(rows), len(columns)
    found = _Numbers(
        np.empty((len(rows), 2)), np.empty(len(rows), int), np.empty((*shape, 3)), *np.empty((2, *shape), bool)
    )
    numbers = np.empty((LINES_AT_ONCE, max(width, 2)))
    for begin in range(0, len(rows), LINES_AT_ONCE):
        some = rows[begin : begin + LINES_AT_ONCE]
        for k, row in enumerate(some):
            found.cells[begin + k] = len(row)
            try:
                numbers[k, :width] = _line(rows, begin + k, row, table, path, signs)
            except TakeError as error:
                raise _with_others(error, rows, begin + k, table, path, signs) from error
        piece = slice(begin, begin + len(some))
        found.first[piece] = numbers[: len(some), :2]
        found.positions[piece] = as_seen(numbers[: len(some), columns] * table.metres)
        found.lacking[piece] = are_incomplete(numbers[: len(some), columns])
        found.zeros[piece] = are_zeros(numbers[: len(some), columns])
    return found


def _line(rows: Rows, at: int, row: list[str], table: Table, path: Path, signs: DecimalSeparators) -> Floats:
    """Return the numbers of one line, (width,), NaN where the line leaves out its last cells.

    Raises:
        TakeError: a cell is not a number, or the number of cells contradicts the header.
    """
    _refuse_a_wrong_line(rows, at, row, table, path)
    cells = row if len(row) == table.width else [*row[: table.width], *[""] * (table.width - len(row))]
    try:
        return _row(cells, signs)
    except ValueError as error:
        advice = NO_THOUSANDS if are_grouped(row) else "mend that line"
        advice = SAY_WHICH if signs.are_mixed or may_be_grouped(row) else advice
        raise TakeError(f"line {rows.numbers[at]} holds {error}", where=path, advice=advice) from error


def _with_others(
    error: TakeError, rows: Rows, at: int, table: Table, path: Path, signs: DecimalSeparators
) -> TakeError:
    """Add to a line's error the later lines that cannot be read either, unless most lines cannot."""
    wrong, looked = list[int](), 0
    for looked, row in enumerate(rows[at + 1 :], 1):
        try:
            _line(rows, at + looked, row, table, path, signs)
        except TakeError:
            wrong.append(rows.numbers[at + looked])
            if len(wrong) > MOST_WRONG:
                break
    if not wrong or len(wrong) > looked / 2:
        return error
    count = f"more than {MOST_WRONG}" if len(wrong) > MOST_WRONG else str(len(wrong))
    more = f"{count} further line{'s' * (len(wrong) > 1)} cannot be read either: "
    more += first_few(list(map(str, wrong)), len(wrong))
    return TakeError(f"{error.what}; {more}", where=path, advice=error.advice)


def _check_the_last(
    rows: Rows, columns: Integers, width: int, writing: Writing, time: Floats, positions: Floats, path: Path, *,
    is_broken: bool,
) -> str:  # fmt: skip
    """Refuse a cut last number; return a warning of one that may be cut, and mark its marker as not seen."""
    at, row = len(rows) - 1, rows[-1] if len(rows) else []
    markers = np.flatnonzero(columns[:, 2] == min(len(row) - 1, columns.max(initial=0)))
    if not len(markers):
        return ""
    marker, number, last = int(markers[0]), rows.numbers[at], int(columns[markers[0], 2])
    ending = ending_of(rows, last, width, writing)
    if ending is Ending.CUT and not row[last].strip():
        raise TakeError(
            f"ends within line {number}, before its last number", where=path,
            advice="the file is cut off: copy or export the file again",
        )  # fmt: skip
    if ending is Ending.CUT:
        raise within_a_number(number, last + 1, width, path)
    if ending is Ending.WHOLE or (np.isnan(positions[at, marker]).all() and not is_part(row[last])):
        return ""
    is_off = is_broken if ending is Ending.OPEN else not is_near(time, positions[:, marker, 2])
    if not is_off:
        return ""
    positions[at, marker] = np.nan
    return f"line {number} {WITHIN_ITS_LAST}"


def _refuse_a_wrong_line(rows: Rows, at: int, row: list[str], table: Table, path: Path) -> None:
    """Refuse a line whose number of cells contradicts the header."""
    width = table.width
    if len(row) == width:
        return
    number = rows.numbers[at]
    if rows.is_cut and at == len(rows) - 1 and len(row) < width and not _may_leave_out_cells(rows, at, table):
        raise TakeError(
            f"ends within line {number}, after {len(row)} of its {width} cells", where=path,
            advice="the file is cut off: copy or export the file again",
        )  # fmt: skip
    if len(row) < width and _marks_join_cells(rows, at):
        raise TakeError(
            f"line {number} has {len(row)} cells, not {width}: quotation marks join some of them", where=path,
            advice="take the quotation marks out of that line",
        )  # fmt: skip
    is_longer = any(cell.strip() for cell in row[width:])
    is_empty = not any(cell.strip() for cell in row[min(table.markers, default=width) :])
    may_be_parted = len(row) > width and rows.separator == "," and not is_empty and all(map(WHOLE.fullmatch, row))
    if may_be_parted and (is_longer or not _commas_part_cells(rows, at, len(row))):
        raise TakeError(
            f"line {number} has {len(row)} cells, not {width}, none with a decimal point", where=path,
            advice="where commas are decimal separators too, export decimal points, or semicolons between cells",
        )  # fmt: skip
    if table.is_exact and (len(row) < width or is_longer):
        raise TakeError(f"line {number} has {len(row)} columns, not {width}", where=path, advice="mend that line")
    begun = next((k for k in table.markers if k < len(row) < k + 3), len(row))
    if len(row) < width and any(map(is_number, row[begun:])):
        raise TakeError(
            f"line {number} ends within a marker, after {len(row)} of its {width} cells", where=path,
            advice="the line is cut off: copy or export the file again",
        )  # fmt: skip
    if is_longer:
        raise TakeError(
            f"line {number} has {len(row)} cells, the header names {width}", where=path,
            advice="the header lacks markers, or the line has cells too many: export it again",
        )  # fmt: skip


def _may_leave_out_cells(rows: Rows, at: int, table: Table) -> bool:
    """Return whether the lines around one show that the writing program leaves out empty cells at the end of a line."""
    leaves_out = not table.is_exact and any(len(line) < table.width for line in lines_around(rows, at))
    return leaves_out and len(rows[at]) > min(table.markers, default=0)


def _marks_join_cells(rows: Rows, at: int) -> bool:
    """Return whether quotation marks join cells of a line, other than around a number with a decimal comma."""
    joined = [cell for cell in rows[at] if rows.separator in cell]
    whole = chain.from_iterable(line for line in lines_around(rows, at) if len(line) > len(rows[at])) if joined else ()
    return bool(joined) and not (all(map(is_number, joined)) and any(rows.separator in cell for cell in whole))


def _commas_part_cells(rows: Rows, at: int, cells: int) -> bool:
    """Return whether the lines around one, with as many cells, show that commas delimit cells only.

    One of them has decimal points, or fewer empty cells at its end than the three of a marker that was not seen.
    """
    lines = (line for line in chain([rows[at]], lines_around(rows, at)) if len(line) == cells)
    return any(any(map(str.strip, line[-3:])) or any("." in cell for cell in line) for line in lines)


def _row(cells: list[str], signs: DecimalSeparators) -> Floats:
    """Return the numbers of cells as `number_of` does; plain numbers convert five times as fast.

    Raises:
        ValueError: as `number_of` and `DecimalSeparators.look`.
    """
    text = "".join(cells)
    signs.look(cells, text)
    plain = cells
    if sign := signs.parts_thousands or ("," if "," in text else ""):
        instead = "" if signs.parts_thousands else "."
        text, plain = text.replace(sign, instead), [cell.replace(sign, instead) for cell in cells]
    if text.isascii() and not text.encode().translate(None, FLOAT_BYTES):
        with contextlib.suppress(ValueError):
            numbers = np.array([float(cell) if cell else np.nan for cell in plain])
            if not np.isinf(numbers).any():
                return numbers
    return np.array([number_of(cell) for cell in (plain if signs.parts_thousands else cells)])
