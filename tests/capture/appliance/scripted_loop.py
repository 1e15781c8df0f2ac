"""The recorder's loop with a scripted sensor, disk, clock and control; the rest of it is real."""

from __future__ import annotations

import numpy as np

from capture.appliance.daemon import Appliance
from capture.appliance.last_good import load_or_last_good
from firmware_host.depth_sensor import SensorFrame
from formats.descriptions import dump_description
from tests.capture.appliance.test_random_events import ScriptedKeeper
from tests.capture.appliance.virtual_appliance import RIG
from tests.capture.garment.towel import GARMENT

FRAME = 1 / 15  # s
NOTHING = np.zeros((480, 640), np.uint16)


class ScriptedDisk:
    """Keeps what the loop asks for, and says what the test puts in; has the interface of `Disk`."""

    def __init__(self):
        self.asked, self.coming, self.is_idle, self.late = [], [], True, 0.0

    def behind(self, now):
        return self.late

    def news(self):
        found, self.coming = self.coming, []
        return found

    def salvage(self):
        self.asked.append("salvage")

    def look(self):
        self.asked.append("look")

    def begin(self, plan):
        self.asked.append(("begin", plan))

    def add(self, seen):
        self.asked.append(("add", seen))

    def end(self, facts, *, is_worth_keeping, shown):
        self.shown = shown
        self.asked.append(("end", facts, is_worth_keeping))

    def of(self, kind):
        return [one for one in self.asked if one == kind or one[0] == kind]


class ScriptedControl:
    """Answers nobody, and keeps what watchers are told."""

    def __init__(self):
        self.told, self.is_watched, self.questions, self.answers = [], True, [], []

    def serve(self, answer):
        self.answers += [answer(question) for question in self.questions]
        self.questions = []

    def tell(self, news):
        self.told.append(news)


class Loop:
    def __init__(self, folder, **recording):
        self.now, self.number, self.folder = 1000.0, 0, folder
        (folder / "rig.toml").write_text(dump_description(RIG))
        (folder / "garment.toml").write_text(dump_description(GARMENT))
        (folder / "takes").mkdir()
        extra = "".join(f"{name} = {value}\n" for name, value in recording.items())
        (folder / "a.toml").write_text(
            '[sensor]\nrig = "rig.toml"\ngarment = "garment.toml"\n[spool]\nfolder = "takes"\nleast_free_mb = 20\n'
            f'[power]\nalarm = "alarm"\n[recording]\npre_roll_s = 0.3\nlongest_s = 5.0\n{extra}'
        )
        self.keeper, self.disk, self.control = ScriptedKeeper(lambda: self.now), ScriptedDisk(), ScriptedControl()
        self.it = Appliance(
            load_or_last_good(folder / "a.toml"), keeper=self.keeper, disk=self.disk, control=self.control,
            clock=lambda: self.now,
        )  # fmt: skip
        self.sees = True

    def frame(self, count=1, dropped=0):
        for _ in range(count):
            self.now += FRAME
            self.number += 1
            self.keeper.frames.append(
                SensorFrame(
                    index=self.number, time_s=self.now, host_time_s=self.now, depth=NOTHING, colour=None,
                    dropped_before=dropped,
                )
            )  # fmt: skip
            self.it.step()

    def wait(self, seconds):
        self.now += seconds
        self.it.step()

    def ask(self, do):
        self.control.questions.append({"do": do})
        self.it.step()
        return self.control.answers[-1]

    @property
    def state(self):
        return self.it.machine.state

    @property
    def faults(self):
        return {fault.name: fault for fault in self.it.faults.all}
