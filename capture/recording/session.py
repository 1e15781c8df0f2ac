"""Track a sensor's frames and write the result as a take."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from capture.errors import CaptureError, HangerGapError, NoMarkersError, UnfitTakeError, UntrackableError
from capture.garment.sight import GarmentSight
from capture.hanger.fiducial_tracker import HangerSight
from capture.hanger.seen_otherwise import is_seen_twice, seen_otherwise
from capture.hanger.seen_sizes import sizes_seen, wrong_size, wrong_unit
from capture.recording.condition import RECORD_AGAIN, Condition
from capture.recording.frame_reader import FrameReader, ScanPlan
from capture.recording.stop_signals import StopRequest, stopped_like_ctrl_c
from capture.recording.tally import Tally
from capture.recording.upside_down import of_the_sensor
from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import SensorError
from formats.archive import TakeWriter, read_take
from formats.arrays import Floats
from formats.errors import HangtimeError, OutputError, TakeError
from formats.findings import Finding
from formats.garment import Garment
from formats.judgement import FEWEST_HANGERS, judge
from formats.outputs import unwritable
from formats.rig import Hanger, Rig
from formats.system_causes import step_to_write
from formats.unfinished import TellAside

Watcher = Callable[[SensorFrame, HangerSight, GarmentSight], None]
Progress = Callable[[int, int | None, float], None]
Announce = Callable[[float, Condition], None]

LEAST_ROOM = 8_000_000  # bytes free on the disk: below, a take is ended while it can still be finished properly
LOOK_FOR_ROOM = 1.0  # s between two checks of the disk; a take with scans grows by 20 kB meanwhile


@dataclass(frozen=True, kw_only=True)
class RecordingReport:
    """The counts of a recording: all frames, frames with the hanger, with each point, and of each condition.

    - `failure`: the fault of the sensor or of a nearly full disk that ended the recording; None after a normal end
    - `findings`: the take's defects that matter to a fit
    - `doubt`: the reason why no model can be fitted, and the remedy; None if it can; the take is kept in either case
    """

    path: Path
    frames: int
    with_hanger: int
    point_share: Floats
    conditions: dict[Condition, int]
    is_interrupted: bool
    failure: HangtimeError | None
    doubt: CaptureError | None
    findings: tuple[Finding, ...] = ()


def check_sensor(info: SensorInfo, rig: Rig, where: object) -> None:
    """Check that the sensor's image size is the rig's, and that the rig describes a sensor.

    Raises:
        UntrackableError: names both.
    """
    if rig.sensor is None or rig.hanger is None:
        raise UntrackableError(
            "the rig has no [sensor] or no [hanger]",
            where=where,
            advice="add it, see docs/reference/file-formats.md",
        )
    if (info.width, info.height) != (rig.sensor.width, rig.sensor.height):
        raise UntrackableError(
            f"{info.uri} gives {info.width} x {info.height} pixels, the rig says "
            f"{rig.sensor.width} x {rig.sensor.height}",
            where=where,
            advice=Condition.WRONG_SIZE.value.advice,
        )


def record(
    sensor: DepthSensor,
    rig: Rig,
    garment: Garment,
    out: Path,
    *,
    take_id: str,
    created: str,
    seconds: float | None = None,
    progress: Progress = lambda frames, total, seen: None,
    watch: Watcher | None = None,
    announce: Announce = lambda time, condition: None,
    picks: Floats | None = None,
    scans: ScanPlan | None = None,
    overwrite: bool = True,
    tell_aside: TellAside | None = None,
    stop: StopRequest | None = None,
) -> RecordingReport:
    """Track every frame of a sensor and write a take.

    Ctrl-C, a sensor that fails or a disk that is nearly full ends the take cleanly.

    - `announce`: called with the time [s] since the beginning and the condition at every settled change
    - `picks` [px], (2, 2): the hanger's dots in the first frame, left one first
    - `scans`: rate and size of surface scans, None for no scans
    - `overwrite`, `tell_aside`: as of `formats.unfinished.UnfinishedFile`
    - `stop`: request to end, tested once a frame and while waiting for the sensor; None: the signals of
      `capture.recording.stop_signals`

    Raises:
        UntrackableError: the sensor's image size is not the rig's, or the garment cannot be tracked.
        NoMarkersError: the hanger was hardly ever detected; no take is left behind.
        SensorError: the sensor failed before the hanger was detected; no take is left behind.
        OutputError: the take cannot be written, or not completely; the part on the disk is kept and named.
    """
    if out.is_dir():
        raise OutputError("is a folder", where=out, advice="give the name of a file in it")
    check_sensor(sensor.info, rig, rig.name)
    reader = FrameReader(sensor.info, rig, garment, picks=picks, scans=scans)
    tally = Tally(len(garment.points))
    cv2.setNumThreads(1)
    is_interrupted = False
    failure: HangtimeError | None = None
    next_look = -np.inf
    shown: SensorFrame | None = None  # the last one in which both markers were found

    def tell(changed: Condition | None) -> None:
        if (
            changed in (Condition.NO_MARKERS, Condition.ONE_MARKER)
            and reader.frame is not None
            and rig.hanger
            and is_seen_twice(reader.frame.colour, rig.hanger)
        ):
            changed = Condition.SEEN_TWICE
        if changed is not None:
            announce(reader.now - tally.first, changed)

    with ExitStack() as opened:
        if stop is None:
            stop = opened.enter_context(stopped_like_ctrl_c())
        opened.enter_context(stop.held())  # an interrupt in the middle of a write would damage the take
        try:
            writer = TakeWriter(
                out, take_id=take_id, created=created, rig=rig, garment=garment, source=sensor.info.uri,
                overwrite=overwrite, tell_aside=tell_aside,
            )  # fmt: skip
        except OSError as error:
            raise unwritable(out, error) from error
        try:
            for came in _frames(sensor, stop):
                seen = reader.read(came)
                if seen is None:
                    tell(tally.add_unplaced(reader.now))
                    if seconds is not None and reader.now - tally.first >= seconds:
                        break
                    continue
                try:
                    writer.append(seen.frame)
                    if seen.scan is not None:
                        writer.append_scan(seen.scan)
                except OSError as error:
                    what = f"writing failed ({error.strerror})"
                    raise _broken_off(writer, tally.with_hanger, what, error) from error
                tell(tally.add(seen))
                if np.isfinite(seen.frame.markers).all():
                    shown = reader.frame
                if watch is not None and reader.frame is not None and reader.sight is not None:
                    watch(reader.frame, reader.sight.hanger, reader.sight.cloth)
                progress(tally.frames, sensor.info.frame_count, tally.with_hanger / tally.frames)
                if seconds is not None and tally.seconds >= seconds:
                    break
                if seen.time >= next_look:
                    next_look = seen.time + LOOK_FOR_ROOM
                    failure = _lack_of_room(out)
                    if failure is not None:
                        break
        except KeyboardInterrupt:
            is_interrupted = True
        except SensorError as error:
            failure = error
        except OutputError:
            raise
        except BaseException as error:
            broken = _broken_off(writer, tally.with_hanger, f"recording broke off: {error}", error)
            if not writer.partial.exists():
                raise
            if isinstance(error, HangtimeError):
                raise broken from error
            error.add_note(str(broken))
            raise
        if tally.with_hanger < FEWEST_HANGERS:
            writer.discard()
            raise failure or _no_markers(sensor.info.uri, rig, tally, frame=reader.frame, info=sensor.info)
        _finish(writer, tally.with_hanger)
    findings = of_the_sensor(judge(read_take(out)), shown, rig)
    return RecordingReport(
        path=out,
        frames=tally.frames,
        with_hanger=tally.with_hanger,
        point_share=tally.points_seen / max(tally.frames, 1),
        conditions=dict(tally.conditions.frames),
        is_interrupted=is_interrupted,
        failure=failure,
        findings=findings,
        doubt=_doubt(out, rig, tally, findings, sensor.info),
    )


def _frames(sensor: DepthSensor, stop: StopRequest) -> Iterator[SensorFrame]:
    """Yield a sensor's frames; an interrupt takes effect only while waiting for one."""
    while True:
        with stop.released():
            frame = sensor.read()
        if frame is None:
            return
        yield frame


