"""Several takes to fit to and to judge on: fit and diagnosis are the same in whatever order they are given."""

from __future__ import annotations

import functools
import itertools

import msgspec
import numpy as np
import pytest

from fit.folders import set_aside_others
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from fit.recordings.ready import ready
from formats.results import save_diagnosis
from tests.fit.gap.linear_cloth import World, a_take, diagnosed
from tests.fit.scenes import hung, sheet, swing, take_of


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


@functools.cache
def fitted_to(*names, seed=0):
    """A diagnosis fitted to takes in this order: of a weak hem and much noise, so that roundings would show."""
    world = World()
    by_name = {
        name: a_take(name, world, {"hem": 0.004}, seed=n, hz=0.7 + 0.3 * n, noise=2e-3) for n, name in enumerate("abc")
    }
    judged = [a_take("d", world, {"hem": 0.004}, seed=7, noise=2e-3, hz=0.9)]
    return diagnosed([by_name[name] for name in names], judged, world, seed=seed).diagnosis


@pytest.mark.parametrize("order", list(itertools.permutations("abc"))[1:])
def test_fitted_takes_in_another_order_give_the_same_diagnosis(order):
    first, other = fitted_to(*"abc"), fitted_to(*order)
    assert msgspec.structs.replace(other, created=first.created, cost=first.cost) == first
    assert first.take_ids == ["a", "b", "c"]


def test_requested_effects_in_another_order_give_the_same_diagnosis():
    world, fitted, judged = takes()
    one, other = (
        diagnosed(fitted, judged[:1], world, added=added).diagnosis
        for added in (("hem", "draught"), ("draught", "hem", "draught"))
    )
    assert msgspec.structs.replace(other, created=one.created, cost=one.cost) == one
    assert one.options["--add"] == "draught hem"


def test_a_fit_to_takes_in_another_order_is_the_same_in_every_digit():
    def take(name, hz, seconds=1.6):
        time = np.arange(0, seconds, 1 / 30)
        path, garment = swing(time, hz=hz, stop=seconds - 0.4), sheet()
        noise = np.random.default_rng(ord(name)).normal(0, 1e-3, (len(time), len(garment.points), 3))
        return take_of(garment, time, path, hung(garment, time) + path[:, None] + noise, name=name)

    made = {name: take(name, hz) for name, hz in zip("abc", (0.6, 0.8, 1.0), strict=True)}
    judged = [take("d", 0.7), take("e", 0.9, 2.0)]
    request = request_of(find_method("lean"), [], iterations=2, seed=3, spacing=0.15, search="annealing")
    one = calibrate([made[name] for name in "abc"], judged, request)
    other = calibrate([made[name] for name in "cab"], judged[::-1], request)
    assert msgspec.structs.replace(other, created=one.created, seconds=one.seconds) == one
    assert (one.take_ids, one.held_out_ids) == (["a", "b", "c"], ["d", "e"])


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
