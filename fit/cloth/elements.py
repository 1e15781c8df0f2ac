"""Samples and stencils of a grid of cubic spectral elements on a four-cornered outline.

Nodes are the tensor product of `fit.cloth.spectral`'s. The outline's corners are mapped bilinearly; with the Jacobian
J = d(X, Y)/d(xi, eta) of that map the columns of the deformation gradient are
    Fu = sum_n (dN_n/dX) x_n,   Fv = sum_n (dN_n/dY) x_n,   [dN/dX, dN/dY] = J^-1 [dN/dxi, dN/deta].

Membrane: each family of fibres is sampled along its own lines of nodes, at three Gauss points an element; shear at 3
by 3 Gauss points, where Fu and Fv are interpolated from those samples (tying points). As many samples as a curved
sheet that does not stretch has freedoms for: sampled more often, elements that are much stiffer in their plane than
against bending lock.
Source: T. J. R. Hughes, "The Finite Element Method" (1987), sections 3.2 and 4.4 (selective integration); K.-J. Bathe,
"Finite Element Procedures" (1996), section 5.4.2 (tying).

Bending: the plate energy E = B/2 integral of |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2, which for a sheet that does not stretch
is B/2 (kappa_1^2 + kappa_2^2), so that B is the moment per width and curvature that fabric testers give. Second
derivatives along rows and columns at the inner nodes, mixed ones at 3 by 3 Gauss points; free edges are natural.
Source: S. Timoshenko, S. Woinowsky-Krieger, "Theory of Plates and Shells", section 22, without Poisson coupling; the
mixed form with lumped masses from P. G. Ciarlet, "The Finite Element Method for Elliptic Problems", section 7.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth import spectral

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
ROW_BEND, COLUMN_BEND, TWIST = range(3)  # second derivatives across, down, and mixed


@dataclass(frozen=True)
class Stencils:
    """Linear functions of the nodes, one after the other.

    first, (stencils + 1,): where each begins; nodes, (n,); weights, (n, kinds)
    """

    first: Integers
    nodes: Integers
    weights: Floats

    def __len__(self) -> int:
        return len(self.first) - 1

    def rows(self) -> NDArray[np.int64]:
        """Stencil of each entry, (n,)."""
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


@dataclass(frozen=True)
class Bends:
    """Second derivatives, first along rows and columns (`stencils`), then mixed ones at the samples of shear.

    Weights [1/m] hold the root of the area [m^2]; twist_weights, (shear samples, 4), act on the fibre samples across.
    counts, (2,): how many stencils have each length of `spectral.BEND_NODES`; area, kind, centre, (bends,): of all of
    them; centre is the node along whose normal a bend is measured.
    """

    stencils: Stencils
    counts: Integers
    twist_weights: Floats
    area: Floats
    kind: Integers
    centre: Integers

    def __len__(self) -> int:
        return len(self.kind)


class Grid:
    """Nodes of `wide` x `high` elements on a four-cornered outline, and the derivatives of its map."""

    def __init__(self, outline: Floats, wide: int, high: int) -> None:
        self.wide, self.high = wide, high
        self.rows, self.columns = spectral.ORDER * high + 1, spectral.ORDER * wide + 1
        self.corners = outline[[0, 1, 3, 2]]
        down, across = np.meshgrid(spectral.places(high), spectral.places(wide), indexing="ij")
        self.rest = bilinear(np.stack([across.ravel(), down.ravel()], 1)) @ self.corners
        index = np.arange(self.rows * self.columns).reshape(self.rows, self.columns)
        by_row, by_column = spectral.line_nodes(high), spectral.line_nodes(wide)
        self.cells = index[by_row[:, None, :, None], by_column[None, :, None, :]].reshape(wide * high, -1)
        weights = np.outer(spectral.WEIGHTS, spectral.WEIGHTS).ravel()
        xi, eta = np.tile(spectral.NODES, spectral.WIDTH), np.repeat(spectral.NODES, spectral.WIDTH)
        self.cell_area = np.stack(
            [w * np.abs(np.linalg.det(self.jacobian(*at))) for w, *at in zip(weights, xi, eta, strict=True)], 1
        )
        self.node_area = np.asarray(np.bincount(self.cells.ravel(), self.cell_area.ravel()), float)

    def jacobian(self, xi: float, eta: float) -> Floats:
        """d(X, Y)/d(xi, eta), (cells, 2, 2) as [along xi, along eta], at a place of every element."""
        row, column = np.divmod(np.arange(self.wide * self.high), self.wide)
        s, t = (column + (xi + 1) / 2) / self.wide, (row + (eta + 1) / 2) / self.high
        return (
            bilinear_slopes(np.stack([s, t], 1)) @ self.corners * np.array([0.5 / self.wide, 0.5 / self.high])[:, None]
        )

    def gradient(self, xi: float, eta: float) -> tuple[Floats, Floats]:
        """Slopes of the shape functions, (cells, 2, 16) as [d/dX, d/dY], and the area scale, (cells,)."""
        of_xi, of_eta = spectral.values(np.array(xi)), spectral.values(np.array(eta))
        local = np.stack(
            [np.outer(of_eta, spectral.slopes(np.array(xi))), np.outer(spectral.slopes(np.array(eta)), of_xi)]
        ).reshape(2, -1)
        jacobian = self.jacobian(xi, eta)
        solved = np.linalg.solve(jacobian, np.broadcast_to(local, (len(jacobian), *local.shape)))
        return np.where(np.abs(solved) > 1e-9 * np.abs(solved).max(), solved, 0.0), np.abs(np.linalg.det(jacobian))


def bilinear(places: Floats) -> Floats:
    """Weights of the top left, top right and bottom corners, (n, 4), at places across and down, (n, 2)."""
    s, t = places.T
    return np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], 1)


def bilinear_slopes(places: Floats) -> Floats:
    """Slopes of those weights across and down, (n, 2, 4)."""
    s, t = places.T
    return np.stack([np.stack([t - 1, 1 - t, -t, t], 1), np.stack([s - 1, -s, 1 - s, s], 1)], 1)


def joined_stencils(nodes: list[NDArray[np.int64]], weights: list[Floats]) -> Stencils:
    """Put stencils, each (n,) nodes and (n, kinds) weights, one after the other."""
    return Stencils(
        first=np.cumsum([0, *(len(n) for n in nodes)]).astype(np.int32),
        nodes=np.concatenate(nodes).astype(np.int32),
        weights=np.concatenate(weights),
    )


class Lines:
    """Samples along rows (axis 0) or columns (1); lines of nodes that two elements share are sampled once.

    of, (cells, 3, 4): sample at each Gauss point of each line of nodes of an element
    width: nodes of every sample
    """

    def __init__(self, grid: Grid, axis: int) -> None:
        self.nodes: list[NDArray[np.int64]] = []
        self.slopes: list[Floats] = []
        self.areas: list[float] = []
        self.of = np.zeros((len(grid.cells), spectral.ORDER, spectral.WIDTH), np.int32)
        known: dict[tuple[int, ...], int] = {}
        at, weights = spectral.gauss(spectral.ORDER)
        parts = [[grid.gradient(*((g, line) if axis == 0 else (line, g))) for line in spectral.NODES] for g in at]
        # Where the grid is askew to the fibres every node of the element has a say.
        most = max(int((gradient[:, axis] != 0).sum(1).max()) for line in parts for gradient, _ in line)
        self.width = spectral.WIDTH if most <= spectral.WIDTH else spectral.WIDTH**2
        for cell, corners in enumerate(grid.cells):
            for line, share in enumerate(spectral.WEIGHTS):
                for g, weight in enumerate(weights):
                    gradient, area = parts[g][line]
                    slope = gradient[cell, axis]
                    used = np.flatnonzero(slope) if self.width == spectral.WIDTH else np.arange(self.width)
                    key = (*corners[used].tolist(), *np.round(1e6 * slope[used] / np.abs(slope).max()).astype(int))
                    if key not in known:
                        known[key] = len(self.areas)
                        self.nodes.append(corners[used])
                        self.slopes.append(slope[used, None])
                        self.areas.append(0.0)
                    self.of[cell, g, line] = known[key]
                    self.areas[known[key]] += float(weight * share * area[cell])


def shear_samples(grid: Grid, across: Lines, down: Lines) -> tuple[Integers, Integers, Floats, Floats]:
    """Samples, weights and areas of shear at three by three Gauss points of every element."""
    at, weights = spectral.gauss(spectral.ORDER)
    between = spectral.values(at)
    of_across, of_down, both, areas = [], [], [], []
    for g, xi in enumerate(at):
        for h, eta in enumerate(at):
            of_across.append(across.of[:, g])
            of_down.append(down.of[:, h])
            both.append(np.tile(np.concatenate([between[h], between[g]]), (len(grid.cells), 1)))
            areas.append(weights[g] * weights[h] * np.abs(np.linalg.det(grid.jacobian(xi, eta))))
    return (
        np.stack(of_across, 1).reshape(-1, 4), np.stack(of_down, 1).reshape(-1, 4),
        np.stack(both, 1).reshape(-1, 8), np.stack(areas, 1).ravel(),
    )  # fmt: skip


def bends_of(grid: Grid) -> Bends:
    """Second derivatives along rows and columns at the nodes between the ends, and mixed ones."""
    index = np.arange(len(grid.rest)).reshape(grid.rows, grid.columns)
    found: list[tuple[int, int, NDArray[np.int64], Floats]] = []
    for kind, lines in ((ROW_BEND, index), (COLUMN_BEND, index.T)):
        for line in lines:
            lengths = np.linalg.norm(np.diff(grid.rest[line[:: spectral.ORDER]], axis=0), axis=1)
            second = spectral.second_difference(lengths)
            for i in range(1, len(line) - 1):
                used = np.flatnonzero(np.abs(second[i]) > 1e-9 * np.abs(second[i]).max())
                found.append((kind, line[i], line[used], np.sqrt(grid.node_area[line[i]]) * second[i, used, None]))
    found.sort(key=lambda bend: (len(bend[2]), bend[1]))
    at, share = spectral.gauss(spectral.ORDER)
    weights, areas, centres = [], [], []
    for g, xi in enumerate(at):
        for h, eta in enumerate(at):
            size = np.abs(np.linalg.det(grid.jacobian(xi, eta)))
            height = np.linalg.norm(grid.jacobian(xi, eta)[:, 1], axis=1)
            area = share[g] * share[h] * size
            # x_uv = d(x_u)/d eta / height, counted twice in the energy
            weights.append(np.sqrt(2 * area)[:, None] * spectral.slopes(np.array(eta)) / height[:, None])
            areas.append(area)
            nearest = np.outer(spectral.values(np.array(eta)), spectral.values(np.array(xi))).argmax()
            centres.append(grid.cells[:, nearest])
    twists = len(grid.cells) * len(at) ** 2
    return Bends(
        stencils=joined_stencils([b[2] for b in found], [b[3] for b in found]),
        counts=np.array([sum(len(b[2]) == count for b in found) for count in spectral.BEND_NODES], np.int32),
        twist_weights=np.stack(weights, 1).reshape(twists, 4),
        area=np.concatenate([grid.node_area[[b[1] for b in found]], np.stack(areas, 1).ravel()]),
        kind=np.array([*(b[0] for b in found), *(TWIST for _ in range(twists))], np.int32),
        centre=np.array([*(b[1] for b in found), *np.stack(centres, 1).ravel()], np.int32),
    )


def grid_places(points: Floats, outline: Floats) -> Floats:
    """Places across and down the outline, (points, 2) within 0 to 1: the bilinear map inverted by Newton's method."""
    corners = outline[[0, 1, 3, 2]]
    places = np.full((len(points), 2), 0.5)
    for _ in range(20):
        along = bilinear_slopes(places) @ corners
        missed = points - bilinear(places) @ corners
        places = places + np.linalg.solve(along.transpose(0, 2, 1), missed[..., None])[..., 0]
    return np.clip(places, 0.0, 1.0)


def interpolation(places: Floats, grid: Grid) -> Stencils:
    """Value, d/dX and d/dY at places across and down, (points, 2): cubic, as the elements are."""
    column = np.clip((places[:, 0] * grid.wide).astype(int), 0, grid.wide - 1)
    row = np.clip((places[:, 1] * grid.high).astype(int), 0, grid.high - 1)
    local = np.stack([2 * (places[:, 0] * grid.wide - column) - 1, 2 * (places[:, 1] * grid.high - row) - 1], 1)
    nodes, parts = [], []
    for (xi, eta), element in zip(local, row * grid.wide + column, strict=True):
        value = np.outer(spectral.values(np.array(eta)), spectral.values(np.array(xi))).ravel()
        weights = np.column_stack([value, *grid.gradient(xi, eta)[0][element]])
        used = np.abs(weights).max(1) > 1e-9
        nodes.append(grid.cells[element][used])
        parts.append(weights[used])
    if not nodes:
        return Stencils(np.zeros(1, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)))
    return joined_stencils(nodes, parts)
