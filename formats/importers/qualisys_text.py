"""Read marker trajectories from the TSV of Qualisys Track Manager, whose export options change the table.

The header lines, each a name and its value, end with `MARKER_NAMES` or `TRAJECTORY_TYPES`. A row of column names may
follow. Then each line is a frame: x, y and z of each marker. The frame's number, its time, or both may stand before
them.

Sources: Qualisys Track Manager, "TSV export" and "Motion data (.tsv)".
"""

from __future__ import annotations

import re
from itertools import takewhile
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.marker_lines import LOOKED_AT, Rows
from formats.importers.marker_numbers import Table, read_frames
from formats.importers.marker_tracks import MarkerTracks, Wanted
from formats.importers.number_cells import CELL_SHOWN, GAP_WORDS, is_number, number_of
from formats.importers.stated_values import frame_rate, names_of, rate_beside_times, warning_of_count, whole_number
from formats.importers.units import GivenUnit, metres_of

LONGEST_HEAD = 1000  # lines above the first frame: one for each event
STATED = re.compile(r"[A-Z_]+")  # the name of a value
NUMBER_TITLE, TIME_TITLE = "frame", "time"  # column names of the clock, without their capital letters
KINDS_OF_CLOCK = (
    (NUMBER_TITLE, TIME_TITLE),
    (NUMBER_TITLE,),
    (TIME_TITLE,),
)  # before the positions; Qualisys writes both, and other programs remove one
WITHIN_A_STEP = 0.5  # frame intervals that a rounded time may be off


def read_qualisys(rows: Rows, unit: GivenUnit | str | None, path: Path, wanted: Wanted) -> MarkerTracks:
    """Read a Qualisys table, in millimetres.

    - `rows`: from the header on; `unit`: the user's unit of lengths
    - `wanted`: markers and frames to check and convert

    Raises:
        TakeError: the header contradicts itself or the table, or the numbers are malformed.
    """
    head = list(takewhile(_states_a_value, rows[:LONGEST_HEAD]))
    stated = {row[0].strip(): row[1:] for row in head}

    def value(name: str) -> str:
        return next(iter(stated.get(name, [])), "")

    kind = value("DATA_INCLUDED").strip().upper()
    if kind not in ("", "3D") and "MARKER_NAMES" not in stated:
        raise TakeError(
            f"its DATA_INCLUDED is {kind[:CELL_SHOWN]!r}, and it names no markers", where=path,
            advice="export the 3D data, with the trajectories of markers",
        )  # fmt: skip
    names = [cell.strip() for cell in stated.get("MARKER_NAMES", []) if cell.strip()]
    count = whole_number(value("NO_OF_MARKERS"), "number of markers", path, len(names))
    if count != len(names):
        raise TakeError(f"names {len(names)} markers and states {count}", where=path, advice="export it again")
    count_of_frames = whole_number(value("NO_OF_FRAMES"), "number of frames", path, len(rows) - len(head))
    body, width = rows[len(head) :], 3 * len(names)
    titles = body[0] if len(body) else [""]
    clock_cells = _clock_named_in(titles, names)
    # FREQUENCY is EXT where another device triggers each frame; frames with times need no rate.
    rate = rate_beside_times(value("FREQUENCY")) if TIME_TITLE in clock_cells else frame_rate(value("FREQUENCY"), path)
    if clock_cells or _are_titles(titles, names):
        body = body[1:]
    if not clock_cells and rate is not None:
        clock_cells = next((cells for cells in KINDS_OF_CLOCK if _begin_with(cells, body, width, rate)), ())
    end = len(body)
    while end > count_of_frames and not any(cell.strip() for cell in body[end - 1]):
        end -= 1
    body = body[:end]
    are_numbered = clock_cells[:1] == (NUMBER_TITLE,)
    warning = warning_of_count(body, count_of_frames, wanted.frames, path, are_numbered=are_numbered)
    begin = len(clock_cells)

    def clock(first: Floats) -> Floats:
        if TIME_TITLE in clock_cells or rate is None:
            return first[:, clock_cells.index(TIME_TITLE)]
        return (first[:, 0] if NUMBER_TITLE in clock_cells else np.arange(len(first))) / rate

    table = Table(begin + width, range(begin, begin + width, 3), names, metres_of("mm", unit, path), clock)
    frames = read_frames(body, table, path, wanted)
    return frames.tracks(names_of(names, path), rate=rate, warning=warning, has_times=TIME_TITLE in clock_cells)


def _states_a_value(row: list[str]) -> bool:
    """Return whether a header line states a value; a frame may begin with a missing-value word such as NULL."""
    return STATED.fullmatch(row[0].strip()) is not None and row[0].strip().lower() not in GAP_WORDS


def _are_titles(row: list[str], names: list[str]) -> bool:
    """Return whether a line holds the column names of a table without a clock, such as `top_left X`."""
    return bool(names) and row[0].strip().startswith(names[0]) and not any(map(is_number, row))


def _clock_named_in(titles: list[str], names: list[str]) -> tuple[str, ...]:
    """Return the cells of the clock before the first marker, by the column names; () without any."""
    named = (cell.strip().lower() for cell in titles)
    found = tuple(takewhile(lambda title: title in (NUMBER_TITLE, TIME_TITLE), named))
    if found == (NUMBER_TITLE,) and len(titles) > 1 and not _are_titles(titles[1:], names):
        return NUMBER_TITLE, TIME_TITLE  # other programs name the time otherwise, as `Time (s)`
    return found


def _begin_with(cells: tuple[str, ...], body: Rows, width: int, rate: float) -> bool:
    """Return whether lines without column names begin with such cells of a clock, at `rate` frames a second.

    `width`: number of cells with coordinates
    """
    lines = [row for row in body[: min(LOOKED_AT, len(body) - body.is_cut)] if any(map(str.strip, row))]
    filled = sorted(len(row) - sum(1 for _ in takewhile(lambda cell: not cell.strip(), reversed(row))) for row in lines)
    # A single line may have a cell too many.
    if max(map(len, lines), default=0) < width + len(cells) or filled[len(filled) // 2] > width + len(cells):
        return False
    if not all(len(row) >= len(cells) and all(map(is_number, row[: len(cells)])) for row in lines):
        return False
    clock = np.array([[number_of(cell) for cell in row[: len(cells)]] for row in lines])
    counted, since = np.arange(len(lines)), clock - clock[0]
    if NUMBER_TITLE in cells and not ((since[:, 0] == counted).all() and float(clock[0, 0]).is_integer()):
        return False
    return TIME_TITLE not in cells or bool((np.abs(since[:, -1] * rate - counted) <= WITHIN_A_STEP).all())
