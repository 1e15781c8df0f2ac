"""From figures to a verdict, by fixed rules, and to a sentence that somebody at a bench understands."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.effects.base import Effect
from fit.gap.closure import DIRECTIONS, SIGNIFICANT_GAP, closure, error_interval, exceeds, solver_draws
from fit.gap.fitting import NORMAL_95, amplitude_of
from fit.gap.hypotheses import Hypothesis
from fit.gap.observer import Observer
from fit.gap.screening import GROUP_COSINE, Screened
from formats.results import Figure, Gate

Floats = NDArray[np.float64]

LEVEL = 0.05  # family-wise
SMALLEST_CLOSURE = 0.25  # an effect that removes less of the gap is not its cause
MOST_LEFT = 0.6  # of the gap that a cause may leave unexplained, beyond noise and mesh
CLEAR_WIN = 0.8  # share of bootstrap draws in which the winner beats every other effect
NEAR, NEAR_TWIN = 0.8, 0.9  # of the winner's closure from which an effect, or one of the same shape, is a rival
AT_BOUND = 0.01  # of an effect's range: an amplitude nearer to its end was stopped by it
RIVAL = 0.1  # share of bootstrap draws that makes an effect a rival
MESH_SHARE = 0.5  # of the mesh's squared error that an effect must remove at least
# A further effect closes a tenth of the gap and a third of what those before leave beyond the noise; or it closes most
# of that, which the wrong law of an effect that is there rarely does.
SECOND_GAIN, SHARE_OF_LEFT = 0.1, 1 / 3
SMALLEST_SECOND_GAIN, MOST_OF_LEFT = 0.03, 0.6
LIKELY = 0.5  # probability that something that is named must have


def is_at_bound(observer: Observer, hypothesis: Hypothesis) -> bool:
    """Whether the effect that a hypothesis adds last was stopped by the end of its physical range."""
    last = hypothesis.effects[-1]
    effect, amplitude = observer.effects[last], hypothesis.fitted.amplitudes[observer.columns[last]]
    reach = AT_BOUND * (effect.high - effect.low)
    below = amplitude < effect.low + reach if effect.low < 0 else np.zeros(len(amplitude), bool)
    return bool((below | (amplitude > effect.high - reach)).any())


def may_be_added(observer: Observer, hypothesis: Hypothesis, p_value: float) -> bool:
    """Whether the effect that a hypothesis adds last is significant, surely not nothing, and in its physical range."""
    _, (low, high) = amplitude_of(hypothesis.fitted, observer, hypothesis.effects[-1])
    is_sure = p_value < LEVEL and low * high > 0 and not is_at_bound(observer, hypothesis)
    return is_sure and not any(is_brought(observer, hypothesis, k) for k in hypothesis.effects)


def is_brought(observer: Observer, hypothesis: Hypothesis, effect: int) -> bool:
    """Whether one effect of a hypothesis may be no more than what a sound law of another one brings along."""
    brought = 0.0
    for other in hypothesis.effects:
        share = dict(observer.effects[other].brings).get(observer.effects[effect].name, 0.0)
        brought += share * amplitude_of(hypothesis.fitted, observer, other)[0] if share else 0.0
    _, (low, _) = amplitude_of(hypothesis.fitted, observer, effect)
    return brought > 0.0 and low <= brought


def is_worth_adding(gap: float, left: float, gain: float) -> bool:
    """Whether a further effect that closes `gain` of what is left of a gap is needed; mean squared errors [mm^2]."""
    return bool(are_worth_adding(np.array(gap), np.array(left), np.array(gain)))


def are_worth_adding(gap: Floats, left: Floats, gain: Floats) -> NDArray[np.bool_]:
    """Return `is_worth_adding` of many draws, each (replicas,)."""
    closes_much = (gain >= SECOND_GAIN * gap) & (gain >= SHARE_OF_LEFT * left)
    return np.asarray(closes_much | ((gain >= SMALLEST_SECOND_GAIN * gap) & (gain >= MOST_OF_LEFT * left)))


@dataclass(frozen=True)
class Evidence:
    """What a verdict is decided on: hypotheses with their held-out errors, noise floor [mm], mesh error [mm], gates."""

    observer: Observer
    screened: Screened
    base: Hypothesis
    singles: dict[int, Hypothesis]
    joint: list[tuple[Hypothesis, float]]
    floor_mm: float
    numerics_mm: float
    picks: NDArray[np.int64]
    gates: list[Gate]
    is_held_out: bool

    def closure_of(self, hypothesis: Hypothesis) -> Figure | None:
        """Share of the gap that a hypothesis closes; None where there is hardly a gap."""
        found = closure(self.base.errors, hypothesis.errors, self.floor_mm, self.picks)
        return Figure(value=found[0], interval=found[1]) if found else None

    def error_of(self, hypothesis: Hypothesis) -> Figure:
        """Root mean square held-out error of a hypothesis [mm]."""
        return Figure(
            value=float(np.sqrt(hypothesis.errors.squared_mm)), interval=error_interval(hypothesis.errors, self.picks)
        )

    def p_value(self, effect: int) -> float:
        """Family-wise p-value of an effect of the library."""
        return float(self.screened.family_p_value[self.screened.effects.index(effect)])

    def amplitude(self, effect: int, *, any_law: bool = True) -> tuple[float, tuple[float, float]]:
        """Size of a refitted effect and its 90 % interval: noise, mesh and solver, and the law of the effect itself.

        any_law: whether the interval is to hold for every sound law of the effect, or for the library's alone.
        """
        size, (low, high) = amplitude_of(self.singles[effect].fitted, self.observer, effect)
        place = self.screened.effects.index(effect)
        wrong = NORMAL_95 * self.numerics_mm * float(self.per_millimetre[place]) / np.sqrt(DIRECTIONS)
        law = NORMAL_95 * self.observer.effects[effect].law_spread * size if any_law else 0.0
        half = float(np.linalg.norm([(high - low) / 2, wrong, law]))
        return size, (size - half, size + half)

    @functools.cached_property
    def per_millimetre(self) -> Floats:
        """Size at which each screened effect, the base model refitted, moves the points by 1 mm rms, (screened,)."""
        moved = [np.mean([self.observer.in_mm(row) ** 2 for row in rows]) for rows in self.screened.projected]
        return np.asarray(self.screened.typical / np.sqrt(np.maximum(moved, 1e-12)))

    def drawn(self, *several: Hypothesis) -> tuple[Floats, dict[int, Floats], list[Floats]]:
        """Mean squared error [mm^2] in every draw of the base model, of each refitted effect, and of several together.

        Drawn are blocks of the held-out takes and what mesh and solver may be wrong by.
        """
        every = [h.errors for h in (self.base, *self.singles.values(), *several)]
        moved = solver_draws(every, self.numerics_mm, len(self.picks))
        base, *rest = (e.draw(self.picks) + moved[:, n] for n, e in enumerate(every))
        return base, dict(zip(self.singles, rest, strict=False)), rest[len(self.singles) :]

    @functools.cached_property
    def draws(self) -> tuple[Floats, dict[int, Floats]]:
        """Mean squared error [mm^2] of the base model and of each refitted effect in every draw."""
        return self.drawn()[:2]

    def alike(self, one: int, other: int) -> bool:
        """Whether two effects explain the same part of the residual, so that a mesh's small error can swap them."""
        places = [self.screened.effects.index(k) for k in (one, other)]
        return bool(abs(self.screened.cosines[places[0], places[1]]) > GROUP_COSINE)

    @functools.cached_property
    def worth_naming(self) -> dict[int, NDArray[np.bool_]]:
        """In which draws each refitted effect leaves the least error and is worth naming, each (replicas,)."""
        return self.are_worth_naming(*self.draws)

    def are_worth_naming(self, base: Floats, drawn: dict[int, Floats]) -> dict[int, NDArray[np.bool_]]:
        """In which draws each refitted effect leaves the least error and is worth naming, each (replicas,).

        Worth naming: the base error of the draw is clearly above the noise, and the effect closes a quarter of it.
        base, (replicas,), drawn, each (replicas,): mean squared errors [mm^2]
        """
        least, gap = np.min(np.stack([base, *drawn.values()]), axis=0), base - self.floor_mm**2
        has_gap = base > SIGNIFICANT_GAP * self.floor_mm**2
        return {k: (d <= least) & has_gap & (base - d >= SMALLEST_CLOSURE * gap) for k, d in drawn.items()}

    def win_shares(self) -> dict[int, float]:
        """Share of draws in which each refitted effect leaves the smallest error."""
        if not self.singles:
            return {}
        winners = np.argmin(np.stack(list(self.draws[1].values())), axis=0)
        return {k: float(np.mean(winners == n)) for n, k in enumerate(self.singles)}

    def exceeds(self, known: float) -> bool:
        """Whether the base model's squared error is clearly above a known one [mm^2]."""
        return exceeds(self.base.errors, self.picks, known)

    def explains_enough(self, hypothesis: Hypothesis) -> bool:
        """Whether what a hypothesis leaves, beyond noise and mesh, is small against the gap."""
        gap = self.base.errors.squared_mm - self.floor_mm**2
        left = hypothesis.errors.squared_mm - self.floor_mm**2 - self.numerics_mm**2
        return left <= MOST_LEFT * gap


