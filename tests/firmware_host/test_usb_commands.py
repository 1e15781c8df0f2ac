"""The commands for a sensor's firmware, run in this process on a bus of models; each opens and closes the device."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("usb.core")
from firmware_host import openni2_library
from firmware_host.errors import (
    FirmwareRefusalError,
    FirmwareReplyError,
    FirmwareUnsupportedError,
    UsbAccessError,
    UsbStallError,
)
from firmware_host.usb_control import devices
from firmware_host.usb_control.ps1080 import READY_PAUSE, Clock, Ps1080, wait_until_answering
from firmware_host.usb_control.ps1080_answers import FixedParameters, decode_log, decode_version
from firmware_host.usb_control.ps1080_messages import Opcode, decode_reply, encode_request
from firmware_host.usb_control.report import driver_status, information, place_lines
from tests.firmware_host.usb_stage.in_process import FakeClock, ModelBackend, ModelLink
from tests.firmware_host.usb_stage.models import KinectCameraModel, KinectMotorModel, Ps1080Model
from tests.fit.here import hangtime_here


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Replace libusb by a bus of models; OpenNI2 has a PS1080 driver and sees no device."""
    monkeypatch.setattr(
        openni2_library, "find_driver", lambda name: Path("/d/libPS1080.so") if name == "PS1080" else None
    )
    monkeypatch.setattr(openni2_library, "live_uris", list)

    def fill(*models: Any, **options: Any) -> ModelBackend:
        backend = ModelBackend(*models, **options)
        monkeypatch.setattr(devices, "load_backend", lambda: backend)
        return backend

    return fill


def ps1080_with(answer: Any) -> tuple[Ps1080, Ps1080Model]:
    """A sensor whose model answers an opcode and its arguments so."""
    model, clock = Ps1080Model(), FakeClock()
    usual = model._answer
    model._answer = lambda opcode, words: answer(opcode, words) or usual(opcode, words)  # type: ignore[method-assign]
    return Ps1080(ModelLink(model), timeout_s=1.0, clock=Clock(clock.now, clock.sleep)), model


def test_info_states_what_a_ps1080_knows_of_itself(bus: Any, tmp_path: Path) -> None:
    bus(Ps1080Model())
    lines = hangtime_here("sensor", "info", folder=tmp_path).stdout.splitlines()
    assert [re.sub(" +", " ", line.strip()) for line in lines[1:]] == [
        "place USB 1:4, 1d27:0600",
        "serial 1401160123",
        "speed high speed, 480 Mbit/s",
        "driver OpenNI2 driver PS1080",
        "firmware 5.8.22 on PS1080 A6, system 4660",
        "serial number 1401160123",
        "platform ARM",
        "geometry depth focal length 575.8 px at 640 px, emitter at 75.0 mm, colour camera at 23.0 mm",
        "processor 2 tasks, 2.5 s in all, 80 % in the busiest",
        "gravity not measured: this sensor has no accelerometer",
    ]


def test_info_of_old_firmware_says_what_it_does_not_have(bus: Any) -> None:
    bus(Ps1080Model("old"))
    told = dict(information(devices.find_devices()[0]))
    assert (told["platform"], told["serial number"]) == ("not in this firmware",) * 2
    assert told["processor"].startswith("2 tasks")


@pytest.mark.parametrize(
    ("status", "counts", "tilt", "motor", "gravity"),
    [
        (0, (0, 709, 410), "30.0 degrees", "stopped", "[0.0000, 0.8657, -0.5006] in the sensor frame"),
        (1, (0, 709, 410), "30.0 degrees", "at its limit", "[0.0000, 0.8657, -0.5006] in the sensor frame"),
        (4, (0, 709, 410), "unknown while it moves", "moving", "[0.0000, 0.8657, -0.5006] in the sensor frame"),
        (9, (0, 709, 410), "30.0 degrees", "state 9", ""),
        (0, (0, 1200, 410), "30.0 degrees", "stopped", "unknown: the sensor is not standing still"),
    ],
)
def test_info_of_a_kinects_foot_states_tilt_motor_and_gravity(
    bus: Any, status: int, counts: tuple[int, int, int], tilt: str, motor: str, gravity: str
) -> None:
    model = KinectMotorModel()
    model.status, model.counts, model.tilt = status, counts, -128 if status == 4 else 60
    bus(model)
    told = dict(information(devices.find_devices()[0]))
    assert (told["tilt"], told["motor"]) == (tilt, motor)
    assert told["gravity"].startswith(gravity)


