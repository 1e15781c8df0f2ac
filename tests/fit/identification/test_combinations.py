"""Identifiable combinations of parameters for every method, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fit.cloth.material import DENSITY, MATERIAL_NAMES, STRETCH
from fit.identification.combinations import describe_combinations
from fit.methods import KINECT_SKIRT_WEIGHED, LEAN, MOCAP_SWATCH
from fit.search.intervals import Intervals
from fit.search.least_squares import BoundedSpace

REACH = LEAN.maximum - LEAN.minimum


def about(fitted, known, method=LEAN):
    """The combinations of a fit at 0.2 kg/m^2 by name."""
    space = BoundedSpace(minimum=method.minimum, maximum=method.maximum, is_log=method.is_log)
    found = describe_combinations(lambda v: method.to_materials(v, 0.2), space, method.initial, np.array(fitted), known)
    return {c.name: c for c in found}


def intervals(covariance, vector, way=0.0, spread=1.645, ends=None, unknown=(), at_bound=()):
    """Intervals as the linear model gives them, unless given."""
    fitted, count = np.array(vector), len(vector)
    ways = np.zeros(count) + way
    half = np.hypot(spread * np.sqrt(np.diag(covariance)), ways)
    spans = np.stack([fitted - half, fitted + half], axis=1) if ends is None else np.array(ends)
    numbers = np.arange(count)
    return Intervals(spans, ~np.isin(numbers, unknown), covariance, ways, spread, np.isin(numbers, at_bound))


def described(covariance, vector=(200.0, 2e-5, 1.0), method=LEAN, **more):
    return about(vector, intervals(covariance, vector, **more), method)


def test_a_known_weight_divides_stiffness_and_its_interval():
    """200 +- 20 N/m at 0.2 kg/m^2 is 1000 +- 100 m^2/s^2, in 90 % within 1.645 of these; before the fit it was 1500."""
    stretch = described(np.diag([20.0, 2e-6, 0.1]) ** 2)["stretch stiffness / density"]
    assert stretch.initial == pytest.approx(1500.0)
    assert stretch.fitted == pytest.approx(1000.0)
    assert (stretch.interval_low, stretch.interval_high) == pytest.approx((835.5, 1164.5))
    assert stretch.is_identified


@pytest.mark.parametrize(("unknown", "at_bound"), [((), ()), ((2,), ()), ((2,), (2,))])
def test_a_combination_of_one_parameter_has_its_verdict_and_its_interval(unknown, at_bound):
    """A damping of 1 /s within 0.7 to 3; and bending of 1.8e-5 to 2.2e-5 N m at 0.2 kg/m^2."""
    ends = [[180.0, 220.0], [1.8e-5, 2.2e-5], [0.7, 3.0]]
    covariance = np.diag([20.0, 2e-6, 2.0]) ** 2
    found = described(covariance, ends=ends, unknown=unknown, at_bound=at_bound)
    damping, bending = found["velocity damping"], found["bending stiffness / density"]
    assert (damping.interval_low, damping.interval_high) == pytest.approx((0.7, 3.0))
    assert (damping.is_identified, damping.is_at_bound) == (not unknown, bool(at_bound))
    assert (bending.interval_low, bending.interval_high) == pytest.approx((0.9e-4, 1.1e-4))
    assert bending.is_identified


def test_fixed_parameters_of_a_method_are_left_out():
    """`lean` has no bending viscosity of its own."""
    assert "bending damping time" not in described(np.diag(REACH**2))


WITH_DENSITY = (200.0, 2e-5, 1.0, 0.2, 1.0)


def test_a_combination_known_from_the_ranges_alone_is_not_identified_and_stays_within_them():
    """Stretching over density: 30 / 0.5 to 1000 / 0.03 m^2/s^2."""
    reach = MOCAP_SWATCH.maximum - MOCAP_SWATCH.minimum
    stretch = described(np.diag(reach**2 / 12), WITH_DENSITY, MOCAP_SWATCH, spread=6.0)["stretch stiffness / density"]
    assert not stretch.is_identified
    assert (stretch.interval_low, stretch.interval_high) == pytest.approx((60.0, 1000 / 0.03))


def test_stretching_and_density_that_err_together_leave_their_ratio_known():
    """Both 30 % too large or small together, 1 % apart: the ratio is known to about 1.4 % though neither is to 30 %."""
    common = np.array([0.3 * 200.0, 0.3 * 2e-5, 0.0, 0.3 * 0.2, 0.0])
    covariance = np.outer(common, common) + np.diag((0.01 * np.array(WITH_DENSITY)) ** 2)
    stretch = described(covariance, WITH_DENSITY, MOCAP_SWATCH)["stretch stiffness / density"]
    deviation = np.log(stretch.interval_high / stretch.interval_low) / 2 / 1.645
    assert deviation == pytest.approx(0.01 * np.sqrt(2), rel=1e-3)
    assert stretch.fitted == pytest.approx(np.sqrt(stretch.interval_low * stretch.interval_high))
    assert stretch.is_identified


def test_the_remaining_step_to_the_minimum_counts_for_a_combination_of_several():
    """The search stopped 40 N/m, a fifth of the stretching, short; the deviations are 1 % of each parameter."""
    covariance = np.diag((0.01 * np.array(WITH_DENSITY)) ** 2)
    way = np.array([40.0, 0.0, 0.0, 0.0, 0.0])
    found = described(covariance, WITH_DENSITY, MOCAP_SWATCH, way=way, spread=2.92)
    half = np.log(found["stretch stiffness / density"].interval_high / 1000.0)
    assert half == pytest.approx(np.hypot(2.92 * 0.01 * np.sqrt(2), 0.2), rel=1e-3)


def test_a_combination_of_several_that_depends_mainly_on_one_is_identified_only_if_that_one_is():
    """Bending is at its bound of 1e-6 N m; it supplies nearly all of what bending over density may be."""
    vector = (200.0, 1e-6, 1.0, 0.2, 1.0)
    ends = [[199.0, 201.0], [1e-6, 2e-4], [0.99, 1.01], [0.199, 0.201], [0.99, 1.01]]
    covariance = np.diag((0.01 * np.array(vector)) ** 2)
    found = described(covariance, vector, MOCAP_SWATCH, ends=ends, unknown=(1,), at_bound=(1,))
    bending = found["bending stiffness / density"]
    assert (bending.is_identified, bending.is_at_bound) == (False, True)
    assert bending.interval_high == pytest.approx(1e-3)
    assert found["stretch stiffness / density"].is_identified


def share_of_the_ranges(share, **more):
    """Stretching over density, of a fit whose variances are a share of the ranges' own."""
    space = BoundedSpace(minimum=MOCAP_SWATCH.minimum, maximum=MOCAP_SWATCH.maximum, is_log=MOCAP_SWATCH.is_log)
    covariance = np.diag(share * space.slope(np.array(WITH_DENSITY)) ** 2 / 12)
    return described(covariance, WITH_DENSITY, MOCAP_SWATCH, **more)["stretch stiffness / density"]


