"""`hangtime calibrate` on rendered scenes of known truth."""

from __future__ import annotations

import dataclasses
import re
import weakref

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from capture.calibration.accelerometer import gravity_of_readings
from capture.calibration.frames import MOST_KEPT, watch
from capture.calibration.measures import Estimate
from capture.calibration.report import lines
from capture.calibration.session import calibrate
from capture.depth.scale import DepthScale, depth_rig
from capture.errors import CalibrationError, UntrackableError
from capture.hanger.fiducial_tracker import MarkerTracker
from capture.hanger.marker_detection import MarkerDetector
from firmware_host.errors import UsbTimeoutError
from firmware_host.oni_writer import OniWriter
from firmware_host.usb_control.kinect_motor import KinectMotor
from formats.archive import read_take, write_take
from formats.command import app, gather_commands
from formats.descriptions import dump_description, load_rig
from formats.errors import OutputError
from formats.rig import Calibration, Hanger, Rig
from formats.summary import describe, summarise
from tests import openni2
from tests.capture.stage import CAMERA, LEVEL, StageSensor, camera_rotation, marker_plate, pictures, plain_plate
from tests.firmware_host.usb_stage.in_process import ModelLink
from tests.firmware_host.usb_stage.models import KinectMotorModel
from tests.formats.test_archive import a_take

HANGER = Hanger(
    dictionary="DICT_4X4_50", ids=(0, 1), marker_size_m=0.06, marker_distance_m=0.3,
    held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)),
)  # fmt: skip
RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0), hanger=HANGER)
HELD = np.array([[-0.195, 0.085, 0.004], [0.205, 0.088, -0.003]])  # m, where the clips of the drawn hanger hold
MIDDLE = np.array([0.1, -0.25, 1.6])
RIGHT = np.array([1.0, 0.0, 0.0])
HALF = 0.15 * RIGHT
TURN = camera_rotation(np.radians(6.0), np.radians(-2.0))
SCALE, SHIFT = 1.02, (3, -2)


def hanger_plates(middle=MIDDLE):
    return [marker_plate(0, middle - HALF), marker_plate(1, middle + HALF)]


def all_plates():
    clips = [marker_plate(i, MIDDLE + held + [0, 0.03, 0]) for i, held in zip((2, 3), HELD, strict=True)]
    return [*hanger_plates(), *clips, marker_plate(4, [-0.4, -0.3, 1.5]), marker_plate(5, [-0.4, 0.2, 1.5])]


@pytest.fixture(scope="module")
def frames():
    """Frames of a sensor pitched down by 6 degrees, rolled by 2; depth is 2 % too long and shifted by (3, -2) px."""
    rng = np.random.default_rng(1)
    return [pictures(all_plates(), rng, turn=TURN, scale=SCALE, shift=SHIFT) for _ in range(20)]


@pytest.fixture(scope="module")
def hanger_alone():
    """Fifteen frames of the hanger without plumb line and clips, before a sensor that shows all as it is."""
    rng = np.random.default_rng(2)
    return [pictures(hanger_plates(), rng) for _ in range(15)]


def calibrated(frames, rig=RIG, **options):
    chosen = {"plumb_ids": (4, 5), "clip_ids": (2, 3), "seconds": 5.0} | options
    return calibrate(StageSensor(frames), rig, **chosen)


@pytest.fixture(scope="module")
def measured(frames):
    return calibrated(frames)


def test_gravity_is_found_to_a_quarter_of_a_degree_and_within_3_of_its_deviations(measured):
    off = np.arccos(np.clip(measured.gravity.value @ TURN[:, 1], -1, 1))
    assert off < np.radians(0.25)
    assert off < 3 * measured.gravity.sd < np.radians(1.0)
    assert measured.rig.gravity == pytest.approx(TURN[:, 1], abs=5e-3)
    assert measured.rig.calibration.gravity_from == "plumb line"


def test_a_depth_two_per_cent_too_long_is_found_to_half_a_per_cent(measured):
    assert abs(measured.scale.value - SCALE) < min(0.005, 3 * measured.scale.sd)
    assert measured.scale.sd < 0.004


def test_depth_three_pixels_aside_is_found_to_a_third_of_a_pixel(measured):
    off = np.abs(measured.offset.value - SHIFT)
    assert (off < 0.33).all()
    assert (off < 3 * measured.offset.sd).all()


def test_held_ends_are_found_to_three_millimetres(measured):
    off = np.abs(measured.held.value - HELD)
    assert off.max() < 3e-3
    assert (off < 3 * measured.held.sd).all()
    assert np.array(measured.rig.hanger.held_m) == pytest.approx(measured.held.value, abs=1e-5)


