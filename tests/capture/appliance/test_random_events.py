"""Random events on the real loop, in any order: the state machine stays valid and no take is lost.

The loop, the tracker, the spool and the disk's thread are the real ones; the sensor and the clock are scripted.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from capture.appliance import daemon
from capture.appliance.control import ControlServer
from capture.appliance.daemon import Appliance
from capture.appliance.disk import Disk
from capture.appliance.last_good import load_or_last_good
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from capture.appliance.states import TRANSITIONS, State
from firmware_host.button import DOWN, EVENT, KEY_EVENT, UP
from firmware_host.depth_sensor import SensorFrame, SensorInfo
from firmware_host.errors import SensorStalledError
from formats.archive import verify_take
from formats.descriptions import dump_description
from tests.capture.appliance.virtual_appliance import CAMERA, LONGEST, RIG
from tests.capture.garment.towel import GARMENT
from tests.capture.stage import marker_plate, pictures, plain_plate

FRAME = 1.0 / 15  # s
ENOUGH = 12  # frames with the hanger, of which a take is kept


@pytest.fixture(scope="module", autouse=True)
def drawn():
    """A hanger with a towel, and the bare wall."""
    rng = np.random.default_rng(1)
    middle = np.array([0.0, -0.2, 1.6])
    plates = [marker_plate(i, middle + np.array([side, 0, 0])) for i, side in ((0, -0.15), (1, 0.15))]
    plates.append(plain_plate(middle + np.array([0, 0.29, 0]), (0.4, 0.4), (60, 70, 150)))
    RandomEvents.shown = {"hanger": pictures(plates, rng), "wall": pictures([], rng)}


class ScriptedKeeper:
    """Delivers the test's frames, or an error; has the interface of `SensorKeeper`."""

    def __init__(self, clock):
        self._clock, self.frames, self.error, self._last = clock, [], None, 0.0
        self.is_open = False

    @property
    def info(self):
        return (
            SensorInfo(
                name="script", uri="script", width=640, height=480, fps=15.0, intrinsics=CAMERA, is_live=True
            ) if self.is_open else None
        )  # fmt: skip

    def silent_s(self, now):
        silent = now - self._last
        return silent if self.is_open and silent > 0.9 else None

    def rest(self, *, is_resting):
        pass

    def next_frame(self, wait_s):
        if self.frames:
            self._last = self._clock()
            return self.frames.pop(0)
        return None