def _finish(writer: TakeWriter, with_hanger: int) -> None:
    try:
        writer.finish()
    except OutputError as error:
        writer.keep()
        advice = f"the recording is kept as {writer.partial.name}; give it another name"
        raise OutputError("has come there meanwhile", where=writer.path, advice=advice) from error
    except (OSError, TakeError) as error:
        words = error.what if isinstance(error, TakeError) else error
        raise _broken_off(writer, with_hanger, f"the take could not be finished: {words}", error) from error


def _lack_of_room(out: Path) -> OutputError | None:
    """Return the error of a disk that is nearly full or whose free space is unknown, None if the take can continue."""
    try:
        room = shutil.disk_usage(out.parent).free
    except OSError as error:
        return OutputError(
            f"the disk does not say how much room it has ({error.strerror}), so the recording was ended",
            where=out.parent, advice="check the folder",
        )  # fmt: skip
    if room >= LEAST_ROOM:
        return None
    return OutputError(
        f"only {room / 1e6:.1f} MB are left on the disk, so the recording was ended",
        where=out, advice=f"make room for {LEAST_ROOM / 1e6:.0f} MB or more, or record to another disk",
    )  # fmt: skip


def _broken_off(writer: TakeWriter, with_hanger: int, what: str, cause: BaseException) -> OutputError:
    """Close a take that cannot be continued; keep it if it shows the hanger and is readable."""
    if with_hanger < FEWEST_HANGERS or not writer.is_readable:
        writer.discard()
        advice = step_to_write(cause) if isinstance(cause, OSError) else "record it again"
        return OutputError(what, where=writer.path, advice=advice)
    writer.keep()
    return OutputError(
        what, where=writer.partial, advice="`hangtime takes show` shows the frames that were recorded until then"
    )


