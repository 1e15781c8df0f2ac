"""The ends of the held edge as points of the cloth, where the corner that belongs there is not found."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter
from capture.garment.geodesic import SOURCE_REACH
from capture.garment.occlusion import END_GAP, folded_away, with_ends
from capture.garment.placing import project
from capture.garment.tracker import CELL, SilhouetteTracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.test_tracker_by_hand import FLAT, PLACES

HELD = np.array([[-0.2, -0.1, 1.6], [0.2, -0.1, 1.6]])  # m, of a swatch 0.4 m wide and 0.42 m high
NONE = np.zeros(4, bool)


def tracker_of(garment):
    return SilhouetteTracker(GARMENTS[garment](), RIG, CorrelationMeter())


def tracked(*outline):
    """Track one picture of a piece of cloth 1.6 m away with this outline [m], (x, y), y down."""
    picture = np.zeros((RIG.sensor.height, RIG.sensor.width), np.uint16)
    places = np.column_stack([np.array(outline), np.full(len(outline), 1.6)])
    cv2.fillPoly(picture, [np.rint(project(places, RIG.sensor)).astype(np.int32)], 1600)
    return tracker_of("swatch").track(picture, HELD, 0.0)


@pytest.mark.parametrize("inset", [0.035, 0.045])
def test_a_corner_below_a_held_end_is_not_also_a_lower_corner(inset):
    """A swatch folded along its diagonal, 35 or 45 mm within both ends: upper and lower left start 3 pixels apart.

    Neither is the held corner, since that lies within 30 mm of its end. The lower left corner is 0.42 m below.
    """
    left, right = -0.2 + inset, 0.2 - inset
    found = tracked((left, -0.1), (right, -0.1), (right, 0.2), (left, -0.092))
    assert found.pixels[3] == pytest.approx(project(np.array([left, -0.09, 1.6]), RIG.sensor), abs=4)
    assert not found.valid.any()


def test_lower_corners_count_where_both_held_corners_are_out_of_view():
    """A flat swatch whose upper corners are cut off by 60 mm: nothing else of it is missing."""
    found = tracked((-0.14, -0.1), (0.14, -0.1), (0.2, -0.04), (0.2, 0.32), (-0.2, 0.32), (-0.2, -0.04))
    assert found.valid.tolist() == [False, False, True, True, False]
    assert found.points[2:4] == pytest.approx(np.array([[0.2, 0.32, 1.6], [-0.2, 0.32, 1.6]]), abs=0.004)


@pytest.mark.parametrize(("way", "is_folded"), [(0.896, True), (0.898, False), (1.5, False), (np.inf, False)])
def test_a_way_from_a_held_end_may_lack_the_gap_beside_it(way, is_folded):
    """Of 1 m may be missing 25 and 8 mm, and 70 mm beside the end; a way that is too long blames nobody."""
    seen, flat = np.full((4, 4), np.nan), np.ones((4, 4)) - np.eye(4)
    seen[3, 3] = 0.0
    to_ends = np.full((2, 4), np.inf)
    to_ends[0, 3] = way
    folded, wrong = folded_away(*with_ends(seen, flat, NONE, to_ends, np.ones((2, 4))))
    assert folded.tolist() == [False, False, False, is_folded, False, False]
    assert not wrong.any()


def test_the_gap_is_the_longest_first_step_of_a_way():
    assert pytest.approx(SOURCE_REACH * CELL) == END_GAP


@pytest.fixture
def ways_of():
    """Compare the corners of a flat panel of 0.4 m by 0.3 m, some without position, with its held ends."""
    across, down = np.meshgrid(np.arange(-0.19, 0.2, 0.02), np.arange(0.01, 0.3, 0.02))
    surface = np.stack([across, down, np.full(across.shape, 1.6)], axis=-1)

    def go(garment, missing, is_held):
        tracker = tracker_of(garment)
        tracker.flat = dataclasses.replace(tracker.flat, distances=FLAT, from_ends=FLAT[:2])
        places, along = PLACES.copy(), FLAT.copy()
        places[missing] = along[missing] = along[:, missing] = np.nan
        return tracker._with_held_ends(surface, places, along, PLACES[:2], np.array(is_held)), along

    return go


@pytest.mark.parametrize(
    ("garment", "missing", "is_held", "ends"),
    [
        ("swatch", [1], [True, False, False, False], [1]),
        ("swatch", [0], [False, True, False, False], [0]),
        ("swatch", [0, 1, 2], [False] * 4, [0, 1]),
        ("t-shirt", [2], [False] * 4, [0, 1]),
    ],
)
def test_an_end_without_a_corner_is_a_point_of_the_cloth(ways_of, garment, missing, is_held, ends):
    """From an end to the other corners are 0.4, 0.3 and 0.5 m, on the surface and on the flat garment."""
    (ways, flat, trusted), along = ways_of(garment, missing, is_held)
    assert trusted.tolist() == is_held + [True] * len(ends)
    np.testing.assert_array_equal(ways[:4, :4], along)
    np.testing.assert_array_equal(flat[:4, :4], FLAT)
    np.testing.assert_array_equal(flat[4:, :4], FLAT[ends])
    seen = np.where(np.isin(np.arange(4), missing), np.nan, FLAT[ends])
    np.testing.assert_allclose(ways[4:, :4], seen, rtol=1e-6)
    assert np.isnan(ways[4:, 4:]).all()
    for table in (ways, flat):
        np.testing.assert_array_equal(table, table.T)


@pytest.mark.parametrize(
    ("garment", "missing", "is_held"),
    [("swatch", [2], [True, True, False, False]), ("t-shirt", [], [False] * 4), ("swatch", [0, 1, 2, 3], [False] * 4)],
)
def test_no_end_is_compared_where_its_corner_or_all_or_none_are_found(ways_of, garment, missing, is_held):
    (ways, flat, trusted), along = ways_of(garment, missing, is_held)
    np.testing.assert_array_equal(ways, along)
    np.testing.assert_array_equal(flat, FLAT)
    assert trusted.tolist() == is_held
