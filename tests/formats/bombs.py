"""Hostile take archives of a few kilobytes, each made to cost a reader memory or time. Every chunk's checksum fits."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache

import msgpack
import numpy as np

from formats.chunks import LARGEST_CHUNK
from formats.integers import encode_tables
from formats.take_writer import binding_of
from tests.formats.damage import chunk_of, chunk_of_records, chunks_of

Maker = Callable[[bytes], bytes]
BOMBS: dict[str, Maker] = {}
parts_of = cache(chunks_of)


def bomb(make: Maker) -> Maker:
    """Add a maker to the list under its name: it turns the bytes of a sound take into those of a hostile file."""
    BOMBS[make.__name__.replace("_", " ")] = make
    return make


def among(raw: bytes, parts: bytes) -> bytes:
    """Put chunks behind the first header."""
    at = parts_of(raw)[1][0]
    return raw[:at] + parts + raw[at:]


def binding(raw: bytes) -> bytes:
    """Return what ties the blocks of the take to its header."""
    return bytes(parts_of(raw)[1][2]["take"])


def header_of(raw: bytes, **changes: object) -> bytes:
    """Return the first header's bytes with changes."""
    return bytes(msgpack.packb({**parts_of(raw)[0][2], **changes}))


def blocks_of(raw: bytes) -> list[dict[str, object]]:
    """Return the blocks of the take."""
    return [content for _, _, content in parts_of(raw) if "table" in content]


def map_of(first: int, key: bytes, value: bytes) -> bytes:
    """Return a message `{"first": first, key: value}` from packed bytes."""
    return b"\x82\xa5first" + msgpack.packb(first) + key + value


@bomb
def lists_in_lists(raw: bytes) -> bytes:
    return among(raw, chunk_of(b"\x91" * 1_000_000 + b"\x90"))


@bomb
def many_lists(raw: bytes) -> bytes:
    return among(raw, chunk_of(b"\xdd\x00\x98\x96\x80" + b"\x90" * 10_000_000))


@bomb
def a_list_that_claims_to_be_long(raw: bytes) -> bytes:
    return among(raw, chunk_of(b"\xdd\xff\xff\xff\xff"))


@bomb
def a_header_of_many_maps(raw: bytes) -> bytes:
    head = b"\x82\xa6format\xaehangtime-take/2\xa5notes\xdd\x00\x4c\x4b\x40"
    return among(raw, chunk_of(head + b"\x80" * 5_000_000))


@bomb
def strings(raw: bytes) -> bytes:
    n = 5_000_000
    return among(
        raw, b"".join(chunk_of(map_of(k, b"\xa1x", b"\xdd" + struct.pack(">I", n) + b"\xa1a" * n)) for k in range(8))
    )


@bomb
def numbers(raw: bytes) -> bytes:
    n = 3_000_000
    return among(
        raw,
        b"".join(chunk_of(map_of(k, b"\xa1x", b"\xdd" + struct.pack(">I", n) + b"\xcd\x12\x34" * n)) for k in range(8)),
    )


@bomb
def a_map_of_strings(raw: bytes) -> bytes:
    n = 4_000_000
    return among(
        raw,
        b"".join(chunk_of(map_of(k, b"\xa1x", b"\xdf" + struct.pack(">I", n) + b"\xa1a\xa1b" * n)) for k in range(8)),
    )


@bomb
def maps_of_strings(raw: bytes) -> bytes:
    n = 200
    one = b"\xde" + struct.pack(">H", n) + b"".join(b"\xa2%02d\xa1b" % (k % 100) for k in range(n))
    return among(
        raw,
        b"".join(chunk_of(map_of(k, b"\xa1x", b"\xdd" + struct.pack(">I", 15_000) + one * 15_000)) for k in range(8)),
    )


@bomb
def many_large_headers(raw: bytes) -> bytes:
    notes = {str(k): "n" * 40 for k in range(19_000)}
    return among(raw, b"".join(chunk_of(header_of(raw, notes=notes, take_id=str(k))) for k in range(200)))


@bomb
def headers_of_long_lists(raw: bytes) -> bytes:
    return among(raw, b"".join(chunk_of(header_of(raw, notes=[7] * 1_000_000, take_id=str(k))) for k in range(40)))


@bomb
def kept_blocks(raw: bytes) -> bytes:
    block = blocks_of(raw)[0]
    return among(
        raw, b"".join(chunk_of({**block, "first": 10**6 + k, "table": bytes((1 << 24) - 200)}) for k in range(12))
    )


