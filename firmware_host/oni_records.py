"""The layout of .oni recordings: reads all record headers, to detect damage before a player does.

All numbers are little-endian and packed:

    file header   24 bytes: "NI10", version 1.0.1.0, largest time stamp (u64, us), largest node id (u32)
    record        28 bytes: "NIR" 0, type, node, size of header and fields, size of payload (u32 each),
                  undo position (u64); then fields, then payload

Source: OpenNI2 2.2, Source/Core/OniDataRecords.{h,cpp} and Source/Drivers/OniFile/DataRecords.h.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from pathlib import Path
from statistics import fmean

from firmware_host.errors import RecordingError
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

FILE_MAGIC = b"NI10"
FILE_VERSION = (1, 0, 1, 0)  # major, minor, maintenance and build number, OniDataRecords.h
FILE_HEADER = struct.Struct("<4sBBHIQI")
RECORD_HEADER = struct.Struct("<IIIIIQ")
RECORD_MAGIC = int.from_bytes(b"NIR\0", "little")
STAMP = struct.Struct("<QI")  # of a frame: time stamp, number
SEEK_ENTRY = struct.Struct("<QIQ")  # time stamp, configuration id, position in the file
MOST_ONI_NODES = 255  # devices and streams; real recordings have up to 5, and the player allocates all at once
LARGEST_RECORD = 1 << 28  # bytes; a 4K colour frame has 25 MB, so anything larger is damage
PROPERTY_SIZES = {  # bytes of a value that the player copies into a buffer of exactly this size
    "xnFOV": 16,  # XnFieldOfView, two doubles
    "xnMapOutputMode": 12,  # XnMapOutputMode: width, height, frames a second
    "xnCropping": 12,  # XnCropping: is it on, padded to 4; x, y, width, height of 2 bytes each
}


class RecordType(IntEnum):
    """The record types that Hangtime reads or writes."""

    INT_PROPERTY = 0x03
    REAL_PROPERTY = 0x04
    STRING_PROPERTY = 0x05
    GENERAL_PROPERTY = 0x06
    NODE_REMOVED = 0x07
    DATA_BEGIN = 0x08
    STATE_READY = 0x09
    NEW_DATA = 0x0A
    END = 0x0B
    NODE_ADDED_1_0_0_4 = 0x02
    NODE_ADDED_1_0_0_5 = 0x0C
    NODE_ADDED = 0x0D
    SEEK_TABLE = 0x0E


class NodeType(IntEnum):
    """Kinds of streams (XnProductionNodeType)."""

    DEPTH = 2
    IMAGE = 3


class PixelFormat(IntEnum):
    """The pixel format of an image (OniPixelFormat)."""

    DEPTH_1_MM = 100
    DEPTH_100_UM = 101
    SHIFT_9_2 = 102
    SHIFT_9_3 = 103
    RGB888 = 200
    YUV422 = 201
    GRAY8 = 202
    GRAY16 = 203
    JPEG = 204
    YUYV = 205


@dataclass(frozen=True)
class Record:
    """One record's position and header; `fields` are the bytes between header and payload."""

    position: int
    type: int
    node: int
    fields: bytes
    payload_size: int


@dataclass(frozen=True)
class OniSummary:
    """The summary of a recording's records: frames per stream, and whether the file was closed properly.

    - `interval_us`: mean of the middle half of the intervals between depth frames of consecutive numbers; None for
      a single frame
    - `beyond`: depth frames whose number exceeds the count of depth frames; the player skips them
    - `mirrored`: streams that the recording declares as mirrored
    - `stands_still`: no stamp of a depth frame exceeds the stamp before it; False for a single frame
    """

    depth_frames: int
    colour_frames: int
    is_complete: bool
    interval_us: float | None = None
    mirrored: frozenset[int] = frozenset()
    beyond: int = 0
    stands_still: bool = False


def read_records(path: Path) -> Iterator[Record]:
    """Yield every complete record up to the END record or the end of a truncated file.

    Raises:
        RecordingError: the file is missing, is not an .oni recording, or its chain of records is broken.
    """
    try:
        size = path.stat().st_size
        check_ends(path)
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(
            f"the recording cannot be read ({error.strerror})", where=path, advice=step_to_read(error)
        ) from error
    with file:
        header = file.read(FILE_HEADER.size)
        if len(header) < FILE_HEADER.size and header.startswith(FILE_MAGIC):
            raise _cut_off(path, "its first record")
        if len(header) < FILE_HEADER.size or header[:4] != FILE_MAGIC:
            raise RecordingError(
                "this is not an .oni recording",
                where=path,
                advice="give a file recorded by OpenNI2, NiViewer or `hangtime sensor synthesise`",
            )
        if FILE_HEADER.unpack(header)[-1] > MOST_ONI_NODES:
            raise _damaged(path, FILE_HEADER.size - 4)
        position = FILE_HEADER.size
        while position + RECORD_HEADER.size <= size:
            file.seek(position)
            magic, kind, node, fields_size, payload_size, _ = RECORD_HEADER.unpack(file.read(RECORD_HEADER.size))
            if magic != RECORD_MAGIC or fields_size < RECORD_HEADER.size or fields_size + payload_size > LARGEST_RECORD:
                raise _damaged(path, position)
            following = position + fields_size + payload_size
            if following > size:
                return
            fields = file.read(fields_size - RECORD_HEADER.size)
            yield Record(position, kind, node, fields, payload_size)
            if kind == RecordType.END:
                return
            position = following


