"""Judge one answer by its truth: all the boolean outcomes that enter the rates.

A verdict names the right group in two cases. The true effect is among the named effects, or shares a group with the
first of them by the diagnosis' own grouping. An `ambiguous` verdict is one group; a verdict of several effects with
their alternatives is one group too. Both effects of a pair are named when they are two of several, or alternatives of
two.

An answer is confident and wrong if one of its causes is no planted effect and has a probability of 0.8 or more. Without
probabilities, a single named effect counts as confident.

Closure is compared with the true effect's closure, refitted by the diagnosis itself. This oracle knows the effect, but
not its size.

Simpler methods are judged on the same answers. Each names the effect with the largest value of one figure:

- correlation with the residual, with or without projecting out the motions that the base model can imitate
- share of the fitted motion that a refit explains
- share of the gap that an effect closes

A classifier (`fit.blind.classifier`) is judged too.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import msgspec

from fit.blind.cases import Kind, Look, Truth
from fit.blind.classifier import features_of
from fit.blind.plants import PLANTS
from fit.blind.rates import brier
from fit.blind.running import DIAGNOSIS
from formats.diagnosis_records import Diagnosis, EffectFinding
from formats.errors import ResultError
from formats.results import load_diagnosis

BINS = ("below 0.5", "0.5 to 1", "1 to 2", "2 to 4", "above 4", "not known")  # times the minimum detectable amplitude
BIN_EDGES = (0.5, 1.0, 2.0, 4.0)  # times the minimum detectable amplitude; our choice: doublings
CONFIDENT = 0.8  # probability from which a name counts as confident; our choice: as the verdict's `SURE`
PLANTED_UNITS = {plant.id: plant.unit for plant in PLANTS}  # of the effects' amplitudes
NAMING = frozenset({"effect", "ambiguous", "several"})


class Judged(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Outcomes of one case. None: not applicable, or missing in the answer.

    ratio: true amplitude over the minimum detectable one, for a pair the smaller ratio; simulations: of each take
    """

    id: str
    kind: Kind
    planted: tuple[str, ...]
    amplitude: float | None
    ratio: float | None
    bin: str
    verdict: str
    named: tuple[str, ...]
    is_tested: bool
    false_alarm: bool | None = None
    right_first: bool | None = None
    right_alone: bool | None = None
    right_in_three: bool | None = None
    both_named: bool | None = None
    said_unknown: bool | None = None
    confident_and_wrong: bool = False
    closure: float | None = None
    closure_of_oracle: float | None = None
    amplitude_error: float | None = None
    amplitude_covered: bool | None = None
    place_found: bool | None = None
    brier: float | None = None
    brier_of_groups: float | None = None
    probability: float | None = None
    simulations: float | None = None
    seconds: float | None = None
    right_by_correlation: bool | None = None
    right_by_screening: bool | None = None
    right_by_training: bool | None = None
    right_by_closure: bool | None = None
    alike: tuple[str, ...] = ()
    features: dict[str, float] = {}
    conditions: dict[str, str] = {}


def answer_of(answers: Path, case: str) -> Diagnosis | None:
    """Return the diagnosis of a case; None if it is missing or unreadable, or has an effect in another unit."""
    try:
        said = load_diagnosis(answers / case / DIAGNOSIS)
    except ResultError:
        return None
    return said if all(f.unit == PLANTED_UNITS.get(f.id, f.unit) for f in said.effects) else None


def named_by(said: Diagnosis | None) -> tuple[str, ...]:
    """Return the effects that an answer names, or none if its verdict names none."""
    return tuple(said.named) if said and said.verdict in NAMING else ()


def mistakes(said: Diagnosis | None, planted: tuple[str, ...]) -> list[tuple[bool, bool]]:
    """Return for every named cause whether it is wrong, and whether the answer is confident of it."""
    named = named_by(said)
    if said is None or not named:
        return []
    findings = {f.id: f for f in said.effects}
    return [
        (_is_wrong(findings, name, cause, planted), _is_certain(said.verdict, _probability(findings, (name,))))
        for name, cause in zip(named, _meant(said), strict=False)
    ]


