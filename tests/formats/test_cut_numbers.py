"""Cut numbers, and lines that end a table early, are refused or left out; undamaged lines are read."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_lines import Rows
from formats.importers.marker_numbers import Table, read_frames
from tests.formats.test_marker_tables import read

HEAD = "time_s,a_x_m,a_y_m,a_z_m,b_x_m,b_y_m,b_z_m\n"
TRC = (
    "PathFileType\t4\t(X/Y/Z)\tf.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t30\t2\tmm\n"
    "Frame#\tTime\ta\t\t\tb\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
)
VICON = "Trajectories\n100\n,,a,,,b,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
FRAMES = [f"{k + 1},0,1.5,2.5,3.5,4.5,5.5,{k}.25\n" for k in range(30)]


DOUBT = "line {} may be cut off within its last number, so its last marker counts as not seen there"


def own(frames: int = 30) -> str:
    """A file of 5 digits behind each point, and of more than 44 different numbers."""
    rows = [f"{k / 100:.3f},{0.1 + k / 1e5:.5f},{0.2 + k / 1e5:.5f},0.33333" for k in range(frames)]
    return HEAD + "".join(f"{row},0.44444,0.55555,-1.23456\n" for row in rows)


@pytest.mark.parametrize("lost", range(2, 9))
def test_a_last_number_that_is_cut_is_refused(tmp_path, lost):
    with pytest.raises(TakeError, match="line 31 ends within a number, after 7 of its 7 cells"):
        read(tmp_path, own()[:-lost], "m", "own.csv")


def test_a_last_line_without_an_end_is_read(tmp_path):
    assert read(tmp_path, own()[:-1], "m", "own.csv").positions[-1, 1, 2] == -1.23456
    assert read(tmp_path, own()[:-1], "m", "own.csv").warning == ""


@pytest.mark.parametrize("number", [2.5, 2.25, 2.0, 2.123456789, 2e-05, 200])
def test_a_last_number_that_nothing_proves_whole_is_left_out_and_the_file_says_so(tmp_path, number):
    """No form is that of all: 0.125 beside 0.25, and 2 may be the rest of 2e-05."""
    text = HEAD + "".join(f"{k},{k / 64:g},1.25,1.25,1.25,1.25,{k / 8:g}\n" for k in range(24))
    whole = read(tmp_path, text + f"24,0.5,1.25,1.25,1.25,1.25,{number:g}\n", "m", "own.csv")
    found = read(tmp_path, text + f"24,0.5,1.25,1.25,1.25,1.25,{number:g}", "m", "own.csv")
    assert (found.warning, len(found.time)) == (DOUBT.format(26), 25)
    assert np.isnan(found.positions[-1, 1]).all()
    assert np.array_equal(found.positions[:, 0], whole.positions[:, 0])
    assert np.array_equal(found.positions[:-1, 1], whole.positions[:-1, 1])


@pytest.mark.parametrize("last", ["1.525e-0", "1.525", "1.5", "1"])
def test_a_number_of_which_a_power_is_cut_is_never_read(tmp_path, last):
    """`1.525e-05` without its last letter is 10^5 times as large. Some numbers of its column have no power."""
    rows = [f"{k / 100!r},1.5,{k / 64!r},1.25,1.5,1.25,{1.5e-05 + k / 1e5!r}\n" for k in range(30)]
    assert ["e-05" in row for row in (rows[0], rows[-1])] == [True, False]
    found = read(tmp_path, HEAD + "".join(rows) + "0.3,1.5,0.5,1.25,1.5,1.25," + last, "m", "own.csv")
    assert np.isnan(found.positions[-1, 1]).all()
    assert found.warning == DOUBT.format(32)


def test_a_last_line_that_lacks_the_separator_of_all_others_is_no_proof(tmp_path):
    """A line that has its end may have been given one by an editor: 12 is the rest of 1234."""
    rows = [f"{k}\t{k / 100}\t998\t{990 + k}\t5\t999\t998\t{1200 + k}\t\n" for k in range(30)]
    assert read(tmp_path, TRC + "".join(rows), None, "a.trc").positions[-1, 1, 2] == pytest.approx(1.229)
    for end in ("", "\n"):
        found = read(tmp_path, TRC + "".join(rows)[:-4] + end, None, "a.trc")
        assert np.isnan(found.positions[-1, 1]).all()
        assert found.warning == DOUBT.format(35)


@pytest.mark.parametrize("last", ["998.", "998.125e+0"])
def test_a_sign_of_a_cut_before_an_end_that_came_later_is_refused(tmp_path, last):
    rows = [f"{k}\t{k / 100}\t1.{k}5\t2.5\t3.125\t4.5\t1.5e+01\t998.{k}\n" for k in range(29)]
    with pytest.raises(TakeError, match="line 35 ends within a number, after 8 of its 8 cells"):
        read(tmp_path, TRC + "".join(rows) + f"29\t0.29\t1.5\t2.5\t3.125\t4.5\t1.5e+01\t{last}\n", None, "a.trc")


@pytest.mark.parametrize("lost", range(2, 8))
def test_a_cut_line_of_fixed_digits_that_was_given_an_end_is_refused(tmp_path, lost):
    with pytest.raises(TakeError, match="line 31 ends within a number, after 7 of its 7 cells"):
        read(tmp_path, own()[:-lost] + "\n", "m", "own.csv")


@pytest.mark.parametrize(("last", "is_read"), [("998.5", True), ("998", True), ("99", False), ("9", False)])
def test_a_short_number_off_its_path_is_left_out_of_a_line_with_its_end(tmp_path, last, is_read):
    """Zeros at the end are left out here, so nothing but the path, which leads to 998.906 mm, shows the cut."""
    rows = [f"{k}\t{k / 100:g}\t1.{k}5\t2.5\t3.125\t4.5\t5.5\t{998 + k / 32:g}\n" for k in range(29)]
    found = read(tmp_path, TRC + "".join(rows) + f"29\t0.29\t1.5\t2.5\t3.125\t4.5\t5.5\t{last}\n", None, "a.trc")
    assert np.isfinite(found.positions[-1, 1]).all() == is_read
    assert found.warning == ("" if is_read else DOUBT.format(35))


def test_a_line_with_its_end_that_ends_within_a_marker_is_refused(tmp_path):
    rows = [f"{k}\t{k / 100}\t1.25\t2.25\t3.25\t4.5\t5.5\t6.5\n" for k in range(30)]
    for last, cells in (("4.5", 6), ("4.5\t5", 7)):
        with pytest.raises(TakeError, match=f"line 35 ends within a marker, after {cells} of its 8 cells; .* cut off"):
            read(tmp_path, TRC + "".join(rows[:-1]) + f"29\t0.29\t1.25\t2.25\t3.25\t{last}\n", None, "a.trc")


@pytest.mark.parametrize("gap", ["0", "0.000"])
def test_a_marker_that_comes_back_in_a_last_line_that_is_cut_is_left_out(tmp_path, gap):
    """It was a gap written as 0 in all lines before, so the other positions show how many digits there are."""
    rows = [f"{k}\t{k / 100}\t1.{k:02d}5\t2.125\t3.125\t{gap}\t{gap}\t{gap}\n" for k in range(29)]
    last = "29\t0.29\t1.295\t2.125\t3.125\t998.125\t1020.125\t1249.881"
    assert read(tmp_path, TRC + "".join(rows) + last, None, "a.trc").positions[-1, 1, 2] == pytest.approx(1.249881)
    cut = read(tmp_path, TRC + "".join(rows) + last[:-6], None, "a.trc")
    assert np.isnan(cut.positions[-1, 1]).all()
    assert cut.warning == DOUBT.format(35)


def test_empty_cells_behind_whole_numbers_are_no_decimal_commas(tmp_path):
    lines = [f"{k + 1},0,1.5,2.5,{k}.25,\n" for k in range(29)] + ["30,0,0,0,0,\n"]
    one = VICON.replace(",,a,,,b,,", ",,a,,").replace("X,Y,Z,X,Y,Z", "X,Y,Z").replace("mm,mm,mm,mm,mm,mm", "mm,mm,mm")
    assert len(read(tmp_path, one + "".join(lines), None, "v.csv").time) == 30


def test_whole_numbers_before_a_last_comma_are_no_decimals_unless_three_cells_are_empty(tmp_path):
    """Of 1,5,2,5,3,5,, the last cells may be a marker that was not seen, and the others one at 1.5, 2.5, 3.5."""
    one = VICON.replace(",,a,,,b,,", ",,a,,").replace("X,Y,Z,X,Y,Z", "X,Y,Z").replace("mm,mm,mm,mm,mm,mm", "mm,mm,mm")
    lines = [f"{k + 1},0,1,2,{k + 3},\n" for k in range(29)] + ["30,0,,,,\n"]
    assert read(tmp_path, one + "".join(lines), None, "v.csv").positions[28, 0, 2] == pytest.approx(0.031)
    with pytest.raises(TakeError, match="line 6 has 9 cells, not 8, none with a decimal point"):
        read(tmp_path, VICON + "1,0,1,5,2,,,,\n" * 30, None, "v.csv")


@pytest.mark.parametrize("gap", [range(40), range(60, 100), range(20, 95)])
def test_a_long_gap_with_one_separator_too_many_holds_no_decimal_commas(tmp_path, gap):
    """No line within 32 of some of these frames shows a number."""
    seen = [f"{k + 1},0," + (",,,,,," if k in gap else f"1.5,2.5,3.5,4.5,5.5,{k}.25,") for k in range(100)]
    found = read(tmp_path, VICON + "\n".join([*seen, ""]), None, "v.csv")
    assert np.flatnonzero(np.isnan(found.positions).any((1, 2))).tolist() == list(gap)


def test_vicon_without_its_column_of_sub_frames_keeps_its_first_marker(tmp_path):
    text = re.sub(r"(?m)^(Frame|\d+|),(Sub Frame|0|),", r"\1,", VICON + "".join(FRAMES))
    assert "Frame,X,Y,Z,X,Y,Z\n" in text
    found, whole = (read(tmp_path, one, None, "v.csv") for one in (text, VICON + "".join(FRAMES)))
    assert found.labels == whole.labels == ("a", "b")
    assert np.array_equal(found.positions, whole.positions)
    lines = text.splitlines(keepends=True)
    for line, words in (("# a note\n", "begins with '# a note', and frames follow"), ("x,1.5,2,3\n", "holds 'x'")):
        with pytest.raises(TakeError, match=f"line 16 {words}"):
            read(tmp_path, "".join([*lines[:15], line, *lines[15:]]), None, "v.csv")
    other = "\nModel Outputs\n100,Hz\n,c\nFrame,X,Y,Z\n,mm,mm,mm\n1,2.5,3,4\n"
    assert len(read(tmp_path, text + other, None, "v.csv").time) == 30


def test_a_minute_of_devices_may_stand_above_the_trajectories_of_vicon(tmp_path):
    devices = "Devices\n2000\n" + "1,0,0.5\n" * 120_000
    assert len(read(tmp_path, devices + "\n" + VICON + "".join(FRAMES), None, "v.csv").time) == 30


def test_a_trc_without_its_line_of_axes_keeps_its_first_frame(tmp_path):
    head = TRC.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", "")
    rows = "".join(f"{k + 1}\t{k / 100}\t1\t2\t3\t4\t5\t6\n" for k in range(30))
    found = read(tmp_path, head + rows, None, "a.trc")
    assert (len(found.time), found.time[0]) == (30, 0.0)


def test_a_number_of_two_signs_is_reported_as_it_is_written(tmp_path):
    with pytest.raises(TakeError, match=r"holds '1,234\.5', which is no number"):
        read(tmp_path, TRC + "1\t0.01\t998\t1,234.5\t12345\t999\t998\t1\n" * 30, None, "a.trc")


@pytest.mark.parametrize("last", ["3.5", "nan"])
def test_a_line_without_its_last_cells_may_end_in_fewer_digits(tmp_path, last):
    """The lines before show that this program writes no zeros at the end, or a word is no number at all."""
    rows = [f"{k}\t{k / 100}\t1.{k}5\t2.5\t3.125\t4.5\t5.5\t6.5\n" for k in range(29)]
    found = read(tmp_path, TRC + "".join(rows) + f"30\t0.29\t1.25\t2.25\t{last}\n", None, "a.trc")
    assert np.isnan(found.positions[-1, 1]).all()
    assert found.positions.shape == (30, 2, 3)


@pytest.mark.parametrize(
    "line", ["# a note\n", "# a note,,,,,,,\n", ",,1,2,3,4,5,6\n", "".join(VICON.splitlines(keepends=True)[2:])]
)
def test_a_line_among_the_frames_of_vicon_does_not_end_them(tmp_path, line):
    with pytest.raises(TakeError, match=r"line 21 begins with .*, and frames follow it"):
        read(tmp_path, VICON + "".join(FRAMES[:15]) + line + "".join(FRAMES[15:]), None, "v.csv")


@pytest.mark.parametrize("title", ["Model Outputs", "Model Outputs,,,,,,,"])
def test_another_section_of_vicon_ends_the_frames(tmp_path, title):
    other = f"\n{title}\n" + VICON.partition("\n")[2] + "".join(FRAMES[:5])
    assert len(read(tmp_path, VICON + "".join(FRAMES) + other, None, "v.csv").time) == 30
    assert len(read(tmp_path, VICON + "".join(FRAMES) + "made by hand\n\n", None, "v.csv").time) == 30
    with_unit = re.sub(r"\n(\d+)[^\n]*", r"\n\1,Hz", other.lstrip("\n"), count=1)
    assert len(read(tmp_path, VICON + "".join(FRAMES) + with_unit, None, "v.csv").time) == 30


@pytest.mark.parametrize(("time", "place"), [("0.01", "1,002"), ("0,01", "1.002")])
def test_the_other_sign_in_whole_numbers_beside_times_separates_thousands(tmp_path, time, place):
    """998 and 999 mm in the same lines show that 1,002 is no number below 2."""
    rows = [f"{k}\t{time}{k:02d}\t998\t{place}\t5\t999\t998\t1\n" for k in range(30)]
    found = read(tmp_path, TRC + "".join(rows), None, "a.trc")
    assert found.positions[:, 0] == pytest.approx(np.tile([0.998, 1.002, 0.005], (30, 1)), abs=1e-12)


@pytest.mark.parametrize(("time", "place"), [("0.01", "1,002"), ("0,01", "1.002")])
def test_points_and_commas_in_one_line_are_refused(tmp_path, time, place):
    """No whole number below 1000 shows which of them is the decimal separator."""
    with pytest.raises(
        TakeError, match=r"line 6 holds '.*,.*' beside '.*\..*': which of them is the decimal separator\?"
    ):
        read(tmp_path, TRC + (f"1\t{time}" + f"\t{place}" * 6 + "\n") * 30, None, "a.trc")


def test_whole_numbers_beside_empty_cells_need_no_decimal_sign(tmp_path):
    rows = [f"{k}\t{k}\t998\t\t5\t999\t998\t1\n" for k in range(30)]
    assert len(read(tmp_path, TRC + "".join(rows), None, "a.trc").time) == 30


@pytest.mark.parametrize(("most", "one"), [("1.5", "1,234"), ("1,5", "1.234")])
def test_points_and_commas_in_lines_of_one_file_are_refused(tmp_path, most, one):
    rows = [f"{k}\t{k}\t998\t{most}\t5\t999\t998\t1\n" for k in range(29)] + [f"29\t29\t998\t{one}\t5\t999\t998\t1\n"]
    with pytest.raises(
        TakeError, match=r"line 35 holds '.*,.*' beside '.*[.].*': which of them is the decimal separator"
    ):
        read(tmp_path, TRC + "".join(rows), None, "a.trc")


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\x85", "\u2028"])
def test_any_end_of_a_line_ends_the_last_one(tmp_path, end):
    rows = [f"{k}\t{k / 100}\t1.25\t2.25\t3.25\t4.5\t5.5\t6.5\n" for k in range(29)]
    text = TRC + "".join(rows) + "30\t0.29\t1.25\t2.25\t3.25\n"
    assert np.isnan(read(tmp_path, text.replace("\n", end), None, "a.trc").positions[-1, 1]).all()


@pytest.mark.parametrize("decimals", [1, 2, 3])
def test_files_whose_zeros_are_left_out_are_read_with_and_without_a_last_end(tmp_path, decimals):
    """Whole numbers, columns of 0, exponents and lines whose last cells are left out: none of them is cut."""
    rng = np.random.default_rng(decimals)
    for turn in range(40):
        rows = []
        for k in range(30):
            places = [f"{value:.{3 + decimals}g}" for value in rng.normal(0, 300, 2)] + ["0"]
            rows.append("\t".join([str(k + 1), f"{k / 100:g}", *places]) + "\n")
        text = TRC + "".join(rows)
        found = read(tmp_path, text if turn % 2 else text[:-1] + "\t\t\t", None, "a.trc")
        assert found.positions.shape == (30, 2, 3)
    gaps = own().replace("0.44444,0.55555,-1.23456", "-,-,-")
    assert np.isnan(read(tmp_path, gaps[:-1], "m", "own.csv").positions[:, 1]).all()


@pytest.mark.parametrize(("shorter", "is_cut"), [(1, True), (2, False)])
def test_a_column_of_shorter_numbers_does_not_show_a_cut(tmp_path, shorter, is_cut):
    """A spreadsheet rounded it on its own, where two of the five lines that are examined are shorter."""
    lines = own(40).splitlines(keepends=True)
    for at in range(1, 1 + 8 * shorter):
        lines[at] = lines[at].replace("-1.23456", "-1.25")
    text = "".join(lines)[:-6]
    if is_cut:
        with pytest.raises(
            TakeError, match="line 41 ends within a number, after 7 of its 7 cells; the line is cut off"
        ):
            read(tmp_path, text, "m", "own.csv")
    else:
        assert read(tmp_path, text, "m", "own.csv").warning == DOUBT.format(41)


@pytest.mark.parametrize(("last", "is_read"), [("0", True), ("-0", True), ("1.5", True), ("5", False), ("-5", False)])
def test_a_last_number_without_an_end_is_read_where_its_path_leads_there(tmp_path, last, is_read):
    """To within 2 mm of 0.5 mm, by a line or a parabola."""
    rows = [f"{k}\t{k / 100:g}\t1.{k}5\t2.5\t3.125\t4.5\t5.5\t{0.5 + (29 - k) ** 2 / 4:g}\n" for k in range(29)]
    found = read(tmp_path, TRC + "".join(rows) + f"29\t0.29\t1.5\t2.5\t3.125\t4.5\t5.5\t{last}", None, "a.trc")
    assert np.isfinite(found.positions[-1, 1]).all() == is_read
    assert found.warning == ("" if is_read else DOUBT.format(35))


def test_a_table_of_more_numbers_than_any_is_refused_before_it_is_read(tmp_path):
    rows = Rows(["x"] * 33, range(33), ",", tmp_path / "a.csv")
    table = Table(1 << 20, [], [], 1.0, lambda first: first[:, 0], is_exact=True)
    with pytest.raises(TakeError) as refused:
        read_frames(rows, table, tmp_path / "a.csv")
    words = "holds 33 frames of 1048576 numbers; export fewer markers or frames"
    assert str(refused.value) == f"{tmp_path}/a.csv: {words}"
    with pytest.raises(TakeError, match="line 0 has 1 columns, not 1048576"):
        read_frames(rows[:32], table, tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("wide", "cut", "message"),
    [
        ("{:.6e}", 1, "ends within a number"),  # 2.027006e+0
        ("{:.6e}", 2, "which is no number"),
        ("{:.6e}", 4, "ends within a number"),  # 2.027006
        ("{:.3f}", 4, "ends within a number"),  # no point
    ],
)
def test_a_cut_number_is_detected_in_every_format(tmp_path, wide, cut, message):
    """In some columns a marker was not seen, and written as 0."""
    rng = np.random.default_rng(3)
    rows = []
    for k in range(30):
        cells = [wide.format(float(value)) for value in rng.uniform(200, 2000, 6)]
        if k % 5 == 0:
            cells[3:] = ["0"] * 3
        rows.append(",".join([f"{k / 100}", *cells]) + "\n")
    whole = HEAD.replace("_m", "_mm") + "".join(rows[1:])
    assert read(tmp_path, whole[:-1], None, "own.csv").positions.shape == (29, 2, 3)
    with pytest.raises(TakeError, match=message):
        read(tmp_path, whole[: -1 - cut], None, "own.csv")


def test_a_file_that_ends_behind_its_last_separator_is_cut(tmp_path):
    whole = own()[:-1]
    with pytest.raises(TakeError, match="ends within line 31, before its last number; the file is cut off"):
        read(tmp_path, whole.removesuffix("-1.23456"), "m", "own.csv")
    unseen = read(tmp_path, whole.rpartition("0.44444")[0] + ",,", "m", "own.csv")
    assert np.isnan(unseen.positions[-1, 1]).all()
    motion = TRC + "".join(f"{k}\t{k / 100}\t1.25\t2.25\t3.25\t4.5\t5.5\t6.5\t\n" for k in range(30))  # ends in a tab
    assert read(tmp_path, motion[:-1], None, "a.trc").positions.shape == (30, 2, 3)


@pytest.mark.parametrize("gap", ["-", "0", "-9999", "nan"])
def test_three_cells_of_one_text_at_the_end_are_a_marker_that_was_not_seen(tmp_path, gap):
    found = read(tmp_path, own().rpartition("0.44444")[0] + ",".join([gap] * 3), "m", "own.csv")
    assert found.positions[-1, 0, 2] == 0.33333
