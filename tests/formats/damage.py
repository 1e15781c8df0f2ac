"""Damage to files, drawn at random, and the question whether a reader gave wrong data."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import msgpack
import numpy as np
import zstandard

from formats.archive import take_of
from formats.chunks import Findings, messages_in
from formats.errors import TakeError
from formats.take_report import TakeReport

PAGE = 4096
COLUMNS = (
    "time", "state", "quality", "pitch", "pitch_sd", "held", "markers", "points", "held_sd", "points_sd", "held_valid",
    "points_valid", "points_hidden",
)  # fmt: skip


def a_report(**found):
    """The report on a sound file of one second, but for what is found in it."""
    sound = TakeReport(
        frames=30, blocks=1, scans=0, damaged_blocks=0, is_complete=True, missing_frames=0, missing_scans=0, spans=(),
        earlier=(), trailing_bytes=0, other_blocks=0, other_takes=0, unread_blocks=0, doubts=(), earlier_doubts="",
    )  # fmt: skip
    return replace(sound, **found)


def chunks_of(raw):
    """Begin and end of each chunk that holds a message, and its message."""
    found, at = [], 8
    while raw[at] != 0x0F:
        end = at + 9 + struct.unpack_from("<Q", raw, at + 1)[0]
        if raw[at] == 6:
            found += [(at, end, msgpack.unpackb(data)) for data in messages_in(raw[at:end], Findings())]
        at = end
    return found


def without_end(raw):
    """The bytes of a take whose recording was interrupted after its last block."""
    return raw[: chunks_of(raw)[-1][0]]


def damaged(raw, rng):
    """The bytes of a file after one accident of a kind that disks and people cause."""
    kind, at, size = rng.integers(9), int(rng.integers(len(raw))), int(2 ** rng.uniform(0, 13))
    page = at // PAGE * PAGE
    out = bytearray(raw)
    if kind == 0:  # one bit
        out[at] ^= 1 << int(rng.integers(8))
    elif kind == 1:  # a few bytes
        for k in rng.integers(len(raw), size=int(rng.integers(2, 12))):
            out[k] = int(rng.integers(256))
    elif kind == 2:  # cut off
        del out[at:]
    elif kind == 3:  # zeros
        out[at : at + size] = bytes(min(size, len(raw) - at))
    elif kind == 4:  # a page is zero
        out[page : page + PAGE] = bytes(min(PAGE, len(raw) - page))
    elif kind == 5:  # a page comes twice
        out[page:page] = out[page : page + PAGE]
    elif kind == 6:  # bytes are lost
        del out[at : at + size]
    elif kind == 7:  # noise
        out[at : at + size] = rng.bytes(min(size, len(raw) - at))
    else:  # one place is copied over another
        other = int(rng.integers(len(raw)))
        part = out[other : other + size]
        out[at : at + len(part)] = part
    return bytes(out)


def is_wrong(raw, sound):
    """Whether the reader gives a frame or a scan that `sound`, the take of the undamaged file, does not have."""
    try:
        take = take_of(raw, "damaged")
    except TakeError:
        return False
    rows = np.searchsorted(sound.time, take.time)
    if (rows == len(sound.time)).any():
        return True
    if any(not np.array_equal(getattr(take, name), getattr(sound, name)[rows], equal_nan=True) for name in COLUMNS):
        return True
    scans = {scan.time: scan for scan in sound.scans}
    if any(
        scan.time not in scans or not np.array_equal(scan.grid, scans[scan.time].grid, equal_nan=True)
        for scan in take.scans
    ):
        return True
    if (take.take_id, take.rig, take.garment) != (sound.take_id, sound.rig, sound.garment):
        return True
    return len(take.time) < len(sound.time) and (take.is_complete or not take.missing)


def chunk_of(content, *, crc=None, compression=b"zstd"):
    """A chunk of one message; crc: instead of the right one."""
    data = msgpack.packb(content) if not isinstance(content, bytes) else content
    return chunk_of_records(
        struct.pack("<BQHIQQ", 5, 22 + len(data), 1, 0, 0, 0) + data, crc=crc, compression=compression
    )


def chunk_of_records(records, *, crc=None, compression=b"zstd"):
    packed = zstandard.compress(records) if compression == b"zstd" else records
    crc = zlib.crc32(records) if crc is None else crc
    body = struct.pack("<QQQII", 0, 0, len(records), crc, len(compression)) + compression
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body
