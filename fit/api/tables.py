"""Tables of text, aligned for a terminal or as HTML for a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from formats.rows import aligned
from formats.templating import environment


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of text below their heads, with remarks that follow them.

    right: right-aligned columns, such as numbers
    """

    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    remarks: tuple[str, ...] = ()
    right: tuple[int, ...] = (1, 2)  # our choice: the second and third columns

    def text(self) -> str:
        """Return the table for a terminal: columns two spaces apart, remarks below."""
        every = [self.heads, *self.rows] if self.heads else list(self.rows)
        return "\n".join([*aligned(every, self.right), *self.remarks])


def as_text(tables: Iterable[Table]) -> str:
    """Return tables for a terminal, one below the other."""
    return "\n".join(table.text() for table in tables)


def as_html(tables: Iterable[Table]) -> str:
    """Return tables as HTML, every cell escaped."""
    return environment("fit.api", ".", trims_lines=True).get_template("tables.html.j2").render(tables=list(tables))
