"""TOML files of tens of thousands of tables, keys or numbers are refused before they are read."""

from __future__ import annotations

import math

import msgspec
import pytest

from formats.descriptions import dump_description
from formats.errors import DescriptionError
from formats.garment import TrackedPoint
from formats.toml_files import MOST_CHARACTERS, read_toml
from tests.formats.measured import MeasuredReading
from tests.formats.test_archive import GARMENT


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("".join(f"[a{k}.b.c.d]\n" for k in range(40_000)), "more than 12000 opening brackets"),
        ("[[a.b]]\n" * 40_000, "more than 12000 opening brackets"),
        (f"a = [{'{},' * 40_000}]", "more than 12000 opening brackets"),
        ("".join(f"a{k}.b.c.d = 1\n" for k in range(40_000)), "more than 10000 equals signs"),
        (f"a = [{'1,' * 500_000}]", "more than 30000 commas"),
        ("".join(f"[a{k}{'.b' * 18}]\n" for k in range(10_000)), "more than 30000 dots"),
    ],
)
def test_a_file_of_40000_tables_keys_or_numbers_is_refused_with_what_it_has_too_many_of(tmp_path, text, says):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(DescriptionError, match=f"has {says}, which no such file has; check the path"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "name", ["both", *(pytest.param(one, marks=pytest.mark.slow) for one in ("tables", "long"))]
)  # fmt: skip
def test_the_costliest_files_within_the_limits_take_less_than_2_s_and_256_mb(tmp_path, name):
    """40,000 tables took 316 MB and 4.7 s; those that are left take a fifth of it."""
    texts = {
        "tables": "".join(f"[a{k}.b.c]\n" for k in range(11_990)),
        "long": "".join(f"[a{k}{'.b' * 18}]\n" for k in range(1650)),
        "both": "".join(f"[a{k}.b]\na{k}.b.c=1\n" for k in range(9990)),
    }
    path = tmp_path / f"{name}.toml"
    path.write_text(texts[name])
    with MeasuredReading() as measured:
        cost = measured("toml", path)
    assert cost["said"] == ""
    assert cost["megabytes"] < 256
    assert cost["seconds"] < 2


def test_the_largest_garment_has_two_thirds_of_the_signs_at_most_and_is_read(tmp_path):
    """An outline of 1000 corners, a hole of 1000, and 2000 points."""
    around = [(math.cos(a), math.sin(a)) for a in (-math.pi * k / 997 for k in range(998))]
    large = msgspec.structs.replace(
        GARMENT, format="hangtime-garment/2", outline_m=((-1.0, 0.1), (1.0, 0.1), *around),
        holes_m=(tuple((0.5 * x, 0.1 * y - 0.2) for x, y in around),),
        points=tuple(TrackedPoint(name=f"row {k} of a long name", at_m=(1e-4 * k, -0.1)) for k in range(2000)),
    )  # fmt: skip
    text = dump_description(large)
    for signs, (most, _) in MOST_CHARACTERS.items():
        assert sum(map(text.count, signs)) <= 0.67 * most
    (tmp_path / "a.toml").write_text(text)
    assert len(read_toml(tmp_path / "a.toml")["points"]) == 2000
