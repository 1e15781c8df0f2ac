"""Compute the held ends of the cloth from the marker centres, by the hanger's frame.

    x = (m1 - m0) / |m1 - m0|,   y = (g - (g . x) x) / |...|,   z = x × y,   held_k = (m0 + m1) / 2 + R [x y z] h_k

with gravity's direction g. Two markers do not determine the hanger's pitch about its bar; it is assumed to hang plumb.
Source: Gram-Schmidt; the definition is that of `formats.rig.Hanger`.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats
from formats.errors import DescriptionError
from formats.rig import Rig


def held_ends(markers: Floats, rig: Rig) -> Floats:
    """Return the ends of the held edge [m], (..., 2, 3), from marker centres [m], (..., 2, 3); NaN in, NaN out.

    Raises:
        DescriptionError: the rig has no hanger.
    """
    if rig.hanger is None:
        raise DescriptionError(
            "the rig has no [hanger]", where=rig.name, advice="add one, see docs/reference/file-formats.md"
        )
    offsets = np.asarray(rig.hanger.held_m, float)
    middle = markers.mean(-2)
    return np.asarray(middle[..., None, :] + np.einsum("...ij,kj->...ki", hanger_frame(markers, rig), offsets))


def hanger_frame(markers: Floats, rig: Rig) -> Floats:
    """Return the hanger's axes x, y, z as columns, (..., 3, 3), from marker centres [m], (..., 2, 3)."""
    x = markers[..., 1, :] - markers[..., 0, :]
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    gravity = np.asarray(rig.gravity, float)
    y = gravity - (x @ gravity)[..., None] * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], -1)
