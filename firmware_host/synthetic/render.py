"""Render the synthetic world: true depth and colour of a wall, a clamp bar, two marker plates and the cloth.

Pinhole camera: u = fx x / z + cx, v = fy y / z + cy. Pixel k covers k - 1/2 to k + 1/2 (`docs/reference/sensors.md`,
"Where a pixel is"). It shows what the ray of its centre meets, so a straight edge is drawn without a constant error:

    first pixel = ceil(u_left),   E[ceil(u_left) - 1/2] = u_left       over all positions of the edge

The cloth is a grid of nodes, bilinear between them. Pieces of about half a pixel divide each cell into triangles. The
plane of a triangle is linear in inverse depth,

    1/z = (1 - b - c) / z_0 + b / z_1 + c / z_2

with barycentric coordinates b and c in the image. The nearest triangle on a ray counts. Plates, bar and panels are
flat, and each pixel's ray meets them exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_host.synthetic.pattern import Pattern
from firmware_host.synthetic.scene import BAR_SIZE, CAMERA, HANGER, MARKER_BITS, PLATE_SIZE, WALL_DISTANCE
from firmware_host.synthetic.surroundings import Panel, Surroundings, draw_panel
from formats.arrays import Floats, Integers

# a side, per pixel of plates and bar. Our choice: edges in steps of a ninth of a pixel's area. Half and double were
# not tried.
SAMPLES_A_SIDE = 3
DRAWN_SPACING = 1.3e-3  # m, longest side of a piece of the flat cloth: half a pixel at 1.5 m
NEAREST_DRAWN = 0.1  # m; our choice: a sensor measures nothing below 0.4 m
SHARED_EDGE = 1e-9  # of a triangle: rounding leaves no ray between two triangles that share an edge
# Our choice: brightness, 0 to 255, that keeps wall, bar, cloth and plates apart.
WALL, BAR_GREY, CLOTH, WHITE, BLACK = 128.0, 60.0, (176.0, 74.0, 82.0), 235.0, 22.0
LIGHT_DIRECTION = np.array([0.3, -0.5, -0.8]) / np.linalg.norm([0.3, -0.5, -0.8])  # our choice: light from above


@dataclass(frozen=True)
class View:
    """True depth [m], (height, width), and colour, (height, width, 3), 0 to 255."""

    depth: Floats
    colour: Floats


class Renderer:
    """Renders poses; caches the parts that do not change."""

    def __init__(
        self, pattern: Pattern, surroundings: Surroundings | None = None, spacing: float = DRAWN_SPACING
    ) -> None:
        rows, columns, _ = pattern.rest.shape
        row_pieces, column_pieces = (
            int(np.ceil(np.linalg.norm(np.diff(pattern.rest, axis=axis), axis=2).max() / spacing)) for axis in (0, 1)
        )
        self._down, self._across = _interpolation(rows, row_pieces), _interpolation(columns, column_pieces)
        self._is_cloth = pattern.is_cloth.repeat(row_pieces, axis=0).repeat(column_pieces, axis=1)
        flat = self._fine(pattern.rest)[..., :2]
        self._middles, self._areas = _middles(flat), _areas(flat)
        v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(float)
        # A wall with a faint pattern, so that colour images are not flat.
        wall = WALL + 14 * np.sin(u / 23.0) * np.sin(v / 31.0)
        colour = np.repeat(wall[..., None], 3, axis=2)
        depth = np.full((CAMERA.height, CAMERA.width), surroundings.wall if surroundings else WALL_DISTANCE)
        if surroundings:
            surroundings.draw(depth, colour)
        self._behind = View(depth, colour)

    def cloth(self, nodes: Floats, in_front: tuple[Panel, ...] = ()) -> View:
        """Draw the cloth's nodes, (rows, columns, 3), between the surroundings and the objects in front."""
        depth, colour = self._behind.depth.copy(), self._behind.colour.copy()
        self._draw_cloth(nodes, depth, colour)
        for panel in in_front:
            draw_panel(panel, depth, colour)
        return View(depth, colour)

    def with_hanger(self, scene: View, origin: Floats, rotation: Floats) -> View:
        """Draw the hanger over a copy of a scene."""
        depth, colour = scene.depth.copy(), scene.colour.copy()
        bar_at = origin + rotation @ np.array([0.0, HANGER.held_m[0][1] - 0.004, -0.004])
        _draw_rectangle(bar_at, rotation, BAR_SIZE, depth, colour, None)
        half = HANGER.marker_distance_m / 2
        for side, marker in ((-half, HANGER.ids[0]), (half, HANGER.ids[1])):
            at = origin + rotation @ np.array([side, 0.0, 0.0])
            _draw_rectangle(at, rotation, (PLATE_SIZE, PLATE_SIZE), depth, colour, marker)
        return View(depth, colour)

    def shown(self, nodes: Floats, in_front: tuple[Panel, ...] = ()) -> tuple[Floats, Floats]:
        """Return true depth [m], (height, width), without the hanger, and each pixel's place on the flat garment.

        Places [m], (height, width, 2), are the middles of pieces, NaN where a pixel shows no cloth; nodes, in_front:
        see `cloth`.
        """
        depth = self._behind.depth.copy()
        places = np.full((*depth.shape, 2), np.nan)
        pixel, z, piece = self._at_centres(nodes)
        depth.reshape(-1)[pixel] = z
        places.reshape(-1, 2)[pixel] = self._middles.reshape(-1, 2)[piece]
        bare = depth.copy()
        for panel in in_front:
            draw_panel(panel, depth, np.zeros((*depth.shape, 3)))
        places[depth < bare] = np.nan
        return depth, places

    def area_near(self, place: Floats, radius: float) -> float:
        """Return the area [m^2] of the flat garment within a radius [m] of a point [m], (2,)."""
        is_near = ((self._middles - place) ** 2).sum(2) < radius**2
        return float(self._areas[is_near & self._is_cloth].sum())

    def _fine(self, nodes: Floats) -> Floats:
        """Return the drawn points, (fine rows, fine columns, 3), of nodes, (rows, columns, 3)."""
        rows, columns, _ = nodes.shape
        return np.asarray(self._across @ (self._down @ nodes.reshape(rows, -1)).reshape(-1, columns, 3))

    def _at_centres(self, nodes: Floats) -> tuple[Integers, Floats, Integers]:
        """Return pixels, depths [m] and numbers of the pieces on the rays of pixels' centres, far first."""
        x, y, z = np.moveaxis(self._fine(nodes), 2, 0)
        nearness = 1 / np.maximum(z, 0.5 * NEAREST_DRAWN)
        image = np.stack([CAMERA.fx * x * nearness + CAMERA.cx, CAMERA.fy * y * nearness + CAMERA.cy, nearness])
        begin = np.maximum(np.ceil(_of_corners(np.minimum, image[:2])), 0).astype(np.int64)
        last = np.array([CAMERA.width - 1, CAMERA.height - 1])[:, None, None]
        end = np.minimum(np.floor(_of_corners(np.maximum, image[:2])), last).astype(np.int64)
        is_drawn = self._is_cloth & (end >= begin).all(0) & (_of_corners(np.minimum, z[None])[0] > NEAREST_DRAWN)
        row, column = np.nonzero(is_drawn)
        corners = [image[:, row + down, column + across] for down, across in ((0, 0), (0, 1), (1, 1), (1, 0))]
        begin, end = begin[:, row, column], end[:, row, column]
        piece = row * self._is_cloth.shape[1] + column
        found = [np.zeros((3, 0))]
        reach = (end - begin).max(1, initial=-1) + 1  # px that a piece may hold, across and down: 1 but for near cloth
        for step in np.ndindex(*reach):
            centre = begin + np.array(step)[:, None]
            near = np.where((centre <= end).all(0), _nearest_of_two_triangles(corners, centre), 0.0)
            found.append(np.stack([centre[1] * CAMERA.width + centre[0], piece, near])[:, near > 0])
        pixel, piece, near = np.concatenate(found, axis=1)
        order = np.argsort(near, kind="stable")
        return pixel[order].astype(np.int64), 1 / near[order], piece[order].astype(np.int64)

    def _draw_cloth(self, nodes: Floats, depth: Floats, colour: Floats) -> None:
        along, down = np.gradient(nodes, axis=1), np.gradient(nodes, axis=0)
        normal = np.cross(along, down)
        normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
        shade = 0.35 + 0.65 * np.abs(normal @ LIGHT_DIRECTION)
        shade = _middles((self._down @ shade @ self._across.T)[..., None])
        pixel, z, piece = self._at_centres(nodes)
        depth.reshape(-1)[pixel] = z
        colour.reshape(-1, 3)[pixel] = shade.reshape(-1, 1)[piece] * np.asarray(CLOTH)


