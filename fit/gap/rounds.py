"""Rounds of a diagnosis: refit and judge further effects together with the best ones of the first round."""

from __future__ import annotations

from functools import partial

import numpy as np

from fit.gap.checkpoint import kept_as
from fit.gap.closure import Resampling, gain_p_value
from fit.gap.detectable import MESH_SHARE
from fit.gap.evidence import (
    Evidence,
    best_of,
    closes_enough,
    edge_left_by_law,
    is_at_bound,
    is_beyond,
    is_refuted_by_edge,
    is_shown_by_edge,
    least_gain,
    per_millimetre,
)
from fit.gap.first_round import FirstRound
from fit.gap.fitting import Task, fit
from fit.gap.floor import Floor
from fit.gap.hypotheses import POLISHING, Hypothesis, further, judged, never_worse
from fit.gap.numerics import Refined
from fit.gap.passing import FAMILY_WISE_LEVEL, is_brought, may_be_added
from fit.gap.screening import GROUP_COSINE, cosine, screen, with_amplitude
from fit.gap.subsets import MOST_EFFECTS
from fit.gap.verdict import Verdict
from fit.observer.edge import is_edge_explained, is_favoured_by_edge
from fit.observer.simulation_error import wrong_by_mesh
from formats.diagnosis_records import Gate

PROMISING = 2.0  # times its closure: a further effect that then suffices is fitted on; our choice: refits end early
POLISHED_WITHIN = 1.5  # of two effects' squared error: within it a twin is fitted on; our choice: refits end early
SECONDS_TRIED = 3  # further effects that are refitted together with the first one; our choice: each costs a refit
FITS_BETTER = 1.5  # times the best effect's saving of cost: more is a start for pairs; our choice: each costs fits
RIVAL_SHARE = 0.7  # of the best effect's closure: from it on, the next is a start for pairs; our choice: below `NEAR`


