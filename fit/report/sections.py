"""The sections of the report, each from the records it shows; a section without anything to show is empty."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from fit.report.answer import named
from fit.report.charts import (
    RUN_NAMES,
    Curve,
    cloth_map,
    effect_bars,
    error_chart,
    force_map,
    gap_bars,
    where_bars,
)  # fmt: skip
from fit.report.methods import headed, method_figures, search_history
from fit.report.motion import RUNS, ReportMotion
from fit.report.tables import effect_table, parameter_table
from fit.report.templating import NOTHING, piece
from fit.report.text import MISSING, duration, number, percent, words
from formats.diagnosis_records import Diagnosis, Gate, MissingForce
from formats.fit_records import ErrorFigure, FitResult


def gap(diagnosis: Diagnosis | None) -> Markup:
    """Return the gap from the base error down to the noise floor."""
    if diagnosis is None:
        return NOTHING
    where = "measured on takes that were not used to fit" if diagnosis.gap.is_held_out else (
        "measured on the takes it was fitted to, so it flatters: give a held-out take for an honest figure"
    )  # fmt: skip
    intro = f"Root mean square distance between simulated and real points, {where}. Whiskers are 90 % intervals."
    return lead(intro) + gap_bars(diagnosis.gap, named(diagnosis))


def player(motions: Sequence[ReportMotion], shown: int, note: str) -> Markup:
    """Return the controls of the motion player for the first `shown` motions."""
    if not shown:
        return NOTHING
    played = motions[:shown]
    runs = [(run, RUN_NAMES[run]) for run in RUNS if any(motion.points(run) is not None for motion in played)]
    takes = [motion.take_id + (" (held out)" if motion.is_held_out else "") for motion in played]
    pull = max(motion.pull_hz for motion in played)
    return piece("player.html", "player", takes, runs, f"{pull:g}" if pull else "", note)


def errors(fit: FitResult | None, motions: Sequence[ReportMotion], shown: int) -> Markup:
    """Return the error over time before and after, of every motion, or of the fit result where there is no motion."""
    charts = []
    for index, motion in enumerate(motions):
        curves = []
        for run in RUNS:
            apart = motion.errors(run)
            if apart is not None:
                is_seen = np.isfinite(apart).any(axis=1)
                mean, largest = np.full(len(apart), np.nan), np.full(len(apart), np.nan)
                mean[is_seen] = np.nanmean(apart[is_seen], axis=1)
                largest[is_seen] = np.nanmax(apart[is_seen], axis=1)
                curves.append(Curve(run, mean, largest))
        kind = "held out: not used to fit" if motion.is_held_out else "used to fit"
        tied = index if index < shown else None
        charts.append(error_chart(f"{motion.take_id} ({kind})", motion.time, curves, motion=tied))
    if not any(charts) and fit is not None:
        charts = [
            _figure_chart("takes used to fit", fit.error.train_before, fit.error.train_after),
            _figure_chart("held-out takes", fit.error.held_out_before, fit.error.held_out_after),
        ]
    if not any(charts):
        return NOTHING
    intro = (
        "Distance between real and simulated points in each frame: thick, the mean over the points; thin, the worst "
        "point; dashed, the mean over all frames."
    )
    hint = " Click a chart to move the player there." if shown else ""
    return lead(intro + hint) + NOTHING.join(charts)


def parameters(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return the fitted parameters, of the fit and of the diagnosis' base model."""
    parts = []
    if fit is not None:
        about = Markup("Method <code>{}</code>, search <code>{}</code>.").format(fit.method, fit.search)
        parts += [lead(about), parameter_table(fit.parameters)]
        parts += [note(said) for said in fit.notes if said.startswith("Warning:")]
        switched_on = [(name.replace("_", " "), number(amplitude)) for name, amplitude in fit.effects.items()]
        if switched_on:
            parts.append(headed("Effects in this fit, and their amplitudes", pairs(switched_on)))
        parts.append(search_history(fit))
    if diagnosis is not None and diagnosis.base_parameters:
        table = parameter_table(diagnosis.base_parameters)
        parts.append(headed("Base model of the diagnosis", table) if parts else table)
    return NOTHING.join(parts)


