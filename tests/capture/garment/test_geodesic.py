"""Geodesic distances on flat cloth and the point farthest from its corners, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.geodesic import _spacing, farthest_place, geodesic_distances
from tests.capture.garment.flat_cloth import H, sheet


def test_paths_on_a_flat_sheet_are_those_of_king_and_knight():
    """5 straight, 4 diagonal, a knight's (2, 1) and (1, 2) twice, and a straight step after a knight's."""
    ways, _ = geodesic_distances(sheet(), sheet()[0, 0][None])
    steps = {(0, 5): 5, (5, 0): 5, (4, 4): 4 * math.sqrt(2), (2, 1): math.sqrt(5), (2, 4): 2 * math.sqrt(5),
             (6, 3): 3 * math.sqrt(5), (1, 4): 2 + math.sqrt(5)}  # fmt: skip
    # The first 2.5 steps around the source are straight.
    steps[1, 4] = min(math.hypot(1, 2) + 2, 4 + math.sqrt(2))
    for node, count in steps.items():
        assert ways[(0, *node)] == pytest.approx(count * H, rel=1e-5), node


def test_paths_lead_in_every_direction_and_from_every_source_to_every_other():
    surface = sheet()
    sources = np.stack([surface[0, 11], surface[8, 0], surface[4, 5] + [0.3 * H, 0, 0], np.full(3, np.nan)])
    ways, apart = geodesic_distances(surface, sources)
    assert ways[0, 8, 3] == pytest.approx(8 * math.sqrt(2) * H, rel=1e-5)
    assert ways[1, 0, 8] == pytest.approx(8 * math.sqrt(2) * H, rel=1e-5)
    assert ways[2, 4, 11] == pytest.approx(5.7 * H, rel=1e-5)
    assert ways[2, 4, 0] == pytest.approx(5.3 * H, rel=1e-5)
    # 8 down and 11 across: 5 diagonals and 3 knight's moves.
    assert apart[0, 1] == pytest.approx((5 * math.sqrt(2) + 3 * math.sqrt(5)) * H, rel=1e-4)
    assert (apart[:3, :3] == apart[:3, :3].T).all()
    assert np.diag(apart).tolist() == [0.0] * 4
    assert np.isinf(ways[3]).all()
    assert np.isinf(apart[3, :3]).all()


def test_paths_on_a_steep_sheet_are_longer():
    """Depth rises by 1 m/m: every step across is sqrt 2 times as long."""
    surface = sheet(slope=1.0)
    ways, _ = geodesic_distances(surface, surface[4, 0][None])
    assert ways[0, 4, 6] == pytest.approx(6 * math.sqrt(2) * H, rel=1e-5)


@pytest.mark.parametrize(("jump", "way"), [(1.7, math.hypot(1, 1.7)), (3.8, None), (3.9, math.inf)])
def test_no_path_leads_over_a_step_twice_as_long_as_it_is_wide(jump, way):
    """Straight across, a jump of sqrt 3 nodes; by a knight's move, sqrt 5 wide, of sqrt 15 = 3.87."""
    surface = sheet()
    surface[:, 6:, 2] += jump * H
    ways, _ = geodesic_distances(surface, surface[4, 5][None])
    if way is None:
        assert 4.0 * H < ways[0, 4, 6] < 10.0 * H
    else:
        assert ways[0, 4, 6] == pytest.approx(way * H, rel=1e-5)


def test_paths_go_around_a_hole_and_not_across_a_gap():
    surface = sheet()
    surface[:7, 5:7] = np.nan
    ways, apart = geodesic_distances(surface, np.stack([surface[0, 4], surface[0, 7]]))
    assert ways[0, 0, 7] > 2 * 6 * H
    assert apart[0, 1] == pytest.approx(ways[0, 0, 7])
    assert np.isinf(ways[:, 0, 5]).all()
    surface[:, 5:7] = np.nan
    ways, apart = geodesic_distances(surface, np.stack([surface[0, 4], surface[0, 7]]))
    assert np.isinf(ways[0, :, 7:]).all()
    assert np.isinf(apart[0, 1])


