"""Mesh of a flat garment, with all precomputed quantities of the time step (`fit.cloth.elements`)."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from fit.cloth import spectral
from fit.cloth.bends import RIMS, Bends, bends_of, free_bends
from fit.cloth.elements import (
    Elements,
    Grid,
    Lines,
    Samples,
    Stencils,
    interpolation,
    joined_stencils,
    quad_elements,
    shear_samples,
)
from fit.cloth.quads import distance_to, quadrilaterals
from fit.errors import FitError
from fit.recordings.held_edge import place_along
from formats.arrays import Floats, Indices, Integers
from formats.garment import Garment
from formats.meant_units import NEAR_A_RANGE

# m; our choice: layers begin 40 mm apart, eight times the 5 mm that contact keeps them apart, and settle from there.
# Half and double were not tried.
LARGEST_BULGE = 0.02
# Of the distance to a seam; our choice: cloth begins stretched by 0.1^2 / 2 = 0.5 %, and would at twice by 2 %.
STEEPEST_BULGE = 0.1
MOST_MESH_NODES = 250_000  # nodes of an exported mesh at most: more than any program needs, and memory grows with them
MOST_SIMULATED_NODES = 40_000  # six seconds of motion take 0.33 s on 100, 2.6 s on 400 (measured), 44 minutes on this
MOST_STATED_NODES = 1e6  # nodes: larger numbers are reported as "more than", as no mesh may have them
MANY_MESH_NODES = 1000  # six seconds of motion take ten seconds, and a fit of 350 simulations an hour
USUAL_NODES = 100  # nodes of a garment of 0.5 m at a spacing of 0.05 m
SPACING_UNITS = {"millimetres": 1e-3, "centimetres": 1e-2}  # m per unit
# Of the garment's height, where its bottom edge is. Our choice: sleeves end above the lowest quarter, and a hem that is
# cut aslant stays within it. Half and double were not tried.
LOWEST_SHARE = 0.25


def check_spacing(spacing: float | None) -> None:
    """Refuse a mesh spacing that is no positive distance; None selects the default.

    Raises:
        FitError: the spacing is not above 0, or not finite.
    """
    if spacing is not None and not 0 < spacing < np.inf:
        raise FitError(f"the mesh spacing is {spacing:g} m", where="--spacing", advice="give metres, for example 0.05")


@dataclass(frozen=True)
class ClothMesh:
    """Mesh of a flat garment; each element has three nodes of its own per direction.

    - `rest` [m], (nodes, 2), material plane, x right, y up
    - `bulge` [m], (nodes,): initial distance of each node behind the plane
    - `cells`, (cells, 16): nodes of each element, row by row
    - `cell_area` [m^2], likewise: the element's share of their areas
    - `triangles`, (n, 3): the same surface for drawing
    - `fibres`: samples of d/dX [1/m] along rows, the first `fibres_across` of them, then of d/dY along columns
    - `fibre_nodes`: nodes of each sample across, and down
    - `shear_across`, `shear_down`, (shear samples, 4): the fibre samples that Fu and Fv are interpolated from
    - `shear_weights`, (shear samples, 8): with which weights
    - `shear_area` [m^2], (shear samples,)
    - `node_area` [m^2], (nodes,)
    - `held_nodes`, (held,)
    - `held_fraction`, (held,): position along the held edge, 0 at its left end
    - `points`: value, d/dX [1/m] and d/dY at the tracked points
    - `pull_points`, (nodes, 3)
    - `pull_weights`, (nodes, 3): how a correction at the points spreads over the nodes
    - `hem_length` [m], (nodes,): share of the bottom edge that belongs to each node
    - `spacing` [m]: mean distance of the nodes
    """

    rest: Floats
    bulge: Floats
    cells: Indices
    cell_area: Floats
    triangles: Indices
    fibres: Samples
    fibres_across: int
    fibre_nodes: tuple[int, int]
    shear_across: Indices
    shear_down: Indices
    shear_weights: Floats
    shear_area: Floats
    bends: Bends
    node_area: Floats
    held_nodes: Indices
    held_fraction: Floats
    points: Stencils
    pull_points: Indices
    pull_weights: Floats
    hem_length: Floats
    spacing: float

    @property
    def is_crossed(self) -> bool:
        """Whether threads of both families cross the elements obliquely, so that all nodes enter every strain."""
        return min(self.fibre_nodes) > spectral.NODES_ALONG_ELEMENT

    @property
    def area(self) -> float:
        """Return the area of the cloth [m^2]."""
        return float(self.node_area.sum())


@dataclass(frozen=True)
class _Laid:
    """Elements and bends of the whole garment, and the node in every layer that belongs to each front node."""

    elements: Elements
    bends: Bends
    layers: Integers


def check_mesh(garment: Garment, spacing: float, most: int = MOST_SIMULATED_NODES) -> None:
    """Refuse a mesh spacing [m] that is too large for a garment, or gives it more than `most` nodes.

    Raises:
        FitError: it is refused; the error names the unit that may be meant.
    """
    check_spacing(spacing)
    width, height = _sides(np.asarray(garment.outline_m, float))
    # Rounded up to a tenth of a millimetre: the advice is then one to follow.
    finest, coarsest = float(np.ceil(1e4 * np.sqrt(width * height / most)) / 1e4), min(width, height) / 2
    if finest <= spacing <= coarsest:
        return
    what = f"mesh spacing {spacing} m does not fit a garment of {width:.3f} m x {height:.3f} m"
    if spacing < finest:
        nodes = _nodes(garment, spacing)
        about = f"about {nodes:.0f}" if nodes < MOST_STATED_NODES else f"more than {MOST_STATED_NODES:.0f}"
        what += f", and gives it {about} nodes where {most} are the most"
    meant = [
        f"{in_metres:g} for {in_metres / size:g} {unit if round(in_metres / size, 9) != 1 else unit[:-1]}"
        for unit, size in SPACING_UNITS.items()
        for in_metres in [spacing * size if spacing > coarsest else spacing / size]  # a tiny one was converted twice
        if max(finest, size) <= in_metres <= coarsest and not finest / NEAR_A_RANGE <= spacing < finest
    ]
    raise FitError(
        what, where=garment.name,
        advice=f"choose a spacing from {finest:g} m to half of its smaller side"
        + (f"; the spacing is in metres: {' or '.join(meant)}" if meant else ""),
    )  # fmt: skip


def cost_words(garment: Garment, spacing: float | None) -> str:
    """Return a sentence on the cost of a fine mesh, after a space; nothing for a usual spacing or None, the default."""
    nodes = 0.0 if spacing is None else _nodes(garment, spacing)
    if nodes < MANY_MESH_NODES:
        return ""
    longer = (nodes / USUAL_NODES) ** 1.5  # half the spacing: four times the nodes, and twice the steps
    return f" The mesh has about {nodes:.0f} nodes; a simulation takes {longer:.0f} times as long as on {USUAL_NODES}."


def _nodes(garment: Garment, spacing: float) -> float:
    """Return the approximate number of nodes of a mesh with a spacing [m]."""
    return (2 if garment.seams else 1) * garment.area_m2 / spacing / spacing  # the square of a tiny one is 0


@functools.lru_cache(maxsize=8)
def build_mesh(garment: Garment, spacing: float) -> ClothMesh:
    """Mesh a garment with nodes about `spacing` [m] apart; all layers have the front's positions on the flat garment.

    The last meshes are cached, because all recordings of a garment share one.

    Raises:
        FitError: the outline cannot be meshed, or the spacing is larger than the garment.
    """
    check_mesh(garment, spacing, MOST_MESH_NODES)
    outline = np.asarray(garment.outline_m, float)
    is_panel = garment.is_four_sided and not garment.holes_m
    laid = _panel(garment, outline, spacing) if is_panel else _pattern(garment, spacing)
    grid = laid.elements
    across, down = Lines(grid, 0), Lines(grid, 1)
    shear_across, shear_down, shear_weights, shear_area = shear_samples(grid, across, down)
    held, fraction = _held(garment, grid.rest)
    points = np.array([p.at_m for p in garment.points], float).reshape(-1, 2)
    pull_points, pull_weights = _spread(points, grid.rest)
    return ClothMesh(
        rest=grid.rest,
        bulge=_bulge(garment, grid.rest, laid.layers),
        cells=grid.cells.astype(np.int32),
        cell_area=grid.cell_area,
        triangles=_triangles(grid.cells),
        fibres=Samples(
            joined_stencils(across.nodes + down.nodes, across.slopes + down.slopes), np.array(across.areas + down.areas)
        ),
        fibres_across=len(across.areas),
        fibre_nodes=(across.width, down.width),
        shear_across=shear_across,
        shear_down=(shear_down + len(across.areas)).astype(np.int32),
        shear_weights=shear_weights,
        shear_area=shear_area,
        bends=laid.bends,
        node_area=grid.node_area,
        held_nodes=held.astype(np.int32),
        held_fraction=fraction,
        points=interpolation(points, grid, front=len(grid.cells) // len(laid.layers)),
        pull_points=pull_points,
        pull_weights=pull_weights,
        hem_length=_hem(outline, grid),
        spacing=float(np.sqrt(grid.node_area.sum() / (spectral.POLYNOMIAL_ORDER**2 * len(grid.cells)))),
    )


def _sides(outline: Floats) -> tuple[float, float]:
    """Return width and height [m]: means of opposite sides of a panel, the extent of anything else."""
    if len(outline) != 4:
        width, height = np.ptp(outline, axis=0)
        return float(width), float(height)
    top, right, bottom, left = np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)
    return float(top + bottom) / 2, float(left + right) / 2


def _panel(garment: Garment, outline: Floats, spacing: float) -> _Laid:
    """Return a four-cornered garment as one grid."""
    wide, high = (max(1, round(side / (spectral.POLYNOMIAL_ORDER * spacing))) for side in _sides(outline))
    grid = Grid(outline, wide, high, np.radians(garment.grain_degrees))
    if garment.is_panel:
        return _Laid(grid, bends_of(grid), np.arange(len(grid.rest))[None])
    return _sewn(garment, grid)


def _pattern(garment: Garment, spacing: float) -> _Laid:
    """Return the quadrilaterals of a garment that is no four-cornered panel; they follow its outline."""
    loops = [np.asarray(loop, float) for loop in (garment.outline_m, *garment.holes_m)]
    places, quads = quadrilaterals(loops, spectral.POLYNOMIAL_ORDER * spacing, name=garment.name)
    return _sewn(garment, quad_elements(places, quads, np.radians(garment.grain_degrees)))


def _sewn(garment: Garment, front: Elements) -> _Laid:
    """Return the front and, if there are seams, a back that faces the other way and shares the seams' nodes."""
    own = np.arange(len(front.rest))
    if not garment.seams:
        return _Laid(front, free_bends(front, own[None]), own[None])
    on_seam = np.zeros(len(own), bool)
    for a, b in garment.seams:
        on_seam |= place_along(front.rest, np.asarray([garment.outline_m[a], garment.outline_m[b]]))[1]
    back = np.where(on_seam, own, len(own) + np.cumsum(~on_seam) - 1)
    layers = np.stack([own, back])
    mirrored = np.arange(spectral.NODES_ALONG_ELEMENT**2).reshape(spectral.NODES_ALONG_ELEMENT, -1)[:, ::-1].ravel()
    elements = Elements(
        np.concatenate([front.rest, front.rest[~on_seam]]),
        np.concatenate([front.cells, back[front.cells[:, mirrored]]]),
        np.concatenate([front.corners, front.corners[:, [1, 0, 3, 2]]]),
        np.radians(garment.grain_degrees),
    )
    return _Laid(elements, free_bends(front, layers), layers)