def camera(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return what a camera made of the takes, found before anything was fitted."""
    found = next((record.camera for record in (diagnosis, fit) if record is not None and record.camera), [])
    if not found:
        return NOTHING
    intro = "Found from the points, the held row and the hanger's path alone, before any cloth was simulated."
    return lead(intro) + piece("parts.html", "notes", [one.sentence for one in found])


def method(fit: FitResult | None) -> Markup:
    """Return errors, objective and identified combinations before and after the fit."""
    return method_figures(fit)


def effects(diagnosis: Diagnosis | None) -> Markup:
    """Return every effect of the library, tested or not."""
    if diagnosis is None or not diagnosis.effects:
        return NOTHING
    refitted = [e for e in diagnosis.effects if e.closure is not None or e.id in diagnosis.named]
    others = [e for e in diagnosis.effects if e not in refitted]
    body = NOTHING
    if refitted:
        intro = (
            "The error that each effect alone would leave, everything fitted again; striped: removed, solid: above "
            "the noise still."
        )
        body += lead(intro) + effect_bars(diagnosis.gap, refitted, diagnosis.named)
        body += effect_table(refitted, diagnosis.named)
    if others:
        about = f"{len(others)} effects of which the residual shows hardly anything, and how small each could be seen"
        body += piece("parts.html", "details", about, effect_table(others, diagnosis.named), not refitted)
    return body


def where(diagnosis: Diagnosis | None) -> Markup:
    """Return the four maps of the gap's places."""
    if diagnosis is None:
        return NOTHING
    found = diagnosis.where
    maps = (
        where_bars("On the cloth", found.space, cloth_map(found.vertices))
        + where_bars("When in the motion", found.time)
        + where_bars("At which frequency", found.frequency)
        + where_bars("In which direction", found.term)
    )
    if not maps:
        return NOTHING
    intro = "Root mean square error of the base model in each part; small, the part's share of the whole squared error."
    return lead(intro) + Markup('<div class="maps">{}</div>').format(maps)


def missing_force(found: MissingForce | None) -> Markup:
    """Return what the missing force looks like, whether or not the library has a name for it."""
    if found is None:
        return NOTHING
    shares = dict(found.spatial_share)
    figures = [
        ("along the cloth's normal", percent(found.normal_share)),
        (f"changes sign with the velocity{_energy(found.power)}", percent(found.odd_share)),
        ("keeps its sign (stores energy, or is constant)", percent(found.even_share)),
        ("grows with speed to the power of", number(found.amplitude_exponent)),
        ("place", ", ".join(f"{words(name)} {percent(share)}" for name, share in shares.items()) or MISSING),
    ]
    return Markup("<p>{}</p>").format(found.sentence) + force_map(found.places) + pairs(figures)


def _energy(power: float | None) -> str:
    return "" if power is None else " (takes energy out)" if power < 0 else " (gives energy to the cloth)"


def gates(diagnosis: Diagnosis | None) -> Markup:
    """Return the checks that a diagnosis has to pass."""
    if diagnosis is None or not diagnosis.gates:
        return NOTHING
    intro = "A check that fails gives no verdict about physics: too little data, or a simulation to refine first."
    return lead(intro) + piece("parts.html", "gates", [_gate(gate) for gate in diagnosis.gates])


def cost(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return what the result took, what it was made from, and the notes."""
    figures: list[tuple[str, str]] = []
    notes: list[str] = []
    both: list[tuple[str, FitResult | Diagnosis]] = []
    if fit is not None:
        both.append(("fit", fit))
        figures.append(("fit", f"{fit.simulations} simulations in {duration(fit.seconds)}, seed {fit.seed}"))
    if diagnosis is not None:
        both.append(("diagnosis", diagnosis))
        figures.append(("diagnosis", f"{diagnosis.cost.simulations} simulations in {duration(diagnosis.cost.seconds)}"))
    for name, record in both:
        figures.append((f"takes of the {name}", ", ".join(record.take_ids) or MISSING))
        figures.append((f"held-out takes of the {name}", ", ".join(record.held_out_ids) or "none"))
        figures.append((f"{name} made", record.created))
        notes += [note for note in record.notes if note not in notes]
    return pairs(figures) + (piece("parts.html", "notes", notes) if notes else NOTHING)


def next_experiment(diagnosis: Diagnosis | None) -> Markup:
    """Return the recording that would say more."""
    if diagnosis is None or diagnosis.next_experiment is None:
        return NOTHING
    found = diagnosis.next_experiment
    apart = ", ".join(name.replace("_", " ") for name in found.separates)
    figures = [("motion", found.motion), ("tells apart", apart or MISSING)]
    if found.sigmas_next is not None:
        now = f", against {number(found.sigmas_now, 2)} now" if found.sigmas_now is not None else ""
        figures.append(("by", f"{number(found.sigmas_next, 2)} standard deviations{now}"))
    return Markup("<p>{}</p>").format(found.sentence) + pairs(figures)


READING = {
    "Gap": "The error of the simulation on motion that was not used to fit it, as far as it is larger than the "
    "sensor's noise. Below the noise floor nothing can be seen and nothing is claimed.",
    "Gap closed": "How much of the gap disappears once an effect is modelled and everything is fitted again, on motion "
    "not used to fit. 100 % means down to the noise; an effect that merely fits noise closes nothing.",
    "Amplitude": "How strong the effect has to be, in its own unit. An interval that includes zero means: "
    "maybe not there.",
    "p": "How often data without the effect would look this much like it.",
    "Smallest that would show": "The weakest amplitude that this recording could have revealed. An effect that was not "
    "found may still be there below this.",
    "Not identified": "Other parameters can make up for this one in this recording; its value says little.",
}


def reading() -> Markup:
    """Return how to read the page."""
    return piece("parts.html", "reading", READING)


def lead(text: str) -> Markup:
    """Return the paragraph that a section begins with."""
    return piece("parts.html", "lead", text)


def note(text: str) -> Markup:
    """Return a remark."""
    return piece("parts.html", "note", text)


def pairs(entries: Sequence[tuple[str, str]]) -> Markup:
    """Return names with their values."""
    return piece("parts.html", "pairs", entries)


def _figure_chart(caption: str, before: ErrorFigure | None, after: ErrorFigure | None) -> Markup:
    """Chart of per-frame errors; the frames of several takes follow one another."""
    given = [(run, figure) for run, figure in (("before", before), ("after", after)) if figure is not None]
    if not given:
        return NOTHING
    stamps = np.array([math.nan if t is None else t for t in given[0][1].time_s], dtype=float)
    passed = np.diff(stamps, prepend=stamps[:1] if len(stamps) else 0.0)
    time = np.cumsum(np.where(passed >= 0, passed, 0.0))
    curves = [
        Curve(run, np.array([math.nan if v is None else v for v in figure.per_frame_m], dtype=float))
        for run, figure in given
    ]
    if any(len(curve.mean) != len(time) for curve in curves):
        return NOTHING
    return error_chart(caption, time, curves)


def _gate(gate: Gate) -> dict[str, object]:
    unit = "" if gate.unit in ("", "1") else f" {gate.unit}"
    figures = f"{number(gate.figure)}{unit}" if gate.figure is not None else "not measured"
    if gate.limit is not None:
        figures += f", limit {number(gate.limit)}{unit}"
    return {"passed": gate.passed, "sentence": gate.sentence, "name": words(gate.name), "figures": figures}
