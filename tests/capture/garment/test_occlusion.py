"""Corners hidden by a nearer object, a fold or the border of the image, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.occlusion import folded_away, is_at_border, is_behind_something
from tests.capture.garment.flat_cloth import LEFT, TOP, WHOLE, silhouette

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


def test_nearer_pixels_count_within_twelve_pixels_and_off_the_garment():
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
