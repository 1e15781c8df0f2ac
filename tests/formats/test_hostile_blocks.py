"""Hostile takes whose headers and blocks are made to exhaust memory, or hold impossible values."""

from __future__ import annotations

import numpy as np

from formats.archive import read_with_report
from formats.integers import FEW, decode_tables, encode_tables
from formats.missing import possible_spans
from formats.take_writer import binding_of
from tests.fit.here import hangtime_here
from tests.formats.bombs import among, blocks_of, header_of, parts_of
from tests.formats.damage import chunk_of
from tests.formats.measured import MeasuredReading

POINTS = 246  # so that a row has 1996 numbers


def of_many_points(raw, rows, blocks):
    """A take of 246 points, each of which moves to and fro by one step from frame to frame."""
    points = [{"name": f"p{k}", "at_m": [1e-4 * k, -0.1]} for k in range(POINTS)]
    header = header_of(raw, garment={**parts_of(raw)[0][2]["garment"], "points": points})
    values = np.zeros((rows, 28 + 8 * POINTS), np.int64)
    values[1::2], values[:, 0] = 1, 200 * np.arange(rows)
    block = {**blocks_of(raw)[0], "take": binding_of(header), "frames": rows}
    block["table"] = encode_tables(values, np.array([rows]))[0]
    return (
        raw[: parts_of(raw)[0][0]]
        + chunk_of(header)
        + b"".join(chunk_of({**block, "first": rows * k, "start": k * 10**6}) for k in range(blocks))
    )


def test_blocks_of_a_million_numbers_in_few_bytes_cost_256_mb_at_most(raw, tmp_path):
    """Forty of 700 rows of 1996 numbers, 15 kB of file, cost 333 MB; two of 4096 rows cost 588 MB."""
    path = tmp_path / "a.mcap"
    path.write_bytes(of_many_points(raw, 700, 40))
    with MeasuredReading() as measured:
        cost = measured("take", path)
    assert cost["said"] == (
        f"{path}: needs more memory in each of its 40 blocks than one file may take; keep this file, and record fewer "
        "points or frames a second"
    )
    assert cost["megabytes"] <= 256
    assert cost["seconds"] <= 2


def test_blocks_of_4096_frames_in_which_time_alone_moves_cost_256_mb_and_2_s_at_most(raw, tmp_path):
    """Row by row, 73 of them took 5 s. Four chunks of 16 MB of no use are before them."""
    block, n, columns = blocks_of(raw)[0], 4096, 28 + 8 * 4
    values = np.zeros((n, columns), np.int64)
    values[:, 0] = 200 * np.arange(n)
    still = {**block, "frames": n, "table": encode_tables(values, np.array([n]))[0]}
    junk = [chunk_of({**block, "first": 10**7 + k, "table": bytes((1 << 24) - 200)}) for k in range(4)]
    moves = [chunk_of({**still, "first": 10**4 + n * k, "start": 10**9 + 10**7 * k}) for k in range(200)]
    (tmp_path / "a.mcap").write_bytes(among(raw, b"".join([*junk, *moves])))
    with MeasuredReading() as measured:
        cost = measured("take", tmp_path / "a.mcap")
    assert (cost["said"], cost["frames"]) == ("", 150 + 73 * n)
    assert cost["megabytes"] <= 256
    assert cost["seconds"] <= 2


def test_a_block_with_a_position_beyond_a_kilometre_is_damaged_and_recover_leaves_it_out(raw, tmp_path):
    """Its frames were read, and `recover` then refused to write them."""
    block = blocks_of(raw)[0]
    coded = bytearray(block["table"])
    width = 28 + 8 * 4
    assert len(coded) > 2 * width
    coded[width + 3 * width + 25] = 0x7F  # the highest byte of a point's first value
    path = tmp_path / "a.mcap"
    begin, end, _ = next(
        part for part in parts_of(raw) if part[2].get("first") == block["first"] and "table" in part[2]
    )
    path.write_bytes(raw[:begin] + chunk_of({**block, "table": bytes(coded)}) + raw[end:])
    take, report = read_with_report(path)
    assert (len(take.time), report.damaged_blocks, report.blocks) == (119, 1, 4)
    done = hangtime_here("takes", "recover", "a.mcap", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "a.recovered.mcap: 119 frames, missing: 0.00 to 1.03 s\n")


def test_a_take_that_a_writer_refuses_costs_no_other_take_of_the_file(raw, tmp_path):
    """More than 20,000 missing spans are read, and not written."""
    header = header_of(raw, take_id="gaps", missing=[[100.0 + k, 100.5 + k] for k in range(25_000)])
    moved = chunk_of(header) + chunk_of({**blocks_of(raw)[0], "take": binding_of(header)})
    (tmp_path / "a.mcap").write_bytes(among(raw, moved))
    done = hangtime_here("takes", "recover", "a.mcap", folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout.splitlines()[0] == "a.recovered.mcap: 150 frames, nothing is missing"
    assert "lacks frames in 25001 places; cut the take" in done.stdout.splitlines()[1]


def test_spans_in_which_frames_can_be_missing_begin_before_they_end_and_hold_no_frame():
    time = np.array([0.0, 1.0, 2.0])
    good = [(0.0, 1.0), (-np.inf, 0.0), (2.0, np.inf)]
    bad = [(1.0, 0.0), (0.0, 2.0), (np.nan, 1.0), (3e10, 4e10), (1.0, 1.0)]
    assert possible_spans([*good, *bad], time) == good
    assert possible_spans([], time) == []


def test_few_numbers_in_long_blocks_are_decoded_as_many_are():
    """Column by column, of each order; a block of 3 rows and a constant column among them."""
    rows = np.array([90, 3, 80])
    line = np.arange(rows.sum())
    values = np.stack([line, line**2, 5 + 0 * line, np.round(50 * np.sin(line / 9)).astype(int) + line % 3], 1)
    assert values.shape[1] * len(rows) < FEW
    coded = encode_tables(values, rows)
    found, sound = decode_tables(coded, rows, 4)
    assert sound.all()
    np.testing.assert_array_equal(found, values)
    many, _ = decode_tables(coded * 20, np.tile(rows, 20), 4)
    np.testing.assert_array_equal(many, np.tile(values, (20, 1)))


def test_an_end_that_counts_a_trillion_blocks_is_said_in_one_line(raw, tmp_path):
    end = next(content for _, _, content in parts_of(raw) if "blocks" in content)
    more = chunk_of({**end, "frames": 2**40, "blocks": 2**40, "scans": 2**40})
    begin = next(part for part in parts_of(raw) if "blocks" in part[2])
    (tmp_path / "a.mcap").write_bytes(raw[: begin[0]] + more + raw[begin[1] :])
    done = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout.startswith("damaged     a.mcap: 150 frames in 5 blocks, ")
    assert done.stdout.count("\n") == 1
