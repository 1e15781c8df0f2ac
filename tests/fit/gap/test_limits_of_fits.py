"""Starts, steps and kept fits of a diagnosis at their limits, each against a figure worked by hand."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest

from fit.errors import FitError
from fit.gap import base_fit, gates
from fit.gap.checkpoint import Checkpoint
from fit.gap.fitting import Fitted, Pinned, Problem, fit
from fit.gap.hypotheses import _starts_of_refit
from fit.gap.likelihood import Likelihood
from fit.gap.numerics import refine
from fit.gap.posterior import SCALES, Linear
from fit.gap.screening import _places, screen, secants_of
from fit.methods import KINECT_SKIRT, SI
from fit.search import least_squares
from tests.fit.gap.linear_scene import LinearObserver
from tests.fit.gap.linear_takes import NOISE, LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_base_fit import CARRIED, FIRST_SAMPLES, SAMPLES, Pulled, gate_at, pulls
from tests.fit.gap.test_numerics import NUMBERS, Meshed, OfBlender
from tests.fit.gap.verdict_scene import KINDS


def begun_and_ended(monkeypatch, frequencies=(0.0,)):
    """Base fits of takes of few candidates: the starts of each fit, the fits and the gate."""
    for name, count in (("FIRST_SAMPLES", FIRST_SAMPLES), ("CARRIED", CARRIED), ("SAMPLES", SAMPLES)):
        monkeypatch.setattr(base_fit, name, count)
    monkeypatch.setattr(base_fit, "across_valleys", lambda observer, best: [])
    pulls(monkeypatch, *frequencies)
    world, kept, begun = Pulled(), Named(), []
    recall = kept.recall

    def recalled(names, go):
        begun.extend(task.vector for task in go.args[1])
        return recall(names, go)

    monkeypatch.setattr(kept, "recall", recalled)
    fits, _, gate = base_fit.fit_base(world, lambda *_: None, kept, 0)
    return world, begun, fits, gate


@pytest.mark.parametrize("apart", [0.15, 2.0])
def test_a_third_start_is_a_candidate_that_lies_apart_and_else_the_middle_of_the_best_two(monkeypatch, apart):
    """No candidate lies two boxes from another: then nothing but the middle is left."""
    monkeypatch.setattr(base_fit, "STARTS_APART", apart)
    monkeypatch.setattr(gates, "disagreement", lambda fits: 1.0 if len(fits) < 3 else 0.0)
    lying, lying_apart = [], base_fit._lying_apart
    monkeypatch.setattr(base_fit, "_lying_apart", lambda *given: lying.extend(lying_apart(*given)) or list(lying))
    world, begun, fits, _ = begun_and_ended(monkeypatch)
    space = Problem(world).space
    first_two = [one for one in fits if not np.array_equal(one.vector, fit(world, [_task(world, begun[2])])[0].vector)]
    middle = np.mean(space.to_unit(np.array([one.vector for one in first_two[:2]])), axis=0)
    assert len(begun) == 3
    assert len(lying) == (4 if apart == 0.15 else 2)
    assert space.to_unit(begun[2]) == pytest.approx(space.to_unit(lying[2]) if apart == 0.15 else middle, abs=1e-9)


def _task(world, vector):
    return base_fit.Task(vector, world.off)


def test_the_gate_of_the_pull_that_was_used_is_measured_at_the_best_fit(monkeypatch):
    at = []
    monkeypatch.setattr(
        gates, "predictability_gate", lambda observer, vector, off: at.append(vector) or gate_at(observer.frequency)
    )
    _, _, fits, _ = begun_and_ended(monkeypatch, (0.5, 2.0, 0.5))
    assert at[0] is fits[0].vector
    assert not np.array_equal(fits[0].vector, fits[1].vector)


def test_the_folder_of_fits_is_made_with_the_folders_above_it(tmp_path):
    Checkpoint(tmp_path / "new" / "diagnosis.partial", {"takes": ["a"]})
    assert (tmp_path / "new" / "diagnosis.partial" / "key.json").exists()


def test_a_key_of_more_than_a_mebibyte_is_compared_too(tmp_path):
    key = {"takes": ["a" * 2**21]}
    Checkpoint(tmp_path / "p", key)
    Checkpoint(tmp_path / "p", key)
    with pytest.raises(FitError, match="other takes or options"):
        Checkpoint(tmp_path / "p", {"takes": ["b" * 2**21]})


def test_a_fit_ends_where_a_step_saves_two_thousandths_or_goes_a_thousandth(monkeypatch):
    given, settings = [], least_squares.LeastSquaresSettings
    monkeypatch.setattr("fit.gap.fitting.LeastSquaresSettings", lambda **made: given.append(made) or settings(**made))
    world = LinearTakes(5)
    world.missed = world.noisy()
    fit(world, [_task(world, SI.initial)])
    assert {(made["cost_tolerance"], made["step_tolerance"]) for made in given} == {(2e-3, 1e-3)}


@pytest.mark.parametrize("step", [-3.0, 3.0])
def test_a_refits_parameters_begin_within_a_factor_of_e(step):
    row = np.linalg.qr(np.random.default_rng(2).normal(size=(NUMBERS, 1)))[0][:, 0]
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    jacobian[:, 0] = 50.0 * row
    observer = LinearObserver(-50.0 * step * row, jacobian, {"hem": 0 * row})
    found = screen(observer, observer.fitted(), ("hem",))["hem"]
    problem, starts, _ = _starts_of_refit(observer, observer.fitted(), found, "hem")
    vectors, _ = problem.unpack(np.array(starts))
    assert vectors[0, 0] / SI.initial[0] == pytest.approx(np.exp(np.sign(step)))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_parameter_that_moves_little_is_refitted_by_as_much_as_its_prior_lets_it(share):
    """A column as long as its prior's row goes half the way, and all of that costs least of none, half and all."""
    row = np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0]
    jacobian = np.zeros((NUMBERS, 6))
    observer = OfBlender(0.1, 0 * row, jacobian)
    jacobian[:, 1] = row / Problem(observer).prior_sd[1]
    missed = 0.2 * share * jacobian[:, 1]
    observer = OfBlender(0.1, missed / 0.1**2, jacobian)
    base = Fitted(KINECT_SKIRT.initial, observer.off, (), observer.missed, jacobian, np.zeros(6), True)
    found = refine(observer, observer, base)
    fine = float(observer.in_mm(missed * (4 / 6) ** 2))
    assert np.sqrt(found.errors.squared_mm) == pytest.approx(0.5 * fine, rel=1e-6)


