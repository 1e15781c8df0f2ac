"""Amplitudes of effects that the held edge alone identifies, and the smallest amplitudes that it can detect.

Hanger and effects alone place a simulated edge, for any cloth (`fit.observer.edge`). The edge has the residual r. S is
its change per unit of the amplitudes of a fit's effects that move it. The edge alone estimates these amplitudes as

    delta = -(S'S)^-1 S'r,   cov = I^-1,   I = S'S over what varies / SLOW + S'S over what is off constantly / takes

since slow noise makes SLOW times the scores of white noise, and a marker's own offset is the same in all takes.
The cloth identifies amplitudes too. Its error e of mesh and solver [mm^2 rms per number] has a random direction among
FREE_DIRECTIONS. The error makes the amplitudes as uncertain as a smaller weight of each of its N numbers would. With
the variance s^2 of its noise, the weight is smaller by

    trust = 1 + N e^2 / (FREE_DIRECTIONS s^2)

(`fit.gap.closure.solver_draws`). The edge may put an amplitude elsewhere by more than DISPUTED deviations, and agree
with the tracked edge there. Then the fit is repeated with the edge's amplitude. An amplitude that the edge identifies
to no better than a typical size stays. For example, a scale of the whole scene moves edge and hanger alike.
Source: weighted least squares with a prior, A. Tarantola, "Inverse Problem Theory" (2005), section 3.2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.gap.fitting import PRIOR_AMPLITUDE, Fitted, Pinned, Problem
from fit.gap.screening import Screened
from fit.observer.edge import is_seen_on_edge
from fit.observer.residuals import Observer
from fit.observer.simulation_error import FREE_DIRECTIONS
from formats.arrays import Floats

SLOW = 4.0  # scores of slow noise, a third of the white one and lasting a third of a second, over those of white noise
# Deviations between the edge's amplitude and the fit's; our choice: noise exceeds it in 5 % of single components.
DISPUTED = 2.0
LEADS = 2  # effects refitted since they would explain the held edge's error; our choice: each costs a refit
# Typical sizes: an effect that needs more moves the edge by rounding errors only. Our choice: ranges end at 20 typical
# sizes, so half and double only change how larger amplitudes are listed.
LARGEST_AMPLITUDE = 1e3


def trust_in_edge(observer: Observer, numerics_mm: float) -> float:
    """Return the factor by which the cloth's residuals are overconfident, for an error of mesh and solver [mm]."""
    layout = observer.layout
    noise = float((layout.sd[layout.is_judged] ** 2).mean())
    wrong = (1e-3 * numerics_mm) ** 2 / 3.0
    return 1.0 + float(layout.is_judged.sum()) * wrong / (FREE_DIRECTIONS * noise)


def disputed(observer: Observer, without: Floats, fitted: Fitted, trust: float) -> Pinned | None:
    """Return a fit's amplitudes as estimated by the held edge, if they differ from the cloth's and explain the edge.

    without: residual of the model without the fit's effects, (numbers,)
    """
    on_edge = observer.layout.is_edge
    moving = Problem(observer, tuple(name for name in fitted.active if observer.library[name].moves_edge))
    chosen = moving.columns
    if not on_edge.any() or not len(chosen):
        return None
    every = Problem(observer, fitted.active)
    rows = fitted.jacobian[on_edge, len(fitted.vector) :][:, np.isin(every.columns, chosen)].T
    delta, known, sd = _solved(observer, rows, fitted.residual[on_edge])
    after, before = fitted.residual.copy(), observer.edge_errors(without)
    after[on_edge] += delta @ rows
    if delta @ known @ delta <= DISPUTED**2 or not is_seen_on_edge(before, observer.edge_errors(after)):
        return None
    amplitudes, spread = fitted.amplitudes.copy(), np.full(len(observer.off), np.inf)
    amplitudes[chosen] += delta * moving.typical
    spread[chosen] = sd * moving.typical
    (amplitudes,) = every.unpack(every.pack(fitted.vector, amplitudes)[None])[1]  # within bounds
    return Pinned(amplitudes, spread, trust)


