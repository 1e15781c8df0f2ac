"""Names that are codes, markup or formulas: refused where a person types them, harmless where old takes hold them."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import msgspec
import pytest

from fit.api.takes import say_takes
from fit.batch.summary import Row, as_csv, as_html
from fit.identification.request import Plan
from fit.report.page import render_report
from fit.virtual_tests.sheet import sheet_of
from formats.archive import write_take
from formats.descriptions import dump_description, load_garment, load_rig
from formats.errors import DescriptionError
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.virtual_tests.test_kes import a_fit, known
from tests.formats.test_archive import RIG, a_take
from tests.formats.test_descriptions import GARMENT

CODES = ("\x1b", "\x07", "\r", "\x9b", "\u202e", "\u2066", "\u200f", "\u2028")
HOSTILE = "\x1b[2J\u202e<script>alert(1)</script>"
LETTERS = ("שָׁלוֹם", "پیراهن‌ها", "Rück 5 %", "裙子", "<b>", "=1+1", "a" * 1000)


@pytest.mark.parametrize("code", [*CODES, "\n", "\t"])
def test_a_typed_name_with_a_code_is_refused_by_its_line(tmp_path, code):
    shown = code.encode("unicode_escape").decode()
    (tmp_path / "g.toml").write_text(dump_description(msgspec.structs.replace(GARMENT, name=f"a{code}b")))
    with pytest.raises(DescriptionError) as refused:
        load_garment(tmp_path / "g.toml")
    assert str(refused.value) == (f"{tmp_path}/g.toml, line 2: name has the control character {shown}; type it again")
    (tmp_path / "r.toml").write_text(dump_description(msgspec.structs.replace(RIG, name=f"a{code}b")))
    with pytest.raises(DescriptionError, match="line 2: name has the control character"):
        load_rig(tmp_path / "r.toml")


def test_a_points_name_with_a_code_is_refused_by_its_own_line(tmp_path):
    first, *rest = GARMENT.points
    points = (first, msgspec.structs.replace(rest[0], name="b\x1b"), *rest[1:])
    text = dump_description(msgspec.structs.replace(GARMENT, points=points))
    (tmp_path / "g.toml").write_text(text)
    line = next(n for n, words in enumerate(text.split("\n"), 1) if "\\u001b" in words)
    with pytest.raises(DescriptionError, match=rf"line {line}: points\[1\]\.name has the control character \\x1b"):
        load_garment(tmp_path / "g.toml")


@pytest.mark.parametrize("name", LETTERS)
def test_letters_of_every_writing_are_a_name(tmp_path, name):
    (tmp_path / "g.toml").write_text(dump_description(msgspec.structs.replace(GARMENT, name=name)), encoding="utf-8")
    assert load_garment(tmp_path / "g.toml").name == name


def test_no_page_and_no_table_has_a_code_or_markup_of_an_old_takes_names():
    found = msgspec.structs.replace(
        fit_result(), take_ids=[HOSTILE], garment=HOSTILE, method="si", notes=[HOSTILE], held_out_ids=["=1+1"]
    )
    page = render_report(fit=found, diagnosis=diagnosis(take_ids=[HOSTILE], notes=[HOSTILE]), motions=[], origin=None)
    rows = [Row(take=name, key="k", state="failed", sentence=name, result=None) for name in (HOSTILE, "=1+1")]
    night = as_html(rows, Plan())
    for text in (page, night, as_csv(rows)):
        assert not any(code in text for code in CODES)
        assert "\\x1b[2J\\u202e" in text
    for text in (page, night):
        assert "<script>alert" not in text
        assert "&lt;script&gt;alert(1)" in text
    cells = [row[0] for row in csv.reader(io.StringIO(as_csv(rows)))]
    assert cells[1:] == ["\\x1b[2J\\u202e<script>alert(1)</script>", "'=1+1"]


def test_every_command_that_shows_an_old_take_shows_its_codes(tmp_path):
    take = a_take(20)
    garment = msgspec.structs.replace(take.garment, name=HOSTILE)
    write_take(tmp_path / "a.mcap", replace(take, garment=garment))
    for words in ("takes list .", "takes show a.mcap"):
        done = hangtime_here(*words.split(), folder=tmp_path)
        assert done.returncode == 0
        assert not any(code in done.stdout for code in CODES)
        assert "\\x1b[2J\\u202e" in done.stdout


def test_a_takes_name_with_an_end_of_line_forges_no_line_of_a_fit(tmp_path, capsys):
    name = "a\nhangtime: all is well"
    take = replace(a_take(), take_id=name)
    write_take(tmp_path / "a.mcap", take)
    done = hangtime_here("fit", "a.mcap", "--method", "mocap-swatch", folder=tmp_path)
    assert done.stderr.startswith("hangtime: a\\nhangtime: all is well: ")
    say_takes([take], [])
    assert capsys.readouterr().err.startswith("Fitting to a\\nhangtime: all is well; judging on the same")
    result = msgspec.structs.replace(known(a_fit()), take_ids=[name])
    assert "Virtual fabric tests of a\\nhangtime: all is well (" in sheet_of(result).splitlines()[0]


FORGED = "ok\nsound       /data/other.mcap: 180 frames in 6 blocks\nhangtime: run something to go on"


@pytest.mark.parametrize(
    "words",
    [("verify", "a.mcap"), ("list", "."), ("recover", "a.mcap"), ("export", "--to=csv", "--out=o", "a.mcap")],
)
def test_a_doubt_in_a_take_is_one_line_of_two_thousand_letters_at_most(tmp_path, words):
    for note in (FORGED, "x" * 900_000):
        write_take(tmp_path / "a.mcap", replace(a_take(), notes={"file": note}))
        done = hangtime_here("takes", *words, folder=tmp_path)
        assert len(done.stdout.splitlines()) == 1
        assert note[:2] in done.stdout
        assert len(done.stdout) < 2500
        for made in ("a.recovered.mcap", "o/a.csv"):
            (tmp_path / made).unlink(missing_ok=True)
