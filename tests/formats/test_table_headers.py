"""Tables of markers are read however options of their program, pandas or R change their header, or refused truly."""

from __future__ import annotations

import pytest

from fit.export.caches import MOTION_HEADS
from formats.errors import ImplausibleError, TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.own_text import EXPECTED_COLUMNS, WITHOUT_IT
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.rows import csv_text
from formats.swatch import swatch
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.formats.test_marker_tables import MOTIVE, read

NAMES = ("one", "two")
FRAMES = [f"{k}.25\t{k}.5\t1200.75\t{k}.125\t7.5\t1100.25".split("\t") for k in range(4)]
HEAD = "NO_OF_FRAMES\t4\nNO_OF_MARKERS\t2\nFREQUENCY\t50\nMARKER_NAMES\tone\ttwo\n"
TITLES = [f"{name} {axis}" for name in NAMES for axis in "XYZ"]
CLOCK = [[str(7 + k), f"{0.12 + k / 50:.5f}"] for k in range(4)]
NUMBERS, TIMES = ([[cells[k]] for cells in CLOCK] for k in range(2))
MM = [f"{name}_{axis}_mm" for name in NAMES for axis in "xyz"]
FIRST = pytest.approx([2.5e-4, 5e-4, 1.20075])


def table(*lines, separator="\t"):
    return "".join(f"{separator.join(line)}\n" for line in lines)


def clocked(frames, clock=CLOCK):
    return [[*when, *cells] for when, cells in zip(clock, frames, strict=True)]


@pytest.mark.parametrize("end", [[], [""]], ids=["", "tab at the end"])
@pytest.mark.parametrize(
    ("titles", "lines", "begin"),
    [
        ([], FRAMES, 0.0), ([TITLES], FRAMES, 0.0), ([["Frame", "Time", *TITLES]], clocked(FRAMES), 0.12),
        ([], clocked(FRAMES), 0.12),
        ([["Frame", *TITLES]], clocked(FRAMES, NUMBERS), 0.14), ([["Time", *TITLES]], clocked(FRAMES, TIMES), 0.12),
        ([["Frame", "Time (s)", *TITLES]], clocked(FRAMES), 0.12), ([["Frame", "", *TITLES]], clocked(FRAMES), 0.12),
        ([], clocked(FRAMES, NUMBERS), 0.14), ([], clocked(FRAMES, TIMES), 0.12),
    ],
    ids=["none", "titles", "both", "clock", "titled numbers", "titled times", "unit", "no title", "numbers", "times"],
)  # fmt: skip
def test_a_table_of_qualisys_is_read_with_and_without_titles_and_clock(tmp_path, titles, lines, begin, end):
    found = read(tmp_path, HEAD + table(*titles, *(line + end for line in lines)), name="a.tsv")
    assert found.time == pytest.approx([begin + k / 50 for k in range(4)])
    assert (found.labels, found.warning, found.has_times) == (NAMES, "", begin == 0.12)  # frame numbers are no times
    assert found.positions[0, 0] == FIRST
    assert found.positions[3, 1] == pytest.approx([3.125e-3, 7.5e-3, 1.10025])


def test_a_line_with_a_cell_too_many_hides_no_clock_of_qualisys(tmp_path):
    lines = clocked(FRAMES)
    with pytest.raises(TakeError, match="line 7 has 9 cells, the header names 8"):
        read(tmp_path, HEAD + table(*lines[:2], [*lines[2], "7.5"], lines[3]), name="a.tsv")


@pytest.mark.parametrize("titles", [[], [TITLES]], ids=["none", "titles"])
@pytest.mark.parametrize("word", ["NULL", "NAN", "NA", "NONE", "", "0.000"])
def test_a_first_frame_that_begins_with_a_gap_is_no_line_of_the_header(tmp_path, word, titles):
    gap = [[word] * 3 + cells[3:] for cells in FRAMES[:2]]
    found = read(tmp_path, HEAD + table(*titles, *gap, *FRAMES[2:]), name="a.tsv")
    assert found.warning == ""
    assert found.positions[:, 0, 0].tolist()[2:] == pytest.approx([2.25e-3, 3.25e-3])
    assert [bool(x != x) for x in found.positions[:, 0, 0]] == [True, True, False, False]


@pytest.mark.parametrize(
    "clock",
    [[["7", f"{k / 25:.3f}"] for k in range(4)], [[str(7 + k), f"{k / 25:.3f}"] for k in range(4)],
     [[f"{k}.5", f"{k / 50:.3f}"] for k in range(4)], [["", ""]] * 4],
    ids=["no count", "another rate", "halves", "empty"],
)  # fmt: skip
def test_two_further_cells_that_are_no_clock_stay_cells_too_many(tmp_path, clock):
    with pytest.raises(TakeError, match="line 5 has 8 cells, the header names 6"):
        read(tmp_path, HEAD + table(*clocked(FRAMES, clock)), name="a.tsv")


