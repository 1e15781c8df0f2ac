"""Rendering of moving cloth: shaded triangles with a depth buffer, seen from between its front and its side.

A camera in the distance d looks at the middle of the motion, or follows a figure. A point at right r, up u and depth w
from there is drawn at f r / (d + w), f u / (d + w). Light falls off as the cosine of its angle with the surface
(Lambert). A part of the light comes from everywhere. Between nodes their normals are interpolated. Front and back have
two colours. The text above the cloth never overlaps it. Below is a floor with a line every half metre, below small
cloth every fifth of a metre. Light straight above casts a shadow there.

Source: J. F. Hughes et al., "Computer Graphics: Principles and Practice" (3rd edition 2013): section 6.3, projection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from fit.export.moving import Moving
from fit.export.raster import FINER, Faces, drawn
from formats.arrays import Floats, Integers
from formats.plain_text import in_one_line

# Our choice: sizes of the view and the light are set by eye, and no figure depends on them.
BESIDE, ABOVE = np.radians(52.0), np.radians(10.0)  # rad, where the camera stands: swings and strides show there
LIGHT_TURN = np.radians(-46.0)  # rad by which the light of a figure is turned about the vertical
CAMERA_DISTANCE = 3.2  # times the size of the motion, from which perspective looks natural
FILLED = 0.84  # of the picture's smaller side
OUTSIDE_FIRST = 0.01  # m: depth offset of the outside of cloth, as layers in contact may overlap by this much
SMOOTHEST_EDGE = 0.5  # cosine between a node's and a triangle's normal, below which they meet at a seam
AMBIENT = 0.42  # share of the light that comes from everywhere, set by eye: folds show, and no cloth is black
TOWARDS_LIGHT = np.array([0.45, -0.75, 0.6])  # towards the light, world frame, set by eye: from above and beside
# RGB. Our choice: with near colours a fold could not be told from its back.
FRONT_COLOUR, BACK_COLOUR = np.array([74, 119, 176]), np.array([206, 156, 96])
SKIN = np.array([196, 188, 180])  # RGB; our choice: each is told from its neighbours
SKY = (244, 245, 247)  # RGB; our choice: each is told from its neighbours
LINE, SHADOW = np.array([222, 224, 228]), np.array([208, 210, 215])  # RGB; our choice: each is told from its neighbours
BAR_COLOUR, WORDS_COLOUR = (70, 74, 80), (60, 64, 70)  # RGB; our choice: each is told from its neighbours
LETTER_SHARE, SMALLEST_LETTER = 1 / 45, 10.0  # of the picture's height, and px: legible at arm's length
TITLE_LINES = 3.0  # times the letters' size: space for text at the top
LEAST_TITLED = 200  # px: below this height the cloth fills the picture without text
END_SIZE = 4  # px, of the ends of the bar that holds the cloth
# of a line on the floor. Our choice: perspective bends no straight line, so the count only bounds how far depth is
# off where cloth hides a line.
PIECES_OF_A_LINE = 24
FLOOR_LINES, SMALL_LINES = 0.5, 0.2  # m between lines: of large motion, and of small motion
SMALL_EXTENT = 1.2  # m: motion of a smaller extent is small
LINE_SHARE, FLOOR_SPANS = 0.024, 6  # width of a line over the distance of lines, and these distances from end to end
BELOW_CLOTH = 0.15  # times the height of hanging cloth, from its lowest place down to the floor
Seen = Callable[[Floats], Floats]

SHADOW_OFFSET = 100.0  # m: depth offset of shadows and lines behind everything on the floor


def node_normals(places: Floats, triangles: Integers) -> Floats:
    """Return the nodes' unit normals, (nodes, 3), as area-weighted means of their triangles' normals."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros(places.shape)
    for k in range(3):
        np.add.at(sums, triangles[:, k], faces)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12))


