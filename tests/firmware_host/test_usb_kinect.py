"""The Kinect's base, queried in this process: lamp, tilt, accelerometer and the direction of gravity."""

from __future__ import annotations

import pytest

from firmware_host.errors import (
    FirmwareError,
    FirmwareReplyError,
    UsbStallError,
    UsbTimeoutError,
    UsbUnpluggedError,
)
from firmware_host.usb_control.kinect_motor import KinectMotor, Led, Motor
from tests.firmware_host.usb_stage.in_process import ModelLink
from tests.firmware_host.usb_stage.models import KinectMotorModel


def foot(fault: str = "") -> tuple[KinectMotor, KinectMotorModel]:
    model = KinectMotorModel(fault)
    return KinectMotor(ModelLink(model)), model


def test_819_counts_are_one_g() -> None:
    motor, model = foot()
    model.counts = (0, 819, 0)
    state = motor.state()
    assert state.acceleration == pytest.approx((0, 9.80665, 0))
    assert state.is_still
    assert state.gravity() == pytest.approx((0, 1, 0))  # level: gravity points down, which is +y


def test_a_sensor_that_looks_up_by_30_degrees_has_gravity_down_and_behind() -> None:
    state = foot()[0].state()
    assert state.tilt_degrees == 30.0
    # Down: cos 30 = 0.866; against the viewing direction: -sin 30 = -0.5; counts are whole, hence the tolerance.
    assert state.gravity() == pytest.approx((0, 0.866, -0.5), abs=1e-3)


def test_a_negative_count_and_a_negative_tilt_are_read_as_such() -> None:
    motor, model = foot()
    model.counts, model.tilt = (-410, 709, 0), -31
    state = motor.state()
    assert state.tilt_degrees == -15.5
    assert state.gravity()[0] == pytest.approx(-0.5, abs=1e-3)


def test_while_the_motor_moves_the_tilt_is_unknown() -> None:
    motor, model = foot()
    model.tilt, model.status = -128, 4
    state = motor.state()
    assert (state.tilt_degrees, state.motor) == (None, Motor.MOVING)


def test_an_acceleration_of_twice_g_is_not_gravity_alone_and_zero_has_no_direction() -> None:
    motor, model = foot()
    model.counts = (0, 1638, 0)
    assert not motor.state().is_still
    model.counts = (0, 0, 0)
    with pytest.raises(FirmwareReplyError, match="zero in every direction"):
        motor.state().gravity()


def test_the_lamp_reaches_the_device() -> None:
    motor, model = foot()
    motor.set_led(Led.BLINK_RED_YELLOW)
    assert model.led == 6


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ("stall", UsbStallError),
        ("timeout", UsbTimeoutError),
        ("short", FirmwareReplyError),
        ("unplug", UsbUnpluggedError),
    ],
)
def test_each_fault_has_an_error_of_its_own(fault: str, kind: type[FirmwareError]) -> None:
    with pytest.raises(kind):
        foot(fault)[0].state()