@bomb
def kept_blocks_of_noise(raw: bytes) -> bytes:
    block = blocks_of(raw)[0]
    return among(
        raw, b"".join(chunk_of({**block, "first": 10**6 + k, "table": b"\xff" * ((1 << 24) - 200)}) for k in range(12))
    )


@bomb
def kept_scans(raw: bytes) -> bytes:
    scan = {"take": binding(raw), "grid_size": 2, "contour_size": 0, "contour": b""}
    return among(
        raw, b"".join(chunk_of({**scan, "surface": k, "grid": b"\xff" * ((1 << 24) - 200)}) for k in range(12))
    )


@bomb
def zeros_for_records(raw: bytes) -> bytes:
    return among(raw, chunk_of_records(bytes(1 << 24)) * 9)


@bomb
def chunks_of_a_wrong_checksum(raw: bytes) -> bytes:
    return among(raw, chunk_of_records(bytes(1 << 24), crc=7) * 20)


@bomb
def thousands_of_takes(raw: bytes) -> bytes:
    end = next(content for _, _, content in parts_of(raw) if "blocks" in content)
    parts = []
    for k in range(4000):
        header = header_of(raw, take_id=str(k))
        parts += [chunk_of(header), chunk_of({**end, "take": binding_of(header)})]
    return among(raw, b"".join(parts))


@bomb
def thousands_of_whole_takes(raw: bytes) -> bytes:
    block = blocks_of(raw)[0]
    parts = []
    for k in range(1500):
        header = header_of(raw, take_id=str(k))
        parts += [chunk_of(header), chunk_of({**block, "take": binding_of(header)})]
    return among(raw, b"".join(parts))


@bomb
def chunks_within_chunks(raw: bytes) -> bytes:
    inner = b""
    for _ in range(12_000):
        rest = len(inner)
        body = struct.pack("<BQQQQII", 6, 40 + rest, 0, 0, rest or 1, 7, 0) + struct.pack("<Q", rest) + inner
        inner = body if len(body) < 1 << 19 else inner
    return among(raw, inner)


@bomb
def an_attachment_of_a_megabyte(raw: bytes) -> bytes:
    return among(raw, (b"\x09" + struct.pack("<Q", 1 << 19) + bytes(1 << 19)) * 8)


@bomb
def metadata_by_the_thousand(raw: bytes) -> bytes:
    return among(raw, (b"\x0c" + struct.pack("<Q", 8) + bytes(8)) * 60_000)


@bomb
def statistics_that_lie(raw: bytes) -> bytes:
    return raw[: parts_of(raw)[-1][1]] + b"\x0b" + struct.pack("<Q", 1 << 62) + b"\xff" * 1000


@bomb
def a_header_of_long_texts(raw: bytes) -> bytes:
    header = header_of(raw, source="s" * 900_000)
    moved = [chunk_of({**block, "take": binding_of(header)}) for block in blocks_of(raw)]
    return raw[: parts_of(raw)[0][0]] + chunk_of(header) + b"".join(moved)


@bomb
def a_header_of_many_missing_seconds(raw: bytes) -> bytes:
    header = header_of(raw, missing=[[float(k), k + 0.5] for k in range(50_000)])
    moved = [chunk_of({**block, "take": binding_of(header)}) for block in blocks_of(raw)]
    return raw[: parts_of(raw)[0][0]] + chunk_of(header) + b"".join(moved)


@bomb
def many_ends(raw: bytes) -> bytes:
    end = next(content for _, _, content in parts_of(raw) if "blocks" in content)
    return among(raw, b"".join(chunk_of({**end, "frames": k}) for k in range(20_000)))


