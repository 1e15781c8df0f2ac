"""The sections of the report, each from the records it shows; a section without anything to show is empty."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

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
from fit.report.methods import method_figures, search_history
from fit.report.motion import RUNS, ReportMotion
from fit.report.tables import effect_table, parameter_table
from fit.report.text import (
    MISSING,
    duration,
    escaped,
    number,
    percent,
    small,
    words,
)
from formats.results import Diagnosis, ErrorFigure, FitResult, Gate, MissingForce


def gap(diagnosis: Diagnosis | None) -> str:
    """Return the gap from the base error down to the noise floor."""
    if diagnosis is None:
        return ""
    where = "measured on takes that were not used to fit" if diagnosis.gap.is_held_out else (
        "measured on the takes it was fitted to, so it flatters: give a held-out take for an honest figure"
    )  # fmt: skip
    intro = f"Root mean square distance between simulated and real points, {where}. Whiskers are 90 % intervals."
    return _section("gap", "The gap", f'<p class="lead">{intro}</p>{gap_bars(diagnosis.gap, named(diagnosis))}')


def player(motions: Sequence[ReportMotion], shown: int, note: str) -> str:
    """Return the controls of the motion player for the first `shown` motions."""
    if not shown:
        return ""
    runs = [run for run in RUNS if any(motion.points(run) is not None for motion in motions[:shown])]
    run_buttons = "".join(_press("run", run, RUN_NAMES[run]) for run in runs)
    choice = ""
    if shown > 1:
        options = "".join(
            f'<option value="{k}">{escaped(motion.take_id)}{" (held out)" if motion.is_held_out else ""}</option>'
            for k, motion in enumerate(motions[:shown])
        )
        choice = f'<label>Take <select data-part="motion">{options}</select></label>'
    speeds = "".join(
        f'<option value="{s}"{" selected" if s == 1 else ""}>{label}</option>'
        for s, label in ((0.1, "1/10"), (0.25, "1/4"), (0.5, "1/2"), (1, "1"), (2, "2"))
    )
    views = "".join(
        _press("view", view, label) for view, label in (("front", "Front"), ("side", "Side"), ("oblique", "Oblique"))
    )
    cloths = "".join(
        _press("cloth", kind, label)
        for kind, label in (("error", "By error"), ("shaded", "Shaded"), ("wire", "Wire"), ("none", "Off"))
    )
    pull = max(motion.pull_hz for motion in motions[:shown])
    drawn = (
        f"These takes cannot be predicted for long: the simulated cloth is drawn weakly to the real points (pull of "
        f"{pull:g} Hz), here as in the figures above."
    )
    pulled = f'<p class="lead">{drawn}</p>' if pull else ""
    legend = (
        '<ul class="legend"><li style="--swatch:var(--real)">filled dots: real points</li>'
        '<li class="is-striped" style="--swatch:var(--after)">open squares: simulated points</li>'
        '<li class="is-line" style="--swatch:var(--real)">lines: the error between them</li></ul>'
    )
    body = f"""{pulled}<div class="player" id="player">
<div class="controls">{choice}{_group("Simulation", run_buttons)}</div>
<canvas tabindex="0" role="img" aria-label="Real points and simulated cloth; drag to turn. Space plays, the arrow
 keys step, shift and arrow keys turn, F and S show front and side, plus and minus zoom."></canvas>
