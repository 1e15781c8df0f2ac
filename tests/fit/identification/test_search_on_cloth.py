"""Searches on cloth: least squares by samples, descents and short windows, and interrupted fits."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from benchmarks import search as benchmark
from fit.cloth.model import Resolution
from fit.errors import BlowUpError
from fit.identification import trials
from fit.identification.calibrate import Model, calibrate
from fit.identification.observed import CATCHING, SHORT_WINDOWS, ObservedSearch, begin_observed
from fit.identification.request import request_of
from fit.identification.trials import ObservedSettings, between_ends, is_settled, scatter_of
from fit.methods import KINECT_SKIRT, SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from formats.archive import write_take
from tests.fit.here import hangtime_here
from tests.fit.scenes import material, sheet, simulate_take, swing

MESH = 0.09  # m


def swung_for(seconds):
    """Median fabric with linear damping of 3 /s; 2 mm of noise; the last second and a half are still."""
    time = np.arange(0, seconds, 1 / 30)
    path = swing(time, amplitude=0.05, hz=0.7, stop=seconds - 1.5)
    garment = sheet()
    row = material(garment, velocity_damping=3.0)
    return simulate_take(garment, time, path, row, noise=0.002, seed=2, resolution=Resolution(spacing=MESH))


@pytest.fixture(scope="module")
def swung():
    return swung_for(5.0)


@pytest.mark.slow
def test_least_squares_find_a_damping_of_3_within_5_percent_and_say_so(swung):
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH, search="least-squares")
    result = calibrate([swung], [], request)
    damping = next(p for p in result.parameters if p.name == "velocity_damping")
    assert damping.fitted == pytest.approx(3.0, rel=0.05)
    assert damping.interval_low < 3.0 < damping.interval_high
    assert damping.is_identified
    assert result.search == "least-squares"
    assert result.history == sorted(result.history, reverse=True)
    assert result.error.train_after.mean_m < 0.0036  # 3.2 mm is the mean length of such noise
    assert result.simulations < 400  # of two trials


@pytest.mark.slow
def test_short_windows_find_the_same_damping(swung):
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH, search="short-windows")
    result = calibrate([swung], [], request)
    assert result.search == "short-windows"
    assert next(p for p in result.parameters if p.name == "velocity_damping").fitted == pytest.approx(3.0, rel=0.1)


def test_between_short_windows_a_pull_catches_the_cloth_and_nothing_counts(swung):
    """Two seconds free, half a second caught. With a wrong damping the windows begin anew near the points."""
    recording = prepare(swung)
    cut = dataclasses.replace(recording, windows=SHORT_WINDOWS)
    time = np.array([0.0, 1.99, 2.01, 2.49, 2.51, 4.49, 4.51])
    assert SHORT_WINDOWS.is_free(time).tolist() == [True, True, False, False, True, True, False]
    assert (cut.targets(time)[1] > 0).any(1).tolist() == [False, False, True, True, False, False, True]
    assert not cut.counted[(cut.time > 2.01) & (cut.time < 2.49)].any()
    wrong = np.array([*SI.initial[:4], 0.5])

    def late_error(windows, frequency):
        chosen = dataclasses.replace(recording, windows=windows)
        observer = Observer([chosen], SI, (), frequency=frequency, resolution=Resolution(spacing=MESH))
        apart = chosen.points - observer.trajectories(wrong[None], observer.off[None])[0][0]
        late = (chosen.time > 2.5) & (chosen.time < 3.0)
        return np.sqrt(np.nanmean(apart[late][:, chosen.judged] ** 2))

    assert late_error(SHORT_WINDOWS, CATCHING) < 0.5 * late_error(None, 0.0)


@pytest.mark.slow
def test_a_pulled_descent_before_the_free_one_ends_in_the_same_damping(swung, monkeypatch):
    monkeypatch.setattr(trials, "STARTS_A_PULL", 1)
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH)
    search = ObservedSearch([prepare(swung)], SI, (), request.space, request.resolution)
    found = search.run(SI.initial, ObservedSettings(pulls=(1.0, 0.0)))
    assert len(found.path) == 2
    assert found.vector[4] == pytest.approx(3.0, rel=0.05)


def test_trials_with_different_ends_measure_by_how_much_chance_moves_a_cost():
    """Logarithms 0.1 and 0.2 above the least: sqrt((0.01 + 0.04) / 2) = 0.158; a trial that blew up does not count."""
    assert scatter_of([100 * np.exp(0.2), 100.0, 100 * np.exp(0.1)]) == pytest.approx(np.sqrt(0.025))
    assert scatter_of([100.0, np.inf]) == scatter_of([100.0]) == 0.0


def test_ends_count_by_their_likelihood():
    """Of 20 numbers an end that costs e^0.1 times the best has the weight 1/e; one that blew up has none."""
    apart = np.array([[0.0, 0.0], [0.3, -0.1], [1.0, 1.0]])
    found = between_ends(apart, np.array([0.0, 0.1, np.inf]), 20.0)
    share = np.exp(-1) / (1 + np.exp(-1))
    assert found == pytest.approx(share * np.array([[0.09, -0.03], [-0.03, 0.01]]))


@pytest.mark.slow
def test_fits_that_differ_by_a_rounding_error_end_in_each_others_intervals(monkeypatch):
    """A known truth in air is fitted without drag, so its trials end apart.

    `benchmarks/rounding.py` counts more of them.
    """
    case = dataclasses.replace(benchmark.make_case(0, air_drag=1.2), effects=())
    twins = []
    for seed in ("0", "1", "2"):
        monkeypatch.setenv("HANGTIME_JITTER", seed)
        twins.append(calibrate(case.takes[:1], [], case.request(search="least-squares")).parameters)
    for mine in twins:
        for k, p in enumerate(mine):
            assert not p.is_identified or all(p.interval_low <= t[k].fitted <= p.interval_high for t in twins)
    stretch, shear, bending, *_ = twins[0]
    assert stretch.is_identified
    assert stretch.interval_low < case.truth[0] < stretch.interval_high
    assert shear.is_identified
    assert shear.interval_low < case.truth[1] < shear.interval_high
    assert not bending.is_identified  # its truth is 5e-6 N m, and it ends at 2.4e-5


@pytest.fixture(scope="module")
def uninterrupted(swung):
    """The result of a request, its take, and the steps that it reports, by the search's name; run once each."""

    @functools.cache
    def run(name):
        take = swung_for(3.0) if name == "short-windows" else swung
        request = request_of(KINECT_SKIRT, [], iterations=1, seed=3, spacing=0.1, search=name)
        steps = []
        whole = calibrate([take], [], request, progress=lambda done, total, best: steps.append((done, total)))
        return request, take, whole, steps

    return run


