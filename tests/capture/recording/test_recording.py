"""Recording of takes from a sensor, compared with the truth of the synthetic world."""

from __future__ import annotations

import contextlib
import resource
import time

import cv2
import numpy as np
import pytest

from capture.errors import NoMarkersError, UntrackableError
from capture.recording.frame_reader import ScanPlan
from capture.recording.session import record
from firmware_host.depth_sensor import DepthSensor, SensorFrame
from firmware_host.synthetic.scene import CAMERA, MARKER_BITS, RIG, demo_garment
from firmware_host.synthetic.sensor import SyntheticSensor
from firmware_host.synthetic.world import FIRST_STAMP, make_world
from formats.archive import read_take
from formats.errors import HangtimeError, OutputError
from formats.take import FrameState


@pytest.fixture(scope="module")
def world():
    """Of 2.6 s: still, swung, stopped. The simulated cloth is coarse, which a drawn one does not show."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("ROWS", "COLUMNS"):
            patch.setattr(f"firmware_host.synthetic.world.{name}", 7)
        return make_world(motion="swing", effect="air_drag", amplitude=None, seconds=2.6, seed=3)


DRAWN = 3  # every third frame, ten a second, is drawn, once for all tests


@pytest.fixture(scope="module")
def drawn(world):
    renderer = world.renderer()
    pictures = {number: world.frame(number, renderer) for number in range(0, len(world.time), DRAWN)}
    return SyntheticSensor(world, "test").info, [
        SensorFrame(
            index=number, time_s=float(world.time[number]) + FIRST_STAMP, host_time_s=0.0, depth=depth, colour=colour
        )
        for number, (depth, colour) in pictures.items()
    ]


class Every(DepthSensor):
    """A faulty sensor: every n-th frame of a world, n a multiple of three, changed by a function."""

    def __init__(self, drawn, step, change=lambda frame: frame):
        self._info, frames = drawn
        self._frames, self._change = iter(frames[:: step // DRAWN]), change

    @property
    def info(self):
        return self._info

    def read(self, timeout_s=1.0):
        frame = next(self._frames, None)
        return None if frame is None else self._change(changed(frame, host_time_s=time.monotonic()))

    def close(self):
        self._frames = iter(())


def changed(frame, **changes):
    fields = {
        name: getattr(frame, name) for name in ("index", "time_s", "host_time_s", "depth", "colour", "dropped_before")
    }
    return SensorFrame(**(fields | changes))


def recorded(sensor, path, **options):
    return record(sensor, RIG, demo_garment(), path, take_id="t", created="2026-01-01T00:00:00Z", **options)


@pytest.fixture(scope="module")
def take(drawn, tmp_path_factory):
    path = tmp_path_factory.mktemp("take") / "t.mcap"
    with Every(drawn, 3) as sensor:
        recorded(sensor, path)
    return read_take(path)


def errors_mm(take, world, seen, truth):
    frames = np.searchsorted(world.time + FIRST_STAMP, take.time - 1e-5)
    return 1e3 * np.linalg.norm(seen - truth[frames], axis=-1)


def test_every_frame_shows_the_hanger(take):
    assert take.held_valid.all()
    assert (take.state == 0).all()


def test_markers_are_placed_to_two_millimetres_still_and_five_moving(take, world):
    apart = errors_mm(take, world, take.markers, world.hanger.markers)
    still = take.time < 0.9
    assert np.sqrt((apart[still] ** 2).mean()) < 2.0
    assert np.sqrt((apart[~still] ** 2).mean()) < 5.0


def test_corners_are_placed_to_eight_millimetres_in_the_median(take, world):
    assert np.nanmedian(errors_mm(take, world, take.points, world.points)[:, :4]) < 8.0


def test_the_centre_is_placed_to_nine_millimetres_on_average(take, world):
    """The paper reports 19 mm."""
    assert np.nanmean(errors_mm(take, world, take.points, world.points)[:, 4]) < 9.0


def test_points_are_seen_in_nearly_every_frame(take):
    assert take.points_valid.mean() > 0.95


def test_the_worlds_markers_are_opencvs():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for marker, bits in MARKER_BITS.items():
        picture = cv2.aruco.generateImageMarker(dictionary, marker, 6)
        assert np.array_equal(picture[1:5, 1:5] > 127, np.array(bits) > 0)


def test_a_recording_without_markers_leaves_no_take(drawn, tmp_path):
    with (
        Every(drawn, 15, lambda f: changed(f, colour=np.full_like(f.colour, 90))) as sensor,
        pytest.raises(NoMarkersError, match="seen together in 0 of 6 frames"),
    ):
        recorded(sensor, tmp_path / "t.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_what_was_recorded_until_then(drawn, tmp_path):
    """Ten frames a second, no room left after the 15th: the block of a second before can be read."""
    partial = tmp_path / "t.mcap.partial"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(frames, total, seen):
        if frames == 15:
            resource.setrlimit(resource.RLIMIT_FSIZE, (partial.stat().st_size, limits[1]))

    try:
        with Every(drawn, 3) as sensor, pytest.raises(OutputError, match=r"partial: .* `hangtime takes show`"):
            recorded(sensor, tmp_path / "t.mcap", progress=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    take = read_take(partial)
    assert 10 <= len(take.time) <= 15
    assert take.held_valid.all()


@pytest.mark.parametrize(("shown", "is_kept"), [(9, False), (10, True)])
def test_a_full_disk_keeps_a_part_that_shows_the_hanger_in_ten_frames(drawn, tmp_path, shown, is_kept):
    partial = tmp_path / "t.mcap.partial"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def hidden(frame):
        seen = frame.index < DRAWN * shown
        return frame if seen else changed(frame, colour=np.full_like(frame.colour, 128))

    def fill(frames, total, seen):
        if frames == 15:
            resource.setrlimit(resource.RLIMIT_FSIZE, (partial.stat().st_size, limits[1]))

    try:
        with Every(drawn, 3, hidden) as sensor, pytest.raises(OutputError, match="writing failed"):
            recorded(sensor, tmp_path / "t.mcap", progress=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert partial.exists() == is_kept


def test_a_disk_that_is_nearly_full_ends_the_take_whole(drawn, tmp_path, monkeypatch):
    """Ten frames a second; from the 12th on, all the disk's room is too little; the room is checked every second."""

    def fill(frames, total, seen):
        if frames == 12:
            monkeypatch.setattr("capture.recording.session.LEAST_ROOM", 1 << 62)

    with Every(drawn, 3) as sensor:
        report = recorded(sensor, tmp_path / "t.mcap", progress=fill)
    assert isinstance(report.failure, OutputError)
    assert "MB are left on the disk" in str(report.failure)
    take = read_take(tmp_path / "t.mcap")
    assert take.is_complete
    assert 12 <= len(take.time) == report.frames <= 23