def ours(head, lines, separator=","):
    return table(head, *lines, separator=separator)


TIMED = [[f"{k / 50:.2f}", *cells] for k, cells in enumerate(FRAMES)]
NUMBERED = [[str(k), *cells] for k, cells in enumerate(TIMED)]
LEFT_OUT = [[str(k + (k > 1)), *cells] for k, cells in enumerate(TIMED)]


@pytest.mark.parametrize(
    ("head", "lines"),
    [
        (["", "time_s", *MM], NUMBERED), (['""', '"time_s"', *MM], NUMBERED), (["Unnamed: 0", "time_s", *MM], LEFT_OUT),
        (["time_s", *MM], NUMBERED), (['"time_s"', *MM], [[f'"{k + 1}"', *cells] for k, cells in enumerate(TIMED)]),
        (["Time_s", *MM], TIMED), (["time_s", *MM, ""], [[*cells, ""] for cells in TIMED]),
        (["time_s", *MM], [[*cells, ""] for cells in TIMED]), (["time_s", *MM, "", ""], TIMED),
        (["", "time_s", *MM, ""], [[*cells, ""] for cells in NUMBERED]),
        (["time_s", *(one.replace("_x_", "_X_").replace("_y_", "_Y_").replace("_z_", "_Z_") for one in MM)], TIMED),
    ],
    ids=["pandas", "R", "read again", "write.table", "write.table in quotes", "capital", "commas at the end",
         "below it alone", "in the header alone", "numbers and commas", "capital axes"],
)  # fmt: skip
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_our_own_table_is_read_as_pandas_r_and_spreadsheets_write_it(tmp_path, head, lines, separator):
    found = read(tmp_path, ours(head, lines, separator))
    assert found.time.tolist() == [0.0, 0.02, 0.04, 0.06]
    assert (found.labels, found.warning, found.positions[0, 0]) == (NAMES, "", FIRST)
    assert found.positions[3, 1] == pytest.approx([3.125e-3, 7.5e-3, 1.10025])


@pytest.mark.parametrize("axes", ["xyz", "XYZ"])
def test_columns_without_a_unit_need_one_to_be_given(tmp_path, axes):
    text = ours(["time_s", *(f"{name}_{axis}" for name in ("a_x", "two") for axis in axes)], TIMED)
    with pytest.raises(TakeError, match="states no unit of length; give --unit, one of m,"):
        read(tmp_path, text)
    found = read(tmp_path, text, "mm")
    assert (found.labels, found.positions[0, 0]) == (("a_x", "two"), FIRST)


@pytest.mark.parametrize(
    ("head", "lines", "sentence"),
    [
        (["index", "time_s", *MM], NUMBERED, f"column 1 of line 1 is 'index', and time_s is column 2; {WITHOUT_IT}"),
        (["", "time_s", *MM], [["0", *cells] for cells in TIMED],
         f"column 1 of line 1 has no name, and below it are no numbers that count up; {WITHOUT_IT}"),
        (["", "time_s", *MM], [["a", *cells] for cells in TIMED],
         f"column 1 of line 1 has no name, and below it are no numbers that count up; {WITHOUT_IT}"),
        (["time_s", *MM], [["0", *cells] for cells in TIMED], "line 2 has 8 columns, not 7; mend that line"),
        (["time_s", *MM], [*TIMED[:2], NUMBERED[2]], "line 4 has 8 columns, not 7; mend that line"),
        (["time_s", *MM[:3], "two_x", "two_y", "two_z"], TIMED,
         f"column 5 of line 1 is 'two_x', not 'two_x_mm'; the line of names must be {EXPECTED_COLUMNS}"),
        (["time_s", *MM, "force"], [[*cells, "1"] for cells in TIMED],
         f"column 8 of line 1 is 'force', no x of a marker; the line of names must be {EXPECTED_COLUMNS}"),
        (["time_s", "one_X_mm", "one_y_mm", "One_Z_mm"], TIMED,
         f"column 4 of line 1 is 'One_Z_mm', not 'one_Z_mm'; the line of names must be {EXPECTED_COLUMNS}"),
    ],
)  # fmt: skip
def test_a_header_of_ours_that_cannot_be_read_names_its_column(tmp_path, head, lines, sentence):
    with pytest.raises(TakeError) as refused:
        read(tmp_path, ours(head, lines))
    assert str(refused.value).removeprefix(f"{tmp_path}/") == f"a.csv: {sentence}"


def test_rows_that_a_script_left_out_are_no_lost_bytes(tmp_path):
    """30 rows of a table whose numbers lack one: its own times lack a frame as well, as they do without numbers."""
    lines = [[str(k), f"{k / 50:.2f}", *FRAMES[k % 4]] for k in range(31) if k != 9]
    found = read(tmp_path, ours(["", "time_s", *MM], lines))
    assert (found.warning, len(found.time)) == ("", 30)


