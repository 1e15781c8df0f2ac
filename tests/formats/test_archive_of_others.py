"""Archives that somebody else wrote, wrong or with intent: one sentence, or read and not sound; never a traceback."""

from __future__ import annotations

import struct
import tracemalloc

import msgpack
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from formats.archive import read_take, verify_take, write_take
from formats.errors import TakeError
from tests.formats.test_archive import a_take

GONE = object()


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """The content of every message of a take of 100 frames."""
    from formats.chunks import Findings, messages_in

    path = write_take(tmp_path_factory.mktemp("sound") / "a.mcap", a_take(frames=100))
    return [msgpack.unpackb(data) for data in messages_in(path.read_bytes(), Findings())]


def archive_of(path, contents, **options):
    """An archive whose chunks are sound, whatever their messages say; options: of its writer."""
    with path.open("wb") as file:
        mcap = Writer(file, chunk_size=1, compression=CompressionType.ZSTD, **options)
        mcap.start(profile="hangtime-take/2", library="another")
        channel = mcap.register_channel("/x", "msgpack", mcap.register_schema("hangtime", "", b""))
        for content in contents:
            mcap.add_message(channel, 0, msgpack.packb(content), 0)
        mcap.finish()
    return path


def changed(messages, kind, **changes):
    """Return messages with a change to the first one with the key `kind`, and to every one with the key `format`."""
    found, is_done = [], False
    for message in messages:
        if kind in message and not is_done:
            every = {**message, **changes}
            message = {key: value for key, value in every.items() if value is not GONE}
            is_done = kind != "format"
        found.append(message)
    return found


def test_the_same_messages_are_a_sound_take(messages, tmp_path):
    path = archive_of(tmp_path / "a.mcap", messages)
    assert verify_take(path).is_sound
    assert len(read_take(path).time) == 100


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"use_chunking": False}, "holds messages outside of chunks, which are not read"),
        ({"enable_crcs": False}, "has chunks without a checksum, which are not read"),
    ],
)
def test_the_same_messages_without_chunks_or_checksums_are_named_so(messages, tmp_path, options, what):
    """They were called a recording that ended in its first second."""
    path = archive_of(tmp_path / "a.mcap", messages, **options)
    with pytest.raises(TakeError) as refused:
        read_take(path)
    assert str(refused.value) == f"{path}: {what}; write its messages in chunks with their CRC-32"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"take_id": GONE}, "header is invalid: .*take_id"),
        ({"take_id": 7}, "header is invalid: take_id must be text .got a whole number"),
        ({"notes": [1]}, "header is invalid: notes must be a table .got a list"),
        ({"rig": GONE}, "its rig is invalid: "),
        ({"format": "hangtime-take/\u00b2"}, "is of format version \u00b2"),
    ],
)
def test_a_header_that_does_not_hold_is_one_sentence(messages, tmp_path, changes, words):
    path = archive_of(tmp_path / "a.mcap", changed(messages, "format", **changes))
    with pytest.raises(TakeError, match=words):
        read_take(path)


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("first", {"first": [0]}),
        ("first", {"first": "a"}),
        ("first", {"frames": True}),
        ("first", {"frames": 0}),
        ("first", {"frames": 10**10}),
        ("first", {"frames": 4096}),
        ("first", {"first": 2**63}),
        ("first", {"first": -1}),
        ("first", {"start": float("nan")}),
        ("first", {"start": 1e300}),
        ("first", {"start": 2**62}),
        ("first", {"start": 10**15}),
        ("first", {"table": b""}),
        ("first", {"table": "text"}),
        ("first", {"table": b"\x21" * 1000}),
        ("first", {"table": b"\xff" * 1000}),
        ("first", {"steps": [0]}),
        ("first", {"steps": [0, 3]}),
        ("first", {"take": b"another!"}),
        ("first", {"take": GONE}),
        ("blocks", {"blocks": "x"}),
    ],
)
def test_a_message_that_does_not_hold_is_damage_and_the_rest_is_read(messages, tmp_path, kind, changes):
    path = archive_of(tmp_path / "a.mcap", changed(messages, kind, **changes))
    take = read_take(path)
    assert np.isfinite(take.time).all()
    assert (np.diff(take.time) > 0).all()
    assert len(take.state) == len(take.time) > 20
    assert not verify_take(path).is_sound


@pytest.mark.parametrize("stray", [5, "surface", None, [1], {"surface": "x"}, {"surface": float("nan")}, {"what": 1}])
def test_a_message_of_no_kind_is_damage_and_the_rest_is_read(messages, tmp_path, stray):
    path = archive_of(tmp_path / "a.mcap", [stray, *messages])
    assert len(read_take(path).time) == 100
    assert not verify_take(path).is_sound


def test_a_take_whose_blocks_hold_no_frame_is_one_sentence(messages, tmp_path):
    path = archive_of(tmp_path / "a.mcap", [m if "first" not in m else {**m, "frames": 0} for m in messages])
    with pytest.raises(TakeError, match="holds none of the 100 frames that it had"):
        read_take(path)


def test_a_chunk_that_claims_to_be_small_is_not_unpacked_when_it_is_large(tmp_path):
    """12 kB that unpack to 400 MB, in a chunk that says 100 bytes: no more than some megabytes are taken."""
    size = 400 << 20
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(size >> 20)) + packer.flush()
    chunk = (
        struct.pack("<QQQI", 0, 0, 100, 1) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    )
    profile = struct.pack("<I", 15) + b"hangtime-take/1" + struct.pack("<I", 0)
    records = b"".join(bytes([kind]) + struct.pack("<Q", len(body)) + body for kind, body in ((1, profile), (6, chunk)))
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + records)
    tracemalloc.start()
    with pytest.raises(TakeError, match="no readable header"):
        read_take(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 20 << 20
