"""A mesh of a flat garment with everything that the step needs precomputed: see `fit.cloth.elements`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth import spectral
from fit.cloth.elements import (
    Bends,
    Grid,
    Lines,
    Samples,
    Stencils,
    bends_of,
    grid_places,
    interpolation,
    joined_stencils,
    shear_samples,
)  # fmt: skip
from fit.errors import FitError
from formats.garment import Garment

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]


@dataclass(frozen=True)
class ClothMesh:
    """A flat garment as a grid of nodes, three to an element and direction.

    rest [m], (nodes, 2), material plane, x right, y up, row by row from the top
    cells, (cells, 16): nodes of each element, row by row; cell_area [m^2], likewise: the element's share of their areas
    triangles, (n, 3): the same surface for drawing
    fibres: samples of d/dX [1/m] along rows, the first `fibres_across` of them, then of d/dY along columns;
    fibre_nodes: nodes of each sample across, and down
    shear_across, shear_down, (shear samples, 4): the fibre samples that Fu and Fv are interpolated from;
    shear_weights, (shear samples, 8): with which weights; shear_area [m^2], (shear samples,)
    node_area [m^2], (nodes,)
    held_nodes, (held,); held_fraction, (held,): place along the held edge, 0 at its left end
    points: value, d/dX [1/m] and d/dY at the tracked points
    pull_points, (nodes, 3); pull_weights, (nodes, 3): how a correction at the points spreads over the nodes
    hem_length [m], (nodes,): share of the bottom edge that belongs to each node
    spacing [m]: mean distance of the nodes
    """

    rest: Floats
    cells: Integers
    cell_area: Floats
    triangles: Integers
    fibres: Samples
    fibres_across: int
    fibre_nodes: tuple[int, int]
    shear_across: Integers
    shear_down: Integers
    shear_weights: Floats
    shear_area: Floats
    bends: Bends
    node_area: Floats
    held_nodes: Integers
    held_fraction: Floats
    points: Stencils
    pull_points: Integers
    pull_weights: Floats
    hem_length: Floats
    spacing: float
    rows: int
    columns: int

    @property
    def area(self) -> float:
        """Area of the cloth [m^2]."""
        return float(self.node_area.sum())


def build_mesh(garment: Garment, spacing: float) -> ClothMesh:
    """Mesh a four-cornered garment with nodes about `spacing` [m] apart.

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
    wide, high = (max(1, round(float(side) / (spectral.ORDER * spacing))) for side in (width, height))
    grid = Grid(outline, wide, high)
    across, down = Lines(grid, 0), Lines(grid, 1)
    shear_across, shear_down, shear_weights, shear_area = shear_samples(grid, across, down)
    columns = spectral.ORDER * wide + 1
    held = np.arange(columns) if garment.held == "edge" else np.array([0, columns - 1])
    points = np.array([p.at_m for p in garment.points], float).reshape(-1, 2)
    pull_points, pull_weights = _spread(points, grid.rest)
    lengths = np.linalg.norm(np.diff(grid.rest.reshape(-1, columns, 2)[-1, :: spectral.ORDER], axis=0), axis=1)
    hem = np.zeros((grid.rows, columns))
    for element, length in zip(spectral.line_nodes(wide), lengths, strict=True):
        hem[-1, element] += spectral.WEIGHTS * length / 2
    return ClothMesh(
        rest=grid.rest,
        cells=grid.cells.astype(np.int32),
        cell_area=grid.cell_area,
        triangles=_triangles(grid.rows, columns),
        fibres=Samples(
            joined_stencils(across.nodes + down.nodes, across.slopes + down.slopes), np.array(across.areas + down.areas)
        ),
        fibres_across=len(across.areas),
        fibre_nodes=(across.width, down.width),
        shear_across=shear_across,
        shear_down=(shear_down + len(across.areas)).astype(np.int32),
        shear_weights=shear_weights,
        shear_area=shear_area,
        bends=bends_of(grid),
        node_area=grid.node_area,
        held_nodes=held.astype(np.int32),
        held_fraction=spectral.places(wide)[held],
        points=interpolation(grid_places(points, outline), grid),
        pull_points=pull_points,
        pull_weights=pull_weights,
        hem_length=hem.ravel(),
        spacing=float(np.sqrt(grid.node_area.sum() / ((columns - 1) * (grid.rows - 1)))),
        rows=grid.rows,
        columns=columns,
    )


def _triangles(rows: int, columns: int) -> Integers:
    """Two triangles between every four nodes, turned to the front like the elements."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    return np.stack([np.stack([a, c, d], 1), np.stack([a, d, b], 1)], 1).reshape(-1, 3)


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
