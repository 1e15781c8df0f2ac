"""A take that a fit refuses, or that misleads a fit, is reported with its true cause; a good take is not."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.scene import RIG
from formats import judged_cloth, judgement
from formats.garment import TrackedPoint
from formats.hanger import held_ends
from formats.judgement import FEW_SIGHTS, judge
from formats.sights import below_held_edge, judged_points, on_held_edge, reach, sights_of
from formats.two_clocks import at_times, with_hanger
from tests.formats.test_judgement import named, swung, with_points, without_hanger
from tests.formats.test_judgement_sentences import imported, unseen

FLAT = np.array([point.at_m for point in swung().garment.points])


def told(take):
    return [(one.name, one.is_grave, one.words) for one in judge(take)]


def turned(places, degrees):
    """Places [m], (..., 3), turned in the picture about their middle."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    middle = places.mean(-2, keepdims=True)
    return middle + (places - middle) @ turn.T


def of_markers(take, markers):
    """The take whose held ends follow from the markers, 10 cm above the held edge."""
    rig = msgspec.structs.replace(
        RIG, hanger=msgspec.structs.replace(RIG.hanger, held_m=((-0.2, 0.1, 0.0), (0.2, 0.1, 0.0)))
    )
    return dataclasses.replace(take, rig=rig, markers=markers, held=held_ends(markers, rig))


def exchanged(take, frames):
    points = take.points.copy()
    points[frames, :2] = points[frames, 1::-1]
    return imported(dataclasses.replace(with_points(take, points), markers=points[:, :2]))


def test_cloth_that_is_seen_in_one_of_600_frames_cannot_be_fitted():
    take = swung(20.0)
    once = unseen(take, slice(None), np.arange(600) != 300)
    assert told(once) == [
        ("garment_hardly_seen", True, "points below the held edge were seen in 1 of 600 frames")
    ]  # fmt: skip


def test_cloth_that_is_seen_in_less_than_a_tenth_of_the_frames_is_reported():
    take = swung(20.0)
    seldom, enough = (unseen(take, slice(None), np.arange(600) % step != 0) for step in (11, 10))
    assert told(seldom) == [
        ("garment_hardly_seen", False, "points below the held edge were seen in 55 of 600 frames")
    ]  # fmt: skip
    assert told(enough) == []


def test_a_single_point_that_is_hardly_ever_seen_is_named():
    seldom = unseen(swung(), [2], np.arange(180) >= 17)
    assert told(seldom) == [("points_hardly_seen", False, "bottom_right was seen in 17 of 180 frames")]
    assert told(unseen(swung(), [2], np.arange(180) >= 18)) == []


def test_cloth_that_is_seen_only_while_the_hanger_is_not_cannot_be_fitted():
    take = unseen(without_hanger(swung(20.0), slice(300, None)), slice(None), slice(0, 300))
    words = (
        "points below the held edge were seen in 300 of 600 frames, and in 0 of them while the hanger's path is known"
    )
    assert told(take) == [("garment_hardly_seen", True, words)]


def test_hanger_and_cloth_in_turn_frame_by_frame_are_no_fault():
    """The hanger's path is led across its gaps of 1/15 s."""
    odd = np.arange(180) % 2 == 1
    assert named(unseen(without_hanger(swung(), odd), slice(None), ~odd)) == []


def test_cloth_that_is_seen_only_soon_after_a_gap_of_the_hanger_is_not_counted():
    """The gap ends at 4 s; the cloth has forgotten the motion in it at 6.5 s, and is seen until 6 s."""
    gap = unseen(without_hanger(swung(10.0), slice(60, 120)), slice(None), np.r_[0:60, 180:300])
    (finding,) = [one for one in told(gap) if one[0] != "hanger_lost"]
    words = (
        "points below the held edge were seen in 120 of 300 frames, and in 0 of them while the hanger's path is known"
    )
    assert finding == ("garment_hardly_seen", True, words)


def test_cloth_that_is_lost_together_with_the_hanger_is_reported_once():
    both = unseen(without_hanger(swung(10.0), slice(60, 150)), slice(None), slice(60, 150))
    assert named(both) == ["hanger_lost"]


