"""Finding sensors through pyusb: their properties on the bus, and the error if none is found."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

import pytest

from firmware_host.errors import (
    FirmwareUnsupportedError,
    SensorAddressError,
    SensorUnavailableError,
    UsbAccessError,
    UsbStallError,
    UsbTimeoutError,
    UsbUnpluggedError,
)
from firmware_host.usb_control import devices
from firmware_host.usb_control.models import MODELS, Protocol

pytest.importorskip("usb.core")
from tests.firmware_host.usb_stage.in_process import ModelBackend
from tests.firmware_host.usb_stage.models import KinectCameraModel, KinectMotorModel, Ps1080Model
from tests.fit.here import hangtime_here


class Stranger(KinectCameraModel):
    """A USB device that is not a sensor."""

    vendor, product = 0x046D, 0xC077


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Replace libusb by a bus of models: bus(model, model, ...)."""

    def fill(*models: Any, **options: Any) -> ModelBackend:
        backend = ModelBackend(*models, **options)
        monkeypatch.setattr(devices, "load_backend", lambda: backend)
        return backend

    return fill


def test_a_ps1080_is_found_with_its_serial_speed_and_current(bus: Any) -> None:
    bus(Stranger(), Ps1080Model())
    (device,) = devices.find_devices()
    assert device.model.protocol is Protocol.PS1080
    assert (device.bus, device.address, device.megabits) == (1, 5, 480.0)
    assert (device.serial, device.milliamperes) == ("1401160123", 500)  # 250 units of 2 mA
    assert not device.on_unpowered_hub
    device.check_access()


def test_the_three_parts_of_a_kinect_are_listed_camera_first(bus: Any) -> None:
    bus(KinectMotorModel(), KinectCameraModel())
    names = [device.model.name for device in devices.find_devices()]
    assert names == ["Kinect v1 camera", "Kinect v1 motor"]


@pytest.mark.parametrize(("attributes", "is_unpowered"), [(0x80, True), (0xC0, False), (None, False)])
def test_a_hub_without_its_own_supply_is_noticed(bus: Any, attributes: int | None, is_unpowered: bool) -> None:
    bus(Ps1080Model(), hub_attributes=attributes)
    assert devices.find_devices()[0].on_unpowered_hub is is_unpowered


def test_a_device_that_may_not_be_opened_is_listed_without_serial_and_names_the_rules(bus: Any) -> None:
    bus(Ps1080Model(), denied=(0,))
    (device,) = devices.find_devices()
    assert device.serial is None
    with pytest.raises(UsbAccessError, match=r"USB 1:4: this user may not open.*55-hangtime-depth-sensor\.rules"):
        device.check_access()


@pytest.mark.parametrize(
    ("fault", "kind"), [("stall", UsbStallError), ("timeout", UsbTimeoutError), ("unplug", UsbUnpluggedError)]
)
def test_an_exception_of_pyusb_becomes_an_error_that_names_device_and_port(bus: Any, fault: str, kind: type) -> None:
    bus(Ps1080Model(fault))
    link = devices.find_devices()[0].open_link()
    with pytest.raises(kind, match=r"PrimeSense PS1080 .* at USB 1:4: "):
        link.receive(512, request=1 if fault == "stall" else 0)  # the model knows request 0 only
    link.close()


def test_the_device_asked_is_the_first_that_can_be_asked_or_the_one_named(bus: Any) -> None:
    bus(KinectCameraModel(), KinectMotorModel(), Ps1080Model())
    found = devices.find_devices()
    either = (Protocol.PS1080, Protocol.KINECT_MOTOR)
    assert [device.model.protocol for device in devices.choose(found, either, "a lamp")] == [*either]
    assert devices.choose(found, either, "a lamp", "1:5")[0].model.protocol is Protocol.KINECT_MOTOR
    with pytest.raises(FirmwareUnsupportedError, match="Kinect v1 camera at USB 1:4: Hangtime cannot ask it for a log"):
        devices.choose(found, either, "a log", "1:4")
    with pytest.raises(SensorUnavailableError, match="no depth sensor at USB 1:9"):
        devices.choose(found, either, "a log", "1:9")


@pytest.mark.parametrize("place", ["1", "1:x", ":", "-1:2", "one:two"])
def test_a_port_is_two_numbers(place: str) -> None:
    with pytest.raises(SensorAddressError, match="give BUS:ADDRESS"):
        devices.parse_place(place)


def test_an_empty_bus_says_so() -> None:
    with pytest.raises(SensorUnavailableError, match=r"^USB bus: no depth sensor is connected; plug it in"):
        devices.choose([], (Protocol.PS1080,), "a log")


def test_without_libusb_the_advice_is_the_apt_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "LIBUSB", "libusb-not-there.so.0")
    with pytest.raises(SensorUnavailableError, match=r"libusb-not-there\.so\.0\) is not installed; .*libusb-1\.0-0"):
        devices.find_devices()


def test_without_pyusb_the_advice_is_the_pip_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "usb.backend.libusb1", None)
    with pytest.raises(SensorUnavailableError, match=r"pip install -e '\."):
        devices.load_backend()


def test_the_real_libusb_starts_where_it_is_installed() -> None:
    try:
        ctypes.CDLL(devices.LIBUSB)
    except OSError:
        pytest.skip("libusb is not installed (apt-get install libusb-1.0-0)")
    assert all((device.vendor, device.product) in MODELS for device in devices.find_devices())


@pytest.mark.parametrize(
    ("models", "words", "says"),
    [
        ([KinectCameraModel], "info", "Hangtime cannot ask it for its properties"),
        ([KinectMotorModel], "log", "Hangtime cannot ask it for a log"),
        ([KinectMotorModel], "reset", "Hangtime cannot ask it for a reset"),
        ([KinectMotorModel], "led purple", "no state 'purple'; choose one of off, green, red, yellow, blink-green, "),
        ([Ps1080Model], "info --device 1:9", "no depth sensor at USB 1:9"),
        ([], "info --device four", "--device: 'four' is no place on the USB bus; give BUS:ADDRESS"),
    ],
)
def test_an_impossible_request_to_a_sensor_is_refused_in_one_sentence(
    bus: Any, tmp_path: Path, models: list[Any], words: str, says: str
) -> None:
    bus(*(model() for model in models))
    done = hangtime_here("sensor", *words.split(), folder=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert says in done.stderr
