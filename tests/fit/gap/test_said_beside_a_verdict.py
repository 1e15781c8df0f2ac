"""What a verdict says beside its effects: why the held edge names none, and what these takes could not have shown."""

from __future__ import annotations

import csv
import dataclasses
import io

import msgspec
import numpy as np
import pytest

from fit.api.results import DiagnosisOutcome
from fit.api.shown import effect_table
from fit.gap import power
from fit.gap.edge_words import describe_held_edge, edge_lacks
from fit.gap.power import hidden_beside
from fit.report.answer import candidates_of
from tests.fit.gap.linear_cloth import World, diagnosed, three_takes
from tests.fit.gap.test_edge_verdict import told
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis, with_edge
from tests.fit.report.report_scene import diagnosis


def of_slack(evidence, **changes):
    """The same evidence with another refit of slack clips, whose edge stays."""
    (slack,) = evidence.singles.values()
    other = hypothesis(("clip_slack",), changes.pop("mm", 11.9), **changes)
    errors = dataclasses.replace(other.errors, edge=slack.errors.edge)
    return dataclasses.replace(evidence, singles={"clip_slack": dataclasses.replace(other, errors=errors)})


def of_drag():
    """Drag that puts the edge right, as no air does."""
    evidence = evidence_of({"air_drag": 11.9})
    drag = with_edge(evidence.singles["air_drag"], 900, 2.0)
    return dataclasses.replace(evidence, base=with_edge(evidence.base, 900, 100.0), singles={"air_drag": drag})


@pytest.mark.parametrize(
    ("evidence", "effect", "said"),
    [
        (told(11.9), "clip_slack", "another effect puts the edge nearer"),
        (of_drag(), "air_drag", "the effect itself moves no held edge"),
        (told(14.0), "clip_slack", "the cloth is surely farther off with it"),
        (of_slack(told(11.9), sizes=1e6), "clip_slack", "its size is at its bound"),
        (told(11.9, before=(900, 20.0)), "clip_slack", "the edge does not surely show it"),
        (
            of_slack(told(11.9), deviation=0.7), "clip_slack",
            "its size may be 0, as far as noise, mesh and solver can tell",
        ),
    ],
)  # fmt: skip
def test_an_effect_that_the_edge_alone_shows_is_unnamed_for_a_reason(evidence, effect, said):
    assert edge_lacks(evidence, effect) == [said]


def test_an_effect_that_the_edge_contradicts_is_unnamed_for_that():
    evidence = told(11.9)
    evidence.__dict__["contradicted"] = frozenset({"clip_slack"})
    (said,) = edge_lacks(evidence, "clip_slack")
    assert said.startswith("the edge lies nearer without it, or with an effect that closes nearly as much")


def test_the_sentence_on_the_edge_ends_with_the_reasons():
    evidence = of_slack(told(14.0), mm=14.0, deviation=0.7)
    assert describe_held_edge(evidence).endswith(
        "but the evidence is too weak to name it: the cloth is surely farther off with it and its size may be 0, as "
        "far as noise, mesh and solver can tell."
    )


def test_effects_without_power_are_told_beside_a_named_one(monkeypatch):
    sizes = {"air_drag": [9.0], "hem": [0.02], "gravity_tilt": [0.001, 0.001], "draught": [np.inf, 0.9]}
    monkeypatch.setattr(power, "smallest_detectable", lambda evidence: {k: np.array(v) for k, v in sizes.items()})
    evidence = evidence_of({"air_drag": 6.0})
    hem, draught = (KINDS[name] for name in ("hem", "draught"))
    assert hem.typical < 0.02
    assert draught.typical < 0.9
    (said,) = hidden_beside(evidence, ["air_drag"])
    assert f"{hem.title} below 0.02 kg/m" in said
    assert f"{draught.title} ({draught.components[1]}) below 0.9" in said
    assert "air drag" not in said
    assert said.endswith(". So these may be missing too.")
    assert hidden_beside(evidence, []) == []
    assert hidden_beside(evidence, list(sizes)) == []


def test_a_diagnosis_that_names_an_effect_notes_what_its_takes_could_not_have_shown(monkeypatch):
    asked = []
    monkeypatch.setattr("fit.gap.diagnosis.hidden_beside", lambda evidence, named: asked.append(named) or ["a note"])
    world = World()
    found = diagnosed(*three_takes(world, {"air_drag": 1.5}), world).diagnosis
    assert found.named == ["air_drag"]
    assert asked == [{"air_drag"}]
    assert "a note" in found.notes


@pytest.mark.parametrize(("by", "is_told"), [("rules", False), ("evidence", True)])
def test_without_a_gap_no_effect_has_a_share_of_the_draws_as_its_cause(by, is_told):
    effects = [msgspec.structs.replace(one, closure=None) for one in diagnosis().effects]
    found = diagnosis(verdict="none", named=[], effects=effects, options={"--by": by})
    chances = {row[0]: row[1] for row in effect_table(found).rows}
    assert chances["air_drag"] == ("94 %" if is_told else "")
    assert candidates_of(found) == (["air_drag"] if is_told else [])
    rows = {row["effect"]: row for row in csv.DictReader(io.StringIO(DiagnosisOutcome(result=found).to_csv()))}
    assert rows["air_drag"]["probability"] == ("0.94" if is_told else "")
    with_a_gap = diagnosis(verdict="unknown", named=[])
    assert with_a_gap.ranked is with_a_gap.effects
    assert diagnosis(effects=effects).ranked == effects
