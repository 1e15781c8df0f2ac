"""A T-shirt's collar: a closed curve round the neck that is lower in front and behind than on the shoulders.

Seen along the neck it is two half circles of radius r and two straight sides of 2 a. At the angle t from the shoulder
it is depressed by z = -d sin^2 t. A quarter of it then has the length

    integral of sqrt(r^2 + (d sin 2t)^2) from t = 0 to pi/2

and the straight sides take what the neck's girth leaves. Nodes lie on it at their distance along the neck's edge.
"""

from __future__ import annotations

import numpy as np

from fit.cloth.mesh import ClothMesh
from fit.figure.shirt import collar_girth, neck_sides
from fit.recordings.held_edge import place_along
from formats.arrays import Booleans, Floats, Indices
from formats.garment import Garment

# m from the neck, nearer in front by the tilt; of the height, above the shoulders' joints.
APART, COLLAR_HEIGHT = 0.012, 0.034
TILT = np.radians(12.0)  # rad, lower in front: with DIP the neck is as high behind as on the shoulders
DIP = 0.018  # m: depth of its middle in front and behind
PIECES_OF_A_QUARTER = 64  # of a quarter; chords leave an arc of 6 cm by 5 um


def half_side(garment: Garment, radius: float) -> float:
    """Return a of the collar of a sewn T-shirt [m], below 0 where its neck is too narrow for the radius [m]."""
    corner = _quarter(radius)
    return collar_girth(garment) / 4 - float(np.linalg.norm(np.diff(corner, axis=0), axis=1).sum())


def collar_nodes(garment: Garment, mesh: ClothMesh) -> tuple[Indices, Floats]:
    """Return the nodes on a sewn T-shirt's neckline, (held,), and their arc length [m] from its left end."""
    way, gone = np.full(len(mesh.rest), np.nan), 0.0
    for side in neck_sides(garment):
        share, is_on = place_along(mesh.rest, side)
        long = float(np.linalg.norm(side[1] - side[0]))
        way[is_on] = gone + np.clip(share[is_on], 0, 1) * long
        gone += long
    held = np.flatnonzero(np.isfinite(way)).astype(np.int32)
    return held, way[held]


def collar_places(way: Floats, is_back: Booleans, radius: float, half: float) -> Floats:
    """Return positions of the collar's nodes [m], (n, 3): left, back and up.

    - way [m], (n,): arc length along the neckline, in front or behind
    - radius [m], half [m]: r and a
    """
    first = _quarter(radius)
    aside = np.array([half, 0.0, 0.0])
    curve = np.concatenate([first - aside, first[::-1] * [-1.0, 1.0, 1.0] + aside])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    places = np.stack([np.interp(way, along, curve[:, axis]) for axis in range(3)], 1)
    places[:, 1] *= np.where(is_back, 1.0, -1.0)
    return places


def _quarter(radius: float) -> Floats:
    """Return the curved quarter of the collar from its right end to its middle [m], (pieces + 1, 3)."""
    turn = np.linspace(0, np.pi / 2, PIECES_OF_A_QUARTER + 1)
    return np.stack([-radius * np.cos(turn), radius * np.sin(turn), -DIP * np.sin(turn) ** 2], 1)
