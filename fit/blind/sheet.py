"""The generator's sheet: an irregular triangle mesh of a rectangle, with hinges.

Nodes sit on staggered rows (a triangular lattice, jittered inside), joined by Delaunay triangulation. Bending is the
isometric hinge energy of neighbouring triangles,

    E_e = (B_e / 2) s_e |K_e x|^2,   K_e = (c03 + c04, c01 + c02, -c01 - c03, -c02 - c04),   s_e = 3 / (A_0 + A_1)

with cotangents c of the angles at the edge, scaled once so that a rolled sheet has B / (2 R^2) per area on this mesh.
Source: M. Bergou, M. Wardetzky, D. Harmon, D. Zorin, E. Grinspun, "A quadratic bending model for inextensible surfaces"
(SGP 2006), equations 3 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]

JITTER = 0.15  # of the spacing, of inner nodes


@dataclass(frozen=True)
class Sheet:
    """Rest shape and connectivity.

    rest [m], (nodes, 2), x across, y up from -height to 0; triangles, (faces, 3); inverse [1/m], (faces, 4); area,
    (faces,)
    hinges, (hinges, 4): both ends of the edge and the two opposite corners; hinge_weights, (hinges, 4), energy is
    1/2 B |w x|^2; across, (hinges, 2): unit vector square to the edge; hinge_scale: w x = hinge_scale * curvature
    top, (held,): nodes of the held edge, left to right; node_area, (nodes,)
    """

    rest: Floats
    triangles: Integers
    inverse: Floats
    area: Floats
    hinges: Integers
    hinge_weights: Floats
    across: Floats
    hinge_scale: Floats
    top: Integers
    node_area: Floats


def build_sheet(width: float, height: float, spacing: float, rng: np.random.Generator) -> Sheet:
    """Mesh a rectangle [m]."""
    rows = max(round(height / (spacing * 0.866)), 3) + 1
    columns = max(round(width / spacing), 3) + 1
    nodes = []
    for r, y in enumerate(np.linspace(0, -height, rows)):
        x = np.linspace(0, width, columns)
        if r % 2:
            x = np.concatenate([[0], (x[:-1] + x[1:]) / 2, [width]])
        line = np.stack([x - width / 2, np.full(len(x), y)], 1)
        if 0 < r < rows - 1:
            line[1:-1] += rng.uniform(-JITTER, JITTER, (len(line) - 2, 2)) * spacing
        nodes.append(line)
    rest = np.concatenate(nodes)
    triangles = Delaunay(rest).simplices.astype(np.int32)
    first, second = rest[triangles[:, 1]] - rest[triangles[:, 0]], rest[triangles[:, 2]] - rest[triangles[:, 0]]
    doubled = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    triangles = triangles[np.abs(doubled) > 1e-3 * spacing**2]
    first, second = rest[triangles[:, 1]] - rest[triangles[:, 0]], rest[triangles[:, 2]] - rest[triangles[:, 0]]
    doubled = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    turned = doubled < 0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    first[turned], second[turned] = second[turned].copy(), first[turned].copy()
    doubled = np.abs(doubled)
    inverse = np.stack([second[:, 1], -second[:, 0], -first[:, 1], first[:, 0]], 1) / doubled[:, None]
    node_area = np.zeros(len(rest))
    np.add.at(node_area, triangles, doubled[:, None] / 6)
    hinges, weights, across, scale = _hinges(rest, triangles)
    top = np.flatnonzero(np.isclose(rest[:, 1], 0.0))
    top = top[np.argsort(rest[top, 0])]
    order = np.asarray(top, np.int32)
    return Sheet(rest, triangles, inverse, doubled / 2, hinges, weights, across, scale, order, node_area)


def _hinges(rest: Floats, triangles: Integers) -> tuple[Integers, Floats, Floats, Floats]:
    owners: dict[tuple[int, int], list[int]] = {}
    for face in triangles.tolist():
        for k in range(3):
            one, other, opposite = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
            owners.setdefault((min(one, other), max(one, other)), []).append(opposite)
    inner = [(e[0], e[1], o[0], o[1]) for e, o in owners.items() if len(o) == 2]
    hinges = np.array(inner, np.int32)
    a, b, c, d = (rest[hinges[:, k]] for k in range(4))

    def cot(p: Floats, q: Floats) -> Floats:
        return np.asarray((p * q).sum(1) / np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]))

    c01, c02 = cot(b - a, c - a), cot(b - a, d - a)  # angles at a, in both triangles
    c03, c04 = cot(a - b, c - b), cot(a - b, d - b)  # angles at b
    pattern = np.stack([c03 + c04, c01 + c02, -c01 - c03, -c02 - c04], 1)
    areas = 0.5 * (_area(a, b, c) + _area(a, b, d))
    weights = np.sqrt(3.0 / (2 * areas))[:, None] * pattern
    edge = b - a
    across = np.stack([-edge[:, 1], edge[:, 0]], 1) / np.linalg.norm(edge, axis=1, keepdims=True)
    # A roll of unit curvature about either axis, small: z = 1/2 (x . d)^2; energy per area must be 1/2.
    total = np.ptp(rest[:, 0]) * np.ptp(rest[:, 1])
    energy = np.mean([0.5 * ((weights * (0.5 * rest[hinges, k] ** 2)).sum(1) ** 2).sum() for k in (0, 1)])
    weights = weights * np.sqrt(0.5 * total / energy)
    lift = 0.5 * ((rest[hinges] * across[:, None]).sum(2)) ** 2  # unit curvature square to the edge
    return hinges, weights, across, (weights * lift).sum(1)


def _area(a: Floats, b: Floats, c: Floats) -> Floats:
    p, q = b - a, c - a
    return np.asarray(0.5 * np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]))


def locate(sheet: Sheet, places: Floats) -> tuple[Integers, Floats]:
    """Return corners, (points, 3), and barycentric weights, (points, 3), of places on the flat sheet [m]."""
    nodes, weights = [], []
    corners = sheet.rest[sheet.triangles]
    for place in places:
        p, q, r = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], place - corners[:, 0]
        doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        second = (r[:, 0] * q[:, 1] - r[:, 1] * q[:, 0]) / doubled
        third = (p[:, 0] * r[:, 1] - p[:, 1] * r[:, 0]) / doubled
        inside = np.stack([1 - second - third, second, third], 1)
        best = int(np.argmax(inside.min(1)))
        clipped = np.clip(inside[best], 0, None)
        nodes.append(sheet.triangles[best])
        weights.append(clipped / clipped.sum())
    return np.array(nodes, np.int32), np.array(weights)