def test_of_tries_on_the_finer_mesh_the_one_of_the_least_squares_is_taken():
    """Every residual is below zero, so that their plain sum is least where nothing is done."""
    row = np.abs(np.linalg.qr(np.random.default_rng(1).normal(size=(NUMBERS, 1)))[0][:, 0])
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    jacobian[:, 0] = 1e4 * row / SI.initial[0]
    observer = Meshed(0.1, -5e4 * row, jacobian)
    base = dataclasses.replace(observer.fitted(), jacobian=SI.initial[0] * jacobian)
    found = refine(observer, observer, base)
    before = float(observer.in_mm(observer.missed)) * (4 / 6) ** 2
    assert np.sqrt(found.errors.squared_mm) < 0.1 * before


def test_a_search_starts_within_a_factor_of_e():
    """Parameters would have to be e^2 as large, or e^-2 of that: of either only one e is tried at once."""
    for sign in (-1.0, 1.0):
        world = LinearTakes(3)
        world.missed = sign * 2.0 * world.sensitivity.sum(0) - 1.2 * world.rows["air_drag"][0]
        base = dataclasses.replace(world.base(), vector=SI.initial.copy(), residual=world.missed)
        noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
        linear = Linear(world, Likelihood(world, noise, base.residual, SCALES), base, dict(world.rows))
        vectors, _ = linear.starts(("air_drag",))
        assert np.log(vectors / SI.initial) == pytest.approx(np.full(vectors.shape, -sign))


def test_a_search_starts_where_the_squares_are_least():
    """A drag of 1.2 sizes is missing from residuals whose plain sum is least where the least of it is added."""
    world = LinearTakes(3)
    world.rows["air_drag"] *= np.sign(world.rows["air_drag"].sum())
    world.missed = -1.2 * world.rows["air_drag"][0]
    base = dataclasses.replace(world.base(), vector=SI.initial.copy(), residual=world.missed)
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    linear = Linear(world, Likelihood(world, noise, base.residual, SCALES), base, dict(world.rows))
    vectors, amplitudes = linear.starts(("air_drag",))
    starts = world.residuals(vectors, amplitudes)
    assert starts.sum(1).argmin() < (starts**2).sum(1).argmin()
    search, _ = world.search()
    (task,) = search._tasks(linear, [("air_drag",)])
    assert task.amplitudes == pytest.approx(amplitudes[(starts**2).sum(1).argmin()])


