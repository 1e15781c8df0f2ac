"""The tables of the report: fitted parameters and effects considered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from markupsafe import Markup, escape

from fit.report.effects import meaning_of, sentence_of, sketch_of
from fit.report.templating import NOTHING, piece
from fit.report.text import MISSING, interval, number, percent, probability, unit_of, words
from formats.diagnosis_records import EffectFinding, place_of
from formats.fit_records import FitParameter


def parameter_table(rows: Sequence[FitParameter], meanings: Mapping[str, str] | None = None) -> Markup:
    """Return a table of parameters with their bounds drawn; meanings: of those that bring none, by name."""
    heads = ("parameter", "initial", "fitted", "90 % interval", "from minimum to maximum", "meaning")
    known = meanings or {}
    return table(
        "Fitted parameters", heads, [_parameter_row(row, known.get(row.name, "")) for row in rows], numeric=(1, 2, 3)
    )


def effect_table(effects: Sequence[EffectFinding], named: Sequence[str]) -> Markup:
    """Return a table of effects; those of `named` are marked."""
    rows = [_effect_row(effect, effect.id in named) for effect in effects]
    heads = ("effect", "probability", "size", "gap closed", "chance by noise (p)", "smallest that would show")
    return table("Effects of the library", heads, rows, numeric=range(1, 6))


def table(label: str, heads: Sequence[str], rows: Sequence[Markup], numeric: Sequence[int] | range) -> Markup:
    """Return a table with these column heads and ready rows; `numeric` columns are set right."""
    return piece("parts.html", "table", label, heads, NOTHING.join(_labelled(row, heads) for row in rows), numeric)


def _labelled(row: Markup, heads: Sequence[str]) -> Markup:
    """Return a row whose cells name their columns, for screens too narrow for a table."""
    first, *cells = str(row).split("<td")
    named = (f'<td data-head="{escape(head)}"{cell}' for head, cell in zip(heads[1:], cells, strict=True))
    return Markup(first + "".join(named))


def row_of(name: str, cells: Sequence[str]) -> Markup:
    """Return a row of numbers; an identifier is shown as words."""
    return piece("parts.html", "row", words(name) if name.isidentifier() else name, cells)


def _parameter_row(row: FitParameter, meaning: str) -> Markup:
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
    parts = [meaning if meaning not in said else "", "not identified" if row.is_identified is False else "", said]
    about = ". ".join(part[0].upper() + part[1:].rstrip(".") for part in parts if part)
    within = None
    if ends is not None:
        left, right = place(ends[0]), place(ends[1])
        within = (left, max(right - left, 0))
    return piece("tables.html", "parameter", {
        "name": words(row.name), "initial": number(row.initial), "fitted": number(row.fitted),
        "is_identified": row.is_identified is not False, "missing": MISSING, "unit": unit_of(row.unit),
        "interval": interval(ends) or MISSING, "has_interval": bool(interval(ends)), "within": within,
        "begins": place(row.initial),
        "ends": place(row.fitted), "minimum": number(row.minimum), "maximum": number(row.maximum), "is_log": is_log,
        "remark": f"{about}." if about else "",
    })  # fmt: skip


def _effect_row(effect: EffectFinding, is_named: bool) -> Markup:
    name, unit = words(effect.id), unit_of(effect.unit)
    about = {"sketch": sketch_of(effect.id), "sentence": sentence_of(effect.id)}
    if not effect.tested:
        about["remark"] = effect.note or "not tested"
        return piece("tables.html", "untested", name, about, is_named, MISSING)
    twin = f"Not told apart from {effect.group.replace('_', ' ')}. " if effect.group not in ("", effect.id) else ""
    absorbed = ""
    if effect.absorbed is not None and effect.absorbed > 0.5:
        absorbed = f"The base parameters can imitate {percent(effect.absorbed)} of it. "
    place = f"Acts {place_of(effect.regions)}. " if is_named and effect.regions else ""
    least = number(effect.minimum_detectable) + unit if effect.minimum_detectable is not None else MISSING
    closure = effect.closure
    return piece("tables.html", "effect", {
        "name": name, "about": {**about, "remark": place + twin + absorbed + effect.note}, "is_named": is_named,
        "probability": percent(effect.probability),
        "amplitude": number(effect.amplitude), "unit": unit, "spread": interval(effect.amplitude_interval),
        "meaning": meaning_of(effect.id, effect.amplitude),
        "closure": percent(closure.value) if closure is not None else MISSING,
        "closure_ends": interval(closure.interval, 100, 2) if closure is not None else "",
        "p_value": probability(effect.p_value), "least": least,
    })  # fmt: skip
