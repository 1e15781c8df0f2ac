"""Searches and posterior draws against plain implementations of the published formulas, and small sums by hand."""

from __future__ import annotations

import numpy as np
import pytest
from cmaes import CMA

from fit.search import posterior
from fit.search.bounds import redraw, reflect
from fit.search.cma_es import Evolution
from fit.search.correlation import independent
from fit.search.emulator import Emulator
from fit.search.least_squares import BoundedSpace
from fit.search.tempering import FIRST_STEP, HOTTEST, Tempering

BOX = BoundedSpace(minimum=np.zeros(2), maximum=np.ones(2), is_log=np.zeros(2, bool))


def valley(units):
    """D [m] of a bowl about (0.3, 0.6), 0.02 at its bottom."""
    return 0.02 + ((units - [0.3, 0.6]) ** 2).sum(-1)


# --- correlation ----------------------------------------------------------------------------------


def test_frames_without_any_sight_have_no_part_in_the_number():
    """16 ones as in `test_search_correlation`; a take that sees nothing adds nothing."""
    slow = np.array([np.nan] * 3 + [1.0] * 16 + [np.nan])[:, None, None]
    assert independent([slow]) == pytest.approx(256 / 145)
    assert independent([slow, np.full((4, 1, 1), np.nan)]) == independent([slow])


def test_pairs_of_which_one_number_was_not_seen_do_not_count():
    """16 ones, the second unseen: lags 1 to 5 have 13, 13, 12, 11 and 10 pairs, and more than 10.83 count."""
    take = np.ones(16)
    take[1] = np.nan
    assert independent([take[:, None]]) == pytest.approx(225 / (14 + 2 * (13 + 13 + 12 + 11)))


# --- bounds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("beyond", "folded"), [(12.0, 12.0), (21.0, 19.0), (9.0, 11.0), (31.0, 11.0), (45.0, 15.0), (-1.0, 19.0)]
)
def test_reflection_between_10_and_20(beyond, folded):
    low, high = np.array([10.0]), np.array([20.0])
    assert reflect(np.array([beyond]), low, high) == pytest.approx([folded])


def test_reflection_never_leaves_the_bounds_by_rounding():
    """In binary numbers 0.03 + (0.33 - 0.03) is above 0.33."""
    low, high = np.array([0.03]), np.array([0.33])
    assert low + (high - low) > high
    assert reflect(high, low, high) == high


def test_a_redrawn_step_is_the_quantile_of_a_cauchy_distribution_cut_off_at_the_bounds():
    """Centre 0, spread 1, from -1 to 1, where the uncut distribution has a quarter and three quarters of its mass."""
    one = np.ones(1)
    for uniform, drawn_at in ((0.0, -1.0), (0.5, 0.0), (0.75, np.tan(np.pi / 8)), (1.0, 1.0)):
        assert redraw(0 * one, uniform * one, one, -one, one) == pytest.approx([drawn_at], abs=1e-12)
    # Spread 2 about 0, from -2 to 6: a quarter below, arctan(3) / pi above; the first draw is the lower bound.
    low, high = -2 * one, 6 * one
    assert redraw(0 * one, 0 * one, 2 * one, low, high) == pytest.approx([-2.0])
    above = np.arctan(3) / np.pi
    middle = 2 * np.tan(np.pi * (-0.25 + 0.5 * (above + 0.25)))
    assert redraw(0 * one, 0.5 * one, 2 * one, low, high) == pytest.approx([middle])
    # Spread 2 about 1, from 1 to 3: half of it is arctan(1) / 2.
    assert redraw(one, 0.5 * one, 2 * one, one, 3 * one) == pytest.approx([1 + 2 * np.tan(np.pi / 8)])


# --- tempering ------------------------------------------------------------------------------------


def tempered(start, numbers, chains, budget, seed):
    """Parallel tempering by its formulas: the coldest chain's draws of the second half, the steps and the swaps."""
    random = np.random.default_rng(seed)
    temperature = 30.0 ** (np.arange(chains) / (chains - 1))
    current, log = np.tile(start, (chains, 1)), np.full(chains, np.log(valley(start)))
    step = 0.1 * np.minimum(np.sqrt(temperature), 4)
    draws, asked, sweep, swaps = [], 1, 0, 0
    while asked + chains <= budget:
        tries = current + random.normal(size=current.shape) * step[:, None]
        tries = np.array([reflect(one, np.zeros(2), np.ones(2)) for one in tries])
        is_settling = asked < budget / 2
        for k, chance in enumerate(random.random(chains)):
            new = np.log(valley(tries[k]))
            is_accepted = chance < min(1, np.exp(-numbers * (new - log[k]) / temperature[k]))
            if is_accepted:
                current[k], log[k] = tries[k], new
            if is_settling:
                step[k] = min(step[k] * np.exp(0.13 * (is_accepted - 0.25)), 1.0)  # at most the box
        sweep, asked = sweep + 1, asked + chains
        for k in range(sweep % 2, chains - 1, 2):
            odds = np.exp(numbers * (log[k] - log[k + 1]) * (1 / temperature[k] - 1 / temperature[k + 1]))
            if random.random() < min(1, odds):
                current[[k, k + 1]], log[[k, k + 1]] = current[[k + 1, k]], log[[k + 1, k]]
                swaps += 1
        if not is_settling:
            draws.append(current[0].copy())
    return np.array(draws), step, swaps


