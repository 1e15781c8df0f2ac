"""Numbers that are shorter than others though nothing cut them are read as they are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.formats.test_broken_numbers import CUT, DOUBT, LINE, ODD, WRITERS, imported, places, vicon
from tests.formats.test_cut_numbers import VICON

FRAMES = 200


def swing(k):
    return 60 * np.sin(k / 9)


def with_last_z(last):
    """Lines of two markers with another number format for the second marker's z."""
    return [
        f"{k + 1},0,{swing(k) + 310:.3f},{swing(k + 3):.3f},{swing(k + 5) + 1200:.3f},{swing(k) + 410:.3f},"
        f"{swing(k + 7):.3f},{last(k)}"
        for k in range(FRAMES)
    ]


def all_seen(found):
    return found.warning == "" and bool(np.isfinite(found.positions).all())


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
    assert found.warning == ODD.format(LINE, lines[CUT].split(",")[-1], "a", 3, "")
    assert np.isnan(found.positions[CUT, 0]).all()


def test_a_rest_of_long_numbers_does_not_show_that_zeros_are_kept(tmp_path):
    """Held for 380 of 400 frames, and one number of ten of the swing ends in zero."""
    angle = np.maximum(np.arange(400) - 380, 0)[:, None] / 9
    rng = np.random.default_rng(0)
    where = np.array([310.27, -145.31, 1205.34, 410.11, -145.77, 1190.93]) + rng.uniform(50, 90, 6) * np.sin(angle)
    lines = vicon(lambda value: f"{value:.2f}".rstrip("0").rstrip("."), where)
    assert all_seen(imported(tmp_path, lines))


def test_numbers_of_one_magnitude_do_not_show_that_a_program_keeps_zeros(tmp_path):
    """Six digits in all: 999.123 and, above it for a moment, 1000.12."""
    k = np.arange(FRAMES)[:, None]
    where = np.hstack([300 + swing(k), 500 + swing(k + 3), 1000.2 - 0.06 * (k - 100) ** 2])
    where = np.round(where, 2) + 3e-3
    assert [f"{z:g}" for z in where[98:103, 2]] == ["999.963", "1000.14", "1000.2", "1000.14", "999.963"]
    assert all_seen(imported(tmp_path, vicon(WRITERS["%g"], np.tile(where, 2))))


def test_no_line_misses_a_position_by_less_than_the_noise_of_cameras(tmp_path):
    """A bump of 0.25 mm, beginning with a whole number, in data without noise."""
    where = np.tile([310.5, -145.5, 1205.25, 410.5, -145.5, 1190.25], (FRAMES, 1))
    where[100:103, [2, 5]] -= [[0.25, 0.25]] * 3
    write = "{:g}".format
    assert all_seen(imported(tmp_path, vicon(write, where)))
    where[100:103, [2, 5]] -= [[5, 5]] * 3
    lines = vicon(write, where)
    lines[101] = lines[101][:-1]  # 118 of 1185
    assert imported(tmp_path, lines).warning == DOUBT.format(107)


def test_a_number_with_a_whole_power_is_whole_and_one_with_a_part_is_broken(tmp_path):
    where = places()
    where[:, 5] = 2 + 0.1 * np.sin(np.arange(len(where)))
    where[CUT, 5] *= 10  # 2.077389e+01, which begins as 2.077389e+00 does
    lines = vicon(WRITERS["%.6e"], where)
    assert all_seen(imported(tmp_path, lines))
    lines[CUT] = lines[CUT][:-1]
    assert imported(tmp_path, lines).warning == ODD.format(LINE, "2.077389e+0", "b", 6, " and the power")


def quoted(k, markers):
    """A line of numbers with decimal commas between commas, its empty cells at the end left out."""
    numbers = [swing(k + axis) + 300 + 100 * axis for axis in range(3 * markers)]
    return ",".join([f"{k + 1},0", *(f'"{number:.2f}"'.replace(".", ",") for number in numbers)])


