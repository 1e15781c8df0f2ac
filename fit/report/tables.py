"""The tables of the report: fitted parameters and effects considered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from fit.report.effects import meaning_of, sentence_of, sketch_of
from fit.report.templating import piece
from fit.report.text import MISSING, interval, number, percent, probability, unit_of, words
from formats.diagnosis_records import EffectFinding, in_percent, place_of, tells_size
from formats.fit_records import FitParameter, verdict_on


def parameter_table(rows: Sequence[FitParameter], meanings: Mapping[str, str] | None = None) -> Markup:
    """Return a table of parameters with drawn bounds; meanings: by name, for parameters without a note."""
    heads = ("parameter", "initial", "fitted", "90 % interval", "from minimum to maximum", "meaning")
    known = meanings or {}
    return table(
        "Fitted parameters", heads, [_parameter_row(row, known.get(row.name, "")) for row in rows], numeric=(1, 2, 3)
    )


def effect_table(effects: Sequence[EffectFinding], named: Sequence[str]) -> Markup:
    """Return a table of effects; those of `named` are marked."""
    rows = [_effect_row(effect, effect.id in named) for effect in effects]
    heads = ("effect", "probability", "size", "gap closed", "p-value", "smallest that would show")
    return table("Effects of the library", heads, rows, numeric=range(1, 6))


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of a table: its name, a cell for every further column, and its CSS class."""

    name: str
    cells: Sequence[str]
    mark: str = ""


def table(label: str, heads: Sequence[str], rows: Sequence[Row], numeric: Sequence[int] | range) -> Markup:
    """Return a table with these column heads; `numeric` columns are set right.

    Cells name their columns, for screens too narrow for a table.
    """
    return piece("parts.html", "table", label, heads, rows, numeric)


def row_of(name: str, cells: Sequence[str]) -> Row:
    """Return a row; an identifier is shown as words."""
    return Row(name=words(name) if name.isidentifier() else name, cells=cells)


def _parameter_row(row: FitParameter, meaning: str) -> Row:
    ends = (
        (row.interval_low, row.interval_high)
        if row.interval_low is not None and row.interval_high is not None
        else None
    )
    # Ranges over two decades are searched, and shown, on a log scale.
    is_log = row.minimum > 0 and row.maximum / row.minimum >= 30

    def place(value: float) -> float:
        low, high, at = row.minimum, row.maximum, min(max(value, row.minimum), row.maximum)
        if is_log:
            low, high, at = math.log(low), math.log(high), math.log(at)
        return 100 * (at - low) / (high - low) if high > low else 50.0

    said = (
        "" if meaning and row.note.lower().rstrip(".") == words(row.name) else row.note
    )  # an effect's title is its name
    parts = [meaning if meaning not in said else "", verdict_on(row), said]
    about = ". ".join(part[0].upper() + part[1:].rstrip(".") for part in parts if part)
    within = None
    if ends is not None:
        left, right = place(ends[0]), place(ends[1])
        within = (left, max(right - left, 0))
    unit, spread, is_known = unit_of(row.unit), interval(ends), row.is_identified is not False
    span = piece("tables.html", "span", {
        "is_identified": is_known, "unit": unit, "within": within, "begins": place(row.initial),
        "ends": place(row.fitted), "minimum": number(row.minimum), "maximum": number(row.maximum), "is_log": is_log,
    })  # fmt: skip
    return Row(
        name=words(row.name),
        cells=(
            number(row.initial) + unit,
            piece("tables.html", "bold", number(row.fitted), unit) if is_known else MISSING,
            spread + unit if spread else MISSING,
            span,
            piece("tables.html", "remark", f"{about}." if about else ""),
        ),
    )


def _as_sentences(note: str) -> str:
    """Return a note with a capital letter and a full stop."""
    return f"{note[:1].upper()}{note[1:]}{'' if not note or note.endswith('.') else '.'}"


def _effect_row(effect: EffectFinding, is_named: bool) -> Row:
    name, unit = words(effect.id), unit_of(effect.unit)
    about = {"sketch": sketch_of(effect.id), "sentence": sentence_of(effect.id)}
    if not effect.tested:
        about["remark"] = _as_sentences(effect.note or "not tested")
        head = piece("tables.html", "effect", name, about, is_named)
        return Row(name=head, cells=(MISSING,) * 5, mark="is-untested")
    twin = f"Not told apart from {effect.group.replace('_', ' ')}. " if effect.group not in ("", effect.id) else ""
    absorbed = ""
    if effect.absorbed is not None and effect.absorbed > 0.5:
        absorbed = f"The base parameters can imitate {percent(effect.absorbed)} of it. "
    place = f"Acts {place_of(effect.regions)}. " if is_named and effect.regions else ""
    least = number(effect.minimum_detectable) + unit if effect.minimum_detectable is not None else MISSING
    closure = effect.closure
    about["remark"] = place + twin + absorbed + _as_sentences(effect.note)
    between = effect.amplitude_interval
    is_sized = tells_size(effect, [effect.id] if is_named else [])
    spread, meaning = interval(between), meaning_of(effect.id, effect.amplitude if is_sized else None)
    size, spread = (number(effect.amplitude), spread) if is_sized else (spread or MISSING, "")
    size_unit = unit if size != MISSING else ""
    closed = percent(closure.value) if closure is not None else MISSING
    ends = interval(closure.interval, 100, 2) if closure is not None else ""
    return Row(
        name=piece("tables.html", "effect", name, about, is_named),
        cells=(
            MISSING if effect.probability is None else in_percent(effect.probability),
            piece("tables.html", "amplitude", size, size_unit, spread, meaning),
            piece("tables.html", "closure", closed, ends),
            probability(effect.p_value),
            least,
        ),
        mark="is-named" if is_named else "",
    )
