"""Apply a rig's calibration to depth: divide by its scale, and shift the principal point by its offset.

    z = z_measured / s          u_depth = u_colour + du, so a pinhole for depth has cx + du and cy + dv

Both from `formats.rig.Calibration`.
"""

from __future__ import annotations

import msgspec
import numpy as np

from formats.arrays import Unsigned
from formats.rig import Calibration, Rig

LARGEST_DEPTH = 65535  # mm, of a 16-bit image


class DepthScale:
    """Divides depth images by a scale; does nothing at a scale of 1."""

    def __init__(self, scale: float) -> None:
        measured = np.arange(LARGEST_DEPTH + 1)
        self._true = np.minimum(np.rint(measured / scale), LARGEST_DEPTH).astype(np.uint16) if scale != 1.0 else None

    def __call__(self, depth: Unsigned) -> Unsigned:
        """Return true depth [mm], (H, W), of a depth image."""
        return depth if self._true is None else self._true[depth]


def depth_rig(rig: Rig) -> Rig:
    """Return the rig for depth pixels: its principal point includes the offset of depth against colour."""
    du, dv = (rig.calibration or Calibration()).depth_offset_px
    if rig.sensor is None or (du, dv) == (0.0, 0.0):
        return rig
    sensor = msgspec.structs.replace(rig.sensor, cx=rig.sensor.cx + du, cy=rig.sensor.cy + dv)
    return msgspec.structs.replace(rig, sensor=sensor)
