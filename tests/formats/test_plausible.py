"""Numbers that no cloth, hanger, sensor or camera has, on both sides of each bound."""

from __future__ import annotations

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.errors import ImplausibleError
from formats.garment import Garment, TrackedPoint
from formats.plausible import (
    check_plausible_garment,
    check_plausible_take,
    check_plausible_times,
    check_stated_rate,
)
from formats.plausible_rig import check_plausible_rig
from formats.rig import Hanger, Sensor
from tests.formats.test_archive import RIG, a_take


def panel(width, height, mass, layers=1):
    half = width / 2
    return Garment(
        format="hangtime-garment/1", name="panel", kind="swatch", mass_kg=mass, layers=layers, held="edge",
        outline_m=((-half, 0.0), (half, 0.0), (half, -height), (-half, -height)),
        points=(TrackedPoint(name="centre", at_m=(0.0, -height / 2)),),
    )  # fmt: skip


def refused(check, *given, **named):
    with pytest.raises(ImplausibleError) as error:
        check(*given, "a file", **named)
    return str(error.value)


@pytest.mark.parametrize("side", [0.1, 3.0])
def test_a_garments_longer_side_is_a_decimetre_to_three_metres(side):
    """Of 0.2 kg/m2, in either direction."""
    for width, height in ((side, 0.1), (0.1, side)):
        check_plausible_garment(panel(width, height, 0.2 * width * height), "a file")


@pytest.mark.parametrize(
    ("side", "words"),
    [
        (0.099, "outline_m is 0.099 m long, a garment 0.1 to 3 m; give metres"),
        (3.01, "outline_m is 3.01 m long, a garment 0.1 to 3 m; give metres"),
        (45.0, "outline_m is 45 m long, a garment 0.1 to 3 m; were centimetres or inches meant? Give metres"),
        (11.0, "outline_m is 11 m long, a garment 0.1 to 3 m; were centimetres or inches meant? Give metres"),
        (150.0, "outline_m is 150 m long, a garment 0.1 to 3 m; were millimetres or centimetres meant? Give metres"),
        (450.0, "outline_m is 450 m long, a garment 0.1 to 3 m; were millimetres meant? Give metres"),
        (9000.0, "outline_m is 9000 m long, a garment 0.1 to 3 m; give metres"),
    ],
)
def test_a_garment_of_another_size_is_refused_with_the_units_that_fit(side, words):
    assert refused(check_plausible_garment, panel(side, side / 2, 1.0)) == f"a file: {words}"


@pytest.mark.parametrize(("density", "is_cloth"), [(0.0199, False), (0.0201, True), (1.499, True), (1.501, False)])
@pytest.mark.parametrize("layers", [1, 2])
def test_each_layer_of_cloth_weighs_twenty_grams_to_one_and_a_half_kilograms(density, is_cloth, layers):
    garment = panel(0.5, 0.4, density * 0.2 * layers, layers)
    if is_cloth:
        check_plausible_garment(garment, "a file")
    else:
        words = f"makes {density:.3g} kg/m2, fabric has 0.02 to 1.5; weigh it and give kilograms"
        assert refused(check_plausible_garment, garment) == f"a file: mass_kg = {garment.mass_kg:g} {words}"


@pytest.mark.parametrize(("apart", "are_two"), [(0.0, False), (0.00099, False), (0.00101, True), (0.1, True)])
@pytest.mark.parametrize("along", [(1.0, 0.0), (0.6, -0.8)])
def test_two_points_of_a_garment_within_a_millimetre_are_at_one_place(apart, are_two, along):
    """A point that is copied and not moved would count twice, and its own place not at all."""
    garment = panel(0.5, 0.4, 0.04)
    at = (0.1 + apart * along[0], -0.1 + apart * along[1])
    named = [("a", (0.1, -0.1)), ("far", (-0.2, -0.1)), ("b", at)]
    garment = msgspec.structs.replace(garment, points=tuple(TrackedPoint(name=n, at_m=place) for n, place in named))
    if are_two:
        check_plausible_garment(garment, "a file")
    else:
        assert refused(check_plausible_garment, garment, offers_anyway=True) == (
            "a file: points: 'a' and 'b' are at one place, [0.1, -0.1]; give each point a place of its own, or "
            "--anyway to accept it"
        )


def test_grams_instead_of_kilograms_are_named_with_the_number_that_was_meant():
    assert refused(check_plausible_garment, panel(0.5, 0.4, 40.0)) == (
        "a file: mass_kg = 40 makes 200 kg/m2, fabric has 0.02 to 1.5; were 40 grams meant, mass_kg = 0.04 "
        "(0.2 kg/m2)? Weigh it and give kilograms"
    )
    assert "grams" not in refused(check_plausible_garment, panel(0.5, 0.4, 1.0)).replace("kilograms", "")
    assert refused(check_plausible_garment, panel(0.5, 0.4, 40.0), offers_anyway=True).endswith(
        "give kilograms, or --anyway to accept it"
    )


