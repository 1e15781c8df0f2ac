"""Evidence for a verdict: held-out errors of the hypotheses, noise floor, and error of mesh and solver."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fit.gap.closure import (
    SIGNIFICANT_GAP,
    BlockErrors,
    Resampling,
    closure,
    error_interval,
    exceeds,
    gain_p_value,
    solver_draws,
)
from fit.gap.fitting import Fitted, amplitude_of, excludes_zero
from fit.gap.floor import NOISE_REPLICAS as FLOOR_REPLICAS
from fit.gap.hypotheses import Hypothesis
from fit.gap.screening import GROUP_COSINE, Screened, Signature, cosine
from fit.observer.edge import LEAST_BY_LAW, is_edge_explained, is_favoured_by_edge, is_seen_on_edge
from fit.observer.residuals import Observer
from fit.observer.simulation_error import wrong_by_law, wrong_by_mesh
from fit.search.intervals import NEAR_BOUND
from formats.arrays import Booleans, Floats
from formats.diagnosis_records import Figure, Gate

SMALLEST_CLOSURE = 0.25  # share of the gap; our choice: less leaves three quarters to another cause
MOST_UNEXPLAINED = 0.6  # of the gap, left beyond noise and mesh; our choice: once the only limit (decision 20), now one
# Sound laws of an effect differ by its `law_spread`, in amplitude and so in motion. Of the gap they leave the square of
# three such deviations, or a twentieth if that is more. An error of mesh and solver adds twice its square at most.
LAW_DEVIATIONS, MESH_TWICE = 3.0, 2.0  # on the sets of decision 20; times, our choice: one finer mesh estimates it
STUDENT_95 = 2.92  # Student's t, 95 % one-sided, two degrees of freedom: for the mean of three replicas of the noise
# Factor for one more draw of the noise, in standard errors of that mean: t times sqrt(3) sqrt(1 + 1/3).
ONE_MORE = STUDENT_95 * 2.0
MOST_LEFT_OF_SILHOUETTE = 0.5  # of the gap: no floor holds a camera's error; our choice: half and double untried
# A further effect closes a tenth of the gap, and a third of the error that the effects before it leave beyond noise.
# Or it closes most of that error, which a wrong law of an effect that is there rarely does. Most counts on average or
# in the median half-second: where cloth becomes unpredictable for a moment, that moment holds nearly all of the error.
SECOND_GAIN, SHARE_OF_LEFT = 0.1, 1 / 3  # our choice: laws 0.1 apart leave 0.09 of a gap; less leaves most to others
MOST_OF_LEFT = 0.6  # of the error left; chosen on the development pairs of decision 18
LEAST_GAIN, LEAST_GAIN_BY_LAW = 0.01, 0.03  # beside effects of one exact law; beside others at most: decision 25
LEAST_LEFT = 0.1  # of the squared noise, of half-seconds whose shares count; our choice: half and double untried
NEAR, NEAR_TWIN = 0.8, 0.9  # of the winner's closure, of rivals; our choice: collinear ones need no share of draws
RIVAL = 0.1  # share of bootstrap draws won, from which an effect is a rival; our choice: below, others win nine of ten


def is_at_bound(observer: Observer, hypothesis: Hypothesis, effect_name: str | None = None) -> bool:
    """Return whether an effect of a hypothesis, or its last one, is at its bound: the end of its physical range."""
    name = effect_name or hypothesis.effects[-1]
    effect, amplitude = observer.library[name], hypothesis.fitted.amplitudes[observer.columns[name]]
    reach = NEAR_BOUND * (effect.high - effect.low)
    below = amplitude < effect.low + reach if effect.low < 0 else np.zeros(len(amplitude), bool)
    return bool((below | (amplitude > effect.high - reach)).any())


def best_of(observer: Observer, singles: dict[str, Hypothesis]) -> list[Hypothesis]:
    """Return the refitted effects by their remaining error, smallest first; effects at their bound come last."""
    return sorted(singles.values(), key=lambda h: (is_at_bound(observer, h), h.errors.squared_mm))


def least_gain(observer: Observer, before: Hypothesis) -> float:
    """Return the share of the gap that a further effect must close: as much as laws of the earlier effects leave."""
    spread = max(observer.library[k].law_spread for k in before.effects)
    return float(np.clip((LAW_DEVIATIONS * spread) ** 2, LEAST_GAIN, LEAST_GAIN_BY_LAW))


def closes_enough(
    observer: Observer, gap: float, before: Hypothesis, after: Hypothesis, floor_mm: float, hope: float = 1.0
) -> bool:
    """Return whether a further effect closes enough of a gap [mm^2], or would if it closed `hope` times as much."""
    was, now = before.errors, after.errors
    gain, usual = was.squared_mm - now.squared_mm, share_in_median_block(was, now, floor_mm)
    least = least_gain(observer, before)
    return is_worth_adding(gap, was.squared_mm - floor_mm**2, hope * gain, hope * usual, least)


def edge_left_by_law(observer: Observer, base: Hypothesis, hypothesis: Hypothesis) -> float:
    """Return the largest error that sound laws of these effects leave at the held edge, in `EdgeErrors` units."""
    moving = (observer.library[k] for k in hypothesis.effects if observer.library[k].moves_edge)
    spread = max((effect.law_spread for effect in moving), default=0.0)
    return (LAW_DEVIATIONS * spread) ** 2 * base.errors.edge.beyond_noise


def is_shown_by_edge(observer: Observer, base: Hypothesis, before: Hypothesis, found: Hypothesis) -> bool:
    """Return whether the held edge shows a further effect, beyond the error that laws of earlier effects may leave.

    The held row of silhouettes already corrected time stamps and edge, so it is no further evidence.
    """
    if any(recording.camera.is_placed for recording in observer.recordings):
        return False
    return is_seen_on_edge(before.errors.edge, found.errors.edge, edge_left_by_law(observer, base, before))


def is_refuted_by_edge(base: Hypothesis, before: Hypothesis, found: Hypothesis) -> bool:
    """Return whether a model's held edge is certainly farther from the tracked edge than another model's."""
    return is_favoured_by_edge(found.errors.edge, before.errors.edge, base.errors.edge)


def is_worth_adding(
    gap: float, left: float, gain: float, usual_share: float = 0.0, least: float = LEAST_GAIN_BY_LAW
) -> bool:
    """Return whether a further effect is needed that closes `gain` of the rest of a gap; mean squared errors [mm^2].

    usual_share: `share_in_median_block` of it; least: `least_gain` beside the effects before it
    """
    return bool(are_worth_adding(np.array(gap), np.array(left), np.array(gain), usual_share, least))


def are_worth_adding(
    gap: Floats, left: Floats, gain: Floats, usual_share: float = 0.0, least: float = LEAST_GAIN_BY_LAW
) -> Booleans:
    """Return `is_worth_adding` of many draws, each (replicas,)."""
    closes_much = (gain >= SECOND_GAIN * gap) & (gain >= SHARE_OF_LEFT * left)
    closes_most = (gain >= MOST_OF_LEFT * left) | (usual_share >= MOST_OF_LEFT)
    return np.asarray(closes_much | ((gain >= least * gap) & closes_most))


def share_in_median_block(before: BlockErrors, after: BlockErrors, floor_mm: float) -> float:
    """Return the share of one model's error beyond noise that another model closes, in the median half-second."""
    was, now = before.sums / before.counts, after.sums / after.counts
    left = np.maximum(was - floor_mm**2, LEAST_LEFT * max(floor_mm**2, 1e-6))
    return float(np.median((was - now) / left))


