"""Sections of the report, each built from the records it shows; a section without content is empty."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from msgspec.structs import replace

from fit.effects import LIBRARY
from fit.errors import FitError
from fit.methods import find_method
from fit.report.answer import named, run_names
from fit.report.charts import (
    Curve,
    cloth_map,
    effect_bars,
    error_chart,
    force_map,
    gap_bars,
    where_bars,
)  # fmt: skip
from fit.report.effects import meaning_of
from fit.report.methods import headed, method_figures, search_history
from fit.report.motion import RUNS, ReportMotion, rms_of
from fit.report.origin import Origin
from fit.report.tables import effect_table, parameter_table
from fit.report.templating import NOTHING, piece
from fit.report.text import MISSING, duration, instant, number, percent, unit_words, words
from formats.arrays import Floats
from formats.diagnosis_records import Diagnosis, Gate, MissingForce
from formats.fit_records import NOT_IDENTIFIED, ErrorFigure, FitParameter, FitResult, warnings_in
from formats.plain_text import counted, joined

OWN_FIT = (
    "The diagnosis fits its base model anew, by a search and on a mesh of its own. So these values may differ from "
    "those above. So may the parameters at their bounds. Refitted effects give it another start, so another library "
    "of effects may end it elsewhere. Its intervals cover the takes' noise and the ends of its own starts that are as "
    "good. They do not cover what the fit above found."
)
# The base fit minimises the residual, so what an effect shares with damping and stiffness is gone from the pull.
BESIDE_CANDIDATES = (
    "This force is what the fitted base model leaves. Its damping and stiffness have taken over what they can of a "
    "missing effect. So the force may look unlike {effects}, which the refits found. The refits decide the verdict, "
    "and this description does not."
)
OTHER_MINIMA = "the fit above found other values that follow the takes as well"
SHARE_OF_SQUARES = (
    "The share of the gap closed is of squared errors above the noise, as independent errors add by their squares. So "
    "the share is not the ratio of two lengths here."
)
MEASURE = (
    "Root mean square (rms) distance between simulated and real free points (points that the hanger does not hold)"
)
# The instruction of a failed check follows the last colon of its sentence.
SHARED_MOTION = (
    "Both errors rise and fall with the same stretches of motion, so the share of the gap closed can be surer than "
    "their whiskers."
)
POINTS_SHOWN = 6  # worst points, which get a curve each
MOST_VERTICES = 400  # vertices of a point's curve: more are finer than a screen's pixels


def gap(diagnosis: Diagnosis | None) -> Markup:
    """Return the gap from the base error down to the noise floor."""
    if diagnosis is None:
        return NOTHING
    where = "measured on takes that were not used to fit" if diagnosis.gap.is_held_out else (
        "measured on the takes it was fitted to, so it flatters: give a held-out take for an honest figure"
    )  # fmt: skip
    intro = f"{MEASURE}, {where}. Whiskers are 90 % intervals."
    if diagnosis.gap.closure is not None and diagnosis.gap.with_effect_mm is not None:
        intro += f" {SHARE_OF_SQUARES} {SHARED_MOTION}"
    return lead(intro) + gap_bars(diagnosis.gap, named(diagnosis))


def player(
    motions: Sequence[ReportMotion], shown: int, note: str, fit: FitResult | None = None,
    diagnosis: Diagnosis | None = None,
) -> Markup:  # fmt: skip
    """Return the controls of the motion player for the first `shown` motions."""
    if not shown:
        return NOTHING
    played, names = motions[:shown], run_names(fit, diagnosis)
    runs = [(run, names[run]) for run in RUNS if any(run in motion.runs for motion in played)]
    takes = [motion.take_id + (" (held out)" if motion.is_held_out else "") for motion in played]
    pull = max(motion.pull_hz for motion in played)
    moved = max(
        (float(np.linalg.norm(m.offset(run), axis=1).max()) for m in played for run in m.shown), default=0.0
    )  # fmt: skip
    return piece(
        "player.html", "player", takes, runs, f"{pull:g}" if pull else "", note,
        f"{1e3 * moved:.0f}" if moved > 0 else "",
    )  # fmt: skip


def errors(
    fit: FitResult | None, motions: Sequence[ReportMotion], shown: int, diagnosis: Diagnosis | None = None
) -> Markup:
    """Return the error over time of every run of every motion, or of the fit result if there is no motion."""
    charts, names = [], run_names(fit, diagnosis)
    for index, motion in enumerate(motions):
        curves = []
        for run in motion.shown:
            whole = rms_of([motion], run)
            if whole is not None:
                apart = motion.errors(run)
                largest = np.max(apart, axis=1, initial=-1.0, where=np.isfinite(apart))
                largest = np.where(largest < 0, np.nan, largest)
                worst = ("worst frame", float(np.nanmax(motion.judged(run))))
                curves.append(Curve(run, motion.rms(run), largest, names[run], ("rms", whole), worst))
        kind = "held out: not used to fit" if motion.is_held_out else "used to fit"
        tied = index if index < shown else None
        charts.append(error_chart(f"{motion.take_id} ({kind})", motion.time, curves, motion=tied))
        if tied is not None:
            charts.append(_by_point(motion, index, names))
    if not any(charts) and fit is not None:
        charts = [
            _figure_chart("takes used to fit", fit.error.train_before, fit.error.train_after),
            _figure_chart("held-out takes", fit.error.held_out_before, fit.error.held_out_after),
        ]
        intro = "Distance between real and simulated points in each frame: the mean over the points, and dashed of all."
    else:
        intro = (
            f"{MEASURE}, in each frame; thin, the worst point, which lies above it; dashed, all frames. A curve breaks "
            "where no free point is seen. A worst frame shows half or more of the most free points seen at once."
        )
        intro += " Dotted, the fit." if any("fit" in motion.shown for motion in motions) else ""
    if not any(charts):
        return NOTHING
    hint = " Click a chart to move the player there." if shown else ""
    return lead(intro + hint) + NOTHING.join(charts)


def _by_point(motion: ReportMotion, index: int, names: dict[str, str]) -> Markup:
    """Return a curve for each of the worst free points, in a collapsed section."""
    if not motion.shown:
        return NOTHING
    size = np.nan_to_num(
        np.sqrt(np.nanmean(np.where(motion.counted, motion.errors(motion.shown[0]) ** 2, 0.0), axis=0))
    )
    worst = [int(k) for k in np.argsort(-size)[:POINTS_SHOWN] if motion.counted[:, k].any()]
    every = max(1, math.ceil(len(motion.time) / MOST_VERTICES))
    charts = []
    for k in worst:
        curves = []
        for run in motion.shown:
            apart = motion.errors(run)[:, k]
            whole = float(np.sqrt(np.nanmean(apart**2)))
            largest = ("largest", float(np.nanmax(apart)))
            curves.append(Curve(run, apart[::every], None, names[run], ("rms", whole), largest))
        caption = f"{motion.point_names[k].replace('_', ' ')}, distance of this point"
        charts.append(error_chart(caption, motion.time[::every], curves, motion=index))
    shown = f"the {len(worst)} worst of " if len(worst) < int(motion.counted.any(0).sum()) else ""
    title = f"{motion.take_id}: point by point ({shown}{int(motion.counted.any(0).sum())} free points)"
    return piece(
        "parts.html", "details", title, Markup('<div class="points">{}</div>').format(NOTHING.join(charts)), False
    )


def parameters(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return the section of fitted parameters, of the fit and of the diagnosis' base model."""
    parts = []
    if fit is not None:
        about = Markup("Method <code>{}</code>, search <code>{}</code>.").format(fit.method, fit.search)
        parts += [lead(about), parameter_table(fit.parameters, _meanings(fit))]
        parts += [note(said) for said in warnings_in(fit.notes)]
        free = {p.name for p in fit.parameters if p.is_identified is False}
        switched_on = [
            (name.replace("_", " "), _size(name, None if name in free else size)) for name, size in fit.effects.items()
        ]
        if switched_on:
            parts.append(headed("Effects in this fit, and their sizes", pairs(switched_on)))
        parts.append(search_history(fit))
    if diagnosis is not None and diagnosis.base_parameters:
        table = parameter_table(_beside(diagnosis.base_parameters, fit))
        parts.append(headed("Base model of the diagnosis", lead(OWN_FIT) + table) if parts else table)
    return NOTHING.join(parts)


