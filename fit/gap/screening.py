"""Screening: compare every effect's signature with the base fit's residual, without a refit.

A fit has the residual r and the Jacobian J. An effect's signatures S are the change of the residual per unit of
amplitude, one column per component, at the typical size. The part that fitted parameters can imitate is projected out
of both:

    P = I - J (J'J + Lambda)^-1 J',   Sp = P S,   rp = P r
    alpha = -(Sp'Sp)^-1 Sp'rp,   explained = |Sp alpha|^2 / |rp|^2,   absorbed = 1 - |Sp|^2 / |S|^2

Screening alone names no effect: a refit is judged on held-out motion (`fit.gap.closure`). An effect may move no point,
for example contact of cloth that never touches itself. Then its figures are empty, and its amplitude is not
identifiable. Signatures are taken against the fit. Contact shortens the step, so its signatures are taken against
contact too small to touch anything (`Effect.no_size`). Without contact they are then zero.

Some effects are far from linear, such as a ringing rod, or taut and slack cloth. They have further secants, at their
`probes`. A secant counts if its own amplitude agrees with the amplitude that it finds. Of these, the secant with the
largest saving is taken. The smallest amplitude with power 0.8 at level 0.05 is (1.645 + 0.842) sd(alpha). Its block
scores come from the best hypothesis' residual, because an explained gap is no noise.
Source: A. Mendler, M. Doehler, C. E. Ventura, MSSP 154 (2021) (minimum detectable change).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from fit.cloth.effect import Effect
from fit.gap.correlation import effective_count
from fit.gap.fitting import Fitted, Problem
from fit.observer.residuals import Observer
from formats.arrays import Floats, Integers
from formats.nature import NORMAL_90

DETECTION = NORMAL_90 + 0.842  # one-sided 5 % and power 80 %
# Signatures with a larger cosine are collinear: they form a group. Our choice: less than 19 % of the square of one is
# not in the other.
GROUP_COSINE = 0.9
# Effects whose signatures are recomputed although signatures about a nearby fit are known: the most promising ones of
# decision 18. Our choice: a limit on the cost. Half and double word the demo's diagnosis alike.
RENEWED = 8
AT_TOP = 0.02  # of a base parameter's largest value; our choice: fits end a little short of a bound
# Of the amplitude of a probe: the range in which its secant is used. Our choice: a factor of about two each way, so
# that probes up to 3.2 times apart leave no amplitude out. Half and double were not tried.
SECANT_RANGE = (0.5, 1.6)


def ended_at(observer: Observer, vector: Floats, effect: str) -> int | None:
    """Return the index of the base parameter that an effect extends, if it is fitted at its upper bound; else None."""
    kind, parameters = observer.library[effect], observer.parameterisation.parameters
    places = {p.name: n for n, p in enumerate(parameters)}
    if not kind.goes_beyond_base or kind.in_base not in places:
        return None
    place = places[kind.in_base]
    return place if vector[place] >= (1.0 - AT_TOP) * parameters[place].maximum else None


@dataclass(frozen=True)
class Signature:
    """Screening result of one effect.

    - `amplitude`, (components,): of the linear refit
    - `raw`, `projected`: signatures in typical sizes, (components, numbers); the raw ones are columns of a joint
      Jacobian
    - `contribution`, (numbers,): the part of the residual that the effect alone would explain
    - `predicted`: cost that a linear refit would save
    - `predicted_mm2`: mean squared error that it would save [mm^2]
    - `explained`: `predicted` as a share of what the fit left
    - `absorbed`: share of the signature that parameters imitate
    - `correlation`: multiple, of the residual with the raw signatures
    """

    amplitude: Floats
    raw: Floats
    projected: Floats
    contribution: Floats
    typical: float
    predicted: float
    predicted_mm2: float
    explained: float
    absorbed: float
    correlation: float

    @property
    def secant(self) -> Secant:
        """Signatures per unit of the effect's components, (components, numbers)."""
        return Secant(self.raw / self.typical)

    def minimum_detectable(self, left: Floats, block: Integers, correlation: Floats) -> Floats:
        """Return the smallest detectable amplitude of each component, given the others, (components,).

        The amplitude is infinite if a component moves nothing. left, (numbers,): residual of a model; correlation,
        (blocks, blocks): of its sums over blocks
        """
        rows = self.projected
        moves = np.flatnonzero(rows.any(1))
        found = np.full(len(rows), np.inf)
        scores = block_scores(rows[moves], left, block)
        inverse = np.linalg.pinv(rows[moves] @ rows[moves].T, hermitian=True)
        spread = (
            inverse
            @ (scores.T @ scores)
            @ inverse
            * (len(correlation) / effective_count(correlation, np.ones(len(correlation))))
        )
        found[moves] = DETECTION * self.typical * np.sqrt(np.maximum(np.diag(spread), 0.0))
        return found


