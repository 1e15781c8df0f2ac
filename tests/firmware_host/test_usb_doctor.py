"""The doctor: order, skipping, the text of each line, and the exit code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware_host import openni2_library
from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.doctor import checks, doctor, stream_checks, usb_checks
from firmware_host.doctor.checks import Check, Examination, StreamSample, Verdict, ok, problem, skipped
from firmware_host.doctor.doctor import examine
from firmware_host.errors import RecordingError, SensorUnavailableError
from firmware_host.oni_writer import OniWriter
from firmware_host.synthetic.sensor import SyntheticSensor
from formats.command import app, gather_commands
from tests.firmware_host.scenes import PERIOD_US, SMALL, flat_world, picture, write_recording

pytest.importorskip("usb.core")
from firmware_host.usb_control import devices
from tests.firmware_host.usb_stage.in_process import ModelBackend
from tests.firmware_host.usb_stage.models import KinectCameraModel, KinectMotorModel, Ps1080Model


@pytest.fixture(scope="module")
def command() -> CliRunner:
    gather_commands()
    return CliRunner()


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Replace libusb by a bus of models, and provide OpenNI2 with its PS1080 driver."""
    monkeypatch.setattr(openni2_library, "load", lambda: None)
    monkeypatch.setattr(openni2_library, "find_driver", lambda name: Path(f"/drivers/lib{name}.so.0"))
    return lambda *models, **options: monkeypatch.setattr(
        devices, "load_backend", lambda: ModelBackend(*models, **options)
    )


def says(check: Callable[[Examination], checks.Finding], examination: Examination) -> str:
    """Return the verdict and the text of a check's finding."""
    ((_, finding),) = examine([Check(name="it", look=check)], examination)
    return f"{finding.verdict.value}: {finding.text}"


def examined(**options: Any) -> Examination:
    """An examination whose device check has run."""
    examination = Examination(**options)
    usb_checks.on_the_bus(examination)
    return examination


# --- order and skipping -------------------------------------------------------------------------


def test_a_check_waits_for_those_that_it_needs_and_for_those_that_were_skipped() -> None:
    made = [
        Check(name="a", look=lambda _: problem("no", "do")),
        Check(name="b", look=lambda _: ok("yes"), needs=("a",)),
        Check(name="c", look=lambda _: ok("yes"), needs=("b",)),
        Check(name="d", look=lambda _: ok("yes"), needs=("elsewhere",)),
    ]
    found = [(check.name, finding.verdict.value, finding.text) for check, finding in examine(made, Examination())]
    assert found == [
        ("a", "problem", "no; do"), ("b", "skipped", "waits for `a`"), ("c", "skipped", "waits for `b`"),
        ("d", "ok", "yes"),
    ]  # fmt: skip


def test_an_error_of_ours_is_a_finding_and_a_fault_of_the_program_is_not() -> None:
    def look(_: Examination) -> checks.Finding:
        raise RecordingError("is damaged", where="x.oni", advice="copy it again")

    assert says(look, Examination()) == "problem: x.oni: is damaged; copy it again"
    with pytest.raises(ZeroDivisionError):
        says(lambda _: ok(str(1 / 0)), Examination())


def test_the_checks_come_in_the_order_of_what_depends_on_what() -> None:
    names = [check.name for check in doctor.all_checks(is_recording=False)]
    assert names == [
        "device", "permission", "speed and power", "firmware", "driver", "streams", "frame rate", "depth", "markers",
    ]  # fmt: skip
    assert [check.name for check in doctor.all_checks(is_recording=True)] == names[5:]


def test_a_check_whose_library_is_absent_is_a_line_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def load() -> Check:
        raise ModuleNotFoundError("no cv2", name="cv2")

    monkeypatch.setattr(doctor, "entry_points", lambda group: [SimpleNamespace(name="markers", load=load)])
    ((check, finding),) = examine(doctor.contributed(), Examination())
    assert (check.name, finding) == ("markers", skipped("cv2 is not installed"))