def test_the_report_names_each_value_its_deviation_and_what_to_look_after(measured):
    said = "\n".join(lines(measured, RIG))
    assert "still         20 of 20 frames" in said
    assert re.search(r"from the plumb line; 6\.\d degrees from what the rig said, is the sensor that tilted\?", said)
    assert "measure that distance again" in said
    assert "px, right and down, depth against colour; recording allows for it" in said


def test_with_its_calibration_the_tracker_finds_the_positions_of_the_markers(frames, measured):
    """Without it they are 32 mm off: 2 % of 1.6 m."""

    def worst(rig):
        tracker, scaled = MarkerTracker(rig), DepthScale(rig.calibration.depth_scale if rig.calibration else 1.0)
        off = []
        for number, (depth, colour) in enumerate(frames[:8]):
            sight = tracker.track(colour, scaled(depth), number / 30)
            off.append(sight.positions - np.stack([TURN @ plate.at for plate in hanger_plates()]))
        return np.abs(np.mean(off, axis=0)).max()

    # What the scale is known to, 0.25 % of 1.6 m.
    assert worst(measured.rig) < 4e-3 + 1e-3
    assert worst(msgspec.structs.replace(measured.rig, calibration=None)) > 20e-3


def test_depth_is_looked_up_where_it_lies(measured):
    calibration = msgspec.structs.replace(measured.rig.calibration, depth_offset_px=(3.0, -2.0))
    moved = depth_rig(msgspec.structs.replace(measured.rig, calibration=calibration))
    assert (moved.sensor.cx, moved.sensor.cy) == (CAMERA.cx + 3, CAMERA.cy - 2)


def test_what_is_not_in_view_stays_as_it_was(hanger_alone):
    known = msgspec.structs.replace(RIG, gravity=(0.0, 0.8, 0.6))
    measured = calibrated(hanger_alone, known)
    assert measured.gravity is None
    assert measured.held is None
    assert (measured.rig.gravity, measured.rig.hanger) == (known.gravity, HANGER)
    assert measured.rig.sensor == CAMERA  # taken over, the rig had none
    assert measured.rig.calibration.gravity_sd_degrees is None
    assert measured.rig.calibration.depth_scale == pytest.approx(1.0, abs=0.005)
    said = "\n".join(lines(measured, known))
    assert "gravity       not measured: no plumb line" in said
    assert "measure that distance again" not in said


def test_an_offset_of_which_one_axis_was_seen_is_saved_and_the_other_kept_as_it_was(tmp_path):
    """Behind each plate a strip of its width goes on above and below: rows end on both sides, columns go on."""
    rng = np.random.default_rng(12)
    behind = np.array([0.0, 0.0, 0.002])
    strips = [plain_plate(plate.at + behind, (plate.size[0], 0.4), (90, 90, 90)) for plate in hanger_plates()]
    scene = [pictures([*strips, *hanger_plates()], rng, shift=SHIFT) for _ in range(15)]
    first = calibrated(scene)
    rig = first.rig
    assert rig.calibration.depth_offset_px[0] == pytest.approx(SHIFT[0], abs=0.4)
    assert rig.calibration.depth_offset_px[1] == 0.0
    assert rig.calibration.depth_offset_sd_px[0] < 0.4
    assert rig.calibration.depth_offset_sd_px[1] == np.inf
    (tmp_path / "rig.toml").write_text(dump_description(rig))
    assert load_rig(tmp_path / "rig.toml").calibration == rig.calibration
    said = "\n".join(lines(first, RIG))
    assert "down was not measured, since no plate ends on both sides along it" in said
    path = write_take(tmp_path / "a.mcap", dataclasses.replace(a_take(), rig=rig))
    assert "along the one axis that was measured" in describe(summarise(read_take(path)))
    before = Calibration(depth_offset_px=(1.0, -2.0), depth_offset_sd_px=(0.5, 0.25))
    again = calibrated(scene, msgspec.structs.replace(RIG, calibration=before)).rig.calibration
    assert (again.depth_offset_px[1], again.depth_offset_sd_px[1]) == (-2.0, 0.25)


def test_a_scene_that_moves_or_has_no_markers_is_refused():
    rng = np.random.default_rng(3)
    swung = [pictures(hanger_plates(MIDDLE + 0.004 * k * RIGHT), rng) for k in range(3)] * 5
    with pytest.raises(CalibrationError, match="nothing hung still for 15 frames"):
        calibrated(swung)
    with pytest.raises(CalibrationError, match="none of the markers 0, 1, 4, 5, 2, 3 was seen in 2 frames"):
        calibrated([pictures([], rng) for _ in range(2)])
    other = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(RIG.hanger, ids=(7, 8)))
    with pytest.raises(CalibrationError, match="was seen in 15 frames; markers 0 and 1 are seen: set the rig's hanger"):
        calibrated(swung, other)


