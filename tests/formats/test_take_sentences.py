"""The exact errors about a file that is no take, or whose take cannot be read."""

from __future__ import annotations

import re
import struct

import msgpack
import msgspec
import pytest

from formats.archive import take_of
from formats.chunks import MCAP_MAGIC
from formats.errors import TakeError
from tests.formats.bombs import header_of
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.test_archive import RIG

GIVE = "give a file that `hangtime record` or `hangtime import` wrote"
COPY = "copy it again from where it was recorded"


def refused(raw):
    with pytest.raises(TakeError) as error:
        take_of(raw, "a")
    return str(error.value)


def profiled(profile):
    return MCAP_MAGIC + struct.pack("<BQI", 1, len(profile) + 8, len(profile)) + profile + bytes(4)


LZ4 = chunk_of(b"x", compression=b"lz4")


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        (b"", "a: is empty; give a take archive"),
        (b"hello", f"a: is not a take archive; {GIVE}"),
        (b"NI10" + bytes(99), "a: is a sensor recording, and no take; give it to `hangtime record --sensor`, which "
         "writes a take"),
        (b"x" * 4083 + b"hangtime-take",
         "a: holds no readable header; the file is not a take archive, or too little of it is left"),
        (b"x" * 4084 + b"hangtime-take", f"a: is not a take archive; {GIVE}"),
        (MCAP_MAGIC + bytes(99),
         "a: holds no readable header; the file is not a take archive, or too little of it is left"),
        (profiled(b"hangtime-take/2"),
         "a: holds no readable header; the recording ended in its first second, or too little of it is left"),
        (profiled(b"hangtime-take/9"), "a: is of format version 9; this Hangtime reads 1 to 2; update Hangtime"),
        (profiled(b"ros2"), f"a: is not a take archive: its profile says ros2; {GIVE}"),
        (profiled(b""), f"a: is not a take archive: the file is MCAP without a profile; {GIVE}"),
        (profiled(b"hangtime-take/2") + LZ4 + chunk_of(b"x", compression=b"brotli"),
         "a: is compressed with brotli, lz4, which is not read; compress it with zstd, or not at all"),
    ],
)  # fmt: skip
def test_a_file_without_a_header_is_named_by_its_likeliest_cause(raw, sentence):
    assert refused(raw) == sentence


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"format": "hangtime-rig/1"}, "a: is a 'hangtime-rig/1', not a take; give a take archive"),
        ({"format": "hangtime-take/3"}, "a: is of format version 3; this Hangtime reads 1 to 2; update Hangtime"),
        ({"format": "hangtime-take/0"}, f"a: is of format version 0; this Hangtime reads 1 to 2; {COPY}"),
        ({"format": "hangtime-take/x"}, f"a: is of format version x; this Hangtime reads 1 to 2; {COPY}"),
        ({"take_id": 3}, "a: its header is invalid: take_id must be text (got a whole number); record it again"),
        (
            {"rig": 3},
            "a: its rig is invalid: the rig must be a table (got a whole number); record it again",
        ),
        (
            {"garment": None},
            "a: its garment is invalid: the garment must be a table (got nothing); record it again",
        ),
        (
            {"rig": msgspec.to_builtins(msgspec.structs.replace(RIG, gravity=(0.0, 2.0, 0.0)))},
            "a: its rig is invalid: gravity must be a unit vector (its length is 2); record it again",
        ),
    ],
)
def test_a_header_of_another_file_or_version_is_refused_with_its_field(raw, changes, sentence):
    assert refused(raw[: chunks_of(raw)[0][0]] + chunk_of(header_of(raw, **changes))) == sentence


def test_a_header_of_too_many_parts_is_no_recording_that_ended_in_its_first_second(raw):
    """Of lists, or of points of the garment, which are too many for a garment before they are for a header."""
    begin = raw[: chunks_of(raw)[0][0]]
    garment = chunks_of(raw)[0][2]["garment"]
    points = [{**garment["points"][0], "name": f"p{k}", "at_m": [k * 1e-5, 0.1]} for k in range(2001)]
    assert refused(begin + chunk_of(header_of(raw, garment={**garment, "points": points}))) == (
        "a: its garment is invalid: points: 2001 are more than the 2000 that a take holds; record it again"
    )
    assert refused(begin + chunk_of(header_of(raw, many=[[]] * 60_000))) == (
        "a: cannot be read: its header has more than 60000 maps and lists; write it again with a garment of at most "
        "2000 points and with shorter notes"
    )


def test_a_header_beyond_its_bytes_is_named_with_them(raw):
    begin = raw[: chunks_of(raw)[0][0]]
    for longer in (1 << 20, 10_000_000):
        header = header_of(raw, notes={"long": "x" * longer})
        said = (
            f"a: cannot be read: its header has {len(header)} bytes, and a take's has 1048576 at most; write it again "
        )
        assert refused(begin + chunk_of(header)).startswith(said)
        assert refused(begin + chunk_of(header) + chunk_of(header_of(raw))).startswith("a: holds no frame")


def test_a_chunk_beyond_its_bytes_is_named_with_them(raw):
    header = header_of(raw, notes={"long": "x" * (1 << 24)})
    said = refused(raw[: chunks_of(raw)[0][0]] + chunk_of(header))
    begin = r"a: cannot be read: a chunk in it unpacks to (\d+) bytes, 16777216 bytes at most are read; write it again "
    assert 1 << 24 < int(re.match(begin + "with a garment", said)[1]) < len(header) + 100


def test_a_take_of_which_no_frame_is_left_says_how_many_it_had(raw):
    """Its blocks are gone, or they and its end; or it had none from the beginning."""
    parts = chunks_of(raw)
    header, end = raw[: parts[0][1]], raw[parts[-1][0] :]
    assert refused(header + end) == f"a: holds none of the 150 frames that it had; {COPY}"
    broken = bytearray(raw[parts[1][0] : parts[1][1]])
    broken[60] ^= 1
    assert refused(header + bytes(broken)) == f"a: holds no frame that is sound; {COPY}"
    assert refused(header) == "a: holds no frame; the recording ended in its first second or is cut off"
    none = {**msgpack.unpackb(msgpack.packb(parts[-1][2])), "frames": 0, "blocks": 0}
    assert refused(header + chunk_of(none)) == "a: holds no frame; the recording ended in its first second"
