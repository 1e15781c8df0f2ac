"""The picture of a take's motion shows the way in which most is moved."""

from __future__ import annotations

import numpy as np
import pytest

from formats.motion import axes_of
from formats.take_picture import draw_in_letters, paths_of
from tests.formats.test_motion import TIME, moved, turned


@pytest.mark.parametrize(
    ("way", "direction"), [("sideways", [1, 0, 0.3]), ("face-on", [0.3, 1, 0]), ("up-and-down", [0, 0.3, 1])]
)
def test_the_picture_shows_the_way_in_which_most_is_moved(way, direction):
    """The points move with the bar; the named share of their motion is 0.05 m times a wave."""
    take = moved(direction)
    shown, names, paths = paths_of(take)
    assert shown == way
    assert names == ["held edge", "top left", "top right", "bottom right", "bottom left", "centre"]
    assert np.nanmax(np.abs(paths[:, 0])) == pytest.approx(0.05, rel=0.05)
    assert f"{way} over {TIME[-1] - TIME[0]:.1f} s" in draw_in_letters(take)


def test_axes_are_unit_vectors_square_to_each_other_with_gravity_down():
    axes = np.stack(list(axes_of(turned(0 * TIME)).values()))
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert axes == pytest.approx(np.eye(3))
