"""Each chunk of a file is judged by its own lengths, and has a share of memory for its own bytes."""

from __future__ import annotations

import struct
import zlib

import pytest
import zstandard

from formats.chunks import (
    LARGEST_CHUNK,
    LONGEST_RECORD,
    MCAP_MAGIC,
    RECORD_BYTES,
    SLAB,
    UNPACKED_PER_BYTE,
    Findings,
    _Starts,
    messages_in,
    messages_with_sizes,
    profile_of,
)
from tests.formats.damage import chunk_of, chunk_of_records, chunks_of


def message(data):
    return struct.pack("<BQHIQQ", 5, 22 + len(data), 1, 0, 0, 0) + data


def chunk(size, crc, name, packed, *, name_length=None, packed_length=None, rest=b""):
    """A chunk of fields that need not agree."""
    body = struct.pack("<QQQII", 0, 0, size, crc, len(name) if name_length is None else name_length) + name
    body += struct.pack("<Q", len(packed) if packed_length is None else packed_length) + packed + rest
    return struct.pack("<BQ", 6, len(body)) + body


def found_in(raw, **left):
    findings = Findings(**left)
    return [bytes(data) for data in messages_in(MCAP_MAGIC + raw, findings)], findings


def test_an_ordinary_take_needs_no_memory_beyond_its_shares(raw):
    found, findings = found_in(raw[8:], bytes_left=0, records_left=0)
    assert len(found) == len(list(messages_in(raw, Findings())))
    assert (findings.damaged, findings.left_packed, findings.is_whole, findings.trailing) == (0, 0, True, 0)


