"""Derive the verdict from the evidence by fixed rules, and word it as a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from fit.gap.closure import SIGNIFICANT_GAP
from fit.gap.edge_words import describe_held_edge, edge_says, still_off
from fit.gap.evidence import (
    NEAR,
    NEAR_TWIN,
    RIVAL,
    SMALLEST_CLOSURE,
    Evidence,
    is_at_bound,
)
from fit.gap.hypotheses import Hypothesis
from fit.gap.passing import (
    FAMILY_WISE_LEVEL,
    closed_by,
    effects_identified_by_edge,
    is_near,
    likely_ones,
    needed_together,
    passing_effects,
    what_lacks,
)
from fit.gap.power import power_of
from fit.gap.probabilities import probabilities
from fit.observer.edge import is_edge_explained
from formats import figures
from formats.diagnosis_records import LIKELY, Figure, in_percent, place_of
from formats.plain_text import counted, joined

CLEAR_WIN = 0.8  # share of bootstrap draws in which the winner beats every other effect; our choice: as `SURE`
MOSTLY_MESH = 0.5  # of an unexplained gap; our choice: if mesh and solver make most of it, it is `numerics`
# Probability of a plain sentence, at least; one with `probably` needs LIKELY. Our choice: wrong in one of five at most.
SURE = 0.8


@dataclass(frozen=True)
class Verdict:
    """The verdict, its named effects, its sentence, and the alternatives of each named effect.

    shows_gap: false where the sentence says that no gap shows, so that no effect has a share of one
    """

    verdict: str
    named: list[str]
    sentence: str
    alternatives: dict[str, list[str]] = field(default_factory=dict)
    shows_gap: bool = True


def decide(evidence: Evidence) -> Verdict:
    """Apply the rules in order: gates, existence of a gap, an effect that explains it, and whether this is enough."""
    library = evidence.observer.library
    failed = [g for g in evidence.gates if not g.passed]
    numbers = gap_numbers(evidence)
    identified = evidence.identified_by_edge
    # The held edge follows the hanger even if the cloth below is chaotic.
    passed_over = {"mesh and step", "base fit", *(["predictability"] if identified else [])}
    blocking = [g for g in failed if g.name not in passed_over]
    if blocking:
        return Verdict("inconclusive", [], f"No diagnosis: {blocking[0].sentence} {numbers}")
    noise, mesh = evidence.floor_mm**2, evidence.numerics_mm**2
    has_gap = evidence.exceeds(noise) and evidence.is_predictable
    passing = passing_effects(evidence) if has_gap else effects_identified_by_edge(evidence)
    several = needed_together(evidence, passing) if has_gap else None
    if several is None:
        passing = likely_ones(evidence, passing)
    if not passing and not (has_gap and evidence.exceeds(noise + mesh)):
        if evidence.base.errors.squared_mm > SIGNIFICANT_GAP * (noise + mesh):
            unsure = "The error exceeds noise and mesh, but differs too much between half-seconds to be sure"
            return Verdict("inconclusive", [], f"{unsure}. {numbers} Record longer.{describe_held_edge(evidence)}")
        return no_gap(evidence, has_gap=has_gap)
    unsettled = next((g for g in failed if g.name == "base fit"), None)
    if unsettled is not None and not identified:
        return Verdict("inconclusive", [], f"No diagnosis: {unsettled.sentence} {numbers}")
    coarse = next((g for g in failed if g.name == "mesh and step"), None)
    causes = [evidence.singles[k] for k in passing] + ([several] if several else [])
    closures = [c.value for h in causes if (c := evidence.closure_of(h)) is not None]
    # A finer mesh is a rival like an effect: it decides if no effect closes more of the gap.
    if coarse is not None and not identified and 100 * max(closures, default=0.0) <= (coarse.figure or 0.0):
        return Verdict("numerics", [], f"Refine first: {coarse.sentence} {numbers}")
    if several is not None and (evidence.explains_enough(several) or not identified):
        return _name_several(evidence, several)
    passing = likely_ones(evidence, passing)
    if not passing and evidence.is_coarse and mesh > MOSTLY_MESH * evidence.gap_mm2:
        most = f"mesh and solver may be wrong by {evidence.numerics_mm:.1f} mm, and most of the gap may be that"
        return Verdict("numerics", [], f"Refine first, by a smaller spacing of the mesh: {most}. {numbers}")
    if not passing:
        return Verdict("unknown", [], f"{_unnamed(evidence)} {numbers}{describe_held_edge(evidence)}")
    best = passing[0]
    closed = evidence.closure_of(evidence.singles[best])
    if not evidence.explains_enough(evidence.singles[best]) and best not in identified:
        assert closed is not None
        return Verdict(
            "unknown",
            [],
            f"There is a gap that no effect in the library explains: {library[best].title} comes nearest, and leaves "
            f"{100 - 100 * closed.value:.0f} % of it, more than a true cause would. {numbers}",
        )
    shares = evidence.win_shares()
    rivals = [
        k
        for k in passing[1:]
        if (k in identified or best not in identified)
        and (
            (shares[best] < CLEAR_WIN and shares[k] >= RIVAL and is_near(evidence, best, k, NEAR))
            or (evidence.alike(best, k) and is_near(evidence, best, k, NEAR_TWIN))
        )
    ]
    if rivals:
        likely = probabilities(evidence, None)
        either = " or ".join(f"{library[k].title} (probability {in_percent(likely[k])})" for k in (best, *rivals))
        return Verdict(
            "ambiguous",
            [best, *rivals],
            f"{either[0].upper()}{either[1:]}: these takes cannot tell them apart. {numbers}",
        )
    title, alone = library[best].title, evidence.singles[best]
    on_edge = edge_says(evidence, best, closed, several) if best in identified else still_off(evidence, alone)
    return Verdict(
        "effect",
        [best],
        f"{_lacks(evidence, None, title, (best,))} {numbers} With {title} ({with_unit(evidence, best)}) it "
        f"misses by {evidence.error_of(evidence.singles[best]).value:.1f} mm"
        f"{share_closed(evidence, evidence.singles[best])}."
        f"{on_edge}",
    )


def no_gap(evidence: Evidence, *, has_gap: bool) -> Verdict:
    """Word the verdict that no gap exceeds noise, mesh and solver, or the reason why these takes cannot show one.

    The verdict is `inconclusive` where effects of typical size would not have made a gap (`fit.gap.power`).
    """
    numbers, wrong = gap_numbers(evidence), f"{evidence.numerics_mm:.1f} mm"
    if has_gap and evidence.is_coarse:
        refine = f"mesh and solver may be wrong by {wrong}, and a gap may hide in that"
        return Verdict("numerics", [], f"Refine first, by a smaller spacing of the mesh: {refine}. {numbers}")
    hidden = f" Mesh and solver may be wrong by {wrong}." if has_gap else ""
    power = power_of(evidence)
    if power.reason:
        said = f"No gap shows, but {power.reason}. These could not have been seen: {power.listed}. {numbers}"
        sentence = f"{said}{hidden}{power.advice}{describe_held_edge(evidence)}"
        return Verdict("inconclusive", [], sentence, shows_gap=False)
    where = "" if is_edge_explained(evidence.base.errors.edge) else " in the cloth below its held edge"
    none = f"No gap{where}: the base model explains the motion down to noise and mesh. {numbers}{hidden}"
    if power.unseen:
        none += f" At their usual sizes, these takes could not have shown: {power.listed}."
    return Verdict("none", [], none + describe_held_edge(evidence), shows_gap=False)


def share_closed(evidence: Evidence, hypothesis: Hypothesis) -> str:
    """Return the words on a hypothesis' closure."""
    closed = evidence.closure_of(hypothesis)
    if closed is None:
        return ""
    low, high = closed.interval or (closed.value, closed.value)
    noise = ". The remaining error is within the noise" if evidence.is_within_noise(hypothesis) else ""
    if evidence.is_silhouette and not noise:
        noise = f". The rest, {100 - 100 * closed.value:.0f} %, no effect explains: a camera's faults are part of it"
    if closed.value <= 0:
        return f", which closes nothing of the gap{noise}"
    share = f"{100 * closed.value:.0f} % of the gap is closed [{100 * low:z.0f} to {100 * high:.0f} %]"
    return f": {share}{beyond_all(closed)}{noise}"


