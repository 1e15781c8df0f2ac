"""The faults of a frame, as bits of `formats.take.FrameState`, from its images and its tracking.

Ranges are those of PrimeSense's long-range sensors and of the Kinect v1, which measure from 0.8 to 3.5 m (PrimeSense,
"Carmine 1.08" data sheet). A marker's distance comes from its size in colour, so it is known without depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.hanger.fiducial_tracker import HangerSight
from firmware_host.depth_sensor import SensorFrame
from formats.arrays import Floats, Unsigned
from formats.rig import Hanger, Sensor
from formats.take import FrameState

# of the pixels that must have depth. Our choice: a sensor that is covered or blinded sees less. Half and double were
# not tried.
FEWEST_DEPTH = 0.01
NEAREST, FARTHEST = 0.8, 3.5  # m, see above
# px: two per bit of 4 x 4 and a border; 20 px of area for a depth.
SMALLEST_MARKER_SEEN = {"fiducial": 12.0, "dot": 5.0}
IN_FRONT_OF_HANGER = 0.3  # m nearer than the hanger was: more than a hand moves it between two detections
IN_FRONT_OF_GARMENT = 0.5  # m nearer than the held edge: beyond the hem of a garment that swings up
# share of the pixels there. Our choice: half of a marker cannot be decoded; a quarter of the cloth hides a corner.
# Half, and 0.9 and 0.5, change no figure of nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`).
COVERED_HANGER, COVERED_GARMENT = 0.5, 0.25
# s after which the hanger may be anywhere, unless an object covers it. Our choice: longer than a swing. Half and
# double change no figure of the same scenes.
HANGER_MEMORY = 3.0
# px along both axes between samples of the whole image. Our choice: 4800 samples of 640 x 480, so a share of a
# quarter errs by less than 1 %.
VIEW_STRIDE = 8


def picture_faults(frame: SensorFrame, camera: Sensor) -> int:
    """Return the faults of a frame's images themselves."""
    state = FrameState.FRAMES_DROPPED_BEFORE if frame.dropped_before else 0
    size = (camera.height, camera.width)
    if frame.depth.shape != size or (frame.colour is not None and frame.colour.shape != (*size, 3)):
        return state | FrameState.WRONG_SIZE
    if np.count_nonzero(frame.depth) < FEWEST_DEPTH * frame.depth.size:
        state |= FrameState.DEPTH_MISSING
    if frame.colour is None:
        state |= FrameState.COLOUR_MISSING
    return state


class HangerWatch:
    """Keeps the hanger's last position, and finds the reason why it is not detected."""

    def __init__(self, hanger: Hanger) -> None:
        self._smallest = SMALLEST_MARKER_SEEN[hanger.marker]
        self._last: list[_Sighting | None] = [None, None]

    def faults(self, sight: HangerSight, depth: Unsigned, time: float) -> int:
        """Return the faults that hinder detection of the hanger: distance, one marker only, an object in front."""
        state = 0
        is_read = np.isfinite(sight.centres[:, 0])
        for row in np.flatnonzero(sight.valid):
            self._last[row] = _Sighting(time, sight.centres[row], float(sight.positions[row, 2]), sight.sides[row])
        distances = np.where(np.isfinite(sight.positions[:, 2]), sight.positions[:, 2], sight.ranges)[is_read]
        if is_read.any():
            if distances.min() < NEAREST:
                state |= FrameState.TOO_NEAR
            if distances.max() > FARTHEST or sight.sides[is_read].min() < self._smallest:
                state |= FrameState.TOO_FAR
        else:
            state |= view_faults(depth)
        if not sight.is_found:
            state |= FrameState.MARKER_LOST
            state |= FrameState.ONE_MARKER if is_read.sum() == 1 else 0
            state |= FrameState.VIEW_BLOCKED if self._is_blocked(sight, depth, time) else 0
        return state

    def _is_blocked(self, sight: HangerSight, depth: Unsigned, time: float) -> bool:
        blocked = False
        for row, last in enumerate(self._last):
            if last is None or sight.valid[row] or time - last.time > HANGER_MEMORY:
                continue
            reach = 0.5 * last.side
            patch = _window(depth, last.centre - reach, last.centre + reach)
            limit = 1e3 * (last.distance - IN_FRONT_OF_HANGER)
            if patch.size and np.count_nonzero((patch > 0) & (patch < limit)) > COVERED_HANGER * patch.size:
                blocked = True
                self._last[row] = _Sighting(time, last.centre, last.distance, last.side)
        return blocked


def view_faults(depth: Unsigned) -> int:
    """Return whether most of an image without markers is too near, or nearly all of it too far."""
    seen = depth[::VIEW_STRIDE, ::VIEW_STRIDE]
    seen = seen[seen > 0]
    if seen.size == 0:
        return 0
    seen.sort()  # `np.percentile` loads NumPy's masked arrays
    low, middle = seen[len(seen) // 20], seen[len(seen) // 2]
    if middle < 1e3 * NEAREST:
        return FrameState.TOO_NEAR
    return FrameState.TOO_FAR if low > 1e3 * FARTHEST else 0


def is_garment_covered(depth: Unsigned, held: Floats, camera: Sensor) -> bool:
    """Return whether an object covers the region below the held edge.

    depth [mm], (H, W); held [m], (2, 3): ends of the held edge.
    """
    if not np.isfinite(held).all():  # a hanger along gravity has no edge below it
        return False
    z = held[:, 2:]
    ends = held[:, :2] / z * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    low, high = ends.min(0), ends.max(0)
    patch = _window(depth, np.array([low[0], high[1]]), np.array([high[0], high[1] + high[0] - low[0]]))
    limit = 1e3 * (float(z.min()) - IN_FRONT_OF_GARMENT)
    return bool(patch.size and np.count_nonzero((patch > 0) & (patch < limit)) > COVERED_GARMENT * patch.size)


@dataclass(frozen=True)
class _Sighting:
    """The last located position of a marker: time [s], centre [px], distance [m], side [px]."""

    time: float
    centre: Floats
    distance: float
    side: float


def _window(depth: Unsigned, low: Floats, high: Floats) -> Unsigned:
    height, width = depth.shape
    left, top = (max(0, int(value)) for value in low)
    right, bottom = min(width, int(high[0]) + 1), min(height, int(high[1]) + 1)
    return depth[top : max(bottom, top), left : max(right, left)]
