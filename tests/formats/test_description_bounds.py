"""Each number of a rig or garment is taken up to its bound, and refused a float's least step beyond it."""

from __future__ import annotations

import math
import sys

import msgspec
import numpy as np
import pytest

from formats.descriptions import (
    DICTIONARIES,
    HEAVIEST_GARMENT,
    LARGEST_FIELD,
    LARGEST_OFFSET,
    MOST_CORNERS,
    MOST_LETTERS_OF_A_NAME,
    MOST_PIXELS,
    MOST_POINTS,
    check_garment,
    check_rig,
)
from formats.errors import DescriptionError
from formats.garment import TrackedPoint
from formats.rig import Calibration, RigBody
from tests.formats.test_descriptions import GARMENT, RIG, cut

replace = msgspec.structs.replace


def more(value):
    return math.nextafter(value, math.inf)


def less(value):
    return math.nextafter(value, -math.inf)


def of_part(part):
    """Return a maker of rigs with one field of a part changed; its place in a list follows the field's name."""

    def made(name, value):
        return replace(RIG, **{part: replace(getattr(RIG, part), **{name: value})})

    return made


def of_size(name, value):
    """A picture of so many pixels along one side, whose middle lies in its first pixel."""
    return replace(RIG, sensor=replace(RIG.sensor, cx=0.5, cy=0.5, **{name: value}))


def of_calibration(name, value):
    return replace(RIG, calibration=Calibration(**{name: value}))


def with_body(**fields):
    return replace(RIG, format="hangtime-rig/2", bodies=(RigBody(**{"at_m": (0.0, 0.0, 1.0), **fields}),))


def with_radius(radius):
    return with_body(kind="sphere", radius_m=radius)


def with_capsule(length):
    return with_body(kind="capsule", at_m=(0.0, 0.0, 0.0), to_m=(0.0, length, 0.0), radius_m=0.1)


SENSOR, HANGER = of_part("sensor"), of_part("hanger")
LEAST = sys.float_info.min  # Taichi lets the processor take smaller numbers for 0
MARKERS = DICTIONARIES[RIG.hanger.dictionary]
WIDTH, HEIGHT = float(RIG.sensor.width), float(RIG.sensor.height)
APART = RIG.hanger.marker_distance_m
# a description at its bound, one beyond it, and the field that its error begins with
RIGS = [
    *((of_size(name, 1), of_size(name, 0), f"sensor.{name} must be above 0 and") for name in ("width", "height")),
    *((SENSOR(name, LEAST), SENSOR(name, 0.0), f"sensor.{name} must be above 0 and") for name in ("fx", "fy")),
    *((SENSOR(name, LEAST), SENSOR(name, 0.0), f"sensor.{name} must lie in the picture") for name in ("cx", "cy")),
    *((SENSOR(name, less(MOST_PIXELS)), SENSOR(name, float(MOST_PIXELS)), f"sensor.{name}") for name in ("fx", "fy")),
    *((SENSOR(name, MOST_PIXELS - 1), SENSOR(name, MOST_PIXELS), f"sensor.{name}") for name in ("width", "height")),
    (SENSOR("cx", less(WIDTH)), SENSOR("cx", WIDTH), "sensor.cx must lie in the picture, between 0 and 640"),
    (SENSOR("cy", less(HEIGHT)), SENSOR("cy", HEIGHT), "sensor.cy must lie in the picture, between 0 and 480"),
    (HANGER("ids", (0, MARKERS - 1)), HANGER("ids", (0, MARKERS)), "hanger.ids: "),
    (HANGER("ids", (0, 1)), HANGER("ids", (-1, 1)), "hanger.ids: "),
    (HANGER("ids", (7, 8)), HANGER("ids", (7, 7)), "hanger.ids must differ (both are 7)"),
    (HANGER("marker_size_m", less(APART)), HANGER("marker_size_m", APART), "hanger.marker_distance_m"),
    (HANGER("marker_size_m", LEAST), HANGER("marker_size_m", 0.0), "hanger.marker_size_m must be above 0"),
    *(
        (HANGER("held_m", ((0.0, 0.1, 0.0), (x, 0.1, 0.0))), HANGER("held_m", ((0.0, 0.1, 0.0), (y, 0.1, 0.0))),
         "hanger.held_m: the two ends")
        for x, y in ((more(0.01), 0.01), (-more(0.01), -0.01))
    ),
    *(
        (HANGER("dot_colours", (ok, (0, 0, 0))), HANGER("dot_colours", (bad, (0, 0, 0))), "hanger.dot_colours")
        for ok, bad in (((0, 255, 9), (0, 256, 9)), ((255, 0, 0), (-1, 0, 0)), ((9, 9, 255), (9, 9, 256)))
    ),
    (of_calibration("depth_scale", more(0.8)), of_calibration("depth_scale", 0.8), "calibration.depth_scale"),
    (of_calibration("depth_scale", less(1.25)), of_calibration("depth_scale", 1.25), "calibration.depth_scale"),
    *(
        (of_calibration("depth_offset_px", tuple(LARGEST_OFFSET * k for k in way)),
         of_calibration("depth_offset_px", tuple(more(LARGEST_OFFSET) * k for k in way)), "calibration.depth_offset_px")
        for way in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ),
    *(
        (of_calibration(name, 0.0), of_calibration(name, -LEAST), f"calibration.{name} is a standard deviation")
        for name in ("depth_scale_sd", "gravity_sd_degrees")
    ),
    (of_calibration("gravity_sd_degrees", LARGEST_FIELD), of_calibration("gravity_sd_degrees", more(LARGEST_FIELD)),
     "calibration.gravity_sd_degrees has a number beyond 1e+09"),
    (of_calibration("depth_offset_sd_px", (1.0, math.inf)), of_calibration("depth_offset_sd_px", (1.0, math.nan)),
     "calibration.depth_offset_sd_px has a number that is not finite (got nan)"),
    (with_radius(0.01), with_radius(less(0.01)), "bodies: radius_m must be between 0.01 and 10 (body 1"),
    (with_radius(10.0), with_radius(more(10.0)), "bodies: radius_m must be between 0.01 and 10 (body 1"),
    (with_capsule(more(1e-6)), with_capsule(1e-6), "bodies: the capsule 1 ends where it begins"),
    (with_body(kind="plane", normal=(0.0, 1e-9, 0.0)), with_body(kind="plane", normal=(0.0, 0.0, 0.0)),
     "bodies: the normal of body 1 has no direction"),
    *(
        (replace(RIG, gravity=(0.0, near, 0.0)), replace(RIG, gravity=(0.0, off, 0.0)), "gravity must be a unit vector")
        for near, off in ((1.0099, 1.0101), (0.9901, 0.9899), (-1.0099, -1.0101))
    ),
]  # fmt: skip


