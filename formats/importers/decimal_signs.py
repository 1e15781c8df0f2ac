"""Tell whether the commas or points of a file of marker paths part decimals or thousands.

A point beside a comma shows that one of them parts thousands. Commas alone part decimals, unless each has one to three
digits before it and three behind, as in 1,234. Then the file may hold whole numbers, of which commas part thousands.
The same holds of points alone where semicolons part cells, as where commas part decimals. Four digits of a place
without a sign show that no sign parts thousands.

Four things tell more:

- no place is 1000 m away, so nothing parts thousands of metres;
- such places are 1000 times as far away, and so is the noise of cameras: most places then leap as no cloth does;
- a path that crosses 1000 goes from 987 to 1.012. Read as decimals it leaps, and read as thousands it does not.
  Decimals that are read as thousands leap farther, and never less often. So this holds whatever parts cells;
- a coordinate that moves through whole numbers alone, beside others that always have three decimals, has no decimals.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE
from formats.importers.number_cells import LONGEST_SHOWN, is_number
from formats.importers.strays import MOST_STRAYS, leaps_ahead
from formats.plausible import SLOWEST

OF_THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2}[,.]\d{3}\s*", re.ASCII)
UNPARTED = re.compile(r"\s*[+-]?\d{4,}\s*", re.ASCII)
WHOLE_PLACE = re.compile(r"\s*[+-]?[1-9]\d*\s*", re.ASCII)
MOVING = 3  # different whole numbers of a coordinate: of 1000 numbers with decimals one is whole


@dataclass
class DecimalSigns:
    """The first number of a file with a decimal point, and the first one with a comma, '' without one.

    - `begin`: cells before the first place
    - `parts_thousands`: the sign with which the file is read so, '' for none
    - `of_thousands`: the first place whose sign may part thousands as well as decimals, '' without one
    - `has_clock_of_decimals`: whether a time or the number of a frame shows that its sign parts decimals
    """

    begin: int = 0
    parts_thousands: str = ""
    point: str = ""
    comma: str = ""
    of_thousands: str = ""
    has_clock_of_decimals: bool = False
    _may_part_thousands: bool = True
    _whole: dict[int, set[str]] = field(default_factory=lambda: defaultdict(set))  # some of each column

    def are_usual(self, separator: str) -> bool:
        """Return whether files that are written so have such signs between thousands."""
        has_usual_signs = not self.has_clock_of_decimals and (bool(self.comma) or separator == ";")
        return has_usual_signs or any(len(found) >= MOVING for found in self._whole.values())

    @property
    def are_mixed(self) -> bool:
        """Whether some numbers have a point and some a comma."""
        return bool(self.point and self.comma)

    def look(self, cells: list[str], text: str) -> None:
        """Refuse a file in which some numbers have a point and some a comma: one of them parts thousands.

        Raises:
            ValueError: names one of each.
        """
        if "." in text and not self.point:
            self.point = _first_with(".", cells)
        if "," in text and not self.comma:
            self.comma = _first_with(",", cells)
        if self.are_mixed:
            raise ValueError(f"{self.comma!r} beside {self.point!r}: which of them parts decimals?")
        if self._may_part_thousands and (self.point or self.comma):
            self._look_for_thousands(cells)

    def _look_for_thousands(self, cells: list[str]) -> None:
        signed = [cell for cell in cells[self.begin :] if "," in cell or "." in cell]
        unparted = any(map(UNPARTED.fullmatch, cells[self.begin :]))
        self._may_part_thousands = not unparted and all(map(OF_THOUSANDS.fullmatch, signed))
        first = self.of_thousands or next(iter(signed), "").strip()
        self.of_thousands = first if self._may_part_thousands else ""
        for k, cell in enumerate(cells[self.begin :]):
            if WHOLE_PLACE.fullmatch(cell) and len(self._whole[k]) < MOVING:
                self._whole[k].add(cell)
        clock = (cell for cell in cells[: self.begin] if "," in cell or "." in cell)
        self.has_clock_of_decimals |= not all(map(OF_THOUSANDS.fullmatch, clock))


def _first_with(sign: str, cells: list[str]) -> str:
    return next((cell.strip()[:LONGEST_SHOWN] for cell in cells if sign in cell and is_number(cell)), "")


def leap_less(time: Floats, places: Floats, large: Floats) -> bool:
    """Return whether places leap that do not where signs part thousands.

    `time` [s], (frames,); `places` and `large` [m], (frames, markers, 3), NaN where not seen
    """
    if not (np.diff(time) > 0).all():
        return False
    return bool(leaps_ahead(time, large).sum() < leaps_ahead(time, places).sum())


def are_too_far(large: Floats) -> bool:
    """Return whether one of some places [m], NaN where not seen, is farther away than any place of a recording."""
    return bool((np.abs(large) >= FARTHEST_PLACE).any())


def may_be_motion(time: Floats, places: Floats) -> bool:
    """Return whether places may be those of cloth that cameras saw: few leap, and there are enough frames a second.

    - `time` [s], (frames,); `places` [m], (frames, markers, 3), NaN where not seen
    """
    if len(time) < 3:
        return True
    steps = np.diff(time)
    if not (steps > 0).all() or float(np.median(steps)) > 1 / SLOWEST:
        return False
    seen = np.isfinite(places[:-2]) & np.isfinite(places[1:-1]) & np.isfinite(places[2:])
    return bool(leaps_ahead(time, places).sum() <= MOST_STRAYS * seen.sum())
