"""The delay before a retry, exponential backoff with jitter, and the limit of the average upload rate."""

from __future__ import annotations

import random
import time
from collections.abc import Callable

FIRST_WAIT, LONGEST_WAIT = 2.0, 300.0  # s; a network that comes back is noticed within five minutes
MOST_DOUBLINGS = 30  # far beyond the 8 from `FIRST_WAIT` to `LONGEST_WAIT`; a power of thousands would overflow


def wait_after(tries: int, chance: random.Random) -> float:
    """Return the delay after a number of failed attempts [s]: one half is fixed, the other random.

    So devices that lost one server together do not retry together ("equal jitter": Brooker, "Exponential Backoff
    And Jitter", AWS Architecture Blog, 2015).
    """
    whole = min(LONGEST_WAIT, FIRST_WAIT * 2.0 ** min(tries - 1, MOST_DOUBLINGS))
    return whole / 2 * (1 + chance.random())


class Rate:
    """Limits the average upload rate: a sender waits until the earlier bytes fit the rate."""

    def __init__(
        self,
        bytes_per_second: float | None,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Set the limit [bytes/s]; None: no limit."""
        self._rate, self._clock, self._sleep = bytes_per_second, clock, sleep
        self._free_at = clock()

    def wait_for(self, count: int) -> None:
        """Wait until this number of bytes may be sent."""
        if self._rate is None:
            return
        if (owed := self._free_at - self._clock()) > 0:
            self._sleep(owed)
        self._free_at = max(self._free_at, self._clock()) + count / self._rate
