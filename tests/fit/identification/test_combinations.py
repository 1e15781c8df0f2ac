"""What motion can tell whatever the method, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.identification.combinations import describe_combinations
from fit.methods import LEAN, MOCAP_SWATCH
from fit.search.intervals import Intervals

REACH = LEAN.maximum - LEAN.minimum


def described(covariance, vector=(200.0, 2e-5, 1.0), method=LEAN, way=0.0, spread=1.645):
    fitted = np.array(vector)
    reach = method.maximum - method.minimum
    count = len(fitted)
    ways = np.zeros(count) + way
    known = Intervals(np.zeros((count, 2)), np.ones(count, bool), covariance, ways, spread)
    found = describe_combinations(lambda v: method.to_materials(v, 0.2), method.initial, fitted, reach, known)
    return {c.name: c for c in found}


def test_a_known_weight_divides_stiffness_and_its_interval():
    """200 +- 20 N/m at 0.2 kg/m^2 is 1000 +- 100 m^2/s^2, in 90 % within 1.645 of these; before the fit it was 1500."""
    stretch = described(np.diag([20.0, 2e-6, 0.1]) ** 2)["stretch stiffness / density"]
    assert stretch.initial == pytest.approx(1500.0)
    assert stretch.fitted == pytest.approx(1000.0)
    assert (stretch.interval_low, stretch.interval_high) == pytest.approx((835.5, 1164.5))
    assert stretch.is_identified


def test_a_combination_is_as_uncertain_as_its_parameters():
    """Three blocks: 2.92 deviations of 100 m^2/s^2; and the search stopped 40 N/m, so 200 m^2/s^2, short."""
    way = np.array([40.0, 0.0, 0.0])
    stretch = described(np.diag([20.0, 2e-6, 0.1]) ** 2, way=way, spread=2.92)["stretch stiffness / density"]
    assert stretch.interval_high - stretch.fitted == pytest.approx(np.hypot(292.0, 200.0), rel=1e-3)


def test_what_the_ranges_alone_allow_is_not_identified():
    prior = np.diag(REACH**2 / 12)
    assert not any(c.is_identified for c in described(prior).values())


def test_an_interval_down_to_zero_is_not_identified_however_wide_the_range():
    """0.2 +- 0.15 /s of a range of 8: far narrower than the range, and still perhaps nothing."""
    damping = described(np.diag([20.0, 2e-6, 0.15]) ** 2, vector=(200.0, 2e-5, 0.2))["velocity damping"]
    assert damping.interval_low == 0.0
    assert not damping.is_identified


def test_a_combination_that_is_a_parameter_which_is_not_identified_has_its_interval():
    """A damping of 1 /s within 0.7 to 3 by the search, wider by the linear model alone."""
    covariance, fitted = np.diag([20.0, 2e-6, 2.0]) ** 2, np.array([200.0, 2e-5, 1.0])
    ends = np.array([[180.0, 220.0], [1.8e-5, 2.2e-5], [0.7, 3.0]])
    known = Intervals(ends, np.array([True, True, False]), covariance, np.zeros(3), 1.645)
    found = describe_combinations(lambda v: LEAN.to_materials(v, 0.2), LEAN.initial, fitted, REACH, known)
    damping = next(c for c in found if c.name == "velocity damping")
    assert (damping.interval_low, damping.interval_high, damping.is_identified) == (0.7, 3.0, False)


def test_what_a_method_holds_fixed_is_left_out():
    """`lean` has no bending viscosity of its own."""
    assert "bending damping time" not in described(np.diag(REACH**2))


def test_stretching_and_density_that_err_together_leave_their_ratio_known():
    """Both 30 % too large or small together, 1 % apart: the ratio is known to about 1.4 % though neither is to 30 %."""
    vector = np.array([200.0, 2e-5, 1.0, 0.2, 1.0])
    common = np.array([0.3 * 200.0, 0.3 * 2e-5, 0.0, 0.3 * 0.2, 0.0])
    covariance = np.outer(common, common) + np.diag((0.01 * vector) ** 2)
    stretch = described(covariance, vector, MOCAP_SWATCH)["stretch stiffness / density"]
    deviation = (stretch.interval_high - stretch.interval_low) / 2 / 1.645
    assert deviation / stretch.fitted == pytest.approx(0.01 * np.sqrt(2), rel=1e-3)
    assert stretch.is_identified


def test_a_combination_of_a_parameter_that_is_not_identified_reaches_as_far_as_that_one():
    """Bending held at 1e-6 by its bound: the slope there would end at 1.3e-5 of the 1e-3 that 2e-4 N m have."""
    fitted, ends = np.array([200.0, 1e-6, 1.0]), np.array([[180.0, 220.0], [1e-6, 2e-4], [0.9, 1.1]])
    covariance = np.diag([12.0, 1e-6, 0.06]) ** 2
    known = Intervals(ends, np.array([True, False, True]), covariance, np.zeros(3), 1.645)
    found = describe_combinations(lambda v: LEAN.to_materials(v, 0.2), LEAN.initial, fitted, REACH, known)
    bending = next(c for c in found if c.name == "bending stiffness / density")
    assert bending.interval_high == pytest.approx(1e-3)
    assert not bending.is_identified
    stretch = next(c for c in found if c.name == "stretch stiffness / density")
    assert (stretch.interval_low, stretch.interval_high) == pytest.approx((1000 - 98.7, 1000 + 98.7))
    sharp = replace(known, covariance=np.diag([12.0, 1e-8, 0.06]) ** 2)  # tight, as a slope at a bound may be
    found = describe_combinations(lambda v: LEAN.to_materials(v, 0.2), LEAN.initial, fitted, REACH, sharp)
    assert not next(c for c in found if c.name == "bending stiffness / density").is_identified
