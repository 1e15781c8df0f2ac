"""Sizes that the held edge tells by itself, and verdicts that rest on it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.cloth.simulator import Resolution
from fit.effects import LIBRARY
from fit.effects.base import amplitudes_of, columns_of
from fit.gap.diagnosis import diagnose
from fit.gap.edge import MOVING_CERTAIN, NUMBERS, RESTING_CERTAIN, EdgeErrors, edge_errors, is_seen_on_edge
from fit.gap.edge_fit import detectable_on_edge, disputed, leads, trust_in_edge
from fit.gap.fitting import Fitted, Pinned, Problem, Task, fit
from fit.gap.observer import Observer
from fit.gap.probabilities import probabilities
from fit.gap.verdict import decide, passing_effects
from fit.parameterisations import SI
from fit.recording import prepare
from tests.fit.scenes import material, sheet, simulate_take, swing
from tests.fit.verdict_scene import COARSE, evidence_of, hypothesis, with_edge

NAMES = [e.name for e in LIBRARY]
SLACK = NAMES.index("clip_slack")
FRAMES = 5


def an_observer(takes=3):
    """Ten numbers of the cloth and an edge of five frames a take, whatever is simulated."""
    edge = takes * NUMBERS * (FRAMES + 1)
    take = np.append(np.zeros(10, int), np.repeat(np.arange(takes), NUMBERS * (FRAMES + 1)))
    frame = np.append(np.zeros(10, int), np.tile(np.append(np.repeat(np.arange(FRAMES), NUMBERS), [-1] * 4), takes))
    layout = SimpleNamespace(
        take=take, frame=frame, sd=np.full(10 + edge, 1e-3), is_judged=np.arange(10 + edge) < 10,
        is_edge=np.arange(10 + edge) >= 10, block=np.zeros(10 + edge, int),
    )  # fmt: skip
    found = SimpleNamespace(
        effects=LIBRARY, columns=columns_of(LIBRARY), off=amplitudes_of(LIBRARY), layout=layout, in_mm=lambda row: 2.0
    )
    chosen = layout.is_edge
    found.edge_errors = lambda r: edge_errors(take[chosen], frame[chosen], r[chosen], layout.sd[chosen])
    return found


def stretched(observer, size):
    """A residual whose edge is too long by so many deviations in every take, and nothing else."""
    residual = np.zeros(len(observer.layout.take))
    residual[observer.layout.frame < 0] = np.tile([0.0, 0.0, 0.0, size], len(np.unique(observer.layout.take)))
    return residual


def test_what_is_off_constantly_counts_once_however_many_takes_show_it():
    """Six deviations in each of three takes: 36 as in one alone, since a marker's own offset is in all of them."""
    for takes in (1, 3):
        observer = an_observer(takes)
        found = observer.edge_errors(stretched(observer, 6.0))
        assert (found.moving, found.count) == (0.0, takes * FRAMES * NUMBERS)
        assert found.resting == pytest.approx(36.0)
        assert found.mm == pytest.approx(6.0)
    assert edge_errors(*(np.zeros(0, int),) * 2, *(np.zeros(0),) * 2) == EdgeErrors()


def test_noise_that_takes_state_too_large_hides_nothing_that_is_off_constantly():
    """Of 1150 that noise may make of what varies there are 800; 54 is 50 above chance, twice what is certain."""
    found = EdgeErrors(moving=800.0, count=1000, resting=54.0)
    assert found.beyond_noise == pytest.approx(50.0 / RESTING_CERTAIN)
    assert is_seen_on_edge(found, dataclasses.replace(found, resting=20.0))
    assert not is_seen_on_edge(found, dataclasses.replace(found, resting=35.0))  # 19 of them are less than certain
    assert not is_seen_on_edge(dataclasses.replace(found, resting=200.0), dataclasses.replace(found, resting=120.0))
    assert EdgeErrors(moving=1270.0, count=1000).beyond_noise == pytest.approx(120.0 / MOVING_CERTAIN)


def test_the_cloth_believes_itself_too_much_by_what_mesh_and_solver_are_wrong_by():
    """Ten numbers of 1 mm noise, wrong by 3 mm a point or sqrt(3) a number: 1 + 10 x 3 / (9 x 1)."""
    assert trust_in_edge(an_observer(), 3.0) == pytest.approx(1 + 30 / 9)
    assert trust_in_edge(an_observer(), 0.0) == 1.0


