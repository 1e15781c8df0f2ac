"""Find the sound chunks of a damaged MCAP file, each checked by its own lengths and checksum.

Layout of a chunk record (https://mcap.dev/spec, version 0), with the bytes of each part:

    opcode 6 (1), length (8), start and end time (8 each), unpacked size (8), CRC-32 of the unpacked records (4),
    length of the compression's name (4), that name, length of the records (8), records
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import zstandard
from mcap.opcode import Opcode

from formats.arrays import Integers

MCAP_MAGIC = b"\x89MCAP0\r\n"
LARGEST_CHUNK = 1 << 24  # bytes unpacked: a second of 500 markers at 500 frames a second, twice over
LARGEST_WINDOW = 1 << 23  # bytes of zstd's window; RFC 8878, section 3.1.1.1.2: decoders should support it
# Unpacked bytes for each packed byte of a chunk. Blocks have 1 to 17, or 390 with 2000 unseen points. A header of 2000
# points has 5, one of repetitive notes 50. A second of version 1 at rest has 18 to 1700 (2000 points).
UNPACKED_PER_BYTE = 32
# budget beyond that, for all chunks of a file together. Our choice: bounds memory. Half and double were not tried.
FREE_BYTES = 1 << 26
COPY_EVERY = 20  # chunks between copies of a header that are free of charge: writers put 30 blocks between them
RECORD_BYTES, FREE_RECORDS = 64, 1 << 16  # packed bytes for each record of a chunk; budget of a file beyond that
# bytes searched at once for the next chunk. Our choice: bounds memory, and the chunks that are found are the same.
SLAB = 1 << 20
# bytes of a chunk record without its compression's name, its records and their length. MCAP specification, chunk.
FIXED = 45
LONGEST_NAME = 16  # bytes of a compression's name; our choice: MCAP knows `lz4` and `zstd`
LONGEST_RECORD = 1 << 20  # bytes of a record that is skipped: the specification is the longest
# records that hold no frames. MCAP specification, opcodes.
KNOWN = {0x01, 0x02, 0x03, 0x04, 0x07, 0x08, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F}


@dataclass
class Findings:
    """The state of a file, beside its messages."""

    damaged: int = 0
    is_whole: bool = False  # the file has the end of an MCAP file
    trailing: int = 0  # bytes behind that end
    other_compressions: set[str] = field(default_factory=set)
    has_loose_messages: bool = False  # a message lies outside of chunks, as some programs write them
    lacks_checksum: bool = False  # a chunk states none
    largest_refused: int = 0  # bytes that the largest chunk beyond `LARGEST_CHUNK` states
    left_packed: int = 0  # chunks that seem sound, but exceed `bytes_left`
    bytes_left: int = FREE_BYTES  # budget of unpacked bytes beyond the chunks' shares
    records_left: int = FREE_RECORDS  # budget of records beyond the chunks' shares
    _chunks: int = 0  # unpacked so far
    _last_copy: int = 0  # value of `_chunks` at the last copy of a header
    _beyond: int = 0  # bytes that the last chunk took beyond its share

    @property
    def has_sound_chunk(self) -> bool:
        """Whether a chunk was unpacked."""
        return self._chunks > 0

    def charge(self, beyond: int) -> None:
        """Charge the budget with the unpacked bytes of a chunk beyond its share."""
        self.bytes_left -= beyond
        self._beyond, self._chunks = beyond, self._chunks + 1

    def refund_copy(self, size: int) -> None:
        """Refund the last chunk's charge up to `size` bytes, since it holds a copy of a known header only."""
        if self._chunks - self._last_copy >= COPY_EVERY:
            self.bytes_left += min(self._beyond, size)
            self._last_copy = self._chunks


def profile_of(raw: bytes) -> str | None:
    """Return the profile that an MCAP file states, None where the beginning of the file is damaged."""
    if not raw.startswith(MCAP_MAGIC) or len(raw) < 21 or raw[8] != Opcode.HEADER:
        return None
    length, size = struct.unpack_from("<QI", raw, 9)
    if not 8 <= length <= LONGEST_RECORD or size > min(length - 8, 4096):
        return None
    return raw[21 : 21 + size].decode(errors="replace")


def messages_in(raw: bytes, findings: Findings) -> Iterator[bytes]:
    """Yield the data of every message; see `messages_with_sizes`."""
    return (data for data, _ in messages_with_sizes(raw, findings))


