"""Quadrilateral meshing of a flat garment: a polygon with or without holes.

Threads run straight through the garment on any mesh, since strains are slopes along them (`fit.cloth.elements`). So the
mesh may follow the outline, and no element is cut. Corners on a square lattice along X and Y fill the inside. These
corners and those on the outline are triangulated by Delaunay's rule. The outline's sides are halved until the
triangulation contains them all. Neighbouring triangles are joined into quadrilaterals, best first.

Most lattice sizes leave single triangles, so several sizes are tried. Among meshes without triangles, the one with the
longest shortest side is taken, since the time step grows with that side. If every size leaves triangles, a coarser mesh
is divided: each triangle into three quadrilaterals, each quadrilateral into four. Source: J.-F. Remacle et al., Int. J.
Numer. Meth. Engng 89 (2012), section 2 (quadrilaterals from triangles); J. Ruppert, J. Algorithms 18 (1995) (halving
sides); E. Catmull, J. Clark, Computer-Aided Design 10 (1978) (division).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fit.errors import FitError
from formats.arrays import Booleans, Floats, Integers

Indices = Integers

# The trials named here meshed a T-shirt, a flared skirt, a disc, a triangle and a panel with a hole, each with two
# sides. Of the side of a square: least distance of inner corners from the outline. At half, the shortest side was
# shorter in five of the ten meshes, down to 0.2 sides. At twice, one mesh failed.
CLEAR = 0.45
# Least sine of a corner's angle for which two triangles are joined; our choice: 20 degrees. At half, two of ten meshes
# had sides twice as long; at 1.4 and at twice, one had half. Others did not change.
WORST_SHAPE = 0.35
# Of the requested side: tried sizes. Our choice: rather a finer mesh than a coarser one; a finer one costs more time.
SIDES_TRIED = 1.0 + 0.02 * np.array(sorted(range(-17, 6), key=abs))
# Factor by which another lattice's shortest side must be longer to be chosen; our choice: it is farther from the
# requested size. All ten meshes are the same with 1, 1.1 and 1.4.
BETTER = 1.2
LONG_ENOUGH = CLEAR  # of the requested side: a shortest side that ends the trials; few are longer than CLEAR allows
SHORTEST_SIDE = 6e-3  # m: stretch of 1000 N/m on 0.2 kg/m^2 then takes a step of 12 us, near the shortest there is
FLATTEST = 1e-3  # of the squared side: triangles of less area are degenerate and are dropped
MOST_HALVINGS = 30  # rounds; each halves the sides that the triangulation lacks, down to a quarter of SHORTEST_SIDE


def quadrilaterals(loops: Sequence[Floats], side: float, *, name: str = "") -> tuple[Floats, Indices]:
    """Return corners [m], (corners, 2), and quadrilaterals, (n, 4), of sides about `side` [m] long.

    loops: corners of the outline, (n, 2) each, then those of the holes, in any sense of rotation. The corners of each
    quadrilateral are in one order: along X first, in the sense of rotation from X to Y.

    Raises:
        FitError: the outline cannot be meshed, or only with elements too small.
    """
    best, longest = None, 0.0
    for share in SIDES_TRIED:
        found = _polygons(loops, share * side, name)
        shortest = _shortest(*found)
        if all(len(face) == 4 for face in found[1]) and shortest > BETTER * longest:
            best, longest = found, shortest
            if shortest > LONG_ENOUGH * side:
                break
    places, faces = best or _divided(*_polygons(loops, 2 * side, name))
    shortest = _shortest(places, faces)
    if shortest < SHORTEST_SIDE:
        raise FitError(
            f"the outline makes elements with sides of {1e3 * shortest:.1f} mm, too small for any step",
            where=name,
            advice="leave out corners: sides of the outline, its holes and gaps need "
            f"{2e3 * SHORTEST_SIDE:.0f} mm or more",
        )
    return places, np.array([_along_threads(places[face], face) for face in faces])


def distance_to(places: Floats, loops: Sequence[Floats]) -> Floats:
    """Return the distance of points, (n, 2), to the nearest side of any loop [m], (n,)."""
    nearest = np.full(len(places), np.inf)
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, 0), strict=True):
            share = np.clip((places - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
            nearest = np.minimum(nearest, np.linalg.norm(places - a - share[:, None] * (b - a), axis=1))
    return nearest


def is_inside(places: Floats, loops: Sequence[Floats]) -> Booleans:
    """Return whether points, (n, 2), lie inside the outline and in no hole: a ray crosses an odd number of sides."""
    crossings = np.zeros(len(places), int)
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, 0), strict=True):
            if a[1] != b[1]:
                spans = (a[1] > places[:, 1]) != (b[1] > places[:, 1])
                crossings += spans & (places[:, 0] < a[0] + (places[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
    return crossings % 2 == 1


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the vector products of vectors of the plane, (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _polygons(loops: Sequence[Floats], side: float, name: str) -> tuple[Floats, list[Indices]]:
    """Return triangles and quadrilaterals, as corners of `places`."""
    places, sides = _rim(loops, side)
    inner = _squares(loops, side)
    places, triangles = _triangles(places, sides, inner, loops, side, name)
    return places, _joined(places, triangles)


def _rim(loops: Sequence[Floats], side: float) -> tuple[Floats, Indices]:
    """Return the corners along all sides, (n, 2), and the pieces of sides between them, (n, 2)."""
    places: list[Floats] = []
    pieces: list[tuple[int, int]] = []
    first = 0
    for loop in loops:
        start = first
        for a, b in zip(loop, np.roll(loop, -1, 0), strict=True):
            count = max(1, round(float(np.linalg.norm(b - a)) / side))
            places.extend(a + (b - a) * k / count for k in range(count))
            first += count
        pieces += [(k, k + 1 if k + 1 < first else start) for k in range(start, first)]
    return np.array(places), np.array(pieces)


def _squares(loops: Sequence[Floats], side: float) -> Floats:
    """Return the corners of squares along the threads, inside and clear of the outline."""
    low, high = loops[0].min(0), loops[0].max(0)
    across, down = (np.linspace(a, b, max(1, round(float(b - a) / side)) + 1) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(across, down), -1).reshape(-1, 2)
    return places[is_inside(places, loops) & (distance_to(places, loops) > CLEAR * side)]


def _triangles(
    rim: Floats, pieces: Indices, inner: Floats, loops: Sequence[Floats], side: float, name: str
) -> tuple[Floats, Indices]:
    """Return Delaunay triangles that have every piece of a side as an edge."""
    from scipy.spatial import Delaunay

    for _ in range(MOST_HALVINGS):
        places = np.concatenate([rim, inner])
        triangles = Delaunay(places).simplices
        edges = {tuple(sorted((int(t[i]), int(t[i - 1])))) for t in triangles for i in range(3)}
        lacking = np.array([tuple(sorted(map(int, piece))) not in edges for piece in pieces])
        if not lacking.any():
            a, b, c = places[triangles].transpose(1, 0, 2)
            area = np.abs(_cross(b - a, c - a)) / 2
            kept = triangles[is_inside((a + b + c) / 3, loops) & (area > FLATTEST * side**2)]
            return places, kept.astype(np.int64)
        if np.linalg.norm(np.diff(rim[pieces[lacking]], axis=1), axis=2).min() < SHORTEST_SIDE / 4:
            break
        middles = rim[pieces[lacking]].mean(1)
        number = len(rim) + np.arange(len(middles))
        halves = np.concatenate(
            [np.column_stack([pieces[lacking][:, 0], number]), np.column_stack([number, pieces[lacking][:, 1]])]
        )
        rim, pieces = np.concatenate([rim, middles]), np.concatenate([pieces[~lacking], halves])
    raise FitError(
        "the garment's outline cannot be meshed",
        where=name,
        advice="look for sides that touch or nearly touch each other; holes must lie inside the outline and apart",
    )


def _joined(places: Floats, triangles: Indices) -> list[Indices]:
    """Join pairs of triangles into quadrilaterals; return the quadrilaterals and the remaining triangles."""
    owners: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for t, corners in enumerate(triangles):
        for i in range(3):
            ends = sorted((int(corners[i]), int(corners[(i + 1) % 3])))
            owners.setdefault((ends[0], ends[1]), []).append((t, int(corners[(i + 2) % 3])))
    pairs = []
    for (a, b), found in owners.items():
        if len(found) == 2:
            (t, c), (u, d) = found
            ring = np.array([a, c, b, d])
            pairs.append((_shape(places[ring]), -t, -u, ring))
    pairs.sort(key=lambda pair: pair[:3], reverse=True)
    is_free = np.ones(len(triangles), bool)
    faces = []
    for shape, t, u, ring in pairs:
        if shape > WORST_SHAPE and is_free[-t] and is_free[-u]:
            is_free[[-t, -u]] = False
            faces.append(ring)
    return faces + list(triangles[is_free])


def _shortest(places: Floats, faces: list[Indices]) -> float:
    """Return the length of the shortest side [m]."""
    return float(min(np.linalg.norm(places[face] - places[np.roll(face, 1)], axis=1).min() for face in faces))


def _shape(ring: Floats) -> float:
    """Return the least sine of a quadrilateral's angles, negative if it is not convex; ring, (4, 2)."""
    ahead, behind = np.roll(ring, -1, 0) - ring, np.roll(ring, 1, 0) - ring
    sines = _cross(ahead, behind) / (np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1))
    return float(max(sines.min(), (-sines).min()))


