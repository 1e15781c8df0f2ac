"""Damage to a take costs the blocks that it touches, never a wrong value."""

from __future__ import annotations

import re
import struct
from dataclasses import replace

import numpy as np
import pytest

from formats.archive import read_take, read_with_report, take_of, verify_take, write_take
from formats.fault_words import faults
from tests.fit.here import hangtime_here
from tests.formats.damage import PAGE, a_report, chunk_of, chunks_of, damaged, is_wrong, without_end
from tests.formats.test_archive import a_take


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Forty seconds, on seven pages and more."""
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", a_take(frames=1200)).read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Three blocks, of which 10 000 accidents are read in seconds."""
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", a_take(frames=80)).read_bytes()


@pytest.mark.parametrize(
    ("seed", "count"), [(4, 200), *(pytest.param(seed, 2500, marks=pytest.mark.slow) for seed in range(4))]
)
def test_of_ten_thousand_accidents_none_gives_a_wrong_value(small, seed, count):
    rng, sound = np.random.default_rng(seed), take_of(small, "sound")
    for k in range(count):
        broken = damaged(small, rng)
        assert not is_wrong(broken, sound), f"accident {k} of seed {seed}"


def test_a_bit_of_a_chunks_own_lengths_costs_that_chunk_only(raw):
    """A seventh of the 392 bits of the second block's record: all frames but its 31 are there, whichever is flipped."""
    begin, _, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    sound = take_of(raw, "sound")
    for bit in range(0, 8 * 49, 7):
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


def test_a_file_that_is_cut_behind_its_last_message_lacks_nothing_and_is_not_sound(raw, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(raw[:-30])
    report = verify_take(path)
    assert (report.frames, report.missing_frames, report.damaged_blocks, report.is_sound) == (150, 0, 1, False)
    assert read_take(path).is_complete


OTHERS = {"another take": 60, "another take as long": 150, "a longer take": 240}  # frames, thirty of them a block


@pytest.mark.parametrize("kind", ["itself", "itself twice", "zeros", "noise", "a byte", *OTHERS])
def test_messages_behind_the_end_of_a_take_are_counted_and_no_frame_is_lost(kind, raw, tmp_path):
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


def test_a_chunk_without_a_checksum_is_not_accepted(raw):
    """MCAP lets 0 mean that there is none."""
    begin, end, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    unchecked = raw[:begin] + chunk_of(block, crc=0) + raw[end:]
    assert len(take_of(unchecked, "unchecked").time) == 150 - block["frames"]
    assert len(take_of(raw[:begin] + chunk_of(block) + raw[end:], "checked").time) == 150


def test_a_block_of_another_take_of_the_same_name_is_not_accepted(raw, tmp_path):
    """The same rig, garment and take id, recorded at another time."""
    other = write_take(tmp_path / "a.mcap", replace(a_take(seed=1), created="2026-01-02T00:00:00Z")).read_bytes()
    begin, end, block = [chunk for chunk in chunks_of(raw) if "table" in chunk[2]][1]
    theirs, until, _ = [chunk for chunk in chunks_of(other) if "table" in chunk[2]][1]
    swapped = raw[:begin] + other[theirs:until] + raw[end:]
    take = take_of(swapped, "swapped")
    assert len(take.time) == 150 - block["frames"]
    assert not is_wrong(swapped, take_of(raw, "sound"))


def test_one_missing_frame_is_one():
    report = a_report(missing_frames=1, spans=((1.0, 1.07),), is_complete=False)
    assert any("(1 frame)" in words for words in faults(a_take(), report))
