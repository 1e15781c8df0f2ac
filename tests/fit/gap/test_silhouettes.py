"""Verdicts on silhouettes: closure from raw points, remaining camera faults, and parameters at their bounds."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from fit.gap.evidence import is_shown_by_edge
from fit.gap.findings import at_bounds, base_parameters
from fit.gap.from_raw import sentence, with_raw
from fit.gap.verdict import decide
from fit.methods import SI
from formats.fit_records import verdict_on
from tests.fit.gap.verdict_scene import EFFECTS, evidence_of, hypothesis, with_edge
from tests.formats.test_results import diagnosis


def test_a_parameter_at_its_bound_has_its_whole_range_and_is_named():
    stopped = SI.parameters[0]
    fitted = dataclasses.replace(hypothesis((), 5.0).fitted, vector=np.array([stopped.minimum, *SI.initial[1:]]))
    first, second, *_ = base_parameters(SI, [fitted])
    assert (first.interval_low, first.interval_high) == (stopped.minimum, stopped.maximum)
    assert not first.is_identified
    assert first.is_at_bound
    assert verdict_on(first) == "not identified, at its bound"
    assert (first.note, second.is_at_bound) == (stopped.meaning, False)
    assert second.interval_high < SI.parameters[1].maximum
    assert at_bounds(SI, fitted) == (
        " In the base fit, stretch stiffness (range from 30 N/m) is at its bound. The takes identify no value of a "
        "parameter at its bound."
    )
    assert at_bounds(SI, hypothesis((), 5.0).fitted) == ""


def test_the_improvement_from_the_raw_points_is_stated_with_its_share():
    """1600 - 144 of 1600 - 25 mm^2 are 92 %."""
    gap = diagnosis().gap
    given = replace(gap, base_mm=replace(gap.base_mm, value=12.0), floor_mm=replace(gap.floor_mm, value=5.0))
    whole = with_raw(replace(given, with_effect_mm=None), 40.0)
    assert whole.closure_from_raw == pytest.approx(1456 / 1575)
    assert "misses by 40.0 mm, to 12.0 mm 92 % of the gap is closed." in sentence(whole)
    assert sentence(given) == ""
    assert with_raw(given, None) is given
    assert with_raw(replace(given, with_effect_mm=None, base_mm=replace(gap.base_mm, value=2.3)), 40.0) == replace(
        given, with_effect_mm=None, base_mm=replace(gap.base_mm, value=2.3), raw_mm=40.0, closure_from_raw=1.0
    )
    assert sentence(with_raw(given, 5.01)) == ""  # no gap to begin with: a share of it would be of nothing


def test_of_a_silhouette_a_cause_is_named_that_leaves_less_than_half_and_the_rest_is_said():
    """144 - 64 of 144 - 25 mm^2 are 67 %; of markers such a rest is more than a true cause leaves."""
    markers, silhouette = evidence_of({"air_drag": 8.0}), evidence_of({"air_drag": 8.0})
    silhouette.judge.recordings.append(SimpleNamespace(camera=SimpleNamespace(is_placed=True)))
    assert decide(markers).verdict == "unknown"
    found = decide(silhouette)
    assert (found.verdict, found.named) == ("effect", ["air_drag"])
    assert "The rest, 33 %, no effect explains" in found.sentence
    little = evidence_of({"air_drag": 9.5})
    little.judge.recordings.append(SimpleNamespace(camera=SimpleNamespace(is_placed=True)))
    assert decide(little).verdict == "unknown"


def test_the_held_row_of_silhouettes_names_nothing_by_itself():
    """Without the effect the edge is off by 9000 squared deviations of 1000, with it by none beyond noise."""
    edges = with_edge(hypothesis((), 12.0), 9000.0), with_edge(hypothesis(("frame_timing",), 11.9), 1000.0)
    observer = SimpleNamespace(**EFFECTS | {"recordings": []})
    assert is_shown_by_edge(observer, edges[0], *edges)
    observer.recordings.append(SimpleNamespace(camera=SimpleNamespace(is_placed=True)))
    assert not is_shown_by_edge(observer, edges[0], *edges)
