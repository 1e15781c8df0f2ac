"""Amplitudes that the held edge alone identifies, and verdicts based on them."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth.effect import amplitudes_of
from fit.cloth.model import Resolution
from fit.effects import LIBRARY
from fit.gap.base_fit import across_valleys
from fit.gap.diagnosis import diagnose
from fit.gap.edge_fit import beside_another, detectable_on_edge, disputed, leads, trust_in_edge
from fit.gap.fitting import Fitted, Pinned, Problem, Task, fit
from fit.gap.hypotheses import polishing, refits
from fit.gap.screening import screen
from fit.methods import SI
from fit.observer.edge import MOVING_CERTAIN, NUMBERS_A_FRAME, RESTING_CERTAIN, EdgeErrors, edge_errors, is_seen_on_edge
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.verdict_scene import EFFECTS, KINDS, signature
from tests.fit.scenes import material, sheet, simulate_take, swing

SLACK = "clip_slack"
FRAMES = 5


def an_observer(takes=3):
    """Ten numbers of the cloth and an edge of five frames a take, whatever is simulated."""
    edge = takes * NUMBERS_A_FRAME * (FRAMES + 1)
    take = np.append(np.zeros(10, int), np.repeat(np.arange(takes), NUMBERS_A_FRAME * (FRAMES + 1)))
    frame = np.append(
        np.zeros(10, int), np.tile(np.append(np.repeat(np.arange(FRAMES), NUMBERS_A_FRAME), [-1] * 4), takes)
    )
    layout = SimpleNamespace(
        take=take, frame=frame, sd=np.full(10 + edge, 1e-3), is_judged=np.arange(10 + edge) < 10,
        is_edge=np.arange(10 + edge) >= 10, block=np.zeros(10 + edge, int),
    )  # fmt: skip
    found = SimpleNamespace(**EFFECTS, off=amplitudes_of(LIBRARY), layout=layout, parameterisation=SI)
    chosen = layout.is_edge
    found.edge_errors = lambda r: edge_errors(take[chosen], frame[chosen], r[chosen], layout.sd[chosen])
    return found


def stretched(observer, size):
    """A residual whose edge is too long by so many deviations in every take, and nothing else."""
    residual = np.zeros(len(observer.layout.take))
    residual[observer.layout.frame < 0] = np.tile([0.0, 0.0, 0.0, size], len(np.unique(observer.layout.take)))
    return residual


def test_a_constant_error_counts_once_however_many_takes_show_it():
    """Six deviations in each of three takes: 36 as in one alone, since a marker's own offset is in all of them."""
    for takes in (1, 3):
        observer = an_observer(takes)
        found = observer.edge_errors(stretched(observer, 6.0))
        assert (found.moving, found.count) == (0.0, takes * FRAMES * NUMBERS_A_FRAME)
        assert found.resting == pytest.approx(36.0)
        assert found.mm == pytest.approx(6.0)
    assert edge_errors(*(np.zeros(0, int),) * 2, *(np.zeros(0),) * 2) == EdgeErrors()


def test_noise_that_takes_state_too_large_hides_no_constant_error():
    """Of 1150 that noise may make of what varies there are 800; 54 is 50 above chance, twice what is certain."""
    found = EdgeErrors(moving=800.0, count=1000, resting=54.0)
    assert found.beyond_noise == pytest.approx(50.0 / RESTING_CERTAIN)
    assert is_seen_on_edge(found, dataclasses.replace(found, resting=20.0))
    assert not is_seen_on_edge(found, dataclasses.replace(found, resting=35.0))  # 19 of them are less than certain
    assert not is_seen_on_edge(dataclasses.replace(found, resting=200.0), dataclasses.replace(found, resting=120.0))
    assert EdgeErrors(moving=1270.0, count=1000).beyond_noise == pytest.approx(120.0 / MOVING_CERTAIN)


def test_the_cloths_certainty_is_lowered_by_the_error_of_mesh_and_solver():
    """Ten numbers of 1 mm noise, wrong by 3 mm a point or sqrt(3) a number: 1 + 10 x 3 / (9 x 1)."""
    assert trust_in_edge(an_observer(), 3.0) == pytest.approx(1 + 30 / 9)
    assert trust_in_edge(an_observer(), 0.0) == 1.0


