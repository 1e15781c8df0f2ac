"""The distance of corners beyond the visible part of flat cloth, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.coverage import INNER_RIM, NOWHERE, SeenWays, _rim_places, beyond_the_seen
from capture.garment.geodesic import geodesic_distances
from tests.capture.garment.flat_cloth import (
    LEFT,
    LEFT_TOP,
    PIXEL,
    RECTANGLE,
    SQUARE,
    TOP,
    WHOLE,
    rectangle,
    sheet,
    silhouette,
)


def metres(u, v):
    """Return the position [m] of a pixel of the window on the plane 1.6 m away."""
    return np.array([(LEFT + u - SQUARE.cx) * PIXEL, (TOP + v - SQUARE.cy) * PIXEL, 1.6])


def covered(hidden_rows, found=(False, False, False, False)):
    """Return the corners' distances beyond the visible part of a panel of 160 x 120 pixels with hidden lowest rows."""
    bottom = 139 - hidden_rows
    cell = 5
    rows, columns = np.indices(((bottom - 20) // cell + 1, 160 // cell)) * cell
    surface = np.full((bottom // cell + 1, 180 // cell, 3), np.nan)
    for r, c in zip(rows.ravel() + 20, columns.ravel() + 20, strict=True):
        surface[r // cell, c // cell] = metres(c + 2, r + 2)
    ends = np.stack([metres(20, 20), metres(179, 20)])
    corners = np.stack([metres(20, 20), metres(179, 20), metres(179, 139), metres(20, 139)])
    from_ends = np.linalg.norm(ends[:, None] - corners[None], axis=-1)
    distances = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    ways = SeenWays(surface, cell, ends, geodesic_distances(surface, corners)[0], np.array(found))
    return beyond_the_seen(silhouette(rectangle(20, 20, 179, bottom)), ways, from_ends, distances, SQUARE)


def test_corners_of_a_panel_in_view_are_where_the_seen_cloth_is():
    """Within 2 % of ways of half a metre, all of them in their corner."""
    seen = covered(0)
    assert seen.by_ends.max() < 0.012
    assert seen.pixels == pytest.approx(LEFT_TOP + RECTANGLE, abs=4)
    places = np.stack([metres(20, 20), metres(179, 20), metres(179, 139), metres(20, 139)])
    assert seen.places == pytest.approx(places, abs=5 * PIXEL)


def test_lower_corners_are_beyond_by_the_rows_that_are_hidden():
    """40 rows of 3.2 mm are 128 mm. From the ends at (0, 0) and (w, 0) the position (x, y) is the nearest that is seen.

    On the lowest row both ways are too short; the root mean square of what is left is least along that row.
    """
    seen = covered(40)
    width, height, y = 159 * PIXEL, 119 * PIXEL, 79 * PIXEL
    x = np.linspace(0, width, 400)
    left = np.hypot(x, y) - math.hypot(width, height)
    right = np.hypot(width - x, y) - height
    least = np.sqrt(0.5 * (left**2 + right**2)).min()
    assert seen.by_ends[2:] == pytest.approx([least, least], abs=0.012)
    assert seen.by_ends[:2].max() < 0.012
    assert seen.by_all == pytest.approx(seen.by_ends)


def test_a_corner_that_was_found_is_an_anchor_of_the_others_but_not_of_its_own():
    """The right lower corner is hidden by 40 rows. Of the upper ones, known twice each, all anchors are the same."""
    plain, both = covered(40), covered(40, (True, True, False, False))
    assert both.by_ends == pytest.approx(plain.by_ends)
    assert both.by_all[2:] == pytest.approx(plain.by_ends[2:], abs=0.012)
    # A third anchor that says the corner is elsewhere counts a third.
    third = covered(40, (False, False, False, True))
    assert third.by_all[3] == pytest.approx(plain.by_all[3])
    assert third.by_all[2] != pytest.approx(plain.by_all[2], abs=0.005)


def test_corners_lie_beyond_everything_where_no_cloth_is_seen():
    cloth = silhouette(WHOLE)
    cloth.depth[:] = 0.0
    ways = SeenWays(sheet(), 5, np.zeros((2, 3)), np.zeros((4, 9, 12), np.float32), np.zeros(4, bool))
    seen = beyond_the_seen(cloth, ways, np.zeros((2, 4)), np.zeros((4, 4)), SQUARE)
    assert (seen.by_ends == NOWHERE).all()
    assert (seen.by_all == NOWHERE).all()
    assert np.isnan(seen.pixels).all()
    assert (seen.by_ends.shape, seen.by_all.shape) == ((4,), (4,))
    assert (seen.pixels.shape, seen.places.shape) == ((4, 2), (4, 3))
    nothing = SeenWays(np.zeros((0, 3, 3)), 5, np.zeros((2, 3)), np.zeros((4, 0, 3), np.float32), np.zeros(4, bool))
    assert (beyond_the_seen(silhouette(WHOLE), nothing, np.zeros((2, 4)), np.zeros((4, 4)), SQUARE).by_all == 9).all()


def test_corners_lie_nine_metres_beyond_cloth_that_no_way_reaches():
    ways = SeenWays(
        np.full((32, 40, 3), np.nan), 5, np.zeros((2, 3)), np.zeros((4, 32, 40), np.float32), np.zeros(4, bool)
    )
    seen = beyond_the_seen(silhouette(WHOLE), ways, np.zeros((2, 4)), np.zeros((4, 4)), SQUARE)
    assert seen.by_ends.tolist() == [NOWHERE] * 4


def test_cloth_that_fills_the_window_has_its_rim_there():
    """Every second pixel along both axes that is less than six pixels from the window's border."""
    _, rows, columns = _rim_places(silhouette(np.ones((40, 50))), SQUARE)
    r, c = np.mgrid[0:40:2, 0:50:2].reshape(2, -1)
    near = np.minimum(np.minimum(r, 39 - r), np.minimum(c, 49 - c)) < INNER_RIM
    assert set(zip(rows.tolist(), columns.tolist(), strict=True)) == set(
        zip(r[near].tolist(), c[near].tolist(), strict=True)
    )
