"""Real-time priority for a recorder, if this user may have it: a frame that is not read in time is lost.

A sensor delivers a frame every 33 ms and keeps only the newest. An ordinary process that has to share the processor may
wait longer than that for its turn. Under SCHED_RR a thread runs as soon as it can, before all ordinary programs.
Ordinary processes still get 5 % of the time (sched_rt_runtime_us). In practice they get far more, since tracking takes
a fifth of one core. Reading frames has a higher priority than tracking them.

Source: Linux man pages, sched(7).

It requires a privilege: root, or RLIMIT_RTPRIO (`systemd/limits.d`, LimitRTPRIO= in a unit).
"""

from __future__ import annotations

import os
from types import TracebackType
from typing import Self

FETCHING, TRACKING = 20, 10  # of 1 to 99; threads of the kernel that serve interrupts have 50


class Precedence:
    """Holds real-time priority while it is open; a context manager for the thread that starts all others.

    Threads that are started in it have the higher priority once `begin_tracking` has lowered the calling thread's.
    """

    def __init__(self) -> None:
        self.is_granted = False  # otherwise nothing is changed

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
        """Lower the priority of the calling thread below the threads that it has started."""
        if self.is_granted:
            self._ask(TRACKING)

    @staticmethod
    def _ask(priority: int) -> bool:
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
        except PermissionError:
            return False
        return True
