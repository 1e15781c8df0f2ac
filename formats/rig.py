"""The rig description: sensor, its direction of gravity, the hanger's markers and where the cloth hangs from them."""

from __future__ import annotations

from typing import Literal

import msgspec

Vector = tuple[float, float, float]
Colour = tuple[int, int, int]


class Sensor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Pinhole intrinsics in pixels; depth is registered to colour, both share them."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class Hanger(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Two markers and the two ends of the held edge.

    `marker` says what they are: printed fiducials of an OpenCV dictionary (ArUco or AprilTag), or round dots of one
    colour each. `marker_size_m` is a fiducial's side or a dot's diameter. `dot_colours` are sRGB, 0 to 255, left dot
    first; without them two dots of any colour are looked for.

    Hanger frame at each instant: origin midway between the marker centres, x from marker 0 to marker 1, y the
    part of gravity square to x (downwards), z = x × y. `held_m` are the two ends of the garment's held top edge
    in that frame, left end first.
    """

    marker: Literal["fiducial", "dot"] = "fiducial"
    dictionary: str = "DICT_4X4_50"
    ids: tuple[int, int] = (0, 1)
    dot_colours: tuple[Colour, Colour] | None = None
    marker_size_m: float
    marker_distance_m: float
    held_m: tuple[Vector, Vector]


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What `hangtime calibrate` measured; a standard deviation of None says that nothing was measured.

    `depth_scale`: measured over true depth; recording divides by it. `depth_offset_px`: where depth shows a thing
    minus where colour shows it, right and down; recording allows for it; a deviation of inf: that axis was never
    measured. Gravity and held ends stand in the rig itself, here is how well they are known: `gravity_sd_degrees`
    about each of two axes square to it, `held_sd_m` per axis of the hanger's frame.
    """

    gravity_from: Literal["plumb line", "accelerometer"] | None = None
    gravity_sd_degrees: float | None = None
    depth_scale: float = 1.0
    depth_scale_sd: float | None = None
    depth_offset_px: tuple[float, float] = (0.0, 0.0)
    depth_offset_sd_px: tuple[float, float] | None = None
    held_sd_m: tuple[Vector, Vector] | None = None


class Rig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything about the recording's set-up that the fitter must know.

    Sensor frame: x right, y down, z away from the sensor, metres. `gravity` is a unit vector in it.
    `hanger` and `sensor` are absent where the held points were measured by other means (imported takes);
    `calibration` is absent until `hangtime calibrate` has run.
    """

    format: Literal["hangtime-rig/1"]
    name: str
    gravity: Vector
    hanger: Hanger | None = None
    sensor: Sensor | None = None
    calibration: Calibration | None = None
