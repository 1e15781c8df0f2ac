"""Choose starts of further descents in neighbouring local minima, from the end of one descent.

Stretch and shear are nearly collinear, and folds ripple the cost between their local minima. So descents may agree in
the wrong local minimum. Take an end u, in shares of the box. Each parameter k moves alone by s, up to 0.45 of its
range. The other parameters follow the floor of the linear model's valley, with H = J'J + prior:

    u_k + s,   u_o - H_oo^-1 H_ok s

The candidates of least cost are the next starts. A parameter that the data determine closely or not at all is not
displaced.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Floats

# Of a parameter's range: displacements of one parameter. Our choice: from the middle they reach nearly both ends, in
# steps of three `fit.search.least_squares.DIFFERENCE`. With half, two fits to the demo's takes have the same errors,
# after 526 and 386 simulations in place of 388 and 376.
HOPS = (-0.45, -0.3, -0.15, 0.15, 0.3, 0.45)
HOPPED = 2  # returned candidates at most; our choice: each costs a descent, two is one on each side of a valley
# Of the cost, by the slope, at the nearest displacement: below, the data do not determine the parameter; above, they
# determine it closely. Our choice: a thousandth and 1.7 times in the error. Half and double change nothing in that fit.
LEAST_RISE, MOST_RISE = 0.002, 2.0


def across(
    unit: Floats, jacobian: Floats, precision: Floats, cost: float, moved: int, judge: Callable[[Floats], Floats]
) -> Floats:
    """Return starts in local minima around a descent's end, (starts, parameters), at most HOPPED, least cost first.

    - `unit`, (parameters,): the end
    - `jacobian`, (numbers, parameters), per share of the box
    - `precision`, (parameters, parameters): the prior's
    - `cost`: of the end
    - `moved`: number of parameters, counted from the first, that are displaced one at a time
    - `judge`: returns the costs, (candidates,), of candidates, (candidates, parameters); called once or never
    """
    normal = jacobian.T @ jacobian + precision
    candidates: list[Floats] = []
    directions: list[tuple[int, bool]] = []
    for k in range(moved):
        others = np.arange(len(unit)) != k
        along = np.eye(len(unit))[k]
        along[others] = -np.linalg.solve(normal[np.ix_(others, others)], normal[others, k])
        rise = min(np.abs(HOPS)) ** 2 * float(along @ normal @ along) / cost
        if LEAST_RISE < rise < MOST_RISE:
            steps = [step for step in HOPS if 0.0 <= unit[k] + step <= 1.0]
            candidates += [np.clip(unit + step * along, 0.0, 1.0) for step in steps]
            directions += [(k, step > 0) for step in steps]
    if not candidates:
        return np.zeros((0, len(unit)))
    found = np.array(candidates)
    best: dict[tuple[int, bool], int] = {}
    for n in np.argsort(judge(found), kind="stable"):
        best.setdefault(directions[n], int(n))
    return found[list(best.values())[:HOPPED]]
