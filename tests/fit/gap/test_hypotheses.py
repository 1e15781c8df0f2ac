"""Starts of refits, on a linear model whose best amplitude is known."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gap.fitting import Fitted
from fit.gap.hypotheses import POLISHING, REFIT_ITERATIONS, _starts_of_refit, further, polishing, refits, shortlist
from fit.gap.screening import screen
from fit.methods import KINECT_SKIRT, SI
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.verdict_scene import KINDS, signature

NUMBERS = len(layout_of().take)


@pytest.mark.parametrize("size", [0.6, 1.0])
def test_a_refit_begins_at_the_joint_linear_solution_of_parameters_and_amplitude(size):
    """r = -50 size s for a typical size s: that size, and the parameters stay where they are."""
    rng = np.random.default_rng(0)
    row = np.linalg.qr(rng.normal(size=(NUMBERS, 1)))[0].T[0]
    typical = KINDS["hem"].typical
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    observer = LinearObserver(-50.0 * size * row, jacobian, {"hem": 50.0 * row / typical})
    start = observer.fitted()
    screened = screen(observer, start, ("hem", "air_drag"))
    task, other = refits(observer, start, screened, ["hem", "air_drag"])
    assert task.active == ("hem",)
    assert task.amplitudes[observer.columns["hem"]] == pytest.approx(size * typical, rel=1e-6)
    assert task.vector == pytest.approx(SI.initial)
    assert task.iterations == REFIT_ITERATIONS
    assert task.jacobian.shape == (NUMBERS, len(SI.initial) + 1)
    # What explains nothing begins at three tenths of its size, of which the least share costs least, or the same.
    assert other.amplitudes[observer.columns["air_drag"]] == pytest.approx(0.09 * KINDS["air_drag"].typical)
    again = polishing(start)
    assert (again.iterations, again.jacobian) == (POLISHING, None)


def test_a_guess_beyond_an_effects_range_begins_inside():
    """Fifty typical sizes of a hem are ten times its range: nine tenths of that, and no share of it beyond."""
    rng = np.random.default_rng(1)
    row = np.linalg.qr(rng.normal(size=(NUMBERS, 1)))[0].T[0]
    hem = KINDS["hem"]
    observer = LinearObserver(-2500.0 * row, np.zeros((NUMBERS, len(SI.initial))), {"hem": 50.0 * row / hem.typical})
    screened = screen(observer, observer.fitted(), ("hem", "air_drag"))
    (task,) = refits(observer, observer.fitted(), screened, ["hem"])
    assert task.amplitudes[observer.columns["hem"]] == pytest.approx(hem.high)  # 1.5 shares of 0.9, within bounds


@pytest.mark.parametrize("sign", [1, -1])
def test_starts_are_shares_of_a_guess_that_lies_within_nine_tenths_of_either_end(sign):
    """Tautness or slack of many times the range: 0.3, 0.6, 1 and 1.5 of nine tenths, at most the end."""
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0].T[0]
    slack, none = KINDS["clip_slack"], np.zeros((NUMBERS, len(SI.initial)))
    observer = LinearObserver(-sign * 2500.0 * row, none, {"clip_slack": 50.0 * row / slack.typical})
    found = screen(observer, observer.fitted(), ("clip_slack",))["clip_slack"]
    problem, starts, _ = _starts_of_refit(observer, observer.fitted(), found, "clip_slack")
    _, amplitudes = problem.unpack(np.array(starts))
    end = slack.high if sign > 0 else slack.low
    shares = amplitudes[:, observer.columns["clip_slack"]][:, 0] / end
    assert shares == pytest.approx([0.27, 0.54, 0.9, 1.0] * 2)


def test_five_effects_and_no_trifle_are_refitted():
    """Of 100 a twentieth is 5: what saves less is not refitted, and no more than five are, twins apart."""
    rows = np.eye(8)
    saved = (100.0, 50.0, 20.0, 10.0, 6.0, 5.5, 4.0, 1.0)
    found = {f"e{n}": signature(rows[n], predicted=s, predicted_mm2=0.0) for n, s in enumerate(saved)}
    assert shortlist(found) == ["e0", "e1", "e2", "e3", "e4"]
    few = {name: found[name] for name in ("e0", "e6", "e7")}
    assert shortlist(few) == ["e0"]
    twins = {**few, "twin": signature(rows[0] + 0.1 * rows[1], predicted=1.0, predicted_mm2=0.0)}
    assert shortlist(twins) == ["e0", "twin"]
    opposite = {**few, "twin": signature(-rows[0] + 0.1 * rows[1], predicted=1.0, predicted_mm2=0.0)}
    assert shortlist(opposite) == ["e0", "twin"]  # what explains the same with the other sign is as hard to tell apart


class Offset(LinearObserver):
    """Linear in the parameters of any method, about its initial values."""

    def __init__(self, missed, jacobian, signatures, method):
        super().__init__(missed, jacobian, signatures)
        self.parameterisation = method

    def residuals(self, vectors, amplitudes):
        return self.missed + (vectors - self.parameterisation.initial) @ self.jacobian.T + amplitudes @ self.rows


@pytest.mark.parametrize(
    ("method", "step", "moved"),
    [(SI, 0.02, np.exp(0.02)), (SI, -0.02, np.exp(-0.02)), (SI, 3.0, np.e), (KINECT_SKIRT, 0.3, 1.3)],
    ids=["up", "down", "by a factor of e at most", "not a logarithm"],
)
def test_a_refits_parameters_begin_where_the_linear_model_has_them(method, step, moved):
    """50 r' a unit of the logarithm, or of the parameter itself; 50 of a typical hem that is missed as well."""
    row, other = np.linalg.qr(np.random.default_rng(2).normal(size=(NUMBERS, 2)))[0].T
    working = np.zeros((NUMBERS, len(method.initial)))
    working[:, 0] = 50.0 * row
    first, hem = method.initial[0], KINDS["hem"]
    plain = working / np.where(method.is_log, method.initial, 1.0)
    observer = Offset(-50.0 * step * row - 50.0 * other, plain, {"hem": 50.0 * other / hem.typical}, method)
    zeros = np.zeros(len(method.initial))
    start = Fitted(method.initial, observer.off, (), observer.missed, working, zeros, True)
    found = screen(observer, start, ("hem", "air_drag"))
    (task,) = refits(observer, start, found, ["hem"])
    expected = first * moved if method is SI else first + step
    assert task.vector[0] == pytest.approx(expected, rel=1e-3)
    assert task.vector[1:] == pytest.approx(method.initial[1:])
    assert task.amplitudes[observer.columns["hem"]] == pytest.approx(hem.typical, rel=1e-3)


