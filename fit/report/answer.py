"""Summary at the top of the report: the verdict in one sentence, with its key figures."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from fit.report.effects import meaning_of
from fit.report.motion import ReportMotion, rms_of
from fit.report.templating import piece
from fit.report.text import interval, millimetres, number, percent, tenths, tenths_interval, unbroken, unit_words
from formats.diagnosis_records import LIKELY, Diagnosis, in_percent
from formats.fit_records import FitResult

VERDICT_TONES = {"none": "good", "effect": "good", "ambiguous": "warn", "several": "good", "unknown": "warn"}
VERDICT_WORDS = {
    "none": "no gap",
    "effect": "one missing effect",
    "ambiguous": "not distinguishable yet",
    "several": "several missing effects",
    "unknown": "cause unknown",
    "numerics": "refine the simulation first",
    "inconclusive": "too little data",
}

OF_SQUARES = "of squared error above the noise"
# A fit's error beside a diagnosis is shown where it is off the base model's by more than this share of it. Our
# choice: closer figures say one thing twice, as the diagnosis fits the base model again.
FIT_APART = 0.05
RMS = "root mean square"  # the figure of the report and the diagnosis; tables of a fit have mean distances


def verdict(fit: FitResult | None, diagnosis: Diagnosis | None, motions: Sequence[ReportMotion] = ()) -> Markup:
    """Return the summary: the verdict in one sentence, with its key figures."""
    tone, tag = "plain", "fit"
    if diagnosis is not None:
        sentence = diagnosis.sentence
        tone, tag = VERDICT_TONES.get(diagnosis.verdict, "bad"), VERDICT_WORDS.get(diagnosis.verdict, diagnosis.verdict)
        figures = _gap_figures(diagnosis) + _fit_beside(fit, diagnosis, motions)
    else:
        sentence = _fit_sentence(fit, motions)
        figures = fit_figures(fit, motions) if fit is not None else []
    figures = [(name, unbroken(value), unbroken(detail)) for name, value, detail in figures]
    # The first sentence is large, the rest smaller.
    first, separator, rest = sentence.partition(". ")
    return piece("parts.html", "answer", tone, tag, first + separator.strip(), rest, figures)


def named(diagnosis: Diagnosis) -> str:
    """Return the names of the effects to which the figures refer; for an ambiguous verdict, the first effect."""
    names = [name.replace("_", " ") for name in diagnosis.named]
    if diagnosis.verdict == "ambiguous":
        return f"{names[0]} (as one of {len(names)})"
    return " and ".join(names) or "the best effect"


def candidates_of(diagnosis: Diagnosis) -> list[str]:
    """Return the effects that a diagnosis names, or else those that it finds likelier than not."""
    return diagnosis.named or [e.id for e in diagnosis.ranked if (e.probability or 0.0) >= LIKELY]


def run_names(fit: FitResult | None, diagnosis: Diagnosis | None) -> dict[str, str]:
    """Return the page's name of each run."""
    return {
        "before": "before the fit",
        "after": "after the fit",
        "base": "base model",
        "with_effect": f"with {named(diagnosis)}" if diagnosis is not None else "with the effect",
        "fit": f"the fit ({fit.method})" if fit is not None else "the fit",
    }


def _judged(motions: Sequence[ReportMotion]) -> tuple[list[ReportMotion], str]:
    """Return the motions on which errors are judged, held-out ones if there are any, and a phrase for them."""
    held_out = [motion for motion in motions if motion.is_held_out]
    if held_out:
        return held_out, "on motion not used to fit"
    return list(motions), "on the motion it was fitted to"


