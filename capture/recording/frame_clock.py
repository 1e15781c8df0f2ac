"""Time in a take from a sensor's clock, which may stumble, wrap around, or be set back or forward.

A frame whose time does not increase cannot be placed and is left out. The same holds for a leap so far ahead that a
live sensor would have counted as stalled: this one time may be wrong. After `SET` such frames in a row with consistent
times, the clock has been set. Time then goes on from its last value, by one nominal interval for each frame that was
left out or dropped. So a counter of 32 bits that begins anew costs two frames.

A leap ahead is a pause, and kept, if something else explains it: dropped frames, or the host's clock. A frame is handed
over some time after it was taken, never before. So the smallest difference of both clocks so far gives the latest
possible time of a frame.
"""

from __future__ import annotations

from firmware_host.depth_sensor import STALL_TIMEOUT
from formats.take import LONGEST_GAP

SET = 3  # frames in a row that agree with each other: one or two are late or damaged, three are a clock that was set
AGREEMENT = 0.1  # of a leap: both clocks part by far less, and so do a device's rate and its nominal one


class FrameClock:
    """Turns a sensor's times [s] into times that increase."""

    def __init__(self, fps: float) -> None:
        self._interval = 1.0 / fps
        self._offset = 0.0
        self._left_out: list[float] = []
        self._count = self._missing = 0  # frames left out, and dropped, since the last one that was placed
        self._last = -float("inf")
        self._host_ahead = float("inf")  # s, the smallest seen
        self.has_jumped = False
        self.dropped = 0

    @property
    def now(self) -> float:
        """The last frame's time [s], and one interval for each frame left out or dropped since."""
        return self._last + self._interval * (self._count + self._missing)

    def place(self, sensor_time: float, *, dropped: int = 0, host_time: float | None = None) -> float | None:
        """Return the time [s] of a frame in the take, None where it cannot be placed.

        - `dropped`: frames that nobody received since the frame before
        - `host_time` [s]: when a live sensor handed it over, None where that says nothing about when it was taken

        Afterwards `has_jumped` says whether frames were left out before this one, and `dropped` how many were dropped
        since the last one that was placed.
        """
        self._missing += dropped
        time = sensor_time + self._offset
        if not (self._follows(time, self._last) or self._is_pause(time, host_time)):
            if self._left_out and not self._follows(sensor_time, self._left_out[-1]):
                self._left_out.clear()
            self._left_out.append(sensor_time)
            self._count += 1
            if len(self._left_out) < SET:
                return None
            time = self._resumed(host_time)
            self._offset = time - sensor_time
        self.has_jumped, self.dropped = self._count > 0, self._missing
        self._left_out.clear()
        self._count = self._missing = 0
        self._last = time
        if host_time is not None:
            self._host_ahead = min(self._host_ahead, host_time - time)
        return time

    @staticmethod
    def _follows(time: float, before: float) -> bool:
        return before < time <= before + STALL_TIMEOUT or before == -float("inf")

    def _is_pause(self, time: float, host_time: float | None) -> bool:
        leap = time - self._last
        if leap <= 0:
            return False
        due = self._interval * (self._count + self._missing + 1)
        is_counted = abs(leap - due) <= AGREEMENT * leap
        return is_counted or (host_time is not None and host_time - time >= self._host_ahead - AGREEMENT * leap)

    def _resumed(self, host_time: float | None) -> float:
        """Return when a frame was taken whose clock was set; a pause meanwhile is seen by the host's clock alone."""
        if host_time is not None and host_time - self._host_ahead > self.now + LONGEST_GAP:
            return host_time - self._host_ahead
        return self.now
