"""The accelerometer of a Kinect on a bus of models: gravity, and a device that others can open afterwards."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("usb.core")
from capture.calibration.accelerometer import connected_accelerometer
from capture.errors import CalibrationError
from firmware_host.errors import FirmwareError
from firmware_host.usb_control import devices
from tests.firmware_host.usb_stage.in_process import ModelBackend
from tests.firmware_host.usb_stage.models import KinectMotorModel, Ps1080Model


def connected(monkeypatch, *models):
    bus = ModelBackend(*models)
    monkeypatch.setattr(devices, "load_backend", lambda: bus)
    return bus


def test_a_kinect_gives_gravity_and_is_free_for_others_afterwards(monkeypatch):
    """Its head is tilted up by 30 degrees."""
    bus = connected(monkeypatch, KinectMotorModel())
    gravity = connected_accelerometer()
    assert gravity is not None
    assert gravity.value == pytest.approx([0.0, np.cos(np.radians(30)), -np.sin(np.radians(30))], abs=1e-3)
    assert bus.opened == set()


def test_a_kinect_that_moves_or_does_not_answer_is_free_for_others_afterwards(monkeypatch):
    moved = KinectMotorModel()
    moved.counts = (0, 1200, 410)
    for model, error in ((moved, CalibrationError), (KinectMotorModel("timeout"), FirmwareError)):
        bus = connected(monkeypatch, model)
        with pytest.raises(error):
            connected_accelerometer()
        assert bus.opened == set()


def test_a_sensor_without_an_accelerometer_gives_no_gravity(monkeypatch):
    connected(monkeypatch, Ps1080Model())
    assert connected_accelerometer() is None