def _of_corners(best: np.ufunc, values: Floats) -> Floats:
    """Return the least or most, (k, pieces down, pieces across), of values, (k, fine rows, fine columns)."""
    along = best(values[:, 1:], values[:, :-1])
    return np.asarray(best(along[:, :, 1:], along[:, :, :-1]))


def _nearest_of_two_triangles(corners: list[Floats], centre: Integers) -> Floats:
    """Return 1/z [1/m], (n,), where the rays of pixels, (2, n), first meet quadrilaterals, 0 where they miss them.

    corners: four of (3, n), columns, rows and 1/z.
    """
    nearest = np.zeros(centre.shape[1])
    for one, two, three in ((0, 1, 2), (0, 2, 3)):
        origin = corners[one]
        p, q, to = corners[two] - origin, corners[three] - origin, centre - origin[:2]
        with np.errstate(divide="ignore", invalid="ignore"):  # a triangle seen edge-on holds no ray
            b = (to[0] * q[1] - q[0] * to[1]) / (p[0] * q[1] - q[0] * p[1])
            c = (p[0] * to[1] - to[0] * p[1]) / (p[0] * q[1] - q[0] * p[1])
            is_met = (b >= -SHARED_EDGE) & (c >= -SHARED_EDGE) & (b + c <= 1 + SHARED_EDGE)
            nearest = np.maximum(nearest, np.where(is_met, origin[2] + b * p[2] + c * q[2], 0.0))
    return np.asarray(nearest)


