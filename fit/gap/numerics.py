"""Estimate the discretisation error: the base model on a finer mesh and step, refitted once, on the same motion.

The larger difference between the meshes, refitted or not, also gives the base mesh's distance from a converged one. The
error falls with the square of the spacing h. For meshes whose spacings stand as q to 1,

    x_h - x_0 = (x_h - x_{h/q}) / (1 - 1/q^2)

A mesh has whole elements, so q comes from the two meshes and not from the request.

Two converged solvers of the same fabric still differ, by Poisson's ratio and the spread of damping. A share of the
motion stands for this difference. The share was chosen on takes of an independent generator without any effect. No
published figure rests on these takes.
Source: P. J. Roache, "Verification and Validation in Computational Science and Engineering" (1998), section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth.model import Resolution
from fit.gap.closure import BlockErrors, block_errors
from fit.gap.fitting import Fitted, Problem
from fit.observer.residuals import Observer

# Of the mesh spacing, as requested. Our choice: 3.4 times the work; the difference is then 0.56 of the error
# of the base mesh, by the equation above. At 1.2 it is 0.31 of it; at 3, 0.89 for 27 times the work.
REFINEMENT = 1.5
# Actual ratio at least: where whole elements give less, a finer mesh is requested (decision 29). Our choice: the
# difference is then 0.41 of the error.
LEAST_REFINEMENT = 1.3
REFINING_FACTOR = 1.1  # factor of each further request; our choice: small, so that no request is much finer than needed
SOLVER_SHARE = 0.015  # of the motion: sound solvers of one cloth differ; chosen on takes without any effect, as above
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
    old = observer.resolution
    resolution = Resolution(spacing=old.spacing / REFINEMENT, step_share=old.step_share)
    while (fine := observer.at_resolution(resolution)).mesh.spacing * LEAST_REFINEMENT > observer.mesh.spacing:
        resolution = Resolution(spacing=resolution.spacing / REFINING_FACTOR, step_share=old.step_share)
    ratio = observer.mesh.spacing / fine.mesh.spacing
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
    mesh = float(judge.in_mm(apart).max()) / (1.0 - ratio**-2)
    numerics = float(np.hypot(mesh, SOLVER_SHARE * motion_mm(judge)))
    return Refined(block_errors(judge, both[0]), ratio, mesh, numerics)


def motion_mm(judge: Observer) -> float:
    """Return the root mean square distance of the judged points from their mean positions [mm]."""
    squares, count = 0.0, 0
    for recording in judge.recordings:
        seen = recording.counted
        apart = np.where(seen[..., None], recording.points, np.nan)
        apart = apart[:, seen.any(0)]
        apart = apart - np.nanmean(apart, axis=0)
        squares += float(np.nansum(apart**2))
        count += int(seen.sum())
    return 1e3 * float(np.sqrt(squares / max(count, 1)))
