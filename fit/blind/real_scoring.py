"""Score measurement faults planted in real takes, by comparison with the diagnosis of the unmodified takes.

Real takes have a gap of their own, with effects that nobody planted and perhaps no library knows. The *named* effect
then depends as much on this gap as on the plant. So two answers on the same frames and the same noise are compared, one
with the plant and one without. In their difference everything else cancels, to first order in the amplitudes. For an
estimate e of the library's effects, untouched e0 and planted e1, and a planted amplitude a:

    change        d = e1 - e0, component by component of the planted effect
    moved most    over all effects, |d| / minimum detectable (untouched) is largest for the planted one's group
    right size    |d - a| <= |a| / 2
    covered       |d - a| <= sqrt(h0^2 + h1^2), h the half widths of the two 90 % intervals; these are too wide for
                  a difference with shared noise, so more than 90 % should be
    newly named   the planted effect is named in the planted takes and not in the untouched ones

Source: differences of paired measurements, G. W. Snedecor & W. G. Cochran, "Statistical Methods" (1989), section 6.2.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from fit.blind.judging import answer_of, bin_of, named_by
from fit.blind.plants import Planted
from fit.blind.rates import Rate, median, rate_of
from fit.blind.real import RealTruth
from formats.arrays import Floats
from formats.diagnosis_records import Diagnosis, EffectFinding

REAL_SCORE_FORMAT = "hangtime-blind-real-score/1"
# Of the planted amplitude. Our choice: from half to one and a half times that size. At twice, no change at
# all would be right; half was not tried.
RIGHT_SIZE = 0.5
COMPONENT_IN_LIBRARY = {("corner_erosion", ""): "corners"}  # components with another name in the library


class RealJudged(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Comparison of one planted case with its untouched takes; None: not applicable, or missing in an answer.

    - `untouched`, `with_plant`, `change`: components of the planted effect's estimate
    - `ratio`: amplitude over the minimum detectable one of the untouched takes
    - `error`: |d - a| / |a|
    - `gap_mm`: base model's error, untouched and planted
    """

    id: str
    reference: str
    planted: str
    amplitude: float
    ratio: float | None
    bin: str
    untouched_verdict: str
    verdict: str
    named: tuple[str, ...]
    newly_named: bool | None
    moved_most: str | None
    is_moved_most: bool | None
    untouched: dict[str, float]
    with_plant: dict[str, float]
    error: float | None
    is_right_size: bool | None
    is_covered: bool | None
    gap_mm: tuple[float, float] | None


