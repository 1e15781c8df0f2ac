"""Write .oni recordings that OpenNI2 plays, so that synthetic recordings pass through the same code as real ones.

The order of writes lets a file cut off at any moment open and play to its last whole frame:

- header
- per stream NODE_ADDED, its properties, STATE_READY
- before the first frame the header again, now with the number of streams
- DATA_BEGIN, then frames
- at the end NODE_REMOVED and the seek table per stream, END, and NODE_ADDED and the header again in place

OpenNI2's own recorder writes the number of streams only at the end, and its interrupted files do not open.
Source: OpenNI2 2.2, Source/Core/OniRecorder.cpp and Source/Drivers/OniFile/Player*.cpp.
"""

from __future__ import annotations

import contextlib
import math
import os
import struct
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np

from firmware_host.errors import RecordingError
from firmware_host.oni_depth_codec import encode_depth
from firmware_host.oni_records import (
    FILE_HEADER,
    FILE_MAGIC,
    FILE_VERSION,
    RECORD_HEADER,
    RECORD_MAGIC,
    SEEK_ENTRY,
    NodeType,
    PixelFormat,
    RecordType,
)
from formats.arrays import Bytes, Unsigned
from formats.rig import Sensor
from formats.system_causes import step_to_write

MAX_DEPTH = 10000  # mm, the PS1080's largest depth
UNKNOWN_COUNT, UNKNOWN_TIME = 0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF  # all bits set: written at first, and replaced at the end
PIXEL_FORMATS = {  # OniPixelFormat, XnPixelFormat
    NodeType.DEPTH: (PixelFormat.DEPTH_1_MM, 4),
    NodeType.IMAGE: (PixelFormat.RGB888, 1),
}
NODE_NAMES = {NodeType.DEPTH: "Depth", NodeType.IMAGE: "Image"}


@dataclass
class _Stream:
    node: int
    kind: NodeType
    codec: str
    added_at: int = 0
    last_frame_at: int = 0
    last_time_us: int = 0
    seek_table: list[tuple[int, int, int]] = field(default_factory=lambda: [(0, 0, 0)])

    @property
    def frames(self) -> int:
        return len(self.seek_table) - 1


