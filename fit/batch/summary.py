"""The table in the morning: what became of every take, as CSV and as one HTML page without anything from outside."""

from __future__ import annotations

import csv
import io
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import TypeVar

from fit.batch.jobs import result_name
from fit.batch.runner import Survey
from fit.batch.store import Store
from fit.errors import BatchError, UnreachableError
from fit.identification.request import Plan
from fit.report.text import MISSING, escaped, interval, millimetres, number, unit_of, words
from fit.search.choice import OBSERVED, has_short_intervals
from formats.errors import ResultError
from formats.plain_text import spreadsheet_cell
from formats.results import FitParameter, FitResult, load_fit_result

Kept = TypeVar("Kept")

WORDS = {
    "fitted": "fitted",
    "known": "fitted before",
    "failed": "failed",
    "refused": "not fitted",
    "waiting": "waiting",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One take of the table; state is a key of `WORDS`."""

    take: str
    key: str
    state: str
    sentence: str
    result: FitResult | None


def rows_of(found: Survey, results: Store) -> list[Row]:
    """Return a row for each take, with what is kept of it.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    rows = []
    for take, key in found.keys.items():
        outcome = found.outcomes.get(key)
        state, sentence = (outcome.state, outcome.sentence) if outcome else ("waiting", "")
        result = None
        if state in ("fitted", "known"):
            try:
                result = kept(results, result_name(key), load_fit_result)
            except UnreachableError:
                raise
            except (ResultError, BatchError) as error:
                state, sentence = "refused", f"its result cannot be read: {error}"
        rows.append(Row(take=take, key=key, state=state, sentence=sentence, result=result))
    return rows


def write_summary(rows: Sequence[Row], results: Store, plan: Plan) -> None:
    """Write `summary.csv` and `summary.html` into the store of results."""
    results.write("summary.csv", as_csv(rows).encode())
    results.write("summary.html", as_html(rows, plan).encode())


def sentence_of(rows: Sequence[Row]) -> str:
    """Say in one sentence how many takes came out how."""
    counts = Counter(row.state for row in rows)
    parts = [f"{counts[state]} {word}" for state, word in WORDS.items() if counts[state]]
    return f"{len(rows)} take{'s' if len(rows) != 1 else ''}: {', '.join(parts)}."


def as_csv(rows: Sequence[Row]) -> str:
    """Return the table as CSV: errors in millimetres, parameters in their own units with 90 % intervals."""
    names = _parameters(rows)
    head = ["take", "take_id", "state", "error_before_mm", "error_after_mm", "simulations", "seconds"]
    for name in names:
        head += [name, f"{name}_low", f"{name}_high", f"{name}_is_identified"]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*head, "remark", "key"])
    for row in rows:
        writer.writerow([spreadsheet_cell(c) for c in (row.take, *_figures(row, names), row.sentence, row.key)])
    return text.getvalue()


def _figures(row: Row, names: list[str]) -> list[object]:
    result = row.result
    if result is None:
        return ["", row.state, "", "", "", "", *[""] * (4 * len(names))]
    figures: list[object] = [
        " ".join(result.take_ids), row.state, f"{1e3 * result.error.train_before.mean_m:.3f}",
        f"{1e3 * result.error.train_after.mean_m:.3f}", result.simulations, f"{result.seconds:.1f}",
    ]  # fmt: skip
    by_name = {p.name: p for p in result.parameters}
    for name in names:
        p = by_name.get(name)
        if p is None:
            figures += [""] * 4
        else:  # an interval alone where rounding would choose the number
            fitted = "" if p.is_identified is False else p.fitted
            figures += [fitted, p.interval_low, p.interval_high, p.is_identified]
    return figures


