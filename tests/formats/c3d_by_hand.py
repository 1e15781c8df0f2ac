"""C3D files of traits that libraries do not write: byte orders, integers, odd labels.

Format: https://www.c3d.org, user guide. A DEC float is four times the IEEE one, its 16-bit halves exchanged.
"""

from __future__ import annotations

import struct

import numpy as np

PROCESSORS = {"intel": 84, "dec": 85, "sgi": 86}


def c3d_bytes(positions, labels, *, processor="intel", rate=100.0, units=("mm",), scale=-1.0, frames_said=None):
    """positions, (frames, points, 3), in the file's unit, NaN where not seen; scale above 0: 16-bit integers."""
    order = ">" if processor == "sgi" else "<"
    frames, points = positions.shape[:2]
    said = frames_said or frames

    def float_bytes(value):
        if processor != "dec":
            return struct.pack(order + "f", value)
        raw = struct.pack("<f", 4 * value)
        return raw[2:] + raw[:2]

    def parameter(name, data, kind, dimensions):
        body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
        return struct.pack("<bb", len(name), 1) + name.encode() + struct.pack(order + "H", len(body) + 2) + body

    def texts(values):
        width = max([len(value) for value in values] or [0])
        return b"".join(value.encode().ljust(width) for value in values), -1, [width, len(values)]

    def parameters(start):
        short = lambda number: struct.pack(order + "H", number)  # noqa: E731
        group = struct.pack("<bb", 5, -1) + b"POINT" + struct.pack(order + "H", 3) + b"\0"
        return group + b"".join([
            parameter("USED", short(points), 2, []), parameter("SCALE", float_bytes(scale), 4, []),
            parameter("RATE", float_bytes(rate), 4, []), parameter("FRAMES", short(said), 2, []),
            parameter("DATA_START", short(start), 2, []), parameter("LABELS", *texts(labels)),
            *([parameter("UNITS", *texts(units))] if units else []),
        ]) + b"\0\0"  # fmt: skip

    blocks = -(-(4 + len(parameters(0))) // 512)
    start = 2 + blocks
    section = struct.pack("<BBBB", 1, 0x50, blocks, PROCESSORS[processor]) + parameters(start)
    head = bytearray(512)
    struct.pack_into("<BB", head, 0, 2, 0x50)
    struct.pack_into(order + "HHHHH", head, 2, points, 0, 1, said, 10)
    head[12:16], head[20:24] = float_bytes(scale), float_bytes(rate)
    struct.pack_into(order + "HH", head, 16, start, 0)
    seen = np.isfinite(positions).all(2)
    values = np.concatenate([np.where(seen[..., None], positions, 0.0), np.where(seen, 0.0, -1.0)[..., None]], axis=2)
    if scale > 0:
        data = np.concatenate([np.rint(values[..., :3] / scale), values[..., 3:]], 2).astype(order + "i2").tobytes()
    elif processor == "dec":
        data = (4 * values).astype("<f4").view("<u2").reshape(*values.shape, 2)[..., ::-1].tobytes()
    else:
        data = values.astype(order + "f4").tobytes()
    whole = bytes(head) + section.ljust(512 * blocks, b"\0") + data
    return whole + bytes(-len(whole) % 512)
