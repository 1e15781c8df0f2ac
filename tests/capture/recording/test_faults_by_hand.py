"""What hides the hanger, and how far a view without markers is: by sights and depth images made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from capture.hanger.fiducial_tracker import nothing_seen
from capture.recording.frame_faults import HangerWatch, is_garment_covered, view_faults
from formats.take import FrameState
from tests.capture.garment.towel import HANGER
from tests.capture.stage import CAMERA

FAR = np.full((480, 640), 2000, np.uint16)
LOST = FrameState.MARKER_LOST


def seen():
    """Both markers at 1.6 m, 20 px wide, around the pixels (200, 100) and (300, 100)."""
    centres = np.array([[200.0, 100.0], [300.0, 100.0]])
    places = np.array([[-0.3, -0.4, 1.6], [0.0, -0.4, 1.6]])
    return dataclasses.replace(
        nothing_seen(), centres=centres, sides=np.full(2, 20.0), positions=places, valid=np.ones(2, bool)
    )


def watched():
    watch = HangerWatch(HANGER)
    assert watch.faults(seen(), FAR, 0.0) == 0
    return watch


def covered(millimetres, columns=slice(190, 211)):
    depth = FAR.copy()
    depth[90:111, columns] = millimetres
    return depth


@pytest.mark.parametrize(
    ("depth", "bit"),
    [
        pytest.param(covered(1299), FrameState.VIEW_BLOCKED, id="30 cm nearer and a millimetre"),
        pytest.param(covered(1300), 0, id="30 cm nearer"),
        pytest.param(covered(0), 0, id="without depth"),
        pytest.param(covered(1000, slice(190, 201)), FrameState.VIEW_BLOCKED, id="11 of 21 columns"),
        pytest.param(covered(1000, slice(190, 200)), 0, id="10 of 21 columns"),
        pytest.param(covered(1000, slice(211, 280)), 0, id="beside it"),
    ],
)
def test_a_thing_hides_a_marker_where_it_covers_half_of_its_21_by_21_pixels(depth, bit):
    assert watched().faults(nothing_seen(), depth, 0.1) == LOST | bit


def test_a_marker_that_stays_hidden_stays_known_and_a_lost_one_is_forgotten_after_three_seconds():
    watch, depth = watched(), covered(1000)
    for time in (2.0, 4.5, 7.5):
        assert watch.faults(nothing_seen(), depth, time) == LOST | FrameState.VIEW_BLOCKED
    assert watch.faults(nothing_seen(), depth, 10.6) == LOST
    assert watched().faults(nothing_seen(), depth, 3.0) == LOST | FrameState.VIEW_BLOCKED
    assert watched().faults(nothing_seen(), depth, 3.1) == LOST


@pytest.mark.parametrize(("rows", "fault"), [(40, 0), (16, FrameState.TOO_FAR)])
def test_a_view_is_too_far_where_at_most_a_twentieth_of_it_is_nearer_than_three_and_a_half_metres(rows, fault):
    """40 and 16 of 480 rows are a twelfth and a thirtieth."""
    depth = np.full((480, 640), 3600, np.uint16)
    depth[:rows] = 2000
    assert view_faults(depth) == fault


@pytest.mark.parametrize(("rows", "fault"), [(232, 0), (248, FrameState.TOO_NEAR)])
def test_a_view_is_too_near_where_half_of_it_is_nearer_than_eight_decimetres(rows, fault):
    depth = FAR.copy()
    depth[:rows] = 700
    assert view_faults(depth) == fault


@pytest.mark.parametrize(("millimetres", "fault"), [(799, FrameState.TOO_NEAR), (801, 0)])
def test_a_view_without_markers_is_too_near_below_eight_decimetres(millimetres, fault):
    assert view_faults(np.full((480, 640), millimetres, np.uint16)) == fault


@pytest.mark.parametrize(("millimetres", "fault"), [(3499, 0), (3501, FrameState.TOO_FAR)])
def test_a_view_without_markers_is_too_far_beyond_three_and_a_half_metres(millimetres, fault):
    assert view_faults(np.full((480, 640), millimetres, np.uint16)) == fault


@pytest.mark.parametrize(("rows", "is_covered"), [(37, True), (36, False), (1, False)])
def test_a_garment_is_covered_where_more_than_a_quarter_of_145_rows_below_its_held_edge_is_nearer(rows, is_covered):
    """An edge of 0.4 m at 1.6 m is 144 px wide, from row 203 on; 37 and 36 rows are 25.5 and 24.8 %."""
    held = np.array([[-0.2, -0.1, 1.6], [0.2, -0.1, 1.6]])
    depth = np.full((480, 640), 1600, np.uint16)
    depth[203 : 203 + rows] = 1000
    assert is_garment_covered(depth, held, CAMERA) == is_covered


@pytest.mark.parametrize(
    ("metres", "pixels", "fault"),
    [
        pytest.param(0.79, 20.0, FrameState.TOO_NEAR, id="one too near"),
        pytest.param(0.81, 20.0, 0, id="both far enough"),
        pytest.param(3.51, 20.0, FrameState.TOO_FAR, id="one too far"),
        pytest.param(3.49, 20.0, 0, id="both near enough"),
        pytest.param(1.6, 11.0, FrameState.TOO_FAR, id="one too small"),
        pytest.param(1.6, 12.0, 0, id="both large enough"),
    ],
)
def test_one_of_the_two_markers_is_enough_to_be_too_near_or_too_far(metres, pixels, fault):
    sight = seen()
    sight.positions[0, 2], sight.sides[0] = metres, pixels
    assert HangerWatch(HANGER).faults(sight, FAR, 0.0) == fault