@pytest.mark.parametrize("chains", [2, 5])
def test_tempering_follows_its_printed_formulas(chains):
    """Acceptance, swaps, temperatures and steps, over 60 sweeps."""
    start = np.array([0.9, 0.2])
    search = Tempering(start, BOX, 60 * chains + 1, 3, numbers=24.0, chains=chains)
    while not search.is_finished:
        candidates = search.ask(7)
        search.tell(candidates, valley(candidates))
    draws, steps, swaps = tempered(start, 24.0, chains, 60 * chains + 1, 3)
    assert search.draws == pytest.approx(draws, rel=1e-12)
    assert search.steps == pytest.approx(steps, rel=1e-12)
    assert 0 < swaps < 60 * chains
    assert (FIRST_STEP, HOTTEST) == (0.1, 30.0)


@pytest.mark.parametrize(("rejections", "step"), [(50, 0.1 * np.exp(-0.13 * 0.25 * 50)), (250, 1e-4)])
def test_a_candidate_that_blew_up_is_never_accepted_and_shrinks_the_step(rejections, step):
    """Half a hundred rejections in the settling half, and so many that the step ends at its least share of the box."""
    search = Tempering(np.array([0.5, 0.5]), BOX, 2 * rejections + 1, 3, numbers=24.0, chains=1)
    search.tell(search.ask(1), np.array([0.02]))
    while not search.is_finished:
        candidates = search.ask(1)
        search.tell(candidates, np.full(1, np.inf))
    assert search.current.tolist() == [[0.5, 0.5]]
    assert search.steps[0] == pytest.approx(step)
    assert len(search.draws) == rejections


def test_a_sweep_that_begins_at_half_of_the_budget_is_drawn():
    """Of 20 candidates the first is the start; of the 19 sweeps of one, the last ten begin with half of them told."""
    search = Tempering(np.array([0.5, 0.5]), BOX, 20, 3, numbers=24.0, chains=1)
    while not search.is_finished:
        candidates = search.ask(1)
        search.tell(candidates, valley(candidates))
    assert len(search.draws) == 10


def test_a_candidate_without_any_distance_is_taken_and_no_warning():
    search = Tempering(np.array([0.5, 0.5]), BOX, 10, 3, numbers=24.0, chains=1)
    search.tell(search.ask(1), np.array([0.02]))
    candidate = search.ask(1)
    search.tell(candidate, np.zeros(1))
    assert search.current == pytest.approx(candidate)


# --- draws from the emulated posterior ------------------------------------------------------------


def drawn(cost, starts, pieces, seed):
    """Differential evolution by halves as its formulas say."""
    random, count = np.random.default_rng(seed), starts.shape[1]
    walker = starts[np.arange(64) % len(starts)]
    walker = np.clip(walker + 3e-3 * random.normal(size=walker.shape), 0, 1)
    kept = []
    for step in range(300):
        gamma = 1.0 if step % 5 == 0 else 2.38 / np.sqrt(2 * count)
        for half in (0, 1):
            moved, still = np.arange(half, 64, 2), np.arange(1 - half, 64, 2)
            one, other = random.choice(still, 32), random.choice(still, 32)
            tries = walker[moved] + gamma * (walker[one] - walker[other]) + 1e-3 * random.normal(size=(32, count))
            chance = random.random(32)
            for k, n in enumerate(moved):
                if (tries[k] >= 0).all() and (tries[k] <= 1).all():
                    odds = (cost(tries[k : k + 1])[0] / cost(walker[n : n + 1])[0]) ** (-pieces / 2)
                    if chance[k] < odds:
                        walker[n] = tries[k]
        if step >= 100:
            kept.append(walker.copy())
    return np.concatenate(kept)


def test_draws_follow_their_printed_formulas():
    """Two hundred steps of 64 walkers are kept; one of the three first candidates lies on a bound."""
    starts = np.array([[0.0, 1.0], [0.3, 0.6], [0.5, 0.5]])

    def within(units):
        assert ((units >= 0) & (units <= 1)).all()
        return valley(units)

    found = posterior.draw(within, starts, 6.0, 4)
    assert found.shape == (200 * 64, 2)
    assert found == pytest.approx(drawn(valley, starts, 6.0, 4), rel=1e-9)


# --- CMA-ES ---------------------------------------------------------------------------------------


