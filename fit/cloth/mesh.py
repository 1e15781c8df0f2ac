"""A triangle mesh of a flat garment with everything that the step needs precomputed.

Membrane: constant-strain triangles. With material edge matrix Dm = [X1-X0, X2-X0] and B = Dm^-1 the columns of the
deformation gradient are Fu = B00 e1 + B10 e2 and Fv = B01 e1 + B11 e2.

Bending: the plate energy E = B/2 integral of |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2, which for a sheet that does not stretch
is B/2 (kappa_1^2 + kappa_2^2), so that B is the moment per width and curvature that fabric testers give. Second
differences along rows and columns and across cells; free edges are natural. (Hinge energies on a grid are up to three
times too stiff along the grid lines: all of the curvature sits in a third of the edges.)
Source: S. Timoshenko, S. Woinowsky-Krieger, "Theory of Plates and Shells", section 22, without Poisson coupling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from formats.garment import Garment

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
ROW_BEND, COLUMN_BEND, TWIST = range(3)  # second differences across, down, and mixed


@dataclass(frozen=True)
class ClothMesh:
    """A flat garment as triangles.

    rest [m], (nodes, 2), material plane, x right, y up
    triangles, (faces, 3); inverse [1/m], (faces, 4) as B00 B01 B10 B11; area [m^2], (faces,)
    bends, (bends, 4); bend_weights [1/m], (bends, 4): second difference of four nodes times the root of its area;
    the second node of a row or column bend is its middle one; bend_kind, (bends,); bend_area [m^2], (bends,)
    node_area [m^2], (nodes,)
    held_nodes, (held,); held_fraction, (held,): place along the held edge, 0 at its left end
    point_nodes, (points, 3); point_weights, (points, 3): barycentric, material place of each tracked point
    pull_points, (nodes, 3); pull_weights, (nodes, 3): how a correction at the points spreads over the nodes
    hem_length [m], (nodes,): share of the bottom edge that belongs to each node
    spacing [m]: mean edge length of the grid
    """

    rest: Floats
    triangles: Integers
    inverse: Floats
    area: Floats
    bends: Integers
    bend_weights: Floats
    bend_kind: Integers
    bend_area: Floats
    node_area: Floats
    held_nodes: Integers
    held_fraction: Floats
    point_nodes: Integers
    point_weights: Floats
    pull_points: Integers
    pull_weights: Floats
    hem_length: Floats
    spacing: float
    rows: int
    columns: int


def build_mesh(garment: Garment, spacing: float) -> ClothMesh:
    """Mesh a four-cornered garment with a grid of about `spacing` [m].

    Raises:
        FitError: the outline does not have four corners, or the spacing is larger than the garment.
    """
    outline = np.asarray(garment.outline_m, float)
    if len(outline) != 4:
        raise FitError(
            f"the garment's outline has {len(outline)} corners",
            where=garment.name,
            advice="only four-cornered garments can be meshed so far: top left, top right, bottom right, bottom left",
        )
    top_left, top_right, bottom_right, bottom_left = outline
    width = 0.5 * (np.linalg.norm(top_right - top_left) + np.linalg.norm(bottom_right - bottom_left))
    height = 0.5 * (np.linalg.norm(top_left - bottom_left) + np.linalg.norm(top_right - bottom_right))
    if not 0 < spacing <= min(width, height) / 2:
        raise FitError(
            f"mesh spacing {spacing} m does not fit a garment of {width:.3f} m x {height:.3f} m",
            where=garment.name,
            advice="choose a spacing below half of its smaller side",
        )
    columns, rows = round(width / spacing) + 1, round(height / spacing) + 1
    down, across = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    s, t = across.ravel()[:, None], down.ravel()[:, None]
    rest = (1 - t) * ((1 - s) * top_left + s * top_right) + t * ((1 - s) * bottom_left + s * bottom_right)
    triangles = _grid_triangles(rows, columns)
    edge1 = rest[triangles[:, 1]] - rest[triangles[:, 0]]
    edge2 = rest[triangles[:, 2]] - rest[triangles[:, 0]]
    doubled = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    flipped = doubled < 0
    triangles[flipped] = triangles[flipped][:, [0, 2, 1]]
    edge1[flipped], edge2[flipped] = edge2[flipped].copy(), edge1[flipped].copy()
    doubled = np.abs(doubled)
    inverse = np.stack([edge2[:, 1], -edge2[:, 0], -edge1[:, 1], edge1[:, 0]], 1) / doubled[:, None]
    area = doubled / 2
    node_area = np.zeros(len(rest))
    np.add.at(node_area, triangles, area[:, None] / 3)
    bends, weights, kinds, bend_area = _bends(rest, node_area, rows, columns)
    held = np.arange(columns) if garment.held == "edge" else np.array([0, columns - 1])
    points = np.array([p.at_m for p in garment.points], float).reshape(-1, 2)
    point_nodes, point_weights = _locate(points, rest, triangles)
    pull_points, pull_weights = _spread(points, rest)
    hem = np.zeros(len(rest))
    bottom = np.arange(columns) + (rows - 1) * columns
    lengths = np.linalg.norm(np.diff(rest[bottom], axis=0), axis=1)
    hem[bottom[:-1]] += lengths / 2
    hem[bottom[1:]] += lengths / 2
    return ClothMesh(
        rest=rest,
        triangles=triangles.astype(np.int32),
        inverse=inverse,
        area=area,
        bends=bends,
        bend_weights=weights,
        bend_kind=kinds,
        bend_area=bend_area,
        node_area=node_area,
        held_nodes=held.astype(np.int32),
        held_fraction=held / (columns - 1),
        point_nodes=point_nodes,
        point_weights=point_weights,
        pull_points=pull_points,
        pull_weights=pull_weights,
        hem_length=hem,
        spacing=float(np.sqrt(2 * area.mean())),
        rows=rows,
        columns=columns,
    )


def _grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Two triangles per cell, diagonals alternating so that the mesh prefers neither bias direction."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    even = (np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2 == 0).ravel()[:, None]
    first = np.where(even, np.stack([a, c, d], 1), np.stack([a, c, b], 1))
    second = np.where(even, np.stack([a, d, b], 1), np.stack([b, c, d], 1))
    # Neighbours in memory: both triangles of a cell follow each other.
    return np.stack([first, second], 1).reshape(-1, 3)


def _bends(rest: Floats, node_area: Floats, rows: int, columns: int) -> tuple[Integers, Floats, Integers, Floats]:
    """Return nodes, weights, kinds and areas of the second differences; of three nodes the last comes twice, at 0."""
    index = np.arange(rows * columns).reshape(rows, columns)
    nodes, weights, kinds, areas = [], [], [], []
    for kind, before, at, after in (
        (ROW_BEND, index[:, :-2], index[:, 1:-1], index[:, 2:]),
        (COLUMN_BEND, index[:-2], index[1:-1], index[2:]),
    ):
        i, j, k = before.ravel(), at.ravel(), after.ravel()
        left, right = np.linalg.norm(rest[j] - rest[i], axis=1), np.linalg.norm(rest[k] - rest[j], axis=1)
        whole = left + right
        second = np.stack([2 / (left * whole), -2 / (left * right), 2 / (right * whole), 0 * whole], 1)
        nodes.append(np.stack([i, j, k, k], 1))
        weights.append(np.sqrt(node_area[j])[:, None] * second)
        kinds.append(np.full(len(j), kind))
        areas.append(node_area[j])
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    first, second = rest[d] - rest[a], rest[c] - rest[b]
    cell = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    nodes.append(np.stack([a, b, c, d], 1))
    # x_uv = (a - b - c + d) / cell, counted twice in the energy
    weights.append(np.sqrt(2 / cell)[:, None] * np.array([1.0, -1.0, -1.0, 1.0]))
    kinds.append(np.full(len(cell), TWIST))
    areas.append(cell)
    return (
        np.concatenate(nodes).astype(np.int32), np.concatenate(weights),
        np.concatenate(kinds).astype(np.int32), np.concatenate(areas),
    )  # fmt: skip


def _barycentric(place: Floats, corners: Floats) -> Floats:
    """Barycentric coordinates of `place` (2,) in triangles (n, 3, 2)."""
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    r = place - corners[:, 0]
    doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    second = (r[:, 0] * q[:, 1] - r[:, 1] * q[:, 0]) / doubled
    third = (p[:, 0] * r[:, 1] - p[:, 1] * r[:, 0]) / doubled
    return np.stack([1 - second - third, second, third], 1)


def _locate(places: Floats, rest: Floats, triangles: NDArray[np.int64]) -> tuple[Integers, Floats]:
    """Return the triangle corners and weights that carry each place; a place outside goes to its nearest triangle."""
    nodes, weights = [], []
    for place in places:
        inside = _barycentric(place, rest[triangles])
        best = int(np.argmax(inside.min(1)))
        clipped = np.clip(inside[best], 0, None)
        nodes.append(triangles[best])
        weights.append(clipped / clipped.sum())
    return np.array(nodes, np.int32).reshape(-1, 3), np.array(weights).reshape(-1, 3)


def _spread(points: Floats, rest: Floats) -> tuple[Integers, Floats]:
    """Piecewise linear interpolation from the tracked points to every node (Delaunay of the points)."""
    from scipy.spatial import Delaunay, QhullError

    if len(points) < 3:
        nearest = np.zeros((len(rest), 3), np.int32)
        return nearest, np.tile([1.0 if len(points) else 0.0, 0.0, 0.0], (len(rest), 1))
    try:
        simplices = Delaunay(points).simplices
    except QhullError:
        closest = np.argmin(np.linalg.norm(rest[:, None] - points[None], axis=2), axis=1)
        return np.repeat(closest[:, None], 3, 1).astype(np.int32), np.tile([1.0, 0.0, 0.0], (len(rest), 1))
    return _locate(rest, points, simplices)
