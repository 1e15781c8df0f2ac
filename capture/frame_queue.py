"""Take frames from a live sensor in a thread of its own, so that a slow disk or a busy processor loses none.

OpenNI2 keeps one frame per stream: a frame that is not read within a frame's time is gone. Writing a block waits for
the disk, and another program may take the processor; the queue bridges `CAPACITY` frames of that.
"""

from __future__ import annotations

import dataclasses
import queue
import threading
from types import TracebackType
from typing import Self

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo

CAPACITY = 12  # frames, 0.4 s; 18 MB at 640 x 480 with colour while it is full


class QueuedSensor(DepthSensor):
    """A live sensor whose frames wait until they are read; a context manager, the thread runs inside it.

    Frames that find the queue full are left out and counted in the next one's `dropped_before`. The inner sensor is not
    closed by this one.
    """

    def __init__(self, inner: DepthSensor, capacity: int = CAPACITY) -> None:
        self._inner = inner
        self._waiting: queue.Queue[SensorFrame | BaseException | None] = queue.Queue(capacity)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fetch, name="frames", daemon=True)

    @property
    def info(self) -> SensorInfo:
        """What the inner sensor is."""
        return self._inner.info

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None at the end and ever after.

        Raises:
            SensorError: what the inner sensor raised, after the frames that came before it.
        """
        if self._stop.is_set():
            return None
        found = self._waiting.get()  # the inner sensor keeps the time limit
        if isinstance(found, SensorFrame):
            return found
        self._stop.set()
        if found is None:
            return None
        raise found

    def close(self) -> None:
        """Stop fetching and wait for the thread; closing twice is allowed."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _fetch(self) -> None:
        left_out = 0
        last: BaseException | None = None
        try:
            while not self._stop.is_set() and (frame := self._inner.read()) is not None:
                if left_out:
                    frame = dataclasses.replace(frame, dropped_before=frame.dropped_before + left_out)
                try:
                    self._waiting.put_nowait(frame)
                    left_out = 0
                except queue.Full:
                    left_out += 1
        except BaseException as error:  # handed to whoever reads
            last = error
        while not self._stop.is_set():
            try:
                self._waiting.put(last, timeout=0.1)
                return
            except queue.Full:
                continue
