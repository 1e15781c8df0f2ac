"""The deviation of held corners follows their distances from the ends of the held edge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.held_scatter import HELD_MEMORY, HeldScatter

PERIOD = 1 / 30  # s
PLACES = np.array([[-0.2, 0.0, 1.6], [0.2, 0.0, 1.6], [0.2, 0.4, 1.6], [-0.2, 0.4, 1.6]])
HELD = np.array([True, True, False, False])
SD = np.tile([0.002, 0.001, 0.004], (4, 1))


def stated(apart, frames=1, *, places=PLACES, scatter=None, begin=0.0):
    """Return the deviations after some frames of one distance [m], (4, 3)."""
    scatter = scatter or HeldScatter(4)
    for k in range(frames):
        found = scatter.stated(places, apart, SD, HELD, begin + k * PERIOD)
    return found


def test_one_frame_counts_as_a_third_of_what_is_stated():
    apart = np.full((4, 3), np.nan)
    apart[0], apart[1] = [0.006, 0.0, -0.004], [0.0, 0.003, 0.0]
    found = stated(apart)
    assert found[0] == pytest.approx([0.002 * math.sqrt((3 + 9) / 4), 0.001, 0.004])
    # A distance of 0 makes it smaller, but along y, where the held edge is itself the side.
    assert found[1] == pytest.approx(
        [0.002 * math.sqrt(3 / 4), 0.001 * math.sqrt((3 + 9) / 4), 0.004 * math.sqrt(3 / 4)]
    )
    assert found[2:].tolist() == SD[2:].tolist()


def test_a_frame_that_is_far_off_is_wrong_at_once():
    """By 20 mm after ten frames without a distance, at 2 mm: 16 mm, and not the 5 mm of their mean."""
    scatter, apart = HeldScatter(4), np.zeros((4, 3))
    stated(apart, 10, scatter=scatter)
    apart[0] = [0.020, -0.020, 0.020]
    assert stated(apart, scatter=scatter, begin=10 * PERIOD)[0] == pytest.approx([0.016, 0.018, 0.012])


def test_long_after_the_deviation_is_nearly_the_distance_and_is_forgotten_again():
    scatter = HeldScatter(4)
    found = stated(np.full((4, 3), 0.006), 60, scatter=scatter)
    frames = 1 / (1 - math.exp(-PERIOD / HELD_MEMORY))
    assert found[0, 0] == pytest.approx(0.002 * math.sqrt((3 + 9 * frames) / (3 + frames)), rel=1e-4)
    assert 0.005 < found[0, 0] < 0.006
    after = stated(np.zeros((4, 3)), scatter=scatter, begin=60 * PERIOD + 10 * HELD_MEMORY)
    assert after[0, 0] == pytest.approx(0.002 * math.sqrt(3 / 4), rel=1e-3)


def test_a_corner_that_is_not_held_in_a_frame_leaves_its_memory_as_it_fades():
    scatter = HeldScatter(4)
    scatter.stated(PLACES, np.full((4, 3), 0.006), SD, HELD, 0.0)
    gone = np.full((4, 3), np.nan)
    assert scatter.stated(PLACES, gone, SD, ~np.ones(4, bool), HELD_MEMORY).tolist() == SD.tolist()
    found = scatter.stated(PLACES, np.zeros((4, 3)), SD, HELD, 2 * HELD_MEMORY)
    before = math.exp(-2)
    assert found[0, 0] == pytest.approx(0.002 * math.sqrt((3 + 9 * before) / (4 + before)))


def test_a_wrong_depth_moves_a_corner_above_the_axis_upwards_too():
    """0.8 m above the axis at 1.6 m, half of the growth of depth's variance; never less than stated."""
    above = PLACES - [0.0, 0.8, 0.0]
    apart = np.tile([0.0, 0.0, 0.012], (4, 1))
    found = stated(apart, places=above)
    assert found[0, 2] == pytest.approx(0.004 * math.sqrt((3 + 9) / 4))
    assert found[0, 1] == pytest.approx(math.sqrt(0.001**2 + 0.25 * (found[0, 2] ** 2 - 0.004**2)))
    assert stated(np.zeros((4, 3)), places=above)[0, 1] == 0.001
