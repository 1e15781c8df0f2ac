"""Plates, pitch and tracks of the hanger's markers in closed form."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from capture.depth.surface import SurfaceDepth, fit_surface, pixel_sd
from capture.errors import UntrackableError
from capture.hanger.fiducial_tracker import ImageTrack, check_distance, hanger_and_sensor, nothing_seen
from capture.hanger.marker_plates import Plate, PlatePlacer
from capture.hanger.pose import PlateSlope, hanger_pitch, plate_slope
from tests.capture.recording.test_conditions import RIG
from tests.capture.stage import CAMERA

SIZE = 0.06  # m
LEVEL_HANGER = np.array([[-0.15, -0.2, 1.6], [0.15, -0.2, 1.6]])


def quad_at(place, size=SIZE):
    """Corners [px] of a marker that faces the sensor, clockwise from its top left."""
    corners = np.array(place) + 0.5 * size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return corners[:, :2] / corners[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]


def depth_of(metres):
    """Depth image [mm] of the same depth [m] everywhere."""
    return np.full((CAMERA.height, CAMERA.width), round(1e3 * metres), np.uint16)


def test_the_normal_over_the_distance_of_an_exact_plane():
    """(0.2, -0.3, 0.9) . X = 1.5: a plane that leans both ways, seen off the middle of the picture."""
    normal, distance, at = np.array([0.2, -0.3, 0.9]), 1.5, np.array([250.0, 150.0])
    v, u = (part.ravel().astype(float) for part in np.mgrid[140:160, 245:270])
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)])
    z = distance / (normal @ rays)
    plate = fit_surface(u - at[0], v - at[1], z, focal_length=CAMERA.fx, spread=0.1, correlated_pixels=1.0)
    assert plate_slope(plate, at, CAMERA, 1.0).normal == pytest.approx(normal / distance, rel=1e-6)


def test_the_deviation_of_a_plates_pitch_by_hand():
    """(s / z) fy sqrt(pixels) / height with 4 pixels and a height of 20 px."""
    plate = SurfaceDepth(2.0, 0.001, np.zeros(2), 20.0, np.zeros(1), np.ones(1, bool))
    camera = msgspec.structs.replace(CAMERA, fy=1.1 * CAMERA.fx)
    slope = plate_slope(plate, np.array([CAMERA.cx, CAMERA.cy]), camera, 4.0)
    assert slope.sd == pytest.approx(pixel_sd(2.0, CAMERA.fx) / 2.0 * 1.1 * CAMERA.fx * 2.0 / 20.0)
    assert slope.normal == pytest.approx([0.0, 0.0, 0.5])


def leaning(pitch, sd):
    return PlateSlope(np.array([0.0, math.sin(pitch), math.cos(pitch)]), sd)


def test_two_plates_are_averaged_by_their_variances():
    """0.1 rad within 1 and 0.3 within 2: weights 1 and 1/4, (0.1 + 0.075) / 1.25 = 0.14 within 1 / sqrt 1.25."""
    pitch, sd = hanger_pitch(LEVEL_HANGER, [leaning(0.1, 1.0), leaning(0.3, 2.0)], RIG)
    assert (pitch, sd) == pytest.approx((0.14, 1.25**-0.5))
    assert hanger_pitch(LEVEL_HANGER, [None, leaning(0.3, 2.0)], RIG) == pytest.approx((0.3, 2.0))


def test_pitch_needs_both_positions_and_a_plate():
    lost = LEVEL_HANGER.copy()
    lost[1] = np.nan
    assert np.isnan(hanger_pitch(lost, [leaning(0.1, 1.0), None], RIG)).all()
    assert np.isnan(hanger_pitch(LEVEL_HANGER, [None, None], RIG)).all()


def test_the_range_of_a_marker_by_its_size():
    """575.8 px x 0.06 m / 1.6 m = 21.5925 px."""
    placer = PlatePlacer(CAMERA, SIZE)
    assert placer.range_by_size(21.5925) == pytest.approx(1.6)
    assert placer.pose_depth(quad_at([0.1, -0.2, 1.6])) == pytest.approx(1.6, rel=1e-4)
    assert math.isnan(placer.pose_depth(np.full((4, 2), np.nan)))


def test_a_position_on_a_ray_and_its_deviation_by_hand():
    """Half a focal length right, a quarter up at 2 m: x = 1, y = -0.5; a pixel is 2 / 575.8 m, depth is within 8 mm."""
    at = np.array([CAMERA.cx + 0.5 * CAMERA.fx, CAMERA.cy - 0.25 * CAMERA.fy])
    position, sd = PlatePlacer(CAMERA, SIZE).on_ray(at, Plate(2.0, 0.008, leaning(0.0, 1.0)), 1.5)
    assert position == pytest.approx([1.0, -0.5, 2.0])
    across = 2.0 * 1.5 / CAMERA.fx
    assert sd == pytest.approx([math.hypot(across, 0.004), math.hypot(across, 0.002), 0.008])


def test_only_what_lies_within_the_outline_determines_a_plates_depth():
    """Around the marker everything is 50 mm farther, within the spread of one marker size."""
    place = np.array([0.1, -0.2, 1.6])
    quad = quad_at(place)
    depth = depth_of(1.65)
    (left, top), (right, bottom) = np.floor(quad[0]).astype(int), np.ceil(quad[2]).astype(int) + 1
    depth[top:bottom, left:right] = 1600
    position, sd, slope = PlatePlacer(CAMERA, SIZE).place(quad, quad.mean(0), depth)
    assert position == pytest.approx(place, abs=1e-6)
    assert 5e-4 < sd[2] < 3e-3
    assert slope.normal == pytest.approx([0, 0, 1 / 1.6], abs=1e-6)


def test_a_part_in_view_gives_the_depth_where_the_rest_is_covered():
    place = np.array([0.1, -0.2, 1.6])
    quad = quad_at(place, 0.12)
    middle = quad.mean(0)
    depth = depth_of(1.6)
    depth[:, round(middle[0]) :] = 1540
    placer = PlatePlacer(CAMERA, 0.12)
    left = np.array([quad[0], [middle[0] - 2, quad[0, 1]], [middle[0] - 2, quad[3, 1]], quad[3]])
    seen = placer.place(quad, middle, depth, in_view=left, centre_sd=2.0)
    assert seen.position == pytest.approx(place, abs=1e-6)
    assert seen.sd[0] > 2.0 * 1.6 / CAMERA.fx
    assert placer.place(quad, middle, depth).position[2] != pytest.approx(1.6, abs=5e-3)


@pytest.mark.parametrize(("off", "is_placed"), [(0.1, True), (-0.1, True), (0.2, False), (-0.2, False)])
def test_a_depth_that_contradicts_the_markers_size_gives_no_position(off, is_placed):
    """Half a pixel of 21.6 at 1.6 m is 37 mm, four of them are 148 mm."""
    quad = quad_at([0.1, -0.2, 1.6])
    position, sd, slope = PlatePlacer(CAMERA, SIZE).place(quad, quad.mean(0), depth_of(1.6 + off))
    assert np.isfinite([*position, *sd]).all() == is_placed
    assert (slope is not None) == is_placed


def test_depth_is_looked_up_aside_by_the_offset():
    """A wedge falls by 2 mm a pixel to the right; 5 px aside it is 10 mm nearer."""
    depth = (1600 - 2 * (np.arange(CAMERA.width) - 320))[None].repeat(CAMERA.height, 0).astype(np.uint16)
    quad = quad_at([0.0, 0.0, 1.6]) + 0.5
    at = np.array([320.0, 240.0])
    assert PlatePlacer(CAMERA, SIZE).plate_depth(quad, at, depth).depth == pytest.approx(1.6, abs=3e-4)
    moved = PlatePlacer(CAMERA, SIZE, (5.0, 0.0)).plate_depth(quad, at, depth)
    assert moved.depth == pytest.approx(1.59, abs=3e-4)
    upright = PlatePlacer(CAMERA, SIZE, (0.0, 5.0)).plate_depth(quad[:, ::-1] + [80, -80], at, depth.T[:480, :480])
    assert upright is None or upright.depth != pytest.approx(1.59, abs=3e-4)


def test_a_plates_normal_is_that_of_its_place_in_colour():
    """(0.2, -0.3, 0.9) . X = 1.44; depth is shifted by 30 and -20 px, and rounded to a millimetre."""
    normal, distance, shift = np.array([0.2, -0.3, 0.9]), 1.44, np.array([30.0, -20.0])
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    u, v = columns - shift[0] - CAMERA.cx, rows - shift[1] - CAMERA.cy
    z = distance / (normal[0] * u / CAMERA.fx + normal[1] * v / CAMERA.fy + normal[2])
    outline = np.array([[200.0, 120], [300, 120], [300, 220], [200, 220]])
    placer = PlatePlacer(CAMERA, 0.3, tuple(shift))
    plate = placer.plate_depth(outline, outline.mean(0), np.rint(1e3 * z).astype(np.uint16))
    assert plate.slope.normal == pytest.approx(normal / distance, abs=1e-3)


def test_a_steep_plate_is_placed_where_it_reaches_its_own_size_in_depth():
    """Three columns 0.2 m apart, of a marker of 0.3 m; within a tenth of that there is only the middle one."""
    depth = depth_of(3.0)
    depth[100:120, 300:303] = [1400, 1600, 1867]  # as far apart in inverse depth
    outline = np.array([[300.0, 100], [302, 100], [302, 119], [300, 119]])
    plate = PlatePlacer(CAMERA, 0.3).plate_depth(outline, np.array([301.0, 110.0]), depth)
    assert plate.depth == pytest.approx(1.6, abs=1e-3)


def test_a_plate_at_the_pictures_border_is_fitted_to_the_part_inside():
    depth = depth_of(1.6)
    outline = np.array([[-10.0, -10], [9, -10], [9, 9], [-10, 9]])
    assert PlatePlacer(CAMERA, SIZE).plate_depth(outline, np.zeros(2), depth).depth == pytest.approx(1.6)
    end = outline + np.array([CAMERA.width, CAMERA.height])
    assert PlatePlacer(CAMERA, SIZE).plate_depth(end, end.mean(0), depth).depth == pytest.approx(1.6)
    assert PlatePlacer(CAMERA, SIZE).plate_depth(outline - 20.0, np.zeros(2), depth) is None
    thin = np.array([[100.2, 100], [100.8, 100], [100.8, 130], [100.2, 130]])
    assert PlatePlacer(CAMERA, SIZE).plate_depth(thin, thin.mean(0), depth) is None
    assert PlatePlacer(CAMERA, SIZE).plate_depth(thin[:, ::-1], thin.mean(0), depth) is None


@pytest.mark.parametrize(("count", "is_plate"), [(3, True), (2, False)])
def test_a_plate_has_three_rows_and_three_columns(count, is_plate):
    """Of twenty pixels along the other axis."""
    wide = np.array([[100.0, 100], [119, 100], [119, 99 + count], [100, 99 + count]])
    for outline in (wide, wide[:, ::-1]):
        plate = PlatePlacer(CAMERA, SIZE).plate_depth(outline, outline.mean(0), depth_of(1.6))
        assert (plate is not None) == is_plate


def test_a_missing_plate_gives_no_position():
    quad = quad_at([0.1, -0.2, 1.6])
    unknown = PlatePlacer(CAMERA, SIZE).place(quad, quad.mean(0), depth_of(0.0))
    assert np.isnan([*unknown.position, *unknown.sd]).all()
    assert unknown.slope is None


def test_plates_teach_how_the_noise_is_correlated():
    """A chess board of 2 mm has none: 18 pixels become fewer with every plate."""
    placer, quad, depth = PlatePlacer(CAMERA, SIZE), quad_at([0.1, -0.2, 1.6]), depth_of(1.6)
    rows, columns = np.indices(depth.shape)
    depth[(rows + columns) % 2 == 0] += 2
    before = placer.correlation.pixels
    placer.place(quad, quad.mean(0), depth)
    assert placer.correlation.pixels < before


HANGER = RIG.hanger


def distances(apart, sd=0.0, doubtful=None):
    positions = np.array([[0.0, 0, 1.6], [apart, 0, 1.6]])
    deviations = np.full((2, 3), sd)
    found = check_distance(positions, deviations, HANGER, doubtful)
    assert np.array_equal(np.isnan(positions), np.isnan(deviations))
    return found, np.isfinite(positions).all(1).tolist()


def test_markers_as_far_apart_as_the_rig_says_within_five_per_cent_are_kept():
    apart = HANGER.marker_distance_m
    for share, is_kept in ((1.049, True), (0.951, True), (1.051, False), (0.949, False)):
        assert distances(share * apart) == (pytest.approx(share * apart), [is_kept, is_kept])


def test_deviations_of_both_positions_allow_for_four_of_their_root_sum_of_squares():
    """5 mm along each of six axes: 4 x 12.25 = 49 mm more."""
    apart, more = HANGER.marker_distance_m, 4 * math.sqrt(6) * 5e-3
    assert distances(1.05 * apart + more - 1e-4, 5e-3)[1] == [True, True]
    assert distances(1.05 * apart + more + 1e-4, 5e-3)[1] == [False, False]


def test_of_a_doubtful_and_a_certain_marker_only_the_doubtful_one_goes():
    wrong = 1.2 * HANGER.marker_distance_m
    assert distances(wrong, doubtful=np.array([True, False]))[1] == [False, True]
    assert distances(wrong, doubtful=np.array([False, True]))[1] == [True, False]
    assert distances(wrong, doubtful=np.array([True, True]))[1] == [False, False]
    assert distances(wrong, doubtful=np.array([False, False]))[1] == [False, False]


def test_a_track_goes_on_with_its_velocity_and_its_window_grows_with_the_square_of_time():
    """10 px in 0.1 s are 100 px/s; after 0.1 s more: 1.2 x 20 px + 0.5 x 40 m/s^2 x 0.01 s^2 x 300 px/m = 84 px."""
    first = ImageTrack.after(None, 1.0, np.array([100.0, 50.0]), 20.0)
    assert first.velocity.tolist() == [0.0, 0.0]
    second = ImageTrack.after(first, 1.1, np.array([110.0, 45.0]), 20.0)
    assert second.velocity == pytest.approx([100.0, -50.0])
    centre, reach, side = second.window(1.2, 300.0)
    assert centre == pytest.approx([120.0, 40.0])
    assert (reach, side) == pytest.approx((84.0, 20.0))


@pytest.mark.parametrize("time", [1.0, 0.9, 1.31])
def test_a_track_that_is_older_than_0_3_s_or_not_older_has_no_velocity(time):
    first = ImageTrack.after(None, 1.0, np.array([100.0, 50.0]), 20.0)
    assert ImageTrack.after(first, time, np.array([110.0, 45.0]), 20.0).velocity.tolist() == [0.0, 0.0]


def test_a_frame_without_markers_has_no_number_in_it():
    sight = nothing_seen()
    assert not sight.is_found
    arrays = (sight.corners, sight.centres, sight.sides, sight.ranges, sight.positions, sight.sd)
    assert [array.shape for array in arrays] == [(2, 4, 2), (2, 2), (2,), (2,), (2, 3), (2, 3)]
    assert all(np.isnan(array).all() for array in arrays)
    assert np.isnan([sight.distance_m, sight.pitch, sight.pitch_sd]).all()


@pytest.mark.parametrize("lacks", ["hanger", "sensor"])
def test_a_rig_without_hanger_or_sensor_is_refused(lacks):
    with pytest.raises(UntrackableError, match="no hanger or no sensor section"):
        hanger_and_sensor(msgspec.structs.replace(RIG, **{lacks: None}))
