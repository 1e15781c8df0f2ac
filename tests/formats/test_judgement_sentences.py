"""The exact sentences about a recording that cannot be fitted, on both sides of each limit."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.scene import RIG
from formats.garment import TrackedPoint
from formats.judgement import judge
from tests.formats.test_judgement import swung, with_points, without_hanger

NAMES = swung().garment.point_names


def imported(take):
    """The same take of motion capture, whose rig has neither a sensor nor a hanger's measures."""
    return dataclasses.replace(take, rig=msgspec.structs.replace(RIG, sensor=None, hanger=None))


def of_hanger(take, **changes):
    return dataclasses.replace(
        take, rig=msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(RIG.hanger, **changes))
    )


def held_at(take, left, right):
    """The same take of a rig whose held ends are so far below the markers [m]."""
    (x, _, z), (other, _, deep) = RIG.hanger.held_m
    return of_hanger(take, held_m=((x, left, z), (other, right, deep)))


def unseen(take, points, frames=slice(None)):
    valid = take.points_valid.copy()
    valid[frames, points] = False
    return dataclasses.replace(take, points_valid=valid)


def scaled(by):
    take = swung()
    middle = take.points.mean(1, keepdims=True)
    return with_points(take, middle + by * (take.points - middle))


def moved_by(reach):
    """A hanger that goes to and fro by so much, evenly, so that all but the first and last step of the way count."""
    take = swung()
    way = np.linspace(-reach / 2, reach / 2, len(take.time))[:, None, None] * [1.0, 0, 0]
    still = take.markers - take.markers.mean(1, keepdims=True) + [0, 0, 1.6]
    points = take.points - take.markers.mean(1, keepdims=True) + [0, 0, 1.6]
    return dataclasses.replace(with_points(take, points + way), markers=still + way)


def holes(*spans):
    take = swung()
    for span in spans:
        take = without_hanger(take, slice(*span))
    return take


SWING = "swing for five seconds or more, then hold still until the cloth hangs"
IN_VIEW = "bring the whole garment into view, with nothing before it"
ABOVE = (
    "the rig's hanger.held_m puts the held edge 70 mm above the markers, as y points down; "
    "drop the minus signs if it hangs below"
)
MEASURE = "measure it again, or choose the file of the garment that hangs there"