def as_html(rows: Sequence[Row], plan: Plan) -> str:
    """Return the table as a page: takes that need a look first, then by error."""
    order = ["failed", "refused", "waiting"]
    ranked = sorted(rows, key=lambda r: (order.index(r.state) if r.state in order else len(order), -_error(r), r.take))
    names = _parameters(rows)
    units = {p.name: p.unit for row in rows if row.result for p in row.result.parameters}
    heads = ["take", "state", "error before", "after", *names, "simulations", "time", "remark"]
    cells = "".join(
        f'<th scope="col"{" class=number" if 2 <= k < len(heads) - 1 else ""}>{words(h)}'
        f"{_small_unit(units.get(h, ''))}</th>"
        for k, h in enumerate(heads)
    )
    body = "".join(_html_row(row, names) for row in ranked)
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    how = (
        f"Method {plan.method}, search {plan.search}, {_spent(rows, plan)}"
        f"mesh {1e3 * plan.request().resolution.spacing:g} mm, seed {plan.seed}"
    )
    is_bad = any(row.state in ("failed", "refused") for row in rows)
    style = resources.files("fit.report").joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n<title>Hangtime batch</title>\n'
        f"<style>\n{style}\nmain {{ max-width: none; }}\n</style>\n</head>\n<body>\n"
        f'<header class="page-head"><p class="brand">Hangtime</p><p class="about">{escaped(f"{how} · {made}")}</p>'
        '</header>\n<main id="main">\n'
        f'<section class="verdict {"is-warn" if is_bad else "is-good"}"><h1>{escaped(sentence_of(rows))}</h1>'
        "<p>Errors are mean distances of the tracked points; below each value is its 90 % interval. Parameters "
        f"that the take does not identify have an interval only.{_warning(rows, plan)}</p></section>\n"
        '<section><div class="scroll" tabindex="0" role="region" aria-label="Takes">'
        f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div></section>\n</main>\n</body>\n</html>\n"
    )


def _spent(rows: Sequence[Row], plan: Plan) -> str:
    """Say what the search spent on a take: what it was told to, or what it did if it decides that itself."""
    if plan.search not in OBSERVED:
        return f"{plan.iterations} {'candidates' if plan.search in ('tempering', 'cma-es') else 'iterations'}, "
    counts = {row.result.simulations for row in rows if row.result}
    if not counts:
        return ""
    return f"{min(counts)}{f' to {max(counts)}' if len(counts) > 1 else ''} simulations a take, "


def _warning(rows: Sequence[Row], plan: Plan) -> str:
    """Say that the intervals are known to be too short, where they are."""
    if not has_short_intervals(plan.search, plan.iterations) or not any(row.result for row in rows):
        return ""
    return (
        f" Intervals by {plan.search} are known to be too short, and too many parameters count as identified. Where "
        "measured, the intervals held the truth far less often than 90 % tells. Where they matter, use "
        "<code>--search least-squares</code>."
    )


def _html_row(row: Row, names: list[str]) -> str:
    tone = {"fitted": "good", "known": "plain", "failed": "bad", "refused": "bad", "waiting": "warn"}[row.state]
    cells = f'<th scope="row">{escaped(row.take)}</th><td><span class="tag tone-{tone}">{WORDS[row.state]}</span></td>'
    result = row.result
    if result is None:
        return f'<tr>{cells}<td colspan="{len(names) + 5}">{escaped(row.sentence)}</td></tr>'
    by_name = {p.name: p for p in result.parameters}
    figures = [
        millimetres(result.error.train_before.mean_m), f"<b>{millimetres(result.error.train_after.mean_m)}</b>",
        *(_value(by_name.get(name)) for name in names), str(result.simulations), f"{result.seconds:.0f} s",
    ]  # fmt: skip
    cells += "".join(f'<td class="number">{figure}</td>' for figure in figures)
    link = f'<a href="{escaped(result_name(row.key))}">result</a>'
    return f"<tr>{cells}<td>{link} {escaped(row.sentence)}</td></tr>"


def _value(parameter: FitParameter | None) -> str:
    if parameter is None:
        return MISSING
    value = MISSING if parameter.is_identified is False else number(parameter.fitted)
    if parameter.interval_low is None or parameter.interval_high is None:
        return value
    return f"{value}<br><small>{interval((parameter.interval_low, parameter.interval_high))}</small>"


def _small_unit(unit: str) -> str:
    return f"<br><small>{unit_of(unit)}</small>" if unit_of(unit) else ""


def _parameters(rows: Sequence[Row]) -> list[str]:
    """Names of all parameters, in the order in which they first appear."""
    return list(dict.fromkeys(p.name for row in rows if row.result for p in row.result.parameters))


def _error(row: Row) -> float:
    return row.result.error.train_after.mean_m if row.result else 0.0


def kept(results: Store, name: str, load: Callable[[Path], Kept]) -> Kept:
    """Return a result of the store, as `load` reads it from a file.

    Raises:
        BatchError, ResultError: it cannot be read.
    """
    path = results.path(name)
    if path is not None:
        return load(path)
    with tempfile.TemporaryDirectory(prefix="hangtime-") as folder:
        copy = Path(folder) / Path(name).name
        copy.write_bytes(results.read(name))
        return load(copy)