# --- the device ---------------------------------------------------------------------------------


def test_a_healthy_ps1080_is_ok_up_to_its_driver(bus: Callable[..., None]) -> None:
    bus(Ps1080Model())
    found = [finding for _, finding in examine(usb_checks.USB_CHECKS, Examination())]
    assert [finding.verdict for finding in found] == [Verdict.OK] * 5
    assert found[3].text == "5.8.22 on PS1080 A6"
    assert found[4].text == "OpenNI2 and its driver libPS1080.so.0"


def test_an_empty_bus_and_a_foot_without_a_camera_get_different_advice(bus: Callable[..., None]) -> None:
    bus()
    assert says(usb_checks.on_the_bus, Examination()).startswith(
        "problem: USB bus: no depth sensor is connected; plug it in"
    )
    bus(KinectMotorModel())
    assert "the camera needs it" in says(usb_checks.on_the_bus, Examination())


def test_the_second_of_two_sensors_is_queried_when_it_is_named(bus: Callable[..., None]) -> None:
    bus(Ps1080Model(), Ps1080Model())
    assert "USB 1:4, 1d27:0600; 1 more" in says(usb_checks.on_the_bus, Examination())
    assert says(usb_checks.on_the_bus, Examination(place="1:5")).endswith("USB 1:5, 1d27:0600")


def test_a_denied_device_names_the_rules_file(bus: Callable[..., None]) -> None:
    bus(Ps1080Model(), denied=(0,))
    assert "copy systemd/udev/55-hangtime-depth-sensor.rules" in says(usb_checks.may_be_opened, examined())
    assert (Path(__file__).parents[2] / "systemd/udev/55-hangtime-depth-sensor.rules").exists()


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"speed": 3}, "ok: high speed, 480 Mbit/s, up to 500 mA"),
        ({"speed": 2}, "problem: connected at full speed, 12 Mbit/s, the streams need 480 Mbit/s"),
        (
            {"hub_attributes": 0x80},
            "problem: the camera may draw 500 mA from a hub without a supply, which gives 100 mA",
        ),
        ({"hub_attributes": 0xC0}, "ok: high speed"),
        ({"speed": 0}, "ok: unknown speed"),
    ],
)
def test_speed_and_power_are_compared_with_what_the_streams_need(
    bus: Callable[..., None], options: dict[str, int], expected: str
) -> None:
    bus(Ps1080Model(), **options)
    assert says(usb_checks.fast_and_powered, examined()).startswith(expected)


def test_a_firmware_that_answers_nonsense_is_a_problem_and_a_kinect_has_none_to_ask(bus: Callable[..., None]) -> None:
    bus(Ps1080Model("magic"))
    assert "starts with 0x1234" in says(usb_checks.firmware_answers, examined())
    bus(KinectCameraModel())
    assert says(usb_checks.firmware_answers, examined()).startswith("ok: none of its own to ask")


def test_a_driver_that_debian_does_not_ship_or_that_is_not_installed_is_a_problem(
    bus: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus(KinectCameraModel())
    assert "has no driver for the Kinect v1 camera; record with" in says(usb_checks.driver_is_there, examined())
    examination = examined()
    examination.camera = replace(examination.camera, model=replace(examination.camera.model, openni2_driver="PSLink"))
    assert says(usb_checks.driver_is_there, examination) == "ok: OpenNI2 and its driver libPSLink.so.0"
    bus(Ps1080Model())
    monkeypatch.setattr(openni2_library, "find_driver", lambda name: None)
    assert "libPS1080.so is not installed; install it: apt-get" in says(usb_checks.driver_is_there, examined())


def test_the_folder_of_drivers_is_the_one_that_openni_is_set_to_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tmp_path / "OpenNI.ini"
    settings.write_text(f"[Drivers]\nRepository={tmp_path}\n")
    monkeypatch.setattr(openni2_library, "SETTINGS_FILE", settings)
    assert openni2_library.find_driver("PS1080") is None
    (tmp_path / "libPS1080.so.0").touch()
    assert openni2_library.find_driver("PS1080") == tmp_path / "libPS1080.so.0"
    found = [tmp_path / f"libPS1080.so{end}" for end in (".1", "", ".0")]  # in the order of some disk
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: iter(found if folder == tmp_path else []))
    assert openni2_library.find_driver("PS1080") == tmp_path / "libPS1080.so"