def beside_another(observer: Observer, start: Fitted, effect: str, rows: Floats) -> Pinned | None:
    """Estimate from the held edge the amplitudes of the effects that it decided in a fit, jointly with one more effect.

    Components that the edge does not identify stay free. rows, (components, numbers): of the effect, in typical sizes
    """
    if start.pinned is None:
        return None
    on_edge, old = observer.layout.is_edge, Problem(observer, start.active)
    decided = np.isfinite(start.pinned.sd[old.columns])
    before = start.jacobian[on_edge, len(start.vector) :].T[decided]
    delta, _, sd = _solved(observer, np.concatenate([before, rows[:, on_edge]]), start.residual[on_edge])
    if not np.isfinite(sd).any():
        return None
    new = Problem(observer, (effect,))
    columns = np.concatenate([old.columns[decided], new.columns])
    typical = np.concatenate([old.typical[decided], new.typical])
    amplitudes, spread = start.amplitudes.copy(), np.full(len(observer.off), np.inf)
    amplitudes[columns] += delta * typical
    spread[columns] = sd * typical
    return Pinned(amplitudes, spread, start.pinned.trust)


def leads(observer: Observer, screened: Screened, residual: Floats) -> list[str]:
    """Return the screened effects that would explain the held edge's error, best first; residual, (numbers,)."""
    on_edge, before = observer.layout.is_edge, observer.edge_errors(residual)
    if not on_edge.any():
        return []
    found = []
    for name, signature in screened.items():
        rows, effect = signature.raw[:, on_edge], observer.library[name]
        if not effect.moves_edge or not rows.any():
            continue
        delta, *_ = _solved(observer, rows, residual[on_edge])
        after = residual.copy()
        after[on_edge] += (np.maximum(delta, 0.0) if effect.is_one_sided else delta) @ rows
        then = observer.edge_errors(after)
        if is_seen_on_edge(before, then):
            found.append((then.shown, name))
    return [name for _, name in sorted(found)[:LEADS]]


def detectable_on_edge(observer: Observer, judge: Observer, screened: Screened) -> dict[str, float]:
    """Return the smallest amplitude of each screened effect that the held edge of the judged takes would reveal."""
    found = dict.fromkeys(screened, float("inf"))
    frames, judged_on = (float((o.layout.is_edge & (o.layout.frame >= 0)).sum()) for o in (observer, judge))
    if min(frames, judged_on) == 0.0:
        return found
    for name, signature in screened.items():
        if observer.library[name].moves_edge:
            errors = [observer.edge_errors(row) for row in signature.raw]
            least = min(replace(e, moving=e.moving * judged_on / frames).shown for e in errors)
            size = signature.typical / float(np.sqrt(max(least, 1e-12)))
            found[name] = size if size < LARGEST_AMPLITUDE * signature.typical else float("inf")
    return found


def _solved(observer: Observer, rows: Floats, residual: Floats) -> tuple[Floats, Floats, Floats]:
    """Solve for the step of components, rows (components, edge's numbers), against the edge's residual.

    Return the step, its information matrix, and the deviation of each component, (components,). The deviation is
    infinite, and the step zero, if the edge identifies the component to no better than a typical size.
    """
    layout = observer.layout
    still = (layout.frame < 0)[layout.is_edge]
    takes = max(len(np.unique(layout.take[layout.is_edge])), 1)
    weighted = rows * np.where(still, 1.0 / takes, 1.0 / SLOW)
    known = weighted @ rows.T + 1e-9 * np.eye(len(rows))
    is_identified = np.diag(np.linalg.inv(known + np.eye(len(known)) / PRIOR_AMPLITUDE**2)) < 1.0
    of_identified = known[np.ix_(is_identified, is_identified)]
    step, sd = np.zeros(len(rows)), np.full(len(rows), np.inf)
    step[is_identified] = -np.linalg.solve(of_identified, (weighted @ residual)[is_identified])
    sd[is_identified] = np.sqrt(np.diag(np.linalg.inv(of_identified)))
    return step, known, sd
