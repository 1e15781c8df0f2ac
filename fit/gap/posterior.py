"""Posterior probability of subsets of effects: linear evidence selects subsets, and nonlinear joint refits weigh them.

A fit has residual r, amplitudes a_0 of its own effects, and their columns S. About it the model is linear in the total
amplitudes: r - S a_0 + J b + S a. All subsets are weighed there (`fit.gap.subsets`). Subsets that may win and were
never fitted are refitted jointly, from shares of their linear solution. The model is then linearised about the best
fit. The search ends when no subset without a fit can win. Masses are those about the last linearisation. Costs of fits
do not decide how likely a subset is, because fits end in different ripples of the cloth's residual. The ripples differ
by more than one effect makes.

Mesh and solver imitate effects. Their error has mean square s^2 and a random direction among FREE_DIRECTIONS. It stands
beside the covariance of `fit.gap.likelihood`, as an amplitude of every component that no effect makes, N(0, tau^2),

    tau = s / (sqrt(FREE_DIRECTIONS) m),   m: root mean square motion of the points by one typical size

with base parameters refitted, so that an amplitude within the error of mesh and solver is no evidence. Mesh and solver
do not move the held edge, so its evidence stays. The size s has two priors, and they are two hypotheses. `known`:
log-normal of width WIDTH about M, with

    M^2 = mesh and solver^2 + what the hanger's noise shakes^2 + sum over effects (law_spread x motion by the effect)^2

where any law leaves LEAST_BY_LAW of a gap, to LAW_DEVIATIONS deviations (`fit.gap.evidence`).

`wide`: log-uniform from M to WIDEST_UNKNOWN M, with the odds UNKNOWN: a cause outside the library is present. Twins,
which are collinear given the base parameters, are never in one subset: no take shows their difference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from fit.gap.evidence import LAW_DEVIATIONS
from fit.gap.fitting import COST_TOLERANCE, Fitted, Problem, Task
from fit.gap.hypotheses import polishing
from fit.gap.likelihood import Likelihood
from fit.gap.passing import is_brought
from fit.gap.screening import GROUP_COSINE
from fit.gap.subsets import (
    MOST_EFFECTS,
    SIZES,
    Columns,
    Reduced,
    log_evidence,
    log_prior,
    reduced,
    subsets,
    summed_out,
)
from fit.observer.edge import LEAST_BY_LAW
from fit.observer.residuals import Observer
from fit.observer.simulation_error import FREE_DIRECTIONS
from formats.arrays import Floats
from formats.plain_text import counted

Subset = tuple[str, ...]

SCALES = np.geomspace(1e-4, 0.1, 48)  # m: the discrepancies that are summed over, each a seventh larger
SIZE_LOG_SD = 0.5  # of the known size's logarithm: on nulls of a development set it came out at 0.5 to 1.4 times M
WIDEST_UNKNOWN = 30.0  # times M: an unknown cause may be as large as the motion; our choice: half and double untried
UNKNOWN = 1 / 6  # odds of a cause outside the library; our choice: small probabilities of it grow in proportion
DOZEN = 12  # subsets that are refitted in one round at most; our choice: a limit on the cost
REFITTED_WITHIN = 2.5  # of log mass below the best, for refits; our choice: an effect without gain is 3.2 behind
JOINT_ITERATIONS = 6  # of a joint refit, along chords; our choice: a limit on the cost, half and double untried
# Of the joint linear solution, from which refits begin; our choice: laws that bend take less than their slope says.
JOINT_STARTS = (0.3, 0.7, 1.0)
# Of a predicted amplitude: a fit that keeps less found another local minimum. Our choice: below the least of
# `JOINT_STARTS`, so that no start counts as lost. Half and double were not tried.
LEAST_KEPT = 0.25
# Effects that are refitted whatever their mass, if the base model needs an unknown cause; our choice: each costs
# refits.
TRIED = 3
# mm: an effect that moves the points less does not move them; our choice: far below a marker's 0.2 mm of noise.
LEAST_MOTION = 1e-3


@dataclass(frozen=True)
class Mass:
    """Log masses of subsets under a known and a wide discrepancy, each (subsets,), up to one constant.

    sharp: log mass with mesh and solver as the only discrepancy, which ranks subsets by the explained error
    """

    among: list[Subset]
    known: Floats
    wide: Floats
    sharp: Floats

    @property
    def total(self) -> Floats:
        """Log mass of each subset, (subsets,)."""
        return np.logaddexp(self.known, self.wide)


class Linear:
    """The model linearised about a fit: evidence and joint solution of every subset."""

    def __init__(self, observer: Observer, likelihood: Likelihood, fitted: Fitted, rows: dict[str, Floats]) -> None:
        """Compute the sums from which every subset's evidence is solved.

        rows, (components, numbers): signatures about the fit in typical sizes, of effects that are not in the fit
        """
        self.observer, self.fitted = observer, fitted
        count, first = len(fitted.vector), len(fitted.vector)
        self.rows = {name: own for name, own in rows.items() if own.any() and name not in fitted.active}
        now = {name: np.zeros(len(own)) for name, own in self.rows.items()}
        for name in fitted.active:
            components = len(observer.library[name].components)
            self.rows[name] = fitted.jacobian[:, first : first + components].T
            now[name] = fitted.amplitudes[observer.columns[name]] / observer.library[name].typical
            first += components
        self.jacobian = fitted.jacobian[:, :count]
        kinds = [observer.library[name] for name, own in self.rows.items() for _ in own]
        self.columns = Columns(
            tuple(name for name, own in self.rows.items() for _ in own),
            np.array([kind.low / kind.typical for kind in kinds]),
            np.array([kind.high / kind.typical for kind in kinds]),
        )
        self.signatures = signatures = np.concatenate(list(self.rows.values()))
        self.residual = fitted.residual - np.concatenate(list(now.values())) @ signatures
        prior = Problem(observer)
        self.precision = prior.prior_sd**-2
        logs = observer.parameterisation.is_log
        initial = observer.parameterisation.initial
        self.offset = np.where(
            logs, np.log(np.where(logs, fitted.vector / np.where(logs, initial, 1.0), 1.0)), fitted.vector - initial
        )
        hat = np.linalg.solve(self.jacobian.T @ self.jacobian + np.diag(self.precision), self.jacobian.T)
        self.seen = signatures - (signatures @ self.jacobian) @ hat
        self.motion = np.array([max(float(observer.in_mm(row)), LEAST_MOTION) for row in self.seen])
        on_cloth = np.where(observer.layout.is_edge, 0.0, signatures)
        sums = likelihood.of(np.vstack([self.residual, self.jacobian.T, on_cloth, signatures]))
        imitated = (1e3 * likelihood.scales[:, None] / np.sqrt(FREE_DIRECTIONS) / self.motion) ** -2
        precision = np.concatenate([np.tile(self.precision, (len(imitated), 1)), imitated], 1)
        self.reduced: Reduced = reduced(sums, precision, np.concatenate([self.offset, np.zeros(len(self.motion))]))
        self.scales = likelihood.scales

    def masses(self, among: Sequence[Subset], known_mm: float) -> Mass:
        """Return the masses of subsets; known_mm: error of mesh, solver and the hanger's noise."""
        evidence = log_evidence(self.reduced, self.columns, among)
        spread = np.array([self.observer.library[name].law_spread for name in self.columns.effects])
        law = np.maximum(spread, np.sqrt(LEAST_BY_LAW) / LAW_DEVIATIONS)
        middle = np.full(len(among), known_mm)
        best = evidence.argmax(1)
        for n, subset in enumerate(among):
            at = self._places(subset)
            if at:
                size = np.abs(self._solution(at, int(best[n])))
                middle[n] = np.hypot(known_mm, float(np.sqrt(((law[at] * size * self.motion[at]) ** 2).sum())))
        prior = np.array([log_prior(len(subset)) for subset in among])
        logs = np.log(1e3 * self.scales)
        known = summed_out(evidence, logs, middle, SIZE_LOG_SD)
        apart = logs - np.log(middle)[:, None]
        within = np.where((apart >= 0) & (apart <= np.log(WIDEST_UNKNOWN)), 0.0, -np.inf)
        wide = logsumexp(evidence + within, axis=1) - logsumexp(within, axis=1)
        sharp = evidence[:, int(np.abs(logs - np.log(known_mm)).argmin())]
        return Mass(list(among), known + prior, wide + prior + float(np.log(UNKNOWN)), sharp + prior)

    def _places(self, subset: Subset) -> list[int]:
        return [n for n, name in enumerate(self.columns.effects) if name in subset]

    def _solution(self, at: list[int], scale: int) -> Floats:
        """Return the total amplitudes of columns in typical sizes, limited to their ranges, (columns,)."""
        normal = self.reduced.normal[scale][np.ix_(at, at)] + np.eye(len(at)) / SIZES**2
        found = np.linalg.solve(normal, self.reduced.pull[scale][at])
        return np.clip(found, self.columns.low[at], self.columns.high[at])

    def twins(self) -> set[frozenset[str]]:
        """Return pairs of one-component effects that are collinear once base parameters are refitted."""
        alone = [n for n, name in enumerate(self.columns.effects) if self.columns.effects.count(name) == 1]
        lengths = np.maximum(np.linalg.norm(self.seen[alone], axis=1), 1e-12)
        cosines = np.abs(self.seen[alone] @ self.seen[alone].T) / lengths[:, None] / lengths
        names = [self.columns.effects[n] for n in alone]
        return {frozenset((names[a], names[b])) for a, b in np.argwhere(cosines > GROUP_COSINE).tolist() if a < b}

    def sizes(self, subset: Subset) -> dict[str, float]:
        """Return each effect's largest component at the subset's solution, in the effect's unit."""
        at = self._places(subset)
        found = self._solution(at, int(log_evidence(self.reduced, self.columns, [subset])[0].argmax()))
        names = [self.columns.effects[n] for n in at]
        typical = {name: self.observer.library[name].typical for name in subset}
        return {
            name: max(abs(float(size)) for own, size in zip(names, found, strict=True) if own == name) * typical[name]
            for name in subset
        }

    def joint(self, subset: Subset) -> Floats:
        """Return the Jacobian of base parameters and a subset's amplitudes, (numbers, parameters + components)."""
        return np.concatenate([self.jacobian, *(self.rows[name].T for name in subset)], axis=1)

    def starts(self, subset: Subset) -> tuple[Floats, Floats]:
        """Return starts of the nonlinear fit of a subset: base parameters and amplitudes, a row per share."""
        problem, at = Problem(self.observer, subset), self._places(subset)
        order = np.argsort([subset.index(self.columns.effects[n]) for n in at], kind="stable")
        scale = int(log_evidence(self.reduced, self.columns, [subset])[0].argmax())
        size = self._solution(at, scale)
        count, logs = len(self.fitted.vector), self.observer.parameterisation.is_log
        normal = self.jacobian.T @ self.jacobian + np.diag(self.precision)
        places = []
        for share in JOINT_STARTS:
            left = self.residual + share * size @ self.signatures[at]
            step = -np.linalg.solve(normal, self.jacobian.T @ left)
            moved = np.where(
                logs, self.fitted.vector * np.exp(np.clip(step * logs, -1, 1)), self.fitted.vector + step * ~logs
            )
            row = self.observer.off
            row[problem.columns] = share * size[order] * problem.typical
            places.append(problem.pack(moved[:count], row))
        return problem.unpack(np.array(places))


