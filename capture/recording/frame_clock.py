"""Time in a take from a sensor's clock, which may repeat times, wrap around, or be set back or forward.

A frame whose time does not increase has no valid time and is discarded. The same holds for a jump so far ahead that a
live sensor would have counted as stalled: this single time may be wrong. After `SET` such frames in a row with
consistent times, the clock counts as set. Time then continues from its last value, by one nominal interval for each
frame that was discarded or dropped. So the overflow of a 32-bit counter costs two frames.

A jump ahead is kept as a pause if dropped frames or the host's clock confirm it. A frame is delivered after its
exposure, never before. So the smallest difference of both clocks so far gives the latest possible time of a frame.
"""

from __future__ import annotations

from firmware_host.depth_sensor import STALL_TIMEOUT
from formats.take import LONGEST_GAP

SET = 3  # consistent frames in a row: one or two are late or damaged, three show that the clock was set
AGREEMENT = 0.1  # of a jump: the two clocks, and a device's actual and nominal rates, differ by far less


class FrameClock:
    """Turns a sensor's times [s] into times that increase."""

    def __init__(self, fps: float) -> None:
        self._interval = 1.0 / fps
        self._offset = 0.0
        self._left_out: list[float] = []
        self._count = self._missing = 0  # frames discarded, and dropped, since the last one with a valid time
        self._last = -float("inf")
        self._host_ahead = float("inf")  # s, smallest difference so far
        self.has_jumped = False
        self.dropped = 0

    @property
    def now(self) -> float:
        """The last frame's time [s], plus one interval for each frame discarded or dropped since."""
        return self._last + self._interval * (self._count + self._missing)

    def place(self, sensor_time: float, *, dropped: int = 0, host_time: float | None = None) -> float | None:
        """Return the time [s] of a frame in the take, None if it has no valid time.

        - `dropped`: frames lost since the previous frame
        - `host_time` [s]: the host's time of delivery, None if it is unrelated to the time of exposure

        Afterwards `has_jumped` states whether frames were discarded before this one, and `dropped` the number of lost
        frames since the last frame with a valid time.
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
        """Return the time of a frame after its clock was set; only the host's clock reveals a pause meanwhile."""
        if host_time is not None and host_time - self._host_ahead > self.now + LONGEST_GAP:
            return host_time - self._host_ahead
        return self.now
