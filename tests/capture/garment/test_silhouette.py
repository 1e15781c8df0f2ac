"""Garments segmented in depth images with known pixels."""

from __future__ import annotations

import numpy as np
import pytest

from capture.garment.silhouette import Window, cut_out, square_around
from tests.capture.garment.flat_cloth import WHOLE, silhouette

WINDOW = Window(30, 20, 230, 180)
HELD = np.array([[80.0, 50.0], [150.0, 50.0]])


def image(depth=1600, rows=slice(50, 121), columns=slice(80, 151)):
    """A garment of 71 by 71 pixels in an empty room."""
    found = np.zeros((200, 260), np.uint16)
    found[rows, columns] = depth
    return found


def cut(depth, *, window=WINDOW, held=HELD):
    return cut_out(depth, window, held, nearest=1.2, farthest=2.0, jump=0.05)


def test_a_garment_is_cut_out_with_twelve_pixels_around_it():
    depth = image()
    depth[60, 155] = 900  # of something else
    found = cut(depth)
    assert found.window == Window(68, 38, 163, 133)
    assert found.mask.shape == found.depth.shape == found.raw.shape == (95, 95)
    expected = np.zeros((95, 95))
    expected[12:83, 12:83] = 1
    assert (found.mask == expected).all()
    assert found.mask.dtype == np.uint8
    assert found.depth == pytest.approx(1.6 * expected)
    assert found.raw[60 - 38, 155 - 68] == 900
    assert (found.raw[12:83, 12:83] == 1600).all()
    assert len(found.outline) == 4 * 70
    assert set(found.outline.min(0)) == {12.0}
    assert set(found.outline.max(0)) == {82.0}
    assert not found.touches_rim


def test_holes_are_garment_without_depth():
    depth = image()
    depth[80:86, 100:106] = 0
    found = cut(depth)
    assert found.mask[80 - 38 : 86 - 38, 100 - 68 : 106 - 68].all()
    assert not found.depth[80 - 38 : 86 - 38, 100 - 68 : 106 - 68].any()


@pytest.mark.parametrize(("depth", "is_found"), [(1199, False), (1200, True), (2000, True), (2001, False)])
def test_a_garment_lies_between_the_nearest_and_the_farthest(depth, is_found):
    assert (cut(image(depth)) is not None) == is_found


def test_pixels_above_the_held_edge_are_no_garment_however_it_tilts():
    """The edge rises by one in five: cloth up to it, in the columns in between as well."""
    depth = image(rows=slice(30, 121))
    found = cut(depth, held=np.array([[80.0, 60.0], [150.0, 46.0]]))
    top = found.mask.argmax(0)[12:83] + found.window.top
    assert top.tolist() == [int(np.ceil(60 - 0.2 * k - 1e-9)) for k in range(71)]
    upright = cut(depth, held=np.array([[100.0, 60.0], [100.0, 46.0]]))
    assert upright is None  # no column lies between its ends


@pytest.mark.parametrize(("behind", "touches"), [(1651, False), (1650, True)])
def test_a_jump_separates_surfaces_behind(behind, touches):
    """Furniture from the garment's right on to the window's end, 51 or 50 mm behind."""
    depth = image()
    depth[60:100, 151:230] = behind
    found = cut(depth)
    assert found.touches_rim == touches
    assert (found.window.right == 163) != touches


@pytest.mark.parametrize(
    ("rows", "columns", "touches"),
    [(slice(50, 121), slice(30, 151), True), (slice(50, 121), slice(31, 151), False),
     (slice(50, 121), slice(80, 230), True), (slice(50, 121), slice(80, 229), False),
     (slice(50, 180), slice(80, 151), True), (slice(50, 179), slice(80, 151), False)],
)  # fmt: skip
def test_a_garment_at_the_windows_left_right_or_bottom_may_go_on(rows, columns, touches):
    assert cut(image(rows=rows, columns=columns)).touches_rim == touches


def test_the_largest_piece_that_begins_below_the_edge_is_the_garment():
    depth = image(columns=slice(80, 110))
    depth[55:120, 115:151] = 1600  # larger by its columns
    assert cut(depth).window == Window(103, 43, 163, 132)
    depth = image(columns=slice(80, 110))
    depth[63:178, 115:226] = 1600  # begins 13 px below: not in the band
    assert cut(depth).window == Window(68, 38, 122, 133)
    depth[61, 115:226] = depth[62, 115:226] = 1600
    assert cut(depth).window == Window(103, 49, 230, 180)
    assert cut(image(rows=slice(63, 121))) is None
    assert cut(np.zeros((200, 260), np.uint16)) is None


def test_an_edge_out_of_the_window_holds_nothing():
    assert cut(image(), held=HELD - [0.0, 60.0]) is None
    assert cut(image(), held=HELD + np.array([400.0, 0.0])) is None


@pytest.mark.parametrize(("width", "height", "is_empty"), [(24, 24, False), (23, 24, True), (24, 23, True)])
def test_a_window_holds_a_garment_of_two_bands(width, height, is_empty):
    assert Window(5, 7, 5 + width, 7 + height).is_empty == is_empty


@pytest.mark.parametrize(("above", "is_found"), [(11, True), (12, False)])
def test_a_garment_hangs_within_twelve_pixels_of_an_edge_above_or_left_of_its_window(above, is_found):
    """The window's first row is `above` px below the edge. Columns count up to the one before the edge's end."""
    depth = image(rows=slice(20, 121))
    assert (cut(depth, held=np.array([[80.0, 20.0 - above], [150.0, 20.0 - above]])) is not None) == is_found
    left = image(columns=slice(30, 121))
    end = 31.0 if is_found else 30.0
    assert (cut(left, held=np.array([[10.0, 50.0], [end, 50.0]])) is not None) == is_found


def test_a_square_around_a_pixel_is_cut_off_at_the_windows_first_row_and_column():
    """The window begins at column 200 and row 150."""
    cloth = silhouette(WHOLE)
    rows, columns = square_around(cloth, np.array([250.7, 190.7]), 5)
    assert (rows, columns) == (slice(35, 46), slice(45, 56))
    rows, columns = square_around(cloth, np.array([203.0, 148.0]), 5)
    assert (rows, columns) == (slice(0, 4), slice(0, 9))
    rows, columns = square_around(cloth, np.array([190.0, 140.0]), 5)
    assert (rows, columns) == (slice(0, 0), slice(0, 0))


def test_the_pixels_kept_around_a_garment_end_at_the_window():
    """It begins one column and one row after the window: nothing is left out of that row and column."""
    found = cut(image(rows=slice(21, 121), columns=slice(31, 151)), held=np.array([[40.0, 21.0], [150.0, 21.0]]))
    assert (found.window.left, found.window.top) == (30, 20)


def test_an_edge_below_the_window_holds_nothing():
    assert cut(image(), held=HELD + np.array([0.0, 400.0])) is None
    assert cut(image(), held=HELD + np.array([0.0, 140.0])) is None  # 190, a row beyond the last, but a column within


def test_a_garment_hangs_by_a_single_pixel_of_the_band():
    depth = image(rows=slice(63, 121))
    depth[61:63, 100] = 1600
    assert cut(depth).window == Window(68, 49, 163, 133)


@pytest.mark.parametrize(("behind", "touches"), [(2201, False), (2200, True)])
def test_a_jump_is_as_many_millimetres_as_it_says(behind, touches):
    depth = image()
    depth[60:100, 151:230] = behind
    assert cut_out(depth, WINDOW, HELD, nearest=1.2, farthest=3.0, jump=0.6).touches_rim == touches
