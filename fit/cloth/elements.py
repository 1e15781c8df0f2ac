"""Cubic spectral elements on quadrilaterals of flat cloth: sample points and stencils of strains.

An element's nodes are the tensor product of `fit.cloth.spectral`'s, and its corners are mapped bilinearly. This map has
the Jacobian J = d(X, Y)/d(xi, eta). The columns of the deformation gradient are
    Fu = sum_n (dN_n/dX) x_n,   Fv = sum_n (dN_n/dY) x_n,   [dN/dX, dN/dY] = R J^-1 [dN/dxi, dN/deta],
with the rotation R from the axes onto the threads. So strains are those of the threads, for any orientation of the
elements.

Each family of fibres is sampled along its own lines of nodes, at three Gauss points an element. Shear is sampled at 3
by 3 Gauss points. Fu and Fv are interpolated there from the fibres' samples (tying points). The samples are as many as
the freedoms of a curved sheet that does not stretch. More samples would lock elements that are much stiffer in their
plane than against bending. An element has nine nodes of its own, with three coordinates each. Neighbours share the
lines at their rims. So an element has nine samples of either family of threads, and nine of shear. If threads cross the
elements askew, nothing is shared, and there are twelve samples of either family. The threads' stiffness is then
divided. A part as large as the shear stiffness stays at the twelve samples. The rest acts with shear at nine points.
Slopes of P3(xi) P3(eta) vanish at the nine points, which alone would leave this mode free. Threads no stiffer than
shear lock nothing (`fit.cloth.forces`).
Source: T. J. R. Hughes, "The Finite Element Method" (1987), sections 3.2 and 4.4 (selective integration); K.-J. Bathe,
"Finite Element Procedures" (1996), section 5.4.2 (tying).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth import spectral
from formats.arrays import Floats, Indices, Integers

# Along and across an element from -1 to 1, (nodes, 2): Gauss-Lobatto points, `fit.cloth.spectral`.
LOCAL_NODES = np.stack(
    [
        np.tile(spectral.LOBATTO_NODES, spectral.NODES_ALONG_ELEMENT),
        np.repeat(spectral.LOBATTO_NODES, spectral.NODES_ALONG_ELEMENT),
    ],
    1,
)
CORNERS = [
    0,
    spectral.POLYNOMIAL_ORDER,
    spectral.NODES_ALONG_ELEMENT * spectral.POLYNOMIAL_ORDER,
    spectral.NODES_ALONG_ELEMENT**2 - 1,
]  # of an element's nodes


@dataclass(frozen=True)
class Stencils:
    """Sparse linear functions of nodal values, stored in turn.

    first, (stencils + 1,): index of each one's first entry; nodes, (n,); weights, (n, kinds)
    """

    first: Indices
    nodes: Indices
    weights: Floats

    def __len__(self) -> int:
        return len(self.first) - 1

    def rows(self) -> Integers:
        """Return the stencil of each entry, (n,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    def apply(self, field: Floats, kind: int = 0) -> Floats:
        """Apply to a field of the nodes, (nodes, ...), giving (stencils, ...)."""
        found = np.zeros((len(self), *field.shape[1:]))
        np.add.at(found, self.rows(), field[self.nodes] * self.weights[:, kind].reshape(-1, *(1,) * (field.ndim - 1)))
        return found


@dataclass(frozen=True)
class Samples:
    """Stencils and the area [m^2] that each stands for, (stencils,)."""

    stencils: Stencils
    area: Floats


class Elements:
    """Quadrilateral elements on the flat cloth, each the bilinear image of a square, and the slopes on them.

    - `rest` [m], (nodes, 2)
    - `cells`, (cells, 16): nodes of each element, row by row
    - `corners` [m], (cells, 4, 2): top left, top right, bottom left and bottom right of each, whose first row runs
      along its xi
    - `grain` [rad]: by how much the threads are turned against X and Y, anticlockwise; slopes are along the threads
    """

    def __init__(self, rest: Floats, cells: Integers, corners: Floats, grain: float = 0.0) -> None:
        self.rest, self.cells, self.corners = rest, cells, corners
        self.threads = np.array([[np.cos(grain), np.sin(grain)], [-np.sin(grain), np.cos(grain)]])
        weights = np.outer(spectral.LOBATTO_WEIGHTS, spectral.LOBATTO_WEIGHTS).ravel()
        self.cell_area = np.stack(
            [w * self.size(xi, eta) for w, (xi, eta) in zip(weights, LOCAL_NODES, strict=True)], 1
        )
        self.node_area = np.asarray(np.bincount(self.cells.ravel(), self.cell_area.ravel()), float)

    def jacobian(self, xi: float, eta: float) -> Floats:
        """Return d(X, Y)/d(xi, eta), (cells, 2, 2) as [along xi, along eta], at one local point of every element."""
        return 0.5 * bilinear_slopes(np.array([[xi + 1, eta + 1]]) / 2)[0] @ self.corners

    def size(self, xi: float, eta: float) -> Floats:
        """Return the area per unit of local coordinates at one point of every element [m^2], (cells,)."""
        return np.abs(np.linalg.det(self.jacobian(xi, eta)))

    def gradient(self, xi: float, eta: float) -> tuple[Floats, Floats]:
        """Return the slopes of the shape functions, (cells, 2, 16) as [d/dX, d/dY], and the area scale, (cells,)."""
        jacobian = self.jacobian(xi, eta)
        solved = self.threads @ np.linalg.solve(jacobian, np.broadcast_to(_local(xi, eta, 1), (len(jacobian), 2, 16)))
        return _without_dust(solved), self.size(xi, eta)

    def hessian(self, xi: float, eta: float) -> Floats:
        """Return the second derivatives of the shape functions, (cells, 2, 2, 16).

        A bilinear map has only one second derivative, along both xi and eta. With g = J^-1 dN, dg/dxi_l = J^-1
        (d(dN)/dxi_l - (dJ/dxi_l) g). The derivative along the axes is J^-1 times dg/dxi_l.
        """
        jacobian = self.jacobian(xi, eta)
        slopes = np.linalg.solve(jacobian, np.broadcast_to(_local(xi, eta, 1), (len(jacobian), 2, 16)))
        second = np.broadcast_to(_local(xi, eta, 2), (len(jacobian), 2, 2, 16)).copy()
        mixed = (self.corners[:, 0] - self.corners[:, 1] - self.corners[:, 2] + self.corners[:, 3]) / 4
        turned = np.einsum("cb,cbn->cn", mixed, slopes)
        second[:, 0, 1] -= turned
        second[:, 1, 0] -= turned
        inverse = self.threads @ np.linalg.inv(jacobian)
        return _without_dust(np.einsum("cak,ckln,cbl->cabn", inverse, second, inverse))


def _local(xi: float, eta: float, order: int) -> Floats:
    """Return first, (2, 16), or second, (2, 2, 16), derivatives of the shape functions on the square."""
    x, y = np.array(xi), np.array(eta)
    of = [[f(at) for f in (spectral.values, spectral.slopes, spectral.curvatures)] for at in (x, y)]
    if order == 1:
        return np.stack([np.outer(of[1][0], of[0][1]).ravel(), np.outer(of[1][1], of[0][0]).ravel()])
    mixed = np.outer(of[1][1], of[0][1]).ravel()
    return np.stack([[np.outer(of[1][0], of[0][2]).ravel(), mixed], [mixed, np.outer(of[1][2], of[0][0]).ravel()]])


def _without_dust(weights: Floats) -> Floats:
    """Return the weights, with rounding errors set to zero."""
    return np.where(np.abs(weights) > 1e-9 * np.abs(weights).max(), weights, 0.0)


class Grid(Elements):
    """`wide` x `high` elements on a four-cornered outline, nodes row by row from the top."""

    def __init__(self, outline: Floats, wide: int, high: int, grain: float = 0.0) -> None:
        self.wide, self.high = wide, high
        self.rows, self.columns = spectral.POLYNOMIAL_ORDER * high + 1, spectral.POLYNOMIAL_ORDER * wide + 1
        down, across = np.meshgrid(spectral.places(high), spectral.places(wide), indexing="ij")
        rest = bilinear(np.stack([across.ravel(), down.ravel()], 1)) @ outline[[0, 1, 3, 2]]
        index = np.arange(self.rows * self.columns).reshape(self.rows, self.columns)
        by_row, by_column = spectral.line_nodes(high), spectral.line_nodes(wide)
        cells = index[by_row[:, None, :, None], by_column[None, :, None, :]].reshape(wide * high, -1)
        super().__init__(rest, cells, rest[cells[:, CORNERS]], grain)


def quad_elements(places: Floats, quads: Integers, grain: float = 0.0) -> Elements:
    """Return cubic elements on quadrilaterals, (n, 4), clockwise from the top left, with the corners `places`.

    Nodes come corners first, then those of the sides, then those inside.
    """
    count = len(places)
    sides: dict[tuple[int, int], list[int]] = {}
    cells = np.zeros((len(quads), spectral.NODES_ALONG_ELEMENT, spectral.NODES_ALONG_ELEMENT), int)
    rims = ((0, 1, np.s_[0, :]), (3, 2, np.s_[3, :]), (0, 3, np.s_[:, 0]), (1, 2, np.s_[:, 3]))
    for cell, quad in zip(cells, quads.tolist(), strict=True):
        for a, b, rim in rims:
            ends = (min(quad[a], quad[b]), max(quad[a], quad[b]))
            if ends not in sides:
                sides[ends] = [count, count + 1]
                count += 2
            inner = sides[ends] if quad[a] < quad[b] else sides[ends][::-1]
            cell[rim] = [quad[a], *inner, quad[b]]
    for cell in cells:
        cell[1:3, 1:3] = count + np.arange(4).reshape(2, 2)
        count += 4
    corners = places[quads[:, [0, 1, 3, 2]]]
    flat = cells.reshape(len(quads), -1)
    rest = np.zeros((count, 2))
    rest[flat] = np.einsum("nk,ckd->cnd", bilinear((LOCAL_NODES + 1) / 2), corners)
    return Elements(rest, flat, corners, grain)


def bilinear(places: Floats) -> Floats:
    """Return the weights of the top left, top right and bottom corners, (n, 4), at local coordinates, (n, 2)."""
    s, t = places.T
    return np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], 1)


