"""Probabilities of effects that share the draws of the held-out error, worked by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.closure import Resampling
from fit.gap.probabilities import probabilities
from tests.fit.gap.test_evidence import flat_evidence, level
from tests.fit.gap.verdict_scene import hypothesis

HALVES = Resampling(np.repeat([[0], [6]], 12, axis=1).repeat(20, axis=0), 1.0)  # 20 draws of a block of either half


def with_halves(one, first_mm, second_mm):
    """The same hypothesis with one error in the first six half-seconds and another in the last six."""
    sums = np.repeat([10.0 * first_mm**2, 10.0 * second_mm**2], 6)
    return dataclasses.replace(one, errors=dataclasses.replace(one.errors, sums=sums))


def test_an_effect_is_not_at_work_alone_in_draws_in_which_it_is_together_with_another():
    """Of 119 mm^2 beyond the noise of 25 the hem leaves 8.6 in half of the draws, where both leave nothing.

    In the other half the hem leaves nothing by itself. So an effect is at work in every draw, the hem in all of them
    and drag in one half: 4 x 1 / (1 + 3 x 1) and 4 x 0.5 / (1 + 3 x 1).
    """
    evidence = flat_evidence({"hem": 6.0}, resampling=HALVES, floor_error_mm=0.0)
    hem = with_halves(evidence.singles["hem"], 5.8, 5.0)
    both = level(hypothesis(("hem", "air_drag"), 5.0), 5.0)
    evidence = dataclasses.replace(evidence, singles={"hem": hem})
    assert np.mean(evidence.worth_naming["hem"]) == 1.0
    assert probabilities(evidence, both) == pytest.approx({"hem": 1.0, "air_drag": 0.5})


def test_probabilities_of_the_same_evidence_are_the_same():
    """Draws choose a limit too: with 8.6 mm an effect leaves 41 % of the gap, near the limits' middle of 35 %."""
    evidence = flat_evidence({"air_lift": 8.6}, resampling=HALVES)
    first, again = (probabilities(evidence, None)["air_lift"] for _ in "12")
    assert 0.05 < first == again < 0.95


def test_an_effect_that_the_held_edge_identifies_is_at_work_in_draws_without_any_other_one():
    """Drag leaves nothing in half of the draws, and slack clips close nothing: 4 x 0.5 / (1 + 3 x 1) each."""
    evidence = flat_evidence({"air_drag": 6.0, "clip_slack": 12.0}, resampling=HALVES, floor_error_mm=0.0)
    singles = {**evidence.singles, "air_drag": with_halves(evidence.singles["air_drag"], 5.0, 12.0)}
    evidence = dataclasses.replace(evidence, singles=singles)
    assert probabilities(evidence, None) == pytest.approx({"air_drag": 0.8, "clip_slack": 0.0})
    evidence.__dict__["identified_by_edge"] = frozenset({"clip_slack"})
    assert probabilities(evidence, None) == pytest.approx({"air_drag": 0.5, "clip_slack": 0.5})