def beyond_all(closed: Figure) -> str:
    """Return what a closure of more than 100 % means, or nothing for one that reads as at most 100 %."""
    is_beyond = round(100 * closed.value) > 100
    return " (above 100 %: less is left than the noise was estimated to be)" if is_beyond else ""


def _unnamed(evidence: Evidence) -> str:
    """Word the verdict without a named effect, and mention the nearest effect with too weak evidence."""
    near = [
        k for k, h in evidence.singles.items()
        if evidence.explains_enough(h) and k not in evidence.contradicted and not is_at_bound(evidence.observer, h)
    ]  # fmt: skip
    if not near:
        return "There is a gap that no effect in the library explains."
    best = max(near, key=lambda k: closed_by(evidence, k))
    title, closed = evidence.observer.library[best].title, evidence.closure_of(evidence.singles[best])
    assert closed is not None
    low, high = closed.interval or (closed.value, closed.value)
    share, _ = figures.beside(100 * closed.value, 100 * SMALLEST_CLOSURE)
    lacking = joined(what_lacks(evidence, best)) or "fewer than half of the draws name an effect that passes every test"
    return (
        f"There is a gap, and no effect in the library explains it for sure. {title[0].upper()}{title[1:]} would close "
        f"{share} % of it [{100 * low:z.0f} to {100 * high:z.0f} %]{beyond_all(closed)}, but the "
        f"evidence is too weak to name it: {lacking}.{_likely_all_the_same(evidence, best)}"
    )