def test_a_source_away_from_the_surface_by_three_steps_reaches_nothing():
    for away, leads in ((2.4, True), (2.6, False)):
        ways, _ = geodesic_distances(sheet(), np.array([[0.0, 0.0, 1.6 + away * H]]))
        assert np.isfinite(ways).all() == leads


def test_the_farthest_point_of_a_cone_that_was_cut_off_is_its_tip_between_the_nodes():
    """Four ways that grow by 1 a step from the four sides: of 11 x 11 nodes the middle is (5, 5)."""
    r, c = np.indices((11, 11)).astype(np.float32)
    assert farthest_place(np.stack([r, 10 - r, c, 10 - c])) == pytest.approx((5.0, 5.0), abs=0.01)
    r, c = np.indices((11, 13)).astype(np.float32)
    off = farthest_place(np.stack([r + 0.5, 10 - r, c, 12 - c + 0.75]))
    assert off is not None
    assert off[0] == pytest.approx(4.75, abs=0.13)
    smooth = 30.0 - (r - 4.25) ** 2 - 0.5 * (c - 7.5) ** 2 - 0.25 * (r - 4.25) * (c - 7.5)
    assert farthest_place(smooth[None].astype(np.float32)) == (4.25, 7.5)


def test_no_point_is_farthest_at_a_border_or_on_too_small_a_surface():
    r, c = np.indices((11, 13)).astype(np.float32)
    assert farthest_place(c[None]) is None
    assert farthest_place(r[None]) is None
    assert farthest_place(np.ones((1, 4, 9), np.float32)) is None
    broken = np.stack([r, 10 - r, c, 12 - c])
    broken[0, ::4, ::4] = np.inf
    assert farthest_place(broken) is None
    left = np.stack([r, 10 - r, c, 12 - c])
    left[1, :, 8:] = np.inf
    place = farthest_place(left)
    assert place is None or place[1] < 6.5


def test_no_point_is_farthest_where_a_node_beside_it_is_farther_still():
    """A way that grows upwards or to the left has its largest value at the border, like one downwards or right."""
    r, c = np.indices((11, 13)).astype(np.float32)
    assert farthest_place((10 - r)[None]) is None
    assert farthest_place((12 - c)[None]) is None


@pytest.mark.parametrize(("row", "column"), [(5, 0), (5, 12), (0, 6), (10, 6)])
def test_a_farther_node_that_is_not_beside_the_farthest_point_does_not_matter(row, column):
    """The point lies two nodes from it, with a lower one between; the surface's rim counts for nothing."""
    at = (min(max(row, 2), 8), min(max(column, 2), 10))
    r, c = np.indices((11, 13)).astype(np.float32)
    way = 10.0 - np.abs(r - at[0]) - np.abs(c - at[1])
    way[row, column] = 12.0
    assert farthest_place(way[None]) is not None


def test_a_surface_of_five_nodes_by_five_has_one_point_inside():
    r, c = np.indices((5, 5)).astype(np.float32)
    assert farthest_place(np.stack([r, 4 - r, c, 4 - c])) == pytest.approx((2.0, 2.0), abs=0.01)


def test_the_spacing_is_the_median_distance_across():
    """201 of them, in no order; a surface of one column has none, and no way leads over it."""
    widths = np.random.default_rng(5).permutation(201) + 1.0
    surface = sheet(1, 202)
    surface[0, 1:, 0] = 1e-3 * np.cumsum(widths)
    surface[0, 0, 0] = 0.0
    assert _spacing(surface) == pytest.approx(1e-3 * 101.0)
    column = sheet(9, 1)
    assert _spacing(column) == 0.0
    ways, _ = geodesic_distances(column, column[4, 0][None])
    assert np.isinf(ways).all()
    assert ways.dtype == np.float32
