"""Find the one reading of a marker file in which every number has thousands separators of one kind.

Three kinds of number show that thousands are separated: 1,234.5 has both signs, 1,234,567 has two groups, and spaces or
apostrophes are never decimal separators. The last sign of 1,234.5 is the decimal one. Whole numbers such as 1,234 show
it beside times such as 0.005, where coordinates go from two different numbers such as 987 to 1,012. Read as decimals,
a coordinate would leap from 987 to 1.012, as to and from a code for a gap such as 999. Several different whole numbers
such as 987 in most lines show it too: numbers with decimals, codes for gaps and damage leave no such lines. So no guess
is needed, if the whole file agrees:

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
from functools import cache
from itertools import islice

from formats.importers.marker_lines import Rows
from formats.importers.number_cells import (
    CELL_END,
    DECIMALS,
    GAP_WORDS,
    GROUP_SIGNS,
    GROUPED,
    SIGNED,
    sign_of_line,
    with_point,
)
from formats.importers.short_lines import OF_THE_CLOCK

FEWEST_SHOWN = 3  # lines; our choice: one or two may be damaged
MOST_OTHERWISE = 0.1  # of those lines; our choice: more may be written in the other way, so the user has to decide
SIGN_NAMES = {",": "commas", ".": "points", "'": "apostrophes", "\u2019": "apostrophes"}  # every other sign is a space
FIRST_CELLS = 8  # cells; our choice: one of two markers' numbers contradicts a wrong decimal separator
DOUBTFUL = "doubtful"  # stands among the kinds for a frame number such as 1,500 that does not count on
# Of the larger number. Our choice: at 5 m/s and 50 frames a second, 1000 mm change by a tenth. A -1 for a gap leaps.
MOST_PASSED = 0.1
FEWEST_PASSED = 2  # different numbers below 1000; our choice: a file's code for a gap, such as 999, is one
# Different whole numbers in a line. Our choice: a file has one code for a gap, or two.
FEWEST_UNGROUPED = 3
MANY = 5  # digits, from which on every language separates thousands (Unicode CLDR, minimumGroupingDigits)
WHOLE_PART = re.compile(r"[+-]?(\d{4,})", re.ASCII)
PARTED = re.compile(rf"[+-]?\d{{1,3}}([,.{GROUP_SIGNS}])\d{{3}}", re.ASCII)
SPACED = re.compile(rf"[1-9]\d{{0,2}}[{GROUP_SIGNS}]\d{{3}}", re.ASCII)
BOTH_SIGNS = re.compile(r"[.,]\d{3}[.,]", re.ASCII)  # with two groups as well; begins with a sign, which is quick
BESIDE_ANOTHER = re.compile(
    r"(?=.*,)(?=.*\.).*?(?<![\d.,])[1-9]\d{0,2}[.,]\d{3}(?![\d.,])", re.ASCII
)  # 1,234 and a point
FRAME_NUMBER = re.compile(r"\W*[1-9]\d{0,2}[.,]\d{3}(?!\d)", re.ASCII)  # at the beginning of a line


@cache
def _patterns(decimal: str, sign: str, end: str) -> tuple[re.Pattern[str], ...]:
    """Return the patterns of a cell behind an `end`, of each kind:

    - of four digits or more without a separator
    - of four digits with one, and of `MANY` or more
    - whose separators leave no doubt
    """
    point, group = re.escape(decimal), re.escape(sign)
    behind = "" if sign not in DECIMALS.values() else rf"(?:{group}\d{{3}}|{point})"
    kinds = (
        r"(\d{4,})", rf"\d{group}\d{{3}}(?!{group})", rf"(?:\d{{2,3}}{group}|\d{group}\d{{3}}{group})",
    )  # fmt: skip
    certain = rf"{end}([+-]?\d{{1,3}}{group}\d{{3}}{behind}[^{end}]*)"
    return *(re.compile(rf"{end}[+-]?{kind}", re.ASCII) for kind in kinds), re.compile(certain, re.ASCII)


@cache
def _patterns_beside(decimal: str) -> tuple[re.Pattern[str], ...]:
    """Return the patterns of a cell whose separator is surely decimal, and of two kinds of cells behind a `CELL_END`.

    The two are whole numbers with thousands separators, and those below 1000.
    """
    point, group = re.escape(decimal), re.escape("," if decimal == "." else ".")
    return (
        re.compile(rf"\s*(?:0*{point}\d+|\d+{point}(?!\d{{3}}\s*$)\d+|\d{{4,}}{point}\d+)\s*", re.ASCII),
        re.compile(rf"{CELL_END}([+-]?[1-9]\d{{0,2}}(?:{group}\d{{3}})+)(?={CELL_END}|$)", re.ASCII),
        re.compile(rf"{CELL_END}[+-]?[1-9]\d{{0,2}}(?={CELL_END}|$)", re.ASCII),
    )


@dataclass
class _Reading:
    """Observations in the numbers of a file, read with this decimal separator.

    - `names`: kinds of thousands separators; `shown`: number of lines that show one, `example` the first of them
    - `beside`: number of lines with whole numbers that have one, beside a clock's decimals; `whole`: the first of them
    - `passed`: the numbers below 1000 of coordinates that pass 1000 there between two lines, as from 987 to 1,012
    - `below`: number of lines of `beside` with `FEWEST_UNGROUPED` different whole numbers below 1000
    - `wrong`: number of lines with a number that has another; `frame`, `before`: the last frame number, and the
      positions beside it, as text
    - `digits`: the whole parts that occur, by their digits, four or `MANY` and more, and whether with a separator
    """

    decimal: str
    names: set[str] = field(default_factory=set)
    shown: int = 0
    beside: int = 0
    passed: set[str] = field(default_factory=set)
    below: int = 0
    wrong: int = 0
    example: str = ""
    whole: str = ""
    frame: float = math.nan
    before: str = ""
    digits: set[tuple[int, bool]] = field(default_factory=set)

    def take(self, cells: list[str]) -> None:
        """Record a whole line's numbers."""
        frame, numbers = self.frame, list[str]()
        for cell in cells:
            if (number := with_point(cell, self.decimal)) is None:
                self.wrong, self.frame = self.wrong + 1, frame + 1
                return
            numbers.append(number)
        self.shown += self._take_cells(cells, numbers, frame + 1)
        self._take_beside(CELL_END.join(cells), CELL_END)

    def take_line(self, line: str, end: str, sign: str | None) -> None:
        """Record a whole line's numbers as `take` does, from its text.

        `end`: the delimiter of the cells; `sign`: the only thousands separator in them, '' without one, None if unknown
        """
        if sign is None:
            some = line.split(end, FIRST_CELLS)[:FIRST_CELLS]
            self.take(some if any(with_point(cell, self.decimal) is None for cell in some) else line.split(end))
            return
        first = line.partition(end)[0]
        is_shown = self._take_cells([first], [first.replace(sign, "").replace(self.decimal, ".")], self.frame + 1)
        self.shown += self._take_text(line[len(first) :], end, sign) or is_shown
        self._take_beside(line, end)

    def _take_beside(self, line: str, end: str) -> None:
        """Record a line whose whole numbers show thousands separators beside the decimals of its clock."""
        *clock, places = line.split(end, OF_THE_CLOCK)
        decimals, grouped, below = _patterns_beside(self.decimal)
        if not any(map(decimals.fullmatch, clock)):
            return
        before, self.before = self.before, places.replace(end, CELL_END)
        text = CELL_END + self.before
        if len(self.passed) < FEWEST_PASSED and below.search(CELL_END + before + text):
            pairs = zip(before.split(CELL_END), self.before.split(CELL_END), strict=False)
            self.passed |= {min(pair, key=len) for pair in pairs if self._goes_on(*pair)}
        if found := grouped.search(text):
            self.beside, self.whole = self.beside + 1, self.whole or found[1]
            self.below += len(set(below.findall(text))) >= FEWEST_UNGROUPED

    def _goes_on(self, one: str, other: str) -> bool:
        """Return whether two cells are near each other with a thousands separator in one of them alone."""
        sign = "," if self.decimal == "." else "."
        if (sign in one) == (sign in other):
            return False
        small, large = (_number(cell.replace(sign, "")) for cell in sorted([one, other], key=lambda cell: sign in cell))
        return abs(large - small) <= MOST_PASSED * abs(large)

    def _take_cells(self, cells: list[str], numbers: list[str], frame: float) -> bool:
        """Record the first cells of a line, one by one; return whether they show thousands separators.

        `numbers`: the cells with a decimal point; `frame`: the number that a next frame would have
        """
        is_shown = False
        for k, (cell, plain) in enumerate(zip(cells, numbers, strict=True)):
            parted = PARTED.match(cell)
            sign = parted[1] if parted and parted[1] != self.decimal else ""
            if k >= OF_THE_CLOCK and (whole := WHOLE_PART.match(plain)):
                self.digits.add((min(len(whole[1]), MANY), bool(sign)))
            is_next = k == 0 and _number(plain) == frame
            if k == 0:
                self.frame = _number(plain)
            if not sign:
                continue
            is_certain = sign not in DECIMALS.values() or self.decimal in cell or cell.count(sign) > 1
            is_doubtful = k == 0 and not (is_certain or is_next)
            self.names.add(DOUBTFUL if is_doubtful else SIGN_NAMES.get(sign, "spaces"))
            if is_certain or is_next:
                is_shown, self.example = True, self.example or cell
        return is_shown

    def _take_text(self, text: str, end: str, sign: str) -> bool:
        """Record the cells behind the first as `_take_cells` does; return whether they show thousands separators.

        `text`: the cells, each behind an `end`; `sign`: the only thousands separator in them, or ''
        """
        places = text[text.find(end, 1) :]  # behind the clock
        ungrouped, four, more, certain = _patterns(self.decimal, sign or GROUP_SIGNS[0], end)
        if ungrouped.search(places):
            self.digits |= {(min(len(whole), MANY), False) for whole in ungrouped.findall(places)}
        if not sign or sign not in text:
            return False
        for count, one in ((4, four), (MANY, more)):
            if (count, True) not in self.digits and one.search(places):
                self.digits.add((count, True))
        self.names.add(SIGN_NAMES.get(sign, "spaces"))
        if found := certain.search(text):
            self.example = self.example or found[1]
        return found is not None

    @property
    def is_shown(self) -> bool:
        """Whether the file shows this reading, and nothing against it."""
        is_even = (MANY, False) not in self.digits and not {(4, True), (4, False)} <= self.digits
        is_beside = len(self.passed) >= FEWEST_PASSED or 2 * self.below > self.beside  # most of these lines
        shown = max(self.shown, self.beside * is_beside)
        is_usual = shown >= FEWEST_SHOWN and self.wrong <= MOST_OTHERWISE * shown
        return is_usual and len(self.names) == 1 and is_even


