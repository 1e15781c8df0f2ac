"""Say where polygons and places lie to each other: inside, apart, touching or crossing."""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats

TOUCHING = 1e-5  # m within which corners and sides are in one place: no mesh fits between


def corner_twice(polygon: Floats) -> list[float] | None:
    """Return a corner of a polygon that is there twice."""
    apart = np.linalg.norm(polygon[:, None] - polygon[None], axis=2) + np.eye(len(polygon))
    return None if apart.min() > TOUCHING else [float(x) for x in polygon[int(apart.min(0).argmin())]]


def touches_itself(polygon: Floats) -> list[float] | None:
    """Return a corner of a polygon that lies on one of its sides that does not end there."""
    for k, corner in enumerate(polygon):
        apart = np.delete(distances_to_sides(corner, polygon), [k - 1, k])
        if apart.min(initial=np.inf) < TOUCHING:
            return [float(x) for x in corner]
    return None


def touch(one: Floats, other: Floats) -> bool:
    """Return whether a corner of one polygon lies on a side of the other."""
    return any(
        distances_to_sides(corner, polygon).min() < TOUCHING
        for corners, polygon in ((one, other), (other, one))
        for corner in corners
    )


def distances_to_sides(place: Floats, polygon: Floats) -> Floats:
    """Distance of a place to each side of a polygon [m], (sides,), the first from the first corner to the second."""
    along = np.roll(polygon, -1, axis=0) - polygon
    share = np.clip(((place - polygon) * along).sum(1) / np.maximum((along**2).sum(1), 1e-18), 0, 1)
    return np.asarray(np.linalg.norm(polygon + share[:, None] * along - place, axis=1))


def crosses_itself(outline: Floats) -> bool:
    """Return whether two sides of a polygon cross."""
    return meet(outline, outline)  # neighbouring sides share an end, which is no crossing


def meet(one: Floats, other: Floats) -> bool:
    """Return whether sides of two polygons cross: each parts the other's two ends."""

    def hands(polygon: Floats, places: Floats) -> Floats:
        along = np.roll(polygon, -1, axis=0) - polygon
        to = places[None] - polygon[:, None]
        return np.asarray(along[:, None, 0] * to[..., 1] - along[:, None, 1] * to[..., 0])

    of_other, of_one = hands(one, other), hands(other, one)
    parts = of_other * np.roll(of_other, -1, axis=1) < 0
    return bool((parts & (of_one * np.roll(of_one, -1, axis=1) < 0).T).any())


def distance_outside(place: Floats, outline: Floats) -> float:
    """Return the distance of a place outside a polygon to it [m]; 0 inside."""
    ends = np.roll(outline, -1, axis=0)
    above = (outline[:, 1] > place[1]) != (ends[:, 1] > place[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = outline[:, 0] + (place[1] - outline[:, 1]) / (ends[:, 1] - outline[:, 1]) * (ends - outline)[:, 0]
    is_inside = bool(np.count_nonzero(above & (place[0] < crossing)) % 2)
    return 0.0 if is_inside else float(distances_to_sides(place, outline).min())
