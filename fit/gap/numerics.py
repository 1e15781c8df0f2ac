"""Estimate the discretisation error: the base model on a finer mesh and step, refitted once, on the same motion.

The larger difference between the meshes, refitted or not, also gives the base mesh's distance from a converged one
(`fit.observer.simulation_error`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.gap.closure import BlockErrors, block_errors
from fit.gap.fitting import Fitted, Problem
from fit.observer.residuals import Observer
from fit.observer.simulation_error import finer, mesh_error_mm, with_solver_mm

TRIED_STEPS = (0.0, 0.5, 1.0)  # of the refit's linear step; our choice: none, half and all of it in one batch


@dataclass(frozen=True)
class Refined:
    """Held-out errors on the finer mesh, and the error [mm] of the mesh alone and of mesh and solver.

    ratio: coarse spacing over fine spacing
    """

    errors: BlockErrors
    ratio: float
    mesh_mm: float
    numerics_mm: float


def refine(observer: Observer, judge: Observer, base: Fitted) -> Refined:
    """Refit and judge the base model on a finer mesh."""
    fine, resolution, ratio = finer(observer)
    fine_judge = fine if judge is observer else judge.at_resolution(resolution)
    problem = Problem(fine)
    start = problem.pack(base.vector, base.amplitudes)
    residual = problem.residuals(start[None])[0]
    jacobian = base.jacobian[:, : len(base.vector)]
    normal = jacobian.T @ jacobian + np.diag(problem.prior_sd**-2)
    step = -np.linalg.solve(normal, jacobian.T @ residual)
    logs = fine.parameterisation.is_log
    tries = np.stack(
        [
            np.clip(
                np.where(logs, start * np.exp(np.clip(share * step * logs, -1, 1)), start + share * step * ~logs),
                problem.space.minimum,
                problem.space.maximum,
            )
            for share in TRIED_STEPS
        ]
    )
    costs = (problem.residuals(tries) ** 2).sum(1)
    both = fine_judge.residuals(*problem.unpack(tries[[int(np.argmin(costs)), 0]]))
    apart = both - judge.residuals(base.vector[None], base.amplitudes[None])[0]
    mesh = mesh_error_mm(float(judge.in_mm(apart).max()), ratio)
    return Refined(block_errors(judge, both[0]), ratio, mesh, with_solver_mm(mesh, judge))
