"""The recorder judges a sensor that hangs upside down as `hangtime record` does, from the take's last good picture."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest

from capture.appliance.disk import Disk
from capture.appliance.retention import Retention
from capture.appliance.running_take import TakeInProgress
from capture.recording.frame_reader import FrameReader
from capture.recording.session import record
from tests.capture.appliance.test_disk import LONGEST, news_of
from tests.capture.garment.towel import GARMENT, HANGER
from tests.capture.garment.towel_scenes import RIG
from tests.capture.stage import StageSensor

EXCHANGED = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, ids=HANGER.ids[::-1]))


def findings_of_the_recorder(folder, pairs, rig):
    """What the recorder finds in a take of these pictures."""
    sensor = StageSensor(pairs)
    reader = FrameReader(sensor.info, rig, GARMENT)
    disk = Disk(folder / "takes", least_free=0, retention=Retention(), clock=time.monotonic)
    disk.start()
    take = TakeInProgress(reader, [], len(GARMENT.points), by="button", now=0.0)
    disk.begin(take.plan(rig, GARMENT, "stage"))
    while (frame := sensor.read()) is not None:
        if (seen := reader.read(frame)) is not None:
            take.count(seen, reader.frame)
            disk.add(seen)
    disk.end(take.facts("button"), is_worth_keeping=take.is_worth_keeping, shown=take.shown)
    (news,) = [one for one in news_of(disk) if one.is_over]
    disk.close(LONGEST)
    assert news.kept.facts["findings"] == [one.as_fact() for one in news.findings]
    return news.findings


@pytest.mark.parametrize(
    ("is_turned", "rig", "advice"),
    [
        (True, RIG, "turn the sensor over and record again"),
        (False, EXCHANGED, "turn the hanger's front to the sensor, or exchange the two markers' numbers in the rig"),
    ],
)
def test_the_recorder_names_the_cause_of_exchanged_markers_as_record_does(good, tmp_path, is_turned, rig, advice):
    pairs = good * 11
    if is_turned:
        pairs = [tuple(np.ascontiguousarray(one[::-1, ::-1]) for one in pair) for pair in pairs]
    report = record(StageSensor(pairs), rig, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    found = findings_of_the_recorder(tmp_path, pairs, rig)
    assert found == report.findings
    assert advice in [one.advice for one in found]