@dataclass(frozen=True)
class Verdict:
    """The verdict, the effects it names, and the sentence."""

    verdict: str
    named: list[str]
    sentence: str


def decide(evidence: Evidence, effects: tuple[Effect, ...]) -> Verdict:
    """Apply the rules in their order: gates, is there a gap, does an effect explain it, does it explain enough."""
    failed = [g for g in evidence.gates if not g.passed]
    numbers = _numbers(evidence)
    blocking = [g for g in failed if g.name not in {"mesh and step", "base fit"}]
    if blocking:
        return Verdict("inconclusive", [], f"No diagnosis: {blocking[0].sentence} {numbers}")
    noise, mesh = evidence.floor_mm**2, evidence.numerics_mm**2
    passing = passing_effects(evidence) if evidence.exceeds(noise) else []
    several = _several(evidence) if passing else None
    if several is not None and not set(several.effects) & set(passing):
        several = None
    if several is None:
        passing = _likely(evidence, passing)
    if not evidence.exceeds(noise) or (not passing and not evidence.exceeds(noise + mesh)):
        return Verdict("none", [], f"No gap: the base model explains the motion down to noise and mesh. {numbers}")
    if any(g.name == "base fit" for g in failed):
        return Verdict("inconclusive", [], f"No diagnosis: {failed[0].sentence} {numbers}")
    coarse = next((g for g in failed if g.name == "mesh and step"), None)
    closures = [c.value for k in passing if (c := evidence.closure_of(evidence.singles[k])) is not None]
    # A finer mesh is a rival like any other: it counts where no effect closes more of the gap than it does.
    if coarse is not None and 100 * max(closures, default=0.0) <= (coarse.figure or 0.0):
        return Verdict("numerics", [], f"Refine first: {coarse.sentence} {numbers}")
    if not passing:
        return Verdict("unknown", [], f"There is a gap that no effect in the library explains. {numbers}")
    if several is not None:
        return _name_several(evidence, several, effects)
    best = passing[0]
    closed = evidence.closure_of(evidence.singles[best])
    assert closed is not None
    if not evidence.explains_enough(evidence.singles[best]):
        return Verdict(
            "unknown",
            [],
            f"There is a gap that no effect in the library explains: {effects[best].title} comes nearest and closes "
            f"only {100 * closed.value:.0f} % of it. {numbers}",
        )
    shares = evidence.win_shares()
    rivals = [
        k
        for k in passing[1:]
        if (shares[best] < CLEAR_WIN and shares[k] >= RIVAL and _near(evidence, best, k, NEAR))
        or (evidence.alike(best, k) and _near(evidence, best, k, NEAR_TWIN))
    ]
    if rivals:
        names = [effects[k].name for k in (best, *rivals)]
        either = " or ".join(effects[k].title for k in (best, *rivals))
        return Verdict(
            "ambiguous", names, f"{either[0].upper()}{either[1:]}: this data cannot tell them apart. {numbers}"
        )
    low, high = closed.interval or (closed.value, closed.value)
    title = effects[best].title
    return Verdict(
        "effect",
        [effects[best].name],
        f"The model lacks {title}. {numbers} With {title} ({_with_unit(evidence, best, effects)}) it misses by "
        f"{evidence.error_of(evidence.singles[best]).value:.1f} mm: {100 * closed.value:.0f} % of the gap is closed "
        f"[{100 * low:.0f} to {100 * high:.0f} %].",
    )


