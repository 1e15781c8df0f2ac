"""A plain, even grid of a flat garment, for engines whose cloth is made of vertices and faces.

Nodes lie at even s and t:

    x(s, t) = (1-t)((1-s) top left + s top right) + t ((1-s) bottom left + s bottom right)

The four corners of a face interpolate a tracked point with the same weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth.elements import grid_places
from fit.errors import FitError
from formats.arrays import Floats, Integers
from formats.garment import Garment


@dataclass(frozen=True)
class PlainGrid:
    """An even grid of a garment.

    - `rest` [m], (nodes, 2), row by row from the top
    - `quads`, (faces, 4)
    - `held_nodes`, (held,)
    - `held_fraction`, (held,): their place along the held edge
    - `point_nodes`, `point_weights`, (points, 4)
    """

    rest: Floats
    quads: Integers
    held_nodes: Integers
    held_fraction: Floats
    point_nodes: Integers
    point_weights: Floats

    @property
    def triangles(self) -> Integers:
        """Return the same surface for drawing, (2 faces, 3)."""
        return np.concatenate([self.quads[:, :3], self.quads[:, [0, 2, 3]]])


def plain_grid(garment: Garment, spacing: float) -> PlainGrid:
    """Lay an even grid of about `spacing` [m] over a four-cornered garment.

    Raises:
        FitError: the outline does not have four corners, or the spacing is larger than the garment.
    """
    outline = np.asarray(garment.outline_m, float)
    sides = np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)
    if not garment.is_panel or not 0 < spacing <= sides.min() / 2:
        raise FitError(
            f"a grid of {spacing} m does not fit {len(outline)} corners, the shortest side {sides.min():.3f} m",
            where=garment.name,
            advice="this engine takes plain four-cornered panels only; choose our own, or a smaller spacing",
        )
    columns = round(0.5 * (sides[0] + sides[2]) / spacing) + 1
    rows = round(0.5 * (sides[1] + sides[3]) / spacing) + 1
    t, s = (place.ravel() for place in np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij"))
    corners = outline[[0, 1, 3, 2]]
    rest = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], 1) @ corners
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    held = index[0] if garment.held == "edge" else index[0, [0, -1]]
    places = grid_places(np.array([p.at_m for p in garment.points], float).reshape(-1, 2), outline)
    column = np.minimum((places[:, 0] * (columns - 1)).astype(int), columns - 2)
    row = np.minimum((places[:, 1] * (rows - 1)).astype(int), rows - 2)
    a, b = places[:, 0] * (columns - 1) - column, places[:, 1] * (rows - 1) - row
    return PlainGrid(
        rest=rest,
        quads=quads,
        held_nodes=held,
        held_fraction=held / (columns - 1),
        point_nodes=np.stack(
            [index[row, column], index[row, column + 1], index[row + 1, column], index[row + 1, column + 1]], 1
        ),
        point_weights=np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], 1),
    )
