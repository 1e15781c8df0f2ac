"""Line A: which effect's signature does the residual of the base fit carry?

With the residual r of a fit, its Jacobian J and an effect's signatures S (change of the residual per unit of amplitude,
one column per component, taken at the typical size), what the fitted parameters can imitate is projected out of both:

    P = I - J (J'J + Lambda)^-1 J',   Sp = P S,   rp = P r
    alpha = -(Sp'Sp)^-1 Sp'rp,   explained = |Sp alpha|^2 / |rp|^2,   absorbed = 1 - |Sp|^2 / |S|^2
    T = g' (sum_b g_b g_b')^-1 g,   g = sum_b g_b,  g_b = Sp_b' rp_b over blocks b of half a second

T is judged against its own wild bootstrap (the signs of the blocks' scores drawn at random), and the smallest p of all
effects against the smallest of each draw, which controls the family-wise error under any correlation.
An effect that moves no point at all (cloth that never touches itself) has none of this, and no amplitude of it would
be found. Signatures are taken against the fit; those of contact, whose step is shorter, against contact too small to
touch anything (`Effect.no_size`), so that they are nothing where nothing touches. An effect that is far from linear (a
rod that rings, cloth that is taut or slack) has further secants, at its `probes`; of those whose own amplitude agrees
with the one that they find, the one that promises most is taken.
The smallest amplitude that would be found with power 0.8 at level 0.05 is (1.645 + 0.842) sd(alpha), with block scores
of what the best hypothesis leaves: a gap that is explained is no noise.
Sources: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) (score test); P. H. Westfall & S. S. Young, "Resampling-based
multiple testing" (1993), section 2.4 (min-p); A. Mendler, M. Doehler, C. E. Ventura, MSSP 154 (2021) (minimum
detectable change).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth.effect import Effect
from fit.gap.closure import TIE
from fit.gap.fitting import Fitted, Problem
from fit.observer.residuals import Observer
from formats.arrays import Floats

REPLICAS = 2000
DETECTION = 1.645 + 0.842  # one-sided 5 % and power 80 %
GROUP_COSINE = 0.9  # signatures closer than this cannot be told apart
RENEWED = 8  # effects whose signatures are taken anew where those of a fit nearby are known
AT_TOP = 0.02  # of a base parameter's largest value: nearer to it a fit was stopped by it
NEAR = (0.5, 1.6)  # of the amplitude of a probe: what its secant may be believed for


def ended_at(observer: Observer, vector: Floats, effect: int) -> int | None:
    """Place of the base parameter that an effect is more of, where a fit ended at the top of its range; else None."""
    kind, parameters = observer.effects[effect], observer.parameterisation.parameters
    places = {p.name: n for n, p in enumerate(parameters)}
    if not kind.goes_beyond_base or kind.in_base not in places:
        return None
    place = places[kind.in_base]
    return place if vector[place] >= (1.0 - AT_TOP) * parameters[place].maximum else None


@dataclass(frozen=True)
class Screened:
    """What the score test says of each screened effect.

    effects: their indices in the library; amplitude: per effect its vector, (components,)
    explained, absorbed, p_value (own), family_p_value: (screened,)
    projected: per effect its projected signatures in typical sizes, (components, numbers); typical, (screened,)
    cosines, (screened, screened): of what each effect alone would explain of the residual
    correlation: multiple, of the residual with the signatures as they are, nothing projected out, (screened,)
    raw: per effect its signatures in typical sizes, (components, numbers), columns of a joint Jacobian
    predicted: cost that a linear refit would save, (screened,); predicted_mm2, (screened,): mean squared error [mm^2]
    """

    effects: tuple[int, ...]
    amplitude: list[Floats]
    explained: Floats
    absorbed: Floats
    p_value: Floats
    family_p_value: Floats
    cosines: Floats
    predicted: Floats
    predicted_mm2: Floats
    correlation: Floats
    raw: list[Floats]
    projected: list[Floats]
    typical: Floats

    def secant(self, effect: int) -> Secant:
        """Return the signatures that an effect was found to have, per unit of its components."""
        place = self.effects.index(effect)
        return Secant(self.raw[place] / self.typical[place])

    def minimum_detectable(self, left: Floats, block: NDArray[np.int64]) -> Floats:
        """Smallest amplitude of each effect that would have shown, (screened,), where `left` is what a model leaves.

        Infinite where an effect moves nothing.
        """
        found = np.full(len(self.effects), np.inf)
        for n, rows in enumerate(self.projected):
            if not rows.any():
                continue
            gain = np.zeros((int(block.max()) + 1, len(rows)))
            np.add.at(gain, block, (rows * left).T)
            inverse = np.linalg.pinv(rows @ rows.T, hermitian=True)
            spread = inverse @ (gain.T @ gain) @ inverse
            found[n] = DETECTION * self.typical[n] * float(np.sqrt(max(np.linalg.eigvalsh(spread)[-1], 0.0)))
        return found


@dataclass(frozen=True)
class Secant:
    """Change of the residual per unit of each of an effect's components, (components, numbers).

    at: the amplitude between which and the fit's it was taken, where it holds for that one alone; 0: for all.
    """

    rows: Floats
    at: float = 0.0

    def holds(self, amplitude: Floats) -> bool:
        """Whether an amplitude, (components,), is one that this secant may be believed for."""
        low, high = NEAR
        return self.at == 0.0 or low <= float(amplitude[0]) / self.at <= high


def secants_of(observer: Observer, fitted: Fitted, chosen: tuple[int, ...]) -> list[list[Secant]]:
    """Secants of the chosen effects about a fit, of each at its typical size and then at its probes."""
    wanted = [_places(observer, fitted, k) for k in chosen]
    rows = np.array([row for places in wanted for row in places])
    moved = observer.residuals(np.tile(fitted.vector, (len(rows), 1)), rows)
    ends = np.cumsum([len(places) for places in wanted])[:-1]
    return [
        _secants(observer, fitted, k, np.array(places), residuals)
        for k, places, residuals in zip(chosen, wanted, np.split(moved, ends), strict=True)
    ]


def _places(observer: Observer, fitted: Fitted, k: int) -> list[Floats]:
    """Rows of amplitudes at which an effect's secants are taken: of its components, its probes, its no-size."""
    effect, columns, now = observer.effects[k], observer.columns[k], fitted.amplitudes
    signs = (1.0,) if effect.is_one_sided else (1.0, -1.0)
    steps = [(c, sign * effect.typical) for c in range(columns.start, columns.stop) for sign in signs]
    steps += [(columns.start, sign * probe) for probe in effect.probes for sign in signs]
    rows = [with_amplitude(now, c, np.clip(now[c] + step, effect.low, effect.high)) for c, step in steps]
    if effect.no_size > 0.0:
        rows.append(with_amplitude(now, columns, np.maximum(now[columns], effect.no_size)))
    return rows