def fitted_to(observer, size, effect=SLACK, slope=-1.0):
    """A fit that has the effect half a typical size and leaves an edge too long by `size` deviations.

    A typical size more changes the length by `slope` deviations.
    """
    amplitudes = observer.off.copy()
    amplitudes[observer.columns[effect]] = 0.5 * LIBRARY[effect].typical
    jacobian = np.zeros((len(observer.layout.take), 6))
    jacobian[:, 5] = stretched(observer, slope)
    return Fitted(SI.initial, amplitudes, (effect,), stretched(observer, size), jacobian, np.ones(6), True)


def test_a_size_that_the_edge_would_have_elsewhere_is_taken_from_the_edge():
    """8 deviations at 4 a typical size: two more of them; three takes know it to 1/4, as one does alone."""
    for takes in (1, 3):
        observer = an_observer(takes)
        pinned = disputed(observer, stretched(observer, 10.0), fitted_to(observer, 8.0, slope=-4.0), 7.0)
        (column,) = np.arange(len(observer.off))[observer.columns[SLACK]]
        assert pinned.amplitudes[column] == pytest.approx(2.5 * LIBRARY[SLACK].typical, rel=1e-6)
        assert pinned.sd[column] == pytest.approx(LIBRARY[SLACK].typical / 4, rel=1e-6)
        assert np.isinf(np.delete(pinned.sd, column)).all()
        assert pinned.trust == 7.0


def test_a_size_that_the_edge_agrees_with_or_cannot_mend_stays():
    observer = an_observer()
    without = stretched(observer, 10.0)
    assert disputed(observer, without, fitted_to(observer, 1.9, slope=-4.0), 7.0) is None  # within two deviations
    moved = fitted_to(observer, 8.0, slope=-4.0)
    elsewhere = np.where(observer.layout.frame < 0, 0.0, 30.0) * observer.layout.is_edge
    moved = dataclasses.replace(moved, residual=moved.residual + elsewhere)
    assert disputed(observer, without + elsewhere, moved, 7.0) is None  # most of what is off stays off
    air = fitted_to(observer, 8.0, NAMES.index("air_drag"), -4.0)
    assert disputed(observer, without, air, 7.0) is None


def screened(observer, **slopes):
    effects = tuple(NAMES.index(name) for name in slopes)
    raw = [stretched(observer, slope)[None] for slope in slopes.values()]
    return SimpleNamespace(effects=effects, raw=raw, typical=np.array([LIBRARY[k].typical for k in effects]))


def test_what_would_put_the_edge_right_is_refitted_whatever_the_cloth_promises():
    observer = an_observer()
    seen = screened(observer, air_drag=4.0, clip_slack=4.0, time_offset=0.0, attachment_offset=-2.0)
    assert leads(observer, seen, stretched(observer, 8.0)) == [1, 3]
    assert leads(observer, seen, stretched(observer, 4.0)) == []


def test_the_edge_shows_a_size_from_which_it_is_certain():
    """Two deviations a typical size: 25 = 4 a^2 at 2.5 typical sizes."""
    observer = an_observer()
    found = detectable_on_edge(observer, an_observer(2), screened(observer, air_drag=4.0, clip_slack=2.0, hem=1.0))
    assert found == pytest.approx([np.inf, 2.5 * LIBRARY[SLACK].typical, np.inf])
    varying = screened(observer, time_offset=0.0)
    varying.raw[0][0, observer.layout.frame >= 0] = 1.0
    varying.raw[0][0, :10] = 0.0
    # 20 numbers a take of one deviation each, in the two takes judged on: 60 = 40 a^2.
    expected = np.sqrt(1.5) * LIBRARY[NAMES.index("time_offset")].typical
    assert detectable_on_edge(observer, an_observer(2), varying) == pytest.approx([expected])


