"""The errors of a recording without markers, of a full disk and of another sensor, by prescribed counts."""

from __future__ import annotations

import dataclasses
import threading
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from capture.errors import HangerGapError, NoMarkersError, UnfitTakeError, UntrackableError
from capture.recording import session
from capture.recording.condition import Condition
from capture.recording.frame_queue import QueuedSensor
from capture.recording.tally import Tally
from firmware_host.depth_sensor import SensorFrame
from formats.findings import Finding
from tests.capture.garment.towel import HANGER
from tests.capture.garment.towel_scenes import RIG
from tests.capture.hanger.test_colour_dots import RIG as DOTS
from tests.capture.stage import StageSensor, marker_plate, pictures

STATED = "markers 0 and 1 of DICT_4X4_50, 60 mm, 300 mm apart"


def counted(condition, frames=12, with_hanger=2):
    tally = Tally(4)
    tally.frames, tally.with_hanger = frames, with_hanger
    for k in range(frames):
        tally.conditions.add(k / 30, condition)
    return tally


def seen(numbers=(0, 1), dictionary="DICT_4X4_50"):
    """A frame with two markers on a wall, 0.3 m apart and 1.6 m away."""
    plates = [
        marker_plate(number, [x, 0.0, 1.6], dictionary=dictionary)
        for number, x in zip(numbers, (-0.15, 0.15), strict=True)
    ]
    depth, colour = pictures(plates, np.random.default_rng(3))
    return SensorFrame(index=0, time_s=0.0, host_time_s=0.0, depth=depth, colour=colour)


@pytest.mark.parametrize(
    ("condition", "kept", "said"),
    [
        (
            Condition.TOO_FAR, False,
            "t.mcap: both hanger markers were seen together in 2 of 12 frames; no take was kept, mostly because: too "
            "far; come closer until the hanger is 1.2 to 2.5 m away",
        ),
        (
            Condition.TOO_FAR, True,
            "t.mcap: both hanger markers were seen together in 2 of 12 frames; the take was kept, but nothing can be "
            "fitted to it, mostly because: too far; record it again: come closer until the hanger is 1.2 to 2.5 m away",
        ),
        (
            Condition.GOOD, False,
            "t.mcap: both hanger markers were seen together in 2 of 12 frames; no take was kept; record longer",
        ),
        (
            Condition.ONE_MARKER, False,
            "t.mcap: both hanger markers were seen together in 2 of 12 frames; no take was kept; turn the hanger so "
            f"that both markers face the sensor (the rig says {STATED})",
        ),
    ],
)  # fmt: skip
def test_a_take_without_markers_says_what_was_mostly_seen_and_what_to_do(condition, kept, said):
    assert str(session._no_markers("t.mcap", RIG, counted(condition), kept=kept)) == said


@pytest.mark.parametrize(("condition", "is_sought"), [(Condition.NO_MARKERS, True), (Condition.ONE_MARKER, False)])
def test_other_markers_are_sought_only_where_none_was_seen(condition, is_sought):
    error = session._no_markers("t.mcap", RIG, counted(condition), frame=seen((5, 6)))
    assert error.advice.startswith(f"the rig says {STATED}; ") is is_sought
    assert ("markers 5 and 6 are seen" in error.advice) is is_sought


def test_depth_in_another_unit_is_said_before_other_markers_are_sought():
    """Metres times 10: 16 m away."""
    frame = seen()
    far = dataclasses.replace(frame, depth=(10 * frame.depth.astype(np.uint32)).clip(0, 65535).astype(np.uint16))
    advice = session._no_markers("t.mcap", RIG, counted(Condition.NO_MARKERS), frame=far).advice
    assert advice.startswith(f"the rig says {STATED}; depth ")


def test_markers_and_dots_of_a_rig_are_stated_in_millimetres():
    assert session._markers_of(HANGER) == STATED
    dots = DOTS.hanger
    assert session._markers_of(dots) == (
        f"two dots of {1000 * dots.marker_size_m:g} mm, {1000 * dots.marker_distance_m:g} mm apart"
    )


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("hanger_hardly_seen", NoMarkersError),
        ("hanger_lost", HangerGapError),
        ("jumps", UnfitTakeError),
        ("too_short", UnfitTakeError),
    ],
)
def test_only_a_grave_first_finding_is_a_doubt_and_each_has_its_error(name, kind):
    grave = Finding(name=name, words="it is so", advice="do this", is_grave=True)
    slight = dataclasses.replace(grave, is_grave=False)
    tally = counted(Condition.GOOD)
    assert session._doubt("t.mcap", RIG, tally, ()) is None
    assert session._doubt("t.mcap", RIG, tally, (slight, grave)) is None
    error = session._doubt("t.mcap", RIG, tally, (grave, slight))
    assert type(error) is kind
    assert "the take was kept, but nothing can be fitted to it" in str(error)
    assert ("nothing can be fitted to it by itself;" in str(error)) == (name == "too_short")
    if kind is not NoMarkersError:
        assert str(error).startswith("t.mcap: it is so; the take was kept")
        assert error.advice == "do this"


@pytest.mark.parametrize(("free", "is_enough"), [(8_000_000, True), (7_999_999, False)])
def test_a_take_ends_below_eight_megabytes(tmp_path, monkeypatch, free, is_enough):
    monkeypatch.setattr(session.shutil, "disk_usage", lambda folder: SimpleNamespace(free=free))
    error = session._lack_of_room(tmp_path / "t.mcap")
    assert (error is None) is is_enough
    assert is_enough or "only 8.0 MB are left" in error.what
    assert is_enough or "make room for 8 MB or more" in error.advice


@pytest.mark.parametrize("part", ["hanger", "sensor"])
def test_a_rig_without_hanger_or_sensor_records_nothing(part):
    with pytest.raises(UntrackableError, match=r"bench: the rig has no \[sensor\] or no \[hanger\]; add it"):
        session.check_sensor(StageSensor([]).info, msgspec.structs.replace(RIG, **{part: None}), "bench")


@pytest.mark.parametrize(("width", "height"), [(320, 480), (640, 240)])
def test_a_sensor_of_another_width_or_height_is_refused(width, height):
    info = dataclasses.replace(StageSensor([]).info, width=width, height=height)
    with pytest.raises(UntrackableError, match=f"stage gives {width} x {height} pixels, the rig says 640 x 480; set"):
        session.check_sensor(info, RIG, "bench")


def test_a_queue_that_was_never_begun_is_closed_at_once():
    for run in (None, lambda fetch: None):
        closing = threading.Thread(target=QueuedSensor(StageSensor([]), run=run).close, daemon=True)
        closing.start()
        closing.join(20.0)
        assert not closing.is_alive()


def test_a_queue_says_whether_there_is_more_and_drops_are_not_counted_while_it_rests():
    """Depth and colour pass whole; a frame read while the queue rests says nothing of those before it."""
    frame = np.full((480, 640), 1600, np.uint16), np.zeros((480, 640, 3), np.uint8)
    with QueuedSensor(StageSensor([frame] * 2)) as queue:
        assert queue.has_more(20.0)
        assert [queue.read().index for _ in range(2)] == [0, 1]
        assert queue.has_more(20.0)  # its end
        assert queue.read() is None
        assert queue.read() is None
    assert queue.left_out == 0
    assert queue.info.uri == "stage"
