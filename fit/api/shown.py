"""Tables of results, with the same rows in the terminal, in a notebook and from the command line.

A parameter that the takes do not identify has an interval and no value. Many values fit such takes equally well, and
rounding decides at which of them a search ends.
"""

from __future__ import annotations

from fit.api.tables import Table
from formats.diagnosis_records import Diagnosis, EffectFinding
from formats.fit_records import Combination, ErrorFigure, FitParameter, FitResult, verdict_on

TRIVIAL_NAMES = {"vertical": "a hanging board", "pendulum": "a pendulum of two numbers"}


def fit_tables(result: FitResult) -> list[Table]:
    """Return tables of the parameters, errors, objective parts and parameter combinations of a fit."""
    tables = [parameter_table(result.parameters), _error_table(result)]
    if result.objective is not None and len(result.objective.parts) > 1:
        whole = result.objective
        parts = [(f"{whole.name}, training", (whole.before, whole.after))]
        parts += [(f"  {name}", figures) for name, figures in whole.parts.items()]
        tables.append(
            Table(
                heads=("objective", "before", "after"),
                rows=tuple((name, f"{before:.4g}", f"{after:.4g}") for name, (before, after) in parts),
            )
        )
    warnings = tuple(note for note in result.notes if note.startswith("Warning:"))
    if result.combinations:
        heads = ("combination", "before", "after", "90 % interval", "")
        rows = tuple(_combination_row(c) for c in result.combinations)
        tables.append(Table(heads=heads, rows=rows))
    if warnings:
        tables[1] = Table(heads=tables[1].heads, rows=tables[1].rows, remarks=warnings)
    return [*camera_table(result), *tables]


def diagnosis_tables(diagnosis: Diagnosis, added: tuple[str, ...] = ()) -> list[Table]:
    """Return tables of the verdict, the gap, the tested effects, and the next recording.

    `added` holds effects that the caller requested in any case
    """
    remarks = [f"Verdict: {diagnosis.verdict}", diagnosis.sentence]
    remarks += [_added_line(finding) for finding in diagnosis.effects if finding.id in added]
    if diagnosis.next_experiment is not None:
        remarks.append(diagnosis.next_experiment.sentence)
    remarks += [note for note in diagnosis.notes if note.startswith("Warning:")]
    return [*camera_table(diagnosis, reported=diagnosis.sentence), Table(remarks=tuple(remarks))]


def camera_table(result: FitResult | Diagnosis, reported: str = "") -> list[Table]:
    """Return the camera's faults as sentences, except those in `reported`; nothing without faults."""
    left = tuple(f"Camera: {found.sentence}" for found in result.camera if found.sentence not in reported)
    return [Table(remarks=left)] if left else []


def effect_table(diagnosis: Diagnosis) -> Table:
    """Return a table of the tested effects, most probable first."""
    tested = sorted((e for e in diagnosis.effects if e.tested), key=lambda e: -(e.probability or 0.0))
    rows = []
    for effect in tested:
        closed = f"{100 * effect.closure.value:z.0f} %" if effect.closure is not None else ""
        chance = f"{100 * effect.probability:.0f} %" if effect.probability is not None else ""
        named = "named" if effect.id in diagnosis.named else ""
        rows.append((effect.id, chance, f"{effect.amplitude:.3g} {effect.unit}".strip(), closed, named))
    return Table(heads=("effect", "probability", "amplitude", "gap closed", ""), rows=tuple(rows), right=(1, 2, 3))


def parameter_table(parameters: list[FitParameter]) -> Table:
    """Return a table of initial and fitted values with 90 % intervals; only an interval for unidentified parameters."""
    rows = []
    for p in parameters:
        verdict = verdict_on(p)
        fitted = "-" if verdict else f"{p.fitted:.4g}"
        rows.append((f"{p.name} [{p.unit}]", f"{p.initial:.4g}", fitted, interval_words(p), verdict))
    return Table(heads=("parameter", "initial", "fitted", "90 % interval", ""), rows=tuple(rows))


def interval_words(p: FitParameter) -> str:
    """Return a parameter's 90 % interval in words, or nothing without one."""
    return f"{p.interval_low:.3g} to {p.interval_high:.3g}" if p.interval_low is not None else ""


def _error_table(result: FitResult) -> Table:
    pairs = [("training", result.error.train_before, result.error.train_after)]
    if result.error.held_out_before is not None and result.error.held_out_after is not None:
        pairs.append(("held out", result.error.held_out_before, result.error.held_out_after))
    rows = []
    for name, before, after in pairs:
        rows.append((f"mean, {name}", millimetres(before.mean_m), millimetres(after.mean_m)))
        rows.append((f"largest, {name}", millimetres(before.max_m), millimetres(after.max_m)))
    for one in result.trivial:
        error = one.held_out or one.train
        where = "held out" if one.held_out else "training"
        rows.append((f"mean, {where}, {TRIVIAL_NAMES[one.name]}", "", millimetres(error.mean_m)))
    return Table(heads=("mean distance of all points", "before", "after"), rows=tuple(rows))


def error_row(name: str, error: ErrorFigure) -> tuple[str, str, str]:
    """Return a name with the mean and the largest error."""
    return name, millimetres(error.mean_m), millimetres(error.max_m)


def millimetres(metres: float) -> str:
    """Return a length [m] in millimetres with one decimal."""
    return f"{1e3 * metres:.1f} mm"


def _combination_row(c: Combination) -> tuple[str, ...]:
    after = f"{c.fitted:.3g}" if c.is_identified else "-"
    span = f"{c.interval_low:.3g} to {c.interval_high:.3g} {c.unit}"
    return c.name, f"{c.initial:.3g}", after, span, verdict_on(c)


def _added_line(finding: EffectFinding) -> str:
    if not finding.tested:
        return f"{finding.id}: {finding.note}"
    closed = (
        f"closes {100 * finding.closure.value:z.0f} % of the gap" if finding.closure else "there is no gap to close"
    )
    p_value = f" (p = {finding.p_value:.3f})" if finding.p_value is not None else ""
    return f"With {finding.id} at {finding.amplitude:.3g} {finding.unit}: {closed}{p_value}."