def _middles(fine: Floats) -> Floats:
    """Return the means of corners, (pieces down, pieces across, k), of values, (fine rows, fine columns, k)."""
    return np.asarray(0.25 * (fine[1:, 1:] + fine[1:, :-1] + fine[:-1, 1:] + fine[:-1, :-1]))


def _areas(flat: Floats) -> Floats:
    """Return the areas [m^2], (pieces down, pieces across), between points [m], (fine rows, fine columns, 2)."""
    down, across = flat[1:, :-1] - flat[:-1, :-1], flat[:-1, 1:] - flat[:-1, :-1]
    return np.asarray(np.abs(down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0]))


def _interpolation(count: int, pieces: int) -> Floats:
    """Weights, ((count - 1) pieces + 1, count), of linear interpolation at equal steps, `pieces` between two nodes."""
    place = np.linspace(0, count - 1, (count - 1) * pieces + 1)
    lower = np.minimum(place.astype(int), count - 2)
    weights = np.zeros((len(place), count))
    weights[np.arange(len(place)), lower] = 1 - (place - lower)
    weights[np.arange(len(place)), lower + 1] = place - lower
    return weights


def _draw_rectangle(
    at: Floats, rotation: Floats, size: tuple[float, float], depth: Floats, colour: Floats, marker: int | None
) -> None:
    """Draw a flat rectangle square to the hanger's depth axis; with a marker id, a white plate that carries it."""
    corners = (
        at + (np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * (0.5 * np.array([*size, 0]))) @ rotation.T
    )
    u, v = CAMERA.fx * corners[:, 0] / corners[:, 2] + CAMERA.cx, CAMERA.fy * corners[:, 1] / corners[:, 2] + CAMERA.cy
    left, right = max(int(u.min()) - 1, 0), min(int(u.max()) + 2, CAMERA.width)
    top, bottom = max(int(v.min()) - 1, 0), min(int(v.max()) + 2, CAMERA.height)
    if left >= right or top >= bottom:
        return
    fraction = (np.arange(SAMPLES_A_SIDE) + 0.5) / SAMPLES_A_SIDE - 0.5
    us = (np.arange(left, right)[:, None] + fraction).ravel()
    vs = (np.arange(top, bottom)[:, None] + fraction).ravel()
    ray = np.stack(
        np.broadcast_arrays((us[None] - CAMERA.cx) / CAMERA.fx, (vs[:, None] - CAMERA.cy) / CAMERA.fy, 1.0), -1
    )
    normal = rotation[:, 2]
    z = (at @ normal) / (ray @ normal)
    local = (ray * z[..., None] - at) @ rotation
    inside = (np.abs(local[..., 0]) <= size[0] / 2) & (np.abs(local[..., 1]) <= size[1] / 2)
    value = np.full(inside.shape, BAR_GREY) if marker is None else _marker_pattern(local, marker)
    shape = (bottom - top, SAMPLES_A_SIDE, right - left, SAMPLES_A_SIDE)
    covered = inside.reshape(shape).mean((1, 3))
    painted = (value * inside).reshape(shape).sum((1, 3)) / np.maximum(inside.reshape(shape).sum((1, 3)), 1)
    patch, behind = depth[top:bottom, left:right], colour[top:bottom, left:right]
    middle = z.reshape(shape).mean((1, 3))
    is_near = middle < patch
    share = np.where(is_near, covered, 0.0)[..., None]
    behind[:] = (1 - share) * behind + share * painted[..., None]
    patch[:] = np.where(is_near & (covered > 0.5), middle, patch)


def _marker_pattern(local: Floats, marker: int) -> Floats:
    """Return the brightness of a marker plate at points of its plane [m], (..., 3)."""
    bits = np.zeros((6, 6))
    bits[1:5, 1:5] = MARKER_BITS[marker]
    cell = HANGER.marker_size_m / 6
    column = np.floor(local[..., 0] / cell + 3).astype(int)
    row = np.floor(local[..., 1] / cell + 3).astype(int)
    inside = (column >= 0) & (column < 6) & (row >= 0) & (row < 6)
    bit = bits[np.clip(row, 0, 5), np.clip(column, 0, 5)]
    return np.where(inside, np.where(bit > 0, WHITE, BLACK), WHITE)
