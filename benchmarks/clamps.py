"""Clamps on simulated cloth, or no support at all, for benchmarks and tests with closed-form solutions.

A clamp has three handles (`fit.cloth.support`), the images of the flat cloth's origin and axes. The node at (X, Y) is
at origin + X across + Y down. So a clamp keeps a strip of cloth flat and at its angle; a single row of nodes is a
hinge. A frame whose axes turn against each other shears the cloth in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fit.cloth.mesh import ClothMesh
from fit.cloth.model import ClothModel
from fit.cloth.support import Support, Supporting
from fit.errors import FitError
from fit.recordings.recording import Curve
from formats.arrays import Booleans, Floats
from formats.nature import GRAVITY


@dataclass(frozen=True)
class Clamp:
    """A clamp over part of the cloth.

    - `holds`: positions on the flat cloth [m], (n, 2) -> which of them it holds, (n,)
    - `frame`: (n,) instants [s] -> (n, 9): images of the flat cloth's origin [m], of its x axis and of its y axis
    """

    holds: Callable[[Floats], Booleans]
    frame: Curve


def clamps(
    *chosen: Clamp, start: Floats, gravity: float = GRAVITY, stir: Callable[[Floats], Floats] | None = None
) -> Supporting:
    """Return clamps, or no support if none is given.

    - `start` [m], (9,): the frame, as a clamp's, in which the flat cloth begins at rest
    - `stir`: positions on the flat cloth [m], (n, 2) -> initial displacement out of its plane [m], (n,).

    Raises:
        FitError: raised by the returned function, if a clamp holds no node of the mesh.
    """

    def support(mesh: ClothMesh) -> Support:
        masks = [clamp.holds(mesh.rest) for clamp in chosen]
        for k, mask in enumerate(masks):
            if not mask.any():
                raise FitError(
                    "it holds no node",
                    where=f"clamp {k + 1} of {len(masks)}",
                    advice="hold a wider strip, or mesh finer",
                )
        nodes = np.concatenate([np.zeros(0, int), *(np.flatnonzero(mask) for mask in masks)])
        affine = np.column_stack([np.ones(len(mesh.rest)), mesh.rest])
        shares = np.zeros((len(nodes), 3 * len(chosen)))
        done = 0
        for k, mask in enumerate(masks):
            shares[done : done + mask.sum(), 3 * k : 3 * k + 3] = affine[mask]
            done += int(mask.sum())
        places = affine @ np.reshape(start, (3, 3))
        if stir is not None:
            normal = np.cross(start[3:6], start[6:])
            places = places + stir(mesh.rest)[:, None] * normal / np.linalg.norm(normal)
        return Support(
            nodes=nodes.astype(np.int32),
            shares=shares,
            path=lambda instants: np.column_stack(
                [np.zeros((len(instants), 0)), *(clamp.frame(instants) for clamp in chosen)]
            ),
            start=lambda handles: np.repeat(places[None], len(handles), 0),
            settle_time=0.0,
            gravity=gravity,
        )

    return support


def steps_of(model: ClothModel, materials: Floats) -> Floats:
    """Return the time step [s] of each candidate without effects, (candidates,)."""
    steps = np.zeros(len(materials))
    for group in model.groups(materials, None, shapes=False)[1]:
        steps[group.members] = group.dt
    return steps
