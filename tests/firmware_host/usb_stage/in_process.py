"""The models in this process: a backend of pyusb without libusb, and a link without USB for the protocols alone."""

from __future__ import annotations

import array
import errno
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from firmware_host.errors import UsbStallError, UsbTimeoutError, UsbUnpluggedError
from tests.firmware_host.usb_stage.models import (
    VENDOR_IN,
    VENDOR_OUT,
    GoneError,
    SilenceError,
    StallError,
    string_descriptor,
)

PARTS = {"where": "model", "advice": "replug it"}


class ModelLink:
    """A `UsbLink` straight to a model."""

    def __init__(self, model: Any) -> None:
        self.model, self.is_closed = model, False

    def send(self, request: int, value: int = 0, data: bytes = b"") -> None:
        self._transfer(VENDOR_OUT, request, value, data, len(data))

    def receive(self, length: int, request: int = 0) -> bytes:
        return self._transfer(VENDOR_IN, request, 0, b"", length)

    def close(self) -> None:
        self.is_closed = True

    def _transfer(self, kind: int, request: int, value: int, data: bytes, length: int) -> bytes:
        try:
            return bytes(self.model.control(kind, request, value & 0xFFFF, data, length))
        except StallError:
            raise UsbStallError("stall", **PARTS) from None
        except SilenceError:
            raise UsbTimeoutError("silence", **PARTS) from None
        except GoneError:
            raise UsbUnpluggedError("gone", **PARTS) from None


class FakeClock:
    """Time passes only in sleep."""

    def __init__(self) -> None:
        self.time, self.slept = 0.0, []  # type: ignore[var-annotated]

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds
        self.slept.append(seconds)


class ModelBackend(usb.backend.IBackend):
    """A USB bus of models, for pyusb; `denied` are the numbers of models that may not be opened."""

    def __init__(self, *models: Any, denied: tuple[int, ...] = (), speed: int = 3, hub_attributes: int | None = None):
        self.models, self.denied, self.speed = models, denied, speed
        self.hub_attributes = hub_attributes
        self.opened: set[Any] = set()  # devices that are open now

    def enumerate_devices(self) -> Any:
        return iter(range(len(self.models)))

    def get_parent(self, dev: Any) -> Any:
        if self.hub_attributes is None or dev == "root":
            return None
        return "root" if dev == "hub" else "hub"

    def get_device_descriptor(self, dev: Any) -> Any:
        model = self.models[dev] if isinstance(dev, int) else SimpleNamespace(vendor=0x1D6B, product=2, serial="")
        number = dev if isinstance(dev, int) else 100
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=model.vendor, idProduct=model.product, bcdDevice=1, iManufacturer=0,
            iProduct=0, iSerialNumber=3 if model.serial else 0, bNumConfigurations=1, address=4 + number, bus=1,
            port_number=1, port_numbers=(1,), speed=self.speed,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        if config:
            raise IndexError
        attributes = self.hub_attributes if dev == "hub" else 0x80
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=18, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=attributes, bMaxPower=250, extra_descriptors=b"",
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=0,
            bInterfaceClass=255, bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=b"",
        )  # fmt: skip

    def open_device(self, dev: Any) -> Any:
        if dev in self.denied:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        self.opened.add(dev)
        return dev

    def close_device(self, dev_handle: Any) -> None:
        self.opened.discard(dev_handle)

    def get_configuration(self, dev_handle: Any) -> int:
        return 1

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        return False

    def ctrl_transfer(
        self, dev_handle: Any, bm_request_type: int, request: int, value: int, index: int, data: array.array[int],
        timeout: int,
    ) -> int:  # fmt: skip
        model = self.models[dev_handle]
        if bm_request_type == 0x80:
            answer = string_descriptor(model.serial, value)
        else:
            try:
                answer = model.control(bm_request_type, request, value, data.tobytes(), len(data))
            except StallError:
                raise usb.core.USBError("Pipe error", -9, errno.EPIPE) from None
            except SilenceError:
                raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT) from None
            except GoneError:
                raise usb.core.USBError("No such device", -4, errno.ENODEV) from None
        if bm_request_type == VENDOR_OUT:
            return len(data)
        for place, byte in enumerate(answer[: len(data)]):
            data[place] = byte
        return min(len(answer), len(data))
