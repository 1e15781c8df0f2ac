"""The odds between sets that differ in one effect are at most those that half-seconds of the fitted takes confirm."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap import weighed
from fit.gap.closure import BlockErrors
from fit.gap.posterior import Found, Mass
from fit.gap.weighed import limited
from fit.observer.edge import EdgeErrors

FAR = -np.inf


def blocks(*squares):
    return BlockErrors(np.array(squares, float), np.ones(len(squares)), np.zeros(3))


SURE = blocks(*[9.0, 9.1, 8.9, 9.0, 9.1, 8.9, 9.0, 9.05])  # worse than `BEST` in each half-second
BEST = blocks(*[8.0, 8.1, 7.9, 8.0, 8.1, 7.9, 8.0, 8.05])
UNSURE = blocks(*[9.0, 7.2, 8.9, 7.1, 9.1, 7.0, 8.0, 8.05])  # worse in half of them


def limited_of(monkeypatch, masses, fitted):
    """Log masses after the limit; fitted: {set: errors of its fit on the takes fitted to}."""
    fitted = {(): SURE} | fitted
    monkeypatch.setattr(weighed, "block_errors", lambda observer, residual: residual)
    monkeypatch.setattr(weighed, "is_brought", lambda observer, fitted, name: name == "brought")
    among = list(masses)
    known = np.array([masses[one] for one in among], float)
    mass = Mass(among, known, np.full(len(among), FAR), known.copy())
    found = Found({one: SimpleNamespace(residual=errors) for one, errors in fitted.items()}, mass)
    return dict(zip(among, limited(None, found).total.tolist(), strict=True))


def test_a_twin_that_is_worse_in_half_of_the_half_seconds_keeps_odds(monkeypatch):
    given = {(): -50.0, ("drag",): 0.0, ("twin",): -30.0}
    found = limited_of(monkeypatch, given, {(): SURE, ("drag",): BEST, ("twin",): UNSURE})
    p = weighed.gain_p_value(UNSURE, BEST, 0.0)
    assert 0.2 < p < 0.5
    assert found["twin",] == pytest.approx(-np.log((1 - p) / p))
    assert found["drag",] == 0.0
    assert found[()] == -50.0  # without the effect: no set in its place


def test_a_twin_that_is_worse_in_every_half_second_keeps_the_odds_of_the_likelihood(monkeypatch):
    given = {("drag",): 0.0, ("twin",): -5.0}
    assert weighed.gain_p_value(SURE, BEST, 0.0) < 1e-5
    assert limited_of(monkeypatch, given, {("drag",): BEST, ("twin",): SURE}) == given


def test_a_set_that_is_refuted_about_the_present_fit_has_the_odds_of_its_own_fit(monkeypatch):
    given = {("drag",): 0.0, ("twin",): FAR, ("worse",): FAR}
    found = limited_of(monkeypatch, given, {("drag",): BEST, ("twin",): UNSURE, ("worse",): SURE})
    assert -2.0 < found["twin",] < 0.0
    assert found["worse",] < -10.0


def test_sets_without_a_fit_brought_ones_and_those_of_another_number_of_effects_keep_theirs(monkeypatch):
    given = {
        ("drag",): 0.0, ("unfitted",): -30.0, ("brought",): FAR, ("drag", "hem"): -30.0, ("lift", "hem"): -30.0,
    }  # fmt: skip
    fitted = {one: UNSURE for one in given if one != ("unfitted",)} | {("drag",): BEST}
    assert limited_of(monkeypatch, given, fitted) == given


def test_the_held_edge_that_tells_twins_apart_keeps_the_odds_of_the_likelihood(monkeypatch):
    """Of 1000 numbers the twin leaves 3000 squared deviations at the edge, as without any effect; the best 1000."""
    given = {("drag",): 0.0, ("twin",): -30.0}
    off, on = (EdgeErrors(moving=squares, count=1000, mm=1.0) for squares in (3000.0, 1000.0))
    fitted = {
        (): dataclasses.replace(SURE, edge=off), ("drag",): dataclasses.replace(BEST, edge=on),
        ("twin",): dataclasses.replace(UNSURE, edge=off),
    }  # fmt: skip
    assert limited_of(monkeypatch, given, fitted) == given


def test_odds_that_are_limited_leave_the_share_of_an_unknown_cause(monkeypatch):
    monkeypatch.setattr(weighed, "block_errors", lambda observer, residual: residual)
    monkeypatch.setattr(weighed, "is_brought", lambda *given: False)
    among = [("drag",), ("twin",)]
    mass = Mass(among, np.array([0.0, -40.0]), np.array([2.0, -30.0]), np.zeros(2))
    fits = {(): SURE, ("drag",): BEST, ("twin",): UNSURE}
    fits = {one: SimpleNamespace(residual=errors) for one, errors in fits.items()}
    found = limited(None, Found(fits, mass))
    assert found.wide - found.known == pytest.approx([2.0, 2.0])


def test_of_two_effects_a_set_that_differs_in_one_is_in_the_place_of_the_best(monkeypatch):
    given = {("drag", "hem"): 0.0, ("hem", "twin"): -30.0, ("lift", "twin"): -30.0}
    found = limited_of(monkeypatch, given, dict.fromkeys(given, UNSURE) | {("drag", "hem"): BEST})
    assert -2.0 < found["hem", "twin"] < 0.0
    assert found["lift", "twin"] == -30.0


def test_without_any_effect_nothing_is_limited(monkeypatch):
    given = {(): 0.0, ("drag",): -30.0}
    assert limited_of(monkeypatch, given, {(): BEST, ("drag",): UNSURE}) == given
