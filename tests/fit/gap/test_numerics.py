"""The estimate of a mesh's discretisation error from a finer mesh."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.gap.fitting import Fitted
from fit.gap.numerics import refine
from fit.methods import KINECT_SKIRT, SI
from fit.observer.edge import EdgeErrors
from fit.observer.residuals import Observer
from fit.observer.simulation_error import LEAST_REFINEMENT, motion_mm, wrong_by_law
from fit.recordings.recording import prepare
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.scenes import hung, sheet, swing, take_of

CONVERGED = Resolution(spacing=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("spacing", [0.2, 0.15, 0.085, 0.08, 0.05])
def test_a_finer_mesh_is_finer_and_says_how_far_the_coarse_one_is_off(spacing):
    """A square of 0.4 m has one element of 0.15 m or more, which 1.5 times as many would leave as one, and two of 0.08.

    The estimate is at least the distance between the mesh and a converged one, and not much more.
    """
    time = np.arange(0, 3, 1 / 30)
    garment = sheet(width=0.4, height=0.4, grid=5)
    moved = swing(time, amplitude=0.05, hz=0.8, stop=2.0)
    take = take_of(garment, time, moved, hung(garment, time) + moved[:, None], sd=1e-3)
    vector = SI.initial.copy()
    observer = Observer([prepare(take)], SI, (), frequency=0.0, resolution=Resolution(spacing=spacing))
    residual = observer.residuals(vector[None], observer.off[None])[0]
    nothing = np.zeros((len(residual), len(vector)))
    base = Fitted(vector, observer.off, (), residual, nothing, np.zeros(len(vector)), True)
    refined = refine(observer, observer, base)
    assert refined.ratio >= LEAST_REFINEMENT
    true = observer.at_resolution(CONVERGED).residuals(vector[None], observer.off[None])[0]
    apart = float(observer.in_mm(true - residual))
    assert 0.8 * apart < refined.mesh_mm < 4 * apart
    # Sound solvers differ by 1.5 % of the motion besides.
    assert refined.numerics_mm == pytest.approx(np.hypot(refined.mesh_mm, 0.015 * motion_mm(observer)))


class Meshed(LinearObserver):
    """A square of 0.4 m in whole elements, whose error falls with the square of their size: r = q h^2 + J dv."""

    def __init__(self, spacing, shape, jacobian, travel=0.0):
        elements = int(np.ceil(0.4 / spacing - 1e-9))
        super().__init__(shape * (0.4 / elements) ** 2, jacobian, {})
        self.shape, self.travel = shape, travel
        self.resolution = Resolution(spacing=spacing, step_share=0.7)
        self.mesh = SimpleNamespace(spacing=0.4 / elements)
        self.layout = MetricLayout(self.layout)
        time = np.arange(60) / 30
        points = travel * np.tile([1.0, -1.0], 30)[:, None, None] * np.ones((60, 6, 3)) / np.sqrt(3)
        self.recordings = [SimpleNamespace(time=time, duration=59 / 30, points=points, counted=np.ones((60, 6), bool))]

    def at_resolution(self, resolution):
        assert resolution.step_share == self.resolution.step_share
        return Meshed(resolution.spacing, self.shape, self.jacobian, self.travel)

    def edge_errors(self, residual):
        return EdgeErrors()


class MetricLayout:
    """A layout whose numbers are of 1 mm."""

    def __init__(self, layout):
        self.__dict__.update(layout.__dict__)

    def metres(self, residuals):
        return residuals * 1e-3

    def moving(self, values):
        return values


NUMBERS = len(layout_of().take)


@pytest.mark.parametrize(
    ("spacing", "ratio"),
    # Elements: 4 and 6, 2 and 3, 3 and 5, 2 and 3. At 0.1325 m the requests 1.5, 1.65 and 1.82 give 5, 5 and 6 for 4.
    [(0.1, 6 / 4), (0.2, 3 / 2), (0.134, 5 / 3), (0.3, 3 / 2), (0.1325, 6 / 4)],
)
def test_a_mesh_is_off_by_its_error_where_that_falls_with_the_square_of_its_spacing(spacing, ratio):
    """q h^2 whatever the finer one is: (q h^2 - q (h / r)^2) / (1 - 1 / r^2); and 1.5 % of 100 mm of motion."""
    shape = np.random.default_rng(0).normal(0, 500.0, NUMBERS)
    observer = Meshed(spacing, shape, np.zeros((NUMBERS, len(SI.initial))), travel=0.1)
    found = refine(observer, observer, observer.fitted())
    off = float(observer.in_mm(observer.missed))
    assert found.ratio == pytest.approx(ratio)
    assert found.mesh_mm == pytest.approx(off)
    assert found.numerics_mm == pytest.approx(np.hypot(off, 1.5))
    assert np.sqrt(found.errors.squared_mm) == pytest.approx(off / ratio**2)


@pytest.mark.parametrize("weight", [1.0, 2.0])
def test_the_base_model_is_refitted_once_on_the_finer_mesh(weight):
    """What a parameter imitates is gone there: only the coarse mesh's share of it keeps them apart.

    A Jacobian that says twice as much goes half the way at once, and the whole of it is tried.
    """
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0]
    first = SI.initial[0]
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    jacobian[:, 0] = 1e4 * row / first  # per N/m: 1e4 a unit of the logarithm
    observer = Meshed(0.1, 5e4 * row, jacobian)
    base = observer.fitted()
    base = dataclasses.replace(base, jacobian=weight * first * jacobian)
    found = refine(observer, observer, base)
    fine = 5e4 * (0.4 / 6) ** 2
    left = fine * (1 - 1 / weight)
    assert np.sqrt(found.errors.squared_mm) == pytest.approx(np.sqrt(3 / NUMBERS) * left, abs=0.01 * fine)
    assert found.mesh_mm == pytest.approx(np.sqrt(3 / NUMBERS) * (5e4 * 0.01 - left) / (1 - (4 / 6) ** 2), rel=0.02)


class OfBlender(Meshed):
    """The same with parameters that are no logarithms."""

    parameterisation = KINECT_SKIRT

    def residuals(self, vectors, amplitudes):
        return self.missed + (vectors - KINECT_SKIRT.initial) @ self.jacobian.T + amplitudes @ self.rows

    def at_resolution(self, resolution):
        return OfBlender(resolution.spacing, self.shape, self.jacobian, self.travel)


def test_a_parameter_without_a_logarithm_is_refitted_in_its_own_unit():
    """Of 222 deviations on the finer mesh 1e4 a unit of Struct take 0.022 units: nothing is left."""
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0]
    jacobian = np.zeros((NUMBERS, 6))
    jacobian[:, 1] = 1e4 * row
    observer = OfBlender(0.1, 5e4 * row, jacobian)
    zeros = np.zeros(6)
    base = Fitted(KINECT_SKIRT.initial, observer.off, (), observer.missed, jacobian, zeros, True)
    found = refine(observer, observer, base)
    fine = np.sqrt(3 / NUMBERS) * 5e4 * (0.4 / 6) ** 2
    assert np.sqrt(found.errors.squared_mm) == pytest.approx(0.0, abs=1e-3 * fine)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_refit_stays_within_the_bounds(sign, monkeypatch):
    """2e5 deviations at ten a unit of Struct would take it thousands of units up or down."""
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0]
    jacobian = np.zeros((NUMBERS, 6))
    jacobian[:, 1] = 10.0 * row
    observer, tried = OfBlender(0.1, sign * 5e7 * row, jacobian), []
    plain = OfBlender.residuals

    def residuals(self, vectors, amplitudes):
        tried.extend(vectors)
        return plain(self, vectors, amplitudes)

    zeros = np.zeros(6)
    base = Fitted(KINECT_SKIRT.initial, observer.off, (), observer.missed, jacobian, zeros, True)
    monkeypatch.setattr(OfBlender, "residuals", residuals)
    refine(observer, observer, base)
    ends = {1.0: KINECT_SKIRT.minimum, -1.0: KINECT_SKIRT.maximum}
    assert max(tried, key=lambda one: abs(one[1] - KINECT_SKIRT.initial[1]))[1] == ends[sign][1]


def test_a_refit_that_makes_it_worse_is_not_taken():
    """A Jacobian of the wrong sign: the parameters stay."""
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0]
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    jacobian[:, 0] = -1e4 * row / SI.initial[0]
    observer = Meshed(0.1, 5e4 * row, jacobian)
    wrong = dataclasses.replace(observer.fitted(), jacobian=-SI.initial[0] * jacobian)
    found = refine(observer, observer, wrong)
    assert np.sqrt(found.errors.squared_mm) == pytest.approx(float(observer.in_mm(observer.missed)) * (4 / 6) ** 2)


def test_the_held_out_takes_show_how_far_the_mesh_is_off():
    shape = np.random.default_rng(0).normal(0, 500.0, NUMBERS)
    none = np.zeros((NUMBERS, len(SI.initial)))
    observer, judge = Meshed(0.1, shape, none), Meshed(0.1, 3 * shape, none)
    found = refine(observer, judge, observer.fitted())
    assert found.mesh_mm == pytest.approx(3 * float(observer.in_mm(observer.missed)))


def test_motion_counts_what_is_seen_of_several_takes():
    """3 mm in 20 sightings, 1 mm in 10 of another take, nothing of a point that was never seen."""
    sign = np.tile([1.0, -1.0], 10)[:, None, None] * [[0.0, 0.0, 1.0]]
    first = 0.003 * np.repeat(sign, 2, axis=1)
    seen = np.stack([np.ones(20, bool), np.zeros(20, bool)], 1)
    first[:, 1] = np.nan
    takes = [SimpleNamespace(points=first, counted=seen),
             SimpleNamespace(points=0.5 + 0.001 * sign[:10], counted=np.ones((10, 1), bool))]  # fmt: skip
    assert motion_mm(SimpleNamespace(recordings=takes)) == pytest.approx(np.sqrt((20 * 9 + 10) / 30))


def test_motion_leaves_out_positions_that_do_not_count_and_is_nothing_where_none_counts():
    """3 mm either way in ten frames; in ten others the point is a metre away, and does not count."""
    points = 0.003 * np.tile([1.0, -1.0], 10)[:, None, None] * [[0.0, 0.0, 1.0]]
    points[10:] += 1.0
    counts = np.arange(20)[:, None] < 10
    assert motion_mm(SimpleNamespace(recordings=[SimpleNamespace(points=points, counted=counts)])) == pytest.approx(3.0)
    assert motion_mm(SimpleNamespace(recordings=[SimpleNamespace(points=points, counted=counts & False)])) == 0.0


def test_a_law_spreads_a_negative_size_as_much_as_a_positive_one():
    """1.645 times a tenth of 2."""
    assert wrong_by_law(0.1, np.array([-2.0, 2.0])) == pytest.approx([0.329, 0.329], abs=1e-4)