def test_a_flat_generation_is_followed_by_one_of_twice_the_population():
    """4 + floor(3 ln 2) = 6, then 12, then 24; the first candidate is the start and of no generation."""
    search = Evolution(np.array([0.5, 0.5]), BOX, 1 + 6 + 12 + 24, 0)
    sizes = []
    while not search.is_finished:
        candidates = search.ask(100)
        sizes.append(len(candidates))
        search.tell(candidates, np.full(len(candidates), 0.02))
    assert sizes == [1, 6, 12, 24]
    assert search.populations == [6, 12, 24, 48]


def test_a_generation_with_a_blow_up_is_not_flat_and_its_candidate_is_the_worst():
    search = Evolution(np.array([0.5, 0.5]), BOX, 13, 0)
    search.tell(search.ask(1), np.array([0.02]))
    told = search._run.tell
    seen = []
    search._run.tell = lambda generation: (seen.extend(generation), told(generation))
    candidates = search.ask(6)
    search.tell(candidates, np.array([0.02, np.inf, 0.02, 0.02, 0.02, 0.02]))
    assert search.populations == [6]
    assert [value for _, value in seen] == [0.02, 1e6, 0.02, 0.02, 0.02, 0.02]
    assert search.non_finite == 1


@pytest.mark.parametrize(("width", "populations"), [(0.9e-4, [6, 12]), (1e-4, [6]), (1.1e-4, [6])])
def test_a_generation_is_too_narrow_below_a_ten_thousandth_of_the_box(width, populations):
    search = Evolution(np.array([0.5, 0.5]), BOX, 13, 0)
    search.tell(search.ask(1), np.array([0.5]))
    places = iter([[0.5, width * (n == 5)] for n in range(6)])
    search._run.ask = lambda: next(places)
    search.tell(search.ask(6), 0.02 + 0.01 * np.arange(6))
    assert search.populations == populations


@pytest.mark.parametrize(("apart", "populations"), [(0.9e-6, [6, 12]), (1e-6, [6])])
def test_a_generation_is_flat_below_a_thousandth_of_a_millimetre(apart, populations):
    search = Evolution(np.array([0.5, 0.5]), BOX, 13, 0)
    search.tell(search.ask(1), np.array([0.5]))
    search.tell(search.ask(6), apart * np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    assert search.populations == populations


def test_a_run_draws_from_one_of_two_to_the_31_seeds_that_follow_from_the_searchs():
    search = Evolution(np.array([0.5, 0.5]), BOX, 10, 7)
    search.tell(search.ask(1), np.array([0.5]))
    seed = int(np.random.default_rng(7).integers(2**31))
    run = CMA(np.array([0.5, 0.5]), 0.25, bounds=np.tile([0.0, 1.0], (2, 1)), seed=seed, population_size=6)
    assert search.ask(3) == pytest.approx(np.array([run.ask() for _ in range(3)]))


def test_a_run_begins_a_quarter_of_the_box_wide_at_the_start_and_inside_the_bounds():
    search = Evolution(np.array([0.0, 1.0]), BOX, 10, 0)
    assert search._run.mean == pytest.approx([0.01, 0.99])
    assert search._run._sigma == 0.25
    assert search._run._bounds.tolist() == [[0.0, 1.0], [0.0, 1.0]]


# --- emulator -------------------------------------------------------------------------------------


def test_the_emulated_cost_is_that_of_kriging_with_the_fitted_ranges():
    """w = K^-1 (k + 1 (1 - 1'K^-1 k) / 1'K^-1 1), cost w' G w + caution s^2 v, v the variance of such weights."""
    random = np.random.default_rng(2)
    samples = random.random((9, 2))
    evaluated = np.stack([np.sin(3 * samples[:, 0] + k) + k * samples[:, 1] for k in range(5)], axis=1)
    gram = evaluated @ evaluated.T
    emulator = Emulator(samples, gram)
    lengths, nugget = np.exp(emulator._logs[:2]), np.exp(emulator._logs[2])

    def correlated(a, b):
        d = np.sqrt(5 * (((a[:, None] - b[None]) / lengths) ** 2).sum(-1))
        return (1 + d + d**2 / 3) * np.exp(-d)

    ones, whole = np.ones(9), correlated(samples, samples) + nugget * np.eye(9)
    projected = np.linalg.inv(whole)
    projected -= np.outer(projected @ ones, projected @ ones) / (ones @ projected @ ones)
    scale = np.trace(projected @ gram) / 8
    asked = random.random((4, 2))
    for candidate, cost in zip(asked, emulator.costs(asked, 0.6)[0], strict=True):
        near = correlated(candidate[None], samples)[0]
        weights = np.linalg.solve(whole, near)
        weights += np.linalg.solve(whole, ones) * (1 - weights.sum()) / (ones @ np.linalg.solve(whole, ones))
        assert weights.sum() == pytest.approx(1.0)
        variance = 1 - 2 * weights @ near + weights @ whole @ weights
        assert cost == pytest.approx(weights @ gram @ weights + 0.6 * scale * variance, rel=1e-6)