def test_ids_that_are_used_twice_and_a_short_plumb_line_are_refused():
    with pytest.raises(UntrackableError, match="a marker id is used twice"):
        calibrated([], clip_ids=(1, 2))
    for wrong in (50, -1):
        with pytest.raises(UntrackableError, match=f"there is no marker {wrong} in DICT_4X4_50; give ids from 0 to 49"):
            calibrated([], clip_ids=(2, wrong))
    rng = np.random.default_rng(4)
    short = [*hanger_plates(), marker_plate(4, [-0.4, 0.0, 1.5]), marker_plate(5, [-0.4, 0.09, 1.5])]
    with pytest.raises(CalibrationError, match=r"markers are only \d\d mm apart"):
        calibrated([pictures(short, rng)] * 15)


def test_a_marker_distance_that_was_measured_wrong_is_reported(hanger_alone):
    """300 mm in the picture, 220 in the rig: a depth scale of 1.36 that no sensor has."""
    wrong = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, marker_distance_m=0.22))
    sensor = StageSensor(hanger_alone)
    with pytest.raises(CalibrationError, match=r"markers are (29\d|30\d) mm apart, the rig says 220"):
        calibrate(sensor, wrong, plumb_ids=(4, 5), clip_ids=(2, 3), seconds=5.0)


def test_frames_before_the_hanger_is_hung_up_do_not_count_as_still():
    rng = np.random.default_rng(8)
    empty, hung = pictures([], rng), pictures(hanger_plates(), rng)
    still = watch(StageSensor([empty] * 20 + [hung] * 16), MarkerDetector("DICT_4X4_50", (0, 1)), 5.0)
    assert (len(still.depth), still.seen) == (16, 36)
    assert np.isfinite(still.corners).all()


def test_an_accelerometer_that_does_not_answer_stops_only_who_asked_for_it(tmp_path, monkeypatch):
    def silent():
        raise UsbTimeoutError("no answer", where="Kinect", advice="replug it")

    sensor = StageSensor([pictures(hanger_plates(), np.random.default_rng(9))] * 15)
    live = dataclasses.replace(sensor.info, is_live=True)
    monkeypatch.setattr(StageSensor, "info", property(lambda self: live))
    monkeypatch.setattr("capture.calibration.accelerometer.connected_accelerometer", silent)
    monkeypatch.setattr("firmware_host.opening.open_sensor", lambda text, **_: sensor)
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    gather_commands()
    words = ["calibrate", "--sensor", "stage", "--rig", str(tmp_path / "rig.toml")]
    asked = CliRunner().invoke(app, [*words, "--accelerometer"])
    assert isinstance(asked.exception, UsbTimeoutError)
    sensor._next = 0
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.exception
    assert "without the accelerometer: Kinect: no answer" in done.output
    sensor._next = 0
    left_out = CliRunner().invoke(app, [*words, "--no-accelerometer"])
    assert left_out.exit_code == 0, left_out.exception
    assert "without the accelerometer" not in left_out.output


def test_the_command_takes_plumb_line_and_clips_to_be_the_markers_of_its_options(frames, tmp_path, monkeypatch):
    """Named the other way round, gravity points up, and the left end of the held edge is on the right.

    No rig is written of those, unless somebody asks for it: `record` would refuse it.
    """
    monkeypatch.setattr("firmware_host.opening.open_sensor", lambda text, **_: StageSensor(frames[:15]))
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    gather_commands()
    words = ["calibrate", "--sensor", "stage", "--rig", str(tmp_path / "rig.toml"), "--overwrite"]
    words += ["--out", str(tmp_path / "new.toml"), "--plumb-ids=5,4", "--clip-ids=3,2"]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code != 0
    assert "is the plumb line's first marker the upper one?" in refused.output
    assert not (tmp_path / "new.toml").exists()
    done = CliRunner().invoke(app, [*words, "--anyway"])
    assert done.exit_code == 0, done.exception
    rig = load_rig(tmp_path / "new.toml", anyway=True)
    assert rig.gravity == pytest.approx(-TURN[:, 1], abs=0.01)
    assert [end[0] for end in rig.hanger.held_m] == pytest.approx(HELD[::-1, 0], abs=0.02)


class Endless(StageSensor):
    """A live sensor whose clock advances by `step` [s] per frame; it counts the images that are still referenced."""

    def __init__(self, picture, step):
        super().__init__([picture])
        self.step, self.given, self.kept = step, [], 0

    def read(self, timeout_s=1.0):
        self._next = 0
        frame = super().read()
        depth = frame.depth.copy()
        self.kept = max(self.kept, sum(one() is not None for one in self.given))
        self.given.append(weakref.ref(depth))
        return dataclasses.replace(frame, time_s=100.0 + self.step * len(self.given), depth=depth)


