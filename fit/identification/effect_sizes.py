"""90 % intervals of effects' sizes in a fit, by the rule of the diagnosis.

The intervals of a search hold if model and mesh are right (`fit.search.intervals`). An effect's size is compared with
other solvers and with nature. So its interval also covers the error of mesh and solver, and the spread of sound laws
(`fit.observer.simulation_error`). All parts are independent, so their squares add up.

    half width = sqrt(search^2 + mesh and solver^2 + laws^2)

Each parameter moves once by a twentieth of its box from the search's result. So the motion m per unit of an amplitude
is known beyond what the other parameters imitate. The result is simulated once on a finer mesh. Where one of these
simulations blows up, the interval of every size is its whole range.
"""

from __future__ import annotations

import numpy as np

from fit.identification.request import Request
from fit.observer.residuals import Observer
from fit.observer.simulation_error import finer, mesh_error_mm, with_solver_mm, wrong_by_law, wrong_by_mesh
from fit.recordings.recording import Recording
from fit.search.intervals import PRIOR_SD, Intervals, widened
from fit.search.least_squares import DIFFERENCE
from formats.arrays import Floats


def with_sizes(
    recordings: list[Recording], request: Request, best: Floats, intervals: Intervals
) -> tuple[Intervals, int]:
    """Return a search's intervals with those of the effects' sizes widened, and the number of simulations.

    best, (parameters,): the search's result
    """
    if not request.effects:
        return intervals, 0
    observer = Observer(recordings, request.method, request.effects, frequency=0.0, resolution=request.resolution)
    more = half_widths(observer, request, best)
    return widened(request.space, intervals, best, more), observer.simulations


def half_widths(observer: Observer, request: Request, best: Floats) -> Floats:
    """Return half widths of 90 % intervals due to mesh, solver and laws, (parameters,); 0 for the method's own."""
    space, count = request.space, len(request.method.parameters)
    unit = space.to_unit(best)
    step = np.where(unit + DIFFERENCE <= 1, DIFFERENCE, -DIFFERENCE)
    candidates = space.from_unit(np.concatenate([unit[None], unit + np.diag(step)]))
    residuals = _sound(observer, candidates, count)
    rows = (residuals[1:] - residuals[0]) / step[:, None]
    fine, _, ratio = finer(observer)
    apart = float(observer.in_mm(_sound(fine, best[None], count)[0] - residuals[0]))
    numerics = with_solver_mm(mesh_error_mm(apart, ratio), observer)
    more, slope, place = np.zeros(len(best)), space.slope(best), count
    is_sound = np.isfinite(numerics) and np.isfinite(rows).all()
    for effect in request.effects:
        for k in range(place, place + len(effect.components)):
            moved = float(observer.in_mm(_beyond_others(rows, k))) / slope[k] if is_sound else 0.0
            wrong = wrong_by_mesh(numerics, 1 / max(moved, 1e-12)) if is_sound else np.inf
            more[k] = np.hypot(wrong, wrong_by_law(effect.law_spread, best[k]))
        place += len(effect.components)
    return more


def _sound(observer: Observer, vectors: Floats, count: int) -> Floats:
    points = observer.trajectories(vectors[:, :count], vectors[:, count:])
    return observer.sound_residuals_of(points)


def _beyond_others(rows: Floats, k: int) -> Floats:
    """Return the part of one row, (parameters, numbers), that the other rows do not imitate, with the box as prior."""
    others = np.delete(rows, k, axis=0)
    hessian = others @ others.T + np.eye(len(others)) / PRIOR_SD**2
    return np.asarray(rows[k] - np.linalg.solve(hessian, others @ rows[k]) @ others)