def test_the_driver_that_each_part_needs_is_named(bus: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bus(KinectMotorModel(), KinectCameraModel(), Ps1080Model())
    found = {device.model.name: device for device in devices.find_devices()}
    assert driver_status(found["Kinect v1 motor"]) == "none needed, this part gives no pictures"
    assert driver_status(found["Kinect v1 camera"]) == "OpenNI2 as Debian ships it has no driver for it"
    (ps1080,) = (device for name, device in found.items() if "PS1080" in name)
    monkeypatch.setattr(openni2_library, "find_driver", lambda name: None)
    assert driver_status(ps1080) == "OpenNI2 driver PS1080 is not installed"
    monkeypatch.setattr(ModelBackend, "is_kernel_driver_active", lambda *given: True)
    (held,) = (device for device in devices.find_devices() if device.product == ps1080.product)
    assert driver_status(held).endswith("is not installed; held by a driver of the kernel")
    assert dict(place_lines(found["Kinect v1 motor"]))["serial"] == "not readable, or none"


def test_log_prints_the_lines_and_then_that_it_is_empty(bus: Any, tmp_path: Path) -> None:
    bus(Ps1080Model())
    assert hangtime_here("sensor", "log", folder=tmp_path).stdout.splitlines()[0] == "12: emitter on"
    assert hangtime_here("sensor", "log", folder=tmp_path).stdout == "The log is empty.\n"


@pytest.mark.parametrize(("words", "mode", "done"), [([], 3, "reset"), (["--reboot"], 4, "rebooted")])
def test_reset_sets_the_mode_and_waits_for_an_answer(
    bus: Any, tmp_path: Path, words: list[str], mode: int, done: str
) -> None:
    model = Ps1080Model()
    bus(model)
    told = hangtime_here("sensor", "reset", *words, folder=tmp_path)
    assert re.search(rf": {done}, answers again after 0\.[5-9] s\n", told.stdout), told
    assert (model.mode, model.asked[-1]) == (mode, Opcode.KEEP_ALIVE)


@pytest.mark.parametrize(
    ("model", "colour", "lamp"),
    [(Ps1080Model, "on", (0, 1)), (Ps1080Model, "off", (0, 0)), (KinectMotorModel, "blink-green", 4)],
)
def test_led_switches_the_lamp_and_names_a_colour_that_it_has_not(
    bus: Any, tmp_path: Path, model: Any, colour: str, lamp: Any
) -> None:
    there = model()
    bus(there)
    wrong = hangtime_here("sensor", "led", "on" if model is KinectMotorModel else "green", folder=tmp_path)
    assert (wrong.returncode, there.led) == (2, None)
    assert f"{'off, green, red' if model is KinectMotorModel else 'on, off'}" in wrong.stderr
    told = hangtime_here("sensor", "led", colour, folder=tmp_path)
    assert (told.returncode, there.led) == (0, lamp)
    assert told.stdout.endswith(f": lamp {colour}\n")


def test_list_says_what_openni2_sees_and_that_nothing_is_there(
    bus: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def listed() -> str:
        return hangtime_here("sensor", "list", folder=tmp_path).stdout

    bus()
    assert listed() == "No depth sensor is connected.\n"
    bus(Ps1080Model())
    assert listed().endswith("OpenNI2 sees none of them; `hangtime sensor doctor` says why.\n")
    monkeypatch.setattr(openni2_library, "live_uris", lambda: ["1d27/0600@1/4"])
    assert listed().endswith("OpenNI2 sees 1d27/0600@1/4\n")
    bus()
    assert listed() == "OpenNI2 sees 1d27/0600@1/4\n"


# --- corners of the protocol --------------------------------------------------------------------


@pytest.mark.parametrize(("minor", "stops"), [(1, [3, 3, 3]), (2, [])])
def test_a_reset_of_firmware_before_5_2_stops_its_three_streams_first(minor: int, stops: list[int]) -> None:
    sent = []

    def answer(opcode: int, words: bytes) -> tuple[int, bytes] | None:
        sent.append((opcode, words))
        return (0, struct.pack("<BBHIHH", minor, 5, 0, 0, 6, 0)) if opcode == Opcode.GET_VERSION else None

    sensor, model = ps1080_with(answer)
    sensor.soft_reset()
    assert model.asked == [0, *stops, 6]
    assert [words for opcode, words in sent if opcode == 3] == [struct.pack("<HH", k, 0) for k in (5, 6, 7)][
        : len(stops)
    ]


def test_old_firmware_is_not_asked_to_switch_a_lamp() -> None:
    model = Ps1080Model("old")
    with pytest.raises(FirmwareUnsupportedError, match=r"a lamp that can be switched came with 5\.8\.0"):
        Ps1080(ModelLink(model)).set_led(True)
    assert model.asked == [Opcode.GET_VERSION]


def test_a_version_is_asked_once_and_again_after_a_reset() -> None:
    sensor, model = ps1080_with(lambda opcode, words: None)
    sensor.version(), sensor.version()
    assert model.asked == [0]
    sensor.reboot()
    sensor.version()
    assert model.asked == [0, 6, 0]


def test_a_sensor_that_is_never_ready_is_asked_three_times_a_second_apart() -> None:
    model, clock = Ps1080Model(), FakeClock()
    model._answer = lambda opcode, words: (13, b"")  # type: ignore[method-assign]
    with pytest.raises(FirmwareRefusalError, match=r"the firmware is not ready \(error 13\); wait for some seconds"):
        Ps1080(ModelLink(model), clock=Clock(clock.now, clock.sleep)).keep_alive()
    assert (len(model.asked), clock.slept) == (3, [READY_PAUSE] * 2)


def test_fixed_parameters_that_end_early_are_refused_with_their_length() -> None:
    sensor, _ = ps1080_with(
        lambda opcode, words: (0, b"\0" * 100 if words == b"\0\0" else b"") if opcode == 4 else None
    )
    with pytest.raises(FirmwareReplyError, match="have 100 of 168 bytes"):
        sensor.fixed_parameters()


def test_a_reply_in_two_packets_of_which_the_second_stalls_is_short() -> None:
    model = Ps1080Model("split")
    link, clock = ModelLink(model), FakeClock()
    whole = link.receive

    def receive(length: int, request: int = 0) -> bytes:
        if len(model.packets) == 1:
            raise UsbStallError("stall", where="model", advice="replug it")
        return whole(length, request)

    link.receive = receive  # type: ignore[method-assign]
    with pytest.raises(FirmwareReplyError, match="the answer has 10 of 22 bytes"):
        Ps1080(link, clock=Clock(clock.now, clock.sleep)).version()


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ((0x5350, 1, 1, 7), "older than 3.0"),
        ((0x4252, 1, 2, 7), "to command 2, not 1"),
        ((0x4252, 1, 1, 8), "to request 8, not 7"),
        ((0x4252, 0, 1, 7), "has 10 of 10 bytes"),
    ],
)
def test_a_reply_to_something_else_is_refused(header: tuple[int, ...], said: str) -> None:
    with pytest.raises(FirmwareReplyError, match=said):
        decode_reply(struct.pack("<HHHHH", *header, 0), Opcode.KEEP_ALIVE, 7, "x")


