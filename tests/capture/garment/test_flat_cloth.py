"""Placing, ways, hidden corners and corners of flat cloth, worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter, fit_surface
from capture.garment.corners import CURL_SD, HARRIS_SD, HELD_SD, PanelCorners, ShirtCorners
from capture.garment.coverage import NOWHERE, SeenWays, beyond_the_seen
from capture.garment.geodesic import farthest_place, geodesic_distances
from capture.garment.occlusion import folded_away, is_at_border, is_behind_something
from capture.garment.placing import PATCH_RADIUS, PATCH_SPREAD, Placer, project
from capture.garment.slant import AROUND, LEVEL, rim_slant
from formats.rig import Sensor
from tests.capture.garment.flat_cloth import LEFT, TOP, rectangle, silhouette

CAMERA = Sensor(width=640, height=480, fx=575.8, fy=500.0, cx=319.5, cy=239.5)
WHOLE = rectangle(20, 20, 179, 139)


def placer(cloth):
    return Placer(cloth, CAMERA, CorrelationMeter(4.0))


def plane(normal, distance, shape=WHOLE.shape):
    """Depth [m] of the plane normal . X = distance in the window."""
    rows, columns = np.indices(shape)
    rays = np.stack([(columns + LEFT - CAMERA.cx) / CAMERA.fx, (rows + TOP - CAMERA.cy) / CAMERA.fy, np.ones(shape)])
    return distance / np.einsum("i,ihw", np.array(normal), rays)


def test_places_are_projected_with_their_own_focal_lengths():
    """x/z = 0.1, y/z = -0.2: 319.5 + 57.58 and 239.5 - 100."""
    places = np.array([[0.2, -0.4, 2.0], [0.0, 0.0, 1.0]])
    assert project(places, CAMERA) == pytest.approx(np.array([[377.08, 139.5], [319.5, 239.5]]))


def test_a_pixel_on_slanted_cloth_is_placed_where_its_ray_meets_the_plane():
    normal, distance = np.array([0.3, -0.2, 0.933]), 1.5
    pixel = np.array([LEFT + 90.25, TOP + 70.75])
    cloth = silhouette(WHOLE, plane(normal, distance))
    place, sd = placer(cloth).place(pixel, np.array([0.5, 2.0]))
    ray = np.array([(pixel[0] - CAMERA.cx) / CAMERA.fx, (pixel[1] - CAMERA.cy) / CAMERA.fy, 1.0])
    assert place == pytest.approx(ray * distance / (normal @ ray), abs=1e-5)
    # dz/du = -z n_x / (fx n . ray), likewise along v.
    z = place[2]
    slope = -z / (normal @ ray) * normal[:2] / [CAMERA.fx, CAMERA.fy]
    rows, columns = np.indices(WHOLE.shape)
    near = (np.abs(columns - 90) <= PATCH_RADIUS) & (np.abs(rows - 70) <= PATCH_RADIUS)
    fitted = fit_surface(
        columns[near] - 90.25, rows[near] - 70.75, cloth.depth[near].astype(float),
        focal_length=CAMERA.fx, spread=PATCH_SPREAD, correlated_pixels=4.0,
    )  # fmt: skip
    along = math.hypot(fitted.sd, 0.5 * slope[0], 2.0 * slope[1])
    across = z * np.array([0.5 / CAMERA.fx, 2.0 / CAMERA.fy])
    assert sd == pytest.approx([math.hypot(across[0], ray[0] * along), math.hypot(across[1], ray[1] * along), along])


@pytest.mark.parametrize(("u", "v"), [(22, 70), (177, 70), (90, 22), (90, 137), (20, 20), (179, 139)])
def test_the_two_outermost_pixels_of_the_cloth_do_not_tell_its_depth(u, v):
    """They are 50 mm farther, mixed with what is behind; what is farther in than the patch says nothing, either."""
    depth = np.full(WHOLE.shape, 1.65)
    depth[22:138, 22:178] = 1.6
    far = (np.abs(np.arange(160)[:, None] - v) > PATCH_RADIUS) | (np.abs(np.arange(200)[None] - u) > PATCH_RADIUS)
    depth[far] = 1.63
    place, _ = placer(silhouette(WHOLE, depth)).place(np.array([LEFT + u, TOP + v], float), np.ones(2))
    assert place[2] == pytest.approx(1.6, abs=1e-5)


def test_cloth_that_fills_the_window_has_its_rim_at_the_windows():
    mask = np.ones((60, 60), np.uint8)
    depth = np.full(mask.shape, 1.65)
    depth[2:-2, 2:-2] = 1.6
    for u, v in ((0, 0), (59, 59), (0, 30), (30, 59)):
        place, _ = placer(silhouette(mask, depth)).place(np.array([LEFT + u, TOP + v], float), np.ones(2))
        assert place[2] == pytest.approx(1.6, abs=1e-5)


def test_a_pixel_without_cloth_around_it_has_no_place():
    cloth = silhouette(WHOLE)
    for pixel in ([np.nan, np.nan], [LEFT - 40, TOP + 70], [LEFT + 90, TOP + 300], [LEFT + 2, TOP + 2]):
        place, sd = placer(cloth).place(np.array(pixel, float), np.ones(2))
        assert np.isnan([*place, *sd]).all()
    cloth.depth[:] = 0.0
    assert np.isnan(placer(cloth).place(np.array([LEFT + 90.0, TOP + 70]), np.ones(2))[0]).all()


H = 0.02  # m between nodes


def sheet(rows=9, columns=12, slope=0.0):
    """A flat surface [m], (rows, columns, 3), whose depth rises by `slope` along x."""
    y, x = np.indices((rows, columns)) * H
    return np.stack([x, y, 1.6 + slope * x], axis=-1)


def test_ways_on_a_flat_sheet_are_those_of_king_and_knight():
    """5 straight, 4 diagonal, a knight's (2, 1) and (1, 2) twice, and a straight step after a knight's."""
    ways, _ = geodesic_distances(sheet(), sheet()[0, 0][None])
    steps = {(0, 5): 5, (5, 0): 5, (4, 4): 4 * math.sqrt(2), (2, 1): math.sqrt(5), (2, 4): 2 * math.sqrt(5),
             (6, 3): 3 * math.sqrt(5), (1, 4): 2 + math.sqrt(5)}  # fmt: skip
    # The first 2.5 steps around the source are straight.
    steps[1, 4] = min(math.hypot(1, 2) + 2, 4 + math.sqrt(2))
    for node, count in steps.items():
        assert ways[(0, *node)] == pytest.approx(count * H, rel=1e-5), node


def test_ways_lead_in_every_direction_and_from_every_source_to_every_other():
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


def test_ways_on_a_steep_sheet_are_longer():
    """Depth rises by 1 m/m: every step across is sqrt 2 times as long."""
    surface = sheet(slope=1.0)
    ways, _ = geodesic_distances(surface, surface[4, 0][None])
    assert ways[0, 4, 6] == pytest.approx(6 * math.sqrt(2) * H, rel=1e-5)


@pytest.mark.parametrize(("jump", "way"), [(1.7, math.hypot(1, 1.7)), (3.8, None), (3.9, math.inf)])
def test_no_way_leads_over_a_step_twice_as_long_as_it_is_wide(jump, way):
    """Straight across, a jump of sqrt 3 nodes; by a knight's move, sqrt 5 wide, of sqrt 15 = 3.87."""
    surface = sheet()
    surface[:, 6:, 2] += jump * H
    ways, _ = geodesic_distances(surface, surface[4, 5][None])
    if way is None:
        assert 4.0 * H < ways[0, 4, 6] < 10.0 * H
    else:
        assert ways[0, 4, 6] == pytest.approx(way * H, rel=1e-5)


