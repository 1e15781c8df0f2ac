"""The whole report on a take, field by field, whatever single part of it was removed or damaged."""

from __future__ import annotations

from dataclasses import asdict

import msgpack
import numpy as np
import pytest

from formats.archive import TakeWriter, read_with_report
from formats.surface import SurfaceScan
from formats.take_writer import binding_of
from tests.formats.damage import a_report, chunk_of, chunks_of
from tests.formats.test_archive import GARMENT, RIG, a_take, frame_of

PARTS = ["header", "scan", "block", "block", "scan", "block", "block", "header", "end"]  # in their order
SECOND = 8  # frames a second: a block has nine


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A take of four blocks of nine frames and two scans, by its path and its parts."""
    path, take = tmp_path_factory.mktemp("whole") / "t.mcap", a_take(36)
    take.time[:] = np.arange(36) / SECOND
    with TakeWriter(path, take_id="t", created="now", rig=RIG, garment=GARMENT) as writer:
        for k in range(36):
            if k in (0, 18):
                scan = SurfaceScan(time=k / SECOND, grid=np.zeros((2, 2, 3)), contour=np.zeros((3, 3)))
                writer.append_scan(scan)
            writer.append(frame_of(take, k))
    raw = path.read_bytes()
    return raw, chunks_of(raw)


def kind_of(content):
    return next(kind for key, kind in (("format", "header"), ("surface", "scan"), ("first", "block"), ("blocks", "end"))
                if key in content)  # fmt: skip


def report_on(folder, raw, **more):
    """Compare the report on a file with one on a sound take of 36 frames, 4 blocks and 2 scans but for `more`."""
    path = folder / "t.mcap"
    path.write_bytes(raw)
    take, report = read_with_report(path)
    expected = a_report(**{"frames": 36, "blocks": 4, "scans": 2, "file": str(path)} | more)
    assert asdict(report) == asdict(expected)
    assert (len(take.time), len(take.scans)) == (report.frames, report.scans)
    assert take.is_complete is (report.is_complete and not report.missing_frames and not report.earlier)
    return take


def test_a_whole_take_has_nothing_to_report(tmp_path, whole):
    raw, parts = whole
    assert [kind_of(content) for *_, content in parts] == PARTS
    assert report_on(tmp_path, raw).notes == {}


GAPS = {2: (-np.inf, 1.125), 3: (1.0, 2.25), 5: (2.125, 3.375), 6: (3.25, np.inf)}  # s around each block


@pytest.mark.parametrize("number", range(len(PARTS)))
@pytest.mark.parametrize("way", ["removed", "damaged"])
def test_the_loss_of_one_part_is_reported_by_its_numbers(tmp_path, whole, number, way):
    """A removed header is there once more. The end says when the first and the last frame were."""
    raw, parts = whole
    begin, end, content = parts[number]
    spoiled = raw[: begin + 60] + bytes([raw[begin + 60] ^ 4]) + raw[begin + 61 :]
    other, harm = (raw[:begin] + raw[end:], 0) if way == "removed" else (spoiled, 1)
    kind = PARTS[number]
    more = {"damaged_blocks": harm}
    if kind == "scan":
        more |= {"scans": 1, "missing_scans": 1}
    elif kind == "block":
        since, until = GAPS[number]
        since, until = max(since, 0.0), min(until, 4.375)
        more |= {"frames": 27, "blocks": 3, "missing_frames": 9, "spans": ((since, until),), "damaged_blocks": 1}
    elif kind == "end":
        more |= {"is_complete": False, "missing_frames": None, "spans": ((4.375, np.inf),)}
    assert kind_of(content) == kind
    report_on(tmp_path, other, **more)


@pytest.mark.parametrize(
    ("changes", "doubts"),
    [
        ({"frames": 35}, ["its end counts 35 frames, and there are 36"]),
        ({"blocks": 3}, ["its end counts 3 blocks, and there are 4"]),
        ({"scans": 1}, ["its end counts 1 scan, and there are 2"]),
        (
            {"scans": 0, "blocks": 2},
            ["its end counts 2 blocks, and there are 4", "its end counts 0 scans, and there are 2"],
        ),
        ({"until": 4_000_000}, ["its end says that it ends at 4.000000 s, and its last frame is of 4.375000 s"]),
        ({"from": 7}, ["its end says that it begins at 0.000007 s, and its first frame is of 0.000000 s"]),
        ({"from": 1}, []), ({"until": 4_375_001}, []), ({"until": 4_374_999}, []),
    ],
)  # fmt: skip
def test_an_end_that_contradicts_what_is_there_is_told_and_kept_with_the_take(tmp_path, whole, changes, doubts):
    """A take of another number of blocks than its end counts is not complete."""
    raw, parts = whole
    begin, end, content = parts[-1]
    (tmp_path / "t.mcap").write_bytes(raw[:begin] + chunk_of({**content, **changes}) + raw[end:])
    take, report = read_with_report(tmp_path / "t.mcap")
    assert (report.doubts, report.is_complete, report.frames) == (tuple(doubts), True, 36)
    assert take.is_complete is ("blocks" not in changes)
    assert take.notes == ({"file": "; ".join(doubts)} if doubts else {})


@pytest.mark.parametrize(("more", "scans"), [(3, 3), (0, 0)])
def test_scans_and_frames_that_an_end_counts_beyond_those_there_are_missing(tmp_path, whole, more, scans):
    raw, parts = whole
    begin, end, content = parts[-1]
    counted = {**content, "scans": content["scans"] + scans, "frames": content["frames"] + more}
    spans = ((4.375, np.inf),) if more else ()
    report_on(
        tmp_path, raw[:begin] + chunk_of(counted) + raw[end:], missing_scans=scans, missing_frames=more, spans=spans
    )


@pytest.mark.parametrize("count", [1, 8, 1000])
def test_bytes_behind_the_end_are_counted(tmp_path, whole, count):
    report_on(tmp_path, whole[0] + bytes(count), trailing_bytes=count)


@pytest.mark.parametrize("cut", [1, 7, 8])
def test_a_take_without_the_last_bytes_of_its_file_has_one_damage(tmp_path, whole, cut):
    """All its messages are there."""
    report_on(tmp_path, whole[0][:-cut], damaged_blocks=1)


def test_blocks_of_another_take_are_counted_beside(tmp_path, whole):
    """It has a header of its own, three of the blocks, and an end."""
    raw, parts = whole
    contents = [content for *_, content in parts]
    header = msgpack.packb({**contents[0], "take_id": "other"})
    of_other = [{**one, "take": binding_of(header)} for one in (contents[2], contents[3], contents[5])]
    begin = parts[-1][0]
    added = chunk_of(header) + b"".join(map(chunk_of, of_other))
    report_on(tmp_path, raw[:begin] + added + raw[begin:], other_blocks=3, other_takes=1)
    report_on(tmp_path, raw[:begin] + chunk_of(header) + raw[begin:], damaged_blocks=1)
    lost = b"".join(map(chunk_of, of_other))
    report_on(tmp_path, raw[:begin] + lost + raw[begin:], damaged_blocks=3)
