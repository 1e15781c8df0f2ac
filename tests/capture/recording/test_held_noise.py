"""The markers' deviations reach the garment's held corners."""

from __future__ import annotations

import numpy as np
import pytest

from capture.recording.tracking import FrameTracker
from firmware_host.depth_sensor import SensorFrame
from firmware_host.synthetic.scene import CAMERA, RIG
from tests.capture.garment.garment_scenes import hung


def test_a_held_corner_is_as_certain_across_the_held_edge_as_the_markers():
    """Beside the part of depth on its ray; 0.3 px of a held edge without known markers would be 0.8 mm."""
    world = hung("swatch", 1.6)
    depth, colour = world.frame(0, world.renderer())
    frame = SensorFrame(index=0, time_s=0.1, host_time_s=0.0, depth=depth, colour=colour)
    seen = FrameTracker(RIG, world.garment).track(frame, 0.1)
    across = np.sqrt((seen.hanger.sd[:, :2] ** 2).mean())
    assert across < 4e-4
    steep = np.abs(seen.cloth.pixels[:2, 1] - CAMERA.cy) / CAMERA.fy
    assert seen.cloth.sd[:2, 1] == pytest.approx(np.hypot(across, steep * seen.cloth.sd[:2, 2]), rel=0.1)
