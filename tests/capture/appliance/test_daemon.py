"""The real daemon, a process of its own: button, lamp, socket, kills, and disks that are bad."""

from __future__ import annotations

import json
import os
import random
import re
import resource
import signal
import stat
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from capture.appliance.control import ControlServer, ask, listen
from capture.appliance.showing import ARMED, FAULT, RECORDING
from capture.appliance.spool import Spool
from capture.errors import ControlError
from firmware_host import openni2_library
from firmware_host.button import DOWN, UP
from firmware_host.errors import SensorError
from formats.archive import read_take, verify_take
from formats.take import FrameState
from tests.capture.appliance.virtual_appliance import LONGEST, ROOT, VirtualAppliance, draw_recording

FPS = 15  # of the recording that stands for the sensor


def has_openni():
    try:
        openni2_library.load()
    except SensorError:
        return False
    return True


pytestmark = [pytest.mark.openni, pytest.mark.skipif(not has_openni(), reason="libopenni2 is not here")]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("sensor") / "swing.oni"
    draw_recording(path, fps=FPS, seconds=2.0)
    return path


@pytest.fixture
def appliance(tmp_path, recording):
    with VirtualAppliance(tmp_path, recording) as one:
        yield one


def recorded(appliance, seconds=1.5):
    """Record for so long by the button; return the status afterwards."""
    appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed with a pre-roll")
    before = appliance.ask("status")["takes"]
    appliance.press()
    appliance.wait_until(
        lambda told: told["recording"] and told["recording"]["seconds"] >= 2.0 + seconds, f"recording {seconds} s"
    )
    appliance.press()
    return appliance.wait_until(lambda told: told["takes"] > before, "kept")


def test_a_press_records_with_two_seconds_before_it_and_a_second_press_keeps_the_take(appliance):
    appliance.start()
    appliance.wait_for("armed")
    assert appliance.lamp == ("timer", str(ARMED.light_ms), str(ARMED.dark_ms))
    appliance.wait_until(lambda told: told["pre_roll_s"] >= 2.0, "a full pre-roll")
    appliance.press((DOWN, UP, DOWN, UP))  # an impatient finger, or a contact that bounces
    told = appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 40, "recording")
    assert 2.0 <= told["recording"]["pre_roll_s"] < 2.5
    assert (told["lamp"], appliance.lamp[0]) == (RECORDING.name, "none")
    appliance.press()
    told = appliance.wait_until(lambda told: told["takes"] == 1, "kept")
    (kept,) = Spool(appliance.spool).takes()
    take = read_take(kept.path)
    assert take.is_complete
    assert verify_take(kept.path).is_sound
    assert take.take_id == "take-000001"
    assert told["last_take"]["kept"] == str(kept.path)
    assert told["waiting"] == 1
    assert kept.facts["begun_by"] == kept.facts["ended_by"] == "button"
    assert kept.facts["frames"] == len(take.time) > 40
    assert kept.facts["seconds"] == pytest.approx(take.time[-1] - take.time[0], abs=1e-4)
    assert kept.facts["clock_source"] in ("NTP", "RTC", "none")
    assert take.notes["pre_roll_s"] == f"{kept.facts['pre_roll_s']:.3f}"
    assert (take.state & FrameState.FRAMES_DROPPED_BEFORE > 0).sum() == kept.facts["gaps"]


