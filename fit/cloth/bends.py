"""Curvature of the cloth: second derivatives of its shape at the nodes of `fit.cloth.elements`.

The plate energy is E = B/2 integral of |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2. For a sheet that does not stretch, the
integrand is kappa_1^2 + kappa_2^2. So B is the moment per width and curvature that fabric testers give. A grid's second
derivatives are taken along rows and columns at the inner nodes, and the mixed ones at 3 by 3 Gauss points. Any other
mesh has all of them at the nodes (`free_bends`). Free edges are natural.

On a four-cornered panel whose sides are slanted by an angle t, columns count as if they were square to the rows. Bent
about the vertical the panel is stiffer than B by (1 + sin^2 t)^2. Bent about the horizontal the panel is softer by
cos^4 t. The average over the panel is some per cent.
Source: S. Timoshenko, S. Woinowsky-Krieger, "Theory of Plates and Shells", section 22, without Poisson coupling; the
mixed form with lumped masses from P. G. Ciarlet, "The Finite Element Method for Elliptic Problems", section 7.1; kinks
between elements as in F. Bassi, S. Rebay, J. Comput. Phys. 131 (1997) (lifted jumps).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth import spectral
from fit.cloth.elements import LOCAL_NODES, Elements, Grid, Stencils, joined_stencils
from formats.arrays import Floats, Indices, Integers

Nodes = Integers

ROW_BEND, COLUMN_BEND, TWIST = range(3)  # second derivatives across, down, and mixed
STENCIL_NODES = 16  # nodes of one element; longer stencils are padded to multiples, so that few lengths are compiled
BEND_NODES = (4, 7, STENCIL_NODES)  # lengths of the stencils of second derivatives, the last one and its multiples
RIMS = (range(4), range(12, 16), range(0, 16, 4), range(3, 16, 4))  # of an element's nodes: top, bottom, left, right


@dataclass(frozen=True)
class Bends:
    """Second derivatives, first along rows and columns (`stencils`), then mixed ones at the samples of shear.

    - `weights` [1/m] hold the root of the area [m^2].
    - `twist_weights`, (shear samples, 4), act on the fibre samples across; none if mixed ones are among the stencils.
    - `counts`, (3,): the number of stencils of each length of `BEND_NODES`
    - `area`, `kind`, `centre`, (bends,): of all of them; a bend is measured along the normal of the node `centre`
    """

    stencils: Stencils
    counts: Indices
    twist_weights: Floats
    area: Floats
    kind: Indices
    centre: Indices

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Return the lengths of `BEND_NODES` that occur."""
        return tuple(length for length, count in zip(BEND_NODES, self.counts, strict=True) if count)


def bends_of(grid: Grid) -> Bends:
    """Return second derivatives along rows and columns at the nodes between the ends, and mixed ones."""
    index = np.arange(len(grid.rest)).reshape(grid.rows, grid.columns)
    found: list[tuple[int, int, Nodes, Floats]] = []
    for kind, lines in ((ROW_BEND, index), (COLUMN_BEND, index.T)):
        for line in lines:
            lengths = np.linalg.norm(np.diff(grid.rest[line[:: spectral.POLYNOMIAL_ORDER]], axis=0), axis=1)
            second = spectral.second_difference(lengths)
            for i in range(1, len(line) - 1):
                used = np.flatnonzero(np.abs(second[i]) > 1e-9 * np.abs(second[i]).max())
                found.append((kind, line[i], line[used], np.sqrt(grid.node_area[line[i]]) * second[i, used, None]))
    found.sort(key=lambda bend: (len(bend[2]), bend[2].min(), bend[0]))  # the two within a line of an element together
    at, share = spectral.gauss(spectral.POLYNOMIAL_ORDER)
    weights, areas, centres = [], [], []
    for g, xi in enumerate(at):
        for h, eta in enumerate(at):
            size = grid.size(xi, eta)
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
        counts=_counts([len(b[2]) for b in found]),
        twist_weights=np.stack(weights, 1).reshape(twists, 4),
        area=np.concatenate([grid.node_area[[b[1] for b in found]], np.stack(areas, 1).ravel()]),
        kind=np.array([*(b[0] for b in found), *(TWIST for _ in range(twists))], np.int32),
        centre=np.array([*(b[1] for b in found), *np.stack(centres, 1).ravel()], np.int32),
    )


