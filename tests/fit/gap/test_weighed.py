"""The verdict by masses, on made-up figures that allow hand calculation of each line of the table."""

from __future__ import annotations

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from fit.errors import FitError
from fit.gap.diagnosis import deciding
from fit.gap.posterior import Found, Mass
from fit.gap.weighed import decide_by_mass, inclusion, weigh
from formats.diagnosis_records import Gate
from tests.fit.gap.verdict_scene import CHAOTIC, COARSE, evidence_of, with_edge


def found_of(shares, twins=()):
    """Masses of subsets, {names: (known, wide)}, all of them fitted."""
    among = list(shares)
    known, wide = (np.array([np.log(max(shares[one][k], 1e-12)) for one in among]) for k in (0, 1))
    return Found(dict.fromkeys(among), Mass(among, known, wide, known), set(twins))


def test_most_of_the_mass_without_an_effect_is_none():
    verdict = decide_by_mass(evidence_of({}, base=5.2), found_of({(): (0.9, 0.02), ("air_drag",): (0.08, 0.0)}))
    assert verdict.verdict == "none"


def test_most_of_the_mass_on_one_effect_names_it_and_says_how_sure_that_is():
    evidence = evidence_of({"air_drag": 5.5, "hem": 11.0})
    sure = found_of({(): (0.02, 0.03), ("air_drag",): (0.9, 0.0), ("hem",): (0.05, 0.0)})
    verdict = decide_by_mass(evidence, sure)
    assert (verdict.verdict, verdict.named) == ("effect", ["air_drag"])
    assert verdict.sentence.startswith("The model lacks air drag")
    unsure = found_of({(): (0.2, 0.1), ("air_drag",): (0.65, 0.0), ("hem",): (0.05, 0.0)})
    assert decide_by_mass(evidence, unsure).sentence.startswith("The model probably lacks air drag")


def test_a_pair_that_was_fitted_before_its_effects_were_known_as_twins_has_no_mass():
    shares = {(): (0.02, 0.03), ("air_drag",): (0.7, 0.0), ("hem",): (0.25, 0.0)}
    found = found_of(shares)
    found.fits = {("air_drag", "hem"): None, **found.fits}
    verdict = decide_by_mass(evidence_of({"air_drag": 5.5, "hem": 5.6}), found)
    assert verdict.named == ["air_drag", "hem"]
    assert verdict.verdict == "ambiguous"


def test_an_effect_that_holds_a_tenth_beside_the_best_is_named_with_it():
    evidence = evidence_of({"time_offset": 5.5, "filter_lag": 5.6, "hem": 11.0})
    shares = {(): (0.01, 0.0), ("time_offset",): (0.7, 0.0), ("filter_lag",): (0.25, 0.0), ("hem",): (0.04, 0.0)}
    verdict = decide_by_mass(evidence, found_of(shares))
    assert (verdict.verdict, verdict.named) == ("ambiguous", ["time_offset", "filter_lag"])


def test_of_two_causes_each_is_listed_with_its_alternatives():
    evidence = evidence_of({"time_offset": 9.0, "air_drag": 8.0}, joint=[(("air_drag", "time_offset"), 5.4)])
    shares = {
        (): (0.01, 0.0), ("air_drag",): (0.05, 0.0), ("air_drag", "time_offset"): (0.6, 0.0),
        ("air_drag", "filter_lag"): (0.3, 0.0), ("hem", "time_offset"): (0.04, 0.0),
    }  # fmt: skip
    verdict = decide_by_mass(evidence, found_of(shares))
    assert (verdict.verdict, verdict.named) == ("several", ["air_drag", "time_offset"])
    assert verdict.alternatives == {"time_offset": ["filter_lag"]}
    assert "(or " in verdict.sentence


def test_a_wide_discrepancy_is_unknown_whatever_subset_it_is_of():
    evidence = evidence_of({"air_drag": 8.0})
    shares = {(): (0.0, 0.5), ("air_drag",): (0.2, 0.3)}
    assert decide_by_mass(evidence, found_of(shares)).verdict == "unknown"
    assert inclusion(found_of(shares))["air_drag"] == pytest.approx(0.2)


def test_masses_that_pass_one_by_rounding_are_one():
    shares = {("air_drag",): (0.7, 0.0), ("air_drag", "hem"): (0.3 + 1e-12, 0.0)}
    assert inclusion(SimpleNamespace(shares=lambda: shares))["air_drag"] == 1.0