Screened = dict[str, Signature]  # every screened effect, by its name


def cosine(one: Signature, other: Signature) -> float:
    """Return the cosine between the parts of the residual that two effects explain alone; 0 if one explains nothing."""
    lengths = float(np.linalg.norm(one.contribution) * np.linalg.norm(other.contribution))
    return float(one.contribution @ other.contribution) / lengths if lengths > 0.0 else 0.0


@dataclass(frozen=True)
class Secant:
    """Change of the residual per unit of each of an effect's components, (components, numbers).

    at: amplitude at which the secant from the fit ends, if it is valid near this amplitude only; 0: valid everywhere
    """

    rows: Floats
    at: float = 0.0

    def holds(self, amplitude: Floats) -> bool:
        """Return whether this secant is valid for an amplitude, (components,)."""
        low, high = SECANT_RANGE
        return self.at == 0.0 or low <= float(amplitude[0]) / self.at <= high


def secants_of(observer: Observer, fitted: Fitted, chosen: Collection[str]) -> dict[str, list[Secant]]:
    """Return secants of the chosen effects about a fit, each at its typical size and then at its probes."""
    wanted = [_places(observer, fitted, name) for name in chosen]
    rows = np.array([row for places in wanted for row in places])
    moved = observer.residuals(np.tile(fitted.vector, (len(rows), 1)), rows)
    ends = np.cumsum([len(places) for places in wanted])[:-1]
    return {
        name: _secants(observer, fitted, name, np.array(places), residuals)
        for name, places, residuals in zip(chosen, wanted, np.split(moved, ends), strict=True)
    }


def _places(observer: Observer, fitted: Fitted, name: str) -> list[Floats]:
    """Return rows of amplitudes for an effect's secants: of its components, its probes and its no-size."""
    effect, columns, now = observer.library[name], observer.columns[name], fitted.amplitudes
    signs = (1.0,) if effect.is_one_sided else (1.0, -1.0)
    steps = [(c, sign * effect.typical) for c in range(columns.start, columns.stop) for sign in signs]
    steps += [(columns.start, sign * probe) for probe in effect.probes for sign in signs]
    rows = [with_amplitude(now, c, np.clip(now[c] + step, effect.low, effect.high)) for c, step in steps]
    if effect.no_size > 0.0:
        rows.append(with_amplitude(now, columns, np.maximum(now[columns], effect.no_size)))
    return rows


def _secants(observer: Observer, fitted: Fitted, name: str, places: Floats, moved: Floats) -> list[Secant]:
    effect, columns = observer.library[name], observer.columns[name]
    before = moved[-1] if effect.no_size > 0.0 else fitted.residual
    first = columns.start
    sizes = places[:, first] - fitted.amplitudes[first]

    def alone(n: int) -> Secant:
        return Secant(((moved[n] - before) / sizes[n])[None], at=float(sizes[n]))

    count = len(effect.components)
    if effect.is_one_sided:
        main = [(moved[c] - before) / (places[c, first + c] - fitted.amplitudes[first + c]) for c in range(count)]
        others = range(count, count + len(effect.probes))
    else:
        main = [
            (moved[2 * c] - moved[2 * c + 1]) / (places[2 * c, first + c] - places[2 * c + 1, first + c])
            for c in range(count)
        ]
        # An effect with a one-sided resistance shows on one side only. So each side is tried alone, and all probes.
        others = range(2 * count + 2 * len(effect.probes)) if effect.probes else range(0)
    return [Secant(np.array(main)), *(alone(n) for n in others if sizes[n] != 0.0)]


def with_amplitude(amplitudes: Floats, columns: slice | int, changed: Floats | float) -> Floats:
    """Return a row of amplitudes, (components,), with the values of some columns replaced."""
    row = amplitudes.copy()
    row[columns] = changed
    return row


