"""Mesh of the generator: a rectangle of equilateral triangles with cotangent hinges, and its stable step.

Rows are staggered by half a side, with half triangles at the two sides. The bending energy of a sheet that does not
stretch is a sum over inner edges. An edge lies between triangles of areas A0 and A1, and s = sum_i K_i x_i is its
integrated mean-curvature vector:

    E = B/2 |s|^2 / (A0 + A1),      K = (cot1 + cot1', cot0 + cot0', -(cot0 + cot1), -(cot0' + cot1'))

The order of K is: the edge's two ends, the two opposite corners. Hinges see 3 kappa_mm - kappa_tt (m square to the
edge, t along it). Over the three edge directions of equilateral triangles, the mean of its square is 3 (kappa_1^2 +
kappa_2^2 - 2/3 kappa_1 kappa_2). So a third of the usual hinge energy is the plate energy with Poisson's ratio -1/3. B
is the moment per width and curvature.
Source: M. Bergou et al., "A quadratic bending model for inextensible surfaces" (SGP 2006), section 4; the factor:
H. S. Seung & D. R. Nelson, Phys. Rev. A 38, 1005 (1988), section II.

Stable step: omega^2 <= max over triangles of lambda(K_e, M_e) (B. M. Irons' element bound) plus the same for hinges.
Source: T. Belytschko, W. K. Liu, B. Moran, "Nonlinear Finite Elements for Continua and Structures", section 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from formats.arrays import Floats, Indices, Integers


@dataclass(frozen=True)
class Sheet:
    """A rectangular sheet, x across from -width/2, y from 0 at its held top edge down to -height.

    - `rest` [m], (nodes, 2)
    - `triangles`, (faces, 3)
    - `inverse` [1/m], (faces, 4): B00 B01 B10 B11 of the inverse edge matrix
    - `area` [m^2], (faces,)
    - `node_area` [m^2], (nodes,)
    - `hinges`, (hinges, 4): edge ends, opposite corners
    - `hinge_cotangents`, (hinges, 4)
    - `hinge_area` [m^2], (hinges,): A0 + A1
    - `hinge_across`, (hinges, 2): unit vector perpendicular to the edge
    - `held`, (held,): nodes of the top edge
    - `bottom_length` [m], (nodes,): share of the bottom edge
    """

    width: float
    height: float
    rest: Floats
    triangles: Indices
    inverse: Floats
    area: Floats
    node_area: Floats
    hinges: Indices
    hinge_cotangents: Floats
    hinge_area: Floats
    hinge_across: Floats
    held: Indices
    bottom_length: Floats

    def node_at(self, x: float, y: float) -> int:
        """Return the node nearest to a position on the flat sheet [m]."""
        return int(np.argmin(np.hypot(self.rest[:, 0] - x, self.rest[:, 1] - y)))


def make_sheet(width: float, height: float, side: float) -> Sheet:
    """Mesh a sheet with triangles of about `side` [m]."""
    columns = max(2, round(width / side))
    rows = max(2, round(height / (side * np.sqrt(3) / 2)))
    places = []
    for row in range(rows + 1):
        across = np.linspace(-0.5, 0.5, columns + 1)
        if row % 2:
            across = np.concatenate([[-0.5], (across[1:] + across[:-1]) / 2, [0.5]])
        places += [(width * x, -height * row / rows) for x in across]
    rest = np.array(places)
    return _sheet_of(width, height, rest, _staggered(rest, rows))


def make_grid(width: float, height: float, side: float) -> Sheet:
    """Mesh a sheet with squares of about `side` [m], each split along alternating diagonals."""
    columns, rows = max(2, round(width / side)), max(2, round(height / side))
    rest = np.array(
        [(x, y) for y in np.linspace(0, -height, rows + 1) for x in np.linspace(-width / 2, width / 2, columns + 1)]
    )
    node = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = (part.ravel() for part in (node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]))
    leans = ((np.arange(rows)[:, None] + np.arange(columns)) % 2 == 1).ravel()[:, None]
    first = np.where(leans, np.stack([a, c, b], 1), np.stack([a, c, d], 1))
    second = np.where(leans, np.stack([b, c, d], 1), np.stack([a, d, b], 1))
    return _sheet_of(width, height, rest, np.stack([first, second], 1).reshape(-1, 3))


def _sheet_of(width: float, height: float, rest: Floats, triangles: Integers) -> Sheet:
    p, q = rest[triangles[:, 1]] - rest[triangles[:, 0]], rest[triangles[:, 2]] - rest[triangles[:, 0]]
    doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    inverse = np.stack([q[:, 1], -q[:, 0], -p[:, 1], p[:, 0]], 1) / doubled[:, None]
    area = doubled / 2
    node_area = np.zeros(len(rest))
    np.add.at(node_area, triangles, area[:, None] / 3)
    hinges, faces = _hinges(triangles)
    cotangents = _cotangents(rest[hinges])
    along = rest[hinges[:, 1]] - rest[hinges[:, 0]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    bottom = np.flatnonzero(np.isclose(rest[:, 1], -height))
    length = np.zeros(len(rest))
    gaps = np.diff(rest[bottom, 0])
    length[bottom[:-1]] += gaps / 2
    length[bottom[1:]] += gaps / 2
    return Sheet(
        width=width, height=height, rest=rest, triangles=triangles.astype(np.int32), inverse=inverse, area=area,
        node_area=node_area, hinges=hinges, hinge_cotangents=cotangents,
        hinge_area=area[faces].sum(1), hinge_across=np.stack([-along[:, 1], along[:, 0]], 1),
        held=np.flatnonzero(np.isclose(rest[:, 1], 0.0)).astype(np.int32), bottom_length=length,
    )  # fmt: skip


def _staggered(rest: Floats, rows: int) -> Integers:
    """Return counter-clockwise Delaunay triangles of the staggered rows, without slivers on the hull."""
    triangles = np.asarray(Delaunay(rest).simplices, np.int64)
    p, q = rest[triangles[:, 1]] - rest[triangles[:, 0]], rest[triangles[:, 2]] - rest[triangles[:, 0]]
    doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    triangles[doubled < 0] = triangles[doubled < 0][:, [0, 2, 1]]
    kept = triangles[np.abs(doubled) > 1e-6 * np.ptp(rest[:, 1]) ** 2 / rows**2]
    # Neighbours in memory: triangles from top to bottom.
    centre = rest[kept].mean(1)
    return np.asarray(kept[np.lexsort((centre[:, 0], -np.round(centre[:, 1], 9)))])


def _hinges(triangles: Integers) -> tuple[Indices, Indices]:
    """Return the nodes, (hinges, 4), and triangles, (hinges, 2), of every inner edge.

    The third node is left of the line from the first to the second, so that every hinge has the same front.
    """
    seen: dict[tuple[int, int], tuple[tuple[int, int], int, int]] = {}
    nodes, faces = [], []
    for face, corners in enumerate(triangles.tolist()):
        for k in range(3):
            i, j, opposite = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
            key = (min(i, j), max(i, j))
            if key in seen:
                edge, other, other_face = seen[key]
                nodes.append((*edge, other, opposite))
                faces.append((other_face, face))
            else:
                seen[key] = ((i, j), opposite, face)
    return np.array(nodes, np.int32), np.array(faces, np.int32)


def _cotangents(corners: Floats) -> Floats:
    """Return K of every hinge, (hinges, 4), from its nodes' positions (hinges, 4, 2)."""

    def cot(at: int, one: int, two: int) -> Floats:
        a, b = corners[:, one] - corners[:, at], corners[:, two] - corners[:, at]
        return np.asarray((a * b).sum(1) / np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))

    first, second = (cot(0, 1, 2), cot(1, 0, 2)), (cot(0, 1, 3), cot(1, 0, 3))
    return np.stack([second[1] + first[1], first[0] + second[0], -first[0] - first[1], -second[0] - second[1]], 1)


