"""The lossless "16zT" depth codec of .oni recordings: a table of values, then differences of table indices in nibbles.

    byte hl < 0xE0        two differences, h - 6 and l - 6 (l = 13: no second pixel, l = 15: a full index follows)
    byte 0xE1 ... 0xEF    1 to 15 pairs of pixels without a change
    byte 0xFF             a full index follows: one byte 192 + d for |d| < 64, else two bytes, high first, below 0x8000

A difference d is the previous index minus this index. Source: OpenNI2 2.2, Source/Drivers/OniFile/Formats/
XnStreamCompression.cpp, XnStreamUncompressDepth16ZWithEmbTable.
"""

from __future__ import annotations

import struct

import numpy as np

from formats.arrays import Booleans, Indices, Integers, Unsigned

LONGEST_TABLE = 0x8000  # distinct values: a full index has 15 bits


def encode_depth(image: Unsigned) -> bytes:
    """Compress a depth image [any unit], any shape, uint16.

    Raises:
        ValueError: more than 32768 distinct values.
    """
    pixels = np.ascontiguousarray(image, dtype=np.uint16).ravel()
    table = np.flatnonzero(np.bincount(pixels, minlength=1)).astype("<u2")
    if table.size > LONGEST_TABLE:
        raise ValueError(f"16zT holds at most {LONGEST_TABLE} distinct values, not {table.size}")
    place_of = np.zeros(int(table[-1]) + 1, np.int32)
    place_of[table] = np.arange(table.size)
    places = place_of[pixels]
    head = struct.pack("<H", table.size) + table.tobytes() + struct.pack("<H", int(places[0]))
    return head + _encode_steps(places) if places.size > 1 else head


def _encode_steps(places: Indices) -> bytes:
    step = places[:-1] - places[1:]
    n = step.size
    at = np.arange(n, dtype=np.int32)
    is_small = np.abs(step) <= 6
    # Small steps are paired from the start of each run; an unpaired step shares its byte with the next code.
    run_start = np.maximum.accumulate(np.where(is_small, np.int32(-1), at))
    opens = is_small & ((at - run_start) & 1 == 1)
    next_small = np.append(is_small[1:], False)
    is_pair, is_lone = opens & next_small, opens & ~next_small
    is_full = ~is_small
    nibble = step + 6
    pair = (nibble << 4) | np.append(nibble[1:], 0)
    after_lone = np.append(False, is_lone[:-1])
    lead = np.where(after_lone, (np.append(0, nibble[:-1]) << 4) | 0xF, 0xFF)
    is_tail = is_lone & (at == n - 1)

    token = np.flatnonzero(is_pair | is_full | is_tail)
    full, tail = is_full[token], is_tail[token]
    first = np.where(full, lead[token], np.where(tail, (nibble[token] << 4) | 0xD, pair[token]))
    size = np.ones(token.size, np.int64)
    is_short = np.abs(step[token]) <= 63
    size[full] = np.where(is_short[full], 2, 3)
    size, first = _merge_still_pairs(is_pair[token] & (pair[token] == 0x66), size, first)

    end = np.cumsum(size)
    out = np.empty(int(end[-1]), np.uint8)
    begin = end - size
    written = size > 0
    out[begin[written]] = first[written]
    short, long = full & is_short, full & ~is_short
    out[begin[short] + 1] = step[token][short] + 192
    target = places[1:][token][long]
    out[begin[long] + 1] = target >> 8
    out[begin[long] + 2] = target & 0xFF
    return out.tobytes()


def _merge_still_pairs(is_still: Booleans, size: Integers, first: Indices) -> tuple[Integers, Indices]:
    """Encode each run of up to 15 unchanged pairs as one byte, at the position of its last pair."""
    k = np.arange(is_still.size)
    rank = (k - np.maximum.accumulate(np.where(is_still, -1, k)) - 1) % 15
    ends = is_still & (np.append(~is_still[1:], True) | (rank == 14))
    return np.where(is_still & ~ends, 0, size), np.where(ends, 0xE1 + rank, first)
