"""Show rows of text as a table: aligned for a terminal, or as HTML for a notebook."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from formats.plain_text import spreadsheet_cell

NOT_IDENTIFIED = "not identified"

_HTML = """\
{%- for table in tables %}
<table>
{%- if table.heads %}
<thead><tr>{% for head in table.heads %}<th>{{ head }}</th>{% endfor %}</tr></thead>
{%- endif %}
<tbody>
{%- for row in table.rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{%- endfor %}
</tbody>
</table>
{%- for line in table.remarks %}
<p>{{ line }}</p>
{%- endfor %}
{%- endfor %}
"""


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of text below their heads, with remarks that follow them.

    right: which columns are set to the right, as numbers are
    """

    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    remarks: tuple[str, ...] = ()
    right: tuple[int, ...] = (1, 2)

    def text(self) -> str:
        """Return the table for a terminal: columns two spaces apart, remarks below."""
        every = [self.heads, *self.rows] if self.heads else list(self.rows)
        widths = [max(map(len, column)) for column in zip(*every, strict=True)]
        lines = []
        for row in every:
            cells = [
                cell.rjust(width) if k in self.right else cell.ljust(width)
                for k, (cell, width) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(cells).rstrip())
        return "\n".join([*lines, *self.remarks])


def as_text(tables: Iterable[Table]) -> str:
    """Return tables for a terminal, one below the other."""
    return "\n".join(table.text() for table in tables)


def as_html(tables: Iterable[Table]) -> str:
    """Return tables as HTML, every cell escaped."""
    from jinja2 import Environment

    return Environment(autoescape=True).from_string(_HTML).render(tables=list(tables))


def as_csv(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV; numbers keep every digit, and None is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(["" if cell is None else spreadsheet_cell(cell) for cell in row] for row in rows)
    return text.getvalue()
