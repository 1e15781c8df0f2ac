"""A hanger that does not hold the cloth, walls that it enters, and points that leave the cloth, reported at import."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.scene import RIG
from formats.impossible_points import find_impossible
from formats.judgement import judge
from formats.rig import RigBody
from formats.sights import away_from_held, sights_of
from formats.two_clocks import at_times, with_hanger
from tests.formats.test_judgement import named, swung, with_points
from tests.formats.test_judgement_sentences import imported


def led_by(take, path, late=0.0):
    """The take, led along a path [m], (frames,), by a hanger that was measured 20 times a second on its own clock."""
    arm = np.arange(0.01, take.time[-1] - 0.01, 0.05)
    ends = take.held + (path[:, None, None] - (take.held[:, :1, :1] - take.held[:1, :1, :1])) * [1.0, 0.0, 0.0]
    return with_hanger(imported(take), arm, at_times(arm - late, take.time, ends), 1e-3)


def way(frequency, reach=0.1):
    return reach * np.sin(2 * np.pi * frequency * swung(10.0).time)


def test_a_hanger_that_swings_at_another_rate_than_the_cloth_does_not_hold_it():
    """Swings of 100 mm at 1 Hz and at 0.5 Hz are 100 mm apart, root mean square; without the farthest it is 63 mm."""
    (finding,) = judge(led_by(swung(10.0), way(0.5)))
    assert (finding.name, finding.is_grave) == ("row_apart", False)
    assert finding.words == (
        "the cloth's held row does not go with the ends of the held edge, at no shift of its clock within 0.5 s: "
        "both are 63 mm apart"
    )
    assert finding.advice == "check that hanger and points are of one take, and that the hanger holds the garment"


@pytest.mark.parametrize("late", [0.0, 0.2, -0.3])
def test_a_hanger_whose_clock_is_late_holds_the_cloth(late):
    take = swung(10.0)
    assert "row_apart" not in named(led_by(take, way(1.0), late))


@pytest.mark.parametrize(("reach", "is_reported"), [(0.055, False), (0.06, True)])
def test_a_hanger_of_which_the_cloth_takes_no_notice_is_reported_from_forty_millimetres_on(reach, is_reported):
    """A swing has a root mean square of 0.707 of its half way: 39 and 42 mm."""
    still = swung(10.0, reach=0.0)
    ends = still.held + way(1.0, reach)[:, None, None] * [1.0, 0.0, 0.0]
    take = dataclasses.replace(still, held=ends, markers=ends)
    assert ("row_apart" in named(imported(take))) == is_reported
    words = {finding.name: finding.words for finding in judge(imported(take))}
    assert ("at no shift of its clock within 0.5 s" in words.get("row_apart", "")) == is_reported  # a fit looks for it
    seen_together = {finding.name: finding.words for finding in judge(take)}
    assert ("row_apart" in seen_together) == is_reported
    assert "at no shift" not in seen_together.get("row_apart", "")  # the rig's hanger is in the points' pictures


@pytest.mark.parametrize("late", [0.05, 0.1, 0.2, 0.33])
def test_imported_cloth_whose_stamps_are_late_goes_with_its_hanger_as_in_a_fit(late):
    """At 1 Hz and 0.1 m a third of a second is up to 0.17 m of the way."""
    take = swung(10.0)
    ahead = 0.1 * np.sin(2 * np.pi * (take.time + late)) - way(1.0)
    ends = take.held + ahead[:, None, None] * [1.0, 0.0, 0.0]
    assert named(imported(dataclasses.replace(take, held=ends, markers=ends))) == []


@pytest.mark.parametrize(("late", "is_last"), [(0.33, False), (-0.33, True), (0.2, False), (-0.2, True)])
def test_a_point_seen_near_one_end_alone_leaves_the_others_their_clock_offset(late, is_last):
    """Such a point has no distance at that offset, before the hanger's path begins or behind its end."""
    take = swung(10.0, reach=0.2)
    ahead = way(1.0, 0.2) - 0.2 * np.sin(2 * np.pi * (take.time + late))
    ends, seen = take.held - ahead[:, None, None] * [1.0, 0.0, 0.0], take.points_valid.copy()
    seen[:, 2] &= (take.time > 9.85) if is_last else (take.time < 0.15)
    known = imported(dataclasses.replace(take, held=ends, markers=ends, points_valid=seen))
    assert "point_far_off" not in named(known)
    away, true = away_from_held(known, sights_of(known)), away_from_held(take, sights_of(take))
    np.testing.assert_allclose(np.delete(away, 2, axis=0), np.delete(true, 2, axis=0), atol=0.02)
    assert np.isfinite(away[2]).all()


