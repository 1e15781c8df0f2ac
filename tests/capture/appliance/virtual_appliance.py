"""An appliance without hardware: the real daemon, a recording played as a live sensor, button and lamp as files.

The button is a named pipe that carries the kernel's input events, the lamp a folder with the files of an LED.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from capture.appliance.control import ask
from capture.errors import ControlError
from firmware_host.button import DOWN, EVENT, KEY_EVENT, UP
from firmware_host.oni_writer import OniWriter
from formats.descriptions import dump_description
from formats.rig import Rig, Sensor
from tests.capture.garment.towel import GARMENT, HANGER
from tests.capture.stage import marker_plate, pictures, plain_plate

ROOT = Path(__file__).parents[3]
CAMERA = Sensor(width=640, height=480, fx=575.8, fy=575.8, cx=319.5, cy=239.5)
RIG = Rig(format="hangtime-rig/1", name="virtual", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=CAMERA)
BTN_0 = 0x100
LED_FILES = {"brightness": "0", "max_brightness": "1", "trigger": "[none] timer", "delay_on": "0", "delay_off": "0"}
LONGEST = 600.0  # s, limit of every wait; a busy machine may exceed a shorter one


def draw_recording(path: Path, *, fps: int, seconds: float = 1.0, has_hanger: bool = True) -> None:
    """Draw a hanger with a towel that swings to and fro by 8 cm once a second, or the bare wall, as an .oni file."""
    rng = np.random.default_rng(1)
    shown = []
    for k in range(fps):
        middle = np.array([0.08, 0.0, 0.03]) * np.sin(2 * np.pi * k / fps) + np.array([0.0, -0.2, 1.6])
        plates = [marker_plate(i, middle + np.array([side, 0, 0])) for i, side in ((0, -0.15), (1, 0.15))]
        plates.append(plain_plate(middle + np.array([0, 0.29, 0]), (0.4, 0.4), (60, 70, 150)))
        shown.append(pictures(plates if has_hanger else [], rng))
    with OniWriter(path, CAMERA, fps=fps, depth_codec="NONE") as recording:
        for number in range(round(fps * seconds)):
            depth, colour = shown[number % fps]
            recording.write_depth(1000 + number * 1_000_000 // fps, depth)
            recording.write_colour(1000 + number * 1_000_000 // fps, colour)


class VirtualAppliance:
    """One appliance in a folder; a context manager that kills the daemon."""

    def __init__(self, folder: Path, recording: Path, settings: str = "", *, spool: Path | None = None) -> None:
        self.folder, self.spool = folder, spool or folder / "takes"
        self.socket, self.button, self.cord = folder / "control.sock", folder / "button", folder / "cord"
        self.led, self.log, self.config = folder / "leds/status", folder / "log", folder / "appliance.toml"
        self.led.mkdir(parents=True)
        for name, content in LED_FILES.items():
            (self.led / name).write_text(content)
        os.mkfifo(self.button)
        (folder / "rig.toml").write_text(dump_description(RIG))
        (folder / "garment.toml").write_text(dump_description(GARMENT))
        self.config.write_text(
            f'[sensor]\naddress = "live:{recording}?cord={self.cord}"\nrig = "rig.toml"\ngarment = "garment.toml"\n'
            f'[button]\ndevice = "{self.button}"\n[lamp]\nled = "status"\nleds = "leds"\n'
            f'[control]\nsocket = "control.sock"\n'
            f'[spool]\nfolder = "{self.spool}"\n{settings}\n'
        )
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> VirtualAppliance:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self, *, before: str = "", environment: dict[str, str] | None = None) -> None:
        """Start the daemon; before: Python to run in its process first, which simulates a bad disk, for example."""
        (self.led / "trigger").write_text(LED_FILES["trigger"])  # the kernel's file always lists all triggers
        program = ["-m", "capture.appliance"]
        if before:
            program = ["-c", f"{before}\nfrom capture.appliance.__main__ import main\nmain()"]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, *program, "--config", str(self.config)], cwd=ROOT, stderr=log,
                env=os.environ | {"PYTHONPATH": str(ROOT)} | (environment or {}),
            )  # fmt: skip

    def kill(self, number: int = signal.SIGKILL) -> int | None:
        """Send a signal and wait for the end; return the exit code."""
        if self.process is None:
            return None
        self.process.send_signal(number)
        code = self.process.wait(LONGEST)
        self.process = None
        return code

    def ask(self, do: str) -> dict:
        return ask(self.socket, do)

    def wait_for(self, *states: str, seconds: float = LONGEST) -> dict:
        """Wait until the daemon is in one of these states; return its status."""
        return self.wait_until(lambda told: told["state"] in states, f"{states}", seconds)

    def wait_until(self, is_so, what: str, seconds: float = LONGEST) -> dict:
        until, told = time.monotonic() + seconds, {}
        while time.monotonic() < until:
            try:
                told = self.ask("status")
                if is_so(told):
                    return told
            except ControlError:
                if self.process is not None and self.process.poll() is not None:
                    raise AssertionError(f"the daemon ended: {self.log.read_text()}") from None
            time.sleep(0.02)
        raise AssertionError(f"not {what} within {seconds:g} s: {json.dumps(told)}\n{self.log.read_text()}")

    def press(self, changes: tuple[int, ...] = (DOWN, UP)) -> None:
        """Press the button: events of a key that goes down and up."""
        with self.button.open("wb", buffering=0) as button:
            button.write(b"".join(EVENT.pack(0, 0, KEY_EVENT, BTN_0, change) for change in changes))

    @property
    def lamp(self) -> tuple[str, ...]:
        """Return the lamp's trigger, and its rhythm or brightness."""
        trigger = (self.led / "trigger").read_text()
        files = ("delay_on", "delay_off") if trigger == "timer" else ("brightness",)
        return (trigger, *((self.led / name).read_text() for name in files))
