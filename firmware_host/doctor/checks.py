"""The checks of the sensor doctor, their findings, and the state that all checks share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from types import TracebackType
from typing import Self

import numpy as np

from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.usb_control.devices import UsbDevice
from formats.plain_text import with_advice
from formats.rig import Rig

# s between the frames that a sample keeps for later checks. Our choice: about ten of 5 s, 15 MB of depth and colour at
# 640 x 480; at half 31 MB. At twice five are kept, which was not tried.
KEPT_EVERY = 0.5


class Verdict(Enum):
    """The status of a check."""

    OK = "ok"
    PROBLEM = "problem"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """The result of a check: its status, and one sentence on the observation or the next action."""

    verdict: Verdict
    text: str


def ok(text: str) -> Finding:
    """Return the finding of a passed check; `text` states the observation."""
    return Finding(Verdict.OK, text)


def problem(what: str, advice: str) -> Finding:
    """Return the finding of a failed check: `what` states the fault, and the advice its remedy."""
    return Finding(Verdict.PROBLEM, with_advice(what, advice))


def skipped(reason: str) -> Finding:
    """Return the finding of a check that could not be made, with the reason."""
    return Finding(Verdict.SKIPPED, reason)


@dataclass
class StreamSample:
    """Statistics of the frames that arrived during the check.

    - `times` [s]: of each frame, by the device's clock
    - `dropped`: frames that the device counted but that were lost
    - `coverage`: share of the pixels with a depth, one number for each frame
    - `frames`: some of the frames, evenly spread
    """

    info: SensorInfo
    times: list[float] = field(default_factory=list)
    dropped: int = 0
    coverage: list[float] = field(default_factory=list)
    frames: list[SensorFrame] = field(default_factory=list)

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return self.times[-1] - self.times[0] if self.times else 0.0

    def add(self, frame: SensorFrame) -> None:
        """Count a frame; drops before the first one do not count."""
        self.dropped += frame.dropped_before if self.times else 0
        self.times.append(frame.time_s)
        self.coverage.append(float(np.count_nonzero(frame.depth)) / frame.depth.size)
        if not self.frames or frame.time_s - self.frames[-1].time_s >= KEPT_EVERY:
            self.frames.append(frame)


@dataclass
class Examination:
    """The subject of the checks, and results of earlier checks that later ones use.

    - `source`: a recording or another sensor's name; None is the live sensor
    - `rig`: the rig whose markers must be visible; None: the default rig
    - `place`: the device to check, BUS:ADDRESS; None: the first camera
    """

    source: str | None = None
    rig: Rig | None = None
    place: str | None = None
    devices: list[UsbDevice] = field(default_factory=list)
    camera: UsbDevice | None = None
    sensor: DepthSensor | None = None
    sample: StreamSample | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.sensor is not None:
            self.sensor.close()


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of the doctor.

    - `needs`: names of the checks that must pass before this one runs
    - `is_for_recordings`: whether it also applies to a recording; the others need the device
    """

    name: str
    look: Callable[[Examination], Finding]
    needs: tuple[str, ...] = ()
    is_for_recordings: bool = False
