"""The wall-clock time, its source and its uncertainty.

Times within a take follow the monotonic clock; the wall-clock time is metadata. A board without a battery starts in
the past and jumps when the network sets it. Sources: `man 2 adjtimex` (STA_UNSYNC, maxerror);
Linux, Documentation/ABI/testing/sysfs-class-rtc (hctosys: the kernel's time came from this clock).
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

STA_UNSYNC = 0x0040  # of timex.status: the kernel's clock is not disciplined
TIMEX_BYTES = 208  # sizeof(struct timex) on 64-bit Linux
STATUS_AT, MAXERROR_AT = 40, 24  # offsets [bytes] of status (int) and maxerror (long, us) on 64-bit Linux
RTCS = Path("/sys/class/rtc")
TIMESYNCD = Path("/run/systemd/timesync/synchronized")  # touched by systemd-timesyncd once the clock is right

Source = Literal["NTP", "RTC", "none"]


@dataclass(frozen=True, kw_only=True)
class WallTime:
    """A wall-clock time with its source and uncertainty.

    - `source`: "NTP" while the kernel's clock is disciplined, "RTC" where it was read from a battery's clock, else
      "none"
    - `uncertainty_s` [s]: the kernel's bound on the error; None if unknown
    """

    utc: str
    source: Source
    uncertainty_s: float | None


def wall_time(before_s: float = 0.0, *, clock: Callable[[], float] = time.time, rtcs: Path = RTCS) -> WallTime:
    """Return the wall-clock time of an instant that many seconds ago [s], with its source."""
    utc = datetime.fromtimestamp(max(clock() - before_s, 0.0), UTC).isoformat(timespec="milliseconds")
    disciplined = _kernel_error_s()
    if disciplined is not None:
        return WallTime(utc=utc, source="NTP", uncertainty_s=disciplined)
    if TIMESYNCD.exists():
        return WallTime(utc=utc, source="NTP", uncertainty_s=None)
    is_from_rtc = any(_text(flag) == "1" for flag in rtcs.glob("rtc*/hctosys")) if rtcs.is_dir() else False
    return WallTime(utc=utc, source="RTC" if is_from_rtc else "none", uncertainty_s=None)


def boot_id() -> str:
    """Return the kernel's boot id; monotonic times are comparable within one boot."""
    return _text(Path("/proc/sys/kernel/random/boot_id"))


def _kernel_error_s() -> float | None:
    """Return the kernel's bound on the clock's error [s]; None if the clock is not disciplined or access is denied."""
    if ctypes.sizeof(ctypes.c_long) != 8:
        return None  # another layout
    content = ctypes.create_string_buffer(TIMEX_BYTES)
    try:
        if ctypes.CDLL(None, use_errno=True).adjtimex(content) < 0:  # as where a unit has ProtectClock=
            return None
    except (OSError, AttributeError):
        return None
    status = int.from_bytes(content.raw[STATUS_AT : STATUS_AT + 4], "little")
    if status & STA_UNSYNC:
        return None
    return int.from_bytes(content.raw[MAXERROR_AT : MAXERROR_AT + 8], "little") * 1e-6


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def monotonic() -> float:
    """Return the time of a clock [s] that is never set and that runs on while the computer sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)
