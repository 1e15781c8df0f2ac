"""Messages and lamp signals of `hangtime record` for faults, on recordings played through OpenNI2."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from typer.testing import CliRunner

from capture.recording.condition import HOLD
from capture.recording.condition_lamp import show_condition
from capture.recording.stop_signals import stopped_like_ctrl_c
from firmware_host.lamp import StatusLamp
from firmware_host.oni_writer import OniWriter
from formats.archive import read_take
from formats.command import app, gather_commands
from formats.descriptions import dump_description
from formats.errors import OutputError
from formats.rig import Sensor
from formats.take import FrameState
from tests import openni2
from tests.capture.garment.towel import GARMENT
from tests.capture.garment.towel_scenes import BODY, RIG, hung, nothing, scenes
from tests.capture.stage import CAMERA
from tests.firmware_host.scenes import AnyStamps

FILES = {"sensor": "a.oni", "rig": "rig.toml", "garment": "garment.toml", "out": "a.mcap"}

PROGRAM = [sys.executable, "-c", "from formats.command import main; main()", "record"]


@dataclasses.dataclass
class Case:
    """Frames of a fault after `GOOD` good ones: the message, their bits, the lamp's half period [ms]."""

    said: str
    bits: int
    half: int
    view: Callable[[], list] | None = None
    spoil: Callable = lambda depth, colour: (depth, colour)
    step: int = 33_333  # us from frame to frame
    frames: int = 20
    late: int = 0  # of these that show another fault, until the cause is known


LOST = FrameState.MARKER_LOST | FrameState.GARMENT_LOST
CASES = {
    "no markers": Case("no markers are seen; show both", LOST, 500, scenes),
    "one marker": Case(
        "only one marker is seen; turn", LOST | FrameState.ONE_MARKER, 500, lambda: scenes(*hung(markers=(1,)))
    ),
    "a person in front": Case(
        "something is in front of the hanger or the garment; step out", LOST | FrameState.VIEW_BLOCKED, 500,
        lambda: scenes(*hung(), BODY),
    ),
    "too near": Case("too near; go back", FrameState.TOO_NEAR, 500, lambda: scenes(*hung((0, -0.1, 0.7))), late=2),
    "too far": Case("too far; come closer", LOST | FrameState.TOO_FAR, 500,
                    spoil=lambda depth, colour: (np.full_like(depth, 3700), np.full_like(colour, 128))),
    "depth all zero": Case("no depth; record the file again with the sensor", LOST | FrameState.DEPTH_MISSING, 125,
                           spoil=lambda depth, colour: (np.zeros_like(depth), colour)),
    "colour missing": Case("no colour picture; record the file again", LOST | FrameState.COLOUR_MISSING, 125,
                           spoil=lambda depth, colour: (depth, None)),
    "a clock that runs backwards": Case("the sensor's clock runs backwards or leaps; record the file again", 0, 125,
                                        step=-33_333),
}  # fmt: skip
GOOD = 35  # frames, five times seven pictures: a fit needs three half-seconds with the hanger
QUICK = ("a clock that runs backwards",)  # the others: test_conditions.py
LED = {"brightness": "0", "max_brightness": "1", "trigger": "[none] timer", "delay_on": "0", "delay_off": "0"}


