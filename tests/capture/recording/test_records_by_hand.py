"""The record of a frame, scans between frames and the counts of a recording, by trackers with prescribed detections."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from capture.garment.sight import nothing_found
from capture.hanger.fiducial_tracker import nothing_seen
from capture.recording.condition import Condition
from capture.recording.frame_reader import FrameReader, ScanPlan, Seen
from capture.recording.tally import Tally
from capture.recording.tracking import FrameTracker, Tracked
from firmware_host.depth_sensor import SensorFrame
from formats.take import FrameState
from tests.capture.garment.towel import GARMENT
from tests.capture.garment.towel_scenes import RIG
from tests.capture.stage import StageSensor

POINTS = len(GARMENT.points)


def told(state=0, **hanger):
    """A garment whose first point alone was found, 1.5 m away."""
    valid = np.arange(POINTS) == 0
    cloth = dataclasses.replace(
        nothing_found(POINTS), points=np.full((POINTS, 3), 1.5), valid=valid, outline=np.zeros((4, 2)),
        sd=np.where(valid[:, None], np.full((POINTS, 3), 0.002), np.nan),
    )  # fmt: skip
    return Tracked(dataclasses.replace(nothing_seen(), **hanger), cloth, state, np.full((2, 3), 1.0))


def test_both_held_ends_have_the_root_mean_square_deviation_of_the_two_markers():
    """3 and 4 mm make sqrt(12.5) mm, 6 and 8 mm sqrt(50) mm; an unseen point has no place and no deviation."""
    sd = np.array([[3e-3, 0.0, 6e-3], [4e-3, 0.0, 8e-3]])
    frame = FrameTracker.as_frame(2.5, told(FrameState.ONE_MARKER, sd=sd, pitch=0.1, pitch_sd=0.02))
    assert frame.held_sd == pytest.approx(np.sqrt([[12.5e-6, 0.0, 50e-6]] * 2))
    assert (frame.time, frame.state, frame.pitch, frame.pitch_sd) == (2.5, FrameState.ONE_MARKER, 0.1, 0.02)
    assert frame.held_valid.tolist() == [True, True]
    assert np.isfinite(frame.points).all(1).tolist() == frame.points_valid.tolist() == [True, *[False] * (POINTS - 1)]
    assert frame.points_sd[0].tolist() == [0.002] * 3
    assert not frame.points_sd[1:].any()


@pytest.fixture
def reader(monkeypatch):
    """A reader of 30 frames a second that wants five scans a second; a scan is its time."""
    monkeypatch.setattr(FrameTracker, "track", lambda self, frame, time: told())
    monkeypatch.setattr(FrameTracker, "scan", lambda self, time, *, grid, contour: time)
    return FrameReader(StageSensor([]).info, RIG, GARMENT, scans=ScanPlan(rate=5.0))


def came(time, dropped=0):
    nothing = np.zeros((480, 640), np.uint16)
    return SensorFrame(index=0, time_s=time, host_time_s=0.0, depth=nothing, colour=None, dropped_before=dropped)


def test_a_scan_comes_every_sixth_frame_though_frames_are_a_little_early_or_late(reader):
    """A fifth of a second after the last one, less a millisecond at most."""
    late = np.array([0, 0, 0, 0, 0, 0, -0.9, 0, 0, 0, 0, 0, 0.9, 0, 0, 0, 0, 0, 0.0]) * 1e-3
    scans = [reader.read(came(1.0 + k / 30 + late[k])).scan for k in range(19)]
    assert [k for k, scan in enumerate(scans) if scan is not None] == [0, 6, 12, 18]


def test_frames_dropped_before_one_without_a_valid_time_count_for_the_next_one(reader):
    reader.read(came(1.0))
    assert reader.read(came(0.5, dropped=2)) is None
    seen = reader.read(came(1.2, dropped=1))
    assert seen.dropped == reader.frame.dropped_before == 3
    assert seen.frame.state & FrameState.CLOCK_JUMPED
    assert reader.read(came(1.3)).dropped == 0


def test_a_recording_counts_each_dropped_frame_and_each_gap():
    tally = Tally(POINTS)
    for time, dropped in ((4.0, 0), (4.5, 3), (5.0, 0), (6.5, 2)):
        frame = FrameTracker.as_frame(time, told())
        tally.add(
            Seen(time=time, frame=frame, scan=None, condition=Condition.GOOD, has_hanger=time > 4, dropped=dropped)
        )
    assert (tally.frames, tally.with_hanger, tally.dropped, tally.frame_gaps, tally.seconds) == (4, 3, 5, 2, 2.5)
    assert tally.points_seen.tolist() == [4.0, *[0.0] * (POINTS - 1)]
