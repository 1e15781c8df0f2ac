"""The recorder's loop, step by step: its states, faults, answers and takes, by a scripted sensor, disk and clock."""

from __future__ import annotations

import json

import numpy as np
import pytest

from capture.appliance.disk import DiskNews
from capture.appliance.spool import KeptTake
from capture.appliance.states import State
from capture.appliance.sync_status import only_sync
from capture.recording.condition import Condition
from capture.recording.tracking import FrameTracker
from firmware_host.depth_sensor import SensorFrame
from firmware_host.errors import SensorStalledError
from formats.errors import OutputError
from formats.findings import Finding
from tests.capture.appliance.scripted_loop import FRAME, NOTHING, Loop
from tests.capture.recording.test_records_by_hand import told

FULL = OutputError("the disk cannot be written", where="takes", advice="make room")


@pytest.fixture
def loop(tmp_path, monkeypatch):
    made = Loop(tmp_path)

    def track(self, frame, time):
        found = {"valid": np.ones(2, bool), "positions": np.full((2, 3), 1.6)} if made.sees else {}
        return told(0 if made.sees else 3, **found)

    monkeypatch.setattr(FrameTracker, "track", track)
    return made


@pytest.fixture
def ready(loop):
    loop.keeper.is_open = True
    loop.disk.coming.append(DiskNews(is_sound=True))
    loop.sees = False
    loop.frame()
    assert loop.state is State.READY
    loop.sees = True
    return loop


@pytest.fixture
def armed(ready):
    ready.wait(1.2)
    ready.frame()
    assert ready.state is State.ARMED
    return ready


def test_it_is_ready_once_the_spool_is_sound_and_a_frame_has_come(loop):
    loop.keeper.is_open = True
    loop.it.step()
    assert (loop.state, loop.disk.of("salvage")) == (State.STARTING, ["salvage"])
    assert not loop.it.is_started
    loop.frame()
    assert loop.state is State.STARTING
    loop.disk.coming.append(DiskNews(is_sound=True))
    loop.it.step()
    assert loop.state is State.READY
    assert loop.it.is_started


def test_a_spool_that_is_not_sound_is_tried_again_every_two_seconds_while_the_disk_is_idle(loop):
    for seconds, tries in ((0.0, 1), (1.9, 1), (0.1, 2)):
        loop.wait(seconds)
        assert len(loop.disk.of("salvage")) == tries
    loop.disk.is_idle = False
    loop.wait(3.0)
    assert len(loop.disk.of("salvage")) == 2


def test_the_hanger_is_sought_every_1_1_seconds_and_is_gone_after_five(ready):
    ready.it._last_look = ready.now
    ready.frame(16)  # 1.07 s
    assert ready.state is State.READY
    ready.frame()
    assert ready.state is State.ARMED
    ready.sees = False
    ready.frame(74)  # 4.9 s
    assert ready.state is State.ARMED
    ready.frame(2)
    assert ready.state is State.READY
    assert ready.it._reader is None
    assert ready.it.status()["pre_roll_s"] == 0.0


def test_a_take_has_its_pre_roll_its_notes_and_its_facts_and_ends_after_its_longest_time(armed):
    armed.frame(8)
    assert armed.it.status()["pre_roll_s"] == pytest.approx(5 * FRAME, abs=1e-3)  # the first at 0.3 s or more
    assert armed.ask("start") == {"ok": True}
    ((_, plan),) = armed.disk.of("begin")
    assert (plan.notes["begun_by"], plan.source) == ("command", "script")
    assert len(armed.disk.of("add")) == 6
    assert float(plan.notes["pre_roll_s"]) == pytest.approx(5 * FRAME, abs=1e-3)
    assert armed.ask("start")["what"] == "a take is being recorded already"
    armed.frame(dropped=2)
    running = armed.it.status()["recording"]
    assert (running["frames"], running["dropped"], running["gaps"]) == (7, 2, 1)
    armed.frame(73)  # 74 frames are 4.93 s
    assert armed.state is State.RECORDING
    armed.frame(2)
    assert armed.state is State.SAVING
    ((_, facts, is_worth_keeping),) = armed.disk.of("end")
    assert (facts["ended_by"], facts["begun_by"]) == ("longest_s of the configuration", "command")
    assert (facts["frames"], facts["with_hanger"], facts["dropped"], facts["gaps"]) == (81, 81, 2, 1)
    assert facts["seconds"] == pytest.approx(80 * FRAME, abs=1e-5)
    assert is_worth_keeping
    assert len(armed.disk.of("add")) == 81
    assert armed.ask("start")["what"].startswith("no take can begin now: saving")
    assert armed.ask("stop")["what"] == "nothing is being recorded"
    armed.disk.coming.append(DiskNews(is_over=True))
    armed.it.step()
    assert armed.state is State.READY


