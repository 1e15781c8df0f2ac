"""Read marker trajectories from Hangtime's own CSV, written by hand, with pandas, R or MATLAB, or with spreadsheets.

`time_s` comes first, then NAME_x_m, NAME_y_m and NAME_z_m of each marker. The time may be in milliseconds,
microseconds or nanoseconds: `time_ms`, `t_us`, `Time (ns)`. The axis may be a capital letter. The unit
may be missing where the user gives it. A table of pandas or R has a column of row numbers before `time_s`. The column's
name is empty, or its header cell is missing: R's `write.table` names the other columns only.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from formats.errors import TakeError
from formats.importers.marker_lines import COMMENT, LOOKED_AT, MOST_OF_DEVICES, MOST_TITLES, OWN_TIME, Rows
from formats.importers.marker_numbers import Table, read_frames
from formats.importers.marker_tracks import MarkerTracks, Wanted
from formats.importers.number_cells import CELL_SHOWN, is_number, number_of
from formats.importers.stated_values import names_of
from formats.importers.units import GivenUnit, metres_of
from formats.rows import named_in_cell

EXPECTED_COLUMNS = (
    "time_s,NAME_x_m,NAME_y_m,NAME_z_m,... with three columns for each marker; mm for m where that is their unit"
)
TIME = "time_s"
TIME_COLUMN = re.compile(OWN_TIME, re.IGNORECASE)
# Of a second. Times are divided by it, not multiplied by its inverse: so 100 ms is the number 0.1 exactly.
PARTS_OF_A_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "\u00b5s": 1e6, "\u03bcs": 1e6, "ns": 1e9}
COLUMN = re.compile(r"(.*)_([xyz])(?:_([^_]+))?", re.IGNORECASE | re.DOTALL)  # a marker's name, axis and unit
SPACED_TRC = re.compile(r"\s*pathfiletype +\d", re.IGNORECASE)  # its first line, with spaces between cells
SECTIONS_OF_VICON = ("devices", "events", "joints", "model outputs", "segments")  # Vicon, "ASCII (.csv) export"
MOTION_COLUMNS = ["time_s", "point", "x_m", "y_m", "z_m"]  # of `hangtime export --to csv --take`
UNNAMED_COLUMN = re.compile(r"|unnamed: \d+", re.IGNORECASE)  # pandas' name for a column without one
WITHOUT_IT = "write the file without it: index=False in pandas, row.names=FALSE in R"
FEWEST_COUNTED = 3  # lines; our choice: fewer do not show that their first cells are row numbers


def read_own(rows: Rows, unit: GivenUnit | str | None, path: Path, wanted: Wanted) -> MarkerTracks:
    """Read Hangtime's own CSV.

    - `rows`: from the header on; `unit`: of lengths, needed where the columns name none
    - `wanted`: markers and frames to check and convert

    Raises:
        TakeError: the columns are others, or the numbers are malformed.
    """
    line, head = (rows.numbers[0], [_as_named(cell) for cell in rows[0]]) if rows else (1, [""])
    while len(head) > 1 and not head[-1]:  # a separator at the end of the line
        head.pop()
    if head == MOTION_COLUMNS:
        raise TakeError(
            "holds a motion that `hangtime export` simulated, and no recording", where=path,
            advice="import the recording; `hangtime takes export TAKE --to csv` writes the positions of a take",
        )  # fmt: skip
    words = [word.strip(f"{COMMENT} ").lower() for word in head[:2]]
    begin = next((k for k, word in enumerate(words) if TIME_COLUMN.fullmatch(word)), None)
    if begin is None and SPACED_TRC.match(head[0]):
        raise TakeError(
            f"line {line} is that of a TRC file, whose cells must be between tabs", where=path,
            advice="export it again, or write a tab in place of the spaces between cells",
        )  # fmt: skip
    if begin is None and len(head) > 1 and COLUMN.fullmatch(head[1]):
        raise TakeError(
            f"column 1 of line {line} is {head[0][:CELL_SHOWN]!r}, no time with its unit", where=path,
            advice=f"name it {TIME}, or time_ms, time_us or time_ns",
        )  # fmt: skip
    if begin is None:
        _refuse_other_tables(rows, head, line, path)
        raise TakeError(
            f"no line names the columns; line {line} begins with {head[0][:CELL_SHOWN]!r}", where=path,
            advice=f"put above the frames {EXPECTED_COLUMNS}; "
            "TRC, Vicon, Motive and Qualisys exports are read as they are",
        )  # fmt: skip
    body, parts = rows[1:], PARTS_OF_A_SECOND[re.split(r"[_(\[]", words[begin])[-1].strip(")]")]
    if begin:
        _refuse_another_column(head[0].strip(f"{COMMENT} "), head[1], line, body, path)
    labels, stated = _columns(head, begin, line, path)
    names = names_of(labels, path)
    metres = metres_of(stated, unit, path)
    clock = begin or int(_has_unnamed_numbers(body, len(head)))
    width = len(head) - begin + clock
    table = Table(
        width, range(clock + 1, width, 3), names, metres, lambda first: first[:, clock] / parts, is_exact=True,
    )  # fmt: skip
    return replace(read_frames(body, table, path, wanted).tracks(names), named_unit=1 / parts)


def _refuse_other_tables(rows: Rows, head: list[str], line: int, path: Path) -> None:
    """Refuse a table of Vicon Nexus without markers, and one that names its columns in no known way.

    `head`: cells of the first line, whose number is `line`
    """
    if head[0].lower() in SECTIONS_OF_VICON:
        within = f" in its first {MOST_OF_DEVICES} lines" * (rows.numbers[-1] > MOST_OF_DEVICES)
        raise TakeError(
            f"line {line} begins the section {head[0]} of Vicon Nexus, and the file has no Trajectories{within}",
            where=path, advice="export it again with the trajectories of the markers",
        )  # fmt: skip
    for number, cells in zip(rows.numbers[:MOST_TITLES], rows[:MOST_TITLES], strict=True):
        if (name := _first_x(cells)) is not None:
            raise TakeError(
                f"line {number} names columns such as {name[:CELL_SHOWN]!r}, and the file has neither the header of a "
                f"known program nor a column {TIME}", where=path,
                advice=f"export it again with its header, or name the columns {EXPECTED_COLUMNS}",
            )  # fmt: skip


def _first_x(cells: list[str]) -> str | None:
    """Return the first of a line's cells that names an x, beside whose y and z it stands; None without one."""
    names = [cell.strip() for cell in cells]
    for k in range(len(names) - 2):
        x, y, z = (name.lower() for name in names[k : k + 3])
        if x[-1:] == "x" and (x[:-1] + "y", x[:-1] + "z") == (y, z):
            return names[k]
    return None


