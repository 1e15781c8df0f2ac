"""The commands and pyusb through the real libusb, on a USB bus mocked by umockdev; only the devices are models.

The sensors behind it are the models of `usb_stage`. Skipped where umockdev is not installed (scripts/setup says how).
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from firmware_host import openni2_library
from firmware_host.synthetic.scene import CAMERA, demo_garment
from formats.archive import read_take
from formats.descriptions import dump_description
from formats.rig import Hanger, Rig
from formats.take import FrameState

STAGE = Path(__file__).parent / "usb_stage" / "mocked_bus.py"
ROOT = Path(__file__).parents[2]
IN_PROCESS = pytest.mark.slow  # test_usb_ps1080.py and test_usb_kinect.py show the same without a bus
SYSTEM_PYTHON = "/usr/bin/python3"
BINDINGS = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
HANGTIME = (sys.executable, "-c", "from formats.command import main; main()", "sensor")

# Asks for the version within a time limit [s]; prints what happens.
ASK = """
import sys
from firmware_host.errors import FirmwareError
from firmware_host.usb_control.devices import find_devices
from firmware_host.usb_control.kinect_motor import KinectMotor
from firmware_host.usb_control.link import PyusbLink
from firmware_host.usb_control.models import Protocol
from firmware_host.usb_control.ps1080 import Ps1080

(device,) = find_devices()
link = PyusbLink(device.handle, device.where, timeout_s=float(sys.argv[1]))
try:
    if device.model.protocol is Protocol.PS1080:
        print(Ps1080(link, device.where, timeout_s=float(sys.argv[1])).version())
    else:
        print(KinectMotor(link, device.where).state().tilt_degrees)
except FirmwareError as error:
    print(type(error).__name__, error)
"""

# Reads so many frames of a live sensor within a time limit [s]; prints each frame's size, distance and colour, and
# what ends it.
WATCH = """
import sys
from firmware_host.errors import SensorError
from firmware_host.opening import open_sensor

try:
    with open_sensor("openni2:") as sensor:
        for number in range(int(sys.argv[1])):
            frame = sensor.read(float(sys.argv[2]))
            colour = None if frame.colour is None else frame.colour.shape
            print(frame.depth.shape, int(frame.depth.min()), int(frame.depth.max()), colour, round(frame.time_s, 3))
except SensorError as error:
    print(type(error).__name__, error)
