"""Gravity from the accelerometer in a Kinect v1's foot (`firmware_host.usb_control.kinect_motor`).

    g = mean of n readings / its size,      sd(g)^2 = (sd of a reading square to g / (sqrt(n) |a|))^2 + ZERO_SD^2

Averaging removes the readings' noise but not the zero-point errors of the part, which `hangtime sensor info` gives as
"within about 3 degrees".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from capture.calibration.measures import Estimate
from capture.errors import CalibrationError
from firmware_host.errors import FirmwareUnsupportedError, SensorUnavailableError
from firmware_host.usb_control import devices
from firmware_host.usb_control.kinect_motor import KinectMotor, MotorState
from firmware_host.usb_control.models import Protocol

READINGS = 20  # our choice: more would lower the noise alone, and ZERO_SD stays
# rad, zero-point errors of the accelerometer's axes. Our choice: 0.05 g. It was not measured, and half and double
# were not tried.
ZERO_SD = np.radians(3.0)


def gravity_of_readings(readings: Sequence[MotorState]) -> Estimate:
    """Return gravity's unit vector, (3,), in the sensor frame and its sd [rad], (), about either axis.

    Raises:
        CalibrationError: the sensor was not standing still.
    """
    if not all(reading.is_still for reading in readings):
        raise CalibrationError(
            "the sensor was moved while its accelerometer was read",
            where="accelerometer",
            advice="let it stand still and calibrate again",
        )
    directions = np.array([reading.gravity() for reading in readings])
    mean = directions.mean(0)
    mean /= np.linalg.norm(mean)
    square = directions - np.outer(directions @ mean, mean)
    noise = np.sqrt(0.5 * (square**2).sum(1).mean() / len(readings))
    return Estimate(mean, np.asarray(np.hypot(noise, ZERO_SD)))


def connected_accelerometer() -> Estimate | None:
    """Return the accelerometer's gravity of the connected Kinect v1, None if none is connected.

    Raises:
        FirmwareError: it does not answer; CalibrationError: it is not standing still.
    """
    try:
        device = devices.choose(devices.find_devices(), (Protocol.KINECT_MOTOR,), "gravity")[0]
    except (FirmwareUnsupportedError, SensorUnavailableError):
        return None
    link = device.open_link()
    try:
        motor = KinectMotor(link, device.where)
        return gravity_of_readings([motor.state() for _ in range(READINGS)])
    finally:
        link.close()
