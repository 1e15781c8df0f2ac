"""Bytes that are lost within the lines of a text leave numbers of other digits, or join two lines."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.lost_lines import remove_joined_lines
from formats.importers.marker_text import read_marker_text
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from tests.formats.test_broken_numbers import WRITERS, imported, places, vicon
from tests.formats.test_cut_numbers import TRC
from tests.formats.test_marker_tables import read

AT = 60
HOLE = "{} missing behind line {}"
JOINED = f"{HOLE}, so its markers count as not seen"
NO_DIGITS = "line 66: {!r} of a lacks the 3 digits behind a point of its column, so it counts as not seen there"


def with_cell(lines, change, column=4):
    cells = lines[AT].split(",")
    cells[column] = change(cells[column])
    return [*lines[:AT], ",".join(cells), *lines[AT + 1 :]], cells[column]


def unseen(found):
    return np.argwhere(np.isnan(found.positions).any(2)).tolist()


@pytest.mark.parametrize("change", [lambda cell: cell[:-1], lambda cell: cell + "7", lambda cell: cell[:-4]])
@pytest.mark.parametrize("column", [2, 4])
def test_a_number_of_other_digits_than_its_column_has_is_no_position(tmp_path, change, column):
    lines, cell = with_cell(vicon(WRITERS["%.3f"], places()), change, column)
    found = imported(tmp_path, lines)
    assert (found.warning, unseen(found)) == (NO_DIGITS.format(cell), [[AT, 0]])


def test_several_numbers_are_counted_also_in_lines_whose_empty_cells_are_left_out(tmp_path):
    lines = [
        line if k % 3 else ",".join(line.split(",")[:5]) for k, line in enumerate(vicon("{:.3f}".format, places()))
    ]
    lines, first = with_cell(lines, lambda cell: cell[:-2], 3)
    lines[AT + 4] = ",".join([*lines[AT + 4].split(",")[:5], "410.5", *lines[AT + 4].split(",")[6:]])
    found = imported(tmp_path, lines)
    told = (
        f"2 numbers have other than the 3 digits of their columns, so their markers count as not seen there: {first!r}"
    )
    assert found.warning == f"{told} of a in line 66, '410.5' of b in line 70"
    assert np.isnan(found.positions[[AT, AT + 4], [0, 1]]).all()


@pytest.mark.parametrize("writer", ["%.0f", "%g", "%.6e", "repr"])
def test_programs_that_leave_out_zeros_write_other_digits(tmp_path, writer):
    found = imported(tmp_path, vicon(WRITERS[writer], places()))
    assert (found.warning, unseen(found)) == ("", [])


@pytest.mark.parametrize("value", ["0", "nan", "-", " 1205.340 ", "1205"])
def test_words_spaces_and_numbers_that_a_column_repeats_are_no_odd_numbers(tmp_path, value):
    lines = vicon(WRITERS["%.3f"], places())
    for k in (10, 60, 110):
        lines[k] = ",".join([*lines[k].split(",")[:4], value, *lines[k].split(",")[5:]])
    found = imported(tmp_path, lines)
    assert "digits" not in found.warning


def test_two_joined_lines_show_by_the_frames_that_are_missing(tmp_path):
    """From within a's z of one line to within that of another one, as a lost block leaves it."""
    lines = vicon(WRITERS["%.3f"], places())
    begin, end = lines[AT].split(","), lines[AT + 10].split(",")
    joined = ",".join([*begin[:4], begin[4][:1] + end[4][1:], *end[5:]])
    found = imported(tmp_path, [*lines[:AT], joined, *lines[AT + 11 :]])
    assert (found.warning, unseen(found)) == (JOINED.format("frames 62 to 71 are", 66), [[AT, 0], [AT, 1]])


@pytest.mark.parametrize("lost", [1, 2, 10])
def test_a_joined_line_is_left_out_or_as_near_its_path_as_noise_and_motion_are(tmp_path, lost):
    """The markers swing by up to 7.5 mm a frame, and a straight line misses them by up to 1.7 mm."""
    lines = vicon(WRITERS["%.3f"], places())
    whole = imported(tmp_path, lines).positions
    told = 0
    for column in range(2, 8):
        begin, end = lines[AT].split(","), lines[AT + lost].split(",")
        joined = ",".join([*begin[:column], *end[column:]])
        found = imported(tmp_path, [*lines[:AT], joined, *lines[AT + lost + 1 :]])
        off = np.abs(found.positions[AT] - whole[AT]).max()
        told += np.isnan(off)
        assert np.isnan(off) or off < 3.4e-3, column
    assert told >= 4


