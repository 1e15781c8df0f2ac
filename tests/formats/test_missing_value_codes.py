"""A missing-value code such as -9999 counts as not seen, and the import names the code."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import Wanted
from formats.importers.missing_values import remove_missing_value_codes
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_broken_numbers import CUT, FRAMES, imported, places, vicon
from tests.formats.test_cut_numbers import VICON

SIGN = "{} is all three coordinates of a marker {}, first in {}, and is read as a missing-value code"
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
    assert found.warning == SIGN.format(told, "10 times", LINE)
    gap = np.isnan(found.positions).all(2)
    assert np.flatnonzero(gap[:, marker]).tolist() == list(range(CUT, CUT + 10))
    assert not gap[:, 1 - marker].any()


def test_once_is_enough_and_each_sign_is_reported(tmp_path):
    lines = with_sign("-9999", frames=1)
    assert imported(tmp_path, lines).warning == SIGN.format("-9999", "1 time", LINE)
    lines[CUT + 2] = with_sign("99999", frames=3)[CUT + 2]
    lines[CUT + 3] = with_sign("99999", frames=4)[CUT + 3]
    both = SIGN.format("99999", "2 times", f"line {CUT + 8}"), SIGN.format("-9999", "1 time", LINE)
    assert imported(tmp_path, lines).warning == "; ".join(both)


@pytest.mark.parametrize(
    ("number", "is_gap"),
    [
        ("9999", True), ("-99999.9", True), ("7777", True), ("9998.00", True), ("999.99", True), ("-1", True),
        ("-1000000.5", True), ("-777777", True), ("9999.90", True), ("9999.50", False), ("-1.5", False),
    ],
)  # fmt: skip
def test_a_whole_number_or_nines_to_which_no_path_leads_is_a_sign(tmp_path, number, is_gap):
    """The nearest position of the path is 0.4 m away or more, and its longest step is 8 mm."""
    found = imported(tmp_path, with_sign(number, frames=3, marker=0))  # a single one jumps
    assert np.isnan(found.positions[CUT, 0]).all() == is_gap
    assert bool(found.warning) == is_gap


@pytest.mark.parametrize("sign", ["-1", "9999", "-100"])
@pytest.mark.parametrize("kind", ["begin", "end", "never seen", "once in each", "nines within the room"])
def test_a_sign_of_one_path_is_a_sign_at_every_position(tmp_path, sign, kind):
    """Also of a marker that was never seen, and where others lie as far out."""
    lines, gone = with_sign(sign), set(range(CUT, CUT + 10))
    other = {"begin": range(5), "end": range(FRAMES - 5, FRAMES), "never seen": range(FRAMES)}.get(kind, range(7, 8))
    for k in other:
        lines[k] = ",".join([*lines[k].split(",")[:2], *[sign] * 3, *lines[k].split(",")[5:]])
    if kind == "nines within the room":
        lines = [f"{line},{30000 + k}.00,1.00,2.00" for k, line in enumerate(lines)]
        found = imported(tmp_path, lines, VICON.replace("b,,\n", "b,,,c,,\n").replace("Z\n", "Z,X,Y,Z\n"))
    else:
        found = imported(tmp_path, lines)
    first = min([*other, CUT]) + 6
    assert found.warning == SIGN.format(sign, f"{10 + len(other)} times", f"line {first}")
    gap = np.isnan(found.positions).all(2)
    assert set(np.flatnonzero(gap[:, 1]).tolist()) == gone
    assert np.flatnonzero(gap[:, 0]).tolist() == list(other)


@pytest.mark.parametrize(("frames", "times"), [(15, 3), (20, 3), (120, 1)])
def test_one_position_of_a_path_or_positions_beside_a_short_one_are_no_signs(frames, times):
    """A take may hold a point at (1, 1, 1) once, which other rules examine, or too few others to know its path."""
    where = np.random.default_rng(0).normal(0, 0.01, (frames, 2, 3))
    where[5 : 5 + times, 0] = 1.0
    assert remove_missing_value_codes(where, np.ones(2), str) == ""


def test_nines_once_are_a_sign_only_twice_as_far_out_as_all_others():
    """A single 999 within the room may be a position: a path of 0.6 m reaches 0.999 m, but hardly 1.5 m."""
    where = 0.6 + np.random.default_rng(0).normal(0, 0.01, (120, 2, 3))
    where[5, 0] = 0.999
    assert remove_missing_value_codes(where, np.full(2, 0.001), str) == ""
    where = where * 0.6
    where[5, 0] = 0.999
    assert remove_missing_value_codes(where, np.full(2, 0.001), str) == SIGN.format("999", "1 time", "5")


@pytest.mark.parametrize("rate", [5, 20, 100])
@pytest.mark.parametrize("unit", [1, 10, 100])
def test_paths_through_positions_of_one_whole_number_are_read(rate, unit):
    """Whole millimetres, centimetres and decimetres with x = y = z, also fast, with gaps, and a marker at rest."""
    time = np.arange(150) / rate
    swing = np.rint((600 + 500 * np.sin(2 * np.pi * time)) / unit)[:, None, None] * np.ones((1, 2, 3)) * unit / 1e3
    swing[40:60, 1] = np.nan
    swing[::7, 0, 0] += unit / 1e3
    swing[:, 1] += 0.3 * (time[:, None] > time[100])
    rests = np.concatenate([swing, np.ones((150, 1, 3))], 1)
    assert remove_missing_value_codes(rests, np.full(3, unit / 1e3), str) == ""


def test_two_cells_of_one_number_and_a_table_of_nothing_else_are_positions(tmp_path):
    lines = [line.replace("-9999,-9999,-9999", "-9998.00,-9999.00,-9999.00") for line in with_sign("-9999")]
    assert np.isfinite(imported(tmp_path, lines).positions).all()
    alone = [f"{k + 1},0,2.5,2.5,2.5,,," for k in range(30)]
    assert np.isfinite(imported(tmp_path, alone).positions[:, 0]).all()


@pytest.mark.parametrize("sign", [-9999.0, 9999.99, -3.697314e28, -1.0])
def test_a_c3d_file_names_the_frame(tmp_path, sign):
    where = places().reshape(-1, 2, 3)
    where[CUT : CUT + 4, 1] = sign
    (tmp_path / "m.c3d").write_bytes(c3d_bytes(where, ["a", "b"]))
    found = read_marker_tracks(tmp_path / "m.c3d")
    assert found.warning == SIGN.format(f"{sign:.8g}", "4 times", f"frame {CUT + 1}")
    assert np.isnan(found.positions[CUT : CUT + 4, 1]).all()
    assert np.isfinite(np.delete(found.positions, range(CUT, CUT + 4), 0)).all()


def test_a_single_number_beyond_all_positions_is_a_code_of_either_sign(tmp_path):
    for sign in ("-3.697314e28", "3.697314e28"):
        found = imported(tmp_path, with_sign(sign, frames=1))
        assert found.warning == SIGN.format(f"{float(sign):.7g}", "1 time", LINE)


@pytest.mark.parametrize("order", ["intel", "sgi"])
def test_the_lowest_integer_in_all_three_coordinates_of_a_c3d_file_is_a_gap(tmp_path, order):
    """Once, or with one or two coordinates that differ from it, and whatever the scale makes of it."""
    where = places().reshape(-1, 2, 3)
    where[CUT, 1] = where[CUT + 2, 0] = -3276.8
    where[CUT + 1, 1] = [-3276.8, -3276.8, -3276.7]
    raw = c3d_bytes(where, ["a", "b"], scale=0.1, processor=order)
    (tmp_path / "m.c3d").write_bytes(raw)
    found = read_marker_tracks(tmp_path / "m.c3d")
    assert SIGN.format("-32768", "2 times", f"frame {CUT + 1}") in found.warning
    assert np.argwhere(np.isnan(found.positions[: CUT + 3]).all(2)).tolist()[:1] == [[CUT, 1]]
    assert np.isnan(found.positions[CUT + 2, 0]).all()
    only_b = read_marker_tracks(tmp_path / "m.c3d", wanted=Wanted(names=("b",)))
    assert SIGN.format("-32768", "1 time", f"frame {CUT + 1}") in only_b.warning


def test_the_lowest_integer_is_no_code_where_the_numbers_are_floats_or_the_file_flags_the_gap(tmp_path):
    where = places().reshape(-1, 2, 3)
    where[CUT, 1] = np.nan
    raw = c3d_bytes(where, ["a", "b"], scale=0.1)
    assert raw.count(struct.pack("<hhhh", 0, 0, 0, -1)) == 1
    raw = raw.replace(struct.pack("<hhhh", 0, 0, 0, -1), struct.pack("<hhhh", -32768, -32768, -32768, -1))
    (tmp_path / "m.c3d").write_bytes(raw)
    found = read_marker_tracks(tmp_path / "m.c3d")
    assert (found.warning, np.argwhere(np.isnan(found.positions).all(2)).tolist()) == ("", [[CUT, 1]])
    (tmp_path / "f.c3d").write_bytes(c3d_bytes(np.full((3, 1, 3), -32768.0), ["a"]))
    assert np.isfinite(read_marker_tracks(tmp_path / "f.c3d").positions).all()
