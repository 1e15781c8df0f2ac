"""Error of mesh and solver, and what it does to the size of an effect.

The difference between two meshes of the same model gives the distance of the coarser one from a converged one. The
error falls with the square of the spacing h. For meshes whose spacings stand as q to 1,

    x_h - x_0 = (x_h - x_{h/q}) / (1 - 1/q^2)

A mesh has whole elements, so q comes from the two meshes and not from the request.

Two converged solvers of the same fabric still differ, by Poisson's ratio and the spread of damping. A share of the
motion stands for this difference. The share was chosen on takes of an independent generator without any effect. No
published figure rests on these takes.

The error has the mean square N^2 and a random direction among FREE_DIRECTIONS of a smooth motion. An effect moves the
points by m per unit, beyond what the other parameters imitate. Then the error moves the effect's size by a deviation of

    N / (sqrt(FREE_DIRECTIONS) m)

Source: P. J. Roache, "Verification and Validation in Computational Science and Engineering" (1998), section 5.5.
"""

from __future__ import annotations

import numpy as np

from fit.cloth.model import Resolution
from fit.observer.residuals import Observer
from formats.arrays import Floats
from formats.nature import NORMAL_90

# Degrees of freedom in space of a smooth error; chosen on amplitudes fitted to takes without any effect.
FREE_DIRECTIONS = 9
# Of the mesh spacing, as requested. Our choice: 3.4 times the work; the difference is then 0.56 of the error
# of the base mesh, by the equation above. At 1.2 it is 0.31 of it; at 3, 0.89 for 27 times the work.
REFINEMENT = 1.5
# Actual ratio at least: where whole elements give less, a finer mesh is requested (decision 29). Our choice: the
# difference is then 0.41 of the error.
LEAST_REFINEMENT = 1.3
REFINING_FACTOR = 1.1  # factor of each further request; our choice: small, so that no request is much finer than needed
SOLVER_SHARE = 0.015  # of the motion: sound solvers of one cloth differ; chosen on takes without any effect, as above


def finer(observer: Observer) -> tuple[Observer, Resolution, float]:
    """Return the observer on a finer mesh, the finer resolution, and the coarse spacing over the fine one."""
    old = observer.resolution
    resolution = Resolution(spacing=old.spacing / REFINEMENT, step_share=old.step_share)
    while (fine := observer.at_resolution(resolution)).mesh.spacing * LEAST_REFINEMENT > observer.mesh.spacing:
        resolution = Resolution(spacing=resolution.spacing / REFINING_FACTOR, step_share=old.step_share)
    return fine, resolution, observer.mesh.spacing / fine.mesh.spacing


def mesh_error_mm(apart_mm: float, ratio: float) -> float:
    """Return the error [mm] of the coarser of two meshes, from the distance between both and their spacings' ratio."""
    return apart_mm / (1.0 - ratio**-2)


def with_solver_mm(mesh_mm: float, observer: Observer) -> float:
    """Return the error [mm] of mesh and solver, from the mesh's."""
    return float(np.hypot(mesh_mm, SOLVER_SHARE * motion_mm(observer)))


def wrong_by_mesh(numerics_mm: float, size_per_millimetre: float) -> float:
    """Return half the 90 % interval of a size due to an error of mesh and solver [mm], in the effect's unit."""
    return NORMAL_90 * numerics_mm * size_per_millimetre / float(np.sqrt(FREE_DIRECTIONS))


def wrong_by_law(law_spread: float, size: Floats | float) -> Floats:
    """Return half the 90 % interval of a size due to the spread of an effect's sound laws, in the effect's unit."""
    return np.asarray(NORMAL_90 * law_spread * np.abs(size))


def motion_mm(observer: Observer) -> float:
    """Return the root mean square distance of the judged points from their mean positions [mm]."""
    squares, count = 0.0, 0
    for recording in observer.recordings:
        seen = recording.counted
        apart = np.where(seen[..., None], recording.points, np.nan)
        apart = apart[:, seen.any(0)]
        apart = apart - np.nanmean(apart, axis=0)
        squares += float(np.nansum(apart**2))
        count += int(seen.sum())
    return 1e3 * float(np.sqrt(squares / max(count, 1)))