def test_the_commands_speak_with_it_and_it_imports_nothing_heavy_and_listens_to_no_network(appliance):
    modules = appliance.folder / "modules"
    appliance.start(
        before="import atexit, sys, pathlib\n"
        f"atexit.register(lambda: pathlib.Path({str(modules)!r}).write_text(' '.join(sys.modules)))"
    )
    appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] > 0.5, "armed")
    program = [sys.executable, "-c", "from formats.command import main; main()"]
    environment = os.environ | {"HANGTIME_SOCKET": str(appliance.socket), "PYTHONPATH": str(ROOT)}

    def run(*words):
        return subprocess.run([*program, *words], env=environment, capture_output=True, text=True, timeout=LONGEST)

    assert run("start").returncode == 0
    again = run("start")
    assert (again.returncode, again.stderr) == (
        2, "hangtime: it is recording already; `hangtime stop` ends the take\n",
    )  # fmt: skip
    said = run("status", "--json", "--preview", str(appliance.folder / "seen.png"))
    told = json.loads(said.stdout)
    assert (told["state"], said.returncode) == ("recording", 0)
    assert {"frames", "dropped", "gaps", "bytes_kept", "waiting", "last_sync", "last_proof"} <= set(told)
    assert re.fullmatch(r"hanger and garment are seen: hanger 1\.[56]\d m away, 4 of 4 points", told["sees"])
    assert (appliance.folder / "seen.png").read_bytes().startswith(b"\x89PNG")
    assert sockets_of_network(appliance.process.pid) == 0
    assert run("stop").returncode == 0
    appliance.wait_until(lambda told: told["takes"] == 1, "kept")
    assert appliance.kill(signal.SIGTERM) == 0
    loaded = {name.split(".")[0] for name in modules.read_text().split()}
    assert {"cv2", "numpy", "mcap"} <= loaded
    assert not loaded & {
        "typer",
        "click",
        "scipy",
        "taichi",
        "boto3",
        "botocore",
        "obstore",
        "pyrage",
        "asyncio",
        "ssl",
    }
    gone = run("status")
    assert gone.returncode == 2
    assert "no daemon listens here; start it: `systemctl start hangtime-capture`" in gone.stderr


def sockets_of_network(pid):
    """Count the process's sockets that are in the kernel's tables of TCP and UDP."""
    own = {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink() and link.exists()}
    own |= {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()}
    count = 0
    for table in ("tcp", "tcp6", "udp", "udp6", "raw"):
        path = Path(f"/proc/{pid}/net/{table}")
        if path.exists():
            count += sum(f"socket:[{line.split()[9]}]" in own for line in path.read_text().splitlines()[1:])
    return count


def test_only_the_group_may_use_the_socket(appliance):
    appliance.start()
    appliance.wait_for("ready", "armed")
    assert stat.S_IMODE(appliance.socket.stat().st_mode) == 0o660
    with pytest.raises(ControlError, match="another daemon listens here"):
        ControlServer(appliance.socket)


def test_watch_tells_every_change_of_state(appliance):
    appliance.start()
    appliance.wait_for("armed")
    news = listen(appliance.socket, "watch")
    assert next(news)["state"] == "armed"
    ask(appliance.socket, "start")
    seen = [next(news)["state"]]
    while seen[-1] != "recording":
        seen.append(next(news)["state"])
    ask(appliance.socket, "stop")
    while seen[-1] != "armed":
        seen.append(next(news)["state"])
    changes = [state for state, before in zip(seen, [None, *seen], strict=False) if state != before]
    assert changes[changes.index("recording") :] == ["recording", "saving", "ready", "armed"]
    news.close()


def test_sigterm_while_it_records_keeps_the_take(appliance):
    appliance.start()
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 15, "recording")
    assert appliance.kill(signal.SIGTERM) == 0
    (kept,) = Spool(appliance.spool).takes()
    assert verify_take(kept.path).is_sound
    assert kept.facts["ended_by"] == "the appliance was stopped"
    assert appliance.lamp == ("none", "0")


def test_a_kill_in_mid_take_costs_its_last_two_seconds_at_most_and_is_named_at_the_next_start(appliance):
    random_after = random.Random(4).uniform(2.5, 4.0)
    appliance.start()
    appliance.wait_for("armed")
    appliance.ask("start")
    told = appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > random_after, "late")
    appliance.kill()
    assert not Spool(appliance.spool).takes()
    appliance.start()
    after = appliance.wait_until(lambda told: told["salvaged"] == 1 and told["takes"] == 1, "salvaged")
    (kept,) = Spool(appliance.spool).takes()
    take = read_take(kept.path)
    assert take.time[-1] - take.time[0] > told["recording"]["seconds"] - 2.0
    assert "a power cut or a crash" in kept.facts["salvaged"]
    assert after["faults"] == []
    told = recorded(appliance)
    assert [one.sequence for one in Spool(appliance.spool).takes()] == [1, 2]


