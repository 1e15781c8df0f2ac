"""Damage to a take costs the blocks that it touches, never a wrong value; hostile files cost little."""

from __future__ import annotations

import os
import re
import struct
import time
import tracemalloc
import zlib
from dataclasses import replace

import msgpack
import numpy as np
import pytest
import zstandard

from formats.archive import read_take, read_with_report, take_of, verify_take, write_take
from formats.chunks import MCAP_MAGIC, Findings, messages_in
from formats.errors import TakeError
from formats.surface import places_of
from tests.fit.here import hangtime_here
from tests.formats.damage import PAGE, chunks_of, damaged, is_wrong, without_end
from tests.formats.test_archive import a_scan, a_take


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Five seconds in five blocks, and two scans."""
    take = replace(a_take(), scans=(a_scan(0.4, 1), a_scan(2.6, 2)))
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", take).read_bytes()


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Forty seconds, on seven pages and more."""
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", a_take(frames=1200)).read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Three blocks, of which 10 000 accidents are read in seconds."""
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", a_take(frames=80)).read_bytes()


@pytest.mark.parametrize(
    ("seed", "count"), [(4, 500), *(pytest.param(seed, 2500, marks=pytest.mark.slow) for seed in range(4))]
)
def test_of_ten_thousand_accidents_none_gives_a_wrong_value(small, seed, count):
    rng, sound = np.random.default_rng(seed), take_of(small, "sound")
    for k in range(count):
        broken = damaged(small, rng)
        assert not is_wrong(broken, sound), f"accident {k} of seed {seed}"


def test_a_bit_of_a_chunks_own_lengths_costs_that_chunk_only(raw):
    """A third of the 392 bits of the second block's record: all frames but its 31 are there, whichever is flipped."""
    begin, _, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    sound = take_of(raw, "sound")
    for bit in range(0, 8 * 49, 3):
        broken = bytearray(raw)
        broken[begin + bit // 8] ^= 1 << bit % 8
        take = take_of(bytes(broken), "broken")
        assert len(take.time) == 150 or len(take.time) == 150 - block["frames"]
        assert np.isin(take.time, sound.time).all()


def test_a_bit_of_a_length_between_the_chunks_costs_nothing(raw):
    """Each bit of every length of a record that holds no frames: the reader does not jump over a block by it."""
    found, at = [], 8
    while raw[at] != 0x0F:
        found += [at + 1] if raw[at] != 6 else []
        at += 9 + struct.unpack_from("<Q", raw, at + 1)[0]
    assert found
    for place in found:
        for bit in range(32):
            broken = bytearray(raw)
            broken[place + bit // 8] ^= 1 << bit % 8
            assert len(take_of(bytes(broken), "broken").time) == 150, (place, bit)


@pytest.mark.parametrize("zeroed", [slice(0, 200), slice(0, PAGE), slice(PAGE, 2 * PAGE), slice(8, 9)])
def test_a_lost_page_costs_what_it_held(long, zeroed):
    """The first page holds the specification, the header and the first blocks; the header comes again and again."""
    broken = bytearray(long)
    broken[zeroed] = bytes(len(broken[zeroed]))
    blocks = [(begin, end, content) for begin, end, content in chunks_of(long) if "table" in content]
    hit = sum(content["frames"] for begin, end, content in blocks if begin < zeroed.stop and end > zeroed.start)
    take = take_of(bytes(broken), "broken")
    assert len(take.time) == 1200 - hit >= 1000
    assert not is_wrong(bytes(broken), take_of(long, "sound"))


def test_an_interrupted_recording_that_lost_its_first_page_keeps_what_was_behind_it(long):
    """Ten seconds in, it has a second header."""
    blocks = [(begin, content) for begin, _, content in chunks_of(long) if "table" in content]
    broken = bytes(PAGE) + long[PAGE : blocks[10][0]]
    behind = sum(content["frames"] for begin, content in blocks[:10] if begin >= PAGE)
    assert len(take_of(broken, "broken").time) == behind >= 200
    assert not is_wrong(broken, take_of(long, "sound"))


@pytest.mark.parametrize("page", range(5))
def test_a_page_that_comes_twice_costs_the_chunk_that_it_parts(long, page):
    broken = long[: (page + 1) * PAGE] + long[page * PAGE :]
    cut = [c["frames"] for a, b, c in chunks_of(long) if "table" in c and a < (page + 1) * PAGE < b]
    assert len(cut) <= 1
    assert len(take_of(broken, "broken").time) >= 1200 - sum(cut)
    assert not is_wrong(broken, take_of(long, "sound"))


def test_missing_seconds_are_named(raw):
    """Without the second block, frames 31 to 61, that is between 1.25 s and 2.317 s of the sensor's clock."""
    blocks = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]]
    begin, end, block = blocks[1]
    take = take_of(raw[:begin] + raw[end:], "broken")
    assert (block["first"], block["frames"]) == (31, 31)
    ((before, after),) = take.missing
    assert before == pytest.approx(0.25 + 30 / 30, abs=1e-6)
    assert after == pytest.approx(0.25 + 62 / 30, abs=1e-6)
    assert not take.is_complete


