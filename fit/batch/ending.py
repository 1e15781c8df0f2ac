"""When a batch stops: after some hours, or at a time of the day."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

from fit.errors import BatchError

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """When a batch stops, if ever; the work of a later run is left waiting.

    The time of the day is looked up on the wall's clock, which also runs while the machine sleeps.
    """

    hours_end: float | None = None  # s of `running`
    day_end: float | None = None  # s of `wall`
    running: Clock = time.monotonic
    wall: Clock = time.time

    @property
    def is_over(self) -> bool:
        """Return whether it has come."""
        return (self.hours_end is not None and self.running() >= self.hours_end) or self.is_near(0.0)

    def is_near(self, seconds: float) -> bool:
        """Return whether its time of the day comes within so many seconds, or has come."""
        return self.day_end is not None and self.wall() + seconds >= self.day_end


def ending_of(
    hours: float | None, until: str | None, *, running: Clock = time.monotonic, wall: Clock = time.time
) -> Ending:
    """Return the end of a batch that begins now; the earlier one where both are given.

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
    """Return when it is next so late by this machine's time zone [s since 1970], after `now` [s since 1970].

    Raises:
        BatchError: it is no time of the day.
    """
    if not re.fullmatch(r"([01]?[0-9]|2[0-3]):[0-5][0-9]", until):
        raise BatchError(
            f"{until!r} is no time of the day", where="--until", advice="give hours and minutes, such as 07:00"
        )
    hour, minute = map(int, until.split(":"))
    today = time.localtime(now)
    # mktime takes the day after the last of a month for the first of the next, and knows of summer time.
    days = (today.tm_mday, today.tm_mday + 1)
    first, second = (time.mktime((today.tm_year, today.tm_mon, d, hour, minute, 0, 0, 0, -1)) for d in days)
    return first if first > now else second
