"""Signals that end a recording, sent at critical moments: while a block is written or the take is finished."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from capture.recording.frame_queue import QueuedSensor
from capture.recording.session import record
from capture.recording.stop_signals import STOPPING, stopped_like_ctrl_c
from formats.archive import read_take
from tests.capture.garment.towel import GARMENT
from tests.capture.garment.towel_scenes import RIG
from tests.capture.stage import StageSensor

INT, TERM, HUP = STOPPING
PAIRS = [(INT, INT), (INT, TERM), (TERM, INT), (TERM, HUP)]


def send(number):
    os.kill(os.getpid(), number)


@pytest.fixture(autouse=True)
def _as_a_shell_starts_it():
    """Tests that `nohup` or a shell's `&` runs ignore some of them."""
    usual = {INT: signal.default_int_handler, TERM: signal.SIG_DFL, HUP: signal.SIG_DFL}
    before = {one: signal.signal(one, handler) for one, handler in usual.items()}
    yield
    assert {one: signal.getsignal(one) for one in STOPPING} == usual
    for one, handler in before.items():
        signal.signal(one, handler)


@pytest.fixture
def on_sync(monkeypatch):
    """A list of functions, of which the next one is called before every sync to the disk."""
    calls, sync = [], os.fsync

    def fsync(file):
        if calls:
            calls.pop(0)()
        sync(file)

    monkeypatch.setattr(os, "fsync", fsync)
    return calls


def recorded(sensor, folder, **options):
    report = record(sensor, RIG, GARMENT, folder / "t.mcap", take_id="t", created="now", **options)
    assert [path.name for path in folder.iterdir()] == ["t.mcap"]
    return report, read_take(folder / "t.mcap")


@pytest.mark.parametrize(
    ("first", "second", "is_within"),
    [*((*pair, False) for pair in PAIRS), (*PAIRS[2], True),
     *(pytest.param(*pair, True, marks=pytest.mark.slow) for pair in PAIRS if pair != PAIRS[2])],
)  # fmt: skip
def test_a_second_signal_while_the_take_is_being_finished_leaves_it_finished(
    good, tmp_path, on_sync, first, second, is_within
):
    """The first during frame 16, the second as often as the disk is waited for after that."""

    def end(frames, total, seen):
        if frames == 16:
            on_sync.extend([lambda: send(second)] * 9)
            send(first)

    if is_within:
        with stopped_like_ctrl_c() as stop:
            report, take = recorded(StageSensor(good * 20), tmp_path, progress=end, stop=stop)
            send(second)  # while its report is printed
    else:
        report, take = recorded(StageSensor(good * 20), tmp_path, progress=end)
    assert len(on_sync) < 9
    assert report.is_interrupted
    assert take.is_complete
    assert len(take.time) == report.frames == 16


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_while_a_block_is_written_costs_no_frame(good, tmp_path, on_sync, number):
    """Blocks are of a second: the first one ends with frame 31, at 1 s."""

    def wait_for(frames, total, seen):
        if frames == 20:
            on_sync.append(lambda: send(number))

    report, take = recorded(StageSensor(good * 20), tmp_path, progress=wait_for)
    assert report.is_interrupted
    assert take.is_complete
    assert len(take.time) == report.frames == 31


class Silent(StageSensor):
    """A sensor that delivers its frames and then blocks; after these are tracked, Ctrl-C follows."""

    def __init__(self, frames):
        super().__init__(frames)
        self.are_tracked, self.goes_on = threading.Event(), threading.Event()

    def read(self, timeout_s=1.0):
        frame = super().read()
        if frame is None:
            assert self.are_tracked.wait(600)
            send(INT)
            assert self.goes_on.wait(600), "nobody was interrupted"
        return frame

    def look(self, frames, total, seen):
        if frames == len(self._frames):
            self.are_tracked.set()


@pytest.mark.parametrize("is_queued", [False, True])
def test_a_sensor_that_is_waited_for_is_given_up_at_once(good, tmp_path, is_queued):
    """Else it would be waited for for a minute, and the test fail."""
    sensor = Silent(good * 4)
    if is_queued:
        with QueuedSensor(sensor) as queue:
            report, take = recorded(queue, tmp_path, progress=sensor.look)
            sensor.goes_on.set()
    else:
        report, take = recorded(sensor, tmp_path, progress=sensor.look)
    assert report.is_interrupted
    assert len(take.time) == 12


def test_a_signal_that_is_ignored_outside_does_not_end_a_recording(good, tmp_path):
    """As SIGINT is for what a shell's script starts with `&`."""

    def end(frames, total, seen):
        if frames == 12:
            send(INT)

    signal.signal(INT, signal.SIG_IGN)
    try:
        report, take = recorded(StageSensor(good * 5), tmp_path, progress=end)
        assert signal.getsignal(INT) is signal.SIG_IGN
    finally:
        signal.signal(INT, signal.default_int_handler)
    assert not report.is_interrupted
    assert len(take.time) == 15


def test_a_recording_in_another_thread_has_no_signals_and_goes_to_its_end(good, tmp_path):
    done = []
    thread = threading.Thread(target=lambda: done.append(recorded(StageSensor(good * 4), tmp_path)))
    thread.start()
    thread.join()
    assert len(done[0][1].time) == 12


def test_outside_of_a_recording_the_first_signal_interrupts_and_the_others_do_nothing():
    with stopped_like_ctrl_c():
        with pytest.raises(KeyboardInterrupt):
            send(TERM)
        for one in STOPPING:
            send(one)
