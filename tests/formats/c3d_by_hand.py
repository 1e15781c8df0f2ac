"""Build C3D files with traits that libraries do not write: byte orders, integers, odd labels.

Format: https://www.c3d.org, user guide. A DEC float is four times the IEEE one, its 16-bit halves exchanged.
"""

from __future__ import annotations

import struct

import numpy as np

PROCESSORS = {"intel": 84, "dec": 85, "sgi": 86}


GROUPS = ((1, "POINT"), (2, "TRIAL"), (3, "ANALOG"), (4, "ROTATION"))
LABELS_AT_ONCE = 255  # that one parameter can hold; LABELS2 holds the next


def c3d_bytes(
    positions, labels, *, processor="intel", rate=100.0, units=("mm",), scale=-1.0, frames_said=None, header=None,
    analogue=0, camera_rate=None, is_locked=False, has_lower_names=False, is_group_last=False,
    more=(),
):  # fmt: skip
    """positions, (frames, points, 3), in the file's unit, NaN where not seen; scale above 0: 16-bit integers.

    - `header`: other values than the parameters' for the header's copies, `scale`, `rate`, `start` and `first` frame
    - `analogue`: values behind each frame's points
    - `camera_rate`: of a group TRIAL
    - `more`: parameters (name, bytes, kind, dimensions, number of the group)
    """
    copies = {"scale": scale, "rate": rate or 0.0, "start": None, "first": 1} | (header or {})
    order = ">" if processor == "sgi" else "<"
    frames, points = positions.shape[:2]
    said = frames_said or frames

    def float_bytes(value):
        if processor != "dec":
            return struct.pack(order + "f", value)
        raw = struct.pack("<f", 4 * value)
        return raw[2:] + raw[:2]

    def parameter(name, data, kind, dimensions, group=1):
        body = struct.pack("<bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
        return start_of(name, group) + struct.pack(order + "H", len(body) + 2) + body

    def start_of(name, group):
        shown = name.lower() if has_lower_names else name
        return struct.pack("<bb", -len(name) if is_locked else len(name), group) + shown.encode()

    def texts(values):
        raw = [value.encode() for value in values]
        width = max([len(value) for value in raw] or [0])
        return b"".join(value.ljust(width) for value in raw), -1, [width, len(raw)]

    def parameters(start):
        short = lambda number: struct.pack(order + "H", number)  # noqa: E731
        groups = [start_of(n, -k) + struct.pack(order + "H", 3) + b"\0" for k, n in GROUPS]
        found = [
            parameter("USED", short(points), 2, []), parameter("SCALE", float_bytes(scale), 4, []),
            parameter("FRAMES", short(said), 2, []), parameter("DATA_START", short(start), 2, []),
            *([parameter("RATE", float_bytes(rate), 4, [])] if rate is not None else []),
            *([parameter("UNITS", *texts(units))] if units else []),
            *([parameter("CAMERA_RATE", float_bytes(camera_rate), 4, [], 2)] if camera_rate is not None else []),
            *(parameter(*one) for one in more),
        ]  # fmt: skip
        for k in range(0, max(len(labels), 1), LABELS_AT_ONCE):
            number = str(k // LABELS_AT_ONCE + 1) if k else ""
            found.append(parameter(f"LABELS{number}", *texts(labels[k : k + LABELS_AT_ONCE])))
        return b"".join([*found, *groups] if is_group_last else [*groups, *found]) + b"\0\0"

    blocks = -(-(4 + len(parameters(0))) // 512)
    start = 2 + blocks
    section = struct.pack("<BBBB", 1, 0x50, blocks, PROCESSORS[processor]) + parameters(start)
    head = bytearray(512)
    struct.pack_into("<BB", head, 0, 2, 0x50)
    first = copies["first"]
    struct.pack_into(order + "HHHHH", head, 2, points, analogue, first, first + said - 1, 10)
    head[12:16], head[20:24] = float_bytes(copies["scale"]), float_bytes(copies["rate"])
    struct.pack_into(order + "HH", head, 16, start if copies["start"] is None else copies["start"], 0)
    seen = np.isfinite(positions).all(2)
    values = np.concatenate([np.where(seen[..., None], positions, 0.0), np.where(seen, 0.0, -1.0)[..., None]], axis=2)
    if scale > 0:
        values = np.concatenate([np.rint(values[..., :3] / scale), values[..., 3:]], 2)
    values = np.concatenate([values.reshape(frames, -1), np.full((frames, analogue), 7.0)], 1)
    if scale > 0:
        data = values.astype(order + "i2").tobytes()
    elif processor == "dec":
        data = (4 * values).astype("<f4").view("<u2").reshape(*values.shape, 2)[..., ::-1].tobytes()
    else:
        data = values.astype(order + "f4").tobytes()
    whole = bytes(head) + section.ljust(512 * blocks, b"\0") + data
    return whole + bytes(-len(whole) % 512)
