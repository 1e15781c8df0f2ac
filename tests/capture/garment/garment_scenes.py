"""Garments that hang flat and still before the synthetic camera, whole, folded or covered."""

from __future__ import annotations

import numpy as np

from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.pattern import lay
from firmware_host.synthetic.scene import place
from firmware_host.synthetic.surroundings import Surroundings
from firmware_host.synthetic.world import NODES_OF_BODY, World
from tests.firmware_host.rooms import plain


def hung(kind: str, distance: float, *, surroundings: Surroundings | None = None, seed: int = 3, fold=None) -> World:
    """A garment hanging flat from its held edge at a distance [m].

    fold: (a, b), two places [m] on the flat garment; what lies right of the way from a to b is folded behind the rest.
    """
    garment = GARMENTS[kind]()
    pattern = lay(garment, *NODES_OF_BODY.get(garment.kind, (46, 41)))
    hanger = place(np.zeros((2, 3)), np.zeros(2), np.zeros(2))

    def to_sensor(flat: np.ndarray) -> np.ndarray:
        out = np.zeros((*flat.shape[:-1], 3))
        if fold is not None:
            a, b = (np.asarray(p, float) for p in fold)
            normal = np.array([(b - a)[1], -(b - a)[0]]) / np.linalg.norm(b - a)
            beyond = np.maximum((flat - a) @ normal, 0.0)
            flat = flat - 2.0 * beyond[..., None] * normal
            out[..., 2] = 0.35 * beyond  # folded by 160 degrees: behind, and not touching
        out[..., 0], out[..., 1] = flat[..., 0], -flat[..., 1]
        return out + 0.5 * (hanger.held[0, 0] + hanger.held[0, 1])

    nodes = np.stack([to_sensor(pattern.rest[..., :2])] * 2)
    points = np.stack([to_sensor(np.array([p.at_m for p in garment.points]))] * 2)
    world = World(np.array([0.0, 1 / 30]), hanger, nodes, points, seed, garment)
    return world.at(distance, seed=seed, surroundings=surroundings or plain(distance))