def is_sound(record: Record) -> bool:
    """Return whether a property's name and value have the stated lengths, so that the player reads no other memory.

    The player trusts both lengths. It looks names up in a table, beyond which non-ASCII letters point. Records of other
    types count as sound.
    """
    kinds = {RecordType.INT_PROPERTY: 8, RecordType.REAL_PROPERTY: 8}
    if record.type not in {*kinds, RecordType.STRING_PROPERTY, RecordType.GENERAL_PROPERTY}:
        return True
    name_end = 4 + int.from_bytes(record.fields[:4], "little")
    name, value = record.fields[4:name_end], record.fields[name_end + 4 :]
    size = int.from_bytes(record.fields[name_end : name_end + 4], "little")
    if not (name[:-1].isascii() and name.find(b"\0") == len(name) - 1 > 0) or len(value) != size:
        return False
    if record.type == RecordType.STRING_PROPERTY:
        return value.endswith(b"\0")
    return size == kinds.get(RecordType(record.type), PROPERTY_SIZES.get(name[:-1].decode(), size))


def summarise(path: Path) -> OniSummary:
    """Count the frames of a recording from its record headers alone (about a millisecond per hundred frames).

    Properties are checked as well; the content of frames is not.

    Raises:
        RecordingError: the file is missing, damaged, cut off before its first depth frame, no .oni recording, or holds
            no depth stream or no depth frame.
    """
    kinds: dict[int, int] = {}
    mirrored: set[int] = set()
    stamps: list[tuple[int, int]] = []
    counts = {NodeType.DEPTH: 0, NodeType.IMAGE: 0}
    is_complete = False
    added = {RecordType.NODE_ADDED, RecordType.NODE_ADDED_1_0_0_4, RecordType.NODE_ADDED_1_0_0_5}
    for record in read_records(path):
        if not is_sound(record):
            raise _damaged(path, record.position)
        if record.type in added:
            name_size = int.from_bytes(record.fields[:4], "little")
            kinds[record.node] = int.from_bytes(record.fields[4 + name_size : 8 + name_size], "little")
        elif record.type == RecordType.NEW_DATA:
            kind = kinds.get(record.node)
            if kind in (NodeType.DEPTH, NodeType.IMAGE):
                counts[NodeType(kind)] += 1
            if kind == NodeType.DEPTH and len(record.fields) >= STAMP.size:
                stamps.append(STAMP.unpack_from(record.fields))
        elif record.type == RecordType.INT_PROPERTY and record.fields[4:13] == b"xnMirror\0":
            is_on = int.from_bytes(record.fields[17:25], "little") != 0
            (mirrored.add if is_on else mirrored.discard)(record.node)
        is_complete = record.type == RecordType.END
    if counts[NodeType.DEPTH] == 0 and not is_complete:
        raise _cut_off(path, "its first depth frame")
    if counts[NodeType.DEPTH] == 0:
        raise RecordingError(
            "the recording holds no depth frame", where=path, advice="record again with the depth stream switched on"
        )
    steps = [b[0] - a[0] for a, b in pairwise(stamps)]
    apart = sorted(b[0] - a[0] for a, b in pairwise(stamps) if b[1] == a[1] + 1 and b[0] > a[0])
    cut = min(-(-len(apart) // 4), (len(apart) - 1) // 2)  # a quarter at each end; one of three or four intervals
    return OniSummary(
        counts[NodeType.DEPTH], counts[NodeType.IMAGE], is_complete,
        interval_us=fmean(apart[cut : len(apart) - cut]) if apart else None,
        mirrored=frozenset(kinds[node] for node in mirrored if node in kinds),
        beyond=sum(number > counts[NodeType.DEPTH] for _, number in stamps),
        stands_still=bool(steps) and max(steps) <= 0,
    )  # fmt: skip


def _cut_off(path: Path, before: str) -> RecordingError:
    """Return the error of a truncated file, which lacks its END record and a necessary part."""
    return RecordingError(
        f"the recording is cut off at byte {path.stat().st_size}, before {before}", where=path,
        advice="copy it again from its source, or record again",
    )  # fmt: skip


def _damaged(path: Path, position: int) -> RecordingError:
    return RecordingError(
        f"the recording is damaged at byte {position}", where=path, advice="copy it again from its source"
    )
