"""Find depth sensors on the USB bus, with the properties that need no query to the device."""

from __future__ import annotations

import ctypes
import errno
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from firmware_host.errors import FirmwareUnsupportedError, SensorAddressError, SensorUnavailableError
from firmware_host.usb_control.link import PyusbLink, as_firmware_error
from firmware_host.usb_control.models import MODELS, Model, Protocol

LIBUSB = "libusb-1.0.so.0"
SPEEDS = {  # libusb.h, enum libusb_speed: name and Mbit/s
    0: ("unknown speed", 0.0),
    1: ("low speed, 1.5 Mbit/s", 1.5),
    2: ("full speed, 12 Mbit/s", 12.0),
    3: ("high speed, 480 Mbit/s", 480.0),
    4: ("SuperSpeed, 5 Gbit/s", 5_000.0),
    5: ("SuperSpeed+, 10 Gbit/s", 10_000.0),
}
SELF_POWERED = 0x40  # bit of bmAttributes (USB 2.0, table 9-10)
UNPOWERED_PORT = 100  # mA that a port of a hub without its own supply gives (USB 2.0, section 7.2.1.1)
USB_BUS, NO_SENSOR_FOUND = "USB bus", "no depth sensor is connected"
PLUG_IN = "plug it in, with its own power supply if it has one"


@dataclass(frozen=True, kw_only=True)
class UsbDevice:
    """One device on the bus that Hangtime knows.

    - `serial`: serial number in the USB descriptor, None if it is missing or unreadable
    - `milliamperes`: largest current of the device, 0 if unknown
    - `on_unpowered_hub`: whether its hub has no power supply
    - `kernel_driver`: whether a kernel driver has claimed its first interface, None if unknown
    """

    model: Model
    vendor: int
    product: int
    bus: int
    address: int
    speed: int
    serial: str | None
    milliamperes: int
    on_unpowered_hub: bool
    kernel_driver: bool | None
    handle: Any

    @property
    def where(self) -> str:
        """Return name and bus address, for messages."""
        return f"{self.model.name} at USB {self.bus}:{self.address}"

    @property
    def megabits(self) -> float:
        """Speed of the connection [Mbit/s], 0 where unknown."""
        return SPEEDS.get(self.speed, SPEEDS[0])[1]

    def open_link(self) -> PyusbLink:
        """Return a link for control transfers."""
        return PyusbLink(self.handle, self.where)

    def check_access(self) -> None:
        """Open the device once.

        Raises:
            UsbAccessError: not permitted, or held by another program.
            UsbUnpluggedError: the device was unplugged.
        """
        import usb.core

        try:
            self.handle.get_active_configuration()
        except usb.core.USBError as error:
            raise as_firmware_error(error, self.where) from error


def load_backend() -> Any:
    """Return pyusb's libusb backend.

    Raises:
        SensorUnavailableError: pyusb or libusb is not installed, or libusb does not start.
    """
    try:
        import usb.backend.libusb1
    except ModuleNotFoundError as error:
        raise SensorUnavailableError(
            "the Python package `pyusb` is not installed",
            where=None,
            advice="in Hangtime's checkout: pip install -e '.[capture]'",
        ) from error
    try:
        ctypes.CDLL(LIBUSB)
    except OSError as error:
        raise SensorUnavailableError(
            f"the USB library ({LIBUSB}) is not installed",
            where=None,
            advice="install it: apt-get install libusb-1.0-0",
        ) from error
    backend = usb.backend.libusb1.get_backend(find_library=lambda _: LIBUSB)
    if backend is None:
        raise SensorUnavailableError(
            "libusb does not start", where="/dev/bus/usb",
            advice="check that this folder is there and readable; a container has to be given it",
        )  # fmt: skip
    return backend


def find_devices() -> list[UsbDevice]:
    """Return every known device, cameras first, in the order of the bus.

    Raises:
        SensorUnavailableError: libusb cannot be used.
    """
    backend = load_backend()
    import usb.core

    found = usb.core.find(find_all=True, backend=backend, custom_match=lambda d: (d.idVendor, d.idProduct) in MODELS)
    devices = [_describe(handle) for handle in found]
    return sorted(devices, key=lambda device: (not device.model.is_camera, device.bus, device.address))


def choose(
    devices: Sequence[UsbDevice], protocols: Sequence[Protocol], what: str, place: str | None = None
) -> list[UsbDevice]:
    """Return the devices that support one of these protocols; `place` (BUS:ADDRESS) selects one.

    what: the requested function, for the message: "a log", "a lamp"

    Raises:
        SensorUnavailableError: no such device.
        FirmwareUnsupportedError: there are devices, but none supports one of the protocols.
        SensorAddressError: `place` is not BUS:ADDRESS.
    """
    if place is not None:
        wanted = parse_place(place)
        devices = [device for device in devices if (device.bus, device.address) == wanted]
        if not devices:
            raise SensorUnavailableError(
                f"no depth sensor at USB {place}", where="--device", advice="`hangtime sensor list` names the places"
            )
    if not devices:
        raise SensorUnavailableError(NO_SENSOR_FOUND, where=USB_BUS, advice=PLUG_IN)
    chosen = [device for device in devices if device.model.protocol in protocols]
    if not chosen:
        raise FirmwareUnsupportedError(
            f"Hangtime cannot ask it for {what}", where=devices[0].where,
            advice="docs/reference/sensors.md says what works with which sensor",
        )  # fmt: skip
    return chosen


def parse_place(place: str) -> tuple[int, int]:
    """Return (bus, address) of BUS:ADDRESS.

    Raises:
        SensorAddressError: it is not two numbers.
    """
    bus, colon, address = place.partition(":")
    if not (colon and bus.isdecimal() and address.isdecimal()):
        raise SensorAddressError(
            f"{place!r} is no place on the USB bus", where="--device", advice="give BUS:ADDRESS, for example 1:4"
        )
    return int(bus), int(address)


def _describe(handle: Any) -> UsbDevice:
    return UsbDevice(
        model=MODELS[handle.idVendor, handle.idProduct],
        vendor=handle.idVendor, product=handle.idProduct, bus=handle.bus or 0, address=handle.address or 0,
        speed=handle.speed or 0, serial=_serial(handle), milliamperes=_milliamperes(handle),
        on_unpowered_hub=_is_on_unpowered_hub(handle), kernel_driver=_kernel_driver(handle), handle=handle,
    )  # fmt: skip


def _serial(handle: Any) -> str | None:
    import usb.core

    try:
        text = handle.serial_number
    except (usb.core.USBError, ValueError, UnicodeError):  # ValueError: pyusb could not read the languages
        return None
    return str(text).strip("\0 ") or None if text else None


def _milliamperes(handle: Any) -> int:
    import usb.core

    try:
        return 2 * int(handle[0].bMaxPower)  # the descriptor counts in 2 mA (USB 2.0, table 9-10)
    except (usb.core.USBError, IndexError):
        return 0


def _is_on_unpowered_hub(handle: Any) -> bool:
    import usb.core

    try:
        hub = handle.parent
        if hub is None or hub.parent is None:  # a root hub is the computer itself
            return False
        return not hub[0].bmAttributes & SELF_POWERED
    except (usb.core.USBError, IndexError):
        return False


def _kernel_driver(handle: Any) -> bool | None:
    import usb.core

    try:
        return bool(handle.is_kernel_driver_active(0))
    except usb.core.USBError as error:
        return False if error.errno in (errno.ENODATA, errno.ENOENT) else None
    except NotImplementedError:
        return None
