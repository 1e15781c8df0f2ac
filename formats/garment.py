"""The garment description: outline, weight, how it is held and which points on it are tracked."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import msgspec


class TrackedPoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One tracked point and its place on the flat garment."""

    name: str
    at_m: tuple[float, float]


class Garment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A garment, flat as the sensor sees it: x to the right, y up, metres, any origin.

    `outline_m` is a polygon; its corners start at the top left and go clockwise as seen by the sensor.
    `held` says what the hanger holds: the whole top `edge` (a clamp bar) or only its two end `corners` (clips).
    """

    format: Literal["hangtime-garment/1"]
    name: str
    kind: Literal["skirt", "t-shirt", "swatch"]
    mass_kg: float
    outline_m: tuple[tuple[float, float], ...]
    held: Literal["edge", "corners"]
    points: tuple[TrackedPoint, ...]
    layers: int = 1

    @property
    def area_m2(self) -> float:
        """Area of the flat outline [m^2] (shoelace formula)."""
        corners = (*self.outline_m, self.outline_m[0]) if self.outline_m else ()
        doubled = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(corners))
        return abs(doubled) / 2

    @property
    def areal_density(self) -> float:
        """Mass per area [kg/m^2], all layers together."""
        return self.mass_kg / self.area_m2

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the tracked points, in order."""
        return tuple(point.name for point in self.points)