def with_middle_of_edge(take, held):
    """The take with a sixth point, in the middle of an edge that is held along it or at its corners."""
    middle = TrackedPoint(name="middle", at_m=(0.0, 0.0))
    garment = msgspec.structs.replace(take.garment, held=held, points=(*take.garment.points, middle))
    points = np.concatenate([take.points, take.points[:, :2].mean(1, keepdims=True)], 1)
    valid, sd = np.ones(points.shape[:2], bool), np.full(points.shape, 3e-3)
    return dataclasses.replace(with_points(take, points), garment=garment, points_valid=valid, points_sd=sd)


def test_cloth_of_which_only_points_on_a_clamped_edge_are_seen_is_never_seen():
    (finding,) = told(unseen(with_middle_of_edge(swung(), "edge"), [2, 3, 4]))
    assert finding == ("garment_never_seen", True, "no point below the held edge was ever seen")


def test_a_point_between_two_held_corners_is_cloth():
    """An edge between two clips sags and swings, so a fit takes its points. The rest of the cloth may be lost."""
    take = with_middle_of_edge(swung(10.0), "corners")
    assert on_held_edge(take.garment).tolist() == [True, True, False, False, False, False]
    assert below_held_edge(take.garment).tolist() == [False, False, True, True, True, False]
    never = ("garment_never_seen", False, "no point below the held edge was ever seen")
    assert told(unseen(take, [2, 3, 4])) == [never]
    lost = ("garment_lost", False, "no point below the held edge was seen for 6.0 s from 2.0 s on")
    assert told(unseen(take, [2, 3, 4], slice(60, 240))) == [lost]


def test_of_two_points_below_the_held_edge_the_others_count_as_well():
    """Two points show no shape of the cloth."""
    (*corners, _) = swung().garment.points
    few = msgspec.structs.replace(swung().garment, points=tuple(corners))
    assert on_held_edge(few).tolist() == [True, True, False, False]
    assert judged_points(few).all()
    assert judged_points(swung().garment).tolist() == [False, False, True, True, True]


@pytest.mark.parametrize(("down", "is_on"), [(0.0089, True), (0.0091, False)])
def test_a_point_is_on_the_held_edge_within_two_percent_of_the_garments_height(down, is_on):
    """The skirt is 0.45 m high, whatever part of it has points."""
    low = TrackedPoint(name="low", at_m=(0.1, -down))
    garment = msgspec.structs.replace(swung().garment, points=(*swung().garment.points[:2], low))
    assert on_held_edge(garment).tolist() == [True, True, is_on]


def test_hanger_and_cloth_that_are_seen_together_for_two_seconds_are_too_short():
    take = unseen(without_hanger(swung(20.0), slice(360, None)), slice(None), slice(0, 300))
    assert [words for name, _, words in told(take) if name == "too_short"] == [
        "garment and hanger were seen together over 2.0 s, and no motion below 2.5 s is diagnosed"
    ]


@pytest.mark.parametrize(("frames", "names"), [(slice(60, 240), ["garment_lost"]), (slice(60, 130), [])])
def test_cloth_that_is_gone_for_long_in_between_is_reported(frames, names):
    found = judge(unseen(swung(10.0), slice(None), frames))
    assert [one.name for one in found] == names
    for one in found:
        assert one.words == "no point below the held edge was seen for 6.0 s from 2.0 s on"


def frozen(take, points, frames):
    places = take.points.copy()
    places[frames, points] = places[frames.start, points]
    return dataclasses.replace(take, points=places)


def test_points_that_keep_their_position_while_the_hanger_swings_are_reported():
    both = frozen(swung(10.0), slice(2, 4), slice(60, 151))
    words = (
        "bottom_right, bottom_left kept their exact positions while the hanger moved, for 3.0 s from 2.0 s on at most"
    )
    assert told(both) == [("points_stand", False, words)]
    longer = frozen(both, 2, slice(60, 181))
    assert told(longer)[0][2].endswith("for 4.0 s from 2.0 s on at most")
    one = frozen(swung(10.0), 2, slice(60, 76))
    assert told(one) == []  # 0.5 s
    (finding,) = told(frozen(swung(10.0), 2, slice(60, 80)))
    assert finding[2] == "bottom_right kept its exact position while the hanger moved, for 0.6 s from 2.0 s on"


