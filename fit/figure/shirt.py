"""Construction of a sewn T-shirt from its front: neck opening, cuffs and girths.

A T-shirt that is described by its front alone has a back of the same shape. Its neck is cut out of the middle of its
top, in front and behind alike, and its hem is its bottom. Its cuffs lead down from the tips of its sleeves. All other
sides are sewn.
"""

from __future__ import annotations

import msgspec
import numpy as np

from fit.errors import FitError
from fit.figure.dressmaking import is_hem
from formats.arrays import Floats
from formats.garment import Garment, TrackedPoint, polygon_area
from formats.plain_text import shortened

NECK_FRONT = 0.22  # m, front of the neck opening: twice this passes over a neck and not over shoulders
NECK_SHARE = 0.55  # of the top: width of the neck opening, if less
# Of the neck opening's width: its depth, and its level bottom. A men's M is cut 9 cm deep in front and 2 cm behind.
NECK_DEPTH, NECK_BOTTOM = 0.27, 0.5
NECK_SIDES = 3  # first sides of a sewn T-shirt's outline
# m, right half of the front below its neck: shoulder, tip and cuff of the sleeve, underarm, hem. About a men's M.
SHOULDER, TIP, CUFF, UNDERARM, HEM = (0.235, -0.045), (0.403, -0.134), (0.319, -0.293), (0.265, -0.235), (0.265, -0.68)
FEWEST_CORNERS = 12  # with the neck's four: tip, cuff, underarm and hem of either side
LEAST_OUT, MOST_OUT = 20.0, 80.0  # degrees from the vertical, of arms in sleeves that lie flat


def plain_shirt(density: float) -> Garment:
    """Return front and back of a plain T-shirt of an areal density [kg/m^2], for a fabric of another garment."""
    right = [SHOULDER, TIP, CUFF, UNDERARM, HEM]
    outline = ((-NECK_FRONT / 2, 0.0), (NECK_FRONT / 2, 0.0), *right, *((-x, y) for x, y in reversed(right)))
    around = np.array(outline)
    after = np.roll(around, -1, 0)
    area = 0.5 * abs(float((around[:, 0] * after[:, 1] - after[:, 0] * around[:, 1]).sum()))
    corners = {"top_left": outline[0], "top_right": outline[1], "bottom_right": HEM, "bottom_left": (-HEM[0], HEM[1])}
    return Garment(
        format="hangtime-garment/2", name="T-shirt of the fabric", kind="t-shirt", mass_kg=density * area,
        outline_m=outline, held="edge", points_are="material",
        points=tuple(TrackedPoint(name=n, at_m=p) for n, p in corners.items()),
    )  # fmt: skip


def sewn_shirt(garment: Garment) -> tuple[Garment, float]:
    """Return a T-shirt with its back, and the share of the flat sheet's weight and stiffness of each layer.

    Its first `NECK_SIDES` sides are the neckline. The cut-out of the neck reduces its weight.

    Raises:
        FitError: its outline has no sleeves, or its top is narrower than a neck.
    """
    outline = _with_neck(garment)
    cuffs = _cuffs(garment, outline)
    sides = [(k, (k + 1) % len(outline)) for k in range(NECK_SIDES, len(outline))]
    seams = tuple(side for side in sides if side not in cuffs and not is_hem(outline, side))
    is_whole = bool(garment.seams)
    share = 0.5 if garment.layers == 2 and not is_whole else 1.0
    left = polygon_area(outline) / polygon_area(garment.outline_m)
    sewn = msgspec.structs.replace(
        garment, format="hangtime-garment/2", held="edge", outline_m=outline, seams=seams, layers=1,
        mass_kg=garment.mass_kg * left * (1.0 if is_whole else 2 * share), points_are=garment.point_kind,
    )  # fmt: skip
    return sewn, share


def neck_sides(garment: Garment) -> Floats:
    """Return the ends of the neckline's sides on a sewn T-shirt's front [m], (`NECK_SIDES`, 2, 2), from its left."""
    corners = np.array(garment.outline_m[: NECK_SIDES + 1])
    return np.stack([corners[:-1], corners[1:]], 1)


def collar_girth(garment: Garment) -> float:
    """Return the circumference of a sewn T-shirt's neck opening [m]."""
    return float(2 * np.linalg.norm(np.diff(neck_sides(garment), axis=1), axis=2).sum())


def arms_out(garment: Garment) -> float:
    """Return the angle of the sleeves of a flat sewn T-shirt from the vertical [rad]."""
    outline = np.array(garment.outline_m)
    tip = int(np.argmax(outline[:, 0]))
    way = outline[tip] - outline[tip - 1]
    return float(np.radians(np.clip(np.degrees(np.arctan2(abs(way[0]), -way[1])), LEAST_OUT, MOST_OUT)))


def cuff_girth(garment: Garment) -> float:
    """Return the circumference of a sewn T-shirt's cuff [m]."""
    outline = np.array(garment.outline_m)
    tip = int(np.argmax(outline[:, 0]))
    return float(2 * np.linalg.norm(outline[(tip + 1) % len(outline)] - outline[tip]))


def chest_at(garment: Garment) -> float:
    """Return the distance below its top of a T-shirt's largest width under the sleeves [m]."""
    outline = np.array(garment.outline_m)
    tip = int(np.argmax(outline[:, 0]))
    return float(outline[:, 1].max() - outline[(tip + 2) % len(outline), 1])


def _with_neck(garment: Garment) -> tuple[tuple[float, float], ...]:
    """Return the outline with the neck cut out, neckline sides first."""
    outline = garment.outline_m
    (left, top), (right, other) = outline[:2]
    wide = min(NECK_FRONT, NECK_SHARE * (right - left))
    if right - left <= NECK_FRONT:
        wide = right - left
    if not wide > 0.1 or abs(top - other) > 0.02:
        raise FitError(
            f"the top of {shortened(garment.name)} is {right - left:.2f} m wide, which goes over no head",
            where="--take", advice="give a T-shirt whose outline begins with its top, left end first",
        )  # fmt: skip
    middle, level, half = (left + right) / 2, (top + other) / 2, wide / 2
    across = (-half, -NECK_BOTTOM * half, NECK_BOTTOM * half, half)
    neck = tuple((middle + x, level - drop * NECK_DEPTH * wide) for x, drop in zip(across, (0, 1, 1, 0), strict=True))
    if wide == right - left:
        return (outline[0], *neck[1:3], *outline[1:])
    return (*neck, *outline[1:], outline[0])


def _cuffs(garment: Garment, outline: tuple[tuple[float, float], ...]) -> tuple[tuple[int, int], ...]:
    """Return the two sides at which the sleeves end.

    Raises:
        FitError: the outline has no sleeves.
    """
    around = np.array(outline)
    count = len(around)
    right, left = int(np.argmax(around[:, 0])), int(np.argmin(around[:, 0]))
    cuffs = ((right, (right + 1) % count), ((left - 1) % count, left))
    under = (around[(right + 2) % count], around[(left - 2) % count])
    lowest = around[:, 1].min() + 0.25 * np.ptp(around[:, 1])
    if count < FEWEST_CORNERS or min(corner[1] for corner in under) < lowest:
        raise FitError(
            f"the outline of {shortened(garment.name)} has no sleeves", where="--take",
            advice="describe sleeve tips, cuffs and underarms, or leave out --take for a T-shirt of the fabric",
        )  # fmt: skip
    return cuffs
