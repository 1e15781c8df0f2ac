"""Table of a batch's outcomes, one row per take, as CSV and as one self-contained HTML page."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import msgspec

from fit.api.shown import camera_words
from fit.batch.jobs import result_name
from fit.batch.kept import kept
from fit.batch.pages import render_page
from fit.batch.runner import Survey
from fit.batch.store import Store
from fit.errors import BatchError, UnreachableError
from fit.identification.calibrate import TOO_SHORT
from fit.identification.read_again import fit_from
from fit.identification.request import Plan
from fit.report.text import MISSING, interval, millimetres, number, unit_of, words
from fit.search.choice import OBSERVED, has_short_intervals
from formats.errors import ResultError
from formats.figures import without_noise
from formats.fit_records import AT_BOUND, FitParameter, FitResult, warnings_in
from formats.plain_text import counted, first_few, plain
from formats.rows import csv_text

DIGEST = re.compile(r"-[0-9a-f]{64}(\.mcap)?$")  # the key of a synced take ends with its SHA-256
STATE_WORDS = {
    "fitted": "fitted",
    "known": "fitted before",
    "failed": "failed",
    "refused": "not fitted",
    "newer": "of a newer version",
    "waiting": "waiting",
}
STATE_TONES = {
    "fitted": "good",
    "known": "plain",
    "failed": "bad",
    "refused": "bad",
    "newer": "warn",
    "waiting": "warn",
}  # of `STATE_WORDS`
MOST_NAMED = 4  # takes; our choice: the line stays short, and the page names every take
UNDONE = ("failed", "refused", "newer")  # states without a result that another run alone does not mend


@dataclass(frozen=True, kw_only=True)
class Row:
    """One take of the table.

    - `state`: a key of `STATE_WORDS`
    - `sentence`: the reason why the take has no result; '' with a result
    """

    take: str
    key: str
    state: str
    sentence: str
    result: FitResult | None

    @property
    def remarks(self) -> list[str]:
        """Why the take has no result, else everything that `hangtime fit` says about its fit besides figures."""
        told = [] if self.result is None else [*camera_words(self.result), *warnings_in(self.result.notes)]
        return [*([self.sentence] if self.sentence else []), *told]

    @property
    def own_remarks(self) -> list[str]:
        """The remarks without the one on the search, which holds for every take of a batch."""
        return [remark for remark in self.remarks if remark != TOO_SHORT]

    @property
    def needs(self) -> list[str]:
        """The remarks that need a person: no result, a warning, or a camera's fault in takes or garment file."""
        if self.result is None:
            return [self.sentence] if self.state in UNDONE else []
        warnings = [note for note in warnings_in(self.result.notes) if note != TOO_SHORT]
        return [*camera_words(self.result, only_faults=True), *warnings]


def rows_of(found: Survey, results: Store) -> list[Row]:
    """Return a row for each take, from its stored result.

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
                result = kept(results, result_name(key), fit_from)
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
    """Return a sentence with the number of takes in each state."""
    counts = Counter(row.state for row in rows)
    parts = [f"{counts[state]} {word}" for state, word in STATE_WORDS.items() if counts[state]]
    return f"{len(rows)} take{'s' if len(rows) != 1 else ''}: {', '.join(parts)}."


def short_name(take: str) -> str:
    """Return a take's name without the digest that its key on a server ends with."""
    return DIGEST.sub("", take)


def lines_of(rows: Sequence[Row], needs: Collection[tuple[str, str]] = ()) -> list[str]:
    """Return the remarks of a run as lines: each sentence once, behind the takes that it is about.

    The remarks on takes that were fitted before have been said then, so one line counts these takes.

    needs: takes and sentences that the run says elsewhere
    """
    said: list[tuple[str, str]] = []
    before = 0
    for row in rows:
        left = [remark for remark in row.own_remarks if (short_name(row.take), remark) not in needs]
        if row.state == "known":
            before += bool(left)
            continue
        said += [(row.take, remark) for remark in left]
    lines = said_once(said)
    if before:
        lines.append(f"{counted(before, 'take')} fitted before: the summary has the remarks again.")
    return lines


def said_once(remarks: Iterable[tuple[str, str]]) -> list[str]:
    """Return lines of takes and what is said of them: each sentence once, behind the takes that it is about."""
    takes: dict[str, list[str]] = {}
    for take, remark in remarks:
        takes.setdefault(remark, []).append(take)
    return [f"{plain(_few(names))}: {plain(remark)}" for remark, names in takes.items()]


def _few(names: Sequence[str]) -> str:
    return first_few(names, most=MOST_NAMED)


def as_facts(rows: Sequence[Row]) -> list[dict[str, object]]:
    """Return the outcome of every take as plain values; where it was fitted, with its state and doubts on its fit."""
    return [
        {
            "take": row.take, "state": STATE_WORDS[row.state], "sentence": " ".join(row.own_remarks),
            "warnings": warnings_in(row.result.notes) if row.result else [],
            "not_identified": [p.name for p in _of(row) if p.is_identified is False and not p.is_at_bound],
            "at_bound": [p.name for p in _of(row) if p.is_at_bound],
            "file": result_name(row.key) if row.result else "",
            "take_states": msgspec.to_builtins(row.result.take_states) if row.result else [],
        }
        for row in rows
    ]  # fmt: skip


