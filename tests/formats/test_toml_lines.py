"""Every error about a TOML file names the line of the malformed text or of the wrong field."""

from __future__ import annotations

import time

import pytest

from formats.descriptions import load_garment, load_rig
from formats.errors import DescriptionError
from formats.toml_files import LARGEST_TOML, line_of, place_in, read_toml

TWICE = [
    ("mass_kg = 1\nname = 'a'\nmass_kg = 2\n", "states mass_kg twice (at line 3, and before at line 1)"),
    ('points = [\n  1,\n]\n"points" = [\n  3,\n]\n', 'states "points" twice (at line 4, and before at line 1)'),
    ("[hanger]\nids = [0]\n[sensor]\nids = 2\n[hanger]\n", "states hanger twice (at line 5, and before at line 1)"),
    ("[hanger]\nids = 1\n[sensor]\nids = 2\nids = 3\n", "states ids twice (at line 5, and before at line 4)"),
    ("[[p]]\nx = 1\n[[p]]\nx = 2\nx = 3\n", "states x twice (at line 5, and before at line 4)"),
    ("points = []\n[[points]]\n", "states points twice (at line 2, and before at line 1)"),
    ("[[points]]\n[points]\n", "states points twice (at line 2, and before at line 1)"),
    ("[[a.b]]\n[a]\nb.c = 2\n", "states b.c twice (at line 3, and before at line 1)"),
    ("a = 1\na.b = 2\n", "states a.b twice (at line 2, and before at line 1)"),
    ("a = {x = 1}\n[a.y]\n", "states a.y twice (at line 2, and before at line 1)"),
    ("[a]\nb.c = 1\n[a.b]\n", "states a.b twice (at line 3, and before at line 2)"),
    ("points = [\n  {name = 'a', name = 'b'}]\n", "states name twice in one table (at line 2)"),
]


@pytest.mark.parametrize(("text", "says"), TWICE)
def test_a_key_or_table_that_is_there_twice_is_named_with_both_lines(tmp_path, text, says):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(DescriptionError) as refused:
        read_toml(tmp_path / "a.toml")
    assert str(refused.value) == f"{tmp_path}/a.toml: {says}; leave out one"


TEXT = """format = "hangtime-rig/1"
name = "x"

[hanger]  # of wood
ids = [0, 1]
held_m = [
  [-0.2, 0.0, 0.0],
  [0.2, 0.0, 0.0],
]

[[points]]
name = "a"
[[points]]
"na me" = "b"
a.b = 3
"""
A_SWATCH = """format = "hangtime-garment/1"
name = "a"
kind = "swatch"
mass_kg = 0.04
outline_m = [[0.0, 0.0], [0.5, 0.0], [0.5, -0.5], [0.0, -0.5]]
held = "corners"
points = []
"""
A_RIG = """format = "hangtime-rig/1"
name = "a"
gravity = [0, 9.81, 0]
"""


@pytest.mark.parametrize(
    ("field", "line"),
    [
        ("name", 2), ("hanger", 4), ("hanger.ids", 5), ("hanger.ids[1]", 5), ("hanger.held_m[1][0]", 6),
        ("hanger.gone", 4), ("points", 11), ("points[0].name", 12), ("points[1]", 13), ("points[1].a.b", 15),
        ("points[1].gone.b", 13), ("gone", None), ("", None),
    ],
)  # fmt: skip
def test_a_field_has_the_line_of_its_key_or_else_of_its_table(field, line):
    assert line_of(TEXT, field) == line


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ('"mass [kg]"', "mass [kg]"), ('"a b[c]"', "a b[c]"), ("'x ]'", "x ]"), ('"a [[b"', "a [[b"),
        ('"p [0][x]"', "p [0][x]"), (r'"\u001b[31mkey"', "\x1b[31mkey"), (r'"a\nb"', "a\nb"), (r'"a \" b"', 'a " b'),
        ("'['", "["), ("']'", "]"), ("'.['", ".["),
    ],
)  # fmt: skip
@pytest.mark.parametrize("table", ["", "hanger", "points[1]"])
def test_a_key_of_any_signs_has_its_line(key, name, table):
    asked = f"{table}.{name}" if table else name
    head = {"": "", "hanger": "[hanger]\n", "points[1]": "[[points]]\n[[points]]\n"}[table]
    assert line_of(f"{head}\n{key} = 1\n", asked) == head.count("\n") + 2
    lost = {"": None, "hanger": 1, "points[1]": 2}[table]
    assert line_of(f"{head}b = 1\n", asked) == lost