@pytest.mark.parametrize("end", ["", ","])
def test_numbers_with_decimal_commas_in_quotation_marks_join_no_cells(tmp_path, end):
    found = imported(tmp_path, [quoted(k, 1 if 40 < k < 45 else 2) + end for k in range(FRAMES)])
    assert (found.warning, np.isnan(found.positions).any(2).sum(0).tolist()) == ("", [0, 4])
    assert found.positions[0, 0] == pytest.approx([0.3, 0.40665, 0.51322])


def zeros_left_out(digits):
    def write(value):
        text = f"{value:.{digits}f}"
        return text.rstrip("0").rstrip(".")

    return write


def flicked(seed, frames, noise):
    """Two markers [m] that rest, move by up to 0.2 m within 0.2 s, all at once, and rest again."""
    rng = np.random.default_rng(seed)
    begin, last = rng.integers(frames // 6, frames * 2 // 3), rng.integers(8, 20)
    u = np.clip((np.arange(frames)[:, None] - begin) / last, 0, 1)
    way = np.tile(rng.normal(size=3), 2)
    where = np.tile(rng.uniform(-1, 1.5, 3), 2) + np.array([0, 0, 0, 0.4, 0, -0.45])
    moved = where + rng.uniform(0.05, 0.2) * way / np.linalg.norm(way[:3]) * (10 * u**3 - 15 * u**4 + 6 * u**5)
    return moved + rng.normal(0, noise, moved.shape)


def near_zero(seed):
    """Two markers whose z begins at 0, a few of them less than 1e-4 m off."""
    where = flicked(seed, 150, 1e-4)
    where[:, [2, 5]] -= where[0, [2, 5]] + 1e-4
    return where


def swayed(seed, noise=0.0):
    """Two markers that sway and come back to z = 0 in the last frame."""
    rng = np.random.default_rng(seed)
    z = 0.1 * np.sin(np.linspace(0, 2 * np.pi, 60))[:, None]
    where = np.hstack([z - 0.2, 1.5 + 0 * z, z, z + 0.2, 1.05 + 0 * z, z]) + rng.normal(0, noise, (60, 6))
    where[-1, 5] = 0
    return where


def rounded(seed):
    """Filtered positions, rounded to 1 mm."""
    rng = np.random.default_rng(seed)
    angle = np.arange(60)[:, None] * rng.uniform(0.02, 0.12, 6)
    return np.round([0.2, 0.05, 1.5, 0.25, 0.05, 1.05] + rng.uniform(0.02, 0.2, 6) * np.sin(angle), 3)


def shortest(value):
    return repr(float(value))


HONEST = {
    "0.0 at the end": (lambda seed: np.round(swayed(seed), 6) + 0.0, shortest, "m"),
    "-0 at the end": (lambda seed: swayed(seed, 1e-3) * [1, 1, 0.04, 1, 1, 0.04] - 1e-9, zeros_left_out(3), "m"),
    "0 at the end": (swayed, WRITERS["%g"], "m"),
    "inches of millimetres": (lambda seed: np.round(swayed(seed, 1e-3), 3) / 0.0254, shortest, "in"),
    "some powers": (lambda seed: near_zero(seed + 4), shortest, "m"),
    "flick in 0.1 mm": (lambda seed: 1e3 * flicked(seed, 100, 0), zeros_left_out(1), "mm"),
    "flick, six digits": (lambda seed: 1e3 * flicked(seed, 100, 0), WRITERS["%g"], "mm"),
    "millimetres of metres": (lambda seed: 1e3 * rounded(seed), shortest, "mm"),
    "inches": (lambda seed: 1e3 * rounded(seed) / 25.4, shortest, "in"),
}


@pytest.mark.parametrize("kind", HONEST)
def test_programs_that_leave_out_zeros_cut_no_number(tmp_path, kind):
    make, write, unit = HONEST[kind]
    for seed in range(4):
        lines = vicon(write, make(seed))
        found = imported(tmp_path, lines, VICON.replace("mm", unit))
        assert found.warning == "", seed
