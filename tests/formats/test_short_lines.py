"""A line that a cut left shorter than the others, and that was given an end later, is refused or warned of."""

from __future__ import annotations

import numpy as np
import pytest

from formats.descriptions import dump_description
from formats.errors import TakeError
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_cut_numbers import DOUBT, TRC, VICON
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.formats.test_marker_tables import read

WHOLE = [f"{k + 1}\t{k / 100:.2f}\t1.25\t2.25\t3.{k:02d}\t4.5\t5.5\t6.{k:02d}" for k in range(30)]
SEEN = [line.rpartition("\t6")[0].rpartition("\t4")[0] for line in WHOLE]  # the second marker is left out
EMPTY = [f"{line}\t\t\t" for line in SEEN]
SHORT = "line {} may be cut off after {} of its 8 cells, so the markers from the last one on count as not seen there"
LATER = "and its time is not later than that of the line before; the line is cut off: copy or export the file again"


def trc(tmp_path, *lines):
    return read(tmp_path, TRC + "".join(f"{line}\n" for line in lines), None, "a.trc")


@pytest.mark.parametrize(("last", "cells"), [("30", 1), ("30\t", 2), ("30\t0.", 2), ("30\t0.2", 2), ("3", 1)])
def test_a_line_that_ends_within_its_time_is_refused_by_its_number(tmp_path, last, cells):
    with pytest.raises(TakeError, match=f"line 35 ends after {cells} of its 8 cells, {LATER}$"):
        trc(tmp_path, *WHOLE[:29], last)


def test_a_number_of_a_frame_that_is_cut_is_refused(tmp_path):
    """Of Vicon's 130, a cut leaves 13."""
    lines = [f"{k + 101},0,1.5,2.5,3.5,4.5,5.5,{k}.25\n" for k in range(29)]
    with pytest.raises(TakeError, match=f"line 35 ends after 1 of its 8 cells, {LATER}$"):
        read(tmp_path, VICON + "".join(lines) + "13\n", None, "v.csv")
    found = read(tmp_path, VICON + "".join(lines) + "130\n", None, "v.csv")
    assert (found.warning, len(found.time)) == (SHORT.format(35, 1), 30)


@pytest.mark.parametrize("last", ["30\t0.29", "30\t0.29\t", WHOLE[29].rpartition("\t4")[0], f"{SEEN[29]}\t"])
def test_a_last_line_that_alone_is_short_is_read_and_warned_of(tmp_path, last):
    for others in (WHOLE[:29], EMPTY[:29], [f"{line}\t" for line in WHOLE[:29]]):
        found = trc(tmp_path, *others, last)
        assert len(found.time) == 30
        is_seen = last.endswith("2.25\t3.29\t")  # nothing but a separator shows that a number is whole
        assert np.isfinite(found.positions[-1]).tolist() == [[is_seen] * 3, [False] * 3]
        assert found.warning == SHORT.format(35, last.count("\t") + 1)


def test_a_last_line_of_a_section_behind_which_another_one_follows_was_not_cut(tmp_path):
    lines = [f"{k + 1},0,1.5,2.5,3.5{',4.5,5.5,6.5' * (k < 27)}\n" for k in range(29)]
    for behind, doubt in (("", SHORT.format(35, 2)), ("\nModel Outputs\n100\n", "")):
        assert read(tmp_path, f"{VICON}{''.join(lines)}30,0\n{behind}", None, "v.csv").warning == doubt
        doubt = doubt.replace("after 2", "after 6")
        assert read(tmp_path, f"{VICON}{''.join(lines)}30,0,1.5,2.5,3.5,\n{behind}", None, "v.csv").warning == doubt


def test_a_line_in_between_is_a_gap_of_a_program_that_leaves_cells_out(tmp_path):
    """A cut loses all that follows, and a single frame without a marker is the commonest gap."""
    assert trc(tmp_path, *WHOLE[:9], "10\t0.09", *WHOLE[10:]).warning == ""
    assert trc(tmp_path, *WHOLE[:9], SEEN[9], *WHOLE[10:]).warning == ""
    assert trc(tmp_path, "1\t0.00", *WHOLE[1:]).warning == ""
    assert trc(tmp_path, *WHOLE[:9], "10\t0.09", *WHOLE[10:20], *SEEN[20:]).warning == ""
    lines = [f"{k + 1},0,1.5,2.5,3.5,4.5,5.5,6.5\n" for k in range(3)]
    assert read(tmp_path, f"{VICON}{''.join(lines)}4,0\n", None, "v.csv").warning == SHORT.format(9, 2)
    assert read(tmp_path, f"{VICON}{''.join(lines[:2])}4,0\n", None, "v.csv").warning == ""


