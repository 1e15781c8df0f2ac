"""Every error of the sensor's host side that a user can act on.

HangtimeError
  +-- SensorError
        +-- SensorUnavailableError   no native library, no device, or a stream that cannot be had
        +-- SensorStalledError       the device stopped sending frames
        +-- RecordingError           an .oni file that is missing, damaged or without depth
        +-- SensorAddressError       an address of a sensor that cannot be understood
"""

from __future__ import annotations

from formats.errors import HangtimeError


class SensorError(HangtimeError):
    """An error of a depth sensor or of a recording that stands in for one."""


class SensorUnavailableError(SensorError):
    """The native library, the device or one of its streams is not there."""


class SensorStalledError(SensorError):
    """The device sent no frame for too long."""


class RecordingError(SensorError):
    """A recording that is missing, damaged, cannot be written or holds no depth."""


class SensorAddressError(SensorError):
    """A sensor address, motion or effect that does not exist."""