def test_ranges_and_offsets_are_in_typical_sizes_and_from_the_initial_parameters():
    """Of an effect of either sign the lower end counts as well; a parameter without a logarithm by its difference."""
    world = LinearTakes(3)
    world.missed = world.noisy()
    effects = world.library["gravity_tilt"]
    assert effects.low < 0.0
    assert effects.typical != 1.0
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    base = world.base()
    linear = Linear(world, Likelihood(world, noise, base.residual, SCALES), base, dict(world.rows))
    n = linear.columns.effects.index("gravity_tilt")
    assert linear.columns.low[n] == pytest.approx(effects.low / effects.typical)
    other = copy.copy(world)
    other.parameterisation = KINECT_SKIRT
    vector = KINECT_SKIRT.initial * 1.1
    count = len(vector)
    plain = Fitted(vector, world.off, (), base.residual, np.tile(base.jacobian[:, :1], count), np.zeros(count), True)
    linear = Linear(other, Likelihood(world, noise, base.residual, SCALES), plain, dict(world.rows))
    is_log = KINECT_SKIRT.is_log
    assert not is_log.all()
    assert linear.offset[~is_log] == pytest.approx(0.1 * KINECT_SKIRT.initial[~is_log])


def test_a_secant_does_not_leave_the_range_of_its_effect():
    """A slack of nearly its lower end would be below it by a typical size less."""
    slack = KINDS["clip_slack"]
    assert slack.low > -np.inf
    observer = LinearObserver(np.zeros(NUMBERS), np.zeros((NUMBERS, 5)), {"clip_slack": np.ones(NUMBERS)})
    amplitudes = observer.off
    column = observer.columns["clip_slack"].start
    amplitudes[column] = slack.low + 0.5 * slack.typical
    places = _places(observer, dataclasses.replace(observer.fitted(), amplitudes=amplitudes), "clip_slack")
    assert min(row[column] for row in places) == slack.low


def changed(name, **attributes):
    """An effect of the library with other attributes."""
    return type("Changed", (type(KINDS[name]),), attributes)()


def test_each_component_of_an_effect_of_one_sign_has_a_secant_of_its_own():
    tilt = changed("gravity_tilt", low=0.0)
    rows = np.random.default_rng(0).normal(size=(len(tilt.components), NUMBERS))
    effects = (KINDS["hem"], tilt)
    observer = LinearObserver(np.zeros(NUMBERS), np.zeros((NUMBERS, 5)), {tilt.name: rows}, effects=effects)
    assert tilt.is_one_sided
    (secant,) = secants_of(observer, observer.fitted(), (tilt.name,))[tilt.name]
    assert secant.rows == pytest.approx(rows)


def test_secants_of_an_effect_with_a_least_size_begin_there_and_not_at_its_first_probe():
    contact = KINDS["self_contact"]
    assert contact.no_size > 0.0
    probed = changed("self_contact", probes=(3.0 * contact.typical,))
    row = np.random.default_rng(0).normal(size=NUMBERS) / contact.typical
    observer = LinearObserver(np.zeros(NUMBERS), np.zeros((NUMBERS, 5)), {probed.name: row}, effects=(probed,))
    main, _ = secants_of(observer, observer.fitted(), (probed.name,))[probed.name]
    assert main.rows[0] == pytest.approx(row, rel=1e-3)


def test_a_kept_fit_without_one_of_its_parts_is_made_again(tmp_path):
    kept = Checkpoint(tmp_path / "p", {})
    one = Fitted(np.ones(1), np.zeros(1), (), np.ones(2), np.ones((2, 1)), np.ones(1), True)
    kept.recall(["fit"], lambda: [one])
    np.savez(tmp_path / "p" / "fit.npz", vector=np.ones(1), pinned=np.zeros(0))
    assert kept.recall(["fit"], lambda: [one])[0] is one


def test_a_candidate_near_one_start_is_no_other_however_far_the_first_one_is():
    world = Pulled()
    space = Problem(world).space
    units = np.array([np.full(5, 0.3), np.full(5, 0.7), np.full(5, 0.72)])
    found = space.to_unit(np.array(base_fit._lying_apart(world, space.from_unit(units))))
    assert found == pytest.approx(units[:2], abs=1e-9)


def test_a_size_that_nothing_decided_has_the_deviation_of_its_fit():
    world = LinearTakes(5)
    world.missed = world.noisy() - world.rows["hem"][0]
    known = Pinned(world.off, np.full(len(world.off), np.inf), 2.0)
    (found,) = fit(world, [base_fit.Task(SI.initial, world.off, ("hem",), iterations=2, pinned=known)])
    assert found.deviation.dtype == float
    assert np.isfinite(found.deviation).all()
