"""A line in the middle of a file that ends within a number, though it has an end, is left out or refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.broken_numbers import broken_of
from formats.importers.marker_lines import Rows
from formats.importers.marker_numbers import _warning_of_lines
from formats.importers.number_cells import Form
from formats.importers.number_formats import Writing, writing_of
from tests.formats.test_cut_numbers import DOUBT, TRC, VICON
from tests.formats.test_marker_tables import read

FRAMES, CUT = 150, 70
LINE = CUT + 6  # in a file of Vicon
ODD = "line {}: '{}' of {} lacks the {} digits behind a point{} of its column, so it counts as not seen there"
MANY = "lines {} may be cut off within their last numbers, so the last marker of each counts as not seen"


def places(noise: float = 0.2):
    """Two markers that swing [mm], with the noise of cameras."""
    rng = np.random.default_rng(0)
    swing = 60 * np.sin(np.arange(FRAMES)[:, None] / 8 + np.arange(6))
    return np.array([310, -145, 1205, 410, -145, 1190]) + swing + rng.normal(0, noise, (FRAMES, 6))


def vicon(write, where, scale=1.0):
    return [f"{k + 1},0,{','.join(map(write, row * scale))}" for k, row in enumerate(where)]


def imported(tmp_path, lines, head=VICON):
    return read(tmp_path, head + "".join(f"{line}\n" for line in lines), None, "v.csv")


WRITERS = {
    "%.0f": lambda value: f"{value:.0f}", "%.1f": lambda value: f"{value:.1f}", "%.3f": lambda value: f"{value:.3f}",
    "%g": lambda value: f"{value:g}", "%.6e": lambda value: f"{value:.6e}", "repr": lambda value: repr(float(value)),
}  # fmt: skip


@pytest.mark.parametrize("marker", [0, 1])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_number_in_the_middle_that_is_cut_is_never_read_as_another_one(tmp_path, writer, marker):
    """The number may be the last of a line or of a marker before. What is read is off by the noise at most."""
    where = places()
    lines = vicon(WRITERS[writer], where)
    cells = lines[CUT].split(",")[: 5 + 3 * marker]
    for kept in range(1, len(cells[-1])):
        if cells[-1][kept - 1] in "e+":
            continue  # this is no number, and refused
        broken = ",".join([*cells[:-1], cells[-1][:kept]])
        found = imported(tmp_path, [*lines[:CUT], broken, *lines[CUT + 1 :]])
        left = found.positions[CUT, marker, 2] * 1e3
        assert np.isnan(left) == found.warning.startswith(f"line {LINE}")
        assert np.isnan(left) or abs(left - where[CUT, 2 + 3 * marker]) < 1.5
        assert np.isnan(left) or writer in ("%g", "repr", "%.6e")  # others have all digits
        others = np.delete(found.positions, CUT, 0)
        assert np.isfinite(others).all()


@pytest.mark.parametrize("writer", WRITERS)
def test_lines_whose_empty_cells_are_left_out_are_read_as_they_are(tmp_path, writer):
    for noise in (0.0, 0.2, 2.0):
        where = places(noise)
        lines = vicon(WRITERS[writer], where)
        for k in (0, 5, *range(40, 70), 100, 101, 148):
            lines[k] = ",".join(lines[k].split(",")[:5])
        found = imported(tmp_path, lines)
        assert found.warning == ""
        assert np.isfinite(found.positions[:, 0]).all()


def test_several_lines_are_named(tmp_path):
    lines = vicon(WRITERS["%g"], places())
    for at in (5, 60, 115):
        cells = lines[at].split(",")
        lines[at] = ",".join([*cells[:4], cells[4][:1]])
    found = imported(tmp_path, lines)
    assert found.warning == MANY.format("11, 66, 121")
    assert np.flatnonzero(np.isnan(found.positions[:, 0, 2])).tolist() == [5, 60, 115]
    assert _warning_of_lines([6, 26, 46, 47, 66]) == MANY.format("6, 26, 46 and 2 more")


def test_a_position_that_jumps_is_no_fragment_of_the_one_that_should_be_there(tmp_path):
    """Another marker was taken for it: no number of 1200 begins with 9."""
    lines = vicon(WRITERS["%.0f"], places())
    lines[CUT] = lines[CUT].rpartition(",")[0] + ",9"
    assert imported(tmp_path, lines).warning == "line 76: b jumps 1.2 m away and back, so it counts as not seen there"


@pytest.mark.parametrize("time", ["0.7", "0.70"])
def test_a_time_in_the_middle_that_is_cut_is_refused(tmp_path, time):
    """It is later than that of the line before, and earlier than that of the line behind."""
    lines = [f"{k + 1}\t{k / 99.7:.4f}\t1\t2\t{k}.5\t4\t5\t{k}.25\n" for k in range(FRAMES)]
    assert [line.split()[1] for line in lines[CUT - 1 : CUT + 2]] == ["0.6921", "0.7021", "0.7121"]
    lines[CUT] = f"{CUT + 1}\t{time}\n"
    words = "line 76 ends within a number, after 2 of its 8 cells; the line is cut off"
    with pytest.raises(TakeError, match=re.escape(words)):
        read(tmp_path, TRC.replace("30", str(FRAMES)) + "".join(lines), None, "a.trc")
    lines[CUT] = f"{CUT + 1}\t0.7021\n"
    assert read(tmp_path, TRC.replace("30", str(FRAMES)) + "".join(lines), None, "a.trc").warning == ""


def rows_of(*cells: str) -> Rows:
    return Rows(cells, range(len(cells)), ",", Path("a"))


@pytest.mark.parametrize(
    ("numbers", "form"),
    [
        ([f"{k}.25" for k in range(300)], None),
        ([f"{k}.25" for k in range(97)] + ["1.50", "2.50"], None),
        ([f"{k}.25" for k in range(97)] + ["1.50", "2.50", "3.50"], Form(2, 0)),
        ([f"{k}.25" for k in range(95)] + ["1.50", "2.50", "3.50", "1.5", "2.5"], Form(2, 0)),
        ([f"{k}.25" for k in range(94)] + ["1.50", "2.50", "3.50", "1.5", "2.5", "3"], None),
        ([f"{k}.{k % 10}" for k in range(100)], Form(1, 0)),
        ([f"{k}.0" for k in range(100)], None),
        ([f"{k}.00" for k in range(100)], Form(2, 0)),
        ([f"{k}0" for k in range(100)], None),
        ([f"{k}.{k % 10}e+01" for k in range(100)], Form(1, 3)),
    ],
)
def test_three_numbers_that_end_in_a_zero_show_that_zeros_are_kept_unless_they_are_whole(numbers, form):
    assert writing_of(rows_of(*numbers, "9"), [0]).form == form


def test_the_last_line_and_a_file_without_numbers_give_no_evidence():
    assert writing_of(rows_of("0", "", "-", "1.5"), [0]) == writing_of(rows_of(), [0]) == Writing(9)


def test_numbers_of_few_digits_are_rare_or_common_in_a_file():
    writing = writing_of(rows_of("1.5", "2.5", "1.25", "1.25", "3", "9"), [0])
    assert (writing.most, [writing.share_of(digits) for digits in (0, 1, 2, 3)]) == (2, [0.4, 0.8, 1.0, 1.0])
    assert Writing().share_of(0) == 1.0


@pytest.mark.parametrize(("short", "off", "is_broken"), [(9, 0.9, True), (9, 0.4, False), (99, 0.9, False)])
def test_a_number_is_broken_by_its_odds(short, off, is_broken):
    """Of 1000 numbers, 10 or 100 are whole, and 96 miss their lines by 0.05 at most, those ahead by 0.1.

    F is (10 * 0.01 / 97 / 1e-5)^(1/3) = 4.7, or 10.
    """
    time, path = np.arange(200.0), np.full(200, 5 + off)
    path[100] = 5
    rows, writing = rows_of(*["5"] * 200), Writing(2, shorter=(short, 500, 999))
    assert broken_of(rows, time == 100, time, path, writing, 0.04)[100] == is_broken


def test_a_path_of_two_positions_or_without_increasing_time_gives_no_evidence():
    path, time, ends = np.full(49, 1.25), np.arange(49.0), np.arange(49) == 4
    path[4] = 1
    rows, writing = rows_of(*map("{:g}".format, path)), Writing(2, shorter=(1, 20, 200))
    assert broken_of(rows, ends, time, path, writing).tolist() == ends.tolist()
    assert not broken_of(rows, ends, time * 0, path, writing).any()
    assert not broken_of(rows, ends, np.where(time < 47, np.nan, time), path, writing).any()


def test_a_line_in_quotation_marks_is_checked_by_its_cells(tmp_path):
    lines = [re.sub(r"[^,]+", r'"\g<0>"', line) for line in vicon(WRITERS["%.1f"], places())]
    lines[CUT] = lines[CUT].rpartition(",")[0] + ',"1"'
    assert imported(tmp_path, lines).warning == DOUBT.format(LINE)


def test_positions_that_rest_exactly_are_whole(tmp_path):
    """Held for a second, 1.0 comes a hundred times: the program leaves out zeros."""
    angle = 0.3 * np.sin(5 * np.maximum(np.arange(400) / 100 - 1, 0))
    where = np.stack([0.25 + 0 * angle, np.sin(angle), 1.5 - 0.5 * np.cos(angle)], 1)
    lines = vicon(lambda value: repr(float(value)), np.tile(where, 2))
    found = imported(tmp_path, lines)
    assert (found.warning, np.isfinite(found.positions).all()) == ("", True)


@pytest.mark.parametrize("writer", ["%.14g", "%.15g", "%.4g", "%g"])
@pytest.mark.parametrize("rest", [0, 600])
def test_no_whole_number_of_a_program_that_leaves_out_zeros_is_broken(tmp_path, writer, rest):
    """Places move over 1000 mm, where %.4g writes whole numbers; or they rest for longer than they move."""
    rng, time = np.random.default_rng(1), np.arange(1000)
    moved = 260 * np.sin(time[:, None] / 9 + np.arange(6)) * (time >= rest)[:, None]
    where = np.array([310, -145, 1005, 410, -145, 1090]) + moved + rng.normal(0, 0.05, (1000, 6))
    found = imported(tmp_path, vicon(lambda value: writer % value, where))
    assert (found.warning, np.isfinite(found.positions).all()) == ("", True)


def test_a_number_without_its_power_is_broken_where_all_others_have_one(tmp_path):
    """1.2649 of 1.264990e+03, where the marker rested before."""
    where = places()
    where[:CUT] = where[0]
    lines = vicon(WRITERS["%.6e"], where)
    lines[CUT] = lines[CUT][:-6]
    found = imported(tmp_path, lines)
    assert found.warning == DOUBT.format(LINE)
    assert np.isnan(found.positions[CUT, 1]).all()
