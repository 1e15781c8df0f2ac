"""Faster sums over an element's lines of four nodes, for threads along these lines, by symmetry.

A line has three samples of its fibre, at its Gauss points. The samples' weights are the slopes D of the shape functions
over the line's length. Nodes and points are symmetric about the middle. Use the differences d_o = y_3 - y_0, d_i = y_2
- y_1 and the sums s_o = y_0 + y_3, s_i = y_1 + y_2:
    slope, middle         D_13 d_o + D_12 d_i
    slopes, first, last   (D_03 + D_23)/2 d_o + (D_02 + D_22)/2 d_i  -/+  (D_20 - D_00)/2 (s_o - s_i)
These are five products; three sums over four nodes have twelve. The same holds for values B between samples, for shear,
and for second derivatives C at the two inner nodes, for bends:
    value, middle         B_10 s_o + B_11 s_i
    values, first, last   (B_00 + B_20)/2 s_o + (B_01 + B_21)/2 s_i  -/+  ((B_23 - B_03)/2 d_o + (B_22 - B_02)/2 d_i)
    curvatures            (C_00 + C_10)/2 (s_o - s_i)  -/+  ((C_13 - C_03)/2 d_o + (C_12 - C_02)/2 d_i)
Source: A. Solomonoff, "A fast algorithm for spectral differentiation", J. Comput. Phys. 98 (1992).
"""

from __future__ import annotations

import numpy as np

from fit.cloth import spectral
from fit.cloth.mesh import ClothMesh
from formats.arrays import Indices, Singles

IN_LINES = 0  # instead of a number of nodes: samples or bends are evaluated by lines
LINE_ENTRIES = 5  # entries of a line in the arrays of weights and nodes; the last node entry is unused
SAME_WITHIN = 1e-6  # of the largest weight: tolerance of rounding errors

D, B = (of(spectral.gauss(spectral.POLYNOMIAL_ORDER)[0]) for of in (spectral.slopes, spectral.values))
C = spectral.curvatures(spectral.LOBATTO_NODES[1:3])
ENDS, BEGINS = [3, 2], [0, 1]  # outer and inner node
UNIT_SLOPES = tuple(map(float, (*D[1, ENDS], *(D[0, ENDS] + D[2, ENDS]) / 2, (D[2, 0] - D[0, 0]) / 2)))
VALUES = tuple(map(float, (*B[1, BEGINS], *(B[0, BEGINS] + B[2, BEGINS]) / 2, *(B[2, ENDS] - B[0, ENDS]) / 2)))
CURVATURES = tuple(map(float, ((C[0, 0] + C[1, 0]) / 2, *(C[1, ENDS] - C[0, ENDS]) / 2)))
BETWEEN = B.astype(np.float32).ravel()


def fibre_family(mesh: ClothMesh, family: int) -> tuple[int, Indices, Singles]:
    """Return the fibres across (0) or down (1) for the kernel: nodes a sample or `IN_LINES`, nodes, weights."""
    stencils, count = mesh.fibres.stencils, mesh.fibre_nodes[family]
    chosen = slice(None, mesh.fibres_across) if family == 0 else slice(mesh.fibres_across, None)
    at = stencils.first[:-1][chosen, None] + np.arange(count)
    nodes, weights = stencils.nodes[at], stencils.weights[at, 0]
    if count == spectral.NODES_ALONG_ELEMENT and len(nodes) % spectral.POLYNOMIAL_ORDER == 0:
        lines = nodes.reshape(-1, spectral.POLYNOMIAL_ORDER, count)
        slopes = weights.reshape(lines.shape)
        scale = slopes[:, :1, :1] / D[0, 0]
        if (lines == lines[:, :1]).all() and (np.abs(slopes - scale * D) < SAME_WITHIN * np.abs(scale)).all():
            filled = np.concatenate([lines[:, 0], lines[:, 0, :1]], axis=1)
            return IN_LINES, filled.ravel(), (scale[:, 0] * np.array(UNIT_SLOPES)).astype(np.float32).ravel()
    return count, nodes.ravel(), weights.astype(np.float32).ravel()


def twist_scales(mesh: ClothMesh) -> Singles:
    """Return each twist's weights over the unit slopes at the same point of the element, (twists,)."""
    weights = mesh.bends.twist_weights.reshape(-1, spectral.POLYNOMIAL_ORDER, spectral.NODES_ALONG_ELEMENT)
    return np.asarray(weights[:, :, 0] / D[:, 0], np.float32).ravel()


def bends_by_line(mesh: ClothMesh) -> tuple[tuple[int, ...], Singles]:
    """Return the bends for the kernel: their lengths, with `IN_LINES` for pairs in lines, and weights.

    A pair is the two second derivatives at the inner nodes of a line of four nodes. The first weight of each is its
    ratio to the unit curvature there; the other weights are unused.
    """
    bends, weights = mesh.bends, mesh.bends.stencils.weights[:, 0].copy()
    count = int(bends.counts[0])
    pairs = np.s_[: count * spectral.NODES_ALONG_ELEMENT]
    if count and count % 2 == 0:
        nodes, kind = (
            bends.stencils.nodes[pairs].reshape(-1, 2, spectral.NODES_ALONG_ELEMENT),
            bends.kind[:count].reshape(-1, 2),
        )
        curved = weights[pairs].reshape(nodes.shape)
        scale = curved[:, :, :1] / C[:, :1]
        fits = (np.abs(curved - scale * C) < SAME_WITHIN * np.abs(scale)).all()
        if fits and (nodes[:, 0] == nodes[:, 1]).all() and (kind[:, 0] == kind[:, 1]).all():
            curved[:, :, :1] = scale
            weights[pairs] = curved.ravel()
            return (IN_LINES, *bends.lengths[1:]), weights.astype(np.float32)
    return bends.lengths, weights.astype(np.float32)