"""


@cache
def why_not() -> str:
    """Return the reason why the bus cannot be mocked here, "" if it can."""
    if sys.maxsize < 2**32:
        return "the mocked bus is written for 64 bit"
    if shutil.which("umockdev-wrapper") is None:
        return "umockdev is not installed (scripts/setup --with-umockdev)"
    found = Path(SYSTEM_PYTHON).exists() and subprocess.run(
        [SYSTEM_PYTHON, "-c", BINDINGS], capture_output=True, check=False
    )
    if not found or found.returncode:
        return "umockdev's Python bindings are not installed (scripts/setup --with-umockdev)"
    return ""


@pytest.fixture(autouse=True)
def umockdev() -> None:
    if why_not():
        pytest.skip(why_not())


def run(stage: str, *program: str) -> subprocess.CompletedProcess[str]:
    """Run a program on a bus of these models, as "ps1080:stall motor"."""
    command = ["umockdev-wrapper", SYSTEM_PYTHON, str(STAGE), *stage.split(), "--", *program]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)


def test_list_shows_place_serial_speed_and_driver() -> None:
    done = run("ps1080 camera", *HANGTIME, "list")
    assert re.search(r"PrimeSense PS1080 .*\n +place +USB 1:4, 1d27:0600\n +serial +1401160123\n", done.stdout)
    assert "high speed, 480 Mbit/s" in done.stdout
    assert re.search(r"Kinect v1 camera\n +place +USB 1:5, 045e:02ae\n +serial +A00364A01234567A", done.stdout)


def test_info_of_a_ps1080_shows_firmware_serial_number_platform_and_geometry() -> None:
    done = run("ps1080", *HANGTIME, "info")
    assert done.returncode == 0, done.stderr
    for line in (r"firmware +5\.8\.22 on PS1080 A6", "serial number +1401160123", "platform +ARM", r"575\.8 px at 640"):
        assert re.search(line, done.stdout)


@IN_PROCESS
def test_info_of_a_kinect_shows_tilt_and_gravity() -> None:
    done = run("camera motor", *HANGTIME, "info")
    assert done.returncode == 0, done.stderr
    assert re.search(r"tilt +30\.0 degrees", done.stdout)
    assert re.search(r"gravity +\[0\.0000, 0\.8657, -0\.5006\]", done.stdout)


@IN_PROCESS
def test_the_log_is_printed_line_by_line() -> None:
    done = run("ps1080", *HANGTIME, "log")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "12: emitter on"
    assert len(done.stdout.splitlines()) == 3


@pytest.mark.parametrize(
    ("stage", "colour", "told"),
    [
        ("ps1080", "on", "'led': (0, 1)"),
        pytest.param("camera motor", "blink-green", "'led': 4", marks=IN_PROCESS),
        pytest.param("motor", "off", "'led': 0", marks=IN_PROCESS),
    ],
)
def test_the_lamp_is_switched_at_the_device(stage: str, colour: str, told: str) -> None:
    done = run(stage, *HANGTIME, "led", colour)
    assert done.returncode == 0, done.stderr
    assert told in done.stderr


@pytest.mark.parametrize(
    ("options", "mode", "says"), [((), 3, "reset"), pytest.param(("--reboot",), 4, "rebooted", marks=IN_PROCESS)]
)
def test_a_reset_reaches_the_device_and_waits_for_its_answer(options: tuple[str, ...], mode: int, says: str) -> None:
    done = run("ps1080", *HANGTIME, "reset", *options)
    assert done.returncode == 0, done.stderr
    assert f"'mode': {mode}" in done.stderr
    assert re.search(rf"USB 1:4: {says}, answers again after \d+\.\d s", done.stdout)


@pytest.mark.parametrize(
    ("stage", "answer"),
    [
        ("ps1080", "5.8.22"),
        ("ps1080:slow", "5.8.22"),
        pytest.param("ps1080:split", "5.8.22", marks=IN_PROCESS),
        pytest.param("ps1080:stale", "5.8.22", marks=IN_PROCESS),
        pytest.param("ps1080:stall", "UsbStallError", marks=IN_PROCESS),
        ("ps1080:timeout", "UsbTimeoutError"),
        pytest.param("ps1080:short", "FirmwareReplyError", marks=IN_PROCESS),
        pytest.param("ps1080:magic", "FirmwareReplyError", marks=IN_PROCESS),
        pytest.param("ps1080:refuse", "FirmwareRefusalError", marks=IN_PROCESS),
        ("ps1080:unplug", "UsbUnpluggedError"),
        pytest.param("ps1080:unplug-late", "UsbUnpluggedError", marks=IN_PROCESS),
        ("motor", "30.0"),
        ("motor:stall", "UsbStallError"),
        pytest.param("motor:timeout", "UsbTimeoutError", marks=IN_PROCESS),
        pytest.param("motor:short", "FirmwareReplyError", marks=IN_PROCESS),
        pytest.param("motor:unplug", "UsbUnpluggedError", marks=IN_PROCESS),
    ],
)
def test_each_reply_on_the_wire_becomes_its_answer_or_its_error(stage: str, answer: str) -> None:
    # Silence is waited for; every other answer may take its time on a busy machine.
    done = run(stage, sys.executable, "-c", ASK, "0.3" if answer == "UsbTimeoutError" else "30")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] == answer


@pytest.mark.parametrize(
    ("stage", "command", "says"),
    [
        pytest.param(
            "ps1080:unplug-late", "info", "USB 1:4: the sensor was unplugged; plug it in again", marks=IN_PROCESS
        ),
        pytest.param("ps1080:magic", "log", "starts with 0x1234, not 0x4252", marks=IN_PROCESS),
        pytest.param(
            "camera", "info", "Kinect v1 camera at USB 1:4: Hangtime cannot ask it for its properties", marks=IN_PROCESS
        ),
        pytest.param("motor", "log", "Kinect v1 motor at USB 1:4: Hangtime cannot ask it for a log", marks=IN_PROCESS),
        pytest.param("motor", "reset", "Hangtime cannot ask it for a reset", marks=IN_PROCESS),
        pytest.param(
            "motor",
            "led purple",
            "no state 'purple'; choose one of off, green, red, yellow, blink-green, blink-red-yellow",
            marks=IN_PROCESS,
        ),
        pytest.param("ps1080:old", "led on", "firmware 5.3.29 has no such request", marks=IN_PROCESS),
        pytest.param("ps1080", "info --device 1:9", "no depth sensor at USB 1:9", marks=IN_PROCESS),
        pytest.param(
            "", "info --device four", "--device: 'four' is no place on the USB bus; give BUS:ADDRESS", marks=IN_PROCESS
        ),
        ("", "info", "hangtime: USB bus: no depth sensor is connected; plug it in"),
    ],
)
def test_a_command_that_fails_says_why_in_one_sentence_and_exits_with_2(stage: str, command: str, says: str) -> None:
    done = run(stage, *HANGTIME, *command.split())
    complaint = [line for line in done.stderr.splitlines() if line.startswith("hangtime:")]
    assert done.returncode == 2
    assert len(complaint) == 1
    assert says in complaint[0]
    assert "Traceback" not in done.stderr


def test_the_doctor_goes_as_far_as_a_sensor_without_streams_lets_it() -> None:
    lines = dict(re.split(r"  +", line, maxsplit=1) for line in run("ps1080", *HANGTIME, "doctor").stdout.splitlines())
    assert lines["device"] == "ok: PrimeSense PS1080 (Carmine, Xtion) at USB 1:4, 1d27:0600"
    assert lines["permission"] == "ok: this user may open it"
    assert lines["speed and power"] == "ok: high speed, 480 Mbit/s, up to 500 mA"
    assert lines["firmware"] == "ok: 5.8.22 on PS1080 A6"
    assert not lines["streams"].startswith("ok")
    assert lines["markers"] == "skipped: waits for `streams`"


def test_the_doctor_distinguishes_a_kinect_without_its_power_supply_from_no_kinect() -> None:
    done = run("motor", *HANGTIME, "doctor")
    assert done.returncode == 1
    assert "only a part of a sensor is there: Kinect v1 motor at USB 1:4; plug in its power supply" in done.stdout


# --- OpenNI2's own driver on the same bus -------------------------------------------------------


@pytest.fixture
def driver() -> None:
    if openni2_library.find_driver("PS1080") is None:
        pytest.skip("OpenNI2's PS1080 driver is not installed (apt-get install libopenni2-0)")


@pytest.mark.openni
@pytest.mark.usefixtures("driver")
def test_a_live_ps1080_streams_640_by_480_unmirrored_at_the_distance_of_its_shifts() -> None:
    done = run("streaming", sys.executable, "-c", WATCH, "9", "30")
    lines = done.stdout.splitlines()
    assert len(lines) == 9, done.stdout + done.stderr
    # A shift of 800 is 1193 mm, see usb_stage/streams.py.
    assert all(line.startswith("(480, 640) 1193 1193 ") for line in lines)
    assert sum("(480, 640, 3)" in line for line in lines) >= 7  # the streams begin one after the other
    steps = np.diff([float(line.split()[-1]) for line in lines])
    # Whole thirtieths of a second; a busy machine may lose a frame. Times are printed to the millisecond.
    np.testing.assert_allclose(30 * steps, np.maximum(np.round(30 * steps), 1), atol=0.05)
    parameters = ast.literal_eval(re.search(r"'parameters': (\{.*?\})", done.stderr)[1])  # type: ignore[index]
    assert (parameters[23], parameters[71]) == (0, 0)  # mirroring of depth and colour


@pytest.mark.openni
@pytest.mark.usefixtures("driver")
@pytest.mark.parametrize("fault", [pytest.param("pulled", marks=pytest.mark.slow), "no-frames"])  # ten seconds
def test_a_live_sensor_that_is_unplugged_or_sends_nothing_is_an_error_after_the_time_limit(fault: str) -> None:
    limit = "10" if fault == "pulled" else "1"  # a busy machine may take seconds from frame to frame
    done = run(f"streaming:{fault}", sys.executable, "-c", WATCH, "200", limit)
    assert done.stdout.splitlines()[-1].startswith(f"SensorStalledError 1d27/0600@1/4: no frame for {limit} s")
    assert len(done.stdout.splitlines()) > (5 if fault == "pulled" else 0)


@pytest.mark.slow
@pytest.mark.openni
@pytest.mark.usefixtures("driver")
def test_the_doctor_finds_nothing_wrong_with_a_sensor_that_streams_two_markers() -> None:
    pytest.importorskip("cv2")
    done = run("streaming", *HANGTIME, "doctor")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("  ok: ") == 9


@pytest.mark.slow
@pytest.mark.openni
@pytest.mark.usefixtures("driver")
@pytest.mark.parametrize("number", [0, 1])
def test_the_doctor_streams_from_the_one_of_two_sensors_that_is_named(number: int) -> None:
    done = run("streaming streaming", *HANGTIME, "doctor", "--device", f"1:{4 + number}")
    lines = dict(re.split(r"  +", line, maxsplit=1) for line in done.stdout.splitlines())
    assert lines["streams"].startswith("ok: PS1080, 640 x 480"), done.stdout + done.stderr
    told = re.findall(r"'parameters': (\{.*?\})", done.stderr)
    assert [parameters == "{}" for parameters in told] == [number == 1, number == 0]  # nobody asked the other one


@pytest.mark.slow
@pytest.mark.openni
@pytest.mark.usefixtures("driver")
def test_a_live_recording_of_two_seconds_is_a_take_of_every_frame(tmp_path: Path) -> None:
    """Markers of 30 px, 120 px apart, at 1193 mm, as a camera of 575.8 px sees them, on a wall."""
    pytest.importorskip("cv2")
    hanger = Hanger(
        dictionary="DICT_4X4_50", ids=(0, 1), marker_size_m=1.193 * 30 / 575.8, marker_distance_m=1.193 * 120 / 575.8,
        held_m=((-0.1, 0.09, 0.0), (0.1, 0.09, 0.0)),
    )  # fmt: skip
    rig = Rig(format="hangtime-rig/1", name="live", gravity=(0.0, 1.0, 0.0), hanger=hanger, sensor=CAMERA)
    (tmp_path / "rig.toml").write_text(dump_description(rig))
    (tmp_path / "garment.toml").write_text(dump_description(demo_garment()))
    out = tmp_path / "live.mcap"
    files = [f"--{name}={tmp_path / name}.toml" for name in ("rig", "garment")]
    done = run("streaming", *HANGTIME[:-1], "record", "--sensor=openni2:", *files, f"--out={out}", "--seconds=2")
    assert done.returncode == 2, done.stdout + done.stderr
    assert "no point of the garment was ever seen; the take was kept" in done.stderr
    take = read_take(out)
    assert take.is_complete
    assert take.held_valid.mean() > 0.9
    assert take.time[-1] - take.time[0] == pytest.approx(2.0, abs=0.1)
    # Frames that the mocked bus or this machine lost are reported.
    gaps = np.flatnonzero(np.diff(take.time) > 1.5 / 30) + 1
    assert (take.state[gaps] & FrameState.FRAMES_DROPPED_BEFORE > 0).all()
