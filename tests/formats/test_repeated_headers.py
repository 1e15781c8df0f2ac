"""A header that unpacks to far more than its bytes is repeated as often as a take is long."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np

from formats.archive import read_with_report, write_take
from formats.chunks import COPY_EVERY, FREE_BYTES, Findings
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.test_archive import a_take


def long_take(blocks):
    """A take of as many frames as blocks, with notes of a megabyte that pack into a few hundred bytes."""
    take = a_take(20)
    rows = np.arange(blocks) % 20
    parts = {
        name: getattr(take, name)[rows]
        for name in ("held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers")
    }
    nothing = {"pitch": None, "pitch_sd": None, "points_hidden": None, "quality": None, "scans": ()}
    return replace(take, time=3.0 * np.arange(blocks), notes={"n": 1_000_000 * "n"}, **parts, **nothing)


def test_more_copies_of_a_header_than_64_mib_can_hold_are_no_damage(tmp_path):
    """2400 blocks have 82 of them, of a megabyte each; all behind the 64th were called damaged."""
    path = write_take(tmp_path / "a.mcap", long_take(2400))
    assert sum("format" in content for _, _, content in chunks_of(path.read_bytes())) == 82
    take, report = read_with_report(path)
    assert len(take.time) == 2400
    assert report.is_sound
    assert report.unread_blocks == 0


def test_a_header_comes_first_after_5_blocks_every_30_from_there_and_before_the_end(tmp_path):
    """Of 66 blocks: before the 1st, the 6th, the 36th and the 66th."""
    path = write_take(tmp_path / "a.mcap", replace(long_take(66), notes={}))
    kinds = [
        "header" if "format" in content else "block" if "table" in content else "end"
        for _, _, content in chunks_of(path.read_bytes())
    ]
    blocks = ["header", *5 * ["block"], "header", *30 * ["block"], "header", *30 * ["block"], "header", "block"]
    assert kinds == [*blocks, "header", "end"]


def test_copies_that_come_more_often_than_a_writer_puts_them_take_of_the_64_mib(tmp_path):
    """A hundred on end: one of 20 is free, and 64 MiB hold 67 others."""
    raw = write_take(tmp_path / "a.mcap", long_take(20)).read_bytes()
    begin, end, _ = chunks_of(raw)[0]
    (tmp_path / "b.mcap").write_bytes(raw[:end] + 100 * raw[begin:end] + raw[end:])
    take, report = read_with_report(tmp_path / "b.mcap")
    assert len(take.time) == 20
    assert 20 < report.unread_blocks < 36


def test_a_chunk_gives_back_no_more_than_it_took_and_than_its_header_has():
    for beyond, size, left in ((900, 1000, FREE_BYTES), (5000, 1000, FREE_BYTES - 4000)):
        findings = Findings()
        for _ in range(COPY_EVERY - 1):
            findings.charge(0)
        findings.charge(beyond)
        findings.refund_copy(size)
        assert findings.bytes_left == left


def test_chunks_that_find_no_more_bytes_are_said_to_be_unread_and_not_damaged(raw, tmp_path):
    """64 MiB hold four chunks of 16 MB; the others of nine stay packed."""
    at = chunks_of(raw)[1][0]
    block = next(content for _, _, content in chunks_of(raw) if "table" in content)
    parts = [chunk_of({**block, "take": bytes([k]), "table": bytes(16_700_000)}) for k in range(9)]
    (tmp_path / "a.mcap").write_bytes(raw[:at] + b"".join(parts) + raw[at:])
    _, report = read_with_report(tmp_path / "a.mcap")
    assert (report.frames, report.unread_blocks, report.damaged_blocks) == (150, 5, 4)


def test_a_long_take_is_written_in_batches_that_come_back_as_one(tmp_path, monkeypatch):
    """Of 6000 rows of 60 numbers, all at once take 25 MB beside the columns; batches of 1092 rows take 5 MB."""
    take = replace(long_take(6000), notes={}, time=np.arange(6000) / 30)
    take.points_valid[1080:1130, 2] = False  # a batch ends among them
    monkeypatch.setattr("formats.take_writer.WRITTEN_AT_ONCE", 1 << 16)
    tracemalloc.start()
    path = write_take(tmp_path / "a.mcap", take)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10e6
    back, report = read_with_report(path)
    assert report.is_sound
    np.testing.assert_array_equal(back.points_valid, take.points_valid)
    np.testing.assert_allclose(back.time, take.time, atol=5.1e-7)
    assert np.abs(back.points - take.points)[take.points_valid].max() < 5.1e-5