@bomb
def small_messages(raw: bytes) -> bytes:
    data = msgpack.packb({"take": binding(raw), "first": 1, "frames": 1, "start": 1, "steps": [0, 0], "table": b""})
    record = struct.pack("<BQHIQQ", 5, 22 + len(data), 1, 0, 0, 0) + data
    return among(raw, chunk_of_records(record * ((1 << 24) // len(record))) * 6)


@bomb
def still_scans(raw: bytes) -> bytes:
    scan = {"take": binding(raw), "grid_size": 512, "contour_size": 65536, "grid": bytes(24), "contour": bytes(24)}
    return among(raw, b"".join(chunk_of({**scan, "surface": k}) for k in range(3000)))


@bomb
def still_blocks(raw: bytes) -> bytes:
    still = bytes(5 * (28 + 8 * 4) + 4)
    block = blocks_of(raw)[0]
    return among(
        raw,
        b"".join(
            chunk_of({**block, "first": 10**4 + 4096 * k, "frames": 4096, "start": 10**9 + k * 10**7, "table": still})
            for k in range(3000)
        ),
    )


@bomb
def blocks_of_long_quotients(raw: bytes) -> bytes:
    n, columns, k = 4096, 28 + 8 * 4, 30
    values = (n - 1) * columns
    quotients = (b"\0\0\x80" * (values // 8 * 8))[: 3 * values]  # 23 zeros and a one each
    coded = bytes([32 + k] * columns) + bytes(4 * columns + 4) + bytes(-(-values * k // 8)) + quotients
    block = {**blocks_of(raw)[0], "frames": n, "table": coded}
    return among(raw, b"".join(chunk_of({**block, "first": 10**4 + 4096 * k}) for k in range(20)))


@bomb
def scans_of_long_quotients(raw: bytes) -> bytes:
    n, k = 512 * 512, 30
    coded = (
        bytes([32 * 3 + k] * 4) + bytes(16) + bytes(4) + bytes(4 * (n - 1) * k // 8 + 1) + b"\xff" * ((n - 1) // 2 + 1)
    )
    scan = {"take": binding(raw), "grid_size": 512, "contour_size": 0, "contour": b"", "grid": coded}
    return among(raw, b"".join(chunk_of({**scan, "surface": k}) for k in range(12)))


@bomb
def keys_that_collide(raw: bytes) -> bytes:
    step = (1 << 61) - 1  # Python hashes whole numbers modulo this
    pairs = b"".join(b"\xcf" + struct.pack(">Q", (k % 7) * step + 1) + b"\x01" for k in range(50_000))
    return among(
        raw, chunk_of(b"\x82\xa6format\xaehangtime-take/2\xa5notes\xdf" + struct.pack(">I", 50_000) + pairs) * 20
    )


@bomb
def still_scans_of_64_places(raw: bytes) -> bytes:
    scan = {"take": binding(raw), "grid_size": 64, "contour_size": 512, "grid": bytes(24), "contour": bytes(24)}
    return among(raw, b"".join(chunk_of({**scan, "surface": k}) for k in range(5000)))


@bomb
def copies_of_a_header_between_chunks_of_nothing(raw: bytes) -> bytes:
    nothing = chunk_of_records(struct.pack("<BQ", 1, 0)) * 20
    copy = chunk_of(header_of(raw, notes={"n": "n" * 1_000_000}))
    return among(raw, copy + (nothing + copy) * 600)


@bomb
def places_beyond_a_kilometre(raw: bytes) -> bytes:
    block, n, columns = blocks_of(raw)[0], 31, 28 + 8 * 4
    values = np.full((n, columns), 1)
    values[:, 0], values[:, 6:12], values[1:, 24:36] = 30_000 * np.arange(n), 2**31 - 1, -(2**31) + 1
    far = {**block, "frames": n, "table": encode_tables(values, np.array([n]))[0]}
    return among(raw, b"".join(chunk_of({**far, "first": 10**4 + n * k, "start": 10**9 + k}) for k in range(10)))


@bomb
def blocks_of_unknown_fields(raw: bytes) -> bytes:
    """Each field holds a list or a map of short strings, which take twenty times their bytes."""
    words = [f"{k:02d}" for k in range(60)]
    unknown = {f"u{k}": words if k % 2 else dict.fromkeys(words, "ab") for k in range(14)}
    content = {**blocks_of(raw)[0], **unknown, "table": b"", "take": binding(raw)}
    part = msgpack.packb(content)
    record = struct.pack("<BQHIQQ", 5, 22 + len(part), 1, 0, 0, 0) + part
    return among(raw, chunk_of_records(record * (LARGEST_CHUNK // len(record))) * 4)


@bomb
def thousands_of_headers_of_version_1(raw: bytes) -> bytes:
    headers = [header_of(raw, format="hangtime-take/1", take_id=f"t{k}") for k in range(3000)]
    ends = [{"frames": 10, "blocks": 10 + k} for k in range(3000)]
    return among(raw, b"".join(chunk_of(part) for part in [*headers, *ends]))
