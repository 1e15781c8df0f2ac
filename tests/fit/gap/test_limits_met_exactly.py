"""Figures that meet a limit exactly, and models that are compared with the one that they are named after."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from fit.gap import first_round, next_experiment, weighed
from fit.gap.findings import base_parameters
from fit.gap.fitting import Problem
from fit.gap.floor import Floor
from fit.gap.next_experiment import _imagined
from fit.gap.posterior import SCALES, UNKNOWN, WIDEST_UNKNOWN
from fit.gap.rounds import Rounds
from fit.gap.subsets import log_evidence
from fit.gap.verdict import decide
from fit.gap.where import _phases
from fit.methods import SI
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_edge_verdict import told
from tests.fit.gap.test_findings import ONE, fitted_at
from tests.fit.gap.test_next_experiment import X, Y, proposed
from tests.fit.gap.test_posterior_by_hand import likelihood, linear, world  # noqa: F401
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis, signature, with_edge


def test_an_effect_is_named_only_where_the_gap_itself_is_sure():
    """Ten half-seconds at the noise of 5 mm and two at 14 mm: one draw in nine holds none of the two.

    Drag closes all of the gap in each half-second, so that its closure is certain.
    """
    evidence = evidence_of({"air_drag": 5.0})
    uneven = dataclasses.replace(evidence.base.errors, sums=10.0 * np.array([25.0] * 10 + [196.0] * 2))
    even = dataclasses.replace(evidence.base.errors, sums=np.full(12, 250.0))
    evidence = dataclasses.replace(
        evidence, base=dataclasses.replace(evidence.base, errors=uneven),
        singles={"air_drag": dataclasses.replace(evidence.singles["air_drag"], errors=even)},
    )  # fmt: skip
    assert evidence.p_value("air_drag") < 0.01
    found = decide(evidence)
    assert (found.verdict, found.named) == ("inconclusive", [])
    assert "differs too much between half-seconds to be sure" in found.sentence


def test_a_verdict_by_the_edge_tells_what_further_effects_beside_it_would_leave():
    """Slack clips close 28 % of the cloth's gap; with drag 144 - 54.75 of 119 mm^2, and 25 % is left."""
    both = with_edge(hypothesis(("clip_slack", "air_drag"), 7.4, seed=9), 900, 2.0)
    found = decide(dataclasses.replace(told(10.5, other={"air_drag": 11.0}), joint=[(both, 0.001)]))
    assert (found.verdict, found.named) == ("effect", ["clip_slack"])
    assert f"explains: {KINDS['air_drag'].title} beside this effect would leave 25 % of the gap" in found.sentence


def test_a_closure_just_above_the_least_one_has_the_digits_that_show_it():
    """25.2 % of 144 - 25 mm^2; of the rest, mesh and solver may make 2 x 49. The size may be nothing."""
    drag = hypothesis(("air_drag",), float(np.sqrt(144 - 0.252 * 119)), deviation=0.7)
    evidence = dataclasses.replace(evidence_of({}), singles={"air_drag": drag}, screened={"air_drag": signature()})
    sentence = decide(dataclasses.replace(evidence, numerics_mm=7.0)).sentence
    assert "would close 25.2 % of it" in sentence


