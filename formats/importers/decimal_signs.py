"""Tell whether the commas or points of a file of marker paths part decimals or thousands.

A point beside a comma shows that one of them parts thousands. Commas alone part decimals, unless each has one to three
digits before it and three behind, as in 1,234. Then the file may hold whole numbers, of which commas part thousands.
The same holds of points alone where semicolons part cells, as where commas part decimals.
Such places are 1000 times as far away, and so is the noise of cameras: most places then leap as no cloth does.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats
from formats.importers.number_cells import LONGEST_SHOWN, is_number
from formats.importers.strays import MOST_STRAYS, leaps_ahead
from formats.plausible import SLOWEST

OF_THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2}[,.]\d{3}\s*", re.ASCII)


@dataclass
class DecimalSigns:
    """The first number of a file with a decimal point, and the first one with a comma, '' without one.

    - `parts_thousands`: the sign with which the file is read so, '' for none
    """

    point: str = ""
    comma: str = ""
    parts_thousands: str = ""
    _all_of_thousands: bool = True

    def of_thousands(self, separator: str) -> str:
        """Return the first number whose sign may part thousands as well as decimals, '' without one.

        separator: of cells
        """
        found = self.comma or (self.point if separator == ";" else "")
        return found if self._all_of_thousands else ""

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
        if self._all_of_thousands and ("," in text or "." in text):
            signed = (cell for cell in cells if "," in cell or "." in cell)
            self._all_of_thousands = all(map(OF_THOUSANDS.fullmatch, signed))


def _first_with(sign: str, cells: list[str]) -> str:
    return next((cell.strip()[:LONGEST_SHOWN] for cell in cells if sign in cell and is_number(cell)), "")


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