def _held(garment: Garment, rest: Floats) -> tuple[Integers, Floats]:
    """Return the held nodes of all layers from left to right, and their positions along the held edge."""
    share, is_on = place_along(rest, np.asarray(garment.outline_m[:2], float))
    if garment.held == "corners":
        is_on &= np.abs(share - 0.5) > 0.5 - 1e-6
    held = np.flatnonzero(is_on)
    held = held[np.argsort(share[held], kind="stable")]
    return held, np.clip(share[held], 0.0, 1.0)


def _bulge(garment: Garment, rest: Floats, layers: Integers) -> Floats:
    """Return each node's initial distance behind the plane of the held edge [m], which separates front and back."""
    out = np.zeros(len(rest))
    if len(layers) > 1:
        joined = [np.asarray([garment.outline_m[a], garment.outline_m[b]]) for a, b in (*garment.seams, (0, 1))]
        out = np.minimum(LARGEST_BULGE, STEEPEST_BULGE * distance_to(rest, joined))
        out[layers[0]] *= -1
    return out


def _hem(outline: Floats, grid: Elements) -> Floats:
    """Return the length of the bottom edge that belongs to each node [m], (nodes,)."""
    length = np.zeros(len(grid.rest))
    nodes = grid.cells[:, RIMS].reshape(-1, spectral.NODES_ALONG_ELEMENT)
    for side in _bottom_sides(outline):
        is_on = place_along(grid.rest, side)[1][nodes].all(1)
        for element in nodes[is_on]:
            length[element] += (
                spectral.LOBATTO_WEIGHTS * np.linalg.norm(grid.rest[element[-1]] - grid.rest[element[0]]) / 2
            )
    return length