def test_an_error_in_a_frame_keeps_the_frames_before_it(drawn, tmp_path):
    def fail(frame):
        if frame.index == 60:
            raise RuntimeError("a bug")
        return frame

    with Every(drawn, 3, fail) as sensor, pytest.raises(RuntimeError, match="a bug") as raised:
        recorded(sensor, tmp_path / "t.mcap")
    assert "t.mcap.partial: recording broke off" in raised.value.__notes__[0]
    assert len(read_take(tmp_path / "t.mcap.partial").time) >= 11


def test_who_watches_and_fails_does_not_count_as_a_disk_fault(drawn, tmp_path):
    def fail(frames, total, seen):
        if frames == 15:
            raise BrokenPipeError("nobody reads")

    with Every(drawn, 3) as sensor, pytest.raises(BrokenPipeError, match="nobody reads") as raised:
        recorded(sensor, tmp_path / "t.mcap", progress=fail)
    assert "t.mcap.partial: recording broke off" in raised.value.__notes__[0]


def test_a_folder_that_goes_away_ends_the_recording_with_its_name(drawn, tmp_path):
    (tmp_path / "disk").mkdir()

    def take_away(frames, total, seen):
        if frames == 15:
            (tmp_path / "disk").rename(tmp_path / "elsewhere")

    with Every(drawn, 3) as sensor, pytest.raises(OutputError, match="the take could not be finished"):
        recorded(sensor, tmp_path / "disk/t.mcap", progress=take_away)