def test_messages_have_their_shares_of_their_chunk():
    """Two messages of 10 and 30 bytes, in records of 41 and 61."""
    records = message(b"a" * 10) + message(b"b" * 30)
    raw = MCAP_MAGIC + chunk_of_records(records, compression=b"")
    size = len(raw) - 8
    assert list(messages_with_sizes(raw, Findings())) == [
        (b"a" * 10, size * 10 // 102), (b"b" * 30, size * 30 // 102)
    ]  # fmt: skip


@pytest.mark.parametrize(("spare", "is_read"), [(0, True), (-1, False)])
def test_a_chunk_that_unpacks_to_more_than_its_share_takes_of_the_bytes_that_are_left(spare, is_read):
    packed = chunk_of(b"z" * 100_000)
    beyond = 100_031 - UNPACKED_PER_BYTE * len(packed)
    assert beyond > 0
    other = chunk_of(b"other")
    found, findings = found_in(packed + other, bytes_left=beyond + spare)
    assert found == ([b"z" * 100_000] if is_read else []) + [b"other"]
    assert (findings.left_packed, findings.damaged) == (int(not is_read), 0)
    assert findings.bytes_left == (0 if is_read else beyond - 1)


@pytest.mark.parametrize("left", [0, 3])
def test_a_chunk_has_a_record_for_each_64_of_its_bytes_and_of_those_that_are_left(left):
    packed = chunk_of_records(b"".join(message(bytes([k])) for k in range(200)))
    share = len(packed) // RECORD_BYTES
    found, findings = found_in(packed, records_left=left)
    assert found == [bytes([k]) for k in range(share + left)]
    assert (findings.damaged, findings.records_left) == (1, 0)
    assert found_in(packed, records_left=200 - share)[1].damaged == 0


def test_a_record_within_a_chunk_that_is_too_short_for_a_message_is_none():
    """Stamps take 22 bytes. One that reaches beyond the chunk is none either."""
    short = struct.pack("<BQ", 5, 21) + bytes(21)
    found, findings = found_in(chunk_of_records(short + message(b"") + message(b"x") + message(b"lost")[:-1]))
    assert (found, findings.damaged) == ([b"", b"x"], 0)


RECORDS = message(b"data")
CRC, PACKED = zlib.crc32(RECORDS), zstandard.compress(RECORDS)
UNSTATED = zstandard.ZstdCompressor(write_content_size=False).compress(RECORDS)


@pytest.mark.parametrize(
    "made",
    [
        chunk(len(RECORDS), CRC, b"zstd", PACKED),
        chunk(len(RECORDS), CRC, b"zstd", UNSTATED),
        chunk(len(RECORDS), CRC, b"", RECORDS),
    ],
    ids=["zstd", "zstd that states no size", "none"],
)
def test_a_chunk_whose_fields_agree_is_read(made):
    assert found_in(made) == ([b"data"], Findings(_chunks=1))


@pytest.mark.parametrize(
    "made",
    [
        chunk(len(RECORDS) + 1, CRC, b"zstd", PACKED),
        chunk(len(RECORDS) - 1, CRC, b"zstd", UNSTATED),
        chunk(len(RECORDS) + 1, CRC, b"zstd", UNSTATED),
        chunk(len(RECORDS) + 1, CRC, b"", RECORDS),
        chunk(len(RECORDS), CRC + 1, b"zstd", PACKED),
        chunk(len(RECORDS), 0, b"zstd", PACKED),
        chunk(0, CRC, b"zstd", PACKED),
        chunk(len(RECORDS), CRC, b"zstd", RECORDS),
        chunk(len(RECORDS), CRC, b"zstd", PACKED, packed_length=len(PACKED) - 1),
        chunk(len(RECORDS), CRC, b"zstd", PACKED, name_length=5),
        chunk(len(RECORDS), CRC, b"zstd", PACKED, name_length=2**31),
        chunk(len(RECORDS), CRC, b"zstd", PACKED, rest=b"."),
        struct.pack("<BQ", 6, 3) + b"abc",
        struct.pack("<BQ", 6, 39) + bytes(39),
    ],
)
def test_a_chunk_whose_fields_contradict_each_other_costs_itself(made):
    found, findings = found_in(made + chunk_of(b"other"))
    assert found == [b"other"]
    assert (findings.damaged, findings.other_compressions, findings.left_packed) == (1, set(), 0)


@pytest.mark.parametrize(
    ("name", "told"), [(b"lz4", {"lz4"}), (b"l z", set()), (b"x" * 16, {"x" * 16}), (b"x" * 17, set())]
)
def test_a_compression_of_another_name_is_reported_where_it_is_one(name, told):
    found, findings = found_in(chunk(len(RECORDS), CRC, name, PACKED))
    assert (found, findings.damaged, findings.other_compressions) == ([], 1, told)


@pytest.mark.parametrize(("beyond", "is_read"), [(0, True), (1, False)])
def test_a_chunk_unpacks_to_16_mib_at_most(beyond, is_read):
    found, findings = found_in(chunk_of_records(message(bytes(LARGEST_CHUNK - 31 + beyond))))
    assert (len(found), findings.damaged) == (int(is_read), int(not is_read))


def record(opcode, length):
    return struct.pack("<BQ", opcode, length) + bytes(length)


@pytest.mark.parametrize(
    ("made", "damaged"),
    [
        (record(0x0C, 5), 0), (record(0x01, LONGEST_RECORD - 9), 0), (record(0x01, LONGEST_RECORD - 8), 1),
        (record(0x05, 5), 1), (record(0x10, 5), 1), (record(0x05, 5) + record(0x10, 5), 1),
        (struct.pack("<BQ", 0x0C, 30 + 67) + bytes(30), 1),
    ],
    ids=["metadata", "long", "too long", "a message outside", "unknown", "two together", "over the next chunk"],
)  # fmt: skip
def test_records_between_chunks_are_skipped_where_their_lengths_can_be(made, damaged):
    found, findings = found_in(chunk_of(b"one") + made + chunk_of(b"two"))
    assert (found, findings.damaged) == ([b"one", b"two"], damaged)


@pytest.mark.parametrize(("name_length", "is_start"), [(16, True), (17, False)])
def test_a_chunk_seems_to_begin_within_a_record_only_where_its_lengths_agree(name_length, is_start):
    """The record's own length is accepted unless a chunk begins in it."""
    false = chunk(100, 1, b"x" * name_length, b"packed")
    inner = b"...." + false + b"...."
    made = struct.pack("<BQ", 0x0C, len(inner)) + inner
    found, findings = found_in(made + chunk_of(b"two"))
    assert (found, findings.damaged > 0) == ([b"two"], is_start)


def test_a_file_without_its_magic_is_damaged_and_read_all_the_same(raw):
    findings = Findings()
    assert len(list(messages_in(raw[chunks_of(raw)[0][0] :], findings))) == len(chunks_of(raw))
    assert findings.damaged == 1


def header(profile, *, opcode=1, length=None, size=None, magic=MCAP_MAGIC):
    rest = struct.pack("<I", len(profile) if size is None else size) + profile
    return magic + struct.pack("<BQ", opcode, len(rest) + 4 if length is None else length) + rest + bytes(4)


@pytest.mark.parametrize(
    ("raw", "profile"),
    [
        (header(b"ros2"), "ros2"), (header(b""), ""), (header(b"x" * 4096), "x" * 4096), (header(b"x" * 4097), None),
        (header(b"ros2", size=5), None), (header(b"ros2", opcode=2), None), (header(b"", length=7), None),
        (header(b"ros2", length=LONGEST_RECORD), "ros2"), (header(b"ros2", length=LONGEST_RECORD + 1), None),
        (header(b"ros2", magic=b"\x89MCAP1\r\n"), None), (header(b"")[:21], ""), (header(b"")[:20], None),
        (header(b"\xff"), "\ufffd"),
    ],
)  # fmt: skip
def test_a_profile_is_read_where_the_beginning_of_a_file_holds(raw, profile):
    assert profile_of(raw) == profile


@pytest.mark.parametrize("at", [SLAB - 1, SLAB, 2 * SLAB - 1])
def test_a_chunk_is_found_on_either_side_of_the_bytes_that_are_searched_at_once(at):
    raw = bytes(at) + chunk_of(b"data")
    assert _Starts(raw).next_at(0) == at
    assert _Starts(raw).next_at(at + 1) == len(raw)


@pytest.mark.parametrize(("chunks", "left"), [(19, 900), (20, 1000)])
def test_a_copy_of_a_header_is_free_of_charge_if_20_chunks_came_since_the_last_one(chunks, left):
    """The copy is the last of these chunks. Each copy takes 100 bytes beyond its share."""
    findings = Findings(bytes_left=1000)
    for _ in range(chunks - 1):
        findings.charge(0)
    findings.charge(100)
    findings.refund_copy(150)
    assert findings.bytes_left == left
    for _ in range(19):  # the first copies behind it come too early, unless the one before them was charged
        findings.charge(0)
    findings.charge(100)
    findings.refund_copy(60)  # no more than the header's own size
    assert findings.bytes_left == left - 40