def test_an_effect_that_closes_little_on_other_motion_is_no_cause():
    verdict = decide_by_mass(evidence_of({"air_drag": 11.0}), found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)}))
    assert (verdict.verdict, verdict.named) == ("unknown", [])
    assert "on the held-out motion 19 % of the gap closes." in verdict.sentence
    judged_on_the_same = dataclasses.replace(evidence_of({"air_drag": 11.0}), is_held_out=False)
    said = decide_by_mass(judged_on_the_same, found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})).sentence
    assert said.endswith(" Air drag would close 19 % of the gap.")
    assert "on the held-out motion" not in said


def test_an_effect_whose_size_may_be_nothing_is_not_named():
    shares = found_of({(): (0.05, 0.0), ("air_drag",): (0.95, 0.0)})
    verdict = decide_by_mass(evidence_of({"air_drag": 5.5}, sizes=0.01), shares)
    assert (verdict.verdict, verdict.named) == ("unknown", [])
    assert "The likeliest is air drag (" in verdict.sentence
    assert "its size may be nothing" in verdict.sentence
    assert verdict.sentence.startswith("There is a gap, and no effect in the library explains it for sure. ")
    # Where the base model is within the noise as well, there is no gap to explain.
    assert decide_by_mass(evidence_of({"air_drag": 5.0}, base=5.2, sizes=0.01), shares).verdict == "none"


def test_the_likeliest_pair_whose_sizes_may_be_zero_is_reported_with_both():
    evidence = evidence_of({}, joint=[(("air_drag", "hem"), 5.4)], sizes=0.01)
    ((pair, p_value),) = evidence.joint
    weak = dataclasses.replace(pair.fitted, amplitudes=0.01 * pair.fitted.amplitudes)
    evidence = dataclasses.replace(evidence, joint=[(dataclasses.replace(pair, fitted=weak), p_value)])
    verdict = decide_by_mass(evidence, found_of({(): (0.05, 0.0), ("air_drag", "hem"): (0.95, 0.0)}))
    assert (verdict.verdict, verdict.named) == ("unknown", [])
    assert re.search(r"The likeliest is air drag \([^()]*\), a heavier hem \([^()]*\), and", verdict.sentence)


def test_where_one_of_two_sizes_may_be_nothing_the_other_effect_is_named_alone():
    evidence = evidence_of({"air_drag": 5.6, "hem": 11.0}, joint=[(("air_drag", "hem"), 5.4)])
    ((pair, p_value),) = evidence.joint
    sizes = pair.fitted.amplitudes.copy()
    sizes[evidence.observer.columns["hem"]] *= 0.01
    weak = dataclasses.replace(pair, fitted=dataclasses.replace(pair.fitted, amplitudes=sizes))
    shares = found_of({(): (0.02, 0.0), ("air_drag", "hem"): (0.6, 0.0), ("air_drag",): (0.35, 0.0)})
    named = decide_by_mass(dataclasses.replace(evidence, joint=[(weak, p_value)]), shares)
    assert (named.verdict, named.named) == ("effect", ["air_drag"])
    assert decide_by_mass(evidence, shares).named == ["air_drag", "hem"]


def test_gates_come_first():
    shares = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    assert decide_by_mass(evidence_of({"air_drag": 5.5}, gate_list=[CHAOTIC]), shares).verdict == "inconclusive"
    # The finer mesh closes 60 % of the gap, the effect 97 or 50 %.
    coarse = evidence_of({"air_drag": 5.5}, gate_list=[COARSE])
    assert decide_by_mass(coarse, shares).verdict == "effect"
    weaker = dataclasses.replace(coarse, singles=evidence_of({"air_drag": 9.2}).singles)
    assert decide_by_mass(weaker, shares).verdict == "numerics"
    # The closure of an effect whose size may be nothing does not count against the mesh.
    unsure = evidence_of({"air_drag": 5.5}, gate_list=[COARSE], sizes=0.01)
    assert decide_by_mass(unsure, shares).verdict == "numerics"


@pytest.mark.parametrize(("base", "verdict"), [(4.5, "none"), (8.0, "unknown"), (10.5, "unknown")])
def test_most_of_the_mass_without_an_effect_is_none_only_where_noise_mesh_and_solver_leave_as_much(base, verdict):
    """Noise leaves 5 mm and the mesh 1 mm: 26 mm^2. An error of 4.5 mm has 20, one of 8 mm 64. The held edge is off."""
    evidence = evidence_of({}, base=base)
    off = dataclasses.replace(evidence, base=with_edge(evidence.base, 9000))
    decided = decide_by_mass(off, found_of({(): (0.9, 0.02), ("air_drag",): (0.08, 0.0)}))
    assert (decided.verdict, decided.named) == (verdict, [])
    assert "may be wrong by" not in decided.sentence
    assert decided.sentence.startswith("There is a gap that no effect" if verdict == "unknown" else "No gap")


