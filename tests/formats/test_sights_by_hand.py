"""When hanger and cloth of a take were seen, computed one by one as the definitions say."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest

from formats.garment import TrackedPoint
from formats.importers.clock_shift import LEAST_NEARER, _about_mean, _apart, _as_good, _median, _Minimum, _residual
from formats.sights import away_from_held, exchanged, longest_without_cloth, on_held_edge, sights_of
from tests.formats.test_archive import GARMENT, a_take
from tests.formats.test_descriptions import RIG

LEFT, RIGHT = (np.array(GARMENT.outline_m[k]) for k in (0, 1))
HEIGHT = np.ptp(np.array(GARMENT.outline_m)[:, 1])


def with_points(*places, held="edge"):
    points = tuple(TrackedPoint(name=f"q{k}", at_m=tuple(map(float, at))) for k, at in enumerate(places))
    return msgspec.structs.replace(GARMENT, points=points, held=held)


@pytest.mark.parametrize(("held", "is_middle_on"), [("edge", True), ("corners", False)])
def test_a_point_beyond_the_ends_of_the_held_edge_is_not_on_it(held, is_middle_on):
    """Within a fiftieth of the garment's height of the edge, or of its two ends where it is held at them."""
    along, near, far = (RIGHT - LEFT) / np.linalg.norm(RIGHT - LEFT), 0.019 * HEIGHT, 0.021 * HEIGHT
    places = [
        LEFT - near * along, LEFT - far * along, RIGHT + near * along, RIGHT + far * along,
        (LEFT + RIGHT) / 2, LEFT + far * along, RIGHT - far * along, LEFT, RIGHT,
    ]  # fmt: skip
    expected = [True, False, True, False, is_middle_on, is_middle_on, is_middle_on, True, True]
    assert on_held_edge(with_points(*places, held=held)).tolist() == expected


def directions(count, seed=0):
    way = np.random.default_rng(seed).normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True)


@pytest.mark.parametrize("share", [0.1, 0.35, 0.45])
def test_ends_that_are_exchanged_are_found_whichever_way_the_edge_points(share):
    """Up to half of the sights; the product of two unit vectors may round to less than -1."""
    time = np.arange(40) * 0.01
    for way in directions(200):
        is_wrong = np.arange(40) < round(40 * share)
        bar = np.where(is_wrong[:, None], -way, way) * 0.37
        ends = np.stack([-bar, bar], 1)
        assert exchanged(time, ends).tolist() == is_wrong.tolist()
        assert exchanged(time, ends[::-1]).tolist() == is_wrong[::-1].tolist()


def longest_by_definition(take, sights):
    """Between two frames with cloth, with a sight of the hanger in between."""
    rows = [k for k in range(len(take.time)) if sights.within[k] and sights.cloth[k]]
    found = [(0.0, 0.0)]
    for begin, end in pairwise(rows):
        if sights.held[begin + 1 : end].any():
            found.append((float(take.time[begin]), float(take.time[end])))
    return max(found, key=lambda span: span[1] - span[0])


@pytest.mark.parametrize("seed", range(30))
def test_the_longest_time_without_cloth_has_the_hanger_in_it(seed):
    rng = np.random.default_rng(seed)
    take = a_take(int(rng.integers(1, 14)), seed)
    take.points_valid[rng.random(len(take.time)) < 0.7] = False
    take.held_valid[rng.random(len(take.time)) < 0.5] = False
    sights = sights_of(replace(take, points=np.where(take.points_valid[..., None], take.points, np.nan)))
    assert longest_without_cloth(take, sights) == longest_by_definition(take, sights)


def test_every_frame_counts_for_a_distance_from_the_hanger_where_one_clock_measured_both():
    """Also of more frames than are looked at where clocks may differ."""
    take = replace(a_take(1501), rig=RIG)
    take.points[:] += np.random.default_rng(1).normal(0, 0.1, take.points.shape)
    found = away_from_held(take, sights_of(take))
    for point in range(4):
        for end in range(2):
            apart = np.linalg.norm(take.points[:, point] - take.held[:, end], axis=1)
            assert found[point, end] == pytest.approx(np.nanmedian(apart[take.points_valid[:, point]]), abs=1e-12)


