"""The rig description: sensor, gravity, the hanger's markers, the held ends of the cloth, and bodies nearby."""

from __future__ import annotations

from typing import Literal

import msgspec

from formats.plain_text import shortened

Vector = tuple[float, float, float]
Colour = tuple[int, int, int]


class Sensor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Pinhole intrinsics in pixels, shared by colour and depth; depth is registered to colour."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class Hanger(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Two markers and the two ends of the held edge.

    `marker` names their kind: printed fiducials of an OpenCV dictionary (ArUco or AprilTag), or round dots of one
    colour each. `marker_size_m` is a fiducial's side or a dot's diameter. `dot_colours` are sRGB, 0 to 255, left dot
    first; without them two dots of any colour are looked for.

    The hanger frame at each instant has its origin midway between the marker centres. Its x axis goes from marker 0 to
    marker 1. Its y axis is the part of gravity square to x (downwards), and z = x × y. `held_m` are the two ends of
    the garment's held top edge in that frame, left end first.
    """

    marker: Literal["fiducial", "dot"] = "fiducial"
    dictionary: str = "DICT_4X4_50"
    ids: tuple[int, int] = (0, 1)
    dot_colours: tuple[Colour, Colour] | None = None
    marker_size_m: float
    marker_distance_m: float
    held_m: tuple[Vector, Vector]


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Measurements of `hangtime calibrate`; a standard deviation of None says that nothing was measured.

    - `depth_scale`: measured over true depth; recording divides by it
    - `depth_offset_px`: pixels right and down from a thing in colour to the same thing in depth; recording allows
      for them
    - `depth_offset_sd_px`: inf along an axis that was never measured
    - `gravity_sd_degrees`: of the rig's gravity, about each of two axes square to it
    - `held_sd_m`: of the rig's held ends, per axis of the hanger's frame
    """

    gravity_from: Literal["plumb line", "accelerometer"] | None = None
    gravity_sd_degrees: float | None = None
    depth_scale: float = 1.0  # 1: a sensor without error, where nothing was measured
    depth_scale_sd: float | None = None
    depth_offset_px: tuple[float, float] = (0.0, 0.0)
    depth_offset_sd_px: tuple[float, float] | None = None
    held_sd_m: tuple[Vector, Vector] | None = None


class RigBody(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A fixed body that the cloth may touch, in the sensor frame.

    - plane: the half-space behind the plane through `at_m`, whose `normal` (of any length) points to the cloth
    - sphere: the ball of radius `radius_m` around `at_m`
    - capsule: all points within `radius_m` of the straight line from `at_m` to `to_m`
    """

    kind: Literal["plane", "sphere", "capsule"]
    at_m: Vector
    normal: Vector | None = None
    to_m: Vector | None = None
    radius_m: float | None = None


class Rig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The set-up of a recording, as far as a fit needs it.

    Sensor frame: x right, y down, z away from the sensor, metres. `gravity` is a unit vector in it.
    `hanger` and `sensor` are absent where the held points were measured by other means (imported takes);
    `calibration` is absent until `hangtime calibrate` has run. In version 2: `bodies`, absent where nothing stands
    near, and `camera_at_m`, the place of the camera where the frame is not its own (imported takes).
    """

    format: Literal["hangtime-rig/1", "hangtime-rig/2"]
    name: str
    gravity: Vector
    hanger: Hanger | None = None
    sensor: Sensor | None = None
    calibration: Calibration | None = None
    bodies: tuple[RigBody, ...] | msgspec.UnsetType = msgspec.UNSET  # written only where not empty

    camera_at_m: Vector | msgspec.UnsetType = msgspec.UNSET  # written only where it is stated

    def __repr__(self) -> str:
        """Return one line: the name, and which parts the rig states."""
        parts = {"hanger": self.hanger, "sensor": self.sensor, "calibration": self.calibration, "bodies": self.near}
        told = [name for name, part in parts.items() if part]
        return f"Rig({shortened(self.name)!r}, {' and '.join(told) if told else 'gravity alone'})"

    @property
    def viewpoint(self) -> Vector:
        """Return the camera's position, where depth rays begin [m]: the origin unless stated."""
        return (0.0, 0.0, 0.0) if isinstance(self.camera_at_m, msgspec.UnsetType) else self.camera_at_m

    @property
    def near(self) -> tuple[RigBody, ...]:
        """Return the bodies nearby, none where they are absent."""
        return () if isinstance(self.bodies, msgspec.UnsetType) else self.bodies
