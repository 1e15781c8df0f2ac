"""Track a sensor's frames and keep what was seen as a take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.errors import NoMarkersError, OutputError, UntrackableError
from capture.garment import GarmentSight, GarmentTracker, nothing_found
from capture.garment_tracker import garment_tracker
from capture.markers import HangerSight, MarkerTracker, nothing_seen
from firmware_host.depth_sensor import DepthSensor, SensorFrame
from formats.archive import TakeWriter
from formats.blocks import Frame
from formats.errors import TakeError
from formats.garment import Garment
from formats.hanger import held_ends
from formats.rig import Rig
from formats.take import FrameState

Floats = NDArray[np.float64]
Watcher = Callable[[SensorFrame, HangerSight, GarmentSight], None]
Progress = Callable[[int, int | None, float], None]

FEWEST_HANGERS = 10  # frames with both markers; fewer are no recording of a hanger
SCAN_TOLERANCE = 1e-3  # s: frames come a little early or late
NEAREST, FARTHEST = 0.8, 3.5  # m: a structured-light sensor's range, within which its noise model holds
FEWEST_DEPTH = 0.01  # of the pixels that must have depth


@dataclass(frozen=True, kw_only=True)
class ScanPlan:
    """How often the visible surface is kept, in scans a second, and with how many places.

    grid: along each side of the grid; contour: around the silhouette
    """

    rate: float = 5.0
    grid: int = 12
    contour: int = 96


@dataclass(frozen=True, kw_only=True)
class RecordingReport:
    """What was recorded: frames, and in how many the hanger and each point were seen."""

    path: Path
    frames: int
    with_hanger: int
    point_share: Floats
    is_interrupted: bool


def record(
    sensor: DepthSensor,
    rig: Rig,
    garment: Garment,
    out: Path,
    *,
    take_id: str,
    created: str,
    seconds: float | None = None,
    scans: ScanPlan | None = None,
    progress: Progress = lambda frames, total, seen: None,
    watch: Watcher | None = None,
) -> RecordingReport:
    """Track every frame of a sensor and write a take; Ctrl-C ends the take cleanly.

    Raises:
        UntrackableError: the sensor's image is not the one that the rig describes, or the garment cannot be followed.
        NoMarkersError: the hanger was hardly ever seen; no take is left behind.
        OutputError: the take cannot be written.
    """
    _check_rig(sensor, rig)
    hanger_tracker, cloth_tracker = MarkerTracker(rig), garment_tracker(garment, rig)
    cv2.setNumThreads(1)
    try:
        writer = TakeWriter(out, take_id=take_id, created=created, rig=rig, garment=garment, source=sensor.info.uri)
    except OSError as error:
        raise OutputError(f"cannot be written ({error.strerror})", where=out, advice="choose another folder") from error
    frames = with_hanger = 0
    seen = np.zeros(len(garment.points))
    first = last = -np.inf
    is_interrupted = False
    jumped = False
    next_scan = -np.inf
    try:
        for frame in sensor.frames():
            if not frame.time_s > last:
                jumped = True  # a clock that runs backwards: the frame cannot be placed in time
                continue
            first = frame.time_s if frames == 0 else first
            last = frame.time_s
            hanger, cloth, state = _track(frame, hanger_tracker, cloth_tracker, rig, garment)
            state |= FrameState.CLOCK_JUMPED if jumped else 0
            jumped = False
            writer.append(_as_frame(frame.time_s, hanger, cloth, rig, state))
            if scans is not None and frame.time_s >= next_scan:
                scan = (
                    cloth_tracker.scan(frame.time_s, grid=scans.grid, contour=scans.contour) if cloth.is_found else None
                )
                if scan is not None:
                    writer.append_scan(scan)
                    next_scan = frame.time_s + 1.0 / scans.rate - SCAN_TOLERANCE
            frames += 1
            with_hanger += hanger.is_found
            seen += cloth.valid
            if watch is not None:
                watch(frame, hanger, cloth)
            progress(frames, sensor.info.frame_count, with_hanger / frames)
            if seconds is not None and last - first >= seconds:
                break
    except KeyboardInterrupt:
        is_interrupted = True
    except OSError as error:
        writer.discard()
        raise OutputError(f"writing failed ({error.strerror})", where=out, advice="make room on the disk") from error
    except BaseException:
        writer.discard()
        raise
    if with_hanger < FEWEST_HANGERS:
        writer.discard()
        markers = rig.hanger
        raise NoMarkersError(
            f"both hanger markers were seen together in {with_hanger} of {frames} frames; no take was kept",
            where=sensor.info.uri,
            advice=f"show markers {markers.ids if markers else ''} of {markers.dictionary if markers else ''} to the "
            "camera, flat and in good light",
        )
    try:
        writer.finish()
    except (OSError, TakeError) as error:
        writer.discard()
        raise OutputError(
            f"the take could not be finished: {error}", where=out, advice="make room on the disk"
        ) from error
    return RecordingReport(
        path=out,
        frames=frames,
        with_hanger=with_hanger,
        point_share=seen / max(frames, 1),
        is_interrupted=is_interrupted,
    )


def _check_rig(sensor: DepthSensor, rig: Rig) -> None:
    if rig.sensor is None or rig.hanger is None:
        raise UntrackableError(
            "the rig has no [sensor] or no [hanger]", where=rig.name, advice="add it, see docs/file-formats.md"
        )
    info = sensor.info
    if (info.width, info.height) != (rig.sensor.width, rig.sensor.height):
        raise UntrackableError(
            f"the sensor gives {info.width} x {info.height} pixels, the rig says "
            f"{rig.sensor.width} x {rig.sensor.height}",
            where=rig.name,
            advice="set the rig's [sensor] to this sensor",
        )


def _track(
    frame: SensorFrame, hanger_tracker: MarkerTracker, cloth_tracker: GarmentTracker, rig: Rig, garment: Garment
) -> tuple[HangerSight, GarmentSight, int]:
    """Find hanger and garment in one frame; return both sights and the frame's state."""
    state = FrameState.FRAMES_DROPPED_BEFORE if frame.dropped_before else 0
    has_depth = np.count_nonzero(frame.depth) >= FEWEST_DEPTH * frame.depth.size
    hanger, cloth = nothing_seen(), nothing_found(len(garment.points))
    if not has_depth:
        state |= FrameState.DEPTH_MISSING
    if frame.colour is None:
        state |= FrameState.COLOUR_MISSING
    if has_depth and frame.colour is not None:
        hanger = hanger_tracker.track(frame.colour, frame.depth, frame.time_s)
    if hanger.is_found:
        held = held_ends(hanger.positions, rig)
        cloth = cloth_tracker.track(frame.depth, held, frame.time_s)
        if not NEAREST <= held[:, 2].mean() <= FARTHEST:
            state |= FrameState.OUT_OF_RANGE
        if cloth.is_covered:
            state |= FrameState.GARMENT_COVERED
    else:
        state |= FrameState.MARKER_LOST
    if not cloth.is_found:
        state |= FrameState.GARMENT_LOST
    return hanger, cloth, state


def _as_frame(time: float, hanger: HangerSight, cloth: GarmentSight, rig: Rig, state: int) -> Frame:
    held = held_ends(hanger.positions, rig)
    # The ends are a rigid step from both markers: between them interpolation, beyond them extrapolation of the noise.
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
    )
