"""`python -m capture.appliance`: the daemon that the systemd unit starts, without Typer and network sockets."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import FrameType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import msgspec
import sdnotify

from capture.appliance.config import DEFAULT, InForce
from capture.appliance.config_tables import Config
from capture.appliance.control import ControlServer
from capture.appliance.daemon import Appliance
from capture.appliance.disk import Disk
from capture.appliance.last_good import keep, last_good, load_or_last_good
from capture.appliance.log import LOG, log_to_stderr
from capture.appliance.memory import StartingMemory, share_one_heap
from capture.appliance.receipts import DEFAULT_URL
from capture.appliance.retention import Retention
from capture.appliance.sensor_keeper import SensorKeeper
from capture.appliance.states import State
from capture.appliance.wall_clock import monotonic
from capture.errors import AnotherDaemonError, ControlError
from capture.recording.stop_signals import STOPPING
from firmware_host.opening import open_sensor
from formats.errors import HangtimeError


def main() -> None:
    """Run the daemon; an error that a user can act on becomes one sentence and exit code 2."""
    parser = argparse.ArgumentParser(prog="hangtime daemon", description="Record takes at the press of a button.")
    parser.add_argument("--config", type=Path, default=DEFAULT, help="the configuration, TOML")
    options = parser.parse_args()
    log_to_stderr()
    try:
        run(options.config)
    except HangtimeError as error:
        LOG.error("hangtime: %s", error)
        sys.exit(error.exit_code)


def run(path: Path) -> None:
    """Run the daemon until it is asked to stop.

    Raises:
        HangtimeError: no configuration, current or last valid, can be read, or another daemon is running.
    """
    in_force = load_or_last_good(path)
    stop = threading.Event()

    def ask_to_stop(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in STOPPING:
        signal.signal(number, ask_to_stop)
    cv2.setNumThreads(1)
    share_one_heap()
    starting_memory = StartingMemory()
    with ExitStack() as opened:
        control, in_force = _listen(in_force, path)
        opened.callback(control.close)
        config = in_force.config
        disk = Disk(
            config.spool.folder,
            least_free=config.spool.least_free_mb * 1_000_000,
            retention=_retention(config),
            url=_server(config),
            clock=monotonic,
        )
        disk.start()
        opened.callback(disk.close, 5.0)
        keeper = SensorKeeper(lambda: open_sensor(config.sensor.address), in_force.rig, monotonic)
        opened.callback(keeper.close)
        appliance = Appliance(in_force, keeper=keeper, disk=disk, control=control, clock=monotonic)
        _loop(appliance, stop, starting_memory, lambda: _keep_if_new(in_force, path))
        LOG.info("stopped")


def _listen(in_force: InForce, path: Path) -> tuple[ControlServer, InForce]:
    """Open the control socket; if it fails, fall back to the last valid configuration, and return the one used.

    Raises:
        HangtimeError: another daemon is running, or no last valid configuration names another socket.
    """
    part = in_force.config.control
    try:
        return ControlServer(part.socket, part.group), in_force
    except AnotherDaemonError:
        raise
    except ControlError as error:
        before = last_good(path, error)
        part_before = before.config.control
        if in_force.refused is not None or part_before == part:
            raise
        return ControlServer(part_before.socket, part_before.group), before


def _keep_if_new(in_force: InForce, path: Path) -> None:
    """Store the configuration as the last valid one, in a thread, so that the loop does not wait for the disk."""
    if in_force.refused is None:
        threading.Thread(target=keep, args=(in_force, path), name="keep", daemon=True).start()


def _retention(config: Config) -> Retention:
    """Return the retention settings of the `[sync]` table.

    Sync reports an invalid table. Until a user corrects the table, takes are removed only when the disk is full.
    """
    try:
        return msgspec.convert(config.sync.get("retention", {}), Retention)
    except msgspec.ValidationError:
        return Retention(quota_bytes=sys.maxsize, days=None)


def _server(config: Config) -> str:
    """Return the server's address from `[sync]`, "" if it is not a string; sync validates the address."""
    url = config.sync.get("url", DEFAULT_URL)
    return url if isinstance(url, str) else ""


def _loop(
    appliance: Appliance, stop: threading.Event, starting_memory: StartingMemory, once_ready: Callable[[], None],
) -> None:  # fmt: skip
    """Run the loop until asked to stop; report the state and the watchdog's keep-alive to systemd."""
    systemd = sdnotify.SystemdNotifier()
    limit = float(os.environ.get("WATCHDOG_USEC", "0")) * 1e-6
    fed = notified = -float("inf")
    was_started = was_ready = False
    was: State | None = None
    while not stop.is_set():
        appliance.step()
        now = monotonic()
        if limit and now - fed >= limit / 4:
            fed = now
            systemd.notify("WATCHDOG=1")
        if appliance.is_started and not was_started:
            was_started = True
            systemd.notify("READY=1")
        if not was_ready and appliance.machine.may_record:
            was_ready = True
            once_ready()
        starting_memory.let_go(now, is_started=was_started)
        if appliance.machine.state is not was and now - notified >= 0.2:
            was, notified = appliance.machine.state, now
            systemd.notify(f"STATUS={was.value}")
    systemd.notify("STOPPING=1")
    appliance.shut_down()


if __name__ == "__main__":
    main()
