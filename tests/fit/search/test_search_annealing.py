"""The annealing follows the published formulas, is the same for every batch width, and resumes."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest

from benchmarks import annealing_gamma
from fit.errors import FitError
from fit.identification.request import request_of
from fit.methods import KINECT_SKIRT
from fit.search import bounds
from fit.search.annealing import Annealing, AnnealingSettings, SearchBox
from fit.search.chains import ParallelChains
from fit.search.steps import Step

BOX = annealing_gamma.BOX


def chain_of(seed=3, **changes):
    return Annealing(KINECT_SKIRT.initial, BOX, AnnealingSettings(**changes), np.random.default_rng(seed))


def run(chain, width, distance=annealing_gamma.smooth, batches=None):
    calls = 0
    while not chain.is_finished and (batches is None or calls < batches):
        candidates = chain.ask(width)
        assert 1 <= len(candidates) <= width
        chain.tell(candidates, distance(candidates))
        calls += 1
    return calls


def printed(start, distance, settings, seed):
    """The five equations once more, written as plainly as they are printed."""
    random = np.random.default_rng(seed)
    theta, temperature, path = start.copy(), settings.start_temperature, []
    for t in range(1, settings.iterations + 1):
        temperature = temperature / (1 + settings.beta * t) ** settings.alpha
        draws = random.random(len(start) + 1)
        v = BOX.interval * np.tan(np.pi * (draws[:-1] - 0.5)) * settings.mu * temperature**settings.sigma
        proposed = bounds.reflect(theta + v, BOX.minimum, BOX.maximum)
        change = distance(theta[None])[0] - distance(proposed[None])[0]
        if draws[-1] <= min(1.0, math.exp(min(0.0, change * settings.gamma / temperature))):
            theta = proposed
        path.append(theta)
    return np.array(path)


def test_temperature_falls_from_1000_to_5_9_in_350_iterations():
    # T_350 = 1000 / (351!)^0.003
    by_hand = 1000 * math.exp(-0.003 * math.lgamma(352))
    assert AnnealingSettings().temperature(350) == pytest.approx(by_hand, rel=1e-9)
    assert by_hand == pytest.approx(5.9, abs=0.05)


def test_first_step_uses_t1():
    assert AnnealingSettings().temperature(1) == pytest.approx(1000 / 2**0.003)
    chain = chain_of(iterations=3)
    run(chain, 2)
    assert [step.temperature for step in chain.steps[1:]] == pytest.approx(
        [AnnealingSettings().temperature(t) for t in (1, 2, 3)]
    )


def test_one_lane_follows_the_printed_equations():
    chain = chain_of(seed=5, iterations=60, gamma=1e4)
    path = []
    while not chain.is_finished:
        candidates = chain.ask(1)
        if chain.tell(candidates, annealing_gamma.smooth(candidates)):
            path.append(chain.current)
    wanted = printed(KINECT_SKIRT.initial, annealing_gamma.smooth, chain.settings, 5)
    assert np.abs(np.array(path) - wanted).max() < 1e-6  # other roundings
    accepted = [step.is_accepted for step in chain.steps[1:]]
    assert {True, False} == set(accepted)


@pytest.mark.parametrize("gamma", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("beyond_bounds", ["reflect", "redraw", "clip"])
def test_chain_is_bit_identical_for_1_4_8_and_16_lanes(gamma, beyond_bounds):
    chains = [chain_of(gamma=gamma, beyond_bounds=beyond_bounds, iterations=150) for _ in range(4)]
    calls = [run(chain, width) for chain, width in zip(chains, (1, 4, 8, 16), strict=True)]
    for chain in chains[1:]:
        assert chain.steps == chains[0].steps
        assert np.array_equal(chain.best, chains[0].best)
        assert np.array_equal(chain.current, chains[0].current)
    assert calls[0] == 151
    assert calls == sorted(calls, reverse=True)


def test_16_lanes_advance_at_least_8_iterations_a_batch_at_the_default_gamma():
    chain = chain_of()
    assert run(chain, 16) <= 350 / 8
    assert chain.iteration == 350


def test_every_candidate_stays_within_the_bounds():
    for beyond_bounds in ("reflect", "redraw", "clip"):
        chain = chain_of(beyond_bounds=beyond_bounds, iterations=40)
        while not chain.is_finished:
            candidates = chain.ask(8)
            assert (candidates >= BOX.minimum).all()
            assert (candidates <= BOX.maximum).all()
            chain.tell(candidates, annealing_gamma.smooth(candidates))


def test_reflection_folds_a_step_of_two_and_a_quarter_boxes_to_a_quarter():
    low, high = np.array([0.0]), np.array([1.0])
    folded = [bounds.reflect(np.array([x]), low, high)[0] for x in (0.25, -0.25, 1.25, 2.25, -3.75, 1e9 + 0.5)]
    assert folded == pytest.approx([0.25, 0.25, 0.75, 0.25, 0.25, 0.5])


def test_redrawn_steps_have_the_quartiles_of_a_cauchy_cut_off_at_the_bounds():
    one = np.ones(1)
    # Centre 0, spread 1, between -1 and infinity: the distribution function runs from 1/4 to 1.
    median = bounds.redraw(0 * one, 0.5 * one, one, -one, 1e12 * one)[0]
    assert median == pytest.approx(math.tan(math.pi * (0.625 - 0.5)), rel=1e-6)


def test_blown_up_simulations_are_rejected_and_counted():
    def broken(candidates):
        found = annealing_gamma.smooth(candidates)
        found[candidates[:, 1] > 40.0] = np.nan
        return found

    chains = [chain_of(iterations=80), chain_of(iterations=80)]
    run(chains[0], 1, broken)
    run(chains[1], 8, broken)
    assert chains[0].steps == chains[1].steps
    assert chains[0].non_finite == chains[1].non_finite > 10
    assert chains[0].non_finite == sum(math.isinf(step.proposed) for step in chains[0].steps)
    assert chains[0].current[1] <= 40.0
    assert all(not step.is_accepted for step in chains[0].steps if math.isinf(step.proposed))


def test_a_start_that_blows_up_is_left_at_the_first_finite_proposal():
    values = itertools.chain([math.inf], itertools.repeat(0.1))
    chain = chain_of(iterations=3)
    run(chain, 1, lambda candidates: np.array([next(values) for _ in candidates]))
    assert chain.steps[1].is_accepted is True
    assert chain.best_distance == 0.1


def test_rises_are_noted_where_both_distances_are_known_and_a_blow_up_is_not_accepted():
    distances = iter([math.inf, 0.1, math.inf, 0.3])
    chain = chain_of(iterations=3)
    run(chain, 1, lambda candidates: np.array([next(distances) for _ in candidates]))
    assert chain.steps[2].is_accepted is False
    assert chain._changes == [math.inf, math.inf, pytest.approx(0.2)]


def test_a_chain_whose_start_blew_up_is_the_same_after_a_round_trip_through_json():
    chain, again = chain_of(iterations=3), chain_of(iterations=3)
    chain.tell(chain.ask(), np.array([math.inf]))
    again.restore(json.loads(json.dumps(chain.state(), allow_nan=False)))
    assert again.current_distance == again.best_distance == math.inf
    assert again.steps == chain.steps
    with pytest.raises(ValueError, match="one distance for each candidate"):
        again.tell(BOX.minimum[None], np.zeros(1))


@pytest.mark.parametrize(("cost", "candidates"), [(0.25, 0), (math.inf, 3)])
def test_a_saved_step_is_the_same_after_a_round_trip_through_json(cost, candidates):
    step = Step(
        is_sampling=candidates > 0, vector=np.ones(2), cost=cost, vectors=np.zeros((candidates, 2)), simulations=7,
        distances=(0.5,), slopes_at=np.zeros(2),
    )  # fmt: skip
    again = Step.from_state(json.loads(json.dumps(step.state(), allow_nan=False)))
    assert (again.cost, again.is_sampling) == (cost, candidates > 0)
    assert again.vectors.shape == (candidates, 2)
    assert again.state() == step.state()


def test_a_saved_chain_goes_on_bit_identically_after_a_round_trip_through_json():
    whole, first = chain_of(iterations=120), chain_of(iterations=120)
    run(whole, 8)
    run(first, 4, batches=9)
    saved = json.loads(json.dumps(first.state(), allow_nan=False))
    second = chain_of(seed=99, iterations=120)
    second.restore(saved)
    assert 0 < second.iteration < 120
    assert second.state() == saved
    run(second, 16)
    assert second.steps == whole.steps
    assert np.array_equal(second.best, whole.best)


def test_a_state_of_other_settings_is_refused():
    with pytest.raises(FitError) as refused:
        chain_of(gamma=1.0).restore(chain_of().state())
    assert str(refused.value) == (
        "annealing: the saved search has other settings; start anew or use the settings it was saved with"
    )


def test_a_start_outside_the_bounds_is_refused():
    with pytest.raises(FitError) as refused:
        Annealing(KINECT_SKIRT.maximum + 1, BOX, AnnealingSettings(), np.random.default_rng(0))
    assert str(refused.value) == "annealing: the start of the search lies outside the bounds; move it inside"
    for corner in (BOX.minimum, BOX.maximum):
        assert Annealing(corner, BOX, AnnealingSettings(), np.random.default_rng(0)).current.tolist() == corner.tolist()


def test_distances_for_other_candidates_are_refused():
    chain = chain_of()
    with pytest.raises(ValueError, match=r"^a batch needs at least one candidate$"):
        chain.ask(0)
    assert len(chain.ask()) == 1
    candidates = chain.ask(4)
    with pytest.raises(ValueError, match=r"wants the candidates of the last ask.., unchanged and in order$"):
        chain.tell(candidates + 1, np.zeros(4))
    for told, distances in ((candidates, np.zeros(3)), (candidates[:3], np.zeros(4)), (candidates[:3], np.zeros(3))):
        with pytest.raises(ValueError, match=r"wants one distance for each candidate of the last ask..$"):
            chain.tell(told, distances)


def test_a_chain_counts_what_was_tried_and_is_done_when_all_is():
    chain, done = chain_of(iterations=20), []
    while not chain.is_finished:
        candidates = chain.ask(4)
        done.append((len(candidates), chain.tell(candidates, annealing_gamma.smooth(candidates))))
    assert chain.evaluations == sum(tried for tried, _ in done)
    assert chain.iteration == sum(stepped for _, stepped in done) == len(chain.steps) - 1 == 20
    assert (chain.steps[0].iteration, chain.steps[0].is_accepted, chain.non_finite) == (0, True, 0)
    assert chain.best_history.tolist() == [step.best for step in chain.steps]
    assert chain.ask(4).shape == (0, len(BOX.minimum))
    assert chain.tell(np.empty((0, len(BOX.minimum))), np.empty(0)) == 0


def test_the_first_batch_goes_on_from_the_start_and_of_equal_distances_the_first_is_the_best():
    chain = chain_of(iterations=20)
    candidates = chain.ask(4)
    assert chain.tell(candidates, np.full(4, 0.1)) >= 1
    assert chain.best.tolist() == KINECT_SKIRT.initial.tolist()


def test_the_guess_of_an_acceptance_is_laplaces_share_of_recent_rises_that_would_pass():
    """Of rises of nothing, and of hardly less and more than the largest that may, two pass: (2 + 1) / (3 + 2)."""
    chain = chain_of()
    assert chain._guess_acceptance(0) == 0.5
    draws, temperature = chain._ahead(0)
    most = -temperature / chain.settings.gamma * math.log(draws[-1])
    chain._changes = [0.0, most * (1 - 1e-9), most * (1 + 1e-9)]
    assert chain._guess_acceptance(0) == (2 + 1) / (3 + 2)


def test_clipped_steps_end_on_the_bound_that_they_would_pass():
    chain = chain_of(beyond_bounds="clip")
    draws, temperature = chain._ahead(0)
    spread = BOX.interval * chain.settings.mu * temperature**chain.settings.sigma
    moved = BOX.maximum + np.tan(np.pi * (draws[:-1] - 0.5)) * spread
    assert (moved > BOX.maximum).any()
    assert chain._propose(BOX.maximum, 0) == pytest.approx(np.clip(moved, BOX.minimum, BOX.maximum))
    redrawn = chain_of(beyond_bounds="redraw")._propose(BOX.maximum, 0)
    assert redrawn == pytest.approx(bounds.redraw(BOX.maximum, draws[:-1], spread, BOX.minimum, BOX.maximum))


@pytest.mark.parametrize("iterations", [50, 1000])
def test_a_fit_of_any_length_cools_to_the_printed_last_temperature(iterations):
    settings = request_of(KINECT_SKIRT, [], iterations=iterations, seed=0, spacing=0.05).settings
    assert settings.iterations == iterations
    assert settings.temperature(iterations) == pytest.approx(AnnealingSettings().temperature(350))
    assert settings.temperature(1) > 0.9 * AnnealingSettings().temperature(1)


def test_a_fit_of_the_printed_length_is_the_printed_one():
    assert request_of(KINECT_SKIRT, [], iterations=350, seed=0, spacing=0.05).settings == AnnealingSettings(
        gamma=KINECT_SKIRT.gamma
    )


@pytest.mark.parametrize(("is_split", "iterations"), [(False, 60), (True, 15)])
def test_four_chains_share_batches_and_match_the_same_chains_alone(is_split, iterations):
    starts = np.tile(KINECT_SKIRT.initial, (4, 1))
    both = [
        ParallelChains(starts, BOX, AnnealingSettings(iterations=60), np.random.default_rng(8), is_split=is_split)
        for _ in range(2)
    ]
    run(both[0], 16)
    for chain in both[1].chains:
        run(chain, 1)
    for one, other in zip(both[0].chains, both[1].chains, strict=True):
        assert one.iteration == iterations
        assert one.steps == other.steps
    history = both[0].best_history
    assert history[-1] == both[0].best_distance == min(c.best_distance for c in both[0].chains)
    assert (np.diff(history) <= 0).all()
    assert not np.array_equal(both[0].chains[0].current, both[0].chains[1].current)


def test_chains_take_turns_when_there_are_fewer_lanes_than_chains():
    chains = ParallelChains(
        np.tile(KINECT_SKIRT.initial, (5, 1)), BOX, AnnealingSettings(iterations=6), np.random.default_rng(1)
    )
    run(chains, 3)
    assert [chain.iteration for chain in chains.chains] == [6] * 5
    again = ParallelChains(
        np.tile(KINECT_SKIRT.initial, (5, 1)), BOX, AnnealingSettings(iterations=6), np.random.default_rng(2)
    )
    again.restore(json.loads(json.dumps(chains.state())))
    assert again.best_distance == chains.best_distance


def test_gamma_table_still_runs_and_the_default_beats_a_hundredth_of_it():
    rows = {gamma: annealing_gamma.row(annealing_gamma.trap, AnnealingSettings(gamma=gamma), 4) for gamma in (1e3, 1e5)}
    assert rows[1e5]["best"] < rows[1e3]["best"] - 3.0  # mm; 49 and 38 with 30 seeds
    assert rows[1e5]["last_third"] < 0.1 < rows[1e3]["last_third"]


def test_bounds_without_width_is_refused():
    with pytest.raises(FitError) as refused:
        SearchBox(np.zeros(2), np.zeros(2), np.ones(2))
    assert str(refused.value) == (
        "search box: a lower bound is not below its upper bound; check minimum, maximum, interval"
    )
    with pytest.raises(FitError, match="lower bound"):
        SearchBox(np.zeros(2), np.ones(2), np.array([1.0, np.inf]))
    with pytest.raises(
        FitError, match=r"^search box: bounds and intervals differ in number; give each parameter all three$"
    ):
        SearchBox(np.zeros(2), np.ones(2), np.ones(3))


@pytest.mark.parametrize("kind", [np.random.MT19937, np.random.Philox, np.random.SFC64])
def test_a_chain_is_saved_with_any_kind_of_generator(kind):
    """The states of these generators hold arrays, which JSON does not know."""
    whole, again = (
        Annealing(KINECT_SKIRT.initial, BOX, AnnealingSettings(iterations=30), np.random.Generator(kind(seed)))
        for seed in (5, 6)
    )
    run(whole, 4, batches=2)
    again.restore(json.loads(json.dumps(whole.state(), allow_nan=False)))
    run(whole, 4)
    run(again, 4)
    assert again.steps == whole.steps
