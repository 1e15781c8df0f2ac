"""Decide whether the commas or points in a marker file are decimal or thousands separators.

Where points and commas both occur, one of them separates thousands. Commas alone are decimal separators, unless each
has one to three digits before it and three behind, as in 1,234. Then the file may hold whole numbers with thousands
separators. The same holds for points alone where semicolons delimit cells, as in countries with a decimal comma. A
position of four digits without a separator shows that the file has no thousands separators.

Four observations decide further:

- No position is 1000 m away. So a separator that would make one is no thousands separator.
- Decimals read as thousands are 1000 times as large, and so is the noise of cameras. Most positions then jump as no
  cloth does.
- A path that crosses 1000 goes from 987 to 1.012. Read as decimals the path jumps, and read as thousands it does not.
  Decimals read as thousands jump farther, and never less often. So this holds for every cell delimiter.
- A coordinate that moves through whole numbers only, beside others that always have three decimals, has no decimals.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE
from formats.importers.number_cells import CELL_SHOWN, is_number
from formats.importers.path_outliers import LARGEST_OUTLIER_SHARE, are_jumps
from formats.plausible import SLOWEST

OF_THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2}[,.]\d{3}\s*", re.ASCII)
UNPARTED = re.compile(r"\s*[+-]?\d{4,}\s*", re.ASCII)
WHOLE_PLACE = re.compile(r"\s*[+-]?[1-9]\d*\s*", re.ASCII)
FEWEST_WHOLE = 3  # different whole numbers of one coordinate; only 1 in 1000 numbers with three decimals is whole


@dataclass
class DecimalSeparators:
    """The separators found so far in a file's numbers.

    - `begin`: number of cells before the first position
    - `parts_thousands`: the thousands separator with which the file is read, '' for none
    - `point`, `comma`: the first number with a decimal point, and the first with a comma, '' without one
    - `of_thousands`: the first position whose separator may be for decimals or thousands, '' without one
    - `has_clock_of_decimals`: whether a time or frame number shows that its separator is a decimal one
    """

    begin: int = 0
    parts_thousands: str = ""
    point: str = ""
    comma: str = ""
    of_thousands: str = ""
    has_clock_of_decimals: bool = False
    _may_part_thousands: bool = True
    _whole: dict[int, set[str]] = field(default_factory=lambda: defaultdict(set))  # by column, a few whole numbers

    def are_usual(self, separator: str) -> bool:
        """Return whether files with this cell delimiter and such numbers usually have thousands separators."""
        has_usual_signs = not self.has_clock_of_decimals and (bool(self.comma) or separator == ";")
        return has_usual_signs or any(len(found) >= FEWEST_WHOLE for found in self._whole.values())

    @property
    def are_mixed(self) -> bool:
        """Whether some numbers have a point and some a comma."""
        return bool(self.point and self.comma)

    def look(self, cells: list[str], text: str) -> None:
        """Record the separators in a line's cells; refuse a file in which some numbers have a point and some a comma.

        Raises:
            ValueError: quotes one number of each kind.
        """
        if "." in text and not self.point:
            self.point = _first_with(".", cells)
        if "," in text and not self.comma:
            self.comma = _first_with(",", cells)
        if self.are_mixed:
            raise ValueError(f"{self.comma!r} beside {self.point!r}: which of them is the decimal separator?")
        if self._may_part_thousands and (self.point or self.comma):
            self._look_for_thousands(cells)

    def _look_for_thousands(self, cells: list[str]) -> None:
        signed = [cell for cell in cells[self.begin :] if "," in cell or "." in cell]
        unparted = any(map(UNPARTED.fullmatch, cells[self.begin :]))
        self._may_part_thousands = not unparted and all(map(OF_THOUSANDS.fullmatch, signed))
        first = self.of_thousands or next(iter(signed), "").strip()
        self.of_thousands = first if self._may_part_thousands else ""
        for k, cell in enumerate(cells[self.begin :]):
            if WHOLE_PLACE.fullmatch(cell) and len(self._whole[k]) < FEWEST_WHOLE:
                self._whole[k].add(cell)
        clock = (cell for cell in cells[: self.begin] if "," in cell or "." in cell)
        self.has_clock_of_decimals |= not all(map(OF_THOUSANDS.fullmatch, clock))


def _first_with(sign: str, cells: list[str]) -> str:
    return next((cell.strip()[:CELL_SHOWN] for cell in cells if sign in cell and is_number(cell)), "")


def fewer_jump(time: Floats, positions: Floats, large: Floats) -> bool:
    """Return whether fewer positions jump when separators are read as thousands separators.

    `time` [s], (frames,); `positions` and `large` [m], (frames, markers, 3), NaN where not seen, as read with decimal
    and with thousands separators
    """
    if not (np.diff(time) > 0).all():
        return False
    return bool(are_jumps(time, large).sum() < are_jumps(time, positions).sum())


def are_too_far(large: Floats) -> bool:
    """Return whether any position [m], NaN where not seen, is farther away than the positions of any recording."""
    return bool((np.abs(large) >= FARTHEST_PLACE).any())


def may_be_motion(time: Floats, positions: Floats) -> bool:
    """Return whether positions may be recorded motion of cloth: few jump, and the frame rate is high enough.

    - `time` [s], (frames,); `positions` [m], (frames, markers, 3), NaN where not seen
    """
    if len(time) < 3:
        return True
    steps = np.diff(time)
    if not (steps > 0).all() or float(np.median(steps)) > 1 / SLOWEST:
        return False
    seen = np.isfinite(positions[:-2]) & np.isfinite(positions[1:-1]) & np.isfinite(positions[2:])
    return bool(are_jumps(time, positions).sum() <= LARGEST_OUTLIER_SHARE * seen.sum())
