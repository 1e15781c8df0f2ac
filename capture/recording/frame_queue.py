"""Read frames from a live sensor in a separate thread, so that a slow disk or a busy processor loses none.

OpenNI2 keeps one frame per stream: a frame that is not read within a frame's time is lost. Writing a block waits for
the disk, and another program may take the processor; the queue bridges more than a second of delay. Its images would
take half of the recorder's memory. So images after the first `UNPACKED_FRAMES` are compressed without loss. Depth in
steps of disparity shrinks to about a sixth, and colour as far as its noise allows. Compression takes 3 to 4 ms a frame,
in the reading thread. Compressed images lie in separate pages, which return to the system one by one; malloc's heap
would never shrink.
"""

from __future__ import annotations

import dataclasses
import mmap
import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import zstandard
from numpy.typing import NDArray

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo

ROOM = 30_000_000  # bytes in the queue: 40 frames of 640 x 480 with colour noise of 3 of 255, at least 27
UNPACKED_FRAMES = 2  # frames; the queue is longer only in case of a fault
ZSTD_LEVEL = 1  # zstd's level: higher ones do not compress a depth image further
NO_DEPTH = np.zeros((0, 0), np.uint16)  # stands for the picture while it is packed


class QueuedSensor(DepthSensor):
    """A live sensor with a queue of frames; a context manager, inside which the reading thread runs.

    If the queue is full, frames are discarded and counted in the next frame's `dropped_before`. Closing the queue does
    not close the inner sensor.
    """

    def __init__(
        self, inner: DepthSensor, room: int = ROOM, run: Callable[[Callable[[], None]], None] | None = None
    ) -> None:
        """Prepare; run: runs the fetching loop in a thread of the caller, None for a thread of the queue's own."""
        self._inner, self._room = inner, room
        self._waiting: deque[_Waiting] = deque()
        self._size = 0  # bytes in the queue
        self._changed = threading.Condition()
        self._has_ended = False
        self._error: BaseException | None = None
        self._stop, self._awake = threading.Event(), threading.Event()
        self._rest_s, self._has_rested = 0.0, False
        self._pack, self._unpack = zstandard.ZstdCompressor(level=ZSTD_LEVEL), zstandard.ZstdDecompressor()
        self._thread = None if run else threading.Thread(target=self._fetch, name="frames", daemon=True)
        self._begin = run or (lambda fetch: None)
        self._is_begun, self._has_finished = False, threading.Event()
        self.left_out = 0  # frames discarded because the queue was full

    @property
    def info(self) -> SensorInfo:
        """Return the inner sensor's properties."""
        return self._inner.info

    def __enter__(self) -> Self:
        self._is_begun = True
        if self._thread is None:
            self._begin(self._fetch)
        else:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None from the end on.

        Raises:
            SensorError: the inner sensor's error, raised after the frames that precede it.
        """
        if self._stop.is_set():
            return None
        with self._changed:
            while not self._waiting and not self._has_ended:
                self._changed.wait()  # the inner sensor enforces the time limit
            if self._waiting:
                found = self._waiting.popleft()
                self._size -= found.size
            else:
                self._stop.set()
                if self._error is not None:
                    raise self._error
                return None
        return found.unpacked(self._unpack)

    def rest(self, seconds: float) -> None:
        """Read one frame per interval [s] and discard the others uncounted; 0: read every frame again."""
        self._rest_s = seconds
        if seconds:
            self._awake.clear()
        else:
            self._awake.set()

    def has_more(self, timeout_s: float) -> bool:
        """Wait up to a time [s], and return whether `read` would return at once."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._waiting) or self._has_ended, timeout_s)

    def close(self) -> None:
        """Stop reading and wait for the thread; closing twice is allowed."""
        self._stop.set()
        self._awake.set()
        if self._is_begun:
            self._has_finished.wait()
        if self._thread is not None and self._thread.is_alive():
            self._thread.join()

    def _fetch(self) -> None:
        missing = 0
        try:
            while not self._stop.is_set() and (frame := self._inner.read()) is not None:
                if self._has_rested:
                    frame = dataclasses.replace(frame, dropped_before=0)
                if missing:
                    frame = dataclasses.replace(frame, dropped_before=frame.dropped_before + missing)
                missing = 0 if self._add(frame) else missing + 1
                del frame  # its images are 1.5 MB, unused while the queue rests
                self._has_rested = self._rest_s > 0
                if self._has_rested:
                    self._awake.wait(self._rest_s)
        except BaseException as error:  # handed to the reader
            self._error = error
        with self._changed:
            self._has_ended = True
            self._changed.notify()
        self._has_finished.set()

    def _add(self, frame: SensorFrame) -> bool:
        """Append a frame to the queue; return False if the queue is full."""
        is_late = len(self._waiting) >= UNPACKED_FRAMES
        entry = _packed(frame, self._pack) if is_late else _Waiting(frame)
        with self._changed:
            if self._waiting and self._size + entry.size > self._room:
                self.left_out += 1
                return False
            self._waiting.append(entry)
            self._size += entry.size
            self._changed.notify()
        return True


class _Picture(NamedTuple):
    """A compressed image, in separate memory pages."""

    content: mmap.mmap
    shape: tuple[int, ...]
    kind: np.dtype[Any]


class _Waiting(NamedTuple):
    """A frame in the queue; compressed images are stored beside the frame, not in it."""

    frame: SensorFrame
    depth: _Picture | None = None
    colour: _Picture | None = None

    @property
    def size(self) -> int:
        """The bytes that its images occupy."""
        colour = self.frame.colour
        packed = sum(len(picture.content) for picture in (self.depth, self.colour) if picture is not None)
        return packed + self.frame.depth.nbytes + (0 if colour is None else colour.nbytes)

    def unpacked(self, unpack: zstandard.ZstdDecompressor) -> SensorFrame:
        """Return the frame with decompressed images."""
        if self.depth is None:
            return self.frame
        colour = None if self.colour is None else _unpacked(self.colour, unpack)
        return dataclasses.replace(self.frame, depth=_unpacked(self.depth, unpack), colour=colour)


def _packed(frame: SensorFrame, pack: zstandard.ZstdCompressor) -> _Waiting:
    def picture(image: NDArray[Any]) -> _Picture:
        packed = pack.compress(np.ascontiguousarray(image).data)
        content = mmap.mmap(-1, len(packed), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        content.write(packed)
        return _Picture(content, image.shape, image.dtype)

    colour = None if frame.colour is None else picture(frame.colour)
    return _Waiting(dataclasses.replace(frame, depth=NO_DEPTH, colour=None), picture(frame.depth), colour)


def _unpacked(picture: _Picture, unpack: zstandard.ZstdDecompressor) -> NDArray[Any]:
    with picture.content as pages, memoryview(pages) as content:
        return np.frombuffer(unpack.decompress(content), picture.kind).reshape(picture.shape)