@pytest.mark.openni
@pytest.mark.parametrize("name", [pytest.param(one, marks=[] if one in QUICK else pytest.mark.slow) for one in CASES])
def test_a_fault_is_printed_shown_on_the_lamp_and_kept_in_the_take(good, tmp_path, monkeypatch, name):
    """The command on a recording, a second and more: good frames, twenty bad ones; the lamp is real files."""
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    case, lamp = CASES[name], make_lamp(tmp_path)
    write_descriptions(tmp_path)
    monkeypatch.setattr(StatusLamp.__init__, "__defaults__", (tmp_path / "leds",))
    shown = []

    def show(on, condition):
        show_condition(on, condition)
        shown.append(((lamp / "trigger").read_text(), int((lamp / "delay_on").read_text())))

    monkeypatch.setattr("capture.recording.condition_lamp.show_condition", show)
    bad = case.view() if case.view else good
    with AnyStamps(tmp_path / "a.oni", CAMERA, depth_codec="NONE") as writer:
        for number in range(GOOD + case.frames):
            is_bad = number >= GOOD
            pair = case.spoil(*bad[number % len(bad)]) if is_bad else good[number % len(good)]
            stamp = 10_000_000 + 33_333 * min(number, GOOD - 1) + is_bad * case.step * (number - GOOD + 1)
            writer.write_depth(stamp, pair[0])
            if pair[1] is not None:
                writer.write_colour(stamp + 1000, pair[1])
    done = CliRunner().invoke(app, ["record", *words(tmp_path), "--lamp=status"])
    if name == "too near":  # half a metre from one frame to the next
        assert "the hanger jumps at 1.23 s" in str(done.exception)
    else:
        assert done.exit_code == 0, done.output
    assert done.stderr.startswith("a.mcap:    0.0 s  hanger and garment are seen\n")
    assert f"   {GOOD / 30 + HOLD:.1f} s  {case.said}" in done.stderr
    assert done.stderr.count(" s  ") == 2
    assert shown == [("none", 0), ("timer", case.half)]
    assert [(lamp / file).read_text() for file in ("trigger", "brightness")] == ["none", "0"]
    assert f"in {case.frames - case.late} frames {case.said.split(';')[0]}\n" in done.stdout
    take = read_take(tmp_path / "a.mcap")
    assert take.is_complete
    assert (take.state[:GOOD] == 0).all()
    seen = take.state[GOOD + case.late :].tolist()
    assert seen == ([case.bits] * (case.frames - case.late) if case.bits else [])


@pytest.mark.openni
def test_a_lamp_that_fails_later_is_said_once_and_the_recording_goes_on(good, tmp_path, monkeypatch):
    """The LED goes away after it was lit; then the hanger comes too near, and goes back."""
    write_swing(tmp_path, [*good * 4, *scenes(*hung((0, -0.1, 0.7))) * 7, *good * 5])
    lamp = make_lamp(tmp_path)
    monkeypatch.setattr(StatusLamp.__init__, "__defaults__", (tmp_path / "leds",))

    def show(on, condition):
        show_condition(on, condition)
        shutil.rmtree(lamp)

    monkeypatch.setattr("capture.recording.condition_lamp.show_condition", show)
    done = CliRunner().invoke(app, ["record", *words(tmp_path), "--lamp=status"])
    assert "the hanger jumps at 0.47 s" in str(done.exception)  # half a metre from one frame to the next
    said = [line.split(" s  ")[1] for line in done.stderr.splitlines()]
    assert [line.split(";")[0] for line in said] == [
        "hanger and garment are seen", "too near",
        f"without the lamp: {lamp}/brightness: cannot be changed (No such file or directory)",
        "hanger and garment are seen",
    ]  # fmt: skip
    take = read_take(tmp_path / "a.mcap")
    assert take.is_complete
    assert len(take.time) == 41


def test_a_lamp_that_is_not_there_is_refused_before_the_recording_begins(tmp_path, monkeypatch):
    write_descriptions(tmp_path)
    make_lamp(tmp_path)
    monkeypatch.setattr(StatusLamp.__init__, "__defaults__", (tmp_path / "leds",))
    done = CliRunner().invoke(app, ["record", *words(tmp_path), "--lamp=gone"])
    assert str(done.exception) == f"{tmp_path / 'leds'}: there is no LED 'gone'; choose one of status"
    assert not list(tmp_path.glob("a.mcap*"))


