"""Templates found again at the limits of what is looked at: few points, starts that fail, borders and flat places."""

from __future__ import annotations

import numpy as np
import pytest

from capture.hanger import marker_following as module
from capture.hanger.marker_following import (
    BLURRED_SD,
    COVERED_SD,
    LEAST_IN_VIEW,
    SURE_MATCH,
    Keepsake,
    _blurred,
    _follow_points,
    _likeness,
    follow,
)
from tests.capture.hanger.test_followed_points import (
    MARKER,
    ORIGIN,
    QUAD,
    STILL,
    WINDOW,
    kept_marker,
    picture_of,
    points,
    template,
    way_of,
)

SIDE = 7  # points along a side of the grid


def block(rows, columns):
    """The points of the grid's first rows and columns."""
    return (np.arange(SIDE)[:, None] < rows) & (np.arange(SIDE) < columns)


@pytest.mark.parametrize(("rows", "is_found"), [(4, True), (3, False)])
def test_points_in_view_span_fifteen_hundredths_of_a_marker(rows, is_found, monkeypatch):
    """Four columns of four rows span 9 of 49, 0.18; of three rows 6 of 49, 0.12."""
    assert LEAST_IN_VIEW == 0.15
    seen = block(rows, 4).ravel()
    monkeypatch.setattr(module, "_there_and_back", lambda first, second, start: (start, seen))
    kept, corners = template()
    assert (points(kept, [way_of(kept, corners)]) is not None) == is_found


def apart(start):
    """Points that come back and agree on no motion."""
    return start + 20.0 * np.random.default_rng(1).standard_normal(start.shape), np.ones(49, bool)


@pytest.mark.parametrize(
    "fails",
    [
        lambda start: (start, block(1, 7).ravel()), apart, lambda start: (1.2 * start, np.ones(49, bool)),
        lambda start: (start, block(3, 4).ravel()),
    ],
    ids=["few come back", "none agree", "too large", "in a small part"],
)  # fmt: skip
def test_after_a_start_that_fails_for_any_reason_comes_the_next_one(fails, monkeypatch):
    kept, corners = template()
    given = [fails, lambda start: (start, np.ones(49, bool))]
    monkeypatch.setattr(module, "_there_and_back", lambda first, second, start: given.pop(0)(start))
    found = points(kept, [way_of(kept, corners)] * 2)
    assert given == []
    assert found.corners == pytest.approx(corners, abs=0.5)


@pytest.mark.parametrize("beyond", [(30.0, 30.0), (-30.0, -30.0), (30.0, -30.0), (-30.0, 30.0)])
def test_a_template_that_is_wider_than_high_fits_to_the_windows_border_as_it_is(beyond):
    """Of 150 x 90 px, 53 x 33 px fit from 0 to 97 px from the left and from 0 to 57 px from the top."""
    at = np.where(np.array(beyond) > 0, [97, 57], [0, 0])
    local = np.array([[6.0, 6.0], [46.0, 6.0], [46.0, 26.0], [6.0, 26.0]])
    picture = np.rint(WINDOW[at[1] : at[1] + 33, at[0] : at[0] + 53]).astype(np.uint8)
    origin = np.array([500.0, 90.0])
    kept = Keepsake(0.0, local + origin, np.repeat(picture[..., None], 3, axis=2), origin)
    way = ORIGIN + at - origin + beyond
    found = _follow_points(WINDOW, ORIGIN, kept, kept.picture, [way])
    assert found.corners == pytest.approx(local + ORIGIN + at, abs=0.5)


def test_where_the_best_match_is_none_the_marker_is_sought_where_it_is_expected(monkeypatch):
    """The best match is made to lie in the window's corner, 60 px off, and to be poor."""
    monkeypatch.setattr(module, "_best_place", lambda window, picture: (0.5, np.zeros(2)))
    found = follow(picture_of(MARKER, (130, 120)), kept_marker(), QUAD.mean(0) + np.array([30, 20]), 60.0, STILL)
    assert found.corners == pytest.approx(QUAD + np.array([30, 20]), abs=0.2)
    assert found.centre_sd == COVERED_SD


def test_a_point_without_texture_on_either_side_does_not_come_back():
    """A blob in the first picture alone, and one in the second alone: each looks at rest from its own side."""
    rows, columns = np.mgrid[:60, :60]

    def blob(x):
        return 120.0 * np.exp(-((columns - x) ** 2 + (rows - 30) ** 2) / 8.0).astype(np.float32)

    first, second = 100 + blob(15) + blob(45), 100 + blob(30) + blob(45)
    _, true = module._there_and_back(first, second, np.array([[15.0, 30.0], [30.0, 30.0], [45.0, 30.0]]))
    assert true.tolist() == [False, False, True]


def test_a_contrast_of_exactly_one_is_contrast():
    """Stripes of 127 and 129 deviate by 1 from their mean; those of 126 and 130 by 2."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    hull = np.array([[0.0, 0.0], [19.0, 0.0], [19.0, 19.0], [0.0, 19.0]])
    sign = np.where(np.arange(20) % 2, 1.0, -1.0) * np.ones((20, 1))
    faint, strong = ((128 + size * sign).astype(np.float32) for size in (1.0, 2.0))
    assert faint.std() == 1.0
    for window, picture in ((faint, strong), (strong, faint)):
        assert _likeness(window, picture, turn, STILL, STILL, hull) == pytest.approx(1.0)


@pytest.mark.parametrize(("likeness", "sd"), [(SURE_MATCH, BLURRED_SD), (np.nextafter(SURE_MATCH, 0.0), COVERED_SD)])
def test_a_match_of_exactly_the_sure_likeness_is_sure(likeness, sd, monkeypatch):
    place = np.array([30.0, 20.0]) + kept_marker().origin - [64, 54]
    monkeypatch.setattr(module, "_best_place", lambda window, picture: (likeness, place))
    found = follow(picture_of(MARKER, (130, 120)), kept_marker(), QUAD.mean(0) + np.array([30, 20]), 60.0, STILL)
    assert found.centre_sd == sd


def test_a_motion_of_exactly_half_a_pixel_blurs():
    assert _blurred(MARKER, np.array([0.5, 0.0])) is not MARKER
    assert _blurred(MARKER, np.array([np.nextafter(0.5, 0.0), 0.0])) is MARKER