@pytest.mark.parametrize(
    "step",
    [pytest.param(0.0, id="stands still", marks=pytest.mark.slow), pytest.param(-1 / 30, id="runs backwards")],
)
def test_a_clock_that_does_not_run_ends_after_twice_the_frames_that_are_due(step):
    """Two seconds of 30 frames are 60, twice that 120, and one is read to see that it is too much."""
    sensor = Endless(pictures(hanger_plates(), np.random.default_rng(3)), step)
    still = watch(sensor, MarkerDetector("DICT_4X4_50", (0, 1)), 2.0)
    assert len(sensor.given) == 121
    assert still.seen == 120
    assert len(still.depth) == len(still.corners) == MOST_KEPT == 90
    assert sensor.kept <= MOST_KEPT + 1  # and the newest


def test_the_accelerometer_gives_gravity_to_three_degrees_and_refuses_a_moved_sensor():
    model = KinectMotorModel()
    motor = KinectMotor(ModelLink(model))
    gravity = gravity_of_readings([motor.state() for _ in range(4)])
    assert gravity.value == pytest.approx((0, 0.866, -0.5), abs=1e-3)
    assert float(gravity.sd) == pytest.approx(np.radians(3.0), rel=1e-6)
    model.counts = (0, 1638, 0)
    with pytest.raises(CalibrationError, match="moved"):
        gravity_of_readings([motor.state()])


def test_gravity_from_the_accelerometer_is_used_where_there_is_no_plumb_line(hanger_alone):
    tilted = Estimate(np.array([0.0, 0.8, 0.6]), np.asarray(0.05))
    measured = calibrated(hanger_alone, accelerometer=tilted)
    assert measured.rig.gravity == (0.0, 0.8, 0.6)
    assert measured.rig.calibration.gravity_from == "accelerometer"
    assert measured.rig.calibration.gravity_sd_degrees == 2.9


def test_a_take_carries_the_calibration_and_shows_it(measured, tmp_path):
    take = msgspec.structs.replace(RIG, calibration=measured.rig.calibration)
    path = write_take(tmp_path / "a.mcap", dataclasses.replace(a_take(), rig=take))
    back = read_take(path)
    assert back.rig.calibration == measured.rig.calibration
    assert "calibrated gravity +- 0.27 degrees (plumb line); depth scale 1.0" in describe(summarise(back))


@pytest.mark.openni
def test_the_command_writes_a_rig_from_a_recording_and_replaces_none_unasked(frames, tmp_path):
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    with OniWriter(tmp_path / "a.oni", CAMERA, depth_codec="NONE") as writer:
        for number, (depth, colour) in enumerate(frames):
            writer.write_depth(1000 + 33_333 * number, depth)
            writer.write_colour(2000 + 33_333 * number, colour)
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    gather_commands()
    words = ["calibrate", "--sensor", str(tmp_path / "a.oni"), "--rig", str(tmp_path / "rig.toml")]
    done = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "new.toml")])
    assert done.exit_code == 0, done.output
    rig = load_rig(tmp_path / "new.toml", anyway=True)
    assert np.linalg.norm(rig.gravity - TURN[:, 1]) < np.radians(0.25)
    assert rig.calibration.depth_scale == pytest.approx(SCALE, abs=0.005)
    again = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "new.toml")])
    assert "is already there; give another name, or --overwrite" in str(again.exception)


def test_recording_replaces_neither_a_take_nor_what_an_interrupted_one_left(tmp_path):
    gather_commands()
    words = ["record", "--sensor", "synthetic:swing", "--rig", "r", "--garment", "g", "--out"]
    (tmp_path / "a.mcap").write_bytes(b"mine")
    (tmp_path / "b.mcap.partial").write_bytes(b"mine too")
    for name, sentence in (("a", "is already there"), ("b", "what an interrupted recording or import left")):
        done = CliRunner().invoke(app, [*words, str(tmp_path / f"{name}.mcap")])
        assert sentence in str(done.exception)
    assert (tmp_path / "a.mcap").read_bytes() == b"mine"
    replaced = CliRunner().invoke(app, [*words, str(tmp_path / "a.mcap"), "--overwrite"])
    assert "r: cannot be read" in str(replaced.exception)  # got past, to the rig that is not there


def test_a_level_camera_is_not_turned():
    assert camera_rotation(0.0, 0.0) == pytest.approx(LEVEL)


def test_the_recording_that_is_calibrated_from_is_not_replaced_by_the_rig(tmp_path):
    recording = tmp_path / "a.oni"
    recording.write_bytes(b"hours of work")
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    words = ["--sensor", str(recording), "--rig", str(tmp_path / "rig.toml"), "--out", str(recording), "--overwrite"]
    gather_commands()
    done = CliRunner().invoke(app, ["calibrate", *words])
    assert isinstance(done.exception, OutputError)
    assert "is what --sensor reads" in str(done.exception)
    assert recording.read_bytes() == b"hours of work"
