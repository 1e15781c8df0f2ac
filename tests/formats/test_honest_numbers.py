"""Numbers that are shorter than others though nothing cut them are read as they are."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.broken_numbers import writings_of
from tests.formats.test_broken_numbers import CUT, DOUBT, LINE, WRITERS, imported, places, rows_of, vicon
from tests.formats.test_cut_numbers import VICON

FRAMES = 200


def swing(k):
    return 60 * np.sin(k / 9)


def with_last_z(last):
    """Lines of two markers of which the second's z is written otherwise."""
    return [
        f"{k + 1},0,{swing(k) + 310:.3f},{swing(k + 3):.3f},{swing(k + 5) + 1200:.3f},{swing(k) + 410:.3f},"
        f"{swing(k + 7):.3f},{last(k)}"
        for k in range(FRAMES)
    ]


def all_seen(found):
    return found.doubt == "" and bool(np.isfinite(found.positions).all())


@pytest.mark.parametrize(
    "last",
    [lambda _: "0", lambda _: "1500", lambda _: "1500.5",
     lambda k: f"{40 * np.sin(k / 60 * np.pi):.3f}" if k % 60 else "0",
     lambda k: f"{1200 + round(swing(k)) / 2:.1f}", lambda k: f"{1200 + swing(k) / 999:.3f}" if k % 60 else "1200"],
    ids=["plane", "whole", "half", "some zeros", "halves", "some repeated"],
)  # fmt: skip
def test_a_column_may_be_written_in_another_form_than_all_others(tmp_path, last):
    assert all_seen(imported(tmp_path, with_last_z(last)))


def test_one_column_of_eighty_markers_may_hold_one_short_number(tmp_path):
    head = VICON.splitlines()
    head = [*head[:2], ",," + ",,,".join(f"m{k}" for k in range(80)), "Frame,Sub Frame" + ",X,Y,Z" * 80,
            "," + ",mm" * 240]  # fmt: skip
    lines = [
        f"{k + 1},0," + ",".join(f"{v:.3f}" for v in swing(k + np.arange(239)) + 100 * np.arange(239)) + ",1500"
        for k in range(20)
    ]
    assert all_seen(imported(tmp_path, lines, "\n".join(head) + "\n"))


def test_a_column_of_another_form_does_not_hide_a_cut_number_of_the_usual_one(tmp_path):
    lines = [line.replace("300.000", "300.001") for line in with_last_z(lambda _: "0")]
    lines[CUT] = ",".join(lines[CUT].split(",")[:5])[:-1]
    found = imported(tmp_path, lines)
    assert found.doubt == DOUBT.format(LINE)
    assert np.isnan(found.positions[CUT, 0]).all()


def test_a_rest_of_long_numbers_does_not_show_that_zeros_are_kept(tmp_path):
    """Held for 380 of 400 frames, and one number of ten of the swing ends in zero."""
    angle = np.maximum(np.arange(400) - 380, 0)[:, None] / 9
    rng = np.random.default_rng(0)
    where = np.array([310.27, -145.31, 1205.34, 410.11, -145.77, 1190.93]) + rng.uniform(50, 90, 6) * np.sin(angle)
    lines = vicon(lambda value: f"{value:.2f}".rstrip("0").rstrip("."), where)
    assert all_seen(imported(tmp_path, lines))


def test_shorter_numbers_are_counted_by_their_number_and_by_their_kinds():
    """Of 100 kinds and of all at most 2 in 100."""
    kinds = [f"{k}.25" for k in range(100)]
    assert writings_of(rows_of(*kinds, "1.5", "2.5"), [0], [0])[0].always == 2
    assert writings_of(rows_of(*kinds, *["1.5"] * 4), [0], [0])[0].always == 0
    assert writings_of(rows_of(*kinds, *["7.25"] * 90, "1.5", "2.5", "3.5"), [0], [0])[0].always == 0


def test_numbers_of_one_magnitude_do_not_show_that_a_program_keeps_zeros(tmp_path):
    """Six digits in all: 999.123 and, above it for a moment, 1000.12."""
    k = np.arange(FRAMES)[:, None]
    where = np.hstack([300 + swing(k), 500 + swing(k + 3), 1000.2 - 0.06 * (k - 100) ** 2])
    where = np.round(where, 2) + 3e-3
    assert [f"{z:g}" for z in where[98:103, 2]] == ["999.963", "1000.14", "1000.2", "1000.14", "999.963"]
    assert all_seen(imported(tmp_path, vicon(WRITERS["%g"], np.tile(where, 2))))


def test_no_line_misses_a_place_by_less_than_the_noise_of_cameras(tmp_path):
    """A bump of 0.25 mm, beginning with a whole number, in data without noise."""
    where = np.tile([310.5, -145.5, 1205.25, 410.5, -145.5, 1190.25], (FRAMES, 1))
    where[100:103, [2, 5]] -= [[0.25, 0.25]] * 3
    write = "{:g}".format
    assert all_seen(imported(tmp_path, vicon(write, where)))
    where[100:103, [2, 5]] -= [[5, 5]] * 3
    lines = vicon(write, where)
    lines[101] = lines[101][:-1]  # 118 of 1185
    assert imported(tmp_path, lines).doubt == DOUBT.format(107)


def test_a_number_with_a_whole_power_is_whole_and_one_with_a_part_is_broken(tmp_path):
    where = places()
    where[:, 5] = 2 + 0.1 * np.sin(np.arange(len(where)))
    where[CUT, 5] *= 10  # 2.077389e+01, which begins as 2.077389e+00 does
    lines = vicon(WRITERS["%.6e"], where)
    assert all_seen(imported(tmp_path, lines))
    lines[CUT] = lines[CUT][:-1]
    assert imported(tmp_path, lines).doubt == DOUBT.format(LINE)


def quoted(k, markers):
    """A line of numbers with decimal commas between commas, its empty cells at the end left out."""
    numbers = [swing(k + axis) + 300 + 100 * axis for axis in range(3 * markers)]
    return ",".join([f"{k + 1},0", *(f'"{number:.2f}"'.replace(".", ",") for number in numbers)])


@pytest.mark.parametrize("end", ["", ","])
def test_numbers_with_decimal_commas_in_quotation_marks_join_no_cells(tmp_path, end):
    found = imported(tmp_path, [quoted(k, 1 if 40 < k < 45 else 2) + end for k in range(FRAMES)])
    assert (found.doubt, np.isnan(found.positions).any(2).sum(0).tolist()) == ("", [0, 4])
    assert found.positions[0, 0] == pytest.approx([0.3, 0.40665, 0.51322])
