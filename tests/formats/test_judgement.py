"""Findings on finished takes of the synthetic world, good and spoilt ones."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.scene import RIG, demo_garment
from formats.judgement import judge
from formats.take import FrameState, Take

FPS = 30


def swung(seconds=6.0, reach=0.1):
    """A skirt that hangs straight and is swung sideways by 10 cm, seen without a fault; sensor frame [m]."""
    time = np.arange(round(seconds * FPS)) / FPS
    moved = np.stack([reach * np.sin(2 * np.pi * time), 0 * time, 0 * time + 1.6], -1)
    flat = np.array([point.at_m for point in demo_garment().points])
    points = moved[:, None] + np.concatenate([flat * [1, -1], np.zeros((len(flat), 1))], 1)
    markers = moved[:, None] + np.array([[-0.15, -0.1, 0.0], [0.15, -0.1, 0.0]])
    return Take(
        take_id="t", created="now", rig=RIG, garment=demo_garment(), time=time, held=points[:, :2],
        held_valid=np.ones((len(time), 2), bool), held_sd=np.full((len(time), 2, 3), 1e-3), points=points,
        points_valid=np.ones((len(time), len(flat)), bool), points_sd=np.full(points.shape, 3e-3),
        state=np.zeros(len(time), np.uint16), markers=markers,
    )  # fmt: skip


def without_hanger(take, frames):
    markers = take.markers.copy()
    markers[frames] = np.nan
    return dataclasses.replace(take, markers=markers)


def with_points(take, points):
    """The same take, held at the first two of other points."""
    return dataclasses.replace(take, points=points, held=points[:, :2])


def named(take):
    return [finding.name for finding in judge(take)]


def test_a_whole_take_has_no_finding():
    assert judge(swung()) == ()


def test_a_hanger_that_was_lost_in_between_is_reported_with_its_time():
    """Frames 30 to 59 at 30 a second: from the sight at 0.97 s to that at 2.00 s are 1.03 s."""
    (finding,) = judge(without_hanger(swung(), slice(30, 60)))
    assert (finding.name, finding.is_grave) == ("hanger_lost", False)
    assert "for 1.0 s from 1.0 s on; a fit leaves out that time and 2.5 s after it" in finding.words
    assert named(without_hanger(swung(), slice(30, 44))) == []  # 0.5 s from sight to sight can be led across
    assert named(without_hanger(swung(), slice(0, 60))) == []  # comes late


@pytest.mark.parametrize(("first", "is_grave"), [(5, True), (6, True), (7, False)])
def test_a_hanger_that_was_lost_is_grave_where_fewer_than_20_sights_of_points_count(first, is_grave):
    """At 6 a second the 15 frames from the sight behind the gap on, 2.5 s long, do not count: here all that are left.

    Three points hang below the held edge, and 7 frames have 21 sights of them. They last into the third half second.
    """
    take = swung((first + 42) / FPS)
    take = dataclasses.replace(take, time=5 * take.time)
    found = {one.name: one.is_grave for one in judge(without_hanger(take, slice(first, first + 27)))}
    assert found["hanger_lost"] == is_grave


@pytest.mark.parametrize("lost", [slice(36, None), slice(0, -36)])
def test_a_hanger_that_is_lost_until_the_end_or_from_the_beginning_leaves_too_short_a_motion(lost):
    """36 of 240 frames are enough to be a hanger, and 1.2 s of them no motion to be diagnosed."""
    (finding,) = [one for one in judge(without_hanger(swung(8.0), lost)) if one.name == "too_short"]
    assert finding.words.startswith("the two hanger markers were seen together over 1.2 s, and no motion below 2.5 s")


def test_a_hanger_that_was_hardly_seen_is_the_only_finding():
    (finding,) = judge(without_hanger(swung(), slice(9, None)))
    assert (finding.name, finding.is_grave) == ("hanger_hardly_seen", True)
    assert "in 9 of 180 frames" in finding.words


def test_swapped_markers_are_grave():
    take = swung()
    found = judge(dataclasses.replace(take, markers=take.markers[:, ::-1]))
    assert [(finding.name, finding.is_grave) for finding in found] == [("markers_swapped", True)]


def test_swapped_markers_are_reported_without_the_points_that_were_sought_on_the_wrong_side():
    """Two points were never seen, or the garment for two seconds alone."""
    unseen, short = swung().points_valid.copy(), swung().points_valid.copy()
    unseen[:, 2:4] = short[60:] = False
    for valid, name in ((unseen, "points_never_seen"), (short, "too_short")):
        take = dataclasses.replace(swung(), points_valid=valid)
        assert name in named(take)
        assert named(dataclasses.replace(take, markers=take.markers[:, ::-1])) == ["markers_swapped"]


def test_another_grave_finding_comes_before_that_of_a_short_take():
    """A longer one would have it too."""
    for frames in (10, 19):
        take = swung(frames / 30)
        found = judge(dataclasses.replace(take, markers=take.markers[:, ::-1]))
        names = [finding.name for finding in found if finding.is_grave]
        assert (names[0], names[-1]) == ("markers_swapped", "too_short")


@pytest.mark.parametrize(("told", "names"), [(0.305, []), (0.295, []), (0.315, ["markers_wrong_distance"])])
def test_a_wrong_marker_distance_is_reported_from_three_percent_on(told, names):
    """The markers are 300 mm apart."""
    rig = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(RIG.hanger, marker_distance_m=told))
    assert named(dataclasses.replace(swung(), rig=rig)) == names


def test_a_hanger_that_moves_by_two_centimetres_hardly_moves():
    (finding,) = judge(swung(reach=0.01))
    assert (finding.name, finding.is_grave) == ("hardly_moved", False)
    assert "20 mm at most" in finding.words
    assert named(swung(reach=0.02)) == []


def test_points_that_were_never_seen_are_named():
    take = swung()
    take.points_valid[:, 2] = False
    (finding,) = judge(take)
    assert finding.words == "bottom_right was never seen"
    take.points_valid[:] = False
    assert named(take) == ["garment_never_seen"]


@pytest.mark.parametrize(
    ("scale", "names"), [(0.8, ["garment_smaller"]), (0.9, []), (1.05, []), (1.2, ["garment_larger"])]
)
def test_a_garment_of_another_size_than_its_file_says_is_reported(scale, names):
    take = swung()
    middle = take.points.mean(1, keepdims=True)
    assert named(with_points(take, middle + scale * (take.points - middle))) == names


@pytest.mark.parametrize(("scale", "names"), [(1.0, []), (1.05, []), (1.2, ["garment_larger"])])
@pytest.mark.parametrize("deviation", [0.02, 0.03])
def test_noise_that_the_take_states_makes_no_garment_larger(scale, names, deviation):
    """The percentile 95 of a distance between two such positions is 1.645 x 1.41 x 30 mm = 70 mm larger."""
    take = swung(seconds=10.0)
    middle = take.points.mean(1, keepdims=True)
    noise = np.random.default_rng(0).normal(0, deviation, take.points.shape)
    take = with_points(take, middle + scale * (take.points - middle) + noise)
    assert named(dataclasses.replace(take, points_sd=np.full(take.points.shape, deviation))) == names
    unknown = dataclasses.replace(take, points_sd=np.full(take.points.shape, np.inf))
    assert named(unknown) == ["garment_larger"]


def test_noise_that_is_stated_and_not_there_hides_no_larger_garment():
    take = swung()
    middle = take.points.mean(1, keepdims=True)
    take = with_points(take, middle + 1.15 * (take.points - middle))
    take.points[7, 2] = take.points[7, 3]  # two corners are in one place for once
    assert named(dataclasses.replace(take, points_sd=np.full(take.points.shape, 0.03))) == ["garment_larger"]


def test_a_take_of_two_seconds_is_too_short():
    assert named(swung(seconds=2.0)) == ["too_short"]


@pytest.mark.parametrize(("degrees", "names"), [(14, []), (16, ["gravity_off"])])
def test_gravity_that_is_not_where_the_garment_hangs_is_reported_from_fifteen_degrees_on(degrees, names):
    """The skirt hangs along y of the sensor; the rig says that the sensor looks down."""
    tilted = (0.0, float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees))))
    take = swung()
    off = dataclasses.replace(take, rig=msgspec.structs.replace(RIG, gravity=tilted))
    held_at_the_markers = msgspec.structs.replace(RIG.hanger, held_m=((-0.2, 0.0, 0.0), (0.2, 0.0, 0.0)))
    off = dataclasses.replace(off, rig=msgspec.structs.replace(off.rig, hanger=held_at_the_markers))
    assert named(off) == names
    for finding in judge(off):
        assert finding.words == f"the garment hangs {degrees} degrees off the rig's gravity, along [0.00, 1.00, 0.00]"


def test_held_ends_that_are_never_seen_while_the_rest_is_are_the_rigs():
    take = swung()
    take.points_valid[:, :2] = False
    (finding,) = judge(take)
    assert finding.advice == "measure hanger.held_m again: by its ends the held edge is 40 cm wide"


@pytest.mark.parametrize("way", ["twist", "seesaw"])
def test_a_hanger_that_turns_about_its_middle_moves(way):
    take = swung(reach=0.0)
    angle = 0.5 * np.sin(2 * np.pi * take.time)
    side = np.stack([np.cos(angle), 0 * angle, 0 * angle], -1)
    side[:, 2 if way == "twist" else 1] = np.sin(angle)
    middle = take.markers.mean(1, keepdims=True)
    turned = middle + 0.15 * np.array([-1.0, 1.0])[:, None] * side[:, None]
    assert "hardly_moved" in named(take)
    assert "hardly_moved" not in named(dataclasses.replace(take, markers=turned))


def test_the_hanger_of_a_slower_clock_is_counted_among_its_own_frames():
    """It shows in each twelfth frame, whenever it was measured."""
    take = swung(seconds=30.0)
    alone = np.arange(len(take.time)) % 12 != 0
    state = np.where(alone, FrameState.POINTS_ALONE, 0).astype(np.uint16)
    of_two = dataclasses.replace(without_hanger(take, alone), state=state)
    assert named(of_two) == []
    (finding,) = judge(dataclasses.replace(of_two, state=np.zeros_like(state)))
    assert finding.name == "hanger_hardly_seen"
    assert "in 75 of 900 frames" in finding.words


def test_a_take_of_few_frames_is_too_short_and_not_unseen():
    (finding,) = judge(swung(seconds=0.3))
    assert (finding.name, finding.is_grave, finding.words) == (
        "too_short",
        True,
        "the take has 9 frames, and a fit needs 20",
    )


def test_a_take_is_as_long_as_both_hanger_and_points_are_seen():
    take = swung()
    state = np.where(take.time < 4.0, FrameState.HANGER_ALONE, 0).astype(np.uint16)
    assert named(dataclasses.replace(take, state=state)) == ["too_short"]


def test_cloth_may_sag_between_two_held_corners_and_not_along_a_held_edge():
    take = swung()
    points = take.points.copy()
    points[:, 0, 0] += 0.1
    sagging = with_points(take, points)
    corners = msgspec.structs.replace(take.garment, held="corners")
    assert named(sagging) == ["held_edge_folds"]
    assert named(dataclasses.replace(sagging, garment=corners)) == []


def test_a_garment_of_which_only_the_held_corners_were_seen_is_a_grave_fault():
    take = swung()
    valid = take.points_valid.copy()
    valid[:, 2:] = False
    (finding,) = judge(dataclasses.replace(take, points_valid=valid))
    assert (finding.name, finding.is_grave) == ("garment_never_seen", True)
    assert finding.words == "no point below the held edge was ever seen"


@pytest.mark.parametrize(("frames", "is_grave"), [(21, True), (30, True), (31, False)])
def test_a_take_of_two_half_seconds_is_refused_as_a_fit_refuses_it(frames, is_grave):
    """At 30 a second, frame 31 is at 1 s and begins the third half second."""
    (finding,) = [one for one in judge(swung(frames / FPS)) if one.name == "too_short"]
    assert finding.is_grave == is_grave
    assert ("intervals need 3 half-seconds of motion, and there are 2" in finding.words) == is_grave


def test_half_seconds_count_from_the_first_sight_and_only_with_points():
    take = swung(3.0)
    late = without_hanger(take, slice(0, 50))  # 40 frames from 1.67 s on: 1.3 s
    assert [one.is_grave for one in judge(late) if one.name == "too_short"] == [False]
    seen = take.points_valid.copy()
    seen[30:] = False  # of 90 frames with the hanger
    hidden = dataclasses.replace(take, points_valid=seen)
    assert [one.is_grave for one in judge(hidden) if one.name == "too_short"] == [True]
