"""The real daemon in a separate process: button, lamp, socket, configuration and kills."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import stat
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from capture.appliance.control import ControlServer, ask, listen
from capture.appliance.showing import ARMED, RECORDING
from capture.appliance.spool import Spool
from capture.errors import ControlError
from firmware_host.button import DOWN, UP
from formats.archive import read_take, verify_take
from formats.take import FrameState
from tests.capture.appliance.real_daemon import needs_openni, recorded
from tests.capture.appliance.virtual_appliance import LONGEST, ROOT, VirtualAppliance, draw_recording
from tests.fit.here import hangtime_here

pytestmark = needs_openni


def test_a_press_records_with_two_seconds_before_it_and_a_second_press_keeps_the_take(appliance):
    appliance.start()
    appliance.wait_for("armed")
    assert appliance.lamp == ("timer", str(ARMED.light_ms), str(ARMED.dark_ms))
    appliance.wait_until(lambda told: told["pre_roll_s"] >= 2.0, "a full pre-roll")
    appliance.press((DOWN, UP, DOWN, UP))  # a double press, or a bouncing contact
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


def test_the_commands_speak_with_it_and_it_imports_nothing_heavy_and_listens_to_no_network(appliance, monkeypatch):
    modules = appliance.folder / "modules"
    appliance.start(
        before="import atexit, sys, pathlib\n"
        f"atexit.register(lambda: pathlib.Path({str(modules)!r}).write_text(' '.join(sys.modules)))"
    )
    appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] > 0.5, "armed")
    monkeypatch.setenv("HANGTIME_SOCKET", str(appliance.socket))
    run = partial(hangtime_here, folder=appliance.folder)
    assert run("start").returncode == 0
    again = run("start")
    assert (again.returncode, again.stderr) == (
        2, f"hangtime: {appliance.socket}: a take is being recorded already; `hangtime stop` ends the take\n",
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
    assert "no recorder listens here; start it: `systemctl start hangtime-capture`" in gone.stderr


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
    with pytest.raises(ControlError, match="another recorder listens here"):
        ControlServer(appliance.socket)


def test_watch_prints_every_change_of_state(appliance):
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


@pytest.mark.slow
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
    told = recorded(appliance, seconds=0.8)
    assert [one.sequence for one in Spool(appliance.spool).takes()] == [1, 2]


@pytest.mark.slow
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
    assert recorded(appliance, seconds=0.8)["takes"] == 1


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('[control]\ngroup = "no-such-group"\n', "there is no group 'no-such-group'"),
        pytest.param(
            '[control]\nsocket = "rig.toml"\n', "something else has this name", marks=pytest.mark.slow
        ),
        pytest.param(f'[control]\nsocket = "{"x" * 200}"\n', "bytes, Linux takes 107", marks=pytest.mark.slow),
    ],
    ids=["group", "file", "long"],
)  # fmt: skip
def test_a_socket_that_cannot_be_made_leaves_the_last_good_configuration_in_force(appliance, line, said):
    appliance.start()
    appliance.wait_for("armed")
    appliance.kill(signal.SIGTERM)
    good = appliance.config.read_text()
    appliance.config.write_text(good.replace("[control]\n", line if "group" in line else "[control]\n"))
    if "socket" in line:
        appliance.config.write_text(good.replace('[control]\nsocket = "control.sock"\n', line))
    for _ in range(2):  # the second start finds the copy that the first start left unchanged
        appliance.start()
        told = appliance.wait_for("armed")
        (fault,) = told["faults"]
        assert (fault["name"], fault["blocks"]) == ("config", False)
        assert said in fault["sentence"]
        assert fault["sentence"].endswith(" (the last valid settings are in force)")
        assert fault["advice"].endswith("; then `systemctl restart hangtime-capture`")
        appliance.kill(signal.SIGTERM)


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


@pytest.mark.slow
def test_a_second_daemon_is_refused_and_the_first_goes_on(appliance):
    appliance.start()
    appliance.wait_for("armed")
    second = subprocess.run(
        [sys.executable, "-m", "capture.appliance", "--config", str(appliance.config)], cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=LONGEST,
    )  # fmt: skip
    assert second.returncode == 2
    assert "another recorder listens here; stop it first" in second.stderr
    assert appliance.ask("status")["state"] == "armed"