def test_a_marker_that_motive_computed_from_a_body_is_none_that_cameras_saw(tmp_path):
    garment = swatch(0.05, markers=4)
    names = [f"Body:{name}" for name in garment.point_names[:2]] + list(garment.point_names[2:])
    kinds = ["Rigid Body Marker"] * 2 + ["Marker"] * 14
    head = "\n".join([
        MOTIVE.split("\n")[0], ",Type," + ",".join(kind for kind in kinds for _ in "XYZ"),
        ",Name," + ",".join(name for name in names for _ in "XYZ"), ",," + ",".join(["Position"] * 48),
        "Frame,Time," + ",".join("XYZ" * 16),
    ])  # fmt: skip
    rows = [f"{k},{k / 100}," + ",".join(["1.5"] * 48) for k in range(2)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([head, *rows, ""]))
    export = "export it again with `Markers`, whose positions cameras measured"
    with pytest.raises(TakeError) as refused:
        import_marker_take(path, garment)
    assert str(refused.value) == (
        f"{path}: has {garment.point_names[0]!r} only where Motive expects it by the pose of a body, as Rigid Body "
        f"Marker or Bone Marker; {export}"
    )
    path.write_text("\n".join([head.replace(",Marker", ",Bone Marker"), *rows, ""]))
    with pytest.raises(TakeError) as refused:
        import_marker_take(path, garment)
    assert str(refused.value) == (
        f"{path}: has no Marker, and 16 markers that Motive expects by the pose of a body, first {names[0]!r}; {export}"
    )


@pytest.mark.parametrize(
    ("column", "parts"),
    [
        ("time_ms", 1000), ("t_ms", 1000), ("Time (ms)", 1000), ("TIME [ms]", 1000), ("time_us", 10**6),
        ("Time (\u00b5s)", 10**6), ("t_ns", 10**9), ("t_s", 1), ("Time(s)", 1),
    ],
)  # fmt: skip
@pytest.mark.parametrize("before", ["", "index,"], ids=["first", "behind an index"])
def test_a_table_in_parts_of_a_second_is_read_exactly(tmp_path, column, parts, before):
    ticks = [k * parts // 50 if parts > 1 else k / 50 for k in range(6)]
    head = f"{',' if before else ''}{column},a_x_m,a_y_m,a_z_m\n"
    lines = (f"{f'{k},' if before else ''}{tick},0.1{k},0.2,1.0\n" for k, tick in enumerate(ticks))
    found = read(tmp_path, head + "".join(lines))
    assert found.time.tolist() == [k / 50 for k in range(6)]
    assert found.positions[3, 0].tolist() == [0.13, 0.2, 1.0]


APART = "apart in the median; are these"
ODD = "Give seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate"


@pytest.mark.parametrize(
    ("column", "step", "said"),
    [
        ("time_s", 40, f"its frames are 40 s {APART} milliseconds? Name their column time_ms"),
        ("t_s", 40_000, f"its frames are 40000 s {APART} microseconds? Name their column time_us"),
        ("Time (s)", 4e7, f"its frames are 4e+07 s {APART} nanoseconds? Name their column time_ns"),
        ("time_ms", 40_000, f"its frames are 40 s {APART} microseconds? Name their column time_us"),
        ("time_ms", 0.04, f"its frames are 40 µs {APART} seconds? Name their column time_s"),
        ("time_ns", 40, f"its frames are 0.04 µs {APART} milliseconds? Name their column time_ms"),
        ("time_s", 1, "its frames are 1 s apart in the median; its times are frame numbers, or milliseconds at 1000 "
         f"frames a second; g{ODD[1:]}"),
        ("time_s", 0.5, f"its frames are 0.5 s apart in the median; is its time in seconds? {ODD}"),
        ("time_s", 0.3, "has 3.333 frames a second; a garment needs 5 to 1000; record with more frames a second"),
    ],
)  # fmt: skip
def test_a_table_whose_times_are_in_another_unit_is_told_the_name_of_their_column(tmp_path, column, step, said):
    path = tmp_path / "a.csv"
    write_marker_csv(path, hanging())
    head, *lines = path.read_text().splitlines()
    body = [f"{k * step:.9f},{line.partition(',')[2]}" for k, line in enumerate(lines)]
    path.write_text("\n".join([head.replace("time_s", column, 1), *body, ""]))
    with pytest.raises(ImplausibleError) as refused:
        import_marker_take(path, GARMENT, MarkerOptions())
    assert str(refused.value) == f"{path}: {said}"


def test_a_motion_that_an_export_simulated_is_no_recording(tmp_path):
    path = tmp_path / "swing.motion.csv"
    path.write_text(csv_text(MOTION_HEADS, [(0.0, "a", 0.1, 0.2, 1.3), (0.0, "held_left", 0.1, 0.2, 1.5)]))
    with pytest.raises(TakeError, match=r"holds a motion that `hangtime export` simulated, and no recording; import "):
        read_marker_tracks(path)
