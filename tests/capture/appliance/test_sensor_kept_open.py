"""The keeper of a sensor opens it, tries again after failures, and reports when it is silent, gone or of another size.

The sensor gives the frames that the test puts in; threads and queue are those of the appliance.
"""

from __future__ import annotations

import dataclasses
import os
import queue
import threading

import numpy as np
import pytest

from capture.appliance.sensor_keeper import RESTING_PERIOD, RETRY, SILENT_AFTER, SensorKeeper
from firmware_host.depth_sensor import DepthSensor, SensorFrame
from firmware_host.errors import SensorStalledError, SensorUnavailableError
from tests.capture.garment.towel_scenes import RIG
from tests.capture.stage import StageSensor

LONG = 20.0  # s; enough on a busy machine


@pytest.fixture(autouse=True)
def ordinary_schedule():
    """Give the process its own schedule back: a keeper that is never closed leaves its real-time priority."""
    policy, order = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    os.sched_setscheduler(0, policy, order)


class Plugged(DepthSensor):
    """A sensor that gives what is put into `coming`: a frame, None for the end, or an error."""

    def __init__(self, width=640):
        self.info_ = dataclasses.replace(StageSensor([]).info, width=width)
        self.coming, self.is_closed, self.thread = queue.Queue(), threading.Event(), None

    @property
    def info(self):
        return self.info_

    def read(self, timeout_s=1.0):
        self.thread = threading.current_thread().name
        found = self.coming.get()
        if isinstance(found, Exception):
            raise found
        return found

    def give(self, index):
        still = np.zeros((480, 640), np.uint16)
        self.coming.put(SensorFrame(index=index, time_s=index / 30, host_time_s=0.0, depth=still, colour=None))

    def close(self):
        self.is_closed.set()


class Desk:
    """A keeper with a clock that the test sets, and the sensors that it opens in turn."""

    def __init__(self, *sensors):
        self.now, self.left, self.tries = 0.0, list(sensors), 0
        self.keeper = SensorKeeper(self.open, RIG, lambda: self.now)

    def open(self):
        self.tries += 1
        found = self.left.pop(0)
        if isinstance(found, Exception):
            raise found
        return found


def test_a_sensor_is_opened_read_in_its_own_thread_and_closed():
    sensor = Plugged()
    desk = Desk(sensor)
    assert (desk.keeper.info, desk.keeper.left_out, desk.keeper.silent_s(desk.now)) == (None, 0, None)
    assert desk.keeper.next_frame(LONG) is None
    assert desk.keeper.info == sensor.info
    assert desk.keeper.next_frame(0.0) is None
    sensor.give(5)
    assert desk.keeper.next_frame(LONG).index == 5
    assert (sensor.thread, desk.keeper.left_out, desk.keeper.error) == ("sensor", 0, None)
    sensor.coming.put(None)
    desk.keeper.close()
    assert sensor.is_closed.wait(LONG)
    assert desk.keeper.info is None


def test_silence_is_reported_from_the_last_frame_or_the_opening_on():
    sensor = Plugged()
    desk = Desk(sensor)
    desk.keeper.next_frame(LONG)
    assert desk.keeper.silent_s(SILENT_AFTER) is None
    assert desk.keeper.silent_s(2.0) == 2.0
    sensor.give(0)
    desk.now = 3.0
    desk.keeper.next_frame(LONG)
    assert desk.keeper.silent_s(3.5) is None
    assert desk.keeper.silent_s(4.0) == 1.0
    sensor.coming.put(None)
    desk.keeper.close()
    assert desk.keeper.silent_s(200.0) is None


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (None, "has come to its end"),
        (SensorStalledError("nothing came", where="x", advice="replug it"), "nothing came"),
    ],
)
def test_a_sensor_that_ends_is_let_go_and_opened_anew_after_a_pause(end, said):
    first, second = Plugged(), Plugged()
    desk = Desk(first, second)
    desk.keeper.next_frame(LONG)
    first.coming.put(end)
    assert desk.keeper.next_frame(LONG) is None
    assert said in str(desk.keeper.error)
    assert first.is_closed.wait(LONG)
    desk.now += 0.9 * RETRY
    desk.keeper.next_frame(0.0)
    assert desk.tries == 1
    desk.now += 0.1 * RETRY + 1e-6
    desk.keeper.next_frame(LONG)
    assert (desk.tries, desk.keeper.error, desk.keeper.info) == (2, None, second.info)
    second.coming.put(None)
    desk.keeper.close()
    assert second.is_closed.wait(LONG)


@pytest.mark.parametrize(
    ("failing", "said"),
    [
        (SensorUnavailableError("none is connected", where="usb", advice="plug one in"), "none is connected"),
        (RuntimeError("a defect"), "the sensor does not open (RuntimeError('a defect'))"),
        (Plugged(width=320), "the sensor gives 320 x 480 pixels, the rig says 640 x 480"),
    ],
)
def test_a_sensor_that_does_not_open_is_named_and_tried_again(failing, said):
    sensor = Plugged()
    desk = Desk(failing, sensor)
    assert desk.keeper.next_frame(LONG) is None
    assert said in str(desk.keeper.error)
    assert desk.keeper.info is None
    assert isinstance(failing, Exception) or failing.is_closed.is_set()
    desk.now += RETRY
    desk.keeper.next_frame(LONG)
    assert (desk.keeper.info, desk.keeper.error) == (sensor.info, None)
    sensor.coming.put(None)
    desk.keeper.close()


def test_a_sensor_that_opens_while_the_keeper_closes_is_closed_too():
    sensor, may_open = Plugged(), threading.Event()
    desk = Desk(sensor)
    opened = desk.open
    desk.keeper._open = lambda: may_open.wait(LONG) and opened()
    desk.keeper.next_frame(0.0)
    assert desk.keeper.info is None
    threading.Timer(0.05, may_open.set).start()
    desk.keeper.close()
    assert sensor.is_closed.is_set()


def test_a_resting_sensor_is_asked_for_one_frame_a_period_and_then_for_all():
    sensor = Plugged()
    desk = Desk(sensor)
    desk.keeper.rest(is_resting=True)  # before it is open: nothing to do
    desk.keeper.next_frame(LONG)
    periods = []
    desk.keeper._queue.rest = periods.append
    for is_resting in (False, True, True, False):
        desk.keeper.rest(is_resting=is_resting)
    assert periods == [RESTING_PERIOD, 0.0]
    sensor.coming.put(None)
    desk.keeper.close()