@pytest.mark.parametrize(
    "lines",
    [
        SEEN, [*WHOLE[:20], *SEEN[20:]], [*SEEN[:20], *WHOLE[20:]], [*EMPTY[:10], *SEEN[10:]],
        [*WHOLE[:10], "11\t0.10", *WHOLE[11:29], "30\t0.29"], [f"{line}\t" for line in SEEN], EMPTY,

    ],
)  # fmt: skip
def test_files_whose_programs_leave_out_empty_cells_are_read_without_a_warning(tmp_path, lines):
    found = trc(tmp_path, *lines)
    assert (found.warning, len(found.time)) == ("", len(lines))


def test_a_last_line_that_alone_ends_behind_a_separator_is_warned_of(tmp_path):
    """Others are as short, since cells are left out there, and none has an empty last cell."""
    assert trc(tmp_path, *WHOLE[:10], *SEEN[10:29], f"{SEEN[29]}\t").warning == SHORT.format(35, 6)
    two = f"{SEEN[28]}\t", f"{SEEN[29]}\t"
    assert trc(tmp_path, *WHOLE[:10], *SEEN[10:28], *two).warning == ""


@pytest.mark.parametrize("last", ["1.25", "1.25\t", "1.25\t2.25", "1.25\t2.25\t"])
def test_a_marker_that_is_begun_and_not_ended_is_refused(tmp_path, last):
    begun = f"30\t0.29\t{last}"
    cells = begun.count("\t") + 1
    if cells < 5:
        with pytest.raises(TakeError, match=f"line 35 ends within a marker, after {cells} of its 8 cells"):
            trc(tmp_path, *WHOLE[:29], begun)
    else:
        assert trc(tmp_path, *WHOLE[:29], begun).warning == DOUBT.format(35)


@pytest.mark.parametrize("last", ["4.5\t5.5\t", "4.5\t5.5\t-"])
def test_a_whole_line_of_which_the_last_number_is_missing_is_warned_of(tmp_path, last):
    found = trc(tmp_path, *WHOLE[:29], f"{SEEN[29]}\t{last}")
    assert np.isnan(found.positions[-1, 1]).all()
    assert found.warning == DOUBT.format(35)
    for gap in ("\t\t", "-\t-\t-", "NaN\tNaN\tNaN", "0\t0\t"):
        assert trc(tmp_path, *WHOLE[:29], f"{SEEN[29]}\t{gap}").warning == ""


def test_an_import_warns_and_a_wrong_time_names_its_frame_and_no_column(tmp_path):
    path = write_marker_csv(tmp_path / "m.csv", hanging())
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:8], lines[7], *lines[9:]]) + "\n")
    done = hangtime_here("import", "m.csv", "--garment", "g.toml", folder=tmp_path)
    assert done.stderr == (
        "hangtime: m.csv: its time does not increase from frame to frame, first at frame 8; mend the times, or the "
        "numbers of the frames\n"
    )


TRIMMED = [  # of 3 digits each, some of which are zeros; the second marker was not seen at the end
    f"{k + 1},0,{310 + k}.125,{9 * k}.250,12{k:02d}.514" + f",{410 + k}.125,{7 * k}.502,11{k:02d}.753" * (k < 37)
    for k in range(40)
]


@pytest.mark.parametrize(
    ("last", "doubt"),
    [
        (TRIMMED[-1] + "\n", ""),
        (TRIMMED[-1], "line 45 has no end and may be cut off after 5 of its 8 cells, so the markers behind count as "
         "not seen there"),
    ],
    ids=["end", "no end"],
)  # fmt: skip
def test_a_last_line_without_end_may_leave_out_cells_as_others_do(tmp_path, last, doubt):
    found = read(tmp_path, VICON + "".join(f"{line}\n" for line in TRIMMED[:-1]) + last)
    assert (len(found.time), found.warning) == (40, doubt)
    assert np.isfinite(found.positions[:, 0]).all()
    assert np.isfinite(found.positions[:, 1]).all(1).tolist() == [k < 37 for k in range(40)]


@pytest.mark.parametrize(
    "last", [TRIMMED[-1], TRIMMED[-1][:-2], TRIMMED[-1].rpartition(",")[0], "40,0", "40"],
    ids=["whole others", "number", "marker", "clock", "number of the frame"],
)  # fmt: skip
def test_a_last_line_without_end_among_whole_ones_or_within_a_marker_is_refused(tmp_path, last):
    others = TRIMMED[:37] if last == TRIMMED[-1] else TRIMMED[:-1]
    text = VICON + "".join(f"{line}\n" for line in others) + last
    with pytest.raises(TakeError, match="ends within"):
        read(tmp_path, text)
