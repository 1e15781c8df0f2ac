"""Measure the real daemon: start-up, memory, processor time, response to the button, and losses by kills.

The sensor is a drawn recording that is played as a live one (30 frames a second, 640 x 480). The button is a pipe of
input events, and the lamp is a folder. Playing the recording costs memory and time of the daemon's process; its
thread's time is shown separately. After each kill this script starts the daemon again, as systemd would.

Run: python benchmarks/appliance.py [--seconds 20] [--kills 25] [--at-once 1] [--seed 1]. 500 kills take about half an
hour with `--at-once 2`.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

FPS = 30
TARGETS = {
    "start to ready": (3.0, "s"), "memory, ready": (70.0, "MB"), "memory, recording": (110.0, "MB"),
    "processor, ready": (2.0, "% of a core"), "press to first frame": (100.0, "ms"),
}  # fmt: skip
TAKE_SECONDS = 6.0  # s, length of a take that may be killed
STARTING = 1.2  # of the last start's duration: latest kill of a starting daemon
SLACK = 2.0  # s of the running take that a kill may cost


def resident(process: psutil.Process) -> float:
    """Return the memory of a process that is in use now [MB = 10^6 bytes]."""
    return process.memory_info().rss / 1e6


def spent(process: psutil.Process) -> tuple[float, float]:
    """Return the processor time [s] of a process, and that of its busiest other thread, which reads frames."""
    times = process.cpu_times()
    others = [thread.user_time + thread.system_time for thread in process.threads() if thread.id != process.pid]
    return times.user + times.system, max(others, default=0.0)


def measure(seconds: float, folder: Path) -> dict[str, float]:
    """Run the daemon with a bare wall and with a hanger in view; return the figures by the names of `TARGETS`."""
    from tests.capture.appliance.virtual_appliance import VirtualAppliance, draw_recording

    found: dict[str, float] = {}
    for name, has_hanger in (("wall", False), ("hanger", True)):
        recording = folder / f"{name}.oni"
        draw_recording(recording, fps=FPS, seconds=2.0, has_hanger=has_hanger)
        with VirtualAppliance(folder / name, recording) as appliance:
            begun = time.monotonic()
            appliance.start()
            appliance.wait_for("ready", "armed")
            found["start to ready"] = max(found.get("start to ready", 0.0), time.monotonic() - begun)
            process = psutil.Process(appliance.process.pid)
            if has_hanger:
                appliance.wait_until(lambda status: status["pre_roll_s"] >= 2.0, "armed")
                begun = time.monotonic()
                appliance.press()
                status = appliance.wait_for("recording")
                found["press to first frame"] = 1e3 * (time.monotonic() - begun)
                found["pre-roll"] = status["recording"]["pre_roll_s"]
            before, fetched = spent(process)
            begun, most = time.monotonic(), 0.0
            while time.monotonic() - begun < seconds:
                time.sleep(0.25)
                most = max(most, resident(process))
            after, fetched_after = spent(process)
            took = time.monotonic() - begun
            kind = "recording" if has_hanger else "ready"
            found[f"memory, {kind}"] = most
            found[f"memory, {kind}, at the end"] = resident(process)
            found[f"processor, {kind}"] = 100 * (after - before) / took
            found[f"of this the player, {kind}"] = 100 * (fetched_after - fetched) / took
            if has_hanger:
                status = appliance.ask("status")["recording"]
                found["frames"], found["dropped"] = status["frames"], status["dropped"]
    return found


def kill_often(kills: int, seed: int, folder: Path, at_once: int = 1) -> dict[str, float]:
    """Kill daemons at random moments, several in parallel; return the counts of kept and lost takes.

    A third of the kills hits the start, in which the daemon opens the sensor and recovers the last take.
    """
    from tests.capture.appliance.virtual_appliance import draw_recording

    recording = folder / "swing.oni"
    draw_recording(recording, fps=15, seconds=2.0)
    shares = [kills // at_once + (one < kills % at_once) for one in range(at_once)]
    with ThreadPoolExecutor(at_once) as pool:
        asked = [
            pool.submit(kill_one, share, 1000 * seed + one, recording, folder / f"kills-{one}")
            for one, share in enumerate(shares)
        ]  # fmt: skip
        found = [one.result() for one in asked]
    worst = "most lost of a running take"
    return {name: (max if name == worst else sum)(one[name] for one in found) for name in found[0]}


def kill_one(kills: int, seed: int, recording: Path, folder: Path) -> dict[str, float]:
    """Kill one daemon at random moments of starting, recording and saving; return the counts of its takes."""
    from capture.appliance.spool import Spool
    from formats.archive import read_take, verify_take
    from tests.capture.appliance.virtual_appliance import VirtualAppliance

    rng = random.Random(seed)
    promised: dict[int, float] = {}  # by number: seconds of the take that the daemon reported before the kill
    found = {"kills": 0, "while it started": 0, "takes": 0, "lost": 0, "doubled": 0, "damaged": 0}
    found["most lost of a running take"] = 0.0
    with VirtualAppliance(folder, recording) as appliance:
        took = 2.0  # s from start to ready
        for _ in range(kills):
            found["kills"] += 1
            begun = time.monotonic()
            appliance.start()
            if rng.random() < 1 / 3:
                time.sleep(rng.uniform(0.0, STARTING * took))
                found["while it started"] += 1
                appliance.kill(signal.SIGKILL)
                continue
            appliance.wait_for("armed")
            took = time.monotonic() - begun
            before = last_number(appliance.spool)
            appliance.ask("start")
            until = time.monotonic() + rng.uniform(0.0, TAKE_SECONDS)
            seconds = 0.0
            while time.monotonic() < until:
                running = appliance.ask("status")["recording"]
                seconds = running["seconds"] if running else seconds
                time.sleep(0.01)
            number = last_number(appliance.spool)
            if rng.random() < 0.5:
                appliance.ask("stop")
                time.sleep(rng.uniform(0.0, 0.05))
            appliance.kill(signal.SIGKILL)
            if number > before:
                promised[number] = seconds
            else:
                found["lost"] += seconds > SLACK
        appliance.start()
        appliance.wait_for("armed")
        appliance.kill(signal.SIGTERM)
        kept = {take.sequence: take for take in Spool(appliance.spool).takes()}
        found["takes"] = len(kept)
        found["doubled"] = len(Spool(appliance.spool).takes()) - len({take.facts["sha256"] for take in kept.values()})
        for number, seconds in promised.items():
            if number not in kept:
                found["lost"] += seconds > SLACK
                continue
            found["damaged"] += not verify_take(kept[number].path).is_sound
            times = read_take(kept[number].path).time
            missing = seconds - float(times[-1] - times[0])
            found["most lost of a running take"] = max(found["most lost of a running take"], missing)
    return found


def last_number(spool: Path) -> int:
    """Return the last number that a spool assigned to a take, 0 if none yet."""
    path = spool / "sequence"
    return int(path.read_text()) if path.exists() else 0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="each state is watched so long; 0: kills only")
    parser.add_argument("--kills", type=int, default=25)
    parser.add_argument("--at-once", type=int, default=1, help="so many daemons are killed side by side")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        for name, value in (measure(options.seconds, Path(folder)) if options.seconds else {}).items():
            target = TARGETS.get(name)
            beside = "" if target is None else f"   (target at most {target[0]:g} {target[1]})"
            print(f"{name:32} {value:8.2f}{beside}")
        if options.kills:
            for name, value in kill_often(options.kills, options.seed, Path(folder), options.at_once).items():
                beside = {"most lost of a running take": f"   (target at most {SLACK:g} s)"}
                beside |= dict.fromkeys(("lost", "doubled", "damaged"), "   (target 0)")
                print(f"{name:32} {value:8.2f}{beside.get(name, '')}", flush=True)


if __name__ == "__main__":
    main()
