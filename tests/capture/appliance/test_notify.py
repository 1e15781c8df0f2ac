"""What systemd hears of the recorder (`man 3 sd_notify`), on a real datagram socket."""

from __future__ import annotations

import socket
import threading

import sdnotify

from capture.appliance.__main__ import _loop
from capture.appliance.disk import DiskNews
from capture.appliance.memory import StartingMemory
from firmware_host.depth_sensor import SensorFrame
from tests.capture.appliance.scripted_loop import FRAME, NOTHING, Loop

SOUND_AT, LAST = 4, 9  # iterations of the loop: the sensor and the spool are sound in the fourth


def test_systemd_hears_that_the_recorder_is_ready_once_and_not_before_sensor_and_spool_are_sound(tmp_path, monkeypatch):
    """A unit that counts as ready too early would pass an upgrade that never opens its sensor."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "10000000")
        loop, stop, heard, kept = Loop(tmp_path), threading.Event(), [[]], []
        step, notifiers, make = loop.it.step, [], sdnotify.SystemdNotifier
        monkeypatch.setattr(sdnotify, "SystemdNotifier", lambda: notifiers.append(make()) or notifiers[-1])

        def next_step():
            heard.append(received(systemd))
            number = len(heard) - 1
            if number == SOUND_AT:
                loop.keeper.is_open = True
                loop.disk.coming.append(DiskNews(is_sound=True))
                loop.keeper.frames.append(
                    SensorFrame(
                        index=0, time_s=loop.now, host_time_s=loop.now, depth=NOTHING, colour=None, dropped_before=0
                    )
                )  # fmt: skip
            loop.now += FRAME
            step()
            if number == LAST:
                stop.set()

        loop.it.step = next_step
        _loop(loop.it, stop, StartingMemory(), lambda: kept.append(len(heard) - 1))
        notifiers[0].socket.close()  # which the end of the process does
        told = [*heard[2:], received(systemd)]  # told[k]: after iteration k + 1
    places = [number for number, lines in enumerate(told, 1) if "READY=1" in lines]
    assert places == [SOUND_AT]
    assert kept == [SOUND_AT]
    assert sum(lines.count("READY=1") for lines in told) == 1
    assert told[0][0] == "WATCHDOG=1"
    assert sum(lines.count("WATCHDOG=1") for lines in told) == 1  # the next one is due after 2.5 s
    assert told[-1][-1] == "STOPPING=1"


def received(systemd):
    """The datagrams that have arrived."""
    found = []
    while True:
        try:
            found.append(systemd.recv(4096).decode())
        except BlockingIOError:
            return found
