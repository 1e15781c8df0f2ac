"""A recording played as a live sensor, in real time and in a loop, to test an appliance without hardware.

As with a sensor, a frame that is not read in time is lost, and is counted in the next frame's `dropped_before`.
If no frame is read for a third of a second, the recording pauses, and later continues from there.
A file in place of the cable can make the sensor silent or unplug it.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import SensorStalledError, SensorUnavailableError

SILENT, UNPLUGGED = "silent", "unplugged"  # valid contents of the file
# s between two reads of the file. Our choice: a third of a frame's interval at 30 a second; half and double change
# only load and delay.
POLL_INTERVAL = 0.01
# s for which the recording follows the clock while no frame is read. Our choice: nine frames at 30 a second, more than
# a busy reader loses. Half and double were not tried.
LONGEST_LEAD = 0.3


class PacedSensor(DepthSensor):
    """Delivers the frames of a recording as a live sensor would."""

    def __init__(
        self, reopen: Callable[[], DepthSensor], uri: str, cord: Path | None = None, *,
        clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        """Open the recording, and start its clock.

        reopen: opens the recording at its beginning; cord: a file that may contain "silent" or "unplugged"

        Raises:
            SensorUnavailableError: the cord is unplugged.
        """
        self._reopen, self._uri, self._cord = reopen, uri, cord
        self._clock, self._sleep = clock, sleep
        self._is_closed = False
        if self._said() == UNPLUGGED:
            raise SensorUnavailableError("no depth sensor is connected", where=uri, advice="plug it in")
        self._inner = reopen()
        self._began = self._clock()
        self._number = 0  # index of the next frame, from 0

    @property
    def info(self) -> SensorInfo:
        """Return the recording's properties, marked as those of a live sensor."""
        return dataclasses.replace(self._inner.info, is_live=True, frame_count=None, uri=self._uri)

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame at its time.

        Raises:
            SensorStalledError: the cord has been silent for `timeout_s` seconds, or is unplugged.
        """
        interval = 1.0 / self._inner.info.fps
        waited_since = self._clock()
        while not self._is_closed:
            now = self._clock()
            said = self._said()
            if said == UNPLUGGED:
                raise SensorStalledError("the sensor was unplugged", where=self._uri, advice="plug it in again")
            if said == SILENT:
                if now - waited_since >= timeout_s:
                    raise SensorStalledError(f"no frame for {timeout_s:g} s", where=self._uri, advice="replug it")
                self._sleep(POLL_INTERVAL)
                continue
            due = int((now - self._began) / interval)  # frames that are due by now
            if due < self._number:
                self._sleep(
                    min(self._began + self._number * interval - now, POLL_INTERVAL)
                    if self._cord
                    else max(self._began + self._number * interval - now, 0.0)
                )
                continue
            missed = due - self._number
            frame = self._advance(missed + 1 if missed < LONGEST_LEAD * self._inner.info.fps else 1)
            self._number = due + 1
            return dataclasses.replace(
                frame, index=due, time_s=(due + 1) * interval, host_time_s=self._clock(), dropped_before=missed
            )
        return None

    def _advance(self, steps: int) -> SensorFrame:
        """Return the frame this number of steps ahead; at its end the recording restarts."""
        frame = None
        for _ in range(steps):
            frame = self._inner.read()
            if frame is None:
                self._inner.close()
                self._inner = self._reopen()
                frame = self._inner.read()
        if frame is None:
            raise SensorUnavailableError(
                "the recording holds no frame", where=self._uri, advice="give another recording"
            )
        return frame

    def _said(self) -> str:
        try:
            return "" if self._cord is None else self._cord.read_text().strip()
        except OSError:
            return ""

    def close(self) -> None:
        """Close the recording; `read` returns None from then on."""
        self._is_closed = True
        self._inner.close()