def test_a_whole_line_before_missing_frames_keeps_its_positions(tmp_path):
    lines = vicon(WRITERS["%.3f"], places())
    whole = imported(tmp_path, lines).positions
    for at in (2, 30, AT, 140):
        found = imported(tmp_path, [*lines[: at + 1], *lines[at + 2 :]])
        assert (found.warning, unseen(found)) == (HOLE.format(f"frame {at + 2} is", at + 6), [])
        assert (found.positions == np.delete(whole, at + 1, 0)).all()


@pytest.mark.parametrize("name", ["a.csv", "a.trc"])
def test_a_pause_in_the_times_keeps_every_position(tmp_path, name):
    """Two seconds are missing behind the 60th frame, and a marker is hidden just before."""
    where, time = places().reshape(-1, 2, 3) * 1e-3, np.arange(150) / 100 + 2.0 * (np.arange(150) >= AT)
    where[AT - 3 : AT - 1, 0] = np.nan
    if name == "a.csv":
        write_marker_csv(tmp_path / name, MarkerTracks(("a", "b"), time, where))
    else:
        rows = [f"{k + 1}\t{t:.3f}\t" + "\t".join(map("{:.5f}".format, row)) for k, (t, row) in
                enumerate(zip(time, where.reshape(-1, 6) * 1e3, strict=True))]  # fmt: skip
        head = TRC.replace("\t30\t", "\t150\t")
        (tmp_path / name).write_text(head + "".join(f"{row}\n" for row in rows).replace("nan", ""))
    found = read_marker_text(tmp_path / name, None)
    assert found.warning == HOLE.format("2 s are", 61 if name == "a.csv" else 65)
    np.testing.assert_allclose(found.positions, where, atol=1e-6)
    np.testing.assert_allclose(found.time, time, atol=1e-6)


@pytest.mark.parametrize(("lost", "is_reported"), [(1, False), (2, True), (10, True)])
def test_times_without_numbers_of_frames_show_two_and_more(tmp_path, lost, is_reported):
    cells = [line.split(",", 2)[2] for line in vicon("{:.4f}".format, places(), 1e-3)]
    lines = [f"{k / 100:.2f},{row}" for k, row in enumerate(cells)]
    head = "time_s," + ",".join(f"{name}_{axis}_m" for name in "ab" for axis in "xyz") + "\n"
    text = head + "\n".join([*lines[:AT], *lines[AT + lost :]]) + "\n"
    found = read(tmp_path, text, None, "own.csv")
    assert found.warning == (HOLE.format(f"{lost / 100:.3g} s are", 61) if is_reported else "")
    assert unseen(found) == []


def own_table(times, where):
    """Hangtime's CSV of two markers; `where` [mm], (lines, 6)."""
    head = "time_s," + ",".join(f"{name}_{axis}_mm" for name in "ab" for axis in "xyz") + "\n"
    lines = [",".join([time, *map("{:.4f}".format, row)]) for time, row in zip(times, where, strict=True)]
    return head + "\n".join(lines).replace("nan", "") + "\n"


@pytest.mark.parametrize("digits", [3, 6])
@pytest.mark.parametrize("at", [30, AT, AT + 5, 146])
@pytest.mark.parametrize("rate", [59.94, 99.7, 200.0])
def test_a_line_lost_before_a_stretch_of_empty_ones_shows_by_the_times(tmp_path, digits, at, rate):
    """Nothing was seen for ten frames from the 61st on, whose lines are there."""
    where, kept = places(), np.arange(150) != at
    where[AT : AT + 10] = np.nan
    times = [f"{k / rate:.{digits}f}" for k in range(150)]
    lines = [time for time, is_kept in zip(times, kept, strict=True) if is_kept]
    found = read(tmp_path, own_table(lines, where[kept]), None, "own.csv")
    told = re.fullmatch(HOLE.format(r"(0\.\d+) s are", at + 1), found.warning)
    assert told is not None, found.warning
    assert float(told[1]) == pytest.approx(1 / rate, abs=1.1e-3)
    np.testing.assert_allclose(found.positions, where[kept].reshape(-1, 2, 3) / 1000, atol=1e-7)


