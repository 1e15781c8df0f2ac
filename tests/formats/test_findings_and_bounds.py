"""Findings do not depend on the sensor's clock, and numbers at a bound of what is plausible are accepted or refused."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from formats.errors import ImplausibleError
from formats.judgement import judge
from formats.plausible import check_plausible_garment, check_plausible_times, check_rate_alone, check_stated_rate
from tests.formats.test_judged_cloth import exchanged, frozen, told
from tests.formats.test_judgement import swung, with_points, without_hanger
from tests.formats.test_judgement_sentences import imported, of_hanger, unseen
from tests.formats.test_plausible import panel


def jumping():
    points = swung().points.copy()
    points[90:95, 0] += [0.0, 0.3, 0.0]
    return imported(dataclasses.replace(with_points(swung(), points), markers=points[:, :2]))


@pytest.mark.parametrize(
    ("take", "second"),
    [
        (unseen(swung(10.0), slice(None), slice(60, 240)), "from 2.0 s on"),
        (frozen(swung(10.0), slice(2, 4), slice(60, 151)), "from 2.0 s on"),
        (without_hanger(swung(10.0), slice(90, 150)), "from 3.0 s on"),
        (exchanged(swung(10.0), slice(60, 90)), "first at 2.00 s"),
        (jumping(), "at 2.97 s"),
    ],
    ids=["garment", "standing", "hanger", "exchanged", "jumping"],
)
def test_seconds_count_from_the_first_frame_whatever_the_sensors_clock_says(take, second):
    early = judge(take)
    late = judge(dataclasses.replace(take, time=take.time + 4096.5))
    assert any(second in one.words for one in early), early
    assert [(one.name, one.words, one.advice) for one in early] == [(one.name, one.words, one.advice) for one in late]


def test_every_finding_says_what_to_do_next():
    swapped = dataclasses.replace(swung(), markers=swung().markers[:, ::-1])
    takes = [swapped, jumping(), swung(1.0), swung(reach=0.001), of_hanger(swung(), marker_distance_m=0.2)]
    found = [one for take in takes for one in judge(take)]
    assert {one.name for one in found} >= {
        "markers_swapped", "hanger_jumps", "too_short", "hardly_moved", "markers_wrong_distance"
    }  # fmt: skip
    assert all(isinstance(one.advice, str) and one.advice for one in found)


@pytest.mark.parametrize(("frames", "is_grave"), [(19, True), (20, False)])
def test_twenty_frames_with_cloth_and_hanger_are_enough_for_a_fit(frames, is_grave):
    """Of 300 frames; a single point is seen."""
    take = swung(10.0)
    few = told(unseen(unseen(take, [3, 4]), [2], np.arange(300) >= frames))
    assert [one[:2] for one in few if one[0] == "garment_hardly_seen"] == [("garment_hardly_seen", is_grave)]
    seldom = told(without_hanger(take, np.arange(300) >= frames))
    assert [one[:2] for one in seldom if one[0] == "hanger_hardly_seen"] == [("hanger_hardly_seen", is_grave)]
    assert (len(seldom) == 1) == is_grave


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        (9, "the take has 9 frames, and a fit needs 20"), (19, "the take has 19 frames, and a fit needs 20"),
    ],
)  # fmt: skip
def test_a_take_of_too_few_frames_is_told_by_their_number(frames, words):
    (first, *_) = judge(swung(frames / 30))
    assert (first.name, first.words, first.is_grave) == ("too_short", words, True)


SECONDS = "give seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate"


@pytest.mark.parametrize(
    ("time", "says"),
    [
        ([], ""), ([7.0], ""), ([0, 0.2], ""), ([0, 0.001], ""), ([0, 0.01, 0.02, 600.02], ""),
        ([5, 5.01, 5.02, 605.03], "its times jump by 600.01 s after 0.02 s; split the recording there, or mend "
         "its clock"),
        ([0, 0.25], "has 4 frames a second; a garment needs 5 to 1000; record with more frames a second"),
        ([0, 1 / 1600], "has 1600 frames a second; a garment needs 5 to 1000; leave out frames"),
        ([0, 0.4], f"its frames are 0.4 s apart in the median; is its time in seconds? G{SECONDS[1:]}"),
        ([0, 0.0005], "its frames are 500 µs apart in the median, 2000 a second; cameras deliver 5 to 1000; give its "
         "time in seconds"),
        ([0, 1, 2], "its frames are 1 s apart in the median; its times are frame numbers, or milliseconds at 1000 "
         f"frames a second; {SECONDS}"),
        ([0, 200], f"its frames are 200 s apart in the median; are these milliseconds? G{SECONDS[1:]}"),
        ([0, 201], f"its frames are 201 s apart in the median; is its time in seconds? G{SECONDS[1:]}"),
        ([0, 1000], f"its frames are 1000 s apart in the median; are these microseconds? G{SECONDS[1:]}"),
    ],
)  # fmt: skip
def test_times_at_the_bounds_of_a_cameras_rates(time, says):
    time = np.array(time, float)
    if not says:
        return check_plausible_times(time, "a.csv")
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_times(time, "a.csv")
    assert str(refused.value) == f"a.csv: {says}"
    return None


@pytest.mark.parametrize(
    ("step", "rate", "says"),
    [
        (1, None, "states 1 frames a second; 5 to 1000 can be used"), (1 / 6, 5, ""), (1 / 5, 6, ""), (1 / 6, None, ""),
        (1 / 6, 4.9, "states 6 frames a second, and its header 4.9"),
        (1 / 5, 6.1, "states 5 frames a second, and its header 6.1"),
    ],
)  # fmt: skip
def test_two_frames_show_the_rate_that_a_file_states(step, rate, says):
    check_rate_alone(np.zeros(1), rate, "a.c3d")
    if not says:
        return check_rate_alone(np.array([0, step]), rate, "a.c3d")
    with pytest.raises(ImplausibleError) as refused:
        check_rate_alone(np.array([0, step]), rate, "a.c3d")
    assert str(refused.value) == f"a.c3d: {says}; export it again with its frame rate"
    return None


@pytest.mark.parametrize(
    ("step", "rate", "is_same"), [(1 / 6, 5, True), (1 / 5, 6, True), (1 / 6, 4.9, False), (1 / 5, 6.1, False)]
)
def test_two_times_show_their_rate_beside_the_stated_one(step, rate, is_same):
    check_stated_rate(np.zeros(1), rate, "a.csv")
    check_stated_rate(np.array([0, step]), None, "a.csv")
    if is_same:
        return check_stated_rate(np.array([0, step]), rate, "a.csv")
    says = f"a.csv: its times come at {1 / step:g} frames a second, and the file states {rate:g}"
    with pytest.raises(ImplausibleError) as refused:
        check_stated_rate(np.array([0, step]), rate, "a.csv")
    assert str(refused.value) == f"{says}; export it again with times in seconds"
    return None


KILOGRAMS = "weigh it and give kilograms"


@pytest.mark.parametrize(
    ("garment", "says"),
    [
        (panel(1.0, 1.0, 0.02), ""), (panel(1.0, 1.0, 1.5), ""), (panel(0.125, 0.125, 0.01), ""),
        (panel(1.0, 1.0, 6.0, layers=4), ""), (panel(0.1, 0.1, 0.01), ""), (panel(1.0, 3.0, 1.0), ""),
        (panel(1.0, 1.0, 0.019), f"mass_kg = 0.019 makes 0.019 kg/m2, fabric has 0.02 to 1.5; {KILOGRAMS}"),
        (panel(1.0, 1.0, 1.6), f"mass_kg = 1.6 makes 1.6 kg/m2, fabric has 0.02 to 1.5; {KILOGRAMS}"),
        (panel(1.0, 1.0, 40.0), "mass_kg = 40 makes 40 kg/m2, fabric has 0.02 to 1.5; were 40 grams meant, mass_kg = "
         f"0.04 (0.04 kg/m2)? W{KILOGRAMS[1:]}"),
        (panel(1.0, 1.0, 40.0, layers=2), "mass_kg = 40 makes 20 kg/m2, fabric has 0.02 to 1.5; were 40 grams meant, "
         f"mass_kg = 0.04 (0.02 kg/m2)? W{KILOGRAMS[1:]}"),
        (panel(1.0, 1.0, 48.0, layers=3), "mass_kg = 48 in 3 layers makes 16 kg/m2, fabric has 0.02 to 1.5; were 48 "
         f"ounces meant, mass_kg = 1.36078 (0.45 kg/m2)? W{KILOGRAMS[1:]}"),
        (panel(0.09, 0.09, 0.01), "outline_m is 0.09 m long, a garment 0.1 to 3 m; give metres"),
    ],
)  # fmt: skip
def test_a_garments_size_and_weight_at_their_bounds(garment, says):
    if not says:
        return check_plausible_garment(garment, "g.toml")
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_garment(garment, "g.toml")
    assert str(refused.value) == f"g.toml: {says}"
    return None


@pytest.mark.parametrize(("apart", "is_one"), [(0.0009, True), (0.001, False)])
def test_two_points_less_than_a_millimetre_apart_are_at_one_place(apart, is_one):
    garment = panel(1.0, 1.0, 0.2)
    (point,) = garment.points
    garment = msgspec.structs.replace(
        garment,
        points=tuple(
            msgspec.structs.replace(point, name=name, at_m=at)
            for name, at in (("a", (0.25, -0.5)), ("b", (0.0, 0.0)), ("c", (apart, 0.0)))
        ),
    )
    if not is_one:
        return check_plausible_garment(garment, "g.toml")
    with pytest.raises(ImplausibleError) as refused:
        check_plausible_garment(garment, "g.toml")
    says = "points: 'b' and 'c' are at one place, [0.0, 0.0]; give each point a place of its own"
    assert str(refused.value) == f"g.toml: {says}"
    return None