def test_ways_go_around_a_hole_and_not_across_a_gap():
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


def test_the_farthest_place_of_a_cone_that_was_cut_off_is_its_tip_between_the_nodes():
    """Four ways that grow by 1 a step from the four sides: of 11 x 11 nodes the middle is (5, 5)."""
    r, c = np.indices((11, 11)).astype(np.float32)
    assert farthest_place(np.stack([r, 10 - r, c, 10 - c])) == pytest.approx((5.0, 5.0), abs=0.01)
    r, c = np.indices((11, 13)).astype(np.float32)
    off = farthest_place(np.stack([r + 0.5, 10 - r, c, 12 - c + 0.75]))
    assert off is not None
    assert off[0] == pytest.approx(4.75, abs=0.13)
    smooth = 30.0 - (r - 4.25) ** 2 - 0.5 * (c - 7.5) ** 2 - 0.25 * (r - 4.25) * (c - 7.5)
    assert farthest_place(smooth[None].astype(np.float32)) == (4.25, 7.5)


def test_no_place_is_farthest_at_a_border_or_on_too_small_a_surface():
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


BESIDE = np.array([LEFT + 180.0, TOP + 80.0])


@pytest.mark.parametrize(
    ("columns", "rows", "millimetres", "is_hidden"),
    [(4, 5, 1499, True), (19, 1, 1499, False), (4, 5, 1501, False), (4, 5, 0, False)],
)
def test_twenty_pixels_nearer_by_a_jump_hide_what_is_beside_them(columns, rows, millimetres, is_hidden):
    """A jump of 0.1 m from 1.6 m; 19 pixels are too few, 1501 mm are no jump, 0 is missing."""
    raw = np.zeros(WHOLE.shape, np.uint16)
    if rows == 1:
        raw[70 : 70 + columns, 181] = millimetres
    else:
        raw[80 : 80 + rows, 181 : 181 + columns] = millimetres
    assert is_behind_something(silhouette(WHOLE, raw=raw), BESIDE, 1.6, 0.1) == is_hidden


