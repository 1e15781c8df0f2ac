"""Verdict from posterior probabilities of effects: `hangtime diagnose --by evidence`.

The fitted takes alone select the set of effects (`fit.gap.posterior`). The held-out takes are used once, for the
closure of this set. An effect's probability is the mass of all subsets that contain it under a known discrepancy.

| most of the mass | verdict |
|---|---|
| no effect, known discrepancy | `none`, or `inconclusive` where typical sizes would not show; `unknown`, see below |
| any subset, wide discrepancy | `unknown` |
| subsets of one effect | `effect`; `ambiguous` where others hold RIVAL of the mass in its place |
| subsets of two or three | `several`, with the effects that may stand in each one's place |

The masses do not weigh a motion of the whole cloth with its held edge. So `none` becomes `unknown` if the base model's
held edge is off beyond noise, and its held-out error clearly exceeds noise, mesh and solver.

The verdict names the set of largest mass in which every effect's size certainly differs from zero. Without this set it
names no effect. An effect that closes less than SMALLEST_CLOSURE of the held-out gap is no cause: `unknown`. Gates and
`numerics` are those of `fit.gap.verdict`.
"""

from __future__ import annotations

import numpy as np

from fit.gap.checkpoint import kept_as
from fit.gap.closure import block_errors, gain_p_value
from fit.gap.edge_words import describe_held_edge, still_off
from fit.gap.evidence import RIVAL, SMALLEST_CLOSURE, Evidence
from fit.gap.fitting import Fitted, Task, excludes_zero, fit
from fit.gap.floor import Floor, measured_noise
from fit.gap.hypotheses import Hypothesis, judged
from fit.gap.numerics import Refined
from fit.gap.passing import is_brought
from fit.gap.posterior import Found, Mass, Search, Subset
from fit.gap.rounds import Rounds
from fit.gap.screening import screen
from fit.gap.verdict import Verdict, gap_numbers, lacks, no_gap, share_closed, with_unit
from fit.observer.edge import is_edge_explained, is_favoured_by_edge
from fit.observer.residuals import Observer
from formats.arrays import Floats
from formats.diagnosis_records import in_percent

# Of odds between two sets; our choice: beyond any odds that are shown, so that their logarithm is finite.
LEAST_P_VALUE = 1e-300


def weigh(rounds: Rounds, noise: Floor, refined: Refined, added: tuple[str, ...]) -> Found:
    """Compute the masses of all subsets of effects, refit probable ones, judge the refits, and store all in `rounds`.

    added: names of effects that are refitted and reported whatever their mass
    """
    base = rounds.base.fitted
    rounds.screened = screen(rounds.observer, base, rounds.tested)
    rows = {name: one.raw for name, one in rounds.screened.items()}
    known = known_error_mm(noise, refined)
    made: dict[str, int] = {}
    ends: list[Fitted] = []  # further ends of the base model, which the search keeps only where they are better

    def refit(wanted: list[Subset], tasks: list[Task]) -> list[Fitted]:
        names = []
        for subset in wanted:
            name = kept_as(subset) or "base"
            made[name] = made.get(name, 0) + 1
            names.append(f"weighed-{name}-{made[name]}")
        fitted = rounds.kept.recall(names, lambda: fit(rounds.observer, tasks))
        ends.extend(one for subset, one in zip(wanted, fitted, strict=True) if not subset)
        return fitted

    def renew(about: Fitted) -> dict[str, Floats]:
        left = [name for name in rounds.tested if name not in about.active]
        if not left:  # the fit holds every effect that is tested
            return {}
        found = screen(rounds.observer, about, left, rounds.screened)
        return {name: one.raw for name, one in found.items()}

    search = Search(rounds.observer, measured_noise(rounds.observer, base.residual), base, rows, known, refit, renew)
    found = search.go(lambda stage: rounds.progress(stage, 0.5))
    found.mass = limited(rounds.observer, found)
    if found.fits[()] is not base:
        (rounds.base,) = judged(rounds.judge, [found.fits[()]])
    if ends:
        rounds.fits = sorted([*rounds.fits, *ends], key=lambda one: one.cost)
    singles = [one for one in found.fits.values() if len(one.active) == 1]
    several = [one for one in found.fits.values() if len(one.active) > 1]
    opened = judged(rounds.judge, singles + several)
    rounds.singles = {h.effects[0]: h for h in opened if len(h.effects) == 1}
    asked = [name for name in rounds.screened if name in added and name not in rounds.singles]
    rounds.asked = frozenset(asked)
    rounds.refit_alone(asked)
    rounds.keep_the_better()
    rounds.joint = [(h, 0.0) for h in opened if len(h.effects) > 1]
    return found


