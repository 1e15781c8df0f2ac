"""Turns a sensor's frames, one after the other, into the records of a take."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from capture.recording.condition import Condition, condition_of
from capture.recording.frame_clock import FrameClock
from capture.recording.tracking import FrameTracker, Tracked
from firmware_host.depth_sensor import SensorFrame, SensorInfo
from formats.arrays import Floats
from formats.blocks import Frame
from formats.garment import Garment
from formats.rig import Rig
from formats.surface import SurfaceScan
from formats.take import FrameState

SCAN_TOLERANCE = 1e-3  # s: tolerance for frames that arrive a little early or late


@dataclass(frozen=True, kw_only=True)
class ScanPlan:
    """The rate of surface scans [1/s], and the number of their points.

    grid: along each side of the grid; contour: around the silhouette
    """

    rate: float = 5.0  # 1/s; our choice: five to a swing of a second
    grid: int = 12  # our choice: one point every 42 mm on half a metre
    contour: int = 96  # our choice: eight times the grid's, as the appliance has it


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The part of a frame that a take stores.

    time [s]: in the take; dropped: frames lost since the previous one
    """

    time: float
    frame: Frame
    scan: SurfaceScan | None
    condition: Condition
    has_hanger: bool
    dropped: int


class FrameReader:
    """Tracks frame after frame; `now` is the last frame's time [s], frames without a valid time included."""

    def __init__(
        self,
        info: SensorInfo,
        rig: Rig,
        garment: Garment,
        *,
        picks: Floats | None = None,
        scans: ScanPlan | None = None,
    ) -> None:
        """Prepare; picks [px], (2, 2): the hanger's dots in the first frame, left one first.

        Raises:
            UntrackableError: the rig lacks a section, or hanger or garment cannot be tracked.
        """
        self._tracker, self._clock = FrameTracker(rig, garment, picks), FrameClock(info.fps)
        self._is_live, self._scans, self._next_scan = info.is_live, scans, -np.inf
        self.frame: SensorFrame | None = None
        self.sight: Tracked | None = None

    @property
    def now(self) -> float:
        """The current time [s] by the sensor's clock."""
        return self._clock.now

    def read(self, came: SensorFrame) -> Seen | None:
        """Track a frame and return its record, None without a valid time; `frame` and `sight` keep frame and result."""
        host_time = came.host_time_s if self._is_live else None
        time = self._clock.place(came.time_s, dropped=came.dropped_before, host_time=host_time)
        if time is None:
            return None
        frame = dataclasses.replace(came, dropped_before=self._clock.dropped)
        hanger, cloth, state, _ = sight = self._tracker.track(frame, time)
        state |= FrameState.CLOCK_JUMPED if self._clock.has_jumped else 0
        scan = None
        if self._scans is not None and cloth.is_found and time >= self._next_scan:
            scan = self._tracker.scan(time, grid=self._scans.grid, contour=self._scans.contour)
            if scan is not None:
                self._next_scan = time + 1.0 / self._scans.rate - SCAN_TOLERANCE
        self.frame, self.sight = frame, sight
        return Seen(
            time=time,
            frame=self._tracker.as_frame(time, sight._replace(state=state)),
            scan=scan,
            condition=condition_of(state, are_read=bool(np.isfinite(hanger.centres).all())),
            has_hanger=hanger.is_found,
            dropped=frame.dropped_before,
        )
