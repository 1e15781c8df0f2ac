"""Lay a grid of nodes over a flat garment: a panel as one block, a T-shirt as a body with a sleeve at either side.

A block between four corners is bilinear. The T-shirt's blocks share the nodes of its armholes, so the grid stays
rectangular and the cells below the sleeves are left out:

    sleeve | body | sleeve        rows down to the underarm
      -    | body |   -           rows below it
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_host.errors import SensorAddressError
from formats.arrays import Booleans, Floats, Integers
from formats.garment import Garment

SHIRT_CORNERS = 10  # shoulder, shoulder, sleeve hem (2), underarm, body hem (2), underarm, sleeve hem (2)
# cells across a sleeve. Our choice: finer than the panels, as a sleeve is narrow. Half and double were not tried.
SLEEVE_COLUMNS = 7
SLEEVE_BULGE = 0.03  # m, initial distance of a hanging sleeve's hem from the plane, so that it can buckle


@dataclass(frozen=True)
class Pattern:
    """Nodes on the flat garment and the cells between them.

    rest [m], (rows, columns, 3), z = 0; is_cloth, (rows - 1, columns - 1); held: the top row's held columns
    """

    rest: Floats
    is_cloth: Booleans
    held: slice

    @property
    def is_node(self) -> Booleans:
        """Return which nodes belong to any cell, (rows, columns)."""
        found = np.zeros(self.rest.shape[:2], bool)
        for i in (slice(None, -1), slice(1, None)):
            for j in (slice(None, -1), slice(1, None)):
                found[i, j] |= self.is_cloth
        return found

    @property
    def bulge(self) -> Floats:
        """Return the nodes' initial distance from the plane [m], (rows, columns): 0 on a panel."""
        out = np.zeros(self.rest.shape[:2])
        left, right = self.held.start or 0, self.rest.shape[1] - 1 - (self.held.stop or self.rest.shape[1]) + 1
        if left:
            out[:, :left] = SLEEVE_BULGE * np.linspace(1, 0, left, endpoint=False) ** 2
            out[:, -right:] = SLEEVE_BULGE * np.linspace(1, 0, right, endpoint=False)[::-1] ** 2
        return out

    def material(self, place: tuple[float, float]) -> tuple[Integers, Floats]:
        """Return the four nodes, (4, 2) rows and columns, and their weights, (4,), at a point [m] of the flat garment.

        The nearest cell's bilinear weights, found by Newton's iteration from its middle.
        """
        target = np.asarray(place, float)
        row, column = np.nonzero(self.is_cloth)
        nodes = np.stack([np.stack([row + down, column + across], -1) for down in (0, 1) for across in (0, 1)], 1)
        corners = self.rest[nodes[..., 0], nodes[..., 1], :2]
        weights = _bilinear_weights(corners, target)
        off = np.linalg.norm(np.einsum("ij,ijk->ik", weights, corners) - target, axis=1)
        nearest = int(np.argmin(off))
        return nodes[nearest], weights[nearest]


def _bilinear_weights(corners: Floats, target: Floats) -> Floats:
    """Return weights, (cells, 4), of corners, (cells, 4, 2), for a point, (2,), clipped to each cell.

    Corners are top left, top right, bottom left and bottom right.
    """
    place = np.full((len(corners), 2), 0.5)  # across and down, as shares of the cell
    top, bottom, left, right = corners[:, :2], corners[:, 2:], corners[:, ::2], corners[:, 1::2]

    def weights_of(place: Floats) -> Floats:
        s, t = place.T
        return np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], 1)

    for _ in range(8):
        s, t = place[:, :1], place[:, 1:]
        across = (1 - t) * (top[:, 1] - top[:, 0]) + t * (bottom[:, 1] - bottom[:, 0])
        down = (1 - s) * (left[:, 1] - left[:, 0]) + s * (right[:, 1] - right[:, 0])
        off = target - np.einsum("ij,ijk->ik", weights_of(place), corners)
        step = np.linalg.solve(np.stack([across, down], axis=2), off[..., None])[..., 0]
        place = np.clip(place + step, 0, 1)
    return weights_of(place)


def lay(garment: Garment, rows: int, columns: int) -> Pattern:
    """Return the pattern of a garment; `rows` and `columns` count the nodes of a panel or of a T-shirt's body.

    Raises:
        SensorAddressError: the synthetic world cannot make such an outline.
    """
    outline = np.asarray(garment.outline_m, float)
    if len(outline) == 4:
        top_left, top_right, bottom_right, bottom_left = outline
        rest = _block(top_left, top_right, bottom_left, bottom_right, rows, columns)
        return Pattern(_with_depth(rest), np.ones((rows - 1, columns - 1), bool), slice(None))
    if garment.kind == "t-shirt" and len(outline) == SHIRT_CORNERS:
        return _shirt(outline, rows, columns)
    raise SensorAddressError(
        f"the synthetic world cannot make a {garment.kind} with {len(outline)} corners",
        where=garment.name,
        advice=f"give a panel of 4 corners, or a T-shirt of {SHIRT_CORNERS}",
    )


def _shirt(outline: Floats, rows: int, columns: int) -> Pattern:
    left, right, right_tip, right_cuff, right_arm, right_hem, left_hem, left_arm, left_cuff, left_tip = outline
    share = abs(right_arm[1] - right[1]) / abs(right_hem[1] - right[1])
    under = max(2, round(share * (rows - 1)))  # the row of nodes at the underarms
    upper = _block(left, right, left_arm, right_arm, under + 1, columns)
    lower = _block(left_arm, right_arm, left_hem, right_hem, rows - under, columns)
    body = np.concatenate([upper, lower[1:]])
    left_sleeve = _block(left_tip, left, left_cuff, left_arm, under + 1, SLEEVE_COLUMNS + 1)[:, :-1]
    right_sleeve = _block(right, right_tip, right_arm, right_cuff, under + 1, SLEEVE_COLUMNS + 1)[:, 1:]
    rest = np.concatenate([np.zeros((rows, SLEEVE_COLUMNS, 2)), body, np.zeros((rows, SLEEVE_COLUMNS, 2))], axis=1)
    rest[: under + 1, :SLEEVE_COLUMNS] = left_sleeve
    rest[: under + 1, -SLEEVE_COLUMNS:] = right_sleeve
    # Nodes off the cloth only keep the arrays rectangular; they must not coincide.
    drop = body[under + 1 :, :1] - body[under, :1]
    rest[under + 1 :, :SLEEVE_COLUMNS] = left_sleeve[-1] + drop
    rest[under + 1 :, -SLEEVE_COLUMNS:] = right_sleeve[-1] + drop
    is_cloth = np.ones((rows - 1, rest.shape[1] - 1), bool)
    is_cloth[under:, :SLEEVE_COLUMNS] = False
    is_cloth[under:, -SLEEVE_COLUMNS:] = False
    return Pattern(_with_depth(rest), is_cloth, slice(SLEEVE_COLUMNS, SLEEVE_COLUMNS + columns))


def _block(
    top_left: Floats, top_right: Floats, bottom_left: Floats, bottom_right: Floats, rows: int, columns: int
) -> Floats:
    """Bilinear nodes, (rows, columns, 2), between four corners."""
    down, across = np.linspace(0, 1, rows)[:, None, None], np.linspace(0, 1, columns)[None, :, None]
    return np.asarray(
        (1 - down) * ((1 - across) * top_left + across * top_right)
        + down * ((1 - across) * bottom_left + across * bottom_right)
    )


def _with_depth(flat: Floats) -> Floats:
    return np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=-1)