@pytest.mark.parametrize("digits", [2, 3])
def test_late_stamps_and_rounded_times_are_no_lost_lines(tmp_path, digits):
    late = np.arange(150) / 99.7 + 0.007 * (np.arange(150) == AT)
    found = read(tmp_path, own_table([f"{t:.{digits}f}" for t in late], places()), None, "own.csv")
    assert (found.warning, unseen(found)) == ("", [])


def test_intervals_of_random_lengths_hardly_ever_show_a_lost_line():
    """A live camera's intervals spread by 30 %, and the longest are nearly two. They add up, as behind a loss."""
    told = 0
    for seed in range(100):
        steps = 1 + 0.3 * np.random.default_rng(seed).standard_normal(60).clip(-2, 2)
        time = np.round(np.cumsum(steps) / 9, 4)
        told += remove_joined_lines(time, time, np.zeros((60, 1, 3)), str) != ""
    assert told <= 5


def test_pauses_beside_numbers_that_go_on_hide_no_lost_line(tmp_path):
    """Four pauses, more than are named, and frame 11 missing."""
    time = np.arange(150) / 100 + 0.05 * (np.arange(150)[:, None] >= [20, 30, 40, 50]).sum(1)
    rows = [f"{k + 1}\t{t:.3f}\t" + "\t".join(map("{:.3f}".format, row)) for k, (t, row) in
            enumerate(zip(time, places(), strict=True)) if k != 10]  # fmt: skip
    found = read(tmp_path, TRC.replace("\t30\t", "\t149\t") + "\n".join(rows) + "\n", None, "a.trc")
    assert found.warning == HOLE.format("frame 11 is", 15)


def test_programs_that_leave_out_frames_at_many_times_lost_no_bytes(tmp_path):
    lines = vicon(WRITERS["%.3f"], places())
    found = imported(tmp_path, [line for k, line in enumerate(lines) if k % 20 != 7])
    assert (found.warning, unseen(found)) == ("", [])


def test_a_line_without_a_clock_begins_with_a_position_and_not_with_the_number_of_a_frame(tmp_path):
    head = "NO_OF_FRAMES\t30\nNO_OF_MARKERS\t1\nFREQUENCY\t100\nMARKER_NAMES\ta\n"
    rows = "".join(f"{k + 9 * (k > 20)}\t200\t{k}\n" for k in range(30))
    found = read(tmp_path, head + rows, None, "a.tsv")
    assert (found.warning, unseen(found)) == ("", [])


@pytest.mark.parametrize(
    ("others", "told"),
    [
        ([], ""), ([70], "; 1 further line cannot be read either: 76"),
        ([70, 80, 61, 149], "; 4 further lines cannot be read either: 67, 76, 86 and 1 more"), (range(150), ""),
    ],
)  # fmt: skip
def test_a_refusal_counts_the_further_lines_that_cannot_be_read(tmp_path, others, told):
    """Some lack a comma between numbers, and some have one too many. Where most are so, it is the file's form."""
    lines = vicon(WRITERS["%.3f"], places())
    for k in [AT, *others]:
        lines[k] = lines[k].replace(",", "", 1) if k == 70 else lines[k].replace(".", "..", 1)
    first = min([AT, *others]) if others == range(150) else AT
    with pytest.raises(TakeError) as refused:
        imported(tmp_path, lines)
    cell = lines[first].split(",")[2]
    what = f"line {first + 6} holds {cell!r}, which is no number{told}; mend that line"
    assert str(refused.value) == f"{tmp_path}/v.csv: {what}"


def test_more_than_a_hundred_further_lines_are_not_counted(tmp_path):
    lines = vicon(WRITERS["%.1f"], np.tile(places(), (3, 1)))
    for k in range(0, 450, 4):
        lines[k] = lines[k].replace(".", "..", 1)
    with pytest.raises(TakeError, match="number; more than 100 further lines cannot be read either: 10, 14, 18 and 98"):
        imported(tmp_path, lines)
