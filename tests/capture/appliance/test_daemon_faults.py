"""The real daemon with a sensor that stalls or disappears, and with a disk that hangs, fails or fills up."""

from __future__ import annotations

import re
import resource
import signal
import subprocess
import time

import numpy as np
import pytest

from capture.appliance.showing import FAULT_LIGHT
from capture.appliance.spool import Spool
from formats.archive import read_take, verify_take
from formats.take import FrameState
from tests.capture.appliance.real_daemon import FPS, needs_openni, recorded, small_disk
from tests.capture.appliance.virtual_appliance import VirtualAppliance

pytestmark = needs_openni


def test_a_sensor_that_goes_silent_is_named_within_a_second_and_the_gap_is_in_the_take(appliance):
    appliance.start()
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
    appliance.cord.write_text("silent")
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    (fault,) = told["faults"]
    assert fault["name"] == "sensor_silent"
    since = float(re.search(r"no frame for (\d\.\d) s", fault["sentence"])[1]) - fault["for_s"]
    assert 0.8 <= since <= 1.0  # s between the last frame and the fault
    assert (told["state"], told["lamp"]) == ("recording", "tracking lost")
    appliance.cord.write_text("")
    told = appliance.wait_until(lambda told: not told["faults"], "frames again")
    assert told["state"] == "recording"
    appliance.press()
    appliance.wait_until(lambda told: told["takes"] == 1, "kept")
    (kept,) = Spool(appliance.spool).takes()
    take = read_take(kept.path)
    gap = int(np.argmax(np.diff(take.time))) + 1
    assert np.diff(take.time).max() > 0.8
    assert take.state[gap] & FrameState.FRAMES_DROPPED_BEFORE  # the gap is in the take
    assert told["gaps"] >= 1


@pytest.mark.slow
def test_a_sensor_that_stays_silent_for_five_seconds_ends_the_take_and_the_next_one_records(appliance):
    appliance.start()
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
    appliance.cord.write_text("silent")
    told = appliance.wait_for("fault")
    assert "no frame for 5 s" in told["faults"][0]["sentence"]
    assert told["lamp"] == FAULT_LIGHT.name
    (kept,) = Spool(appliance.spool).takes()
    assert "no frame for 5 s" in kept.facts["ended_by"]
    assert appliance.ask("start")["what"].startswith("nothing can be recorded: ")
    appliance.cord.write_text("")
    appliance.wait_for("armed")
    assert recorded(appliance)["takes"] == 2


def test_a_sensor_that_vanishes_after_too_low_a_voltage_blames_the_power_supply(tmp_path, recording):
    alarm = tmp_path / "in0_lcrit_alarm"
    alarm.write_text("0\n")
    with VirtualAppliance(tmp_path / "a", recording, f'[power]\nalarm = "{alarm}"\n') as appliance:
        appliance.start()
        appliance.wait_for("armed")
        alarm.write_text("1\n")
        appliance.wait_until(lambda told: "power" in {fault["name"] for fault in told["faults"]}, "low voltage")
        appliance.cord.write_text("unplugged")
        told = appliance.wait_for("fault")
        sensor = next(fault for fault in told["faults"] if fault["name"] == "sensor")
        assert "after the board's voltage was too low" in sensor["sentence"]
        assert sensor["advice"].startswith("use a stronger power supply")


@pytest.mark.slow
def test_unplugged_and_plugged_in_again_in_mid_take_keeps_the_take_and_records_the_next(appliance):
    appliance.start()
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
    appliance.cord.write_text("unplugged")
    appliance.wait_for("fault")
    appliance.cord.write_text("")
    appliance.wait_for("armed")
    assert recorded(appliance)["takes"] == 2
    assert all(verify_take(kept.path).is_sound for kept in Spool(appliance.spool).takes())


BAD_DISK = """
import os, time
whole = os.fsync
def fsync(handle):
    if os.path.exists({flag!r}):
        time.sleep({seconds})
        if {fails}:
            raise OSError(5, "Input/output error")
    whole(handle)
os.fsync = fsync
"""


def bad_disk(appliance, *, seconds=0.0, fails=False):
    """Return Python that makes every fsync of the daemon slow, or fail, while a file is there; and the file."""
    flag = appliance.folder / "bad"
    return BAD_DISK.format(flag=str(flag), seconds=seconds, fails=fails), flag