@pytest.mark.parametrize(
    ("name", "stop"),
    [
        pytest.param("least-squares", 5, marks=pytest.mark.slow),
        pytest.param("least-squares", 34, marks=pytest.mark.slow),
        pytest.param("least-squares", 35, marks=pytest.mark.slow),
        pytest.param("least-squares", 60, marks=pytest.mark.slow),
        pytest.param("least-squares", -1, marks=pytest.mark.slow),
        ("short-windows", 2),
    ],
)
def test_interrupted_least_squares_go_on_at_the_last_step_that_was_done(uninterrupted, tmp_path, name, stop):
    """16 samples and 32 times two make 33 steps, then there are descents, and scans across valleys after the 34th.

    These six parameters cannot follow the take to its noise: by the 60th step one scan is the second one. The step
    after the last but one goes on from the best end.
    """
    request, take, whole, steps = uninterrupted(name)
    assert len(steps) > stop
    stop %= len(steps)
    file = tmp_path / "search.json"

    def interrupt(done, total, best):
        if done == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        calibrate([take], [], request, checkpoint=file, progress=interrupt)
    ends = []
    result = calibrate(
        [take], [], request, checkpoint=file, progress=lambda done, total, best: ends.append((done, total))
    )
    assert ends == steps[stop:]
    assert result.history == whole.history
    assert result.simulations == whole.simulations
    for again, before in zip(result.parameters, whole.parameters, strict=True):
        assert again.fitted == pytest.approx(before.fitted, rel=1e-12)
        assert again.interval_high == pytest.approx(before.interval_high, rel=1e-9)
    # Interrupted once more when all is done: only the Jacobian of the end is made again.
    ends.clear()
    done = calibrate([take], [], request, checkpoint=file, progress=lambda *words: ends.append(words))
    assert not ends
    assert done.history == whole.history
    assert [p.fitted for p in done.parameters] == pytest.approx([p.fitted for p in whole.parameters], rel=1e-12)


@pytest.mark.slow
def test_least_squares_know_the_distance_of_every_candidate(swung):
    """It is that of the free rollouts that the result is reported for, with an effect on as well."""
    request = request_of(SI, ["air_drag"], iterations=1, seed=1, spacing=MESH, search="least-squares")
    model = Model([prepare(swung)], request)
    search, settings = begin_observed(request, model.recordings, model.distances_of)
    vectors = request.space.from_unit(np.random.default_rng(0).random((3, len(request.parameters))))
    assert search.simulate(vectors, 0.0)[1] == pytest.approx(model.distances(vectors), rel=1e-12)
    initial = np.array([p.initial for p in request.parameters])
    found = search.run(initial, dataclasses.replace(settings, samples=20, trials=1, iterations=2))
    distances = [d for step in found.path for d in step.distances]
    assert len(distances) == found.path[-1].simulations  # one take: one each
    assert [step.is_sampling for step in found.path[:5]] == [True, True, True, False, True]
    assert distances[0] == pytest.approx(float(model.distances(initial[None])[0]), rel=1e-12)
    looked = found.path[2]
    assert looked.distances[-1] == pytest.approx(float(model.distances(looked.vector[None])[0]), rel=1e-12)
    assert found.ends[0][0] <= min(step.cost for step in found.path if step.is_sampling)


