"""Hand-made answers to blind cases."""

from __future__ import annotations

from fit.blind.foreign.engines import OWN_GENERATOR
from fit.blind.judging import PLANTED_UNITS
from fit.blind.making import open_labels
from formats.diagnosis_records import Cost, Diagnosis, EffectFinding, Figure, Gap, Where, WhereBin
from formats.results import save_diagnosis

COARSE = 0.1  # m of a triangle: a case in half a second
NUMBERS = {"single": 2, "null": 1, "pair": 1, "unknown": 1}
PLANTED = OWN_GENERATOR.plants(["hem", "time_offset"])


def finding(name, amplitude=1.0, least=1.0, closure=0.5, **changes):
    low, high = sorted([0.9 * amplitude, 1.1 * amplitude])
    return EffectFinding(**{
        "id": name, "group": name, "tested": True, "amplitude": amplitude, "unit": PLANTED_UNITS.get(name, "1"),
        "minimum_detectable": least, "closure": Figure(value=closure), "amplitude_interval": (low, high), **changes,
    })  # fmt: skip


def diagnosis(verdict, named=(), effects=(), region="bottom left"):
    return Diagnosis(
        format="hangtime-diagnosis/1", created="2000-01-01T00:00:00Z", take_ids=["a"], held_out_ids=[], verdict=verdict,
        sentence="", named=list(named), gap=Gap(base_mm=Figure(value=5.0), floor_mm=Figure(value=1.0)),
        effects=list(effects), where=Where(
            space=[WhereBin(name=region, value_mm=1.0, share=1.0)], vertices=[], time=[], frequency=[], term=[]
        ), missing_force=None, next_experiment=None, gates=[], cost=Cost(simulations=1, seconds=1.0),
        base_parameters=[], notes=[],
    )  # fmt: skip


def answer_rightly(folder, answers):
    """Answers that know the truth, with amplitudes 20 % too large."""
    for truth in open_labels(folder).truths:
        known = [p for p in truth.planted if p.in_library]
        findings = [finding(p.id, 1.2 * p.amplitude, p.amplitude / 3) for p in known]
        verdict = {"null": "none", "single": "effect", "pair": "several", "unknown": "unknown"}[truth.kind]
        region = known[0].place[0] if known and known[0].place else "top left"
        save_diagnosis(answers / truth.id / "diagnosis.json",
                       diagnosis(verdict, [p.id for p in known], findings, region))  # fmt: skip