def _as_named(cell: str) -> str:
    """Return a name without the apostrophes that stop a spreadsheet from running the name as a formula."""
    return named_in_cell(cell.strip())


def _columns(head: list[str], begin: int, line: int, path: Path) -> tuple[list[str], str]:
    """Return the markers' names and the unit in their column names, '' without one.

    `begin`: index of the time column, which the markers' columns follow
    """
    labels, stated = list[str](), ""
    for k in range(begin + 1, len(head), 3):
        name = COLUMN.fullmatch(head[k])
        if name is None:
            raise TakeError(
                f"column {k + 1} of line {line} is {head[k][:CELL_SHOWN]!r}, no x of a marker", where=path,
                advice=f"the line of names must be {EXPECTED_COLUMNS}",
            )  # fmt: skip
        labels.append(name[1])
        stated = stated if len(labels) > 1 else name[3] or ""
        axes = "XYZ" if name[2].isupper() else "xyz"
        for at, axis in enumerate(axes, k):
            wanted = f"{name[1]}_{axis}" + f"_{stated}" * bool(stated)
            if at >= len(head) or head[at].lower() != wanted.lower() or not head[at].startswith(name[1]):
                there = f"is {head[at][:CELL_SHOWN]!r}" if at < len(head) else "is missing"
                raise TakeError(
                    f"column {at + 1} of line {line} {there}, not {wanted[:CELL_SHOWN]!r}", where=path,
                    advice=f"the line of names must be {EXPECTED_COLUMNS}",
                )  # fmt: skip
    return labels, stated


def _refuse_another_column(name: str, time: str, line: int, body: Rows, path: Path) -> None:
    """Refuse a column before the time, unless the column is unnamed and numbers the lines."""
    if not UNNAMED_COLUMN.fullmatch(name):
        raise TakeError(
            f"column 1 of line {line} is {name[:CELL_SHOWN]!r}, and {time[:CELL_SHOWN]} is column 2", where=path,
            advice=WITHOUT_IT,
        )  # fmt: skip
    if not _count_up([row[0] for row in _whole_lines(body)]):
        raise TakeError(
            f"column 1 of line {line} has no name, and below it are no numbers that count up", where=path,
            advice=WITHOUT_IT,
        )  # fmt: skip


def _has_unnamed_numbers(body: Rows, named: int) -> bool:
    """Return whether lines begin with a row number for which the header has no cell.

    If the first cells were times, there would be at most one frame a second, which no recording of swung cloth has.
    """
    lines = _whole_lines(body)
    has_one_more = all(len(row) == named + 1 for row in lines) and any(row[-1].strip() for row in lines)
    return len(lines) >= FEWEST_COUNTED and has_one_more and _count_up([row[0] for row in lines])


def _whole_lines(body: Rows) -> list[list[str]]:
    """Return the cells of the first lines, without a last line that has no line end."""
    return list(body[: min(LOOKED_AT, len(body) - body.is_cut)])


def _count_up(cells: list[str]) -> bool:
    """Return whether cells are increasing whole numbers."""
    if not all(map(is_number, cells)):
        return False
    numbers = np.array([number_of(cell) for cell in cells])
    return bool((numbers == np.rint(numbers)).all() and (np.diff(numbers) > 0).all())
