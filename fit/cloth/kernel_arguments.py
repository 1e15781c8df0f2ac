"""Input arrays of the rollout kernel for one cloth: membrane, bending and contact."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from fit import runtime
from fit.cloth import spectral
from fit.cloth.bundles import Membrane, Stencils, Touch
from fit.cloth.contact import Contact, Surface
from fit.cloth.lines import BETWEEN, bends_by_line, fibre_family, twist_scales
from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats, Indices, Singles

Numbers = TypeVar("Numbers", Floats, Singles, Indices)


def membrane_bundle(mesh: ClothMesh) -> Membrane:
    """Return the samples of stretch and shear on a mesh."""
    families = [fibre_family(mesh, k) for k in range(2)]
    return Membrane(
        fibre_at=3 * np.concatenate([nodes for _, nodes, _ in families]),
        fibre_weights=np.concatenate([w for _, _, w in families]),
        down_entry=len(families[0][1]),
        fibre_area=single(mesh.fibres.area),
        fibres_across=mesh.fibres_across,
        shear_across=3 * mesh.shear_across.ravel(),
        shear_down=3 * mesh.shear_down.ravel(),
        between=BETWEEN,
        shear_area=single(mesh.shear_area),
    )


def stencil_bundle(mesh: ClothMesh) -> Stencils:
    """Return the samples of bending on a mesh."""
    bends, plain = mesh.bends, len(mesh.bends.stencils)
    root = single(np.sqrt(bends.area))
    return Stencils(
        bend_first=bends.stencils.first,
        bend_nodes=3 * bends.stencils.nodes,
        bend_weights=bends_by_line(mesh)[1],
        bend_kind=bends.kind[:plain],
        bend_centre=3 * bends.centre[:plain],
        bend_root=root[:plain],
        bend_counts=bends.counts[bends.counts > 0],
        twist_scales=some(twist_scales(mesh)),
        twist_centre=3 * some(bends.centre[plain:]),
        twist_root=some(root[plain:]),
    )


def facing_bases(mesh: ClothMesh) -> tuple[Indices, Singles]:
    """Return the nodes of the elements, three times their numbers, and slopes and weights of the shape functions."""
    return 3 * mesh.cells, single(np.vstack([spectral.slopes(spectral.LOBATTO_NODES), spectral.LOBATTO_WEIGHTS]))


def contact_bundle(surface: Surface, contact: Contact, thickness: Floats, nodes: int) -> Touch:
    """Return the kernel's arguments on contact, and its memory (`fit.cloth.nearby`).

    thickness [m], (groups, lanes): distances at which layers are kept apart
    """
    from fit.cloth.nearby import BODY, LIST_COUNTS, PANEL, SPOT, WAY_COUNT

    samples, quads, bodies = len(surface.area), len(surface.quads), contact.bodies
    groups, lanes = thickness.shape
    most = (int(surface.may_meet.sum()) if thickness.any() else 0) + samples * len(bodies)
    motion = contact.motion if bodies else None
    spacing, instants = (0.0, 0) if motion is None else (motion.spacing, len(motion.poses))
    standing = np.zeros((len(bodies), BODY))
    for row, body in zip(standing, bodies, strict=True):
        row[: len(body.row())] = body.row()
    numbers = np.concatenate(
        [
            surface.samples.weights[:, 0], surface.area, surface.reach, surface.windows.ravel(),
            [surface.carried, contact.friction, contact.clearance, spacing], thickness.max(1),
            np.tile(standing.ravel(), groups), np.zeros(WAY_COUNT * groups),
            *([] if motion is None else [motion.way(bodies), motion.poses.ravel()]),
        ]
    )  # fmt: skip
    front = -(-len(numbers) // lanes)
    memory = zeros((front + groups * (SPOT * samples + PANEL * quads + 6 * nodes + 1), lanes))
    alone = memory.reshape(-1)
    alone[: len(numbers)] = numbers
    sizes = np.array([samples, quads, len(bodies), most, front, instants])
    known = np.concatenate([sizes, 3 * surface.samples.nodes, SPOT * surface.quads.ravel(), surface.words()])
    # Capacity for all possible pairs; hardly any of this memory is ever used.
    whole = np.zeros(len(known) + groups * (LIST_COUNTS + 2 * (samples + quads + most)), np.int32)
    whole[: len(known)] = known
    return Touch(contact_whole=whole, contact_memory=memory, contact_alone=alone)


def zeros(shape: tuple[int, ...]) -> Singles:
    """Return zeros of single precision whose memory is aligned for vectors."""
    return runtime.aligned_zeros(shape, np.float32)


def some(values: Numbers) -> Numbers:
    """Return the values, or a single zero of as many dimensions if empty, because Taichi refuses empty arrays."""
    return values if values.size else np.zeros_like(values, shape=[max(n, 1) for n in values.shape])


def single(values: Floats) -> Singles:
    """Return the values contiguous in single precision."""
    return np.ascontiguousarray(values, np.float32)