def passing_effects(evidence: Evidence) -> list[int]:
    """Return the effects that pass every test on their own, the one that closes most first."""
    passing = []
    for k, hypothesis in evidence.singles.items():
        closed = evidence.closure_of(hypothesis)
        if closed is None or closed.interval is None or is_at_bound(evidence.observer, hypothesis):
            continue
        _, (low, high) = evidence.amplitude(k, any_law=False)
        # The score test is blind to effects that act in few half-seconds; held-out motion is not.
        gain = evidence.base.errors.squared_mm - hypothesis.errors.squared_mm
        is_certain = evidence.p_value(k) < LEVEL or closed.interval[0] >= SMALLEST_CLOSURE
        is_resolved = gain > MESH_SHARE * evidence.numerics_mm**2
        if (
            is_certain
            and is_resolved
            and closed.value >= SMALLEST_CLOSURE
            and closed.interval[0] > 0
            and low * high > 0
        ):
            passing.append((closed.value, k))
    return [k for _, k in sorted(passing, reverse=True)]


def _likely(evidence: Evidence, passing: list[int]) -> list[int]:
    """Return the passing effects, or none where it is likelier that none of them is worth naming."""
    return passing if sum(float(evidence.worth_naming[k].mean()) for k in passing) >= LIKELY else []


