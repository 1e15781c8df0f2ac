"""Places, scans and ways at their limits: cloth nearer than a metre, first rows and columns, and bulging sides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter
from capture.garment.coverage import NEIGHBOUR_NODES, NOWHERE, SeenWays, _rim_places, _ways_to, beyond_the_seen
from capture.garment.geodesic import geodesic_distances
from capture.garment.peeking import BELOW, _below, _depth_around, peeking_area
from capture.garment.placing import Placer
from capture.garment.plausibility import FASTEST_POINT, HARDEST_WHIP, POINT_MEMORY, MotionGate
from capture.garment.silhouette import _before_jumps, _cut_above, _hanging_piece
from capture.garment.slant import rim_slant
from capture.garment.surface_scan import (
    CORNER_REACH_PIXELS,
    _in_metres,
    _patch,
    _side,
    _smooth_depth,
    _smoothed,
    scan_surface,
)
from tests.capture.garment.flat_cloth import LEFT, LEFT_TOP, PIXEL, RECTANGLE, SQUARE, TOP, WHOLE, silhouette
from tests.capture.garment.test_coverage_by_hand import metres
from tests.capture.garment.test_peeking import CAMERA, CORNER, HELD, peeking, scene

NEAR = silhouette(WHOLE, 0.8)


def test_cloth_nearer_than_a_metre_is_cloth():
    """At 0.8 m: its rim, a place on it, its depth around a point and its scanned depth."""
    places, rows, _ = _rim_places(NEAR, SQUARE)
    assert len(places) == len(rows) > 100
    assert places[:, 2] == pytest.approx(np.full(len(places), 0.8))
    assert _depth_around(NEAR, LEFT_TOP + np.array([100.0, 80.0]), 1.6) == pytest.approx(0.8)
    assert _smooth_depth(NEAR)[80, 100] == pytest.approx(0.8)
    place, _ = Placer(NEAR, SQUARE, CorrelationMeter()).place(LEFT_TOP + np.array([100.0, 80.0]), np.ones(2))
    assert place[2] == pytest.approx(0.8)


def one_node(rows, columns, cell=3):
    """A surface of so many nodes at one place, and a map of distances for each node that leads nowhere but there."""
    count = rows * columns
    maps = np.full((count, rows, columns), NOWHERE, np.float32)
    maps.reshape(count, -1)[np.arange(count), np.arange(count)] = 0.0
    ways = SeenWays(np.zeros((rows, columns, 3)), cell, np.zeros((2, 3)), maps[:0], np.zeros(4, bool))
    return maps, ways


@pytest.mark.parametrize("pixel", [(0, 0), (13, 13), (26, 23), (2, 23), (26, 0)])
def test_a_pixels_ways_lead_by_the_nodes_up_to_two_from_its_own_and_no_others(pixel):
    """Of 9 x 8 nodes of 3 px."""
    assert NEIGHBOUR_NODES == 2
    maps, ways = one_node(9, 8)
    row, column = (np.array([part]) for part in pixel)
    found = _ways_to(np.zeros((1, 3)), row, column, maps, ways).reshape(9, 8) < NOWHERE
    near = np.abs(np.arange(9)[:, None] - pixel[0] // 3) <= 2
    assert found.tolist() == (near & (np.abs(np.arange(8) - pixel[1] // 3) <= 2)).tolist()


def test_without_visible_cloth_corners_are_nowhere():
    ways = SeenWays(np.zeros((0, 4, 3)), 5, np.zeros((2, 3)), np.zeros((4, 0, 4), np.float32), np.zeros(4, bool))
    seen = beyond_the_seen(NEAR, ways, np.ones((2, 4)), np.ones((4, 4)), SQUARE)
    assert seen.by_ends.tolist() == seen.by_all.tolist() == [NOWHERE] * 4
    assert seen.places.dtype == seen.pixels.dtype == float
    assert np.isnan([*seen.places.ravel(), *seen.pixels.ravel()]).all()


def panel(from_ends=None, found=(False,) * 4, moved=0.0):
    """What is seen of a panel of 160 x 120 px, whose third corner is taken to lie `moved` [m] from where it is."""
    cell, corners = 5, np.stack([metres(*at) for at in RECTANGLE])
    surface = np.full((28, 36, 3), np.nan)
    for r in range(4, 28):
        for c in range(4, 36):
            surface[r, c] = metres(cell * c + 2, cell * r + 2)
    distances = np.linalg.norm(corners[:, None] - corners, axis=-1)
    taken = corners.copy()
    taken[2, 0] -= moved
    maps = geodesic_distances(surface, taken)[0]
    ways = SeenWays(surface, cell, corners[:2], maps, np.array(found))
    given = distances[:2] if from_ends is None else from_ends
    return beyond_the_seen(silhouette(WHOLE), ways, given, distances, SQUARE)


def test_a_corner_to_which_no_way_leads_on_the_flat_garment_is_nowhere():
    assert panel(np.full((2, 4), np.inf)).by_ends.tolist() == [NOWHERE] * 4


def test_a_detected_corner_is_no_anchor_of_its_own_however_many_there_are():
    """The third corner is taken to lie 0.2 m aside. The others say where it is; only for them it is an anchor."""
    seen = panel(found=(True, True, True, True), moved=0.2)
    assert seen.by_all[2] < 0.012
    assert seen.places[2] == pytest.approx(metres(179, 139), abs=5 * PIXEL)
    assert seen.by_all[3] > 0.03


def test_a_pixel_outside_of_the_window_and_cloth_too_small_for_a_plane_have_no_place():
    few = np.zeros(WHOLE.shape, np.uint8)
    few[80:83, 100:103] = 1
    for cloth, pixel in ((NEAR, (-500.0, -500.0)), (NEAR, (5000.0, 5000.0)), (silhouette(few), (LEFT + 101, TOP + 81))):
        for part in Placer(cloth, SQUARE, CorrelationMeter()).place(np.array(pixel, float), np.ones(2)):
            assert part.shape == (3,)
            assert np.isnan(part).all()


def test_the_first_rows_and_columns_of_a_window_have_their_own_depth():
    depth = np.full((6, 7), 2.0, np.float32)
    depth[0], depth[:, 0], depth[-1], depth[:, -1] = 1.0, 1.1, 1.2, 1.3
    found = _in_metres(np.array([[3.0, 0.0], [0.0, 3.0], [3.0, 5.0], [6.0, 3.0]]), depth, np.zeros(2), SQUARE)
    assert found[:, 2] == pytest.approx([1.0, 1.1, 1.2, 1.3])


def test_a_place_far_outside_of_a_window_has_no_depth():
    assert np.isnan(
        _in_metres(np.array([[-900.0, -900.0], [900.0, 900.0]]), np.ones((6, 7)), np.zeros(2), SQUARE)
    ).all()


def bulging(side):
    """An outline of 100 x 80 px, clockwise, of which one side bulges outwards, most at a quarter of its way."""
    s = np.linspace(0, 1, 101)[:-1]
    corners = np.array([[0, 0], [100, 0], [100, 80], [0, 80]], float)
    sides = [(1 - s[:, None]) * corners[n] + s[:, None] * corners[(n + 1) % 4] for n in range(4)]
    outwards = np.array([[0, -1], [1, 0], [0, 1], [-1, 0]])[side]
    sides[side] = sides[side] + 10 * (np.sin(np.pi * s) + 0.5 * np.sin(2 * np.pi * s))[:, None] * outwards
    return np.concatenate(sides), corners, outwards


@pytest.mark.parametrize(("side", "along"), [
    (0, np.s_[0, :]), (1, np.s_[:, 4]), (2, np.s_[4, ::-1]), (3, np.s_[::-1, 0]),
])  # fmt: skip
def test_a_bulge_of_any_side_is_one_of_the_grids_in_the_order_of_that_side(side, along):
    """Of 10 (sin + sin 2 / 2): 12.1, 10 and 2.1 px at its quarters; the opposite side is straight."""
    outline, corners, outwards = bulging(side)
    patch = _patch(outline, corners, 5)
    s, t = np.meshgrid(np.linspace(0, 100, 5), np.linspace(0, 80, 5))
    off = (patch - np.stack([s, t], axis=-1)) @ outwards
    assert off[along][1:4] == pytest.approx([12.1, 10.0, 2.1], abs=1.5)
    assert np.abs(off[::4, ::4]).max() < 1e-6


@pytest.mark.parametrize("same", [(0, 1), (1, 2), (2, 3)])
def test_two_corners_at_one_pixel_have_no_grid(same):
    corners = RECTANGLE + LEFT_TOP
    corners[same[1]] = corners[same[0]]
    scan = scan_surface(silhouette(WHOLE), corners, SQUARE, 0.0, grid=5, contour=40)
    assert scan.grid.shape == (5, 5, 3)
    assert np.isnan(scan.grid).all()


def test_an_outline_of_three_pixels_goes_clockwise_as_seen():
    """Of half a square pixel: right, down and back, to which the mean of seven is the same in either order."""
    for outline in ([[0, 0], [1, 0], [0, 1]], [[0, 0], [4, 0], [0, 4]], [[0, 0], [6, 0], [6, 6], [0, 6]]):
        clockwise = np.array(outline, float)
        assert _smoothed(clockwise) == pytest.approx(_mean_of_seven(clockwise))
        assert _smoothed(clockwise[::-1]) == pytest.approx(_mean_of_seven(clockwise))


def _mean_of_seven(outline):
    return np.mean([np.roll(outline, k, axis=0) for k in range(-3, 4)], axis=0)


def diamond():
    """A square that stands on its corner: its first pixel is the uppermost one."""
    rows, columns = np.indices(WHOLE.shape)
    return silhouette(np.abs(rows - 80) + np.abs(columns - 100) <= 60)


def begin_of(corners):
    scan = scan_surface(diamond(), corners, SQUARE, 0.0, grid=3, contour=200)
    return scan.contour[0, :2] * 500 / 1.6 + [319.5, 239.5] - LEFT_TOP


def test_a_contour_begins_at_its_first_corner_or_where_it_is_nearest_to_the_windows():
    """The side from (40, 80) to (100, 20) is nearest to (0, 0) at (60, 60)."""
    corners = np.array([[100.0, 20.0], [160.0, 80.0], [100.0, 140.0], [40.0, 80.0]]) + LEFT_TOP
    assert begin_of(corners) == pytest.approx([100, 20], abs=3)
    for missing, begin in ((0, [60, 60]), (1, [100, 20])):
        some = corners.copy()
        some[missing] = np.nan
        assert begin_of(some) == pytest.approx(begin, abs=3)


def test_a_contour_has_equal_steps_from_its_last_place_to_its_first_too():
    rows, columns = np.indices(WHOLE.shape)
    cloth = silhouette(np.hypot(rows - 80, columns - 100) <= 60)
    scan = scan_surface(cloth, RECTANGLE + LEFT_TOP, SQUARE, 0.0, grid=3, contour=12)
    pixel = scan.contour[:, :2] * 500 / 1.6
    steps = np.linalg.norm(pixel - np.roll(pixel, 1, axis=0), axis=1)
    assert steps[0] == pytest.approx(steps[1:].mean(), abs=0.35)


def test_a_held_edge_seen_end_on_is_level():
    """Both ends in one column: what is below the upper one by 40 mm, 20 px, is below; the row itself is not."""
    held = np.array([[0.0, -0.2, 1.0], [0.0, -0.1, 1.0]])
    rows, columns = np.arange(200)[:, None], np.arange(640)
    assert BELOW * CAMERA.fx / 1.0 == 20.0
    below = _below(np.zeros(2), rows, columns, held, CAMERA, 1.0)
    assert below.all(1).tolist() == below.any(1).tolist() == (np.arange(200) > 140 + 20).tolist()


def test_things_are_sought_within_six_pixels_of_a_corner_far_away():
    """At 3 m, with no cloth missing, 30 mm are 5 px."""
    far = scene()
    far.raw[96:105, 116:125], far.depth[96:105, 116:125] = 3000, 3.0
    far.raw[80:96] = 3000
    held = HELD * [2.0, 2.0, 2.0]
    area = peeking_area(far, CORNER, 0.0, held, np.array([2.0, 2.0]), CAMERA) / (3.0 / 500.0) ** 2
    # Straight above the cloth one pixel of row 94, and of seven of row 95 three, have four of nine beside them.
    assert area == pytest.approx(4.0)


def test_a_pixel_exactly_as_far_as_the_missing_cloth_counts():
    """0.13 m are 43 px; of a wide patch that begins above, the pixel straight above the corner is the first."""
    whole = peeking(scene(rows=slice(50, 70), columns=slice(60, 180)))
    inner = peeking(scene(rows=slice(58, 70), columns=slice(60, 180)))
    assert whole - inner == pytest.approx(1.0)


def test_a_patch_at_the_windows_first_row_is_not_doubled_there():
    """Its first row has one pixel, beside which only two of the row below are: three of nine."""
    made = scene(rows=slice(0, 0))
    pixel = np.array([320.0, 210.0])  # row 10 of the window
    made.raw[:20], made.depth[:20] = 0, 0.0
    made.raw[0, 120], made.raw[1, 119:121] = 1550, 1550
    made.raw[2, 118:123] = made.raw[3, 118:123] = 1550
    area = peeking_area(made, pixel, 0.1, HELD, np.array([1.0, 1.0]), CAMERA) / (1.5 / 500.0) ** 2
    made.raw[0, 120] = 0
    less = peeking_area(made, pixel, 0.1, HELD, np.array([1.0, 1.0]), CAMERA) / (1.5 / 500.0) ** 2
    assert area == pytest.approx(less)


def test_the_direction_outwards_has_no_length():
    """A point 0.3 px beside the middle of a square of cloth, which slopes by a half along x."""
    _, columns = np.indices(WHOLE.shape)
    slope = 0.5 * 1.6 / SQUARE.fx
    inverse = (1 - slope * (columns - 100) / 1.6) / 1.6
    slant = rim_slant(silhouette(WHOLE, 1 / inverse), np.array([LEFT + 100.3, TOP + 80.0]), 1.6, SQUARE)
    assert slant.outwards == pytest.approx(math.atan(0.5), abs=0.01)


def test_cloth_in_the_windows_first_row_determines_the_slant_too():
    """Cloth below the first row recedes by a tenth; that row is 15 mm nearer."""
    rows, _ = np.indices(WHOLE.shape)
    depth = 1.6 + np.where(rows == 0, -0.015, 0.1 * PIXEL * rows)
    pixel = np.array([LEFT + 100.0, float(TOP)])
    mask = np.ones(WHOLE.shape)
    with_it = rim_slant(silhouette(mask, depth), pixel, 1.6, SQUARE)
    mask[0] = 0
    assert with_it.outwards != pytest.approx(rim_slant(silhouette(mask, depth), pixel, 1.6, SQUARE).outwards, abs=1e-3)


def test_a_surface_two_pixels_behind_a_nearer_one_is_set_apart():
    patch = np.full((20, 20), 1600, np.uint16)
    patch[:, :10] = 1500
    assert (_before_jumps(patch, 50)[10] == 0).tolist() == [n in (10, 11) for n in range(20)]


def test_a_held_edge_of_half_a_pixel_slopes_as_it_does():
    """From (10, 10) to (10.5, 20): twenty down for one to the right."""
    mask = np.ones((60, 30), np.uint8)
    _cut_above(mask, np.array([[10.0, 10.0], [10.5, 20.0]]))
    assert [int(np.count_nonzero(mask[:, x] == 0)) for x in (9, 10, 11, 12)] == [0, 10, 30, 50]


def test_a_piece_of_a_single_pixel_below_the_edge_is_a_piece():
    labels = np.zeros((30, 30), np.uint16)
    labels[12, 15] = 1
    stats = np.array([[0, 0, 30, 30, 899], [15, 12, 1, 1, 1]], np.int32)
    assert _hanging_piece(labels, stats, 2, np.array([[10.0, 10.0], [20.0, 10.0]])) == 1


STILL = np.zeros((1, 3))


def gate(*times, points=1):
    """A gate that has seen its points at rest at these times."""
    made = MotionGate(points)
    for time in times:
        made.admit(np.zeros((points, 3)), np.zeros((points, 3)), time)
    return made


def at(x):
    return np.array([[x, 0.0, 0.0]])


def test_a_point_lost_for_exactly_its_memory_is_still_predicted():
    assert POINT_MEMORY == 0.2
    for time, is_valid in ((0.2, True), (np.nextafter(0.2, 1.0), False)):
        made = gate(-0.1, 0.0)
        made.admit(np.full((1, 3), np.nan), STILL, 0.1)
        valid, _ = made.admit(at(0.0), STILL, float(time))
        assert valid.tolist() == [is_valid]


def test_a_point_exactly_as_far_as_the_hardest_whip_leads_follows():
    """60 m/s^2 in two steps of an eighth of a second: 0.9375 m."""
    most = 0.5 * HARDEST_WHIP * 0.125 * 0.25
    for x, is_valid in ((most, True), (np.nextafter(most, 1.0), False)):
        valid, _ = gate(0.0, 0.125).admit(at(float(x)), STILL, 0.25)
        assert valid.tolist() == [is_valid]


def test_a_second_detection_has_no_interval_before_it():
    """In an eighth of a second 60 m/s^2 and 6 m/s lead 0.47 and 0.75 m."""
    most = 0.5 * HARDEST_WHIP * 0.125**2 + FASTEST_POINT * 0.125
    for x, is_valid in ((0.99 * most, True), (1.01 * most, False)):
        valid, _ = gate(0.0).admit(at(x), STILL, 0.125)
        assert valid.tolist() == [is_valid]


def test_a_weak_first_detection_counts_in_the_first_frame_alone():
    weak = np.ones(1, bool)
    assert MotionGate(1).admit(STILL, STILL, 0.0, weak)[0].tolist() == [True]
    late = MotionGate(1)
    late.admit(np.full((1, 3), np.nan), STILL, 0.0)
    assert late.admit(STILL, STILL, 0.1, weak)[0].tolist() == [False]


def test_a_pixel_exactly_twelve_from_a_corner_is_left_out_of_its_side():
    assert CORNER_REACH_PIXELS == 12.0
    way = np.stack([np.arange(41.0), np.zeros(41)], axis=1)
    assert _side(way, way[0], way[-1])[1:-1, 0].tolist() == list(range(13, 28))