# --- the streams --------------------------------------------------------------------------------


def sample(count: int, *, period: float = 1 / 30, dropped: tuple[int, ...] = (), share: float = 0.8) -> StreamSample:
    """Return a sample with a number of frames; after each frame in `dropped`, one is missing."""
    info = SensorInfo(name="s", uri="s", width=10, height=10, fps=30.0, intrinsics=SMALL, is_live=True)
    depth = np.zeros((10, 10), np.uint16)
    depth.flat[: round(100 * share)] = 1000
    made = StreamSample(info=info)
    for number in range(count):
        made.add(
            SensorFrame(
                index=number, time_s=period * number, host_time_s=0.0, depth=depth, colour=None,
                dropped_before=int(number in dropped),
            )
        )  # fmt: skip
    return made


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (sample(151), "ok: 30.0 frames a second for 5.0 s, 0 of 151 dropped"),
        (sample(151, dropped=(70,)), "ok: 30.0 frames a second for 5.0 s, 1 of 152 dropped"),
        (sample(151, dropped=(70, 80)), "problem: 30.0 frames a second for 5.0 s, 2 of 153 dropped; end other"),
        (sample(101, period=0.05), "problem: 20.0 frames a second for 5.0 s, 0 of 101 dropped, but 30 a second are"),
        (sample(1), "problem: a second frame never came"),
    ],
)
def test_more_than_one_percent_dropped_or_five_percent_too_slow_is_a_problem(made: StreamSample, expected: str) -> None:
    assert says(lambda _: stream_checks.judge_rate(made), Examination()).startswith(expected)


class Clockwork(DepthSensor):
    """An endless live sensor, whose clock advances by `step` [s] per frame."""

    info = SensorInfo(name="s", uri="s", width=10, height=10, fps=30.0, intrinsics=SMALL, is_live=True)

    def __init__(self, step: float) -> None:
        self.step, self.given = step, 0

    def read(self, timeout_s: float = 1.0) -> SensorFrame:
        self.given += 1
        depth = np.ones((10, 10), np.uint16)
        return SensorFrame(
            index=self.given - 1, time_s=100.0 + self.step * (self.given - 1), host_time_s=0.0, depth=depth, colour=None
        )

    def close(self) -> None: ...


@pytest.mark.parametrize(
    ("step", "given", "expected"),
    [
        pytest.param(0.0, 310, "problem: its clock stands still or runs backwards: 300 frames came while it went from "
                     "100.00 to 100.00 s; unplug and replug", id="stands still"),
        pytest.param(-1 / 30, 310, "problem: its clock stands still or runs backwards: 300 frames came while it went "
                     "from 99.67 to 89.70 s; unplug", id="runs backwards"),
        pytest.param(1 / 30, 161, "ok: 30.0 frames a second for 5.0 s", id="runs"),
    ],
)  # fmt: skip
def test_a_clock_that_does_not_run_is_a_problem_and_is_not_waited_for(step: float, given: int, expected: str) -> None:
    """Ten frames to warm up, then five seconds, at most twice the 150 frames that are due in them."""
    sensor = Clockwork(step)
    examination = Examination(sensor=sensor, sample=StreamSample(info=sensor.info))
    assert says(stream_checks.rate_and_drops, examination).startswith(expected)
    assert sensor.given == given


