"""Split the lines of a marker text file into cells, with the delimiter that its header shows.

The header shows which program wrote the file. Titles, comments and tables of devices may stand above the header. Their
delimiters say nothing about the frames.

A quotation mark is an ordinary character unless a cell begins and ends with one. Where commas or semicolons delimit
cells, a quoted cell may contain them (RFC 4180). A quoted cell never continues on the next line. A tab is always a
delimiter.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import overload

from formats.errors import TakeError
from formats.importers.number_cells import CELL_SHOWN, DECIMALS, with_point, with_points
from formats.importers.text_lines import TextLines, read_text_lines
from formats.plain_text import sized
from formats.system_causes import step_to_read

LARGEST_TEXT = 1 << 28  # bytes; our choice: 19 minutes of 40 markers at 200 frames a second, ten letters a coordinate
CAN_BE_READ = "markers can be read from .c3d, .trc, .csv, .tsv and .txt, swung cloth from .npz"
COMMENT = "#%"
MOST_TITLES = 100  # lines above the header; our choice: programs write a dozen, half and double were not tried
MOST_OF_DEVICES = 500_000  # lines above Vicon Nexus' trajectories: 4 minutes of device data at 2000 samples a second
OWN_TIME = r"(?:time|t)(?:_| ?[\[(])(?:s|ms|[u\u00b5\u03bc]s|ns)[\])]?"  # the time column of Hangtime's own CSV
HEADER_LINE = re.compile(
    rf"""[\s"'#%]*({OWN_TIME}|pathfiletype|format version|no_of_frames)["']?\s*([,;\t]|$)""", re.IGNORECASE
)  # of the first cell
BEHIND_INDEX = re.compile(  # the time is the second column, behind an index; tried where no line matches HEADER_LINE
    rf"""[^,;\t]*[,;\t][\s"']*({OWN_TIME})["']?\s*([,;\t]|$)""", re.IGNORECASE
)
TRAJECTORIES = re.compile(r"""[\s"']*(trajectories)["']?\s*([,;\t]|$)""", re.IGNORECASE)
COLUMNS_OF_VICON = re.compile(r"""[\s"']*(frame)["']?\s*([,;\t])""", re.IGNORECASE)
CUT_LETTER = ("truncated data", "unexpected end of data")  # Python's reasons for text that ends within a character
LINES_OF_VICON_HEAD = 8  # from `Trajectories` on: rate, names and columns, and as many empty lines
# Lines searched for delimiters where the header has a single cell; our choice: half a second at 100 a second.
LOOKED_AT = 50
MOST_CELLS = 100_000  # of a line: three for each of 30,000 markers, and some more
LONGEST_CELL = 1 << 17  # characters; our choice: a longer one is no number or name but another kind of file
MINUS = "\u2212"  # the sign of negative numbers in Swedish, Norwegian or Finnish (Unicode CLDR)