def bilinear_slopes(places: Floats) -> Floats:
    """Return the derivatives of these weights across and down, (n, 2, 4)."""
    s, t = places.T
    return np.stack([np.stack([t - 1, 1 - t, -t, t], 1), np.stack([s - 1, -s, 1 - s, s], 1)], 1)


def joined_stencils(nodes: list[Integers], weights: list[Floats]) -> Stencils:
    """Concatenate stencils, each of (n,) nodes and (n, kinds) weights."""
    return Stencils(
        first=np.cumsum([0, *(len(n) for n in nodes)]).astype(np.int32),
        nodes=np.concatenate(nodes).astype(np.int32),
        weights=np.concatenate(weights),
    )


class Lines:
    """Fibre samples along rows (axis 0) or columns (1); a line that two elements share is sampled once.

    of, (cells, 3, 4): sample at each Gauss point of each line of nodes of an element
    width: nodes of every sample
    """

    def __init__(self, grid: Elements, axis: int) -> None:
        self.nodes: list[Integers] = []
        self.slopes: list[Floats] = []
        self.areas: list[float] = []
        self.of = np.zeros((len(grid.cells), spectral.POLYNOMIAL_ORDER, spectral.NODES_ALONG_ELEMENT), np.int32)
        known: dict[tuple[int, ...], int] = {}
        at, weights = spectral.gauss(spectral.POLYNOMIAL_ORDER)
        parts = [
            [grid.gradient(*((g, line) if axis == 0 else (line, g))) for line in spectral.LOBATTO_NODES] for g in at
        ]
        # On a grid oblique to the fibres every node of the element enters each sample.
        most = max(int((gradient[:, axis] != 0).sum(1).max()) for line in parts for gradient, _ in line)
        self.width = (
            spectral.NODES_ALONG_ELEMENT if most <= spectral.NODES_ALONG_ELEMENT else spectral.NODES_ALONG_ELEMENT**2
        )
        for cell, corners in enumerate(grid.cells):
            for line, share in enumerate(spectral.LOBATTO_WEIGHTS):
                for g, weight in enumerate(weights):
                    gradient, area = parts[g][line]
                    slope = gradient[cell, axis]
                    used = (
                        np.flatnonzero(slope) if self.width == spectral.NODES_ALONG_ELEMENT else np.arange(self.width)
                    )
                    key = (*corners[used].tolist(), *np.round(1e6 * slope[used] / np.abs(slope).max()).astype(int))
                    if key not in known:
                        known[key] = len(self.areas)
                        self.nodes.append(corners[used])
                        self.slopes.append(slope[used, None])
                        self.areas.append(0.0)
                    self.of[cell, g, line] = known[key]
                    self.areas[known[key]] += float(weight * share * area[cell])


