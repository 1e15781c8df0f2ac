"""Numbers of a rig or garment in another unit or spelling are refused with the number that was probably meant."""

from __future__ import annotations

import re

import pytest

from formats.descriptions import load_garment, load_rig
from formats.errors import DescriptionError
from formats.toml_files import read_toml

GARMENT = """format = "hangtime-garment/2"
name = "skirt"
kind = "skirt"
mass_kg = 0.035
layers = 1
outline_m = [[-0.2, 0.0], [0.2, 0.0], [0.25, -0.45], [-0.25, -0.45]]
held = "edge"

[[points]]
name = "low"
at_m = [0.1, -0.4]

[[points]]
name = "lower"
at_m = [0.2, -0.45]
"""
RIG = """format = "hangtime-rig/2"
name = "bench"
gravity = [0.0, 1.0, 0.0]

[[bodies]]
kind = "capsule"
at_m = [1.0, 0.0, 2.0]
to_m = [1.0, 1.0, 2.0]
radius_m = 0.1

[calibration]
depth_offset_px = [1.0, 2.0]
"""


@pytest.mark.parametrize(
    ("value", "meant"),
    [
        ("[0,05, 1]", "was 0.05 meant?"), ("[1, 0,05]", "was 0.05 meant?"), ("[0.05 m, 1]", "was 0.05 meant?"),
        ("[1.5cm, 2]", "was 0.015 meant?"), ("[{x_m = [0,05, 1]}]", "was 0.05 meant?"), ("[.5, 1]", "was 0.5 meant?"),
        (".5", "was x_m = 0.5 meant?"), ("5.", "was x_m = 5 meant?"), ("05", "was x_m = 5 meant?"),
        ("\u22120.5", "was x_m = -0.5 meant?"), ("1e-3m", "was x_m = 0.001 meant?"), ("2 metres", "was x_m = 2 meant?"),
        ("[1,5m, 2]", ""), ("1.000,5", ""), ("3\u00b0", ""), ("1 / 3", ""), ("1.2.3", ""), ("[1,050,000 m, 2]", ""),
    ],
)  # fmt: skip
def test_a_number_that_toml_does_not_take_gets_the_number_meant_or_no_guess(tmp_path, value, meant):
    (tmp_path / "a.toml").write_text(f"a = 1\nx_m = {value}\nb = 2\n")
    with pytest.raises(DescriptionError) as refused:
        read_toml(tmp_path / "a.toml")
    assert re.findall(r"was .* meant\?", str(refused.value)) == ([meant] if meant else [])


def test_an_angle_with_its_sign_is_understood_by_a_field_of_degrees(tmp_path):
    (tmp_path / "a.toml").write_text("grain_degrees = 3\u00b0\n")
    with pytest.raises(DescriptionError, match=r"was grain_degrees = 3 meant\?"):
        read_toml(tmp_path / "a.toml")


HOLE = 'held = "edge"\nholes_m = [[[-5, -10], [5, -10], [0, -20]]]'


@pytest.mark.parametrize(
    ("change", "to", "says"),
    [
        ("layers = 1", "layers = 1.0", "line 5: layers must be a whole number (got 1.0); was layers = 1 meant?"),
        ("layers = 1", "layers = 1.5", "line 5: layers must be a whole number (got 1.5); see"),
        ("[0.1, -0.4]", "[0,1, -0.4]", "at_m must be a list of 2 (got 3); was a comma meant as a decimal point?"),
        ("[0.1, -0.4]", "[0.1, -0.4, 0.0]", "at_m must be a list of 2 (got 3); see"),
        ("[0.1, -0.4]", "[1]", "at_m must be a list of 2 (got 1); see"),
        ("[0.2, -0.45]", "[nan, 0.0]", "line 15: points[1].at_m has a number that is not finite (got nan)"),
        ('held = "edge"', HOLE, "line 8: holes_m: hole 1 has a coordinate of 20 m, and the outline none above 0.45 m; "
         "were millimetres or centimetres meant?"),
        ("[0.1, -0.4]", "[100, -400]", "line 9: points: 'low' has a coordinate of 400 m, and the outline none above "
         "0.45 m; were millimetres meant?"),
        ("layers = 1", "layers = 100", "mass_kg = 0.035 in 100 layers makes 0.00173 kg/m2"),
    ],
)  # fmt: skip
def test_a_number_of_a_garment_is_refused_with_its_line_and_what_was_meant(tmp_path, change, to, says):
    (tmp_path / "a.toml").write_text(GARMENT.replace(change, to))
    with pytest.raises(DescriptionError) as refused:
        load_garment(tmp_path / "a.toml")
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("change", "to", "says"),
    [
        ("[0.0, 1.0, 0.0]", "[0.0, 981, 0.0]", "(its length is 981); were cm/s2 or thousandths of g meant, gravity"),
        ("[0.0, 1.0, 0.0]", "[0.0, 9810.0, 0.0]", "were mm/s2 meant, gravity = [0, 1, 0]?"),
        ("[0.0, 1.0, 0.0]", "[0.0, 100.0, 0.0]", "gravity must be a unit vector (its length is 100); see"),
        ("[1.0, 1.0, 2.0]", "[1.0, 1e-200, 2.0]", "bodies: the capsule 1 ends where it begins"),
        ("radius_m = 0.1", "radius_m = nan", "line 9: bodies[0].radius_m has a number that is not finite"),
        ("[1.0, 2.0]", "[1.0, -200.0]", "depth_offset_px must be at most 30 pixels either way (got -200)"),
    ],
)
def test_a_number_of_a_rig_is_refused_with_its_line_and_what_was_meant(tmp_path, change, to, says):
    (tmp_path / "a.toml").write_text(RIG.replace(change, to))
    with pytest.raises(DescriptionError) as refused:
        load_rig(tmp_path / "a.toml")
    assert says in str(refused.value)
