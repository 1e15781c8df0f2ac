"""Live devices and `.oni` recordings through OpenNI2.

Recordings play in manual mode (speed -1): each read returns the next frame and skips none. Every read is preceded
by a wait with a time limit, because reading past the end blocks for ever. The library's seek is broken and never
called.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from firmware_host import openni2_library
from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import RecordingError, SensorError, SensorStalledError, SensorUnavailableError
from firmware_host.oni_records import NodeType, OniSummary, PixelFormat, summarise
from formats.blocks import LATEST
from formats.figures import short
from formats.plain_text import counted, plain
from formats.plausible import FASTEST, RATE_WITHIN, SLOWEST
from formats.rig import Sensor

LIVE_MODE = (640, 480, 30)  # px, px, frames a second: the best mode of PS1080 devices in both depth and colour
REPLUG = "unplug and replug it"
COPY_AGAIN = "copy the recording again from its source"
BOTH = "record depth and colour"
OTHER_SENSOR = "use a sensor that does, as PS1080 devices do, or play a recording in which depth is registered"
CLOCK = time.CLOCK_BOOTTIME  # monotonic, and goes on while the computer sleeps
# s without a frame after which a recording of unknown length has ended. Our choice: it is waited once, at the end; a
# disk that pauses for longer would end the recording too early. Half and double were not tried.
END_WAIT = 1.0
# colour frames read per depth frame while they are too old for it. Our choice: bounds a wait for colour to four
# reads. Half and double were not tried.
MOST_COLOURS = 4
FAR_AHEAD = 1_000_000  # us between a depth and a colour frame: above, they are of different clocks or a restarted clock
# Depth frames for which a colour frame so far ahead is kept. Our choice: one second at 30 a second, so that frames up
# to 2 s ahead find theirs. Half and double were not tried.
COLOUR_PATIENCE = 30
# us: range of a 32-bit timestamp, and the margin in which it may wrap around.
CLOCK_RANGE, WRAP_MARGIN = 1 << 32, 10_000_000
ANOTHER_UNIT = 10.0  # times the stated rate: so far off, stamps have another unit; a camera in dim light is nearer
FOCAL_SHARE = 575.8 / 640  # focal length over width of PS1080 and Kinect v1 depth cameras (OpenNI's factory default)


class OpenNI2Sensor(DepthSensor):
    """One OpenNI2 device or recording with a depth stream and, if present, a colour stream."""

    def __init__(self, target: Path | None = None, *, device: str | None = None, anyway: bool = False) -> None:
        """Open a recording, or a live device by OpenNI2's name for it; without either, the first live device.

        anyway: accept a recording's stamps at any stated rate

        Raises:
            SensorUnavailableError: no library, no device, or a device without the needed streams.
            RecordingError: the file is missing or not a recording.
        """
        self._path, self._accepts_stamps = target, anyway
        self._summary = summarise(target) if target is not None else None
        self._openni2 = openni2_library.load()
        self._is_closed = False
        self._rounds: dict[NodeType, tuple[int, int]] = {}
        self._timeout = STALL_TIMEOUT
        self._pairs = self._paired()
        self._uri = str(target) if target is not None else device or _first_device()
        self._depth: Any = None
        self._colour: Any = None
        self._device = self._open()
        try:
            self._start()
        except self._openni2.OpenNIError as error:
            self.close()
            raise self._refused(f"its streams do not start: {openni2_library.reason(error)}") from error
        except BaseException:
            self.close()  # streams first: one that outlives its device ends the process when Python collects it
            raise

    def _open(self) -> Any:
        name = contextlib.nullcontext(self._uri) if self._path is None else openni2_library.playable(self._path)
        try:
            with name as uri:
                return self._openni2.Device(uri.encode())
        except (self._openni2.OpenNIError, AssertionError) as error:
            if self._path is not None:
                raise self._unopened(self._path) from error
            raise SensorUnavailableError(
                f"the sensor does not open ({openni2_library.reason(error)})", where=self._uri, advice=REPLUG
            ) from error

    def _unopened(self, path: Path) -> RecordingError:
        """Return the error of a recording that the player does not open: its list of frames is at its end."""
        if self._summary is None or self._summary.is_complete:
            return RecordingError("OpenNI2 cannot open it", where=path, advice=COPY_AGAIN)
        frames = counted(self._summary.depth_frames, "depth frame")
        return RecordingError(
            f"the recording is cut off at byte {path.stat().st_size}, after {frames}", where=path, advice=COPY_AGAIN
        )

    def _refused(self, what: str, advice: str = "") -> SensorError:
        """Return the error of a device or recording without the needed streams."""
        if self._path is None:
            return SensorUnavailableError(what, where=self._uri, advice=advice or REPLUG)
        return RecordingError(what, where=self._path, advice=advice or COPY_AGAIN)

    def _start(self) -> None:
        self._depth = depth = self._device.create_depth_stream()
        self._colour = colour = self._device.create_color_stream()
        if depth is None:
            raise self._refused("has no depth stream", "use a depth sensor" if self._path is None else BOTH)
        if self._device.playback is not None:
            self._device.playback.set_speed(-1.0)
            self._device.playback.set_repeat_enabled(True)
        else:
            self._set_up_live(depth, colour)
        self._info = self._describe(depth)
        self._check_numbers()
        self._check_clock()
        self._check_formats(depth, colour)
        for stream in (depth, colour):
            if stream is not None:
                stream.start()

    def _set_up_live(self, depth: Any, colour: Any) -> None:
        """Set the largest common image size, unmirrored: PS1080 devices start with mirrored images of 320 x 240."""
        for stream, pixels in ((depth, PixelFormat.DEPTH_1_MM), (colour, PixelFormat.RGB888)):
            if stream is None:
                continue
            mode = stream.get_video_mode()
            mode.resolutionX, mode.resolutionY, mode.fps = LIVE_MODE
            mode.pixelFormat = int(pixels)
            with contextlib.suppress(self._openni2.OpenNIError):  # a device without this setting keeps its own
                stream.set_video_mode(mode)
            with contextlib.suppress(self._openni2.OpenNIError):
                stream.set_mirroring_enabled(False)
        if colour is not None:
            registration = self._openni2.IMAGE_REGISTRATION_DEPTH_TO_COLOR
            if not self._device.is_image_registration_mode_supported(registration):
                raise self._refused(
                    "does not register depth to colour, and Hangtime cannot register depth itself", OTHER_SENSOR
                )
            self._device.set_image_registration_mode(registration)
            self._device.set_depth_color_sync_enabled(True)

    def _check_formats(self, depth: Any, colour: Any) -> None:
        """Refuse pixel formats other than those of `SensorFrame`, except depth in tenths of a millimetre."""
        self._is_fine = depth.get_video_mode().pixelFormat.value == PixelFormat.DEPTH_100_UM
        readable = {PixelFormat.DEPTH_1_MM, PixelFormat.DEPTH_100_UM, PixelFormat.RGB888}
        for name, stream in (("depth", depth), ("colour", colour)):
            if stream is None or (found := stream.get_video_mode().pixelFormat.value) in readable:
                continue
            known = PixelFormat(found).name if found in set(PixelFormat) else f"pixel format {found}"
            raise self._refused(
                f"its {name} comes as {known}, which Hangtime cannot read",
                "record depth as DEPTH_1_MM or DEPTH_100_UM, and colour as RGB888",
            )

    def _check_numbers(self) -> None:
        """Refuse a recording none of whose frames can be played, because the player goes by their count."""
        if self._summary is not None and (count := self._summary.depth_frames) <= self._summary.beyond:
            raise self._refused(
                f"the numbers of all its {count} depth frames are above {count}, so none of them can be played",
                "record again, with frames numbered from 1",
            )

    def _check_clock(self) -> None:
        """Refuse a recording whose timestamps stand still or contradict its frame rate, or whose rate suits no garment.

        Frames of consecutive numbers count, so that dropped frames do not look like a slow sensor. A wrong time scale
        would give a wrong fabric, hence `--anyway` alone accepts it.
        """
        if self._summary is not None and self._summary.stands_still and not self._accepts_stamps:
            raise self._refused(
                f"the stamps of its {self._summary.depth_frames} depth frames never increase",
                "record again, with stamps of a clock in microseconds",
            )
        interval = None if self._summary is None or self._accepts_stamps else self._summary.interval_us
        if interval is None:
            return
        rate = 1e6 / interval
        faster = rate / self._info.fps
        if not 1 / RATE_WITHIN <= faster <= RATE_WITHIN:
            how = f"{short(faster)} times as fast" if faster > 1 else f"{short(1 / faster)} times as slowly"
            step = "record again with stamps in microseconds, or accept them with --anyway"
            if 1 / ANOTHER_UNIT <= faster <= ANOTHER_UNIT:
                step = "record again with a steady rate; where its frames did come so, accept the stamps with --anyway"
            raise self._refused(
                f"its stamps run {how} as its {self._info.fps:g} frames a second, {interval:.10g} us apart", step
            )
        if not rate * 1.001 >= SLOWEST or rate > FASTEST * 1.001:
            raise self._refused(
                f"has {rate:.4g} frames a second; a garment needs {SLOWEST:g} to {FASTEST:g}",
                "record with more frames a second, or accept them with --anyway",
            )

    def _describe(self, depth: Any) -> SensorInfo:
        mode = depth.get_video_mode()
        width, height = int(mode.resolutionX), int(mode.resolutionY)
        if mode.fps <= 0:
            raise self._refused(f"says that its depth comes at {mode.fps} frames a second")
        notes = []
        try:
            views = depth.get_horizontal_fov(), depth.get_vertical_fov()
        except self._openni2.OpenNIError:
            views = 0.0, 0.0
        if all(0.0 < view < np.pi for view in views):
            fx, fy = (0.5 * size / np.tan(0.5 * view) for size, view in zip((width, height), views, strict=True))
        else:  # missing, or not an angle
            fx = fy = FOCAL_SHARE * width
            notes.append(f"field of view unknown; focal length taken as {fx:.1f} px, as for PS1080 and Kinect v1")
        if self._summary is not None and not self._summary.is_complete:
            notes.append("the recording was interrupted; its last frame is left out")
        if self._summary is not None and self._summary.beyond:
            left_out, of = self._summary.beyond, self._summary.depth_frames
            notes.append(f"{left_out} of its {of} depth frames have numbers above {of} and are left out")
        if self._summary is not None and self._summary.mirrored:
            notes.append("the recording says that its pictures are mirrored; Hangtime turns mirrored pictures round")
        if self._summary is not None and self._summary.interval_us is not None:
            rate = 1e6 / self._summary.interval_us
            if not 1 / RATE_WITHIN <= rate / mode.fps <= RATE_WITHIN:
                notes.append(f"its frames come at {rate:.1f} a second, the recording states {mode.fps}")
        info = self._device.get_device_info()
        return SensorInfo(
            name=plain(info.name.decode(errors="replace")) or "OpenNI2 device",
            width=width,
            height=height,
            uri=str(self._path) if self._path else info.uri.decode(errors="replace"),
            fps=float(mode.fps),
            intrinsics=Sensor(
                width=width, height=height, fx=float(fx), fy=float(fy), cx=(width - 1) / 2, cy=(height - 1) / 2
            ),
            is_live=self._device.playback is None,
            frame_count=None if self._summary is None else _playable(self._summary),
            notes=tuple(notes),
            is_turned=self._summary is not None and bool(self._summary.mirrored),
            left_out=0 if self._summary is None else self._summary.beyond,
        )

    @property
    def info(self) -> SensorInfo:
        """Return the sensor's properties."""
        return self._info

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None at the end of a recording and ever after.

        Raises:
            SensorStalledError: a live device sent nothing for `timeout_s` seconds, or failed.
            RecordingError: the recording cannot be played any further.
        """
        if self._is_closed:
            return None
        self._timeout = timeout_s
        try:
            return next(self._pairs, None)
        except SensorStalledError:
            self._pairs = self._paired()  # a generator that raised has ended; the device may return
            raise
        except self._openni2.OpenNIError as error:
            what = f"does not give the next frame: {openni2_library.reason(error)}"
            if not self._info.is_live:
                raise self._refused(what) from error
            self._pairs = self._paired()
            raise SensorStalledError(what, where=self._uri, advice=REPLUG) from error

    def _paired(self) -> Iterator[SensorFrame]:
        """Pair each depth frame with the colour frame nearest in time, within half a frame.

        A clock may be set back. If depth steps back first, a colour frame far ahead is older than the step. A colour
        frame that stays far ahead has a wrong timestamp. Depth waits for neither. If colour steps back first, it waits
        a few frames for depth to follow, since reading further colour frames would lose depth frames.
        """
        half = 0.5e6 / self._info.fps
        last_index, given = 0, 0
        last_stamp = last_colour = waited = skipped = 0
        broken = whole = 0  # depth frames: since the last intact one, and in total
        colours_left = np.inf if self._summary is None else self._summary.colour_frames
        held: tuple[int, np.ndarray[Any, Any]] | None = None
        read: tuple[int, int, np.ndarray[Any, Any] | None] | None = None
        colour: np.ndarray[Any, Any] | None
        late = 0  # us
        while self._info.frame_count is None or given < self._info.frame_count:
            found = self._read(self._depth, np.uint16)
            if found is None:
                break
            index, stamp, depth = found
            if stamp > LATEST:
                raise self._refused(
                    f"the stamp of frame {index} is {stamp:.4g} us, centuries away",
                    "record again, with stamps of a clock",
                )
            if self._summary is not None and index + skipped <= last_index:
                if stamp <= last_stamp:
                    break  # the player skipped a frame and has started again from the beginning
                skipped = last_index - index + 1  # the numbers restart, the clock continues
            index += skipped
            if depth is None:
                broken, given = broken + 1, given + 1
                continue
            colour, late = None, 0
            for _ in range(MOST_COLOURS if self._colour is not None else 0):
                if held is None:
                    if colours_left == 0:
                        break  # the next frame would be the first of the next loop
                    read = self._read(self._colour, np.uint8)
                    if read is None:
                        break
                    colours_left -= 1
                    if read[2] is None:
                        continue
                    held = read[1], read[2]
                    has_stepped_back, last_colour = held[0] < last_colour, held[0]
                    if has_stepped_back and held[0] < stamp - half:
                        break
                waited = waited + 1 if held[0] > stamp + FAR_AHEAD else 0
                if held[0] < stamp - half or (waited and (stamp < last_stamp or waited > COLOUR_PATIENCE)):
                    held = None  # useless for this frame and all later ones
                    continue
                if held[0] <= stamp + half:
                    late, colour, held = held[0] - stamp, held[1], None
                break
            dropped = max(index - last_index - 1, 0) if last_index else broken
            last_index, last_stamp, given, broken, whole = index, stamp, given + 1, 0, whole + 1
            depth = _millimetres(depth) if self._is_fine else depth
            colours, depths = [colour], [depth]
            found = depth = read = colour = None  # while waiting for the next call, the frame holds no images
            yield SensorFrame(
                index=index - 1, time_s=stamp * 1e-6, host_time_s=time.clock_gettime(CLOCK), depth=depths.pop(),
                colour=colours.pop(), dropped_before=dropped, colour_late_s=late * 1e-6,
            )  # fmt: skip
        if broken and not whole:
            raise RecordingError("every depth frame is damaged", where=self._info.uri, advice=COPY_AGAIN)

    def _read(self, stream: Any, kind: type) -> tuple[int, int, np.ndarray[Any, Any] | None] | None:
        """Read one frame as (index, time stamp [us], image), or None at the end of a recording.

        The image is None if its data are shorter than its pixels, as for a damaged frame after decompression.
        """
        limit = self._timeout if self._info.is_live else END_WAIT
        if self._openni2.wait_for_any_stream([stream], limit) is None:
            if self._info.is_live:
                raise SensorStalledError(f"no frame for {limit:g} s", where=self._info.uri, advice=REPLUG)
            return None
        frame = stream.read_frame()
        try:
            shape = (frame.height, frame.width) if kind is np.uint16 else (frame.height, frame.width, 3)
            size = int(np.prod(shape)) * np.dtype(kind).itemsize
            raw = np.frombuffer(frame.get_buffer_as_uint8(), np.uint8)[:size]
            # Copied: the memory belongs to the library, which frees it at close().
            image = raw.view(kind).reshape(shape).copy() if 0 < size == len(raw) else None
            stream_kind = NodeType.DEPTH if kind is np.uint16 else NodeType.IMAGE
            if image is not None and self._summary is not None and stream_kind in self._summary.mirrored:
                image = np.ascontiguousarray(image[:, ::-1])
            stamp = int(frame.timestamp)
            last, rounds = self._rounds.get(stream_kind, (0, 0))
            if last > CLOCK_RANGE - WRAP_MARGIN and stamp < WRAP_MARGIN:  # 32 bits wrap around after 71 minutes
                rounds += 1
            self._rounds[stream_kind] = stamp, rounds
            return int(frame.frameIndex), stamp + rounds * CLOCK_RANGE, image
        finally:
            frame.close()

    def close(self) -> None:
        """Stop the streams and close the device."""
        if self._is_closed:
            return
        self._is_closed = True
        for stream in (self._depth, self._colour):
            if stream is not None:
                for end in (stream.stop, stream.close):
                    with contextlib.suppress(self._openni2.OpenNIError):  # as of a device that was unplugged
                        end()
        with contextlib.suppress(self._openni2.OpenNIError):
            self._device.close()


def _first_device() -> str:
    uris = openni2_library.live_uris()
    if not uris:
        raise SensorUnavailableError(
            "no depth sensor is connected",
            where="OpenNI2",
            advice="plug it in; if it is plugged in, see `hangtime sensor doctor`",
        )
    return uris[0]


def _millimetres(tenths: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Round depth in tenths of a millimetre, uint16; a measured depth stays above 0."""
    return np.where(tenths > 0, np.maximum(tenths // 10 + (tenths % 10 >= 5), 1), 0).astype(np.uint16)


def _playable(summary: OniSummary) -> int:
    """Return the number of frames to deliver: all but the last if the recording was interrupted."""
    return summary.depth_frames if summary.is_complete else summary.depth_frames - 1