def test_ounces_instead_of_kilograms_are_named_with_the_number_that_was_meant():
    """1.2 oz of 28.3495 g are 34.02 g, on 0.2 m2."""
    assert refused(check_plausible_garment, panel(0.5, 0.4, 1.2)) == (
        "a file: mass_kg = 1.2 makes 6 kg/m2, fabric has 0.02 to 1.5; were 1.2 ounces meant, mass_kg = 0.0340194 "
        "(0.17 kg/m2)? Weigh it and give kilograms"
    )
    assert "ounces" not in refused(check_plausible_garment, panel(0.5, 0.4, 0.59))  # 2.95 kg/m2, near the range
    assert "ounces" in refused(check_plausible_garment, panel(0.5, 0.4, 0.61))
    assert "were" not in refused(check_plausible_garment, panel(0.5, 0.4, 0.001))


NARROW = (-0.1, 0.02, 0.0), (0.1, 0.02, 0.0)
HANGER = Hanger(marker_size_m=0.05, marker_distance_m=0.3, held_m=((-0.2, 0.02, 0.0), (0.2, 0.02, 0.0)))


def hanger(**changes):
    return msgspec.structs.replace(RIG, sensor=None, hanger=msgspec.structs.replace(HANGER, **changes))


@pytest.mark.parametrize(("field", "least", "most"), [("marker_size_m", 0.005, 0.5), ("marker_distance_m", 0.03, 3.0)])
def test_a_hangers_markers_are_as_large_and_as_far_apart_as_some_are(field, least, most):
    for value in (least, most):
        check_plausible_rig(hanger(**{field: value}, held_m=NARROW), "a file")
    for value in (0.99 * least, 1.01 * most):
        said = refused(check_plausible_rig, hanger(**{field: value}))
        assert f"hanger.{field} is {value:g} m, a hanger has {least:g} to {most:g} m" in said


def test_a_hangers_held_ends_are_a_centimetre_to_three_metres_away():
    ends = np.array(HANGER.held_m)
    for reach, is_one in ((0.009, False), (0.0101, True), (2.99, True), (3.01, False)):
        scaled = tuple(tuple(float(v) for v in end) for end in ends * reach / np.abs(ends).max())
        if is_one:
            check_plausible_rig(hanger(held_m=scaled, marker_distance_m=1.0), "a file")
        else:
            assert "hanger.held_m is" in refused(check_plausible_rig, hanger(held_m=scaled))
    assert "were millimetres or centimetres meant?" in refused(
        check_plausible_rig, hanger(marker_distance_m=200.0), offers_anyway=True
    )
    check_plausible_rig(msgspec.structs.replace(RIG, sensor=None, hanger=None), "a file")


def sensor(fx=500.0, fy=500.0):
    kept = Sensor(width=640, height=480, fx=fx, fy=fy, cx=319.5, cy=239.5)
    return msgspec.structs.replace(RIG, sensor=kept, hanger=None)


def focal(pixels, degrees):
    return pixels / 2 / np.tan(np.radians(degrees / 2))


@pytest.mark.parametrize(("degrees", "is_one"), [(9.9, False), (10.1, True), (149.9, True), (150.1, False)])
def test_a_sensors_picture_spans_ten_to_a_hundred_and_fifty_degrees_both_ways(degrees, is_one):
    if is_one:
        square = Sensor(width=640, height=640, fx=focal(640, degrees), fy=focal(640, degrees), cx=319.5, cy=319.5)
        check_plausible_rig(msgspec.structs.replace(sensor(), sensor=square), "a file")
        return
    for name, pixels in (("fx", 640), ("fy", 480)):
        said = refused(check_plausible_rig, sensor(**{name: focal(pixels, degrees)}))
        assert f"sensor.{name} = " in said
        assert f"lets {pixels} pixels span {degrees:.3g} degrees" in said


def at_steps(seconds, frames=10):
    return seconds * np.arange(frames)


@pytest.mark.parametrize("step", [0.2, 0.001, 1 / 30])
def test_cameras_deliver_five_to_a_thousand_frames_a_second(step):
    check_plausible_times(at_steps(step), "a file")
    check_plausible_times(at_steps(step)[:1], "a file")


NEEDS = "a garment needs 5 to 1000"
SECONDS = "Give seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate"
DELIVER = "cameras deliver 5 to 1000; give its time in seconds"


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (0.201, f"has 4.975 frames a second; {NEEDS}; record with more frames a second"),
        (0.399, f"has 2.506 frames a second; {NEEDS}; record with more frames a second"),
        (0.401, f"its frames are 0.401 s apart in the median; is its time in seconds? {SECONDS}"),
        (0.5, f"its frames are 0.5 s apart in the median; is its time in seconds? {SECONDS}"),
        (1.5, f"its frames are 1.5 s apart in the median; are these milliseconds? {SECONDS}"),
        (1.0, "its frames are 1 s apart in the median; its times are frame numbers, or milliseconds at 1000 frames a "
         f"second; g{SECONDS[1:]}"),
        (33.3, f"its frames are 33.3 s apart in the median; are these milliseconds? {SECONDS}"),
        (200.0, f"its frames are 200 s apart in the median; are these milliseconds? {SECONDS}"),
        (33300.0, f"its frames are 33300 s apart in the median; are these microseconds? {SECONDS}"),
        (3.33e7, f"its frames are 3.33e+07 s apart in the median; are these nanoseconds? {SECONDS}"),
        (1e9, f"its frames are 1e+09 s apart in the median; is its time in seconds? {SECONDS}"),
        (0.000998, f"has 1002 frames a second; {NEEDS}; leave out frames"),
        (0.000501, f"has 1996 frames a second; {NEEDS}; leave out frames"),
        (0.000499, f"its frames are 499 µs apart in the median, 2004 a second; {DELIVER}"),
        (0.0001, f"its frames are 100 µs apart in the median, 10000 a second; {DELIVER}"),
    ],
)  # fmt: skip
def test_times_of_no_camera_are_refused_with_the_unit_that_fits(step, words):
    assert refused(check_plausible_times, at_steps(step)) == f"a file: {words}"
    anyway = f"a file: {words}, or --anyway to accept it"
    assert refused(check_plausible_times, at_steps(step), offers_anyway=True) == anyway


