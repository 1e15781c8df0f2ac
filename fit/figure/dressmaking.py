"""Construction of a sewn skirt from its front, and its girth along its length.

A skirt that is described by its front alone has a back of the same shape. A flat sheet that represents both layers is
split: front and back then have half of its weight and stiffness each.
"""

from __future__ import annotations

import msgspec
import numpy as np

from fit.cloth.mesh import LOWEST_SHARE
from fit.errors import FitError
from fit.figure.skeleton import STANDARD_HEIGHT
from formats.arrays import Floats
from formats.garment import Garment, TrackedPoint
from formats.plain_text import shortened

WAIST_FRONT, FLARE, LENGTH = 0.40, 0.56, 0.50  # m: front of a skirt, its top, its hem and its length


def plain_skirt(density: float) -> Garment:
    """Return the front of a plain skirt of an areal density [kg/m^2], for a fabric recorded as another garment."""
    outline = ((-WAIST_FRONT / 2, 0.0), (WAIST_FRONT / 2, 0.0), (FLARE / 2, -LENGTH), (-FLARE / 2, -LENGTH))
    names = ("top_left", "top_right", "bottom_right", "bottom_left")
    return Garment(
        format="hangtime-garment/1", name="skirt of the fabric", kind="skirt",
        mass_kg=density * (WAIST_FRONT + FLARE) / 2 * LENGTH, outline_m=outline, held="edge",
        points=tuple(TrackedPoint(name=n, at_m=p) for n, p in zip(names, outline, strict=True)),
    )  # fmt: skip


def usual_skirt(height: float) -> Garment:
    """Return front and back of a skirt for a wearer of a height [m] and usual width."""
    plain = plain_skirt(1.0)
    scale = height / STANDARD_HEIGHT
    wider = tuple((scale * x, scale * y) for x, y in plain.outline_m)
    points = tuple(TrackedPoint(name=p.name, at_m=(scale * p.at_m[0], scale * p.at_m[1])) for p in plain.points)
    return sewn_skirt(msgspec.structs.replace(plain, outline_m=wider, points=points))[0]


def sewn_skirt(garment: Garment) -> tuple[Garment, float]:
    """Return a skirt with its back, and the share of the flat sheet's weight and stiffness of each layer.

    Raises:
        FitError: the garment is no skirt.
    """
    if garment.kind != "skirt":
        raise FitError(
            f"the figure wears skirts and T-shirts, and {shortened(garment.name)} is a {garment.kind}", where="--take",
            advice="leave out --take, and the figure wears a skirt of the fabric; or leave out the figure and give a "
            "--motion",
        )  # fmt: skip
    if garment.seams:
        return msgspec.structs.replace(garment, held="edge"), 1.0
    share = 1.0 if garment.layers == 1 else 0.5
    outline = garment.outline_m
    sides = [(k, (k + 1) % len(outline)) for k in range(len(outline))]
    seams = tuple(side for side in sides[1:] if not is_hem(outline, side))
    sewn = msgspec.structs.replace(
        garment, format="hangtime-garment/2", held="edge", seams=seams, layers=1,
        mass_kg=garment.mass_kg * 2 * share, points_are=garment.point_kind,
    )  # fmt: skip
    return sewn, share


def is_hem(outline: tuple[tuple[float, float], ...], side: tuple[int, int]) -> bool:
    """Return whether a side of an outline is part of the bottom edge."""
    one, other = (np.array(outline[k]) for k in side)
    heights = np.array(outline)[:, 1]
    lowest = heights.min() + LOWEST_SHARE * np.ptp(heights)
    return bool((one[1] + other[1]) / 2 < lowest and (one - other)[0] > abs((one - other)[1]))


def ends_at(garment: Garment, below: Floats) -> tuple[Floats, Floats]:
    """Return the left and right ends of the front [m], (n,), at distances below its top [m], clipped to its length."""
    outline = np.array(garment.outline_m)
    after = np.roll(outline, -1, 0)
    heights = np.clip(outline[:, 1].max() - np.asarray(below, float), outline[:, 1].min(), outline[:, 1].max())
    left, right = np.full(len(heights), np.inf), np.full(len(heights), -np.inf)
    for a, b in zip(outline, after, strict=True):
        low, high = min(a[1], b[1]) - 1e-9, max(a[1], b[1]) + 1e-9
        crosses = (heights >= low) & (heights <= high)
        share = np.clip((heights - a[1]) / (b[1] - a[1]), 0, 1) if abs(b[1] - a[1]) > 1e-9 else np.zeros(len(heights))
        for x in ((a[0] + share * (b[0] - a[0])), *((a[0], b[0]) if abs(b[1] - a[1]) <= 1e-9 else ())):
            left, right = np.where(crosses, np.minimum(left, x), left), np.where(crosses, np.maximum(right, x), right)
    return left, right


def girth(garment: Garment, below: Floats) -> Floats:
    """Return the circumference of the sewn skirt [m], (n,), at distances below its top [m]."""
    left, right = ends_at(garment, below)
    return np.asarray(2 * (right - left))
