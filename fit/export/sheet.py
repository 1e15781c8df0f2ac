"""Sheets of cloth at rest for export: a swatch of the fabric, or the garment of a take.

World frame: z up, x along the held edge, y away from a viewer of the front; metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth.mesh import MOST_MESH_NODES, build_mesh
from fit.errors import out_of_range
from formats.arrays import Floats, Integers
from formats.garment import Garment
from formats.meant_units import UNITS

EXPORTED_SIDE = 0.3  # m; our choice: 15 times `SWATCH_SPACING`, several folds wide, half and double were not tried
SWATCH_SPACING = 0.02  # m: folds of hanging cloth are several times wider


@dataclass(frozen=True)
class Sheet:
    """A sheet of cloth at rest: nodes, triangles and flat positions.

    - `name`
    - `rest` [m], (nodes, 2): x across, y up on the flat cloth
    - `start` [m], (nodes, 3): hanging flat, world frame
    - `triangles`, (n, 3), anticlockwise as seen from the front
    - `held`, (m,): nodes of the held edge
    """

    name: str
    rest: Floats
    start: Floats
    triangles: Integers
    held: Integers

    @property
    def node_areas(self) -> Floats:
        """Return each node's third of its triangles' areas [m^2], (nodes,)."""
        a, b, c = (self.rest[self.triangles[:, k]] for k in range(3))
        p, q = b - a, c - a
        areas = 0.5 * np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
        shared = np.zeros(len(self.rest))
        np.add.at(shared, self.triangles.ravel(), np.repeat(areas / 3, 3))
        return shared


def check_strip(width: float, height: float, spacing: float) -> None:
    """Refuse a grid that does not fit a rectangle, or has too many nodes.

    Raises:
        FitError: the spacing is too fine or too coarse.
    """
    finest, coarsest = np.sqrt(width * height / MOST_MESH_NODES), min(width, height)
    if not finest <= spacing <= coarsest:
        what = f"a spacing of {spacing:g} m does not fit a swatch of {width:g} m x {height:g} m"
        raise out_of_range(spacing, finest, coarsest, what, where="--spacing", unit="m", units=UNITS)


def strip(width: float, height: float, spacing: float, name: str = "swatch") -> Sheet:
    """Return a rectangle as an even grid of right triangles whose diagonals alternate, held at its top edge.

    Raises:
        FitError: the spacing does not fit into it.
    """
    check_strip(width, height, spacing)
    columns, rows = round(width / spacing) + 1, round(height / spacing) + 1
    x, y = np.linspace(-width / 2, width / 2, columns), np.linspace(0.0, -height, rows)
    rest = np.stack([np.tile(x, rows), np.repeat(y, columns)], 1)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    odd = ((np.arange(rows - 1)[:, None] + np.arange(columns - 1)) % 2).ravel().astype(bool)[:, None]
    first = np.where(odd, np.stack([a, c, b], 1), np.stack([a, c, d], 1))
    second = np.where(odd, np.stack([b, c, d], 1), np.stack([a, d, b], 1))
    return Sheet(name, rest, upright(rest), np.concatenate([first, second]), index[0])


def garment_sheet(garment: Garment, spacing: float) -> Sheet:
    """Return a garment's sheet with the mesh of the fit's simulation.

    Raises:
        FitError: the garment cannot be meshed.
    """
    mesh = build_mesh(garment, spacing)
    start = upright(mesh.rest)
    start[:, 1] = mesh.bulge
    return Sheet(
        garment.name, mesh.rest, start, mesh.triangles.astype(np.int64), mesh.held_nodes.astype(np.int64)
    )  # fmt: skip


def upright(rest: Floats) -> Floats:
    """Return flat hanging cloth in the world frame, (nodes, 3)."""
    return np.stack([rest[:, 0], np.zeros(len(rest)), rest[:, 1]], 1)
