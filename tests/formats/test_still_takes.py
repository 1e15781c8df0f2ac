"""Takes in which nothing moves: few bytes hold many frames, and all of them are there."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import read_with_report, write_take
from formats.garment import TrackedPoint
from formats.table_memory import FREE_MEMORY, TableMemory
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


@pytest.mark.parametrize(("points", "seconds"), [(2000, 20), (81, 400)])
def test_a_take_of_points_that_nobody_sees_is_read_whole_and_called_sound(tmp_path, points, seconds):
    """With a quarter of the memory, 350 s of 81 points or 9 s of 2000 were read, and the rest was called damaged."""
    write_take(tmp_path / "a.mcap", still(points, 30 * seconds))
    take, report = read_with_report(tmp_path / "a.mcap")
    assert (len(take.time), report.damaged_blocks, report.is_complete) == (30 * seconds, 0, True)


def test_blocks_that_need_more_memory_are_left_out_with_the_reason_and_not_called_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr("formats.table_memory.FREE_MEMORY", 1 << 22)
    monkeypatch.setattr("formats.take_reader.TableMemory", lambda: TableMemory(left=1 << 22))
    write_take(tmp_path / "a.mcap", still(2000, 300))
    take, report = read_with_report(tmp_path / "a.mcap")
    assert report.damaged_blocks == 0
    assert not take.is_complete
    left_out = int(report.doubts[0].split()[0])
    assert report.doubts == (
        f"{left_out} blocks need more memory than the 128 MB for points at rest; they were not read",
    )
    assert report.blocks + left_out == 10
    assert take.missing[-1][1] == pytest.approx(299 / 30, abs=1e-5)


def test_one_table_that_no_file_has_memory_for_costs_itself_alone():
    memory = TableMemory()
    assert not memory.fits(FREE_MEMORY, 100)
    assert memory.left_out == 0
    assert memory.fits(FREE_MEMORY // 16, 100)
    assert not memory.fits(FREE_MEMORY // 10, 100)
    assert memory.left_out == 1


def test_tables_share_128_mib_and_a_still_table_of_64_kib_is_free():
    """A number takes 8 bytes of memory; 64 are free for each byte of the file."""
    memory = TableMemory()
    assert memory.left == 1 << 27
    assert memory.fits((1 << 16) // 8 + 64 * 1000 // 8, own=1000)
    assert memory.left == 1 << 27
    assert memory.fits((1 << 16) // 8 + 100, own=0)
    assert memory.left == (1 << 27) - 800
