"""The queue before a live sensor, and a short form of the endurance benchmark."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from benchmarks import endurance
from capture.frame_queue import CAPACITY, QueuedSensor
from firmware_host.depth_sensor import DepthSensor, SensorFrame
from firmware_host.errors import SensorStalledError
from tests.capture.stage import StageSensor

PICTURES = (np.ones((2, 2), np.uint16), np.zeros((2, 2, 3), np.uint8))


class Gated(DepthSensor):
    """Gives its frames one after the other and tells when it was asked for one more than it has."""

    def __init__(self, frames, ends_with=None):
        self._inner, self._ends_with = StageSensor([PICTURES] * frames), ends_with
        self.is_dry = threading.Event()

    @property
    def info(self):
        return self._inner.info

    def read(self, timeout_s=1.0) -> SensorFrame | None:
        frame = self._inner.read()
        if frame is None:
            self.is_dry.set()
            if self._ends_with is not None:
                raise self._ends_with
        return frame

    def close(self):
        self._inner.close()


def test_frames_wait_for_a_reader_that_is_late():
    inner = Gated(12)
    with QueuedSensor(inner) as sensor:
        assert inner.is_dry.wait(10)
        frames = list(sensor.frames())
        assert sensor.read() is None
    assert [frame.index for frame in frames] == list(range(12))
    assert not any(frame.dropped_before for frame in frames)


def test_what_does_not_fit_is_counted_in_the_next_frame_that_does():
    """Three places, seven frames: the first three wait; after one is read, there is room again."""
    gate = threading.Semaphore(0)
    put = threading.Semaphore(0)

    class Slow(Gated):
        def read(self, timeout_s=1.0):
            put.release()
            gate.acquire(timeout=10)
            return super().read()

    def let_through(count):
        for _ in range(count):
            gate.release()
            put.acquire(timeout=10)  # it asked for the one after, so this one was dealt with

    with QueuedSensor(Slow(7), capacity=3) as sensor:
        put.acquire(timeout=10)
        let_through(5)
        assert [sensor.read().index for _ in range(3)] == [0, 1, 2]
        let_through(2)
        gate.release()
        late = [(frame.index, frame.dropped_before) for frame in sensor.frames()]
    assert late == [(5, 2), (6, 0)]


def test_a_failing_sensor_fails_after_its_last_frame():
    with QueuedSensor(Gated(2, SensorStalledError("no frame for 5 s"))) as sensor:
        assert [sensor.read().index, sensor.read().index] == [0, 1]
        with pytest.raises(SensorStalledError):
            sensor.read()
        assert sensor.read() is None


def test_leaving_early_stops_the_thread():
    with QueuedSensor(Gated(100), capacity=2) as sensor:
        assert sensor.read().index == 0
    assert "frames" not in {thread.name for thread in threading.enumerate()}


def test_a_short_recording_stays_below_110_megabytes_and_accounts_for_every_frame():
    """Five seconds. A machine that is busy with other things may lose frames, but the take tells of them.

    Only those at the very end have no next frame that could: at most what the queue holds.
    """
    found = endurance.measure(5.0, hogs=0)
    assert found["memory"] < endurance.MOST_MEMORY
    assert found["published"] == 150
    assert 0 <= found["lost"] - found["told"] <= CAPACITY
    assert found["with_hanger"] >= 0.9 * found["frames"] > 0
