"""Compare the described garment with the one in view, where the sensor is a synthetic world and knows it.

A take with another outline than the cloth's is poor. Its points are searched at wrong places, and a fit hides the
difference in its parameters.
"""

from __future__ import annotations

import numpy as np

from capture.errors import UntrackableError
from formats.garment import Garment
from formats.polygons import distances_to_sides

SAME_OUTLINE = 0.005  # m; our choice: outlines measured by hand and rounded to whole centimetres still agree


def check_known_garment(described: Garment, in_view: Garment, where: object) -> None:
    """Check that a described garment has the outline of the one in view, wherever its origin is.

    Raises:
        UntrackableError: the outlines differ by more than `SAME_OUTLINE`; says by how much.
    """
    ours, theirs = (np.array(one.outline_m) - np.mean(one.outline_m[:2], axis=0) for one in (described, in_view))
    apart = max(float(distances_to_sides(a, b).min(1).max()) for a, b in ((ours, theirs), (theirs, ours)))
    if apart > SAME_OUTLINE:
        raise UntrackableError(
            f"describes another garment than the {in_view.name} that the synthetic world swings: the outlines are up "
            f"to {1e3 * apart:.0f} mm apart",
            where=where,
            advice="choose a garment of the world, as in 'synthetic:swing?garment=t-shirt', and give the garment.toml "
            "that `hangtime sensor synthesise` writes of it, or --anyway",
        )