def test_the_disk_gets_the_last_frame_that_shows_the_hanger(armed):
    armed.ask("start")
    armed.frame(40)
    last = armed.number
    armed.sees = False
    armed.frame(3)
    armed.ask("stop")
    assert armed.disk.shown.index == last < armed.number


def test_a_take_in_which_the_hanger_is_hardly_seen_is_not_kept_and_says_why(armed):
    armed.ask("start")
    armed.sees = False
    armed.frame(5)
    assert armed.ask("stop") == {"ok": True}
    assert armed.disk.of("end")[0][2] is False
    last = armed.it.status()["last_take"]
    assert last["kept"] is None
    (finding,) = last["findings"]
    assert (finding["name"], finding["is_grave"]) == ("nothing_kept", True)
    assert "markers were seen in 0 of 5 frames, mostly because: no markers are seen" in finding["words"]


def test_a_clock_that_runs_backwards_in_a_take_is_its_condition(armed):
    armed.ask("start")
    armed.now += FRAME
    for _ in range(2):
        armed.keeper.frames.append(
            SensorFrame(index=0, time_s=armed.now - 5.0, host_time_s=armed.now, depth=NOTHING, colour=None)
        )
        armed.it.step()
    assert armed.it.status()["condition"] == Condition.CLOCK.value.words
    assert armed.it._take.tally.conditions.frames[Condition.CLOCK] >= 1


@pytest.mark.parametrize(("late", "is_slow"), [(3.0, False), (3.1, True)])
def test_a_disk_that_is_over_three_seconds_behind_ends_the_take(armed, late, is_slow):
    armed.ask("start")
    armed.disk.late = late
    armed.it.step()
    assert ("disk_slow" in armed.faults) is is_slow
    assert armed.state is (State.SAVING if is_slow else State.RECORDING)
    assert armed.it.status()["disk_behind_s"] == late
    if is_slow:
        assert "has not finished writing for 3.1 s" in armed.disk.of("end")[0][1]["ended_by"]
        armed.disk.late = 0.0
        armed.disk.coming.append(DiskNews(is_sound=True, is_over=True))
        armed.it.step()
        assert (armed.faults, armed.state) == ({}, State.READY)


def test_a_failure_of_the_disk_blocks_until_it_is_sound_again(ready):
    ready.disk.coming.append(DiskNews(failure=FULL))
    ready.it.step()
    assert ready.state is State.FAULT
    assert ready.faults["disk"].blocks
    answer = ready.ask("start")
    assert answer == {
        "ok": False, "what": "nothing can be recorded: takes: the disk cannot be written", "advice": "make room",
    }  # fmt: skip
    ready.disk.coming.append(DiskNews(is_sound=True))
    ready.frame()
    assert (ready.state, ready.faults) == (State.READY, {})


def test_room_is_wanted_as_configured_and_less_of_it_during_a_take(armed):
    armed.disk.coming.append(DiskNews(room=20_000_000, counts=(5, 2)))
    armed.it.step()
    status = armed.it.status()
    assert (armed.faults, status["free_bytes"], status["takes"], status["waiting"]) == ({}, 20_000_000, 5, 2)
    armed.ask("start")
    armed.disk.coming.append(DiskNews(room=19_999_999))
    armed.it.step()
    assert armed.state is State.RECORDING
    armed.disk.coming.append(DiskNews(room=1_000_000))
    armed.it.step()
    assert armed.faults["disk_full"].sentence.endswith("only 1 MB are left on the disk")
    assert "make room for 20 MB" in armed.faults["disk_full"].advice
    assert armed.state is State.SAVING
    armed.disk.coming += [DiskNews(is_over=True), DiskNews(room=19_999_999)]
    armed.it.step()
    assert "disk_full" in armed.faults
    armed.disk.coming.append(DiskNews(room=20_000_000))
    armed.it.step()
    assert armed.faults == {}


def test_a_kept_take_is_counted_shown_for_three_seconds_and_its_findings_are_a_complaint(ready):
    one = Finding(name="short", words="it is short", advice="record longer")
    kept = KeptTake(sequence=7, path=ready.folder / "take-000007.mcap", facts={"seconds": 4.0}, receipt=None)
    kept.path.write_bytes(b"12345")
    ready.disk.coming.append(DiskNews(kept=kept, findings=(one,), salvaged=(kept, kept)))
    ready.it.step()
    status = ready.it.status()
    assert (status["bytes_kept"], status["salvaged"], status["lamp"]) == (5, 2, "kept")
    assert status["last_take"] == {
        "kept": str(kept.path), "sequence": 7, "seconds": 4.0, "findings": [one.as_fact()],
    }  # fmt: skip
    ready.wait(2.9)
    assert ready.it.status()["lamp"] == "kept"
    ready.wait(0.2)
    assert ready.it.status()["lamp"] == "look"


