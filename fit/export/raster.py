"""Rasteriser of shaded triangles with a depth buffer and linearly interpolated normals.

A triangle covers the pixels whose centres lie inside. Its depth is linear in the picture, which is exact for planes in
a parallel projection and within a thousandth of the depth here. Colour is that of the triangle's side seen, times

    shade = ambient + (1 - ambient) |n . l|

with the unit normal n at the pixel and the direction l of the light (Lambert). A triangle of shade 0 is flat: its
colour is taken as it is. Each output pixel is the mean of FINER by FINER drawn pixels.

Source: J. F. Hughes et al., "Computer Graphics: Principles and Practice" (3rd edition 2013), section 15.6: the z-buffer
and barycentric interpolation.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit import runtime
from formats.arrays import Bytes, Floats

# drawn pixels per output pixel along each side. Our choice: 1 shows stairs on edges, and 3 takes more than twice the
# time.
FINER = 2
UNCOVERED = np.int64(2**63 - 1)  # index of a pixel without a triangle


@dataclass(frozen=True)
class Faces:
    """Triangles in the picture.

    - `corners`, (n, 3, 3): right and down [px], depth [m] > 0
    - `normals`, (n, 3, 3): unit vectors at the corners
    - `front`, `back`, (n, 3): colours 0 to 255 of the sides that turn anticlockwise to the eye, and clockwise
    - `shaded`, (n,): 1, or 0 for a flat colour
    """

    corners: Floats
    normals: Floats
    front: Floats
    back: Floats
    shaded: Floats

    @staticmethod
    def together(*parts: "Faces") -> "Faces":
        """Return all triangles of several parts."""
        names = ("corners", "normals", "front", "back", "shaded")
        return Faces(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


@functools.cache
def _kernels() -> tuple[Any, Any]:
    """Compile the two passes of the rasteriser: depth, then colour."""
    runtime.start()
    import taichi as ti

    singles_2d = ti.types.ndarray(dtype=ti.f32, ndim=2)
    singles_3d = ti.types.ndarray(dtype=ti.f32, ndim=3)
    singles_1d = ti.types.ndarray(dtype=ti.f32, ndim=1)
    bytes_3d = ti.types.ndarray(dtype=ti.u8, ndim=3)
    nearest_2d = ti.types.ndarray(dtype=ti.i64, ndim=2)

    @ti.func
    def shares(corners: ti.template(), k, x, y):
        """Return the barycentric coordinates of a pixel's centre, and twice the triangle's area."""
        ax, ay = corners[k, 0, 0], corners[k, 0, 1]
        bx, by = corners[k, 1, 0] - ax, corners[k, 1, 1] - ay
        cx, cy = corners[k, 2, 0] - ax, corners[k, 2, 1] - ay
        doubled = bx * cy - by * cx
        px, py = x + 0.5 - ax, y + 0.5 - ay
        one = (px * cy - py * cx) / doubled
        two = (bx * py - by * px) / doubled
        return 1.0 - one - two, one, two, doubled

    @ti.kernel
    def cover(corners: singles_3d, nearest: nearest_2d):
        high, wide = nearest.shape[0], nearest.shape[1]
        for k in range(corners.shape[0]):
            x0 = ti.min(ti.min(corners[k, 0, 0], corners[k, 1, 0]), corners[k, 2, 0])
            x1 = ti.max(ti.max(corners[k, 0, 0], corners[k, 1, 0]), corners[k, 2, 0])
            y0 = ti.min(ti.min(corners[k, 0, 1], corners[k, 1, 1]), corners[k, 2, 1])
            y1 = ti.max(ti.max(corners[k, 0, 1], corners[k, 1, 1]), corners[k, 2, 1])
            first, last = ti.max(ti.cast(x0, ti.i32), 0), ti.min(ti.cast(x1, ti.i32) + 1, wide)
            top, bottom = ti.max(ti.cast(y0, ti.i32), 0), ti.min(ti.cast(y1, ti.i32) + 1, high)
            for y in range(top, bottom):
                for x in range(first, last):
                    a, b, c, doubled = shares(corners, k, x, y)
                    if ti.abs(doubled) > 1e-9 and a >= -1e-5 and b >= -1e-5 and c >= -1e-5:
                        depth = a * corners[k, 0, 2] + b * corners[k, 1, 2] + c * corners[k, 2, 2]
                        bits = ti.bit_cast(ti.max(depth, 1e-3), ti.i32)  # ordered like positive floats
                        code = (ti.cast(bits, ti.i64) << 32) + ti.cast(k, ti.i64)
                        ti.atomic_min(nearest[y, x], code)

    @ti.kernel
    def shade(
        corners: singles_3d, normals: singles_3d, front: singles_2d, back: singles_2d, shaded: singles_1d,
        nearest: nearest_2d, picture: bytes_3d, sky: singles_1d, light: singles_1d, ambient: ti.f32, nothing: ti.i64,
    ):  # fmt: skip
        for v, u in ti.ndrange(picture.shape[0], picture.shape[1]):
            red, green, blue = 0.0, 0.0, 0.0
            for i, j in ti.static(ti.ndrange(FINER, FINER)):
                y, x = FINER * v + i, FINER * u + j
                r, g, b = sky[0], sky[1], sky[2]
                if nearest[y, x] < nothing:
                    k = ti.cast(nearest[y, x], ti.i32)
                    one, two, three, doubled = shares(corners, k, x, y)
                    n0 = one * normals[k, 0, 0] + two * normals[k, 1, 0] + three * normals[k, 2, 0]
                    n1 = one * normals[k, 0, 1] + two * normals[k, 1, 1] + three * normals[k, 2, 1]
                    n2 = one * normals[k, 0, 2] + two * normals[k, 1, 2] + three * normals[k, 2, 2]
                    size = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-12
                    bright = ambient + (1.0 - ambient) * ti.abs(n0 * light[0] + n1 * light[1] + n2 * light[2]) / size
                    bright = shaded[k] * bright + 1.0 - shaded[k]
                    r, g, b = bright * back[k, 0], bright * back[k, 1], bright * back[k, 2]
                    if doubled < 0.0:  # down is positive: anticlockwise in the picture is clockwise here
                        r, g, b = bright * front[k, 0], bright * front[k, 1], bright * front[k, 2]
                red, green, blue = red + r, green + g, blue + b
            share = 1.0 / (FINER * FINER)
            picture[v, u, 0] = ti.cast(ti.min(red * share + 0.5, 255.0), ti.u8)
            picture[v, u, 1] = ti.cast(ti.min(green * share + 0.5, 255.0), ti.u8)
            picture[v, u, 2] = ti.cast(ti.min(blue * share + 0.5, 255.0), ti.u8)

    return cover, shade


def drawn(
    faces: Faces, size: tuple[int, int], sky: Floats, light: Floats, ambient: float
) -> Bytes:  # fmt: skip
    """Return a picture of faces, (rows, columns, 3), with corners in pixels of a picture FINER times as fine.

    size: columns and rows; sky: background colour; light: unit vector towards the light; ambient: share of ambient
    light
    """
    cover, shade = _kernels()
    wide, high = size
    picture = np.zeros((high, wide, 3), np.uint8)
    nearest = np.full((FINER * high, FINER * wide), UNCOVERED)
    given = [np.ascontiguousarray(v, np.float32) for v in (
        faces.corners, faces.normals, faces.front, faces.back, faces.shaded,
    )]  # fmt: skip
    cover(given[0], nearest)
    shade(
        *given, nearest, picture, np.asarray(sky, np.float32), np.asarray(light, np.float32), float(ambient), UNCOVERED
    )
    return picture
