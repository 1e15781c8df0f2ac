"""Where a descent that ended in the wrong valley is begun again."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.valleys import HOPPED, across

# Two parameters of which the sum is known ten times as well as the difference, and a third that is known by itself.
JACOBIAN = np.array([[3.0, 3.0, 0.0], [0.3, -0.3, 0.0], [0.0, 0.0, 1.0]])
END = np.array([0.5, 0.5, 0.5])
WEAK = 1e-6 * np.eye(3)


def never(places):
    raise AssertionError(f"asked of {len(places)} places")


def test_one_parameter_is_moved_and_another_makes_up_for_it():
    asked = []

    def judge(places):
        asked.append(places)
        return np.abs(places[:, 0] - 0.8)  # the valley beyond

    found = across(END, JACOBIAN, WEAK, 1.0, 2, judge)
    (places,) = asked
    # H_oo^-1 H_ok of the sum and the difference: (9 - 0.09) / (9 + 0.09).
    apart = places - END
    assert np.allclose(apart[:, 2], 0.0)
    for moved in apart:
        k = int(np.abs(moved[:2]).argmax())
        assert moved[1 - k] == pytest.approx(-moved[k] * 8.91 / 9.09, rel=1e-6)
    assert sorted({round(abs(float(m)), 2) for m in apart[:6, 0]}) == [0.15, 0.3, 0.45]
    assert len(found) == HOPPED
    assert found[0, 0] == pytest.approx(0.8)
    # The second place is one in another direction, and not the next best in the same one.
    assert found[1, 0] != pytest.approx(0.65)


def test_places_stay_in_the_box():
    seen = []
    across(np.array([0.9, 0.05, 0.5]), JACOBIAN, WEAK, 1.0, 2, lambda places: seen.append(places) or places[:, 0])
    assert ((seen[0] >= 0) & (seen[0] <= 1)).all()
    assert not np.isclose(seen[0][:, 0], 1.05).any()


@pytest.mark.parametrize("scale", [1e3, 1e-4])
def test_what_is_held_tightly_or_not_at_all_is_not_moved(scale):
    assert across(END, scale * np.eye(3), 1e-12 * np.eye(3), 1.0, 3, never).shape == (0, 3)


def test_only_the_first_parameters_are_moved_alone():
    seen = []
    across(END, JACOBIAN, WEAK, 1.0, 1, lambda places: seen.append(places) or places[:, 0])
    assert len(seen[0]) == 6
