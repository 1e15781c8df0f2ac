"""Line A: which effect's signature does the residual of the base fit carry?

With the residual r of the base fit, its Jacobian J and an effect's signature s (change of the residual per unit of
amplitude, taken at the typical size), base parameters are projected out of both:

    P = I - J (J'J + Lambda)^-1 J',   sp = P s,   rp = P r
    alpha = -(sp'rp)/(sp'sp),   explained = (sp'rp)^2 / (sp'sp rp'rp),   absorbed = 1 - |sp|^2 / |s|^2
    T = g / sqrt(sum_b g_b^2),  g_b = sp_b' rp_b over blocks b of half a second

T is judged against its own wild bootstrap (the signs of the blocks' scores drawn at random), and the largest |T| of all
effects against the largest of the bootstrap, which controls the family-wise error under any correlation.
The smallest amplitude that would be found with power 0.8 at level 0.05: (1.645 + 0.842) sd(alpha).
Sources: C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) (score test); P. H. Westfall & S. S. Young, "Resampling-based
multiple testing" (1993), section 2.4 (max-T); A. Mendler, M. Doehler, C. E. Ventura, MSSP 154 (2021) (minimum
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


@dataclass(frozen=True)
class Screened:
    """What the score test says of each effect; all arrays (effects,)."""

    amplitude: Floats
    explained: Floats
    absorbed: Floats
    score: Floats
    p_value: Floats
    minimum_detectable: Floats
    cosines: Floats


def screen(observer: Observer, base: Fitted, rng: np.random.Generator) -> Screened:
    """Screen every effect of the observer against the base fit."""
    effects = observer.effects
    count = len(effects)
    amplitudes = np.diag([e.typical for e in effects])
    both = np.concatenate([amplitudes, -amplitudes]) if any(not e.is_one_sided for e in effects) else amplitudes
    for k, effect in enumerate(effects):
        if effect.is_one_sided and len(both) > count:
            both[count + k] = 0.0
    moved = observer.residuals(np.tile(base.vector, (len(both), 1)), both)
    signatures = np.empty((count, len(base.residual)))
    for k, effect in enumerate(effects):
        if effect.is_one_sided:
            signatures[k] = (moved[k] - base.residual) / effect.typical
        else:
            signatures[k] = (moved[k] - moved[count + k]) / (2 * effect.typical)
    jacobian = base.jacobian[:, : len(base.vector)]
    precision = np.diag(Problem(observer).prior_sd ** -2)
    hat = np.linalg.solve(jacobian.T @ jacobian + precision, jacobian.T)

    def project(rows: Floats) -> Floats:
        return np.asarray(rows - (rows @ jacobian) @ hat)

    squares = (signatures**2).sum(1)
    projected, rest = project(signatures), project(base.residual[None])[0]
    left = np.maximum((projected**2).sum(1), 1e-12)
    pull = projected * rest
    blocks = np.zeros((count, int(observer.layout.block.max()) + 1))
    np.add.at(blocks.T, observer.layout.block, pull.T)
    gain = blocks.sum(1)
    spread = np.sqrt(np.maximum((blocks**2).sum(1), 1e-30))
    score = -gain / spread
    signs = rng.choice([-1.0, 1.0], size=(REPLICAS, blocks.shape[1]))
    drawn = -(signs @ blocks.T) / spread
    one_sided = np.array([e.is_one_sided for e in effects])
    judged = np.where(one_sided, score, np.abs(score))
    largest = np.where(one_sided, drawn, np.abs(drawn)).max(1)
    p_value = (1 + (largest[:, None] >= judged).sum(0)) / (1 + REPLICAS)
    unit = projected / np.sqrt(left)[:, None]
    return Screened(
        amplitude=-gain / left,
        explained=gain**2 / (left * max(float(rest @ rest), 1e-12)),
        absorbed=1 - left / np.maximum(squares, 1e-12),
        score=score,
        p_value=p_value,
        minimum_detectable=DETECTION * spread / left,
        cosines=unit @ unit.T,
    )


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