def test_what_is_nearer_counts_within_twelve_pixels_and_off_the_garment():
    for shift, is_hidden in ((0, True), (1, False)):
        raw = np.zeros(WHOLE.shape, np.uint16)
        raw[92 + shift, 181:191] = raw[68 - shift, 181:191] = 1400
        assert is_behind_something(silhouette(WHOLE, raw=raw), BESIDE, 1.6, 0.1) == is_hidden
        raw = np.zeros(WHOLE.shape, np.uint16)
        raw[75:85, 191 + shift : 193 + 2 * shift] = 1400
        assert is_behind_something(silhouette(WHOLE, raw=raw), BESIDE, 1.6, 0.1) == is_hidden
    raw = np.full(WHOLE.shape, 1400, np.uint16) * WHOLE
    assert not is_behind_something(silhouette(WHOLE, raw=raw), BESIDE, 1.6, 0.1)
    corner = np.array([LEFT + 1.0, TOP + 1.0])
    raw = np.zeros(WHOLE.shape, np.uint16)
    raw[:4, :5] = 1400
    assert is_behind_something(silhouette(WHOLE, raw=raw), corner, 1.6, 0.1)


@pytest.mark.parametrize(
    ("u", "v", "is_out"),
    [(3, 3, False), (636, 476, False), (2, 100, True), (637, 100, True), (100, 2, True), (100, 477, True)],
)
def test_the_three_outermost_pixels_are_the_border(u, v, is_out):
    assert is_at_border(np.array([u, v], float), (480, 640)) == is_out


def corner_ways(changed):
    """Ways between the corners of a square of 1 m, with those of some pairs changed."""
    flat = np.array(
        [[0, 1, math.sqrt(2), 1], [1, 0, 1, math.sqrt(2)], [math.sqrt(2), 1, 0, 1], [1, math.sqrt(2), 1, 0]]
    )
    seen = flat.copy()
    for (i, j), way in changed.items():
        seen[i, j] = seen[j, i] = way
    return seen, flat


@pytest.mark.parametrize(
    ("changed", "folded", "wrong"),
    [
        # Of 1 m may be missing 25 and 8 mm, too much are 100 and 8 mm.
        ({(0, 1): 0.968}, [], []),
        ({(0, 1): 0.966}, [0], []),
        ({(0, 1): 1.107}, [], []),
        ({(0, 1): 1.109}, [], [0]),
        ({(0, 1): 0.9, (1, 2): 0.9}, [1], []),
        ({(0, 1): 1.3, (1, 2): 1.3}, [], [1]),
        ({(0, 1): np.inf, (1, 2): np.inf, (1, 3): np.inf}, [], [1]),
        ({(0, 1): np.nan, (1, 2): np.nan, (1, 3): np.nan}, [], []),
        # The shortest is blamed first; what is left between the other two is looked at again.
        ({(0, 1): 0.5, (1, 2): 0.5, (2, 3): 0.9}, [1, 2], []),
        ({(0, 1): 0.9, (1, 2): 0.9, (1, 3): 2.0}, [1], [3]),
        ({(0, 1): 0.9, (2, 3): 1.3}, [0], [2]),
    ],
)
def test_the_corner_with_most_missing_or_too_much_is_blamed(changed, folded, wrong):
    found = folded_away(*corner_ways(changed), np.zeros(4, bool))
    assert [np.flatnonzero(one).tolist() for one in found] == [folded, wrong]


