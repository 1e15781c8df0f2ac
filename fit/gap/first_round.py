"""Refit and judge single effects: the first round of a diagnosis, with its base fits and sizes by the held edge."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice

from fit.gap import gates as gate
from fit.gap.base_fit import across_valleys, middle
from fit.gap.checkpoint import Checkpoint, kept_as
from fit.gap.edge_fit import disputed, leads, trust_in_edge
from fit.gap.fitting import Fitted, Task, fit
from fit.gap.hypotheses import POLISHING, Hypothesis, judged, never_worse, polishing, refits, shortlist
from fit.gap.screening import Screened, ended_at, screen
from fit.observer.residuals import Observer
from formats.diagnosis_records import Gate
from formats.plain_text import counted

Progress = Callable[[str, float], None]

POLISHED = 2  # hypotheses whose fit goes on with a Jacobian of finite differences; our choice: best by cost, and by mm
POLISHED_SHARE = 0.5  # of the best hypothesis' saving of cost: one that saves less is not continued (decision 18)


class FirstRound:
    """Hypotheses of a running diagnosis after its first round: the base model and single effects."""

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
        self.keep_the_better()

    def keep_the_better(self) -> None:
        """Put the base fit, with the effect's size 0, in the place of each refit that fits no better than it."""
        self.singles = {name: self.no_worse_than_base(one) for name, one in self.singles.items()}

    def no_worse_than_base(self, alone: Hypothesis) -> Hypothesis:
        """Return a refit with one effect, or the base fit with the effect's size 0 where that fits no worse."""
        return never_worse(self.base, alone, self.screened)

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

    def _refit(self, start: Fitted, screened: Screened, names: list[str], kind: str = "") -> list[Hypothesis]:
        def go() -> list[Fitted]:
            return fit(self.observer, refits(self.observer, start, screened, names))

        added = [(*start.active, name) for name in names]
        return judged(self.judge, self.kept.recall([kept_as(active) + kind for active in added], go))

    def refit_alone(self, names: list[str]) -> None:
        """Refit each effect alone and add it to the tried hypotheses."""
        for hypothesis in self._refit(self.base.fitted, self.screened, names) if names else []:
            self.singles[hypothesis.effects[-1]] = hypothesis
