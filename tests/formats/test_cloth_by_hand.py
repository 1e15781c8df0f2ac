"""Sizes and distances of a garment that hangs still, word for word and at the bounds of what is taken for cloth."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.garment import TrackedPoint
from formats.judged_cloth import (
    LARGER,
    MEASURED_APART,
    MOST_STRETCHED,
    SHORTEST_EDGE,
    SMALLER,
    _apart,
    _far_off,
    _folded,
    _held_width,
    _pairs,
    _size,
    _without_noise,
)
from formats.sights import sights_of
from tests.formats.test_archive import GARMENT, a_take

CORNERS = ((0.0, 0.0), (1.2, 0.0), (1.2, -0.8), (0.0, -0.8))  # m, from the left end of the held edge clockwise
NAMES = ("left", "right", "low right", "low left")
FRAMES = 60


def garment(held="edge", **more):
    points = tuple(TrackedPoint(name=name, at_m=at) for name, at in zip(NAMES, CORNERS, strict=True))
    return msgspec.structs.replace(GARMENT, outline_m=CORNERS, points=points, held=held, **more)


def hanging(*, wide=1.0, high=1.0, ends=None, held="edge", sd=0.0):
    """A garment as it is on the table but for factors of its width and height, held at points or elsewhere [m]."""
    flat = np.array([(wide * x, high * y, 0.0) for x, y in CORNERS])
    held_at = flat[:2] if ends is None else np.array(ends)
    points = np.repeat(flat[None], FRAMES, 0)
    both = np.repeat(held_at[None], FRAMES, 0)
    return replace(
        a_take(FRAMES), garment=garment(held), points=points, points_valid=np.ones((FRAMES, 4), bool), held=both,
        markers=both, points_sd=np.full(points.shape, sd),
    )  # fmt: skip


def about(found):
    return [(one.name, one.is_grave, one.words, one.advice) for one in found]


MEASURE = "measure it again, or choose the file of the garment that hangs there"
TAUT = 'hold the edge taut, or give held = "corners" where two corners alone are held'


@pytest.mark.parametrize(
    ("take", "found"),
    [
        (hanging(), []), (hanging(high=SMALLER + 1e-6), []), (hanging(high=LARGER - 1e-6), []),
        (hanging(high=0.5), [
            ("garment_smaller", False, "the garment is smaller than described: right and low right are at most 40 cm "
             "apart, 80 cm in its file", MEASURE),
        ]),
        (hanging(wide=1.5, high=1.4), [
            ("garment_larger", False, "the garment is larger than described: left and right are at most 180 cm apart, "
             "120 cm in its file", MEASURE),
        ]),
        (hanging(wide=0.5), [
            ("held_edge_folds", False, "the held edge folds or sags: its ends are at most 60 cm apart, 120 cm in the "
             "garment's file", TAUT),
        ]),
        (hanging(wide=0.5, held="corners"), []),
        (hanging(wide=0.5, high=0.5, held="corners"), [
            ("garment_smaller", False, "the garment is smaller than described: right and low right are at most 40 cm "
             "apart, 80 cm in its file", MEASURE),
        ]),
        (hanging(wide=0.5, high=0.4), [
            ("garment_smaller", False, "the garment is smaller than described: right and low right are at most 32 cm "
             "apart, 80 cm in its file", MEASURE),
        ]),
    ],
)  # fmt: skip
def test_a_size_that_the_file_does_not_have_is_told_in_centimetres(take, found):
    assert about(_size(take)) == found


def test_a_folded_edge_is_told_with_both_lengths():
    assert _folded(0.7449, 1.2051).words == (
        "the held edge folds or sags: its ends are at most 74 cm apart, 121 cm in the garment's file"
    )


def apart(metres):
    return [[0.0, 0.0, 0.0], [metres, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("metres", "is_told"),
    [(SHORTEST_EDGE * 1.2 + 1e-6, False), (SHORTEST_EDGE * 1.2 - 1e-3, True),
     (MOST_STRETCHED * 1.2 + MEASURED_APART - 1e-6, False), (MOST_STRETCHED * 1.2 + MEASURED_APART + 1e-3, True)],
)  # fmt: skip
def test_held_ends_that_the_held_edge_does_not_reach_are_told(metres, is_told):
    take = hanging(ends=apart(metres))
    found = [one for one in _far_off(take, sights_of(take)) if one.name == "held_ends_apart"]
    words = f"the held ends are {1e3 * metres:.0f} mm apart, the garment's held edge is 1200 mm long"
    advice = "check the garment's outline, which points are its held ends, and their unit"
    assert about(found) == [("held_ends_apart", True, words, advice)] * is_told


@pytest.mark.parametrize(("point", "end", "side"), [(2, 0, "left"), (3, 1, "right"), (3, 0, "left"), (2, 1, "right")])
def test_a_point_beyond_the_reach_of_its_cloth_is_told_with_the_end_that_it_is_too_far_from(point, end, side):
    take = hanging()
    across = CORNERS[point][0] - CORNERS[end][0]  # m; the point moves along this, or down below its own end
    flat = float(np.linalg.norm(np.subtract(CORNERS[point], CORNERS[end])))
    for beyond, is_told in ((-1e-6, False), (1e-3, True)):
        reach = MOST_STRETCHED * flat + MEASURED_APART + beyond
        way = (np.copysign(np.sqrt(reach**2 - 0.8**2), across), -0.8, 0.0) if across else (0.0, -reach, 0.0)
        take.points[:, point] = take.held[0, end] + np.array(way)
        found = _far_off(take, sights_of(take))
        assert bool(found) == is_told
    words = (
        f"{NAMES[point]} is {1e3 * reach:.0f} mm from the {side} held end in the median, {1e3 * flat:.0f} mm on the "
        "flat garment"
    )
    advice = "check the points' names, which held end is the left one, and that points and hanger are of one recording"
    assert about(found) == [("point_far_off", True, words, advice)]


def test_neighbours_along_the_outline_are_compared_the_held_ends_first():
    assert _pairs(garment()) == [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert _pairs(msgspec.structs.replace(garment(), points=garment().points[::-1])) == [(3, 2), (2, 1), (1, 0), (0, 3)]
    near = (TrackedPoint(name="near", at_m=(1.2, -0.799)),)
    assert _pairs(msgspec.structs.replace(garment(), points=(*garment().points[:2], *near, garment().points[3]))) == []


def test_two_points_have_the_distance_that_19_of_20_frames_keep_and_their_flat_one():
    take = hanging()
    take.points[:, 0, 0] = -np.linspace(0.0, 1.0, FRAMES)
    seen, flat, first, second = _apart(take, (0, 1))
    assert (flat, first, second) == (pytest.approx(1.2), "left", "right")
    assert seen == pytest.approx(max(1.2, np.percentile(1.2 + np.linspace(0.0, 1.0, FRAMES), 95)))
    take.points[:, 0, 0] = np.linspace(0.0, 1.0, FRAMES)
    assert _apart(take, (0, 1))[0] == pytest.approx(np.percentile(1.2 - np.linspace(0.0, 1.0, FRAMES), 95))
    take.points_valid[:, 0] = np.arange(FRAMES) < 9
    assert _apart(take, (0, 1)) is None
    take.points_valid[:, 0] = np.arange(FRAMES) < 10
    assert _apart(take, (0, 1)) is not None


@pytest.mark.parametrize("length", [0.3, 1.2])
def test_noise_is_taken_off_a_distance_along_and_across_it(length):
    """Of s along and t across: root of max(median, percentile 95 - 1.645 s)^2 - t^2, in the mean of both points."""
    rng = np.random.default_rng(2)
    ways = np.array([length, 0.0, 0.0]) + rng.normal(0, 0.01, (400, 3))
    deviations = np.array([[0.03, 0.01, 0.02], [0.04, 0.02, 0.01]])
    found = _without_noise(ways, np.repeat(deviations[None], 400, 0))
    variances = (deviations**2).sum(0)
    share = (ways / np.linalg.norm(ways, axis=1, keepdims=True)) ** 2
    along = (share @ variances).mean()
    sizes = np.linalg.norm(ways, axis=1)
    most = max(np.median(sizes), np.percentile(sizes, 95) - 1.6449 * np.sqrt(along))
    assert found == pytest.approx(np.sqrt(most**2 - (variances.sum() - along)), rel=1e-4)
    assert _without_noise(ways, np.full((400, 2, 3), np.nan)) == pytest.approx(np.percentile(sizes, 95))
    assert _without_noise(0 * ways, np.repeat(deviations[None], 400, 0)) == 0.0


def test_the_held_edge_is_as_wide_as_in_19_of_20_frames_that_show_both_ends():
    take = hanging()
    take.held[:, 1, 0] = np.linspace(1.0, 2.0, FRAMES)
    take.held[10:, 0, 2] = np.nan
    assert _held_width(take) == pytest.approx(np.percentile(np.linspace(1.0, 2.0, FRAMES)[:10], 95))
