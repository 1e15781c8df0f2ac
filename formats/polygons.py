"""Test how polygons and points lie relative to each other: inside, apart, touching or crossing.

A polygon is an array (corners, 2) [m]. Side k goes from corner k to the next, the last side to the first corner.
All points are compared with all sides at once. A garment has up to 1000 sides in its outline and 1000 in its holes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from formats.arrays import Booleans, Floats

TOUCHING = 1e-5  # m within which corners and sides touch: no mesh fits between
CELLS_AT_ONCE = 2**17  # pairs of a point and a side, so that a table of pairs takes some megabytes


def corner_twice(polygon: Floats) -> list[float] | None:
    """Return a corner that occurs twice in a polygon, None without one."""
    apart = np.linalg.norm(polygon[:, None] - polygon[None], axis=2) + np.eye(len(polygon))
    return None if apart.min() > TOUCHING else [float(x) for x in polygon[int(apart.min(0).argmin())]]


def touches_itself(polygon: Floats) -> list[float] | None:
    """Return a corner that lies on another side of its polygon, one that does not end there; None without one."""
    apart = distances_to_sides(polygon, polygon)
    corners = np.arange(len(polygon))
    apart[corners, corners - 1] = apart[corners, corners] = np.inf
    touching = (apart < TOUCHING).any(1)
    return [float(x) for x in polygon[int(touching.argmax())]] if touching.any() else None


def crosses_itself(polygon: Floats) -> bool:
    """Return whether two sides of a polygon cross. Neighbouring sides share an end, which is no crossing."""
    return cross(polygon, polygon)


def cross(one: Floats, other: Floats) -> bool:
    """Return whether a side of one polygon crosses a side of the other."""
    return bool(_crossings(one, _ends(one), other, _ends(other)).any())


def touch(one: Floats, other: Floats) -> bool:
    """Return whether a corner of one polygon lies on a side of the other."""
    return any(bool((distances_to_sides(a, b) < TOUCHING).any()) for a, b in ((one, other), (other, one)))


def first_overlap(polygons: Sequence[Floats]) -> tuple[int, int] | None:
    """Return the index of the first polygon that overlaps an earlier one, and the index of that one, from 0."""
    if len(polygons) < 2:
        return None
    starts, ends = np.concatenate(polygons), np.concatenate([_ends(polygon) for polygon in polygons])
    owner = np.repeat(np.arange(len(polygons)), [len(polygon) for polygon in polygons])
    meet = _crossings(starts, ends, starts, ends) | (_to_segments(starts, starts, ends) < TOUCHING)
    pairs = np.array([inside(np.array([polygon[0] for polygon in polygons]), other) for other in polygons])
    np.logical_or.at(pairs, (owner[:, None], owner[None]), meet)
    later, earlier = np.nonzero(np.tril(pairs | pairs.T, -1))
    return (int(later[0]), int(earlier[0])) if len(later) else None


def inside(places: Floats, polygon: Floats) -> Booleans:
    """Return which points lie in a polygon, (places,).

    A ray to the right of an inside point crosses an odd number of sides.
    """
    starts, ends = polygon, _ends(polygon)
    with np.errstate(divide="ignore", invalid="ignore"):  # a level side is crossed by no level ray
        slope = (ends[:, 0] - starts[:, 0]) / (ends[:, 1] - starts[:, 1])
    found = np.empty(len(places), bool)
    for part in _parts(len(places), len(polygon)):
        x, y = places[part, 0, None], places[part, 1, None]
        spans = (starts[:, 1] > y) != (ends[:, 1] > y)
        with np.errstate(invalid="ignore"):
            found[part] = np.count_nonzero(spans & (x < starts[:, 0] + (y - starts[:, 1]) * slope), axis=1) % 2
    return found


def distances_outside(places: Floats, polygon: Floats) -> Floats:
    """Return the distance of each point to a polygon [m], (places,); 0 inside."""
    return np.where(inside(places, polygon), 0.0, distances_to_sides(places, polygon).min(1))


def distances_to_sides(places: Floats, polygon: Floats) -> Floats:
    """Return the distance of each point to each side of a polygon [m], (places, sides)."""
    return _to_segments(places, polygon, _ends(polygon))


def _ends(polygon: Floats) -> Floats:
    return np.roll(polygon, -1, axis=0)


def _parts(count: int, width: int) -> Iterator[slice]:
    """Split the rows of a table into parts of at most CELLS_AT_ONCE cells, or of one row."""
    step = max(1, CELLS_AT_ONCE // width)
    return (slice(first, first + step) for first in range(0, count, step))


def _to_segments(places: Floats, starts: Floats, ends: Floats) -> Floats:
    """Return the distance of each point to each segment [m], (places, segments)."""
    along = ends - starts
    squared = np.maximum((along**2).sum(1), 1e-18)
    found = np.empty((len(places), len(starts)))
    for part in _parts(len(places), len(starts)):
        to = places[part, None] - starts
        share = np.clip((to * along).sum(2) / squared, 0, 1)
        found[part] = np.linalg.norm(to - share[..., None] * along, axis=2)
    return found


def _crossings(starts: Floats, ends: Floats, other_starts: Floats, other_ends: Floats) -> Booleans:
    """Return which segments cross, (segments, others): each separates the ends of the other."""

    def parts(one: Floats, one_ends: Floats, other: Floats, other_ends: Floats) -> Booleans:
        along = one_ends - one
        hands = [along[:, None, 0] * to[..., 1] - along[:, None, 1] * to[..., 0]
                 for to in (other - one[:, None], other_ends - one[:, None])]  # fmt: skip
        return np.asarray(hands[0] * hands[1] < 0)

    return parts(starts, ends, other_starts, other_ends) & parts(other_starts, other_ends, starts, ends).T
