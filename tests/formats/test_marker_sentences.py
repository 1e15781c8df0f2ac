"""What is wrong with a text file of markers, and what to do about it, word for word."""

from __future__ import annotations

import pytest

from formats.errors import TakeError
from formats.importers.marker_lines import CAN_BE_READ
from formats.importers.own_text import EXPECTED_COLUMNS
from tests.formats.test_marker_tables import MOTIVE, OWN, QTM, TRC, VICON, read

MEND = "mend that line"
AGAIN = "export it again"
MEND_UNIT = "mend the unit that the file states"
CUT = "the file is cut off: copy or export the file again"
FEWER = "the file is cut off, or that number is wrong: copy or export the file again"
UNITS = "m, dm, cm, mm, um, in, ft"
RATE = "export it with its frame rate"
NO_COLUMNS = "TRC, Vicon, Motive and Qualisys exports are read as they are"
FIRST = "0,1,2,3,4,5,6\n"
ONE = "0,1.5,2,3,4,5,6\n"


@pytest.mark.parametrize(
    ("text", "unit", "sentence"),
    [
        (OWN + FIRST + "1,2,3\n", None, f"line 3 has 3 columns, not 7; {MEND}"),
        (OWN + FIRST + "1,2,3,4,5,6\n", None, f"line 3 has 6 columns, not 7; {MEND}"),
        (OWN + ONE + "1,2.5,3,4,5,6,7,8\n", None, f"line 3 has 8 columns, not 7; {MEND}"),
        (OWN + FIRST + "1,2,3,4,5,6,x\n", None, f"line 3 holds 'x', which is no number; {MEND}"),
        (OWN + FIRST + "1,2,3", None, f"ends within line 3, after 3 of its 7 cells; {CUT}"),
        (OWN.replace("a_y_m", "a_z_m"), None,
         f"column 3 of line 1 is 'a_z_m', not 'a_y_m'; the line of names must be {EXPECTED_COLUMNS}"),
        ("# a\n" + OWN.replace(",b_z_m", ""), None,
         f"column 7 of line 2 is missing, not 'b_z_m'; the line of names must be {EXPECTED_COLUMNS}"),
        ("time_s\n0\n", None, "names no markers; export the trajectories with their names"),
        ("\nTime,x,y,z\n0,1,2,3\n", None,
         "line 2 names columns such as 'x', and the file has neither the header of a known program nor a column "
         f"time_s; export it again with its header, or name the columns {EXPECTED_COLUMNS}"),
        (OWN.replace("time_s", "time"), None,
         "column 1 of line 1 is 'time', no time with its unit; name it time_s, or time_ms, time_us or time_ns"),
        (OWN.replace("time_s", "Zeit (ms)"), None,
         "column 1 of line 1 is 'Zeit (ms)', no time with its unit; name it time_s, or time_ms, time_us or time_ns"),
        (f"{'x' * 50},1,2\n", None, f"no line names the columns; line 1 begins with '{'x' * 40}'; put above the frames "
         f"{EXPECTED_COLUMNS}; {NO_COLUMNS}"),
        (OWN + "0,1,2,3,4,5,6,7\n", None, "line 2 has 8 cells, not 7, none with a decimal point; where commas "
         "are decimal separators too, export decimal points, or semicolons between cells"),
        (OWN + '0,1,"2,3",4,5,6\n', None,
         "line 2 has 6 cells, not 7: quotation marks join some of them; take the quotation marks out of that line"),
        (OWN + FIRST, "mm", "states its lengths in m, not mm: its 1000 is 1000 m, and would be 1 m; leave out --unit, "
         f"or {MEND_UNIT}"),
        ("", None, f"is empty; {AGAIN}; {CAN_BE_READ}"),
        (TRC.replace("\t2\t2\tmm", "\t3\t2\tmm"), None, f"holds 2 of the 3 frames that it states; {FEWER}"),
        (TRC.replace("\t2\t2\tmm", "\t2\t3\tmm"), None, f"names 2 markers and states 3; {AGAIN}"),
        (TRC.replace("\t2\t2\tmm", "\tx\t2\tmm"), None, f"its number of frames is 'x', no number; {AGAIN}"),
        (TRC.replace("\t2\t2\tmm", "\t2\ty\tmm"), None, f"its number of markers is 'y', no number; {AGAIN}"),
        (TRC.replace("\t2\t2\tmm", "\t2\t2\tells"), None,
         f"the unit of its points is 'ells'; give --unit, one of {UNITS}"),
        (TRC.replace("\t2\t2\tmm", "\t2\t2\t"), None, f"states no unit of length; give --unit, one of {UNITS}"),
        (TRC.replace("\t4\t5\t6\n", "\t4\t5\tz\n"), None, f"line 6 holds 'z', which is no number; {MEND}"),
        (TRC.replace("\t5\t6\n", "\t5\t6\t7.5\n"), None, "line 6 has 9 cells, the header names 8; the header lacks "
         f"markers, or the line has cells too many: {AGAIN}"),
        ("\n".join(TRC.split("\n")[:4]), None, f"ends within its header; {AGAIN}; {CAN_BE_READ}"),
        (QTM.replace("FRAMES\t3", "FRAMES\t4"), None, f"holds 3 of the 4 frames that it states; {FEWER}"),
        (QTM.replace("MARKERS\t2", "MARKERS\t3"), None, f"names 2 markers and states 3; {AGAIN}"),
        (QTM.replace("MARKERS\t2", "MARKERS\tx"), None, f"its number of markers is 'x', no number; {AGAIN}"),
        (QTM.replace("FRAMES\t3", "FRAMES\tx"), None, f"its number of frames is 'x', no number; {AGAIN}"),
        (QTM.replace("FREQUENCY\t50", "FREQUENCY\t0"), None, f"its frame rate is '0'; {RATE}"),
        (QTM.replace("FREQUENCY\t50", "FREQUENCY\t10000"), None,
         f"its frame rate is '10000'; 5 to 1000 can be used; {RATE}"),
        (QTM.replace("FREQUENCY\t50", "FREQUENCY\tx"), None, f"its frame rate is 'x'; {RATE}"),
        (QTM.replace("FREQUENCY\t50\n", ""), None, f"its frame rate is ''; {RATE}"),
        (QTM.replace("NO_OF_MARKERS", "DATA_INCLUDED\t6D\nNO_OF_BODIES").replace("MARKER_NAMES", "BODY_NAMES"), None,
         "its DATA_INCLUDED is '6D', and it names no markers; export the 3D data, with the trajectories of markers"),
        (TRC.replace("\t", "  "), None, "line 1 is that of a TRC file, whose cells must be between tabs; export it "
         "again, or write a tab in place of the spaces between cells"),
        (QTM, "cm", "states its lengths in mm, not cm: its 1000 is 1 m, and would be 10 m; leave out --unit, or "
         f"{MEND_UNIT}"),
        (VICON.replace(",,mm,mm", ",,m,mm"), None, "states several units: m, mm; export in one"),
        (VICON.replace("Trajectories\n100", "Trajectories\n0"), None, f"its frame rate is '0'; {RATE}"),
        (VICON[: VICON.index("Trajectories") + 16], None, f"ends within the header of its trajectories; {AGAIN}"),
        (VICON.replace("\n12,", "\nx,"), None, f"line 11 holds 'x', which is no number; {MEND}"),
        (VICON.replace("\n12,", "\npause\n12,"), None,
         "line 11 begins with 'pause', and frames follow it; mend its number or take it out; "
         "where it begins another section, put its frame rate below it"),
        (VICON + VICON[VICON.index("Trajectories") :], None, "has trajectories twice, in lines 5 and 15; export one "
         "section of trajectories, or put the second into a file of its own"),
        (MOTIVE.replace("Frames,2", "Frames,3"), None, f"holds 2 of the 3 frames that it states; {FEWER}"),
        (MOTIVE.replace("Frames,2", "Frames,x"), None, f"its number of frames is 'x', no number; {AGAIN}"),
        (MOTIVE.replace("Name", "Nome"), None, "has no rows that name its markers; export it with its header"),
        (MOTIVE.replace("Type", "Kind"), None, "has no rows that name its markers; export it with its header"),
        (MOTIVE.replace("Frame,", "Bild,"), None, "has no rows that name its markers; export it with its header"),
        (MOTIVE.replace("Marker,", "Bone,"), None, "names no markers; export the trajectories with their names"),
    ],
)  # fmt: skip
def test_a_file_of_markers_that_does_not_hold_together_is_refused(tmp_path, text, unit, sentence):
    with pytest.raises(TakeError) as refused:
        read(tmp_path, text, unit)
    assert str(refused.value).removeprefix(f"{tmp_path}/") == f"a.csv: {sentence}"


