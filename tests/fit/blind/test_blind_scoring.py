"""Scoring of answers: every rate on hand-made answers, baselines, the report."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from fit.blind.cases import Look
from fit.blind.classifier import RIDGE, leave_one_out
from fit.blind.engine import Cloth
from fit.blind.judging import BINS, Judged, bin_of, conditions_of, judge
from fit.blind.making import open_labels, read_manifest
from fit.blind.page import check_page_name, figure, write_page
from fit.blind.plants import PLANTS
from fit.blind.rates import brier, rate_of, wilson
from fit.blind.scoring import ANSWERS_HASHES, LOOKS_FILE, SCORE, rates_of, score_set, summarise
from fit.errors import FitError
from formats.diagnosis_records import Cost
from formats.results import save_diagnosis
from tests.fit.blind.blind_answers import answer_rightly, diagnosis, finding
from tests.fit.here import hangtime_here


def test_right_answers_get_full_marks(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    score = score_set(a_set, tmp_path)
    assert (score.overall.right_first.k, score.overall.right_first.n) == (2, 2)
    assert (score.overall.false_alarms.k, score.overall.false_alarms.n) == (0, 1)
    assert score.overall.said_unknown.k == 1
    assert score.overall.pair_both_named.k == 1
    assert score.overall.confident_and_wrong.k == 0
    assert score.overall.amplitude_error == pytest.approx(0.2)
    assert score.overall.amplitude_covered.k == 0  # 1.2 a within 10 % does not reach a
    assert score.overall.closure_against_oracle == pytest.approx(1.0)
    assert score.by_size["2 to 4"].right_first.k == 2  # every amplitude is three times the minimum detectable
    for steps in score.by_condition.values():
        assert sum(rates.cases for rates in steps.values()) == 5
        assert sum(rates.right_first.k for rates in steps.values()) == 2
    assert score.overall.brier is None
    assert any("no probabilities" in note for note in score.notes)
    assert (tmp_path / SCORE).exists()
    assert len((tmp_path / ANSWERS_HASHES).read_text().splitlines()) == 5


def test_two_folders_of_answers_stand_side_by_side(a_set, tmp_path):
    answers, rivals = tmp_path / "answers", tmp_path / "rivals"
    answer_rightly(a_set, answers)
    for truth in open_labels(a_set).truths:
        save_diagnosis(rivals / truth.id / "diagnosis.json", diagnosis("none"))
    said = hangtime_here("blind", "score", a_set, answers, "--beside", rivals, folder=tmp_path)
    assert said.returncode == 0, said.stderr
    (line,) = [line for line in said.stdout.splitlines() if line.startswith("pairs: both named")]
    assert line.index("1/1") < line.index("0/1")
    assert "beside: 5 cases, opening " in said.stdout
    assert (rivals / SCORE).exists()


def test_conditions_of_a_sensor_are_grouped():
    look = Look(width=0.3, height=0.3, mass=0.02, grid=0, rate=45.0, duration=3.5, noise=1.4e-3, away=0.08,
                tilt=(0.0, 0.0), distance=1.5)  # fmt: skip
    assert conditions_of(look) == {
        "noise": "1 to 2 mm", "points": "corners and centre", "frames": "45 a second", "missing": "above 6 %",
    }  # fmt: skip


def test_every_opening_of_the_seal_is_recorded(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    looks = a_set / LOOKS_FILE
    before = len(looks.read_text().splitlines()) if looks.exists() else 0
    first, second = score_set(a_set, tmp_path), score_set(a_set, tmp_path)
    lines = [json.loads(line) for line in looks.read_text().splitlines()][before:]
    assert [first.look, second.look] == [before + 1, before + 2]
    assert [line["answers"] for line in lines] == [first.answers, second.answers]
    assert "right group first" in lines[0]["headline"]


def test_the_seal_stays_closed_while_answers_are_missing(a_set, tmp_path, monkeypatch):
    from fit.blind import scoring

    answer_rightly(a_set, tmp_path)
    (tmp_path / read_manifest(a_set).cases[0] / "diagnosis.json").unlink()
    monkeypatch.setattr(scoring, "open_labels", lambda folder: pytest.fail("opened too early"))
    with pytest.raises(FitError, match="1 cases have no answer"):
        score_set(a_set, tmp_path)


def test_the_answered_cases_can_be_counted_alone_and_the_score_says_so(a_set, tmp_path):
    with pytest.raises(FitError, match="5 cases have no answer"):
        score_set(a_set, tmp_path, some=True)
    answer_rightly(a_set, tmp_path)
    (tmp_path / read_manifest(a_set).cases[0] / "diagnosis.json").unlink()
    score = score_set(a_set, tmp_path, some=True)
    assert len(score.cases) == 4
    assert len((tmp_path / ANSWERS_HASHES).read_text().splitlines()) == 4
    assert "1 of 5 cases have no answer and count nowhere." in score.notes
    assert json.loads((a_set / LOOKS_FILE).read_text().splitlines()[-1])["cases"] == 4


def truth_of(a_set, kind):
    return next(t for t in open_labels(a_set).truths if t.kind == kind)


def judged(a_set, tmp_path, kind, said):
    truth = truth_of(a_set, kind)
    save_diagnosis(tmp_path / truth.id / "diagnosis.json", said)
    return judge(truth, tmp_path)


def test_a_named_effect_on_a_null_is_a_false_alarm_and_confident(a_set, tmp_path):
    one = judged(a_set, tmp_path, "null", diagnosis("effect", ["hem"], [finding("hem")]))
    assert one.false_alarm
    assert one.confident_and_wrong
    doubtful = diagnosis("effect", ["hem"], [finding("hem", probability=0.6)])
    assert not judged(a_set, tmp_path, "null", doubtful).confident_and_wrong


def test_another_effect_of_the_same_group_is_credited_but_not_alone(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    said = diagnosis("effect", ["draught"], [finding("draught"), finding(name, group="draught", closure=0.6)])
    one = judged(a_set, tmp_path, "single", said)
    assert one.right_first
    assert not one.right_alone
    assert not one.confident_and_wrong
    assert (one.closure, one.closure_of_oracle) == (0.5, 0.6)
    assert one.amplitude_error is None


def test_of_several_named_effects_the_first_must_be_right(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    both = [finding("draught"), finding(name)]
    assert not judged(a_set, tmp_path, "single", diagnosis("several", ["draught", name], both)).right_first
    assert judged(a_set, tmp_path, "single", diagnosis("several", [name, "draught"], both)).right_first
    assert judged(a_set, tmp_path, "single", diagnosis("ambiguous", ["draught", name], both)).right_first


@pytest.mark.parametrize(("probability", "is_sure"), [(0.95, True), (0.6, False)])
def test_any_cause_that_is_named_surely_and_is_not_there_counts(a_set, tmp_path, probability, is_sure):
    name = truth_of(a_set, "single").planted[0].id
    both = [finding(name, probability=0.9), finding("draught", probability=probability)]
    found = judged(a_set, tmp_path, "single", diagnosis("several", [name, "draught"], both))
    assert found.right_first
    assert found.confident_and_wrong == is_sure


def test_alternatives_of_several_count_as_one_cause(a_set, tmp_path):
    """Hem and time offset are planted: an alternative of either counts, two alternatives of one cause do not."""
    one, other = (p.id for p in truth_of(a_set, "pair").planted)
    three = [finding(one), finding(other), finding("draught")]

    def said(named, alternatives):
        return msgspec.structs.replace(diagnosis("several", named, three), alternatives=alternatives)

    found = judged(a_set, tmp_path, "pair", said([one, "draught"], {"draught": [other]}))
    assert (found.both_named, found.right_first) == (True, True)
    found = judged(a_set, tmp_path, "pair", said(["draught", other], {"draught": [one]}))
    assert (found.both_named, found.right_first) == (True, True)
    assert not judged(a_set, tmp_path, "pair", said([one, "draught"], {one: [other]})).both_named
    assert not judged(a_set, tmp_path, "pair", said(["draught", one], {})).right_first


def test_a_pairs_size_is_that_of_its_smaller_effect(a_set, tmp_path):
    planted = truth_of(a_set, "pair").planted
    both = [finding(p.id, least=p.amplitude / size) for p, size in zip(planted, (5.0, 1.5), strict=True)]
    found = judged(a_set, tmp_path, "pair", diagnosis("several", [p.id for p in planted], both))
    assert (found.ratio, found.bin) == (pytest.approx(1.5), "1 to 2")
    assert summarise((found,)).by_size["1 to 2"].pair_both_named.k == 1
    left_out = [finding(planted[0].id), finding(planted[1].id, tested=False)]
    assert not judged(a_set, tmp_path, "pair", diagnosis("effect", [planted[0].id], left_out)).is_tested


def test_the_cost_is_counted_for_each_take_and_the_most_expensive_case_is_seen(a_set, tmp_path):
    truths = open_labels(a_set).truths[:3]
    for truth, simulations in zip(truths, (400, 800, 2800), strict=True):
        said = msgspec.structs.replace(
            diagnosis("none"), take_ids=["a", "b", "c"], held_out_ids=["d"],
            cost=Cost(simulations=simulations, seconds=simulations / 10),
        )  # fmt: skip
        save_diagnosis(tmp_path / truth.id / "diagnosis.json", said)
    overall = summarise(tuple(judge(truth, tmp_path) for truth in truths)).overall
    assert (overall.simulations, overall.simulations_most) == (200.0, 700.0)
    assert [figure(overall, name) for name in ("simulations", "simulations_most")] == ["200", "700"]
    assert (overall.seconds, overall.seconds_most) == (80.0, 280.0)


def test_the_brier_score_of_groups_adds_up_effects_that_cannot_be_distinguished(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    both = [finding("draught", probability=0.6), finding(name, group="draught", probability=0.4)]
    found = judged(a_set, tmp_path, "single", diagnosis("ambiguous", ["draught", name], both))
    assert found.brier == pytest.approx(0.6**2 + 0.6**2)
    assert found.brier_of_groups == pytest.approx(0.0)


def test_an_effect_in_third_place_is_among_the_first_three_groups(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    three = [finding("draught"), finding("air_lift"), finding(name)]
    one = judged(a_set, tmp_path, "single", diagnosis("effect", ["draught"], three))
    assert not one.right_first
    assert one.right_in_three
    assert one.confident_and_wrong
    untested = [finding("added_mass", tested=False), *three]  # a group that was not tested takes no place
    assert judged(a_set, tmp_path, "single", diagnosis("effect", ["draught"], untested)).right_in_three
    four = [*three[:2], finding("added_mass"), three[2]]
    assert not judged(a_set, tmp_path, "single", diagnosis("effect", ["draught"], four)).right_in_three


def test_simpler_tools_are_judged_by_the_same_answers(a_set, tmp_path):
    """Drag explains more linearly, the truth closes more: the rules may say nothing at all."""
    name = truth_of(a_set, "single").planted[0].id
    both = [finding("air_drag", closure=0.2, explained=0.5), finding(name, closure=0.4, explained=0.3)]
    one = judged(a_set, tmp_path, "single", diagnosis("unknown", [], both))
    assert (one.right_first, one.right_by_screening, one.right_by_closure) == (False, False, True)
    both = [finding("air_drag", correlation=0.2, fitted_share=0.5), finding(name, correlation=0.4, fitted_share=0.3)]
    other = judged(a_set, tmp_path, "single", diagnosis("unknown", [], both))
    assert (other.right_by_correlation, other.right_by_training) == (True, False)
    found = summarise((one,)).baselines
    assert found["largest share explained linearly, no refit"].k == 0
    assert found["largest share of the gap closed, no rules"].k == 1


def test_a_classifier_learns_labels_that_follow_the_features_and_none_that_do_not():
    """Two features that differ by five deviations; with labels drawn at random half are right."""
    rng = np.random.default_rng(4)
    labels = ["hem", "air_drag"] * 20
    near = [{"a": rng.normal() + 5 * (name == "hem"), "b": rng.normal()} for name in labels]
    assert leave_one_out(near, labels) == labels
    drawn = rng.permutation(labels).tolist()
    right = np.mean([a == b for a, b in zip(leave_one_out(near, drawn), drawn, strict=True)])
    assert 0.2 < right < 0.7


def test_leave_one_out_is_what_learning_without_the_case_gives():
    """The closed form against a regression that never saw the case; standardisation is of all cases in both."""
    rng = np.random.default_rng(5)
    labels = rng.choice(["a", "b", "c"], 12).tolist()
    table = rng.normal(size=(12, 4))
    given = [dict(zip("pqrs", row.tolist(), strict=True)) for row in table]
    design = np.column_stack([np.ones(12), (table - table.mean(0)) / table.std(0)])
    wanted = np.array([[name == kind for kind in "abc"] for name in labels], float)
    penalty = RIDGE * np.diag([0.0, 1, 1, 1, 1])
    expected = []
    for k in range(12):
        rest = np.arange(12) != k
        learnt = np.linalg.solve(design[rest].T @ design[rest] + penalty, design[rest].T @ wanted[rest])
        expected.append("abc"[int((design[k] @ learnt).argmax())])
    assert leave_one_out(given, labels) == expected


def test_an_effect_of_the_base_model_counts_in_no_rate(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    one = judged(a_set, tmp_path, "single", diagnosis("none", effects=[finding(name, tested=False)]))
    score = summarise((one,))
    assert score.in_base_model == 1
    assert score.overall.right_first.n == 0


def test_negative_amplitudes_are_compared_by_size(a_set, tmp_path):
    planted = truth_of(a_set, "single").planted[0]
    found = finding(
        planted.id, -planted.amplitude, amplitude_interval=(-1.3 * planted.amplitude, -0.8 * planted.amplitude)
    )
    one = judged(a_set, tmp_path, "single", diagnosis("effect", [planted.id], [found]))
    assert one.amplitude_error == pytest.approx(0.0)
    assert one.amplitude_covered


def test_wilsons_interval_of_3_in_60_and_of_none():
    """3 of 60: 1.7 to 13.7 %; 0 of 10: 0 to 27.8 % (both from Wilson's formula by hand)."""
    assert wilson(3, 60) == pytest.approx((0.0171, 0.1370), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert rate_of([]).rate is None
    assert str(rate_of([True, False])) == "50 % [9, 91]  1/2"


def test_a_brier_score_of_certainty_and_of_doubt():
    """Probability one and right 0; probability one and wrong 2; 0.8 for the truth and 0.2 for the rest 0.04 + 0.04."""
    assert brier({"hem": 1.0}, "hem") == 0.0
    assert brier({"hem": 1.0}, "draught") == 2.0
    assert brier({"hem": 0.8}, "hem") == pytest.approx(0.08)
    assert brier({"hem": 0.2}, "") == pytest.approx(0.08)
    # Probabilities of effects that are at work together may pass 1, and then leave nothing: 0.3^2 + 0.6^2.
    assert brier({"hem": 0.7, "draught": 0.6}, "hem") == pytest.approx(0.45)


def test_sizes_fall_into_their_bins():
    assert [bin_of(r) for r in (0.3, 0.5, 1.0, 3.9, 4.0, None)] == [
        "below 0.5", "0.5 to 1", "1 to 2", "2 to 4", "above 4", "not known",
    ]  # fmt: skip


def test_the_report_is_one_file_with_nothing_from_outside(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    with pytest.raises(FitError, match="not scored"):
        write_page(tmp_path, tmp_path / "page.html")
    score = score_set(a_set, tmp_path)
    text = write_page(tmp_path, tmp_path / "page.html").read_text()
    assert text.startswith("<!doctype html>")
    for word in ("http", "src=", "<script", "<link"):
        assert word not in text
    for word in ("false alarms on nulls", "time_offset", "always air_drag", "chance", "no probabilities"):
        assert word in text
    sure = tuple(msgspec.structs.replace(j, probability=0.9 if j.named else None) for j in score.cases)
    (tmp_path / SCORE).write_bytes(msgspec.json.encode(msgspec.structs.replace(score, cases=sure)))
    assert "<svg" in write_page(tmp_path, tmp_path / "page.html").read_text()
    evil = tuple(msgspec.structs.replace(j, id="<i>", named=("<i>",)) for j in score.cases)
    named = {"created": "<i>", "sealed": "<i>", "notes": ("<i>",), "verdicts": {"<i>": {"<i>": 1}}}
    (tmp_path / SCORE).write_bytes(msgspec.json.encode(msgspec.structs.replace(score, cases=evil, **named)))
    page = write_page(tmp_path, tmp_path / "page.html").read_text()
    assert "<i>" not in page
    assert page.count("&lt;i&gt;") == 2 * len(evil) + 5
    assert figure(score.overall, "closure") == "0.50"
    assert figure(score.by_size["below 0.5"], "closure") == "–"


@pytest.mark.parametrize("name", ["answers/score.json", "answers/a/report.html", "looks.jsonl", "sealed/page.html"])
def test_a_page_replaces_no_file_of_the_set_or_its_answers(tmp_path, name):
    folders = (tmp_path, tmp_path / "answers")
    with pytest.raises(FitError, match="belongs to the set or its answers"):
        check_page_name(tmp_path / name, folders)
    for fine in (tmp_path / "answers/blind.html", tmp_path / "blind.html", tmp_path.parent / "score.json"):
        check_page_name(fine, folders)


def test_a_named_local_effect_states_its_region_and_else_the_largest_residual_does(a_set, tmp_path):
    truth = msgspec.structs.replace(truth_of(a_set, "single"), planted=())
    (slip,) = (plant for plant in PLANTS if plant.id == "clip_slip")
    planted = slip.draw(np.random.default_rng(0), Cloth(width=0.3, height=0.3))
    truth = msgspec.structs.replace(truth, planted=(planted,))

    def found(named, regions, largest):
        said = diagnosis("effect", named, [finding("clip_slip", regions=list(regions)), finding("draught")], largest)
        save_diagnosis(tmp_path / truth.id / "diagnosis.json", said)
        return judge(truth, tmp_path).place_found

    (right,) = planted.place
    wrong = {"top left": "top right", "top right": "top left"}[right]
    assert found(["clip_slip"], (right,), "bottom left")
    assert not found(["clip_slip"], (wrong,), right)
    assert found(["draught"], (), right)
    assert not found(["draught"], (right,), "bottom left")


def test_closure_is_compared_with_the_true_effects_where_that_closes_anything():
    """0.4 of 0.8; 1.2 of 0.6 counts as all, -0.3 of 0.5 as nothing; a refit that closes 0.05 gives no share."""
    closed = [(0.4, 0.8), (1.2, 0.6), (-0.3, 0.5), (0.04, 0.05), (0.3, None)]
    singles = [
        Judged(
            id=str(k), kind="single", planted=("hem",), amplitude=1.0, ratio=None, bin=BINS[-1], verdict="effect",
            named=("hem",), is_tested=True, closure=mine, closure_of_oracle=best,
        )
        for k, (mine, best) in enumerate(closed)
    ]  # fmt: skip
    found = rates_of(singles)
    assert found.closure_against_oracle == pytest.approx((0.5 + 1.0 + 0.0) / 3)
    assert found.closure == pytest.approx(0.3)  # the median of all five
    assert rates_of(singles[3:]).closure_against_oracle is None