def _divided(places: Floats, faces: list[Indices]) -> tuple[Floats, list[Indices]]:
    """Return one quadrilateral at every corner of every face, up to the middles of its sides and of the face."""
    found = list(places)
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        ends = (min(a, b), max(a, b))
        if ends not in middles:
            middles[ends] = len(found)
            found.append((places[a] + places[b]) / 2)
        return middles[ends]

    quads = []
    for face in faces:
        ring = [int(corner) for corner in face]
        centre = len(found)
        found.append(places[face].mean(0))
        for i, corner in enumerate(ring):
            quads.append(
                np.array([corner, middle(corner, ring[i - 1]), centre, middle(corner, ring[(i + 1) % len(ring)])])
            )
    return np.array(found), quads


def _along_threads(ring: Floats, face: Indices) -> Indices:
    """Return the same quadrilateral as top left, top right, bottom right, bottom left: its rows run along X, not Y."""
    if _cross(ring[1] - ring[0], ring[2] - ring[1]) > 0:
        ring, face = ring[::-1], face[::-1]  # clockwise, with y up
    first = int(np.argmax([(ring[(i + 1) % 4] - ring[i] + ring[(i + 2) % 4] - ring[(i + 3) % 4])[0] for i in range(4)]))
    return np.roll(face, -first)