def fitted_to(observer, size, effect=SLACK, slope=-1.0):
    """A fit that has the effect half a typical size and leaves an edge too long by `size` deviations.

    A typical size more changes the length by `slope` deviations.
    """
    amplitudes = observer.off.copy()
    amplitudes[observer.columns[effect]] = 0.5 * KINDS[effect].typical
    jacobian = np.zeros((len(observer.layout.take), 6))
    jacobian[:, 5] = stretched(observer, slope)
    return Fitted(SI.initial, amplitudes, (effect,), stretched(observer, size), jacobian, np.ones(6), True)


def test_a_size_that_the_edge_contradicts_is_taken_from_the_edge():
    """8 deviations at 4 a typical size: two more of them; three takes know it to 1/4, as one does alone."""
    for takes in (1, 3):
        observer = an_observer(takes)
        pinned = disputed(observer, stretched(observer, 10.0), fitted_to(observer, 8.0, slope=-4.0), 7.0)
        (column,) = np.arange(len(observer.off))[observer.columns[SLACK]]
        assert pinned.amplitudes[column] == pytest.approx(2.5 * KINDS[SLACK].typical, rel=1e-6)
        assert pinned.sd[column] == pytest.approx(KINDS[SLACK].typical / 4, rel=1e-6)
        assert np.isinf(np.delete(pinned.sd, column)).all()
        assert pinned.trust == 7.0


def test_what_varies_at_the_edge_counts_a_quarter_for_its_noise_may_be_slow():
    """15 frames at 2 deviations a typical size weigh 15 x 4 / 4 = 15: the size is known to 1 / sqrt(15)."""
    observer = an_observer()
    frames = (observer.layout.frame >= 0) & observer.layout.is_edge
    varying = np.zeros(len(frames))
    varying[np.flatnonzero(frames)[::NUMBERS_A_FRAME]] = 1.0
    found = fitted_to(observer, 0.0)
    found = dataclasses.replace(found, residual=4.0 * varying, jacobian=np.outer(-2.0 * varying, np.arange(6) == 5))
    pinned = disputed(observer, 5.0 * varying, found, 7.0)
    (sd,) = pinned.sd[observer.columns[SLACK]] / KINDS[SLACK].typical
    assert pinned.amplitudes[observer.columns[SLACK]] == pytest.approx(2.5 * KINDS[SLACK].typical, rel=1e-6)
    assert sd == pytest.approx(1 / np.sqrt(15), rel=1e-6)


def test_a_size_that_the_edge_confirms_or_cannot_correct_stays():
    observer = an_observer()
    without = stretched(observer, 10.0)
    assert disputed(observer, without, fitted_to(observer, 1.9, slope=-4.0), 7.0) is None  # within two deviations
    assert disputed(observer, without, fitted_to(observer, 2.1, slope=-4.0), 7.0) is not None
    moved = fitted_to(observer, 8.0, slope=-4.0)
    elsewhere = np.where(observer.layout.frame < 0, 0.0, 30.0) * observer.layout.is_edge
    moved = dataclasses.replace(moved, residual=moved.residual + elsewhere)
    assert disputed(observer, without + elsewhere, moved, 7.0) is None  # most of what is off stays off
    air = fitted_to(observer, 8.0, "air_drag", -4.0)
    assert disputed(observer, without, air, 7.0) is None


def test_a_component_that_the_edge_does_not_determine_stays_where_the_cloth_has_it():
    """A scale of the points moves the edge; one of the whole scene only by a solver's last digits."""
    observer, scale = an_observer(), "depth_scale"
    points, scene = np.arange(len(observer.off))[observer.columns[scale]]
    amplitudes = observer.off.copy()
    amplitudes[[points, scene]] = 0.005, 0.002
    jacobian = np.zeros((len(observer.layout.take), 7))
    jacobian[:, 5], jacobian[:, 6] = stretched(observer, -4.0), stretched(observer, 1e-3)
    moved = Fitted(SI.initial, amplitudes, (scale,), stretched(observer, 8.0), jacobian, np.ones(7), True)
    pinned = disputed(observer, stretched(observer, 10.0), moved, 7.0)
    assert pinned.amplitudes[points] == pytest.approx(0.005 + 2.0 * KINDS[scale].typical, rel=1e-6)
    assert pinned.amplitudes[scene] == pytest.approx(0.002)
    assert np.isinf(pinned.sd[scene])


