"""The two markers of flat pictures: their corners, tracks and templates are known to the pixel."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from capture.hanger import fiducial_tracker as module
from capture.hanger.choice import hanger_tracker
from capture.hanger.fiducial_tracker import ImageTrack, MarkerTracker
from capture.hanger.marker_detection import MarkerDetector, _pair, diagonal_crossing, quad_side, times_seen
from capture.hanger.marker_following import Followed, Keepsake, keep
from formats.rig import Calibration, Hanger, Rig, Sensor

SENSOR = Sensor(width=640, height=480, fx=400.0, fy=400.0, cx=319.5, cy=239.5)
HANGER = Hanger(marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)), ids=(0, 1))
RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=SENSOR)
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
LEFT, RIGHT = (200, 150), (320, 150)  # px, upper left pixels, 120 px apart: 0.3 m at 1 m, where a marker has 24 px


def square(left, top, side=24):
    """The corners of a marker in the pixels from left, top on."""
    low, high = np.array([left, top]) - 0.5, np.array([left, top]) + side - 0.5
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def scene(*placed, side=24, depth=1000):
    """A grey picture with markers, each (id, left, top), and a depth everywhere."""
    picture = np.full((480, 640, 3), 200, np.uint8)
    for number, x, y in placed:
        marker = cv2.aruco.generateImageMarker(DICTIONARY, number, 120)
        small = cv2.resize(marker, (side, side), interpolation=cv2.INTER_AREA)
        picture[y : y + side, x : x + side] = small[..., None]
    return picture, np.full((480, 640), depth, np.uint16)


BOTH = ((0, *LEFT), (1, *RIGHT))


def moved(by, placed=BOTH):
    return tuple((number, x + by, y) for number, x, y in placed)


def test_both_markers_of_a_flat_picture_have_all_that_is_known_of_them():
    sight = MarkerTracker(RIG).track(*scene(*BOTH), 0.0)
    assert sight.is_found
    assert sight.corners == pytest.approx(np.stack([square(*LEFT), square(*RIGHT)]), abs=0.5)
    centres = np.array([[211.5, 161.5], [331.5, 161.5]])
    assert sight.centres == pytest.approx(centres, abs=0.1)
    assert sight.sides == pytest.approx([24.0, 24.0], abs=0.5)
    assert sight.ranges == pytest.approx(400 * 0.06 / sight.sides)
    wanted = np.column_stack([(centres - [319.5, 239.5]) / 400, [1.0, 1.0]])
    assert sight.positions == pytest.approx(wanted, abs=3e-4)
    assert sight.distance_m == pytest.approx(0.3, abs=3e-4)
    assert ((sight.sd > 0) & (sight.sd < 5e-3)).all()
    assert sight.pitch == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < sight.pitch_sd < 0.2


def test_markers_that_are_read_but_have_no_depth_keep_their_corners():
    sight = MarkerTracker(RIG).track(*scene(*BOTH, depth=0), 0.0)
    assert np.isfinite(sight.corners).all()
    assert np.isfinite([*sight.centres.ravel(), *sight.sides, *sight.ranges]).all()
    assert np.isnan([*sight.positions.ravel(), *sight.sd.ravel(), sight.distance_m, sight.pitch]).all()
    assert sight.positions.shape == sight.sd.shape == (2, 3)
    assert not sight.valid.any()


def test_a_picture_without_markers_shows_nothing():
    sight = MarkerTracker(RIG).track(*scene(), 0.0)
    arrays = (sight.corners, sight.centres, sight.sides, sight.ranges, sight.positions, sight.sd)
    assert [array.shape for array in arrays] == [(2, 4, 2), (2, 2), (2,), (2,), (2, 3), (2, 3)]
    assert all(np.isnan(array).all() for array in arrays)


def test_a_marker_is_placed_where_it_was_at_the_instant_of_the_depth():
    """It moves by 200 px/s to the right; colour that is 20 ms late shows it 4 px ahead."""
    tracker = MarkerTracker(RIG)
    tracker.track(*scene(*BOTH), 1.0, 0.02)
    sight = tracker.track(*scene(*moved(20)), 1.1, 0.02)
    assert sight.centres[:, 0] == pytest.approx([231.5, 351.5], abs=0.1)
    assert 400 * sight.positions[:, 0] + 319.5 == pytest.approx([227.5, 347.5], abs=0.2)
    assert [track.time for track in tracker._tracks] == pytest.approx([1.12, 1.12])


def test_a_markers_depth_is_aside_by_the_calibrated_offset():
    """Only 12 px right of and 7 px above the markers is it 1 m; around that it is 1.03 m."""
    picture, depth = scene(*BOTH, depth=1030)
    for x, y in (LEFT, RIGHT):
        depth[y - 8 : y + 18, x + 11 : x + 37] = 1000
    rig = msgspec.structs.replace(RIG, calibration=Calibration(depth_offset_px=(12.0, -7.0)))
    assert MarkerTracker(rig).track(picture, depth, 0.0).positions[:, 2] == pytest.approx([1.0, 1.0], abs=1e-6)


def test_a_third_marker_of_an_id_that_is_elsewhere_is_none_of_the_hangers():
    """The rig's distance over its size tells which of two: five sides."""
    sight = MarkerTracker(RIG).track(*scene(*BOTH, (0, 560, 160)), 0.0)
    assert sight.centres[:, 0] == pytest.approx([211.5, 331.5], abs=0.2)


