"""Report section with the measures of the published methods: error table, objective and parameter combinations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from fit.report.charts import Curve, error_chart
from fit.report.tables import Row, row_of, table
from fit.report.templating import NOTHING, piece
from fit.report.text import MISSING, interval, number, percent, unit_of
from formats.fit_records import TRIVIAL_NAMES, Combination, FitResult, ObjectiveFigure, verdict_on

PAPER_MEASURE = (
    "Publications, and the tables of `hangtime fit`, state the mean distance of all points, held ones included. All "
    "other errors on this page are root mean squares over the free points."
)


def method_figures(fit: FitResult | None) -> Markup:
    """Return the body of the section on mean distances and objective, empty without a fit."""
    if fit is None:
        return NOTHING
    return _error_table(fit) + _objective_table(fit.objective) + _combination_table(fit.combinations)


def search_history(fit: FitResult) -> Markup:
    """Return the chart of the best error after each iteration: millimetres, or the objective's own unit."""
    is_distance = fit.objective is None or fit.objective.unit == "m"
    unit = "mm" if is_distance or fit.objective is None else fit.objective.name
    best = np.array(fit.history, dtype=float) * (1.0 if is_distance else 1e-3)  # charts show thousandths
    curve = Curve("after", best, name="best mean distance of all points so far" if is_distance else "best so far")
    caption = "The search: best error after each iteration, in the measure of the search"
    return error_chart(caption, np.arange(len(best), dtype=float), [curve], axis="iteration", unit=unit)


def _error_table(fit: FitResult) -> Markup:
    """Return maximum and mean over frames of the points' mean distance, before and after, as in Figure 6."""
    rows = []
    for name, before, after in (
        ("takes used to fit", fit.error.train_before, fit.error.train_after),
        ("held-out takes", fit.error.held_out_before, fit.error.held_out_after),
    ):
        if before is not None and after is not None:
            rows.append(_error_row(f"maximum, {name}", before.max_m, after.max_m))
            rows.append(_error_row(f"mean, {name}", before.mean_m, after.mean_m))
    for one in fit.trivial:
        error, on = (one.held_out, "held-out takes") if one.held_out else (one.train, "takes used to fit")
        rows.append(row_of(f"mean of {TRIVIAL_NAMES[one.name]}, instead, {on}", ("", number(1e3 * error.mean_m), "")))
    heads = ("mean distance of all points, over the frames", "before, mm", "after, mm", "down by")
    body = piece("parts.html", "note", PAPER_MEASURE)
    body += table("Errors before and after", heads, rows, range(1, 4))
    if fit.error.held_out_after is None:
        flatters = "No held-out take was given: errors on the takes fitted to flatter."
        body += piece("parts.html", "note", flatters)
    return headed("Errors before and after", body)


def _error_row(name: str, before: float, after: float) -> Row:
    return row_of(name, (number(1e3 * before), number(1e3 * after), percent(1 - after / before)))


def _objective_table(objective: ObjectiveFigure | None) -> Markup:
    if objective is None or len(objective.parts) < 2:
        return NOTHING
    rows = [row_of(name, (number(a), number(b), _fall(a, b))) for name, (a, b) in objective.parts.items()]
    before, after = objective.before, objective.after
    rows.append(row_of(f"{objective.name}, the whole", (number(before), bold(number(after)), _fall(before, after))))
    heads = ("part of the objective", "manual", "optimised", "down by")
    intro = "Weighted parts per marker; places in metres, speeds in m/s, curvatures in 1/m."
    body = table("Manual against optimised", heads, rows, range(1, 4)) + piece("parts.html", "note", intro)
    return headed("Manual against optimised", body)


def _fall(before: float, after: float) -> str:
    return percent(1 - after / before) if before > 0 else ""


def _combination_table(found: Sequence[Combination]) -> Markup:
    if not found:
        return NOTHING
    rows = [
        row_of(c.name, (
            number(c.initial) + unit_of(c.unit),
            bold(number(c.fitted)) + unit_of(c.unit) if c.is_identified else MISSING,
            interval((c.interval_low, c.interval_high)) + unit_of(c.unit), verdict_on(c) or "identified",
        ))
        for c in found
    ]  # fmt: skip
    heads = ("combination of parameters", "before", "fitted", "90 % interval", "verdict")
    return headed("Combinations", table("Combinations", heads, rows, range(1, 4)))


def headed(title: str, body: Markup) -> Markup:
    """Return a body under a heading of its own."""
    return piece("parts.html", "headed", title, body)


def bold(text: str) -> Markup:
    """Return text set bold."""
    return piece("parts.html", "bold", text)