def test_a_corner_that_is_trusted_is_never_blamed():
    trusted = np.array([True, True, False, False])
    assert not np.any(folded_away(*corner_ways({(0, 1): 0.5}), trusted))
    folded, wrong = folded_away(*corner_ways({(1, 2): 0.5, (0, 3): 1.5}), trusted)
    assert (folded.tolist(), wrong.tolist()) == ([False, False, True, False], [False, False, False, True])


PIXEL = 1.6 / 500.0
SQUARE = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)


def metres(u, v):
    """Place [m] of a pixel of the window on the plane 1.6 m away."""
    return np.array([(LEFT + u - SQUARE.cx) * PIXEL, (TOP + v - SQUARE.cy) * PIXEL, 1.6])


def covered(hidden_rows, found=(False, False, False, False)):
    """A panel of 160 x 120 pixels whose lowest rows are hidden: how far its corners lie beyond what is seen."""
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


LEFT_TOP = np.array([LEFT, TOP])


def test_lower_corners_are_beyond_by_the_rows_that_are_hidden():
    """40 rows of 3.2 mm are 128 mm. From the ends at (0, 0) and (w, 0) the place (x, y) is the nearest that is seen.

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
    assert (seen.pixels.shape, seen.places.shape) == ((4, 2), (4, 3))
    nothing = SeenWays(np.zeros((0, 3, 3)), 5, np.zeros((2, 3)), np.zeros((4, 0, 3), np.float32), np.zeros(4, bool))
    assert (beyond_the_seen(silhouette(WHOLE), nothing, np.zeros((2, 4)), np.zeros((4, 4)), SQUARE).by_all == 9).all()


@pytest.mark.parametrize(("outwards", "along"), [(0.5, 0.0), (-0.5, 0.0), (0.3, 0.4), (0.3, -0.4)])
def test_the_slant_at_a_straight_rim_is_exact(outwards, along):
    """n . X = d with n = (-a, -b, 1) has the slope dz/dx = a where it is level with the ray."""
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    rows, columns = np.indices(WHOLE.shape)
    slope = np.array([outwards, along]) * 1.6 / SQUARE.fx
    inverse = (1 - (slope[0] * (columns - 119) + slope[1] * (rows - 89)) / 1.6) / 1.6
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), 1 / inverse), pixel, 1.6, SQUARE)
    assert slant == pytest.approx((math.atan(outwards), abs(math.atan(along))), abs=1e-4)


def test_cloth_farther_than_fifty_millimetres_does_not_tell_the_slant():
    """Of 15.6 px; beyond, it bends by half a metre a metre."""
    rows, columns = np.indices(WHOLE.shape)
    far = AROUND * SQUARE.fx / 1.6
    away = np.hypot(columns - 119, rows - 89)
    depth = np.where(away <= far, 1.6, 1.6 + 0.5 * PIXEL * (away - far))
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), depth), pixel, 1.6, SQUARE)
    assert slant == pytest.approx(LEVEL, abs=1e-5)


def test_half_the_distance_doubles_the_pixels_that_tell_the_slant():
    depth = np.full(WHOLE.shape, 0.8)
    _, columns = np.indices(WHOLE.shape)
    depth += 0.4 * 0.8 / SQUARE.fx * (columns - 119)
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), depth), pixel, 0.8, SQUARE)
    assert slant.outwards == pytest.approx(math.atan(0.4), abs=0.02)


SIDES = np.full((4, 2), 120.0)
RECTANGLE = np.array([[20, 20], [179, 20], [179, 139], [20, 139]], float)


def window_held(left, right):
    return np.array([left, right], float) + LEFT_TOP


def test_corners_of_a_rectangle_lie_at_the_rims_of_its_outermost_pixels():
    """Half a pixel outside their centres; the top side is where the held edge says."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 18], [179, 18]), SIDES)
    expected = LEFT_TOP + np.array([[19.5, 18], [179.5, 18], [179.5, 139.5], [19.5, 139.5]])
    assert found.pixels == pytest.approx(expected, abs=1e-6)
    # A side of up to 45 px from 3 px on is 43 pixels: 2 x 0.8 px / sqrt 43 and 0.5 px of curl.
    side = math.hypot(1.6 / math.sqrt(43), CURL_SD)
    assert found.sd == pytest.approx(np.array([[side, HELD_SD]] * 2 + [[side, side]] * 2), rel=1e-6)