class Rows(Sequence[list[str]]):
    """The non-empty lines of a text file, each split into cells when it is read.

    All cells at once would take 30 times the memory of the text. Where the decimal separator is stated, every number is
    returned with a decimal point and without thousands separators.

    Raises:
        TakeError: a cell is longer than any number or name; a line has more cells than any marker file; or a number in
            a frame contradicts the stated separator.
    """

    def __init__(
        self, lines: Sequence[str], numbers: Sequence[int], separator: str, path: Path, *, is_cut: bool = False,
        decimal: str = "", are_frames: bool = False,
    ) -> None:  # fmt: skip
        """Hold lines of a file.

        - `lines`: the text of each line
        - `numbers`: line numbers in the file, from 1
        - `is_cut`: the last line has no line end, so it may be incomplete
        - `decimal`: the stated decimal separator, a comma or a point; '' where none is stated
        - `are_frames`: every line is a frame; a header line may hold other numbers, such as a version
        """
        self.lines, self.numbers, self.separator, self._path, self.is_cut = lines, numbers, separator, path, is_cut
        self.decimal, self._are_frames = decimal, are_frames
        self.are_last = True  # of the file

    def __len__(self) -> int:
        return len(self.lines)

    @overload
    def __getitem__(self, place: int) -> list[str]: ...
    @overload
    def __getitem__(self, place: slice) -> Rows: ...
    def __getitem__(self, place: int | slice) -> list[str] | Rows:
        """Return the cells of one line, or some of the lines."""
        if isinstance(place, slice):
            has_last = range(len(self.lines))[place][-1:] == range(len(self.lines))[-1:]
            is_cut = self.is_cut and has_last
            some = Rows(
                self.lines[place], self.numbers[place], self.separator, self._path, is_cut=is_cut,
                decimal=self.decimal, are_frames=self._are_frames,
            )  # fmt: skip
            some.are_last = self.are_last and has_last
            return some
        return self._as_stated(self._cells(self.lines[place]), self.numbers[place])

    def __iter__(self) -> Iterator[list[str]]:
        """Yield the cells of each line."""
        return map(self._as_stated, map(self._cells, self.lines), self.numbers)

    def last_cell(self, at: int) -> str:
        """Return the last cell of a line."""
        line = self.with_hyphens(self.lines[at])
        if '"' in line:
            return self[at][-1]
        return self._as_stated([line[line.rfind(self.separator) + 1 :]], self.numbers[at])[0]

    def count_cells(self) -> Iterator[int]:
        """Yield the number of cells of each line."""
        for line in self.lines:
            yield len(self._cells(line)) if '"' in line else line.count(self.separator) + 1

    def with_decimal(self, decimal: str) -> Rows:
        """Return the same lines, of which the decimal separator is known."""
        found = self[:]
        found.decimal = decimal
        return found

    def frames(self) -> Rows:
        """Return the same lines, marked as frames."""
        found = self[:]
        found._are_frames = True
        return found

    def _as_stated(self, cells: list[str], number: int) -> list[str]:
        if not self.decimal:
            return cells
        if (plain_cells := with_points(cells, self.decimal)) is not None:
            return plain_cells
        found = [with_point(cell, self.decimal) for cell in cells]
        if self._are_frames and None in found:
            wrong = cells[found.index(None)].strip()[:CELL_SHOWN]
            word = next(word for word, sign in DECIMALS.items() if sign == self.decimal)
            raise TakeError(
                f"line {number} holds {wrong!r}, which is no number with a decimal {word}", where=self._path,
                advice="give the other --decimal, or mend that line",
            )  # fmt: skip
        return [cell if plain is None else plain for cell, plain in zip(cells, found, strict=True)]

    def with_hyphens(self, line: str) -> str:
        """Return a frame with the hyphens that programs in some languages replace by a minus sign."""
        return line if not self._are_frames or line.isascii() else line.replace(MINUS, "-")

    def _cells(self, line: str) -> list[str]:
        """Split a line into cells, within the memory that a marker file needs."""
        line = self.with_hyphens(line)
        if len(line) > MOST_CELLS and line.count(self.separator) > MOST_CELLS:
            raise TakeError(
                f"has a line of more than {MOST_CELLS} cells", where=self._path, advice="export fewer markers"
            )
        cells = line.split(self.separator)
        if len(line) > LONGEST_CELL and max(map(len, cells)) > LONGEST_CELL:
            raise TakeError(
                f"has a cell of more than {LONGEST_CELL} characters", where=self._path, advice="export it again"
            )
        if '"' not in line:
            return cells
        if len(line) <= LONGEST_CELL and _plainly_quoted(self.separator).fullmatch(line):
            return next(csv.reader((line,), delimiter=self.separator))
        return [unquoted(cell) for cell in (cells if self.separator == "\t" else _joined(cells, self.separator))]


