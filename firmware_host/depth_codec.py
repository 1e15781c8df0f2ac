"""OpenNI's 16zT coding of depth images: a table of the values that occur, then differences of table places in nibbles.

    u16 number of values, the values; u16 place of the first pixel; then per pixel the place before minus its own:
    -6..6 as a nibble (+6), two to a byte below 0xE0; 0xE1..0xEF: 1 to 15 pairs of "no change"; nibble 0xF or byte 0xFF
    escapes to one byte (difference + 192, for |d| <= 63) or to two bytes (the place itself, high byte first)
Source: OpenNI2, `Source/Drivers/OniFile/Formats/XnStreamCompression.cpp` (16z with embedded tables).
"""

from __future__ import annotations

import struct

import numpy as np

from firmware_host.depth_sensor import Depth
from firmware_host.errors import RecordingError

LARGEST_TABLE = 0x8000


def encode_16zt(depth: Depth) -> bytes:
    """Code a depth image of any shape.

    Raises:
        RecordingError: more than 32768 different values.
    """
    pixels = np.ascontiguousarray(depth, dtype="<u2").ravel()
    table = np.flatnonzero(np.bincount(pixels, minlength=1)).astype("<u2")
    if len(table) > LARGEST_TABLE:
        raise RecordingError("a depth image has more than 32768 different values", advice="write it uncompressed")
    places = np.zeros(int(table[-1]) + 1, np.int32)
    places[table] = np.arange(len(table))
    index = places[pixels]
    head = struct.pack("<H", len(table)) + table.tobytes() + struct.pack("<H", int(index[0]))
    step = index[:-1] - index[1:]
    count = len(step)
    if count == 0:
        return head
    is_small = np.abs(step) <= 6
    position = np.arange(count)
    run_start = np.maximum.accumulate(np.where(is_small, -1, position))
    in_run = position - run_start - 1
    is_first = is_small & (in_run % 2 == 0)
    next_small = np.append(is_small[1:], False)
    is_pair, is_lone = is_first & next_small, is_first & ~next_small
    nibble = (step + 6).astype(np.int64)
    next_nibble = np.append(nibble[1:], 0)
    is_tail = is_lone & (position == count - 1)
    is_escape = ~is_small
    after_lone, lone_nibble = np.append(False, is_lone[:-1]), np.append(0, nibble[:-1])

    tokens, used = np.zeros((count, 3), np.uint8), np.zeros((count, 3), bool)
    pair = (nibble << 4) | next_nibble
    is_still = is_pair & (pair == 0x66)
    is_plain = is_pair & ~is_still
    tokens[is_plain, 0], used[is_plain, 0] = pair[is_plain], True
    tokens[is_tail, 0], used[is_tail, 0] = (nibble[is_tail] << 4) | 0xD, True
    lead = np.where(after_lone, (lone_nibble << 4) | 0xF, 0xFF)
    tokens[is_escape, 0], used[is_escape, 0] = lead[is_escape], True
    is_near = is_escape & (np.abs(step) <= 63)
    is_far = is_escape & ~is_near
    tokens[is_near, 1], used[is_near, 1] = (step[is_near] + 192).astype(np.uint8), True
    tokens[is_far, 1], tokens[is_far, 2] = index[1:][is_far] >> 8, index[1:][is_far] & 0xFF
    used[is_far, 1] = used[is_far, 2] = True

    # Runs of "no change" pairs: one byte for up to fifteen.
    order = np.flatnonzero(is_pair | is_tail | is_escape)
    still = is_still[order]
    place = np.arange(len(order))
    length = place - np.maximum.accumulate(np.where(still, -1, place)) - 1
    is_last = np.append(~still[1:], True)
    emitted = still & (is_last | (length % 15 == 14))
    tokens[order[emitted], 0] = 0xE0 + (length[emitted] % 15) + 1
    used[order[emitted], 0] = True
    return head + tokens[used].tobytes()


def decode_16zt(raw: bytes, pixels: int) -> Depth:
    """Decode to (pixels,); a plain loop, for checks.

    Raises:
        RecordingError: the bytes do not hold that many pixels.
    """
    (values,) = struct.unpack_from("<H", raw, 0)
    table = np.frombuffer(raw, "<u2", values, 2)
    at = 2 + 2 * values
    (place,) = struct.unpack_from("<H", raw, at)
    at += 2
    places = [place]

    def escaped(at: int, place: int) -> tuple[int, int]:
        byte = raw[at]
        return (at + 1, place - (byte - 192)) if byte & 0x80 else (at + 2, (byte << 8) | raw[at + 1])

    while at < len(raw):
        byte = raw[at]
        if byte < 0xE0:
            place -= (byte >> 4) - 6
            places.append(place)
            low = byte & 15
            at += 1
            if low == 15:
                at, place = escaped(at, place)
                places.append(place)
            elif low != 13:
                place -= low - 6
                places.append(place)
        elif byte == 0xFF:
            at, place = escaped(at + 1, place)
            places.append(place)
        else:
            places.extend([place] * (2 * (byte - 0xE0)))
            at += 1
    if len(places) != pixels:
        raise RecordingError(f"a depth image decodes to {len(places)} pixels instead of {pixels}")
    return np.asarray(table[np.array(places)], np.uint16)
