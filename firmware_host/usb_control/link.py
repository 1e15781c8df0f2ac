"""The USB link: control transfers to one device; every failure becomes an error with advice.

`PyusbLink` is the real link. Any object with the three methods of `UsbLink` can replace it.
"""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING, Any, Protocol

from firmware_host.errors import (
    FirmwareError,
    UsbAccessError,
    UsbStallError,
    UsbTimeoutError,
    UsbUnpluggedError,
)

if TYPE_CHECKING:
    import usb.core

VENDOR_OUT = 0x40  # bmRequestType: host to device, vendor, device (USB 2.0, table 9-2)
VENDOR_IN = 0xC0  # bmRequestType: device to host, vendor, device (USB 2.0, table 9-2)
TRANSFER_TIMEOUT = 5.0  # s; OpenNI2 `XnHostProtocol.cpp`, XN_USB_HOST_PROTOCOL_TIMEOUT
RULES = "systemd/udev/55-hangtime-depth-sensor.rules"
PERMISSION_ADVICE = f"copy {RULES} to /etc/udev/rules.d/, join the group plugdev, and replug the sensor"
REPLUG_ADVICE = "check the cable and replug the sensor"
UPDATE_ADVICE = "update its firmware with its maker's program, or use a newer sensor"


class UsbLink(Protocol):
    """Vendor control transfers to one device."""

    def send(self, request: int, value: int = 0, data: bytes = b"") -> None:
        """Send `data` to the device.

        Raises:
            FirmwareError: refused, late, unplugged or not permitted.
        """

    def receive(self, length: int, request: int = 0) -> bytes:
        """Return the device's answer, at most `length` bytes and perhaps none.

        Raises:
            FirmwareError: refused, late, unplugged or not permitted.
        """

    def close(self) -> None:
        """Release the device; closing twice is allowed."""


class PyusbLink:
    """Control transfers through pyusb and libusb."""

    def __init__(self, device: usb.core.Device, where: str, timeout_s: float = TRANSFER_TIMEOUT) -> None:
        self._device = device
        self._where = where
        self._timeout_ms = max(1, round(1000 * timeout_s))

    def send(self, request: int, value: int = 0, data: bytes = b"") -> None:
        """Send `data` with this request and value."""
        sent = int(self._transfer(VENDOR_OUT, request, value, data))
        if sent != len(data):
            raise UsbUnpluggedError(
                f"only {sent} of {len(data)} bytes of a request went out", where=self._where, advice=REPLUG_ADVICE
            )

    def receive(self, length: int, request: int = 0) -> bytes:
        """Return at most `length` bytes that the device answers to this request."""
        return bytes(self._transfer(VENDOR_IN, request, 0, length))

    def _transfer(self, kind: int, request: int, value: int, payload: bytes | int) -> Any:
        import usb.core

        try:
            return self._device.ctrl_transfer(kind, request, value & 0xFFFF, 0, payload, self._timeout_ms)
        except usb.core.USBError as error:
            raise as_firmware_error(error, self._where) from error

    def close(self) -> None:
        """Release the device; a later transfer would open it again."""
        import usb.util

        usb.util.dispose_resources(self._device)


def as_firmware_error(error: usb.core.USBError, where: str) -> FirmwareError:
    """Return the `FirmwareError` for an error of pyusb."""
    meanings = {
        errno.EPIPE: (
            UsbStallError,
            "the sensor refused the transfer (a stall)",
            "replug the sensor; where it refuses again, update its firmware",
        ),
        errno.ETIMEDOUT: (UsbTimeoutError, "the sensor does not answer", REPLUG_ADVICE),
        errno.ENODEV: (UsbUnpluggedError, "the sensor was unplugged", "plug it in again"),
        errno.ENOENT: (UsbUnpluggedError, "the sensor is no longer there", "plug it in again"),
        errno.EIO: (UsbUnpluggedError, "the transfer broke off", REPLUG_ADVICE),
        errno.EACCES: (UsbAccessError, "this user may not open the sensor", PERMISSION_ADVICE),
        errno.EPERM: (UsbAccessError, "this user may not open the sensor", PERMISSION_ADVICE),
        errno.EBUSY: (
            UsbAccessError,
            "another program or kernel driver holds the sensor",
            "end that program; `lsusb -t` names the driver, `sudo modprobe -r` removes it",
        ),
    }
    number = error.errno if error.errno is not None else 0
    kind, what, advice = meanings.get(number, (FirmwareError, f"USB says: {error.strerror}", REPLUG_ADVICE))
    return kind(what, where=where, advice=advice)