def _bottom_sides(outline: Floats) -> list[Floats]:
    """Return the sides of the bottom edge, (2, 2) each: a panel's third side, or an outline's low sides that face down.

    If an outline ends in a point, these are the sides that meet there.
    """
    sides = list(np.stack([outline, np.roll(outline, -1, 0)], 1))
    if len(outline) == 4:
        return [sides[2]]
    lowest = outline[:, 1].min() + LOWEST_SHARE * float(np.ptp(outline[:, 1]))
    level = [s for s in sides if s.mean(0)[1] < lowest and (s[0] - s[1])[0] > abs((s[0] - s[1])[1])]
    return level or [s for s in sides if s[:, 1].min() < lowest and (s[0] - s[1])[0] > 0]


def _triangles(cells: Integers) -> Indices:
    """Return two triangles between every four nodes of an element, turned to the front like the elements."""
    index = cells.reshape(-1, spectral.NODES_ALONG_ELEMENT, spectral.NODES_ALONG_ELEMENT).astype(np.int32)
    a, b, c, d = (i.reshape(-1) for i in (index[:, :-1, :-1], index[:, :-1, 1:], index[:, 1:, :-1], index[:, 1:, 1:]))
    return np.stack([np.stack([a, c, d], 1), np.stack([a, d, b], 1)], 1).reshape(-1, 3)


