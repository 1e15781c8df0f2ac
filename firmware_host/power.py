"""Detect a weak power supply of the board: a Raspberry Pi's firmware tells the kernel when its 5 V sink.

USB devices drop out then, and people see a sensor that vanishes.

Source: Linux, drivers/hwmon/raspberrypi-hwmon.c: `in0_lcrit_alarm` of the device `rpi_volt` is 1 when the voltage was
below 4.63 V since the last look.
"""

from __future__ import annotations

from pathlib import Path

HWMON = Path("/sys/class/hwmon")
NAME, ALARM = "rpi_volt", "in0_lcrit_alarm"
BLAMED = 60.0  # s for which a sensor that vanishes is put down to a voltage that was low


class PowerSupply:
    """The under-voltage flag, looked at now and then; a board without one is never blamed."""

    def __init__(self, alarm: Path | None = None, hwmon: Path = HWMON) -> None:
        """Find the flag; alarm: the file that bears it, None to look for it."""
        self._alarm = alarm or _found(hwmon)
        self._low_at = -float("inf")

    @property
    def is_watched(self) -> bool:
        """Return whether this board has such a flag."""
        return self._alarm is not None

    def was_low(self, now: float) -> bool:
        """Look at the flag and say whether it was set within the last minute; now [s], monotonic."""
        try:
            if self._alarm is not None and self._alarm.read_text().strip() == "1":
                self._low_at = now
        except OSError:
            pass  # a flag that cannot be read blames nobody
        return now - self._low_at < BLAMED


def _found(hwmon: Path) -> Path | None:
    for name in sorted(hwmon.glob("hwmon*/name")) if hwmon.is_dir() else ():
        alarm = name.with_name(ALARM)
        try:
            if name.read_text().strip() == NAME and alarm.is_file():
                return alarm
        except OSError:
            continue
    return None
