"""Marker paths of text files: TRC, CSV of Vicon Nexus and of OptiTrack Motive, TSV of Qualisys, and our own CSV.

Cells may be parted by commas, semicolons or tabs, decimals by a comma where cells are not. `marker_lines` finds the
header, whose first word shows which program wrote a file.

Sources: OpenSim, "Marker (.trc) Files"; Vicon Nexus, "ASCII (.csv) export"; OptiTrack, "Data Export: CSV";
Qualisys Track Manager, "TSV export".
"""

from __future__ import annotations

import contextlib
import math
import re
from itertools import takewhile
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.marker_lines import CAN_BE_READ, COMMENT, TRAJECTORIES, Rows, read_lines
from formats.importers.marker_tracks import MarkerTracks, as_seen
from formats.importers.units import AXES, metres_of
from formats.rows import spreadsheet_cell

DECIMAL_COMMA = re.compile(r"^\s*-?\d+,\d+(e[+-]?\d+)?\s*$", re.IGNORECASE)
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)  # `float` takes 1_0 as well
PLAIN = frozenset("0123456789+-.eE ")  # `float` makes of these letters what `NUMBER` knows, or refuses them
MOST_NUMBERS = 1 << 25  # of a file: 19 minutes of 81 markers at 120 frames a second
LONGEST_SHOWN = 40  # characters of a cell in a message
LONGEST_HEAD = 1000  # lines above the first frame: Qualisys writes one for each event
COLUMNS = "time_s,NAME_x_m,NAME_y_m,NAME_z_m,... with three columns for each marker"
# Of programs, spreadsheets (#N/A), R (NA), and the C libraries of Windows (-nan(ind), 1.#QNAN).
GAP_WORDS = {
    "", "-", "--", "nan", "null", "none", "n/a", "na", "#n/a", "#n/v", "nan(ind)", "1.#ind", "1.#qnan", "1.#nan",
}  # fmt: skip


def read_marker_text(path: Path, unit: str | None) -> MarkerTracks:
    """Read the marker paths of a text file; unit: of its lengths, where it states none.

    Raises:
        TakeError: the file is of none of the known kinds, malformed, or has fewer frames than it states.
    """
    first, rows = read_lines(path)
    programs = {"pathfiletype": _trc, "format version": _motive, "no_of_frames": _qualisys, "trajectories": _vicon}
    return programs.get(first, _own)(rows, unit, path)


def _numbers(rows: Rows, width: int, path: Path, *, is_exact: bool = False) -> Floats:
    """Return rows of numbers, (rows, width), NaN for a cell that says that nothing was seen.

    is_exact: whether a line must have as many cells as the first one has. Without it, ends of lines may be left out,
    but not of a last line that has no end itself.
    """
    if len(rows) * width > MOST_NUMBERS:
        raise TakeError(
            f"holds {len(rows)} frames of {width} numbers", where=path, advice="export fewer markers or frames"
        )
    values = np.full((len(rows), width), np.nan)
    for k, row in enumerate(rows):
        if rows.is_cut and k == len(rows) - 1 and len(row) < width:
            raise TakeError(
                f"ends within line {rows.numbers[k]}, after {len(row)} of its {width} cells", where=path,
                advice="it is cut off: copy or export it again",
            )  # fmt: skip
        if not is_exact and len(row) < width and _is_cut(row):
            raise TakeError(
                f"line {rows.numbers[k]} ends within a number, after {len(row)} of its {width} cells", where=path,
                advice="the line is cut off: copy or export the file again",
            )  # fmt: skip
        if not is_exact and any(cell.strip() for cell in row[width:]):
            raise TakeError(
                f"line {rows.numbers[k]} has {len(row)} cells, the header names {width}", where=path,
                advice="the header lacks markers, or the line has cells too many: export it again",
            )  # fmt: skip
        cells = row if is_exact else [*row[:width], *[""] * (width - len(row))]
        if len(cells) != width:
            raise TakeError(
                f"line {rows.numbers[k]} has {len(cells)} columns, not {width}", where=path, advice="mend that line"
            )
        try:
            values[k] = _row(cells)
        except ValueError as error:
            raise TakeError(
                f"line {rows.numbers[k]} holds {error}, which is no number", where=path,
                advice="mend that line",
            ) from error  # fmt: skip
    return values


