"""Rigs, garments and the hanger's frame."""

from __future__ import annotations

import re
import time
import tomllib

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.garments import shirt
from formats.descriptions import check_garment, dump_description, load_garment, load_rig
from formats.descriptions_beside import check_description
from formats.errors import DescriptionError
from formats.garment import TrackedPoint
from formats.hanger import held_ends
from formats.rig import Calibration, Hanger, Rig, RigBody, Sensor
from tests.formats.test_archive import GARMENT


def test_the_cameras_position_is_kept_and_stated_only_for_other_frames_than_its_own(tmp_path):
    rig = Rig(format="hangtime-rig/2", name="arm", gravity=(0.0, 0.0, -1.0), camera_at_m=(0.0, -2.0, 0.3))
    path = tmp_path / "rig.toml"
    path.write_text(dump_description(rig))
    assert load_rig(path) == rig
    assert load_rig(path).viewpoint == (0.0, -2.0, 0.3)
    for change, sentence in (
        ({"format": "hangtime-rig/1"}, 'camera_at_m needs format = "hangtime-rig/2"'),
        (
            {"sensor": Sensor(width=640, height=480, fx=570.0, fy=570.0, cx=320.0, cy=240.0)},
            "the sensor is in the origin",
        ),
    ):
        path.write_text(dump_description(msgspec.structs.replace(rig, **change)))
        with pytest.raises(DescriptionError, match=sentence):
            load_rig(path)


HANGER = Hanger(
    dictionary="DICT_4X4_50",
    ids=(0, 1),
    marker_size_m=0.05,
    marker_distance_m=0.3,
    held_m=((-0.2, 0.1, 0.0), (0.2, 0.1, 0.0)),
)
RIG = Rig(
    format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0), hanger=HANGER,
    sensor=Sensor(width=640, height=480, fx=575.8, fy=575.8, cx=319.5, cy=239.5),
)  # fmt: skip


def test_descriptions_come_back_from_their_files(tmp_path):
    (tmp_path / "garment.toml").write_text(dump_description(GARMENT))
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    assert load_garment(tmp_path / "garment.toml") == GARMENT
    assert load_rig(tmp_path / "rig.toml") == RIG


@pytest.mark.parametrize("name", ["two\nlines", "\ttab\r\0\x1f\x7f", 'a "quote" and a \\n', "Möbel ↑ 👕"])
def test_a_name_of_any_characters_is_written_as_toml_that_holds_it(name):
    assert tomllib.loads(dump_description(msgspec.structs.replace(RIG, name=name)))["name"] == name


@pytest.mark.parametrize(
    ("description", "words"),
    [
        (msgspec.structs.replace(RIG, gravity=(0.0, np.nan, 0.0)), r"a\.toml: gravity has a number .* \(got nan"),
        (msgspec.structs.replace(GARMENT, mass_kg=210.0), r"got 210\); were grams meant, mass_kg = 0\.21\?"),
        (msgspec.structs.replace(GARMENT, mass_kg=50.0), r"a\.toml: mass_kg must be above 0 and below 50 \(got 50"),
    ],
)
def test_a_description_that_no_command_reads_is_not_written(tmp_path, description, words):
    with pytest.raises(DescriptionError, match=words):
        check_description(tmp_path / "a.toml", description, overwrite=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass_kg": -1.0}, r"mass_kg must be above 0.*got -1"),
        ({"mass_kg": np.inf}, r"mass_kg has a number that is not finite \(got inf\)"),
        ({"layers": 0}, "layers must be 1 or more"),
        ({"outline_m": ((0, 0), (1, 0))}, "outline_m needs 3 corners"),
        ({"outline_m": ((0, 0), (0.4, -0.4), (0.4, 0), (0, -0.5))}, "outline_m crosses itself"),
        ({"outline_m": ((0, 0), (0.4, 0), (0, -0.4), (0.4, -0.4))}, "outline_m crosses itself"),  # halves cancel
        ({"outline_m": (*GARMENT.outline_m, GARMENT.outline_m[0])}, "has the corner .* twice: leave one out"),
        ({"outline_m": ((-0.2, 0), (0.2, 0), (0.2, -0.4), (0, 0), (-0.2, -0.4))}, r"touches itself at its corner \[0"),
        ({"points": (*GARMENT.points, GARMENT.points[0])}, "'p0' is used twice"),
        ({"points": 2 * (msgspec.structs.replace(GARMENT.points[0], name="n" * 3000),)}, "'n{60} ... n{60}' is used"),
        ({"points": (msgspec.structs.replace(GARMENT.points[0], at_m=(0.5, 0.5)),)}, "'p0' lies outside"),
        ({"points": (msgspec.structs.replace(GARMENT.points[0], at_m=(0.0, np.nan)),)}, r"points\[0\].at_m has a num"),
    ],
)
def test_an_impossible_garment_is_refused_with_its_field(tmp_path, change, words):
    (tmp_path / "garment.toml").write_text(dump_description(msgspec.structs.replace(GARMENT, **change)))
    with pytest.raises(DescriptionError, match=words) as caught:
        load_garment(tmp_path / "garment.toml")
    assert "garment.toml" in str(caught.value)


