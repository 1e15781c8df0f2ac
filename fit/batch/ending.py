"""End of a batch: after a number of hours, or at a time of day."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

from fit.errors import BatchError

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """End time of a batch, if any; remaining jobs wait for a later run.

    The time of day refers to the wall clock, which also runs while the machine sleeps.
    """

    hours_end: float | None = None  # s of `running`
    day_end: float | None = None  # s of `wall`
    running: Clock = time.monotonic
    wall: Clock = time.time

    @property
    def is_over(self) -> bool:
        """Whether the end has come."""
        return (self.hours_end is not None and self.running() >= self.hours_end) or self.is_near(0.0)

    def is_near(self, seconds: float) -> bool:
        """Return whether the end's time of day comes within this number of seconds, or has come."""
        return self.day_end is not None and self.wall() + seconds >= self.day_end


def ending_of(
    hours: float | None, until: str | None, *, running: Clock = time.monotonic, wall: Clock = time.time
) -> Ending:
    """Return the end of a batch that begins now; the earlier one if both are given.

    Raises:
        BatchError: `until` is no time of the day.
    """
    return Ending(
        hours_end=None if hours is None else running() + 3600 * hours,
        day_end=None if until is None else next_time(until, wall()),
        running=running,
        wall=wall,
    )


def next_time(until: str, now: float) -> float:
    """Return the next instant of a time of day in this machine's time zone [s since 1970], after `now` [s since 1970].

    Raises:
        BatchError: the text is no time of the day.
    """
    if not re.fullmatch(r"([01]?[0-9]|2[0-3]):[0-5][0-9]", until):
        raise BatchError(
            f"{until!r} is no time of the day", where="--until", advice="give hours and minutes, such as 07:00"
        )
    hour, minute = map(int, until.split(":"))
    today = time.localtime(now)
    # mktime accepts the day after the last of a month, and accounts for summer time.
    days = (today.tm_mday, today.tm_mday + 1)
    first, second = (time.mktime((today.tm_year, today.tm_mon, d, hour, minute, 0, 0, 0, -1)) for d in days)
    return first if first > now else second
