"""Moving rigid meshes of a figure's parts, for pictures and mesh files."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from fit.recordings.bodies import Body, BodyMotion
from formats.arrays import Floats, Integers

VERTICES_AROUND, VERTICES_RISING = 24, 6  # vertices around a part, a multiple of 4, and from its middle to either end


@dataclass(frozen=True, eq=False)
class Solids:
    """Rigid bodies and their motion, world frame."""

    names: tuple[str, ...]
    bodies: tuple[Body, ...]
    motion: BodyMotion

    @functools.cached_property
    def meshes(self) -> tuple[tuple[Floats, Integers], ...]:
        """Return for each body its vertices [m] along its axes, (n, 3), and its triangles, oriented outwards."""
        return tuple(mesh_of(body) for body in self.bodies)

    @functools.cached_property
    def triangles(self) -> Integers:
        """Return the triangles of all bodies together, with vertices as in `places`."""
        firsts = np.cumsum([0, *(len(places) for places, _ in self.meshes)])
        return np.concatenate([t + first for (_, t), first in zip(self.meshes, firsts, strict=False)])

    def places(self, instant: float) -> Floats:
        """Return the vertices of all bodies at an instant [s], (n, 3) [m], world frame."""
        poses = self.motion.at(np.array([instant]))[0]
        return np.concatenate(
            [p @ pose[3:].reshape(3, 3) + pose[:3] for (p, _), pose in zip(self.meshes, poses, strict=True)]
        )


def mesh_of(body: Body) -> tuple[Floats, Integers]:
    """Return the surface of a body along its own axes: vertices [m], (n, 3), and triangles, (m, 3).

    The vertices of a sphere are shifted to the nearest corner of the core box. At the four quarters and the middle two
    vertices face two corners each, and the sides of the box lie between them.
    """
    quarter = np.linspace(0, np.pi / 2, VERTICES_AROUND // 4 + 1)
    round_ = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    signs = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], len(quarter), axis=0)
    rising = np.concatenate(
        [np.linspace(-np.pi / 2, 0, VERTICES_RISING + 1), np.linspace(0, np.pi / 2, VERTICES_RISING + 1)]
    )
    ends = np.repeat([-1.0, 1.0], VERTICES_RISING + 1)
    half = np.array(body.half_size)
    radius = body.radius + body.taper * ends * half[2]
    places = np.stack(
        [
            signs[None, :, 0] * half[0] + (radius * np.cos(rising))[:, None] * np.cos(round_),
            signs[None, :, 1] * half[1] + (radius * np.cos(rising))[:, None] * np.sin(round_),
            np.repeat((ends * half[2] + radius * np.sin(rising))[:, None], len(round_), 1),
        ],
        -1,
    )
    rows, columns = places.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    after = np.roll(index, -1, 1)
    a, b, c, d = (i.ravel() for i in (index[:-1], after[:-1], index[1:], after[1:]))
    return places.reshape(-1, 3), np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
