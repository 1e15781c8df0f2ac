"""Let a recorder come before other programs where this user may: a frame that is not fetched in time is gone.

A sensor gives a frame every 33 ms and keeps only the newest. An ordinary program that has to share the processor may
wait longer than that for its turn. Under SCHED_RR a thread runs as soon as it can, before all ordinary programs.
Ordinary programs still have 5 % of the time (sched_rt_runtime_us). In practice they have far more, since tracking takes
a fifth of one core. Fetching frames comes before tracking them.

Source: Linux man pages, sched(7).

It takes a right: root, or RLIMIT_RTPRIO (`systemd/limits.d`, LimitRTPRIO= in a unit).
"""

from __future__ import annotations

import os
from types import TracebackType
from typing import Self

FETCHING, TRACKING = 20, 10  # of 1 to 99; threads of the kernel that serve interrupts have 50


class Precedence:
    """Comes before others while it is open; a context manager for the thread that starts all others.

    Threads that are started in it come first among ours, until `begin_tracking` puts the calling one behind them.
    """

    def __init__(self) -> None:
        self.is_granted = False  # else nothing is changed

    def __enter__(self) -> Self:
        self._before = os.sched_getscheduler(0), os.sched_getparam(0)
        self.is_granted = self._ask(FETCHING)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.is_granted:
            os.sched_setscheduler(0, *self._before)

    def begin_tracking(self) -> None:
        """Put the calling thread behind those that it has started."""
        if self.is_granted:
            self._ask(TRACKING)

    @staticmethod
    def _ask(priority: int) -> bool:
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
        except PermissionError:
            return False
        return True