def _is_cut(row: list[str]) -> bool:
    """Return whether the last cell of a row lacks digits behind its point that all other places of the row have.

    Many programs write every place with as many digits. A cell without some of them was cut, and its number is
    another one. The first two cells are a frame's number and time.
    """
    written = {count for cell in row[2:-1] if (count := _digits(cell))}
    return len(written) == 1 and bool(row[-1].strip()) and _digits(row[-1]) < min(written)


def _digits(cell: str) -> int:
    """Return how many digits stand behind the point, or the decimal comma, of a cell."""
    return len(cell.strip().replace(",", ".").partition(".")[2])


def _row(cells: list[str]) -> list[float]:
    """Return the numbers of cells, as `_number` does, five times as quickly where all of them are plain.

    Raises:
        ValueError: as `_number`.
    """
    if PLAIN.issuperset("".join(cells)):
        with contextlib.suppress(ValueError):
            numbers = [float(cell) for cell in cells]
            if not (math.inf in numbers or -math.inf in numbers):
                return numbers
    return [_number(cell) for cell in cells]


def _number(cell: str) -> float:
    """Return the number of a cell, NaN where it says that nothing was seen.

    Raises:
        ValueError: it holds anything else, and names that.
    """
    word = cell.strip().lower()
    if word.lstrip("+-") in GAP_WORDS or word in GAP_WORDS:
        return np.nan
    plain = word.replace(",", ".") if DECIMAL_COMMA.match(word) else word
    # No place is infinite, as 1e999 is: to read it as a gap would hide a fault.
    if not NUMBER.fullmatch(plain) or np.isinf(number := float(plain)):
        raise ValueError(repr(cell.strip()[:LONGEST_SHOWN]))
    return number


def _tracks(
    labels: list[str], time: Floats, values: Floats, metres: float, path: Path, rate: float | None = None,
    doubt: str = "",
) -> MarkerTracks:  # fmt: skip
    if not labels:
        raise TakeError("names no markers", where=path, advice="export the trajectories with their names")
    positions = values[:, : 3 * len(labels)].reshape(len(values), len(labels), 3) * metres
    return MarkerTracks(tuple(label.strip() for label in labels), time, as_seen(positions), rate, doubt)


def _cell(row: list[str], at: int) -> str:
    return row[at].strip().lower() if at < len(row) else ""


def _whole(cell: str, what: str, path: Path) -> int:
    try:
        return int(_number(cell))
    except (ValueError, OverflowError) as error:
        raise TakeError(f"its {what} is {cell.strip()!r}, no number", where=path, advice="export it again") from error


def _rate(cell: str, path: Path) -> float:
    try:
        rate = _number(cell)
    except ValueError:
        rate = np.nan
    if not 0 < rate < 1e4:
        shown = cell.strip()[:LONGEST_SHOWN]
        raise TakeError(f"its frame rate is {shown!r}", where=path, advice="export it with its frame rate")
    return rate


def _rate_beside_times(cell: str) -> float | None:
    """Return the frame rate that a file with a time for each frame states, None where it states none."""
    try:
        rate = _number(cell)
    except ValueError:
        return None
    return rate if rate > 0 else None


def _doubt_of_count(found: int, stated: int, path: Path) -> str:
    """Return a sentence about a file of more frames than it states, '' where they agree.

    Programs that cut or join recordings may leave the old count. All frames that are there are read.

    Raises:
        TakeError: it holds fewer.
    """
    if found > stated:
        return f"the file states {stated} frames and holds {found}; all of them were read"
    if found < stated:
        raise TakeError(
            f"holds {found} of the {stated} frames that it states", where=path,
            advice="it is cut off: copy or export it again",
        )  # fmt: skip
    return ""