class RandomEvents(RuleBasedStateMachine):
    """Presses, bounces, commands, frames, a sensor that disappears and returns, a disk that fails and recovers."""

    shown: ClassVar[dict] = {}

    @initialize()
    def begin(self):
        self.folder = Path(tempfile.mkdtemp(prefix="random-events"))
        self.now, self.number = 1000.0, 0
        (self.folder / "rig.toml").write_text(dump_description(RIG))
        (self.folder / "garment.toml").write_text(dump_description(GARMENT))
        self.button = self.folder / "button"
        os.mkfifo(self.button)
        (self.folder / "a.toml").write_text(
            f'[sensor]\nrig = "rig.toml"\ngarment = "garment.toml"\n[button]\ndevice = "{self.button}"\n'
            '[spool]\nfolder = "takes"\nleast_free_mb = 10\n[recording]\npre_roll_s = 0.5\nlongest_s = 6.0\n'
        )
        in_force = load_or_last_good(self.folder / "a.toml")
        self.keeper = ScriptedKeeper(lambda: self.now)
        self.disk = Disk(
            in_force.config.spool.folder, least_free=10_000_000, retention=Retention(), clock=lambda: self.now
        )
        self.disk.start()
        self.control = ControlServer(self.folder / "socket")
        self.appliance = Appliance(
            in_force, keeper=self.keeper, disk=self.disk, control=self.control, clock=lambda: self.now
        )
        self.passed = []
        follow = self.appliance.machine.take
        self.appliance.machine.take = lambda event: self._note(event, follow)
        self.worth = 0  # takes that must be kept
        self.step(40)

    def _note(self, event, follow):
        before = self.appliance.machine.state
        led = follow(event)
        if led:
            self.passed.append((before, event, self.appliance.machine.state))
        return led

    def step(self, count=1, seconds=FRAME):
        """Let time pass for a number of rounds of the loop; the disk finishes its work after each."""
        for _ in range(count):
            self.now += seconds
            take = self.appliance._take
            self.appliance.step()
            if take is not None and self.appliance._take is not take:
                self.worth += take.is_worth_keeping
            until = time.monotonic() + LONGEST
            while not self.disk.is_idle and time.monotonic() < until:
                time.sleep(0.0005)

    @rule(what=st.sampled_from(["hanger", "wall"]), count=st.sampled_from([1, 3, ENOUGH]))
    def frames(self, what, count):
        if not self.keeper.is_open:
            return
        depth, colour = self.shown[what]
        for _ in range(count):
            self.number += 1
            self.keeper.frames.append(
                SensorFrame(
                    index=self.number, time_s=self.now + FRAME, host_time_s=self.now + FRAME, depth=depth, colour=colour
                )
            )
            self.step()

    @rule(is_ended=st.booleans())
    def a_whole_take(self, is_ended):
        """The most common use: show the hanger, press, swing, and mostly press again."""
        if self.disk_is_there and not self.keeper.is_open:
            self.sensor_opens()
        self.frames("hanger", ENOUGH)
        self.button_changes([DOWN, UP], 0.6)
        self.frames("hanger", ENOUGH)
        if is_ended:
            self.button_changes([DOWN, UP], 0.6)

    @property
    def disk_is_there(self):
        return not (self.folder / "elsewhere").is_dir()

    @rule(changes=st.lists(st.sampled_from([DOWN, UP]), min_size=1, max_size=6), later=st.sampled_from([0.07, 0.6]))
    def button_changes(self, changes, later):
        with self.button.open("wb", buffering=0) as button:
            button.write(b"".join(EVENT.pack(0, 0, KEY_EVENT, 0x100, change) for change in changes))
        self.step(2, later)

    @rule()
    def command_start(self):
        may = self.appliance.machine.may_record and self.keeper.is_open
        assert self.appliance._answer({"do": "start"})["ok"] == may
        self.step()

    @rule()
    def command_stop(self):
        is_recording = self.appliance.machine.state is State.RECORDING
        take = self.appliance._take
        assert self.appliance._answer({"do": "stop"})["ok"] == is_recording
        if is_recording:
            self.worth += take.is_worth_keeping
        self.step()

    @rule()
    def sensor_opens(self):
        self.keeper.is_open, self.keeper.error = True, None
        self.frames("wall", 1)

    @precondition(lambda self: self.keeper.is_open)
    @rule()
    def sensor_fails(self):
        self.keeper.is_open, self.keeper.frames = False, []
        self.keeper.error = SensorStalledError("no frame for 5 s", where="sensor", advice="replug it")
        self.step(2)

    @rule(seconds=st.sampled_from([0.5, 1.5, 7.0]))
    def time_passes(self, seconds):
        self.step(4, seconds / 4)

    @rule()
    def disk_goes(self):
        takes = self.folder / "takes"
        if takes.is_dir():
            takes.rename(self.folder / "elsewhere")
            takes.write_text("a file where the folder was")
        self.step(2, 1.1)

    @rule()
    def disk_comes(self):
        takes, elsewhere = self.folder / "takes", self.folder / "elsewhere"
        if elsewhere.is_dir():
            takes.unlink()
            elsewhere.rename(takes)
        self.step(4, 1.1)

    @invariant()
    def the_table_holds(self):
        for before, event, after in self.passed:
            assert TRANSITIONS[before, event] is after
        for (_, _, after), (before, _, _) in zip(self.passed, self.passed[1:], strict=False):
            assert after is before

    @invariant()
    def nothing_is_recorded_in_spite_of_a_fault_that_blocks(self):
        if self.appliance.faults.blocking:
            assert self.appliance.machine.state in (State.FAULT, State.STARTING, State.SAVING)

    @invariant()
    def a_take_runs_exactly_while_it_records(self):
        assert (self.appliance._take is not None) == (self.appliance.machine.state is State.RECORDING)

    @invariant()
    def a_status_can_always_be_given(self):
        told = self.appliance.status()
        assert told["state"] == self.appliance.machine.state.name.lower()
        assert all(fault["sentence"] and fault["advice"] for fault in told["faults"])

    def teardown(self):
        self.disk_comes()
        self.appliance.shut_down()
        self.disk.close(10.0)
        self.control.close()
        with Spool(self.folder / "takes") as spool:
            spool.salvage()
            kept = spool.takes()
            assert all(verify_take(one.path).is_sound for one in kept)
            assert len({one.sequence for one in kept}) == len(kept) >= self.worth
        shutil.rmtree(self.folder)


TestRandomEvents = RandomEvents.TestCase
TestRandomEvents.settings = settings(
    max_examples=4, stateful_step_count=25, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)  # fmt: skip


class MoreEvents(RandomEvents):
    """The same events in longer runs."""


TestMoreEvents = pytest.mark.slow(MoreEvents.TestCase)
TestMoreEvents.settings = settings(TestRandomEvents.settings, max_examples=24)
assert daemon.TRY_AGAIN <= 4 * 1.1  # `disk_comes` waits for one try
