"""Sums, orders and kept folders of a diagnosis exactly at their limits, from made-up figures."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.errors import FitError
from fit.gap.checkpoint import Checkpoint
from fit.gap.closure import BlockErrors, Resampling, exceeds
from fit.gap.findings import describe_effects
from fit.gap.likelihood import Sums
from fit.gap.screening import screen
from fit.gap.subsets import reduced
from fit.gap.weighed import decide_by_mass, limited
from fit.methods import SI
from tests.fit.gap.linear_scene import LinearObserver
from tests.fit.gap.test_evidence import flat_evidence
from tests.fit.gap.test_hypotheses import NUMBERS
from tests.fit.gap.test_posterior_by_hand import search_of
from tests.fit.gap.test_weighed import found_of
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis


def test_no_effect_that_is_as_likely_as_one_is_none():
    shares = {(): (0.5, 0.0), ("air_drag",): (0.5, 0.0)}
    found = SimpleNamespace(fits=dict.fromkeys(shares), shares=lambda: shares)
    assert decide_by_mass(evidence_of({"air_drag": 5.5}), found).verdict == "none"


def test_a_set_that_the_half_seconds_contradict_has_even_odds_and_no_worse(monkeypatch):
    """That the better set is no better has a probability of nine tenths."""
    monkeypatch.setattr("fit.gap.weighed.gain_p_value", lambda errors, least, known: 0.9)
    monkeypatch.setattr("fit.gap.weighed.block_errors", lambda observer, residual: hypothesis((), 5.0).errors)
    monkeypatch.setattr("fit.gap.weighed.is_brought", lambda *given: False)
    found = found_of({(): (0.1, 0.0), ("air_drag",): (0.1, 0.0), ("hem",): (0.1, 0.0)})
    found.fits = {one: SimpleNamespace(residual=None) for one in found.fits}
    found.mass = dataclasses.replace(found.mass, known=np.array([-9.0, 0.0, -5.0]), wide=np.full(3, -30.0))
    known = limited(SimpleNamespace(), found).known
    assert known[2] == known[1] == 0.0


@pytest.mark.parametrize(("squared", "is_more"), [(30.0, False), (30.001, True)])
def test_an_error_exceeds_a_known_one_by_more_than_exactly_a_fifth(squared, is_more):
    """25 mm^2 are known."""
    errors = BlockErrors(np.full(8, 10.0 * squared), np.full(8, 10.0), np.zeros(3))
    assert exceeds(errors, Resampling(np.zeros((10, 8), int), 1.0), 25.0) == is_more


@pytest.mark.parametrize(("left", "is_worth_it"), [(114.25, True), (114.26, False)])
def test_an_effect_that_closes_exactly_a_quarter_of_a_draws_gap_is_worth_naming(left, is_worth_it):
    """29.75 of 119 mm^2."""
    evidence = flat_evidence({"air_drag": 5.0})
    (worth,) = evidence.are_worth_naming(np.array([144.0]), {"air_drag": np.array([left])}).values()
    assert worth.tolist() == [is_worth_it]


def test_effects_without_a_refit_are_listed_by_what_they_explain(monkeypatch):
    monkeypatch.setattr(
        "fit.gap.findings.smallest_detectable", lambda evidence: {k: np.array([0.3]) for k in evidence.screened}
    )
    evidence = evidence_of({"air_drag": 6.0, "hem": 6.5, "air_lift": 7.0})
    explained = {"air_drag": 0.1, "hem": 0.3, "air_lift": 0.2}
    screened = {k: dataclasses.replace(one, explained=explained[k]) for k, one in evidence.screened.items()}
    evidence = dataclasses.replace(evidence, screened=screened, singles={})
    effects = tuple(KINDS[k] for k in explained)
    assert [one.id for one in describe_effects(evidence, None, effects, SI, weighed={})] == [
        "hem",
        "air_lift",
        "air_drag",
    ]


def test_fits_beside_an_empty_key_are_refused(tmp_path):
    (tmp_path / "key.json").touch()
    (tmp_path / "fit.npz").write_bytes(b"fit")
    with pytest.raises(FitError, match="cannot be read"):
        Checkpoint(tmp_path, {})


def test_an_effect_explains_all_of_a_small_residual():
    """A tenth of a deviation in all, along the effect."""
    row = np.linalg.qr(np.random.default_rng(0).normal(size=(NUMBERS, 1)))[0].T[0]
    observer = LinearObserver(-0.1 * row, np.zeros((NUMBERS, len(SI.initial))), {"hem": row / KINDS["hem"].typical})
    assert screen(observer, observer.fitted(), ("hem",))["hem"].explained == pytest.approx(1.0, rel=1e-3)


def test_each_scale_of_a_discrepancy_has_its_own_priors():
    """Two scales at once have the evidence that each has alone."""
    rows = np.random.default_rng(0).normal(size=(4, 30))
    inner, precision = rows @ rows.T, np.array([[1.0, 2.0], [3.0, 5.0]])
    both = reduced(Sums(np.stack([inner, 2.0 * inner]), np.zeros(2)), precision, np.zeros(2))
    for n, factor in enumerate((1.0, 2.0)):
        alone = reduced(Sums(factor * inner[None], np.zeros(1)), precision[n], np.zeros(2))
        assert both.base[n] == pytest.approx(alone.base[0])


@pytest.mark.parametrize(("again", "refits"), [(True, [("a",), ()]), (False, [("a",)])])
def test_the_base_model_is_fitted_again_only_when_asked(again, refits):
    asked = []
    fitted = SimpleNamespace(cost=50.0, vector=np.zeros(1), amplitudes=np.zeros(1), active=("a",), pinned=None)

    def refit(wanted, tasks):
        asked.extend(wanted)
        return [fitted]

    search = search_of(refit=refit)
    search.observer.off = np.zeros(1)
    search.found.fits[("a",)] = fitted
    assert search._polished(("a",), again=again) is fitted
    assert asked == refits
