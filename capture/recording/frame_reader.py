"""From a sensor's frames to what a take keeps of them: one after the other, for whoever records."""

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

SCAN_TOLERANCE = 1e-3  # s: frames come a little early or late


@dataclass(frozen=True, kw_only=True)
class ScanPlan:
    """The rate of surface scans [1/s], and the number of their places.

    grid: along each side of the grid; contour: around the silhouette
    """

    rate: float = 5.0
    grid: int = 12
    contour: int = 96


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The part of a frame that a take keeps.

    time [s]: in the take; dropped: frames that nobody received since the one before
    """

    time: float
    frame: Frame
    scan: SurfaceScan | None
    condition: Condition
    has_hanger: bool
    dropped: int


class FrameReader:
    """Tracks frame after frame; `now` is the last one's time [s], counting those that could not be placed."""

    def __init__(
        self,
        info: SensorInfo,
        rig: Rig,
        garment: Garment,
        *,
        picks: Floats | None = None,
        scans: ScanPlan | None = None,
    ) -> None:
        """Prepare; picks [px], (2, 2): where the hanger's dots are in the first frame, left one first.

        Raises:
            UntrackableError: the rig lacks a section, or one of both cannot be followed.
        """
        self._tracker, self._clock = FrameTracker(rig, garment, picks), FrameClock(info.fps)
        self._is_live, self._scans, self._next_scan = info.is_live, scans, -np.inf
        self.frame: SensorFrame | None = None
        self.sight: Tracked | None = None

    @property
    def now(self) -> float:
        """The time [s] that the sensor's clock has come to."""
        return self._clock.now

    def read(self, came: SensorFrame) -> Seen | None:
        """Return what a frame shows, None where its time cannot be placed; `frame` and `sight` hold what it was."""
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
