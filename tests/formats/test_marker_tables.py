"""Marker paths by name, at one rate, in text of any kind, and the units and cells of these texts."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import TakeError
from formats.exporters.marker_files import at_one_rate
from formats.importers.marker_text import read_marker_text
from formats.importers.marker_tracks import MarkerTracks
from formats.importers.missing_values import as_seen
from formats.importers.number_cells import number_of
from formats.importers.units import metres_of, other_unit


def tracks(*labels, time=(0.0,)):
    return MarkerTracks(labels, np.asarray(time, float), np.zeros((len(time), len(labels), 3)))


def test_markers_are_found_by_their_whole_name_first_and_then_by_subject():
    found = tracks("a", "John:a", "Jane:a", "John:b", "x:y:b")
    assert found.columns_named("a") == [0]
    assert found.columns_named("a", "John") == [1]
    assert found.columns_named("a", "Jim") == []
    assert found.columns_named("b") == [3, 4]
    assert found.columns_named("b", "x:y") == [4]
    assert found.columns_named("John:b") == [3]
    assert found.columns_named("c") == []
    assert tracks("John:a", "Jane:a").columns_named("a") == [0, 1]


def test_a_marker_at_the_origin_or_without_a_coordinate_was_not_seen():
    places = np.array([[[0.0, 0, 0], [0, 0, 1e-9], [1, np.nan, 1], [1, 1, np.inf], [1, 2, 3]]])
    assert np.isnan(as_seen(places)).all(2).tolist() == [[True, False, True, True, False]]
    absent = np.array([[False, False, False, False, True]])
    assert np.isnan(as_seen(places, absent)).all(2).tolist() == [[True, False, True, True, True]]
    assert as_seen(places)[0, 4].tolist() == [1, 2, 3]


def at(*time):
    return MarkerTracks(("a",), np.array(time), np.arange(3.0 * len(time)).reshape(-1, 1, 3))


def test_frames_of_one_rate_keep_their_numbers_and_gaps():
    rate, places, _ = at_one_rate(at(5.0, 5.02, 5.06, 5.08, 5.1), "t")
    assert rate == pytest.approx(50.0)
    assert np.isnan(places[:, 0, 0]).tolist() == [False, False, True, False, False, False]
    assert places[[0, 1, 3, 4, 5], 0, 0].tolist() == [0, 3, 6, 9, 12]
    rate, places, _ = at_one_rate(at(0.0, 0.25), "t")
    assert (rate, places.shape) == (4.0, (2, 1, 3))


def test_a_rate_is_that_of_all_frames_and_not_of_the_median_step():
    """Stamps in whole milliseconds, 33, 33 and 34 by turns: after a thousand frames the median is 0.3 s off."""
    time = np.round(np.arange(1000) / 30, 3)
    rate, places, _ = at_one_rate(MarkerTracks(("a",), time, np.ones((1000, 1, 3))), "t")
    assert rate == pytest.approx(30.0, rel=1e-5)
    assert places.shape == (1000, 1, 3)
    assert np.isfinite(places).all()


@pytest.mark.parametrize(("off", "is_steady"), [(0.24, True), (0.3, False)])
def test_a_frame_lies_within_a_quarter_of_an_interval_of_its_time(off, is_steady):
    time = np.arange(101) / 50
    time[50] += off / 50
    if is_steady:
        assert at_one_rate(at(*time), "t")[0] == pytest.approx(50.0, rel=1e-3)
        return
    with pytest.raises(TakeError, match=rf"no steady rate \(frame 50 is {1e3 * off / 50:.1f} ms off\)"):
        at_one_rate(at(*time), "t")


def test_numbers_beyond_the_limits_of_c3d_are_refused():
    with pytest.raises(TakeError, match="has one frame, and so no rate"):
        at_one_rate(at(0.0), "t")
    for last, is_held in ((65533, True), (65534, False)):
        many = MarkerTracks(("a",), np.array([0.0, 1, 2, last]), np.ones((4, 1, 3)))
        if is_held:
            assert len(at_one_rate(many, "t")[1]) == 65534
        else:
            with pytest.raises(TakeError, match="has 65535 frames, a C3D file 65534 at most"):
                at_one_rate(many, "t")


@pytest.mark.parametrize(
    ("cell", "number"),
    [("1.5", 1.5), (" -2 ", -2.0), ("+.5e-3", 5e-4), ("1,25", 1.25), ("-1,5E2", -150.0), ("7.", 7.0),
     ("", np.nan), (" NaN ", np.nan), ("-nan(ind)", np.nan), ("1.#QNAN0", np.nan), ("#N/A", np.nan), ("--", np.nan),
     ("-NaN(sNaN)", np.nan),
     ("-1.#IND00", np.nan), ("1.#QNB", np.nan), ("-1.#QO", np.nan), ("1.#R", np.nan), ("1.#SNAN", np.nan),
     ("-1.#IO", np.nan), ("-1.#J", np.nan), ("-1.$", np.nan), ("-1,#IND00", np.nan), ("-1.#IND00E+000", np.nan)],
)  # fmt: skip
def test_a_cell_is_a_number_or_says_that_nothing_was_seen(cell, number):
    assert number_of(cell) == pytest.approx(number, nan_ok=True)


@pytest.mark.parametrize(
    "cell",
    ["1_0", "1e999", "1,2,3", "1.2.3", "inf", "1.#INF", "-1.#INF00", "1.#IO", "1.#J", "1.$", "+1.#IO", "1.#Q", "1.#R0",
     "--1.#QO", "x", "0x10", "1 2", "1,5 m", "٣"],
)  # fmt: skip
def test_a_cell_that_holds_anything_else_is_named(cell):
    with pytest.raises(ValueError, match=r"^'"):
        number_of(cell)
    with pytest.raises(ValueError, match=rf"^'{'x' * 40}', which is no number$"):
        number_of("x" * 60)


def read(tmp_path, text, unit=None, name="a.csv"):
    path = tmp_path / name
    path.write_text(text)
    return read_marker_text(path, unit)


OWN = "time_s,a_x_m,a_y_m,a_z_m,b_x_m,b_y_m,b_z_m\n"


def test_our_own_table_is_read_with_its_gaps_in_any_separator(tmp_path):
    body = "0.5,1,2,3,4,5,6\n0.6,,,,7,8,9\n"
    for text in (OWN + body, (OWN + body).replace(",", ";"), (OWN + body).replace(",", "\t")):
        found = read(tmp_path, text)
        assert found.labels == ("a", "b")
        assert found.time.tolist() == [0.5, 0.6]
        assert found.positions[0].tolist() == [[1, 2, 3], [4, 5, 6]]
        assert np.isnan(found.positions[1, 0]).all()
        assert found.positions[1, 1].tolist() == [7, 8, 9]
        assert found.rate is None
    decimals = read(tmp_path, OWN.replace(",", ";") + "0,5;1,25;2;3;4;5;6\n")
    assert (decimals.time[0], decimals.positions[0, 0, 0]) == (0.5, 1.25)


@pytest.mark.parametrize(
    "titles",
    ["# made by hand\n", "% a;b;c\n# d\te\n", "sep=,\n", 'Swing 3; Monday\n\n"said, quoted"\n', "# t\n" * 99, "# "],
)
def test_titles_and_comments_above_the_header_are_passed_over(tmp_path, titles):
    """Whatever parts their words; and the header may be a comment itself, as NumPy writes it."""
    found = read(tmp_path, titles + OWN + "0.5,1,2,3,4,5,6\n")
    assert found.labels == ("a", "b")
    assert found.positions.tolist() == [[[1, 2, 3], [4, 5, 6]]]


@pytest.mark.parametrize(("name", "kind"), [("a.trc", "TRC"), ("a.tsv", "QTM")])
def test_titles_above_the_files_of_programs_are_passed_over(tmp_path, name, kind):
    text = {"TRC": TRC, "QTM": QTM}[kind]
    alone, titled = read(tmp_path, text, name=name), read(tmp_path, "exported; by\n# me\n" + text, name=name)
    assert titled.labels == alone.labels
    assert np.array_equal(titled.positions, alone.positions, equal_nan=True)


@pytest.mark.parametrize(
    "end", ["\n", "\r", "\x0b", "\x85", *(pytest.param(one, marks=pytest.mark.slow) for one in ("\r\n", "\u2028"))]
)
def test_a_text_of_nothing_but_lines_is_refused_before_it_is_split(tmp_path, end):
    with pytest.raises(TakeError, match="has 5000001 lines"):
        read(tmp_path, OWN + end * 5_000_000)


def test_plain_numbers_are_read_as_all_others_are(tmp_path):
    """The second row has cells that are not plain, so each is read by itself; all hold the same numbers."""
    found = read(tmp_path, OWN + "-1.5,+2,.5, 3e-1 ,4.,1E2,0\n-1.5\t,2.0,0.5,0.3,4,100,0\n")
    commas = read(tmp_path, OWN + '"-1,5","2,0","0,5","0,3",4,100,0\n')
    assert found.time.tolist() == [-1.5, -1.5] == [*commas.time, *commas.time]
    assert found.positions[0].tolist() == found.positions[1].tolist() == commas.positions[0].tolist()
    for cell in ("1e999", "1 2", "1e", "--1", "1.2.3"):
        with pytest.raises(TakeError, match=f"line 2 holds '{cell}', which is no number"):
            read(tmp_path, OWN + f"0,1,2,3,4,5,{cell}\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (OWN + "0,1,2,3,4,5,6\n1,2,3\n", "line 3 has 3 columns, not 7"),
        (OWN + "0,1,2,3,4,5,6\n1,2,3,4,5,6,x\n", "line 3 holds 'x', which is no number"),
        (OWN + "0,1,2,3,4,5,6\n1,2,3", "ends within line 3, after 3 of its 7 cells"),
        (OWN.replace("a_y_m", "a_z_m"), "column 3 of line 1 is 'a_z_m', not 'a_y_m'"),
        ("# a\n" + OWN.replace(",b_z_m", ""), "column 7 of line 2 is missing, not 'b_z_m'"),
        ("# a\n\n# b\n" + OWN + "\n0,1,2,3,4,5,6\n\n1,2,3,4,5,6,x\n", "line 8 holds 'x', which is no number"),
        (OWN + "0,1,2,3,4,5,6\n# pause\n", "line 3 has 1 columns, not 7"),
        ("time_s\n0\n", "names no markers"),
        ("\nTime,x,y,z\n0,1,2,3\n", "line 2 names columns such as 'x', and the file has neither the header of"),
        ("\nTime [s],x,y,z\n0,1,2,3\n", "column 2 of line 2 is 'x', no x of a marker"),
        (";;\n", "no line names the columns; line 1 begins with ''"),
        ("\n\n", "is empty"),
    ],
)
def test_a_table_that_does_not_hold_together_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(TakeError, match=words):
        read(tmp_path, text)


TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t200\t2\t2\tmm\n"
    "Frame#\tTime\tone\t\t\ttwo\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "1\t0.00\t1\t2\t3\t4\t5\t6\n2\t0.01\t7\t8\t9\n"
)


def test_a_trc_file_is_read_in_its_unit_with_its_rate_and_short_lines(tmp_path):
    found = read(tmp_path, TRC, name="a.trc")
    assert (found.labels, found.rate) == (("one", "two"), 100.0)
    assert found.time.tolist() == [0.0, 0.01]
    assert found.positions[0] == pytest.approx(1e-3 * np.array([[1, 2, 3], [4, 5, 6]]))
    assert np.isnan(found.positions[1, 1]).all()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("\t2\t2\tmm", "\t3\t2\tmm", "holds 2 of the 3 frames that it states"),
        ("\t2\t2\tmm", "\t2\t3\tmm", "names 2 markers and states 3"),
        ("\t2\t2\tmm", "\tx\t2\tmm", "its number of frames is 'x', no number"),
        ("\t2\t2\tmm", "\t2\ty\tmm", "its number of markers is 'y', no number"),
        ("\t2\t2\tmm", "\t2\t2\tells", "the unit of its points is 'ells'"),
        ("\t4\t5\t6\n", "\t4\t5\tz\n", "line 6 holds 'z', which is no number"),
    ],
)
def test_a_trc_file_that_contradicts_itself_is_refused(tmp_path, old, new, words):
    with pytest.raises(TakeError, match=words):
        read(tmp_path, TRC.replace(old, new), name="a.trc")


QTM = (
    "NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t2\nFREQUENCY\t50\nMARKER_NAMES\tone\ttwo\n"
    "1\t2\t3\t4\t5\t6\n7\t8\t9\t\t\t\n\t\t\t\t\t\n"
)


def test_a_table_of_qualisys_with_times_needs_no_rate(tmp_path):
    """Where another device triggers each frame, the program writes EXT for the rate."""
    lines = "".join(f"{k + 1}\t{k / 80:.5f}\t1\t2\t3\t4\t5\t{k}\n" for k in range(3))
    text = QTM[: QTM.index("1\t2\t3")].replace("FREQUENCY\t50", "FREQUENCY\tEXT")
    found = read(tmp_path, text + "Frame\tTime\tone X\tone Y\tone Z\ttwo X\ttwo Y\ttwo Z\n" + lines, name="a.tsv")
    assert (found.rate, found.has_times, found.time.tolist()) == (None, True, [0.0, 0.0125, 0.025])
    with pytest.raises(TakeError, match="its frame rate is 'EXT'; export it with its frame rate"):
        read(tmp_path, text + lines, name="a.tsv")


def test_a_table_of_qualisys_has_a_clock_by_its_rate_or_of_its_own(tmp_path):
    found = read(tmp_path, QTM, name="a.tsv")
    assert (found.labels, found.rate) == (("one", "two"), 50.0)
    assert found.time == pytest.approx([0.0, 0.02, 0.04])
    assert found.positions[0] == pytest.approx(1e-3 * np.array([[1, 2, 3], [4, 5, 6]]))
    assert np.isnan(found.positions).all(2).tolist() == [[False, False], [False, True], [True, True]]
    clocked = QTM.replace("\n1\t", "\nFrame\tTime\tone X\n1\t0.5\t1\t").replace("\n7\t", "\n2\t0.6\t7\t")
    clocked = clocked.replace("\n\t\t\t\t\t\n", "\n3\t0.7\n")
    own = read(tmp_path, clocked, name="a.tsv")
    assert own.time.tolist() == [0.5, 0.6, 0.7]
    assert own.positions[0] == pytest.approx(found.positions[0])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("FRAMES\t3", "FRAMES\t4", "holds 3 of the 4 frames"),
        ("MARKERS\t2", "MARKERS\t3", "names 2 markers and states 3"),
        ("FREQUENCY\t50", "FREQUENCY\t0", "its frame rate is '0'"),
        ("FREQUENCY\t50", "FREQUENCY\t10000", "its frame rate is '10000'"),
        ("FREQUENCY\t50", "FREQUENCY\tx", "its frame rate is 'x'"),
        ("FREQUENCY\t50\n", "", "its frame rate is ''"),
    ],
)
def test_a_table_of_qualisys_that_contradicts_itself_is_refused(tmp_path, old, new, words):
    with pytest.raises(TakeError, match=words):
        read(tmp_path, QTM.replace(old, new), name="a.tsv")


VICON = (
    "Devices\n1000\n,,F\n\nTrajectories\n100\n,,who:one,,,who:two,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
    "11,0,1,2,3,4,5,6\n12,0,7,8,9\n\nModel Outputs\n5\n"
)


def test_a_table_of_vicon_counts_time_by_the_numbers_of_its_frames(tmp_path):
    found = read(tmp_path, VICON)
    assert found.labels == ("who:one", "who:two")
    assert found.time == pytest.approx([0.11, 0.12])
    assert found.positions[0] == pytest.approx(1e-3 * np.array([[1, 2, 3], [4, 5, 6]]))
    assert found.positions[1, 0] == pytest.approx([7e-3, 8e-3, 9e-3])
    assert np.isnan(found.positions[1, 1]).all()
    with pytest.raises(TakeError, match="states several units: m, mm"):
        read(tmp_path, VICON.replace("mm,mm,mm\n", "m,m,m\n"))
    with pytest.raises(TakeError, match="ends within the header of its trajectories"):
        read(tmp_path, "Trajectories\n100\n,,one\nFrame,,X,Y,Z\n")


MOTIVE = (
    "Format Version,1.23,Export Frame Rate,120,Total Exported Frames,2,Length Units,Meters\n"
    ",Type,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker\n,Name,bar,bar,bar,one,one,one\n"
    ",,Position,Position,Position,Position,Position,Position\nFrame,Time,X,Y,Z,X,Y,Z\n"
    "0,0.00,9,9,9,1,2,3\n1,0.01,9,9,9,4,5,6\n"
)


def test_a_table_of_motive_gives_its_markers_and_no_rigid_bodies(tmp_path):
    found = read(tmp_path, MOTIVE)
    assert (found.labels, found.rate) == (("one",), 120.0)
    assert found.time.tolist() == [0.0, 0.01]
    assert found.positions[:, 0].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert read(tmp_path, MOTIVE.replace("Export Frame Rate", "Capture Frame Rate")).rate == 120.0
    assert read(tmp_path, MOTIVE.replace("Rate,120", "Rate,-1")).rate is None
    assert read(tmp_path, MOTIVE.replace("Rate,120", "Rate,x")).rate is None
    with pytest.raises(TakeError, match="holds 2 of the 3 frames"):
        read(tmp_path, MOTIVE.replace("Frames,2", "Frames,3"))
    with pytest.raises(TakeError, match="has no rows that name its markers"):
        read(tmp_path, MOTIVE.replace(",Name", ",Title"))
    with pytest.raises(TakeError, match="names no markers"):
        read(tmp_path, MOTIVE.replace("Marker", "Bone"))


@pytest.mark.parametrize(
    ("stated", "metres"),
    [("mm", 1e-3), ("Millimeters", 1e-3), ("(cm)", 1e-2), ("Metres", 1.0), ("inches", 0.0254), ("Feet", 0.3048),
     ("µm", 1e-6), ("micron(s)", 1e-6), ("metre (m)", 1.0), ("millimetres [mm]", 1e-3), ("dm", 0.1), ("mètre", 1.0)],
)  # fmt: skip
def test_units_are_known_however_they_are_spelt(stated, metres):
    assert metres_of(stated, None, "a") == metres
    assert metres_of("", stated, "a") == metres


def test_a_unit_that_is_unknown_lacking_or_contradicted_is_refused():
    for stated, given, words in (
        ("ells", None, "the unit of its points is 'ells'"), ("", None, "states no unit of length"),
        ("mm", "ells", "there is no unit 'ells'"), ("mm", "cm", "states its lengths in mm, not cm"),
        ("metre (mm)", None, r"the unit of its points is 'metre \(mm\)'"),
    ):  # fmt: skip
        with pytest.raises(TakeError, match=words):
            metres_of(stated, given, "a")
    assert metres_of("mm", "millimetre", "a") == 1e-3


@pytest.mark.parametrize(
    ("times", "words"),
    [(1000.0, "millimetres that were taken for metres"), (1e-3, "metres that were taken for millimetres"),
     (10.0, "millimetres that were taken for centimetres"), (25.4, "millimetres that were taken for inches"),
     (39.4, "inches that were taken for metres"), (1210.0, "millimetres that were taken for metres"),
     (0.01, "metres that were taken for centimetres")],
)  # fmt: skip
def test_lengths_that_are_so_many_times_too_long_were_read_in_another_unit(times, words):
    assert other_unit(times) == f"; are these {words}?"


@pytest.mark.parametrize("times", [1.0, 1.2, 0.0, -3.0, 1230.0, 5.0])
def test_lengths_of_no_other_unit_ask_nothing(times):
    assert other_unit(times) == ""