def a_slack_take(amplitude, *, noise=0.0005):
    time = np.arange(0, 3.0, 1 / 30)
    garment = sheet(grid=5)
    row = material(garment, velocity_damping=1.5, bending_stiffness=3e-5, shear_stiffness=40.0)
    sizes = amplitudes_of(LIBRARY, clip_slack=amplitude)[None]
    moved = swing(time, amplitude=0.05, hz=0.7, sideways=0.02, stop=2.0)
    return simulate_take(
        garment, time, moved, row, effects=LIBRARY, amplitudes=sizes, noise=noise, resolution=Resolution(spacing=0.1)
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
    assert (free.is_by_edge, held.is_by_edge) == (False, True)
    assert held.amplitudes[columns] == pytest.approx(-0.009, abs=1e-4)
    assert held.deviation[-1] == pytest.approx(1e-4 / LIBRARY[SLACK].typical)
    assert not np.allclose(held.vector, SI.initial)
    assert Problem(observer, (SLACK,)).prior_sd[-1] > 1.0


def told(closed_mm, *, base=12.0, before=(900, 100.0), after=(900, 2.0), other=None):
    """Evidence where the edge is off constantly without slack and not with it; `other`: {name: mm} beside it."""
    evidence = evidence_of({"clip_slack": closed_mm, **(other or {})}, base=base)
    singles = {k: with_edge(h, *(after if k == SLACK else before)) for k, h in evidence.singles.items()}
    return dataclasses.replace(evidence, base=with_edge(evidence.base, *before), singles=singles)


@pytest.mark.parametrize(
    ("evidence", "verdict"),
    [
        (told(10.5), "effect"),  # it closes 28 % of the gap, more is left than laws leave
        (told(11.9), "effect"),  # 2 %
        (told(14.0), "unknown"),  # the cloth is surely worse off
        (told(5.05, base=5.1), "effect"),  # there is no gap
        (told(5.05, base=5.1, after=(900, 90.0)), "none"),
        (told(11.9, after=(900, 40.0)), "unknown"),  # the edge is not where the effect has it: 36 beyond chance
        (told(11.9, before=(900, 20.0)), "unknown"),  # 18 less are not certain
    ],
)
def test_what_the_held_edge_tells_is_named_whatever_the_cloth_does(evidence, verdict):
    found = decide(evidence, LIBRARY)
    assert (found.verdict, found.named) == (verdict, ["clip_slack"] if verdict == "effect" else [])
    assert (probabilities(evidence, None)[SLACK] > 0.8) == (verdict == "effect")


def test_the_sentence_says_what_the_edge_tells_and_what_no_effect_explains():
    """0.02 sqrt(900) = 0.6 mm."""
    sentence = decide(told(10.5), LIBRARY).sentence
    assert (
        "The held edge tells of it: the model has that edge 0.6 mm off without it, 0.6 mm with it, noise included."
        in sentence
    )
    assert "The rest of the gap, 72 %, no effect in the library explains." in sentence
    assert "The rest" not in decide(told(5.3), LIBRARY).sentence
    small = decide(told(5.05, base=5.1), LIBRARY).sentence
    assert "it misses by 5.0 mm. The held edge" in small


@pytest.mark.parametrize(("base", "verdict"), [(5.1, "none"), (12.0, "unknown")])
def test_an_edge_that_nothing_puts_right_is_told_of(base, verdict):
    found = decide(told(base - 0.1, base=base, after=(900, 90.0)), LIBRARY)
    assert found.verdict == verdict
    assert found.sentence.endswith("It has the held edge 0.6 mm off, beyond noise.")
    quiet = decide(told(base - 0.1, base=base, before=(900, 20.0), after=(900, 20.0)), LIBRARY)
    assert "edge" not in quiet.sentence


def test_an_effect_that_leaves_the_edge_off_is_not_named_in_the_place_of_one_that_it_tells_of():
    """Drag closes 60 % of the cloth's gap; both together are `several` if either needs the other."""
    evidence = told(10.5, other={"air_drag": 8.0})
    assert [NAMES[k] for k in passing_effects(evidence)] == ["clip_slack", "air_drag"]  # a rival, were it not told
    assert decide(evidence, LIBRARY).named == ["clip_slack"]
    for left, verdict in ((6.0, "several"), (10.2, "effect")):
        both = with_edge(hypothesis(("air_drag", "clip_slack"), left, seed=9), 900, 2.0)
        assert decide(dataclasses.replace(evidence, joint=[(both, 0.001)]), LIBRARY).verdict == verdict


def test_a_base_fit_or_a_mesh_that_is_not_settled_does_not_hide_what_the_edge_tells():
    for gate in (COARSE, msgspec.structs.replace(COARSE, name="base fit")):
        assert decide(dataclasses.replace(told(10.5), gates=[gate]), LIBRARY).verdict == "effect"


def test_clips_too_far_apart_are_named_though_the_cloth_hardly_shows_it():
    """12 mm of 400: taut cloth below the clips hangs as before."""
    takes = [a_slack_take(-0.012)] * 2
    found = diagnose(takes[:1], takes[1:], resolution=Resolution(spacing=0.1)).diagnosis
    assert (found.verdict, found.named) == ("effect", ["clip_slack"])
    (slack,) = (e for e in found.effects if e.id == "clip_slack")
    assert slack.amplitude == pytest.approx(-0.012, abs=0.0015)
    assert found.gap.edge_mm == pytest.approx(4.2, abs=0.3)  # 0.012 sqrt(1/8)
    assert found.gap.edge_with_effect_mm < 1.0