def _gap_figures(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    gap = diagnosis.gap
    on = "on motion not used to fit" if gap.is_held_out else "on the motion it was fitted to"
    figures = [("base model misses by", tenths(gap.base_mm.value), f"{RMS}, {on}")]
    if gap.with_effect_mm is not None:
        figures.append((f"with {named(diagnosis)}", tenths(gap.with_effect_mm.value), f"{RMS}, {on}"))
    ends = tenths_interval(gap.floor_mm.interval)
    figures.append(("the sensor's noise alone", tenths(gap.floor_mm.value), "; ".join(filter(None, [RMS, ends]))))
    for effect in diagnosis.effects:
        if effect.id in diagnosis.named:
            unit = "" if effect.unit in ("", "1") else f" {unit_words(effect.unit)}"
            ends = f"{interval(effect.amplitude_interval)}{unit}; " if effect.amplitude_interval else ""
            meaning = ends + meaning_of(effect.id, effect.amplitude)
            title = effect.id.replace("_", " ")
            figures.append((f"size of {title}", number(effect.amplitude) + unit, meaning))
            if effect.probability is not None:
                figures.append(
                    (f"probability of {title}", in_percent(effect.probability), "that the model lacks the effect")
                )
    if gap.raw_mm is not None and gap.closure_from_raw is not None:
        closed = f"{percent(gap.closure_from_raw)} of the gap from there closed, the camera's faults included"
        figures.append(("base model on the points as tracked", tenths(gap.raw_mm), closed))
    if gap.edge_mm is not None and gap.edge_with_effect_mm is not None:
        with_it = f"{tenths(gap.edge_with_effect_mm)} with {named(diagnosis)}; noise in both"
        figures.append(("base model has the held edge off by", tenths(gap.edge_mm), with_it))
    if gap.held_by_edge_mm is not None and gap.closure_held_by_edge is not None:
        closed = f"{percent(gap.closure_held_by_edge.value)} of the gap closed"
        figures.append(("held where its edge was tracked", tenths(gap.held_by_edge_mm.value), closed))
    if gap.closure is not None:
        ends = interval(gap.closure.interval, 100, 2)
        detail = "; ".join(filter(None, [f"{ends} %" if ends else "", OF_SQUARES]))
        figures.append(("share of the gap closed", percent(gap.closure.value), detail))
    return figures


def _fit_beside(
    fit: FitResult | None, diagnosis: Diagnosis, motions: Sequence[ReportMotion]
) -> list[tuple[str, str, str]]:
    """Return the error of a fit that is shown with a diagnosis, unless the base model's is close to it."""
    judged, on = _judged(motions)
    error = rms_of(judged, "fit")
    base = diagnosis.gap.base_mm.value
    if fit is None or error is None or abs(1e3 * error - base) <= FIT_APART * base:
        return []
    name = f"the fit ({fit.method}) misses by"
    return [(name, millimetres(error), f"{RMS}, {on}; with the values that hangtime fit found before")]


def _fit_sentence(fit: FitResult | None, motions: Sequence[ReportMotion]) -> str:
    if fit is None:
        return "Real and simulated motion, without a fit or a diagnosis."
    judged, on = _judged(motions)
    before, after = rms_of(judged, "before"), rms_of(judged, "after")
    if after is not None:
        against = f", against {millimetres(before)} before the fit" if before is not None else ""
        return f"The fitted simulation misses the real cloth by {millimetres(after)} ({RMS}) {on}{against}."
    error = fit.error
    if error.held_out_after is not None:
        shown, begun, on = error.held_out_after, error.held_out_before, "on motion not used to fit"
    else:
        shown, begun, on = error.train_after, error.train_before, "on the motion it was fitted to"
    against = f", against {millimetres(begun.mean_m)} before the fit" if begun is not None else ""
    return f"The fitted simulation stays {millimetres(shown.mean_m)} from the real cloth on average {on}{against}."


def fit_figures(fit: FitResult, motions: Sequence[ReportMotion]) -> list[tuple[str, str, str]]:
    """Return the errors before and after the fit: root mean square if the motion is known, else the fit's figures."""
    figures = []
    groups = (
        ("held-out takes", [m for m in motions if m.is_held_out], fit.error.held_out_before, fit.error.held_out_after),
        ("takes used to fit", [m for m in motions if not m.is_held_out], fit.error.train_before, fit.error.train_after),
    )
    for name, shown, before, after in groups:
        begun, reached = rms_of(shown, "before"), rms_of(shown, "after")
        if begun is not None and reached is not None:
            detail = f"{RMS} distance of the free points"
            figures.append((f"fit, {name}", f"{1e3 * begun:.1f} → {millimetres(reached)}", detail))
        elif not motions and before is not None and after is not None:
            detail = f"mean distance of all points; largest {1e3 * before.max_m:.0f} → {1e3 * after.max_m:.0f} mm"
            figures.append((f"fit, {name}", f"{1e3 * before.mean_m:.1f} → {millimetres(after.mean_m)}", detail))
    return figures
