"""Detect hanger and garment in one frame, and determine the faults that prevent their detection."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from capture.depth.scale import DepthScale, depth_rig
from capture.garment.sight import GarmentSight, nothing_found
from capture.garment.tracker import garment_tracker
from capture.hanger.choice import hanger_tracker
from capture.hanger.fiducial_tracker import HangerSight, hanger_and_sensor, nothing_seen
from capture.recording.frame_faults import HangerWatch, is_garment_covered, picture_faults
from firmware_host.depth_sensor import SensorFrame
from formats.arrays import Floats
from formats.blocks import Frame
from formats.garment import Garment
from formats.hanger import held_ends
from formats.rig import Calibration, Rig
from formats.surface import SurfaceScan
from formats.take import FrameState


class Tracked(NamedTuple):
    """Hanger and garment as detected in a frame, the frame's state, and the ends of the held edge [m], (2, 3)."""

    hanger: HangerSight
    cloth: GarmentSight
    state: int
    held: Floats


class FrameTracker:
    """Tracks hanger and garment through a recording."""

    def __init__(self, rig: Rig, garment: Garment, picks: Floats | None = None, *, is_sparing: bool = False) -> None:
        """Prepare for a rig and a garment.

        picks [px], (2, 2): the hanger's dots in the first frame
        is_sparing: as of `hanger_tracker`

        Raises:
            UntrackableError: the rig lacks a section, or hanger or garment cannot be tracked.
        """
        hanger, self.camera = hanger_and_sensor(rig)
        self.rig, self.garment = rig, garment
        self._hanger = hanger_tracker(rig, picks, is_sparing=is_sparing)
        self._cloth = garment_tracker(garment, depth_rig(rig), self._hanger.correlation)
        self._scaled = DepthScale((rig.calibration or Calibration()).depth_scale)
        self._watch = HangerWatch(hanger)

    def track(self, frame: SensorFrame, time: float) -> Tracked:
        """Return hanger and garment of a frame at a time [s]."""
        hanger, cloth, held = nothing_seen(), nothing_found(len(self.garment.points)), np.full((2, 3), np.nan)
        lost = FrameState.MARKER_LOST | FrameState.GARMENT_LOST
        state = picture_faults(frame, self.camera)
        if state & (FrameState.WRONG_SIZE | FrameState.DEPTH_MISSING) or frame.colour is None:
            return Tracked(hanger, cloth, state | lost, held)
        depth = self._scaled(frame.depth)
        hanger = self._hanger.track(frame.colour, depth, time, frame.colour_late_s)
        state |= self._watch.faults(hanger, depth, time)
        if hanger.is_found:
            held = held_ends(hanger.positions, self.rig)
            cloth = self._cloth.track(depth, held, time, hanger.sd)
            if not cloth.valid.all() and is_garment_covered(depth, held, self.camera):
                state |= FrameState.VIEW_BLOCKED
        state |= 0 if cloth.is_found else FrameState.GARMENT_LOST
        return Tracked(hanger, cloth, state, held)

    def scan(self, time: float, *, grid: int, contour: int) -> SurfaceScan | None:
        """Scan the visible surface of the last frame; None if the garment was not found in it."""
        return self._cloth.scan(time, grid=grid, contour=contour)

    @staticmethod
    def as_frame(time: float, seen: Tracked) -> Frame:
        """Return the record of a frame in a take."""
        hanger, cloth, state, held = seen
        # The ends are rigidly attached to the markers: noise is interpolated between and extrapolated beyond them.
        sd = np.sqrt(np.mean(np.nan_to_num(hanger.sd) ** 2, axis=0))
        return Frame(
            time=time,
            markers=hanger.positions,
            held=held,
            held_valid=np.asarray(np.isfinite(held).all(1)),
            held_sd=np.broadcast_to(sd, (2, 3)),
            points=np.where(cloth.valid[:, None], cloth.points, np.nan),
            points_valid=cloth.valid,
            points_sd=np.nan_to_num(cloth.sd),
            state=int(state),
            points_hidden=cloth.hidden,
            quality=cloth.quality,
            pitch=hanger.pitch,
            pitch_sd=hanger.pitch_sd,
        )