@dataclass
class Found:
    """Fitted models and the masses of all subsets.

    fits: by their effects, sorted; the base model's is of no effect
    """

    fits: dict[Subset, Fitted]
    mass: Mass | None = None
    twins: set[frozenset[str]] = field(default_factory=set)

    def shares(self) -> dict[Subset, tuple[float, float]]:
        """Return the probability of each subset with a known and with a wide discrepancy."""
        assert self.mass is not None
        whole = logsumexp(self.mass.total)
        return {
            subset: (float(np.exp(known - whole)), float(np.exp(wide - whole)))
            for subset, known, wide in zip(self.mass.among, self.mass.known, self.mass.wide, strict=True)
        }


Refit = Callable[[list[Subset], list[Task]], list[Fitted]]
Renew = Callable[[Fitted], dict[str, Floats]]


class Search:
    """Search for the subsets of effects that explain a residual, by alternating linear evidence and refits."""

    def __init__(
        self, observer: Observer, noise: list[Floats], base: Fitted, rows: dict[str, Floats], known_mm: float,
        refit: Refit, renew: Renew,
    ) -> None:  # fmt: skip
        """Begin at the base fit.

        - `noise`: measured, per axis [m], (points,) a take
        - `rows`: signatures about the base fit in typical sizes
        - `known_mm`: error of mesh, solver and the hanger's noise
        - `refit`: fits tasks of some subsets
        - `renew`: signatures about another fit
        """
        self.observer, self.noise, self.rows, self.known_mm = observer, noise, rows, known_mm
        self.refit, self.renew = refit, renew
        self.found, self.about = Found({(): base}), base
        self.refuted: list[Subset] = []  # about the present fit

    def go(self, tell: Callable[[str], None] = lambda _: None) -> Found:
        """Run the search; return the fitted models and the masses of all subsets."""
        found = self.found
        for turn in range(MOST_EFFECTS + 1):
            likelihood = Likelihood(self.observer, self.noise, self.about.residual, SCALES)
            linear = Linear(self.observer, likelihood, self.about, self.rows)
            found.twins |= linear.twins()
            found.mass = self._possible(linear.masses(self._allowed(linear), self.known_mm))
            wanted = _wanted(found, turn)
            if not wanted or turn == MOST_EFFECTS:
                break
            tell(f"{counted(len(wanted), 'refit')}, each with a set of effects")
            found.fits.update(zip(wanted, self.refit(wanted, self._tasks(linear, wanted)), strict=True))
            best = min(wanted, key=lambda one: found.fits[one].cost)
            self.refuted += [one for one in wanted if self._refutes(linear, found.fits[one])]
            if best in self.refuted:
                continue
            self.refuted.clear()
            found.fits[best] = self._polished(best, again=turn == 0)
            self.about = min(found.fits[best], found.fits[()], key=lambda one: one.cost)
            self.rows = {**self.rows, **self.renew(self.about)}
        return found

    def _refutes(self, linear: Linear, fitted: Fitted) -> bool:
        """Return whether a nonlinear fit contradicts the linear prediction of its cost or of an effect's size."""
        if fitted.cost >= (1 - COST_TOLERANCE) * self.about.cost:
            return True
        promised = linear.sizes(fitted.active)
        kept = {name: float(np.abs(fitted.amplitudes[self.observer.columns[name]]).max()) for name in fitted.active}
        return any(kept[name] < LEAST_KEPT * promised[name] for name in fitted.active)

    def _possible(self, mass: Mass) -> Mass:
        """Return masses without the subsets that fits refute, or whose effects another effect's law already contains.

        A secant of a strongly nonlinear effect may predict a saving that no amplitude reaches; its subsets with other
        effects are then refuted too. A sound law of one effect may contain another effect as well.
        """
        for n, subset in enumerate(mass.among):
            fitted = self.found.fits.get(subset)
            is_known = fitted is not None and subset not in self.refuted
            is_refuted = not is_known and any(set(one) <= set(subset) for one in self.refuted)
            if is_refuted or (fitted and any(is_brought(self.observer, fitted, name) for name in subset)):
                mass.known[n] = mass.wide[n] = mass.sharp[n] = -np.inf
        return mass

    def _polished(self, best: Subset, *, again: bool) -> Fitted:
        """Continue the best subset's fit with a Jacobian of finite differences; refit the base model from its end."""
        (fitted,) = self.refit([best], [polishing(self.found.fits[best])])
        if again and best:
            base = self.found.fits[()]
            (other,) = self.refit([()], [Task(fitted.vector, self.observer.off, known_cost=base.cost)])
            self.found.fits[()] = min(base, other, key=lambda one: one.cost)
        return fitted

    def _tasks(self, linear: Linear, wanted: list[Subset]) -> list[Task]:
        starts = [linear.starts(subset) for subset in wanted]
        vectors, amplitudes = (np.concatenate([start[k] for start in starts]) for k in (0, 1))
        costs = (self.observer.residuals(vectors, amplitudes) ** 2).sum(1).reshape(len(wanted), -1)
        return [
            Task(
                own[int(np.argmin(cost))], sizes[int(np.argmin(cost))], subset, JOINT_ITERATIONS, renewals=0,
                jacobian=linear.joint(subset), is_rough=True,
            )
            for subset, (own, sizes), cost in zip(wanted, starts, costs, strict=True)
        ]  # fmt: skip

    def _allowed(self, linear: Linear) -> list[Subset]:
        names, library = sorted(linear.rows), self.observer.library
        every = subsets(names, beside={name: not library[name].differs_by_solver for name in names})
        return [one for one in every if not any(pair <= set(one) for pair in self.found.twins)]


def _wanted(found: Found, turn: int) -> list[Subset]:
    """Return subsets without a fit that may win, with one more effect per turn, as a refit changes the linear model."""
    assert found.mass is not None
    mass, total = found.mass, found.mass.total
    order = np.argsort(-total)
    likely = [mass.among[n] for n in order[:DOZEN] if total[n] > total[order[0]] - REFITTED_WITHIN]
    chosen = [one for one in likely if len(one) <= turn + 1] or likely[:TRIED]
    # If the base model needs an unknown cause, the linear model hardly predicts the end of a refit.
    base = mass.among.index(())
    if turn == 0 and mass.wide[base] > mass.known[base]:
        chosen += [mass.among[n] for n in np.argsort(-mass.sharp) if len(mass.among[n]) == 1][:TRIED]
    return [one for one in dict.fromkeys(chosen) if one not in found.fits]