def test_a_silent_sensor_is_a_fault_that_blocks_nothing_and_a_failed_one_blocks(armed):
    armed.wait(1.0)
    assert armed.faults["sensor_silent"].sentence == "script: the sensor has sent no frame for 1.0 s"
    assert armed.state is State.ARMED
    armed.frame()
    assert armed.faults == {}
    armed.keeper.error = SensorStalledError("it is gone", where="usb", advice="replug it")
    armed.it.step()
    assert (armed.state, armed.faults["sensor"].blocks) == (State.FAULT, True)
    armed.keeper.error = None
    armed.wait(0.1)
    assert armed.state is State.FAULT
    armed.frame()
    assert armed.state is State.READY


def test_a_fault_of_the_sensor_within_a_minute_of_too_low_a_voltage_blames_the_supply(ready):
    (ready.folder / "alarm").write_text("1\n")
    ready.wait(1.0)
    assert ready.faults["power"].advice == "use a stronger power supply and a shorter cable"
    (ready.folder / "alarm").write_text("0\n")
    ready.keeper.error = SensorStalledError("it is gone", where="usb", advice="replug it")
    ready.wait(50.0)
    assert ready.faults["sensor"].sentence == "usb: it is gone, after the board's voltage was too low"
    assert ready.faults["sensor"].advice.startswith("use a stronger power supply")
    ready.wait(11.0)
    assert "power" not in ready.faults
    ready.keeper.error = SensorStalledError("it is away", where="usb", advice="replug it")
    ready.it.step()
    assert ready.faults["sensor"].sentence == "usb: it is away"


def test_a_look_from_the_end_of_a_take_asks_for_no_more_room_than_the_take(armed):
    """The disk thread makes room once the take is kept."""
    armed.ask("start")
    armed.ask("stop")
    armed.disk.coming.append(DiskNews(room=19_999_999))
    armed.it.step()
    assert (armed.state, armed.faults) == (State.SAVING, {})


def test_the_house_is_kept_once_a_second_and_the_disk_looked_at_while_it_is_busy_too(ready):
    before = len(ready.disk.of("look"))
    ready.it._last_house = ready.now
    ready.wait(0.9)
    assert len(ready.disk.of("look")) == before
    ready.wait(0.1)
    assert len(ready.disk.of("look")) == before + 1
    ready.disk.is_idle = False  # as in every iteration of a take that adds a frame
    ready.wait(1.0)
    assert len(ready.disk.of("look")) == before + 2


def test_a_running_sync_is_a_state_and_ends_with_it(ready):
    with only_sync(ready.folder / "takes"):
        ready.sees = False
        ready.frame(16)
        assert (ready.state, ready.it.status()["lamp"]) == (State.SYNCING, "syncing")
    ready.wait(1.0)
    assert ready.state is State.READY


def test_watchers_are_told_each_change_once(ready):
    ready.it.step()
    ready.control.told.clear()
    ready.it.step()
    assert ready.control.told == []
    ready.disk.coming.append(DiskNews(failure=FULL))
    ready.it.step()
    assert [status["state"] for status in ready.control.told][-1] == "fault"
    ready.control.told.clear()
    ready.control.is_watched = False
    ready.disk.coming.append(DiskNews(is_sound=True))
    ready.frame()
    assert (ready.control.told, ready.state) == ([], State.READY)


def test_each_request_has_its_answer(ready):
    assert ready.ask("status")["state"] == "ready"
    assert ready.ask("preview")["ok"] is True
    assert ready.ask("dance") == {
        "ok": False, "what": "the recorder does not know 'dance'", "advice": "update Hangtime on both sides",
    }  # fmt: skip
    json.dumps(ready.it.status())


def test_a_press_begins_and_ends_and_a_shutdown_ends_the_take_and_waits_for_the_disk(armed, monkeypatch):
    presses = iter([1, 0, 1, 0, 1])
    monkeypatch.setattr(armed.it._panel, "presses", lambda now: next(presses, 0))
    armed.it.step()
    assert armed.state is State.RECORDING
    armed.it.step()
    armed.it.step()
    assert (armed.state, armed.disk.of("end")[0][1]["ended_by"]) == (State.SAVING, "button")
    armed.disk.coming.append(DiskNews(is_over=True))
    armed.it.step()
    armed.it.step()
    assert armed.state is State.RECORDING
    waited = []

    def step():
        waited.append(1)
        armed.now += 1.0
        if len(waited) == 3:
            armed.it.machine.state = State.READY

    monkeypatch.setattr(armed.it, "step", step)
    armed.it.shut_down()
    assert (len(waited), armed.disk.of("end")[-1][1]["ended_by"]) == (3, "the appliance was stopped")


def test_a_shutdown_waits_for_a_disk_that_hangs_for_20_seconds(armed, monkeypatch):
    armed.ask("start")
    begun = armed.now

    def step():
        armed.now += 1.0

    monkeypatch.setattr(armed.it, "step", step)
    armed.it.shut_down()
    assert armed.now - begun == 20.0
