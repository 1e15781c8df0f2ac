"""Thousands separators that only one reading of the whole file explains are read; the others are refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from tests.formats.test_stated_decimals import SAY_WHICH, files

PLACES = 1200 + np.arange(6) * 150 + 400 * np.sin(np.arange(30) / 8)[:, None]  # mm, (frames, 2 markers of x, y, z)
STYLES = {
    "en": (",", "."), "de": (".", ","), "fr": ("\u202f", ","), "se": ("\u00a0", ","), "si": (" ", "."),
    "it": ("\u2009", ","), "ch": ("'", "."), "ch-new": ("\u2019", "."), "at": ("'", ","),
}  # fmt: skip
NAMED = {",": "commas", ".": "points", "'": "apostrophes", "\u2019": "apostrophes"}
NAMES = ["a.trc", "vicon.csv", "motive.csv", "a.tsv", "own.csv"]


def in_style(style, digits=2):
    """A function that writes a number in a style, with a minus sign where Swedish has one."""
    group, decimal = STYLES[style]

    def write(value):
        text = f"{value:,.{digits}f}".replace(",", "G").replace(".", decimal).replace("G", group)
        return text.replace("-", "\u2212") if style == "se" else text

    return write


def text_of(name, style, places=PLACES, write=None):
    """The text of a file whose positions are written in a style."""
    return files("," if STYLES[style][1] == "." else ".", places, write or in_style(style))[name]


@pytest.mark.parametrize("style", list(STYLES))
@pytest.mark.parametrize("name", NAMES)
def test_thousands_that_only_one_reading_explains_are_read_exactly(tmp_path, name, style):
    """Swedish with negative numbers."""
    path, places = tmp_path / name, PLACES - 3500 * (style == "se")
    path.write_text(text_of(name, style, places), encoding="utf-8")
    found = read_marker_tracks(path)
    assert found.positions.reshape(30, 6) == pytest.approx(np.round(places, 2) / 1000, abs=1e-9)
    assert np.diff(found.time) == pytest.approx(0.01)
    example = next(text for value in places.ravel() if len(text := in_style(style)(value)) > 7).replace("\u2212", "-")
    kind = NAMED.get(STYLES[style][0], "spaces")
    assert found.warning == f"{kind} were read as thousands separators, as in {example}"


@pytest.mark.parametrize("style", ["en", "de", "fr"])
def test_a_stated_decimal_separator_reads_the_same(tmp_path, style):
    path = tmp_path / "a.trc"
    path.write_text(text_of("a.trc", style), encoding="utf-8")
    found = read_marker_tracks(path, decimal="point" if STYLES[style][1] == "." else "comma")
    assert found.positions.reshape(30, 6) == pytest.approx(np.round(PLACES, 2) / 1000, abs=1e-9)
    assert found.warning == ""


def test_gaps_stay_gaps_beside_thousands(tmp_path):
    places, path = np.where(np.arange(180).reshape(30, 6) // 3 % 7 == 2, np.nan, PLACES), tmp_path / "a.trc"
    for gap in ("", "NaN", "0.00"):
        path.write_text(text_of("a.trc", "en", places).replace("nan", gap))
        found = read_marker_tracks(path).positions.reshape(30, 6)
        assert found == pytest.approx(np.round(places, 2) / 1000, abs=1e-9, nan_ok=True)


def spanish(value):
    """1234,50 and 12.345,60."""
    return in_style("de")(value).replace(".", "", int(abs(value) < 1e4))


def test_languages_that_separate_thousands_from_10000_on_are_read(tmp_path):
    """As in Spanish and Polish."""
    path, places = tmp_path / "a.trc", 8 * PLACES
    path.write_text(text_of("a.trc", "de", places, spanish))
    assert re.search(r"\t\d{4},", path.read_text())
    assert re.search(r"\t\d\d\.\d{3},", path.read_text())
    found = read_marker_tracks(path)
    assert found.positions.reshape(30, 6) == pytest.approx(np.round(places, 2) / 1000, abs=1e-9)


@pytest.mark.parametrize("sign", [",", "\u202f"])
def test_frame_numbers_with_thousands_separators_count_on(tmp_path, sign):
    """The positions have none, and decimal points."""
    path = tmp_path / "a.trc"
    lines = files(",", PLACES / 10, lambda value: f"{value:.2f}")["a.trc"].splitlines()
    lines[5:] = [f"{k + 990:,}".replace(",", sign) + line[len(str(k)) :] for k, line in enumerate(lines[5:])]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = read_marker_tracks(path)
    assert found.positions.reshape(30, 6) == pytest.approx(np.round(PLACES / 10, 2) / 1000, abs=1e-9)
    name = "commas" if sign == "," else "spaces"
    assert found.warning == f"{name} were read as thousands separators, as in 1{sign}000"
    lines[20] = lines[20].replace(f"1{sign}00", f"1{sign}50")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if sign == ",":
        with pytest.raises(TakeError, match=f"which of them is the decimal separator\\? S{SAY_WHICH[1:]}$"):
            read_marker_tracks(path)


def damaged(change, at=12):
    """A function that changes the text of one line of a file, or of all from a line on."""
    return lambda lines: [change(line) if k in np.atleast_1d(at) else line for k, line in enumerate(lines)]


ALL_LINES = np.arange(5, 35)


@pytest.mark.parametrize(
    ("style", "change", "told"),
    [
        ("en", damaged(lambda line: re.sub(r"(\d),(\d{3})\.(\d\d)$", r"\1.\2,\3", line)), "line 13 holds"),
        ("en", damaged(lambda line: line.replace(",", "\u202f")), "line .* holds"),
        ("en", damaged(lambda line: line[::-1].replace(",", "", 1)[::-1], ALL_LINES), "line .* holds"),
        ("en", damaged(lambda line: line.replace(",", "", 5), np.arange(8, 35)), "line .* holds"),
        ("en", damaged(lambda line: line.replace(",", "", 6), np.arange(7, 35)), "line .* holds"),
        ("en", damaged(lambda line: line.replace("1,", "1,2", 1)), "line 13 holds '1,2"),
        ("fr", damaged(lambda line: line.replace("\u202f", " 2", 1)), "line 13 holds '"),
    ],
    ids=["other-decimal", "other-sign", "some-unparted", "most-unparted", "two-lines", "four-digits", "after-space"],
)  # fmt: skip
def test_a_file_that_no_reading_explains_is_refused_with_the_line(tmp_path, style, change, told):
    path = tmp_path / "a.trc"
    lines = text_of("a.trc", style).splitlines()
    path.write_text("\n".join(change(lines)) + "\n", encoding="utf-8")
    with pytest.raises(TakeError, match=told):
        read_marker_tracks(path)


def test_two_numbers_that_a_lost_tab_joins_are_no_thousands(tmp_path):
    """Every line whose tab became a comma has a cell too few."""
    path = tmp_path / "a.trc"
    lines = files(",", PLACES / 10, lambda value: f"{value:.2f}")["a.trc"].splitlines()
    lines[10:20] = [
        re.sub(r"\t(\d{3}\.\d\d)$", r",\1", re.sub(r"\d+\.\d\d\t(\S+)$", r"7\t\1", one)) for one in lines[10:20]
    ]
    assert lines[10].split("\t")[-1].startswith("7,")
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(TakeError, match="line 11 "):
        read_marker_tracks(path)


def test_a_stated_count_with_a_thousands_separator_is_read(tmp_path):
    """A count is whole, so 1,030 is never 1."""
    path = tmp_path / "a.trc"
    text = files(",", PLACES / 10, lambda value: f"{value:.2f}")["a.trc"]
    for count in ("1,030", "1.030", "1\u202f030", "1'030"):
        path.write_text(text.replace("\t30\t", f"\t{count}\t"), encoding="utf-8")
        with pytest.raises(TakeError, match="holds 30 of the 1030 frames that it states"):
            read_marker_tracks(path)
    path.write_text(text.replace("\t30\t", "\t30.5\t"))
    with pytest.raises(TakeError, match=r"its number of frames is '30\.5', no whole number"):
        read_marker_tracks(path)
    path.write_text(text.replace("\t30\t", "\t30.0\t"))
    assert read_marker_tracks(path).warning == ""


@pytest.mark.parametrize("held", ["{:.3f}", "{:.6f}", "{:.4e}"])
def test_a_stated_count_with_decimals_is_read(tmp_path, held):
    """A script that writes all numbers of a line in one format states 30.000 frames; the file holds 30 of them."""
    path = tmp_path / "a.trc"
    text = text_of("a.trc", "en", write="{:.4f}".format)
    for frames, warning in ((30, ""), (28, "the file states 28 frames and holds 30; all of them were read")):
        stated = text.replace("\t30\t2\t", f"\t{held.format(frames)}\t{held.format(2)}\t")
        assert stated != text
        path.write_text(stated)
        found = read_marker_tracks(path)
        assert (found.positions.shape, found.warning) == ((30, 2, 3), warning)


def test_a_warning_of_thousands_stands_before_that_of_the_stated_count(tmp_path):
    path = tmp_path / "a.trc"
    path.write_text(text_of("a.trc", "en").replace("\t30\t2\t", "\t28\t2\t"))
    assert read_marker_tracks(path).warning == (
        "commas were read as thousands separators, as in 1,200.00; the file states 28 frames and holds 30; all of them "
        "were read"
    )


WHOLE = np.round(PLACES) - 600  # mm: from 200 to 1800
TIMED = ["a.trc", "motive.csv", "own.csv"]


def whole_thousands(name, places=WHOLE, write=lambda value: f"{value:,.0f}"):
    """A file of whole positions whose times have a decimal point."""
    return text_of(name, "en", places, write)


@pytest.mark.parametrize("name", TIMED)
def test_whole_thousands_beside_times_with_a_point_are_read(tmp_path, name):
    path = tmp_path / name
    path.write_text(whole_thousands(name))
    found = read_marker_tracks(path)
    assert found.positions.reshape(30, 6) == pytest.approx(WHOLE / 1000, abs=1e-9)
    assert np.diff(found.time) == pytest.approx(0.01)
    example = next(f"{value:,.0f}" for row in WHOLE for value in row[name == "own.csv" :] if value >= 1000)
    assert found.warning == f"commas were read as thousands separators, as in {example}"


@pytest.mark.parametrize("name", TIMED)
@pytest.mark.parametrize("kind", ["all above", "decimals", "without", "leading", "metres"])
def test_whole_thousands_that_a_column_contradicts_are_refused(tmp_path, name, kind):
    """Numbers with three decimals, or of two kinds, are beside a decimal point as well."""
    places, write = {
        "all above": (WHOLE + 1000, lambda value: f"{value:,.0f}"),
        "decimals": (WHOLE, lambda value: f"{value / 1000:.3f}".replace(".", ",")),
        "without": (WHOLE, lambda value: f"{value:,.0f}" if value < 1500 else f"{value:.0f}"),
        "leading": (WHOLE, lambda value: f"{value:,.0f}" if value < 1500 else f"0{value / 10:.0f},125"),
        "metres": (1000 * WHOLE, lambda value: f"{value / 1000:,.0f}"),
    }[kind]
    text = whole_thousands(name, places, write)
    if kind == "metres":
        text = text.replace("_mm", "_m").replace("\tmm\n", "\tm\n").replace("Millimeters", "Meters")
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(TakeError, match=r"holds '.+' beside '.+': which of them is the decimal separator\? Say which"):
        read_marker_tracks(path)


@pytest.mark.parametrize("name", TIMED)
@pytest.mark.parametrize("whole", ["2", "-1", "999", "1"])
@pytest.mark.parametrize("factor", [1, 300])
def test_decimals_beside_a_few_whole_numbers_are_never_read_as_thousands(tmp_path, name, whole, factor):
    """Then 1,652 mm were read as 1652 mm, and a whole number or a code for a gap was the only sign of it."""
    some = {WHOLE[5, 2], WHOLE[9, 2], WHOLE[15, 2], WHOLE[20, 4]}
    path = tmp_path / name
    path.write_text(
        whole_thousands(
            name, write=lambda value: whole if value in some else f"{factor * value / 1000 + 1:.3f}".replace(".", ",")
        )
    )
    with pytest.raises(TakeError, match=r"holds '.+' beside '.+': which of them is the decimal separator\? Say which"):
        read_marker_tracks(path)


@pytest.mark.parametrize("name", TIMED)
def test_a_code_for_gaps_near_decimals_that_look_like_1000_shows_no_thousands(tmp_path, name):
    """From 999 to 1,050 and back a coordinate seems to pass 1000; from one other number it really does."""
    places = 1050 + np.round(PLACES / 100)
    places[[5, 15], 2] = places[20, 4] = 999
    path = tmp_path / name
    path.write_text(whole_thousands(name, places))
    with pytest.raises(TakeError, match=r"holds '.+' beside '.+': which of them is the decimal separator\? Say which"):
        read_marker_tracks(path)
    places[25, 4] = 998
    path.write_text(whole_thousands(name, places))
    assert read_marker_tracks(path).positions.reshape(30, 6) == pytest.approx(places / 1000, abs=1e-9)


def test_whole_thousands_above_1000_are_read_with_a_stated_decimal_separator(tmp_path):
    path = tmp_path / "a.trc"
    path.write_text(whole_thousands("a.trc", WHOLE + 1000))
    found = read_marker_tracks(path, decimal="point")
    assert found.positions.reshape(30, 6) == pytest.approx((WHOLE + 1000) / 1000, abs=1e-9)
