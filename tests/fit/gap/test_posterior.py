"""The search for subsets of effects, on linear takes of known truth with drawn noise, mesh error and effects."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gap.likelihood import Likelihood
from fit.gap.posterior import SCALES, UNKNOWN, Linear
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes, best_of


@pytest.fixture
def world():
    """Takes with noise and with an error of the mesh of half a millimetre."""
    made = LinearTakes()
    made.missed = made.noisy() + made.moved(1e-3 * MESH)
    return made


def test_nothing_is_named_nor_refitted_where_noise_and_mesh_are_all(world):
    search, asked = world.search()
    found = search.go()
    assert best_of(found) == ()
    assert asked == []
    known, wide = found.shares()[()]
    assert known > 0.8
    assert wide < UNKNOWN


def test_one_effect_is_named_for_little_more_than_one_refit(world):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, asked = world.search()
    found = search.go()
    assert best_of(found) == ("air_drag",)
    assert found.shares()[("air_drag",)][0] > 0.8
    assert len({one for one in asked if one}) <= 3
    size = found.fits[("air_drag",)].amplitudes[world.columns["air_drag"]][0] / world.library["air_drag"].typical
    assert size == pytest.approx(1.5, abs=0.15)


def test_two_effects_are_named_together(world):
    world.missed = world.missed - world.rows["air_drag"][0] - 0.8 * world.rows["hem"][0]
    search, asked = world.search()
    found = search.go()
    assert best_of(found) == ("air_drag", "hem")
    # The best set is fitted on, and the base model from where that ends, once.
    assert asked[-2:] == [("air_drag", "hem"), ()]
    assert asked.count(()) == 1
    assert found.shares()[("air_drag", "hem")][0] > 0.7


def test_twins_share_the_mass_and_are_never_named_together(world):
    world.missed = world.missed - 0.5 * world.rows["time_offset"][0]
    search, _ = world.search()
    found = search.go()
    assert frozenset(("filter_lag", "time_offset")) in found.twins
    assert not any({"filter_lag", "time_offset"} <= set(one) for one in found.mass.among)
    shares = found.shares()
    assert shares[("time_offset",)][0] + shares[("filter_lag",)][0] > 0.8


def test_a_cause_that_no_effect_imitates_is_a_wide_discrepancy(world):
    world.missed = world.missed + sum(world.moved(5e-3) for _ in range(4))
    search, _ = world.search()
    wide = sum(share for _, share in search.go().shares().values())
    assert wide > 0.8


def test_an_error_that_the_mesh_may_cause_is_no_evidence(world):
    """An effect's motion of a third of the mesh's error has no more evidence than the odds of an effect."""
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    world.missed = world.missed - 0.03 * world.rows["air_drag"][0]  # 0.18 mm, a third of MESH
    search, _ = world.search()
    base = search.about
    linear = Linear(world, Likelihood(world, noise, base.residual, SCALES), base, dict(world.rows))
    mass = linear.masses([(), ("air_drag",)], MESH)
    assert mass.total[1] < mass.total[0] - 2.0


def test_a_set_whose_refit_lowers_no_cost_is_refuted(world):
    """A secant promises that drag explains the residual, and no size of the effect does."""
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, asked = world.search()
    world.rows["air_drag"] = 0.0 * world.rows["air_drag"]
    found = search.go()
    assert ("air_drag",) in asked
    assert max(sum(found.shares().get(one, (0.0, 0.0))) for one in found.mass.among if "air_drag" in one) < 1e-9
    assert "air_drag" not in best_of(found)
