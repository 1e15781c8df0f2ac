"""The combinations that motion identifies with any method: every stiffness over the density, and the dampings.

Every force of the step is divided by the mass (`fit.cloth.rollout`). So motion depends on the material row only through
k/rho, G/rho, B/rho, the two damping times and c. C is the covariance of a fit's parameters theta. g =
d(combination)/d(theta) comes from central differences along the method's own map:

    variance = g' C g,   half width = sqrt(t^2 g' C g + (g . way)^2)

The interval is built as a parameter's (`fit.search.intervals`). A combination is identified under two conditions. The
data shrink its deviation to at most half of the ranges' own. Its 90 % interval ends above 0, for no combination can be
negative. A combination that hangs on one parameter is not identified where that parameter is not. Its interval then
reaches as far as that parameter's, for the slope at a bound tells too little.
A combination that is such a parameter itself has this parameter's own interval.

Source: P. R. Bevington, D. K. Robinson, "Data Reduction and Error Analysis for the Physical Sciences", section 3.2
(propagation of error).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fit.cloth import material as mat
from fit.search.intervals import Intervals
from formats.arrays import Floats, Integers
from formats.fit_records import Combination

NEARBY = 1e-3  # of the range, for the differences
HANGS_ON = 0.9  # of the ranges' own variance of a combination, that one parameter supplies
# Name, unit, column, whether it is divided by the density.
COMBINATIONS = (
    ("stretch stiffness / density", "m2/s2", mat.STRETCH, True),
    ("shear stiffness / density", "m2/s2", mat.SHEAR, True),
    ("bending stiffness / density", "m4/s2", mat.BENDING, True),
    ("bending damping time", "s", mat.BENDING_TIME, False),
    ("velocity damping", "1/s", mat.VELOCITY, False),
)


def combine(rows: Floats) -> Floats:
    """Return the combinations of material rows, (candidates, combinations)."""
    columns = [rows[:, column] / (rows[:, mat.DENSITY] if is_ratio else 1.0) for _, _, column, is_ratio in COMBINATIONS]
    return np.stack(columns, axis=1)


def describe_combinations(
    materials: Callable[[Floats], Floats], initial: Floats, fitted: Floats, reach: Floats, intervals: Intervals
) -> list[Combination]:
    """Return combinations before and after a fit with 90 % intervals, without those that the method holds fixed.

    - `materials`: maps vectors, (candidates, parameters), to material rows
    - `initial`, `fitted`, (parameters,)
    - `reach`, (parameters,): widths of the box at the fit; for a logarithm, its slope times the parameter
    - `intervals`: of the parameters
    """
    step = np.diag(NEARBY * reach)
    ahead, behind = combine(materials(fitted + step)), combine(materials(fitted - step))
    slopes = (ahead - behind) / (2 * NEARBY * reach)[:, None]
    before, after = combine(materials(np.stack([initial, fitted])))
    unknown = np.flatnonzero(~intervals.is_identified)
    at_ends = _at_ends(materials, fitted, intervals, unknown)
    found = []
    for k, (name, unit, _, _) in enumerate(COMBINATIONS):
        slope = slopes[:, k]
        prior = float(np.sqrt(slope**2 @ (reach**2 / 12)))
        if prior == 0.0:
            continue
        deviation = float(np.sqrt(slope @ intervals.covariance @ slope))
        half = float(np.hypot(intervals.spread * deviation, slope @ intervals.way))
        low, high = float(after[k]) - half, float(after[k]) + half
        share = (slope * reach) ** 2 / 12 / prior**2
        hangs_on_unknown = bool((share[~intervals.is_identified] > HANGS_ON).any())
        is_identified = deviation < 0.5 * prior and low > 0.0 and not hangs_on_unknown
        if not is_identified and len(unknown):
            reached = at_ends[..., k][:, slope[unknown] != 0]
            low, high = float(np.min(reached, initial=low)), float(np.max(reached, initial=high))
        alone = np.flatnonzero(slope)
        if len(alone) == 1 and np.isclose(slope[alone[0]], 1.0) and hangs_on_unknown:  # it is that parameter
            low, high = intervals.ends[alone[0]]
        found.append(
            Combination(
                name=name, unit=unit, initial=float(before[k]), fitted=float(after[k]),
                interval_low=max(float(low), 0.0), interval_high=float(high), is_identified=is_identified,
            )
        )  # fmt: skip
    return found


def _at_ends(materials: Callable[[Floats], Floats], fitted: Floats, intervals: Intervals, unknown: Integers) -> Floats:
    """Return the combinations, (2, unknown, combinations), with one unknown parameter at either end of its interval."""
    vectors = np.tile(fitted, (2, len(unknown), 1))
    for end in range(2):
        vectors[end, np.arange(len(unknown)), unknown] = intervals.ends[unknown, end]
    flat = vectors.reshape(-1, len(fitted))
    return combine(materials(flat)).reshape(2, len(unknown), -1) if len(flat) else np.zeros((2, 0, len(COMBINATIONS)))
