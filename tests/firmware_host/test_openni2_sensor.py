"""Recordings and devices through the real OpenNI2 library, and a live device that stalls through a stand-in."""

from __future__ import annotations

import ctypes
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware_host import openni2_library
from firmware_host.errors import RecordingError, SensorStalledError, SensorUnavailableError
from firmware_host.oni_records import NodeType, PixelFormat, RecordType, read_records
from firmware_host.oni_writer import PIXEL_FORMATS, OniWriter
from firmware_host.opening import open_sensor
from firmware_host.openni2_sensor import OpenNI2Sensor
from formats.command import app, gather_commands
from tests.firmware_host.scenes import PERIOD_US, SMALL, AnyStamps, payload_of, picture, write_pictures, write_recording
from tests.shared_data import SHARED_DATA

KINECT_ROOM = SHARED_DATA / "oni" / "kinect-room.oni"


@pytest.fixture(scope="module")
def command() -> CliRunner:
    gather_commands()
    return CliRunner()


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
@pytest.mark.parametrize("codec", ["16zT", "NONE"])
def test_the_library_plays_every_byte_and_microsecond_that_was_written(tmp_path: Path, codec: str) -> None:
    with OpenNI2Sensor(write_recording(tmp_path / "a.oni", 8, depth_codec=codec)) as sensor:
        frames = list(sensor.frames())
    assert len(frames) == 8
    for number, frame in enumerate(frames):
        depth, colour = picture(number)
        np.testing.assert_array_equal(frame.depth, depth)
        np.testing.assert_array_equal(frame.colour, colour)
        assert round(frame.time_s * 1e6) == 1000 + number * PERIOD_US


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_the_written_field_of_view_gives_the_focal_length_back(tmp_path: Path) -> None:
    with OpenNI2Sensor(write_recording(tmp_path / "a.oni", 2)) as sensor:
        assert sensor.info.intrinsics.fx == pytest.approx(57.58, rel=1e-5)
        assert sensor.info.intrinsics.fy == pytest.approx(57.58, rel=1e-5)
        assert sensor.info.notes == ()


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_that_lost_power_plays_all_but_its_last_whole_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL) as writer:
        for number in range(6):
            depth, colour = picture(number)
            writer.write_depth(1000 + number * PERIOD_US, depth)
            writer.write_colour(2000 + number * PERIOD_US, colour)
        writer._file.flush()
        unfinished = path.read_bytes()
    path.write_bytes(unfinished[:-100])  # the sixth colour frame is cut
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
        assert sensor.info.notes == ("the recording was interrupted; its last frame is left out",)
    assert len(frames) == 5
    np.testing.assert_array_equal(frames[-1].depth, picture(4)[0])
    np.testing.assert_array_equal(frames[-1].colour, picture(4)[1])


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_finished_recording_cut_by_a_broken_copy_is_refused(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    last = [r for r in read_records(path) if r.type == RecordType.NEW_DATA][-2]
    size = payload_of(last).start + 10
    path.write_bytes(path.read_bytes()[:size])
    told = f"the recording is cut off at byte {size}, after 5 depth frames; copy the recording again from its source"
    with pytest.raises(RecordingError, match=told):
        OpenNI2Sensor(path)


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
@pytest.mark.parametrize(
    ("kind", "pixels", "sentence"),
    [
        (NodeType.IMAGE, PixelFormat.YUV422, "its colour comes as YUV422"),
        (NodeType.IMAGE, PixelFormat.GRAY8, "its colour comes as GRAY8"),
        (NodeType.DEPTH, PixelFormat.SHIFT_9_2, "its depth comes as SHIFT_9_2"),
        (NodeType.DEPTH, 77, "its depth comes as pixel format 77"),
    ],
)
def test_pictures_that_cannot_be_read_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: NodeType, pixels: int, sentence: str
) -> None:
    monkeypatch.setitem(PIXEL_FORMATS, kind, (pixels, PIXEL_FORMATS[kind][1]))
    path = write_recording(tmp_path / "a.oni", 2)
    with pytest.raises(RecordingError, match=f"a.oni: {sentence}, which Hangtime cannot read; record depth as"):
        OpenNI2Sensor(path)


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_that_says_zero_frames_a_second_is_refused(tmp_path: Path) -> None:
    """Its xnMapOutputMode: name and 0, size of 4 bytes, width and height of 4 each, then frames a second."""
    path = write_recording(tmp_path / "a.oni", 2)
    raw, name = path.read_bytes(), b"xnMapOutputMode\0"
    at = raw.index(name) + len(name) + 4 + 8
    assert raw[at : at + 4] == (30).to_bytes(4, "little")
    path.write_bytes(raw[:at] + bytes(4) + raw[at + 4 :])
    with pytest.raises(RecordingError, match=r"a\.oni: says that its depth comes at 0 frames a second; copy"):
        OpenNI2Sensor(path)


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
@pytest.mark.parametrize("view", [0.0, float("nan"), 4.0])
def test_a_field_of_view_that_is_no_angle_is_unknown(tmp_path: Path, view: float) -> None:
    """Its xnFOV: name and 0, size of 16 bytes, two double numbers."""
    path = write_recording(tmp_path / "a.oni", 2)
    raw, name = path.read_bytes(), b"xnFOV\0"
    at = raw.index(name) + len(name) + 4
    path.write_bytes(raw[:at] + struct.pack("<2d", view, view) + raw[at + 16 :])
    with OpenNI2Sensor(path) as sensor:
        assert sensor.info.notes[0].startswith("field of view unknown")
        assert sensor.info.intrinsics.fx == pytest.approx(0.9 * sensor.info.width, rel=0.01)


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_depth_in_tenths_of_a_millimetre_is_rounded_to_whole_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PIXEL_FORMATS, NodeType.DEPTH, (PixelFormat.DEPTH_100_UM, 4))
    path = tmp_path / "a.oni"
    depth = np.zeros((48, 64), np.uint16)
    depth[0, :6] = [1, 4, 15_994, 15_995, 65_530, 65_535]
    with OniWriter(path, SMALL, with_colour=False) as writer:
        writer.write_depth(33_000, depth)
        writer.write_depth(66_000, depth)
    with OpenNI2Sensor(path) as sensor:
        frame = sensor.read()
    assert frame is not None
    assert frame.depth.dtype == np.uint16
    assert frame.depth[0, :7].tolist() == [1, 1, 1599, 1600, 6553, 6554, 0]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_forty_recordings_are_played_to_their_end_and_closed_without_a_crash(tmp_path: Path) -> None:
    # Played without a loop, one close in about 60 ended the process.
    path = write_recording(tmp_path / "a.oni", 3)
    for _ in range(40):
        with OpenNI2Sensor(path) as sensor:
            assert len(list(sensor.frames())) == 3


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_colour_twelve_milliseconds_late_is_paired_with_its_own_depth(tmp_path: Path) -> None:
    # 11.7 ms is what a Kinect's recording has between its streams; half a frame is 16.7 ms.
    with OpenNI2Sensor(write_recording(tmp_path / "a.oni", 5, colour_delay_us=11_700)) as sensor:
        frames = list(sensor.frames())
        assert len(frames) == 5
        for number, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.colour, picture(number)[1])
            assert frame.colour_late_s == pytest.approx(0.0117, abs=1e-9)


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_depth_frame_without_colour_nearby_has_none(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL) as writer:
        for number in range(6):
            depth, colour = picture(number)
            writer.write_depth(1000 + number * PERIOD_US, depth)
            if number != 3:
                writer.write_colour(2000 + number * PERIOD_US, colour)
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
    assert [frame.colour is None for frame in frames] == [False, False, False, True, False, False]
    np.testing.assert_array_equal(frames[4].colour, picture(4)[1])


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
@pytest.mark.parametrize(
    ("leap", "colour_leaps_at", "without_colour"),
    [
        pytest.param(-4_000_000, 20, set(), id="set back"),
        pytest.param(-4_000_000, 19, {19}, id="colour set back first"),
        pytest.param(-4_000_000, 21, {20}, id="depth set back first"),
        pytest.param(3_600_000_000, 20, set(), id="set forward by an hour"),
        pytest.param(3_600_000_000, 19, {19}, id="colour set forward first"),
    ],
)
@pytest.mark.parametrize("delay", [2_000, 20_000])
def test_colour_comes_back_after_the_clock_was_set(
    tmp_path: Path, leap: int, colour_leaps_at: int, without_colour: set[int], delay: int
) -> None:
    """From frame 20 on depth's stamps jump, and colour's at about that time, 2 or 20 ms after depth's.

    20 ms are more than half a frame: then the colour frame before is the nearest, and one always waits.
    """
    path = tmp_path / "a.oni"
    with AnyStamps(path, SMALL) as writer:
        write_pictures(
            writer, 60, lambda k: 5_000_000 + k * PERIOD_US + leap * (k >= 20),
            lambda k: 5_000_000 + k * PERIOD_US + delay + leap * (k >= colour_leaps_at),
        )  # fmt: skip
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
    assert len(frames) == 60
    late = int(delay > PERIOD_US / 2)
    missing = {frame.index for frame in frames if frame.colour is None}
    if not late:
        assert missing == without_colour
    assert missing <= {0, 19, 20, 21}
    for frame in frames[25:]:
        np.testing.assert_array_equal(frame.colour, picture(frame.index - late)[1])


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_one_colour_frame_with_a_stamp_an_hour_ahead_costs_a_second_of_colour(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with AnyStamps(path, SMALL) as writer:
        write_pictures(
            writer, 60, lambda k: 1000 + k * PERIOD_US,
            lambda k: 1000 + k * PERIOD_US + 3_600_000_000 * (k == 10),
        )  # fmt: skip
    with OpenNI2Sensor(path) as sensor:
        missing = {frame.index for frame in sensor.frames() if frame.colour is None}
    assert missing == set(range(10, 41))


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_of_depth_alone_plays_without_colour(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL, with_colour=False) as writer:
        for number in range(3):
            writer.write_depth(1000 + number * PERIOD_US, picture(number)[0])
    with OpenNI2Sensor(path) as sensor:
        assert [frame.colour for frame in sensor.frames()] == [None, None, None]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
@pytest.mark.skipif(Path("/dev/bus/usb").exists(), reason="a sensor may be connected")
def test_a_recording_played_before_is_not_mistaken_for_a_live_device(tmp_path: Path) -> None:
    open_sensor(str(write_recording(tmp_path / "a.oni", 2))).close()
    with pytest.raises(SensorUnavailableError, match="no depth sensor is connected; plug it in"):
        open_sensor("openni2:")


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_playing_prints_frames_rate_and_size(command: CliRunner, tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 7)
    result = command.invoke(app, ["sensor", "play", str(path)])
    assert result.exit_code == 0, result.output
    assert "64 x 48" in result.output
    assert "for rig.toml: fx = 57.6, fy = 57.6, cx = 31.5, cy = 23.5" in result.output
    assert "7 frames" in result.output
    assert "30.0 a second" in result.output


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_playing_stops_after_the_frames_asked_for(command: CliRunner, tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 7)
    result = command.invoke(app, ["sensor", "play", str(path), "--max-frames", "3"])
    assert result.exit_code == 0, result.output
    assert "3 frames" in result.output


@pytest.mark.openni
@pytest.mark.shared_data
@pytest.mark.usefixtures("openni")
@pytest.mark.skipif(not KINECT_ROOM.exists(), reason=f"no real recording at {KINECT_ROOM}")
def test_a_real_kinect_recording_plays_its_twelve_frames_and_stops() -> None:
    with open_sensor(str(KINECT_ROOM)) as sensor:
        info, frames = sensor.info, list(sensor.frames())
    assert (info.width, info.height, len(frames)) == (640, 480, 12)
    assert all(frame.colour is not None for frame in frames)
    # A room, mostly measured, at room-like distances.
    depth = frames[5].depth
    assert 0.6 < (depth > 0).mean() < 0.95
    assert 500 < float(depth[depth > 0].mean()) < 5000


class StandInStream:
    """A live stream that has some frames and then falls silent."""

    def __init__(self, frames: int, image: np.ndarray) -> None:
        self.left, self.image, self.count, self.pixels = frames, np.ascontiguousarray(image), 0, 100

    def get_video_mode(self) -> Any:
        return SimpleNamespace(resolutionX=64, resolutionY=48, fps=30, pixelFormat=ctypes.c_int(self.pixels))

    def get_horizontal_fov(self) -> float:
        return 1.0

    get_vertical_fov = get_horizontal_fov

    def start(self) -> None: ...

    stop = close = start

    def set_video_mode(self, mode: Any) -> None:
        self.asked_for = mode

    def set_mirroring_enabled(self, is_on: bool) -> None:
        raise RuntimeError("not supported")

    def read_frame(self) -> Any:
        self.left, self.count = self.left - 1, self.count + 1
        # The device counted a frame between the second and the third that never arrived.
        index = self.count + (self.count > 2)
        return SimpleNamespace(
            frameIndex=index, timestamp=index * PERIOD_US, height=48, width=64,
            get_buffer_as_uint8=lambda: bytearray(self.image.tobytes()), close=lambda: None,
        )  # fmt: skip


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> StandInStream:
    """Replace the binding by one with a single live depth stream of three frames."""
    stream = StandInStream(3, picture(0)[0])
    device = SimpleNamespace(
        playback=None, create_depth_stream=lambda: stream, create_color_stream=lambda: None, close=lambda: None,
        get_device_info=lambda: SimpleNamespace(name=b"stand-in", uri=b"1d27/0600"),
    )  # fmt: skip

    class Device:
        def __new__(cls, uri: bytes) -> Any:
            return device

        enumerate_uris = staticmethod(lambda: [b"/tmp/old.oni", b"1d27/0600"])

    binding = SimpleNamespace(
        Device=Device,
        OpenNIError=RuntimeError,
        wait_for_any_stream=lambda streams, timeout: streams[0] if streams[0].left > 0 else None,
    )
    monkeypatch.setattr(openni2_library, "load", lambda: binding)
    return stream


def test_a_live_device_that_falls_silent_is_an_error_each_time_not_an_end(stand_in: StandInStream) -> None:
    with OpenNI2Sensor() as sensor:
        assert sensor.info.is_live
        mode = stand_in.asked_for
        assert (mode.resolutionX, mode.resolutionY, mode.fps, mode.pixelFormat) == (640, 480, 30, 100)
        frames = [sensor.read() for _ in range(3)]
        for _ in range(2):
            with pytest.raises(SensorStalledError, match=r"no frame for 0\.5 s; unplug"):
                sensor.read(0.5)
        stand_in.left = 1
        assert sensor.read() is not None
    assert [frame.dropped_before for frame in frames if frame is not None] == [0, 0, 1]


def test_a_live_device_that_keeps_to_shifts_is_refused(stand_in: StandInStream) -> None:
    stand_in.pixels = 102
    with pytest.raises(SensorUnavailableError, match="1d27/0600: its depth comes as SHIFT_9_2"):
        OpenNI2Sensor()


def test_a_closed_sensor_gives_no_more_frames(stand_in: StandInStream) -> None:
    sensor = OpenNI2Sensor()
    assert sensor.read() is not None
    sensor.close()
    assert sensor.read() is None
