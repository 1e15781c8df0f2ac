"""Combinations of parameters that determine the motion: each stiffness over the density, and the dampings.

Every force of the step is divided by the mass (`fit.cloth.rollout`). So motion depends on the material row only through
k/rho, G/rho, B/rho, the two damping times and c. The parameters u are in shares of the box, and have the covariance V.
The slopes g = d ln(combination) / du come from central differences along the method's own map:

    variance = g' V g,   half width of the logarithm = sqrt(t^2 g' V g + (g . way)^2)

The interval ends where the ranges end. A combination is identified by a parameter's rule (`fit.search.intervals`): the
data shrink its deviation to less than half of the ranges' own, g' g / 12. A combination that depends mainly on one
parameter is not identified where that parameter is not. Its interval is then between the values at the ends of that
parameter's interval, because the slope at a bound underestimates it.

A combination of one parameter alone has exactly this parameter's verdict, and the interval between its ends.

Source: P. R. Bevington, D. K. Robinson, "Data Reduction and Error Analysis for the Physical Sciences", section 3.2
(propagation of error).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from fit.cloth import material as mat
from fit.search.intervals import SHARE_IDENTIFIED, Intervals
from fit.search.least_squares import BoundedSpace
from formats.arrays import Floats, Integers
from formats.fit_records import Combination

# Of the range, for the differences. Our choice: central differences err by about the square, 1e-6, and rounding by
# 1e-13. Half and double change no digit that a fit to the demo's takes prints.
NEARBY = 1e-3
# Of the ranges' own variance of a combination's logarithm, that one parameter supplies. Our choice: the others then
# supply at most a third of the deviation. Half and double of the rest were not tried.
DOMINANT = 0.9
LEAST_COMBINATION = 1e-12  # in its unit, far below any cloth's value: the logarithm of a damping of 0 is undefined
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
    materials: Callable[[Floats], Floats], space: BoundedSpace, initial: Floats, fitted: Floats, intervals: Intervals
) -> list[Combination]:
    """Return the combinations before and after a fit with 90 % intervals, except those that the method keeps fixed.

    - `materials`: maps vectors, (candidates, parameters), to material rows
    - `space`: of the parameters
    - `initial`, `fitted`, (parameters,)
    - `intervals`: of the parameters
    """
    reach = space.slope(fitted)
    step = np.diag(NEARBY * reach)
    ahead, behind = (
        np.log(np.maximum(combine(materials(fitted + sign * step)), LEAST_COMBINATION)) for sign in (1, -1)
    )
    slopes = (ahead - behind) / (2 * NEARBY)  # of the logarithms, by shares of the box
    covariance, way = intervals.covariance / np.outer(reach, reach), intervals.way / reach
    before, after = combine(materials(np.stack([initial, fitted])))
    ends = _at_ends(materials, fitted, intervals)
    found = []
    for k, (name, unit, _, _) in enumerate(COMBINATIONS):
        slope = slopes[:, k]
        moved_by = np.flatnonzero(slope)
        if not len(moved_by):
            continue
        prior = slope**2 / 12
        if len(moved_by) == 1:
            alone = moved_by[0]
            low, high = np.sort(ends[:, alone, k])
            is_identified, is_at_bound = bool(intervals.is_identified[alone]), bool(intervals.is_at_bound[alone])
        else:
            variance = float(slope @ covariance @ slope)
            half = float(np.hypot(intervals.spread * np.sqrt(variance), slope @ way))
            every = combine(materials(_corners(space, fitted, moved_by)))[:, k]
            with np.errstate(over="ignore"):  # an end far outside of the ranges becomes their end
                low, high = np.clip(after[k] * np.exp([-half, half]), every.min(), every.max())
            is_dominant = prior > DOMINANT * prior.sum()
            is_dominant_unidentified = bool((is_dominant & ~intervals.is_identified).any())
            is_identified = variance < SHARE_IDENTIFIED**2 * prior.sum() and not is_dominant_unidentified
            is_at_bound = bool((is_dominant & intervals.is_at_bound).any())
            if is_dominant_unidentified:
                low, high = np.sort(ends[:, int(np.argmax(prior)), k])
            elif not is_identified:
                reached = ends[:, ~intervals.is_identified & (slope != 0), k]
                low, high = float(np.min(reached, initial=low)), float(np.max(reached, initial=high))
        found.append(
            Combination(
                name=name, unit=unit, initial=float(before[k]), fitted=float(after[k]), interval_low=float(low),
                interval_high=float(high), is_identified=bool(is_identified), is_at_bound=is_at_bound,
            )
        )  # fmt: skip
    return found


def _at_ends(materials: Callable[[Floats], Floats], fitted: Floats, intervals: Intervals) -> Floats:
    """Return the combinations, (2, parameters, combinations), with one parameter at either end of its interval."""
    count = len(fitted)
    vectors = np.tile(fitted, (2, count, 1))
    vectors[:, np.arange(count), np.arange(count)] = intervals.ends.T
    return combine(materials(vectors.reshape(-1, count))).reshape(2, count, -1)


def _corners(space: BoundedSpace, fitted: Floats, moved: Integers) -> Floats:
    """Return the fit with some parameters at all corners of their ranges, (corners, parameters)."""
    corners = np.array(list(itertools.product((False, True), repeat=len(moved))))
    vectors = np.tile(fitted, (len(corners), 1))
    vectors[:, moved] = np.where(corners, space.maximum[moved], space.minimum[moved])
    return vectors