def test_a_take_that_has_come_there_meanwhile_stays_and_this_one_is_kept_beside_it(drawn, tmp_path):
    path = tmp_path / "t.mcap"

    def comes(frame):
        path.write_bytes(b"another take")
        return frame

    with Every(drawn, 3, comes) as sensor, pytest.raises(OutputError, match="has come there meanwhile") as caught:
        recorded(sensor, path, overwrite=False)
    assert "t.mcap.partial" in caught.value.advice
    assert path.read_bytes() == b"another take"
    assert len(read_take(tmp_path / "t.mcap.partial").time) > 20
    with Every(drawn, 18) as sensor, pytest.raises(OutputError, match="is already there"):
        recorded(sensor, path, overwrite=False)


def test_the_file_that_an_interrupted_recording_left_is_put_aside_and_named(drawn, tmp_path):
    partial, told = tmp_path / "t.mcap.partial", []
    partial.write_bytes(b"mine")
    with Every(drawn, 15) as sensor, contextlib.suppress(HangtimeError):  # so few frames are no take
        recorded(sensor, tmp_path / "t.mcap", tell_aside=lambda *names: told.append(names))
    assert told == [(partial, tmp_path / "t.left-1.mcap.partial")]
    assert told[0][1].read_bytes() == b"mine"


def test_a_folder_is_not_replaced_by_a_take(drawn, tmp_path):
    with Every(drawn, 15) as sensor, pytest.raises(OutputError, match="is a folder"):
        recorded(sensor, tmp_path)


def test_lost_depth_lost_colour_and_a_clock_that_jumps_are_reported_frame_by_frame(drawn, tmp_path):
    def spoil(frame):
        if frame.index == 30:
            return changed(frame, depth=np.zeros_like(frame.depth))
        if frame.index == 36:
            return changed(frame, colour=None)
        if frame.index == 42:
            return changed(frame, time_s=0.5)
        return frame

    with Every(drawn, 6, spoil) as sensor:
        recorded(sensor, tmp_path / "t.mcap")
    take = read_take(tmp_path / "t.mcap")
    state = {round(30 * (t - FIRST_STAMP)): s for t, s in zip(take.time, take.state, strict=True)}
    assert state[30] & FrameState.DEPTH_MISSING
    assert state[36] & FrameState.COLOUR_MISSING
    assert 42 not in state
    assert state[48] & FrameState.CLOCK_JUMPED
    assert not take.points_valid[list(state).index(30)].any()


def test_a_person_in_front_costs_quality_and_delays_a_scan(drawn, tmp_path):
    def spoil(frame):
        if frame.index == 30:  # from below the markers down
            depth = frame.depth.copy()
            depth[175:] = 800
            return changed(frame, depth=depth)
        if frame.index == 42:  # a sensor blind below 0.5 m, with everything nearer than that
            return changed(frame, depth=np.zeros_like(frame.depth))
        return frame

    with Every(drawn, 6, spoil) as sensor:
        recorded(sensor, tmp_path / "t.mcap", scans=ScanPlan(rate=2.5, grid=6, contour=24))
    take = read_take(tmp_path / "t.mcap")
    number = np.rint(30 * (take.time - FIRST_STAMP)).astype(int)
    covered = int(np.flatnonzero(number == 30)[0])
    assert take.state[covered] == FrameState.VIEW_BLOCKED | FrameState.GARMENT_LOST
    assert take.quality[covered] == 0.0
    blind = int(np.flatnonzero(number == 42)[0])
    assert take.state[blind] & FrameState.DEPTH_MISSING
    others = np.setdiff1d(np.arange(len(number)), [covered, blind])
    assert (take.state[others] == 0).all()
    assert np.median(take.quality[others]) > 0.7
    # Frames come at 5 a second, so that 2.5 scans a second are every other one; a lost garment delays one.
    assert [round(30 * (scan.time - FIRST_STAMP)) for scan in take.scans][:4] == [0, 12, 24, 36]
    assert take.scans[0].grid.shape == (6, 6, 3)
    assert np.isfinite(take.scans[0].contour).all(1).mean() > 0.9


def test_a_sensor_of_another_size_than_the_rig_says_is_refused(drawn, tmp_path):
    import msgspec

    small = msgspec.structs.replace(RIG, sensor=msgspec.structs.replace(CAMERA, width=320, height=240))
    with Every(drawn, 15) as sensor, pytest.raises(UntrackableError, match="640 x 480 pixels, the rig says 320 x 240"):
        record(sensor, small, demo_garment(), tmp_path / "t.mcap", take_id="t", created="now")
