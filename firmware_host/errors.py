"""Every error of the sensor's host side that a user can act on.

HangtimeError
  +-- SensorError
        +-- SensorUnavailableError   no native library, no device, or a stream that cannot be opened
        +-- SensorStalledError       the device stopped sending frames
        +-- RecordingError           an .oni file that is missing, damaged or without depth
        +-- SensorAddressError       an address of a sensor that cannot be understood
        +-- FirmwareError            the sensor's firmware, queried over USB
              +-- UsbAccessError           the device may not be opened, or another program holds it
              +-- UsbStallError            the device refused a transfer, as USB devices do with unknown requests
              +-- UsbTimeoutError          no answer in time
              +-- UsbUnpluggedError        the device was unplugged, perhaps in the middle of a transfer
              +-- FirmwareReplyError       a reply that is too short or belongs to another request
              +-- FirmwareRefusalError     a reply with an error code
              +-- FirmwareUnsupportedError this device or firmware lacks the function
  +-- LampError   this machine's status lamp is missing or may not be set
  +-- ButtonError   this machine's button is missing or cannot be read
"""

from __future__ import annotations

from formats.errors import HangtimeError


class LampError(HangtimeError):
    """An LED that is missing, cannot blink or may not be set."""


class ButtonError(HangtimeError):
    """A button that is missing, was unplugged or may not be read."""


class SensorError(HangtimeError):
    """An error of a depth sensor, or of a recording that replaces one."""


class SensorUnavailableError(SensorError):
    """The native library, the device or one of its streams is missing."""


class SensorStalledError(SensorError):
    """The device sent no frame for too long."""


class RecordingError(SensorError):
    """A recording that is missing, damaged, cannot be written or holds no depth."""


class SensorAddressError(SensorError):
    """A sensor address, motion or effect that does not exist, or an invalid number in it."""


class FirmwareError(SensorError):
    """The sensor's firmware could not be queried, or gave an invalid answer."""


class UsbAccessError(FirmwareError):
    """The USB device may not be opened by this user, or another program holds it."""


class UsbStallError(FirmwareError):
    """The device refused a USB transfer."""


class UsbTimeoutError(FirmwareError):
    """The device did not answer in time."""


class UsbUnpluggedError(FirmwareError):
    """The device was unplugged, before or during a transfer."""


class FirmwareReplyError(FirmwareError):
    """A reply that is too short, of another protocol, or to another request."""


class FirmwareRefusalError(FirmwareError):
    """The firmware answered with an error code, kept as `code`."""

    def __init__(self, what: str, *, code: int, where: object, advice: str) -> None:
        self.code = code
        super().__init__(what, where=where, advice=advice)


class FirmwareUnsupportedError(FirmwareError):
    """This device, or this version of its firmware, has no such function."""