def test_cloth_may_keep_its_position_under_a_hanger_that_rests():
    """In takes without noise, and where a body of its own holds the hanger."""
    take = swung(10.0)
    rests = take.time > 4.0
    for places in (take.points, take.markers):
        places[rests] = places[120]
    assert named(take) == []


def test_a_swing_of_one_second_in_a_minute_is_no_hanger_that_hardly_moves():
    """It goes 20 cm, in 1 of 60 s; percentiles 1 and 99 of all positions see next to nothing of it."""
    take = swung(60.0)
    rests = (take.time < 30) | (take.time > 31)
    for places in (take.points, take.markers):
        places[rests] = places[0]
    assert named(take) == []


def test_a_single_bad_sight_of_the_hanger_is_no_motion():
    take = swung(reach=0.0)
    take.markers[90] += [0.1, 0, 0]
    assert [words for name, _, words in told(take) if name == "hardly_moved"] == [
        "the hanger moved by 0 mm at most, which shows next to nothing of the cloth"
    ]


def swings(rate, frequency):
    """Both ends of a bar that swings by 1 m, for three seconds, from each of thirty phases; (sights, 2, 3)."""
    time = np.arange(3 * rate) / rate
    for phase in np.linspace(0, 2 * np.pi, 30):
        way = 0.5 * np.sin(2 * np.pi * frequency * time + phase)
        yield np.stack([way, 0 * way, 0 * way], 1)[:, None].repeat(2, 1)


@pytest.mark.parametrize(
    ("rate", "frequency", "least"), [(9, 1.0, 0.97), (9, 1.5, 0.86), (9, 2.0, 0.97), (30, 1.5, 0.98)]
)
def test_a_swing_reaches_nearly_as_far_in_few_sights_a_second(rate, frequency, least):
    """Half a step from its turning point, at 60 degrees a step, a swing has the cosine of 30 degrees, 0.866."""
    assert all(least <= reach(places) <= 1.0 for places in swings(rate, frequency))


def test_one_bad_sight_among_five_is_no_motion_and_among_four_it_is():
    places = np.zeros((5, 2, 3))
    places[2, 1, 0] = 0.1
    assert reach(places) == 0.0
    assert reach(places[:4]) == pytest.approx(0.1)


def test_a_hanger_that_swings_by_31_millimetres_at_nine_frames_a_second_moves():
    """At 40 degrees a step one turning point is seen, and the other by the cosine of 20 degrees: 30.1 mm."""
    take = swung(5.0, reach=0.0)
    way = 0.0155 * np.sin(2 * np.pi * np.arange(150) / 9)[:, None, None] * [1.0, 0, 0]
    slow = dataclasses.replace(
        with_points(take, take.points + way), markers=take.markers + way, time=np.arange(150) / 9
    )
    assert named(slow) == []


def test_ends_of_the_cloth_that_are_nearer_than_the_hangers_markers_fold_the_held_edge():
    """The markers are 40 cm apart, the two upper corners of the cloth 30 cm."""
    take = swung()
    points = take.points.copy()
    middle = points.mean(1)[:, 0]
    for point, half in ((0, -0.15), (1, 0.15), (2, 0.15), (3, -0.15)):
        points[:, point, 0] = middle + half
    ((name, is_grave, words),) = told(dataclasses.replace(take, points=points))
    assert (name, is_grave) == ("held_edge_folds", False)
    assert "its ends are at most 30 cm apart, 40 cm in the garment's file" in words


