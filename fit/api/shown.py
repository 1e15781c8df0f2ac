"""Tables of results, with the same rows in the terminal, in a notebook and from the command line.

A parameter that the takes do not identify has an interval and no value. Many values fit such takes equally well, and
rounding decides at which of them a search ends.
"""

from __future__ import annotations

from fit.api.tables import Table
from formats.diagnosis_records import Diagnosis, EffectFinding, in_percent, is_refitted, tells_size
from formats.figures import head_of, short, span_of, with_unit
from formats.fit_records import (
    TRIVIAL_NAMES,
    Combination,
    ErrorFigure,
    FitParameter,
    FitResult,
    verdict_on,
    warnings_in,
)

IF_IT_HOLDS = "90 % interval, if the model holds"
# The coverage is measured on takes of the fit's own solver and mesh (`benchmarks/search.py`).
COVERED_BY_INTERVALS = (
    "90 % intervals cover the takes' noise and the local minima that the search found, but neither missing physics nor "
    "the mesh's error."
)
COVERED_OF_EFFECTS = "The interval of an effect's size covers mesh, solver and the effect's other laws as well."
OWN_BASE_FIT = (
    "The diagnosis fits its base model anew, by a search and on a mesh of its own: `hangtime fit` may end at other "
    "bounds."
)
FINDS_PHYSICS = "`hangtime diagnose` finds missing physics."


def fit_tables(result: FitResult) -> list[Table]:
    """Return tables of the parameters, errors, objective parts and parameter combinations of a fit."""
    tables = [parameter_table(result.parameters), _error_table(result)]
    if any(p.interval_low is not None for p in result.parameters):
        more = f"{COVERED_OF_EFFECTS} {FINDS_PHYSICS}" if result.effects else FINDS_PHYSICS
        tables[0] = Table(heads=tables[0].heads, rows=tables[0].rows, remarks=(COVERED_BY_INTERVALS, more))
    if result.objective is not None and len(result.objective.parts) > 1:
        whole = result.objective
        parts = [(f"{whole.name}, training", (whole.before, whole.after))]
        parts += [(f"  {name}", figures) for name, figures in whole.parts.items()]
        tables.append(
            Table(
                heads=("objective", "before", "after"),
                rows=tuple((name, short(before, 4), short(after, 4)) for name, (before, after) in parts),
            )
        )
    if result.combinations:
        heads = ("combination", "before", "after", IF_IT_HOLDS, "")
        rows = tuple(_combination_row(c) for c in result.combinations)
        tables.append(Table(heads=heads, rows=rows))
    if warnings := warnings_in(result.notes):
        tables[1] = Table(heads=tables[1].heads, rows=tables[1].rows, remarks=tuple(warnings))
    return [*camera_table(result), *tables]


def diagnosis_tables(diagnosis: Diagnosis, added: tuple[str, ...] = ()) -> list[Table]:
    """Return tables of the verdict, the gap, the tested effects, and the next recording.

    `added` holds effects that the caller requested in any case
    """
    remarks = [f"Verdict: {diagnosis.verdict}", diagnosis.sentence]
    remarks.append("Errors are root mean square distances of the free points.")
    if any(p.is_at_bound for p in diagnosis.base_parameters):
        remarks.append(OWN_BASE_FIT)
    remarks += [_added_line(finding, diagnosis.named) for finding in diagnosis.effects if finding.id in added]
    if diagnosis.next_experiment is not None:
        remarks.append(diagnosis.next_experiment.sentence)
    remarks += warnings_in(diagnosis.notes)
    return [*camera_table(diagnosis, reported=diagnosis.sentence), Table(remarks=tuple(remarks))]


def camera_table(result: FitResult | Diagnosis, reported: str = "") -> list[Table]:
    """Return the camera's faults as sentences, except those in `reported`; nothing without faults."""
    left = camera_words(result, reported)
    return [Table(remarks=tuple(left))] if left else []


def camera_words(result: FitResult | Diagnosis, reported: str = "", *, only_faults: bool = False) -> list[str]:
    """Return the camera's findings as sentences, except those in `reported`.

    only_faults: only those for which the takes or the garment file must be corrected
    """
    return [
        f"Camera: {found.sentence}"
        for found in result.camera
        if found.sentence not in reported and (found.is_fault or not only_faults)
    ]