def test_a_lost_beginning_and_a_lost_end_are_named_by_what_the_end_counts(raw):
    blocks = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]]
    without = raw[: blocks[0][0]] + raw[blocks[0][1] : blocks[4][0]] + raw[blocks[4][1] :]
    first, last = take_of(without, "broken").missing
    assert first[0] == pytest.approx(0.25, abs=1e-6)
    assert last[1] == pytest.approx(0.25 + 149 / 30, abs=1e-6)


def test_a_take_that_lost_its_scans_or_its_frames_is_not_sound(raw, tmp_path):
    """Without one scan all 150 frames are there, and `/end` still counts two."""
    begin, end, _ = next(chunk for chunk in chunks_of(raw) if "surface" in chunk[2])
    path = tmp_path / "a.mcap"
    path.write_bytes(raw[:begin] + raw[end:])
    report = verify_take(path)
    assert (report.frames, report.scans, report.missing_scans, report.is_sound) == (150, 1, 1, False)


def chunk_of(content, *, crc=None, compression=b"zstd"):
    """A chunk of one message; crc: instead of the right one."""
    data = msgpack.packb(content) if not isinstance(content, bytes) else content
    return chunk_of_records(
        struct.pack("<BQHIQQ", 5, 22 + len(data), 1, 0, 0, 0) + data, crc=crc, compression=compression
    )