@pytest.mark.parametrize("bottom", [0.15, 0.2])
def test_hands_that_are_nearer_together_than_the_cloth_is_wide_fold_the_held_edge(bottom):
    """The sides are as long as on the table, hence the garment is not smaller."""
    take = swung()
    points = take.points.copy()
    middle = points.mean(1)[:, 0]
    for point, half in ((0, -0.15), (1, 0.15), (2, bottom), (3, -bottom)):
        points[:, point, 0] = middle + half
    (finding,) = told(imported(with_points(take, points)))
    words = "the held edge folds or sags: its ends are at most 30 cm apart, 40 cm in the garment's file"
    assert finding == ("held_edge_folds", False, words)
    corners = msgspec.structs.replace(take.garment, held="corners")
    assert named(imported(dataclasses.replace(with_points(take, points), garment=corners))) == []  # it may sag there


def test_held_ends_that_are_exchanged_in_some_frames_are_reported_with_number_and_second():
    take = swung(800 / 30)
    frames = np.zeros(800, bool)
    frames[200:215] = frames[500:515] = True
    words = "left and right end of the held edge are exchanged in 30 of 800 frames, first at 6.67 s"
    assert told(exchanged(take, frames)) == [("ends_exchanged", True, words)]
    words = "left and right end of the held edge are exchanged in 30 of 800 frames, first at 0.00 s"
    assert told(exchanged(take, slice(0, 30))) == [("ends_exchanged", True, words)]
    (finding,) = judge(exchanged(take, frames))
    assert finding.advice == "check which is which there, then correct the labels or record again"


def test_held_ends_are_exchanged_at_nine_frames_a_second_too():
    """Nothing is faster than 4 m/s there: ends 40 cm apart change places in 0.11 s."""
    take = swung(10.0)
    slow = dataclasses.replace(exchanged(take, slice(150, 155)), time=take.time * 30 / 9)
    assert told(slow)[0][2].startswith("left and right end of the held edge are exchanged in 5 of 300 frames")


def turning(time, angle):
    """A hanger that turns about the vertical by an angle [rad], (frames,), with its cloth."""
    turn = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], -1)
    points = [0, 0, 1.6] + FLAT[:, :1] * turn[:, None] - FLAT[:, 1:] * [0, 1, 0]
    take = swung(len(time) / 30)
    return imported(dataclasses.replace(with_points(take, points), markers=points[:, :2], time=time))


def test_a_hanger_that_is_twisted_by_hand_is_not_exchanged():
    """By 60 degrees to each side at 1 Hz, seen at 9 frames a second: 42 degrees from frame to frame at most."""
    time = np.arange(300) / 9
    assert named(turning(time, np.radians(60) * np.sin(2 * np.pi * time))) == []


def test_a_hanger_that_turns_while_it_is_not_seen_is_not_exchanged():
    """By 4 rad/s, and 99 degrees in 0.43 s."""
    time = np.arange(300) / 30
    take = turning(time, np.clip(4 * (time - 4), 0, np.pi))
    assert named(without_hanger(take, slice(125, 137))) == []


def test_an_imported_hanger_of_a_late_clock_does_not_put_the_points_far_off():
    """Up to 0.9 m/s and 0.3 s late: a fit takes up to 0.5 s out."""
    take = imported(swung(10.0, reach=0.15))
    arm = np.arange(1.0, 9.0, 0.05)
    assert named(with_hanger(take, arm, at_times(arm - 0.3, take.time, take.held), 1e-3)) == []
    wrong = with_hanger(take, arm, np.add(at_times(arm, take.time, take.held), [0.3, 0, 0]), 1e-3)
    assert named(wrong) == ["point_far_off"]


def test_a_hanger_that_jumps_is_reported_with_its_second():
    take = swung()
    points = take.points.copy()
    points[90:95, 0] += [0.0, 0.3, 0.0]
    jumps = imported(dataclasses.replace(with_points(take, points), markers=points[:, :2]))
    assert told(jumps)[0] == ("hanger_jumps", True, "the hanger jumps at 2.97 s, as no hand moves it")
    assert judge(jumps)[0].advice == "check the ends of the held edge there, then record again"


@pytest.mark.parametrize("degrees", [20, 45, 90])
def test_markers_that_lie_oblique_on_the_hanger_put_the_held_ends_elsewhere(degrees):
    """The held edge is level, and its corners are seen where they are."""
    found = told(of_markers(swung(), turned(swung().markers, degrees)))
    assert [(name, is_grave) for name, is_grave, _ in found if name == "point_far_off"] == [("point_far_off", True)]


