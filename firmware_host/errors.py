"""Every error of the sensor's host side that a user can act on.

HangtimeError
  +-- SensorError
        +-- SensorUnavailableError   no native library, no device, or a stream that cannot be had
        +-- SensorStalledError       the device stopped sending frames
        +-- RecordingError           an .oni file that is missing, damaged or without depth
        +-- SensorAddressError       an address of a sensor that cannot be understood
        +-- FirmwareError            the sensor's own computer, asked over USB
              +-- UsbAccessError           the device may not be opened, or another program holds it
              +-- UsbStallError            it refused a transfer, as USB devices do with what they do not know
              +-- UsbTimeoutError          no answer in time
              +-- UsbUnpluggedError        it went away, also in the middle of a transfer
              +-- FirmwareReplyError       an answer that is short or not an answer to this request
              +-- FirmwareRefusalError     an answer that says no
              +-- FirmwareUnsupportedError this device or firmware has no such thing
  +-- LampError   this machine's status lamp is not there or may not be changed
  +-- ButtonError   this machine's button is not there or cannot be read
"""

from __future__ import annotations

from formats.errors import HangtimeError


class LampError(HangtimeError):
    """A LED that is not there, cannot blink or may not be changed."""


class ButtonError(HangtimeError):
    """A button that is not there, was unplugged or may not be read."""


class SensorError(HangtimeError):
    """An error of a depth sensor or of a recording that stands in for one."""


class SensorUnavailableError(SensorError):
    """The native library, the device or one of its streams is not there."""


class SensorStalledError(SensorError):
    """The device sent no frame for too long."""


class RecordingError(SensorError):
    """A recording that is missing, damaged, cannot be written or holds no depth."""


class SensorAddressError(SensorError):
    """A sensor address, motion or effect that does not exist, or a number in one that cannot be."""


class FirmwareError(SensorError):
    """The sensor's firmware could not be asked, or did not answer as it should."""


class UsbAccessError(FirmwareError):
    """The USB device may not be opened by this user, or another program holds it."""


class UsbStallError(FirmwareError):
    """The device refused a USB transfer."""


class UsbTimeoutError(FirmwareError):
    """The device did not answer in time."""


class UsbUnpluggedError(FirmwareError):
    """The device went away, before or in the middle of a transfer."""


class FirmwareReplyError(FirmwareError):
    """An answer that is short, foreign or belongs to another request."""


class FirmwareRefusalError(FirmwareError):
    """The firmware answered with an error code, kept as `code`."""

    def __init__(self, what: str, *, code: int, where: object = None, advice: str = "") -> None:
        self.code = code
        super().__init__(what, where=where, advice=advice)


class FirmwareUnsupportedError(FirmwareError):
    """This device, or this version of its firmware, has no such function."""