SKIRT = ((-0.2, 0.0), (0.2, 0.0), (0.25, -0.45), (-0.25, -0.45))
CIRCLE_SKIRT = ((-0.1, 0.0), (0.1, 0.0), (0.5, -0.3), (0.3, -0.5), (-0.3, -0.5), (-0.5, -0.3))
SHIRT = shirt().outline_m
RAISED_SLEEVES = tuple((x, y + 0.2 if abs(x) > 0.25 else y) for x, y in SHIRT)
TOP = "which seem to be [-0.2, 0.0] and [0.2, 0.0]"


def begun_at(outline, corner):
    return (*outline[corner:], *outline[:corner])


@pytest.mark.parametrize(
    ("outline", "words"),
    [
        (((-0.2, 0.0), (-0.25, -0.45), (0.25, -0.45), (0.2, 0.0)), f"goes anticlockwise.*{re.escape(TOP)}"),
        (SKIRT[::-1], f"goes anticlockwise.*{re.escape(TOP)}"),
        (tuple((x, -y) for x, y in SKIRT), "goes anticlockwise: x is to the right and y up"),
        (begun_at(SKIRT, 1), f"does not begin with the held edge.*{re.escape(TOP)}"),
        (begun_at(SKIRT, 2), f"does not begin with the held edge.*{re.escape(TOP)}"),
        (begun_at(SKIRT, 3), f"does not begin with the held edge.*{re.escape(TOP)}"),
        (begun_at(CIRCLE_SKIRT, 1), re.escape("seem to be [-0.1, 0.0] and [0.1, 0.0]")),
        *((begun_at(SHIRT, k), "does not begin with the held edge") for k in range(1, len(SHIRT))),
    ],
)
@pytest.mark.parametrize("held", ["edge", "corners"])
def test_an_outline_that_does_not_begin_with_the_held_edge_is_refused(outline, words, held):
    """Cloth would be fitted hanging by the wrong side; the sentence names the two corners that come first."""
    with pytest.raises(DescriptionError, match=words):
        check_garment(msgspec.structs.replace(GARMENT, outline_m=outline, points=(), held=held), "here")


@pytest.mark.parametrize(
    "outline",
    [
        SKIRT, CIRCLE_SKIRT, SHIRT, RAISED_SLEEVES,
        ((-0.2, 0.0), (0.2, 0.0), (0.0, -0.3)),
        ((-0.2, 0.0), (0.2, -0.05), (0.25, -0.45), (-0.25, -0.45)),
        ((-0.2, -0.05), (0.2, 0.0), (0.25, -0.45), (-0.25, -0.45)),
        ((-0.2, 0.0), (0.2, 0.0), (0.3, 0.005), (0.3, -0.4), (-0.3, -0.4), (-0.3, 0.005)),
        tuple((0.3 * np.sin(a), 0.3 * np.cos(a)) for a in np.radians(np.arange(-15, 345, 30))),
    ],
    ids=["skirt", "circle", "shirt", "raised", "kerchief", "right low", "left low", "by hand", "round"],
)  # fmt: skip
def test_an_outline_from_the_top_left_clockwise_is_taken(outline):
    check_garment(msgspec.structs.replace(GARMENT, outline_m=outline, points=()), "here")


