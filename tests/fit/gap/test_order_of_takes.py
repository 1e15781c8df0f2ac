"""Several held-out takes: a diagnosis is the same in whatever order they are given."""

from __future__ import annotations

import functools
import itertools

import msgspec
import pytest

from fit.folders import set_aside_others
from fit.recordings.ready import ready
from formats.results import save_diagnosis
from tests.fit.gap.linear_cloth import World, a_take, diagnosed


@functools.cache
def takes():
    """Two takes to fit to, and three to judge on, of a cloth with a hem."""
    world, sizes = World(), {"hem": 0.015}
    fitted = [a_take(name, world, sizes, seed=n, hz=0.7 + 0.3 * n) for n, name in enumerate("ab")]
    judged = [a_take(name, world, sizes, seed=3 + n, noise=1.5e-3, hz=0.8 + 0.1 * n) for n, name in enumerate("cde")]
    return world, fitted, judged


@functools.cache
def judged_on(*names):
    world, fitted, judged = takes()
    by_name = {take.take_id: take for take in judged}
    return diagnosed(fitted, [by_name[name] for name in names], world).diagnosis


@pytest.mark.parametrize("names", [("c", "d"), ("c", "d", "e")])
def test_held_out_takes_in_another_order_give_the_same_diagnosis(names):
    first, *others = (judged_on(*order) for order in (names, names[::-1]))
    for other in others:
        same = msgspec.structs.replace(other, created=first.created, cost=first.cost)
        assert same == first
    assert (first.verdict, first.named, first.held_out_ids) == ("effect", ["hem"], list(names))


def test_a_result_of_the_same_takes_in_another_order_is_replaced_and_not_kept_beside(tmp_path):
    """Results of older versions state the held-out takes as they were given."""
    _, fitted, judged = takes()
    kept = judged_on("c", "d")
    contents = kept.options["--held-out"].split()
    for order in itertools.permutations(contents):
        before = msgspec.structs.replace(
            kept, held_out_ids=["d", "c"], take_ids=kept.take_ids[::-1], take_contents=kept.take_contents[::-1],
            options=kept.options | {"--held-out": " ".join(order)},
        )  # fmt: skip
        save_diagnosis(tmp_path / "diagnosis.json", before)
        assert set_aside_others(tmp_path / "diagnosis.json", ready(fitted, judged[:2]).are_of, kept) == ""
    other = msgspec.structs.replace(kept, options=kept.options | {"--held-out": " ".join([contents[0]] * 2)})
    save_diagnosis(tmp_path / "diagnosis.json", other)
    said = set_aside_others(tmp_path / "diagnosis.json", ready(fitted, judged[:2]).are_of, kept)
    assert "is judged on another recording of the same name" in said
