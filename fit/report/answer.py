"""The answer on top of the report: the verdict in a sentence, with the figures that carry it."""

from __future__ import annotations

from markupsafe import Markup

from fit.report.templating import piece
from fit.report.text import interval, millimetres, percent, tenths, tenths_interval
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult

TONES = {"none": "good", "effect": "good", "ambiguous": "warn", "several": "good", "unknown": "warn"}
TRIVIAL_NAMES = {"vertical": "a hanging board instead", "pendulum": "a pendulum of two numbers instead"}
VERDICT_WORDS = {
    "none": "no gap",
    "effect": "one missing effect",
    "ambiguous": "not distinguishable yet",
    "several": "several missing effects",
    "unknown": "cause unknown",
    "numerics": "refine the simulation first",
    "inconclusive": "too little data",
}


def verdict(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return the answer in one sentence, with the figures that carry it."""
    tone, tag = "plain", "fit"
    if diagnosis is not None:
        sentence = diagnosis.sentence
        tone, tag = TONES.get(diagnosis.verdict, "bad"), VERDICT_WORDS.get(diagnosis.verdict, diagnosis.verdict)
    else:
        sentence = _fit_sentence(fit)
    lists = [_gap_figures(diagnosis)] if diagnosis is not None else []
    lists += [_fit_figures(fit)] if fit is not None else []
    # The first sentence is large, the rest smaller.
    first, separator, rest = sentence.partition(". ")
    return piece("parts.html", "answer", tone, tag, first + separator.strip(), rest, lists)


def named(diagnosis: Diagnosis) -> str:
    """Return in words which effects the figures are of; of ambiguous effects, the first."""
    names = [name.replace("_", " ") for name in diagnosis.named]
    if diagnosis.verdict == "ambiguous":
        return f"{names[0]} (as one of {len(names)})"
    return " and ".join(names) or "the best effect"


def _gap_figures(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    gap = diagnosis.gap
    on = "on motion not used to fit" if gap.is_held_out else "on the motion it was fitted to"
    figures = [("base model misses by", tenths(gap.base_mm.value), on)]
    if gap.with_effect_mm is not None:
        figures.append((f"with {named(diagnosis)}", tenths(gap.with_effect_mm.value), on))
    figures.append(("the sensor's noise alone", tenths(gap.floor_mm.value), tenths_interval(gap.floor_mm.interval)))
    if gap.edge_mm is not None and gap.edge_with_effect_mm is not None:
        with_it = f"{tenths(gap.edge_with_effect_mm)} with {named(diagnosis)}; noise in both"
        figures.append(("base model has the held edge off by", tenths(gap.edge_mm), with_it))
    if gap.held_by_edge_mm is not None and gap.closure_held_by_edge is not None:
        closed = f"{percent(gap.closure_held_by_edge.value)} of the gap closed"
        figures.append(("held where its edge was tracked", tenths(gap.held_by_edge_mm.value), closed))
    if gap.closure is not None:
        ends = interval(gap.closure.interval, 100, 2)
        figures.append(("share of the gap closed", percent(gap.closure.value), f"{ends} %" if ends else ""))
    return figures


def _fit_sentence(fit: FitResult | None) -> str:
    if fit is None:
        return "Real and simulated motion, without a fit or a diagnosis."
    error = fit.error
    if error.held_out_after is not None:
        after, before, on = error.held_out_after, error.held_out_before, "on motion not used to fit"
    else:
        after, before, on = error.train_after, error.train_before, "on the motion it was fitted to"
    against = f", against {millimetres(before.mean_m)} before the fit" if before is not None else ""
    return f"The fitted simulation stays {millimetres(after.mean_m)} from the real cloth on average {on}{against}."


def _fit_figures(fit: FitResult) -> list[tuple[str, str, str]]:
    figures = []
    for name, before, after in (
        ("takes used to fit", fit.error.train_before, fit.error.train_after),
        ("held-out takes", fit.error.held_out_before, fit.error.held_out_after),
    ):
        if before is not None and after is not None:
            detail = f"mean distance; largest {1e3 * before.max_m:.0f} → {1e3 * after.max_m:.0f} mm"
            figures.append((f"fit, {name}", f"{1e3 * before.mean_m:.1f} → {millimetres(after.mean_m)}", detail))
    for one in fit.trivial:
        error, on = (one.held_out, "held-out takes") if one.held_out else (one.train, "takes used to fit")
        detail = f"mean distance of a rigid sheet, {on}"
        figures.append((TRIVIAL_NAMES[one.name], millimetres(error.mean_m), detail))
    return figures