@pytest.mark.parametrize("degrees", [-40, -20, 20, 40])
def test_a_hanger_that_is_held_oblique_is_no_fault(degrees):
    """The sides of the cloth hang plumb below the held ends: at 40 degrees its diagonal is longer by 28 %."""
    take = swung()
    markers = turned(take.markers, degrees)
    tilted = of_markers(take, markers)
    bar = (tilted.held[:, 1:] - tilted.held[:, :1]) / 0.4
    points = tilted.held.mean(1, keepdims=True) + FLAT[:, :1] * bar - FLAT[:, 1:] * [0, 1, 0]
    assert named(dataclasses.replace(tilted, points=points)) == []


def test_held_ends_that_are_far_too_near_or_apart_are_another_unit():
    take = swung()
    points = take.points.copy()
    points[:, :2, 0] = points[:, :2, 0].mean(1, keepdims=True) + np.array([-0.04, 0.04])
    (finding, *_) = told(imported(with_points(take, points)))
    assert finding == ("held_ends_apart", True, "the held ends are 80 mm apart, the garment's held edge is 400 mm long")


def test_a_hanger_of_nineteen_sights_is_too_little_for_a_fit_however_long_they_last():
    take = without_hanger(swung(20 / 30), slice(19, None))
    slow = dataclasses.replace(take, time=take.time * 30 / 4)
    words = "the two hanger markers were seen together in 19 frames, and a fit needs 20"
    assert ("too_short", True, words) in told(slow)
    more = swung(20 / 30)
    assert "too_short" not in named(dataclasses.replace(more, time=more.time * 30 / 4))


def test_points_count_only_in_pictures_between_the_first_and_the_last_sight_of_the_hanger():
    take = imported(swung(10.0))
    arm = np.arange(1.01, 9.0, 0.05)
    both = with_hanger(take, arm, at_times(arm, take.time, take.held), 1e-3)
    sights = sights_of(both)
    assert sights.held.sum() == len(arm)
    assert both.time[sights.within].tolist() == take.time[(take.time > 1.01) & (take.time < arm[-1])].tolist()
    assert (sights.is_known == sights.within).all()


def test_without_any_sight_of_the_hanger_no_point_counts():
    never = without_hanger(swung(3.0), slice(None))
    assert not sights_of(never).within.any()
    assert told(never) == [("hanger_hardly_seen", True, "both hanger markers were seen together in 0 of 90 frames")]


@pytest.mark.parametrize("at", [0, 1])
def test_the_longest_of_several_spells_is_named(at, monkeypatch):
    """4 s from 1 s on, and 1 s from 7 s on, in either order of the points."""
    take = swung(10.0)
    spells = [(1.0, 5.0), (7.0, 8.0)]
    found = [(2 + k, *spells[(k + at) % 2]) for k in range(2)]
    monkeypatch.setattr(judged_cloth, "standing", lambda *given: found)
    (one,) = [one for one in judge(take) if one.name == "points_stand"]
    start = 1.0 - float(take.time[0])
    assert f"for 4.0 s from {start:.1f} s on at most" in one.words


@pytest.mark.parametrize(("sights", "is_judged_anew"), [(FEW_SIGHTS - 1, True), (FEW_SIGHTS, False)])
def test_cloth_with_few_sights_is_judged_without_its_impossible_ones(sights, is_judged_anew, monkeypatch):
    """A take with the same sights is judged once."""
    take, other, judged = swung(2.0), swung(3.0), []
    monkeypatch.setattr(judgement, "cloth_findings", lambda one, found: judged.append(one) or [])
    monkeypatch.setattr(judgement, "fitted_sights", lambda *given: sights)
    monkeypatch.setattr(judgement, "without_impossible", lambda *given: other)
    judgement._cloth(take, None)
    assert [one is other for one in judged] == [False, True] if is_judged_anew else [False]
    del judged[:]
    monkeypatch.setattr(judgement, "without_impossible", lambda *given: take)
    judgement._cloth(take, None)
    assert len(judged) == 1