def effect_table(diagnosis: Diagnosis) -> Table:
    """Return a table of the tested effects, most probable first; it marks those that were screened only."""
    tested = sorted((e for e in diagnosis.ranked if e.tested), key=lambda e: -(e.probability or 0.0))
    rows = []
    for effect in tested:
        closed = f"{100 * effect.closure.value:z.0f} %" if effect.closure is not None else ""
        chance = in_percent(effect.probability) if effect.probability is not None else ""
        is_named, ends = effect.id in diagnosis.named, effect.amplitude_interval
        is_sized = tells_size(effect, diagnosis.named)
        size = with_unit(short(effect.amplitude), effect.unit) if is_sized else "-"
        spread = with_unit(span_of(ends), effect.unit) if ends is not None else ""
        state = "named" if is_named else "" if is_refitted(effect) else "screened only"
        rows.append((effect.id, chance, size, spread, closed, state))
    heads = ("effect", "probability", "size", "90 % interval", "gap closed", "")
    return Table(heads=heads, rows=tuple(rows), right=(1, 2, 4))


def parameter_table(parameters: list[FitParameter]) -> Table:
    """Return a table of initial and fitted values with 90 % intervals; only an interval for unidentified parameters."""
    rows = []
    for p in parameters:
        verdict = verdict_on(p)
        fitted = "-" if verdict else short(p.fitted, 4)
        rows.append((head_of(p.name, p.unit), short(p.initial, 4), fitted, interval_words(p), verdict))
    return Table(heads=("parameter", "initial", "fitted", IF_IT_HOLDS, ""), rows=tuple(rows))


def interval_words(p: FitParameter) -> str:
    """Return a parameter's 90 % interval in words, or nothing without one."""
    if p.interval_low is None or p.interval_high is None:
        return ""
    return span_of((p.interval_low, p.interval_high))


def _error_table(result: FitResult) -> Table:
    pairs = [("training", result.error.train_before, result.error.train_after)]
    if result.error.held_out_before is not None and result.error.held_out_after is not None:
        pairs.append(("held out", result.error.held_out_before, result.error.held_out_after))
    rows = []
    for name, before, after in pairs:
        rows.append((f"all frames, {name}", millimetres(before.mean_m), millimetres(after.mean_m)))
        rows.append((f"worst frame, {name}", millimetres(before.max_m), millimetres(after.max_m)))
    for one in result.trivial:
        error = one.held_out or one.train
        where = "held out" if one.held_out else "training"
        rows.append((f"all frames, {where}, {TRIVIAL_NAMES[one.name]}", "", millimetres(error.mean_m)))
    return Table(heads=("mean distance of all points", "before", "after"), rows=tuple(rows))


def error_row(name: str, error: ErrorFigure) -> tuple[str, str, str]:
    """Return a name with the mean and the largest error."""
    return name, millimetres(error.mean_m), millimetres(error.max_m)


def millimetres(metres: float) -> str:
    """Return a length [m] in millimetres with one decimal."""
    return f"{1e3 * metres:.1f} mm"


def _combination_row(c: Combination) -> tuple[str, ...]:
    after = short(c.fitted) if c.is_identified else "-"
    span = span_of((c.interval_low, c.interval_high))
    return head_of(c.name, c.unit), short(c.initial), after, span, verdict_on(c)


def _added_line(finding: EffectFinding, named: list[str]) -> str:
    if not finding.tested:
        return f"{finding.id}: {finding.note}"
    closed = "no gap shows that it could close"
    if finding.closure is not None:
        closed = f"closes {100 * finding.closure.value:z.0f} % of the gap"
        if finding.closure.interval is not None:
            low, high = finding.closure.interval
            closed += f" [{100 * low:z.0f} to {100 * high:z.0f} %]"
    p_value = f" (p {_compared(finding.p_value)})" if finding.p_value is not None else ""
    ends, size = finding.amplitude_interval, ""
    if tells_size(finding, named):
        size = f" at {with_unit(short(finding.amplitude), finding.unit)}"
    elif ends is not None:
        size = f" ({with_unit(span_of(ends), finding.unit)}, 90 % interval)"
    return f"With {finding.id}{size}: {closed}{p_value}.{_doubt(finding, named)}"


def _doubt(finding: EffectFinding, named: list[str]) -> str:
    """Return a sentence on the closure of an effect whose size may be 0."""
    ends = finding.amplitude_interval
    if finding.closure is None or ends is None or finding.id in named or not ends[0] <= 0 <= ends[1]:
        return ""
    if finding.amplitude == 0 and finding.closure.value == 0:
        return " No size of it fits the takes better than none."
    return " Its size may be 0, and that the difference of two refits, which may end at other local minima."


def _compared(p_value: float) -> str:
    """Return a p-value behind its sign; a very small one is no 0."""
    return "< 0.001" if p_value < 0.001 else f"= {p_value:.3f}"
