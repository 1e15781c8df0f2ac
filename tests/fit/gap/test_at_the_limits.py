"""Figures exactly at a limit: `at least` and `at most` hold the limit itself."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.closure import BlockErrors
from fit.gap.evidence import is_at_bound
from fit.gap.gates import choose_frequency, convergence_gate, data_gates, numerics_gate, predictability_gate
from fit.methods import SI
from fit.search.intervals import NEAR_BOUND
from formats.findings import HARDLY_MOVED, SHORTEST_DIAGNOSED
from tests.fit.gap.test_gates import Chaotic, recorded
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis

ADVICE = {
    "length": "Record longer.", "motion": "Swing it wider.", "cloth motion": "Swing faster",
    "repeated frames": "Record with a tracker", "impossible points": "",
}  # fmt: skip


def moved_by(mm):
    """A take in which points go up and down by so many 1024ths of a metre, with noise of 3 of them rms."""
    take = recorded(own=0.0)
    take.point_sd = np.array([1.0, 2.0, 2.0]) / 1024
    take.points[:, :2, 2] = -0.25 + mm / 1024 * np.tile([1.0, -1.0], 5)[:9, None]
    take.points[8] = np.nan
    return take


def repeating(changes):
    """A take of so many changes from frame to frame, of which one is none."""
    take = recorded()
    take.points = np.arange(changes + 1.0)[:, None, None] * np.ones((1, 3, 3))
    take.points[changes] = take.points[changes - 1]
    held = np.tile(take.held(take.time)[:1], (changes + 1, 1))
    held[1:, [1, 4]] += 0.1
    take.time, take.held, take.valid = np.linspace(0, 4, changes + 1), lambda t: held, np.ones((changes + 1, 3), bool)
    take.seen_points = take.points
    return take


@pytest.mark.parametrize(
    ("name", "at", "beyond"),
    [
        ("length", recorded(seconds=SHORTEST_DIAGNOSED), recorded(seconds=SHORTEST_DIAGNOSED - 0.01)),
        ("motion", recorded(travel=HARDLY_MOVED), recorded(travel=HARDLY_MOVED - 1e-4)),
        ("cloth motion", moved_by(6.0), moved_by(5.99)),
        ("repeated frames", repeating(10), repeating(9)),
        ("impossible points", recorded(impossible=0.05), recorded(impossible=0.051)),
    ],
)
def test_a_take_exactly_at_a_limit_passes_without_advice(name, at, beyond):
    for take, passed in ((at, True), (beyond, False)):
        gate = next(gate for gate in data_gates([take], []) if gate.name == name)
        assert gate.passed == passed
        assert (gate.figure == gate.limit) == passed
        assert not ADVICE[name] or (ADVICE[name] in gate.sentence) != passed


def test_a_nudge_exactly_as_large_as_the_noise_is_allowed_and_a_fifth_of_it_forgotten(monkeypatch):
    observer = Chaotic(lambda hz: 0.0, 2.0)
    noise = predictability_gate(observer, SI.initial, observer.off).limit
    for share, passed in ((1.0, True), (1.001, False)):
        monkeypatch.setattr(Chaotic, "in_mm", lambda self, residuals, share=share: share * noise)
        assert predictability_gate(observer, SI.initial, observer.off).passed == passed
    for share, frequency in ((0.2, 0.0), (0.2001, 1.0)):
        monkeypatch.setattr(
            Chaotic, "in_mm", lambda self, moved, share=share: (share if self.frequency < 1.0 else 0.1) * noise
        )
        assert choose_frequency(observer, SI.initial)[0] == frequency


def test_fits_exactly_as_far_apart_as_allowed_and_a_mesh_that_closes_exactly_two_fifths_pass():
    """Costs of 1 and 2 are 100 % apart, and the root of what an effect makes of the cost, 1 / 4, allows 100 %."""
    observer = Chaotic(lambda hz: 0.0)
    fits = [dataclasses.replace(observer.fitted(), residual=np.array(row)) for row in ([1.0, 0.0], [1.0, 1.0])]
    gate = convergence_gate(fits, 0.25)
    assert gate.passed
    assert gate.figure == gate.limit == 100.0
    assert not convergence_gate(fits, 0.251).passed
    assert numerics_gate(0.4, 1.2, 1.5).passed


def squared(one, mm2):
    """The same hypothesis with exactly this mean squared error in every half-second."""
    return dataclasses.replace(one, errors=BlockErrors(np.full(4, 8.0 * mm2), np.full(4, 8.0), np.zeros(3)))


@pytest.mark.parametrize(
    ("name", "is_silhouette", "most"), [("time_offset", False, 5.0), ("air_lift", False, 60.0), ("hem", True, 50.0)]
)
def test_an_effect_that_leaves_exactly_what_a_cause_may_leave_explains_enough(name, is_silhouette, most):
    """Of 100 mm^2 without noise: a twentieth by its law, three fifths by any law, half of a silhouette's."""
    found = evidence_of({name: 6.0}, floor=0.0, floor_error=0.0)
    judge = SimpleNamespace(recordings=[SimpleNamespace(camera=SimpleNamespace(is_placed=is_silhouette))])
    found = dataclasses.replace(found, base=squared(found.base, 100.0), numerics_mm=0.0, judge=judge)
    for mm2, is_enough in ((most, True), (np.nextafter(most, 100), False)):
        assert found.explains_enough(squared(found.singles[name], mm2)) == is_enough


def test_an_error_exactly_as_large_as_the_noise_is_within_it():
    found = evidence_of({}, floor=4.0, floor_error=0.0)
    assert found.is_within_noise(squared(found.base, 16.0))
    assert not found.is_within_noise(squared(found.base, 16.5))


@pytest.mark.parametrize("end", [-1, 1])
def test_an_amplitude_exactly_a_hundredth_of_its_range_from_an_end_is_not_at_its_bound(end):
    slack, one = KINDS["clip_slack"], hypothesis(("clip_slack",), 6.0)
    reach = NEAR_BOUND * (slack.high - slack.low)
    limit = slack.high - reach if end > 0 else slack.low + reach
    observer = evidence_of({}).observer
    for amplitude, is_there in ((limit, False), (np.nextafter(limit, 100 * end), True)):
        one.fitted.amplitudes[observer.columns["clip_slack"]] = amplitude
        assert is_at_bound(observer, one) == is_there
