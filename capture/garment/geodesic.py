"""The garment's centre: the point of the visible surface with the largest geodesic distance to its nearest corner.

    centre = argmax_p min_i d(p, corner_i),     d = length of the shortest path on the depth surface

Source: the max-min distant point of "Estimating the clothes characteristics with the image and depth sensors for
developing virtual fitting room", section 2. The paper finds d with Dijkstra's algorithm (Numerische Mathematik 1,
1959).

Here the surface is a grid of block means of depth. Each node is joined to 16 neighbours, the chess moves of king and
knight. These paths are at most 2.7 % too long in any direction, and 0.4 % near the diagonals of a panel's centre. All
four distance maps are relaxed together over the whole grid until nothing changes (Bellman 1958). The distances are
those of Dijkstra's queue on the same graph, in array operations.
"""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np

from formats.arrays import Floats, Singles

# Half of the 16 moves (rows, columns); the other half are their opposites.
MOVES = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
# path length per distance across the view; a steeper step joins two folds, not one surface. With 1.4 the centre
# is located in 83 % of the frames of the scenes below, with 4 in 84 as with this.
STEEPEST_STEP = 2.0
# grid steps from a corner to the nodes that its distance map starts from. Our choice: 20 nodes around a corner, so
# that one missing node does not matter. On nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`) half
# locates the centre in 54 % of the frames in place of 84 %. Double puts the centre off by 3.5 mm in place of 3.3.
SOURCE_REACH = 2.5
GRID_PADDING = 2  # nodes of padding around the grid so that every move stays inside the arrays
# nodes to either side over which a distance map is smoothed by a parabola. Our choice: 25 values for a parabola's 6
# numbers. On the same scenes the centre is off by 3.3 mm, with half as well. Double costs three times the time and
# puts the centre off by 3.5 mm.
FIT_REACH = 2
WHOLE_PATCH = np.ones((2 * FIT_REACH + 1, 2 * FIT_REACH + 1), np.uint8)  # nodes of one parabola
# points per grid step at which the smoothed maps are compared. Our choice: 3.5 mm at a step of 28 mm, below the
# depth's noise. On the same scenes the centre is off by 3.3 mm; by 4.6 mm with half, and by 3.2 mm with double.
FINE_STEPS = 8


def geodesic_distances(surface: Floats, sources: Floats) -> tuple[Singles, Floats]:
    """Return the geodesic distances from each source to each node, and from each source to each other source.

    surface [m], (rows, columns, 3), any frame, NaN where there is none; sources [m], (k, 3), on the surface.
    Returns [m], (k, rows, columns) and (k, k); infinite if no path exists, and for sources that are NaN.

    The nodes are stored in one flat array, grid after grid and row after row, with padding between. So a move is one
    shift of the whole array.
    """
    rows, columns, _ = surface.shape
    count, width = len(sources), columns + GRID_PADDING
    margin, nodes = GRID_PADDING * width, (rows + GRID_PADDING) * width
    line = np.full((3, nodes + margin), np.nan, dtype=np.float32)
    line[:, :nodes].reshape(3, -1, width)[:, :rows, :columns] = surface.transpose(2, 0, 1)
    spacing = _spacing(surface)
    steps = []
    for down, right in MOVES:
        shift = down * width + right
        x, y, z = line[:, shift:] - line[:, : nodes + margin - shift]
        length = np.full(nodes, np.inf, dtype=np.float32)
        squared = (x * x + y * y + z * z)[:nodes]
        limit = (STEEPEST_STEP * spacing * math.hypot(down, right)) ** 2
        np.sqrt(squared, out=length[: squared.size], where=squared < limit)
        steps.append((shift, np.tile(length, count)))
    away = np.sqrt(((line[:, :nodes] - sources[:, :, None].astype(np.float32)) ** 2).sum(1))
    start = np.where(away < SOURCE_REACH * spacing, away, np.float32(np.inf))
    distance = _relaxed(start.ravel(), steps, margin + GRID_PADDING).reshape(count, nodes)
    apart = np.empty((count, count))
    for j, reached in enumerate(start):
        near = np.flatnonzero(reached < np.inf)
        apart[:, j] = (distance[:, near] + reached[near]).min(1) if near.size else np.inf
    np.fill_diagonal(apart, 0.0)
    grid = distance.reshape(count, -1, width)[:, :rows, :columns]
    return np.ascontiguousarray(grid), np.minimum(apart, apart.T)


def _relaxed(start: Singles, steps: list[tuple[int, Singles]], margin: int) -> Singles:
    """Return the distances, (nodes of the array,), relaxed over all moves in both directions until nothing changes."""
    nodes = start.size
    whole = np.concatenate([start, np.full(margin, np.inf, dtype=np.float32)])
    here, way = whole[:nodes], np.empty_like(start)
    before = start
    while True:
        for shift, length in steps:
            there = whole[shift : shift + nodes]
            np.minimum(here, np.add(there, length, out=way), out=here)
            np.minimum(there, np.add(here, length, out=way), out=there)
        if np.array_equal(here, before):
            return before
        before = here.copy()


def farthest_place(distances: Singles) -> tuple[float, float] | None:
    """Return the point (row, column), in nodes, whose nearest source is farthest away.

    distances [m], (k, rows, columns). Only points inside the surface count, because a maximum at its border is an
    artefact. None if no such point is reached from every source, or if it lies at the border of the reached region.
    """
    nearest = distances.min(0)
    reached = np.isfinite(distances).all(0)
    if min(reached.shape) < len(WHOLE_PATCH):
        return None
    inner = cv2.erode(reached.astype(np.uint8), WHOLE_PATCH, borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
    if not inner.any():
        return None
    row, column = np.unravel_index(int(np.argmax(np.where(inner, nearest, -1.0))), nearest.shape)
    around = (
        slice(row - FIT_REACH, row + FIT_REACH + 1),
        slice(column - FIT_REACH, column + FIT_REACH + 1),
    )
    patch = distances[:, around[0], around[1]]
    if nearest[row - 1 : row + 2, column - 1 : column + 2].max() > nearest[row, column]:
        return None
    fine, smoothing = _smoother()
    smooth = (patch.reshape(len(patch), -1).astype(np.float64) @ smoothing).min(0)
    best_row, best_column = np.unravel_index(int(np.argmax(smooth)), (fine.size, fine.size))
    return float(row + fine[best_row]), float(column + fine[best_column])


@cache
def _smoother() -> tuple[Floats, Floats]:
    """Return fine coordinates along a patch, and the matrix from node values to the fitted parabola at their pairs."""
    coarse = np.arange(-FIT_REACH, FIT_REACH + 1, dtype=np.float64)
    fine = np.arange(-FIT_REACH * FINE_STEPS, FIT_REACH * FINE_STEPS + 1) / FINE_STEPS
    return fine, np.asarray((_parabola(fine) @ np.linalg.pinv(_parabola(coarse))).T)


def _parabola(along: Floats) -> Floats:
    """Return the terms 1, r, c, r^2, rc, c^2 at every pair of coordinates, (coordinates^2, 6)."""
    r, c = (grid.ravel() for grid in np.meshgrid(along, along, indexing="ij"))
    return np.stack([np.ones_like(r), r, c, r * r, r * c, c * c], axis=1)


def _spacing(surface: Floats) -> float:
    """Return the typical distance between neighbouring nodes of a row [m]."""
    across = np.abs(np.diff(surface[..., 0], axis=1))
    across = across[np.isfinite(across)]
    return float(np.partition(across, across.size // 2)[across.size // 2]) if across.size else 0.0
