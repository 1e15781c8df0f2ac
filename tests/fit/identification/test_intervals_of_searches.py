"""Intervals of searches: residuals of free rollouts in units of their deviation, and ends that fit as well."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.errors import BlowUpError
from fit.identification import trials
from fit.identification.free_intervals import blocks_of, free_intervals
from fit.identification.trials import ObservedSettings, Run
from fit.search.intervals import LinearModel, block_intervals
from fit.search.least_squares import BoundedSpace
from fit.search.steps import Step

SPACE = BoundedSpace(minimum=np.zeros(2), maximum=np.array([4.0, 10.0]), is_log=np.zeros(2, bool))
BEST = np.array([1.0, 9.9])  # of the second parameter no step upwards stays within the box


def seen(frames, missing=()):
    """A recording of one point at four frames a second that is not seen in some."""
    valid = np.ones((frames, 1), bool)
    valid[list(missing)] = False
    points = np.random.default_rng(frames).normal(0, 0.01, (frames, 1, 3))
    return SimpleNamespace(time=np.arange(frames) / 4, points=points, valid=valid)


def test_half_seconds_of_two_takes_are_blocks_of_their_own():
    """A second of four frames, the second one unseen, and then three frames; each frame has three numbers."""
    first, second = blocks_of([seen(4, missing=[1]), seen(3)])
    assert first.tolist() == [0] * 3 + [1] * 6
    assert second.tolist() == [2] * 6 + [3] * 3


def test_intervals_of_free_rollouts_are_those_of_the_residuals_in_their_own_deviation():
    """Points that follow both parameters along lines: the Jacobian is minus these lines, whatever the step."""
    recordings = [seen(12, missing=[2]), seen(9)]
    rng = np.random.default_rng(0)
    slopes = [rng.normal(0, 0.02, (2, *one.points.shape)) for one in recordings]  # m per share of the box

    def points(candidates):
        away = SPACE.to_unit(candidates) - SPACE.to_unit(BEST)
        return [np.einsum("cp,pfkx->cfkx", away, slope) for slope in slopes]

    found = free_intervals(SPACE, recordings, points, BEST)
    residual = np.concatenate([one.points[one.valid].ravel() for one in recordings])
    jacobian = np.concatenate(
        [-slope[:, one.valid].reshape(2, -1) for one, slope in zip(recordings, slopes, strict=True)], axis=1
    ).T
    deviation = np.sqrt(np.mean(residual**2))
    frames = [*(k // 2 for k in range(12) if k != 2), *(6 + k // 2 for k in range(9))]
    model = LinearModel(
        parameters=BEST, residuals=residual / deviation, jacobian=jacobian / deviation, block=np.repeat(frames, 3)
    )
    known = block_intervals(SPACE, model)
    assert found.ends == pytest.approx(known.ends)
    assert found.covariance == pytest.approx(known.covariance, rel=1e-6, abs=0)
    assert found.way == pytest.approx(known.way)
    assert found.is_identified.tolist() == known.is_identified.tolist()


def an_end(cost, at):
    return Step(
        is_sampling=False, vector=np.array(at), cost=cost, vectors=np.zeros((0, 2)), simulations=0, distances=(),
        slopes_at=np.array(at),
    )  # fmt: skip


def intervals_of(monkeypatch, rise=2 / 3, **changes):
    """What the intervals of a search are made with, whose best end costs 100 and another one e^rise times that."""
    given = {}
    monkeypatch.setattr(trials, "block_intervals", lambda space, model, **more: given.update(more, model=model))
    free = SimpleNamespace(
        recordings=[SimpleNamespace(duration=2.5), SimpleNamespace(duration=3.5)], by_place=lambda residuals: residuals,
        layout=SimpleNamespace(block=np.arange(4), is_judged=slice(None)),
    )  # fmt: skip
    run = SimpleNamespace(
        search=SimpleNamespace(space=SPACE, free=free), residuals=None, costs=np.zeros(0), units=np.zeros((0, 2)),
        unit=np.full(2, 0.5), least=[100.0], settings=SimpleNamespace(seed=0),
    )  # fmt: skip
    for name, value in changes.items():
        setattr(run, name, value)
    best = SimpleNamespace(parameters=np.array([1.0, 2.0]), cost=100.0, residuals=np.ones(4), jacobian=np.ones((4, 2)))
    ends = [an_end(100.0, [1.0, 2.0]), an_end(100.0 * np.exp(rise), [2.0, 2.0])]
    Run._intervals(run, best, ends)
    return given


def test_ends_of_descents_without_samples_count_a_number_for_every_two_seconds(monkeypatch):
    """Six seconds are 3 numbers: an end that costs e^(2/3) times the best one has a weight of e^-1; it is 0.25 off."""
    given = intervals_of(monkeypatch)
    share = np.exp(-1) / (1 + np.exp(-1))
    assert given["between"] == pytest.approx(np.array([[share * 0.25**2, 0.0], [0.0, 0.0]]))
    assert given["model"].jacobian[0].tolist() == [4.0, 10.0]  # by shares of the box


@pytest.mark.parametrize(("apart", "pieces"), [(0.001, 40.0), (0.1, 20.0)])
@pytest.mark.parametrize("rise", [2 / 3, 0.01])  # of the other end, whose weight is nothing, and nearly the best one's
def test_draws_count_the_numbers_that_the_trials_agree_on(monkeypatch, apart, pieces, rise):
    """Of 40 independent numbers chance moves a cost by 2 / 40; trials that end farther apart leave fewer numbers."""
    told = {}
    monkeypatch.setattr(trials, "independent", lambda takes: 40.0)
    monkeypatch.setattr(trials, "Emulator", lambda units, gram: None)
    monkeypatch.setattr(
        trials,
        "draw",
        lambda cost, places, pieces, seed: told.update(pieces=pieces) or np.array([[0.25, 0.2], [0.35, 0.2]]),
    )
    given = intervals_of(
        monkeypatch, rise, residuals=np.ones((6, 4)), costs=np.arange(6.0), units=np.zeros((6, 2)),
        least=[100.0, 100.0 * np.exp(apart)],
    )  # fmt: skip
    assert told["pieces"] == pytest.approx(pieces)
    # Draws lie 0 and 0.1 of the box from the best end, and the other end 0.25; the wider of both counts.
    share = np.exp(-pieces * rise / 2) / (1 + np.exp(-pieces * rise / 2))
    assert (0.25 * np.sqrt(share) > 0.1 / np.sqrt(2)) == (rise < 0.1)
    assert given["spread"][0] == pytest.approx(max(0.1 / np.sqrt(2), 0.25 * np.sqrt(share)))


@pytest.mark.parametrize(("rise", "pieces"), [(0.03, 2 / 0.03), (0.7, 40.0), (0.001, 900.0)])
def test_draws_count_the_numbers_that_the_ends_of_descents_agree_on(monkeypatch, rise, pieces):
    """Two trials agree to the last bit. Another end costs e^rise times the best, of which 0.05 counts at most.

    Of 900 independent numbers chance moves a cost by 2 / 900.
    """
    told = {}
    monkeypatch.setattr(trials, "independent", lambda takes: 900.0)
    monkeypatch.setattr(trials, "Emulator", lambda units, gram: None)
    monkeypatch.setattr(
        trials, "draw", lambda cost, places, pieces, seed: told.update(pieces=pieces) or np.array([[0.25, 0.2]])
    )
    intervals_of(
        monkeypatch, rise, residuals=np.ones((6, 4)), costs=np.arange(6.0), units=np.zeros((6, 2)),
        least=[100.0, 100.0],
    )  # fmt: skip
    assert told["pieces"] == pytest.approx(pieces)


def test_draws_begin_at_the_better_half_of_the_sound_samples_by_expected_cost_and_prior(monkeypatch):
    """Of seven samples one blew up; the prior has a variance of 1 / 12 about the start, in shares of the box."""
    told = {}

    class Emulated:
        def __init__(self, units, gram):
            told.update(units=units, gram=gram)

        def costs(self, units, caution):
            return np.full(len(units), 100.0 * caution), None

    def draw(cost, places, pieces, seed):
        told.update(cost=cost, places=places, seed=seed)
        return np.array([[0.25, 0.2], [0.35, 0.2]])

    monkeypatch.setattr(trials, "Emulator", Emulated)
    monkeypatch.setattr(trials, "draw", draw)
    monkeypatch.setattr(trials, "independent", lambda takes: told.update(takes=takes) or 40.0)
    units = np.stack([np.arange(7) / 7, np.zeros(7)], 1)
    residuals = np.arange(28.0).reshape(7, 4)
    is_judged = np.array([True, True, False, True])
    free = SimpleNamespace(by_place=lambda values: [values], layout=SimpleNamespace(
        block=np.arange(4), is_judged=is_judged), recordings=[])  # fmt: skip
    intervals_of(
        monkeypatch, search=SimpleNamespace(space=SPACE, free=free), residuals=residuals, units=units,
        costs=np.array([7.0, 3.0, np.inf, 5.0, 1.0, 6.0, 2.0]), settings=SimpleNamespace(seed=9),
    )  # fmt: skip
    sound = np.array([0, 1, 3, 4, 5, 6])
    assert told["units"] == pytest.approx(units[sound])
    assert told["gram"] == pytest.approx(residuals[sound] @ residuals[sound].T)
    assert told["places"] == pytest.approx(units[[4, 6, 1]])
    assert told["seed"] == 9
    assert told["cost"](np.array([[0.5, 0.5], [0.75, 0.5]])) == pytest.approx([100.0, 100.0 + 12 / 16])
    assert len(told["takes"][0]) == 3  # of the judged numbers


def test_few_sound_samples_leave_the_spread_to_the_ends_alone(monkeypatch):
    """An emulator of two parameters needs more than three samples; of four, one blew up."""
    monkeypatch.setattr(trials, "Emulator", lambda units, gram: pytest.fail("three samples are too few"))
    given = intervals_of(
        monkeypatch, residuals=np.ones((4, 4)), costs=np.array([1.0, 2.0, np.inf, 3.0]), units=np.zeros((4, 2))
    )
    share = np.exp(-1) / (1 + np.exp(-1))
    assert given["between"][0, 0] == pytest.approx(share * 0.25**2)
    assert given["spread"].tolist() == [0.0, 0.0]


def a_run(start=(1.0, 2.0), **settings):
    search = SimpleNamespace(space=SPACE, free=SimpleNamespace(simulations=0))
    return Run(search, np.array(start), ObservedSettings(samples=20, **settings), lambda step: None, ())


def test_a_search_has_the_prior_of_an_even_draw_from_its_box_about_the_start():
    """Of widths 4 and 10, on no log scale: variances of 16 / 12 and 100 / 12."""
    prior = a_run().prior
    assert prior.mean.tolist() == [1.0, 2.0]
    assert np.linalg.inv(prior.precision) == pytest.approx(np.diag([16 / 12, 100 / 12]))


def test_every_trial_has_scattered_samples_of_its_own():
    """The first one begins at the start and at scattered samples, later ones at other scattered samples."""
    run, drawn = a_run(seed=3), []
    for trial in range(3):
        drawn.append(run._next_units())
        run.units = np.concatenate([run.units, drawn[-1]])
        run.residuals, run.first = np.zeros((len(run.units), 1)), len(run.units)
        run.least = [100.0] * (trial + 1)
    assert drawn[0][0] == pytest.approx([0.25, 0.2])  # the start, in shares of the box
    every = np.concatenate(drawn)
    assert len(every) == 48
    assert len(np.unique(every, axis=0)) == 48


def test_valleys_are_scanned_about_the_best_of_known_ends_until_a_scan_gains_less_than_a_two_hundredth():
    """Known descents of cost 9, then 5 and 6, then 4.99: scanned about 9 and 5, and 4.99 is no gain worth a third."""
    run, scanned = object.__new__(Run), []
    run.settings, run.least = ObservedSettings(samples=16, pulls=(1.0,)), []
    costs = iter([[5.0, 6.0], [4.99], [1.0]])

    def end(cost):
        return SimpleNamespace(cost=cost, vector=np.array([cost])), None  # a known descent has no slopes any more

    run._sample, run._starts = (lambda: None), (lambda: [np.zeros(1)])
    run._descend = lambda pull, start: end(9.0)
    run._across = lambda before, found: scanned.append(before.cost) or [end(cost) for cost in next(costs)]
    assert [one.cost for one, _ in run._try()] == [9.0, 5.0, 6.0, 4.99]
    assert scanned == [9.0, 5.0]
    assert run.least == [4.99]


def test_a_trial_begins_at_its_own_best_sample():
    """Of five samples two are of an earlier trial, the best of all among them; the last is the best of the other."""
    run = object.__new__(Run)
    run.search, run.settings = SimpleNamespace(space=SPACE), ObservedSettings(samples=3, pulls=(1.0,))
    run.units, run.first = np.array([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [0.4, 0.4], [0.5, 0.6]]), 2
    run.costs = np.array([1.0, 9.0, 8.0, 7.0, 6.0])
    (start,) = run._starts()
    assert start == pytest.approx([0.5 * 4.0, 0.6 * 10.0])


def test_a_trial_simulates_its_number_of_samples_whatever_earlier_trials_did():
    """Five after two of an earlier trial, proposed by three: a batch of three, then one of two."""
    run, asked = object.__new__(Run), []
    run.search, run.settings = SimpleNamespace(space=SPACE), ObservedSettings(samples=5, pulls=(1.0,))
    run.units, run.first, run.waiting = np.zeros((2, 2)), 2, []
    run._next_units = lambda: np.full((3, 2), 0.5)
    run._record_samples = lambda vectors, known: None

    def evaluate(vectors):
        asked.append(len(vectors))
        run.units = np.concatenate([run.units, SPACE.to_unit(vectors)])

    run._evaluate = evaluate
    run._sample()
    assert asked == [3, 2]


def test_the_scattered_samples_are_one_batch_and_each_further_two_are_one():
    steps = [ObservedSettings(samples=samples, trials=2).steps for samples in (16, 17, 18, 19)]
    assert np.diff(steps).tolist() == [2, 0, 2]  # a batch more in each of two trials


def test_a_descent_that_blew_up_has_no_samples():
    run = object.__new__(Run)
    run.waiting, run.settings, run.distances = [], ObservedSettings(samples=5, pulls=(1.0,)), []

    def minimise(*given):
        raise BlowUpError("of too long a step", where="here", advice="shorten the step")

    run._minimise, run._simulations, run._take = minimise, lambda: 7, lambda step, is_known: None
    step, found = run._descend(1.0, BEST)
    assert found is None
    assert (step.vectors.shape, step.cost, step.simulations) == ((0, 2), np.inf, 7)
