"""Parts of the search for markers, each alone: blur, template, diagonals, plates, and what refusals say."""

from __future__ import annotations

from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.hanger.choice import hanger_tracker
from capture.hanger.colour_dots import DotTracker
from capture.hanger.fiducial_tracker import MarkerTracker, hanger_and_sensor, nothing_seen
from capture.hanger.marker_detection import MarkerDetector, diagonal_crossing, marker_dictionary, quad_side
from capture.hanger.marker_following import _blurred, keep
from capture.hanger.marker_plates import CORNER_BIAS, PlatePlacer
from capture.hanger.marker_sheet import draw_sheet
from formats.rig import Calibration
from tests.capture.recording.test_conditions import RIG
from tests.capture.stage import CAMERA

SIZE = 0.06  # m


@pytest.mark.parametrize("way", [(6.0, 2.0), (-5.0, 4.0), (0.0, 7.0), (0.6, 0.0)])
def test_a_blurred_point_is_spread_evenly_along_its_motion_and_stays_where_it_is(way):
    """A line of length L has a variance of L^2 / 12 along; laid on pixels, up to a quarter more along each axis."""
    picture = np.zeros((41, 41), np.float32)
    picture[20, 20] = 100.0
    blurred = _blurred(picture, np.array(way))
    assert blurred.sum() == pytest.approx(100.0, rel=1e-5)
    assert blurred.min() >= 0.0
    rows, columns = np.indices(picture.shape) - 20.0
    share = blurred / blurred.sum()
    assert [(share * columns).sum(), (share * rows).sum()] == pytest.approx([0.0, 0.0], abs=1e-4)
    spread = [(share * columns**2).sum(), (share * rows**2).sum(), (share * columns * rows).sum()]
    expected = [way[0] ** 2 / 12, way[1] ** 2 / 12, way[0] * way[1] / 12]
    assert (np.abs(np.subtract(spread, expected)) <= [0.26, 0.26, 0.1]).all()
    assert blurred.dtype == np.float32


def test_a_picture_is_blurred_as_if_its_border_went_on_and_not_at_all_by_less_than_half_a_pixel():
    """Along 8 px over a ramp that begins with 0: of the first pixel, half of the blur lies before the ramp."""
    ramp = np.tile(np.arange(40, dtype=np.float32), (9, 1))
    blurred = _blurred(ramp, np.array([8.0, 0.0]))
    assert blurred[:, 20] == pytest.approx(20.0, abs=1e-4)
    assert blurred[4, 0] == pytest.approx(1.0, abs=0.05)  # the mean of 0 to 4 px, over half of it
    assert (_blurred(ramp, np.array([0.3, 0.3])) == ramp).all()


@pytest.mark.parametrize(
    ("shift", "is_kept"),
    [((0, 0), True), ((-1, 0), False), ((0, -1), False), ((26, 16), True), ((27, 16), False), ((26, 17), False)],
)
def test_a_template_is_kept_where_the_picture_holds_its_margin(shift, is_kept):
    """A side of 20 px has 3 px of margin: of 53 by 43 pixels, the square from 3 to 23 begins in the first of them."""
    square = np.array([[3.0, 3.0], [23.0, 3.0], [23.0, 23.0], [3.0, 23.0]]) + shift
    colour = np.random.default_rng(3).integers(0, 255, (43, 53, 3), dtype=np.uint8)
    kept = keep(colour, square, 0.5)
    assert (kept is not None) == is_kept
    if kept is not None:
        assert kept.origin.tolist() == list(shift)
        assert kept.origin.dtype == float
        assert (kept.colour == colour[shift[1] : shift[1] + 27, shift[0] : shift[0] + 27]).all()
        assert kept.time == 0.5


def test_the_diagonals_of_any_quadrilateral_cross_where_both_lines_meet():
    quad = np.array([[1.0, 2.0], [11.0, 3.0], [15.0, 12.0], [2.0, 9.0]])
    a, b, c, d = quad
    s, t = np.linalg.solve(np.array([c - a, b - d]).T, b - a)
    assert diagonal_crossing(quad) == pytest.approx(a + s * (c - a))
    assert diagonal_crossing(quad) == pytest.approx(b + t * (d - b))
    assert diagonal_crossing(0.05 * quad) == pytest.approx(0.05 * (a + s * (c - a)))
    assert np.isnan(diagonal_crossing(np.outer(np.arange(4.0), [1.0, 2.0]))).all()


def test_corners_that_are_not_found_more_exactly_stay_as_they_were():
    coarse = np.array([[30.0, 30.0], [50.0, 30.0], [50.0, 50.0], [30.0, 50.0]])
    blank = np.full((100, 100, 3), 180, np.uint8)
    assert (MarkerDetector("DICT_4X4_50", (0, 1)).refined(blank, 0, coarse) == coarse).all()