def _near(evidence: Evidence, best: int, other: int, share: float) -> bool:
    """Whether another effect closes at least a share of what the best one closes."""
    first, second = evidence.closure_of(evidence.singles[best]), evidence.closure_of(evidence.singles[other])
    return first is not None and second is not None and second.value > share * first.value


def _several(evidence: Evidence) -> Hypothesis | None:
    """Return the largest joint hypothesis in which every added effect was needed."""
    accepted: Hypothesis | None = None
    before = min(evidence.singles.values(), key=lambda h: h.errors.squared_mm)
    gap = evidence.base.errors.squared_mm - evidence.floor_mm**2
    for hypothesis, p_value in evidence.joint:
        gain = (before.errors.draw(evidence.picks) - hypothesis.errors.draw(evidence.picks)) / gap
        # What acts for a moment (a slip) closes little in most draws of half-seconds: the motion fitted to decides.
        is_certain = np.quantile(gain, 0.05) > 0 or (hypothesis.fitted.cost < (1 - SECOND_GAIN) * before.fitted.cost)
        left = before.errors.squared_mm - evidence.floor_mm**2
        is_enough = is_worth_adding(gap, left, before.errors.squared_mm - hypothesis.errors.squared_mm)
        if not may_be_added(evidence.observer, hypothesis, p_value) or not is_enough or not is_certain:
            break
        accepted = before = hypothesis
    return accepted


def _name_several(evidence: Evidence, several: Hypothesis, effects: tuple[Effect, ...]) -> Verdict:
    closed = evidence.closure_of(several)
    assert closed is not None
    titles = " and ".join(effects[k].title for k in several.effects)
    if not evidence.explains_enough(several):
        return Verdict(
            "unknown",
            [],
            f"There is a gap that no effect in the library explains: {titles} together close only "
            f"{100 * closed.value:.0f} % of it. {_numbers(evidence)}",
        )
    return Verdict(
        "several",
        [effects[k].name for k in several.effects],
        f"The model lacks {titles}. {_numbers(evidence)} With them it misses by "
        f"{evidence.error_of(several).value:.1f} mm: {100 * closed.value:.0f} % of the gap is closed.",
    )


def _numbers(evidence: Evidence) -> str:
    on = "on motion not used for fitting"
    if not evidence.is_held_out:
        on = "on the motion it was fitted to (no held-out take)"
    return (
        f"The base model misses by {evidence.error_of(evidence.base).value:.1f} mm {on}; "
        f"the sensor's noise alone is {evidence.floor_mm:.1f} mm."
    )


def _with_unit(evidence: Evidence, effect: int, effects: tuple[Effect, ...]) -> str:
    kind = effects[effect]
    unit = "" if kind.unit == "1" else f" {kind.unit}"
    middle, (low, high) = evidence.amplitude(effect)
    return f"{middle:.3g}{unit} [{low:.3g} to {high:.3g}]"
