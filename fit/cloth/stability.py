"""Upper bound of the highest frequency of a mesh, which limits the stable time step.

Explicit leapfrog with Kelvin-Voigt damping is stable for

    dt < (2 / omega) (sqrt(1 + zeta^2) - zeta),   zeta = omega tau / 2

with the highest frequency omega and the damping ratio zeta. A bound of omega^2 is k lambda_k + G lambda_G + B lambda_B.
Each lambda is the largest eigenvalue of one energy alone on this mesh at unit stiffness and unit density. The maximum
of a sum is at most the sum of the maxima. Stretch viscosity counts as stiffness (`fit.effects.stretch_viscosity`).
Source: T. Belytschko, W. K. Liu, B. Moran, "Nonlinear Finite Elements for Continua and Structures", section 6.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.cloth.mesh import ClothMesh


def unit_frequencies(mesh: ClothMesh) -> tuple[float, float, float]:
    """Return the largest eigenvalues of stretch, shear and bending at unit stiffness and density [m^-2, m^-2, m^-4]."""
    from scipy.sparse import coo_array, hstack, vstack
    from scipy.sparse.linalg import eigsh

    def matrix(weights: Any, columns: Any, rows: Any, shape: tuple[int, int]) -> Any:
        return coo_array((np.ravel(weights), (rows, np.ravel(columns))), shape=shape).tocsr()

    def largest(strain: Any) -> float:
        start = np.random.default_rng(0).standard_normal(strain.shape[1])
        square = (strain.T @ strain).tocsc()
        return float(eigsh(square, 1, which="LA", v0=start, return_eigenvectors=False, tol=1e-3)[0])

    nodes, samples, shears = len(mesh.rest), len(mesh.fibres.area), len(mesh.shear_area)
    scale = 1 / np.sqrt(mesh.node_area)
    lines, plain = mesh.fibres.stencils, mesh.bends.stencils
    fibres = matrix(lines.weights[:, 0] * scale[lines.nodes], lines.nodes, lines.rows(), (samples, nodes))
    stretched = fibres.multiply(np.sqrt(mesh.fibres.area)[:, None]).tocsr()
    fours = np.repeat(np.arange(shears), 4)
    weights = np.sqrt(mesh.shear_area)[:, None] * mesh.shear_weights
    across = matrix(weights[:, :4], mesh.shear_across, fours, (shears, samples)) @ fibres
    down = matrix(weights[:, 4:], mesh.shear_down, fours, (shears, samples)) @ fibres
    bent = matrix(plain.weights[:, 0] * scale[plain.nodes], plain.nodes, plain.rows(), (len(plain), nodes))
    bends = [bent]
    if len(mesh.bends.twist_weights):
        bends.append(matrix(mesh.bends.twist_weights, mesh.shear_across, fours, (shears, samples)) @ fibres)
    count = mesh.fibres_across
    return (
        max(largest(stretched[:count]), largest(stretched[count:])),
        largest(hstack([down, across])),  # in the plane, x couples to slopes down the cloth, y to slopes across
        largest(vstack(bends)),
    )