class OniWriter:
    """Writes one recording of depth and, optionally, colour.

    `intrinsics` set the size and the field of view; `depth_codec` "16zT" is lossless and about four times smaller.

    Raises:
        RecordingError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        intrinsics: Sensor,
        *,
        fps: int = 30,  # frames a second, of the PS1080 at VGA
        depth_codec: Literal["16zT", "NONE"] = "16zT",
        with_colour: bool = True,
    ) -> None:
        self.path, self.intrinsics, self.fps = path, intrinsics, fps
        try:
            self._file = path.open("w+b")
        except OSError as error:
            raise RecordingError(
                f"the recording cannot be written ({error.strerror})", where=path, advice=step_to_write(error)
            ) from error
        self._begun = False
        self._write_header(UNKNOWN_TIME, 0)
        self._depth = self._add_stream(_Stream(1, NodeType.DEPTH, depth_codec))
        self._colour = self._add_stream(_Stream(2, NodeType.IMAGE, "NONE")) if with_colour else None

    def write_depth(self, time_us: int, depth: Unsigned) -> None:
        """Append one depth frame [mm], (height, width); time stamps [us] are above 0 and increase."""
        _check_frame(depth, np.uint16, (self.intrinsics.height, self.intrinsics.width))
        pixels = np.ascontiguousarray(depth)
        encoded = encode_depth(pixels) if self._depth.codec == "16zT" else pixels.tobytes()
        self._append(self._depth, time_us, encoded)

    def write_colour(self, time_us: int, colour: Bytes) -> None:
        """Append one colour frame, RGB, (height, width, 3); time stamps [us] are above 0 and increase."""
        if self._colour is None:
            raise ValueError("this recording was opened without colour")
        _check_frame(colour, np.uint8, (self.intrinsics.height, self.intrinsics.width, 3))
        self._append(self._colour, time_us, np.ascontiguousarray(colour).tobytes())

    def close(self) -> None:
        """Finish the recording and put it on the disk; closing twice is allowed."""
        if self._file.closed:
            return
        try:
            if not self._begun:
                self._begin()
            tables = {}
            for stream in self._streams:
                self._record(RecordType.NODE_REMOVED, stream.node, undo=stream.added_at)
                table = b"".join(SEEK_ENTRY.pack(*entry) for entry in stream.seek_table)
                tables[stream.node] = self._record(RecordType.SEEK_TABLE, stream.node, payload=table)
            self._record(RecordType.END, 0)
            for stream in self._streams:
                self._file.seek(stream.added_at)
                self._node_added(stream, stream.frames, stream.last_time_us, tables[stream.node])
            self._write_header(max(stream.last_time_us for stream in self._streams), len(self._streams))
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
        except OSError as error:
            raise self._write_error(error) from error
        finally:
            with contextlib.suppress(OSError):  # already closed, or reported above
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _streams(self) -> list[_Stream]:
        return [self._depth] if self._colour is None else [self._depth, self._colour]

    def _append(self, stream: _Stream, time_us: int, payload: bytes) -> None:
        # The player silently drops a frame with time 0.
        if time_us <= stream.last_time_us:
            raise ValueError(f"time stamps must be above 0 and increase: {time_us} after {stream.last_time_us}")
        try:
            if not self._begun:
                self._begin()
            fields = struct.pack("<QI", time_us, stream.frames + 1)
            position = self._record(RecordType.NEW_DATA, stream.node, fields, payload, undo=stream.last_frame_at)
        except OSError as error:
            raise self._write_error(error) from error
        stream.last_frame_at, stream.last_time_us = position, time_us
        stream.seek_table.append((time_us, 0, position))

    def _write_error(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"writing the recording failed ({error.strerror})",
            where=self.path,
            advice=step_to_write(error),
        )

    def _begin(self) -> None:
        end = self._file.tell()
        self._write_header(UNKNOWN_TIME, len(self._streams))
        self._file.seek(end)
        for stream in self._streams:
            self._record(RecordType.DATA_BEGIN, stream.node, struct.pack("<IQ", UNKNOWN_COUNT, UNKNOWN_TIME))
        self._begun = True

    def _write_header(self, last_time_us: int, nodes: int) -> None:
        self._file.seek(0)
        self._file.write(FILE_HEADER.pack(FILE_MAGIC, *FILE_VERSION, last_time_us, nodes))

    def _record(self, kind: RecordType, node: int, fields: bytes = b"", payload: bytes = b"", undo: int = 0) -> int:
        position = self._file.tell()
        size = RECORD_HEADER.size + len(fields)
        self._file.write(RECORD_HEADER.pack(RECORD_MAGIC, kind, node, size, len(payload), undo) + fields)
        self._file.write(payload)
        return position

    def _node_added(self, stream: _Stream, frames: int, last_time_us: int, table_at: int) -> int:
        codec = int.from_bytes(stream.codec.encode(), "little")
        numbers = struct.pack("<IIIQQQ", stream.kind, codec, frames, 0, last_time_us, table_at)
        return self._record(RecordType.NODE_ADDED, stream.node, _text(NODE_NAMES[stream.kind]) + numbers)

    def _property(self, kind: RecordType, node: int, name: str, value: bytes) -> None:
        self._record(kind, node, _text(name) + struct.pack("<I", len(value)) + value)

    def _add_stream(self, stream: _Stream) -> _Stream:
        stream.added_at = self._node_added(stream, UNKNOWN_COUNT, UNKNOWN_TIME, 0)
        size = self.intrinsics
        oni_format, xn_format = PIXEL_FORMATS[stream.kind]
        bytes_per_pixel = 2 if stream.kind == NodeType.DEPTH else 3
        mode = struct.pack("<III", size.width, size.height, self.fps)
        field_of_view = struct.pack(
            "<dd", 2.0 * math.atan(size.width / (2.0 * size.fx)), 2.0 * math.atan(size.height / (2.0 * size.fy))
        )
        numbers = {
            "oniRequiredFrameSize": size.width * size.height * bytes_per_pixel,
            "xnIsGenerating": 1,
            "xnSupportedMapOutputModesCount": 1,
            "xnPixelFormat": xn_format,
            "oniPixelFormat": oni_format,
            "Cropping": 1,
            "Mirror": 1,
            "xnMirror": 0,
        }
        if stream.kind == NodeType.DEPTH:
            numbers["xnDeviceMaxDepth"] = MAX_DEPTH
        for name, number in numbers.items():
            self._property(RecordType.INT_PROPERTY, stream.node, name, struct.pack("<Q", number))
        general = {
            "xnSupportedMapOutputModes": mode,
            "xnMapOutputMode": mode,
            "xnFOV": field_of_view,
            # Without this one the player silently drops every frame of the stream.
            "xnCropping": struct.pack("<IHHHH", 0, 0, 0, 0, 0),
        }
        for name, value in general.items():
            self._property(RecordType.GENERAL_PROPERTY, stream.node, name, value)
        self._record(RecordType.STATE_READY, stream.node)
        return stream


def _text(text: str) -> bytes:
    encoded = text.encode() + b"\0"
    return struct.pack("<I", len(encoded)) + encoded


def _check_frame(image: Unsigned | Bytes, kind: type[np.generic], shape: tuple[int, ...]) -> None:
    if image.shape != shape or image.dtype != kind:
        raise ValueError(f"the frame is {image.shape} {image.dtype}, the stream is {shape} {np.dtype(kind)}")