MISSES = "The base model misses by 12.0 mm on motion not used for fitting; the sensor's noise alone is 5.0 mm."


SAID = [
    (
        "ambiguous", evidence_of({"time_offset": 5.5, "filter_lag": 5.6, "hem": 11.0}),
        {(): (0.01, 0.0), ("time_offset",): (0.6, 0.0), ("hem",): (0.14, 0.0), ("filter_lag",): (0.25, 0.0)},
        "A time offset between markers and points (probability 60 %) or a tracker that lags (probability 25 %) or a "
        f"heavier hem (probability 14 %): these takes cannot tell them apart. {MISSES}",
    ),
    (
        "several", evidence_of({"time_offset": 9.0, "air_drag": 8.0}, joint=[(("air_drag", "time_offset"), 5.4)]),
        {
            (): (0.01, 0.0), ("air_drag",): (0.05, 0.0), ("air_drag", "time_offset"): (0.6, 0.0),
            ("air_drag", "filter_lag"): (0.3, 0.0), ("hem", "time_offset"): (0.04, 0.0),
        },
        "The model lacks air drag and a time offset between markers and points (or a tracker that lags: these takes "
        f"cannot tell), each with a probability of at least 94 %. {MISSES} With them (1.2 [0.979 to 1.42], "
        "0.02 s [0.0183 to 0.0217]) it misses by 5.4 mm: 97 % of the gap is closed [94 to 99 %]. The "
        "remaining error is within the noise.",
    ),
    (
        "unknown", evidence_of({}, joint=[(("air_drag", "time_offset"), 11.2)]),
        {(): (0.1, 0.0), ("air_drag", "time_offset"): (0.9, 0.0)},
        f"There is a gap that no effect in the library explains. {MISSES} On the fitted motion air drag and a time "
        "offset between markers and points would close the gap; on the held-out motion 16 % of the gap closes.",
    ),
    (
        "unknown", evidence_of({"air_drag": 5.5}),
        {(): (0.0, 0.9), ("air_drag",): (0.1, 0.0)},
        f"There is a gap that no effect in the library explains. {MISSES}",
    ),
    (
        "effect", evidence_of({"air_drag": 5.5}),
        {(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)},
        f"The model lacks air drag, with a probability of 90 %. {MISSES} With it (1.2 [0.979 to 1.42]) "
        "it misses by 5.5 mm: 96 % of the gap is closed [94 to 98 %].",
    ),
    (
        "inconclusive", evidence_of({"air_drag": 5.5}, gate_list=[CHAOTIC]),
        {(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)},
        f"No diagnosis: chaotic {MISSES}",
    ),
    (
        "numerics", evidence_of({"air_drag": 9.2}, gate_list=[COARSE]), {(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)},
        f"Refine first: coarse {MISSES}",
    ),
    (
        "none", evidence_of({"air_drag": 5.5}), {(): (0.9, 0.0), ("air_drag",): (0.1, 0.0)},
        f"No gap: the base model explains the motion down to noise and mesh. {MISSES} Mesh and solver may be wrong by "
        "1.0 mm.",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("verdict", "evidence", "shares", "sentence"), SAID)
def test_a_verdict_by_masses_says(verdict, evidence, shares, sentence):
    found = decide_by_mass(evidence, found_of(shares))
    assert (found.verdict, found.sentence) == (verdict, sentence)
    assert found.named == [] or verdict in {"effect", "ambiguous", "several"}


def test_a_base_fit_whose_starts_disagree_stops_no_verdict_by_masses():
    loose = Gate(name="base fit", passed=False, figure=9.0, limit=5.0, unit="%", sentence="loose")
    shares = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    assert decide_by_mass(evidence_of({"air_drag": 5.5}, gate_list=[loose]), shares).verdict == "effect"


@pytest.mark.parametrize(("other", "verdict"), [(0.076, "effect"), (0.079, "ambiguous")])
def test_an_alternative_of_the_best_is_what_holds_a_tenth_of_both(other, verdict):
    """A ninth of 0.7 is 0.0778; a pair is in the place of no single effect, however much it holds."""
    evidence = evidence_of({"time_offset": 5.5, "filter_lag": 5.6})
    shares = {("time_offset",): (0.7, 0.0), ("filter_lag",): (other, 0.0), ("filter_lag", "hem"): (0.1, 0.0)}
    found = decide_by_mass(evidence, found_of({(): (0.3 - other - 0.1, 0.0), **shares}))
    assert (found.verdict, found.named[0]) == (verdict, "time_offset")


def test_a_cause_of_two_is_as_sure_as_the_mass_that_it_and_its_twin_hold():
    """Drag and either delay hold 0.45 and 0.36, together 0.81; nearly all holds a drag."""
    evidence = evidence_of({"air_drag": 8.0}, joint=[(("air_drag", "time_offset"), 5.4)])
    pairs = {("air_drag", "time_offset"): (0.45, 0.0), ("air_drag", "filter_lag"): (0.36, 0.0)}
    for rest in {("air_drag",): (0.19, 0.0)}, {(): (0.0, 0.19)}:
        said = decide_by_mass(evidence, found_of({(): (0.0, 0.0), **pairs, **rest})).sentence
        assert said.startswith("The model lacks air drag and a time offset")
    pairs["air_drag", "filter_lag"] = (0.33, 0.0)
    said = decide_by_mass(evidence, found_of({**pairs, (): (0.0, 0.22)})).sentence
    assert said.startswith("The model probably lacks air drag and a time offset")


@pytest.mark.parametrize(("more", "verdict"), [(0.01, "numerics"), (-0.3, "effect")])
def test_a_finer_mesh_that_closes_as_much_as_the_effect_comes_first(more, verdict):
    """Drag closes (144 - 6^2) / (144 - 5^2) of the gap, 90.8 %."""
    coarse = COARSE.__class__(
        name="mesh and step", passed=False, figure=100 * 108 / 119 + more, limit=40.0, unit="%", sentence="coarse"
    )
    shares = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    assert decide_by_mass(evidence_of({"air_drag": 6.0}, gate_list=[coarse]), shares).verdict == verdict


@pytest.mark.parametrize(("share", "words"), [(0.79, "probably lacks"), (0.81, "The model lacks"), (0.49, "may lack")])
def test_a_cause_is_named_as_surely_as_its_mass(share, words):
    """Most of what is left is no other subset that is larger."""
    rest = (1 - share) / 3
    masses = {(): (rest, 0.0), ("air_drag",): (share, 0.0), ("hem",): (0.0, rest), ("draught",): (0.0, rest)}
    said = decide_by_mass(evidence_of({"air_drag": 5.5, "hem": 11.0}), found_of(masses)).sentence
    assert words in said


def test_an_unknown_decision_is_refused_with_the_known_ones():
    assert deciding("evidence") == "evidence"
    with pytest.raises(FitError, match="tea leaves is no way to decide") as refused:
        deciding("tea leaves")
    assert str(refused.value) == "--by: tea leaves is no way to decide; choose one of: rules, evidence"
    with pytest.raises(FitError, match="--by: rule is no way to decide; did you mean rules"):
        deciding("rule")


def test_effects_that_are_not_there_yet_are_screened_again_and_fits_are_told_by_their_number_of_effects(monkeypatch):
    base, hem, pair = (SimpleNamespace(active=names, residual=None) for names in ((), ("hem",), ("air_drag", "hem")))
    screened = []

    class Searched:
        def __init__(self, *given):
            self.renew = given[-1]

        def go(self, tell):
            self.renew(hem)
            return SimpleNamespace(fits={one.active: one for one in (base, hem, pair)}, mass=None)

    def screen(observer, about, names, before=None):
        screened.append((about, list(names)))
        return {}

    for name, value in (
        ("Search", Searched), ("screen", screen), ("measured_noise", lambda *given: None),
        ("known_error_mm", lambda *given: 0.0),
        ("judged", lambda judge, fits: [SimpleNamespace(effects=one.active) for one in fits]),
    ):  # fmt: skip
        monkeypatch.setattr(f"fit.gap.weighed.{name}", value)
    tested = ["air_drag", "hem", "time_offset"]
    rounds = SimpleNamespace(
        observer=None, base=SimpleNamespace(fitted=base), tested=tested, judge=None, refit_alone=lambda names: None,
        keep_the_better=lambda: None,
    )  # fmt: skip
    weigh(rounds, None, None, ())
    assert screened == [(base, tested), (hem, ["air_drag", "time_offset"])]
    assert list(rounds.singles) == ["hem"]
    assert [(one.effects, p_value) for one, p_value in rounds.joint] == [(("air_drag", "hem"), 0.0)]
