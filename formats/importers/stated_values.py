"""Read the names, counts and frame rates that the header of a marker text file states."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from formats.errors import TakeError
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import CELL_SHOWN, DECIMALS, is_number, number_of, with_point
from formats.plain_text import MOST_LISTED, counted, first_few
from formats.plausible import USABLE_RATES

# The next step for a file that holds fewer frames than it states. A program that shortens a recording may leave the
# old count, so that the file need not be cut off.
FEWER_FRAMES = "the file is cut off, or that number is wrong: copy or export the file again"


def names_of(labels: list[str], path: Path) -> tuple[str, ...]:
    """Return the names of markers.

    Raises:
        TakeError: there is none.
    """
    if not labels:
        raise TakeError("names no markers", where=path, advice="export the trajectories with their names")
    return tuple(label.strip() for label in labels)


def cell_at(row: list[str], at: int, *, as_is: bool = False) -> str:
    """Return a cell in lowercase, or unchanged with `as_is`; '' where the line is shorter."""
    cell = row[at].strip() if at < len(row) else ""
    return cell if as_is else cell.lower()


def whole_number(cell: str, what: str, path: Path, found: int) -> int:
    """Return the whole number in a cell; `what` names the quantity in an error.

    A comma or point before three digits may separate thousands, as in 1,030, or decimals, as in 60.000. Of both
    readings, the one counts that is nearer to the number in the file by its ratio.

    found: the number of what the file holds

    Raises:
        TakeError: the cell holds no whole number.
    """
    plain = next(filter(None, (with_point(cell, sign) for sign in DECIMALS.values() if cell.count(sign) != 1)), cell)
    try:
        readings = [number_of(one) for one in (plain, cell) if is_number(one)]
    except ValueError:  # infinite
        readings = []
    whole = [int(one) for one in readings if one == int(one)]
    if not whole:
        kind = "whole number" if readings else "number"
        raise TakeError(f"its {what} is {cell.strip()!r}, no {kind}", where=path, advice="export it again")
    return min(whole, key=lambda one: abs(math.log(max(one, 1) / max(found, 1))))


def frame_rate(cell: str, path: Path) -> float:
    """Return the frame rate [1/s] that a file without times states.

    Raises:
        TakeError: the rate is missing or out of range.
    """
    try:
        rate = number_of(cell)
    except ValueError:
        rate = np.nan
    if not 0 < rate < 1e4:
        shown = repr(cell.strip()[:CELL_SHOWN]) + f"; {USABLE_RATES}" * bool(rate > 0)
        raise TakeError(f"its frame rate is {shown}", where=path, advice="export it with its frame rate")
    return rate


def rate_beside_times(cell: str) -> float | None:
    """Return the frame rate [1/s] that a file states besides its times, None where it states none."""
    try:
        rate = number_of(cell)
    except ValueError:
        return None
    return rate if rate > 0 else None


def warning_of_count(rows: Rows, stated: int, wanted: int | None, path: Path, *, are_numbered: bool = True) -> str:
    """Return a warning of a file with more frames than it states, '' where no further frame is wanted.

    Programs that cut or join recordings may leave the old count. All wanted frames in the file are read.

    - `rows`: the frames' lines; `are_numbered`: they begin with the frame's number

    Raises:
        TakeError: the file holds fewer frames than it states.
    """
    found = len(rows)
    read = found if wanted is None else min(wanted, found)
    if read > stated:
        which = "all of them" if read == found else f"the first {read}"
        return f"the file states {counted(stated, 'frame')} and holds {found}; {which} were read"
    if found < stated:
        if are_numbered and (lost := _lost_within(rows, stated - found)):
            raise TakeError(
                f"holds {found} of the {stated} frames that it states: {lost}", where=path,
                advice="copy or export the file again",
            )  # fmt: skip
        raise TakeError(
            f"holds {found} of the {stated} frames that it states", where=path,
            advice=FEWER_FRAMES,
        )  # fmt: skip
    return ""


def _lost_within(rows: Rows, count: int) -> str:
    """Return which `count` frames are missing between which lines, by their numbers; '' where these show others."""
    try:
        numbers = np.array([int(line.partition(rows.separator)[0].strip(' "')) for line in rows.lines], float)
    except ValueError:  # a cell that holds no whole number
        return ""
    lost = np.diff(numbers) - 1
    holes = np.flatnonzero(lost).tolist()
    if not holes or (lost < 0).any() or lost.sum() != count:
        return ""
    each = [
        f"{missing_frames(int(numbers[at]) + 1, int(numbers[at + 1]) - 1)} missing behind line {rows.numbers[at]}"
        for at in holes[:MOST_LISTED]
    ]
    return first_few(each, len(holes))


def missing_frames(begin: int, end: int) -> str:
    """Return missing frame numbers in words, from the first to the last."""
    return f"frame {begin} is" if begin == end else f"frames {begin} to {end} are"
