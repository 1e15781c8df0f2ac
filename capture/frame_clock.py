"""Time in a take from a sensor's clock, which may stumble, wrap around, or be set back or forward.

A frame whose time does not increase, or leaps so far ahead that a live sensor would have counted as stalled, cannot be
placed and is left out: what it says may be wrong for this one alone. After `SET` of them in a row whose times follow
each other the clock has been set: time goes on from where it was, one nominal interval for each frame left out. So a
counter of 32 bits that begins anew costs two frames.
"""

from __future__ import annotations

from firmware_host.depth_sensor import STALL_TIMEOUT

SET = 3  # frames in a row that agree with each other: one or two are late or damaged, three are a clock that was set


class FrameClock:
    """Turns a sensor's times [s] into times that increase."""

    def __init__(self, fps: float) -> None:
        self._interval = 1.0 / fps
        self._offset = 0.0
        self._left_out: list[float] = []
        self._count = 0
        self._last = -float("inf")
        self.has_jumped = False

    @property
    def now(self) -> float:
        """The last frame's time [s], and one interval for each frame left out since."""
        return self._last + self._interval * self._count

    def place(self, sensor_time: float) -> float | None:
        """Return the time [s] of a frame in the take, None where it cannot be placed.

        Afterwards `has_jumped` says whether frames were left out before this one.
        """
        time = sensor_time + self._offset
        if not self._follows(time, self._last):
            if self._left_out and not self._follows(sensor_time, self._left_out[-1]):
                self._left_out.clear()
            self._left_out.append(sensor_time)
            self._count += 1
            if len(self._left_out) < SET:
                return None
            time = self.now
            self._offset = time - sensor_time
        self.has_jumped = self._count > 0
        self._left_out.clear()
        self._count = 0
        self._last = time
        return time

    @staticmethod
    def _follows(time: float, before: float) -> bool:
        return before < time <= before + STALL_TIMEOUT or before == -float("inf")