def test_a_step_that_ends_exactly_at_the_upper_bound_goes_up(monkeypatch):
    asked = []

    def answered(given):
        asked.extend(vectors for _, vectors, _ in given)
        return [one.residuals(vectors, amplitudes) for one, vectors, amplitudes in given]

    observer = LinearObserver(np.zeros(3), np.ones((3, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    observer.of = lambda recordings: observer
    space = Problem(observer).space
    base = dataclasses.replace(observer.fitted(), vector=space.from_unit(np.full(len(SI.initial), 0.75)))
    unit = space.to_unit(base.vector)
    assert unit[0] > 0.5
    monkeypatch.setattr(next_experiment, "MENU", next_experiment.MENU[:1])
    monkeypatch.setattr(next_experiment, "residuals_together", answered)
    monkeypatch.setattr(next_experiment, "JACOBIAN_STEP", float(1 - unit[0]))
    _imagined(observer, [None], base, [])
    assert unit[0] + float(1 - unit[0]) == 1.0
    assert asked[0][1, 0] == pytest.approx(SI.maximum[0])


def test_two_explanations_are_apart_now_by_what_the_other_one_cannot_imitate(monkeypatch):
    """(6, 8) is 10 long, and 6 beside (0, 1000): 3 deviations of an inflation of 4, not 5."""
    now = [6.0 * X + 8.0 * Y, 1e3 * Y]
    after = [[2.0 * X, 0 * X], [8.0 * X, 0 * X], [7.0 * X, 0 * X]]
    found = proposed(monkeypatch, now, after, ["hem", "air_drag"], [0.5, 0.5])
    assert (found.sigmas_now, found.sigmas_next) == pytest.approx((3.0, 5.0), rel=1e-4)


def test_each_fit_that_is_continued_keeps_the_ends_of_its_own_starts(monkeypatch):
    """The second one's further start ends lowest of all, and is no end of the first one."""
    search = object.__new__(Rounds)
    search.observer, search.kept = None, Named()
    one, other = (SimpleNamespace(active=(name,), cost=cost) for name, cost in (("hem", 9.0), ("draught", 8.0)))
    costs = {"hem": [9.0, 7.0], "draught": [8.0, 5.0]}
    monkeypatch.setattr(first_round, "polishing", lambda fitted: (fitted.active, 0))
    monkeypatch.setattr(first_round, "across_valleys", lambda observer, fitted: [(fitted.active, 1)])
    monkeypatch.setattr(
        first_round, "fit",
        lambda observer, tasks: [SimpleNamespace(active=active, cost=costs[active[0]][n]) for active, n in tasks],
    )  # fmt: skip
    found = search._fitted_on([one, other])
    assert [(fitted.active, fitted.cost) for fitted in found] == [(("hem",), 7.0), (("draught",), 5.0)]


@pytest.fixture
def screened(monkeypatch):
    """What each screening is given as known; screening itself stays as it is."""
    given = []
    for module in (first_round, weighed):
        own = module.screen

        def told(observer, fitted, chosen, known=None, own=own):
            given.append(known)
            return own(observer, fitted, chosen, known)

        monkeypatch.setattr(module, "screen", told)
    return given


def poorly_based():
    """A cloth with drag and a base fit that ended a third of every stiffness away."""
    made = LinearTakes(3)
    made.missed = made.noisy() + made.moved(1e-3 * MESH) - made.rows["air_drag"][0]
    best = made.base()
    vector = 1.3 * best.vector
    poor = dataclasses.replace(best, vector=vector, residual=made.residuals(vector[None], made.off[None])[0])
    return made, Rounds(made, made, [poor], lambda *_: None, Named())


def test_a_better_base_fit_is_screened_by_what_the_first_screening_found(screened):
    """So the effects that promise little are not simulated again."""
    _, search = poorly_based()
    search.first_round((), has_gap=True)
    assert screened[0] is None
    assert len(screened) == 2
    assert screened[1].keys() == search.screened.keys()


def test_weighing_screens_about_each_fit_by_what_the_first_screening_found(screened):
    _, search = poorly_based()
    own = np.sqrt(3) * 1e3 * NOISE
    weighed.weigh(search, Floor(own, 0.02, own, own), SimpleNamespace(numerics_mm=MESH), ())
    assert len(screened) >= 2
    assert [known is None for known in screened] == [True] + [False] * (len(screened) - 1)


def test_the_wide_prior_begins_with_a_size_that_is_exactly_that_of_mesh_and_solver(linear):  # noqa: F811
    mm = 1e3 * SCALES
    known = float(mm[3])
    mass = linear.masses([()], known)
    evidence = log_evidence(linear.reduced, linear.columns, [()])[0]
    flat = (np.log(mm) >= np.log(known)) & (np.log(mm) <= np.log(known) + np.log(WIDEST_UNKNOWN))
    assert flat[3]
    assert mass.wide[0] == pytest.approx(logsumexp(evidence[flat]) - np.log(flat.sum()) + np.log(UNKNOWN))


def test_a_further_end_of_a_plain_parameter_is_predicted_on_its_own_scale():
    """Ends at 3 and 1: half a width of 0.1645, and Student's 6.314 of one degree times sqrt(2) sqrt(3/2)."""
    plain = dataclasses.replace(ONE, is_log=False, minimum=-50.0, maximum=50.0)
    ends = [fitted_at(**{ONE.name: 3.0}), fitted_at(**{ONE.name: 1.0})]
    (found,) = base_parameters(SimpleNamespace(parameters=[plain]), ends)
    half = np.hypot(0.1645, 6.3138 * np.sqrt(2) * np.sqrt(1.5))
    assert (found.interval_low, found.interval_high) == pytest.approx((2 - half, 2 + half), rel=1e-3)


def test_cloth_rings_down_only_after_the_hanger_has_rested_for_longer_than_three_tenths_of_a_second():
    """The hanger moves at 0 s alone; the middle of its path goes to and fro between frames."""
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    ends = np.zeros((6, 6))
    ends[:, [1, 4]] = np.array([0.0, 0.1, 0.0, 0.1, 0.0, 0.0])[:, None]
    ends[4:, [1, 4]] = 0.0
    names = _phases(SimpleNamespace(time=time, held=lambda instants: ends))
    assert names[3] == "hanger turning or just stopped"