@cache
def _plainly_quoted(separator: str) -> re.Pattern[str]:
    """Return a pattern of lines that the `csv` module splits as `_joined` and `unquoted` do, but sooner.

    In such a line, quotation marks surround whole cells, and stand nowhere else.
    """
    inside = '[^"\\t\\r\\n]*' if separator == "\t" else '[^"\\r\\n]*'
    cell = rf'(?:"{inside}"|[^"\r\n{separator}]*)'
    return re.compile(rf"{cell}(?:{separator}{cell})*")


def _joined(cells: list[str], separator: str) -> list[str]:
    """Join the cells that one pair of quotation marks surrounds."""
    found, begun, marks = list[str](), list[str](), 0
    for cell in cells:
        if not begun and not cell.lstrip().startswith('"'):
            found.append(cell)
            continue
        begun.append(cell)
        marks += cell.count('"')
        if marks % 2 == 0 and cell.rstrip().endswith('"'):
            found.append(separator.join(begun))
            begun.clear()
    return found + begun


def unquoted(cell: str) -> str:
    """Return a cell without its surrounding quotation marks; doubled marks inside become single ones."""
    inner = cell.strip()
    if len(inner) < 2 or inner[0] != '"' or inner[-1] != '"':
        return cell
    return inner[1:-1].replace('""', '"')


def read_lines(path: Path, decimal: str = "") -> tuple[str, Rows]:
    """Return the lowercase first word of the header, '' without a header, and the lines from the header on.

    Empty lines are left out. Without a header, the lines begin at the top of the file.

    decimal: as in `Rows`

    Raises:
        TakeError: the file cannot be read, is empty, is not text, or is too large.
    """
    if (size := path.stat().st_size) > LARGEST_TEXT:
        raise TakeError(f"has {sized(size)} of text", where=path, advice="export fewer frames at once")
    try:
        lines = read_text_lines(path)
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    except UnicodeDecodeError as error:
        if error.reason in CUT_LETTER:
            raise TakeError(
                "ends within a character", where=path, advice="the file is cut off: copy or export the file again"
            ) from error
        is_c3d = error.object[1:2] == b"\x50"
        advice = "the file looks like C3D: give it the ending .c3d" if is_c3d else "export it as text again"
        raise TakeError("cannot be read (not a text file)", where=path, advice=advice) from error
    if not lines:
        raise TakeError("is empty", where=path, advice=f"export it again; {CAN_BE_READ}")
    begin, kind, separator = _header(lines)
    # In Qualisys' table a line of delimiters alone is a frame in which no marker was seen.
    dropped = ' "' if kind == "no_of_frames" else f'{separator}" \t'
    places = array("L", (k for k, line in enumerate(lines[begin:], begin) if line.strip(dropped)))
    numbers = array("L", (k + 1 for k in places))
    return kind, Rows(lines.at(places), numbers, separator, path, is_cut=lines.is_cut, decimal=decimal)


def _header(lines: TextLines) -> tuple[int, str, str]:
    """Return the header's line index, its lowercase first word, and the cell delimiter of the lines below it."""
    for pattern, most in ((HEADER_LINE, MOST_TITLES), (BEHIND_INDEX, MOST_TITLES), (TRAJECTORIES, MOST_OF_DEVICES)):
        found = next(((k, match) for k, line in enumerate(lines[:most]) if (match := pattern.match(line))), None)
        if found is not None:
            begin, match = found
            head = lines[begin : begin + LINES_OF_VICON_HEAD] if pattern is TRAJECTORIES else []
            columns = next((parted for line in head if (parted := COLUMNS_OF_VICON.match(line))), match)
            return begin, match[1].lower(), columns[2] or _most_likely(lines[begin : begin + LOOKED_AT])
    return 0, "", _most_likely(lines[:LOOKED_AT])


def _most_likely(lines: Sequence[str]) -> str:
    """Return the cell delimiter: a comma, which may also be the decimal separator, only without tabs and semicolons."""
    return next((separator for separator in "\t;" if any(separator in line for line in lines)), ",")