@pytest.mark.parametrize(("share", "verdict"), [(0.31, "ok"), (0.29, "problem")])
def test_depth_in_less_than_three_tenths_of_the_pixels_is_a_problem(share: float, verdict: str) -> None:
    assert says(stream_checks.depth_coverage, Examination(sample=sample(3, share=share))).startswith(
        f"{verdict}: depth"
    )


def test_the_mean_and_the_worst_frame_are_stated_and_the_mean_decides() -> None:
    made = sample(3, share=0.5)
    made.coverage[1] = 0.2
    assert says(stream_checks.depth_coverage, Examination(sample=made)).startswith(
        "ok: depth in 40 % of the pixels, in the worst frame 20 %"
    )


def test_checks_of_streams_without_a_sensor_or_a_frame_say_so() -> None:
    assert "streams: no sensor is open" in says(stream_checks.rate_and_drops, Examination(sample=sample(3)))
    assert "streams: nothing came from the sensor" in says(stream_checks.depth_coverage, Examination())


def test_a_frame_every_half_second_is_kept_for_other_checks() -> None:
    assert [frame.index for frame in sample(40).frames] == [0, 15, 30]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_is_checked_from_its_streams_on_and_lacks_markers(command: CliRunner, tmp_path: Path) -> None:
    result = command.invoke(app, ["sensor", "doctor", str(write_recording(tmp_path / "a.oni", 20))])
    assert result.exit_code == 1, result.output
    lines = result.output.splitlines()
    assert [line.split("  ")[0] for line in lines] == ["streams", "frame rate", "depth", "markers"]
    assert lines[0] == "streams     ok: oni File, 64 x 48 at 30 frames a second"
    assert lines[1] == "frame rate  ok: 30.0 frames a second for 0.6 s, 0 of 20 dropped"
    assert "marker 0 in 0 %, marker 1 in 0 % of 2 frames; hang the hanger" in lines[3]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_without_colour_says_so_and_skips_the_rest(command: CliRunner, tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL, with_colour=False) as writer:
        for number in range(3):
            writer.write_depth(1000 + number * PERIOD_US, picture(number)[0])
    result = command.invoke(app, ["sensor", "doctor", str(path)])
    assert result.exit_code == 1
    assert "but no colour beside the depth; colour is needed" in result.output
    assert result.output.count("skipped: waits for `streams`") == 3


@pytest.mark.parametrize("wrong", [["gone.oni"], ["--rig", "gone.toml"]])
def test_a_file_that_is_not_there_ends_the_doctor_before_it_begins(command: CliRunner, wrong: list[str]) -> None:
    result = command.invoke(app, ["sensor", "doctor", *wrong])
    assert result.output == ""
    assert str(result.exception).startswith("gone.")


def test_without_libusb_the_doctors_first_line_says_how_to_get_it(
    command: CliRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load_backend() -> None:
        raise SensorUnavailableError(
            "the USB library is not installed", where=None, advice="apt-get install libusb-1.0-0"
        )

    monkeypatch.setattr(devices, "load_backend", load_backend)
    result = command.invoke(app, ["sensor", "doctor"])
    assert result.exit_code == 1
    assert result.output.startswith("device           the USB library is not installed; apt-get install libusb-1.0-0\n")


def test_the_doctor_of_a_synthetic_world_says_first_what_it_simulates_and_how_far_it_is(
    command: CliRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream_checks, "open_sensor", lambda uri: SyntheticSensor(flat_world(11), uri))
    result = command.invoke(app, ["sensor", "doctor", "synthetic:flat"])
    lines = result.stderr.splitlines()
    assert lines[0] == (
        "A synthetic world's cloth is simulated first, then 5 s of its frames are rendered, within a minute or so"
    )
    assert lines[1:] == ["synthetic frames: 1 %, 2 rendered"]  # the next line at 11 %
    assert result.stdout.startswith("streams     ok: synthetic sensor")