def shear_samples(grid: Elements, across: Lines, down: Lines) -> tuple[Indices, Indices, Floats, Floats]:
    """Return samples, weights and areas of shear at three by three Gauss points of every element."""
    at, weights = spectral.gauss(spectral.POLYNOMIAL_ORDER)
    between = spectral.values(at)
    of_across, of_down, both, areas = [], [], [], []
    for g, xi in enumerate(at):
        for h, eta in enumerate(at):
            of_across.append(across.of[:, g])
            of_down.append(down.of[:, h])
            both.append(np.tile(np.concatenate([between[h], between[g]]), (len(grid.cells), 1)))
            areas.append(weights[g] * weights[h] * grid.size(xi, eta))
    return (
        np.stack(of_across, 1).reshape(-1, 4), np.stack(of_down, 1).reshape(-1, 4),
        np.stack(both, 1).reshape(-1, 8), np.stack(areas, 1).ravel(),
    )  # fmt: skip


def within(points: Floats, corners: Floats) -> tuple[Integers, Floats]:
    """Return the element at or nearest to each point, (points,), and its local coordinates, (points, 2) in -1 to 1."""
    cells, places = [], []
    for point in points:
        found = inverted(np.broadcast_to(point, (len(corners), 2)), corners)
        best = int(np.abs(found - 0.5).max(1).argmin())
        cells.append(best)
        places.append(np.clip(2 * found[best] - 1, -1, 1))
    return np.array(cells, int), np.array(places).reshape(-1, 2)