@pytest.mark.parametrize("brackets", ["[%s]", "[[%s]]"])
def test_a_table_with_brackets_in_its_name_has_its_line(brackets):
    assert line_of("[hanger]\n" + brackets % '"rate [kB]"' + "  # slow\nx = 1\n", "rate [kB]") == 2
    assert line_of("[hanger]\n" + brackets % '"rate [kB]"' + "\nx = 1\n", "hanger.x") == 1


@pytest.mark.parametrize(
    "line", ['["a' + " " * 200_000, "[a" + " " * 200_000, "a" + "-" * 200_000, "a" + ".a" * 100_000]
)
def test_a_long_line_without_its_end_costs_time_in_proportion_to_its_length(line):
    begin = time.process_time()
    assert line_of(f"x = 1\n{line}\n", "y [") is None
    assert time.process_time() - begin < 2  # s; milliseconds here, and minutes in proportion to the square


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ('"mass [kg]"', "unknown field `mass [kg]`; did you mean `mass_kg`?"),
        (r'"\u001b[31mkey"', r"unknown field `\x1b[31mkey`"), (r'"mass\nkg"', r"unknown field `mass\nkg`; did you"),
    ],
)  # fmt: skip
def test_an_unknown_key_of_any_signs_is_refused_with_its_line(tmp_path, key, says):
    (tmp_path / "a.toml").write_text(f'name = "a"\n{key} = 3\n')
    with pytest.raises(DescriptionError) as refused:
        load_garment(tmp_path / "a.toml")
    assert str(refused.value).startswith(f"{tmp_path}/a.toml, line 2: {says}")


