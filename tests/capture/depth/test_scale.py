"""A rig's calibration of depth: its scale and its offset."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from capture.depth.scale import DepthScale, depth_rig
from formats.rig import Calibration, Rig
from tests.capture.stage import CAMERA

RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0), sensor=CAMERA)


def test_depth_is_divided_by_the_scale_and_rounded_to_a_millimetre():
    """1632 / 1.02 = 1600, 1000 / 1.02 = 980.39, 1001 / 1.02 = 981.37; 0 stays missing."""
    depth = np.array([[0, 1632], [1000, 1001]], np.uint16)
    assert DepthScale(1.02)(depth).tolist() == [[0, 1600], [980, 981]]
    assert DepthScale(1.03)(np.array([1000], np.uint16)).tolist() == [971]  # 970.87
    assert DepthScale(0.5)(np.array([40000, 65535], np.uint16)).tolist() == [65535, 65535]
    assert DepthScale(1.02)(np.array([65535], np.uint16)).tolist() == [64250]
    assert DepthScale(1.02)(depth).dtype == np.uint16
    assert DepthScale(1.0)(depth) is depth


@pytest.mark.parametrize("offset", [(3.0, 0.0), (0.0, -2.0), (3.0, -2.0)])
def test_the_principal_point_of_depth_is_aside_by_the_offset(offset):
    moved = depth_rig(msgspec.structs.replace(RIG, calibration=Calibration(depth_offset_px=offset))).sensor
    assert (moved.cx, moved.cy) == (CAMERA.cx + offset[0], CAMERA.cy + offset[1])
    assert (moved.fx, moved.width) == (CAMERA.fx, CAMERA.width)


def test_a_rig_without_offset_or_sensor_stays_as_it_is():
    assert depth_rig(RIG) is RIG
    without = msgspec.structs.replace(RIG, sensor=None, calibration=Calibration(depth_offset_px=(1.0, 1.0)))
    assert depth_rig(without) is without
