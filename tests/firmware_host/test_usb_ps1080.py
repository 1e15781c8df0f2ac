"""The PS1080's firmware, queried in this process: valid answers, and each fault of a device."""

from __future__ import annotations

import pytest

from firmware_host.errors import (
    FirmwareError,
    FirmwareRefusalError,
    FirmwareReplyError,
    FirmwareUnsupportedError,
    UsbStallError,
    UsbTimeoutError,
    UsbUnpluggedError,
)
from firmware_host.usb_control.ps1080 import Clock, Ps1080, wait_until_answering
from firmware_host.usb_control.ps1080_answers import decode_log, decode_text
from firmware_host.usb_control.ps1080_messages import Opcode, encode_request
from tests.firmware_host.usb_stage.in_process import FakeClock, ModelLink
from tests.firmware_host.usb_stage.models import Ps1080Model, log_block


def sensor(fault: str = "") -> tuple[Ps1080, Ps1080Model, FakeClock]:
    model, clock = Ps1080Model(fault), FakeClock()
    return Ps1080(ModelLink(model), "PS1080", timeout_s=1.0, clock=Clock(clock.now, clock.sleep)), model, clock


def test_a_request_on_the_wire_is_gm_words_opcode_id_and_arguments() -> None:
    assert encode_request(Opcode.SET_MODE, 0x0102, b"\x04\x00") == b"GM\x01\x00\x06\x00\x02\x01\x04\x00"
    with pytest.raises(ValueError, match="3 bytes"):
        encode_request(Opcode.SET_MODE, 1, b"abc")


def test_the_version_is_read_minor_first_and_its_build_as_it_looks() -> None:
    version = sensor()[0].version()
    assert str(version) == "5.8.22"  # 0x22 on the wire
    assert version.chip_name == "PS1080 A6"
    assert version.system == 0x1234


def test_serial_number_and_platform_are_read_with_and_without_zero_bytes_between() -> None:
    ps1080 = sensor()[0]
    assert ps1080.serial_number() == "1401160123"
    assert ps1080.platform() == "ARM"
    assert decode_text(b"A\0\0\0") == "A"


def test_the_factorys_centimetres_become_metres_and_give_the_known_focal_length() -> None:
    fixed = sensor()[0].fixed_parameters()
    assert fixed.emitter_baseline_m == pytest.approx(0.075)
    assert fixed.reference_distance_m == pytest.approx(1.2)
    # 120 cm / 0.1042 cm = 1151.6 px at 1280 px, so half of it at 640 px.
    assert fixed.focal_length(640) == pytest.approx(575.8, abs=0.05)


def test_fixed_parameters_are_fetched_in_pieces_of_at_most_100_bytes() -> None:
    ps1080, model, _ = sensor()
    ps1080.fixed_parameters()
    assert model.asked == [4, 4]


def test_the_log_is_fetched_until_it_is_empty_and_read_line_by_line() -> None:
    lines = ["12: emitter on", "13: entries were lost here, the log had run full",
             "14: module 0x2, error 0x3, parameter 0x9, line 321"]  # fmt: skip
    ps1080, model, _ = sensor()
    assert ps1080.log() == lines
    assert ps1080.log() == []
    assert model.asked == [7] * 5
    assert decode_log(log_block()[:-1]) == lines[:2]


def test_processor_times_are_seconds() -> None:
    times = sensor()[0].cpu_statistics()
    assert [(t.runs, t.seconds) for t in times] == [(10, 2.0), (30, 0.5)]


def test_lamp_keep_alive_and_resets_reach_the_device() -> None:
    ps1080, model, _ = sensor()
    ps1080.keep_alive()
    ps1080.set_led(True)
    ps1080.soft_reset()
    assert (model.led, model.mode) == ((0, 1), 3)
    ps1080.reboot()
    assert model.mode == 4


@pytest.mark.parametrize("call", ["serial_number", "platform"])
def test_old_firmware_is_not_asked_for_what_it_does_not_have(call: str) -> None:
    ps1080, model, _ = sensor("old")
    with pytest.raises(
        FirmwareUnsupportedError, match=r"PS1080: firmware 5\.3\.29 has no such request; a .* came with"
    ):
        getattr(ps1080, call)()
    assert model.asked == [0]


@pytest.mark.parametrize("fault", ["slow", "stale", "split", "busy"])
def test_a_reply_that_is_late_split_or_preceded_by_an_old_one_is_still_read(fault: str) -> None:
    ps1080, _, clock = sensor(fault)
    assert str(ps1080.version()) == "5.8.22"
    # Not ready costs a second before asking again; three stalls cost 10 ms each; the others cost nothing.
    assert clock.time == pytest.approx({"busy": 1.0, "slow": 0.03}.get(fault, 0.0))


@pytest.mark.parametrize(
    ("fault", "kind", "says"),
    [
        ("stall", UsbStallError, "stall"),
        ("timeout", UsbTimeoutError, "silence"),
        ("short", FirmwareReplyError, "the answer has 4 bytes and no header"),
        ("cut", FirmwareReplyError, "the answer has 16 of 22 bytes"),
        ("magic", FirmwareReplyError, "starts with 0x1234, not 0x4252; unplug"),
        ("refuse", FirmwareRefusalError, r"refuses command GET_VERSION: the parameters are wrong \(error 5\)"),
        ("unplug", UsbUnpluggedError, "gone"),
        ("unplug-late", UsbUnpluggedError, "gone"),
    ],
)
def test_each_fault_has_an_error_of_its_own(fault: str, kind: type[FirmwareError], says: str) -> None:
    with pytest.raises(kind, match=says):
        sensor(fault)[0].version()


def test_a_stalled_request_is_sent_five_times_in_all() -> None:
    ps1080, _, clock = sensor("stall")
    with pytest.raises(UsbStallError):
        ps1080.keep_alive()
    assert clock.slept == [0.1] * 4


def test_a_sensor_that_accepts_requests_and_has_no_answer_is_given_up_after_the_time_limit() -> None:
    ps1080, model, clock = sensor()
    model._take = lambda request: None  # type: ignore[method-assign]
    with pytest.raises(UsbTimeoutError, match="no answer in 1 s"):
        ps1080.keep_alive()
    assert clock.time == pytest.approx(1.0, abs=0.02)


def test_a_reboot_that_takes_the_device_off_the_bus_before_it_answers_has_worked() -> None:
    ps1080, model, _ = sensor("unplug-late")
    ps1080.reboot()
    assert model.mode == 4


def test_waiting_for_a_rebooted_sensor_ends_with_its_first_answer() -> None:
    clock = FakeClock()
    links = iter([None, ModelLink(Ps1080Model("unplug")), ModelLink(Ps1080Model())])
    assert wait_until_answering(lambda: next(links), clock=Clock(clock.now, clock.sleep)) == pytest.approx(1.5)
    assert wait_until_answering(lambda: None, limit_s=3.0, clock=Clock(clock.now, clock.sleep)) is None
