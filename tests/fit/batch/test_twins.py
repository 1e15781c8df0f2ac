"""Which takes stay where some share frames of one recording: those with the most independent evidence."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import pytest

from fit.batch.twins import MOST_TOGETHER, left_out, sharing


@dataclass(frozen=True)
class Made:
    name: str
    seconds: float = 10.0
    kind: str = "face-on"


def twins_of(every, *pairs):
    found = {one.name: set() for one in every}
    for one, other in pairs:
        found[one].add(other)
        found[other].add(one)
    return found


def without(every, *pairs, can=lambda _: True, known=lambda _: False):
    return left_out(every, twins_of(every, *pairs), can, known)


def names(takes):
    return {one.name for one in takes}


def test_takes_that_share_no_frames_all_stay():
    assert without([Made("a"), Made("b")]) == {}


def test_the_longer_one_stays_and_of_two_as_long_the_first():
    assert without([Made("a", 8.0), Made("b")], ("a", "b")) == {"a": ["b"]}
    assert without([Made("a"), Made("b")], ("a", "b")) == {"b": ["a"]}


def test_of_two_as_long_the_one_that_was_diagnosed_stays_but_not_the_shorter_one():
    def known(takes):
        return names(takes) == {"b", "c"}

    assert without([Made("a"), Made("b"), Made("c")], ("a", "b"), known=known) == {"a": ["b"]}
    assert without([Made("a"), Made("b", 8.9), Made("c")], ("a", "b"), known=known) == {"b": ["a"]}


def test_takes_of_two_kinds_stay_and_a_file_that_joins_them_does_not():
    every = [Made("joined", 20.03, "mixed"), Made("front"), Made("side", kind="sideways")]
    pairs = [("joined", "front"), ("joined", "side")]
    assert without(every, *pairs) == {"joined": ["front", "side"]}


def test_a_whole_take_stays_and_its_two_halves_do_not():
    every = [Made("half", 5.0), Made("other half", 4.97), Made("whole")]
    assert without(every, ("whole", "half"), ("whole", "other half")) == {"half": ["whole"], "other half": ["whole"]}


def test_a_long_file_with_parts_stays_unless_nothing_can_be_diagnosed_then():
    every = [Made("all", 60.0), Made("front"), Made("side", kind="sideways")]
    pairs = [("all", "front"), ("all", "side")]
    assert without(every, *pairs) == {"front": ["all"], "side": ["all"]}
    assert without(every, *pairs, can=lambda some: len(some) > 1) == {"all": ["front", "side"]}


def test_a_chain_of_parts_that_overlap_leaves_those_that_share_nothing():
    every = [Made("a"), Made("b"), Made("c")]
    assert without(every, ("a", "b"), ("b", "c")) == {"b": ["a", "c"]}


@pytest.mark.parametrize("count", [MOST_TOGETHER, MOST_TOGETHER + 1, 60])
def test_of_many_copies_of_one_take_one_stays(count):
    every = [Made(f"{k:02}", 10.0 + 0.01 * k) for k in range(count)]
    pairs = [(one.name, other.name) for one in every for other in every if one.name < other.name]
    out = without(every, *pairs)
    assert out == {one.name: [every[-1].name] for one in every[:-1]}


def test_many_pairs_of_copies_are_chosen_among_in_bounded_time():
    every = [Made(f"{k:02}{which}") for k in range(40) for which in "ab"]
    asked = Counter()

    def known(_):
        asked["known"] += 1
        return False

    out = without(every, *((f"{k:02}a", f"{k:02}b") for k in range(40)), known=known)
    assert out == {f"{k:02}b": [f"{k:02}a"] for k in range(40)}
    assert asked["known"] <= 256


def test_the_sentence_names_those_that_stay():
    assert sharing(["a"]) == "it holds frames of the recording that a holds"
    assert sharing(["a", "b", "c"]) == "it holds frames of the recordings that a, b and c hold"
