"""Describe the square swatch of the motion capture method: a full grid of markers, held at the two top corners.

Source: "Optimization of Cloth Simulation Parameters by Considering Static and Dynamic Features", section 2. The paper
has 81 markers about 5 cm apart on a swatch of 50 cm by 50 cm. The two markers at the top corners drive the swatch. The
two statements differ: nine by nine markers from edge to edge are 62.5 mm apart. This module uses 62.5 mm.
"""

from __future__ import annotations

import math

from formats.descriptions import MOST_POINTS, check_garment
from formats.errors import DescriptionError
from formats.garment import Garment, TrackedPoint
from formats.meant_units import unit_of
from formats.plausible import LONGEST, SHORTEST

SWATCH_SIDE = 0.5  # m, section 2
MARKERS = 9  # along each side, section 2: 81 in all
LEAST_SIDE = 0.01  # m: the side of the smallest area of a garment
FEWEST_MARKERS = 4  # along each side: a Catmull-Rom segment needs four


def swatch(mass: float, *, side: float = SWATCH_SIDE, markers: int = MARKERS, name: str = "swatch") -> Garment:
    """Return a square swatch of this mass [kg] and side [m] with `markers` x `markers` markers from edge to edge.

    Markers are named `row1_column1` (top left as the sensor sees it) to `row9_column9` (bottom right).

    Raises:
        DescriptionError: too few or too many markers, or a size or mass that no swatch has.
    """
    if markers < FEWEST_MARKERS:
        raise DescriptionError(
            f"a swatch has too few markers along each side (got {markers})", where="--markers",
            advice=f"give {FEWEST_MARKERS} or more",
        )  # fmt: skip
    if not (LEAST_SIDE <= side < 10 and mass > 0):
        larger = next((times * side for times in (100, 1000) if SHORTEST <= times * side <= LONGEST), None)
        meant = f"; was {larger:g} meant?" if larger is not None and side < LEAST_SIDE else ""
        meant = meant or unit_of(side, SHORTEST, LONGEST)
        raise DescriptionError(
            f"no swatch has a side of {side:g} m and a mass of {mass:g} kg{meant}",
            where="--mass" if LEAST_SIDE <= side < 10 else "--side", advice="give metres and kilograms",
        )  # fmt: skip
    if markers**2 > MOST_POINTS:
        raise DescriptionError(
            f"{markers} markers along each side are more than the {MOST_POINTS} that a take holds", where="--markers",
            advice=f"give {math.isqrt(MOST_POINTS)} at most",
        )  # fmt: skip
    half, pitch = side / 2, side / (markers - 1)
    garment = Garment(
        format="hangtime-garment/1", name=name, kind="swatch", mass_kg=mass,
        outline_m=((-half, 0.0), (half, 0.0), (half, -side), (-half, -side)), held="corners",
        points=tuple(
            TrackedPoint(name=f"row{r + 1}_column{c + 1}", at_m=(round(-half + c * pitch, 6), round(-r * pitch, 6)))
            for r in range(markers) for c in range(markers)
        ),
    )  # fmt: skip
    check_garment(garment, "--mass, --side")
    return garment
