"""Rigid bodies that cloth may touch: spheres, capsules, half-spaces and boxes, at rest or on prescribed paths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.errors import FitError
from formats.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Body:
    """A box with rounded edges, of which sphere, capsule, half-space and box are special cases.

    - centre [m], world frame
    - axes, (3, 3): unit vectors along its sides
    - half_size [m], (3,): before rounding
    - radius [m]: of the rounding, in the middle of the third side
    - taper [m/m]: growth of the radius along the third axis, from end to end of the side
    """

    centre: tuple[float, float, float]
    axes: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    half_size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.0
    taper: float = 0.0

    def __post_init__(self) -> None:
        """Raise FitError for numbers that make no body."""
        sizes = (*self.half_size, self.radius)
        axes, place = np.array(self.axes, float), f"body at {self.centre}"
        if not (np.isfinite((*self.centre, *sizes)).all() and min(sizes) >= 0 and max(sizes) > 0):
            raise FitError(
                f"with half sizes of {self.half_size} m and a radius of {self.radius} m it has no inside",
                where=place,
                advice="give a finite place and sizes, one size above 0",
            )
        if axes.shape != (3, 3) or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6):
            raise FitError(
                f"its axes are {self.axes}", where=place, advice="give three unit vectors square to each other"
            )
        if not abs(self.taper) * self.half_size[2] < max(self.radius, 1e-12):
            raise FitError(
                f"with a radius of {self.radius} m that tapers by {self.taper} it has no end",
                where=place,
                advice="let it taper less",
            )

    def row(self) -> Floats:
        """Return centre, axes, half sizes, radius and taper, (17,)."""
        return np.concatenate([self.centre, np.ravel(self.axes), self.half_size, [self.radius, self.taper]])

    @property
    def thickness(self) -> float:
        """Its smallest width [m]."""
        return 2 * (min(self.half_size) + self.radius - abs(self.taper) * self.half_size[2])

    def distance(self, places: Floats) -> Floats:
        """Return distances [m] of points, (..., 3), from the surface, negative inside, as the kernel computes them."""
        local = (places - np.array(self.centre)) @ np.array(self.axes).T
        beyond = np.abs(local) - np.array(self.half_size)
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        radius = self.radius + self.taper * np.clip(local[..., 2], -self.half_size[2], self.half_size[2])
        return np.asarray((outside + np.minimum(beyond.max(-1), 0.0) - radius) / np.hypot(1.0, self.taper))


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Prescribed motion of bodies: poses at even instants from 0 on, linear between them.

    - `spacing` [s] of the instants
    - `poses`, (instants, bodies, 12): centre [m], world frame, and the three axes
    """

    spacing: float
    poses: Floats

    def at(self, instants: Floats) -> Floats:
        """Return the poses at instants [s], (n, bodies, 12), with unit axes square to each other."""
        place = np.clip(np.asarray(instants) / self.spacing, 0, len(self.poses) - 1)
        first = np.minimum(place.astype(int), len(self.poses) - 2)
        part = (place - first)[:, None, None]
        poses = (1 - part) * self.poses[first] + part * self.poses[first + 1]
        axes = poses[..., 3:].reshape(*poses.shape[:2], 3, 3)
        third = axes[..., 2, :] / np.linalg.norm(axes[..., 2, :], axis=-1, keepdims=True)
        first = axes[..., 0, :] - (axes[..., 0, :] * third).sum(-1, keepdims=True) * third
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        return np.concatenate([poses[..., :3], first, np.cross(third, first), third], axis=-1)

    def way(self, bodies: tuple[Body, ...]) -> Floats:
        """Return an upper bound of any body point's path length since the first instant [m], (instants,)."""
        sign = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        reach = np.array([np.add(b.half_size, b.radius + abs(b.taper) * b.half_size[2]) for b in bodies])
        corners = sign[None] * reach[:, None]
        steps = np.diff(self.poses, axis=0)
        gone = steps[:, :, None, :3] + np.einsum(
            "bck,nbkx->nbcx", corners, steps[..., 3:].reshape(*steps.shape[:2], 3, 3)
        )
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(gone, axis=-1).max((1, 2)))])


def placed(body: Body, pose: Floats) -> Body:
    """Return the body at another pose, (12,), as in `BodyMotion`."""
    return replace(body, centre=_triple(pose[:3]), axes=tuple(_triple(axis) for axis in pose[3:].reshape(3, 3)))


def sphere(centre: tuple[float, float, float], radius: float) -> Body:
    """Return a sphere [m]."""
    return Body(centre=centre, radius=radius)


def capsule(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Body:
    """Return a capsule: all points within a radius of the straight line from start to end [m].

    Raises:
        FitError: start and end coincide.
    """
    way = np.subtract(end, start)
    length = float(np.linalg.norm(way))
    if not length > 0:
        raise FitError(
            "ends where it starts and is a sphere", where=f"capsule at {start}", advice="use sphere(centre, radius)"
        )
    centre = np.add(start, end) / 2
    return Body(centre=_triple(centre), axes=_square_to(way / length), half_size=(0.0, 0.0, length / 2), radius=radius)


def half_space(place: tuple[float, float, float], normal: tuple[float, float, float]) -> Body:
    """Return a half-space behind a plane through a point [m]; the normal points to the cloth's side.

    Raises:
        FitError: the normal has no length.
    """
    length = float(np.linalg.norm(normal))
    if not length > 0:
        raise FitError(
            f"its normal {normal} has no direction", where=f"plane at {place}", advice="give one with a length"
        )
    unit = np.array(normal) / length
    half = HALF_SPACE
    return Body(centre=_triple(np.array(place) - half * unit), axes=_square_to(unit), half_size=(half, half, half))


HALF_SPACE = 50.0  # m: extent of a half-space, at which single precision still resolves micrometres


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _square_to(axis: Floats) -> tuple[tuple[float, float, float], ...]:
    """Three axes, the last one given."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(other, axis)
    first /= np.linalg.norm(first)
    return _triple(first), _triple(np.cross(axis, first)), _triple(axis)