def test_the_size_of_an_effect_beside_it_that_moves_no_edge_stays():
    observer, hem = an_observer(), "hem"
    alone = fitted_to(observer, 8.0, slope=-4.0)
    amplitudes = alone.amplitudes.copy()
    amplitudes[observer.columns[hem]] = 0.01
    both = dataclasses.replace(
        alone, amplitudes=amplitudes, active=(hem, SLACK), jacobian=np.insert(alone.jacobian, 5, 0.0, axis=1)
    )
    pinned = disputed(observer, stretched(observer, 10.0), both, 7.0)
    assert pinned.amplitudes[observer.columns[hem]] == pytest.approx(0.01)
    assert pinned.amplitudes[observer.columns[SLACK]] == pytest.approx(2.5 * KINDS[SLACK].typical, rel=1e-6)
    assert np.isinf(pinned.sd[observer.columns[hem]]).all()


def test_a_size_that_the_edge_decided_is_decided_with_what_else_moves_the_edge():
    """Slack of 2.5 typical sizes at 4 deviations each: 1/4 of one; a scale of the points at 3 each, 1/3, is nothing.

    An effect that lengthens the edge as `clip_slack` does is collinear with it.
    """
    observer, hem, scale = an_observer(), "hem", "depth_scale"
    decided = disputed(observer, stretched(observer, 10.0), fitted_to(observer, 8.0, slope=-4.0), 7.0)
    start = dataclasses.replace(fitted_to(observer, 0.0, slope=-4.0), amplitudes=decided.amplitudes, pinned=decided)
    slack, (points, scene) = observer.columns[SLACK], np.arange(len(observer.off))[observer.columns[scale]]
    nothing = np.zeros(len(observer.layout.take))
    sideways = np.roll(stretched(observer, 3.0), -1)
    for effect, rows in ((hem, nothing[None]), (scale, np.stack([sideways, nothing]))):
        pinned = beside_another(observer, start, effect, rows)
        assert pinned.amplitudes[slack] == pytest.approx(2.5 * KINDS[SLACK].typical, rel=1e-6)
        assert pinned.sd[slack] == pytest.approx(KINDS[SLACK].typical / 4, rel=1e-3)
        assert pinned.trust == 7.0
        assert np.isinf(pinned.sd[[scene, *np.arange(len(observer.off))[observer.columns[hem]]]]).all()
        assert pinned.sd[points] == (pytest.approx(KINDS[scale].typical / 3, rel=1e-3) if effect == scale else np.inf)
    assert beside_another(observer, start, hem, stretched(observer, -4.0)[None]) is None
    assert beside_another(observer, dataclasses.replace(start, pinned=None), hem, nothing[None]) is None


def test_fits_that_continue_from_a_size_of_the_edge_keep_it():
    """Clips that are 12 mm too far apart were taken for 9: beside a curl the edge is asked again."""
    observer = Observer([prepare(a_slack_take(-0.012))], SI, LIBRARY, frequency=1.0, resolution=Resolution(spacing=0.1))
    known, sd = observer.off.copy(), np.full(len(observer.off), np.inf)
    columns = observer.columns[SLACK]
    known[columns], sd[columns] = -0.009, 1e-4
    (start,) = fit(observer, [Task(SI.initial, known, (SLACK,), iterations=1, pinned=Pinned(known, sd, 1e4))])
    assert polishing(start).pinned is start.pinned
    beyond = across_valleys(observer, start)
    assert beyond
    assert all(task.pinned is start.pinned for task in beyond)
    found = screen(observer, start, ("rest_curvature",))
    freed = dataclasses.replace(start, pinned=None)
    imitable = screen(observer, freed, tuple(found))["rest_curvature"].absorbed
    assert found["rest_curvature"].absorbed < imitable - 1e-3  # a size that is decided imitates nothing
    (both,) = fit(observer, refits(observer, start, found, ["rest_curvature"]))
    assert both.pinned.amplitudes[columns] == pytest.approx(-0.012, rel=0.05)
    (error,) = both.pinned.sd[columns]  # beside a curl the edge knows the size to 1.3 mm
    assert both.amplitudes[columns] == pytest.approx(both.pinned.amplitudes[columns], abs=error)