@pytest.mark.parametrize(
    ("take", "name", "is_grave", "words", "advice"),
    [
        (without_hanger(swung(), slice(17, None)), "hanger_hardly_seen", True,
         "both hanger markers were seen together in 17 of 180 frames",
         "turn both hanger markers to the sensor and record again"),
        (imported(without_hanger(swung(), slice(17, None))), "hanger_hardly_seen", True,
         "both ends of the held edge were seen together in 17 of 180 frames",
         "turn both ends of the held edge to the cameras and record again"),
        (without_hanger(swung(3.0), slice(9, None)), "hanger_hardly_seen", True,
         "both hanger markers were seen together in 9 of 90 frames",
         "turn both hanger markers to the sensor and record again"),
        (holes((30, 60)), "hanger_lost", False,
         "the two hanger markers were not seen together for 1.0 s from 1.0 s on; "
         "a fit leaves out that time and 2.5 s after it",
         "record again with both hanger markers in view from beginning to end"),
        (imported(holes((45, 75), (90, 150))), "hanger_lost", False,
         "the two ends of the held edge were not seen together for 2.0 s from 3.0 s on, in all 2 times for over 0.5 s; "
         "a fit leaves out that time and 2.5 s after it",
         "record again with both ends of the held edge in view from beginning to end"),
        (imported(holes((30, 60), (90, 150))), "hanger_lost", True,
         "the two ends of the held edge were not seen together for 2.0 s from 3.0 s on, in all 2 times for over 0.5 s; "
         "a fit leaves out that time and 2.5 s after it; intervals need 3 half-seconds of motion, and there are 2",
         "record again with both ends of the held edge in view from beginning to end"),
        (without_hanger(swung(), slice(25, None)), "too_short", True,
         "the take is too short: intervals need 3 half-seconds of motion, and there are 2", SWING),
        (swung(2.5), "too_short", False, "the take lasts 2.46 s, and none below 2.5 s is diagnosed", SWING),
        (dataclasses.replace(swung(), markers=swung().markers[:, ::-1]), "markers_swapped", True,
         "the hanger's first marker is on the right as the sensor sees it, not on the left",
         "turn the hanger's front to the sensor, or exchange the two markers' numbers in the rig"),
        (of_hanger(swung(), marker_distance_m=0.31), "markers_wrong_distance", False,
         "the markers are 300 mm apart as the sensor sees them, 310 mm as the rig says",
         "measure marker_distance_m again, centre to centre, or run `hangtime calibrate`"),
        (of_hanger(swung(), marker_distance_m=0.29), "markers_wrong_distance", False,
         "the markers are 300 mm apart as the sensor sees them, 290 mm as the rig says",
         "measure marker_distance_m again, centre to centre, or run `hangtime calibrate`"),
        (moved_by(0.0303), "hardly_moved", False,
         "the hanger moved by 30 mm at most, which shows next to nothing of the cloth",
         "swing it to and fro by the width of a hand or more"),
        (unseen(swung(), slice(None)), "garment_never_seen", True, "no point of the garment was ever seen",
         "let it hang free below the hanger, 8 cm or more before any wall"),
        (held_at(unseen(swung(), slice(None)), -0.09, -0.07), "garment_never_seen", True,
         "no point of the garment was ever seen", ABOVE),
        (held_at(unseen(swung(), [0, 1]), -0.07, -0.07), "points_never_seen", False,
         f"{NAMES[0]}, {NAMES[1]} were never seen", ABOVE),
        (held_at(unseen(swung(), slice(None)), -0.09, 0.0), "garment_never_seen", True,
         "no point of the garment was ever seen", "let it hang free below the hanger, 8 cm or more before any wall"),
        (unseen(swung(), [2]), "points_never_seen", False, f"{NAMES[2]} was never seen", IN_VIEW),
        (unseen(swung(), [1, 2]), "points_never_seen", False, f"{NAMES[1]}, {NAMES[2]} were never seen", IN_VIEW),
        (unseen(swung(), [0, 1]), "points_never_seen", False, f"{NAMES[0]}, {NAMES[1]} were never seen",
         "measure hanger.held_m again: by its ends the held edge is 40 cm wide"),
        (imported(unseen(swung(), [0, 1])), "points_never_seen", False,
         f"{NAMES[0]}, {NAMES[1]} were never seen", IN_VIEW),
        (scaled(0.84), "garment_smaller", False,
         "the garment is smaller than described: top_right and bottom_right are at "
         "most 38 cm apart, 45 cm in its file", MEASURE),
        (scaled(1.11), "garment_larger", False,
         "the garment is larger than described: bottom_right and bottom_left are at "
         "most 55 cm apart, 50 cm in its file", MEASURE),
    ],
    ids=range(22),
)  # fmt: skip
def test_a_finding_says_what_is_wrong_and_what_to_do(take, name, is_grave, words, advice):
    (found,) = judge(take)
    assert found.as_fact() == {"name": name, "words": words, "advice": advice, "is_grave": is_grave}


@pytest.mark.parametrize(
    "take",
    [
        holes((30, 44)),
        imported(dataclasses.replace(swung(), markers=swung().markers[:, ::-1])),
        of_hanger(swung(), marker_distance_m=0.309), of_hanger(swung(), marker_distance_m=0.2915),
        moved_by(0.0304), scaled(0.86), scaled(1.09), imported(scaled(1.0)),
        dataclasses.replace(swung(), time=swung().time * (2.5 / swung().time[-1])),
    ],
    ids=range(9),
)  # fmt: skip
def test_a_take_just_within_a_bound_has_none_of_its_findings(take):
    assert judge(take) == ()


