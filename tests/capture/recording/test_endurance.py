"""The frame queue of a live sensor, and a short run of the endurance benchmark."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from benchmarks import endurance
from benchmarks.endurance import swung_pictures
from capture.recording.frame_queue import UNPACKED_FRAMES, QueuedSensor
from firmware_host.depth_sensor import DepthSensor, SensorFrame
from firmware_host.errors import SensorStalledError
from tests.capture.stage import StageSensor
from tests.conftest import STILL

PICTURES = (np.ones((2, 2), np.uint16), np.zeros((2, 2, 3), np.uint8))
SIZE = 8 + 12  # bytes of these
IN_A_SECOND = 30


class Gated(DepthSensor):
    """Delivers its frames in order, and signals a request for one more than it has."""

    def __init__(self, frames, ends_with=None, pictures=PICTURES):
        self._inner, self._ends_with = StageSensor([pictures] * frames), ends_with
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
        assert inner.is_dry.wait(600)
        frames = list(sensor.frames())
        assert sensor.read() is None
    assert [frame.index for frame in frames] == list(range(12))
    assert not any(frame.dropped_before for frame in frames)


def test_frames_that_do_not_fit_are_counted_in_the_next_one_that_does():
    """Room for two, seven frames: the first two wait; after both are read, there is room again."""
    gate = threading.Semaphore(0)
    put = threading.Semaphore(0)

    class Slow(Gated):
        def read(self, timeout_s=1.0):
            put.release()
            gate.acquire(timeout=STILL)
            return super().read()

    def let_through(count):
        for _ in range(count):
            gate.release()
            put.acquire(timeout=STILL)  # the queue requested the next frame, so it has handled this one

    with QueuedSensor(Slow(7), room=2 * SIZE) as sensor:
        put.acquire(timeout=STILL)
        let_through(5)
        assert [sensor.read().index for _ in range(2)] == [0, 1]
        let_through(2)
        gate.release()
        late = [(frame.index, frame.dropped_before) for frame in sensor.frames()]
        assert sensor.left_out == 3
    assert late == [(5, 3), (6, 0)]


def test_a_compressed_frame_takes_the_room_of_its_colour_too():
    """Colour of noise cannot be compressed: beside the first frames there is room for two more and half a picture."""
    noise = np.random.default_rng(1).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    depth = np.ones((40, 40), np.uint16)
    inner = Gated(UNPACKED_FRAMES + 5, pictures=(depth, noise))
    room = UNPACKED_FRAMES * (depth.nbytes + noise.nbytes) + round(2.5 * noise.nbytes)
    with QueuedSensor(inner, room=room) as sensor:
        assert inner.is_dry.wait(600)
        assert sum(1 for _ in sensor.frames()) == UNPACKED_FRAMES + 2
        assert sensor.left_out == 3


def test_a_hitch_of_a_second_costs_no_frame_and_no_bit_of_one(monkeypatch):
    """Forty frames at once, a second and a third: 61 MB, of which 30 MB may wait."""
    monkeypatch.setattr(endurance, "LOOP", 1)  # the others are not checked
    depth, colour = swung_pictures()[0]
    inner = Gated(0)
    inner._inner = StageSensor([(np.roll(depth, k, axis=1), np.roll(colour, k, axis=1)) for k in range(40)])
    with QueuedSensor(inner) as sensor:
        assert inner.is_dry.wait(600)
        frames = list(sensor.frames())
        assert sensor.left_out == 0
    assert [frame.index for frame in frames] == list(range(40))
    for k, frame in enumerate(frames):
        assert np.array_equal(frame.depth, np.roll(depth, k, axis=1))
        assert np.array_equal(frame.colour, np.roll(colour, k, axis=1))


def test_a_frame_without_colour_that_waits_comes_out_without_colour():
    depth = np.arange(12, dtype=np.uint16).reshape(3, 4)
    inner = Gated(0)
    inner._inner = StageSensor([(depth, None)] * (UNPACKED_FRAMES + 2))
    with QueuedSensor(inner) as sensor:
        assert inner.is_dry.wait(600)
        frames = list(sensor.frames())
    assert len(frames) == UNPACKED_FRAMES + 2
    assert all(frame.colour is None and np.array_equal(frame.depth, depth) for frame in frames)


def test_a_failing_sensor_fails_after_its_last_frame():
    with QueuedSensor(Gated(2, SensorStalledError("no frame for 5 s", where="sensor", advice="replug it"))) as sensor:
        assert [sensor.read().index, sensor.read().index] == [0, 1]
        with pytest.raises(SensorStalledError):
            sensor.read()
        assert sensor.read() is None


def test_leaving_early_stops_the_thread():
    with QueuedSensor(Gated(100), room=2 * SIZE) as sensor:
        assert sensor.read().index == 0
    assert "frames" not in {thread.name for thread in threading.enumerate()}


@pytest.mark.slow
def test_a_short_recording_stays_below_110_megabytes_and_accounts_for_every_frame():
    """Five seconds. A machine that is busy with other things may lose frames, but the take reports them.

    Only those at the very end have no next frame that could.
    """
    found = endurance.measure(5.0, hogs=0)
    assert found["memory"] < endurance.MOST_MEMORY
    assert found["published"] == 150
    assert 0 <= found["lost"] - found["reported"] <= IN_A_SECOND
    assert found["missed"] <= found["reported"]
    assert found["with_hanger"] >= 0.9 * found["frames"] > 0
