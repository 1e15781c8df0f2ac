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
touch anything (`Effect.no_size`), so that they are nothing where nothing touches.
The smallest amplitude that would be found with power 0.8 at level 0.05 is (1.645 + 0.842) sd(alpha), with block scores
of what the best hypothesis leaves: a gap that is explained is no noise.
Sources: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) (score test); P. H. Westfall & S. S. Young, "Resampling-based
multiple testing" (1993), section 2.4 (min-p); A. Mendler, M. Doehler, C. E. Ventura, MSSP 154 (2021) (minimum
detectable change).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.gap.fitting import Fitted, Problem
from fit.gap.observer import Observer

Floats = NDArray[np.float64]

REPLICAS = 2000
DETECTION = 1.645 + 0.842  # one-sided 5 % and power 80 %
GROUP_COSINE = 0.9  # signatures closer than this cannot be told apart
SECANT = 1.0  # typical sizes at which signatures are taken


@dataclass(frozen=True)
class Screened:
    """What the score test says of each screened effect.

    effects: their indices in the library; amplitude: per effect its vector, (components,)
    explained, absorbed, p_value (own), family_p_value: (screened,)
    projected: per effect its projected signatures in typical sizes, (components, numbers); typical, (screened,)
    cosines, (screened, screened): of what each effect alone would explain of the residual
    correlation: multiple, of the residual with the signatures as they are, nothing projected out, (screened,)
    raw: per effect its signatures in typical sizes, (components, numbers), columns of a joint Jacobian
    predicted: cost that a linear refit would save, (screened,)
    """

    effects: tuple[int, ...]
    amplitude: list[Floats]
    explained: Floats
    absorbed: Floats
    p_value: Floats
    family_p_value: Floats
    cosines: Floats
    predicted: Floats
    correlation: Floats
    raw: list[Floats]
    projected: list[Floats]
    typical: Floats

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


def signatures_of(observer: Observer, fitted: Fitted, chosen: tuple[int, ...]) -> list[Floats]:
    """Change of the residual per unit of each component of the chosen effects, each (components, numbers)."""
    rows = []
    references: dict[int, int] = {}
    for k in chosen:
        effect, columns = observer.effects[k], observer.columns[k]
        for column in range(columns.start, columns.stop):
            for sign in (1.0,) if effect.is_one_sided else (1.0, -1.0):
                moved_to = fitted.amplitudes[column] + sign * SECANT * effect.typical
                rows.append(with_amplitude(fitted.amplitudes, column, np.clip(moved_to, effect.low, effect.high)))
        if effect.no_size > 0.0:
            references[k] = len(rows)
            rows.append(
                with_amplitude(fitted.amplitudes, columns, np.maximum(fitted.amplitudes[columns], effect.no_size))
            )
    moved = observer.residuals(np.tile(fitted.vector, (len(rows), 1)), np.array(rows))
    found, at = [], 0
    for k in chosen:
        effect, columns = observer.effects[k], observer.columns[k]
        parts = []
        for column in range(columns.start, columns.stop):
            if effect.is_one_sided:
                before = moved[references[k]] if k in references else fitted.residual
                parts.append((moved[at] - before) / (rows[at][column] - fitted.amplitudes[column]))
                at += 1
            else:
                parts.append((moved[at] - moved[at + 1]) / (rows[at][column] - rows[at + 1][column]))
                at += 2
        at += k in references
        found.append(np.array(parts))
    return found


def with_amplitude(amplitudes: Floats, columns: slice | int, changed: Floats | float) -> Floats:
    """Return a row of amplitudes, (components,), with those of some columns changed."""
    row = amplitudes.copy()
    row[columns] = changed
    return row


def screen(observer: Observer, fitted: Fitted, chosen: tuple[int, ...], rng: np.random.Generator) -> Screened:
    """Screen the chosen effects of the library against a fit, whose own effects are projected out like parameters."""
    signatures = signatures_of(observer, fitted, chosen)
    jacobian = fitted.jacobian
    precision = np.diag(Problem(observer, fitted.active).prior_sd ** -2)
    hat = np.linalg.solve(jacobian.T @ jacobian + precision, jacobian.T)

    def project(rows: Floats) -> Floats:
        return np.asarray(rows - (rows @ jacobian) @ hat)

    rest = project(fitted.residual[None])[0]
    blocks = observer.layout.block
    signs = rng.choice([-1.0, 1.0], size=(REPLICAS, int(blocks.max()) + 1))
    amplitude, statistic, drawn, contributions, raw = [], [], [], [], []
    explained, absorbed, predicted, correlation = (np.zeros(len(chosen)) for _ in range(4))
    kept = []
    for n, (k, rows) in enumerate(zip(chosen, signatures, strict=True)):
        typical = observer.effects[k].typical
        scaled = rows * typical
        seen = project(scaled)
        ridge = 1e-9 * max(float((scaled**2).sum()), 1e-12) * np.eye(len(rows))
        hessian = seen @ seen.T + ridge
        gain = np.zeros((signs.shape[1], len(rows)))
        np.add.at(gain, blocks, (seen * rest).T)
        total = gain.sum(0)
        alpha = -np.linalg.solve(hessian, total)
        if observer.effects[k].is_one_sided:
            alpha = np.maximum(alpha, 0.0)
        amplitude.append(alpha * typical)
        predicted[n] = max(float(-2 * total @ alpha - alpha @ hessian @ alpha), 0.0)
        explained[n] = predicted[n] / max(float(rest @ rest), 1e-12)
        absorbed[n] = 1 - float((seen**2).sum()) / max(float((scaled**2).sum()), 1e-12)
        correlation[n] = _correlation(scaled, fitted.residual, observer.effects[k].is_one_sided)
        meat = gain.T @ gain + 1e-12 * max(float(np.trace(gain.T @ gain)), 1e-30) * np.eye(len(rows))
        one_sided = observer.effects[k].is_one_sided
        statistic.append(_statistic(total[None], meat, one_sided)[0])
        drawn.append(_statistic(signs @ gain, meat, one_sided))
        kept.append(seen)
        contributions.append(alpha @ seen)
        raw.append(scaled)
    p_value, family = _p_values(np.array(statistic), np.array(drawn))
    return Screened(
        effects=chosen, amplitude=amplitude, explained=explained, absorbed=absorbed, p_value=p_value,
        family_p_value=family, cosines=_cosines(np.array(contributions)), predicted=predicted,
        correlation=correlation, raw=raw, projected=kept,
        typical=np.array([observer.effects[k].typical for k in chosen]),
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
    own = (1 + (drawn >= statistic[:, None]).sum(1)) / (1 + replicas)
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