@pytest.mark.parametrize(("take", "over"), [(swung(), 18), (swung(3.0), 10)])
def test_a_hanger_of_a_tenth_of_the_frames_is_seen_in_too_few(take, over):
    (finding,) = judge(without_hanger(take, slice(over, None)))
    assert (finding.name, finding.is_grave) == ("too_short", True)
    assert finding.words == f"the two hanger markers were seen together in {over} frames, and a fit needs 20"


@pytest.mark.parametrize(("over", "names"), [(29, ["hanger_hardly_seen", "too_short"]), (30, ["too_short"])])
def test_a_hanger_of_twenty_sights_is_hardly_seen_below_a_tenth_of_the_frames(over, names):
    """Below that many sights a fit refuses the take. At 15 a second, 29 of them last 1.9 s."""
    take = swung(10.0)
    found = judge(without_hanger(dataclasses.replace(take, time=2 * take.time), slice(over, None)))
    assert [(one.name, one.is_grave) for one in found if one.name != "garment_hardly_seen"] == [
        (name, False) for name in names
    ]


def test_grave_findings_come_first_and_each_kind_in_its_order():
    take = moved_by(0.01)
    take = dataclasses.replace(take, time=take.time / 4, markers=take.markers[:, ::-1])
    assert [found.name for found in judge(take)] == ["markers_swapped", "too_short", "hardly_moved"]


@pytest.mark.parametrize(("count", "more"), [(5, ""), (6, " and 1 more"), (8, " and 3 more")])
def test_five_points_that_were_never_seen_are_named(count, more):
    """Of points beside those of the outline."""
    take = swung()
    extra = tuple(TrackedPoint(name=f"p{k}", at_m=(0.01 * k, -0.2)) for k in range(count))
    garment = msgspec.structs.replace(take.garment, points=(*take.garment.points, *extra))
    frames, points = len(take.time), len(garment.points)
    whole = np.full((frames, points, 3), np.nan)
    whole[:, : len(NAMES)] = take.points
    take = dataclasses.replace(
        take, garment=garment, points=whole, points_valid=np.isfinite(whole).all(2), points_sd=np.ones(whole.shape)
    )
    (found,) = judge(take)
    assert found.words == f"p0, p1, p2, p3, p4{more} were never seen"


def test_sizes_are_reported_from_ten_frames_on_in_which_both_points_are_seen():
    few, enough = (unseen(scaled(1.2), [0, 2], slice(seen, None)) for seen in (9, 10))
    assert [found.name for found in judge(few)] == ["points_hardly_seen"]
    assert [found.name for found in judge(enough)] == ["points_hardly_seen", "garment_larger"]


def test_points_of_the_held_edge_alone_determine_neither_size_nor_gravity():
    take = swung()
    garment = msgspec.structs.replace(take.garment, points=take.garment.points[:2])
    take = with_points(take, 1.2 * take.points[:, :2])
    take = dataclasses.replace(
        take, garment=garment, points_valid=take.points_valid[:, :2], points_sd=take.points_sd[:, :2]
    )
    assert judge(take) == ()


@pytest.mark.parametrize(("seen", "is_reported"), [(9, False), (10, True)])
def test_gravity_is_reported_from_ten_frames_on_in_which_all_that_hangs_is_seen(seen, is_reported):
    take = dataclasses.replace(swung(), rig=msgspec.structs.replace(RIG, gravity=(0.6, 0.8, 0.0)))
    found = judge(unseen(take, [2], slice(seen, None)))
    assert [one.name for one in found] == ["points_hardly_seen", *["gravity_off"] * is_reported]
    found = found[1:]
    if is_reported:
        assert found[0].words.startswith("the garment hangs 3")
        assert found[0].words.endswith(" degrees off the rig's gravity, along [0.00, 1.00, 0.00]")
        assert found[0].advice == (
            "measure gravity with `hangtime calibrate`; x is to the right, y down, z away from the sensor"
        )
