"""The tables of the report: fitted parameters and effects considered."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fit.report.text import MISSING, escaped, interval, number, percent, probability, small, unit_of, words
from formats.results import EffectFinding, FitParameter, place_of


def parameter_table(rows: Sequence[FitParameter]) -> str:
    """Return a table of parameters with their bounds drawn."""
    heads = ("parameter", "initial", "fitted", "90 % interval", "from minimum to maximum", "remark")
    return table("Fitted parameters", heads, "".join(map(_parameter_row, rows)), numeric=(1, 2, 3))


def effect_table(effects: Sequence[EffectFinding], named: Sequence[str]) -> str:
    """Return a table of effects; those of `named` are marked."""
    rows = "".join(_effect_row(effect, effect.id in named) for effect in effects)
    heads = ("effect", "probability", "amplitude", "gap closed", "p", "smallest that would show", "remark")
    return table("Effects of the library", heads, rows, numeric=range(1, 6))


def _parameter_row(row: FitParameter) -> str:
    unit = unit_of(row.unit)
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

    marks = ""
    if ends is not None:
        left, right = place(ends[0]), place(ends[1])
        marks += f'<i class="within" style="left:{left:.1f}%;width:{max(right - left, 0):.1f}%"></i>'
    marks += f'<i class="from" style="left:{place(row.initial):.1f}%"></i>'
    marks += f'<i class="to" style="left:{place(row.fitted):.1f}%"></i>'
    remark, fitted = row.note, f"<b>{number(row.fitted)}</b>{unit}"
    if row.is_identified is False:  # rounding chooses one of many values that fit equally well: the interval says more
        remark, fitted = f"Not identified. {remark}".strip(), MISSING
    span = (
        f'<span class="span" aria-hidden="true">{marks}</span>'
        f"<small>{number(row.minimum)} to {number(row.maximum)}{unit}{' (log)' if is_log else ''}</small>"
    )
    return (
        f'<tr><th scope="row">{words(row.name)}</th><td class="number">{number(row.initial)}</td>'
        f'<td class="number">{fitted}</td><td class="number">{interval(ends) or MISSING}</td>'
        f'<td>{span}</td><td><span class="note">{escaped(remark)}</span></td></tr>'
    )


def _effect_row(effect: EffectFinding, is_named: bool) -> str:
    unit = unit_of(effect.unit)
    name = f'<th scope="row">{words(effect.id)}'
    if is_named:
        name += ' <span class="tag">named</span>'
    if not effect.tested:
        remark = escaped(effect.note) or "not tested"
        cells = f'<td class="number">{MISSING}</td>' * 5
        return f'<tr class="is-untested">{name}</th>{cells}<td><span class="note">{remark}</span></td></tr>'
    twin = f"Not told apart from {words(effect.group)}. " if effect.group and effect.group != effect.id else ""
    absorbed = ""
    if effect.absorbed is not None and effect.absorbed > 0.5:
        absorbed = f"The base parameters can imitate {percent(effect.absorbed)} of it. "
    place = f"Acts {place_of(effect.regions)}. " if is_named and effect.regions else ""
    remark = place + twin + absorbed + escaped(effect.note)
    closure = MISSING
    if effect.closure is not None:
        ends = interval(effect.closure.interval, 100, 2)
        closure = percent(effect.closure.value) + (f"<br>{small(ends + ' %')}" if ends else "")
    spread = interval(effect.amplitude_interval)
    least = f"{number(effect.minimum_detectable)}{unit}" if effect.minimum_detectable is not None else MISSING
    return (
        f"<tr{' class=is-named' if is_named else ''}>{name}</th>"
        f'<td class="number">{percent(effect.probability)}</td>'
        f'<td class="number">{number(effect.amplitude)}{unit}{"<br>" + small(spread) if spread else ""}</td>'
        f'<td class="number">{closure}</td><td class="number">{probability(effect.p_value)}</td>'
        f'<td class="number">{least}</td><td><span class="note">{remark}</span></td></tr>'
    )


def table(label: str, heads: Sequence[str], rows: str, numeric: Sequence[int] | range) -> str:
    """Return a table with these column heads and ready rows; `numeric` columns are set right."""
    cells = "".join(
        f'<th scope="col"{" class=number" if k in numeric else ""}>{escaped(head)}</th>' for k, head in enumerate(heads)
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escaped(label)}">'
        f"<table><thead><tr>{cells}</tr></thead><tbody>{rows}</tbody></table></div>"
    )