@pytest.mark.openni
def test_the_surface_is_scanned_as_often_and_as_finely_as_the_command_asks(good, tmp_path):
    """Five times in a second: every sixth of 33 frames, 4 x 4 places and 32 around."""
    write_swing(tmp_path, good * 11)
    done = CliRunner().invoke(app, ["record", *words(tmp_path), "--scan-rate=5", "--scan-points=4"])
    assert done.exit_code == 0, done.output
    scans = read_take(tmp_path / "a.mcap").scans
    assert [scan.time for scan in scans] == pytest.approx(np.arange(6) * 0.2, abs=0.04)
    assert {(scan.grid.shape, scan.contour.shape) for scan in scans} == {((4, 4, 3), (32, 3))}


@pytest.mark.openni
def test_a_recording_of_another_size_than_the_rigs_is_refused_and_leaves_nothing(tmp_path):
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    write_descriptions(tmp_path)
    half = Sensor(width=320, height=240, fx=287.9, fy=287.9, cx=159.5, cy=119.5)
    with OniWriter(tmp_path / "a.oni", half) as writer:
        writer.write_depth(1000, np.full((240, 320), 1200, np.uint16))
        writer.write_colour(2000, np.zeros((240, 320, 3), np.uint8))
    done = CliRunner().invoke(app, ["record", *words(tmp_path)])
    assert done.exit_code != 0
    assert str(done.exception) == (
        f"{tmp_path}/rig.toml: {tmp_path}/a.oni gives 320 x 240 pixels, the rig says 640 x 480; "
        "set the rig's [sensor] to what `hangtime sensor play` says"
    )
    assert not list(tmp_path.glob("a.mcap*"))


@pytest.mark.parametrize("name", ["q2", "q2.oni", "q2.MCAP", ".mcap"])
def test_a_take_is_only_written_under_a_name_by_which_takes_are_found(tmp_path, name):
    write_descriptions(tmp_path)
    done = CliRunner().invoke(app, ["record", *words(tmp_path)[:-1], f"--out={tmp_path / name}"])
    assert isinstance(done.exception, OutputError)
    assert str(done.exception) == f"{tmp_path / name}: takes are written as MCAP; give a name that ends in .mcap"


@pytest.mark.parametrize("option", ["sensor", "rig", "garment"])
def test_a_recording_does_not_replace_what_it_reads(tmp_path, option):
    """Named by another way to the same file, and even where it is to be replaced."""
    write_descriptions(tmp_path)
    (tmp_path / "a.oni").write_bytes(b"raw")
    (tmp_path / "a.mcap").symlink_to(tmp_path / FILES[option])
    before = (tmp_path / FILES[option]).read_bytes()
    done = CliRunner().invoke(app, ["record", *words(tmp_path), "--overwrite"])
    assert isinstance(done.exception, OutputError)
    assert f"a.mcap: is what --{option} reads; give another name to --out" in str(done.exception)
    assert (tmp_path / "a.mcap").read_bytes() == before


@pytest.mark.openni
@pytest.mark.slow
def test_on_a_terminal_the_count_gives_way_to_what_is_said(good, tmp_path):
    """On a real terminal (a pty): what stays on each line is what was written after it was last cleared."""
    write_swing(tmp_path, [*good * 11, *nothing() * 7])
    ours, theirs = os.openpty()
    subprocess.run([*PROGRAM, *words(tmp_path)], stderr=theirs, stdout=subprocess.DEVNULL, check=True)
    os.close(theirs)
    written = b""
    with contextlib.suppress(OSError):  # how a terminal without a writer ends on Linux
        while part := os.read(ours, 4096):
            written += part
    os.close(ours)
    lines = written.decode().replace("\r\n", "\n").split("\n")
    assert any("40 of 47 frames, hanger seen in 82 %" in line for line in lines), lines
    assert [line.split("\x1b[K")[-1][:40] for line in lines] == [
        "   0.0 s  hanger and garment are seen", "   1.5 s  no markers are seen; show both mark"[:40], "",
    ]  # fmt: skip