def test_a_unit_that_nobody_knows_is_the_options_fault(tmp_path):
    with pytest.raises(TakeError) as refused:
        read(tmp_path, OWN + FIRST, "ells")
    assert str(refused.value) == f"--unit: there is no unit 'ells'; give one of {UNITS}"


@pytest.mark.parametrize(
    ("text", "doubt"),
    [
        (TRC.replace("\t2\t2\tmm", "\t1\t2\tmm"), "the file states 1 frame and holds 2; all of them were read"),
        (QTM.replace("FRAMES\t3", "FRAMES\t2").replace("\t\t\t\t\t\n", "1\t2\t3\t4\t5\t6\n"),
         "the file states 2 frames and holds 3; all of them were read"),
        (MOTIVE.replace("Frames,2", "Frames,1"), "the file states 1 frame and holds 2; all of them were read"),
        (TRC, ""), (QTM, ""), (MOTIVE, ""), (MOTIVE.replace("Frames,2", "Frames,"), ""), (VICON, ""),
    ],
)  # fmt: skip
def test_a_file_of_more_frames_than_it_states_is_read_whole_with_a_doubt(tmp_path, text, doubt):
    assert read(tmp_path, text).warning == doubt


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        (TRC, 100.0), (TRC.replace("\n100\t", "\n0\t"), None), (TRC.replace("\n100\t", "\nx\t"), None),
        (TRC.replace("\n100\t", "\n0.5\t"), 0.5), (QTM, 50.0), (QTM.replace("\t50", "\t9999.5"), 9999.5),
        (MOTIVE, 120.0),
        (MOTIVE.replace("Export Frame Rate,120", "Capture Frame Rate,60"), 60.0),
        (MOTIVE.replace("Rate,120", "Rate,120,Capture Frame Rate,60"), 120.0), (OWN + FIRST, None), (VICON, None),
    ],
)  # fmt: skip
def test_a_rate_beside_the_times_is_the_one_that_the_file_states(tmp_path, text, rate):
    assert read(tmp_path, text).rate == rate
