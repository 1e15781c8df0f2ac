"""Reading a marker file takes little more memory than its text and positions, and splitting it loses nothing."""

from __future__ import annotations

import time

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers import text_lines
from formats.importers.text_lines import read_text_lines
from tests.formats.measured import MeasuredReading
from tests.formats.test_marker_tables import OWN, VICON, read

FRAMES, MARKERS = 400, 1000


def test_a_large_text_costs_its_length_and_its_positions_and_a_gap_costs_no_time(tmp_path):
    """11 MB of text and 10 MB of positions. All lines at once take 39 MB, each row with a gap took 12 ms."""
    path = tmp_path / "a.csv"
    names = ",".join(f"m{k}{axis}" for k in range(MARKERS) for axis in ("_x_m", "_y_m", "_z_m"))
    line = ",".join(["0.123456,0.234567,1.345678"] * (MARKERS - 1) + [",,"])
    few = tmp_path / "few.csv"
    for file, frames in ((few, 4), (path, FRAMES)):
        file.write_text(f"time_s,{names}\n" + "".join(f"{k / 100},{line}\n" for k in range(frames)))
    places = 8 * 3 * FRAMES * MARKERS
    with MeasuredReading() as reading:
        cost = reading("markers", path, after=few)
    assert cost["said"] == ""
    # A piece of text, its lines and the parser's tables take the rest: of 24 to 28 MB in all, 5 to 8.
    assert cost["megabytes"] < (path.stat().st_size + places) / 2**20 + 12
    assert cost["seconds"] < 2  # 0.7 s on a slow core; with the gap read cell by cell 5 s


@pytest.mark.parametrize("piece", [1, 2, 3, 7, 64])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\x0b"])
def test_lines_are_the_same_wherever_pieces_end(tmp_path, monkeypatch, piece, encoding, end):
    monkeypatch.setattr(text_lines, "PIECE_BYTES", piece)
    if encoding == "cp1252" and end == "\x0b":
        return  # such a byte shows that a file is none of Windows' texts
    lines = ["Rücken 1", "", "µm,1,2", "x" * 40, "", "end"]
    (tmp_path / "a.txt").write_bytes(end.join(lines).encode(encoding))
    found = read_text_lines(tmp_path / "a.txt")
    assert (list(found), found[-1], list(found[1:3]), found.is_cut) == (lines, "end", ["", "µm,1,2"], True)
    (tmp_path / "a.txt").write_bytes(end.join([*lines, ""]).encode(encoding))
    assert list(read_text_lines(tmp_path / "a.txt")) == lines
    assert list(found.at([4, 0])) == ["", "Rücken 1"]


def test_a_file_of_zeros_is_empty_and_ctrl_z_ends_a_text(tmp_path):
    (tmp_path / "a.csv").write_bytes(bytes(999))
    assert not read_text_lines(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_bytes(b"a\nb\n" + b"\x1a" * 100)
    assert list(read_text_lines(tmp_path / "a.csv")) == ["a", "b"]


@pytest.mark.parametrize("row", ["0,5,1,25,2,5,3,5,4,5,5,5,6,5", "0,5,1,2,3,4,5,6", "0,5,1,2,3,4,,,"])
def test_a_comma_that_separates_cells_and_decimals_is_named_with_the_remedy(tmp_path, row):
    words = r"line 2 has \d+ cells, not 7, none with a decimal point; where commas are decimal separators too, export"
    with pytest.raises(TakeError, match=words):
        read(tmp_path, OWN + row + "\n")
    with pytest.raises(TakeError, match=r"line 10 has 15 cells, not 8, none with a decimal point"):
        read(tmp_path, VICON.replace("11,0,1,2,3,4,5,6", "11,0," + "1,5," * 6))


@pytest.mark.parametrize(
    "row", ['0,"1,2",3,4,5,6', '0,1,2,"3,4,5",6', '"0,1",2,3,4,5,6', '0,1,2,3,4,"5,6"', '0,"1,2,3"']
)
def test_two_quotation_marks_that_join_cells_are_named_and_no_number_is_shifted(tmp_path, row):
    """Nexus leaves out cells at the end of a line, so that a line with joined cells looked like one with gaps."""
    with pytest.raises(TakeError, match=r"line 2 has \d cells, not 7: quotation marks join some of them; take the"):
        read(tmp_path, OWN + row + "\n")
    with pytest.raises(TakeError, match="line 10 has 7 cells, not 8: quotation marks join some of them"):
        read(tmp_path, VICON.replace("11,0,1,2,3,4,5,6", '11,0,1,"2,3",4,5,6'))


def test_decimal_commas_in_quotation_marks_are_read(tmp_path):
    found = read(tmp_path, OWN + '"0,5","1,25",2,"3,5",4,5,"6,0"\n')
    assert found.time.tolist() == [0.5]
    assert found.positions.tolist() == [[[1.25, 2, 3.5], [4, 5, 6]]]
    assert np.isfinite(found.positions).all()


def test_many_parts_of_short_lines_are_cut_once(tmp_path):
    """Each part cut the whole piece again: these took 10 s. Now they take 0.2 s, or 1 s with every call counted."""
    (tmp_path / "a.csv").write_text("0.5,1,2,3\n" * 20_000)
    lines = read_text_lines(tmp_path / "a.csv")
    begin = time.process_time()
    assert [lines[k : k + 1][0] for k in range(len(lines))] == ["0.5,1,2,3"] * 20_000
    assert time.process_time() - begin < 4