def membrane_rate(sheet: Sheet, normal: float, coupled: float, shear: float) -> float:
    """Return the upper bound of omega^2 at unit density [m^4/s^2 kg] for a membrane of these stiffnesses [N/m]."""
    b = np.zeros((len(sheet.area), 3, 6))
    rows = sheet.inverse.reshape(-1, 2, 2)
    slopes = np.concatenate([-rows.sum(1, keepdims=True), rows], 1)  # d/dx, d/dy of the three corners' hats
    b[:, 0, 0::2], b[:, 1, 1::2] = slopes[:, :, 0], slopes[:, :, 1]
    b[:, 2, 0::2], b[:, 2, 1::2] = slopes[:, :, 1], slopes[:, :, 0]
    stiffness = np.array([[normal, coupled, 0], [coupled, normal, 0], [0, 0, shear]])
    return float(np.linalg.eigvalsh(3 * np.einsum("eki,kl,elj->eij", b, stiffness, b)).max())


def bending_rate(sheet: Sheet) -> float:
    """Return the upper bound of omega^2 [1/m^4] at unit bending stiffness and unit density."""
    share = np.bincount(sheet.hinges.ravel(), minlength=len(sheet.rest))
    mass = sheet.node_area / np.maximum(share, 1)
    return float(((sheet.hinge_cotangents**2 / mass[sheet.hinges]).sum(1) / sheet.hinge_area).max())


def place_on(sheet: Sheet, places: Floats) -> tuple[Indices, Floats]:
    """Return corners, (points, 3), and barycentric weights, (points, 3), of positions [m], (points, 2)."""
    nodes, weights = [], []
    corners = sheet.rest[sheet.triangles]
    inverse = sheet.inverse.reshape(-1, 2, 2)
    for place in places:
        second_third = np.einsum("fij,fj->fi", inverse, place - corners[:, 0])
        inside = np.column_stack([1 - second_third.sum(1), second_third])
        best = int(np.argmax(inside.min(1)))
        held = np.clip(inside[best], 0, None)
        nodes.append(sheet.triangles[best])
        weights.append(held / held.sum())
    return np.array(nodes, np.int32), np.array(weights)