HOLE = ((0.05, -0.1), (0.15, -0.1), (0.15, -0.2))


def cut(**changes):
    return msgspec.structs.replace(GARMENT, format="hangtime-garment/2", points=GARMENT.points[:1], **changes)


def test_holes_seams_and_grain_come_back_from_the_file_and_take_their_area(tmp_path):
    """0.1 x 0.1 / 2 = 0.005 m^2 less; a back that is sewn on halves the mass per area."""
    garment = cut(holes_m=(HOLE,), seams=((1, 2), (3, 0)), grain_degrees=45.0)
    (tmp_path / "garment.toml").write_text(dump_description(garment))
    assert load_garment(tmp_path / "garment.toml") == garment
    assert garment.area_m2 == pytest.approx(GARMENT.area_m2 - 0.005)
    assert garment.areal_density == pytest.approx(garment.mass_kg / (2 * garment.area_m2))
    assert not garment.is_panel
    assert "holes_m" not in dump_description(GARMENT)


@pytest.mark.parametrize(
    ("garment", "words"),
    [
        (msgspec.structs.replace(GARMENT, grain_degrees=45.0), "need format = "),
        (cut(holes_m=(HOLE[:2],)), "hole 1 needs 3 corners"),
        (cut(holes_m=(tuple((x + 0.3, y) for x, y in HOLE),)), "hole 1 is not inside"),
        (cut(holes_m=(tuple((x + 0.05, y) for x, y in HOLE),)), "hole 1 touches the outline"),
        (cut(holes_m=((*HOLE, HOLE[0]),)), "hole 1 touches itself, or has a corner twice"),
        (cut(holes_m=(HOLE, tuple((x - 0.1, y) for x, y in HOLE))), "hole 2 overlaps"),
        (cut(holes_m=(HOLE, tuple((x - 0.01, y) for x, y in HOLE))), "hole 2 overlaps"),
        (cut(seams=((1, 2), (3, 0), (1, 2))), "seams: one is there twice"),
        (cut(name="a" * 1001), "a name has 1001 letters, at most 1000 can be used"),
        (cut(seams=((0, 2),)), r"seams: \[0, 2\] are not neighbouring"),
        (cut(seams=((1, 0),)), r"seams: \[1, 0\] are not neighbouring"),
        (cut(grain_degrees=120.0), "grain_degrees must be between -90 and 90"),
    ],
)
def test_impossible_holes_seams_and_grain_are_refused(tmp_path, garment, words):
    (tmp_path / "garment.toml").write_text(dump_description(garment))
    with pytest.raises(DescriptionError, match=words):
        load_garment(tmp_path / "garment.toml")


def test_many_holes_and_points_are_checked_in_seconds(tmp_path):
    """One by one, these holes and points took 15 s."""
    lines = [0.02 + 0.15 * k / 120 for k in range(120)]
    holes = tuple(((0.08, -y), (0.15, -y), (0.15, -y - 0.0005)) for y in lines)
    points = tuple(TrackedPoint(name=f"p{k}", at_m=(0.05, -0.2 * k / 1000)) for k in range(1000))
    garment = msgspec.structs.replace(cut(holes_m=holes), points=points)
    start = time.process_time()
    check_garment(garment, tmp_path)
    assert time.process_time() - start < 4