def points(count, name="p"):
    return tuple(TrackedPoint(name=f"{name}{k}", at_m=GARMENT.points[0].at_m) for k in range(count))


def gear(corners):
    """A garment with an outline of so many corners: the right and lower part round, the top side straight."""
    turn = np.linspace(0.0, -np.pi, corners - 1)
    arc = [(float(0.3 * np.cos(angle)), float(0.3 * np.sin(angle)) - 0.01) for angle in turn]
    outline = ((-0.3, 0.0), (0.3, 0.0), *arc[:-1])
    return replace(GARMENT, outline_m=outline, points=(TrackedPoint(name="p", at_m=(0.0, -0.1)),))


def square(side):
    outline = ((0.0, 0.0), (side, 0.0), (side, -side), (0.0, -side))
    return replace(GARMENT, outline_m=outline, points=(TrackedPoint(name="p", at_m=(0.0, 0.0)),))


def long_name(letters):
    return replace(GARMENT, points=(TrackedPoint(name="n" * letters, at_m=GARMENT.points[0].at_m),))


GARMENTS = [
    (replace(GARMENT, mass_kg=LEAST), replace(GARMENT, mass_kg=0.0), "mass_kg must be above 0 and below 50 (got 0)"),
    (replace(GARMENT, mass_kg=less(HEAVIEST_GARMENT)), replace(GARMENT, mass_kg=HEAVIEST_GARMENT),
     "mass_kg must be above 0 and below 50 (got 50); were grams meant, mass_kg = 0.05?"),
    (replace(GARMENT, layers=1), replace(GARMENT, layers=0), "layers must be 1 or more (got 0)"),
    (cut(grain_degrees=90.0), cut(grain_degrees=more(90.0)), "grain_degrees must be between -90 and 90 (got 90)"),
    (cut(grain_degrees=-90.0), cut(grain_degrees=less(-90.0)), "grain_degrees must be between -90 and 90 (got -90)"),
    (replace(GARMENT, points=points(MOST_POINTS)), replace(GARMENT, points=points(MOST_POINTS + 1)),
     "points: 2001 are more than the 2000 that a take holds"),
    (gear(MOST_CORNERS), gear(MOST_CORNERS + 1), "outline_m has 1001 corners and holes_m 0, at most 1000 each can be"),
    (square(0.01001), square(0.00999), "outline_m encloses hardly any area"),
    (long_name(MOST_LETTERS_OF_A_NAME), long_name(MOST_LETTERS_OF_A_NAME + 1), "a name has 1001 letters, at most 1000"),
    (replace(GARMENT, name="n" * MOST_LETTERS_OF_A_NAME), replace(GARMENT, name="n" * (MOST_LETTERS_OF_A_NAME + 1)),
     "a name has 1001 letters, at most 1000"),
    (cut(seams=((3, 0),)), cut(seams=((3, 1),)), "seams: [3, 1] are not neighbouring corners of the outline"),
    (cut(seams=((2, 3),)), cut(seams=((3, 4),)), "seams: [3, 4] are not neighbouring corners of the outline"),
    (cut(seams=((0, 1),)), cut(seams=((-1, 0),)), "seams: [-1, 0] are not neighbouring corners of the outline"),
]  # fmt: skip


@pytest.mark.parametrize(("within", "beyond", "words"), RIGS, ids=lambda one: one[:40] if type(one) is str else "")
def test_a_number_of_a_rig_is_taken_up_to_its_bound(within, beyond, words):
    check_rig(within, "rig.toml")
    with pytest.raises(DescriptionError) as caught:
        check_rig(beyond, "rig.toml")
    assert caught.value.what.startswith(words)
    assert (caught.value.where, caught.value.advice) == ("rig.toml", "see docs/reference/file-formats.md")


@pytest.mark.parametrize(("within", "beyond", "words"), GARMENTS, ids=lambda one: one[:40] if type(one) is str else "")
def test_a_number_of_a_garment_is_taken_up_to_its_bound(within, beyond, words):
    check_garment(within, "garment.toml")
    with pytest.raises(DescriptionError) as caught:
        check_garment(beyond, "garment.toml")
    assert caught.value.what.startswith(words)
    assert (caught.value.where, caught.value.advice) == ("garment.toml", "see docs/reference/file-formats.md")
