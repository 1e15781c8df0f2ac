"""Grids on a silhouette: recognition, skew, and material positions."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from fit.recordings.grids import _ways, grid_of, length_seen, placed, skew_degrees
from tests.fit.recordings.silhouettes import silhouette_sheet
from tests.fit.scenes import sheet


def flat(garment, frames=1):
    places = np.array([p.at_m for p in garment.points])
    return np.stack([places[:, 0], 0 * places[:, 0], places[:, 1]], 1)[None].repeat(frames, 0)


def ends(frames=1):
    return np.tile([-0.15, 0.0, 0.0, 0.15, 0.0, 0.0], (frames, 1))


def test_a_grid_is_known_whatever_the_order_of_its_points():
    garment = silhouette_sheet()
    mixed = replace(garment, points=tuple(garment.points[k] for k in np.random.default_rng(2).permutation(64)))
    for one in (garment, mixed):
        grid = grid_of(one)
        places = np.array([p.at_m for p in one.points])
        assert places[grid.at[0], 1] == pytest.approx(0.0)
        assert np.diff(places[grid.at[3], 0]) == pytest.approx(0.3 / 7)
        assert grid.down[[0, -1]] == pytest.approx([0.0, 0.3])


def test_five_points_and_a_grid_with_a_hole_are_none():
    garment = silhouette_sheet()
    assert grid_of(sheet()) is None
    assert grid_of(replace(garment, points=garment.points[:-1])) is None


@pytest.mark.parametrize(("columns", "rows", "is_grid"), [(4, 4, True), (3, 6, False), (6, 3, False), (4, 5, True)])
def test_a_grid_has_four_rows_and_columns(columns, rows, is_grid):
    garment = silhouette_sheet()
    across, down = np.linspace(-0.15, 0.15, columns), np.linspace(0.0, -0.3, rows)
    points = tuple(replace(garment.points[0], name=f"{x}{y}", at_m=(x, y)) for y in down for x in across)
    found = grid_of(replace(garment, points=points))
    assert (found is not None) == is_grid
    if is_grid:
        assert (found.at.shape, found.across) == ((rows, columns), pytest.approx(across + 0.15))


def test_the_skew_of_a_sheared_grid_is_its_angle():
    garment = silhouette_sheet()
    points = flat(garment, 3)
    for frame, degrees in enumerate((0.0, 5.0, -7.0)):
        points[frame, :, 0] += np.tan(np.radians(degrees)) * points[frame, :, 2]
    points[0, :60] = np.nan
    skew = skew_degrees(points, grid_of(garment))
    assert np.isnan(skew[0])
    assert np.abs(skew[1:]) == pytest.approx([5.0, 7.0])
    assert skew[1] * skew[2] < 0


def test_a_grid_that_has_fallen_into_a_line_is_askew_by_a_right_angle():
    """Whichever way the line goes, and however its cosine is rounded beyond one."""
    garment = silhouette_sheet()
    places = np.array([p.at_m for p in garment.points])
    ways = np.random.default_rng(0).normal(size=(200, 3))
    for sign in (1.0, -1.0):
        points = (places[:, 0] - sign * places[:, 1])[:, None] * ways[:, None]
        assert skew_degrees(points, grid_of(garment)) == pytest.approx(np.full(200, 90.0 * sign), abs=1e-5)


def test_a_grid_that_is_laid_over_a_shorter_silhouette_is_moved_to_its_position():
    """On a cylinder of 0.2 m, laid down to 0.25 m of 0.3 m: places within are on the cylinder, those below unseen."""
    garment, radius = silhouette_sheet(), 0.2
    grid = grid_of(garment)
    places = np.array([p.at_m for p in garment.points])

    def bent(down):
        return np.stack([places[:, 0], radius * (1 - np.cos(down / radius)), -radius * np.sin(down / radius)], 1)

    laid = bent(-places[:, 1] * 0.25 / 0.3)
    found = placed(laid[None], ends(), grid)[0]
    covered = -places[:, 1] < 0.25
    assert np.isfinite(found).all(1).tolist() == covered.tolist()
    # Chords of 36 mm on this cylinder are 0.05 mm shorter than their arcs and 0.8 mm inside them.
    assert np.abs(found - bent(-places[:, 1]))[covered].max() < 1e-3
    assert np.abs(laid - bent(-places[:, 1]))[covered].max() > 0.025
    assert length_seen(laid[None], ends(), grid)[0] == pytest.approx(0.25, abs=1e-3)


def test_the_path_down_begins_at_the_held_edge_and_not_at_the_first_row():
    """A grid whose first row hangs 0.02 m below the edge, 30 degrees out of the vertical."""
    garment = silhouette_sheet()
    grid, down = grid_of(garment), np.array([0.0, 0.5, -np.sqrt(0.75)])
    places = np.array([p.at_m for p in garment.points])
    points = places[:, :1] * [1.0, 0.0, 0.0] + (0.02 - places[:, 1:]) * down
    assert length_seen(points[None], ends(), grid)[0] == pytest.approx(0.32)


def test_columns_that_are_hardly_seen_are_not_placed():
    garment = silhouette_sheet()
    grid = grid_of(garment)
    points = flat(garment)
    points[0, grid.at[2:, :4].ravel()] = np.nan
    found = placed(points, ends(), grid)[0]
    assert np.isnan(found[grid.at[:, :4]]).all()
    assert found[grid.at[:, 4:]] == pytest.approx(points[0, grid.at[:, 4:]], abs=1e-9)
    points[:] = np.nan
    assert np.isnan(placed(points, ends(), grid)).all()


def test_the_way_down_a_column_is_its_polyline_and_its_first_point_is_projected_on_the_whole_way():
    """From the edge's end the first point is 0.1 m off along z; the way from first to last is (0, 0.3, -0.1)."""
    column = np.array([[0.0, 0.0, -0.1], [0.0, 0.1, -0.2], [0.0, 0.3, -0.2]])
    laid = np.stack([column, column + np.array([0.2, 0.0, 0.0])], 1)
    across, down = _ways(laid, np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]))
    first = 0.1 * 0.1 / np.hypot(0.3, 0.1)
    ways = [first, first + np.hypot(0.1, 0.1), first + np.hypot(0.1, 0.1) + 0.2]
    assert across == pytest.approx(np.tile([0.0, 0.2], (3, 1)))
    assert down == pytest.approx(np.tile(ways, (2, 1)).T)
    laid[1, 1] = np.nan
    assert np.isnan(_ways(laid, np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]))[1][:, 1]).all()