def chunk_of_records(records, *, crc=None, compression=b"zstd"):
    packed = zstandard.compress(records) if compression == b"zstd" else records
    crc = zlib.crc32(records) if crc is None else crc
    body = struct.pack("<QQQII", 0, 0, len(records), crc, len(compression)) + compression
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def test_a_file_that_is_cut_behind_its_last_message_lacks_nothing_and_is_not_sound(raw, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(raw[:-30])
    report = verify_take(path)
    assert (report.frames, report.missing_frames, report.damaged_blocks, report.is_sound) == (150, 0, 1, False)
    assert read_take(path).is_complete


OTHERS = {"another take": 60, "another take as long": 150, "a longer take": 240}  # frames, thirty of them a block


@pytest.mark.parametrize("kind", ["itself", "itself twice", "zeros", "noise", "a byte", *OTHERS])
def test_what_follows_the_end_of_a_take_is_counted_and_no_frame_is_lost(kind, raw, tmp_path):
    """All 150 frames are there once, whatever comes behind them."""
    other = write_take(tmp_path / "b.mcap", replace(a_take(frames=OTHERS.get(kind, 1)), take_id="b")).read_bytes()
    noise = np.random.default_rng(1).bytes(5000)
    behind = {
        "itself": raw, "itself twice": raw + raw, "zeros": bytes(4096), "noise": noise, "a byte": b"x",
    }.get(kind, other)  # fmt: skip
    path = tmp_path / "a.mcap"
    path.write_bytes(raw + behind)
    take, report = read_with_report(path)
    assert np.array_equal(take.time, take_of(raw, path).time)
    assert take.is_complete
    assert take.take_id == take_of(raw, path).take_id != "b"
    assert (report.frames, report.trailing_bytes, report.is_sound) == (150, len(behind), False)
    assert (report.damaged_blocks, report.other_blocks) == (0, OTHERS[kind] // 30 if kind in OTHERS else 0)
    said = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path)
    assert said.returncode == 2
    assert re.search(
        rf"^damaged +a.mcap: 150 frames in 5 blocks.*; {len(behind)} bytes? follows? its end; ", said.stdout
    )


@pytest.mark.parametrize(("frames", "chosen"), [((60, 240), "b"), ((240, 60), "a"), ((60, 60), "b")])
def test_of_two_takes_without_an_end_the_one_of_most_blocks_is_read_or_else_the_last(tmp_path, frames, chosen):
    both = [
        without_end(write_take(tmp_path / f"{name}.mcap", replace(a_take(frames=count), take_id=name)).read_bytes())
        for name, count in zip("ab", frames, strict=True)
    ]
    path = tmp_path / "both.mcap"
    path.write_bytes(both[0] + both[1])
    take, report = read_with_report(path)
    assert (take.take_id, len(take.time), report.is_complete) == (chosen, max(frames), False)
    assert report.other_blocks == min(frames) // 30


def test_a_damaged_take_with_a_whole_one_behind_it_is_the_damaged_one(raw, tmp_path):
    other = write_take(tmp_path / "b.mcap", replace(a_take(frames=240), take_id="b")).read_bytes()
    begin, end, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    broken = raw[: begin + 60] + bytes(end - begin - 60) + raw[end:]
    path = tmp_path / "a.mcap"
    path.write_bytes(broken + other)
    take, report = read_with_report(path)
    assert take.take_id == take_of(raw, path).take_id != "b"
    assert (report.frames, report.missing_frames, report.trailing_bytes) == (
        150 - block["frames"],
        block["frames"],
        len(other),
    )


def test_frames_that_were_lost_are_taken_from_a_copy_behind_the_end(raw, tmp_path):
    begin, end, _ = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    path = tmp_path / "a.mcap"
    path.write_bytes(raw[: begin + 60] + bytes(end - begin - 60) + raw[end:] + raw)
    report = verify_take(path)
    assert (report.frames, report.missing_frames, report.trailing_bytes) == (150, 0, len(raw))


def test_a_chunk_without_a_checksum_is_not_believed(raw):
    """MCAP lets 0 mean that there is none."""
    begin, end, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    unchecked = raw[:begin] + chunk_of(block, crc=0) + raw[end:]
    assert len(take_of(unchecked, "unchecked").time) == 150 - block["frames"]
    assert len(take_of(raw[:begin] + chunk_of(block) + raw[end:], "checked").time) == 150


def test_a_block_of_another_take_of_the_same_name_is_not_believed(raw, tmp_path):
    """The same rig, garment and take id, recorded at another time."""
    other = write_take(tmp_path / "a.mcap", replace(a_take(seed=1), created="2026-01-02T00:00:00Z")).read_bytes()
    begin, end, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    theirs, until, _ = [chunk for chunk in chunks_of(other) if "table" in chunk[2]][1]
    swapped = raw[:begin] + other[theirs:until] + raw[end:]
    take = take_of(swapped, "swapped")
    assert len(take.time) == 150 - block["frames"]
    assert not is_wrong(swapped, take_of(raw, "sound"))


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


BOMBS = {
    "lists": b"\x91" * 1_000_000 + b"\x90",
    "many lists": b"\xdd\x00\x98\x96\x80" + b"\x90" * 10_000_000,
    "a long list": b"\xdd\xff\xff\xff\xff",
    "maps": b"\x82\xa6format\xaehangtime-take/2\xa5notes\xdd\x00\x4c\x4b\x40" + b"\x80" * 5_000_000,
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_message_that_swells_is_damage(raw, name):
    """Kilobytes that unpack to millions of containers: at most 64 MB, and the take is read."""
    at = chunks_of(raw)[1][0]
    bomb = raw[:at] + chunk_of(BOMBS[name]) + raw[at:]
    assert len(bomb) < len(raw) + 40_000
    most, said = peak_of(lambda: take_of(bomb, "bomb"))
    assert said == ""
    assert most < 64 << 20
    assert len(take_of(bomb, "bomb").time) == 150


def test_many_blocks_that_say_that_nothing_moved_are_bounded(raw):
    """1000 blocks of 4096 still frames claim 2 GB in 180 kB of file: at most 256 MB are taken."""
    blocks = [content for _, _, content in chunks_of(raw) if "table" in content]
    columns = 28 + 8 * 4
    still = bytes(5 * columns + 4)
    at = chunks_of(raw)[1][0]
    more = b"".join(
        chunk_of(blocks[0] | {"first": 1000 + 4096 * k, "frames": 4096, "start": 10**9 + k * 10**7, "table": still})
        for k in range(1000)
    )
    most, _ = peak_of(lambda: take_of(raw[:at] + more + raw[at:], "bomb"))
    assert most < 256 << 20


@pytest.mark.parametrize("record", [bytes(9), b"\x05" + struct.pack("<Q", 22) + bytes(22)])
def test_many_records_in_few_bytes_are_bounded(raw, record):
    """A hundred kilobytes of millions of records; the take before them is read."""
    whole = raw[: chunks_of(raw)[-1][1]]  # without the end of the file, behind which nothing is read
    bomb = whole + chunk_of_records(record * ((1 << 24) // len(record))) * 8
    start = time.process_time()
    assert len(take_of(bomb, "bomb").time) == 150
    findings = Findings()
    list(messages_in(bomb[len(whole) :], findings))
    assert findings.records < 150_000
    assert time.process_time() - start < 5


def test_a_pipe_is_no_take(tmp_path):
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(TakeError, match="is a pipe or a device"):
        read_take(tmp_path / "a.mcap")


def test_many_large_scans_in_few_bytes_are_bounded(raw):
    """Three kilobytes claim 300 scans of 327,680 places: at most 256 MB and a few seconds are taken."""
    at = chunks_of(raw)[1][0]
    scan = {"take": chunks_of(raw)[1][2]["take"], "grid_size": 512, "contour_size": 65536}
    still = {"grid": bytes(24), "contour": bytes(24)}
    more = b"".join(chunk_of(scan | still | {"surface": k}) for k in range(300))
    bomb = raw[:at] + more + raw[at:]
    start = time.process_time()
    most, said = peak_of(lambda: take_of(bomb, "bomb"))
    assert said == ""
    assert most < 256 << 20
    assert time.process_time() - start < 5
    assert 0 < len(take_of(bomb, "bomb").scans) < 10


def test_a_scan_has_the_places_of_its_grid_and_those_around_it():
    assert places_of({"grid_size": 5, "contour_size": 12}) == 37
    for size, count in ((-1, 0), (513, 0), (0, 65537), (True, 0), (1.0, 0), (0, None)):
        with pytest.raises(ValueError, match="cannot be"):
            places_of({"grid_size": size, "contour_size": count})


def test_a_take_that_lost_all_of_its_blocks_is_not_said_to_have_ended_early(raw):
    begin, end = chunks_of(raw)[1][0], chunks_of(raw)[-1][0]
    for broken, sentence in (
        (raw[:begin] + bytes(end - begin) + raw[end:], "holds none of the 150 frames that it had; copy it again"),
        (raw[:begin] + bytes(len(raw) - begin), "holds no frame that is sound; copy it again"),
        (raw[: begin + 200], "holds no frame; it ended in its first second or is cut off"),
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
    assert "is no take: it has 300.0 GB and its profile says ros2" in said
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
