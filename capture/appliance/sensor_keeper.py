"""Keeps the sensor open: a thread opens it, retries after failures, and reports when it delivers no frames.

One thread opens, reads and closes the sensor for the daemon's whole life. OpenNI2 remembers each thread that waited for
a frame, and calls `pthread_kill` to test whether the thread still runs. This call crashes if the thread has ended
(libopenni2 2.2.0.33).
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from capture.recording.condition import Condition
from capture.recording.frame_queue import QueuedSensor
from capture.recording.precedence import Precedence
from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import SensorError, SensorStalledError, SensorUnavailableError
from formats.errors import HangtimeError
from formats.rig import Rig

RETRY = 2.0  # s between two attempts to open the sensor: a USB reset takes about as long
RESTING_PERIOD = 0.4  # s between frames while no more are needed
SILENT_AFTER = 0.9  # s without a frame after which the sensor is reported as silent: within a second of the last frame


class SensorKeeper:
    """The appliance's sensor, open or not."""

    def __init__(self, open_sensor: Callable[[], DepthSensor], rig: Rig, clock: Callable[[], float]) -> None:
        self._open, self._rig, self._clock = open_sensor, rig, clock
        self._queue: QueuedSensor | None = None
        self._inner: DepthSensor | None = None
        self._work: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._is_opening, self._is_tried = False, threading.Event()
        self._opened: DepthSensor | None = None
        self._failed: HangtimeError | None = None
        self._last_try = -float("inf")
        self._last_frame = -float("inf")
        self._precedence, self._is_resting = Precedence(), False
        self.error: HangtimeError | None = None  # of the last attempt; None while open or before the first result

    @property
    def info(self) -> SensorInfo | None:
        """Return the open sensor's properties, None if none is open."""
        return None if self._queue is None else self._queue.info

    @property
    def left_out(self) -> int:
        """Frames for which the queue had no room."""
        return 0 if self._queue is None else self._queue.left_out

    def silent_s(self, now: float) -> float | None:
        """Return the time since the last frame [s] if it is above the limit, else None."""
        silent = now - self._last_frame
        return silent if self._queue is not None and silent > SILENT_AFTER else None

    def next_frame(self, wait_s: float) -> SensorFrame | None:
        """Return the next frame, None if none arrived within the time limit or no sensor is open."""
        if self._queue is None:
            self._keep_opening(wait_s)
            return None
        if not self._queue.has_more(wait_s):
            return None
        try:
            frame = self._queue.read()
            if frame is None:
                raise SensorStalledError("has come to its end", where=self._queue.info.uri, advice="replug it")
        except SensorError as error:
            self.error = error
            self._let_go()
            return None
        self._last_frame = self._clock()
        return frame

    def rest(self, *, is_resting: bool) -> None:
        """Read frames at the resting rate, or every frame."""
        if self._queue is not None and is_resting is not self._is_resting:
            self._is_resting = is_resting
            self._queue.rest(RESTING_PERIOD if is_resting else 0.0)

    def close(self) -> None:
        """Close the sensor."""
        self._let_go()
        if self._is_opening:
            self._is_tried.wait(RETRY)
        if self._opened is not None:
            self._work.put(self._opened.close)
        done = threading.Event()
        self._work.put(done.set)
        if self._thread is not None:
            done.wait(RETRY)

    def _let_go(self) -> None:
        if self._queue is not None and self._inner is not None:
            self._queue.close()
            self._work.put(self._inner.close)
        self._queue = self._inner = None

    def _keep_opening(self, wait_s: float) -> None:
        if not self._is_opening:
            if self._clock() - self._last_try < RETRY:
                threading.Event().wait(wait_s)
                return
            self._last_try = self._clock()
            self._start_thread()
            self._is_opening = True
            self._is_tried.clear()
            self._work.put(self._try_to_open)
        if not self._is_tried.wait(wait_s):
            return
        self._is_opening = False
        if self._opened is None:
            self.error = self._failed
            return
        self._inner, self._opened, self.error = self._opened, None, None
        self._last_frame, self._is_resting = self._clock(), False
        self._queue = QueuedSensor(self._inner, run=self._work.put).__enter__()

    def _start_thread(self) -> None:
        """Start the sensor's thread, with priority over the calling thread, which tracks."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._do_work, name="sensor", daemon=True)
            self._precedence.__enter__()
            self._thread.start()
            self._precedence.begin_tracking()

    def _do_work(self) -> None:
        while True:
            self._work.get()()

    def _try_to_open(self) -> None:
        try:
            sensor = self._open()
            info, camera = sensor.info, self._rig.sensor
            if camera is not None and (info.width, info.height) != (camera.width, camera.height):
                sensor.close()
                raise SensorUnavailableError(
                    f"the sensor gives {info.width} x {info.height} pixels, the rig says "
                    f"{camera.width} x {camera.height}", where=self._rig.name, advice=Condition.WRONG_SIZE.value.advice,
                )  # fmt: skip
            self._opened, self._failed = sensor, None
        except HangtimeError as error:
            self._failed = error
        except Exception as error:  # the thread survives, and tries again
            self._failed = SensorUnavailableError(
                f"the sensor does not open ({error!r})", where="[sensor]", advice="replug it"
            )
        finally:
            self._is_tried.set()
