"""Templates found again in drawn patterns that were moved, turned, scaled or covered by known amounts."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from capture.hanger import marker_following as module
from capture.hanger.marker_following import (
    BLURRED_SD,
    COVERED_SD,
    Keepsake,
    _best_place,
    _blurred,
    _follow_points,
    _likeness,
    _peak,
    _there_and_back,
    follow,
    keep,
)

SIDE = 40.0  # px of the template's marker
ORIGIN = np.array([300.0, 200.0])  # px, where the window lies in the picture
STILL = np.zeros(2)


def pattern(height, width, seed=5):
    """A smooth random pattern, 0 to 255, with features of some pixels."""
    rough = np.random.default_rng(seed).standard_normal((height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.clip(128 + 50 * smooth / smooth.std(), 0, 255).astype(np.float32)


WINDOW = pattern(90, 150)
MIDDLE = np.array([60.0, 44.0])  # px of the window, of the marker's middle


def template(turn=0.0, scale=1.0, shift=STILL):
    """A template, and the corners [px of the picture] that its marker has in the window.

    The template shows what the window does before it was turned [rad], scaled and shifted [px] about the middle.
    """
    c, s = scale * np.cos(turn), scale * np.sin(turn)
    linear = np.array([[c, -s], [s, c]])
    # From a pixel of the template, 53 x 53, to one of the window.
    lead = np.column_stack([linear, MIDDLE + shift - linear @ [26.0, 26.0]])
    picture = cv2.warpAffine(WINDOW, lead, (53, 53), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    colour = np.repeat(np.rint(picture).astype(np.uint8)[..., None], 3, axis=2)
    local = np.array([[6.0, 6.0], [46.0, 6.0], [46.0, 46.0], [6.0, 46.0]])
    kept = Keepsake(0.0, local + np.array([500.0, 90.0]), colour, np.array([500.0, 90.0]))
    return kept, local @ lead[:, :2].T + lead[:, 2] + ORIGIN


def way_of(kept, corners):
    return corners.mean(0) - kept.corners.mean(0)


def points(kept, shifts, window=WINDOW):
    return _follow_points(window, ORIGIN, kept, kept.picture, shifts)


@pytest.mark.parametrize(
    ("turn", "scale", "is_found"),
    [
        (0.0, 1.0, True), (0.15, 1.0, True), (-0.15, 1.0, True), (0.0, 1.1, True), (0.0, 0.9, True),
        (0.28, 1.0, False), (-0.28, 1.0, False), (0.0, 1.14, False), (0.0, 0.86, False),
    ],
)  # fmt: skip
def test_points_show_how_a_marker_was_turned_and_scaled_up_to_a_quarter_radian_and_12_per_cent(turn, scale, is_found):
    kept, corners = template(turn, scale)
    found = points(kept, [way_of(kept, corners)])
    assert (found is not None) == is_found
    if found:
        assert found.corners == pytest.approx(corners, abs=0.5)
        assert found.centre_sd == COVERED_SD
        assert found.in_view.dtype == np.float64
        # The outermost of 7 x 7 points are a fourteenth of the side from the corners.
        inner = (corners - corners.mean(0)) * 6 / 7 + corners.mean(0)
        away = np.linalg.norm(found.in_view[:, None] - inner, axis=2)
        assert away.min(0).max() < 0.7


def test_a_marker_is_sought_from_every_start_until_one_leads_to_it():
    kept, corners = template()
    right = way_of(kept, corners)
    wrong = right + np.array([60.0, -10.0])
    assert points(kept, [wrong]) is None
    assert points(kept, [wrong, right]).corners == pytest.approx(corners, abs=0.2)
    assert points(kept, []) is None


@pytest.mark.parametrize("off", [(2.0, -1.0), (-2.0, 1.5)])
def test_points_find_a_marker_some_pixels_from_their_start(off):
    kept, corners = template(shift=np.array([0.4, -0.3]))
    found = points(kept, [way_of(kept, corners) + off])
    assert found.corners == pytest.approx(corners, abs=0.2)


@pytest.mark.parametrize("shift", [(-50.0, -30.0), (70.0, 30.0), (-50.0, 30.0), (70.0, -30.0)])
def test_a_start_beyond_the_windows_border_is_moved_to_it(shift):
    """The template of 53 px fits to 97 px from the left and 37 px from the top of 150 x 90 px."""
    at = np.clip(MIDDLE + shift, [27, 27], [150 - 27, 90 - 27])
    kept, corners = template(shift=at - MIDDLE)
    found = points(kept, [way_of(kept, corners) + np.sign(shift) * 30.0])
    assert found.corners == pytest.approx(corners, abs=0.5)


def covered(rows):
    """The window, whose rows above or below the marker's are replaced by another pattern."""
    window = WINDOW.copy()
    window[rows] = pattern(90, 150, seed=8)[rows]
    return window


