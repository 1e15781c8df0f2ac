"""The flat garment as the tracker uses it: its corners, their geodesic distances, and the garment's extent.

    D_ij = length of the shortest way inside the outline

The same algorithm (`capture.garment.geodesic`) measures distances on a grid over the outline and on the seen surface.
So the grid's excess length cancels. Cloth hardly stretches. So a shorter distance on the seen surface means folded
cloth between the two corners, or a wrong corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.errors import UntrackableError
from capture.garment.geodesic import farthest_place, geodesic_distances
from formats.arrays import Floats
from formats.garment import Garment

CORNER_MATCH = 0.01  # m, a tracked point this near to an outline corner is that corner
CENTRE_ROLE = 4  # the role of the centre, after the four corners
# m of the grid. Our choice: on a square of 0.5 m the ways between corners are up to 0.8 % too long (measured). At half
# they are 0.4 % too long, from four times the nodes; at twice 1.6 %.
GRID_STEP = 0.025
CENTRE_MATCH = 0.01  # m from a garment file's centre to the tracker's; our choice: rounding to cm moves it by 7 mm
AS_GOOD = 0.003  # m by which its nearest corner may be nearer: on wide garments the grid has errors of 10 mm


@dataclass(frozen=True)
class FlatGarment:
    """Corners [m], (4, 2), y up, from the top left clockwise; roles: of each tracked point its corner or `CENTRE_ROLE`.

    - `sides` [m], (4, 2): lengths of the outline's sides before and after each corner, clockwise
    - `distances` [m], (4, 4), along the cloth
    - `from_ends` [m], (2, 4): from the ends of the held edge to the corners
    - `reach` [m]: largest possible distance of any point from the held edge
    - `area` [m^2]
    """

    corners: Floats
    roles: list[int]
    sides: Floats
    distances: Floats
    from_ends: Floats
    reach: float
    area: float


def flat_garment(garment: Garment, corners: Floats) -> FlatGarment:
    """Return the flat garment of a description with these four corners [m], (4, 2).

    Its outline begins with the two ends of the held edge.

    Raises:
        UntrackableError: a point of the garment is neither a corner nor the centre, or its centre is misplaced.
    """
    outline = np.array(garment.outline_m, float)
    reach = float(np.linalg.norm(outline[:, None] - outline[None, :2], axis=-1).min(1).max())
    surface = _laid_flat(outline)
    sources = np.concatenate([np.concatenate([corners, outline[:2]]), np.zeros((6, 1))], axis=1)
    _, distances = geodesic_distances(surface, sources)
    lengths = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    at = [int(np.linalg.norm(outline - corner, axis=1).argmin()) for corner in corners]
    sides = np.array([[lengths[k - 1], lengths[k]] for k in at])
    roles = _roles(garment, corners)
    if CENTRE_ROLE in roles:
        _check_centre(garment, roles.index(CENTRE_ROLE), corners, surface)
    return FlatGarment(corners, roles, sides, distances[:4, :4], distances[4:, :4], reach, garment.area_m2)


def _laid_flat(outline: Floats) -> Floats:
    """Return a grid of points [m], (rows, columns, 3), NaN outside the outline."""
    low, high = outline.min(0), outline.max(0)
    x = np.arange(low[0] + 0.5 * GRID_STEP, high[0], GRID_STEP)
    y = np.arange(high[1] - 0.5 * GRID_STEP, low[1], -GRID_STEP)
    places = np.stack(np.meshgrid(x, y), axis=-1)
    ends = np.roll(outline, -1, axis=0)
    above = (outline[:, 1] > places[..., 1:]) != (ends[:, 1] > places[..., 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = outline[:, 0] + (places[..., 1:] - outline[:, 1]) / (ends - outline)[:, 1] * (ends - outline)[:, 0]
    is_inside = (above & (places[..., :1] < crossing)).sum(-1) % 2 == 1
    flat = np.concatenate([places, np.zeros((*places.shape[:2], 1))], axis=-1)
    flat[~is_inside] = np.nan
    return flat


def _roles(garment: Garment, corners: Floats) -> list[int]:
    """Return the role of every tracked point: 0 to 3 for its corner, 4 for the centre."""
    roles = []
    for point in garment.points:
        away = np.linalg.norm(corners - np.array(point.at_m), axis=1)
        if away.min() < CORNER_MATCH:
            roles.append(int(away.argmin()))
        elif point.name in {"centre", "center"}:
            roles.append(CENTRE_ROLE)
        else:
            raise UntrackableError(
                f"the point {point.name!r} is neither one of the four corners of this kind of garment nor the centre",
                where=garment.name,
                advice="track the corners that docs/reference/file-formats.md names and the point 'centre'",
            )
    return roles


def _check_centre(garment: Garment, index: int, corners: Floats, surface: Floats) -> None:
    """Check that the described centre is the point farthest from the four corners, as the tracker defines it.

    The check is skipped if no such point lies inside the outline, and for holes, around which geodesics lead.

    Raises:
        UntrackableError: the described centre lies elsewhere.
    """
    flat_corners = np.concatenate([corners, np.zeros((4, 1))], axis=1)
    place = farthest_place(geodesic_distances(surface, flat_corners)[0])
    if place is None or garment.holes_m:
        return
    outline = np.array(garment.outline_m, float)
    found = np.array(
        [outline[:, 0].min() + (place[1] + 0.5) * GRID_STEP, outline[:, 1].max() - (place[0] + 0.5) * GRID_STEP]
    )
    point = garment.points[index]
    given = np.array(point.at_m)
    off = float(np.linalg.norm(given - found))
    nearest, wanted = (float(np.linalg.norm(corners - at, axis=1).min()) for at in (given, found))
    if off > CENTRE_MATCH and nearest < wanted - AS_GOOD:
        raise UntrackableError(
            f"the point {point.name!r} is {1e3 * off:.0f} mm beside where the tracker looks for it, the "
            f"place farthest from the four corners: at_m = [{found[0]:z.3f}, {found[1]:z.3f}]",
            where=garment.name,
            advice="enter that, or leave the point out",
        )