def test_a_shorter_side_gives_a_shorter_line():
    """0.6 of 50 px are 30: 28 pixels from 3 px on."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), np.full((4, 2), 50.0))
    assert found.sd[2] == pytest.approx([math.hypot(1.6 / math.sqrt(28), CURL_SD)] * 2, rel=1e-6)
    # Each side has its own: before the corner the one to the right, after it the one below.
    sides = np.tile([50.0, 30.0], (4, 1))
    sd = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), sides).sd[2]
    assert sd == pytest.approx([math.hypot(1.6 / math.sqrt(n), CURL_SD) for n in (28, 16)], rel=1e-6)


def test_sides_too_short_for_a_line_leave_the_corner_as_it_was_found():
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), np.full((4, 2), 10.0))
    assert found.sd.tolist() == [[HARRIS_SD] * 2] * 4
    assert found.pixels == pytest.approx(LEFT_TOP + RECTANGLE, abs=2)


def test_a_held_edge_far_from_the_corners_leaves_them_as_they_were_found():
    """A crossing more than 10 px away is none."""
    for above, refined in ((9, True), (11, False)):
        found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20 - above], [179, 20 - above]), SIDES)
        assert (found.sd[0, 1] == HELD_SD) == refined
        assert (found.sd[0, 0] == HARRIS_SD) != refined


def test_corners_of_a_turned_rectangle_are_found_to_a_third_of_a_pixel():
    """Turned by 12 degrees about its middle, drawn pixel by pixel where their centres lie inside."""
    rows, columns = np.indices((200, 220)).astype(float)
    c, s = math.cos(math.radians(12)), math.sin(math.radians(12))
    x, y = c * (columns - 110) + s * (rows - 100), -s * (columns - 110) + c * (rows - 100)
    mask = (np.abs(x) <= 70) & (np.abs(y) <= 50)
    true = np.array(
        [[c * a - s * b + 110, s * a + c * b + 100] for a, b in ((-70, -50), (70, -50), (70, 50), (-70, 50))]
    )
    found = PanelCorners().find(silhouette(mask), true[:2] + LEFT_TOP, SIDES)
    assert np.abs(found.pixels - LEFT_TOP - true).max() < 0.35
    normals = np.hypot([c, s], [s, c])
    assert found.sd[2] == pytest.approx(normals * math.hypot(1.6 / math.sqrt(46), CURL_SD), rel=0.05)


def test_a_line_of_pixels_has_no_four_corners():
    line = rectangle(20, 20, 20, 139)
    for finder in (PanelCorners(), ShirtCorners()):
        found = finder.find(silhouette(line), window_held([20, 20], [22, 20]), SIDES)
        assert found.pixels.shape == found.sd.shape == (4, 2)
        assert np.isnan([found.pixels, found.sd]).all()


def test_a_shirts_upper_corners_are_its_outermost_places():
    """A T of 160 px whose sleeves end slanted, 20 px lower outside than a panel's corner would be."""
    mask = rectangle(60, 20, 139, 139)
    for k in range(40):
        mask[20 + k // 2 : 60 + k // 2, 60 - k] = 1
        mask[20 + k // 2 : 60 + k // 2, 139 + k] = 1
    shirt = ShirtCorners()
    assert shirt.tips == (0, 1)
    assert PanelCorners().tips == ()
    found = shirt.find(silhouette(mask), window_held([60, 20], [139, 20]), SIDES)
    assert found.pixels[:2, 0] == pytest.approx([LEFT + 21, LEFT + 178], abs=2.5)
    assert found.pixels[2:] == pytest.approx(LEFT_TOP + np.array([[139.5, 139.5], [59.5, 139.5]]), abs=0.1)


def test_corners_of_a_flat_outline_by_the_same_rule():
    """In metres and y up: a hexagon with sleeves at (-3, 1) and (3, 1.1)."""
    outline = np.array([[-2.0, 2.0], [2.0, 2.0], [3.0, 1.1], [2.0, -2.0], [-2.0, -2.1], [-3.0, 1.0]])
    assert PanelCorners().flat_corners(outline).tolist() == [[-2, 2], [3, 1.1], [2, -2], [-2, -2.1]]
    assert ShirtCorners().flat_corners(outline).tolist() == [[-3, 1], [3, 1.1], [2, -2], [-2, -2.1]]
    square = np.array([[-1.0, 1.0], [1.1, 1.0], [1.0, -1.0], [-1.0, -1.1]])
    assert PanelCorners().flat_corners(square).tolist() == square.tolist()