def test_one_visible_component_is_enough_for_a_guess():
    """Of a tilt the first component explains 0.8 of its typical size; the second moves nothing, and stays at none."""
    row = np.linalg.qr(np.random.default_rng(3).normal(size=(NUMBERS, 1)))[0].T[0]
    tilt = KINDS["gravity_tilt"]
    rows = np.stack([50.0 * row / tilt.typical, 0 * row])
    observer = LinearObserver(-40.0 * row, np.zeros((NUMBERS, len(SI.initial))), {"gravity_tilt": rows})
    found = screen(observer, observer.fitted(), ("gravity_tilt", "hem"))
    (task,) = refits(observer, observer.fitted(), found, ["gravity_tilt"])
    assert task.amplitudes[observer.columns["gravity_tilt"]] == pytest.approx([0.8 * tilt.typical, 0.0], rel=1e-6)


def promising(**figures):
    """Effects by the cost and the mm^2 that they would save, none of them alike."""
    rows = np.eye(len(figures))
    return {
        name: signature(rows[n], predicted=saved, predicted_mm2=nearer)
        for n, (name, (saved, nearer)) in enumerate(figures.items())
    }


@pytest.mark.parametrize(("nearer", "chosen"), [(5.1, ["first", "nearest", "second"]), (4.9, ["first", "nearest"])])
def test_an_effect_that_saves_half_of_the_largest_distance_is_refitted_too(nearer, chosen):
    assert shortlist(promising(first=(100.0, 0.0), second=(1.0, nearer), nearest=(2.0, 10.0))) == chosen


def test_an_effect_that_brings_no_point_nearer_is_not_refitted_for_that():
    assert shortlist(promising(first=(100.0, -3.0), second=(1.0, -1.0))) == ["first"]


def test_further_effects_save_cost_and_a_twentieth_of_the_most_distance():
    """Best first, at most three, of 10 mm^2 half a one is enough; then what saves 5 of 10 mm^2 or more."""
    found = promising(
        first=(50.0, 0.49), second=(20.0, 0.51), third=(40.0, 10.0), trifle=(1.9, 5.0), fifth=(30.0, 6.0),
        sixth=(10.0, 6.0),
    )  # fmt: skip
    assert further(found, 3) == ["third", "fifth", "second", "sixth"]
    assert further(found, 9) == ["third", "fifth", "second", "sixth"]
    assert further(promising(first=(5.0, -1.0), second=(9.0, -2.0)), 9) == ["second", "first"]
    assert further(promising(first=(5.0, 0.9), second=(9.0, 0.01)), 9) == ["first"]