@pytest.mark.openni
def test_a_take_goes_on_when_nobody_reads_what_is_said(good, tmp_path):
    """The pipe behind stderr is closed after its first line, as `head -n 1` does; the view goes bad after that."""
    write_swing(tmp_path, [*good * 11, *[(good[0][0], None)] * 20])
    with subprocess.Popen([*PROGRAM, *words(tmp_path)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert b"hanger and garment are seen" in process.stderr.readline()
        process.stderr.close()
        assert process.wait() == 0
    take = read_take(tmp_path / "a.mcap")
    assert take.is_complete
    assert len(take.time) == 53


@pytest.mark.openni
@pytest.mark.skipif(shutil.which("setsid") is None, reason="setsid of util-linux is not here")
@pytest.mark.parametrize(
    "what",
    ["a connection that drops", *(pytest.param(one, marks=pytest.mark.slow) for one in ("SIGTERM", "Ctrl-C twice"))],
)
def test_a_recording_that_is_asked_to_stop_ends_its_take_and_gives_the_lamp_back(good, tmp_path, what):
    """On a terminal of its own (a pty): when our end closes, the kernel sends SIGHUP, as when a connection drops.

    There are 201 frames, so that a busy machine does not come to their end before the signal. Tests that `nohup` or a
    shell's background runs ignore signals, and would hand that on.
    """
    write_swing(tmp_path, good * 67)
    lamp = make_lamp(tmp_path)
    leds = "import pathlib, firmware_host.lamp as lamp; lamp.StatusLamp.__init__.__defaults__ = (pathlib.Path('leds'),)"
    program = [sys.executable, "-c", f"{leds}; {PROGRAM[2]}", *PROGRAM[3:], *words(tmp_path), "--lamp=status"]
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        ["setsid", "--ctty", *program], stdin=theirs, stdout=theirs, stderr=theirs, cwd=tmp_path,
        preexec_fn=lambda: [signal.signal(one, signal.SIG_DFL) for one in (signal.SIGHUP, signal.SIGINT)],
    )  # fmt: skip
    os.close(theirs)
    said = b""
    while b"45 of 201 frames" not in said:
        said += os.read(ours, 4096)
    if what != "a connection that drops":
        if what == "SIGTERM":
            process.terminate()
        else:
            for _ in range(2):
                os.write(ours, b"\x03")  # the terminal makes SIGINT of it
        assert process.wait() == 0
        assert b"stopped early" in os.read(ours, 4096)
    os.close(ours)
    process.wait()
    take = read_take(tmp_path / "a.mcap")
    assert take.is_complete
    assert 15 <= len(take.time) < 201
    assert (lamp / "trigger").read_text() == "none"
    assert (lamp / "brightness").read_text() == "0"
    assert not (tmp_path / "a.mcap.partial").exists()


def test_of_two_signals_the_second_is_let_pass_and_what_was_ignored_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopped_like_ctrl_c():
            os.kill(os.getpid(), signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, before)


def write_swing(folder, pictures):
    """Write the command's files, with these pictures as the recording."""
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    write_descriptions(folder)
    with OniWriter(folder / "a.oni", CAMERA, depth_codec="NONE") as writer:
        for number, (depth, colour) in enumerate(pictures):
            writer.write_depth(1000 + 33_333 * number, depth)
            if colour is not None:
                writer.write_colour(2000 + 33_333 * number, colour)


def make_lamp(folder):
    lamp = folder / "leds/status"
    lamp.mkdir(parents=True)
    for file, value in LED.items():
        (lamp / file).write_text(value)
    return lamp


def write_descriptions(folder):
    gather_commands()
    (folder / "rig.toml").write_text(dump_description(RIG))
    (folder / "garment.toml").write_text(dump_description(GARMENT))


def words(folder):
    return [f"--{name}={folder / file}" for name, file in FILES.items()]