@pytest.mark.parametrize("is_sparing", [False, True])
def test_a_sparing_tracker_looks_for_small_markers_in_every_second_picture(is_sparing):
    """The first picture is empty; markers of 13 px follow."""
    tracker = hanger_tracker(RIG, is_sparing=is_sparing)
    small = scene((0, 200, 150), (1, 265, 150), side=13)
    tracker.track(*scene(), 0.0)
    seen = [np.isfinite(tracker.track(*small, k / 30).corners).all() for k in (1, 2)]
    assert seen == [not is_sparing, True]


def track_at(time, place=LEFT, velocity=(0.0, 0.0)):
    return ImageTrack(time, np.array(place) + 11.5, np.array(velocity), 24.0)


@pytest.mark.parametrize(("time", "is_window"), [(0.3, True), (0.31, False)])
def test_a_marker_is_sought_near_its_track_for_0_3_s_and_then_anywhere(time, is_window):
    """One track is where the marker is, and one has left the picture, beside which there is nothing."""
    tracker = MarkerTracker(RIG)
    tracker._tracks = [track_at(0.0), track_at(0.0, RIGHT, (90_000.0, 0.0))]
    corners = tracker._find_corners(scene(*BOTH)[0], time)
    assert np.isfinite(corners[0]).all()
    assert np.isnan(corners[1]).all() == is_window


def test_a_marker_that_is_lost_is_sought_anywhere_while_the_other_one_is_followed():
    tracker = MarkerTracker(RIG)
    tracker._tracks = [track_at(0.0), None]
    corners = tracker._find_corners(scene(*BOTH)[0], 0.1)
    assert corners == pytest.approx(np.stack([square(*LEFT), square(*RIGHT)]), abs=0.5)
    tracker._tracks = [track_at(0.0, velocity=(90_000.0, 0.0)), None]
    corners = tracker._find_corners(scene(*BOTH)[0], 0.1)
    assert np.isnan(corners[0]).all()  # its window is elsewhere
    assert np.isfinite(corners[1]).all()


def test_corners_found_anywhere_are_refined_in_a_window():
    """Those of the whole picture are whole pixels of a marker of 24 px that is 0.5 px wider than seen."""
    tracker = MarkerTracker(RIG)
    picture, _ = scene(*BOTH)
    coarse = MarkerDetector("DICT_4X4_50", (0, 1)).in_picture(picture)
    found = tracker._find_corners(picture, 0.0)
    assert found[0] == pytest.approx(tracker._detector.refined(picture, 0, coarse[0]))


@pytest.mark.parametrize(
    ("kept", "last", "time", "is_followed"),
    [(0.0, 0.3, 0.5, True), (0.0, 0.3, 0.51, False), (0.2, 0.0, 0.3, True), (0.2, 0.0, 0.31, False)],
)
def test_a_template_is_followed_for_half_a_second_and_0_3_s_after_the_last_detection(kept, last, time, is_followed):
    tracker, (picture, _) = MarkerTracker(RIG), scene(*BOTH)
    assert tracker._follow(picture, 0, time) is None
    tracker._kept[0] = keep(picture, square(*LEFT), kept)
    assert tracker._follow(picture, 0, time) is None
    tracker._tracks[0] = track_at(last)
    assert (tracker._follow(picture, 0, time) is not None) == is_followed


def test_a_template_is_sought_where_its_track_leads(monkeypatch):
    """100 px/s for 0.2 s; 1.2 x 24 + 0.5 x 40 x 0.04 x 400 px = 348.8 px, less 0.7 x 24 px: to where it still fits."""
    asked = []
    monkeypatch.setattr(module, "follow", lambda *given: asked.append(given))
    tracker, (picture, _) = MarkerTracker(RIG), scene(*BOTH)
    tracker._kept[0], tracker._tracks[0] = keep(picture, square(*LEFT), 0.9), track_at(0.9, velocity=(100.0, -50.0))
    tracker._follow(picture, 0, 1.1)
    ((_, kept, expected, reach, step),) = asked
    assert kept is tracker._kept[0]
    assert expected == pytest.approx([231.5, 151.5])
    assert reach == pytest.approx(332.0)
    assert step == pytest.approx([20.0, -10.0])


def covered(*placed):
    """The scene with a grey patch over the left marker's lower half, so that its id cannot be read."""
    picture, depth = scene(*placed)
    _, x, y = placed[0]
    picture[y + 13 : y + 28, x - 4 : x + 28] = 120
    return picture, depth


