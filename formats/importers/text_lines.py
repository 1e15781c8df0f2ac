"""Hold the lines of a large text file in little memory: blocks of text are split into lines on access.

All lines at once would take several times the memory of the text.
"""

from __future__ import annotations

import codecs
import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, overload

from formats.errors import TakeError
from formats.plain_text import encoding_of

PIECE_BYTES = 1 << 20  # bytes of a file that are decoded at once; our choice: bounds memory, and the lines are the same
MOST_LINES_OF_A_FILE = 5_000_000  # 80 minutes at 1000 frames a second
CTRL_Z, MOST_CTRL_Z = b"\x1a", 4096  # the end mark of DOS text files; bytes of marks that are skipped
# in which a zero byte shows UTF-16. Our choice: more than a header's first line. Half and double were not tried.
LOOKED_AT_BYTES = 200
VISIBLE_BYTES = re.compile(rb"[^\0\r\n\t ]")  # bytes of visible characters
NEVER_IN_TEXT = re.compile(rb"[\0-\x08\x0b\x0c\x0e-\x1f]")  # bytes that no Windows text contains


class TextLines(Sequence[str]):
    """All or some lines of a text, without their line ends.

    - `is_cut`: the last line of the text has no line end
    """

    def __init__(self, pieces: list[str], first: list[int], numbers: Sequence[int], *, is_cut: bool = False) -> None:
        """Hold lines of a text.

        - `pieces`: blocks of text, each of whole lines
        - `first`: index of the first line of each block, from 0, and the index after the last line
        - `numbers`: indices of the lines to hold
        """
        self._pieces, self._first, self._numbers, self.is_cut = pieces, first, numbers, is_cut
        self._lines = dict[int, list[str]]()  # of the block that was read last

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> TextLines: ...
    def __getitem__(self, place: int | slice) -> str | TextLines:
        """Return one line, or some of the lines."""
        if isinstance(place, slice):
            return self.at(self._numbers[place])
        number = self._numbers[place]
        piece = bisect_right(self._first, number) - 1
        if piece not in self._lines:
            self._lines.clear()
            self._lines[piece] = self._pieces[piece].splitlines()
        return self._lines[piece][number - self._first[piece]]

    def at(self, numbers: Sequence[int]) -> TextLines:
        """Return the lines with these indices, from 0."""
        some = TextLines(self._pieces, self._first, numbers, is_cut=self.is_cut)
        some._lines = self._lines  # a block is often read in many short slices
        return some


def read_text_lines(path: Path) -> TextLines:
    """Return the lines of a text file; a file without words has none.

    Text that is not UTF-8 is read as Windows-1252, in which µ and ä are single bytes.

    Raises:
        TakeError: the file has more than `MOST_LINES_OF_A_FILE` lines.
        OSError, UnicodeDecodeError: the file cannot be read, or is not text.
    """
    with path.open("rb") as file:
        if not _holds(VISIBLE_BYTES, file):
            return TextLines([], [0], [])
        file.seek(0)
        head = file.read(LOOKED_AT_BYTES)
        encoding = encoding_of(head)
        try:
            return _lines(_pieces(file, encoding), path)
        except UnicodeDecodeError:
            if encoding != "utf-8" or _holds(NEVER_IN_TEXT, file):
                raise
            return _lines(_pieces(file, "cp1252"), path)


def _lines(pieces: Iterator[str], path: Path) -> TextLines:
    kept, first, is_cut = list[str](), [0], False
    for piece in pieces:
        lines = piece.splitlines(keepends=True)
        first.append(first[-1] + len(lines))
        is_cut = lines[-1].splitlines() == lines[-1:]
        if first[-1] <= MOST_LINES_OF_A_FILE:
            kept.append(piece)
    if first[-1] > MOST_LINES_OF_A_FILE:
        raise TakeError(f"has {first[-1]} lines", where=path, advice="export fewer frames at once")
    return TextLines(kept, first, range(first[-1]), is_cut=is_cut)


def _pieces(file: BinaryIO, encoding: str) -> Iterator[str]:
    """Yield the text of a file in blocks of whole lines."""
    left, text = _end(file), ""
    decoder = codecs.getincrementaldecoder(encoding)("replace" if encoding == "cp1252" else "strict")
    while left > 0:
        raw = file.read(min(left, max(PIECE_BYTES, len(text))))  # so that a long line is not scanned again and again
        left = left - len(raw) if raw else 0
        text += decoder.decode(raw, final=not left)
        rest = text.splitlines(keepends=True)[-1] if text and left else ""  # its line end may continue: \r\n
        if len(text) > len(rest):
            yield text[: len(text) - len(rest)]
        text = rest
    if text:
        yield text


def _end(file: BinaryIO) -> int:
    """Return the byte offset at which a file's text ends, and rewind the file."""
    size = file.seek(0, 2)
    file.seek(max(size - MOST_CTRL_Z, 0))
    end = size - len(tail := file.read()) + len(tail.rstrip(CTRL_Z))
    file.seek(0)
    return end


def _holds(wanted: re.Pattern[bytes], file: BinaryIO) -> bool:
    """Return whether a file's text contains a byte that the pattern matches."""
    left = _end(file)
    while raw := file.read(min(left, PIECE_BYTES)):
        left -= len(raw)
        if wanted.search(raw):
            return True
    return False