def limited(observer: Observer, found: Found) -> Mass | None:
    """Return masses in which no set beats one that differs in one effect by more than the half-seconds confirm.

    The likelihood states the covariance of the errors. Where an effect's law is inexact, this covariance is wrong, and
    its odds between two sets are too large. The half-seconds of the fitted takes need no covariance. Student's t of
    their gains (`fit.gap.closure.gain_p_value`) gives the probability p that the better set is no better. The odds
    between both are at most (1 - p) / p. A set that is refuted about the present fit has its odds, too, because its own
    fit decides. Where the held edge tells the sets apart, the likelihood's odds stay.
    Source: Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57 (1989).
    """
    mass = found.mass
    if mass is None:
        return None
    best = mass.among[int(mass.total.argmax())]
    if not best or best not in found.fits:
        return mass
    known, wide, top = mass.known.copy(), mass.wide.copy(), mass.among.index(best)
    base, least = (block_errors(observer, found.fits[one].residual) for one in ((), best))
    for n, subset in enumerate(mass.among):
        fitted = found.fits.get(subset)
        is_swapped = len(subset) == len(best) and len(set(subset) - set(best)) == 1
        if fitted is None or not is_swapped or any(is_brought(observer, fitted, name) for name in subset):
            continue
        errors = block_errors(observer, fitted.residual)
        p = float(np.clip(gain_p_value(errors, least, 0.0), LEAST_P_VALUE, 0.5))
        odds = float(np.log((1 - p) / p))
        is_told_by_edge = is_favoured_by_edge(errors.edge, least.edge, base.edge)
        if mass.total[top] - odds > mass.total[n] and not is_told_by_edge:
            known[n], wide[n] = mass.known[top] - odds, mass.wide[top] - odds
    return Mass(mass.among, known, wide, mass.sharp)


def known_error_mm(noise: Floor, refined: Refined) -> float:
    """Return the error [mm] of mesh and solver, plus the cloth motion by hanger noise beyond the points' noise."""
    shaken = max(noise.mm**2 - noise.measured_mm**2, 0.0)
    return float(np.sqrt(refined.numerics_mm**2 + shaken))


def inclusion(found: Found) -> dict[str, float]:
    """Return each effect's probability: the mass of the subsets that contain it under a known discrepancy."""
    likely: dict[str, float] = {}
    for subset, (known, _) in found.shares().items():
        for name in subset:
            likely[name] = likely.get(name, 0.0) + known
    return {name: min(mass, 1.0) for name, mass in likely.items()}  # sums of masses exceed 1 by rounding


