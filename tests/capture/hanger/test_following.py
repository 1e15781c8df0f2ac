"""Fiducial markers under blur and partial occlusion, on rendered scenes of known truth."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from capture.hanger.fiducial_tracker import MarkerTracker
from capture.hanger.marker_detection import MarkerDetector
from capture.hanger.marker_following import BLURRED_SD, Followed, _best_place, _blurred, _likeness, follow, keep
from tests.capture.recording.test_conditions import RIG
from tests.capture.stage import CAMERA, marker_plate, pictures, plain_plate

MIDDLE = np.array([0.0, -0.2, 1.6])
SIDES = np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]])
REACH = 0.12  # m, of the swing to and fro along x
FINGER = (205, 160, 140)
READ = 4  # frames in which the marker is not covered yet, so that its id is read


def plates(middle, cover):
    """Both markers, and a finger in front of the left one: offset from its centre and size [m]."""
    shown = [marker_plate(i, middle + SIDES[i]) for i in range(2)]
    if cover is not None:
        shown.append(plain_plate(middle + SIDES[0] + np.array(cover[0]), cover[1], FINGER))
    return shown


@cache
def swung(speed, exposure, cover, frames, rate, late):
    """Depth, colour and the true middle [m] of each frame; see `tracked`."""
    rng = np.random.default_rng(3)
    found = []
    for k in range(frames):

        def at(time):
            return MIDDLE + np.array([REACH * np.sin(speed / REACH * time), 0.0, 0.0])

        def shown(time, cover=cover if k >= READ else None):
            return plates(at(time), cover)

        instants = [k / rate + late + exposure * part for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
        depth, colour = pictures(shown(k / rate), rng, exposures=[shown(time) for time in instants])
        found.append((depth, colour, at(k / rate)))
    return found


def tracked(speed, exposure, cover=None, frames=12, rate=30, late=0.0, is_known=True):
    """Errors [m] and deviations [m], (frames, 2, 3), NaN where lost, and how many markers were read by their ids.

    speed [m/s]: maximum; exposure [s]; late [s]: delay of the colour, and whether the tracker knows it
    """
    tracker, reader = MarkerTracker(RIG), MarkerDetector("DICT_4X4_50", (0, 1))
    errors, deviations, read = [], [], 0
    for k, (depth, colour, middle) in enumerate(swung(speed, exposure, cover, frames, rate, late)):
        sight = tracker.track(colour, depth, k / rate, late if is_known else 0.0)
        if k >= READ:
            errors.append(sight.positions - middle - SIDES)
            deviations.append(sight.sd)
            read += int(np.isfinite(reader.in_picture(colour)[:, 0, 0]).sum())
    return np.array(errors), np.array(deviations), read


@pytest.mark.parametrize(("speed", "exposure"), [(2.0, 0.008), pytest.param(1.0, 0.016, marks=pytest.mark.slow)])
def test_markers_too_blurred_to_be_read_are_followed_to_two_millimetres(speed, exposure):
    """16 mm of way while the picture is taken: 6 px of a marker whose bits are 3.6 px."""
    errors, deviations, read = tracked(speed, exposure)
    assert read <= 10  # of 16
    assert np.isfinite(errors).all()
    assert np.sqrt((errors**2).mean()) < 2e-3
    assert np.sqrt(((errors / deviations) ** 2).mean()) < 2.0


@pytest.mark.parametrize("late", [pytest.param(-0.012, marks=pytest.mark.slow), 0.012])
def test_markers_are_placed_at_the_instant_of_the_depth_also_where_colour_is_not(late):
    """At 1 m/s colour 12 ms off shows markers 12 mm away; the last velocity leaves a a late T / 2 of it: 1.7 mm."""
    errors, _, _ = tracked(1.0, 0.004, late=late)
    uncorrected, _, _ = tracked(1.0, 0.004, late=late, is_known=False)
    assert np.sqrt((errors[..., 0] ** 2).mean()) < 2e-3
    assert np.sqrt((uncorrected[..., 0] ** 2).mean()) > 6e-3


@pytest.mark.parametrize(
    "cover",
    [((-0.02, 0.0, -0.03), (0.03, 0.09)), pytest.param(((0.0, 0.03, -0.03), (0.09, 0.03)), marks=pytest.mark.slow)],
    ids=["left third", "lower third"],
)
def test_a_marker_behind_a_finger_is_followed_to_six_millimetres(cover):
    errors, deviations, read = tracked(0.3, 0.008, cover)
    assert read <= 8  # only the right marker
    assert np.isfinite(errors).all()
    assert np.sqrt((errors**2).mean()) < 6e-3
    assert np.sqrt(((errors / deviations) ** 2).mean()) < 2.0


def test_a_marker_behind_a_hand_is_lost_and_not_guessed():
    errors, _, _ = tracked(0.0, 0.008, ((0.0, 0.0, -0.05), (0.12, 0.12)), frames=8)
    assert np.isnan(errors[:, 0]).all()
    assert np.isfinite(errors[:, 1]).all()


def test_half_a_second_after_its_id_was_read_a_covered_marker_is_lost():
    errors, _, _ = tracked(0.0, 0.008, ((-0.02, 0.0, -0.03), (0.03, 0.09)), frames=READ + 8, rate=10)
    seen = np.isfinite(errors[:, 0, 0])
    # The id was last read in frame 3, at 0.3 s; five frames follow until 0.8 s.
    assert seen[:4].all()
    assert not seen[5:].any()


def test_a_marker_moved_by_a_known_way_is_found_there():
    """Shifted by 5.5 and -3 px and blurred over 6 px along x: found to a quarter of a pixel."""
    rng = np.random.default_rng(4)
    z = MIDDLE[2]
    moved = np.array([5.5, -3.0, 0.0]) * z / CAMERA.fx
    blur = np.array([6.0, 0.0, 0.0]) * z / CAMERA.fx
    _, first = pictures(plates(MIDDLE, None), rng)
    instants = [plates(MIDDLE + moved + part * blur, None) for part in np.linspace(-0.5, 0.5, 7)]
    _, second = pictures(plates(MIDDLE + moved, None), rng, exposures=instants)
    quad = MarkerDetector("DICT_4X4_50", (0, 1)).in_picture(first)[0]
    kept = keep(first, quad, 0.0)
    found = follow(second, kept, quad.mean(0), 12.0, np.array([12.0, 0.0]))
    assert found.corners.mean(0) - quad.mean(0) == pytest.approx([5.5, -3.0], abs=0.25)
    assert found.centre_sd == BLURRED_SD


def test_blur_keeps_a_bright_spots_middle_and_sum():
    picture = np.zeros((21, 21), np.float32)
    picture[10, 10] = 100.0
    blurred = _blurred(picture, np.array([6.0, 2.0]))
    v, u = np.mgrid[0:21, 0:21]
    assert blurred.sum() == pytest.approx(100.0, rel=1e-4)
    assert [(blurred * u).sum() / 100, (blurred * v).sum() / 100] == pytest.approx([10, 10], abs=0.05)
    # Evenly spread over a length of 6, the variance along u is 6^2 / 12 = 3, and 1/6 for whole pixels.
    assert (blurred * (u - 10) ** 2).sum() / 100 == pytest.approx(3.17, abs=0.1)


def test_the_best_position_is_found_between_pixels():
    """A smooth hill moved by 0.3 px right and 0.4 px down of where it was cut out."""
    v, u = np.mgrid[0:40, 0:40].astype(np.float32)

    def hill(x, y):
        return np.exp(-((u - x) ** 2 + (v - y) ** 2) / 18.0).astype(np.float32)

    score, place = _best_place(hill(20.3, 18.4), hill(20.0, 18.0)[8:29, 10:31])
    assert score > 0.99
    assert place == pytest.approx([10.3, 8.4], abs=0.05)


def test_ids_of_moving_markers_are_read_where_they_are_expected():
    """Swung at 1.5 m/s with 8 ms of exposure, up to 4.3 px of way: of 16, with OpenCV's own squares 8 are read."""
    rng, detector, read = np.random.default_rng(4), MarkerDetector("DICT_4X4_50", (0, 1)), 0
    for k in range(8):
        instants = [k / 30 + 0.008 * part for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
        middles = [MIDDLE + np.array([REACH * np.sin(1.5 / REACH * time), 0.0, 0.0]) for time in instants]
        _, colour = pictures(plates(middles[2], None), rng, exposures=[plates(middle, None) for middle in middles])
        for row in range(2):
            at = middles[2] + SIDES[row]
            centre = at[:2] / at[2] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
            side = CAMERA.fx * 0.06 / at[2]
            corners = detector.in_window(colour, row, centre, 1.6 * side, side)
            read += bool(np.isfinite(corners).all() and np.linalg.norm(corners.mean(0) - centre) < 1.0)
    assert read >= 11


def test_a_template_has_a_margin_of_15_per_cent_of_its_markers_side():
    """Of a side of 40 px 6 px; the corners lie between pixels."""
    quad = np.array([[20.5, 30.5], [60.5, 30.5], [60.5, 70.5], [20.5, 70.5]])
    kept = keep(np.zeros((100, 100, 3), np.uint8), quad, 0.0)
    assert kept.origin.tolist() == [14.0, 24.0]
    assert kept.colour.shape == (54, 54, 3)  # from 14 and 24 to 67 and 77
    assert keep(np.zeros((100, 67, 3), np.uint8), quad, 0.0) is None


def test_likeness_counts_the_pixels_within_the_rounded_hull():
    """Columns and rows 5 to 15 of the window are those of the template; the others are noise."""
    rng = np.random.default_rng(7)
    picture, window = (rng.uniform(0, 255, (20, 20)).astype(np.float32) for _ in range(2))
    window[5:16, 5:16] = picture[5:16, 5:16]
    hull = np.array([[4.6, 4.6], [15.4, 4.6], [15.4, 15.4], [4.6, 15.4]])
    origin, turn = np.array([30.0, 40.0]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert _likeness(window, picture, turn, origin, origin, hull + origin) == pytest.approx(1.0, abs=1e-5)
    assert _likeness(window, picture, turn, origin, origin, hull + origin - 0.2) < 0.95
    assert _likeness(window, picture, turn, origin, origin, hull + origin + 0.2) < 0.95


def test_a_followed_marker_is_placed_where_it_was_at_the_instant_of_the_depth(monkeypatch):
    """20 px to the right in a tenth of a second; colour that is 50 ms late is 10 px ahead, centre and rim alike."""
    quad = np.array([[100.0, 100.0], [130.0, 100.0], [130.0, 130.0], [100.0, 130.0]])
    tracker, asked = MarkerTracker(RIG), []

    def place(corners, centre, depth, *, in_view=None, centre_sd=None):
        asked.append((corners, centre, in_view))
        return np.array([0.0, 0.0, 1.5]), np.full(3, 0.002), None

    monkeypatch.setattr(tracker._placer, "place", place)
    monkeypatch.setattr(tracker, "_find_corners", lambda *given: np.stack([quad, np.full((4, 2), np.nan)]))
    monkeypatch.setattr(tracker, "_follow", lambda *given: None)
    colour, depth = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.uint16)
    tracker.track(colour, depth, 0.95, 0.05)
    moved = quad + np.array([20.0, 0.0])
    monkeypatch.setattr(tracker, "_find_corners", lambda *given: np.full((2, 4, 2), np.nan))
    monkeypatch.setattr(
        tracker, "_follow", lambda colour, row, time: Followed(moved, moved, 0.45) if row == 0 else None
    )
    tracker.track(colour, depth, 1.05, 0.05)
    corners, centre, in_view = asked[-1]
    assert corners == pytest.approx(moved - [10.0, 0.0])
    assert centre == pytest.approx([125.0, 115.0])
    assert in_view == pytest.approx(moved - [10.0, 0.0])