def test_a_point_in_a_hole_is_refused(tmp_path):
    point = msgspec.structs.replace(GARMENT.points[0], at_m=(0.13, -0.12))
    garment = msgspec.structs.replace(cut(holes_m=(HOLE,)), points=(point,))
    (tmp_path / "garment.toml").write_text(dump_description(garment))
    with pytest.raises(DescriptionError, match="lies in hole 1"):
        load_garment(tmp_path / "garment.toml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg", "mass_gk", "unknown field `mass_gk`; did you mean `mass_kg`"),
        ("mass_kg = 0.03", 'mass_kg = "light"', "mass_kg must be a number .got text."),
        ("name", "name = = ", "not valid TOML"),
        ('held = "edge"', 'held = "sleeve"', "held must be one of edge, corners .got 'sleeve'."),
    ],
)
def test_a_wrong_line_is_named(tmp_path, old, new, words):
    (tmp_path / "garment.toml").write_text(dump_description(GARMENT).replace(old, new, 1))
    with pytest.raises(DescriptionError, match=words):
        load_garment(tmp_path / "garment.toml")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gravity": (0.0, 2.0, 0.0)}, "gravity must be a unit vector"),
        ({"hanger": msgspec.structs.replace(HANGER, ids=(3, 3))}, "hanger.ids must differ"),
        (
            {"hanger": msgspec.structs.replace(HANGER, marker_size_m=0.4)},
            r"hanger.marker_distance_m, 0.3, must be above hanger.marker_size_m, 0.4; was 3 meant",
        ),
        ({"hanger": msgspec.structs.replace(HANGER, marker_size_m=60.0)}, r"got 60\); were millimetres meant\?"),
        ({"sensor": msgspec.structs.replace(RIG.sensor, cx=np.nan)}, r"sensor\.cx has a number that is not finite"),
        ({"sensor": msgspec.structs.replace(RIG.sensor, cy=500.0)}, r"sensor\.cy must lie in the picture, .* 480"),
        ({"sensor": msgspec.structs.replace(RIG.sensor, width=10**9)}, r"sensor\.width must be .* below 100000"),
        ({"calibration": Calibration(depth_scale_sd=np.nan)}, r"calibration\.depth_scale_sd has a number"),
        ({"calibration": Calibration(gravity_sd_degrees=-3.0)}, r"gravity_sd_degrees is a standard deviation"),
    ],
)
def test_an_impossible_rig_is_refused_with_its_field(tmp_path, change, words):
    (tmp_path / "rig.toml").write_text(dump_description(msgspec.structs.replace(RIG, **change)))
    with pytest.raises(DescriptionError, match=words):
        load_rig(tmp_path / "rig.toml")


def test_an_axis_whose_offset_was_never_measured_is_taken(tmp_path):
    rig = msgspec.structs.replace(RIG, calibration=Calibration(depth_offset_sd_px=(0.3, np.inf)))
    (tmp_path / "rig.toml").write_text(dump_description(rig))
    assert load_rig(tmp_path / "rig.toml") == rig


def test_brackets_without_end_are_one_sentence(tmp_path):
    (tmp_path / "garment.toml").write_text("a = " + "[" * 10_000)
    with pytest.raises(DescriptionError, match="too many brackets in each other"):
        load_garment(tmp_path / "garment.toml")


def test_area_and_density_by_hand():
    """0.4 m x 0.4 m = 0.16 m^2; 30 g on it are 0.1875 kg/m^2."""
    assert GARMENT.area_m2 == pytest.approx(0.16)
    assert GARMENT.areal_density == pytest.approx(0.1875)


def test_a_level_hanger_holds_its_cloth_below_and_beside_its_markers():
    markers = np.array([[[-0.15, -0.3, 1.5], [0.15, -0.3, 1.5]]])
    assert held_ends(markers, RIG)[0] == pytest.approx(np.array([[-0.2, -0.2, 1.5], [0.2, -0.2, 1.5]]))


def test_a_hanger_turned_by_ninety_degrees_turns_its_cloth():
    """Markers one behind the other: the ends lie along z, still 0.1 m below."""
    markers = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, 1.3]]])
    assert held_ends(markers, RIG)[0] == pytest.approx(np.array([[0.0, 0.1, 0.95], [0.0, 0.1, 1.35]]))


def test_a_lost_marker_gives_no_ends():
    assert np.isnan(held_ends(np.full((1, 2, 3), np.nan), RIG)).all()


WALL = RigBody(kind="plane", at_m=(0.0, 0.0, 2.0), normal=(0.0, 0.0, -1.0))
POLE = RigBody(kind="capsule", at_m=(0.3, 0.0, 2.0), to_m=(0.3, 1.0, 2.0), radius_m=0.03)


def near(*bodies):
    return {"format": "hangtime-rig/2", "bodies": bodies}


def test_bodies_near_the_cloth_are_read_as_they_were_written(tmp_path):
    rig = msgspec.structs.replace(RIG, **near(WALL, POLE))
    (tmp_path / "rig.toml").write_text(dump_description(rig))
    assert load_rig(tmp_path / "rig.toml") == rig
    assert load_rig(tmp_path / "rig.toml").near == (WALL, POLE)