def _secants(observer: Observer, fitted: Fitted, k: int, places: Floats, moved: Floats) -> list[Secant]:
    effect, columns = observer.effects[k], observer.columns[k]
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
        # What resists one way only shows on one side: both sides by themselves, and all probes.
        others = range(2 * count + 2 * len(effect.probes)) if effect.probes else range(0)
    return [Secant(np.array(main)), *(alone(n) for n in others if sizes[n] != 0.0)]


def with_amplitude(amplitudes: Floats, columns: slice | int, changed: Floats | float) -> Floats:
    """Return a row of amplitudes, (components,), with those of some columns changed."""
    row = amplitudes.copy()
    row[columns] = changed
    return row


def screen(
    observer: Observer, fitted: Fitted, chosen: tuple[int, ...], rng: np.random.Generator, known: Screened | None = None
) -> Screened:
    """Screen the chosen effects of the library against a fit, whose own effects are projected out like parameters.

    known: the same effects screened against a fit of the same takes, nearby: their signatures there say which are worth
    taking anew, and stand for those of the others.
    """
    # What stopped at the top of its range is no more free to imitate the effect that is more of it.
    stopped = [ended_at(observer, fitted.vector, k) for k in chosen]
    is_free = ~np.isin(np.arange(fitted.jacobian.shape[1]), [place for place in stopped if place is not None])
    jacobian = fitted.jacobian[:, is_free]
    precision = np.diag(Problem(observer, fitted.active, fitted.pinned).prior_sd[is_free] ** -2)
    hat = np.linalg.solve(jacobian.T @ jacobian + precision, jacobian.T)

    def project(rows: Floats) -> Floats:
        return np.asarray(rows - (rows @ jacobian) @ hat)

    rest = project(fitted.residual[None])[0]
    blocks = observer.layout.block
    signs = rng.choice([-1.0, 1.0], size=(REPLICAS, int(blocks.max()) + 1))
    scored, statistic, drawn = [], [], []

    def score(k: int, secants: list[Secant]) -> list[_Scored]:
        """Return those of an effect's secants that hold for the amplitude that they find."""
        every = [(_score(secant, observer.effects[k], project, fitted.residual, rest), secant) for secant in secants]
        return [one for one, secant in every if secant.holds(one.amplitude)]

    tried = {k: score(k, [known.secant(k)]) for k in chosen} if known else {}
    renewed = tuple(sorted(sorted(tried, key=lambda k: -tried[k][0].predicted)[:RENEWED])) if known else chosen
    for k, secants in zip(renewed, secants_of(observer, fitted, renewed), strict=True):
        tried[k] = score(k, secants)
    for k in chosen:
        effect, found = observer.effects[k], tried[k]
        best = max(found, key=lambda one: one.predicted)
        gain = np.zeros((signs.shape[1], len(best.seen)))
        np.add.at(gain, blocks, (best.seen * rest).T)
        meat = gain.T @ gain + 1e-12 * max(float(np.trace(gain.T @ gain)), 1e-30) * np.eye(len(best.seen))
        statistic.append(_statistic(gain.sum(0)[None], meat, effect.is_one_sided)[0])
        drawn.append(_statistic(signs @ gain, meat, effect.is_one_sided))
        scored.append(best)
    p_value, family = _p_values(np.array(statistic), np.array(drawn))
    left = max(float(rest @ rest), 1e-12)
    missed = np.array([rest + one.contribution for one in scored])
    return Screened(
        effects=chosen, amplitude=[one.amplitude for one in scored],
        explained=np.array([one.predicted / left for one in scored]),
        absorbed=np.array([1 - float((o.seen**2).sum()) / max(float((o.raw**2).sum()), 1e-12) for o in scored]),
        p_value=p_value, family_p_value=family, cosines=_cosines(np.array([one.contribution for one in scored])),
        predicted=np.array([one.predicted for one in scored]),
        predicted_mm2=observer.in_mm(rest) ** 2 - observer.in_mm(missed) ** 2,
        correlation=np.array([one.correlation for one in scored]),
        raw=[one.raw for one in scored], projected=[one.seen for one in scored],
        typical=np.array([observer.effects[k].typical for k in chosen]),
    )  # fmt: skip