def inverted(points: Floats, corners: Floats) -> Floats:
    """Return local coordinates in quadrilaterals, (points, 2), by Newton's method; corners, (points or 1, 4, 2)."""
    places = np.full((len(points), 2), 0.5)
    for _ in range(20):
        along = bilinear_slopes(places) @ corners
        missed = points - np.squeeze(bilinear(places)[:, None] @ corners, 1)
        # Far outside a slanting quadrilateral the map is not unique, but such a point is not inside it.
        along = np.where(np.abs(np.linalg.det(along))[:, None, None] > 1e-12, along, np.eye(2))
        places = np.clip(places + np.linalg.solve(along.transpose(0, 2, 1), missed[..., None])[..., 0], -9.0, 9.0)
    return places


def grid_places(points: Floats, outline: Floats) -> Floats:
    """Return local coordinates across and down a four-cornered outline, (points, 2) in 0 to 1."""
    return np.clip(inverted(points, outline[[0, 1, 3, 2]]), 0.0, 1.0)


def interpolation(points: Floats, grid: Elements, *, front: int | None = None) -> Stencils:
    """Return stencils of value, d/dX and d/dY at points on the flat cloth [m], (points, 2): cubic, as the elements are.

    front: number of elements, counted from the first, that have the points; further layers have the same positions
    """
    nodes, parts = [], []
    for element, (xi, eta) in zip(*within(points, grid.corners[:front]), strict=True):
        value = np.outer(spectral.values(np.array(eta)), spectral.values(np.array(xi))).ravel()
        weights = np.column_stack([value, *grid.gradient(xi, eta)[0][element]])
        used = np.abs(weights).max(1) > 1e-9
        nodes.append(grid.cells[element][used])
        parts.append(weights[used])
    if not nodes:
        return Stencils(np.zeros(1, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)))
    return joined_stencils(nodes, parts)
