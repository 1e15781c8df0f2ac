"""Smoothing splines through noisy frames, with a given cut-off frequency or one chosen by cross-validation.

`smoothing_spline` is a cubic f that minimises sum_k (y_k - f(t_k))^2 + lambda integral f''^2 dt. The spline is a
low-pass 1 / (1 + (lambda / rate) omega^4). A chosen cut-off sets lambda.

`steady_spline` drives a simulation. Cloth answers to acceleration, so the path must be smooth in its acceleration. The
spline consists of B-splines of the fifth degree with a knot at every frame, a time h apart. Their coefficients a
minimise

    |y - B a|^2 + lambda |D a|^2,   D third differences: a low-pass H(w) = 1 / (1 + lambda d(w) / b(w)),
    d = (2 sin(w h / 2))^6,   b = ((66 + 52 cos w h + 2 cos 2 w h) / 120)^2,   lambda = b(2 pi f_c) / d(2 pi f_c)

with the splines' values b at the knots. The low-pass is close to 1 / (1 + (f / f_c)^6). Generalised cross-validation
chooses one cut-off f_c for all columns together,

    min  |y - f|^2 / (1 - tr H / n)^2,   tr H = sum_k H(pi k / (n h)), k = 0 to n - 1

Here tr H is that of evenly spaced frames, whose eigenvectors are cosines of k half turns. On takes of a hand at 30 to
60 frames a second the cut-off is 3 to 6 Hz, lower for more noise. `benchmarks/hanger_noise.py` measures the effect of
the path's noise on cloth, through either spline.

Sources: P. J. Green & B. W. Silverman, "Nonparametric Regression and Generalized Linear Models" (1994), section 2.2; B.
W. Silverman, Ann. Statist. 12 (1984) (transfer function); P. H. C. Eilers & B. D. Marx, Statistical Science 11 (1996)
(penalised B-splines); P. Craven & G. Wahba, Numerische Mathematik 31 (1979) (cross-validation).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from formats.arrays import Floats

CUT_OFF = 6.0  # Hz of the cubic splines; hands swing below 2 Hz
CUT_OFF_SHARE = 0.4  # of the frame rate, just below what frames can show
LOWEST_CUT_OFF = 2.0  # Hz: the motion of a hand stays below
DEGREE, DIFFERENCE_ORDER = (
    5,
    3,
)  # degree of the steady splines, and order of the penalised differences, as in the formulas


def smoothing_spline(time: Floats, values: Floats, cut_off: float = CUT_OFF) -> Any:
    """Cubic smoothing spline of `values`, (n, k), with a cut-off [Hz]; called with instants, (m,), it gives (m, k)."""
    from scipy.interpolate import make_smoothing_spline

    rate = (len(time) - 1) / (time[-1] - time[0])
    omega = 2 * np.pi * min(cut_off, CUT_OFF_SHARE * rate)
    return make_smoothing_spline(time, values, lam=rate / omega**4)


def low_pass(time: Floats, values: Floats, cut_off: float) -> Floats:
    """Low-pass filter `values`, (frames, ...), at the cut-off [Hz], with the same filter for every column."""
    columns = values.reshape(len(time), -1)
    return np.asarray(smoothing_spline(time, columns, cut_off)(time)).reshape(values.shape)


def steady_spline(time: Floats, values: Floats, cut_off: float) -> Any:
    """Return a spline of `values`, (n, k), at `time` [s], (n,), with smooth acceleration and a cut-off [Hz].

    Called with instants between the first and the last, (m,), it gives (m, k).
    """
    from scipy.interpolate import BSpline

    knots, basis, bands = _penalised(time)
    return BSpline(knots, _coefficients(time, basis, bands, values, cut_off), DEGREE)


def best_cut_off(time: Floats, values: Floats) -> float:
    """Return the cut-off [Hz] of a steady spline of `values`, (n, k), by generalised cross-validation."""
    from scipy.optimize import minimize_scalar

    _, basis, bands = _penalised(time)
    count, rate = len(time), (len(time) - 1) / (time[-1] - time[0])
    turns = np.pi * np.arange(count) / count

    def score(logarithm: float) -> float:
        cut_off = float(np.exp(logarithm))
        left = values - basis @ _coefficients(time, basis, bands, values, cut_off)
        trace = float((1 / (1 + _weight(cut_off, rate) / _weight_at(turns))).sum())
        return float(np.log((left**2).sum() + 1e-30) - 2 * np.log(1 - trace / count))

    highest = max(CUT_OFF_SHARE * rate, 1.01 * LOWEST_CUT_OFF)
    found = minimize_scalar(score, bounds=(np.log(LOWEST_CUT_OFF), np.log(highest)), method="bounded")
    return float(np.exp(found.x))


def _penalised(time: Floats) -> tuple[Floats, Any, tuple[Floats, Floats]]:
    """Return knots, the sparse basis matrix at the frames, and the upper bands of B'B and D'D."""
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array, diags_array

    every = max(round((time[-1] - time[0]) / float(np.median(np.diff(time)))), 2 * DEGREE)
    step = (time[-1] - time[0]) / every
    knots = time[0] + step * np.arange(-DEGREE, every + DEGREE + 1)
    # Rounding may place the last frame beyond the last valid knot.
    basis = BSpline.design_matrix(np.clip(time, knots[DEGREE], knots[-DEGREE - 1]), knots, DEGREE)
    size = basis.shape[1]
    signs = np.array([-1.0, 3.0, -3.0, 1.0])
    differences = csr_array(
        diags_array(signs, offsets=range(DIFFERENCE_ORDER + 1), shape=(size - DIFFERENCE_ORDER, size))
    )
    squares = (csr_array(basis.T @ basis), csr_array(differences.T @ differences))
    return knots, basis, (_bands(squares[0]), _bands(squares[1]))


def _bands(square: Any) -> Floats:
    """Upper bands of a symmetric sparse matrix as `scipy.linalg.solveh_banded` takes them, (DEGREE + 1, size)."""
    size = square.shape[0]
    bands = np.zeros((DEGREE + 1, size))
    for k in range(DEGREE + 1):
        bands[DEGREE - k, k:] = square.diagonal(k)
    return bands


def _coefficients(time: Floats, basis: Any, bands: tuple[Floats, Floats], values: Floats, cut_off: float) -> Floats:
    """The spline's coefficients, (size, k)."""
    from scipy.linalg import solveh_banded

    rate = (basis.shape[1] - DEGREE) / (time[-1] - time[0])
    return np.asarray(solveh_banded(bands[0] + _weight(cut_off, rate) * bands[1], basis.T @ values))


def _weight(cut_off: float, rate: float) -> float:
    """Return the lambda whose low-pass halves motion at the cut-off [Hz]."""
    return float(_weight_at(np.array(2 * np.pi * cut_off / rate)))


def _weight_at(turns: Floats) -> Floats:
    """Return the lambda that halves waves of a phase step [rad] per knot, (n,): b / d in the module's formulas."""
    values = (66 + 52 * np.cos(turns) + 2 * np.cos(2 * turns)) / 120
    differences = (2 * np.sin(turns / 2)) ** (2 * DIFFERENCE_ORDER)
    return np.asarray(values**2 / np.maximum(differences, 1e-30))


def noise_of(values: Floats) -> float:
    """Return the deviation of white noise in a smooth, evenly sampled column, from its sixth differences.

    White noise of deviation s has sixth differences of deviation sqrt(924) s. A flutter of 20 mm at 3 Hz and 30 frames
    a second adds less than 0.1 mm. The median ignores jumps.
    """
    sixth = np.diff(values, 6)
    return float(np.median(np.abs(sixth)) / 0.6745 / np.sqrt(924.0))
