"""Time in a take from a sensor's clock, which may step back or be set back.

A frame whose time does not increase cannot be placed and is left out. After `SET_BACK` of them in a row that increase
among themselves, the clock has been set back: time goes on, one nominal interval for each frame left out.
"""

from __future__ import annotations

SET_BACK = 10  # frames: a third of a second; a single late frame is not a clock that was set


class FrameClock:
    """Turns a sensor's times [s] into times that increase."""

    def __init__(self, fps: float) -> None:
        self._interval = 1.0 / fps
        self._offset = 0.0
        self._left_out: list[float] = []
        self._count = 0
        self.last = -float("inf")
        self.has_jumped = False

    def place(self, sensor_time: float) -> float | None:
        """Return the time [s] of a frame in the take, None where it cannot be placed.

        Afterwards `has_jumped` says whether frames were left out before this one.
        """
        time = sensor_time + self._offset
        if not time > self.last:
            if self._left_out and not sensor_time > self._left_out[-1]:
                self._left_out.clear()
            self._left_out.append(sensor_time)
            self._count += 1
            if len(self._left_out) < SET_BACK:
                return None
            time = self.last + self._interval * self._count
            self._offset = time - sensor_time
        self.has_jumped = self._count > 0
        self._left_out.clear()
        self._count = 0
        self.last = time
        return time
