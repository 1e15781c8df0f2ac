"""Answers on planted takes against those on the same takes untouched: sizes, groups and limits, worked by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from fit.blind import striking
from fit.blind.judging import BINS, Judged
from fit.blind.real_scoring import judge_real
from tests.fit.blind.blind_answers import finding
from tests.fit.blind.test_blind_cases import planted
from tests.fit.blind.test_blind_real import a_truth, of


@pytest.mark.parametrize(("found", "is_covered"), [(0.0149, True), (0.0151, False), (0.0051, True), (0.0049, False)])
def test_a_change_is_covered_by_both_intervals_together(found, is_covered):
    """Half widths of 3 and 4 ms make 5 ms: 10 ms were planted, and 5.1 ms too much or too little are not covered."""
    before = of(finding("time_offset", 0.0, 0.001, amplitude_interval=(-0.003, 0.003)))
    after = of(finding("time_offset", found, 0.001, amplitude_interval=(found - 0.004, found + 0.004)))
    assert judge_real(a_truth(planted("time_offset", 0.01)), before, after).is_covered == is_covered


def test_effects_move_in_units_of_what_the_untouched_takes_could_show_of_each():
    """10 ms are ten times what could be seen of the one effect, and 20 ms twice what could be seen of the other."""
    before = of(finding("time_offset", 0.0, 0.001), finding("filter_lag", 0.0, 0.01))
    after = of(finding("time_offset", 0.01, 0.1), finding("filter_lag", 0.02, 0.01))
    judged = judge_real(a_truth(planted("time_offset", 0.01)), before, after)
    assert (judged.moved_most, judged.is_moved_most) == ("time_offset", True)


@pytest.mark.parametrize("groups", [("time", "time_offset"), ("time_offset", "time")])
def test_an_effect_of_the_planted_ones_group_by_either_diagnosis_is_as_good(groups):
    before, after = (
        of(finding("time_offset", 0.0, 0.01, group=group), finding("filter_lag", amount, 0.01, group="time"))
        for group, amount in zip(groups, (0.0, 0.02), strict=True)
    )
    judged = judge_real(a_truth(planted("time_offset", 0.01)), before, after)
    assert (judged.moved_most, judged.is_moved_most) == ("filter_lag", True)


def test_cases_are_struck_from_twice_the_smallest_detectable_amplitude_on(monkeypatch, tmp_path):
    """Of one effect that was tested; a case of just twice that amplitude counts."""

    def case(name, ratio, kind="single", is_tested=True):
        return Judged(
            id=name, kind=kind, planted=("hem",), amplitude=1.0, ratio=ratio, bin=BINS[-1], verdict="effect",
            named=("hem",), is_tested=is_tested,
        )  # fmt: skip

    cases = [
        case("twice", 2.0), case("less", 1.99), case("more", 7.0), case("unknown", None), case("pair", 5.0, "pair"),
        case("untested", 5.0, is_tested=False),
    ]  # fmt: skip
    asked = {}
    monkeypatch.setattr(striking, "load_score", lambda answers: SimpleNamespace(sealed="s", answers="h", cases=cases))
    monkeypatch.setattr(striking, "read_manifest", lambda folder: SimpleNamespace(sealed="s"))
    monkeypatch.setattr(striking, "run_set", lambda folder, out, *, without, **more: asked.update(without))
    struck = striking.strike_set(tmp_path, tmp_path, tmp_path)
    assert asked == {"twice": "hem", "more": "hem"}
    assert [one.id for one in struck.cases] == ["twice", "more"]
    assert (struck.nothing.k, struck.nothing.n) == (2, 2)  # no answer is none
