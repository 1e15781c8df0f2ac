"""Initial shape of a T-shirt on a figure: the flat garment surrounds thin bones, which then grow to body size.

Front and back of the flat garment lie a few millimetres apart. All parts of the body are threads between them at first,
and widen step by step. After each step

    x_i <- x_i + (1/n_i) sum_j (1 - L_ij / |x_i - x_j|) (x_j - x_i) / 2

brings the n_i sides at node i back towards their length L_ij on the flat cloth. Nodes within a gap of a body move to
its surface, along the gradient of its distance. The front stays in front of the bones, and the back behind them. Every
node sinks a little. The collar moves from its position in the flat garment to the neck. The cloth relaxes the remaining
strain while it settles.

Source: M. Müller, B. Heidelberger, M. Hennix, J. Ratcliff, "Position based dynamics", J. Vis. Commun. Image Represent.
18 (2007): constraints on positions, averaged over the sides of a node
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.cloth.mesh import ClothMesh
from fit.recordings.bodies import Body
from formats.arrays import Booleans, Floats, Indices

# Steps of the body's growth, and of the cloth's relaxation after it. Our choice: the cloth relaxes the rest as it
# settles. A plain T-shirt, nodes 60 mm apart, is strained by 15 % in its worst hundredth. With half or twice as many
# steps of growth it is 15 and 14 %, of relaxation 18 and 13 % (measured).
GROWING, GROWN = 120, 150
# Of the sides in each step. Our choice: the strain above is 19 % with half as many, and 12 % with twice as many, which
# take twice the time (measured).
SIDE_ROUNDS = 6
# Of a body's size, at first. Our choice: 3.4 of 170 mm fit between the layers. Half and twice leave the strain above as
# it is (measured).
FIRST_SIZE = 0.02
HALF_APART = 0.004  # m of either layer from the middle, at first
SINKING = 1e-5  # m per round: sinking, so that loose hems fall instead of folding
SMALL_STEP = 1e-5  # m: step of the finite differences of a gradient
PUSH = 1.2  # of the mean correction: over-relaxation


def dressed(
    mesh: ClothMesh,
    is_back: Booleans,
    held: Indices,
    collar: Floats,
    origin: Floats,
    bodies: tuple[Body, ...],
    gap: float,
) -> Floats:
    """Return initial positions of a garment's nodes on a figure that faces -y [m], (nodes, 3), world frame.

    - `is_back`, (nodes,)
    - `held`, (held,): nodes of the collar, and their positions `collar` [m], (held, 3)
    - `origin` [m], (3,): position of the flat garment's origin
    - `gap` [m]: distance of nodes from the bodies
    """
    places = origin + np.column_stack(
        [mesh.rest[:, 0], np.where(is_back, HALF_APART, -HALF_APART), mesh.rest[:, 1]]
    )  # fmt: skip
    sides, length = _sides(mesh)
    front = np.setdiff1d(np.flatnonzero(~is_back), mesh.cells[len(mesh.cells) // 2 :])
    behind = np.flatnonzero(is_back)
    front_most, back_most = origin[1] - HALF_APART, origin[1] + HALF_APART
    touched = np.maximum(np.bincount(sides.ravel(), minlength=len(places)), 1)[:, None]
    begun = places[held].copy()
    for size in np.concatenate([np.linspace(FIRST_SIZE, 1.0, GROWING), np.ones(GROWN)]):
        grown = [_sized(body, float(size)) for body in bodies]
        for _ in range(SIDE_ROUNDS):
            way = places[sides[:, 0]] - places[sides[:, 1]]
            far = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
            step = 0.5 * (1 - length / far)[:, None] * way
            moved = np.stack(
                [
                    np.bincount(sides[:, 1], step[:, axis], len(places))
                    - np.bincount(sides[:, 0], step[:, axis], len(places))
                    for axis in range(3)
                ],
                axis=1,
            )
            places = places + PUSH * moved / touched - [0.0, 0.0, SINKING]
            places[front, 1] = np.minimum(places[front, 1], front_most)
            places[behind, 1] = np.maximum(places[behind, 1], back_most)
            places[held] = begun + (collar - begun) * size
            for body in grown:
                _push_out(places, body, gap * float(size))
            places[held] = begun + (collar - begun) * size
    return np.asarray(places)


def _sides(mesh: ClothMesh) -> tuple[Indices, Floats]:
    """Return the sides of the drawn triangles, (sides, 2), and their length on the flat cloth [m], (sides,)."""
    every = np.concatenate([mesh.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    sides = np.unique(np.sort(every, axis=1), axis=0)
    length = np.linalg.norm(mesh.rest[sides[:, 0]] - mesh.rest[sides[:, 1]], axis=1)
    return sides[length > 1e-9], np.asarray(length[length > 1e-9])


def _sized(body: Body, size: float) -> Body:
    """Return a body of the same length and `size` times the width."""
    wide, deep, long = body.half_size
    return replace(body, half_size=(wide * size, deep * size, long), radius=body.radius * size, taper=body.taper * size)


def _push_out(places: Floats, body: Body, gap: float) -> None:
    """Move positions that are within a gap [m] of a body to this distance, in place."""
    reach = np.linalg.norm(body.half_size) + body.radius + abs(body.taper) * body.half_size[2] + gap
    near = np.flatnonzero(((places - np.array(body.centre)) ** 2).sum(1) < reach**2)
    distance = body.distance(places[near])
    near, distance = near[distance < gap], distance[distance < gap]
    if not len(near):
        return
    ahead, behind = body.distance(places[near] + SMALL_STEP * np.concatenate([np.eye(3), -np.eye(3)])[:, None]).reshape(
        2, 3, -1
    )
    slope = (ahead - behind).T
    out = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    places[near] += (gap - distance)[:, None] * out
