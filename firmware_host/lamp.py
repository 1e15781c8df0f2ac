"""The status lamp: a LED of this machine, driven through Linux's LED class.

The kernel shows every LED as a folder `/sys/class/leds/NAME`. Steady light is `brightness` without a trigger. Blinking
is the kernel's own `timer` trigger with `delay_on` and `delay_off` in milliseconds. So the rhythm holds while this
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
LONGEST_MS = 60_000  # of light or dark; more is no blinking
SOME_MS = "1000"  # of light beside no dark, or of dark beside no light: any length but 0


class StatusLamp:
    """One LED, lit, blinking or dark; a context manager that leaves it with the trigger that it had."""

    def __init__(self, name: str, leds: Path = LEDS) -> None:
        """Open the LED of this name, and remember its trigger.

        Raises:
            LampError: there is none of this name, or this user may not change it.
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
        # The kernel makes the timer's files anew, for root alone, whenever the trigger changes. A LED that blinks
        # already keeps its trigger, so that a user who may write these files goes on being one.
        self._keeps_timer = self._before == "timer"
        self.dark()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(LampError):  # a lamp that is gone cannot be given back
            self.close()

    def dark(self) -> None:
        """Switch the LED off."""
        if self._keeps_timer:
            self._write("delay_off", SOME_MS)  # never both 0: the kernel takes that for its own rhythm
            self._write("delay_on", "0")
            return
        self._write("trigger", "none")
        self._write("brightness", "0")

    def steady(self) -> None:
        """Light it without a pause."""
        if self._keeps_timer:
            self._write("delay_on", SOME_MS)
            self._write("delay_off", "0")
            return
        self._write("trigger", "none")
        self._write("brightness", self._brightest)

    def blink(self, light_ms: int, dark_ms: int) -> None:
        """Light it for so long, then leave it dark for so long, and so on.

        Raises:
            LampError: the kernel has no timer for LEDs, or the LED is gone.
            ValueError: a time that is no blinking.
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
        """Give the LED back as it was."""
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
