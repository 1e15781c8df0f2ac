"""The garment description: outline, weight, held part and tracked points."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import msgspec

from formats.plain_text import shortened

Polygon = tuple[tuple[float, float], ...]
PointKind = Literal["material", "silhouette"]


def polygon_area(corners: Polygon) -> float:
    """Return the area of a polygon [m^2]."""
    return abs(signed_area(corners))


def signed_area(corners: Polygon) -> float:
    """Return the area of a polygon [m^2] (shoelace formula), negative where its corners go clockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise((*corners, *corners[:1]))) / 2


class TrackedPoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One tracked point and its position on the flat garment."""

    name: str
    at_m: tuple[float, float]


class Garment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A garment, flat as the sensor sees it: x to the right, y up, metres, any origin.

    `outline_m` is a polygon. Its corners start at the top left and go clockwise as seen by the sensor. The first two
    are the ends of the held edge, left and right. No other side lies wholly higher.
    `held` names the part that the hanger holds: the whole top `edge` (a clamp bar) or its two end `corners` (clips).

    Version 2 adds four fields:

    - `holes_m`: polygons cut out of the outline
    - `seams`: sides along which a back of the same shape is sewn on, each as two neighbouring corners counted from 0
    - `grain_degrees`: the turn of the threads against x and y, anticlockwise; 45 is cut on the bias
    - `points_are`: `material` for points that stay on the cloth, such as markers. `silhouette` for points found in its
      outline: corners, a grid, a contour. The default depends on the kind of garment (`point_kind`).
    """

    format: Literal["hangtime-garment/1", "hangtime-garment/2"]
    name: str
    kind: Literal["skirt", "t-shirt", "swatch"]
    mass_kg: float
    outline_m: Polygon
    held: Literal["edge", "corners"]
    points: tuple[TrackedPoint, ...]
    layers: int = 1
    holes_m: tuple[Polygon, ...] = ()
    seams: tuple[tuple[int, int], ...] = ()
    grain_degrees: float = 0.0
    points_are: PointKind | None = None

    def __repr__(self) -> str:
        """Return one line: name, kind, weight and size; the outline and the points stay out of it."""
        name, points = shortened(self.name), len(self.points)
        return (
            f"Garment({name!r}, {self.kind}, {1e3 * self.mass_kg:.1f} g, {len(self.outline_m)} corners, "
            f"{points} points, held by its {self.held})"
        )

    @property
    def area_m2(self) -> float:
        """Area of the flat outline less its holes [m^2]."""
        return polygon_area(self.outline_m) - sum(polygon_area(hole) for hole in self.holes_m)

    @property
    def point_kind(self) -> PointKind:
        """Return the kind of the tracked points: as stated, else `material` on a swatch and `silhouette` elsewhere."""
        return self.points_are or ("material" if self.kind == "swatch" else "silhouette")

    @property
    def as_meant(self) -> Garment:
        """The garment in the latest version of its format, so that equivalent descriptions are equal.

        A kind of points that is left out stays left out, since a fit corrects camera faults of a stated silhouette
        only.
        """
        return msgspec.structs.replace(self, format="hangtime-garment/2")

    @property
    def areal_density(self) -> float:
        """Mass per area [kg/m^2] of all layers together; a sewn-on back counts with its own area."""
        return self.mass_kg / (self.area_m2 * (2 if self.seams else 1))

    @property
    def is_panel(self) -> bool:
        """True for one plain piece with four convex corners and threads along x and y."""
        return self.is_four_sided and not (self.holes_m or self.seams or self.grain_degrees)

    @property
    def is_four_sided(self) -> bool:
        """True for an outline of four corners, all of them convex."""
        corners = self.outline_m
        turns = [
            (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
            for a, b, c in zip(corners, corners[1:] + corners[:1], corners[2:] + corners[:2], strict=True)
        ]
        return len(corners) == 4 and (max(turns) < 0 or min(turns) > 0)

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the tracked points, in order."""
        return tuple(point.name for point in self.points)
