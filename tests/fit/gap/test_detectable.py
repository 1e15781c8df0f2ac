"""Sentences on undetectable amplitudes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.detectable import in_words, mesh_share, resolvable, smallest_detectable, unseen
from tests.fit.gap.verdict_scene import KINDS, evidence_of


def test_components_whose_typical_size_would_not_show_are_listed_the_nearest_to_it_first():
    smallest = {
        "gravity_tilt": np.array([0.056, 0.02]), "air_drag": np.array([1.3]), "hem": np.array([0.0099]),
        "draught": np.array([np.inf, np.inf]),
    }  # fmt: skip
    assert unseen(KINDS, smallest) == ["air drag below 1.3", "tilted gravity (x) below 3.2 degrees"]


def test_a_component_that_shows_exactly_from_its_typical_size_on_would_have_been_seen():
    typical = KINDS["air_drag"].typical
    assert unseen(KINDS, {"air_drag": np.array([typical])}) == []
    assert len(unseen(KINDS, {"air_drag": np.array([np.nextafter(typical, 9.0)])})) == 1


def test_sizes_have_their_units():
    assert (in_words(0.0561, "rad"), in_words(0.0123, "m"), in_words(1.25, "1")) == ("3.2 degrees", "0.012 m", "1.2")


@pytest.mark.parametrize(
    ("name", "numerics", "floor", "size"),
    [
        # 0.5 x 4^2 = 8 mm^2 of mesh and solver beside 0.2 x 5^2 = 5 of noise; 0.001 moves the points by 2 mm.
        ("air_drag", 4.0, 5.0, np.sqrt(8.0) * 0.0005),
        ("air_drag", 3.0, 5.0, np.sqrt(5.0) * 0.0005),
        ("anisotropy", 4.0, 5.0, np.sqrt(48.0) * 0.0005),
    ],
)
def test_an_effect_moves_the_points_by_as_much_as_the_verdict_asks_for(name, numerics, floor, size):
    evidence = evidence_of({name: 6.0}, floor=floor)
    object.__setattr__(evidence, "numerics_mm", numerics)
    assert resolvable(evidence, name) == pytest.approx(size)
    assert mesh_share(KINDS[name]) == (3.0 if name == "anisotropy" else 0.5)


def test_a_component_shows_from_what_noise_and_rules_ask_for_or_from_what_the_edge_shows(monkeypatch):
    """Beside the residual of the model that costs least, of the base model and those with one effect."""
    evidence = evidence_of({"air_drag": 6.0, "hem": 7.0, "clip_slack": 8.0})
    costs = {"": 9.0, "air_drag": 5.0, "hem": 4.0, "clip_slack": 7.0}
    given = {
        name: dataclasses.replace(h, fitted=dataclasses.replace(h.fitted, residual=np.array([cost, 0.0, 0.0])))
        for (name, cost), h in zip(costs.items(), [evidence.base, *evidence.singles.values()], strict=True)
    }
    evidence = dataclasses.replace(evidence, base=given.pop(""), singles=given)
    asked, of = [], []
    monkeypatch.setattr(
        "fit.gap.screening.Signature.minimum_detectable",
        lambda self, left, block, correlation: asked.append(left[0]) or np.array([0.2, 0.02]),
    )
    monkeypatch.setattr(
        "fit.gap.detectable.correlation_of", lambda observer, residual: of.append(residual[0]) or np.eye(1)
    )
    monkeypatch.setattr("fit.gap.detectable.resolvable", lambda given, name: 0.1 if given is evidence else np.nan)
    edges = {"air_drag": np.inf, "hem": 0.15, "clip_slack": 0.01}
    monkeypatch.setattr("fit.gap.detectable.detectable_on_edge", lambda observer, judge, screened: edges)
    found = smallest_detectable(evidence)
    assert (asked, of) == ([4.0] * 3, [4.0])
    assert {name: size.tolist() for name, size in found.items()} == {
        "air_drag": [0.2, 0.1], "hem": [0.15, 0.1], "clip_slack": [0.01, 0.01]
    }  # fmt: skip
