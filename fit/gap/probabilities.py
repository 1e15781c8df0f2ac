"""How likely each effect is at work, from draws of the held-out error.

Drawn are blocks of the held-out takes, what mesh and solver may be wrong by (`fit.gap.closure.solver_draws`), and how
much of the gap a true cause may leave unexplained beyond noise, mesh and solver: the library's laws are not nature's.
That limit is logistic about LEFT with a width of LEFT_WIDTH: on cases whose truth was known (`docs/blind-check.md`)
nearly all that left less than a tenth was the cause, and about half of what left a fifth to three fifths. In a draw an
effect is at work if it leaves the least error, is worth naming and leaves no more than the limit. Several effects are
at work together where they leave no more than the limit and the last of them was worth adding; they share that
probability, and each of them may be at work alone in the other draws.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.gap.evidence import Evidence, are_worth_adding
from fit.gap.hypotheses import Hypothesis

Floats = NDArray[np.float64]

LEFT, LEFT_WIDTH = 0.35, 0.12  # of the gap that a cause may leave


def probabilities(evidence: Evidence, several: Hypothesis | None) -> dict[int, float]:
    """Return the probability of each effect that was refitted or is one of several that are named together."""
    base, drawn, joint = evidence.drawn(*([several] if several else []))
    noise = evidence.floor_mm**2
    limit = np.maximum(np.random.default_rng(1).logistic(LEFT, LEFT_WIDTH, len(base)), 0.0)
    most = noise + evidence.numerics_mm**2 + limit * (base - noise)
    together = np.zeros(len(base), bool)
    if several is not None:
        before = np.min(np.stack(list(drawn.values())), axis=0)
        together = are_worth_adding(base - noise, before - noise, before - joint[0]) & (joint[0] <= most)
    worth = evidence.are_worth_naming(base, drawn)
    found = {k: float(np.mean(worth[k] & (drawn[k] <= most) & ~together)) for k in drawn}
    for k in several.effects if several is not None else ():
        found[k] = found.get(k, 0.0) + float(together.mean())
    return found