def _likely_all_the_same(evidence: Evidence, effect: str) -> str:
    """Return sentences that reconcile the probability of an unnamed effect with its p-value, if it seems likely."""
    chance = probabilities(evidence, None)[effect]
    if chance < LIKELY or evidence.p_value(effect) < FAMILY_WISE_LEVEL:
        return ""
    if evidence.is_held_out:
        family = f"{counted(len(evidence.singles), 'refitted effect')} and for the few independent half-seconds"
        ranks = f"Its probability of {in_percent(chance)} ranks the library's effects, and tests none."
        return f" The p-value allows for {family}. {ranks}"
    family = counted(len(evidence.screened), "effect")
    return (
        f" The p-value allows for the choice among {family} on the takes they are judged on. Its probability of "
        f"{in_percent(chance)} does not: it ranks the library's effects. A held-out take needs no such allowance."
    )


def _name_several(evidence: Evidence, several: Hypothesis) -> Verdict:
    library = evidence.observer.library
    closed = evidence.closure_of(several)
    assert closed is not None
    others = evidence.alternatives(several)
    causes = [
        library[k].title + "".join(f" (or {library[n].title}: these takes cannot tell)" for n in others.get(k, []))
        for k in several.effects
    ]
    titles, sizes = " and ".join(causes), ", ".join(with_unit(evidence, k, several) for k in several.effects)
    if not evidence.explains_enough(several):
        return Verdict(
            "unknown",
            [],
            f"There is a gap that no effect in the library explains: {titles} come nearest, and together leave "
            f"{100 - 100 * closed.value:.0f} % of it, more than true causes would. {gap_numbers(evidence)}",
        )
    return Verdict(
        "several",
        list(several.effects),
        f"{_lacks(evidence, several, titles, *((k, *others.get(k, [])) for k in several.effects))} "
        f"{gap_numbers(evidence)} With them ({sizes}) it misses by {evidence.error_of(several).value:.1f} mm"
        f"{share_closed(evidence, several)}.{still_off(evidence, several)}",
        {name: list(alike) for name, alike in others.items()},
    )


def _lacks(evidence: Evidence, several: Hypothesis | None, titles: str, *causes: tuple[str, ...]) -> str:
    """Return the sentence that names causes, worded by the least probable cause."""
    likely = probabilities(evidence, several)
    return lacks([sum(likely[k] for k in cause) for cause in causes], titles)


def lacks(likely: Sequence[float], titles: str) -> str:
    """Return the sentence that names causes; likely: the probability of each, of which the least words it."""
    least = min(likely)
    begun = (
        "The model lacks" if least >= SURE else "The model probably lacks" if least >= LIKELY else "The model may lack"
    )
    words = in_percent(least)
    whose, bound = "", ""
    if len(likely) > 1:
        is_number, is_of_all = words[0].isdigit(), words == in_percent(max(likely))
        whose = "each " if is_number or is_of_all else "the least probable "
        bound = "at least " if is_number else ""
    return f"{begun} {titles}, {whose}with a probability of {bound}{words}."


def gap_numbers(evidence: Evidence) -> str:
    """Return the sentence on the base model's error and the noise."""
    on = "on motion not used for fitting"
    if not evidence.is_held_out:
        on = "on the motion it was fitted to (no held-out take)"
    return (
        f"The base model misses by {evidence.error_of(evidence.base).value:.1f} mm {on}; the sensor's noise alone is "
        f"{evidence.floor_mm:.1f} mm."
    )


def with_unit(evidence: Evidence, effect: str, beside: Hypothesis | None = None) -> str:
    """Return an effect's size, interval and location in words."""
    kind = evidence.observer.library[effect]
    middle, ends = evidence.amplitude(effect, beside=beside)
    fitted = (beside or evidence.singles[effect]).fitted.amplitudes[evidence.observer.columns[effect]]
    place = place_of(kind.regions(fitted))
    return f"{figures.with_unit(figures.short(middle), kind.unit)} [{figures.span_of(ends)}]{place and f' {place}'}"