@pytest.mark.parametrize(("share", "is_identified"), [(0.49**2, True), (0.51**2, False)])
def test_a_combination_is_identified_below_half_of_the_ranges_deviation(share, is_identified):
    assert share_of_the_ranges(share).is_identified == is_identified


def test_a_combination_that_is_not_identified_reaches_the_ends_of_its_unknown_parameters():
    """Stretching of 30 to 1000 N/m at 0.2 kg/m^2, though the linear model says far less; density 0.1 is known."""
    ends = [[30.0, 1000.0], [1e-6, 2e-4], [0.99, 1.01], [0.01, 0.201], [0.99, 1.01]]
    wide = share_of_the_ranges(0.51**2, spread=0.01, ends=ends, unknown=(0,))
    assert (wide.interval_low, wide.interval_high) == pytest.approx((150.0, 5000.0))


def test_a_combination_that_depends_mainly_on_two_may_be_identified_though_one_is_at_its_bound():
    """Stretching alone supplies less than nine tenths of what the ranges allow of its ratio to the density."""
    found = share_of_the_ranges(0.01, unknown=(0,), at_bound=(0,))
    assert (found.is_identified, found.is_at_bound) == (True, False)


def test_a_combination_that_falls_with_its_parameter_has_its_ends_in_order():
    """100 N/m over a density of 0.1 to 0.25 kg/m^2: 400 to 1000 m^2/s^2."""

    def materials(vectors):
        rows = np.zeros((len(vectors), len(MATERIAL_NAMES)))
        rows[:, STRETCH], rows[:, DENSITY] = 100.0, vectors[:, 0]
        return rows

    space = BoundedSpace(minimum=np.array([0.05]), maximum=np.array([0.5]), is_log=np.zeros(1, bool))
    known = intervals(np.array([[0.02**2]]), [0.2], ends=[[0.1, 0.25]])
    (stretch,) = describe_combinations(materials, space, np.array([0.3]), np.array([0.2]), known)
    assert (stretch.interval_low, stretch.interval_high) == pytest.approx((400.0, 1000.0))


def test_a_damping_of_0_has_an_interval_and_warns_of_no_logarithm():
    """Spring 0 to 2.5 of Blender's is a bending damping time of 0 to 1 ms."""
    vector = [30.0, 20.0, 0.0, 5.0, 0.95]
    ends = [[29.0, 31.0], [19.0, 21.0], [0.0, 2.5], [4.0, 6.0], [0.94, 0.96]]
    with np.errstate(all="raise"):
        found = described(
            np.diag(np.full(5, 0.01)), vector, KINECT_SKIRT_WEIGHED, ends=ends, unknown=(2,), at_bound=(2,)
        )
    damping = found["bending damping time"]
    assert (damping.interval_low, damping.interval_high) == pytest.approx((0.0, 1e-3))
    assert damping.is_at_bound