def decide_by_mass(evidence: Evidence, found: Found) -> Verdict:
    """Return the verdict with the largest mass, and its sentence."""
    failed = [g for g in evidence.gates if not g.passed and g.name not in {"mesh and step", "base fit"}]
    figures = gap_numbers(evidence)
    if failed:
        return Verdict("inconclusive", [], f"No diagnosis: {failed[0].sentence} {figures}")
    shares = found.shares()
    unknown = sum(wide for _, wide in shares.values())
    nothing = shares[()][0]
    named = 1.0 - unknown - nothing
    gap = f"There is a gap that no effect in the library explains. {figures}"
    if nothing >= max(unknown, named):
        is_off = evidence.exceeds(evidence.floor_mm**2 + evidence.numerics_mm**2)
        if is_off and not is_edge_explained(evidence.base.errors.edge):
            return Verdict("unknown", [], gap + describe_held_edge(evidence))
        return no_gap(evidence, has_gap=evidence.exceeds(evidence.floor_mm**2))
    coarse = next((g for g in evidence.gates if g.name == "mesh and step" and not g.passed), None)
    order = sorted((s for s in found.fits if s), key=lambda s: -shares.get(s, (0.0, 0.0))[0])
    likeliest = _judged(evidence, order[0]) if order else None
    best = next((s for s in order if _is_sure(evidence, _judged(evidence, s))), ())
    hypothesis = _judged(evidence, best)
    closed = evidence.closure_of(hypothesis) if hypothesis else None
    if coarse is not None and 100 * (closed.value if closed else 0.0) <= (coarse.figure or 0.0):
        return Verdict("numerics", [], f"Refine first: {coarse.sentence} {figures}")
    if unknown < named and hypothesis is None and likeliest is not None:
        if not evidence.exceeds(evidence.floor_mm**2):
            return no_gap(evidence, has_gap=False)
        sizes = ", ".join(
            f"{evidence.observer.library[name].title} ({with_unit(evidence, name, likeliest)})"
            for name in likeliest.effects
        )
        unsure = "There is a gap, and no effect in the library explains it for sure."
        whose = "its size" if len(likeliest.effects) == 1 else "the size of one of them"
        said = f"{unsure} {figures} The likeliest is {sizes}, and {whose} may be nothing."
        return Verdict("unknown", [], said)
    if unknown >= named or hypothesis is None:
        return Verdict("unknown", [], gap + describe_held_edge(evidence))
    if closed is not None and closed.value < SMALLEST_CLOSURE:
        titles = " and ".join(evidence.observer.library[name].title for name in best)
        share = f"{100 * closed.value:z.0f} %"
        more = f" {titles[0].upper()}{titles[1:]} would close {share} of the gap."
        if evidence.is_held_out:
            fitted = f" On the fitted motion {titles} would close the gap"
            more = f"{fitted}; on the held-out motion {share} of the gap closes."
        return Verdict("unknown", [], gap + more)
    others = {name: _instead(shares, best, name) for name in best}
    return _named(evidence, found, hypothesis, {name: held for name, held in others.items() if held})


def _judged(evidence: Evidence, subset: Subset) -> Hypothesis | None:
    if len(subset) == 1:
        return evidence.singles.get(subset[0])
    return next((h for h, _ in evidence.joint if set(h.effects) == set(subset)), None)


def _is_sure(evidence: Evidence, hypothesis: Hypothesis | None) -> bool:
    """Return whether every effect's size exceeds noise, mesh and solver; an effect that was not judged does not."""
    if hypothesis is None:
        return False
    sizes = (evidence.amplitude(name, beside=hypothesis, any_law=False) for name in hypothesis.effects)
    return all(excludes_zero(interval) for _, interval in sizes)


def _instead(shares: dict[Subset, tuple[float, float]], best: Subset, name: str) -> list[str]:
    """Return alternatives to each effect of the best subset that have a large mass, most probable first."""
    rest = set(best) - {name}
    swaps = [
        (known, next(iter(set(subset) - rest)))
        for subset, (known, _) in shares.items()
        if len(subset) == len(best) and rest < set(subset) and name not in subset
    ]
    return [other for known, other in sorted(swaps, reverse=True) if known >= RIVAL * (known + shares[best][0])]


def _named(evidence: Evidence, found: Found, best: Hypothesis, others: dict[str, list[str]]) -> Verdict:
    library, likely = evidence.observer.library, inclusion(found)
    shares = found.shares()
    if len(best.effects) == 1 and others:
        names = [best.effects[0], *next(iter(others.values()))]
        either = " or ".join(f"{library[name].title} (probability {in_percent(likely[name])})" for name in names)
        said = f"{either[0].upper()}{either[1:]}: these takes cannot tell them apart. {gap_numbers(evidence)}"
        return Verdict("ambiguous", names, said)
    causes = [
        library[name].title
        + "".join(f" (or {library[n].title}: these takes cannot tell)" for n in others.get(name, []))
        for name in best.effects
    ]
    held = [
        min(likely[name] + sum(_swapped(shares, best.effects, name, n) for n in others.get(name, [])), 1.0)
        for name in best.effects
    ]
    sizes = ", ".join(with_unit(evidence, name, best) for name in best.effects)
    titles = " and ".join(causes)
    verdict = "effect" if len(best.effects) == 1 else "several"
    return Verdict(
        verdict, list(best.effects),
        f"{lacks(held, titles)} {gap_numbers(evidence)} With {'it' if verdict == 'effect' else 'them'} "
        f"({sizes}) it misses by {evidence.error_of(best).value:.1f} mm{share_closed(evidence, best)}."
        f"{still_off(evidence, best)}",
        others,
    )  # fmt: skip


def _swapped(shares: dict[Subset, tuple[float, float]], best: Subset, name: str, other: str) -> float:
    return shares[tuple(sorted({*best, other} - {name}))][0]
