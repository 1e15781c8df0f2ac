"""A recording that cannot be used names the true cause: the file's own statements, or a sensor upside down."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from capture.errors import NoMarkersError
from capture.recording.condition import Condition
from capture.recording.session import record
from tests.capture.garment.towel import GARMENT, HANGER
from tests.capture.garment.towel_scenes import RIG
from tests.capture.stage import StageSensor


class Stating(StageSensor):
    """A recording with statements about its pictures."""

    def __init__(self, pairs, **stated):
        super().__init__(pairs)
        self.stated = stated

    @property
    def info(self):
        return dataclasses.replace(super().info, **self.stated)


def test_a_file_that_calls_unmirrored_pictures_mirrored_is_told_apart_from_a_mirroring_sensor(good, tmp_path):
    turned = Stating([(depth, np.ascontiguousarray(colour[:, ::-1])) for depth, colour in good * 2], is_turned=True)
    told = r"the file says that its pictures are mirrored, and both are read without that: set its xnMirror to 0$"
    with pytest.raises(NoMarkersError, match=told):
        record(turned, RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")


def test_frames_that_a_file_numbers_too_high_are_the_cause_and_no_longer_recording_helps(good, tmp_path):
    with pytest.raises(NoMarkersError, match=r"again: 89 of its depth frames have numbers too high to be read$"):
        record(Stating(good[:1], left_out=89), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")


def test_a_sensor_that_hangs_upside_down_is_named_and_not_the_hangers_front(good, tmp_path):
    pairs = [tuple(np.ascontiguousarray(one[::-1, ::-1]) for one in pair) for pair in good * 11]
    report = record(StageSensor(pairs), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    assert str(report.doubt).endswith(
        "the first marker is on the right, and both stand on their heads: the sensor hangs upside down; the take was "
        "kept, but nothing can be fitted to it; turn the sensor over and record again"
    )


def test_a_hanger_with_exchanged_markers_is_not_a_sensor_upside_down(good, tmp_path):
    swapped = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, ids=HANGER.ids[::-1]))
    report = record(StageSensor(good * 11), swapped, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    assert "turn the hanger's front to the sensor" in str(report.doubt)


def test_doubled_markers_are_said_at_once_and_not_that_none_are_seen(good, tmp_path):
    """A second sheet with both markers, at the same distance from each other, 150 rows below the hanger's."""
    pairs = []
    for depth, colour in good * 2:
        doubled = colour.copy()
        rows = slice(145, 190)  # around the markers, at rows 157 to 178
        doubled[rows.start + 150 : rows.stop + 150] = colour[rows]
        pairs.append((depth, doubled))
    said = []
    with pytest.raises(NoMarkersError, match=r"seen twice: leave only the hanger's own in view$"):
        record(
            StageSensor(pairs), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now",
            announce=lambda time, condition: said.append((time, condition)),
        )  # fmt: skip
    assert said == [(0.0, Condition.SEEN_TWICE)]
