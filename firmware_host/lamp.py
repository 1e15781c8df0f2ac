"""The status lamp: an LED of this machine, driven through Linux's LED class.

The kernel presents every LED as a folder `/sys/class/leds/NAME`. Steady light is `brightness` without a trigger.
Blinking is the kernel's `timer` trigger with `delay_on` and `delay_off` in milliseconds. So the rhythm holds while this
program is busy. An appliance's udev rule may give the LED this trigger already. Then the LED keeps the trigger: no dark
time is steady light, no light time is dark.

Source: Linux, Documentation/leds/leds-class.rst and Documentation/ABI/testing/sysfs-class-led and
sysfs-class-led-trigger-timer.
"""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from types import TracebackType
from typing import Self

from firmware_host.errors import LampError

LEDS = Path("/sys/class/leds")
LONGEST_MS = 60_000  # ms on or off; a longer time does not count as blinking
SOME_MS = "1000"  # ms of light without dark, or of dark without light: any value but 0


class StatusLamp:
    """One LED, on, blinking or off; a context manager that restores its trigger at the end."""

    def __init__(self, name: str, leds: Path = LEDS) -> None:
        """Open the LED of this name, and remember its trigger.

        Raises:
            LampError: there is no LED of this name, or this user may not set it.
        """
        self._folder = leds / name
        if not name or "/" in name or not (self._folder / "brightness").is_file():
            there = sorted(path.name for path in leds.iterdir()) if leds.is_dir() else []
            raise LampError(
                f"there is no LED {name!r}", where=leds,
                advice=f"choose one of {', '.join(there)}" if there else "this machine shows none; leave the lamp out",
            )  # fmt: skip
        self._brightest = self._read("max_brightness") or "1"
        triggers = self._read("trigger")
        self._can_blink = "timer" in re.findall(r"[\w-]+", triggers)
        active = re.search(r"\[(.+?)\]", triggers)
        self._before = active.group(1) if active else "none"
        self._brightness_before = self._read("brightness") or "0"
        # At each change of the trigger the kernel recreates the timer's files, writable by root alone. So an LED that
        # already blinks keeps its trigger, and with it the user's permission to write these files.
        self._keeps_timer = self._before == "timer"
        self.dark()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(LampError):  # a removed LED cannot be restored
            self.close()

    def dark(self) -> None:
        """Switch the LED off."""
        if self._keeps_timer:
            self._write("delay_off", SOME_MS)  # never both 0: the kernel would use its default rhythm
            self._write("delay_on", "0")
            return
        self._write("trigger", "none")
        self._write("brightness", "0")

    def steady(self) -> None:
        """Switch the LED on."""
        if self._keeps_timer:
            self._write("delay_on", SOME_MS)
            self._write("delay_off", "0")
            return
        self._write("trigger", "none")
        self._write("brightness", self._brightest)

    def blink(self, light_ms: int, dark_ms: int) -> None:
        """Let the LED blink with these times on and off [ms].

        Raises:
            LampError: the kernel has no timer trigger, or the LED was removed.
            ValueError: a time is outside the range of blinking.
        """
        if not (0 < light_ms <= LONGEST_MS and 0 < dark_ms <= LONGEST_MS):
            raise ValueError(f"{light_ms} and {dark_ms} ms are no blinking")
        if not self._can_blink:
            raise LampError(
                "the kernel cannot let this LED blink",
                where=self._folder,
                advice="load it: sudo modprobe ledtrig-timer",
            )
        if not self._keeps_timer:
            self._write("brightness", self._brightest)
            self._write("trigger", "timer")
        self._write("delay_on", str(light_ms))
        self._write("delay_off", str(dark_ms))

    def close(self) -> None:
        """Restore the LED's trigger and release it."""
        self.dark()
        if self._keeps_timer:
            return
        self._write("trigger", self._before)
        if self._before == "none":
            self._write("brightness", self._brightness_before)

    def _read(self, name: str) -> str:
        try:
            return (self._folder / name).read_text().strip()
        except OSError:
            return ""

    def _write(self, name: str, value: str) -> None:
        try:
            (self._folder / name).write_text(value)
        except OSError as error:
            raise LampError(
                f"cannot be changed ({error.strerror})", where=self._folder / name,
                advice="let this user write the LED's files, or run as root; see docs/reference/recording.md",
            ) from error  # fmt: skip
