"""Detect undervoltage of the board: a Raspberry Pi's firmware reports a low 5 V supply to the kernel.

USB devices drop out at undervoltage, and the sensor seems to disappear.

Source: Linux, drivers/hwmon/raspberrypi-hwmon.c: `in0_lcrit_alarm` of the device `rpi_volt` is 1 when the voltage was
below 4.63 V since the last read.
"""

from __future__ import annotations

from pathlib import Path

HWMON = Path("/sys/class/hwmon")
VOLTAGE_MONITOR, ALARM = "rpi_volt", "in0_lcrit_alarm"
# s after an undervoltage for which a lost sensor is attributed to it. Our choice: no board's delay was measured, and
# half and double were not tried.
BLAMED = 60.0


class PowerSupply:
    """Polls the undervoltage flag; a board without the flag is never reported."""

    def __init__(self, alarm: Path | None = None, hwmon: Path = HWMON) -> None:
        """Find the flag; alarm: its file, None to search for it."""
        self._alarm = alarm or _found(hwmon)
        self._low_at = -float("inf")

    @property
    def is_watched(self) -> bool:
        """Return whether this board has such a flag."""
        return self._alarm is not None

    def was_low(self, now: float) -> bool:
        """Read the flag and return whether it was set within the last minute; now [s], monotonic."""
        try:
            if self._alarm is not None and self._alarm.read_text().strip() == "1":
                self._low_at = now
        except OSError:
            pass  # an unreadable flag counts as not set
        return now - self._low_at < BLAMED


def _found(hwmon: Path) -> Path | None:
    for name in sorted(hwmon.glob("hwmon*/name")) if hwmon.is_dir() else ():
        alarm = name.with_name(ALARM)
        try:
            if name.read_text().strip() == VOLTAGE_MONITOR and alarm.is_file():
                return alarm
        except OSError:
            continue
    return None