@pytest.mark.parametrize(("visible", "is_found"), [(0.55, True), (0.1, False)])
def test_the_part_in_view_is_where_the_points_agree(visible, is_found):
    """Of 40 px from row 24 on the upper ones are in view; the lower ones show something else."""
    end = round(24 + visible * SIDE)
    kept, corners = template()
    found = points(kept, [way_of(kept, corners)], covered(slice(end, None)))
    assert (found is not None) == is_found
    if found:
        assert found.corners == pytest.approx(corners, abs=0.5)
        assert found.in_view[:, 1].max() < ORIGIN[1] + end + 3
        assert found.in_view[:, 1].min() == pytest.approx(ORIGIN[1] + 24 + SIDE / 14, abs=0.5)


def test_points_come_back_to_where_they_were_or_are_none():
    """The second picture is 3 px right and 2 px up of the first one; its left half is another one."""
    whole = pattern(80, 120)
    first, second = whole[10:70, 10:110], whole[12:72, 7:107].copy()
    second[:, :50] = pattern(60, 50, seed=9)
    v, u = (part.ravel().astype(float) for part in np.mgrid[15:50:7, 20:85:8])
    there, true = _there_and_back(first, second, np.stack([u, v], axis=1))
    assert there.dtype == np.float64
    right = u > 60
    assert true[right].all()
    assert np.count_nonzero(true[u < 40]) <= 1  # of 15, by chance
    assert there[right] == pytest.approx(np.stack([u, v], axis=1)[right] + [3.0, -2.0], abs=0.1)


def test_values_of_a_picture_are_clipped_to_its_range_before_points_are_tracked():
    first = pattern(60, 60)
    bright = np.where(first > 200, first + 256, np.where(first < 50, first - 256, first))
    start = np.array([[20.0, 20.0], [30.0, 25.0], [40.0, 40.0]])
    clipped = np.where(first > 200, 255, np.where(first < 50, 0, first)).astype(np.float32)
    for pair in ((bright, clipped), (clipped, bright)):
        there, true = _there_and_back(*(part.astype(np.float32) for part in pair), start)
        assert true.all()
        assert there == pytest.approx(start, abs=1e-3)


@pytest.mark.parametrize(
    ("three", "vertex"),
    [
        ([-4.0, 0.0, 0.0], 0.5),  # -2 (x - 0.5)^2 + 0.5
        ([-2.25, -0.25, -0.25 - 0.0], 0.5),
        ([-1.5625, -0.0625, -0.5625], 0.25),  # -(x - 0.25)^2
        ([-0.5625, -0.0625, -1.5625], -0.25),
        ([0.0, 1.0, 3.0], 0.0),  # a valley's rise
        ([1.0, 1.0, 1.0], 0.0),
        ([-9.0, -4.0, -1.0], 0.5),  # -(x - 2)^2 has its vertex farther out
        ([-1.0, -4.0, -9.0], -0.5),
        ([1.0, 2.0], 0.0),
        ([], 0.0),
    ],
)
def test_the_vertex_of_a_parabola_through_three_values(three, vertex):
    assert _peak(np.array(three, np.float32)) == pytest.approx(vertex)


def test_the_best_position_at_a_windows_border_is_a_whole_pixel_along_that_axis():
    window = pattern(40, 60)
    for x, y in ((0, 12), (60 - 21, 12), (17, 0), (17, 40 - 21)):
        score, place = _best_place(window, np.ascontiguousarray(window[y : y + 21, x : x + 21]))
        assert score == pytest.approx(1.0, abs=1e-4)
        assert place == pytest.approx([x, y], abs=0.1)
        assert (place[0] == x) == (x in (0, 39))
        assert (place[1] == y) == (y in (0, 19))


def picture_of(window, at, size=(480, 640)):
    """A grey picture that shows a window from a pixel on."""
    picture = np.full((*size, 3), 128, np.uint8)
    x, y = (int(part) for part in at)
    picture[y : y + window.shape[0], x : x + window.shape[1]] = np.rint(window)[..., None]
    return picture


MARKER = pattern(60, 60)
QUAD = np.array([[110.0, 110.0], [150.0, 110.0], [150.0, 150.0], [110.0, 150.0]])


def kept_marker():
    return keep(picture_of(MARKER, (100, 100)), QUAD, 0.0)


@pytest.mark.parametrize("way", [(0, 0), (7, -5), (-7, 7), (7, 7)])
def test_a_template_is_found_as_far_as_the_reach(way):
    """From where it is expected, 30 px right and 20 px down, up to 7 px along either axis."""
    found = follow(
        picture_of(MARKER, (130 + way[0], 120 + way[1])), kept_marker(), QUAD.mean(0) + np.array([30, 20]), 6.2, STILL
    )
    moved = QUAD + np.add(way, [30, 20])
    assert found.corners == pytest.approx(moved, abs=0.05)
    assert found.in_view == pytest.approx(moved, abs=0.05)
    assert found.centre_sd == BLURRED_SD


@pytest.mark.parametrize("at", [(0, 0), (640 - 60, 480 - 60)])
def test_a_template_is_found_at_the_pictures_border(at):
    way = np.array(at) - 100.0
    found = follow(picture_of(MARKER, at), kept_marker(), QUAD.mean(0) + way, 9.0, STILL)
    assert found.corners == pytest.approx(QUAD + way, abs=0.05)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("end", [0, 1])