@pytest.mark.parametrize("shape", [(1, 3), (2, 3), (7, 4), (8, 4)])
@pytest.mark.parametrize("axis", [0, 1])
def test_medians_of_many_rows_are_those_of_each(shape, axis):
    rng = np.random.default_rng(sum(shape))
    values = rng.normal(size=shape)
    values[rng.random(shape) < 0.3] = np.nan
    values[:, 0] = values[0, :] = 1.5  # none is without a number
    found = _median(values, axis)
    np.testing.assert_allclose(found, np.nanmedian(values, axis=axis, keepdims=True))


def test_a_residual_is_about_its_median_and_lacks_a_point_of_which_a_coordinate_lacks():
    rng = np.random.default_rng(3)
    seen, path = rng.normal(size=(9, 2, 3)), rng.normal(size=(9, 2, 3))
    seen[4, 1, 2] = np.nan
    found = _residual(seen, path)
    left = seen - path
    left[4, 1] = np.nan
    np.testing.assert_allclose(found, left - np.nanmedian(left, axis=0))


def test_values_are_about_the_mean_of_those_that_count():
    rng = np.random.default_rng(4)
    values, counts = rng.normal(size=(9, 2, 3)), rng.random((9, 2)) < 0.6
    found = _about_mean(values, counts)
    for point in range(2):
        some = counts[:, point]
        np.testing.assert_allclose(found[some, point], values[some, point] - values[some, point].mean(0))
        assert not found[~some, point].any()
    assert not _about_mean(values, np.zeros((9, 2), bool)).any()


@pytest.mark.parametrize("fewest", [11, 12, 13])
def test_an_offset_is_judged_by_the_median_distance_where_enough_is_known(fewest):
    """Of 18 positions 12 are known at the second offset."""
    time = np.arange(9) * 0.1

    def path(at):
        moved = np.stack([np.sin(at), np.cos(2 * at), at**2], 1)[:, None] + np.array([[0.0], [0.3]])
        return np.where((at > 1.05)[:, None, None], np.nan, moved)

    seen = np.random.default_rng(6).normal(size=(9, 2, 3))
    shifts = np.array([0.0, 0.451])
    found = _apart(time, seen, path, shifts, float(fewest))
    for one, shift, count in zip(found, shifts, (18, 12), strict=True):
        away = np.linalg.norm(_residual(seen, path(time + shift)), axis=2)
        assert one == (pytest.approx(np.nanmedian(away)) if count >= fewest else np.inf)


def minimum(seconds, off):
    """A minimum whose residuals are so long [m], (pictures,), at one point, along one axis."""
    left = np.zeros((len(off), 1, 3))
    left[:, 0, 1] = off
    return _Minimum(seconds, 0.01, left, np.isfinite(left).all(2))


@pytest.mark.parametrize(("blocks", "is_good"), [(9, True), (49, False)])
def test_another_minimum_is_as_good_unless_its_squares_are_surely_larger(blocks, is_good):
    """Its squares are larger by 1 in the mean of the blocks, with a deviation of 1.5: 2 or 4.7 standard errors."""
    more = 1.0 + 1.5 * np.tile([1.0, -1.0], blocks)[:blocks]
    more = 1.0 + (more - more.mean()) * 1.5 / more.std(ddof=1)
    block, base = np.repeat(np.arange(blocks), 4), 9.0
    best, other = minimum(0.0, np.full(4 * blocks, base**0.5)), minimum(1.0, np.repeat((base + more) ** 0.5, 4))
    good = _as_good([other, best], block)
    assert good[0] is best
    assert (len(good) == 2) == is_good


@pytest.mark.parametrize(("nearer", "is_good"), [(0.97, True), (1.03, False)])
def test_a_minimum_that_is_hardly_farther_off_is_as_good(nearer, is_good):
    """By less than 3 mm, however sure that is."""
    best, other = minimum(0.0, np.full(60, 0.01)), minimum(1.0, np.full(60, 0.01 + nearer * LEAST_NEARER))
    assert (len(_as_good([best, other], np.repeat(np.arange(6), 10))) == 2) == is_good


def test_minima_are_compared_where_both_are_known():
    """The other one is worse only where the best one does not count."""
    off = np.full(60, 0.01)
    best, other = minimum(0.0, off), minimum(1.0, np.where(np.arange(60) < 20, 5.0, off + 1e-4))
    best.counts[:20] = False
    block = np.repeat(np.arange(6), 10)
    assert _as_good([best, other], block) == [best, other]
    best.counts[:] = True
    assert _as_good([best, other], block)[0] is best