def diamond():
    """A marker turned by 45 degrees, half of its bounding box, 1.6 m away; its centre [px]."""
    half = CAMERA.fx * SIZE / 1.6 / np.sqrt(2)
    centre = np.array([CAMERA.cx, CAMERA.cy])
    return centre + half * np.array([[0, -1], [1, 0], [0, 1], [-1, 0]]), centre


def test_only_pixels_within_a_plates_outline_tell_its_depth():
    """Around the plate, 4 mm farther, is what is no outlier to a plane, yet does not belong to the plate."""
    outline, centre = diamond()
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    within = np.abs(columns - centre[0]) + np.abs(rows - centre[1]) <= outline[1, 0] - centre[0] + 2.0
    depth = np.where(within, 1600, 1604).astype(np.uint16)
    plate = PlatePlacer(CAMERA, SIZE).plate_depth(outline, centre, depth)
    assert plate.depth == pytest.approx(1.6, abs=1e-5)
    assert PlatePlacer(CAMERA, SIZE).plate_depth(outline, centre, np.zeros_like(depth)) is None


@pytest.mark.parametrize(("deviations", "is_placed"), [(3.7, True), (4.4, False), (-3.7, True), (-4.4, False)])
def test_a_plate_whose_size_contradicts_its_depth_by_four_deviations_is_not_placed(deviations, is_placed):
    corners = np.array([0.0, 0.0, 1.6]) + 0.5 * SIZE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    quad = corners[:, :2] / corners[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
    placer = PlatePlacer(CAMERA, SIZE)
    by_size = placer.pose_depth(quad)
    assert by_size == pytest.approx(1.6, abs=1e-3)
    sd = by_size * CORNER_BIAS / quad_side(quad)
    depth = np.full((CAMERA.height, CAMERA.width), round(1e3 * (by_size + deviations * sd)), np.uint16)
    exact = placer.plate_depth(quad, quad.mean(0), depth)
    off = abs(by_size - exact.depth) / np.hypot(sd, exact.sd)
    assert off < 4.0 if is_placed else 4.0 < off < 5.0
    assert np.isfinite(placer.place(quad, quad.mean(0), depth).position).all() == is_placed


def test_nothing_seen_has_two_markers_that_do_not_count():
    sight = nothing_seen()
    assert (sight.valid.dtype, sight.valid.tolist()) == (bool, [False, False])
    assert np.isnan(sight.distance_m)


@pytest.mark.parametrize(
    ("ask", "where", "said", "advice"),
    [
        (lambda: marker_dictionary("DICT_4X4_51"), "rig", "'DICT_4X4_51' is not known", "DICT_4X4_50"),
        (lambda: marker_dictionary("ARUCO_MIP_36h12"), "rig", "'ARUCO_MIP_36h12' is not known", "DICT_4X4_50"),
        (lambda: marker_dictionary("detectMarkers"), "rig", "'detectMarkers' is not known", "DICT_4X4_50"),
        (lambda: hanger_and_sensor(msgspec.structs.replace(RIG, hanger=None)), "rig", "no hanger", "file-formats.md"),
        (lambda: draw_sheet("DICT_4X4_50", [1, 1], 0.06), "--ids", "asked for twice", "two different ids"),
        (lambda: draw_sheet("DICT_4X4_50", [0, 1], 0.2), "--size", "do not fit", "smaller ones"),
        (lambda: hanger_tracker(RIG, picks=np.zeros((2, 2))), "--pick", "", ""),
    ],
)  # fmt: skip
def test_a_refusal_names_the_option_or_the_file_and_says_what_to_do(ask, where, said, advice):
    with pytest.raises(UntrackableError) as refused:
        ask()
    assert refused.value.where == where
    assert said in str(refused.value)
    assert advice in str(refused.value)


@pytest.mark.parametrize("kind", [MarkerTracker, DotTracker])
def test_a_tracker_places_with_the_rigs_calibration_and_tells_its_placers_correlation(kind):
    hanger = msgspec.structs.replace(RIG.hanger, marker="dot" if kind is DotTracker else RIG.hanger.marker)
    calibration = Calibration(depth_offset_px=(1.5, -0.5))
    tracker = kind(msgspec.structs.replace(RIG, hanger=hanger, calibration=calibration))
    assert tracker._placer.depth_offset.tolist() == [1.5, -0.5]
    assert tracker.correlation is tracker._placer.correlation


def test_a_page_of_markers_is_a_white_a4_sheet_measured_in_millimetres():
    page = ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.06))
    assert page.tag == "{http://www.w3.org/2000/svg}svg"
    assert page.attrib == {"width": "210mm", "height": "297mm", "viewBox": "0 0 210 297"}
    assert page[0].tag == "{http://www.w3.org/2000/svg}rect"
    assert page[0].attrib == {"width": "100%", "height": "100%", "fill": "#fff"}
