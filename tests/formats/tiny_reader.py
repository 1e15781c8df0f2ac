"""A second reader of sound take archives, from `formats/SPEC.md` alone: it imports nothing of Hangtime."""

from __future__ import annotations

import math
import struct
import zlib
from hashlib import blake2b

import msgpack
import zstandard

STEPS = 1e-4, 2e-5, 1e-6


def messages(raw):
    """The data of every message, in the order of the file."""
    at = 8
    while raw[at] != 0x0F:  # DataEnd
        opcode, length = struct.unpack_from("<BQ", raw, at)
        if opcode == 6:
            _, _, size, crc, name = struct.unpack_from("<QQQII", raw, at + 9)
            records = zstandard.decompress(raw[at + 49 + name : at + 9 + length], max_output_size=size)
            assert zlib.crc32(records) == crc != 0
            inner = 0
            while inner < len(records):
                kind, extent = struct.unpack_from("<BQ", records, inner)
                if kind == 5:
                    yield records[inner + 31 : inner + 9 + extent]
                inner += 9 + extent
        at += 9 + length


def signed(zigzag):
    return zigzag >> 1 if zigzag % 2 == 0 else -(zigzag >> 1) - 1


def table(raw, rows, columns):
    """Return the rows of a table as lists of whole numbers."""
    codes, planes = raw[:columns], raw[columns : 5 * columns]
    first = [signed(sum(planes[p * columns + c] << 8 * p for p in range(4))) for c in range(columns)]
    (count,) = struct.unpack_from("<I", raw, 5 * columns)
    coded = [c for c in range(columns) if codes[c]]
    bits = (rows - 1) * sum(codes[c] & 31 for c in coded)
    remainders = int.from_bytes(raw[5 * columns + 4 : 5 * columns + 4 + -(-bits // 8)], "little")
    at = 5 * columns + 4 + -(-bits // 8)
    exceptions = iter(struct.unpack_from(f"<{count}Q", raw, at))
    quotients = (len(zeros) for zeros in "".join(f"{byte:08b}"[::-1] for byte in raw[at + 8 * count :]).split("1"))
    found = [first]
    for t in range(1, rows):
        row = list(first)
        one, two, three = (found[max(t - back, 0)] for back in (1, 2, 3))
        for c in coded:
            order, k = codes[c] >> 5, codes[c] & 31
            remainder, remainders = remainders & ((1 << k) - 1), remainders >> k
            quotient = next(quotients)
            z = next(exceptions) if quotient == 24 else (quotient << k) + remainder
            slope = {1: 0, 2: one[c] - two[c], 3: (one[c] - three[c]) // 2}[order]
            row[c] = one[c] + slope + signed(z)
        found.append(row)
    return found


def deviation(code):
    return {0: math.nan, 1: 0.0, 2: math.inf}.get(code, 1e-9 * 2 ** ((code - 3) / 32))


def frames_of(block, points):
    """The frames of a block: maps of lists, None where something was not seen."""
    held_step, points_step = (STEPS[k] for k in block["steps"])
    width = 6 + 3 * 6 + 6 * points + 4 + 2 * points
    for row in table(block["table"], block["frames"], width):
        take = iter(row)
        read = lambda n: [next(take) for _ in range(n)]  # noqa: B023, E731
        time, state, quality, pitch, pitch_sd, pitch_valid = read(6)
        held, markers, held_sd = read(6), read(6), read(6)
        places, points_sd, held_valid, markers_valid = read(3 * points), read(3 * points), read(2), read(2)
        points_valid, hidden = read(points), read(points)
        yield {
            "time": (block["start"] + time) / 1e6,
            "state": state,
            "quality": None if quality == 255 else quality / 254,
            "pitch": pitch * 1e-4 if pitch_valid else None,
            "pitch_sd": deviation(pitch_sd) if pitch_valid else None,
            "held": places_of(held, held_valid, held_step),
            "markers": places_of([a + b for a, b in zip(held, markers, strict=True)], markers_valid, held_step),
            "points": places_of(places, points_valid, points_step),
            "held_sd": [deviation(code) for code in held_sd],
            "points_sd": [deviation(code) for code in points_sd],
            "points_hidden": hidden,
        }


def places_of(numbers, valid, step):
    return [[step * n for n in numbers[3 * k : 3 * k + 3]] if ok else None for k, ok in enumerate(valid)]


def read(raw):
    """A finished, sound take: header, frames, scans and end."""
    frames, scans = [], []
    for data in messages(raw):
        content = msgpack.unpackb(data)
        if "format" in content:
            header, binding = content, blake2b(data, digest_size=8).digest()
            points = len(header["garment"]["points"])
            continue
        assert content["take"] == binding
        if "table" in content:
            assert content["first"] == len(frames)
            frames += frames_of(content, points)
        elif "surface" in content:
            n, k = content["grid_size"] ** 2, content["contour_size"]
            scans.append({
                "time": content["surface"] / 1e6,
                "grid": [[x * 1e-4, y * 1e-4, z * 1e-4] if v else None for x, y, z, v in table(content["grid"], n, 4)],
                "contour": [
                    [x * 1e-4, y * 1e-4, z * 1e-4] if v else None for x, y, z, v in table(content["contour"], k, 4)
                ],
            })  # fmt: skip
        else:
            end = content
    assert (end["frames"], end["scans"]) == (len(frames), len(scans))
    return {"header": header, "frames": frames, "scans": scans, "end": {k: v for k, v in end.items() if k != "take"}}
