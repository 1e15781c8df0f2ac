"""Format rows of cells as text: CSV that runs no formula in a spreadsheet, and columns for a terminal."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Container, Iterable, Sequence

from formats.plain_text import plain, without_codes

FORMULA_SIGNS = "-=+@\uff1d\uff0b\uff0d\uff20"  # that begin a formula; spreadsheets read full-width ones alike
FORMULA = re.compile(f"(^|;)(?='*[{FORMULA_SIGNS}\t\r])")
GUARDED = re.compile(f"(^|;)'(?='*[{FORMULA_SIGNS}\t\r])")
SIGNED_NUMBER = re.compile(r"[+-](?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


def csv_text(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV; numbers keep every digit, and None becomes an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(map(spreadsheet_cell, row) for row in rows)
    return text.getvalue()


def spreadsheet_cell(cell: object) -> object:
    """Return a cell that a spreadsheet shows unchanged: an apostrophe before a text stops a formula from running.

    Full-width signs begin formulas too. A semicolon begins a cell wherever the comma is the decimal separator.
    Terminal control codes and line breaks are escaped, so that `cat` shows one line a row.

    Source: OWASP, "CSV Injection".
    """
    if not isinstance(cell, str) or SIGNED_NUMBER.fullmatch(cell):
        return cell
    shown = without_codes(FORMULA.sub(r"\1'", cell))
    return shown.replace("\n", "\\n").replace("\t", "\\t")


def named_in_cell(word: str) -> str:
    """Return the text for which `spreadsheet_cell` returns this word, or the word where no text gives it."""
    bare = GUARDED.sub(r"\1", word)
    return bare if spreadsheet_cell(bare) == word else word


def aligned(rows: Sequence[Sequence[str]], right: Container[int] = ()) -> list[str]:
    """Return one line for each row, with columns two spaces apart; columns in `right` are aligned to the right.

    Line breaks and control codes in cells are escaped.
    """
    rows = [[plain(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        sized = enumerate(zip(row, widths, strict=True))
        cells = [cell.rjust(width) if k in right else cell.ljust(width) for k, (cell, width) in sized]
        lines.append("  ".join(cells).rstrip())
    return lines
