"""`--decimal comma` and `--decimal point` state the decimal separator for all readers of text."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.descriptions import dump_description
from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.number_cells import with_point
from tests.fit.here import hangtime_here
from tests.formats.test_decimal_separators import table
from tests.formats.test_marker_oddities import GARMENT

PLACES = 1200 + np.arange(6) * 150 + 40 * np.sin(np.arange(30) / 8)[:, None]  # mm, (frames, 2 markers of x, y, z)
SAY_WHICH = "say which with --decimal comma or --decimal point"
NO_THOUSANDS = "export numbers without a thousands separator"


def files(comma, places=PLACES, write=None):
    """A file of each program; numbers of its header are written as in a table of that land.

    - comma: the sign that is not the decimal one
    - write: formats a position [mm]; by default as a whole number with a thousands separator, or of 1.200 to 2.000
    """
    point = "." if comma == "," else ","
    write = write or (lambda value: f"{value:,.0f}".replace(",", comma))

    def rows(before, separator):
        quote = '"' if separator == "," else ""
        return "".join(
            separator.join([*before(k), *(f"{quote}{write(value)}{quote}" for value in row)]) + "\n"
            for k, row in enumerate(places)
        )

    rate = f"100{point}00"
    trc = (
        f"PathFileType\t4\t(X/Y/Z)\tf.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n{rate}\t30\t2\tmm\n"
        "Frame#\tTime\ta\t\t\tb\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    )
    vicon = f"Trajectories\n{rate}\n;;a;;;b;;\nFrame;Sub Frame;X;Y;Z;X;Y;Z\n;;mm;mm;mm;mm;mm;mm\n"
    motive = (
        f'Format Version,1.23,Capture Frame Rate,"{rate}",Total Exported Frames,30,Length Units,Millimeters\n\n'
        ",Type,Marker,Marker,Marker,Marker,Marker,Marker\n,Name,a,a,a,b,b,b\n,ID,1,1,1,2,2,2\n"
        ",,Position,Position,Position,Position,Position,Position\nFrame,Time,X,Y,Z,X,Y,Z\n"
    )
    qualisys = f"NO_OF_FRAMES\t30\nNO_OF_MARKERS\t2\nFREQUENCY\t{rate}\nMARKER_NAMES\ta\tb\n"
    own = "time_s;a_x_mm;a_y_mm;a_z_mm;b_x_mm;b_y_mm;b_z_mm\n"

    def timed(k):
        return [f"{k / 100:.2f}".replace(".", point)]

    return {
        "a.trc": trc + rows(lambda k: [str(k), *timed(k)], "\t"),
        "vicon.csv": vicon + rows(lambda k: [str(k + 1), "0"], ";"),
        "motive.csv": motive + rows(lambda k: [str(k), f'"{timed(k)[0]}"'], ","),
        "a.tsv": qualisys + rows(lambda k: [], "\t"),
        "own.csv": own + rows(timed, ";"),
    }


@pytest.mark.parametrize(("word", "comma"), [("point", ","), ("comma", ".")])
@pytest.mark.parametrize("name", ["a.trc", "vicon.csv", "motive.csv", "a.tsv", "own.csv"])
def test_every_reader_of_text_reads_thousands_as_they_are_stated(tmp_path, name, word, comma):
    path = tmp_path / name
    path.write_text(files(comma)[name])
    found = read_marker_tracks(path, decimal=word)
    assert found.positions.reshape(30, 6) == pytest.approx(np.round(PLACES) / 1000)
    assert np.diff(found.time) == pytest.approx(0.01)
    assert found.warning == ""


def test_the_option_decides_between_two_readings(tmp_path):
    """1,200 is 1200 mm or 1.2 mm; a stated frame count has a thousands separator as well."""
    path = tmp_path / "a.tsv"
    path.write_text(table(lambda value: f"{value:,.0f}")[0])
    with pytest.raises(TakeError, match=f"{SAY_WHICH}$"):
        read_marker_tracks(path)
    found = {word: read_marker_tracks(path, decimal=word).positions[0, 0, 0] for word in ("comma", "point")}
    assert found == pytest.approx({"comma": 0.0012, "point": 1.2})
    path.write_text(path.read_text().replace("NO_OF_FRAMES\t30", "NO_OF_FRAMES\t1,030"))
    with pytest.raises(TakeError, match="holds 30 of the 1030 frames"):
        read_marker_tracks(path, decimal="point")


def test_points_beside_commas_are_refused_with_the_option_that_says_which_parts_thousands(tmp_path):
    path = tmp_path / "own.csv"
    path.write_text(files(",")["own.csv"])
    words = f"line 2 holds '1,200' beside '0.00': which of them is the decimal separator? S{SAY_WHICH[1:]}"
    with pytest.raises(TakeError, match=re.escape(words)):
        read_marker_tracks(path)
    with pytest.raises(TakeError, match=r"line 2 holds '0\.00', which is no number with a decimal comma; give the o"):
        read_marker_tracks(path, decimal="comma")


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        ("1.234,5", SAY_WHICH),
        ("1,234.5", SAY_WHICH),
        ("1.23,4.5", "mend that line"),
        ("1,2.x", "mend that line"),
        *((f"{sign}1{mark}500{mark}250", NO_THOUSANDS) for sign in ("", "-") for mark in " '\u00a0\u2009\u202f\u2019"),
        *((f"1\u00a0500{behind}", NO_THOUSANDS) for behind in (",25", ".25", ",", "")),
        ("1 50", "mend that line"),
        ("1 500 kg", "mend that line"),
        ("1500 250", "mend that line"),
    ],
)
def test_a_number_with_both_signs_is_refused_with_the_option_that_reads_it(tmp_path, number, advice):
    path = tmp_path / "own.csv"
    lines = [f"{k / 100:.2f};0;{number if k == 5 else 1};2\n" for k in range(30)]
    path.write_text("time_s;a_x_mm;a_y_mm;a_z_mm\n" + "".join(lines))
    words = f"line 7 holds {number!r}, which is no number; {advice}"
    with pytest.raises(TakeError, match=re.escape(words)):
        read_marker_tracks(path)


@pytest.mark.parametrize(
    ("cell", "sign", "plain"),
    [
        ("1,234", ".", "1234"), ("1,234", ",", "1.234"), ("1.234", ",", "1234"), ("1", ".", "1"),
        ("-1,234,567.5e-3", ".", "-1234567.5e-3"), (" +12.345,5 ", ",", "+12345.5"),
        (".5", ".", ".5"), (",5", ",", ".5"), ("5,", ",", "5."),
        ("-0,5", ",", "-0.5"),
        ("0,125", ".", None), ("0.125", ",", None), ("1234,567", ".", None), ("1,23", ".", None), ("1,2345", ".", None),
        ("1,234,5", ",", None), ("1,234.5.6", ".", None), ("1.5,234", ".", None), (",", ",", None), ("12", ",", "12"),
        ("NaN", ",", "NaN"), ("", ".", ""), ("a.b", ",", "a.b"), ("#N/A", ".", "#N/A"), ("1e5", ",", "1e5"),
    ],
)  # fmt: skip
def test_a_number_is_read_as_stated_or_not_at_all(cell, sign, plain):
    assert with_point(cell, sign) == plain


def test_the_command_takes_the_option_for_text_alone(tmp_path):
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    (tmp_path / "m.tsv").write_text(table(lambda value: f"{value:,.0f}")[0])
    for name in ("m.c3d", "r.npz"):
        (tmp_path / name).touch()
    words = ("--garment", "g.toml", "--decimal")
    done = hangtime_here("import", "m.tsv", *words, "point", folder=tmp_path)
    assert "16 of the garment's 16 markers are not in the file" in done.stderr  # the table was read
    done = hangtime_here("import", "m.c3d", *words, "point", folder=tmp_path)
    assert done.stderr == (
        "hangtime: --decimal: is for text, and m.c3d is none; leave out --decimal, or import that file by itself\n"
    )
    done = hangtime_here("import", "r.npz", *words, "comma", folder=tmp_path)
    assert "--decimal: is for motion capture, and r.npz is none" in done.stderr
    assert "is not one of" in hangtime_here("import", "m.tsv", *words, ";", folder=tmp_path).stderr
    with pytest.raises(TakeError, match="--decimal: there is no decimal separator ';'; give comma or point"):
        read_marker_tracks(tmp_path / "m.tsv", decimal=";")


def test_the_help_says_where_the_option_is_needed_and_there_the_import_asks_for_it(tmp_path):
    shown = " ".join(hangtime_here("import", "--help", folder=tmp_path).stdout.split())
    needed = "Needed where 1,234 may be 1234 or 1.234; the import then asks for it."
    assert needed in shown
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    (tmp_path / "m.tsv").write_text(table(lambda value: f"{value:,.0f}")[0])
    assert SAY_WHICH in hangtime_here("import", "m.tsv", "--garment", "g.toml", folder=tmp_path).stderr