def screened(observer, **slopes):
    return {
        name: signature(raw=stretched(observer, slope)[None], typical=KINDS[name].typical)
        for name, slope in slopes.items()
    }


def test_an_effect_that_would_explain_the_edge_is_refitted_whatever_the_cloth_promises():
    observer = an_observer()
    seen = screened(observer, air_drag=4.0, clip_slack=4.0, time_offset=0.0, attachment_offset=-2.0)
    assert leads(observer, seen, stretched(observer, 8.0)) == ["clip_slack", "attachment_offset"]
    assert leads(observer, seen, stretched(observer, 4.0)) == []


def test_only_the_two_effects_that_leave_the_least_at_the_edge_are_refitted_for_it():
    """Four explain the stretch, and three of them also push the edge aside, by 0.1 to 0.3 of it."""
    observer = an_observer()
    rest = np.flatnonzero(observer.layout.frame < 0)
    wrong = stretched(observer, 8.0)
    seen = {}
    for name, aside in (("eroded_outline", 0.3), ("clock_drift", 0.2), ("clip_slack", 0.1), ("time_offset", 0.0)):
        row = stretched(observer, 4.0)
        row[rest[::NUMBERS_A_FRAME]] = 4.0 * aside
        seen[name] = signature(raw=row[None], typical=KINDS[name].typical)
    assert leads(observer, seen, wrong) == ["time_offset", "clip_slack"]


def test_the_edge_shows_a_size_from_which_it_is_certain():
    """Two deviations a typical size: 25 = 4 a^2 at 2.5 typical sizes."""
    observer = an_observer()
    found = detectable_on_edge(observer, an_observer(2), screened(observer, air_drag=4.0, clip_slack=2.0, hem=1.0))
    assert found == {"air_drag": np.inf, SLACK: pytest.approx(2.5 * KINDS[SLACK].typical), "hem": np.inf}
    varying = screened(observer, time_offset=0.0)
    row = varying["time_offset"].raw[0]
    row[observer.layout.frame >= 0] = 1.0
    row[:10] = 0.0
    # 20 numbers a take of one deviation each, in the two takes judged on: 60 = 40 a^2.
    expected = np.sqrt(1.5) * KINDS["time_offset"].typical
    assert detectable_on_edge(observer, an_observer(2), varying)["time_offset"] == pytest.approx(expected)


def a_slack_take(amplitude, *, noise=0.0005, seed=0):
    time = np.arange(0, 3.0, 1 / 30)
    garment = sheet(grid=5)
    row = material(garment, velocity_damping=1.5, bending_stiffness=3e-5, shear_stiffness=40.0)
    sizes = amplitudes_of(LIBRARY, clip_slack=amplitude)[None]
    moved = swing(time, amplitude=0.05, hz=0.7, sideways=0.02, stop=2.0)
    return simulate_take(
        garment,
        time,
        moved,
        row,
        effects=LIBRARY,
        amplitudes=sizes,
        noise=noise,
        seed=seed,
        resolution=Resolution(spacing=0.1),
    )


