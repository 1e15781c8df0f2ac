"""Rounds of a diagnosis: refit and judge single effects first, then further effects together with the best one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice

import numpy as np

from fit.gap import gates as gate
from fit.gap.base_fit import across_valleys, middle
from fit.gap.checkpoint import Checkpoint, kept_as
from fit.gap.closure import Resampling, gain_p_value
from fit.gap.detectable import MESH_SHARE
from fit.gap.edge_fit import disputed, leads, trust_in_edge
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
from fit.gap.fitting import Fitted, Task, fit
from fit.gap.floor import Floor
from fit.gap.hypotheses import POLISHING, Hypothesis, further, judged, polishing, refits, shortlist
from fit.gap.numerics import Refined
from fit.gap.screening import GROUP_COSINE, Screened, cosine, ended_at, screen, with_amplitude
from fit.gap.subsets import MOST_EFFECTS
from fit.gap.verdict import FAMILY_WISE_LEVEL, Verdict, is_brought, may_be_added
from fit.observer.edge import is_edge_explained, is_favoured_by_edge
from fit.observer.residuals import Observer
from fit.observer.simulation_error import wrong_by_mesh
from formats.diagnosis_records import Gate
from formats.plain_text import counted

Progress = Callable[[str, float], None]

POLISHED = 2  # hypotheses whose fit goes on with a Jacobian of finite differences; our choice: best by cost, and by mm
POLISHED_SHARE = 0.5  # of the best hypothesis' saving of cost: one that saves less is not continued (decision 18)
PROMISING = 2.0  # times its closure: a further effect that then suffices is fitted on; our choice: refits end early
POLISHED_WITHIN = 1.5  # of two effects' squared error: within it a twin is fitted on; our choice: refits end early
SECONDS_TRIED = 3  # further effects that are refitted together with the first one; our choice: each costs a refit
FITS_BETTER = 1.5  # times the best effect's saving of cost: more is a start for pairs; our choice: each costs fits
RIVAL_SHARE = 0.7  # of the best effect's closure: from it on, the next is a start for pairs; our choice: below `NEAR`


class Rounds:
    """Hypotheses of a running diagnosis: the base model, single effects, and combinations with the best effects."""

    def __init__(
        self, observer: Observer, judge: Observer, fits: list[Fitted], progress: Progress, kept: Checkpoint,
    ) -> None:  # fmt: skip
        self.observer, self.judge, self.progress, self.kept = observer, judge, progress, kept
        self.fits = fits
        own = {p.name for p in observer.parameterisation.parameters}
        self.tested = tuple(
            effect.name
            for effect in observer.effects
            if effect.in_base not in own or ended_at(observer, fits[0].vector, effect.name) is not None
        )
        (self.base,) = judged(judge, fits[:1])
        self.screened: Screened
        self.singles: dict[str, Hypothesis] = {}
        self.asked: frozenset[str] = frozenset()  # effects that are refitted on request alone
        self.joint: list[tuple[Hypothesis, float]] = []  # further effects, and the last one's p-value
        self.beside: dict[str, Screened] = {}  # screening of the other effects, given one effect
        self.instead: list[Hypothesis] = []  # two effects, one of them in the place of a twin

    def first_round(self, added: tuple[str, ...], *, has_gap: bool) -> None:
        """Screen the library and refit the shortlist; refit the base model with the same effort.

        Without a gap no effect can explain anything, so only the effects in `added` are refitted.
        """
        self.progress("screening the effects", 0.32)
        self.screened = screen(self.observer, self.base.fitted, self.tested)
        chosen = self._and_leads(shortlist(self.screened), self.screened, self.base.fitted) if has_gap else []
        self.asked = frozenset(name for name in self.screened if name in added and name not in chosen)
        chosen += [name for name in self.screened if name in self.asked]
        if not chosen:
            return
        self.progress(f"{counted(len(chosen), 'refit')}, each with one effect", 0.4)
        self.refit_alone(chosen)
        self.progress("continuing the best refits", 0.62)
        by_cost = sorted(self.singles, key=lambda k: self.singles[k].fitted.cost)
        nearest = min(self.singles, key=lambda k: self.singles[k].errors.squared_mm)
        best = list(dict.fromkeys([by_cost[0], nearest, *by_cost]))[:POLISHED]
        saved = {k: self.base.fitted.cost - self.singles[k].fitted.cost for k in best}
        best = [k for k in best if k == nearest or saved[k] >= POLISHED_SHARE * saved[by_cost[0]]]
        polished = judged(self.judge, self._fitted_on([self.singles[k].fitted for k in best]))
        self.singles.update(zip(best, polished, strict=True))
        # A base fit that compensates for an effect is a poor start for the fit with this effect, and vice versa.
        again = Task(self.least.vector, self.observer.off, known_cost=self.base.fitted.cost)
        self.fits += self.kept.recall(["base-again"], partial(fit, self.observer, [again]))
        if gate.disagreement(self.fits) > gate.CONVERGED:
            between = Task(middle(self.observer, self.fits), self.observer.off)
            self.fits += self.kept.recall(["base-between"], partial(fit, self.observer, [between]))
        self.fits.sort(key=lambda f: f.cost)
        if self.fits[0] is not self.base.fitted:
            (self.base,) = judged(self.judge, self.fits[:1])
            self.screened = screen(self.observer, self.base.fitted, self.tested, self.screened)

    def sizes_by_edge(self, numerics: float) -> None:
        """Refit effects whose size the held edge disputes; numerics [mm]: error of mesh and solver."""
        again = self._by_edge(list(self.singles.values()), numerics)
        self.singles = dict(zip(self.singles, again, strict=True))

    def _by_edge(self, found: list[Hypothesis], numerics: float, came: str = "") -> list[Hypothesis]:
        """Return hypotheses, refitted where the held edge disputes amplitudes; came: their origin, for saved fits."""
        if not self.observer.layout.is_edge.any():
            return found
        trust, without = trust_in_edge(self.observer, numerics), self.base.fitted.residual
        known = [disputed(self.observer, without, one.fitted, trust) for one in found]
        again = [
            (n, Task(one.fitted.vector, pinned.amplitudes, one.effects, iterations=POLISHING, pinned=pinned))
            for n, (one, pinned) in enumerate(zip(found, known, strict=True))
            if pinned is not None
        ]
        if not again:
            return found
        names = [f"{kept_as(task.active)}{came}-by-edge" for _, task in again]
        made = self.kept.recall(names, partial(fit, self.observer, [task for _, task in again]))
        settled = list(found)
        for (n, _), one in zip(again, judged(self.judge, made), strict=True):
            settled[n] = one
        return settled

    def _and_leads(self, names: list[str], screened: Screened, before: Fitted) -> list[str]:
        """Return the most promising effects, and then further effects that the held edge shows."""
        return names + [name for name in leads(self.observer, screened, before.residual) if name not in names]

    def _fitted_on(self, found: list[Fitted]) -> list[Fitted]:
        """Return fits, continued with Jacobians of finite differences from their ends or across the valleys."""
        names = [kept_as(one.active) for one in found]
        tasks = [polishing(one) for one in found]
        polished = self.kept.recall([f"{name}-polished" for name in names], partial(fit, self.observer, tasks))
        beyond = [across_valleys(self.observer, one) for one in polished]
        every = [task for tasks in beyond for task in tasks]
        places = [f"{name}-beyond-{n}" for name, tasks in zip(names, beyond, strict=True) for n in range(len(tasks))]
        ends = iter(self.kept.recall(places, partial(fit, self.observer, every)) if every else [])
        return [
            min((one, *islice(ends, len(tasks))), key=lambda f: f.cost)
            for one, tasks in zip(polished, beyond, strict=True)
        ]

    @property
    def least(self) -> Fitted:
        """The refit of least cost, with or without an effect."""
        return min((h.fitted for h in (self.base, *self.singles.values())), key=lambda f: f.cost)

    @property
    def least_chosen(self) -> Fitted:
        """The refit of least cost without requested effects, so that these change no noise, which is measured at it."""
        own = (h.fitted for name, h in self.singles.items() if name not in self.asked)
        return min((self.base.fitted, *own), key=lambda f: f.cost)

    def predictability(self) -> Gate:
        """Return the predictability gate for the refit of least cost, because a fit without effects may be too limp."""
        least = self.least
        return gate.predictability_gate(self.observer, least.vector, least.amplitudes)

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
                (found,) = self._by_edge([found], numerics)
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
                self.singles[k] = alone

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

        Effects that a law of the start's effects may contain are left out (`fit.gap.verdict.is_brought`). So are
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

    def _refit(self, start: Fitted, screened: Screened, names: list[str], kind: str = "") -> list[Hypothesis]:
        def go() -> list[Fitted]:
            return fit(self.observer, refits(self.observer, start, screened, names))

        added = [(*start.active, name) for name in names]
        return judged(self.judge, self.kept.recall([kept_as(active) + kind for active in added], go))

    def refit_alone(self, names: list[str]) -> None:
        """Refit each effect alone and add it to the tried hypotheses."""
        for hypothesis in self._refit(self.base.fitted, self.screened, names) if names else []:
            self.singles[hypothesis.effects[-1]] = hypothesis

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