class Rounds(FirstRound):
    """Hypotheses of a running diagnosis: the base model, single effects, and combinations with the best effects."""

    def further_rounds(self, floor: float, numerics: float) -> None:
        """Add effects to the best one while unexplained error remains.

        A further effect must close a share of the gap and of its rest, or show on the held edge (`fit.gap.evidence`).
        The rounds end when less than this share remains.
        """
        order = best_of(self.observer, self.singles)
        best, starts = order[0], [order[0], *self._further_starts(order)]
        gap = self.base.errors.squared_mm - floor**2
        while len(starts[0].effects) < MOST_EFFECTS:
            left_mm2 = best.errors.squared_mm - floor**2
            is_left = left_mm2 >= max(least_gain(self.observer, best) * gap, MESH_SHARE * numerics**2)
            by_law = edge_left_by_law(self.observer, self.base, best)
            if not is_left and is_edge_explained(best.errors.edge, by_law):
                return
            tried = [pair for start in starts for pair in self._with_another(start, floor)]
            if not tried:
                return
            found, p_value = self._best_of_tried(tried, best)
            if self._is_hopeful(found, p_value) and self._is_needed(best, found, floor, PROMISING):
                found = self._polished(found)
                if len(found.effects) == 2 and may_be_added(self.observer, found, p_value):
                    found = self._better_of_twins(found, p_value, floor)
                (found,) = self._by_edge([self._no_worse_than_start(found, best)], numerics)
                p_value = self._p_value(best, found, len(tried), floor)
            self.joint.append((found, p_value))
            if not may_be_added(self.observer, found, p_value) or not self._is_needed(best, found, floor):
                return
            if len(found.effects) == MOST_EFFECTS:
                self._drop_idle(found, p_value, numerics)
            if len(found.effects) == 2:
                self._each_alone(found, numerics)
                if not self._is_needed(best_of(self.observer, self.singles)[0], found, floor):
                    return
            best, starts = found, [found]

    def _is_needed(self, before: Hypothesis, found: Hypothesis, floor: float, hope: float = 1.0) -> bool:
        """Return whether a further effect closes enough (times `hope`), or shows on the held edge."""
        gap = self.base.errors.squared_mm - floor**2
        is_enough = closes_enough(self.observer, gap, before, found, floor, hope)
        return is_enough or is_shown_by_edge(self.observer, self.base, before, found)

    def _best_of_tried(self, tried: list[tuple[Hypothesis, float]], before: Hypothesis) -> tuple[Hypothesis, float]:
        """Return the hypothesis of least held-out error among those with a further effect.

        Hypotheses that may be added come first, then hopeful ones, then all. The same effects in another order may be
        added if either order may. Effects that explain the held edge's error come first.
        """
        real = [(h, p) for h, p in tried if may_be_added(self.observer, h, p)]
        seen = [(h, p) for h, p in real if is_shown_by_edge(self.observer, self.base, before, h)]
        if seen:
            nearest = min((h.errors.edge for h, _ in seen), key=lambda edge: edge.shown)
            real = [(h, p) for h, p in seen if not is_favoured_by_edge(h.errors.edge, nearest, before.errors.edge)]
        hopeful = [(h, p) for h, p in tried if self._is_hopeful(h, p)]
        return min(real or hopeful or tried, key=_held_out_error)

    def _is_hopeful(self, joint: Hypothesis, p_value: float) -> bool:
        """Return whether the last of several effects is significant and within its range, even after a rough fit."""
        return p_value < FAMILY_WISE_LEVEL and not is_at_bound(self.observer, joint)

    def _polished(self, joint: Hypothesis) -> Hypothesis:
        """Return a hypothesis of several effects whose fit was continued with a Jacobian of finite differences."""
        return judged(self.judge, self._fitted_on([joint.fitted]))[0]

    def _no_worse_than_start(self, joint: Hypothesis, best: Hypothesis) -> Hypothesis:
        """Return several effects, or the fit that they started from, with the last one's size 0, where that costs less.

        Two effects started from the first one alone, and more of them from the best ones so far.
        """
        start = best if len(joint.effects) > 2 else self.singles.get(joint.effects[0], best)
        if joint.fitted.cost <= start.fitted.cost or joint.effects[:-1] != start.effects:
            return joint
        return never_worse(start, joint, self.screened)

    def _drop_idle(self, several: Hypothesis, p_value: float, numerics: float) -> None:
        """Refit several effects without the idle ones; the fit replaces all joint hypotheses.

        An earlier effect may have compensated for a later one. Together with the later one, its size is then within the
        error of noise, mesh and solver.
        """
        wrong = {k: wrong_by_mesh(numerics, per_millimetre(self.observer, self.screened[k])) for k in several.effects}
        kept = tuple(
            k for k in several.effects if k == several.effects[-1] or is_beyond(self.observer, several, k, wrong[k])
        )
        if len(kept) == len(several.effects) or len(kept) < 2:
            return
        amplitudes = self.observer.off
        for columns in (self.observer.columns[k] for k in kept):
            amplitudes = with_amplitude(amplitudes, columns, several.fitted.amplitudes[columns])
        task = Task(several.fitted.vector, amplitudes, kept, iterations=POLISHING)
        name = f"{kept_as(kept)}-of-{kept_as(several.effects)}"
        (found,) = judged(self.judge, self.kept.recall([name], partial(fit, self.observer, [task])))
        self.joint = [(found, p_value)]

    def _each_alone(self, pair: Hypothesis, numerics: float) -> None:
        """Refit each of two effects alone from the end of their joint fit, and keep the fits that improve.

        An effect whose first refit ended in a poor local minimum may need no second effect. Where the held edge
        disputes a size, the fit has the edge's size, as before.
        """
        columns, both = self.observer.columns, pair.fitted
        amplitudes = {
            k: with_amplitude(self.observer.off, columns[k], both.amplitudes[columns[k]]) for k in pair.effects
        }
        before = {k: self.singles[k].fitted.cost if k in self.singles else np.inf for k in pair.effects}
        tasks = [
            Task(both.vector, row, (k,), iterations=POLISHING, known_cost=before[k]) for k, row in amplitudes.items()
        ]
        names = [f"{kept_as((k,))}-of-{kept_as(pair.effects)}" for k in pair.effects]
        made = self.kept.recall(names, partial(fit, self.observer, tasks))
        for alone in self._by_edge(judged(self.judge, made), numerics, f"-of-{kept_as(pair.effects)}"):
            (k,) = alone.effects
            if k not in self.singles or alone.fitted.cost < self.singles[k].fitted.cost:
                self.singles[k] = self.no_worse_than_base(alone)

    def _better_of_twins(self, pair: Hypothesis, p_value: float, floor: float) -> Hypothesis:
        """Return two effects, or a better hypothesis in which a twin replaces one of them.

        A twin is collinear with the single effect. The tried hypotheses are kept as `instead`. From them the verdict
        derives which effects the takes cannot distinguish.
        """
        found = [(pair, p_value)]
        for kept, replaced in (pair.effects[::-1], pair.effects):
            twins = self._twins(replaced, kept)
            tried = self._with_another(self.singles[kept], floor, twins) if twins and kept in self.singles else []
            near = [one for one in tried if _held_out_error(one) < POLISHED_WITHIN * pair.errors.squared_mm]
            found += [(self._polished(h), p) for h, p in near]
        best, _ = min(found, key=_held_out_error)
        self.instead = [h for h, p in found if h is not best and may_be_added(self.observer, h, p)]
        return best

    def _twins(self, effect: str, kept: str) -> tuple[str, ...]:
        """Return effects collinear with one of two, screened together with the other one, or else alone."""
        screened = self.beside.get(kept, self.screened)
        if effect not in screened:  # an effect that is never combined as a second one was a start
            screened = self.screened
        own = screened[effect]
        alike = [name for name, other in screened.items() if abs(cosine(own, other)) > GROUP_COSINE]
        return tuple(name for name in alike if name not in (effect, kept))

    def _further_starts(self, order: list[Hypothesis]) -> list[Hypothesis]:
        """Return further starts for pairs: the next best effect, if it closes nearly as much, and the best fit.

        While the other effect of a pair is missing, an effect may close little on held-out motion. Yet it may explain
        most of the fitted motion, or the held edge where the best effect does not. This holds even for an effect that
        the missing one drives to its bound.
        """
        base = self.base.errors.squared_mm
        least = RIVAL_SHARE * (base - order[0].errors.squared_mm)
        rivals = [h for h in order[1:2] if base - h.errors.squared_mm > least]
        fits_best = min(order, key=lambda h: (is_at_bound(self.observer, h), h.fitted.cost))
        saved, usual = (self.base.fitted.cost - h.fitted.cost for h in (fits_best, order[0]))
        found = [*rivals, fits_best] if saved > FITS_BETTER * usual else rivals
        nearest = min(order, key=lambda h: h.errors.edge.shown)
        edge, by_law = order[0].errors.edge, edge_left_by_law(self.observer, self.base, order[0])
        if not is_edge_explained(edge, by_law) and is_favoured_by_edge(edge, nearest.errors.edge, nearest.errors.edge):
            found = [*found, nearest]
        return list({h.effects: h for h in found if h is not order[0]}.values())

    def _with_another(
        self, start: Hypothesis, floor: float, chosen: tuple[str, ...] | None = None
    ) -> list[tuple[Hypothesis, float]]:
        """Refit with one more effect each, the most promising or `chosen` ones; return hypotheses with p-values.

        Effects that a law of the start's effects may contain are left out (`fit.gap.passing.is_brought`). So are
        effects that would move the held edge away from the tracked one.
        """
        library = self.observer.library
        left = tuple(
            name
            for name in (self.tested if chosen is None else chosen)
            if name not in start.effects and not library[name].differs_by_solver
        )
        if not left:
            return []
        screened = screen(self.observer, start.fitted, left, self.screened)
        if chosen is None and len(start.effects) == 1:
            self.beside[start.effects[0]] = screened
        names = self._and_leads(further(screened, SECONDS_TRIED), screened, start.fitted)
        refitted = self._refit(start.fitted, screened, names, "" if chosen is None else "-as-twin")
        return [
            (h, self._p_value(start, h, len(names), floor))
            for h in refitted
            if not any(is_brought(self.observer, h.fitted, k) for k in h.effects)
            and not is_refuted_by_edge(self.base, start, h)
        ]

    def _p_value(self, before: Hypothesis, found: Hypothesis, refitted: int, floor: float) -> float:
        """Return the family-wise p-value of a further effect among the refitted ones, as `Evidence.p_value` does.

        An effect that explains the held edge's error is certain, whatever its closure on the cloth
        (`fit.observer.edge`).
        """
        if is_shown_by_edge(self.observer, self.base, before, found):
            return 0.0
        family = len(self.tested) if self.judge is self.observer else refitted
        return min(1.0, family * gain_p_value(before.errors, found.errors, floor))

    def alive(self, evidence: Evidence, verdict: Verdict) -> tuple[list[Hypothesis], list[float]]:
        """Return the hypotheses that the next recording should distinguish, and the weight of each."""
        if verdict.verdict not in {"effect", "ambiguous", "unknown"}:
            return [], []
        shares = evidence.win_shares()
        order = sorted(self.singles, key=lambda k: self.singles[k].errors.squared_mm)
        named = [k for k in order if k in verdict.named]
        chosen = (named + [k for k in order if k not in named])[: max(2, len(named))]
        return [self.singles[k] for k in chosen], [max(shares[k], 0.1) for k in chosen]

    def evidence(
        self, noise: Floor, refined: Refined, resampling: Resampling, gates: list[Gate], *,
        is_held_out: bool,
    ) -> Evidence:  # fmt: skip
        """Gather the evidence for the verdict; noise: of the held-out takes."""
        return Evidence(
            observer=self.observer, judge=self.judge, screened=self.screened, base=self.base, singles=self.singles,
            joint=self.joint, instead=self.instead, floor_mm=noise.mm, numerics_mm=refined.numerics_mm,
            mesh_mm=refined.mesh_mm, resampling=resampling, gates=gates, is_held_out=is_held_out,
            floor_error_mm=noise.error_mm,
        )  # fmt: skip

    def named(self, verdict: Verdict) -> Hypothesis | None:
        """Return the hypothesis that the verdict names."""
        if verdict.verdict == "several":
            return next(h for h, _ in self.joint if set(h.effects) == set(verdict.named))
        if verdict.verdict in {"effect", "ambiguous"}:
            return self.singles[verdict.named[0]]
        return None


def _held_out_error(pair: tuple[Hypothesis, float]) -> float:
    return pair[0].errors.squared_mm
