"""`python -m capture.appliance`: the daemon, as the unit runs it. It imports no Typer and opens no network socket."""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import sys
import threading
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import msgspec
import sdnotify

from capture.appliance.config import DEFAULT, Config, load_or_last_good
from capture.appliance.control import ControlServer
from capture.appliance.daemon import Appliance
from capture.appliance.disk import Disk
from capture.appliance.log import LOG, log_to_stderr
from capture.appliance.retention import Retention
from capture.appliance.sensor_keeper import SensorKeeper
from capture.appliance.states import State
from capture.appliance.wall_clock import monotonic
from capture.recording.stop_signals import STOPPING
from firmware_host.opening import open_sensor
from formats.errors import HangtimeError

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8  # `man 3 mallopt`
PICTURE = 256 * 1024  # bytes; larger pieces of memory go back to the system when they are freed


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
        HangtimeError: there is no configuration, old or new, or another daemon is running.
    """
    in_force = load_or_last_good(path)
    if in_force.refused is not None:
        LOG.error("%s; the last configuration that held stays in force", in_force.refused)
    config = in_force.config
    stop = threading.Event()

    def ask_to_stop(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in STOPPING:
        signal.signal(number, ask_to_stop)
    cv2.setNumThreads(1)
    _give_memory_back()
    with ExitStack() as opened:
        control = ControlServer(config.control.socket, config.control.group)
        opened.callback(control.close)
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
        _loop(appliance, stop)
        LOG.info("stopped")


def _retention(config: Config) -> Retention:
    """Return how long takes stay, which is sync's to say.

    Sync complains of a table that does not hold; until it is mended a take leaves only where the disk is full.
    """
    try:
        return msgspec.convert(config.sync.get("retention", {}), Retention)
    except msgspec.ValidationError:
        return Retention(quota_bytes=sys.maxsize, days=None)


def _server(config: Config) -> str | None:
    """Return the address of the server, which is sync's to judge; None where none is named."""
    url = config.sync.get("url")
    return url if isinstance(url, str) else None


def _give_memory_back() -> None:
    """Let freed pictures go back to the system, and all threads share one heap: it is what pictures leave holes in."""
    with suppress(OSError, AttributeError):  # another C library
        library = ctypes.CDLL(None)
        library.mallopt(M_ARENA_MAX, 1)
        library.mallopt(M_MMAP_THRESHOLD, PICTURE)


def _let_go_of_the_heap() -> None:
    """Give back what loading the modules left free in the heap."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def _loop(appliance: Appliance, stop: threading.Event) -> None:
    """Go round until asked to stop; tell systemd how it goes, and that the loop still goes round."""
    systemd = sdnotify.SystemdNotifier()
    limit = float(os.environ.get("WATCHDOG_USEC", "0")) * 1e-6
    fed = told = -float("inf")
    was_started = False
    was: State | None = None
    while not stop.is_set():
        appliance.step()
        now = monotonic()
        if limit and now - fed >= limit / 4:
            fed = now
            systemd.notify("WATCHDOG=1")
        if appliance.is_started and not was_started:
            was_started = True
            _let_go_of_the_heap()
            systemd.notify("READY=1")
        if appliance.machine.state is not was and now - told >= 0.2:
            was, told = appliance.machine.state, now
            systemd.notify(f"STATUS={was.value}")
    systemd.notify("STOPPING=1")
    appliance.say_goodbye()


if __name__ == "__main__":
    main()