def _of(row: Row) -> list[FitParameter]:
    return row.result.parameters if row.result else []


def as_csv(rows: Sequence[Row]) -> str:
    """Return the table as CSV: mean distances in millimetres, parameters in their own units with 90 % intervals."""
    names = _parameters(rows)
    head = ["take", "take_id", "state", "error_before_mm", "error_after_mm", "simulations", "seconds"]
    for name in names:
        head += [name, f"{name}_low", f"{name}_high", f"{name}_is_identified", f"{name}_is_at_bound"]
    figures = ((row.take, *_figures(row, names), " ".join(row.remarks), row.key) for row in rows)
    return csv_text([*head, "remark", "key"], figures)


def _figures(row: Row, names: list[str]) -> list[object]:
    result = row.result
    if result is None:
        return ["", STATE_WORDS[row.state], "", "", "", "", *[""] * (5 * len(names))]
    figures: list[object] = [
        " ".join(result.take_ids), STATE_WORDS[row.state], f"{1e3 * result.error.train_before.mean_m:.3f}",
        f"{1e3 * result.error.train_after.mean_m:.3f}", result.simulations, f"{result.seconds:.1f}",
    ]  # fmt: skip
    by_name = {p.name: p for p in result.parameters}
    for name in names:
        p = by_name.get(name)
        if p is None:
            figures += [""] * 5
        else:  # only the interval if the value is not identified
            numbers = (None if p.is_identified is False else p.fitted, p.interval_low, p.interval_high)
            figures += [None if one is None else without_noise(one) for one in numbers]
            figures += [p.is_identified, p.is_at_bound]
    return figures


def as_html(rows: Sequence[Row], plan: Plan) -> str:
    """Return the table as a page: faulty takes first, then by error."""
    order = ["failed", "refused", "newer", "waiting"]
    ranked = sorted(rows, key=lambda r: (order.index(r.state) if r.state in order else len(order), -_error(r), r.take))
    names = _parameters(rows)
    units = {p.name: p.unit for row in rows if row.result for p in row.result.parameters}
    heads = ["take", "state", "error before", "after", *names, "simulations", "time", "remark"]
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    how = (
        f"Method {plan.method}, search {plan.search}, {_spent(rows, plan)}"
        f"mesh {1e3 * plan.request().resolution.spacing:g} mm, seed {plan.seed}"
    )
    return render_page(
        "summary.html.j2",
        about=f"{how} · {made}",
        is_bad=any(row.needs for row in rows),
        sentence=sentence_of(rows),
        short_intervals_of=plan.search if _has_short_intervals(rows, plan) else "",
        heads=[(words(head), unit_of(units.get(head, ""))) for head in heads],
        lines=[_line(row, names) for row in ranked],
    )


def _spent(rows: Sequence[Row], plan: Plan) -> str:
    """Return the cost of the search per take: requested iterations, or the simulations that it used."""
    if plan.search not in OBSERVED:
        return f"{plan.iterations} {'candidates' if plan.search in ('tempering', 'cma-es') else 'iterations'}, "
    counts = {row.result.simulations for row in rows if row.result}
    if not counts:
        return ""
    return f"{min(counts)}{f' to {max(counts)}' if len(counts) > 1 else ''} simulations a take, "


def _has_short_intervals(rows: Sequence[Row], plan: Plan) -> bool:
    """Return whether the page shows intervals that are known to be too short."""
    return has_short_intervals(plan.search, plan.iterations or 0) and any(row.result for row in rows)


def _line(row: Row, names: list[str]) -> dict[str, object]:
    """Return the texts of a take's line; without a result its sentence alone."""
    line: dict[str, object] = {
        "take": row.take, "tone": STATE_TONES[row.state], "state": STATE_WORDS[row.state],
        "sentence": " ".join(row.own_remarks),
        "cells": None,
    }  # fmt: skip
    result = row.result
    if result is None:
        return line
    by_name = {p.name: p for p in result.parameters}
    return line | {
        "before": millimetres(result.error.train_before.mean_m), "after": millimetres(result.error.train_after.mean_m),
        "cells": [_value(by_name.get(name)) for name in names], "simulations": result.simulations,
        "seconds": f"{result.seconds:.0f} s", "link": result_name(row.key),
    }  # fmt: skip


def _value(parameter: FitParameter | None) -> tuple[str, str]:
    """Return a fitted value, a dash if it is not identified, and its interval, marked where it is at its bound."""
    if parameter is None:
        return MISSING, ""
    value = MISSING if parameter.is_identified is False else number(parameter.fitted)
    if parameter.interval_low is None or parameter.interval_high is None:
        return value, AT_BOUND if parameter.is_at_bound else ""
    ends = interval((parameter.interval_low, parameter.interval_high))
    return value, f"{ends}, {AT_BOUND}" if parameter.is_at_bound else ends


def _parameters(rows: Sequence[Row]) -> list[str]:
    """Return the names of all parameters, in the order of their first appearance."""
    return list(dict.fromkeys(p.name for row in rows for p in _of(row)))


def _error(row: Row) -> float:
    return row.result.error.train_after.mean_m if row.result else 0.0