def test_a_rig_with_nothing_near_is_written_as_before():
    """Archives and the hashes of takes stay what they were."""
    assert "bodies" not in msgspec.to_builtins(RIG)
    assert RIG.near == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bodies": (WALL,)}, 'bodies need format = "hangtime-rig/2"'),
        (near(msgspec.structs.replace(WALL, normal=None)), r"a plane needs at_m, normal, and nothing else \(body 1\)"),
        (near(WALL, msgspec.structs.replace(POLE, to_m=None)), r"a capsule needs at_m, to_m and radius_m, .* \(body 2"),
        (near(msgspec.structs.replace(WALL, radius_m=0.1)), "a plane needs at_m, normal, and nothing else"),
        (
            near(msgspec.structs.replace(POLE, radius_m=0.001)),
            r"radius_m must be between 0\.01 and 10 \(body 1 has 0\.001",
        ),
        (near(msgspec.structs.replace(WALL, normal=(0.0, 0.0, 0.0))), "the normal of body 1 has no direction"),
        (near(msgspec.structs.replace(POLE, to_m=POLE.at_m)), "the capsule 1 ends where it begins"),
        (near(msgspec.structs.replace(POLE, at_m=(0.3, np.nan, 2.0))), r"bodies\[0\]\.at_m has a number that is not"),
    ],
)
def test_an_impossible_body_is_refused(tmp_path, change, words):
    (tmp_path / "rig.toml").write_text(dump_description(msgspec.structs.replace(RIG, **change)))
    with pytest.raises(DescriptionError, match=words):
        load_rig(tmp_path / "rig.toml")


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        ("1e308", "outline_m has a number beyond 1e\\+09"),
        ("9" * 400, "outline_m.*Number out of range"),
        ("9" * 5000, "has a number of thousands of digits"),
    ],
    ids=["1e308", "400 digits", "5000 digits"],
)
def test_numbers_that_overflow_are_refused_before_anything_is_computed_with_them(tmp_path, number, sentence):
    corners = f"[[0, 0], [{number}, 0], [{number}, -0.5], [0, -0.5]]"
    text = dump_description(GARMENT)
    line = next(line for line in text.splitlines() if line.startswith("outline_m"))
    (tmp_path / "g.toml").write_text(text.replace(line, f"outline_m = {corners}"))
    with pytest.raises(DescriptionError, match=sentence):
        load_garment(tmp_path / "g.toml")


@pytest.mark.parametrize("field", ["radius_m", "to_m", "at_m", "normal", "kind"])
def test_a_slip_in_a_field_of_a_part_is_named_with_the_field_that_was_meant(tmp_path, field):
    body = f'format = "hangtime-rig/2"\nname = "rig"\ngravity = [0.0, 1.0, 0.0]\n[[bodies]]\n{field}x = 1\n'
    (tmp_path / "rig.toml").write_text(body)
    with pytest.raises(DescriptionError, match=f"unknown field `{field}x`.*; did you mean `{field}`"):
        load_rig(tmp_path / "rig.toml")


def test_a_slip_in_the_hangers_part_is_named_too(tmp_path):
    (tmp_path / "rig.toml").write_text('format = "hangtime-rig/1"\nname = "rig"\n[hanger]\nmarker_sizem = 0.05\n')
    with pytest.raises(DescriptionError, match=r"unknown field `marker_sizem`.*; did you mean `marker_size_m`"):
        load_rig(tmp_path / "rig.toml")


@pytest.mark.parametrize("kind", ["garment", "rig"])
def test_a_description_without_its_format_is_refused_with_the_line_to_add(tmp_path, kind):
    path = tmp_path / "a.toml"
    path.write_text('name = "mine"\n')
    with pytest.raises(DescriptionError) as refused:
        (load_garment if kind == "garment" else load_rig)(path)
    add = f'add the line format = "hangtime-{kind}/2" at its top, and see docs/reference/file-formats.md'
    assert str(refused.value) == f"{path}: the field `format` is missing; {add}"
    path.write_text(f'format = "hangtime-{kind}/2"\n' + path.read_text())
    with pytest.raises(DescriptionError) as refused:
        (load_garment if kind == "garment" else load_rig)(path)
    assert "add the line" not in str(refused.value)