def test_a_single_gap_is_no_frame_rate():
    time = at_steps(1 / 30)
    time[5:] += 60.0
    check_plausible_times(time, "a file")


@pytest.mark.parametrize(("rate", "is_one"), [(24.9, False), (25.1, True), (35.9, True), (36.1, False)])
def test_times_and_a_stated_rate_agree_to_a_fifth(rate, is_one):
    """30 frames a second: 1.2 times 25, and 36."""
    if is_one:
        check_stated_rate(at_steps(1 / 30), rate, "a file")
    else:
        said = refused(check_stated_rate, at_steps(1 / 30), rate)
        assert f"its times come at 30 frames a second, and the file states {rate:.4g}" in said
    check_stated_rate(at_steps(1 / 30), None, "a file")
    check_stated_rate(at_steps(1 / 30)[:1], rate, "a file")
    two = refused(check_stated_rate, at_steps(1.0, 2), 30.0, offers_anyway=True)
    assert re.search("at 1 frames a second.*--anyway", two)


def test_times_that_jump_by_more_than_ten_minutes_are_refused_at_the_jump():
    """A simulation would go through the gap; one of 5e9 s asked for a terabyte."""
    time = np.arange(60) / 30
    check_plausible_times(np.where(np.arange(60) < 30, time, time + 599.0), "a file")
    for jump in (601.0, 5e9):
        said = refused(check_plausible_times, np.where(np.arange(60) < 30, time, time + jump), offers_anyway=True)
        assert re.search(r"its times jump by .* s after 0.97 s; split the recording there, .*--anyway", said)


def flat_take():
    """A take whose cloth hangs as the flat garment lies: its edge is 0.4 m, and its points 0.566 m across."""
    take = a_take()
    outline = np.array([[(x, -y, 1.5) for x, y in take.garment.outline_m]] * len(take.time))
    return replace(take, held=outline[:, :2], points=np.where(take.points_valid[..., None], outline, np.nan))


@pytest.mark.parametrize(
    ("of_held", "of_points", "says"),
    [
        (
            100.0,
            100.0,
            "held ends lie up to 40 m apart in the median, .* garment 0.4 m; were centimetres meant",
        ),
        (1.0, 100.0, "points lie up to .* m apart in the median, on the flat garment 0.566 m; were centimetres meant"),
        (1.0, 1000.0, "points lie up to .* m apart in the median, on the flat garment 0.566 m; were millimetres meant"),
        (39.37, 1.0, "held ends lie up to 15.7 m apart in the median, .*; were centimetres or inches meant"),
        (
            1.0,
            3.0,
            "points lie up to .* m apart in the median, on the flat garment 0.566 m; give places and garment",
        ),
    ],
)
def test_places_in_another_unit_than_the_garment_are_refused_with_the_unit(of_held, of_points, says):
    take = flat_take()
    given = replace(take, held=of_held * take.held, points=of_points * take.points)
    assert re.search(says, refused(check_plausible_take, given, offers_anyway=True))


@pytest.mark.parametrize("scale", [0.0, 0.3, 1.0, 1.9])
def test_places_of_folded_or_stretched_cloth_are_accepted(scale):
    take = flat_take()
    check_plausible_take(replace(take, held=scale * take.held, points=scale * take.points), "a file")


def test_one_seen_point_has_no_distance():
    take = flat_take()
    alone = np.zeros_like(take.points_valid)
    alone[:, 0] = True
    check_plausible_take(replace(take, points=100.0 * take.points, points_valid=alone), "a file")


def test_a_take_is_judged_by_its_garment_its_rig_and_its_times():
    take = a_take()
    check_plausible_take(take, "a file")
    for changes in (
        {"garment": msgspec.structs.replace(take.garment, mass_kg=900.0)},
        {"rig": hanger(marker_size_m=5.0)},
        {"time": np.arange(len(take.time)) * 33.0},
    ):
        said = refused(check_plausible_take, replace(take, **changes), offers_anyway=True)
        assert said.endswith("--anyway to accept it")
        assert "--anyway" not in refused(check_plausible_take, replace(take, **changes))