class RealScore(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Score of a set of answers on real takes."""

    format: str
    created: str
    sealed: str
    answers: str
    look: int
    moved_most: Rate
    right_size: Rate
    covered: Rate
    newly_named: Rate
    error: float | None
    without_answer: int
    untouched: dict[str, str]
    cases: tuple[RealJudged, ...]


def score_real(truths: tuple[RealTruth, ...], answers: Path) -> RealScore:
    """Compare every planted case with its untouched takes; a case without both diagnoses counts in no rate."""
    said = {truth.id: answer_of(answers, truth.id) for truth in truths}
    judged = tuple(
        judge_real(truth, said[truth.reference], said[truth.id]) for truth in truths if truth.kind == "single"
    )

    def asked(name: str) -> Rate:
        return rate_of(value for one in judged if (value := getattr(one, name)) is not None)

    return RealScore(
        format=REAL_SCORE_FORMAT, created="", sealed="", answers="", look=0, moved_most=asked("is_moved_most"),
        right_size=asked("is_right_size"), covered=asked("is_covered"), newly_named=asked("newly_named"),
        error=median([one.error for one in judged if one.error is not None]),
        without_answer=sum(one.error is None for one in judged),
        untouched={truth.id: _sentence(said[truth.id]) for truth in truths if truth.kind == "null"}, cases=judged,
    )  # fmt: skip


def real_headline(score: RealScore) -> str:
    """Return the most important rates in one line."""
    return (
        f"planted effect's estimate moved most {score.moved_most}; by the right size {score.right_size}; "
        f"newly named {score.newly_named}"
    )


def judge_real(truth: RealTruth, untouched: Diagnosis | None, planted: Diagnosis | None) -> RealJudged:
    """Compare the diagnosis of planted takes with that of the untouched takes."""
    plant = truth.planted[0]
    before, after = _findings(untouched), _findings(planted)
    first, second = before.get(plant.id), after.get(plant.id)
    ratio = plant.amplitude / first.minimum_detectable if first and first.minimum_detectable else None
    named = named_by(planted)
    judged = RealJudged(
        id=truth.id, reference=truth.reference, planted=plant.id, amplitude=plant.amplitude, ratio=ratio,
        bin=bin_of(ratio), untouched_verdict=_verdict(untouched), verdict=_verdict(planted), named=named,
        newly_named=None if plant.id in named_by(untouched) else plant.id in named, moved_most=None, is_moved_most=None,
        untouched={}, with_plant={}, error=None, is_right_size=None, is_covered=None, gap_mm=None,
    )  # fmt: skip
    if untouched is None or planted is None or first is None or second is None or not (first.tested and second.tested):
        return msgspec.structs.replace(judged, newly_named=None if planted is None else judged.newly_named)
    wanted, was, now = _vectors(plant, first, second)
    missed = float(np.linalg.norm(now - was - wanted))
    halves = [half for half in (_half_width(first), _half_width(second)) if half is not None]
    most = _moved_most(before, after)
    return msgspec.structs.replace(
        judged, moved_most=most, is_moved_most=_is_same_group(before, after, most, plant.id),
        untouched=_parts(first), with_plant=_parts(second), error=missed / plant.amplitude,
        is_right_size=missed <= RIGHT_SIZE * plant.amplitude,
        is_covered=missed <= float(np.linalg.norm(halves)) if len(halves) == 2 else None,
        gap_mm=(untouched.gap.base_mm.value, planted.gap.base_mm.value),
    )  # fmt: skip


def _findings(said: Diagnosis | None) -> dict[str, EffectFinding]:
    return {finding.id: finding for finding in said.effects} if said else {}


def _verdict(said: Diagnosis | None) -> str:
    return said.verdict if said else "inconclusive"


def _sentence(said: Diagnosis | None) -> str:
    return ": ".join([_verdict(said), ", ".join(named)]) if (named := named_by(said)) else _verdict(said)


def _parts(finding: EffectFinding) -> dict[str, float]:
    """Return the components of an estimate; a scalar effect has one component without a name."""
    return dict(finding.components) or {"": finding.amplitude}


def _vectors(plant: Planted, first: EffectFinding, second: EffectFinding) -> tuple[Floats, Floats, Floats]:
    """Return the planted amount and both estimates as vectors of common components."""
    wanted = {COMPONENT_IN_LIBRARY.get((plant.id, name), name): value for name, value in plant.components.items()}
    was, now = _parts(first), _parts(second)
    names = sorted({*wanted, *was, *now})
    rows = [[part.get(name, 0.0) for name in names] for part in (wanted, was, now)]
    return np.array(rows[0]), np.array(rows[1]), np.array(rows[2])


def _moved_most(before: dict[str, EffectFinding], after: dict[str, EffectFinding]) -> str | None:
    """Return the effect whose estimate changed most, in units of its minimum detectable amplitude."""
    sizes = {}
    for name, first in before.items():
        second = after.get(name)
        if second is not None and first.tested and second.tested and first.minimum_detectable:
            was, now = _parts(first), _parts(second)
            changes = [now.get(part, 0.0) - was.get(part, 0.0) for part in {*was, *now}]
            sizes[name] = float(np.linalg.norm(changes)) / first.minimum_detectable
    return max(sizes, key=lambda name: sizes[name]) if sizes and max(sizes.values()) > 0 else None


def _is_same_group(
    before: dict[str, EffectFinding], after: dict[str, EffectFinding], most: str | None, planted: str
) -> bool:
    """Return whether two effects are equal, or share a group in either diagnosis."""
    return most is not None and any(said[most].group == said[planted].group for said in (before, after))


def _half_width(finding: EffectFinding) -> float | None:
    interval = finding.amplitude_interval
    return None if interval is None else 0.5 * (interval[1] - interval[0])
