"""A number that stands for a marker that was not seen, such as -9999, is a gap, and the import says so."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.marker_files import read_marker_tracks
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_broken_numbers import CUT, imported, places, vicon

SIGN = "{} stands in all three coordinates of a marker {}, first in {}, and counts as not seen"
LINE = f"line {CUT + 6}"


def with_sign(sign, *, frames=10, marker=1):
    """Lines of Vicon [mm] of which a marker was not seen in some."""
    lines = vicon("{:.2f}".format, places())
    for k in range(CUT, CUT + frames):
        cells = lines[k].split(",")
        cells[2 + 3 * marker : 5 + 3 * marker] = [sign] * 3
        lines[k] = ",".join(cells)
    return lines


@pytest.mark.parametrize("marker", [0, 1])
@pytest.mark.parametrize(
    ("sign", "told"),
    [("-9999", "-9999"), ("9999.99", "9999.99"), ("-9999.0000", "-9999"), ("-3.697314e28", "-3.697314e+28")],
)
def test_one_number_far_out_in_all_three_cells_is_a_gap(tmp_path, sign, told, marker):
    found = imported(tmp_path, with_sign(sign, marker=marker))
    assert found.doubt == SIGN.format(told, "10 times", LINE)
    gap = np.isnan(found.positions).all(2)
    assert np.flatnonzero(gap[:, marker]).tolist() == list(range(CUT, CUT + 10))
    assert not gap[:, 1 - marker].any()


def test_once_is_enough_and_each_sign_is_told(tmp_path):
    lines = with_sign("-9999", frames=1)
    assert imported(tmp_path, lines).doubt == SIGN.format("-9999", "1 time", LINE)
    lines[CUT + 2] = with_sign("99999", frames=3)[CUT + 2]
    lines[CUT + 3] = with_sign("99999", frames=4)[CUT + 3]
    both = SIGN.format("99999", "2 times", f"line {CUT + 8}"), SIGN.format("-9999", "1 time", LINE)
    assert imported(tmp_path, lines).doubt == "; ".join(both)


@pytest.mark.parametrize(
    ("number", "is_gap"),
    [
        ("9999", True), ("-99999.9", True), ("7777", False), ("9998.00", False), ("999.99", False), ("999999", True),
        ("1000000", True), ("-777777", False), ("-7777777", True), ("9999.90", True), ("9999.50", False),
    ],
)  # fmt: skip
def test_only_nines_or_a_number_beyond_all_places_is_a_sign_and_only_far_out(tmp_path, number, is_gap):
    """The largest other number is 1260 mm, so 999.99 may be a place."""
    found = imported(tmp_path, with_sign(number, frames=3, marker=0))  # a single one leaps
    assert np.isnan(found.positions[CUT, 0]).all() == is_gap
    assert bool(found.doubt) == is_gap


def test_two_cells_of_one_number_and_a_table_of_nothing_else_are_places(tmp_path):
    lines = [line.replace("-9999,-9999,-9999", "-9998.00,-9999.00,-9999.00") for line in with_sign("-9999")]
    assert np.isfinite(imported(tmp_path, lines).positions).all()
    alone = [f"{k + 1},0,2.5,2.5,2.5,,," for k in range(30)]
    assert np.isfinite(imported(tmp_path, alone).positions[:, 0]).all()


@pytest.mark.parametrize("sign", [-9999.0, 9999.99, -3.697314e28])
def test_a_c3d_file_names_the_frame(tmp_path, sign):
    where = places().reshape(-1, 2, 3)
    where[CUT : CUT + 4, 1] = sign
    (tmp_path / "m.c3d").write_bytes(c3d_bytes(where, ["a", "b"]))
    found = read_marker_tracks(tmp_path / "m.c3d")
    assert found.doubt == SIGN.format(f"{sign:.8g}", "4 times", f"frame {CUT + 1}")
    assert np.isnan(found.positions[CUT : CUT + 4, 1]).all()
    assert np.isfinite(np.delete(found.positions, range(CUT, CUT + 4), 0)).all()
