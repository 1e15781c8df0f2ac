"""Lines of grouped numbers are matched as one text, in a tenth of the time, and give what their cells give."""

from __future__ import annotations

import time

import numpy as np
import pytest

from formats.importers.marker_files import read_marker_tracks
from formats.importers.number_cells import CELL_END, GROUP_SIGNS, sign_of_line, with_point, with_points
from formats.importers.thousands import _is_of_a_frame, _Reading

PIECES = (
    "1",
    "12",
    "123",
    "0",
    "01",
    "1234",
    "12345",
    ",",
    ".",
    ",234",
    ".567",
    " 234",
    "'234",
    "-",
    "+",
    "",
    "nan",
    "e5",
)


def random_cells(rng, count):
    return ["".join(rng.choice(PIECES, rng.integers(1, 5))).strip() for _ in range(count)]


def grouped(value, decimal, sign):
    return f"{value:,.3f}".translate({ord(","): sign, ord("."): decimal})


@pytest.mark.parametrize("decimal", [",", "."])
def test_a_line_that_is_matched_at_once_has_the_numbers_of_its_cells(decimal):
    rng, matched = np.random.default_rng(0), 0
    for _ in range(30_000):
        cells = random_cells(rng, int(rng.integers(1, 3)))
        plain = with_points(cells, decimal)
        if plain is not None:
            matched += 1
            assert plain == [with_point(cell, decimal) for cell in cells], cells
            assert all(map(_is_of_a_frame, cells))
    assert matched > 3000


@pytest.mark.parametrize(
    ("decimal", "sign"), [(",", "."), (".", ","), *((one, sign) for one in ",." for sign in GROUP_SIGNS)]
)
def test_every_separator_of_thousands_is_matched_at_once(decimal, sign):
    cells = [grouped(value, decimal, sign) for value in (1234.5, -999.25, 1e6, 0.125, 12345.678)] + ["", "NaN"]
    assert sign_of_line(CELL_END.join(cells), CELL_END, decimal) == sign
    assert with_points(cells, decimal) == ["1234.500", "-999.250", "1000000.000", "0.125", "12345.678", "", "NaN"]


@pytest.mark.parametrize("decimal", [",", "."])
def test_a_reading_records_the_same_of_a_line_as_of_its_cells(decimal):
    rng, recorded = np.random.default_rng(1), 0
    for _ in range(3000):
        whole, by_cells = _Reading(decimal), _Reading(decimal)
        for frame in range(3):
            cells = [str(frame + 1), *random_cells(rng, 3)]
            sign = sign_of_line("\t".join(cells), "\t", decimal)
            if sign is not None:
                recorded += 1
                whole.take_line("\t".join(cells), "\t", sign)
                by_cells.take(cells)
        assert whole == by_cells or np.isnan(whole.frame)
    assert recorded > 300


@pytest.mark.parametrize(("cells", "shown"), [
    (["1", "0.01", "1,234.5"], 1), (["1", "0.01", "1,234"], 0), (["1", "0.01", "1,234,567"], 1), (["1", "1,234.5"], 1),
    (["1,000", "0.01", "123.4"], 0), (["999", "0.01", "12345.5"], 0), (["1", "0.01", "999.5"], 0), (["7"], 0),
    ([""], 0),
])  # fmt: skip
def test_a_line_shows_thousands_as_its_cells_do(cells, shown):
    whole, by_cells = _Reading("."), _Reading(".")
    whole.take_line("\t".join(cells), "\t", sign_of_line("\t".join(cells), "\t", "."))
    by_cells.take(cells)
    assert (whole.shown, whole.names, whole.digits, whole.example) == (
        by_cells.shown, by_cells.names, by_cells.digits, by_cells.example,
    )  # fmt: skip
    assert whole.shown == shown


def test_a_line_with_another_decimal_separator_is_counted_as_wrong_at_its_first_such_cell():
    for cells in (["1", "0.01", "1,234.5"], ["1", "0"] + ["1"] * 10 + ["1,234.5"]):
        reading = _Reading(",")
        reading.take_line("\t".join(cells), "\t", None)
        assert (reading.wrong, reading.names, reading.digits) == (1, set(), set())


def trc(values, form):
    """A TRC file of these values [mm], (frames, markers, 3)."""
    frames, markers = values.shape[:2]
    head = (
        "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n"
        f"100\t{frames}\t{markers}\tmm\nFrame#\tTime\t"
    )
    names = "\t".join(f"m{k}\t\t" for k in range(markers))
    axes = "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, markers + 1))
    lines = (
        f"{k + 1}\t{k / 100:.3f}\t" + "\t".join(format(value, form) for value in row)
        for k, row in enumerate(values.reshape(frames, -1).tolist())
    )
    return f"{head}{names}\n\t\t{axes}\n" + "\n".join(lines) + "\n"


def test_grouped_numbers_take_little_longer_than_plain_ones(tmp_path):
    """They took 9 times as long. The bound is 3 times, for processors that are busy with other work."""
    values = 1500 + 100 * np.sin(np.arange(1500)[:, None, None] / 16 + np.arange(243).reshape(81, 3))
    seconds = {}
    for form in (".3f", ",.3f"):
        (tmp_path / f"{form}.trc").write_text(trc(values, form))
        begun = time.process_time()
        tracks = read_marker_tracks(tmp_path / f"{form}.trc")
        seconds[form] = time.process_time() - begun
        np.testing.assert_allclose(1e3 * tracks.positions, values, atol=1e-3)
    assert seconds[",.3f"] < 3 * seconds[".3f"], seconds