def _beside(parameters: Sequence[FitParameter], fit: FitResult | None) -> list[FitParameter]:
    """Return the base model's parameters; those that a fit of the same takes does not identify have no value either."""
    found = fit.parameters if fit is not None else []
    free = {(p.name, p.unit) for p in found if p.is_identified is False}
    return [
        replace(p, is_identified=False, note=f"{OTHER_MINIMA}. {p.note[:1].upper()}{p.note[1:]}")
        if (p.name, p.unit) in free and p.is_identified is not False
        else p
        for p in parameters
    ]


def _meanings(fit: FitResult) -> dict[str, str]:
    """Return the meanings of a fit's parameters by name; for an unknown method, those of effects only."""
    sizes = {
        p.name: meaning_of(p.name.partition(".")[0], None if p.is_identified is False else p.fitted)
        for p in fit.parameters
    }
    try:
        return sizes | {p.name: p.meaning for p in find_method(fit.method).parameters}
    except FitError:
        return sizes


def _size(name: str, amplitude: float | None) -> str:
    """Return an effect's amplitude with its unit and meaning; name: the effect's, a component's after a dot.

    amplitude: None where the takes do not identify the amplitude
    """
    effect = name.partition(".")[0]
    if amplitude is None:
        return "; ".join(filter(None, [NOT_IDENTIFIED, meaning_of(effect, None)]))
    unit = next((f" {unit_words(known.unit)}" for known in LIBRARY if known.name == effect and known.unit != "1"), "")
    return f"{number(amplitude)}{unit}: {meaning_of(effect, amplitude)}"


