"""Render the synthetic world: true depth and colour of a wall, a clamp bar, two marker plates and the cloth.

Pinhole camera: u = fx x / z + cx, v = fy y / z + cy. The cloth is a grid of nodes, bilinear between them. Its points
are about half a pixel apart and are drawn into a depth buffer. Plates and bar are flat, and each pixel's ray meets them
exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_host.synthetic.pattern import Pattern
from firmware_host.synthetic.scene import BAR_SIZE, CAMERA, HANGER, MARKER_BITS, PLATE_SIZE, WALL_DISTANCE
from firmware_host.synthetic.surroundings import Panel, Surroundings, draw_panel
from formats.arrays import Booleans, Floats, Integers

# a side, per pixel of plates and bar. Our choice: edges in steps of a ninth of a pixel's area. Half and double were
# not tried.
SAMPLES_A_SIDE = 3
DRAWN_SPACING = 1.3e-3  # m between drawn points of the cloth: half a pixel at 1.5 m, so that no pixel stays empty
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
        height = float(np.abs(np.diff(pattern.rest[..., 1], axis=0)).max(1).sum())
        width = float(np.abs(np.diff(pattern.rest[..., 0], axis=1)).max(0).sum())
        fine_rows, fine_columns = int(height / spacing), int(width / spacing)
        self._down, self._across = _interpolation(rows, fine_rows), _interpolation(columns, fine_columns)
        row, column = (np.minimum(np.linspace(0, n - 1, fine).astype(int), n - 2)
                       for n, fine in ((rows, fine_rows), (columns, fine_columns)))  # fmt: skip
        self._drawn = pattern.is_cloth[row][:, column].ravel()
        flat = self._fine(pattern.rest)[..., :2]
        self._flat = flat.reshape(-1, 2)
        self._pieces = _pieces(flat, self._drawn.reshape(flat.shape[:2]))
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
        """Return true depth [m], (height, width), without the hanger, and each pixel's point on the flat garment.

        Points [m], (height, width, 2), NaN where a pixel shows no cloth; nodes, in_front: see `cloth`.
        """
        depth = self._behind.depth.copy()
        places = np.full((*depth.shape, 2), np.nan)
        pixel, z, which = self._projected(self._fine(nodes))
        depth.reshape(-1)[pixel] = z
        places.reshape(-1, 2)[pixel] = self._flat[which]
        bare = depth.copy()
        for panel in in_front:
            draw_panel(panel, depth, np.zeros((*depth.shape, 3)))
        places[depth < bare] = np.nan
        return depth, places

    def area_near(self, place: Floats, radius: float) -> float:
        """Return the area [m^2] of the flat garment within a radius [m] of a point [m], (2,)."""
        middles, areas = self._pieces
        return float(areas[((middles - place) ** 2).sum(1) < radius**2].sum())

    def _fine(self, nodes: Floats) -> Floats:
        """Return the drawn points, (fine rows, fine columns, 3), of nodes, (rows, columns, 3)."""
        rows, columns, _ = nodes.shape
        return np.asarray(self._across @ (self._down @ nodes.reshape(rows, -1)).reshape(-1, columns, 3))

    def _projected(self, fine: Floats) -> tuple[Integers, Floats, NDArray[np.intp]]:
        """Return pixels, depths [m] and numbers of the drawn points in the image, far first: the nearest overwrites."""
        z = fine[..., 2].ravel()
        u = np.rint(CAMERA.fx * fine[..., 0].ravel() / z + CAMERA.cx).astype(np.int64)
        v = np.rint(CAMERA.fy * fine[..., 1].ravel() / z + CAMERA.cy).astype(np.int64)
        inside = (u >= 0) & (u < CAMERA.width) & (v >= 0) & (v < CAMERA.height) & (z > 0.1) & self._drawn
        which = np.flatnonzero(inside)
        which = which[np.argsort(-z[which], kind="stable")]
        return (v * CAMERA.width + u)[which], z[which], which

    def _draw_cloth(self, nodes: Floats, depth: Floats, colour: Floats) -> None:
        along, down = np.gradient(nodes, axis=1), np.gradient(nodes, axis=0)
        normal = np.cross(along, down)
        normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
        shade = 0.35 + 0.65 * np.abs(normal @ LIGHT_DIRECTION)
        shade = self._down @ shade @ self._across.T
        pixel, z, which = self._projected(self._fine(nodes))
        depth.reshape(-1)[pixel] = z
        colour.reshape(-1, 3)[pixel] = shade.ravel()[which, None] * np.asarray(CLOTH)


def _pieces(flat: Floats, drawn: Booleans) -> tuple[Floats, Floats]:
    """Return middles [m], (pieces, 2), and areas [m^2], (pieces,), of the pieces between neighbouring drawn points."""
    down, across = flat[1:, :-1] - flat[:-1, :-1], flat[:-1, 1:] - flat[:-1, :-1]
    areas = np.abs(down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0])
    middles = 0.25 * (flat[1:, 1:] + flat[1:, :-1] + flat[:-1, 1:] + flat[:-1, :-1])
    return middles[drawn[:-1, :-1]], areas[drawn[:-1, :-1]]


def _interpolation(count: int, fine: int) -> Floats:
    """Weights, (fine, count), of linear interpolation."""
    place = np.linspace(0, count - 1, fine)
    lower = np.minimum(place.astype(int), count - 2)
    weights = np.zeros((fine, count))
    weights[np.arange(fine), lower] = 1 - (place - lower)
    weights[np.arange(fine), lower + 1] = place - lower
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
