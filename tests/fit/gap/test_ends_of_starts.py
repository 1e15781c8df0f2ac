"""Ends of all starts of the base fit, as a diagnosis by evidence keeps them for the intervals of its parameters."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from fit.gap.floor import Floor
from fit.gap.rounds import Rounds
from fit.gap.weighed import weigh
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named


def test_by_evidence_an_end_that_is_no_better_than_the_base_fit_is_kept_beside_it(monkeypatch):
    """The base fit is the best that there is; its refit beside the drag ends no better."""
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH) - world.rows["air_drag"][0]
    base, own = world.base(), np.sqrt(3) * 1e3 * NOISE
    search = Rounds(world, world, [base], lambda *_: None, Named())
    names, recall = [], search.kept.recall
    monkeypatch.setattr(search.kept, "recall", lambda wanted, go: names.extend(wanted) or recall(wanted, go))
    found = weigh(search, Floor(own, 0.02, own, own), SimpleNamespace(numerics_mm=MESH), ())
    refitted = sum(name.startswith("weighed-base-") for name in names)
    assert refitted >= 1
    assert len(search.fits) == 1 + refitted
    assert {fitted.active for fitted in search.fits} == {()}
    assert [f.cost for f in search.fits] == sorted(f.cost for f in search.fits)
    assert search.fits[0].cost == found.fits[()].cost