def camera(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return the section on the camera's faults, found before any fit."""
    found = next((record.camera for record in (diagnosis, fit) if record is not None and record.camera), [])
    if not found:
        return NOTHING
    intro = "Found from the points, the held row and the hanger's path alone, before any cloth was simulated."
    return lead(intro) + piece("parts.html", "notes", [one.sentence for one in found])


def method(fit: FitResult | None) -> Markup:
    """Return the section with the published method's errors, objective and combinations before and after the fit."""
    found = method_figures(fit)
    return piece("parts.html", "details", "Mean distance of all points, objective", found, False) if found else NOTHING


def effects(diagnosis: Diagnosis | None) -> Markup:
    """Return the section on every effect of the library, tested or not."""
    if diagnosis is None or not diagnosis.effects:
        return NOTHING
    refitted = [e for e in diagnosis.ranked if e.closure is not None or e.id in diagnosis.named]
    others = [e for e in diagnosis.ranked if e not in refitted]
    body = NOTHING
    if refitted:
        intro = (
            f"Root mean square error that each effect alone would leave, everything fitted again. {SHARE_OF_SQUARES}"
        )
        body += lead(intro) + effect_bars(diagnosis.gap, refitted, diagnosis.named)
        body += effect_table(refitted, diagnosis.named)
    if others:
        many = counted(len(others), "effect")
        about = f"{many} not chosen for a refit, and how small each could be seen"
        body += piece("parts.html", "details", about, effect_table(others, diagnosis.named), not refitted)
    return body


def where(diagnosis: Diagnosis | None, outline: Floats | None = None) -> Markup:
    """Return the section with the four splits of the gap: region, phase, frequency, direction."""
    if diagnosis is None:
        return NOTHING
    found = diagnosis.where
    maps = (
        where_bars("On the cloth", found.space, cloth_map(found.vertices, outline))
        + where_bars("When in the motion", found.time)
        + where_bars("At which frequency", found.frequency)
        + where_bars("In which direction", found.term)
    )
    if not maps:
        return NOTHING
    intro = (
        "Root mean square error of the base model; small, the part's share of the whole squared error. A region or a "
        "phase has the error of its own points and frames. Frequencies and directions are components of the whole "
        "error, so their squares add up to its square."
    )
    return lead(intro) + Markup('<div class="maps">{}</div>').format(maps)


def missing_force(
    found: MissingForce | None, outline: Floats | None = None, candidates: Sequence[str] = ()
) -> Markup:  # fmt: skip
    """Return the section on the missing force, whether or not an effect of the library explains it.

    A force that the noise hides has its sentence alone. `candidates`: names of effects that are named or likely.
    """
    if found is None:
        return NOTHING
    if found.is_hidden:
        return Markup("<p>{}</p>").format(found.sentence)
    shares = dict(found.spatial_share)
    figures = [
        ("along the cloth's normal", percent(found.normal_share)),
        (f"changes sign with the velocity{_energy(found.power)}", percent(found.odd_share)),
        ("keeps its sign (stores energy, or is constant)", percent(found.even_share)),
        ("grows with speed to the power of", number(found.amplitude_exponent)),
        ("place", ", ".join(f"{words(name)} {percent(share)}" for name, share in shares.items()) or MISSING),
    ]
    said = lead("Shares are of the mean squared force per mass.")
    if candidates:
        titles = joined([name.replace("_", " ") for name in candidates], last="or")
        said = lead(BESIDE_CANDIDATES.format(effects=titles)) + said
    return Markup("<p>{}</p>").format(found.sentence) + said + force_map(found.places, outline) + pairs(figures)


def _energy(power: float | None) -> str:
    return "" if power is None else " (takes energy out)" if power < 0 else " (gives energy to the cloth)"


def gates(diagnosis: Diagnosis | None) -> Markup:
    """Return the section on the gates of a diagnosis."""
    if diagnosis is None or not diagnosis.gates:
        return NOTHING
    intro = "A check that fails gives no verdict about physics: too little data, or a simulation to refine first."
    return lead(intro) + piece("parts.html", "gates", [_gate(gate) for gate in diagnosis.gates])


def cost(fit: FitResult | None, diagnosis: Diagnosis | None) -> Markup:
    """Return the section on cost, inputs and notes of the result; nothing without a result."""
    if fit is None and diagnosis is None:
        return NOTHING
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
        figures.append((f"{name} made", instant(record.created)))
        notes += [note for note in record.notes if note not in notes]
    names = [p.name for p in (fit.parameters if fit is not None else [])]
    for name in sorted(names, key=len, reverse=True):
        notes = [note.replace(name, name.replace("_", " ")) for note in notes]
    return pairs(figures) + (piece("parts.html", "notes", notes) if notes else NOTHING)


def next_experiment(diagnosis: Diagnosis | None) -> Markup:
    """Return the section on the proposed next recording."""
    if diagnosis is None or diagnosis.next_experiment is None:
        return NOTHING
    found = diagnosis.next_experiment
    apart = ", ".join(name.replace("_", " ") for name in found.separates)
    figures = [("motion", found.motion), ("tells apart", apart or MISSING)]
    if found.sigmas_next is not None:
        now = f", against {number(found.sigmas_now, 2)} now" if found.sigmas_now is not None else ""
        figures.append(("by", f"{number(found.sigmas_next, 2)} standard deviations{now}"))
    return Markup("<p>{}</p>").format(found.sentence) + pairs(figures)


def origin(found: Origin | None) -> Markup:
    """Return the provenance section, including the digest of every take."""
    if found is None:
        return NOTHING
    rows = [(f"take {take}, {part}", f"sha256 {digest}") for take, part, digest in found.takes]
    return pairs([*found.facts, *rows])


def lead(text: str) -> Markup:
    """Return the first paragraph of a section."""
    return piece("parts.html", "lead", text)


def note(text: str) -> Markup:
    """Return a paragraph in the style of remarks."""
    return piece("parts.html", "note", text)


def pairs(entries: Sequence[tuple[str, str]]) -> Markup:
    """Return names with their values."""
    return piece("parts.html", "pairs", entries)


def _figure_chart(caption: str, before: ErrorFigure | None, after: ErrorFigure | None) -> Markup:
    """Return the chart of per-frame errors of a fit result; several takes follow one another."""
    given = [(run, figure) for run, figure in (("before", before), ("after", after)) if figure is not None]
    if not given:
        return NOTHING
    stamps = np.array([math.nan if t is None else t for t in given[0][1].time_s], dtype=float)
    passed = np.diff(stamps, prepend=stamps[:1] if len(stamps) else 0.0)
    time = np.cumsum(np.where(passed >= 0, passed, 0.0))
    names = run_names(None, None)
    curves = [
        Curve(
            run, np.array([math.nan if v is None else v for v in figure.per_frame_m], dtype=float), None, names[run],
            ("mean", figure.mean_m),
        )
        for run, figure in given
    ]  # fmt: skip
    if any(len(curve.values) != len(time) for curve in curves):
        return NOTHING
    return error_chart(caption, time, curves)


def _gate(gate: Gate) -> dict[str, object]:
    return {"passed": gate.passed, "sentence": gate.sentence, "name": words(gate.name)}
