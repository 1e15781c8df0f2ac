"""Takes in which nothing moves: few bytes hold many frames, and all of them are there."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import read_with_report, write_take
from formats.blocks import most_rows
from formats.garment import TrackedPoint
from formats.table_memory import FREE_MEMORY, NUMBERS_AT_ONCE, TableMemory
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take


def still(points, frames):
    """A garment of many points at rest, or out of view, 30 frames a second."""
    take = a_take(20)
    names = tuple(TrackedPoint(name=f"point {k}", at_m=(1e-4 * k - 0.15, -0.1)) for k in range(points))
    return replace(
        take, time=np.arange(frames) / 30, garment=msgspec.structs.replace(take.garment, points=names),
        points=np.full((frames, points, 3), np.nan), points_valid=np.zeros((frames, points), bool),
        points_sd=np.zeros((frames, points, 3)), points_hidden=None, state=np.zeros(frames, np.uint16),
        held=np.repeat(take.held[:1], frames, 0), held_valid=np.ones((frames, 2), bool),
        held_sd=np.repeat(take.held_sd[:1], frames, 0), markers=np.repeat(take.held[:1], frames, 0), scans=(),
    )  # fmt: skip


@pytest.mark.parametrize(("points", "seconds"), [(2000, 20), pytest.param(81, 400, marks=pytest.mark.slow)])
def test_a_take_of_points_that_nobody_sees_is_read_whole_and_called_sound(tmp_path, points, seconds):
    """With a quarter of the memory, 350 s of 81 points or 9 s of 2000 were read, and the rest was called damaged."""
    write_take(tmp_path / "a.mcap", still(points, 30 * seconds))
    take, report = read_with_report(tmp_path / "a.mcap")
    assert (len(take.time), report.damaged_blocks, report.is_complete) == (30 * seconds, 0, True)


def test_seconds_of_many_points_at_a_high_rate_are_cut_into_blocks_that_can_be_read(tmp_path):
    """Smooth motion has few bytes too, and a block of more than 2^20 numbers has no memory beyond its bytes."""
    at_rest = still(2000, 300)
    time = np.arange(300) / 120
    points = np.sin(time)[:, None, None] * np.linspace(0.1, 0.2, 6000).reshape(2000, 3) + 1.5
    moving = replace(at_rest, time=time, points=points, points_valid=np.ones((300, 2000), bool))
    write_take(tmp_path / "a.mcap", replace(moving, points_sd=np.full(points.shape, 0.002)))
    take, report = read_with_report(tmp_path / "a.mcap")
    assert (len(take.time), report.is_sound) == (300, True)
    assert report.blocks == 300 // most_rows(2000) + 1
    np.testing.assert_allclose(take.points, points, atol=5.1e-5)


def test_blocks_that_need_more_memory_are_left_out_with_the_reason_and_not_called_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr("formats.table_memory.FREE_MEMORY", 1 << 22)
    monkeypatch.setattr("formats.take_reader.TableMemory", lambda: TableMemory(left=1 << 22))
    write_take(tmp_path / "a.mcap", still(2000, 300))
    take, report = read_with_report(tmp_path / "a.mcap")
    assert (report.damaged_blocks, report.is_damaged, report.is_sound, report.doubts) == (0, False, False, ())
    assert not take.is_complete
    assert report.unread_blocks > 0
    assert report.blocks + report.unread_blocks == 10
    assert take.missing[-1][1] == pytest.approx(299 / 30, abs=1e-5)


def test_commands_say_of_a_take_beyond_the_limit_that_nothing_is_damaged(tmp_path, monkeypatch):
    """With memory for two blocks of 31 frames, the two others are not read."""
    monkeypatch.setattr("formats.take_reader.TableMemory", lambda: TableMemory(left=1 << 23))
    write_take(tmp_path / "a.mcap", still(2000, 100))
    why = (
        "2 blocks or scans need more memory than one file may take, which is no damage; keep this file, and record "
        "shorter takes"
    )
    done = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path)
    told = f"too large   a.mcap: 62 frames in 2 blocks; not read: 2.03 to 3.30 s (38 frames); {why}\n"
    assert (done.returncode, done.stdout) == (2, told)
    done = hangtime_here("takes", "list", ".", folder=tmp_path)
    assert done.stdout.startswith("too large   a.mcap: 2.0 s, still, ")
    assert f"\nnot read  {why}\n" in hangtime_here("takes", "show", "a.mcap", folder=tmp_path).stdout
    done = hangtime_here("takes", "recover", "a.mcap", folder=tmp_path)
    assert done.stdout == f"a.recovered.mcap: 62 frames, missing: 2.03 to 3.30 s; {why}\n"


def test_81_points_that_nobody_sees_are_read_for_an_hour_and_a_half():
    """30 frames a second in blocks of 31; a block of them has 198 bytes of the file."""
    memory = TableMemory()
    assert all(memory.fits(31 * (28 + 8 * 81), 198) for _ in range(90 * 60 * 30 // 31))
    assert memory.left < FREE_MEMORY


def test_one_table_that_no_file_has_memory_for_costs_itself_alone():
    memory = TableMemory(left=4_000_000)
    assert not memory.fits(FREE_MEMORY, 100)
    assert memory.left_out == 0
    assert memory.fits(500_000, 100)
    assert not memory.fits(500_000, 100)
    assert memory.left_out == 1


def test_a_table_that_is_decoded_alone_needs_the_bytes_of_its_numbers_and_a_scan_has_none_free():
    """Of 2^20 numbers and one, decoding takes 73 MB beyond the table: it needs a byte of the file for eight."""
    memory = TableMemory()
    assert not memory.fits(NUMBERS_AT_ONCE + 1, 1000)
    assert (memory.left, memory.left_out) == (FREE_MEMORY, 1)
    assert memory.fits(NUMBERS_AT_ONCE + 1, NUMBERS_AT_ONCE // 8 + 1)
    assert memory.fits(NUMBERS_AT_ONCE, 1000)
    assert memory.left == FREE_MEMORY - 8 * NUMBERS_AT_ONCE + 64 * 1000 + (1 << 17)
    memory = TableMemory()
    assert memory.fits(64 * 64 * 4, 100, may_rest=False)
    assert memory.left == FREE_MEMORY - 8 * 64 * 64 * 4 + 64 * 100


def test_tables_share_128_mib_and_a_still_table_of_128_kib_is_free():
    """A number takes 8 bytes of memory; 64 are free for each byte of the file."""
    memory = TableMemory()
    assert memory.left == 1 << 27
    assert memory.fits((1 << 17) // 8 + 64 * 1000 // 8, own=1000)
    assert memory.left == 1 << 27
    assert memory.fits((1 << 17) // 8 + 100, own=0)
    assert memory.left == (1 << 27) - 800
