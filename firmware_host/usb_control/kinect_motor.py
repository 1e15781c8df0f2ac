"""The Kinect v1's base: lamp, tilt motor and accelerometer, a separate USB device (045e:02b0).

    a = 9.80665 counts / 819        [m/s^2], three signed 16-bit numbers, big-endian
    tilt = number / 2               [degrees], signed 8 bits, -128 while the motor moves

Source: libfreenect, `src/tilt.c` (requests, layout, range of tilt) and `include/libfreenect.h` (lamp and motor states,
819 counts per g, after the data sheet of Kionix's KXSD9).

Axes: level, the accelerometer reads +1 g in y. Microsoft describes the same part's reading as the direction of gravity,
in axes left, up, forward (Kinect for Windows 1.8, NuiAccelerometerGetCurrentReading). There the level reading is -1 g
in y, the opposite sign. Hence gravity in the sensor frame (x right, y down, z away) is (x, y, -z). No device has
confirmed the signs of x and z yet: tilting the sensor up must make the third number fall.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum

from firmware_host.errors import FirmwareReplyError
from firmware_host.usb_control.link import UsbLink
from formats.nature import GRAVITY

SET_LED = 0x06  # freenect_set_led
GET_STATE = 0x32  # freenect_update_tilt_state
STATE = struct.Struct(">xxhhhbB")  # ten bytes: two unused, x, y, z, twice the tilt, motor state
COUNTS_PER_G = 819.0  # FREENECT_COUNTS_PER_G
UNKNOWN_TILT = -128  # reading of the tilt while the motor moves
STILL_TOLERANCE = (
    0.15  # of g; at larger deviations from 1 g, the sensor moves or a zero point is wrong (data sheet: 0.25 g at most)
)


class Led(IntEnum):
    """The lamp's states, freenect_led_options."""

    OFF = 0
    GREEN = 1
    RED = 2
    YELLOW = 3
    BLINK_GREEN = 4
    BLINK_RED_YELLOW = 6


class Motor(IntEnum):
    """The motor's activity, freenect_tilt_status_code."""

    STOPPED = 0
    AT_LIMIT = 1
    MOVING = 4


@dataclass(frozen=True, kw_only=True)
class MotorState:
    """One reading of the motor: activity, angle and acceleration.

    acceleration [m/s^2], accelerometer's axes; gravity counts as an acceleration upwards
    tilt_degrees [degrees], up is positive, None while the motor moves
    """

    acceleration: tuple[float, float, float]
    tilt_degrees: float | None
    motor: Motor | int

    @property
    def size_g(self) -> float:
        """Size of the acceleration in units of standard gravity; 1 when the sensor stands still."""
        return math.hypot(*self.acceleration) / GRAVITY

    @property
    def is_still(self) -> bool:
        """Return whether the reading is compatible with gravity alone."""
        return abs(self.size_g - 1) <= STILL_TOLERANCE

    def gravity(self) -> tuple[float, float, float]:
        """Return the unit vector of gravity in the sensor frame (x right, y down, z away), as in rig.toml.

        Raises:
            FirmwareReplyError: the acceleration is zero in every direction.
        """
        x, y, z = self.acceleration
        size = math.hypot(x, y, z)
        if size == 0:
            raise FirmwareReplyError(
                "the accelerometer reads zero in every direction", where="Kinect v1 motor", advice="replug the Kinect"
            )
        return x / size, y / size, -z / size


class KinectMotor:
    """Queries the base of a Kinect v1."""

    def __init__(self, link: UsbLink, where: str = "Kinect v1 motor") -> None:
        self._link, self._where = link, where

    def state(self) -> MotorState:
        """Return the current readings of accelerometer and tilt.

        Raises:
            FirmwareReplyError: the answer is short.
        """
        data = self._link.receive(STATE.size, GET_STATE)
        if len(data) != STATE.size:
            raise FirmwareReplyError(
                f"the answer has {len(data)} of {STATE.size} bytes", where=self._where, advice="replug the Kinect"
            )
        x, y, z, half_degrees, status = STATE.unpack(data)
        return MotorState(
            acceleration=(x * GRAVITY / COUNTS_PER_G, y * GRAVITY / COUNTS_PER_G, z * GRAVITY / COUNTS_PER_G),
            tilt_degrees=None if half_degrees == UNKNOWN_TILT else half_degrees / 2,
            motor=Motor(status) if status in set(Motor) else status,
        )

    def set_led(self, led: Led) -> None:
        """Switch the lamp to one of its states."""
        self._link.send(SET_LED, led)
