"""Scans in takes of version 1 that lie outside the take's time may belong to another take, since they name none."""

from __future__ import annotations

import json

import pytest

from formats.archive import read_take, read_with_report
from formats.fault_words import doubts_of
from tests.fit.here import hangtime_here
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.test_vectors import HERE as VECTORS

# Blocks of 0.25 to 1.25, 1.28 to 2.32 and, behind a pause that is added here, 9.35 to 9.55 s; a scan of 0.4 s.
CHUNKS = [content for _, _, content in chunks_of((VECTORS / "version-1.mcap").read_bytes())]
HEADER, END = CHUNKS[0], CHUNKS[-1]
BLOCKS = [content for content in CHUNKS if "first" in content]
BLOCKS[2] = {**BLOCKS[2], "start": BLOCKS[2]["start"] + 7_000_000}
SCANS = [content for content in CHUNKS if "surface" in content]


def scan_at(seconds):
    return {**SCANS[0], "surface": round(1e6 * seconds)}


def written(folder, *contents):
    """A file of these messages, and the doubts of its report."""
    (folder / "a.mcap").write_bytes(b"".join(map(chunk_of, contents)))
    return read_with_report(folder / "a.mcap")[1].doubts


def doubt(stray, span="0.250000 to 9.550000"):
    return f"{stray} s may be of another take: the frames go from {span} s"


@pytest.mark.parametrize("seconds", [-0.76, 10.56, -3e9, 1005.25])
def test_a_scan_more_than_a_block_outside_the_frames_of_a_whole_take_is_doubted(tmp_path, seconds):
    found = written(tmp_path, HEADER, *BLOCKS, *SCANS, scan_at(seconds), HEADER, END)
    assert found == (doubt(f"a scan of {seconds:.6f}"),)


def test_several_stray_scans_are_counted_and_the_first_one_is_named(tmp_path):
    found = written(tmp_path, HEADER, *BLOCKS, *SCANS, scan_at(50), scan_at(40), HEADER, END)
    assert found == (doubt("2 of 3 scans, one of 40.000000"),)


@pytest.mark.parametrize(
    "contents",
    [
        [HEADER, *BLOCKS, *SCANS, scan_at(0.25), scan_at(9.55), HEADER, END],  # with the first and the last frame
        [HEADER, BLOCKS[0], scan_at(1.25), *BLOCKS[1:], scan_at(5.0), HEADER, END],  # behind its block, in a pause
        [HEADER, *BLOCKS, scan_at(-0.7), scan_at(10.5), HEADER, END],  # a caller scanned beside the frames
        [HEADER, *BLOCKS, scan_at(9.9)],  # cut short in the second that waits
        [HEADER, *BLOCKS[:2], scan_at(9.35)],  # cut short behind a pause of 7 s
        [HEADER, *BLOCKS[:2], scan_at(9.4), HEADER, END],  # the last block is lost
        [scan_at(0.3), scan_at(1.2), *BLOCKS[2:], HEADER, END],  # the first two blocks and their header are lost
        [HEADER, BLOCKS[0], scan_at(1.7), BLOCKS[2], HEADER, END],  # a block between is lost
    ],
    ids=["ends", "pause", "beside", "cut", "cut-after-pause", "last-lost", "first-lost", "between-lost"],
)
def test_a_scan_of_a_frame_that_is_there_or_may_be_lost_is_not_doubted(tmp_path, contents):
    assert written(tmp_path, *contents) == ()


def test_a_scan_before_the_first_frame_of_a_take_that_was_cut_short_is_doubted(tmp_path):
    assert written(tmp_path, HEADER, *BLOCKS[:2], scan_at(-9)) == (
        doubt("a scan of -9.000000", "0.250000 to 2.316667"),
    )  # fmt: skip


def test_commands_report_a_stray_scan_and_a_recovered_take_keeps_the_doubt(tmp_path):
    told = doubt("a scan of 1005.250000")
    assert written(tmp_path, HEADER, *BLOCKS, *SCANS, scan_at(1005.25), HEADER, END) == (told,)
    verified = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path)
    assert (verified.returncode, verified.stdout.partition(" ")[0]) == (2, "damaged")
    assert verified.stdout.count(told) == 1
    assert f"\nwarning   {told}\n" in hangtime_here("takes", "show", "a.mcap", folder=tmp_path).stdout
    (entry,) = json.loads(hangtime_here("takes", "verify", "a.mcap", "--json", folder=tmp_path).stdout)["takes"]
    assert (entry["state"], entry["doubts"]) == ("damaged", [told])
    assert doubts_of(read_take(tmp_path / "a.mcap")) == [told, "2 blocks of its file are damaged"]
    assert hangtime_here("compare", "a.mcap", "a.mcap", folder=tmp_path).stderr.count(f": {told}.") == 1
    assert hangtime_here("takes", "recover", "a.mcap", folder=tmp_path).stdout.endswith(f"; {told}\n")
    recovered = tmp_path / "a.recovered.mcap"
    take, report = read_with_report(recovered)
    assert (len(take.scans), report.is_sound, report.doubts, report.earlier_doubts) == (2, True, (), told)
