"""Pictures of moving cloth: shaded triangles, the farthest first, seen from in front and a little from the side.

A camera in the distance d looks at the middle of the motion. A point at right r, up u and depth w from there is drawn
at f r / (d + w), f u / (d + w). Light falls off as the cosine of its angle with the surface (Lambert). A part of the
light comes from everywhere. Between nodes their normals are interpolated. Front and back have two colours.

Source: J. F. Hughes et al., "Computer Graphics: Principles and Practice" (3rd edition 2013): section 6.3, projection;
section 36.3, the painter's algorithm.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.export.moving import Moving
from formats.arrays import Floats

SIDE, ABOVE = np.radians(28.0), np.radians(10.0)  # rad, where the camera stands
DISTANCE = 3.2  # times the size of the motion, from which perspective looks natural
FILLED = 0.84  # of the picture's smaller side
FEWEST_FACES = 6000  # triangles are quartered until their shades are finer than an eye sees
OUTSIDE_FIRST = 0.01  # m by which the outside of cloth is drawn as nearer: layers that touch may cross by as much
SMOOTHEST_EDGE = 0.5  # cosine between a node's and a triangle's normal, below which they meet at a seam
FINER = 2  # times as many pixels are drawn as are kept along each side
AMBIENT = 0.42  # share of the light that comes from everywhere
LIGHT = np.array([0.45, -0.75, 0.6])  # towards the light, world frame
FRONT, BACK = np.array([74, 119, 176]), np.array([206, 156, 96])  # RGB
SKY = (244, 245, 247)
BAR, WORDS = (70, 74, 80), (60, 64, 70)


def node_normals(places: Floats, triangles: NDArray[np.int64]) -> Floats:
    """Return the nodes' unit normals, (nodes, 3), from the triangles that meet there, weighed by their areas."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros(places.shape)
    for k in range(3):
        np.add.at(sums, triangles[:, k], faces)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12))


def _corner_normals(places: Floats, triangles: NDArray[np.int64]) -> Floats:
    """Return unit normals at the corners, (triangles, 3, 3): the nodes', the triangle's own where cloth has an edge."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-12)
    smooth = node_normals(places, triangles)[triangles]
    is_smooth = np.einsum("tkx,tx->tk", smooth, own) > SMOOTHEST_EDGE
    return np.where(is_smooth[..., None], smooth, own[:, None])


def _quartered(corners: Floats) -> Floats:
    """Return four triangles for each, (4 n, 3, width), with values at the middles of its sides."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


class Stage:
    """The camera for one motion, and its pictures."""

    def __init__(self, moving: Moving, size: tuple[int, int]) -> None:
        self.moving, self.size = moving, size
        every = np.concatenate([moving.places.reshape(-1, 3), moving.held.reshape(-1, 3)])
        low, high = every.min(0), every.max(0)
        self._middle = 0.5 * (low + high)
        right = np.array([np.cos(SIDE), np.sin(SIDE), 0.0])
        away = np.array([-np.sin(SIDE) * np.cos(ABOVE), np.cos(SIDE) * np.cos(ABOVE), -np.sin(ABOVE)])
        self._axes = np.stack([right, np.cross(right, away), away])
        extent = float(np.linalg.norm(high - low))
        self._distance = DISTANCE * extent
        seen = self._project(every, 1.0, (0, 0))[0]
        reach = np.abs(seen).max(0)
        self._scale = FILLED * float(np.min(0.5 * np.array(size) / reach))

    def _project(self, places: Floats, scale: float, centre: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return places in the picture [px], (..., 2), y down, and depths [m]."""
        local = (places - self._middle) @ self._axes.T
        depth = local[..., 2]
        flat = local[..., :2] * (scale * self._distance / (self._distance + depth))[..., None]
        return np.stack([centre[0] + flat[..., 0], centre[1] - flat[..., 1]], -1), depth

    def picture(self, frame: int) -> Any:
        """Return one frame as a Pillow image.

        Raises:
            ModuleNotFoundError: Pillow is not installed.
        """
        from PIL import Image, ImageDraw

        wide, high = (FINER * n for n in self.size)
        image = Image.new("RGB", (wide, high), SKY)
        pen = ImageDraw.Draw(image)
        places, triangles = self.moving.places[frame].astype(float), self.moving.triangles
        flat, depth = self._project(places, FINER * self._scale, (wide / 2, high / 2))
        corners, behind, normals = flat[triangles], depth[triangles], _corner_normals(places, triangles)
        while len(corners) < FEWEST_FACES:
            corners, behind, normals = _quartered(corners), _quartered(behind[..., None])[..., 0], _quartered(normals)
        towards = LIGHT / np.linalg.norm(LIGHT)
        mean = normals.mean(1)
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
        # The picture's y runs down: what turns anticlockwise on the cloth's front turns clockwise there.
        p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        is_front = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] < 0
        shade = AMBIENT + (1 - AMBIENT) * np.abs(mean @ towards)
        colours = (np.where(is_front[:, None], FRONT, BACK) * shade[:, None]).clip(0, 255).astype(int)
        for k in np.argsort(-behind.mean(1) + OUTSIDE_FIRST * is_front).tolist():
            colour = tuple(colours[k].tolist())
            pen.polygon([tuple(p) for p in corners[k].tolist()], fill=colour, outline=colour)
        ends, _ = self._project(self.moving.held[frame], FINER * self._scale, (wide / 2, high / 2))
        pen.line([tuple(p) for p in ends.tolist()], fill=BAR, width=3 * FINER)
        for x, y in ends.tolist():
            pen.ellipse((x - 4 * FINER, y - 4 * FINER, x + 4 * FINER, y + 4 * FINER), fill=BAR)
        image = image.resize(self.size, Image.Resampling.BOX)
        ImageDraw.Draw(image).text((12, 10), f"{self.moving.name}   {self.moving.time[frame]:.2f} s", fill=WORDS)
        return image

    def pictures(self) -> Iterator[Any]:
        """Yield every frame as a Pillow image."""
        for frame in range(len(self.moving.time)):
            yield self.picture(frame)
