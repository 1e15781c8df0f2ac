"""Tests that effects must pass to be named, alone or together: the rules behind a verdict."""

from __future__ import annotations

from fit.gap.closure import gain_p_value
from fit.gap.detectable import mesh_share
from fit.gap.evidence import (
    SMALLEST_CLOSURE,
    Evidence,
    best_of,
    closes_enough,
    is_at_bound,
    is_refuted_by_edge,
    is_shown_by_edge,
)
from fit.gap.fitting import Fitted, amplitude_of, excludes_zero
from fit.gap.hypotheses import Hypothesis
from fit.observer.residuals import Observer
from formats import figures
from formats.diagnosis_records import LIKELY

# Probability of any wrong rejection among the refitted effects (Bonferroni); our choice: as is usual.
FAMILY_WISE_LEVEL = 0.05
# Of the gap: lower end of the closure's interval where no effect passes alone; our choice: surely most of it.
SURELY_CLOSED = 0.5


def may_be_added(observer: Observer, hypothesis: Hypothesis, p_value: float) -> bool:
    """Return whether a hypothesis' last effect is significant, certainly not zero, and within its physical range."""
    _, interval = amplitude_of(hypothesis.fitted, observer, hypothesis.effects[-1])
    is_sure = p_value < FAMILY_WISE_LEVEL and excludes_zero(interval) and not is_at_bound(observer, hypothesis)
    return is_sure and not any(is_brought(observer, hypothesis.fitted, k) for k in hypothesis.effects)


def is_brought(observer: Observer, fitted: Fitted, effect: str) -> bool:
    """Return whether an effect of a fit may be only part of another effect's law."""
    brought = 0.0
    for other in fitted.active:
        share = dict(observer.library[other].brings).get(observer.library[effect].name, 0.0)
        brought += share * amplitude_of(fitted, observer, other)[0]
    _, (low, _) = amplitude_of(fitted, observer, effect)
    return brought > 0.0 and low <= brought


def what_lacks(evidence: Evidence, effect: str) -> list[str]:
    """Return what a refitted effect lacks to be named: each test that it fails, nothing if it passes all."""
    hypothesis, p_value = evidence.singles[effect], evidence.p_value(effect)
    closed, (_, interval) = evidence.closure_of(hypothesis), evidence.amplitude(effect, any_law=False)
    gain = evidence.base.errors.squared_mm - hypothesis.errors.squared_mm
    least = mesh_share(evidence.observer.library[effect]) * evidence.numerics_mm**2
    shown, level = figures.beside(p_value, FAMILY_WISE_LEVEL, 2)
    failed = {
        f"p is {shown} where less than {level} is needed": p_value >= FAMILY_WISE_LEVEL,
        "its size may be 0, as far as noise, mesh and solver can tell": not excludes_zero(interval),
        "it removes no more error than mesh and solver may make": gain <= least,
        f"less than {100 * SMALLEST_CLOSURE:.0f} % is too little": closed is None or closed.value < SMALLEST_CLOSURE,
    }
    return [said for said, fails in failed.items() if fails]


def passing_effects(evidence: Evidence) -> list[str]:
    """Return the effects that the held edge identifies, then those that pass every test, each sorted by closure."""
    passing = []
    for k, hypothesis in evidence.singles.items():
        if k in evidence.identified_by_edge:
            continue
        closed = evidence.closure_of(hypothesis)
        if closed is None or k in evidence.contradicted or is_at_bound(evidence.observer, hypothesis):
            continue
        if not what_lacks(evidence, k):
            passing.append((closed.value, k))
    return effects_identified_by_edge(evidence) + [k for _, k in sorted(passing, reverse=True)]


def effects_identified_by_edge(evidence: Evidence) -> list[str]:
    """Return the effects that the held edge identifies, largest closure first."""
    return sorted(evidence.identified_by_edge, key=lambda name: (-closed_by(evidence, name), name))


def likely_ones(evidence: Evidence, passing: list[str]) -> list[str]:
    """Return the passing effects if most draws name one, else only those that the held edge identifies."""
    is_likely = sum(float(evidence.worth_naming[k].mean()) for k in passing) >= LIKELY
    return passing if is_likely else [k for k in passing if k in evidence.identified_by_edge]


def needed_together(evidence: Evidence, passing: list[str]) -> Hypothesis | None:
    """Return the largest joint hypothesis in which every added effect was needed, if one effect passes alone.

    If none passes alone because each hides the other, both together must certainly close half of the gap.
    """
    if not evidence.joint:
        return None
    accepted: Hypothesis | None = None
    before = best_of(evidence.observer, evidence.singles)[0]
    gap = evidence.gap_mm2
    for hypothesis, p_value in evidence.joint:
        is_enough = closes_enough(evidence.observer, gap, before, hypothesis, evidence.floor_mm)
        added = evidence.observer.library[hypothesis.effects[-1]]
        saved = before.errors.squared_mm - hypothesis.errors.squared_mm
        is_resolved = saved > mesh_share(added) * evidence.numerics_mm**2
        is_seen = is_shown_by_edge(evidence.observer, evidence.base, before, hypothesis)
        # An effect that the held edge shows may have zero closure, but must not certainly increase the error.
        is_shown = is_seen and gain_p_value(hypothesis.errors, before.errors, evidence.floor_mm) >= FAMILY_WISE_LEVEL
        # As for the first effect, its size must exceed the error of noise, mesh and solver.
        _, interval = evidence.amplitude(hypothesis.effects[-1], beside=hypothesis, any_law=False)
        is_certain = gain_p_value(before.errors, hypothesis.errors, evidence.floor_mm) < FAMILY_WISE_LEVEL
        closes = is_certain and is_enough and is_resolved and excludes_zero(interval)
        closes = closes and not evidence.is_law_of(before, hypothesis)
        is_needed = (closes or is_shown) and _adds_to_identified(evidence, hypothesis, gap)
        is_needed = is_needed and not is_refuted_by_edge(evidence.base, before, hypothesis)
        is_needed = is_needed and not any(
            evidence.observer.library[k].differs_by_solver and k not in passing for k in hypothesis.effects
        )
        if not may_be_added(evidence.observer, hypothesis, p_value) or not is_needed:
            break
        accepted = before = hypothesis
    if accepted is None or set(accepted.effects) & set(passing):
        return accepted
    closed = evidence.closure_of(accepted)
    return accepted if closed and closed.interval and closed.interval[0] >= SURELY_CLOSED else None


def _adds_to_identified(evidence: Evidence, pair: Hypothesis, gap: float) -> bool:
    """Return whether two effects are both needed if the held edge identifies one of them, which is certain."""
    identified = [evidence.singles[k] for k in evidence.identified_by_edge & set(pair.effects)]
    return len(pair.effects) > 2 or all(
        closes_enough(evidence.observer, gap, alone, pair, evidence.floor_mm)
        or is_shown_by_edge(evidence.observer, evidence.base, alone, pair)
        for alone in identified
    )


def is_near(evidence: Evidence, best: str, other: str, share: float) -> bool:
    """Return whether another effect closes at least a share of the best one's closure."""
    first, second = evidence.closure_of(evidence.singles[best]), evidence.closure_of(evidence.singles[other])
    return first is not None and second is not None and second.value > share * first.value


def closed_by(evidence: Evidence, effect: str) -> float:
    """Return the closure of a refitted effect, 0 where there is hardly a gap."""
    closed = evidence.closure_of(evidence.singles[effect])
    return closed.value if closed is not None else 0.0