def test_a_pinned_amplitude_stays_where_it_is_known_and_the_fabric_is_fitted_beside_it():
    """Clips 12 mm too far apart, known as 9 mm to 0.1 mm: the fit has 9 mm, and says 0.1."""
    observer = Observer([prepare(a_slack_take(-0.012))], SI, LIBRARY, frequency=1.0, resolution=Resolution(spacing=0.1))
    known, sd = observer.off.copy(), np.full(len(observer.off), np.inf)
    columns = observer.columns[SLACK]
    known[columns], sd[columns] = -0.009, 1e-4
    start = observer.off.copy()
    start[columns] = -0.006
    free, held = fit(
        observer,
        [
            Task(SI.initial, start, (SLACK,), iterations=4),
            Task(SI.initial, start, (SLACK,), iterations=4, pinned=Pinned(known, sd, 1e4)),
        ],
    )
    assert free.pinned is None
    assert held.pinned.trust == 1e4
    assert held.amplitudes[columns] == pytest.approx(-0.009, abs=1e-4)
    assert held.deviation[-1] == pytest.approx(1e-4 / KINDS[SLACK].typical)
    assert not np.allclose(held.vector, SI.initial)
    assert Problem(observer, (SLACK,)).prior_sd[-1] > 1.0


@pytest.mark.slow
def test_clips_too_far_apart_are_named_though_the_cloth_hardly_shows_it():
    """12 mm of 400: taut cloth below the clips hangs as before."""
    takes = [a_slack_take(-0.012, seed=seed) for seed in range(2)]
    found = diagnose(takes[:1], takes[1:], resolution=Resolution(spacing=0.1)).diagnosis
    assert (found.verdict, found.named) == ("effect", ["clip_slack"])
    (slack,) = (e for e in found.effects if e.id == "clip_slack")
    assert slack.amplitude == pytest.approx(-0.012, abs=0.003)  # markers may sit 1 mm beside, at either end
    assert slack.amplitude_interval[0] < -0.012 < slack.amplitude_interval[1]
    assert found.gap.edge_mm == pytest.approx(4.2, abs=0.3)  # 0.012 sqrt(1/8)
    assert found.gap.edge_with_effect_mm < 1.0


@pytest.mark.parametrize(("slope", "is_told"), [(0.97, False), (0.99, True)])
def test_the_edge_determines_a_component_that_it_knows_to_a_typical_size(slope, is_told):
    """One deviation a typical size, beside a prior of five: 1 / (s^2 + 1/25) is 1 at 0.98."""
    observer = an_observer()
    start = dataclasses.replace(fitted_to(observer, 0.0, slope=-4.0), pinned=known_slack(observer))
    sideways = np.roll(stretched(observer, slope), -1)
    pinned = beside_another(observer, start, "hem", sideways[None])
    assert np.isfinite(pinned.sd[observer.columns["hem"]]).all() == is_told


def known_slack(observer):
    """A `clip_slack` of half a typical size, identified by the held edge."""
    sd = np.full(len(observer.off), np.inf)
    sd[observer.columns[SLACK]] = KINDS[SLACK].typical / 4
    amplitudes = observer.off.copy()
    amplitudes[observer.columns[SLACK]] = 0.5 * KINDS[SLACK].typical
    return Pinned(amplitudes, sd, 7.0)


def test_what_the_edge_decided_is_decided_anew_where_a_residual_is_left_there():
    """2 deviations at -4 a typical size: half a one more, and one of a hem that takes 3 of sideways."""
    observer = an_observer()
    sideways = np.roll(stretched(observer, 3.0), -1)
    start = dataclasses.replace(fitted_to(observer, 2.0, slope=-4.0), pinned=known_slack(observer))
    start = dataclasses.replace(start, residual=start.residual - sideways)
    pinned = beside_another(observer, start, "hem", sideways[None])
    assert pinned.amplitudes[observer.columns[SLACK]] == pytest.approx(1.0 * KINDS[SLACK].typical, rel=1e-6)
    assert pinned.amplitudes[observer.columns["hem"]] == pytest.approx(1.0 * KINDS["hem"].typical, rel=1e-6)


def test_a_one_sided_effect_puts_the_edge_right_on_its_own_side_only():
    observer = an_observer()
    one_sided = next(e.name for e in LIBRARY if e.moves_edge and e.is_one_sided and len(e.components) == 1)
    for slope, leading in ((-4.0, [one_sided]), (4.0, [])):
        assert leads(observer, screened(observer, **{one_sided: slope}), stretched(observer, 8.0)) == leading