def messages_with_sizes(raw: bytes, findings: Findings) -> Iterator[tuple[bytes, int]]:
    """Yield the data of every message in every sound chunk, and the message's share of the file [bytes].

    The search continues after damage. A record without frames is skipped by its length. A length within which a chunk
    seems to begin counts as damaged. Sound chunks behind the end of the file count too; other bytes there are trailing,
    and no damage. The time is linear in the file's length. Each chunk has a share of unpacked bytes and records in
    proportion to its length. A chunk beyond its share takes from the file's budget. If the budget is spent, the chunk
    stays packed, and the chunks behind it are still read.
    """
    at = len(MCAP_MAGIC) if raw.startswith(MCAP_MAGIC) else 0
    findings.damaged += at == 0
    starts = _Starts(raw)
    was_sound = True
    while at + 9 <= len(raw):
        opcode, end = raw[at], at + 9 + struct.unpack_from("<Q", raw, at + 1)[0]
        is_within = end <= len(raw)
        records = _records(raw, at, end, starts, findings) if opcode == Opcode.CHUNK and is_within else None
        if records is not None:
            was_sound = True
            for data in _message_data(records, (end - at) // RECORD_BYTES, findings):
                yield data, (end - at) * len(data) // len(records)
        elif opcode in KNOWN and is_within and end - at <= LONGEST_RECORD and starts.next_at(at + 1) >= end:
            if opcode == Opcode.FOOTER and raw.startswith(MCAP_MAGIC, end):
                end += len(MCAP_MAGIC)
                findings.is_whole, findings.trailing = True, findings.trailing or len(raw) - end
        else:
            findings.has_loose_messages |= opcode == Opcode.MESSAGE and was_sound and is_within
            findings.damaged += was_sound and is_within and not findings.trailing
            was_sound = False
            at = starts.next_at(at + 1)
            continue
        at = end


class _Starts:
    """The offsets at which a chunk seems to begin: the chunk's lengths agree, and the chunk ends within the file."""

    def __init__(self, raw: bytes) -> None:
        self._raw, self._found, self._searched = raw, np.empty(0, np.int64), 0
        self._asked, self._answer = 0, -1

    def next_at(self, at: int) -> int:
        """Return the first such offset from `at` on, or the end of the file."""
        if not self._asked <= at <= self._answer:
            self._asked, self._answer = at, self._sought(at)
        return self._answer

    def _sought(self, at: int) -> int:
        self._searched = max(self._searched, at)
        while True:
            index = int(np.searchsorted(self._found, at))
            if index < len(self._found):
                return int(self._found[index])
            if self._searched >= len(self._raw):
                return len(self._raw)
            self._found = self._search(self._searched)
            self._searched += SLAB

    def _search(self, begin: int) -> Integers:
        whole = np.frombuffer(self._raw, np.uint8)
        at = begin + np.flatnonzero(whole[begin : begin + SLAB] == int(Opcode.CHUNK))
        at = at[at + FIXED + 4 <= len(whole)]
        length, name = self._number(at + 1, 8), self._number(at + 37, 4)
        is_chunk = (name <= LONGEST_NAME) & (length <= len(whole) - at - 9) & (length >= 40 + name)
        at, length, name = at[is_chunk], length[is_chunk], name[is_chunk]
        return np.asarray(at[self._number(at + 41 + name, 8) == length - 40 - name])

    def _number(self, at: Integers, size: int) -> Integers:
        """Return the numbers of `size` bytes at these offsets; a number above 2^62 becomes 2^62."""
        view = np.ndarray((len(self._raw) - size + 1,), f"<u{size}", self._raw, strides=(1,))
        most = np.array(2**62 if size == 8 else 2**32 - 1, view.dtype)
        return np.asarray(np.minimum(view[at], most), np.int64)


def _records(raw: bytes, at: int, end: int, starts: _Starts, findings: Findings) -> bytes | None:
    """Return the unpacked records of the chunk between two offsets, None where the chunk is damaged or too large.

    The result is empty where the budget does not suffice; the chunk's checksum was not verified then. A chunk within
    which another chunk seems to begin has no share, since only such chunks can overlap.
    """
    if end - at < FIXED + 4:
        return None
    size, crc, name_length = struct.unpack_from("<QII", raw, at + 25)
    begin = at + 49 + name_length
    if name_length > LONGEST_NAME or begin > end or struct.unpack_from("<Q", raw, begin - 8)[0] != end - begin:
        return None
    findings.lacks_checksum |= crc == 0  # in MCAP a checksum of 0 stands for none
    if size > LARGEST_CHUNK and crc:
        findings.largest_refused = max(findings.largest_refused, size)
    if not 0 < size <= LARGEST_CHUNK or crc == 0:
        return None
    compression, packed = raw[at + 41 : begin - 8], memoryview(raw)[begin:end]
    if compression not in (b"zstd", b""):
        if compression.isalnum():
            findings.other_compressions.add(compression.decode())
        return None
    if not compression and size != len(packed):
        return None
    is_alone = starts.next_at(at + 1) >= end
    beyond = max(size - UNPACKED_PER_BYTE * (end - at), 0) if is_alone else size
    if beyond > findings.bytes_left:
        findings.left_packed += is_alone
        return b"" if is_alone else None
    findings.charge(beyond)
    try:
        records = _unpacked(packed, size) if compression else bytes(packed)
    except zstandard.ZstdError:
        return None
    return records if len(records) == size and zlib.crc32(records) == crc else None


def _unpacked(packed: memoryview, size: int) -> bytes:
    stated = zstandard.frame_content_size(packed)
    if stated == size:
        return bytes(_UNPACKER.decompress(packed))
    if stated != -1:  # a chunk states its size twice; zstd follows the inner statement alone
        return b""
    with _UNPACKER.stream_reader(packed) as stream:
        return bytes(stream.read(size + 1))


_UNPACKER = zstandard.ZstdDecompressor(max_window_size=LARGEST_WINDOW)


def _message_data(records: bytes, share: int, findings: Findings) -> Iterator[bytes]:
    """Yield the data of the messages among a chunk's records, without the opcode, the length and 22 bytes of stamps."""
    at = 0
    while at + 9 <= len(records):
        if share > 0:
            share -= 1
        elif findings.records_left > 0:
            findings.records_left -= 1
        else:
            findings.damaged += 1
            return
        end = at + 9 + int.from_bytes(records[at + 1 : at + 9], "little")
        if records[at] == Opcode.MESSAGE and at + 31 <= end <= len(records):
            yield records[at + 31 : end]
        at = end