def _barycentric(place: Floats, corners: Floats) -> Floats:
    """Return the barycentric coordinates of a point `place`, (2,), in triangles, (n, 3, 2)."""
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    r = place - corners[:, 0]
    doubled = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    second = (r[:, 0] * q[:, 1] - r[:, 1] * q[:, 0]) / doubled
    third = (p[:, 0] * r[:, 1] - p[:, 1] * r[:, 0]) / doubled
    return np.stack([1 - second - third, second, third], 1)


def _locate(places: Floats, rest: Floats, triangles: Integers) -> tuple[Indices, Floats]:
    """Return triangle corners and weights that interpolate at each position; outside ones use the nearest triangle."""
    nodes, weights = [], []
    for place in places:
        inside = _barycentric(place, rest[triangles])
        best = int(np.argmax(inside.min(1)))
        clipped = np.clip(inside[best], 0, None)
        nodes.append(triangles[best])
        weights.append(clipped / clipped.sum())
    return np.array(nodes, np.int32).reshape(-1, 3), np.array(weights).reshape(-1, 3)


def _spread(points: Floats, rest: Floats) -> tuple[Indices, Floats]:
    """Return the piecewise linear interpolation from the tracked points to every node (Delaunay of the points).

    If the points span no triangle, the nearest one stands for a node; without points, all weights are 0.
    """
    from scipy.spatial import Delaunay, QhullError

    if not len(points):
        return np.zeros((len(rest), 3), np.int32), np.zeros((len(rest), 3))
    try:
        simplices = Delaunay(points).simplices
    except QhullError:
        closest = np.argmin(np.linalg.norm(rest[:, None] - points[None], axis=2), axis=1)
        return np.repeat(closest[:, None], 3, 1).astype(np.int32), np.tile([1.0, 0.0, 0.0], (len(rest), 1))
    return _locate(rest, points, simplices)
