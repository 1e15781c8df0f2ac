"""Hostile files cost little memory and time, and one sentence."""

from __future__ import annotations

import os
import struct
import time
import tracemalloc

import msgpack
import pytest

from formats.archive import read_take, take_of
from formats.chunks import MCAP_MAGIC, Findings, messages_in
from formats.errors import TakeError
from formats.surface import places_of
from formats.take_messages import MOST_CONTAINERS, header_of
from tests.formats.bombs import BOMBS
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.measured import MeasuredReading


@pytest.mark.parametrize("inner", [b"", b"zstd"])
def test_false_chunk_starts_within_each_other_are_read_in_linear_time(raw, inner):
    """390 kB of them took 34 s: the work on 4 times as many is counted, at most 6 times as much."""
    head = raw[: chunks_of(raw)[1][0]]

    def work(count):
        size = 49 + len(inner) + 5
        parts = []
        for k in range(count):  # each claims to reach to the end of the file
            rest = (count - k) * size - 49 - len(inner)
            body = struct.pack("<BQQQQII", 6, 40 + len(inner) + rest, 0, 0, 1000, 7, len(inner)) + inner
            parts.append(body + struct.pack("<Q", rest) + b"\x28\xb5\x2f\xfd\0")
        findings = Findings()
        start = time.process_time()
        list(messages_in(head + b"".join(parts), findings))
        return time.process_time() - start

    few, many = min(work(1500) for _ in range(3)), min(work(6000) for _ in range(3))
    assert many < 10 * few + 0.5


# Others of the list, and blocks in which time alone moves, are like these and cost a tenth.
DEAR = (
    "many large headers", "headers of long lists", "kept blocks of noise", "kept scans", "a map of strings", "strings",
    "maps of strings", "small messages", "still scans of 64 places", "copies of a header between chunks of nothing",
    "thousands of takes", "many ends", "still blocks",
)  # fmt: skip


@pytest.fixture(scope="module")
def measured():
    """Reads files in a process each, and returns what they cost."""
    with MeasuredReading() as reading:
        yield reading


@pytest.mark.unmutated
@pytest.mark.parametrize("name", [pytest.param(one, marks=pytest.mark.slow) if one in DEAR else one for one in BOMBS])
def test_a_hostile_file_costs_256_mb_and_2_s_at_most_and_the_take_in_it_is_read(name, raw, measured, tmp_path):
    path = tmp_path / "bomb.mcap"
    path.write_bytes(BOMBS[name](raw))
    cost = measured("take", path)
    assert (cost["said"], cost.get("frames")) == ("", 150)
    assert cost["megabytes"] <= 256
    assert cost["seconds"] <= 2
    assert not cost["is_sound"] or name == "metadata by the thousand"


def peak_of(read):
    tracemalloc.start()
    try:
        read()
    except TakeError as error:
        said = str(error)
    else:
        said = ""
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most, said


def test_a_pipe_is_no_take(tmp_path):
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(TakeError, match="is a pipe or a device"):
        read_take(tmp_path / "a.mcap")


def test_a_scan_has_the_points_of_its_grid_and_those_around_it():
    assert places_of({"grid_size": 5, "contour_size": 12}) == 37
    assert places_of({"grid_size": 512, "contour_size": 65536}) == 512 * 512 + 65536
    assert places_of({"grid_size": 0, "contour_size": 0}) == 0
    for size, count in ((-1, 0), (513, 0), (0, 65537), (True, 0), (1.0, 0), (0, None)):
        with pytest.raises(ValueError, match="cannot be"):
            places_of({"grid_size": size, "contour_size": count})


def test_a_take_that_lost_all_of_its_blocks_is_not_said_to_have_ended_early(raw):
    begin, end = chunks_of(raw)[1][0], chunks_of(raw)[-1][0]
    for broken, sentence in (
        (raw[:begin] + bytes(end - begin) + raw[end:], "holds none of the 150 frames that it had; copy it again"),
        (raw[:begin] + bytes(len(raw) - begin), "holds no frame that is sound; copy it again"),
        (raw[: begin + 200], "holds no frame; the recording ended in its first second or is cut off"),
    ):
        with pytest.raises(TakeError, match=sentence):
            take_of(broken, "lost")


def test_a_take_whose_time_stands_still_in_every_block_is_one_sentence(raw):
    blocks = [content for _, _, content in chunks_of(raw) if "table" in content]
    still = chunk_of(blocks[0] | {"table": bytes(5 * (28 + 8 * 4) + 4)})
    at = chunks_of(raw)[1][0]
    with pytest.raises(TakeError, match="holds no frame"):
        take_of(raw[:at] + still, "still")


def test_a_file_of_300_gigabytes_is_refused_unread(tmp_path):
    path = tmp_path / "huge.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQI", 1, 12, 4) + b"ros2" + bytes(4))
    with path.open("r+b") as file:
        file.truncate(300 * 10**9)
    most, said = peak_of(lambda: read_take(path))
    assert "is no take: the file has 300.0 GB and its profile says ros2; a take has 1.1 GB at most" in said
    assert most < 32 << 20


def test_a_file_of_nothing_is_held_once(tmp_path):
    """128 MB of holes behind the magic: they are read once, and searched in 60 MB."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        file.write(MCAP_MAGIC)
        file.truncate(1 << 27)
    most, said = peak_of(lambda: read_take(path))
    assert "holds no readable header" in said
    assert most < (1 << 27) + 60e6


def test_an_archive_of_another_profile_is_named_and_not_read_whole(tmp_path):
    path = tmp_path / "ros.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQI", 1, 12, 4) + b"ros2" + bytes(4))
    with path.open("r+b") as file:
        file.truncate(10**9)
    most, said = peak_of(lambda: read_take(path))
    assert "is not a take archive: its profile says ros2" in said
    assert most < 64 << 20


def test_an_archive_of_another_compression_is_named(raw):
    """As a tool that compresses with lz4 would write it."""
    chunks = chunks_of(raw)
    lz4 = raw[: chunks[0][0]] + b"".join(chunk_of(c, compression=b"lz4") for _, _, c in chunks) + raw[chunks[-1][1] :]
    with pytest.raises(TakeError, match="is compressed with lz4, which is not read; compress it with zstd"):
        take_of(lz4, "lz4")


def test_an_archive_without_compression_is_read(raw):
    chunks = chunks_of(raw)
    header = chunk_of(b"".join(messages_in(raw[chunks[0][0] : chunks[0][1]], Findings())), compression=b"")
    plain = raw[: chunks[0][0]] + header + raw[chunks[0][1] :]
    assert len(take_of(plain, "plain").time) == 150


@pytest.mark.parametrize("part", [[], {}], ids=["lists", "maps"])
def test_a_header_has_so_many_maps_and_lists_and_no_more(part):
    """The header itself and the list of the parts are two of them."""
    for count, is_read in ((MOST_CONTAINERS - 2, True), (MOST_CONTAINERS - 1, False)):
        data = msgpack.packb({"format": "hangtime-take/2", "parts": [part] * count})
        assert (header_of(data) is not None) == is_read