def _corner_normals(places: Floats, triangles: Integers) -> Floats:
    """Return unit normals at the corners, (triangles, 3, 3): the nodes', the triangle's own where cloth has an edge."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-12)
    smooth = node_normals(places, triangles)[triangles]
    is_smooth = np.einsum("tkx,tx->tk", smooth, own) > SMOOTHEST_EDGE
    return np.where(is_smooth[..., None], smooth, own[:, None])


class Stage:
    """The camera for one motion, and its pictures."""

    def __init__(self, moving: Moving, size: tuple[int, int]) -> None:
        self.moving, self.size = moving, size
        right = np.array([np.cos(BESIDE), np.sin(BESIDE), 0.0])
        away = np.array([-np.sin(BESIDE) * np.cos(ABOVE), np.cos(BESIDE) * np.cos(ABOVE), -np.sin(ABOVE)])
        self._axes = np.stack([right, np.cross(right, away), away])
        self._followed = moving.followed
        every = np.concatenate([moving.places - self._followed[:, None], moving.held - self._followed[:, None]], 1)
        if moving.figure is not None:
            few = range(0, len(moving.time), max(len(moving.time) // 30, 1))
            seen = [moving.figure.places(float(moving.time[n])) - self._followed[n] for n in few]
            every = np.concatenate([every.reshape(-1, 3), *seen])
        every = every.reshape(-1, 3)
        low, high = every.min(0), every.max(0)
        self._floor_at = 0.0 if moving.figure is not None else float(low[2] - BELOW_CLOTH * (high[2] - low[2]))  # m up
        low[2] = min(low[2], self._floor_at)
        every = np.concatenate([every, every * [1.0, 1.0, 0.0] + [0.0, 0.0, self._floor_at]])  # with their shadows
        self._middle = 0.5 * (low + high)
        extent = float(np.linalg.norm(high - low))
        self._apart = FLOOR_LINES if extent > SMALL_EXTENT else SMALL_LINES
        self._distance = CAMERA_DISTANCE * extent
        reach = np.abs(self._project(every, np.zeros(3), 1.0, (0, 0))[..., :2]).max(0)
        self._letter = max(LETTER_SHARE * size[1], SMALLEST_LETTER)
        self._title = round(TITLE_LINES * self._letter) if size[1] >= LEAST_TITLED else 0
        free = np.array([size[0], size[1] - self._title])
        self._scale = FILLED * float(np.min(0.5 * free / reach))
        turn = 0.0 if moving.figure is None else LIGHT_TURN
        cos, sin = np.cos(turn), np.sin(turn)
        light = np.array(
            [
                cos * TOWARDS_LIGHT[0] - sin * TOWARDS_LIGHT[1],
                sin * TOWARDS_LIGHT[0] + cos * TOWARDS_LIGHT[1],
                TOWARDS_LIGHT[2],
            ]
        )
        self._light = light / np.linalg.norm(light)

    def _project(self, places: Floats, followed: Floats, scale: float, centre: tuple[float, float]) -> Floats:
        """Project points into the picture, (..., 3): right and down [px], and distance [m] along the camera's view."""
        local = (places - followed - self._middle) @ self._axes.T
        far = self._distance + local[..., 2]
        flat = local[..., :2] * (scale * self._distance / far)[..., None]
        return np.stack([centre[0] + flat[..., 0], centre[1] - flat[..., 1], far], -1)

    def picture(self, frame: int) -> Any:
        """Return one frame as a Pillow image.

        Raises:
            ModuleNotFoundError: Pillow is not installed.
        """
        from PIL import Image, ImageDraw, ImageFont

        wide, high = (FINER * n for n in self.size)
        moving, followed = self.moving, self._followed[frame]

        def seen(places: Floats) -> Floats:
            return self._project(places, followed, FINER * self._scale, (wide / 2, (high + FINER * self._title) / 2))

        places, triangles = moving.places[frame].astype(float), moving.triangles
        corners = seen(places)[triangles]
        p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        is_front = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] < 0
        corners[..., 2] -= OUTSIDE_FIRST * is_front[:, None]
        faces = [_faces(corners, _corner_normals(places, triangles), FRONT_COLOUR, BACK_COLOUR)]
        if moving.figure is not None:
            body, parts = moving.figure.places(float(moving.time[frame])), moving.figure.triangles
            faces.append(_faces(seen(body)[parts], _corner_normals(body, parts), SKIN, SKIN))
            faces.append(self._shadow(seen, body[parts]))
        else:
            faces.append(self._bar(seen(moving.held[frame])))
        faces += [self._shadow(seen, places[triangles]), self._floor(seen, followed)]
        picture = drawn(Faces.together(*faces), self.size, np.array(SKY), self._light, AMBIENT)
        image = Image.fromarray(picture)
        if self._title:
            drawing, words = ImageDraw.Draw(image), f"{moving.time[frame]:.2f} s"
            whole = f"{in_one_line(moving.name)}   {words}"
            font = ImageFont.load_default(self._letter)
            fits = drawing.textlength(whole, font) <= self.size[0] - 2 * self._letter
            drawing.text((self._letter, self._letter), whole if fits else words, fill=WORDS_COLOUR, font=font)
        return image

    @staticmethod
    def _bar(ends: Floats) -> Faces:
        """Return faces of the held edge's bar and its ends, in front of everything; ends, (2, 3), in the picture."""
        along = ends[1, :2] - ends[0, :2]
        across = FINER * np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
        quad = np.array([ends[0, :2] - across, ends[1, :2] - across, ends[1, :2] + across, ends[0, :2] + across])
        turns = np.linspace(0, 2 * np.pi, 13)
        rim = END_SIZE * FINER * np.stack([np.cos(turns), np.sin(turns)], 1)
        discs = [np.array([end, end + rim[k], end + rim[k + 1]]) for end in ends[:, :2] for k in range(12)]
        flat = np.concatenate([quad[[[0, 1, 2], [0, 2, 3]]], discs])
        return _flat(np.concatenate([flat, np.full((len(flat), 3, 1), 1e-2)], 2), np.array(BAR_COLOUR))

    def _shadow(self, seen: Seen, corners: Floats) -> Faces:
        """Return triangles, (n, 3, 3), projected vertically onto the floor."""
        return _flat(
            seen(corners * [1.0, 1.0, 0.0] + [0.0, 0.0, self._floor_at]) + np.array([0.0, 0.0, SHADOW_OFFSET]), SHADOW
        )

    def _floor(self, seen: Seen, followed: Floats) -> Faces:
        """Return the lines on the floor about the figure, or below the cloth."""
        apart, count = self._apart, FLOOR_SPANS // 2
        half = count * apart
        if self.moving.figure is None:
            followed = followed + self._middle
        quads = []
        for axis in range(2):
            middle = apart * np.round(followed[axis] / apart)
            for k in range(-count, count + 1):
                at, low = middle + k * apart, followed[1 - axis] - half
                quad = np.full((PIECES_OF_A_LINE, 4, 3), self._floor_at)
                quad[..., axis] = at + LINE_SHARE * apart * np.array([-0.5, 0.5, 0.5, -0.5])
                quad[..., 1 - axis] = low + 2 * half / PIECES_OF_A_LINE * (
                    np.arange(PIECES_OF_A_LINE)[:, None] + np.array([0, 0, 1, 1])
                )
                quads.append(quad)
        corners = np.concatenate(quads)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
        return _flat(seen(corners) + np.array([0.0, 0.0, 2 * SHADOW_OFFSET]), LINE)

    def pictures(self) -> Iterator[Any]:
        """Yield every frame as a Pillow image."""
        for frame in range(len(self.moving.time)):
            yield self.picture(frame)


def _faces(corners: Floats, normals: Floats, front: Floats, back: Floats) -> Faces:
    """Return triangles of one piece."""
    count = len(corners)
    return Faces(corners, normals, np.tile(front, (count, 1)), np.tile(back, (count, 1)), np.ones(count))


def _flat(corners: Floats, colour: Floats) -> Faces:
    """Return triangles of one colour without shading."""
    count = len(corners)
    colours = np.tile(colour, (count, 1))
    return Faces(corners, np.ones((count, 3, 3)), colours, colours, np.zeros(count))