def find_thousands(rows: Rows) -> tuple[str, str] | None:
    """Return the decimal separator of a file with thousands separators, and a warning; None if no reading is shown.

    rows: the lines below the first one of the header
    """
    if len(list(islice((line for line in rows.lines if _may_show(line, rows.separator)), FEWEST_SHOWN))) < FEWEST_SHOWN:
        return None
    rows = rows.frames()
    readings = [_Reading(decimal) for decimal in DECIMALS.values()]
    widths = Counter(rows.count_cells())
    width = max(widths, key=lambda one: widths[one], default=0)
    for at, line in enumerate(rows.lines):
        text, end, cells = rows.with_hyphens(line), rows.separator, list[str]()
        if '"' in text:
            cells = [cell.strip() for cell in rows[at]]
            if not any("\t" in cell for cell in cells):
                text, end = "\t".join(cells), "\t"
        signs: list[str | None] = [None, None]
        if '"' not in text and end != ",":
            signs = [sign_of_line(text, end, one.decimal) for one in readings]
        if signs == [None, None]:
            cells = cells or [cell.strip() for cell in rows[at]]
            if len(cells) >= width and all(map(_is_of_a_frame, cells)):
                for one in readings:
                    one.take(cells)
        elif text.count(end) >= width - 1:
            for one, sign in zip(readings, signs, strict=True):
                one.take_line(text, end, sign)
    found = next((one for one in readings if one.is_shown), None)  # both agree only where no number has decimals
    if found is None:
        return None
    example = found.example or found.whole
    return found.decimal, f"{next(iter(found.names))} were read as thousands separators, as in {example}"


def _may_show(line: str, separator: str) -> bool:
    """Return whether a line's text may hold a number that shows thousands separators; cells would take longer."""
    if any(sign in line for sign in GROUP_SIGNS) and SPACED.search(line):
        return True
    are_cells_whole = separator != "," or '"' in line
    shows = FRAME_NUMBER.match(line) or BOTH_SIGNS.search(line) or BESIDE_ANOTHER.match(line)
    return are_cells_whole and shows is not None


def _is_of_a_frame(cell: str) -> bool:
    """Return whether a cell is a number, perhaps with thousands separators, or stands for a missing value."""
    return SIGNED.fullmatch(cell) is not None or GROUPED.fullmatch(cell) is not None or cell.lower() in GAP_WORDS


def _number(plain: str) -> float:
    try:
        return float(plain)
    except ValueError:
        return math.nan