@pytest.mark.parametrize(("seen", "is_reported"), [(19, False), (20, True)])
def test_a_held_row_is_compared_from_twenty_sights_on(seen, is_reported):
    still = swung(10.0, reach=0.0)
    ends = still.held + way(1.0)[:, None, None] * [1.0, 0.0, 0.0]
    still.points_valid[:, 0] = np.isin(np.arange(300), 13 * np.arange(seen))
    assert still.points_valid[:, 0].sum() == seen
    assert ("row_apart" in named(imported(dataclasses.replace(still, held=ends, markers=ends)))) == is_reported


def test_a_row_with_single_positions_far_off_goes_with_its_hanger():
    take = swung(10.0)
    points = take.points.copy()
    points[::10, :2, 1] += 0.5
    assert "row_apart" not in named(imported(dataclasses.replace(take, points=points)))


def near(*bodies):
    rig = msgspec.structs.replace(RIG, format="hangtime-rig/2", bodies=bodies)
    return dataclasses.replace(swung(), rig=rig)


WALL = RigBody(kind="plane", at_m=(0.0, 0.0, 1.65), normal=(0.0, 0.0, -2.0))
BODIES = {
    "plane": lambda by: RigBody(kind="plane", at_m=(0.0, 0.0, 1.6 - by), normal=(0.0, 0.0, -2.0)),
    "sphere": lambda by: RigBody(kind="sphere", at_m=(0.0, 0.0, 1.5), radius_m=0.1 + by),
    "capsule": lambda by: RigBody(kind="capsule", at_m=(-3.0, 0.3 - by, 1.6), to_m=(3.0, 0.3 - by, 1.6), radius_m=0.3),
    "capsule's end": lambda by: RigBody(
        kind="capsule", at_m=(0.0, 0.2 - by, 1.6), to_m=(0.0, 3.0, 1.6), radius_m=0.2
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BODIES)
def test_a_held_edge_that_enters_a_body_of_the_rig_is_reported_with_its_depth(name):
    """The held edge swings along x at a depth of 1.6 m; the body comes 20 mm over it, or stays 1 mm away."""
    (finding,) = judge(near(WALL, BODIES[name](0.02)))
    kind = name.split("'")[0]
    assert (finding.name, finding.is_grave) == ("held_edge_in_body", True)
    assert finding.words == f"the held edge comes 20 mm into the rig's body 2, a {kind}"
    assert finding.advice == "check where it stands: metres in the sensor frame, a plane's normal towards the cloth"
    assert judge(near(WALL, BODIES[name](-0.001))) == ()


def with_jumps(count):
    """The take of five points in 180 frames, with some sightings of one corner 40 cm below its position."""
    points = swung().points.copy()
    points[:count, 2, 1] += 0.4
    return with_points(swung(), points)


@pytest.mark.parametrize(("count", "is_reported"), [(45, False), (46, True)])
def test_points_out_of_the_cloths_reach_are_reported_above_five_percent(count, is_reported):
    """45 of 900 are 5 %."""
    assert ("points_impossible" in named(with_jumps(count))) == is_reported
    if is_reported:
        (finding,) = [one for one in judge(with_jumps(count)) if one.name == "points_impossible"]
        assert finding.words == ("5.1 % of the sightings of points are further from the others than the cloth reaches")
        assert finding.advice == "check the markers' names and the tracker"
        assert not finding.is_grave


def test_a_long_take_on_a_clock_of_its_own_is_judged_by_frames_evenly_over_it():
    take = swung(100.0)
    points = take.points.copy()
    points[1000:, 2] += [0.0, 0.3, 0.0]  # in the last two thirds
    both = led_by(dataclasses.replace(take, points=points), 0.1 * np.sin(2 * np.pi * take.time))
    sights = sights_of(both)
    assert sights.is_known.sum() > 2000
    assert away_from_held(both, sights)[2, 1] == pytest.approx(0.752, abs=0.002)


def test_the_reach_grows_with_the_noise_of_both_points():
    """100 mm apart on the cloth: 130 mm is what stretch and glue allow, and 6 sqrt(2) deviations more."""
    places, seen = np.array([[0.0, 0.0], [0.1, 0.0]]), np.ones((1, 2), bool)
    points = np.array([[[0.0, 0.0, 0.0], [0.142, 0.0, 0.0]]])
    assert find_impossible(points, seen, np.full((1, 2, 3), 1.3e-3), places).all()  # 130 + 11 mm
    assert not find_impossible(points, seen, np.full((1, 2, 3), 1.5e-3), places).any()  # 130 + 12.7 mm
    seen[0, 1] = False
    assert not find_impossible(points, seen, np.full((1, 2, 3), 1e-4), places).any()


def test_points_are_compared_though_the_first_of_them_was_not_seen():
    """Fifty frames are compared at once: in one of them the last two points are a metre apart."""
    places, seen = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]]), np.ones((50, 3), bool)
    points = np.zeros((50, 3, 3))
    points[:, 0], seen[:, 0] = np.nan, False
    points[7, 1, 1] = 1.0
    found = find_impossible(points, seen, np.full(points.shape, 1e-3), places)
    assert np.argwhere(found).tolist() == [[7, 1], [7, 2]]