def test_a_bad_configuration_at_the_start_is_shown_and_the_last_good_one_records(appliance):
    appliance.start()
    appliance.wait_for("ready", "armed")
    appliance.kill(signal.SIGTERM)
    appliance.config.write_text(appliance.config.read_text() + "[buton]\n")
    appliance.start()
    told = appliance.wait_for("armed")
    (fault,) = told["faults"]
    assert (fault["name"], fault["blocks"]) == ("config", False)
    assert "unknown field `buton`" in fault["sentence"]
    assert recorded(appliance)["takes"] == 1


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
    assert told["lamp"] == FAULT.name
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
    begun = time.monotonic()
    flag.touch()
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    behind = float(re.search(r"not finished writing for (\d\.\d) s", told["faults"][0]["sentence"])[1])
    assert told["faults"][0]["name"] == "disk_slow"
    assert behind <= 5.0 < time.monotonic() - begun + 5.0
    assert told["state"] in ("recording", "saving")
    flag.unlink()
    told = appliance.wait_until(lambda told: told["takes"] == 1 and not told["faults"], "mended")
    (kept,) = Spool(appliance.spool).takes()
    take = read_take(kept.path)
    assert "has not finished writing" in kept.facts["ended_by"]
    steps = np.diff(take.time)
    told_of = (take.state[1:] & FrameState.FRAMES_DROPPED_BEFORE) > 0
    assert (steps[~told_of] < 1.5 / FPS).all()  # no frame is missing without being told of


def test_a_disk_that_fails_on_fsync_is_named_and_what_is_shown_as_kept_is_readable(appliance):
    before, flag = bad_disk(appliance, fails=True)
    appliance.start(before=before)
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 3.0, "recording")
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


@contextmanager
def small_disk(folder, size):
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True)
    if made.returncode:
        pytest.skip("this user may not mount")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.slow
def test_a_disk_that_fills_up_or_turns_read_only_is_named_and_mends_by_itself(tmp_path, recording):
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
        told = appliance.wait_until(lambda told: told["takes"] == 1, "kept")
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


def test_a_file_size_limit_in_mid_take_is_a_named_fault_and_keeps_what_was_written(appliance):
    appliance.start(environment={})
    appliance.wait_for("armed")
    appliance.ask("start")
    appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 3.0, "recording")
    (partial,) = appliance.spool.glob("*.partial")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.prlimit(appliance.process.pid, resource.RLIMIT_FSIZE, (partial.stat().st_size + 10, limits[1]))
    told = appliance.wait_until(lambda told: told["faults"], "a fault")
    assert "File too large" in told["faults"][0]["sentence"]
    resource.prlimit(appliance.process.pid, resource.RLIMIT_FSIZE, limits)
    appliance.wait_until(lambda told: told["takes"] == 1, "kept")
    (kept,) = Spool(appliance.spool).takes()
    assert len(read_take(kept.path).time) > 15


def test_a_take_in_which_the_hanger_was_hardly_seen_is_not_kept_and_says_why(tmp_path):
    wall = tmp_path / "wall.oni"
    draw_recording(wall, fps=5, seconds=2.0, has_hanger=False)
    with VirtualAppliance(tmp_path / "a", wall) as appliance:
        appliance.start()
        appliance.wait_for("ready")
        appliance.ask("start")
        appliance.wait_until(lambda told: told["recording"] and told["recording"]["frames"] > 5, "recording")
        appliance.ask("stop")
        told = appliance.wait_for("ready")
        (finding,) = told["last_take"]["findings"]
        assert told["last_take"]["kept"] is None
        assert finding["words"].startswith("nothing was kept: both hanger markers were seen in 0 of ")
        assert told["lamp"] == "look"
        assert not Spool(appliance.spool).takes()


@pytest.mark.slow
def test_a_take_ends_by_itself_after_the_longest_time(tmp_path, recording):
    with VirtualAppliance(tmp_path / "a", recording, "[recording]\nlongest_s = 5.0\npre_roll_s = 1.0\n") as appliance:
        appliance.start()
        appliance.wait_until(lambda told: told["pre_roll_s"] >= 1.0, "armed")
        appliance.ask("start")
        appliance.wait_until(lambda told: told["takes"] == 1, "kept")
        (kept,) = Spool(appliance.spool).takes()
        assert kept.facts["ended_by"] == "longest_s of the configuration"
        assert kept.facts["seconds"] - kept.facts["pre_roll_s"] == pytest.approx(5.0, abs=0.5)


def test_a_second_daemon_is_refused_and_the_first_goes_on(appliance):
    appliance.start()
    appliance.wait_for("armed")
    second = subprocess.run(
        [sys.executable, "-m", "capture.appliance", "--config", str(appliance.config)], cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=LONGEST,
    )  # fmt: skip
    assert second.returncode == 2
    assert "another daemon listens here; stop it first" in second.stderr
    assert appliance.ask("status")["state"] == "armed"