def test_a_followed_marker_is_placed_by_its_part_in_view_and_keeps_its_template():
    tracker = MarkerTracker(RIG)
    tracker.track(*scene(*BOTH), 0.0)
    kept = tracker._kept[0]
    picture, depth = covered(*moved(2))
    depth[LEFT[1] + 13 :, :300] = 950
    sight = tracker.track(picture, depth, 1 / 30)
    assert sight.is_found
    assert sight.centres[0] == pytest.approx([213.5, 161.5], abs=1.0)
    assert sight.positions[0, 2] == pytest.approx(1.0, abs=2e-3)
    assert sight.sd[0, 0] > 1.5 * sight.sd[1, 0]  # 0.45 px against 0.08 px
    assert tracker._kept[0] is kept
    assert tracker._tracks[0].time == tracker._tracks[1].time == 1 / 30


def test_a_followed_marker_without_depth_is_lost_and_its_track_ends():
    tracker = MarkerTracker(RIG)
    tracker.track(*scene(*BOTH), 0.0)
    picture, depth = covered(*BOTH)
    depth[:, :300] = 0
    sight = tracker.track(picture, depth, 1 / 30)
    assert sight.valid.tolist() == [False, True]
    assert np.isnan([*sight.corners[0].ravel(), *sight.centres[0], sight.sides[0], sight.ranges[0]]).all()
    assert [track.time for track in tracker._tracks] == [0.0, 1 / 30]
    assert not np.isfinite(sight.distance_m)


def test_of_two_markers_too_far_apart_only_the_followed_one_is_doubted(monkeypatch):
    """150 px are 0.375 m. Two markers that are both read are both wrong."""
    tracker = MarkerTracker(RIG)
    tracker.track(*scene(*BOTH), 0.0)
    away = square(LEFT[0] - 30, LEFT[1])
    monkeypatch.setattr(tracker, "_follow", lambda colour, row, time: Followed(away, away, 0.45) if row == 0 else None)
    sight = tracker.track(*scene(BOTH[1]), 1 / 30)
    assert sight.distance_m == pytest.approx(0.375, abs=1e-3)
    assert sight.valid.tolist() == [False, True]
    assert np.isfinite(sight.corners[0]).all()
    wide = MarkerTracker(RIG).track(*scene(BOTH[0], (1, RIGHT[0] + 5, RIGHT[1])), 0.0)
    assert wide.valid.tolist() == [True, True]  # 0.3125 m
    wide = MarkerTracker(RIG).track(*scene(BOTH[0], (1, RIGHT[0] + 30, RIGHT[1])), 0.0)
    assert wide.valid.tolist() == [False, False]


@pytest.mark.parametrize(("distance", "is_pair"), [(85.5, True), (84.5, False), (114.5, True), (115.5, False)])
def test_a_pair_is_as_many_sides_apart_as_the_rig_says_within_15_per_cent(distance, is_pair):
    """Sides of 16 and 24 px have the mean 20, so that five of them are 100 px."""
    one = square(100, 100, 16)
    other = square(0, 0, 24) + one.mean(0) - square(0, 0, 24).mean(0) + [0.6 * distance, -0.8 * distance]
    (first, second) = _pair([one], [other], 5.0)
    assert ([len(first), len(second)] == [1, 1]) == is_pair
    if is_pair:
        assert first[0] is one
        assert second[0] is other
    assert _pair([one, one], [other], 5.0) == [[], []]


def test_a_marker_within_another_outline_of_itself_counts_once():
    """Two markers of one id whose middles are 40 px apart are two; each has a side of 24 px."""
    assert times_seen(scene((0, 100, 100), (0, 140, 100), (1, 300, 100))[0], "DICT_4X4_50") == {0: 2, 1: 1}
    assert times_seen(scene()[0], "DICT_4X4_50") == {}


def test_the_crossing_of_diagonals_and_the_mean_side_of_a_quadrilateral():
    """Diagonals from (1, 2) to (7, 8) and from (7, 4) to (1, 6) cross at (4, 5). Sides of 3-4-5 triangles."""
    assert diagonal_crossing(np.array([[1.0, 2], [7, 4], [7, 8], [1, 6]])) == pytest.approx([4.0, 5.0])
    assert diagonal_crossing(np.array([[0.0, 0], [4, 0], [6, 6], [0, 4]])) == pytest.approx([2.0, 2.0])
    assert quad_side(np.array([[0.0, 0], [3, 4], [3, 10], [0, 6]])) == pytest.approx((5 + 6 + 5 + 6) / 4)
    flat = diagonal_crossing(np.array([[0.0, 0], [1, 1], [3, 3], [2, 2]]))
    assert flat.shape == (2,)
    assert np.isnan(flat).all()
    assert np.isnan(diagonal_crossing(np.full((4, 2), np.nan))).all()


def test_a_template_is_grey_and_computed_once():
    """Of (100, 150, 200) the grey is 0.299 x 100 + 0.587 x 150 + 0.114 x 200 = 140.75."""
    kept = Keepsake(0.0, square(0, 0), np.full((4, 5, 3), (100, 150, 200), np.uint8), np.zeros(2))
    assert kept.picture.tolist() == [[141.0] * 5] * 4
    assert kept.picture.dtype == np.float32
    assert kept.picture is kept.picture
