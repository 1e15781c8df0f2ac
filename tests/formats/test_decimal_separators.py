"""Commas of marker files are decimal separators, unless all of them may be thousands separators as well."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.decimal_separators import may_be_motion
from formats.importers.marker_text import read_marker_text
from tests.formats.test_marker_tables import read

HEAD = "NO_OF_FRAMES\t30\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDESCRIPTION\t--\nMARKER_NAMES\ta\tb\n"


def table(write, *, noise=0.0, start=1200.0):
    """A Qualisys table without a column of times; `write` formats the positions [mm]."""
    rng = np.random.default_rng(0)
    places = start + np.arange(6) * 150 + 40 * np.sin(np.arange(30) / 8)[:, None] + rng.normal(0, noise, (30, 6))
    return HEAD + "".join("\t".join(map(write, row)) + "\n" for row in places), places


@pytest.mark.parametrize("start", [1200.0, 800.0])
def test_thousands_that_commas_part_are_refused_with_both_readings(tmp_path, start):
    """From 800 mm on some numbers are below 1000, and have no comma."""
    text, _ = table(lambda value: f"{value:,.0f}", start=start)
    assert "." not in text
    with pytest.raises(TakeError) as refused:
        read(tmp_path, text, None, "a.tsv")
    first = next(cell for cell in text.split() if "," in cell)
    assert str(refused.value) == (
        f"{tmp_path}/a.tsv: commas may separate decimals or thousands: {first!r} is {first.replace(',', '.')} or "
        f"{first.replace(',', '')}; say which with --decimal comma or --decimal point"
    )


def test_decimal_commas_of_moving_markers_are_read_though_each_number_has_three_digits(tmp_path):
    """As thousands, the 0.1 mm of noise would be jumps of 100 mm from frame to frame."""
    text, places = table(lambda value: f"{value:.3f}".replace(".", ","), noise=0.1, start=100.0)
    found = read(tmp_path, text, None, "a.tsv")
    assert found.positions.reshape(30, 6) == pytest.approx(places / 1000, abs=1e-6)


@pytest.mark.parametrize("one", ["0,125", "1234,125", "1,25", "1,2345", "-0,125"])
def test_one_number_that_no_comma_of_thousands_parts_decides(tmp_path, one):
    """Beside 1.2 mm, 1234.125 mm jump."""
    text, _ = table(lambda value: f"{value:,.0f}")
    cells = text.splitlines()[-1].split("\t")
    found = read(tmp_path, text.replace(cells[0], one), None, "a.tsv")
    place = np.nan if one == "1234,125" else float(one.replace(",", ".")) / 1000
    assert found.positions[-1, 0, 0] == pytest.approx(place, nan_ok=True)
    assert found.positions[-1, 1, 0] == pytest.approx(float(cells[3].replace(",", ".")) / 1000)


def test_positions_that_jump_in_one_frame_of_twenty_and_times_of_seconds_are_no_motion():
    still = np.zeros((42, 1, 3))
    time = np.arange(42) / 100
    assert may_be_motion(time, still)
    assert may_be_motion(time[:2], still[:2])
    assert not may_be_motion(time * 30, still)
    assert not may_be_motion(time[::-1], still)
    leaping = still.copy()
    leaping[[20], :] = 0.046 / 2  # jumps by 23, 46 and 23 mm, of which the bound is 45 mm
    assert may_be_motion(time, leaping)
    leaping[::2] = 0.046
    assert not may_be_motion(time, leaping)
    unseen = np.full_like(still, np.nan)
    assert may_be_motion(time, unseen)


@pytest.mark.parametrize("start", [1200.0, 800.0])
def test_thousands_that_points_part_are_refused_where_semicolons_part_cells(tmp_path, start):
    """As a German spreadsheet writes whole millimetres: 1.500 beside 998 and -250."""
    text = vicon(lambda value: f"{value:,.0f}".replace(",", "."), start)
    with pytest.raises(TakeError) as refused:
        read(tmp_path, text, None, "a.csv")
    first = next(cell for cell in text.replace("\n", ";").split(";") if "." in cell)
    assert str(refused.value) == (
        f"{tmp_path}/a.csv: points may separate decimals or thousands: {first!r} is {first} or "
        f"{first.replace('.', '')}; say which with --decimal comma or --decimal point"
    )
    for decimal, metres in ((",", start / 1000), (".", start / 1e6 if start > 1000 else 0.8)):
        found = read_marker_text(tmp_path / "a.csv", None, decimal)
        assert found.positions[0, 0, 0] == pytest.approx(metres)


def test_points_between_commas_or_tabs_and_of_moving_markers_part_decimals(tmp_path):
    text = vicon(lambda value: f"{value:,.0f}".replace(",", "."), 1200.0)
    for other in ",\t":
        assert read(tmp_path, text.replace(";", other), None, "a.csv").positions[0, 0, 0] == pytest.approx(0.0012)
    found = read(tmp_path, vicon(lambda value: f"{value:.3f}", 100.0, noise=0.1), None, "a.csv")
    assert found.positions[0, 0, 0] == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize("separator", [",", "\t"])
@pytest.mark.parametrize(("start", "first"), [(800.0, "1.100"), (965.0, "1.115"), (-1020.0, "-1.020")])
def test_points_of_a_path_that_jumps_where_it_crosses_1000_part_thousands(tmp_path, start, first, separator):
    """987 mm is beside 1.012, which is read as 1012 mm by no jump."""
    text = vicon(lambda value: f"{value:,.0f}".replace(",", "."), start, noise=0.2).replace(";", separator)
    with pytest.raises(TakeError) as refused:
        read(tmp_path, text, None, "a.csv")
    assert str(refused.value) == (
        f"{tmp_path}/a.csv: points may separate decimals or thousands: {first!r} is {first} or "
        f"{first.replace('.', '')}; say which with --decimal comma or --decimal point"
    )
    found = read_marker_text(tmp_path / "a.csv", None, ",").positions[0]
    assert found.ravel() == pytest.approx(start / 1e3 + np.arange(6) * 0.15, abs=2e-3)


def test_thousands_beside_times_with_the_same_sign_ask_for_another_export(tmp_path):
    """No `--decimal` fits both."""
    rows = table(lambda value: f"{value:,.0f}".replace(",", "."), start=965.0)[0].splitlines()[5:]
    head = "\t".join(["time_s", *(f"{name}_{axis}_mm" for name in "ab" for axis in "xyz")])
    text = "".join(f"{line}\n" for line in [head, *(f"{k / 100:.2f}\t{row}" for k, row in enumerate(rows))])
    with pytest.raises(TakeError, match=r"'1\.115' is 1\.115 or 1115; export numbers without a thousands separator"):
        read(tmp_path, text, None, "a.tsv")


@pytest.mark.parametrize("write", ["{:.3f}", "{:.6g}"])
@pytest.mark.parametrize(("damage", "noise"), [(None, 0.0), (None, 0.1), ("1.234", 0.0), ("1234", 0.0), ("234", 0.0)])
def test_three_decimals_between_tabs_are_read_also_where_a_marker_jumps(tmp_path, write, damage, noise):
    """Millimetres beside the origin, of which one may be another marker's or lack its point or first digit."""
    lines = table(write.format, start=160.0, noise=noise)[0].splitlines()
    if damage:
        lines[20] = "\t".join([damage, *lines[20].split("\t")[1:]])
    found = read(tmp_path, "".join(f"{line}\n" for line in lines), None, "a.tsv")
    assert found.positions[0].ravel() == pytest.approx(0.16 + np.arange(6) * 0.15, abs=1e-3)


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("start", [1.2, -1.9, 0.53])
@pytest.mark.parametrize("sign", [",", "."])
def test_metres_with_three_decimals_are_no_thousands_also_at_rest(tmp_path, separator, start, sign):
    """As thousands, 1,234 m would be more than a kilometre."""
    text = vicon(lambda value: f"{value:.3f}".replace(".", sign), 1e3 * start, unit="m").replace(";", separator)
    found = read(tmp_path, text, None, "a.csv")
    assert found.warning == ""
    assert found.positions.reshape(30, 6) == pytest.approx(start + np.arange(6) * 0.15 + np.zeros((30, 6)), abs=1e-9)


def vicon(write, start, noise=0.0, unit="mm"):
    """A table of Vicon whose cells semicolons part; markers of metres are at rest."""
    lines = table(write, start=start, noise=noise)[0].splitlines()[5:]
    if unit == "m":
        lines = ["\t".join(write(start / 1e3 + 0.15 * k) for k in range(6))] * 30
    units = ";".join([unit] * 6)
    head = f"Trajectories\n100\n;;a;;;b;;\nFrame;Sub Frame;X;Y;Z;X;Y;Z\n;;{units}\n"
    return head + "".join(f"{k};0;{line}\n".replace("\t", ";") for k, line in enumerate(lines, 1))
