"""What the two published methods report: Figure 6's table, the objective with its parts, and what motion can tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fit.report.charts import Curve, error_chart
from fit.report.tables import table
from fit.report.text import escaped, interval, number, percent, unit_of, words
from formats.results import Combination, ErrorFigure, FitResult, ObjectiveFigure


def method_figures(fit: FitResult | None) -> str:
    """Return the section's body, empty without a fit."""
    if fit is None:
        return ""
    return _error_table(fit) + _objective_table(fit.objective) + _combination_table(fit.combinations)


def search_history(fit: FitResult) -> str:
    """Return the chart of the best error after each iteration: millimetres, or the objective's own unit."""
    is_distance = fit.objective is None or fit.objective.unit == "m"
    unit = "mm" if is_distance or fit.objective is None else fit.objective.name
    best = np.array(fit.history, dtype=float) * (1.0 if is_distance else 1e-3)  # charts show thousandths
    curve = Curve("after", best, name="best distance so far" if is_distance else "best so far")
    caption = "The search: best error after each iteration"
    return error_chart(caption, np.arange(len(best), dtype=float), [curve], axis="iteration", unit=unit)


def _error_table(fit: FitResult) -> str:
    """Maximum and mean over the frames of the mean distance of the points, before and after, as in Figure 6."""
    rows = []
    for name, before, after in (
        ("takes used to fit", fit.error.train_before, fit.error.train_after),
        ("held-out takes", fit.error.held_out_before, fit.error.held_out_after),
    ):
        if before is not None and after is not None:
            rows.append(_error_row(f"maximum, {name}", before.max_m, after.max_m))
            rows.append(_error_row(f"mean, {name}", before.mean_m, after.mean_m))
    heads = ("distance of the points over all frames", "before, mm", "after, mm", "down by")
    held = _settled(fit.error.held_out_after)
    return (
        "<h3>Errors before and after</h3>" + table("Errors before and after", heads, "".join(rows), range(1, 4)) + held
    )


def _settled(after: ErrorFigure | None) -> str:
    if after is not None:
        return ""
    return '<p class="note">No held-out take was given: errors on the takes fitted to flatter.</p>'


def _error_row(name: str, before: float, after: float) -> str:
    return _row(name, (number(1e3 * before), number(1e3 * after), percent(1 - after / before)))


def _objective_table(objective: ObjectiveFigure | None) -> str:
    if objective is None or len(objective.parts) < 2:
        return ""
    rows = "".join(_row(name, (number(a), number(b), _fall(a, b))) for name, (a, b) in objective.parts.items())
    before, after = objective.before, objective.after
    rows += _row(f"{objective.name}, the whole", (number(before), f"<b>{number(after)}</b>", _fall(before, after)))
    heads = ("part of what was minimised", "manual", "optimised", "down by")
    intro = '<p class="note">Weighted parts per marker; places in metres, speeds in m/s, curvatures in 1/m.</p>'
    return "<h3>Manual against optimised</h3>" + table("Manual against optimised", heads, rows, range(1, 4)) + intro


def _fall(before: float, after: float) -> str:
    return percent(1 - after / before) if before > 0 else ""


def _combination_table(found: Sequence[Combination]) -> str:
    if not found:
        return ""
    rows = "".join(
        _row(c.name, (number(c.initial), f"<b>{number(c.fitted)}</b>{unit_of(c.unit)}",
                      interval((c.interval_low, c.interval_high)), "yes" if c.is_identified else "no"))
        for c in found
    )  # fmt: skip
    heads = ("what motion tells", "before", "fitted", "90 % interval", "told by these takes")
    return "<h3>What motion can tell, whatever the parameters</h3>" + table("Combinations", heads, rows, range(1, 5))


def _row(name: str, cells: tuple[str, ...]) -> str:
    head = words(name) if name.isidentifier() else escaped(name)
    return f'<tr><th scope="row">{head}</th>' + "".join(f'<td class="number">{cell}</td>' for cell in cells) + "</tr>"