def test_a_window_three_pixels_longer_than_the_template_is_searched_and_a_smaller_one_is_not(axis, end):
    """The template, 53 px long, is expected at the picture's border and past it; there are 4 px of reach."""
    kept = kept_marker()
    assert kept.colour.shape == (53, 53, 3)
    assert kept.origin.tolist() == [104.0, 104.0]
    limit = (640, 480)[axis]
    # From `start` on, less 4 px, to `start` and 57 px, within 0 and the limit: 56 or 55 px.
    for length, is_found in ((56, True), (55, False)):
        start = length - 57 if end == 0 else limit - length + 4
        at = [200.0, 200.0]
        at[axis] = start
        shown = list(at)
        shown[axis] = min(max(start, 0), limit - 53)
        picture = picture_of(MARKER[4:57, 4:57], shown)
        found = follow(picture, kept, QUAD.mean(0) + np.array(at) - 104.0, 4.0, STILL)
        assert (found is not None) == is_found


def test_of_several_blurs_the_one_that_is_most_alike_is_taken():
    """Blurred along 24 px by a half, the marker is no more like the sharp template than 0.8."""
    step = np.array([24.0, 0.0])
    blurred = _blurred(MARKER, 0.5 * step)
    picture = picture_of(blurred, (105, 100))
    found = follow(picture, kept_marker(), QUAD.mean(0), 8.0, step)
    assert found.centre_sd == BLURRED_SD
    assert found.corners == pytest.approx(QUAD + np.array([5.0, 0.0]), abs=0.2)
    sharp = follow(picture, kept_marker(), QUAD.mean(0), 8.0, STILL)
    assert sharp is None or sharp.centre_sd == COVERED_SD


def test_a_motion_of_less_than_half_a_pixel_blurs_nothing():
    picture = pattern(20, 30)
    assert _blurred(picture, np.array([0.3, -0.39])) is picture
    assert _blurred(picture, np.array([0.3, -0.41])) is not picture


def test_a_picture_without_contrast_is_like_nothing():
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    hull = np.array([[2.0, 2.0], [17.0, 2.0], [17.0, 17.0], [2.0, 17.0]])
    plain, full = np.full((20, 20), 9.0, np.float32), pattern(20, 20)
    for window, picture in ((plain, full), (full, plain), (plain, plain)):
        assert _likeness(window, picture, turn, STILL, STILL, hull) == 0.0
    assert _likeness(full, full, turn, STILL, STILL, hull) == pytest.approx(1.0)


@pytest.mark.parametrize(("contrast", "likeness"), [(1.1, 1.0), (0.9, 0.0)])
def test_contrast_is_a_deviation_of_one_of_255(contrast, likeness):
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    hull = np.array([[0.0, 0.0], [19.0, 0.0], [19.0, 19.0], [0.0, 19.0]])
    full = pattern(20, 20)
    faint = (full - full.mean()) * np.float32(contrast / full.std()) + 100
    assert _likeness(faint, full, turn, STILL, STILL, hull) == pytest.approx(likeness, abs=1e-4)
    assert _likeness(full, faint, turn, STILL, STILL, hull) == pytest.approx(likeness, abs=1e-4)


def test_a_template_goes_on_beyond_its_rim_as_it_ends_there():
    picture = pattern(20, 20)
    window = np.pad(picture, 4, mode="edge")
    turn = np.array([[1.0, 0.0, 4.0], [0.0, 1.0, 4.0]])
    hull = np.array([[0.0, 0.0], [27.0, 0.0], [27.0, 27.0], [0.0, 27.0]])
    assert _likeness(window, picture, turn, STILL, STILL, hull) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("count", "is_found"), [(12, True), (11, False)])
@pytest.mark.parametrize("what", ["come back", "agree"])
def test_twelve_points_that_come_back_and_agree_are_a_marker(count, is_found, what, monkeypatch):
    """Every fourth of 49 points; all others are lost, or come back but have moved apart."""
    chosen = np.zeros(49, bool)
    chosen[: 4 * count : 4] = True

    def flow(first, second, start):
        apart = 20.0 * np.random.default_rng(1).standard_normal(start.shape)
        if what == "come back":
            return start, chosen
        return np.where(chosen[:, None], start, start + apart), np.ones(49, bool)

    monkeypatch.setattr(module, "_there_and_back", flow)
    kept, corners = template()
    found = points(kept, [way_of(kept, corners)])
    assert (found is not None) == is_found


def test_a_turned_template_is_laid_where_its_corners_are():
    kept, corners = template(0.2, 1.1)
    c, s = 1.1 * np.cos(0.2), 1.1 * np.sin(0.2)
    linear = np.array([[c, -s], [s, c]])
    turn = np.column_stack([linear, corners[0] - linear @ kept.corners[0]])
    assert _likeness(WINDOW, kept.picture, turn, kept.origin, ORIGIN, corners) > 0.98
    assert _likeness(WINDOW, kept.picture, turn, kept.origin, ORIGIN + 2.0, corners) < 0.9
