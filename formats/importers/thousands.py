"""Find the one reading of a marker file in which every number has thousands separators of one kind.

Three kinds of number show that thousands are separated: 1,234.5 has both signs, 1,234,567 has two groups, and spaces or
apostrophes are never decimal separators. The last sign of 1,234.5 is the decimal one. So no guess is needed, if the
whole file agrees:

- Every number has that decimal separator, and one kind of thousands separator. The error of a few lines with another
  decimal separator then names them.
- At least `FEWEST_SHOWN` whole lines have such a number, since a lost delimiter joins two numbers of a line to one.
- Positions from 10,000 on all have the separator. Those from 1000 on all have it, or none has it, as in Spanish.

Frame numbers that count on from 999 to 1,000 show the same.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from itertools import islice

from formats.importers.marker_lines import Rows
from formats.importers.number_cells import DECIMALS, GAP_WORDS, GROUP_SIGNS, GROUPED, SIGNED, with_point
from formats.importers.short_lines import OF_THE_CLOCK

FEWEST_SHOWN = 3  # lines; our choice: one or two may be damaged
MOST_OTHERWISE = 0.1  # of those lines; our choice: more may be written in the other way, so the user has to decide
SIGN_NAMES = {",": "commas", ".": "points", "'": "apostrophes", "\u2019": "apostrophes"}  # every other sign is a space
DOUBTFUL = "doubtful"  # stands among the kinds for a frame number such as 1,500 that does not count on
MANY = 5  # digits, from which on every language separates thousands (Unicode CLDR, minimumGroupingDigits)
WHOLE_PART = re.compile(r"[+-]?(\d{4,})", re.ASCII)
PARTED = re.compile(rf"[+-]?\d{{1,3}}([,.{GROUP_SIGNS}])\d{{3}}", re.ASCII)
SPACED = re.compile(rf"[1-9]\d{{0,2}}[{GROUP_SIGNS}]\d{{3}}", re.ASCII)
BOTH_SIGNS = re.compile(r"[.,]\d{3}[.,]", re.ASCII)  # with two groups as well; begins with a sign, which is quick
FRAME_NUMBER = re.compile(r"\W*[1-9]\d{0,2}[.,]\d{3}(?!\d)", re.ASCII)  # at the beginning of a line


@dataclass
class _Reading:
    """Observations in the numbers of a file, read with this decimal separator.

    - `names`: kinds of thousands separators; `shown`: number of lines that show one, `example` the first of them
    - `wrong`: number of lines with a number that has another; `frame`: the last frame number
    - `digits`: the whole parts that occur, by their digits, four or `MANY` and more, and whether with a separator
    """

    decimal: str
    names: set[str] = field(default_factory=set)
    shown: int = 0
    wrong: int = 0
    example: str = ""
    frame: float = math.nan
    digits: set[tuple[int, bool]] = field(default_factory=set)

    def take(self, cells: list[str]) -> None:
        """Record a whole line's numbers."""
        is_shown, frame = False, self.frame
        numbers = []
        for cell in cells:
            if (number := with_point(cell, self.decimal)) is None:
                self.wrong, self.frame = self.wrong + 1, frame + 1
                return
            numbers.append(number)
        for k, (cell, plain) in enumerate(zip(cells, numbers, strict=True)):
            parted = PARTED.match(cell)
            sign = parted[1] if parted and parted[1] != self.decimal else ""
            if k >= OF_THE_CLOCK and (whole := WHOLE_PART.match(plain)):
                self.digits.add((min(len(whole[1]), MANY), bool(sign)))
            is_next = k == 0 and _number(plain) == frame + 1
            if k == 0:
                self.frame = _number(plain)
            if not sign:
                continue
            is_certain = sign not in DECIMALS.values() or self.decimal in cell or cell.count(sign) > 1
            is_doubtful = k == 0 and not (is_certain or is_next)
            self.names.add(DOUBTFUL if is_doubtful else SIGN_NAMES.get(sign, "spaces"))
            if is_certain or is_next:
                is_shown, self.example = True, self.example or cell
        self.shown += is_shown

    @property
    def is_shown(self) -> bool:
        """Whether the file shows this reading, and nothing against it."""
        is_even = (MANY, False) not in self.digits and not {(4, True), (4, False)} <= self.digits
        is_usual = self.shown >= FEWEST_SHOWN and self.wrong <= MOST_OTHERWISE * self.shown
        return is_usual and len(self.names) == 1 and is_even


def find_thousands(rows: Rows) -> tuple[str, str] | None:
    """Return the decimal separator of a file with thousands separators, and a warning; None if no reading is shown.

    rows: the lines below the first one of the header
    """
    if len(list(islice((line for line in rows.lines if _may_show(line, rows.separator)), FEWEST_SHOWN))) < FEWEST_SHOWN:
        return None
    rows = rows.frames()
    readings = [_Reading(decimal) for decimal in DECIMALS.values()]
    widths = Counter(len(row) for row in rows)
    width = max(widths, key=lambda one: widths[one], default=0)
    for row in rows:
        cells = [cell.strip() for cell in row]
        if len(cells) < width or not all(_is_of_a_frame(cell) for cell in cells):
            continue
        for one in readings:
            one.take(cells)
    found = next((one for one in readings if one.is_shown), None)  # both agree only where no number has decimals
    if found is None:
        return None
    return found.decimal, f"{next(iter(found.names))} were read as thousands separators, as in {found.example}"


def _may_show(line: str, separator: str) -> bool:
    """Return whether a line's text may hold a number that shows thousands separators; cells would take longer."""
    if any(sign in line for sign in GROUP_SIGNS) and SPACED.search(line):
        return True
    are_cells_whole = separator != "," or '"' in line
    return are_cells_whole and (FRAME_NUMBER.match(line) or BOTH_SIGNS.search(line)) is not None


def _is_of_a_frame(cell: str) -> bool:
    """Return whether a cell is a number, perhaps with thousands separators, or stands for a missing value."""
    return SIGNED.fullmatch(cell) is not None or GROUPED.fullmatch(cell) is not None or cell.lower() in GAP_WORDS


def _number(plain: str) -> float:
    try:
        return float(plain)
    except ValueError:
        return math.nan