<div class="controls"><button type="button" class="play" data-part="play">Play</button>
<input type="range" data-part="scrub" min="0" max="1" value="0" step="1" aria-label="Time">
<span class="clock" data-part="clock"></span>
<label>Speed <select data-part="speed">{speeds}</select></label></div>
<p class="readout" data-part="readout"></p>
<div class="controls">{_group("View", views)}{_group("Cloth", cloths)}
<label><input type="checkbox" data-part="errors" checked> error lines</label>
<span class="choices"><button type="button" data-zoom="1.25" aria-label="Nearer">+</button><button type="button"
 data-zoom="0.8" aria-label="Farther">−</button></span></div>
{legend}<noscript><p class="warning">The player needs JavaScript; everything else on this page does not.</p></noscript>
</div>"""
    return _section(
        "motion", "Real against simulated motion", body + (f'<p class="note">{escaped(note)}</p>' if note else "")
    )


def errors(fit: FitResult | None, motions: Sequence[ReportMotion], shown: int) -> str:
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
        return ""
    intro = (
        "Distance between real and simulated points in each frame: thick, the mean over the points; thin, the worst "
        "point; dashed, the mean over all frames."
    )
    hint = " Click a chart to move the player there." if shown else ""
    return _section("errors", "Error over time", f'<p class="lead">{intro}{hint}</p>{"".join(charts)}')


def parameters(fit: FitResult | None, diagnosis: Diagnosis | None) -> str:
    """Return the fitted parameters, of the fit and of the diagnosis' base model."""
    parts = []
    if fit is not None:
        about = f"Method <code>{escaped(fit.method)}</code>, search <code>{escaped(fit.search)}</code>."
        switched_on = [(name.replace("_", " "), number(amplitude)) for name, amplitude in fit.effects.items()]
        added = f"<h3>Effects in this fit, and their amplitudes</h3>{_pairs(switched_on)}" if switched_on else ""
        warned = "".join(f'<p class="note">{escaped(n)}</p>' for n in fit.notes if n.startswith("Warning:"))
        table = parameter_table(fit.parameters) + warned
        parts.append(f'<p class="lead">{about}</p>' + table + added + search_history(fit))
    if diagnosis is not None and diagnosis.base_parameters:
        heading = "<h3>Base model of the diagnosis</h3>" if parts else ""
        parts.append(heading + parameter_table(diagnosis.base_parameters))
    return _section("parameters", "Fitted parameters", "".join(parts)) if parts else ""


def method(fit: FitResult | None) -> str:
    """Return errors, objective and identified combinations before and after the fit."""
    body = method_figures(fit)
    return _section("method", "Before and after", body) if body else ""


def effects(diagnosis: Diagnosis | None) -> str:
    """Return every effect of the library, tested or not."""
    if diagnosis is None or not diagnosis.effects:
        return ""
    refitted = [e for e in diagnosis.effects if e.closure is not None or e.id in diagnosis.named]
    others = [e for e in diagnosis.effects if e not in refitted]
    body = ""
    if refitted:
        body += (
            '<p class="lead">What the model would still miss by with each effect alone, everything fitted again; '
            "striped: what goes, solid: what stays above the noise.</p>"
            + effect_bars(diagnosis.gap, refitted, diagnosis.named)
            + effect_table(refitted, diagnosis.named)
        )
    if others:
        listed = effect_table(others, diagnosis.named)
        what = f"{len(others)} effects of which the residual shows hardly anything, and how small each could be seen"
        body += f"<details{'' if refitted else ' open'}><summary>{what}</summary>{listed}</details>"
    return _section("effects", "Effects considered", body)


def where(diagnosis: Diagnosis | None) -> str:
    """Return the four maps of where the gap lies."""
    if diagnosis is None:
        return ""
    found = diagnosis.where
    place = where_bars("On the cloth", found.space)
    cloth = cloth_map(found.vertices)
    maps = (
        (place[: -len("</div>")] + cloth + "</div>" if place else f"<div>{cloth}</div>" if cloth else "")
        + where_bars("When in the motion", found.time)
        + where_bars("At which frequency", found.frequency)
        + where_bars("In which direction", found.term)
    )
    if not maps:
        return ""
    intro = "Root mean square error of the base model in each part; small, the part's share of the whole squared error."
    return _section("where", "Where the gap lies", f'<p class="lead">{intro}</p><div class="maps">{maps}</div>')


def missing_force(found: MissingForce | None) -> str:
    """Return what the missing force looks like, whether or not the library has a name for it."""
    if found is None:
        return ""
    shares = dict(found.spatial_share)
    pairs = [
        ("along the cloth's normal", percent(found.normal_share)),
        (f"changes sign with the velocity{_energy(found.power)}", percent(found.odd_share)),
        ("keeps its sign (stores energy, or is constant)", percent(found.even_share)),
        ("grows with speed to the power of", number(found.amplitude_exponent)),
        ("place", ", ".join(f"{words(name)} {percent(share)}" for name, share in shares.items()) or MISSING),
    ]
    return _section(
        "force",
        "What the missing force looks like",
        f"<p>{escaped(found.sentence)}</p>{force_map(found.places)}{_pairs(pairs)}",
    )


def _energy(power: float | None) -> str:
    return "" if power is None else " (takes energy out)" if power < 0 else " (gives energy to the cloth)"


def gates(diagnosis: Diagnosis | None) -> str:
    """Return the checks that a diagnosis has to pass."""
    if diagnosis is None or not diagnosis.gates:
        return ""
    items = "".join(_gate(gate) for gate in diagnosis.gates)
    intro = "A check that fails gives no verdict about physics: too little data, or a simulation to refine first."
    return _section("gates", "Checks", f'<p class="lead">{intro}</p><ul class="gates">{items}</ul>')


