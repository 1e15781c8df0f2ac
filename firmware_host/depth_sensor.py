"""The interface of every depth sensor, live, recorded or synthetic: a stream of timestamped frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from formats.arrays import Bytes, Unsigned
from formats.rig import Sensor

# Multiple of the frames due in a time: after so many frames the device's clock counts as stopped, and waiting ends.
MOST_FRAMES_OF_DUE = 2.0
# m from projector to camera, of PrimeSense and Kinect v1: K. Khoshelham, S. Elberink, Sensors 12 (2012), section 3;
# K. Konolige, P. Mihelich, "Technical description of Kinect calibration" (ROS wiki), depth calculation.
BASELINE = 0.075
STALL_TIMEOUT = 5.0  # s without a frame before a live sensor counts as stalled; a USB reset takes about 2 s


@dataclass(frozen=True, kw_only=True)
class SensorInfo:
    """The properties of a sensor that are known before its first frame.

    `frame_count` is the number of depth frames to come, None if unknown (live sensors). `notes` are sentences about
    assumptions, such as a default focal length. `is_turned`: a recording says that its pictures are mirrored, and they
    are turned round. `left_out`: depth frames of a recording that cannot be read, because of their numbers.
    """

    name: str
    uri: str
    width: int
    height: int
    fps: float
    intrinsics: Sensor
    is_live: bool
    frame_count: int | None = None
    notes: tuple[str, ...] = ()
    is_turned: bool = False
    left_out: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorFrame:
    """One depth frame and the colour frame nearest to it in time.

    - `index`: number of the depth frame from 0, counting dropped ones
    - `time_s` [s]: the device's clock when the depth was taken; strictly increasing, any origin
    - `host_time_s` [s]: the host's monotonic time of delivery; for a recording, of playback
    - `depth` [mm], (height, width), uint16, 0 where nothing was measured
    - `colour`, RGB, (height, width, 3), uint8, registered to depth; None where no colour frame is near in time
    - `colour_late_s` [s]: delay of the colour after the depth, at most half a frame, of either sign
    - `dropped_before`: frames that the device counted but that were lost since the previous frame
    """

    index: int
    time_s: float
    host_time_s: float
    depth: Unsigned
    colour: Bytes | None
    dropped_before: int = 0
    colour_late_s: float = 0.0


class DepthSensor(ABC):
    """A source of frames, open from construction to `close`; a context manager."""

    @property
    @abstractmethod
    def info(self) -> SensorInfo:
        """Name, size, rate and intrinsics."""

    @abstractmethod
    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None from the end of a recording on.

        Raises:
            SensorStalledError: a live sensor sent nothing for `timeout_s` seconds.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the sensor; closing twice is allowed."""

    def frames(self, timeout_s: float = STALL_TIMEOUT) -> Iterator[SensorFrame]:
        """Yield frames until the end of the recording; a live sensor never ends by itself."""
        while (frame := self.read(timeout_s)) is not None:
            yield frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