def _own(rows: Rows, unit: str | None, path: Path) -> MarkerTracks:
    line, head = (rows.numbers[0], [_as_named(cell) for cell in rows[0]]) if rows else (1, [""])
    if head[0].strip(f"{COMMENT} ") != "time_s":
        raise TakeError(
            f"no line names the columns; line {line} begins with {head[0][:LONGEST_SHOWN]!r}", where=path,
            advice=f"put above the frames {COLUMNS}; TRC, Vicon, Motive and Qualisys exports are read as they are",
        )  # fmt: skip
    labels = [name.removesuffix(AXES[0]) for name in head[1::3]]
    for k, name in enumerate((label + axis for label in labels for axis in AXES), 1):
        if k >= len(head) or head[k] != name:
            there = f"is {head[k][:LONGEST_SHOWN]!r}" if k < len(head) else "is missing"
            raise TakeError(
                f"column {k + 1} of line {line} {there}, not {name[:LONGEST_SHOWN]!r}", where=path,
                advice=f"that line must be {COLUMNS}",
            )  # fmt: skip
    values = _numbers(rows[1:], len(head), path, is_exact=True)
    return _tracks(labels, values[:, 0], values[:, 1:], metres_of("m", unit, path), path)


def _as_named(cell: str) -> str:
    """Return a name without the apostrophe that keeps a spreadsheet from running it as a formula."""
    word = cell.strip()
    return word[1:] if word.startswith("'") and spreadsheet_cell(word[1:]) == word else word


def _trc(rows: Rows, unit: str | None, path: Path) -> MarkerTracks:
    """OpenSim's: a line of names and a line of values, then `Frame#`, `Time` and a marker's name every three cells."""
    if len(rows) < 5:
        raise TakeError("ends within its header", where=path, advice=f"export it again; {CAN_BE_READ}")
    stated = dict(zip((cell.strip().lower() for cell in rows[1]), rows[2], strict=False))
    count = _whole(stated.get("nummarkers", ""), "number of markers", path)
    names = [cell.strip() for cell in rows[3][2:] if cell.strip()]
    if len(names) != count:
        raise TakeError(f"names {len(names)} markers and states {count}", where=path, advice="export it again")
    body = rows[5:]
    metres = metres_of(stated.get("units", ""), unit, path)
    doubt = _doubt_of_count(len(body), _whole(stated.get("numframes", ""), "number of frames", path), path)
    values = _numbers(body, 2 + 3 * count, path)
    rate = _rate_beside_times(stated.get("datarate", ""))
    return _tracks(names, values[:, 1], values[:, 2:], metres, path, rate, doubt)


def _vicon(rows: Rows, unit: str | None, path: Path) -> MarkerTracks:
    """Nexus': after `Trajectories` the rate, names above X, Y and Z, their units, then frames by their number.

    A row of units that holds none, or that is not there, leaves the unit to be given.
    """
    section = rows[1:]
    if len(section) < 4:
        raise TakeError("ends within the header of its trajectories", where=path, advice="export it again")
    rate = _rate(section[0][0], path)
    names, kinds = section[1], section[2]
    has_units = not section[3][0].strip().isdigit()  # lines that hold nothing are left out
    units, section = (section[3], section[4:]) if has_units else ([], section[3:])
    at = [k for k in range(2, len(kinds) - 2) if [cell.strip().upper() for cell in kinds[k : k + 3]] == ["X", "Y", "Z"]]
    labels = [names[k].strip() if k < len(names) else "" for k in at]
    stated = {units[k].strip() for k in at if k < len(units)}
    if len(stated) > 1:
        raise TakeError(f"states several units: {', '.join(sorted(stated))}", where=path, advice="export in one")
    metres = metres_of(next(iter(stated), ""), unit, path)
    count = sum(1 for _ in takewhile(lambda row: row[0].strip().lstrip("-").isdigit(), section))
    body, behind = section[:count], next(iter(section[count : count + 1]), None)
    if behind and _cell(behind, 1).isdigit():
        raise TakeError(  # the number of a sub frame: this is a frame, and no title of the next section
            f"line {section.numbers[count]} holds {behind[0].strip()[:LONGEST_SHOWN]!r}, which is no number",
            where=path, advice="mend that line",
        )  # fmt: skip
    if (second := _second_trajectories(section[count:])) is not None:
        raise TakeError(
            f"has trajectories twice, in lines {rows.numbers[0]} and {second}", where=path,
            advice="export one section of trajectories, or put the second into a file of its own",
        )  # fmt: skip
    values = _numbers(body, len(kinds), path)
    return _tracks(labels, values[:, 0] / rate, values[:, [k + axis for k in at for axis in range(3)]], metres, path)