def cost(fit: FitResult | None, diagnosis: Diagnosis | None) -> str:
    """Return what the result took, what it was made from, and the notes."""
    pairs: list[tuple[str, str]] = []
    notes: list[str] = []
    both: list[tuple[str, FitResult | Diagnosis]] = []
    if fit is not None:
        both.append(("fit", fit))
        pairs.append(("fit", f"{fit.simulations} simulations in {duration(fit.seconds)}, seed {fit.seed}"))
    if diagnosis is not None:
        both.append(("diagnosis", diagnosis))
        pairs.append(("diagnosis", f"{diagnosis.cost.simulations} simulations in {duration(diagnosis.cost.seconds)}"))
    for name, record in both:
        pairs.append((f"takes of the {name}", ", ".join(map(escaped, record.take_ids)) or MISSING))
        pairs.append((f"held-out takes of the {name}", ", ".join(map(escaped, record.held_out_ids)) or "none"))
        pairs.append((f"{name} made", escaped(record.created)))
        notes += [note for note in record.notes if note not in notes]
    listed = "".join(f"<li>{escaped(note)}</li>" for note in notes)
    return _section("cost", "Cost and origin", _pairs(pairs) + (f"<h3>Notes</h3><ul>{listed}</ul>" if listed else ""))


def next_experiment(diagnosis: Diagnosis | None) -> str:
    """Return the recording that would say more."""
    if diagnosis is None or diagnosis.next_experiment is None:
        return ""
    found = diagnosis.next_experiment
    pairs = [("motion", escaped(found.motion)), ("tells apart", ", ".join(map(words, found.separates)) or MISSING)]
    if found.sigmas_next is not None:
        now = f", against {number(found.sigmas_now, 2)} now" if found.sigmas_now is not None else ""
        pairs.append(("by", f"{number(found.sigmas_next, 2)} standard deviations{now}"))
    return _section("next", "What to record next", f"<p>{escaped(found.sentence)}</p>{_pairs(pairs)}")


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


def reading() -> str:
    """Return how to read the page."""
    items = "".join(f"<dt>{escaped(term)}</dt><dd>{escaped(text)}</dd>" for term, text in READING.items())
    return _section("reading", "How to read this", f'<dl class="reading">{items}</dl>')


def _section(anchor: str, title: str, body: str) -> str:
    return (
        f'<section id="{anchor}" aria-labelledby="{anchor}-title"><h2 id="{anchor}-title">{title}</h2>{body}</section>'
    )


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    return (
        '<dl class="pairs">' + "".join(f"<dt>{escaped(name)}</dt><dd>{value}</dd>" for name, value in pairs) + "</dl>"
    )


def _press(group: str, value: str, label: str) -> str:
    return f'<button type="button" data-{group}="{value}" aria-pressed="false">{escaped(label)}</button>'


def _group(name: str, buttons: str) -> str:
    return f'<fieldset class="choices"><legend>{name}</legend>{buttons}</fieldset>'


def _figure_chart(caption: str, before: ErrorFigure | None, after: ErrorFigure | None) -> str:
    """Chart of per-frame errors; the frames of several takes follow one another."""
    given = [(run, figure) for run, figure in (("before", before), ("after", after)) if figure is not None]
    if not given:
        return ""
    stamps = np.array([math.nan if t is None else t for t in given[0][1].time_s], dtype=float)
    passed = np.diff(stamps, prepend=stamps[:1] if len(stamps) else 0.0)
    time = np.cumsum(np.where(passed >= 0, passed, 0.0))
    curves = [
        Curve(run, np.array([math.nan if v is None else v for v in figure.per_frame_m], dtype=float))
        for run, figure in given
    ]
    if any(len(curve.mean) != len(time) for curve in curves):
        return ""
    return error_chart(caption, time, curves)


def _gate(gate: Gate) -> str:
    mark = '<span class="is-passed">✓ passed</span>' if gate.passed else '<span class="is-failed">✗ failed</span>'
    unit = "" if gate.unit in ("", "1") else f" {escaped(gate.unit)}"
    figures = f"{number(gate.figure)}{unit}" if gate.figure is not None else "not measured"
    if gate.limit is not None:
        figures += f", limit {number(gate.limit)}{unit}"
    detail = small(f"({words(gate.name)}: {figures})")
    return f"<li>{mark}<span>{escaped(gate.sentence)} {detail}</span></li>"