def judge(truth: Truth, answers: Path) -> Judged:
    """Judge one case; a missing or unreadable diagnosis counts as `inconclusive`."""
    said = answer_of(answers, truth.id)
    findings = {f.id: f for f in said.effects} if said else {}
    first = truth.planted[0] if truth.planted else None
    true = findings.get(first.id) if first and first.in_library else None
    named = named_by(said)
    ratios = [_ratio(p.amplitude, findings.get(p.id)) for p in truth.planted]
    known = [ratio for ratio in ratios if ratio is not None]
    ratio = min(known) if known and len(known) == len(ratios) else None
    judged = Judged(
        id=truth.id, kind=truth.kind, planted=tuple(p.id for p in truth.planted),
        amplitude=first.amplitude if first else None, ratio=ratio, bin=bin_of(ratio),
        verdict=said.verdict if said else "inconclusive", named=named,
        is_tested=all(findings[p.id].tested for p in truth.planted if p.id in findings),
        probability=_probability(findings, named),
        simulations=said.cost.simulations / max(len(said.take_ids) + len(said.held_out_ids), 1) if said else None,
        seconds=said.cost.seconds if said else None,
        conditions=conditions_of(truth.look), features=features_of(said) if said else {},
        alike=tuple(f.id for f in findings.values() if true and true.tested and f.tested and f.group == true.group),
    )  # fmt: skip
    found = mistakes(said, judged.planted)
    wrong = bool(found) and found[0][0]
    judged = msgspec.structs.replace(
        judged, confident_and_wrong=any(is_wrong and is_certain for is_wrong, is_certain in found),
        brier=_brier(findings, judged.planted, truth.kind),
        brier_of_groups=_brier(findings, judged.planted, truth.kind, of_groups=True),
    )  # fmt: skip
    if truth.kind == "null":
        return msgspec.structs.replace(judged, false_alarm=bool(named))
    if truth.kind == "unknown":
        return msgspec.structs.replace(
            judged, said_unknown=judged.verdict == "unknown", place_found=_place(said, first.place if first else ())
        )
    if truth.kind == "pair":
        both = said is not None and bool(named) and _names_both(_meant(said), judged.planted)
        return msgspec.structs.replace(judged, right_first=bool(named) and not wrong, both_named=both)
    return _judge_single(judged, truth, said, true, wrong)


def _judge_single(
    judged: Judged, truth: Truth, said: Diagnosis | None, true: EffectFinding | None, wrong: bool
) -> Judged:
    findings, planted = ({f.id: f for f in said.effects} if said else {}), truth.planted[0]
    groups = list(dict.fromkeys(f.group for f in said.effects if f.tested)) if said else []
    is_right = bool(judged.named) and not wrong
    by_name = findings.get(judged.named[0]) if judged.named else None
    error = covered = None
    if is_right and true is not None and true.tested and planted.id in judged.named:
        error = abs(abs(true.amplitude) - planted.amplitude) / planted.amplitude
        if true.amplitude_interval:
            low, high = true.amplitude_interval
            low, high = (low, high) if true.amplitude >= 0 else (-high, -low)
            covered = low <= planted.amplitude <= high
    return msgspec.structs.replace(
        judged, right_first=is_right, right_alone=judged.named == (planted.id,),
        right_in_three=is_right or (bool(judged.named) and true is not None and true.group in groups[:3]),
        closure=by_name.closure.value if by_name and by_name.closure else None,
        closure_of_oracle=true.closure.value if true and true.closure else None,
        amplitude_error=error, amplitude_covered=covered, place_found=_place(said, planted.place),
        right_by_correlation=_is_largest(findings, planted.id, {f.id: f.correlation for f in findings.values()}),
        right_by_screening=_is_largest(findings, planted.id, {f.id: f.explained for f in findings.values()}),
        right_by_training=_is_largest(findings, planted.id, {f.id: f.fitted_share for f in findings.values()}),
        right_by_closure=_is_largest(
            findings, planted.id, {f.id: f.closure.value if f.closure else None for f in findings.values()}
        ),
    )  # fmt: skip