def per_millimetre(observer: Observer, signature: Signature) -> float:
    """Return the size at which a screened effect moves the points by 1 mm rms, after a linear base refit."""
    moved = float(np.mean([observer.in_mm(row) ** 2 for row in signature.projected]))
    return signature.typical / float(np.sqrt(max(moved, 1e-12)))


def size_within(observer: Observer, fitted: Fitted, effect: str, wrong: float) -> tuple[float, tuple[float, float]]:
    """Return an effect's size and its 90 % interval from noise, mesh and solver, in the effect's unit.

    wrong: half of the interval due to mesh and solver; it does not count if the held edge decided the size
    """
    size, (low, high) = amplitude_of(fitted, observer, effect)
    is_off_mesh = fitted.pinned is not None and observer.library[effect].moves_edge
    half = float(np.hypot((high - low) / 2, 0.0 if is_off_mesh else wrong))
    return size, (size - half, size + half)


def is_beyond(observer: Observer, hypothesis: Hypothesis, effect: str, wrong: float) -> bool:
    """Return whether an effect's size exceeds noise and the error of mesh and solver, `wrong` (90 %, effect's unit)."""
    return excludes_zero(size_within(observer, hypothesis.fitted, effect, wrong)[1])


@dataclass(frozen=True)
class Evidence:
    """All figures of a verdict: hypotheses with held-out errors, noise floor [mm], mesh error [mm], gates.

    - joint: hypotheses with further effects, each with the p-value of the last effect
    - instead: hypotheses of two effects, one of them in the place of a twin
    - observer, judge: of the fitted and of the held-out takes
    - floor_error_mm: standard error of the floor
    """

    observer: Observer
    judge: Observer
    screened: Screened
    base: Hypothesis
    singles: dict[str, Hypothesis]
    joint: list[tuple[Hypothesis, float]]
    floor_mm: float
    numerics_mm: float
    resampling: Resampling
    gates: list[Gate]
    is_held_out: bool
    instead: list[Hypothesis]
    floor_error_mm: float = 0.0
    mesh_mm: float = 0.0  # error of the mesh alone; numerics_mm holds the solver's too

    @property
    def gap_mm2(self) -> float:
        """The gap: mean squared error of the base model beyond the noise [mm^2]."""
        return self.base.errors.squared_mm - self.floor_mm**2

    @property
    def is_predictable(self) -> bool:
        """Whether the takes are predictable: two nearly equal simulations stay close."""
        return all(g.passed for g in self.gates if g.name == "predictability")

    @property
    def is_coarse(self) -> bool:
        """Whether the mesh error exceeds noise and solver error together, so that it may hide a gap."""
        solver = float(np.sqrt(max(self.numerics_mm**2 - self.mesh_mm**2, 0.0)))
        return self.mesh_mm > self.floor_mm + solver

    def closure_of(self, hypothesis: Hypothesis) -> Figure | None:
        """Return the closure of a hypothesis, the share of the gap that it closes; None if there is hardly a gap.

        Closure exceeds 1 if the hypothesis leaves less error than the estimated noise.
        """
        found = closure(self.base.errors, hypothesis.errors, self.floor_mm, self.floor_error_mm, FLOOR_REPLICAS)
        return Figure(value=found[0], interval=found[1]) if found is not None else None

    def is_within_noise(self, hypothesis: Hypothesis) -> bool:
        """Return whether the error of a hypothesis is within the noise and the noise's uncertainty."""
        return hypothesis.errors.squared_mm <= (self.floor_mm + ONE_MORE * self.floor_error_mm) ** 2

    def error_of(self, hypothesis: Hypothesis) -> Figure:
        """Return the root mean square held-out error of a hypothesis [mm]."""
        return Figure(
            value=float(np.sqrt(hypothesis.errors.squared_mm)),
            interval=error_interval(hypothesis.errors, self.resampling),
        )

    def p_value(self, effect: str) -> float:
        """Return the family-wise p-value (Bonferroni) that a refitted effect closes nothing.

        The family is every refitted effect if the judged takes chose none of them, else every screened effect.
        """
        family = len(self.singles) if self.is_held_out else len(self.screened)
        return min(1.0, family * gain_p_value(self.base.errors, self.singles[effect].errors, self.floor_mm))

    def amplitude(
        self, effect: str, *, beside: Hypothesis | None = None, any_law: bool = True
    ) -> tuple[float, tuple[float, float]]:
        """Return a refitted effect's size and its 90 % interval from noise, mesh, solver and the spread of its laws.

        - beside: a hypothesis of several effects that includes this one; None: the effect alone
        - any_law: whether the interval holds for every sound law of the effect, or for the library's alone
        """
        wrong = wrong_by_mesh(self.numerics_mm, per_millimetre(self.observer, self.screened[effect]))
        size, (low, high) = size_within(self.observer, (beside or self.singles[effect]).fitted, effect, wrong)
        law = wrong_by_law(self.observer.library[effect].law_spread, size) if any_law else 0.0
        half = float(np.hypot((high - low) / 2, law))
        return size, (size - half, size + half)

    def drawn(self, *several: Hypothesis) -> tuple[Floats, dict[str, Floats], list[Floats]]:
        """Draw mean squared errors [mm^2] of the base model, of each refitted effect, and of several effects together.

        A draw chooses blocks of the held-out takes and an error of mesh and solver.
        """
        every = [h.errors for h in (self.base, *self.singles.values(), *several)]
        moved = solver_draws(every, self.numerics_mm, len(self.resampling.picks))
        base, *rest = (e.draw(self.resampling) + moved[:, n] for n, e in enumerate(every))
        return base, dict(zip(self.singles, rest, strict=False)), rest[len(self.singles) :]

    @functools.cached_property
    def draws(self) -> tuple[Floats, dict[str, Floats]]:
        """Draws of the mean squared error [mm^2] of the base model and of each refitted effect."""
        return self.drawn()[:2]

    def alternatives(self, several: Hypothesis) -> dict[str, dict[str, Hypothesis]]:
        """Return, for each of two effects, the twins that replace it with nearly equal closure, and their hypotheses.

        A twin closes at least the share NEAR_TWIN of the error that the effect closes beside the other one. Or it
        closes the share NEAR of this error, and leaves less in RIVAL of the draws.
        """
        found: dict[str, dict[str, Hypothesis]] = {}
        for other in self.instead:
            shared = set(several.effects) & set(other.effects)
            if len(several.effects) != 2 or len(shared) != 1 or not shared <= self.singles.keys():
                continue
            ((kept,), (replaced,), (twin,)) = shared, set(several.effects) - shared, set(other.effects) - shared
            alone = self.singles[kept].errors.squared_mm
            gain, full = (alone - h.errors.squared_mm for h in (other, several))
            is_often_better = (
                np.mean(other.errors.draw(self.resampling) < several.errors.draw(self.resampling)) >= RIVAL
            )
            if is_favoured_by_edge(other.errors.edge, several.errors.edge, self.singles[kept].errors.edge):
                continue
            if gain >= NEAR_TWIN * full or (gain >= NEAR * full and is_often_better):
                found.setdefault(replaced, {})[twin] = other
        return found

    @functools.cached_property
    def contradicted(self) -> frozenset[str]:
        """Refitted effects that the held edge contradicts.

        The simulated edge is certainly farther from the tracked one with the effect than without it. Or it is farther
        than with another effect that closes nearly as much.
        """
        base = self.base.errors.squared_mm
        closed = {k: base - h.errors.squared_mm for k, h in self.singles.items() if not is_at_bound(self.observer, h)}
        beside = frozenset(
            k
            for k, h in self.singles.items()
            for other, saved in closed.items()
            if saved > NEAR * (base - h.errors.squared_mm) and is_refuted_by_edge(self.base, self.singles[other], h)
        )
        return beside | {k for k, h in self.singles.items() if is_refuted_by_edge(self.base, self.base, h)}

    @functools.cached_property
    def identified_by_edge(self) -> frozenset[str]:
        """Refitted effects that the held edge alone identifies, without evidence from the cloth.

        In held-out takes the simulated edge agrees with the tracked one with the effect, and certainly not without it.
        The effect's interval excludes zero, and the effect does not certainly increase the cloth's error. Of several
        effects, those count that the edge cannot distinguish from the best one.
        """
        found = [k for k in self.singles if self._is_identified_by_edge(k)]
        if not found:
            return frozenset()
        edges = {k: self.singles[k].errors.edge for k in found}
        nearest = min(edges.values(), key=lambda edge: edge.shown)
        return frozenset(k for k in found if not is_favoured_by_edge(edges[k], nearest, self.base.errors.edge))

    def _is_identified_by_edge(self, effect: str) -> bool:
        found = self.singles[effect]
        return not any(self.edge_lacks(effect)) and is_edge_explained(
            found.errors.edge, edge_left_by_law(self.observer, self.base, found)
        )

    def edge_lacks(self, effect: str) -> Iterator[str]:
        """Yield why the held edge does not identify an effect, even if the effect explains it."""
        found = self.singles[effect]
        if not self.observer.library[effect].moves_edge:
            yield "the effect itself moves no held edge"
        if effect in self.contradicted:
            yield "the edge lies nearer without it, or with an effect that closes nearly as much"
        if (closed := self.closure_of(found)) and closed.interval and closed.interval[1] < 0.0:
            yield "the cloth is surely farther off with it"
        if is_at_bound(self.observer, found):
            yield "its size is at its bound"
        if not is_shown_by_edge(self.observer, self.base, self.base, found):
            yield "the edge does not surely show it"
        if not excludes_zero(self.amplitude(effect, any_law=False)[1]):
            yield "its size may be 0, as far as noise, mesh and solver can tell"

    def alike(self, one: str, other: str) -> bool:
        """Return whether two effects are collinear on the residual, so that a small mesh error can swap them."""
        return abs(cosine(self.screened[one], self.screened[other])) > GROUP_COSINE

    @functools.cached_property
    def worth_naming(self) -> dict[str, Booleans]:
        """Draws in which each refitted effect has the least error and is worth naming, each (replicas,)."""
        return self.are_worth_naming(*self.draws)

    def are_worth_naming(self, base: Floats, drawn: dict[str, Floats]) -> dict[str, Booleans]:
        """Return the draws in which each refitted effect has the least error and is worth naming, each (replicas,).

        Worth naming: the base error of the draw is clearly above the noise, and the effect closes a quarter of it.
        Effects at their bound and effects that the held edge contradicts are never worth naming.

        - base, (replicas,), drawn, each (replicas,): mean squared errors [mm^2]
        """
        possible = {
            k: d
            for k, d in drawn.items()
            if k not in self.contradicted and not is_at_bound(self.observer, self.singles[k])
        }
        least, gap = np.min(np.stack([base, *possible.values()]), axis=0), base - self.floor_mm**2
        has_gap = base > SIGNIFICANT_GAP * self.floor_mm**2
        return {
            k: (d <= least) & has_gap & (base - d >= SMALLEST_CLOSURE * gap) & (k in possible) for k, d in drawn.items()
        }

    def win_shares(self) -> dict[str, float]:
        """Return the share of draws in which each refitted effect has the smallest error."""
        if not self.singles:
            return {}
        winners = np.argmin(np.stack(list(self.draws[1].values())), axis=0)
        return {k: float(np.mean(winners == n)) for n, k in enumerate(self.singles)}

    def exceeds(self, known: float) -> bool:
        """Return whether the base model's squared error is clearly above a known one [mm^2]."""
        return exceeds(self.base.errors, self.resampling, known)

    def most_by_law(self, hypothesis: Hypothesis, gap: Floats) -> Floats:
        """Return the largest mean squared error that sound laws of the effects leave of a gap, both (...,) [mm^2]."""
        spread = max(self.observer.library[k].law_spread for k in hypothesis.effects)
        share = max((LAW_DEVIATIONS * spread) ** 2, LEAST_BY_LAW)
        return np.asarray(self.most_by_noise + share * gap)

    @property
    def most_by_noise(self) -> float:
        """Return the largest mean squared error that noise, mesh and solver leave of a correct model [mm^2]."""
        noise = min(SIGNIFICANT_GAP * self.floor_mm**2, (self.floor_mm + ONE_MORE * self.floor_error_mm) ** 2)
        return noise + MESH_TWICE * self.numerics_mm**2

    def is_law_of(self, before: Hypothesis, after: Hypothesis) -> bool:
        """Return whether a further effect may only compensate for the laws of the earlier effects.

        It closes no more than sound laws of these may leave, less than a tenth of the gap, and not all that is left. A
        true small effect would leave only noise, mesh and solver.
        """
        spread = max(self.observer.library[k].law_spread for k in before.effects)
        saved = before.errors.squared_mm - after.errors.squared_mm
        is_within = saved <= min((LAW_DEVIATIONS * spread) ** 2, SECOND_GAIN) * self.gap_mm2
        return is_within and after.errors.squared_mm > self.most_by_noise

    @property
    def is_silhouette(self) -> bool:
        """Whether all judged points belong to silhouettes and were moved to their material positions."""
        recordings = self.judge.recordings
        return len(recordings) > 0 and all(recording.camera.is_placed for recording in recordings)

    def explains_enough(self, hypothesis: Hypothesis) -> bool:
        """Return whether a hypothesis' error beyond noise and mesh is small compared with the gap."""
        left = hypothesis.errors.squared_mm - self.floor_mm**2 - self.numerics_mm**2
        if self.is_silhouette:
            return left <= MOST_LEFT_OF_SILHOUETTE * self.gap_mm2
        by_law = float(self.most_by_law(hypothesis, np.array(self.gap_mm2)))
        return left <= MOST_UNEXPLAINED * self.gap_mm2 and hypothesis.errors.squared_mm <= by_law