def free_bends(grid: Elements, layers: Nodes) -> Bends:
    """Return second derivatives along the threads at every node, from `hessian` and the kinks between elements.

    `layers`, (layers, nodes), names each node in every layer of this shape. Layers that are sewn together at a node
    bend independently there.

    Each element e has the share m_e of the node's area. The node stands for a length l of each side between two
    elements, with the normal n:
        m H = sum_e m_e H_e + sum_sides l n n' [dx/dn],    m = sum_e m_e
    This is the weak form of the second derivative with lumped masses. On a line the form is
    `spectral.second_difference`.
    """
    entries: list[dict[int, Floats]] = [{} for _ in grid.rest]  # node -> node of its stencil -> three weights
    for at, (xi, eta) in enumerate(LOCAL_NODES):
        second, share = grid.hessian(xi, eta), grid.cell_area[:, at]
        for cell, nodes in enumerate(grid.cells):
            _add(entries[nodes[at]], nodes, share[cell] * _three(second[cell]))
    for ours, theirs in _between(grid.cells):
        _add_kinks(entries, grid, ours, theirs)
    found = []
    for node, stencil in enumerate(entries):
        nodes, weights = np.array(list(stencil)), np.array(list(stencil.values())) / np.sqrt(grid.node_area[node])
        for kind in (ROW_BEND, COLUMN_BEND, TWIST):
            used = np.abs(weights[:, kind]) > 1e-9 * np.abs(weights).max()
            if used.any():
                stencilled, weighted = _filled_up(nodes[used], weights[used, kind, None])
                found += [(kind, layer[node], layer[stencilled], weighted, grid.node_area[node]) for layer in layers]
    found.sort(key=lambda bend: (len(bend[2]), bend[1]))
    return Bends(
        stencils=joined_stencils([b[2] for b in found], [b[3] for b in found]),
        counts=_counts([len(b[2]) for b in found]),
        twist_weights=np.zeros((0, 4)),
        area=np.array([b[4] for b in found]),
        kind=np.array([b[0] for b in found], np.int32),
        centre=np.array([b[1] for b in found], np.int32),
    )


def _counts(lengths: list[int]) -> Indices:
    """Return the number of stencils of each length of `BEND_NODES`."""
    kinds = [BEND_NODES.index(min(length, STENCIL_NODES)) for length in lengths]
    return np.bincount(kinds, minlength=len(BEND_NODES)).astype(np.int32)


def _three(second: Floats) -> Floats:
    """Return second derivatives across, down and mixed, (16, 3); the mixed ones count twice in the energy."""
    return np.stack([second[0, 0], second[1, 1], np.sqrt(2) * second[0, 1]], 1)


def _add(stencil: dict[int, Floats], nodes: Nodes, weights: Floats) -> None:
    for node, weight in zip(nodes.tolist(), weights, strict=True):
        stencil[node] = stencil.get(node, 0.0) + weight


def _filled_up(nodes: Nodes, weights: Floats) -> tuple[Nodes, Floats]:
    """Return a stencil padded with zero weights to a length of `BEND_NODES`, or to whole pieces."""
    missing = next((n for n in BEND_NODES if n >= len(nodes)), -(-len(nodes) // STENCIL_NODES) * STENCIL_NODES) - len(
        nodes
    )
    return np.append(nodes, np.repeat(nodes[:1], missing)), np.concatenate([weights, np.zeros((missing, 1))])


def _between(cells: Nodes) -> list[tuple[tuple[int, range], tuple[int, range]]]:
    """Return the sides that two elements share, as element and side of both."""
    owners: dict[tuple[int, ...], list[tuple[int, range]]] = {}
    for cell, nodes in enumerate(cells):
        for rim in RIMS:
            owners.setdefault(tuple(sorted(nodes[list(rim)].tolist())), []).append((cell, rim))
    return [(found[0], found[1]) for found in owners.values() if len(found) == 2]


def _add_kinks(
    entries: list[dict[int, Floats]], grid: Elements, ours: tuple[int, range], theirs: tuple[int, range]
) -> None:
    """Add the contribution of the kink between two elements to the second derivatives on their common side."""
    (cell, rim), (other, other_rim) = ours, theirs
    nodes, other_nodes = grid.cells[cell], grid.cells[other]
    ends = grid.rest[nodes[rim[-1]]] - grid.rest[nodes[rim[0]]]
    length = float(np.linalg.norm(ends))
    normal = np.array([ends[1], -ends[0]]) / length
    if normal @ (grid.corners[other].mean(0) - grid.corners[cell].mean(0)) < 0:
        normal = -normal
    n = grid.threads @ normal
    outer = np.array([n[0] * n[0], n[1] * n[1], np.sqrt(2) * n[0] * n[1]])
    for k, at in enumerate(rim):
        node = nodes[at]
        other_at = next(i for i in other_rim if other_nodes[i] == node)
        share = spectral.LOBATTO_WEIGHTS[k] * length / 2
        for sign, element, place in ((-1.0, cell, at), (1.0, other, other_at)):
            slope = n @ grid.gradient(*LOCAL_NODES[place])[0][element]
            _add(entries[node], grid.cells[element], sign * share * slope[:, None] * outer)