def _no_markers(
    where: object, rig: Rig, tally: Tally, *, kept: bool = False, frame: SensorFrame | None = None,
    info: SensorInfo | None = None,
) -> NoMarkersError:  # fmt: skip
    worst = tally.conditions.worst
    what = f"both hanger markers were seen together in {tally.with_hanger} of {tally.frames} frames; "
    what += "the take was kept, but nothing can be fitted to it" if kept else "no take was kept"
    is_live = info is None or info.is_live
    advice = worst.value.next_step(is_live=is_live) or "record longer"
    if info is not None and info.left_out and worst is Condition.GOOD:
        advice = f"write the file again: {info.left_out} of its depth frames have numbers too high to be read"
    elif kept and not advice.startswith(RECORD_AGAIN):
        advice = f"record it again: {advice}"
    picture = None if frame is None else frame.colour
    how = ""
    if frame is not None and picture is not None and rig.hanger and rig.sensor:
        sizes = sizes_seen(picture, frame.depth, rig)
        how = wrong_unit(picture, frame.depth, rig) or (wrong_size(rig.hanger, rig.sensor, sizes) if sizes else "")
    if rig.hanger is not None and (how or worst in (Condition.NO_MARKERS, Condition.ONE_MARKER, Condition.MISFIT)):
        stated = f"the rig says {_markers_of(rig.hanger)}"
        if not how and worst is Condition.NO_MARKERS:
            how = seen_otherwise(picture, rig.hanger, is_turned=info is not None and info.is_turned)
        advice = f"{stated}; {how}" if how else f"{advice} ({stated})"
    elif worst is not Condition.GOOD:
        what += f", mostly because: {worst.value.words}"
    return NoMarkersError(what, where=where, advice=advice)


def _doubt(
    where: Path, rig: Rig, tally: Tally, findings: tuple[Finding, ...], info: SensorInfo | None = None
) -> CaptureError | None:
    """Return the error of the most serious finding if it makes a fit impossible, else None."""
    if not findings or not findings[0].is_grave:
        return None
    worst = findings[0]
    if worst.name == "hanger_hardly_seen":
        return _no_markers(where, rig, tally, kept=True, info=info)
    kind = HangerGapError if worst.name == "hanger_lost" else UnfitTakeError
    alone = " by itself" if worst.name == "too_short" else ""  # beside longer takes, a fit uses what there is
    what = f"{worst.words}; the take was kept, but nothing can be fitted to it{alone}"
    return kind(what, where=where, advice=worst.advice)


def _markers_of(hanger: Hanger) -> str:
    if hanger.marker == "dot":
        return f"two dots of {1e3 * hanger.marker_size_m:g} mm, {1e3 * hanger.marker_distance_m:g} mm apart"
    size, distance = 1e3 * hanger.marker_size_m, 1e3 * hanger.marker_distance_m
    return f"markers {hanger.ids[0]} and {hanger.ids[1]} of {hanger.dictionary}, {size:g} mm, {distance:g} mm apart"