def _second_trajectories(rows: Rows) -> int | None:
    """Return the number of the line with which another section of trajectories begins, None without one."""
    begins = (number for number, line in zip(rows.numbers, rows.lines, strict=True) if TRAJECTORIES.match(line))
    return next(begins, None)


def _motive(rows: Rows, unit: str | None, path: Path) -> MarkerTracks:
    """OptiTrack's: names and values in the first line, then rows `Type`, `Name`, ... above `Frame`, `Time`."""
    stated = {name.strip().lower(): value for name, value in zip(rows[0][::2], rows[0][1::2], strict=False)}
    heads = {row[1].strip().lower(): row for row in rows[1:9] if len(row) > 1 and not row[0].strip()}
    begin = next((k for k, row in enumerate(rows[:12]) if row[0].strip().lower() == "frame"), None)
    if begin is None or "name" not in heads or "type" not in heads:
        raise TakeError("has no rows that name its markers", where=path, advice="export it with its header")
    axes, names, kinds = rows[begin], heads["name"], heads["type"]
    what = next((row for row in rows[1:begin] if "Position" in [cell.strip() for cell in row]), axes)
    at = [
        k for k in range(2, len(axes) - 2)
        if [cell.strip().upper() for cell in axes[k : k + 3]] == ["X", "Y", "Z"]
        and _cell(kinds, k) == "marker" and (what is axes or _cell(what, k) == "position")
    ]  # fmt: skip
    body = rows[begin + 1 :]
    total = stated.get("total exported frames", "")
    doubt = _doubt_of_count(len(body), _whole(total, "number of frames", path), path) if total.strip() else ""
    values = _numbers(body, len(axes), path)
    metres = metres_of(stated.get("length units", ""), unit, path)
    columns = [k + axis for k in at for axis in range(3)]
    labels = [names[k] if k < len(names) else "" for k in at]
    rate = _rate_beside_times(stated.get("export frame rate", "") or stated.get("capture frame rate", ""))
    return _tracks(labels, values[:, 1], values[:, columns], metres, path, rate, doubt)


def _qualisys(rows: Rows, unit: str | None, path: Path) -> MarkerTracks:
    """QTM's: lines of a name and its value, `MARKER_NAMES`, then a row of x, y, z a frame, in millimetres."""
    head = list(takewhile(lambda row: re.fullmatch(r"[A-Z_]+", row[0].strip()), rows[:LONGEST_HEAD]))
    stated = {row[0].strip().upper(): row[1:] for row in head}

    def value(name: str) -> str:
        return next(iter(stated.get(name, [])), "")

    names = [cell.strip() for cell in stated.get("MARKER_NAMES", []) if cell.strip()]
    if (count := _whole(value("NO_OF_MARKERS"), "number of markers", path)) != len(names):
        raise TakeError(f"names {len(names)} markers and states {count}", where=path, advice="export it again")
    rate = _rate(value("FREQUENCY"), path)
    begin = len(head)
    has_clock = begin < len(rows) and rows[begin][0].strip().lower() == "frame"
    count_of_frames = _whole(value("NO_OF_FRAMES"), "number of frames", path)
    body = rows[begin + has_clock :]
    end = len(body)
    while end > count_of_frames and not any(cell.strip() for cell in body[end - 1]):
        end -= 1
    body = body[:end]
    doubt = _doubt_of_count(end, count_of_frames, path)
    values = _numbers(body, 3 * count + 2 * has_clock, path)
    time = values[:, 1] if has_clock else np.arange(len(values)) / rate
    return _tracks(names, time, values[:, 2 * has_clock :], metres_of("mm", unit, path), path, rate, doubt)