@dataclass(frozen=True)
class _Scored:
    """What one secant says: its amplitude, (components,), its rows in typical sizes, raw and projected, and their use.

    contribution, (numbers,): what it would explain; predicted: cost that a linear refit would save; correlation:
    multiple, of the residual with the raw rows
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
    alpha = np.asarray(-np.linalg.solve(hessian, total), float)
    if effect.is_one_sided:
        alpha = np.maximum(alpha, 0.0)
    return _Scored(
        amplitude=alpha * effect.typical, raw=raw, seen=seen, contribution=np.asarray(alpha @ seen, float),
        predicted=max(float(-2 * total @ alpha - alpha @ hessian @ alpha), 0.0),
        correlation=_correlation(raw, residual, effect.is_one_sided),
    )  # fmt: skip


def _correlation(rows: Floats, residual: Floats, is_one_sided: bool) -> float:
    """Multiple correlation of a residual, (numbers,), with rows; none where a one-sided effect would have to be off."""
    sums = rows @ residual
    if is_one_sided and sums[0] > 0:
        return 0.0
    inverse = np.linalg.pinv(rows @ rows.T, hermitian=True)
    return float(np.sqrt(max(float(sums @ inverse @ sums), 0.0) / max(float(residual @ residual), 1e-12)))


def _statistic(total: Floats, meat: Floats, is_one_sided: bool) -> Floats:
    """T of block scores summed with signs, (draws, components) -> (draws,); a one-sided one counts only if it fits."""
    value = np.einsum("dc,cd->d", total, np.linalg.solve(meat, total.T))
    return np.where(total[:, 0] < 0, value, -value) if is_one_sided else np.asarray(value)


def _p_values(statistic: Floats, drawn: Floats) -> tuple[Floats, Floats]:
    """Own and family-wise p-values from statistics, (effects,), and draws, (effects, replicas).

    An effect whose draws are all alike moves nothing and is not one of the family.
    """
    replicas = drawn.shape[1]
    # With few blocks the very signs that were seen are drawn again and again: ties, however the sums round.
    own = (1 + (drawn >= (statistic - TIE * np.abs(statistic))[:, None]).sum(1)) / (1 + replicas)
    # p-value of every draw among all draws of its own effect
    order = np.argsort(np.argsort(-drawn[np.ptp(drawn, axis=1) > 0], axis=1), axis=1)
    smallest = ((1 + order) / replicas).min(0, initial=1.0)
    family = (1 + (smallest[None] <= own[:, None]).sum(1)) / (1 + replicas)
    return own, family


def _cosines(rows: Floats) -> Floats:
    """Cosines between rows, (effects, effects); zero rows are alike to none."""
    unit = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    return np.asarray(unit @ unit.T)


def groups(cosines: Floats) -> list[int]:
    """Number the groups of effects whose signatures this data cannot tell apart (complete linkage)."""
    number = list(range(len(cosines)))
    for i in range(len(cosines)):
        for j in range(i):
            members = [k for k in range(len(cosines)) if number[k] == number[j]]
            if all(abs(cosines[i, k]) > GROUP_COSINE for k in members):
                number[i] = number[j]
                break
    return number