def screen(
    observer: Observer,
    fitted: Fitted,
    chosen: Sequence[str],
    known: Screened | None = None,
) -> Screened:
    """Screen the chosen effects against a fit, whose own effects are projected out like parameters.

    `known` holds the same effects, screened against a nearby fit of the same takes. These signatures decide which
    effects are simulated again, and replace the signatures of the other effects.
    """
    # A parameter at its upper bound cannot imitate an effect that extends it.
    stopped = [ended_at(observer, fitted.vector, name) for name in chosen]
    is_free = ~np.isin(np.arange(fitted.jacobian.shape[1]), [place for place in stopped if place is not None])
    jacobian = fitted.jacobian[:, is_free]
    precision = np.diag(Problem(observer, fitted.active, fitted.pinned).prior_sd[is_free] ** -2)
    hat = np.linalg.solve(jacobian.T @ jacobian + precision, jacobian.T)

    def project(rows: Floats) -> Floats:
        return np.asarray(rows - (rows @ jacobian) @ hat)

    rest = project(fitted.residual[None])[0]

    def score(name: str, secants: list[Secant]) -> list[_Scored]:
        """Return the scores of an effect's secants that are valid for their own estimated amplitude."""
        effect = observer.library[name]
        every = [(_score(secant, effect, project, fitted.residual, rest), secant) for secant in secants]
        return [one for one, secant in every if secant.holds(one.amplitude)]

    tried = {name: score(name, [known[name].secant]) for name in chosen} if known else {}
    promising = set(sorted(tried, key=lambda name: -tried[name][0].predicted)[:RENEWED]) if known else set(chosen)
    renewed = [name for name in chosen if name in promising]
    for name, secants in secants_of(observer, fitted, renewed).items():
        tried[name] = score(name, secants)
    scored = {name: max(tried[name], key=lambda one: one.predicted) for name in chosen}
    left, left_mm2 = max(float(rest @ rest), 1e-12), float(observer.in_mm(rest)) ** 2
    return {
        name: Signature(
            amplitude=one.amplitude, raw=one.raw, projected=one.seen, contribution=one.contribution,
            typical=observer.library[name].typical, predicted=one.predicted,
            predicted_mm2=left_mm2 - float(observer.in_mm(rest + one.contribution)) ** 2,
            explained=one.predicted / left,
            absorbed=1 - float((one.seen**2).sum()) / max(float((one.raw**2).sum()), 1e-12),
            correlation=one.correlation,
        )
        for name, one in scored.items()
    }  # fmt: skip


@dataclass(frozen=True)
class _Scored:
    """Result of one secant: amplitude, (components,), and rows in typical sizes, raw and projected.

    contribution, (numbers,): explained part of the residual; predicted: cost that a linear refit would save;
    correlation: multiple, of the residual with the raw rows
    """

    amplitude: Floats
    raw: Floats
    seen: Floats
    contribution: Floats
    predicted: float
    correlation: float


def _score(
    secant: Secant, effect: Effect, project: Callable[[Floats], Floats], residual: Floats, rest: Floats
) -> _Scored:
    raw = secant.rows * effect.typical
    seen = project(raw)
    hessian = seen @ seen.T + 1e-9 * max(float((raw**2).sum()), 1e-12) * np.eye(len(raw))
    total = seen @ rest
    alpha = np.asarray(-np.linalg.solve(hessian, total))
    if effect.is_one_sided:
        alpha = np.maximum(alpha, 0.0)
    return _Scored(
        amplitude=alpha * effect.typical, raw=raw, seen=seen, contribution=np.asarray(alpha @ seen),
        predicted=max(float(-2 * total @ alpha - alpha @ hessian @ alpha), 0.0),
        correlation=_correlation(raw, residual, effect.is_one_sided),
    )  # fmt: skip


def _correlation(rows: Floats, residual: Floats, is_one_sided: bool) -> float:
    """Return the multiple correlation of a residual, (numbers,), with rows; 0 if a one-sided effect would be off."""
    sums = rows @ residual
    if is_one_sided and sums[0] > 0:
        return 0.0
    inverse = np.linalg.pinv(rows @ rows.T, hermitian=True)
    return float(np.sqrt(max(float(sums @ inverse @ sums), 0.0) / max(float(residual @ residual), 1e-12)))


def block_scores(rows: Floats, residual: Floats, block: Integers) -> Floats:
    """Return products of rows, (components, numbers), with a residual, summed per block, (blocks, components)."""
    found = np.zeros((int(block.max()) + 1, len(rows)))
    np.add.at(found, block, (rows * residual).T)
    return found


def groups(screened: Screened) -> dict[str, str]:
    """Return each effect's group, named by its first effect; effects of a group are collinear (complete linkage)."""
    leader: dict[str, str] = {}
    for name, own in screened.items():
        leader[name] = name
        for first in [other for other, its in leader.items() if other == its and other != name]:
            members = [other for other, its in leader.items() if its == first]
            if all(abs(cosine(own, screened[other])) > GROUP_COSINE for other in members):
                leader[name] = first
                break
    return leader
