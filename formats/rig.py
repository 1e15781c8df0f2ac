"""The rig description: sensor, its direction of gravity, the hanger's markers and where the cloth hangs from them."""

from __future__ import annotations

from typing import Literal

import msgspec

Vector = tuple[float, float, float]


class Sensor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Pinhole intrinsics in pixels; depth is registered to colour, both share them."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class Hanger(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Two fiducial markers and the two ends of the held edge.

    Hanger frame at each instant: origin midway between the marker centres, x from marker 0 to marker 1, y the
    part of gravity square to x (downwards), z = x × y. `held_m` are the two ends of the garment's held top edge
    in that frame, left end first.
    """

    dictionary: str
    ids: tuple[int, int]
    marker_size_m: float
    marker_distance_m: float
    held_m: tuple[Vector, Vector]


class Rig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything about the recording's set-up that the fitter must know.

    Sensor frame: x right, y down, z away from the sensor, metres. `gravity` is a unit vector in it.
    `hanger` and `sensor` are absent where the held points were measured by other means (imported takes).
    """

    format: Literal["hangtime-rig/1"]
    name: str
    gravity: Vector
    hanger: Hanger | None = None
    sensor: Sensor | None = None
