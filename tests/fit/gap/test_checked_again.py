"""What a diagnosis measures again because a round has found another base fit or other amplitudes."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from fit.gap import diagnosis as steps
from fit.recordings.ready import ready
from tests.fit.gap.test_diagnosis_parts import a_take


class MeshReachedError(Exception):
    """Raised where the mesh has been judged, behind all that is measured here."""


def fit_of(name):
    return SimpleNamespace(
        errors=SimpleNamespace(edge=None, of=name),
        fitted=SimpleNamespace(vector=f"vector of {name}", amplitudes=name, cost=1.0),
    )


def measured_again(monkeypatch, by, base="first", least="first"):
    """What was refined and where noise and resampling were measured, if a round ends at this base and least fit."""
    fits = {name: fit_of(name) for name in ("first", "other")}
    refined, floors, resampled, judged = [], [], [], []
    observer = SimpleNamespace(off="off")
    observer.of = lambda test: observer
    gates = SimpleNamespace(passed=True)
    first = fits["first"].fitted
    search = SimpleNamespace(base=fits["first"], least=first, least_chosen=first, fits=[])

    def end_round(*given, **more):
        search.base, search.least, search.least_chosen = fits[base], fits[base].fitted, fits[least].fitted

    search.first_round, search.sizes_by_edge = end_round, lambda mm: None
    search.predictability = lambda: gates
    patches = {
        "Observer": lambda *given, **more: observer,
        "_key": lambda *given: {},
        "fit_base": lambda *given: ([], observer, gates),
        "Rounds": lambda *given: search,
        "noise_floor": lambda judge, vector, amplitudes, rng: (
            floors.append((vector, amplitudes)) or SimpleNamespace(mm=2.0)
        ),
        "resample": lambda errors, rng: resampled.append(errors),
        "exceeds": lambda *given: True,
        "is_edge_explained": lambda edge: True,
        "refine": lambda observer, judge, fit: (
            refined.append(fit) or SimpleNamespace(errors=fit, numerics_mm=0.5, ratio=1.5)
        ),
        "weigh": end_round,
        "closure": lambda coarse, fine, mm: judged.append((coarse, fine, mm)) or (0.1, 0.0, 0.2),
    }
    for name, value in patches.items():
        monkeypatch.setattr(steps, name, value)

    def numerics_gate(*given):
        raise MeshReachedError

    monkeypatch.setattr(steps.gate, "convergence_gate", lambda *given: gates)
    monkeypatch.setattr(steps.gate, "numerics_gate", numerics_gate)
    take = a_take()
    with pytest.raises(MeshReachedError):
        steps.diagnose([take], [], prepared=ready([take], []), by=by)
    assert judged == [(fits[base].errors, fits[base].fitted, 2.0)]
    assert [fits["first"].errors, fits[base].errors][: len(resampled)] == resampled
    named = {fits[name].fitted.vector: name for name in fits}
    return (
        [named[fit.vector] for fit in refined],
        [(named[vector], amplitudes) for vector, amplitudes in floors],
        len(resampled),
    )


@pytest.mark.parametrize("base", ["first", "other"])
def test_the_mesh_is_judged_at_the_base_fit_of_the_last_round(monkeypatch, base):
    """By evidence it was judged before the round already, which holds unless the base fit is another one then."""
    assert measured_again(monkeypatch, "rules", base=base)[0] == [base]
    assert measured_again(monkeypatch, "evidence", base=base)[0] == list(dict.fromkeys(["first", base]))


@pytest.mark.parametrize("by", ["rules", "evidence"])
def test_noise_is_measured_at_the_least_fit_and_errors_are_resampled_at_the_base_fit(monkeypatch, by):
    at_first = ("first", "off")
    assert measured_again(monkeypatch, by)[1:] == ([at_first], 1)
    assert measured_again(monkeypatch, by, base="other")[1:] == ([at_first], 2)
    assert measured_again(monkeypatch, by, least="other")[1:] == ([at_first, ("other", "other")], 1)