def test_the_largest_request_has_512_bytes() -> None:
    assert len(encode_request(Opcode.SET_MODE, 1, bytes(504))) == 512
    with pytest.raises(ValueError, match="506 bytes"):
        encode_request(Opcode.SET_MODE, 1, bytes(506))


@pytest.mark.parametrize(("major", "build", "said"), [(5, 0x22, "5.8.22"), (4, 0x22, "4.8.34"), (5, 0x2A, "5.8.42")])
def test_a_build_number_is_in_decimal_digits_since_version_5(major: int, build: int, said: str) -> None:
    version = decode_version(struct.pack("<BBHIHH", 8, major, build, 0x99, 6, 0), "x")
    assert (str(version), version.chip_name) == (said, "chip 0x00000099")
    with pytest.raises(FirmwareReplyError, match="the answer has 11 of 12 bytes"):
        decode_version(struct.pack("<BBHIHH", 8, major, build, 0x99, 6, 0)[:11], "x")


def test_without_a_pixel_size_the_focal_length_is_unknown() -> None:
    fixed = FixedParameters(
        serial=1, watchdog=1, emitter_baseline_m=0.1, colour_baseline_m=0.1, reference_distance_m=1.2,
        reference_pixel_m=0.001,
    )  # fmt: skip
    assert fixed.focal_length(640) == pytest.approx(600.0)
    assert replace(fixed, reference_pixel_m=0.0).focal_length(640) == 0.0


def test_a_log_entry_without_words_of_its_own_is_left_out() -> None:
    assert decode_log(struct.pack("<HIH", 2, 5, 0x0203) + bytes(4)) == []
    assert decode_log(struct.pack("<HIH", 3, 5, 0x0203) + struct.pack("<HI", 1, 16)) == [
        "5: module 0x2, error 0x3, parameter 0x10, line 1"
    ]


def test_a_sensor_that_may_not_be_opened_after_its_return_is_waited_for_half_of_the_time() -> None:
    clock, tries = FakeClock(), []

    def find() -> None:
        tries.append(clock.time)
        raise UsbAccessError("may not", where="x", advice="install the rules")

    with pytest.raises(UsbAccessError):
        wait_until_answering(find, limit_s=4.0, clock=Clock(clock.now, clock.sleep))
    assert tries == [0.5 * k for k in range(1, 7)]  # that at 3.0 s began to wait at 2.5 s, after half of the time
