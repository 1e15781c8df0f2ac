"""Compare the described garment with the one in view, where the sensor is a synthetic world and knows it.

A take with another outline than the cloth's is poor. Its points are searched at wrong places, and a fit hides the
difference in its parameters. A fit also hides another weight, another way of holding and other layers.
"""

from __future__ import annotations

import numpy as np

from capture.errors import UntrackableError
from formats.garment import Garment
from formats.polygons import distances_to_sides

SAME_OUTLINE = 0.005  # m; our choice: outlines measured by hand and rounded to whole centimetres still agree
SAME_WEIGHED = 0.05  # share; our choice: a kitchen scale errs by 1 g, 3 % of the lightest garment of the world
SAME_FIELDS = ("layers", "seams", "holes_m", "grain_degrees")


def check_known_garment(described: Garment, in_view: Garment, where: object) -> None:
    """Check that a described garment has outline and cloth of the one in view, wherever its origin is.

    Its name and its points may be others: `record` looks for the points of the description.

    Raises:
        UntrackableError: the outlines differ by more than `SAME_OUTLINE`, or the weight by more than `SAME_WEIGHED`, or
            another quantity; says by how much.
    """
    if difference := _difference(described, in_view):
        raise UntrackableError(
            f"describes another garment than the {in_view.name} that the synthetic world swings: {difference}",
            where=where,
            advice="choose a garment of the world, as in 'synthetic:swing?garment=t-shirt', and give the garment.toml "
            "that `hangtime sensor synthesise` writes of it, or --anyway",
        )


def _difference(described: Garment, in_view: Garment) -> str:
    """Return the first difference in words; '' for the same garment."""
    ours, theirs = (np.array(one.outline_m) - np.mean(one.outline_m[:2], axis=0) for one in (described, in_view))
    apart = max(float(distances_to_sides(a, b).min(1).max()) for a, b in ((ours, theirs), (theirs, ours)))
    if apart > SAME_OUTLINE:
        return f"the outlines are up to {1e3 * apart:.0f} mm apart"
    if described.kind != in_view.kind:
        return f"its kind is {described.kind} instead of {in_view.kind}"
    if described.held != in_view.held:
        return f"the description has the garment held by its {described.held} instead of its {in_view.held}"
    if abs(described.mass_kg - in_view.mass_kg) > SAME_WEIGHED * in_view.mass_kg:
        return f"the description states {1e3 * described.mass_kg:.1f} g instead of {1e3 * in_view.mass_kg:.1f} g"
    others = [name for name in SAME_FIELDS if getattr(described, name) != getattr(in_view, name)]
    return f"its {others[0]} differ" if others else ""
