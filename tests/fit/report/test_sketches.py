"""The sketches of effects: their arrows, dots and ticks by geometry, and each drawing as it was looked at."""

from __future__ import annotations

import math
import re
import zlib

import pytest

from fit.report.sketches import SKETCHES, _arrow, _dots

# CRC-32 of the strokes of each sketch, as they were looked at in a report. Look at a changed one, then write its own.
LOOKED_AT = {
    "shear_stiffness": 4147677614,
    "bending_hysteresis": 1721259221,
    "rest_curvature": 3381367365,
    "hem": 366901633,
    "anisotropy": 4173054546,
    "strain_stiffening": 1863629048,
    "bending_viscosity": 1252101892,
    "stretch_viscosity": 3084973263,
    "mass_distribution": 3585950974,
    "self_contact": 2331934703,
    "hanger_compliance": 295157129,
    "hanger_rotation": 1260795956,
    "attachment_offset": 1664052108,
    "clip_slip": 1392917043,
    "clip_slack": 3845666591,
    "air_drag": 3917943547,
    "added_mass": 4060670836,
    "draught": 2254919361,
    "air_lift": 2870772756,
    "time_offset": 1308752850,
    "gravity_tilt": 1323674360,
    "depth_scale": 2267824372,
    "filter_lag": 570182950,
    "corner_erosion": 1102997855,
    "clock_drift": 2293679492,
    "tracker_smoothing": 2971264674,
    "sliding_points": 4258015421,
    "eroded_outline": 4187093553,
    "frame_timing": 410531233,
}


def places_of(path):
    """Return the pairs of coordinates that a path of absolute lines moves through."""
    return [(float(x), float(y)) for x, y in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path)]


@pytest.mark.parametrize("end", [(30.0, 20.0), (10.0, 40.0), (-10.0, 20.0), (10.0, 0.0), (22.0, 36.0)])
def test_an_arrow_ends_in_a_head_of_five_units_that_opens_by_half_a_radian_to_either_side(end):
    style, path = _arrow(10.0, 20.0, *end)
    tail, tip, left, again, right = places_of(path)
    assert (style, tail, tip, again) == ("hot", (10.0, 20.0), end, end)
    back = math.atan2(tail[1] - tip[1], tail[0] - tip[0])
    for corner, turn in ((left, 0.5), (right, -0.5)):
        assert math.dist(corner, tip) == pytest.approx(5.0, abs=0.1)  # coordinates have one decimal
        off = math.atan2(corner[1] - tip[1], corner[0] - tip[0]) - back
        assert (off + math.pi) % (2 * math.pi) - math.pi == pytest.approx(turn, abs=0.03)


def test_a_dot_is_a_circle_of_two_half_turns_about_its_place():
    assert _dots("dot", (12, 24), (30, 8)) == (
        "dot", "M10 24a2 2 0 1 0 4 0a2 2 0 1 0 -4 0M28 8a2 2 0 1 0 4 0a2 2 0 1 0 -4 0",
    )  # fmt: skip
    assert _dots("ghost", (12, 24), radius=3) == ("ghost", "M9 24a3 3 0 1 0 6 0a3 3 0 1 0 -6 0")


def test_every_sketch_is_the_one_that_was_looked_at():
    found = {name: zlib.crc32(repr(strokes).encode()) for name, strokes in SKETCHES.items()}
    assert found == LOOKED_AT
