"""Arrays that the rollout kernel needs to know of one cloth: membrane, bending and contact, in the kernel's order."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fit import runtime
from fit.cloth import spectral
from fit.cloth.contact import Contact, Surface
from fit.cloth.lines import BETWEEN, bends_by_line, fibre_family, twist_scales
from fit.cloth.mesh import ClothMesh, Integers

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Numbers = TypeVar("Numbers", Floats, Singles, Integers)


def membrane_arguments(mesh: ClothMesh) -> list[Singles | Integers | int]:
    """What the kernel wants to know of the membrane, in its order."""
    families = [fibre_family(mesh, k) for k in range(2)]
    return [
        3 * np.concatenate([nodes for _, nodes, _ in families]), np.concatenate([w for _, _, w in families]),
        len(families[0][1]), single(mesh.fibres.area), mesh.fibres_across,
        3 * mesh.shear_across.ravel(), 3 * mesh.shear_down.ravel(), BETWEEN,
        single(mesh.shear_area),
    ]  # fmt: skip


def bending_arguments(mesh: ClothMesh) -> list[Singles | Integers]:
    """What the kernel wants to know of bending and of normals, in its order."""
    bends, plain = mesh.bends, len(mesh.bends.stencils)
    root = single(np.sqrt(bends.area))
    basis = np.vstack([spectral.slopes(spectral.NODES), spectral.WEIGHTS])
    return [
        bends.stencils.first, 3 * bends.stencils.nodes, bends_by_line(mesh)[1],
        bends.kind[:plain], 3 * bends.centre[:plain], root[:plain], bends.counts[bends.counts > 0],
        some(twist_scales(mesh)), 3 * some(bends.centre[plain:]), some(root[plain:]),
        3 * mesh.cells, single(basis),
    ]  # fmt: skip


def contact_arguments(surface: Surface, contact: Contact, thickness: Floats, nodes: int) -> list[Singles | Integers]:
    """What the kernel wants to know of contact and the memory it works in, in the order of `fit.cloth.nearby`.

    thickness [m], (groups, lanes): distances at which layers are kept apart
    """
    from fit.cloth.nearby import COUNTS, PANEL, SPOT

    samples, quads, bodies = len(surface.area), len(surface.quads), contact.bodies
    groups, lanes = thickness.shape
    most = (int(surface.may_meet.sum()) if thickness.any() else 0) + samples * len(bodies)
    numbers = np.concatenate(
        [
            surface.samples.weights[:, 0], surface.area, surface.reach, surface.windows.ravel(),
            *(body.row() for body in bodies),
            [surface.carried, contact.friction, contact.clearance], thickness.max(1),
        ]
    )  # fmt: skip
    front = -(-len(numbers) // lanes)
    memory = zeros((front + groups * (SPOT * samples + PANEL * quads + 6 * nodes + 1), lanes))
    alone = memory.reshape(-1)
    alone[: len(numbers)] = numbers
    sizes = np.array([samples, quads, len(bodies), most, front])
    known = np.concatenate([sizes, 3 * surface.samples.nodes, SPOT * surface.quads.ravel(), surface.words()])
    # Room for every pair there is, hardly any of which is ever touched.
    whole = np.zeros(len(known) + groups * (COUNTS + 2 * (samples + quads + most)), np.int32)
    whole[: len(known)] = known
    return [whole, memory, alone]


def zeros(shape: tuple[int, ...]) -> Singles:
    """Return zeros of single precision whose memory is aligned for vectors."""
    return runtime.aligned_zeros(shape, np.float32)


def some(values: Numbers) -> Numbers:
    """Return the values, or a single zero of as many dimensions where there are none, which Taichi cannot take."""
    return values if values.size else np.zeros_like(values, shape=[max(n, 1) for n in values.shape])


def single(values: Floats) -> Singles:
    """Return the values contiguous in single precision."""
    return np.ascontiguousarray(values, np.float32)
