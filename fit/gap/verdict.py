"""From figures to a verdict, by fixed rules, and to a sentence that somebody at a bench understands."""

from __future__ import annotations

from dataclasses import dataclass

from fit.effects.base import Effect
from formats.results import EffectFinding, Gap, Gate

LEVEL = 0.05  # family-wise
SMALLEST_CLOSURE = 0.25  # an effect that removes less of the gap is not its cause
CLEAR_WIN = 0.8  # share of bootstrap draws in which the winner beats every other effect
SIGNIFICANT_GAP = 1.2  # base error over floor, squared: below, there is nothing to explain
GATE_VERDICTS = {"mesh and step": "numerics"}  # every other failed gate means `inconclusive`


@dataclass(frozen=True)
class Verdict:
    """The verdict, the effects it names, and the sentence."""

    verdict: str
    named: list[str]
    sentence: str


def decide(
    gap: Gap, findings: list[EffectFinding], win_share: dict[str, float], gates: list[Gate], effects: tuple[Effect, ...]
) -> Verdict:
    """Apply the rules in their order: gates, is there a gap, does one effect explain it."""
    failed = [g for g in gates if not g.passed]
    on = "on motion not used for fitting" if gap.is_held_out else "on the motion it was fitted to (no held-out take)"
    numbers = (
        f"The base model misses by {gap.base_mm.value:.1f} mm {on}; "
        f"the sensor's noise alone is {gap.floor_mm.value:.1f} mm."
    )
    blocking = [g for g in failed if GATE_VERDICTS.get(g.name) != "numerics"]
    if blocking:
        return Verdict("inconclusive", [], f"No diagnosis: {blocking[0].sentence} {numbers}")
    significant = gap.base_mm.value**2 > SIGNIFICANT_GAP * gap.floor_mm.value**2 and (
        gap.base_mm.interval is None or gap.base_mm.interval[0] > gap.floor_mm.value
    )
    if not significant:
        return Verdict("none", [], f"No gap: the base model explains the motion down to the noise. {numbers}")
    titles = {e.name: e.title for e in effects}
    passing = [
        f
        for f in findings
        if f.p_value is not None
        and f.p_value < LEVEL
        and f.closure is not None
        and f.closure.value >= SMALLEST_CLOSURE
        and f.closure.interval is not None
        and f.closure.interval[0] > 0
        and f.amplitude_interval is not None
        and f.amplitude_interval[0] * f.amplitude_interval[1] > 0
    ]
    passing.sort(key=lambda f: -(f.closure.value if f.closure else 0.0))
    if failed:
        return Verdict("numerics", [], f"Refine first: {failed[0].sentence} {numbers}")
    if not passing:
        return Verdict("unknown", [], f"There is a gap that no effect in the library explains. {numbers}")
    best = passing[0]
    rivals = [f for f in passing[1:] if win_share.get(best.id, 0.0) < CLEAR_WIN or f.group == best.group]
    if rivals:
        names = [best.id, *(f.id for f in rivals)]
        either = " or ".join(titles[n] for n in names)
        return Verdict("ambiguous", names, f"{either.capitalize()}: this data cannot tell them apart. {numbers}")
    assert best.closure is not None
    low, high = best.closure.interval or (best.closure.value, best.closure.value)
    after = gap.with_effect_mm.value if gap.with_effect_mm else float("nan")
    return Verdict(
        "effect",
        [best.id],
        f"The model lacks {titles[best.id]}. {numbers} "
        f"With {titles[best.id]} ({_with_unit(best)}) it misses by {after:.1f} mm: "
        f"{100 * best.closure.value:.0f} % of the gap is closed [{100 * low:.0f} to {100 * high:.0f} %].",
    )


def _with_unit(finding: EffectFinding) -> str:
    unit = "" if finding.unit == "1" else f" {finding.unit}"
    if finding.amplitude_interval is None:
        return f"{finding.amplitude:.3g}{unit}"
    low, high = finding.amplitude_interval
    return f"{finding.amplitude:.3g}{unit} [{low:.3g} to {high:.3g}]"
