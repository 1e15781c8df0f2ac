"""Live devices that refuse, fail or lack a stream, and the choice among several, with a stand-in for OpenNI2."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from firmware_host import openni2_library
from firmware_host.doctor import stream_checks
from firmware_host.doctor.checks import Check, Examination
from firmware_host.doctor.doctor import examine
from firmware_host.errors import SensorStalledError, SensorUnavailableError
from firmware_host.openni2_sensor import OpenNI2Sensor
from firmware_host.usb_control.devices import UsbDevice
from firmware_host.usb_control.models import MODELS
from tests.firmware_host.scenes import picture
from tests.firmware_host.test_openni2_sensor import StandInStream

PS1080 = 0x1D27, 0x0600
URIS = ["1d27/0600@1/4", "1d27/0600@1/5"]


class StandInColour(StandInStream):
    """A live colour stream."""

    def __init__(self, frames: int) -> None:
        super().__init__(frames, picture(0)[1])
        self.pixels = 200


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A stand-in device with depth and colour; `opened` records the names by which it was opened."""
    depth, colour = StandInStream(60, picture(0)[0]), StandInColour(60)
    device = SimpleNamespace(
        playback=None, create_depth_stream=lambda: depth, create_color_stream=lambda: colour, depth=depth,
        get_device_info=lambda: SimpleNamespace(name=b"stand-in", uri=device.opened[-1]), closed=0, opened=[],
        is_image_registration_mode_supported=lambda mode: True, set_image_registration_mode=lambda mode: None,
        set_depth_color_sync_enabled=lambda is_on: None,
    )  # fmt: skip

    def close() -> None:
        device.closed += 1

    device.close = close

    class Device:
        def __new__(cls, uri: bytes) -> Any:
            device.opened.append(uri)
            return device

        enumerate_uris = staticmethod(lambda: [uri.encode() for uri in URIS])

    binding = SimpleNamespace(
        Device=Device, OpenNIError=RuntimeError, IMAGE_REGISTRATION_DEPTH_TO_COLOR=1,
        wait_for_any_stream=lambda streams, timeout: streams[0] if streams[0].left > 0 else None,
    )  # fmt: skip
    monkeypatch.setattr(openni2_library, "load", lambda: binding)
    return device


def fail(*arguments: Any) -> None:
    """Fail as the binding does: with a code, what the library says, and the name of its log."""
    raise RuntimeError(1, b"device is busy!\n", b"")


def test_a_device_that_does_not_register_depth_to_colour_is_refused(device: SimpleNamespace) -> None:
    device.is_image_registration_mode_supported = lambda mode: False
    with pytest.raises(SensorUnavailableError, match=r"1d27/0600@1/4: does not register depth to colour.*; use a"):
        OpenNI2Sensor()
    assert device.closed == 1


@pytest.mark.parametrize(
    "call", ["create_depth_stream", "set_image_registration_mode", "set_depth_color_sync_enabled", "get_device_info"]
)
def test_a_device_that_fails_while_it_is_set_up_is_an_error_of_ours(device: SimpleNamespace, call: str) -> None:
    setattr(device, call, fail)
    with pytest.raises(SensorUnavailableError) as caught:
        OpenNI2Sensor()
    assert str(caught.value) == (
        "1d27/0600@1/4: its streams do not start: device is busy; unplug and replug it"
    )  # fmt: skip
    assert device.closed == 1


def test_a_device_that_fails_between_two_frames_has_stalled_and_may_come_back(device: SimpleNamespace) -> None:
    read = device.depth.read_frame
    with OpenNI2Sensor() as sensor:
        assert sensor.read() is not None
        device.depth.read_frame = fail
        with pytest.raises(SensorStalledError, match="does not give the next frame: device is busy; unplug and"):
            sensor.read()
        device.depth.read_frame = read
        assert sensor.read() is not None
        device.depth.stop = device.depth.close = fail  # as after it was unplugged: the sensor closes all the same
    assert device.closed == 1


def test_a_library_that_cannot_list_its_devices_is_an_error_of_ours(
    device: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(openni2_library.load().Device, "enumerate_uris", fail)
    with pytest.raises(
        SensorUnavailableError, match=r"^OpenNI2: the library cannot list the devices \(device is busy\); `h"
    ):
        OpenNI2Sensor()


@pytest.mark.parametrize(
    ("addresses", "chosen", "uris", "found"),
    [
        pytest.param((4, 5), 5, URIS, "ok: stand-in", id="the second"),
        pytest.param((4, 5), 5, URIS[:1], "skipped: OpenNI2 would open 1d27/0600@1/4 and not the", id="not listed"),
        pytest.param((5,), 5, URIS[:1], "skipped: OpenNI2 would open", id="at another place meanwhile"),
        pytest.param((4,), 4, ["maker://0"], "ok: stand-in", id="a name without a place, and one camera"),
        pytest.param((4, 5), 4, ["maker://0"], "skipped: OpenNI2 would open maker://0", id="and two cameras"),
    ],
)
def test_the_doctor_opens_the_sensor_that_its_other_lines_are_about(
    device: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, addresses: tuple[int, ...], chosen: int,
    uris: list[str], found: str,
) -> None:  # fmt: skip
    on_the_bus = [
        UsbDevice(
            model=MODELS[PS1080], vendor=PS1080[0], product=PS1080[1], bus=1, address=address, speed=3, serial=None,
            milliamperes=500, on_unpowered_hub=False, kernel_driver=None, handle=None,
        )
        for address in addresses
    ]  # fmt: skip
    listed = staticmethod(lambda: [uri.encode() for uri in uris])
    monkeypatch.setattr(openni2_library.load().Device, "enumerate_uris", listed)
    camera = next(one for one in on_the_bus if one.address == chosen)
    with Examination(devices=on_the_bus, camera=camera) as examination:
        ((_, finding),) = examine([Check(name="streams", look=stream_checks.streams_start)], examination)
    assert f"{finding.verdict.value}: {finding.text}".startswith(found)
    assert device.opened == ([uris[-1].encode()] if found.startswith("ok") else [])