@pytest.mark.slow
def test_a_disk_that_hangs_is_named_within_five_seconds_and_the_take_is_ended_not_thinned(appliance):
    before, flag = bad_disk(appliance, seconds=7.0)
    appliance.start(before=before)
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
    flag.touch()
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    behind = float(re.search(r"not finished writing for (\d\.\d) s", told["faults"][0]["sentence"])[1])
    assert told["faults"][0]["name"] == "disk_slow"
    assert behind <= 5.0
    assert told["state"] in ("recording", "saving")
    flag.unlink()
    told = appliance.wait_until(lambda told: told["takes"] == 1 and not told["faults"], "mended")
    (kept,) = Spool(appliance.spool).takes()
    take = read_take(kept.path)
    assert "has not finished writing" in kept.facts["ended_by"]
    steps = np.diff(take.time)
    is_reported = (take.state[1:] & FrameState.FRAMES_DROPPED_BEFORE) > 0
    assert (steps[~is_reported] < 1.5 / FPS).all()  # every missing frame is reported


def test_a_disk_that_fails_on_fsync_is_named_and_what_is_shown_as_kept_is_readable(appliance):
    before, flag = bad_disk(appliance, fails=True)
    appliance.start(before=before)
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 2.2, "recording")
    flag.touch()
    told = appliance.wait_for("fault", "saving")
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    assert "Input/output error" in told["faults"][0]["sentence"]
    assert "replace the card" in told["faults"][0]["advice"]
    assert not Spool(appliance.spool).takes()
    flag.unlink()
    appliance.wait_until(lambda told: told["takes"] == 1 and not told["faults"], "mended")
    (kept,) = Spool(appliance.spool).takes()
    assert verify_take(kept.path).is_sound
    assert len(read_take(kept.path).time) > 15


@pytest.mark.slow
def test_a_disk_that_fills_up_or_turns_read_only_is_named_and_recovers(tmp_path, recording):
    disk = tmp_path / "disk"
    with (
        small_disk(disk, "80M"),
        VirtualAppliance(tmp_path / "a", recording, "least_free_mb = 20\n", spool=disk / "takes") as appliance,
    ):
        appliance.start()
        appliance.wait_for("armed")
        appliance.ask("start")
        appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
        filler = disk / "filler"
        filler.write_bytes(bytes(77_000_000))  # less than 8 MB are left
        told = appliance.wait_for("fault", "saving")
        told = appliance.wait_until(lambda told: told["takes"] == 1 and told["faults"], "kept, and no room for more")
        assert re.search(r"only \d MB are left on the disk", told["faults"][0]["sentence"])
        assert "hangtime sync" in told["faults"][0]["advice"]
        (kept,) = Spool(appliance.spool).takes()
        assert verify_take(kept.path).is_sound
        filler.unlink()
        appliance.wait_for("armed")
        appliance.kill(signal.SIGTERM)
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        appliance.start()
        told = appliance.wait_for("fault")
        assert "Read-only file system" in told["faults"][0]["sentence"]
        assert appliance.ask("start")["what"].startswith("nothing can be recorded")
        subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
        appliance.wait_for("armed")
        assert recorded(appliance)["takes"] == 2


@pytest.mark.slow
def test_a_file_size_limit_in_mid_take_is_a_named_fault_and_keeps_what_was_written(appliance):
    appliance.start(environment={})
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 2.2, "recording")
    (partial,) = appliance.spool.glob("*.partial")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.prlimit(appliance.process.pid, resource.RLIMIT_FSIZE, (partial.stat().st_size + 10, limits[1]))
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    assert "File too large" in told["faults"][0]["sentence"]
    resource.prlimit(appliance.process.pid, resource.RLIMIT_FSIZE, limits)
    appliance.wait_until(lambda told: told["takes"] == 1, "kept")
    (kept,) = Spool(appliance.spool).takes()
    assert len(read_take(kept.path).time) > 15


def test_takes_that_are_moved_away_during_a_take_are_a_fault_within_five_seconds_and_back_with_it(appliance):
    """As where somebody pulls the disk of the spool: the light must not stay that of a recording."""
    appliance.start()
    appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed with a pre-roll")
    appliance.press()
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] >= 3.5, "recording")
    elsewhere = appliance.spool.with_name("elsewhere")
    appliance.spool.rename(elsewhere)
    moved = time.monotonic()
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    assert time.monotonic() - moved < 5.0
    assert "this is not the folder of takes that the recorder began with" in told["faults"][0]["sentence"]
    appliance.wait_for("fault")
    assert appliance.ask("start")["what"].startswith("nothing can be recorded: ")
    assert not appliance.spool.exists()
    elsewhere.rename(appliance.spool)
    appliance.wait_until(lambda told: told["takes"] == 1 and told["state"] == "armed", "the take of before")
    (kept,) = Spool(appliance.spool).takes()
    assert verify_take(kept.path).is_sound
    assert len(read_take(kept.path).time) > 3 * FPS - 1
    assert recorded(appliance, seconds=0.8)["takes"] == 2