@pytest.mark.slow
def test_a_fit_begins_again_from_other_samples_until_two_agree(swung):
    """Of the same points, stated to be known to 2 mm, which they are, and to 0.2 mm."""
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH)
    surer = dataclasses.replace(swung, points_sd=0.1 * swung.points_sd)
    settings = ObservedSettings(samples=40, trials=6)
    scattered = []
    for take in (swung, surer):
        search = ObservedSearch([prepare(take)], SI, (), request.space, request.resolution)
        found = search.run(SI.initial, settings)
        firsts = [k for k, step in enumerate(found.path) if len(step.vectors) == 16]
        parts = [found.path[a:b] for a, b in zip(firsts, [*firsts[1:], -1], strict=True)]
        trials = [(part[0].vectors, min(s.cost for s in part if not s.is_sampling)) for part in parts]
        assert found.vector[4] == pytest.approx(3.0, rel=0.05)
        assert len(found.path) <= settings.steps
        assert 2 <= len(trials) < 6
        (first, _), (second, _), *_ = trials
        scattered.append(first)
        apart = np.abs(request.space.to_unit(first)[:, None] - request.space.to_unit(second)).max(2)
        assert apart.min() > 1e-3
        best, runner_up, *_ = sorted(cost for _, cost in trials)
        assert runner_up < 1.005 * best
    assert scattered[0] == pytest.approx(scattered[1])


def test_trials_end_with_two_that_agree():
    assert not is_settled([1020.0])
    assert not is_settled([2000.0, 1500.0, 1990.0])  # the two that agree are not the best
    assert is_settled([2000.0, 1500.0, 1507.0])
    assert not is_settled([2000.0, 1500.0, 1508.0])
    assert not is_settled([1500.0, np.inf])


@pytest.mark.slow
def test_the_best_end_is_followed_by_finer_differences_to_where_no_descent_stops_short(swung):
    """Descents of one iteration and of two stop at different costs; finer differences lead both to the same one.

    The two ends may differ by a twentieth in chi square. A deviation of one parameter makes 1.
    """
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH)
    last = []
    for iterations in (1, 2):
        search = ObservedSearch([prepare(swung)], SI, (), request.space, request.resolution)
        found = search.run(SI.initial, ObservedSettings(samples=20, iterations=iterations))
        *coarse, fine = (step.cost for step in found.path if not step.is_sampling)
        assert fine == min(cost for cost, _ in found.ends) < min(coarse)
        assert np.array_equal(found.vector, found.path[-1].vector)
        last.append(fine)
    assert last[0] == pytest.approx(last[1], abs=0.05)


@pytest.fixture
def breaking(swung):
    """A search whose simulations of some vectors blow up, and how far it goes."""
    request = request_of(SI, [], iterations=1, seed=1, spacing=MESH)

    def begun(is_broken):
        search = ObservedSearch([prepare(swung)], SI, (), request.space, request.resolution)
        simulate = search.simulate

        def simulated(vectors, pull):
            residuals, distances = simulate(vectors, pull)
            return np.where(is_broken(vectors)[:, None], np.nan, residuals), distances

        search.simulate = simulated
        return search.run(SI.initial, ObservedSettings(samples=20, iterations=1))

    return begun


def test_a_first_candidate_that_blows_up_is_refused(breaking):
    with pytest.raises(BlowUpError, match="initial parameters"):
        breaking(lambda vectors: vectors[:, 4] > 0.0)


@pytest.mark.slow
def test_later_candidates_that_blow_up_are_not_refused(breaking):
    found = breaking(lambda vectors: vectors[:, 0] > 1.2 * SI.initial[0])
    assert found.vector[0] <= 1.2 * SI.initial[0]
    # Where next to nothing can be simulated, the descent begins at once.
    found = breaking(lambda v: np.abs(v - SI.initial).max(1) > 0.3 * SI.initial[0])
    assert [step.is_sampling for step in found.path][:2] == [True, False]


@pytest.mark.parametrize(
    "name", ["annealing", *(pytest.param(n, marks=pytest.mark.slow) for n in ("restarts", "tempering", "cma-es"))]
)
def test_an_interrupted_fit_by_any_search_goes_on_to_the_same_end(swung, tmp_path, name):
    request = request_of(KINECT_SKIRT, [], iterations=12, seed=3, spacing=0.2, search=name)
    whole = calibrate([swung], [], request)
    calls = 0

    def interrupt(done, total, best):
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        calibrate([swung], [], request, checkpoint=tmp_path / "c.json", progress=interrupt)
    resumed = calibrate([swung], [], request, checkpoint=tmp_path / "c.json")
    assert resumed.history == whole.history
    assert resumed.parameters == whole.parameters
    assert whole.history[-1] < whole.history[0]


def test_the_command_line_names_the_searches_there_are(tmp_path, swung):
    write_take(tmp_path / "a.mcap", swung)
    done = hangtime_here("fit", "a.mcap", "--search", "guess", folder=tmp_path)
    assert done.returncode == 2
    assert "known searches: annealing, restarts, tempering, cma-es, least-squares" in done.stderr


@pytest.mark.slow
def test_the_benchmark_still_runs(capsys):
    runs = benchmark.main(truths=1, budget=12, only=["cma-es"])
    assert runs["cma-es"][0].history.shape == (12,)
    assert "velocity_damping" in capsys.readouterr().out
