"""Detect intersections of the cloth with itself and of line segments with triangles.

Source: T. Moeller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2 (1997).
"""

from __future__ import annotations

import numpy as np

from fit.cloth.contact import Surface
from formats.arrays import Booleans, Floats


def crossings(surface: Surface, nodes: Floats) -> int:
    """Return the number of quad edges that pierce quads far away along the cloth; nodes [m], (nodes, 3)."""
    from scipy.spatial import cKDTree

    y, quads = surface.samples.apply(nodes), surface.quads
    triangles = np.concatenate([quads[:, [0, 2, 3]], quads[:, [0, 3, 1]]])
    edges = np.unique(np.sort(np.concatenate([quads[:, p] for p in ([0, 1], [0, 2], [1, 3], [2, 3])]), axis=1), axis=0)
    middles, centres = y[edges].mean(1), y[triangles].mean(1)
    reach = np.linalg.norm(y[edges[:, 0]] - middles, axis=1).max()
    reach += np.linalg.norm(y[triangles] - centres[:, None], axis=2).max()
    near = cKDTree(middles).sparse_distance_matrix(cKDTree(centres), reach, output_type="coo_matrix")
    edge, triangle = edges[near.row], triangles[near.col]
    quad = near.col % len(quads)
    is_far = surface.may_meet[edge[:, 0], quad] & surface.may_meet[edge[:, 1], quad]
    edge, triangle = edge[is_far], triangle[is_far]
    return int(pierces(y[edge[:, 0]], y[edge[:, 1]], y[triangle]).sum())


def pierces(start: Floats, end: Floats, corners: Floats) -> Booleans:
    """Return which segments from start to end [m], (n, 3), pierce the triangles of the same rows [m], (n, 3, 3)."""
    way, corner = end - start, corners[:, 0]
    one, two = corners[:, 1] - corner, corners[:, 2] - corner
    p = np.cross(way, two)
    scale = (one * p).sum(1)
    inverse = 1 / np.where(np.abs(scale) < 1e-14, np.inf, scale)
    s = start - corner
    q = np.cross(s, one)
    u, v, t = (s * p).sum(1) * inverse, (way * q).sum(1) * inverse, (two * q).sum(1) * inverse
    return np.asarray((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1) & (inverse != 0))
