"""The gates whose figures come from simulations, on observers that answer by a formula."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.gates import FREQUENCIES, choose_frequency, disagreement, numerics_gate, predictability_gate
from fit.methods import SI
from tests.fit.gap.linear_scene import LinearObserver, layout_of


class Chaotic(LinearObserver):
    """A thousandth in every parameter moves the points by so many mm, depending on the pull."""

    def __init__(self, apart, frequency=0.0):
        numbers = len(layout_of().take)
        super().__init__(np.zeros(numbers), np.zeros((numbers, len(SI.initial))), {})
        self.apart, self.frequency = apart, frequency

    def with_frequency(self, frequency):
        return Chaotic(self.apart, frequency)

    def residuals(self, vectors, amplitudes):
        moved = (vectors[:, 0] / SI.initial[0] - 1.0) / 1e-3
        return moved[:, None] * self.apart(self.frequency) / np.sqrt(3) * np.ones((1, len(self.missed)))


# The noise of 1 mm per axis is 1.73 mm; a fifth of it 0.35 mm.
@pytest.mark.parametrize(
    ("apart", "frequency", "passed"),
    [
        (lambda hz: 0.34, 0.0, True),
        (lambda hz: 0.36 if hz < 1.0 else 0.34, 1.0, True),
        (lambda hz: 5.0 - hz if hz < 4 else 1.5 + hz / 100, 4.5, True),
        (lambda hz: 2.0 + abs(hz - 2.0), 2.0, False),
    ],
    ids=["free", "weakly pulled", "never forgotten, yet within the noise", "never within the noise"],
)
def test_the_weakest_pull_is_chosen_under_which_a_nudge_is_forgotten(apart, frequency, passed):
    found, gate = choose_frequency(Chaotic(apart), SI.initial)
    assert (found, gate.passed) == (frequency, passed)
    assert found in FREQUENCIES
    assert gate.limit == pytest.approx(np.sqrt(3.0))
    assert gate.figure == pytest.approx(apart(frequency), rel=1e-6)
    assert ("free rollout" in gate.sentence) == (frequency == 0.0)


@pytest.mark.parametrize(("mm", "passed"), [(1.7, True), (1.75, False)])
def test_takes_are_predictable_where_a_nudge_stays_within_the_noise(mm, passed):
    observer = Chaotic(lambda hz: mm, 2.0)
    gate = predictability_gate(observer, SI.initial, observer.off)
    assert gate.passed == passed
    assert "under a pull of 2 Hz" in gate.sentence


def test_fits_disagree_by_the_second_best_cost_over_the_best():
    observer = Chaotic(lambda hz: 0.0)
    fits = [dataclasses.replace(observer.fitted(), residual=np.array([np.sqrt(cost)])) for cost in (30.0, 10.0, 12.0)]
    assert disagreement(fits) == pytest.approx(0.2)
    assert disagreement(fits[:1]) == 0.0


@pytest.mark.parametrize(
    ("closed", "figure", "passed"), [(0.39, 39.0, True), (0.41, 41.0, False), (-0.2, 0.0, True), (None, 0.0, True)]
)
def test_a_finer_mesh_may_close_two_fifths_of_the_gap(closed, figure, passed):
    gate = numerics_gate(closed, 1.2, 1.5)
    assert (gate.figure, gate.passed, gate.limit) == (pytest.approx(figure), passed, pytest.approx(40.0))
    assert "1.2 mm" in gate.sentence
    assert ("hardly a gap" in gate.sentence) == (closed is None)