@pytest.mark.parametrize(
    ("raw", "says"),
    [
        (b"a = 1\nb = \xe9\n", "is no text in UTF-8 (at line 2)"),
        (b"\x89MCAP0\r\n\x01\x00\xff", "is a binary file, and no TOML"),
        (b"a = 1\n" + b"b." * 30 + b"c = 1\n", "has a key of twenty parts or more (at line 2)"),
        (b"a = 1\nb = " + b"9" * 5000, "has a number of thousands of digits (at line 2)"),
        (b"a = 1\nb = [1,\n\n", "(at line 2, the last)"),
        (b"a = 1\nb = 1,5\n", "(at line 2, column 6); was b = 1.5 meant? Mend that line"),
        (
            b"mass_kg = 0,035",
            "newline or end of document after a statement (at line 1, column 12); was mass_kg = 0.035",
        ),
        (b"a = 1\nmass_kg = 35 g  # weighed\n", "(at line 2, column 14); was mass_kg = 0.035 meant? Mend that line"),
        (b"a.x_m = 0,5cm\n", "was a.x_m = 0.005 meant?"),
        (b"a = 05 kg\n", "(at line 1, column 6); mend that line"),
        (b"a = {x = 0,5}\n", "(at line 1, column 13); was x = 0.5 meant?"),
        (b"a = [\n[0, 0,06]\n]\n", "(at line 2, column 8); was 0.06 meant? Mend that line"),
        (b"a = [1, 2\nb = 3\n", "; mend that line"),
        (b"a = 1,500,000\n", "(at line 1, column 6); mend that line"),
        (b"a = 1\n\nb = -1_" + b"9" * 4300, "has a number of thousands of digits (at line 3); mend it"),
        (b"#" * LARGEST_TOML + b"\n", "has more than 1048576 bytes, which no such file has; check the path"),
    ],
)
def test_text_that_is_no_toml_is_named_by_its_line(tmp_path, raw, says):
    (tmp_path / "a.toml").write_bytes(raw)
    with pytest.raises(DescriptionError) as refused:
        read_toml(tmp_path / "a.toml")
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("load", "text", "says"),
    [
        (load_rig, "name = 3\n", "line 1: name must be text"),
        (load_rig, TEXT, "line 4: the field `marker_size_m` is missing in hanger"),
        (load_garment, 'name = "a"\nmas_kg = 3\n', "line 2: unknown field `mas_kg`; did you mean `mass_kg`?"),
        (
            load_garment,
            A_SWATCH.replace("0.04", '"0,06"'),
            "line 4: mass_kg must be a number (got text); was mass_kg = 0.06 meant? See docs",
        ),
        (
            load_garment,
            A_SWATCH.replace("0.04", '"35 g"'),
            "line 4: mass_kg must be a number (got text); was mass_kg = 0.035 meant? See docs",
        ),
        (
            load_garment,
            A_SWATCH.replace("0.04", '"1.2 oz"'),
            "line 4: mass_kg must be a number (got text); was mass_kg = 0.03401942775 meant? See docs",
        ),
        (load_garment, A_SWATCH.replace("0.04", '"heavy"'), "line 4: mass_kg must be a number (got text); see docs"),
        (load_garment, A_SWATCH.replace("0.04", '"35 stone"'), "line 4: mass_kg must be a number (got text); see docs"),
        (
            load_garment,
            A_SWATCH.replace("0.0]", '"5 mm"]'),
            "line 5: outline_m[0][1] must be a number (got text); was 0.005 meant? See",
        ),
        (
            load_garment,
            'layers = "2"\n' + A_SWATCH,
            "line 1: layers must be a whole number (got text); was layers = 2 m",
        ),
        (load_garment, 'layers = "2.5"\n' + A_SWATCH, "line 1: layers must be a whole number (got text); see docs"),
        (
            load_rig,
            A_RIG,
            "line 3: gravity must be a unit vector (its length is 9.81); were m/s2 meant, gravity = [0, 1, 0]? See",
        ),
        (load_rig, A_RIG.replace("9.81", "2"), "line 3: gravity must be a unit vector (its length is 2); see docs"),
        (load_rig, TEXT.partition("[[")[0] + "marker_size_m = 0.1\nmarker_distance_m = 0.3\n[x]\n", "line 13: unknown"),
    ],
)
def test_a_wrong_field_of_a_rig_or_garment_is_named_by_its_line(tmp_path, load, text, says):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(DescriptionError) as refused:
        load(tmp_path / "a.toml")
    assert str(refused.value).startswith(f"{tmp_path}/a.toml, {says}")


def test_a_file_of_the_largest_size_is_read(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"a = 1\n#" + b"x" * (LARGEST_TOML - 7))
    assert read_toml(tmp_path / "a.toml") == {"a": 1}


@pytest.mark.parametrize(
    ("words", "table", "place"),
    [
        ("the field `marker_size_m` is missing in hanger", "", "a, line 4"),
        ("the field `mass_kg` is missing", "", "a"),
        ("the field `mass_kg` is missing", "hanger", "a, line 4"), ("unknown field `ids` in hanger", "", "a, line 5"),
        ("unknown field `name`", "", "a, line 2"), ("unknown field `ids`", "hanger", "a, line 5"),
        ("hanger.ids[1] must be a number", "", "a, line 5"), ("ids must be two", "hanger", "a, line 5"),
        ("points[1].a.b is odd", "", "a, line 15"), ("3 is no field", "", "a"),
        ("3 is no field", "hanger", "a, line 4"),
    ],
)  # fmt: skip
def test_the_words_of_an_error_lead_to_the_line_of_the_field_that_they_name(tmp_path, words, table, place):
    (tmp_path / "a").write_text(TEXT)
    assert str(place_in("a", read_toml(tmp_path / "a"), words, table=table)) == place