def _is_largest(findings: dict[str, EffectFinding], planted: str, figures: dict[str, float | None]) -> bool:
    """Return whether the tested effect with the largest figure is the planted one or in its group."""
    known = {name: value for name, value in figures.items() if value is not None and findings[name].tested}
    return bool(known) and _same_group(findings, (max(known, key=known.__getitem__),), (planted,))


def conditions_of(look: Look) -> dict[str, str]:
    """Return a case's noise, points, frame rate and missing points, as classes."""
    noise, away = 1e3 * look.noise, 100 * look.away
    return {
        "noise": "below 1 mm" if noise < 1 else "1 to 2 mm" if noise < 2 else "above 2 mm",
        "points": f"{look.grid} x {look.grid}" if look.grid else "corners and centre",
        "frames": f"{look.rate:.0f} a second",
        "missing": "below 3 %" if away < 3 else "3 to 6 %" if away < 6 else "above 6 %",
    }


def bin_of(ratio: float | None) -> str:
    """Return the bin of an amplitude over the minimum detectable one."""
    return BINS[-1] if ratio is None else BINS[sum(ratio >= edge for edge in BIN_EDGES)]


def _ratio(amplitude: float, finding: EffectFinding | None) -> float | None:
    least = finding.minimum_detectable if finding else None
    return amplitude / least if least else None


def _same_group(findings: dict[str, EffectFinding], named: tuple[str, ...], planted: tuple[str, ...]) -> bool:
    first = findings.get(named[0])
    return first is not None and any(
        p in findings and findings[p].tested and findings[p].group == first.group for p in planted
    )


def _is_wrong(findings: dict[str, EffectFinding], name: str, cause: set[str], planted: tuple[str, ...]) -> bool:
    """Return whether a named cause, with all its alternatives, is none of the planted effects."""
    return not (cause & set(planted) or _same_group(findings, (name,), planted))


def _is_certain(verdict: str, probability: float | None) -> bool:
    return verdict == "effect" if probability is None else probability >= CONFIDENT


def _probability(findings: dict[str, EffectFinding], named: tuple[str, ...]) -> float | None:
    """Return the probability of the first named cause; None if the diagnosis gives none."""
    found = findings.get(named[0]) if named else None
    return found.probability if found else None


def _meant(said: Diagnosis) -> list[set[str]]:
    """Return the causes that an answer names, each with its alternative effects."""
    if said.verdict == "ambiguous":
        return [set(said.named)]
    return [{name, *said.alternatives.get(name, [])} for name in said.named]


def _names_both(meant: list[set[str]], planted: tuple[str, ...]) -> bool:
    """Return whether two planted effects are among different named causes."""
    return any(planted[0] in one and planted[1] in other for one, other in itertools.permutations(meant, 2))


def _brier(
    findings: dict[str, EffectFinding], planted: tuple[str, ...], kind: Kind, *, of_groups: bool = False
) -> float | None:
    """Return the Brier score over the library, or over the answer's groups of collinear effects."""
    given: dict[str, float] = {}
    for f in findings.values():
        if f.probability is not None:
            name = f.group if of_groups else f.id
            given[name] = given.get(name, 0.0) + f.probability
    if not given or kind == "pair":
        return None
    truth = planted[0] if kind == "single" else ""
    if of_groups and truth in findings:
        truth = findings[truth].group
    return brier(given, truth)


def _place(said: Diagnosis | None, place: tuple[str, ...]) -> bool | None:
    """Return whether the answer locates an effect, by its first effect's region or the largest residual."""
    if not place:
        return None
    if said is None:
        return False
    named = next((f.regions for f in said.effects if f.id in said.named[:1]), [])
    return not set(place).isdisjoint(named or [b.name for b in said.where.space[:1]])
