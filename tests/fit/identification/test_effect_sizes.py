"""The interval of an effect's size covers mesh, solver and laws, in a fit as in a diagnosis; on linear cloth."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.identification import effect_sizes
from fit.identification.effect_sizes import _beyond_others, half_widths, with_sizes
from fit.identification.request import Request
from fit.methods import SI
from fit.observer import residuals
from fit.observer.residuals import Observer
from fit.observer.simulation_error import FREE_DIRECTIONS, SOLVER_SHARE, motion_mm
from fit.recordings.recording import prepare
from fit.search.intervals import PRIOR_SD, Intervals, LinearModel, block_intervals, widened
from fit.search.least_squares import BoundedSpace
from formats.nature import NORMAL_90
from tests.fit.gap.linear_cloth import MESH, OF_VECTOR, LinearCloth, World, a_take

REQUEST = Request(method=SI, effects=find_effects(["air_drag", "hem"]), resolution=MESH)
TRUE = {"air_drag": 1.2, "hem": 0.01}


def in_world(monkeypatch, world):
    monkeypatch.setattr(residuals, "Simulator", LinearCloth)
    monkeypatch.setattr(LinearCloth, "world", world)


def observed(recordings):
    return Observer(recordings, SI, REQUEST.effects, frequency=0.0, resolution=MESH)


def solved(observer):
    """The least squares of the linear world, and the model about it."""
    space, count = REQUEST.space, len(SI.parameters)
    middle = np.concatenate([SI.initial, [0.5, 0.005]])
    unit = space.to_unit(middle)

    def of(units):
        vectors = space.from_unit(units)
        return observer.residuals(vectors[:, :count], vectors[:, count:])

    first, *moved = of(np.concatenate([unit[None], unit + 0.01 * np.eye(len(unit))]))
    slopes = (np.array(moved) - first).T / 0.01
    end = unit - np.linalg.solve(slopes.T @ slopes + np.eye(len(unit)) / PRIOR_SD**2, slopes.T @ first)
    best = space.from_unit(end)
    (left,) = of(end[None])
    return best, LinearModel(parameters=best, residuals=left, jacobian=slopes, block=observer.layout.block)


def test_the_half_width_is_that_of_mesh_solver_and_laws_by_hand(monkeypatch):
    """The mesh moves the cloth by 0.3 mm; a finer one by that times the square of the ratio of spacings."""
    world = World()
    in_world(monkeypatch, world)
    recording = prepare(a_take("a", world, TRUE))
    observer = observed([recording])
    best, model = solved(observer)
    found = half_widths(observer, REQUEST, best)
    assert not found[:5].any()
    mesh = observer.in_mm(observer.residuals_of([(recording.points - LinearCloth(
        recording, REQUEST.effects, resolution=MESH).off)[None]])[0])  # fmt: skip
    numerics = np.hypot(mesh, SOLVER_SHARE * motion_mm(observer))
    for k, effect in zip((5, 6), REQUEST.effects, strict=True):
        others = np.delete(model.jacobian, k, axis=1)
        hat = np.linalg.solve(others.T @ others + np.eye(6) / PRIOR_SD**2, others.T @ model.jacobian[:, k])
        moved = observer.in_mm(model.jacobian[:, k] - others @ hat) / (effect.high - effect.low)
        wrong = NORMAL_90 * numerics / moved / np.sqrt(FREE_DIRECTIONS)
        law = NORMAL_90 * effect.law_spread * best[k]
        assert found[k] == pytest.approx(np.hypot(wrong, law), rel=0.02)
        assert min(wrong, law) > 0.1 * found[k]


def test_intervals_hold_the_truth_of_cloth_with_another_mesh_and_law(monkeypatch):
    """40 cloths whose drag follows a law that is a tenth off, simulated on a mesh that is 0.3 to 0.6 mm off.

    Intervals of noise alone hold the truth in a few of them. The binomial deviation of 90 % of 40 is 1.9.
    """
    rng, held, before = np.random.default_rng(5), 0, 0
    for seed in range(40):
        world = World(mesh=1e-3 * rng.uniform(0.3, 0.6))
        world.field = _reseeded(world, seed)
        in_world(monkeypatch, world)
        law = 1 + 0.1 * rng.normal()
        take = a_take("a", world, {"air_drag": 1.2 * law, "hem": 0.01}, seed=seed, noise=5e-4)
        observer = observed([prepare(take)])
        best, model = solved(observer)
        intervals = block_intervals(REQUEST.space, model)
        wide, simulations = with_sizes([prepare(take)], REQUEST, best, intervals)
        assert simulations == len(best) + 2
        before += intervals.ends[5, 0] <= 1.2 <= intervals.ends[5, 1]
        held += wide.ends[5, 0] <= 1.2 <= wide.ends[5, 1]
        assert np.array_equal(wide.ends[:5], intervals.ends[:5])
    assert before < 20
    assert 33 <= held <= 40


def _reseeded(world, seed):
    """Fields of the mesh's error that differ between cloths; all others stay."""
    plain = World.field

    def field(recording, number, size):
        return plain(world, recording, number + 5000 * (seed + 1) if number == 1 else number, size)

    return field


SPACE = BoundedSpace(minimum=np.array([1.0, 0.0]), maximum=np.array([10.0, 2.0]), is_log=np.array([True, False]))
GIVEN = Intervals(
    ends=np.array([[2.0, 5.0], [0.7, 1.6]]), is_identified=np.array([True, True]),
    covariance=np.array([[0.2, 0.01], [0.01, 0.04]]), way=np.zeros(2), spread=2.0, is_at_bound=np.array([False, False]),
)  # fmt: skip


def test_half_widths_add_up_in_squares_on_both_sides_and_within_the_range():
    wide = widened(SPACE, GIVEN, np.array([3.0, 1.0]), np.array([0.0, 0.4]))
    assert wide.ends[0].tolist() == [2.0, 5.0]
    assert wide.ends[1] == pytest.approx([1 - np.hypot(0.3, 0.4), 1 + np.hypot(0.6, 0.4)])
    assert wide.covariance == pytest.approx(np.array([[0.2, 0.01], [0.01, 0.04 + 0.2**2]]))
    assert wide.is_identified.tolist() == [True, True]
    far = widened(SPACE, GIVEN, np.array([3.0, 1.0]), np.array([0.0, np.inf]))
    assert far.ends[1].tolist() == [0.0, 2.0]
    assert np.isfinite(far.covariance).all()


@pytest.mark.parametrize(("more", "is_identified"), [(0.40, True), (0.43, False)])
def test_a_size_is_identified_by_the_whole_deviation(more, is_identified):
    """The limit is half of 2 / sqrt(12) = 0.289: of 0.2 and 0.2 or 0.215, 0.283 and 0.294."""
    wide = widened(SPACE, GIVEN, np.array([3.0, 1.0]), np.array([0.0, more]))
    assert bool(wide.is_identified[1]) == is_identified
    assert wide.is_identified[0]
    unknown = dataclasses.replace(GIVEN, is_identified=np.array([True, False]))
    assert not widened(SPACE, unknown, np.array([3.0, 1.0]), np.array([0.0, 0.1])).is_identified[1]


def test_a_fit_without_an_effect_is_not_simulated_again(monkeypatch):
    monkeypatch.setattr(effect_sizes, "Observer", None)
    plain = dataclasses.replace(REQUEST, effects=())
    assert with_sizes([], plain, np.ones(5), GIVEN) == (GIVEN, 0)


def test_an_end_of_another_parameter_stays_to_the_last_digit():
    given = dataclasses.replace(GIVEN, ends=np.array([[1.0, 7.3], [0.7, 1.6]]))
    for best in np.linspace(1.01, 7.29, 50):
        wide = widened(SPACE, given, np.array([best, 1.0]), np.array([0.0, 0.4]))
        assert wide.ends[0].tolist() == [1.0, 7.3]


@pytest.mark.parametrize(
    ("best", "ends"), [(0.5, [0.1, 0.5 + np.hypot(1.1, 0.4)]), (1.7, [1.7 - np.hypot(1.0, 0.4), 2.0])]
)
def test_a_best_draw_outside_the_draws_interval_widens_it_and_no_other_one(best, ends):
    """The best draw of a parameter may lie beyond the 5 % or the 95 % of the draws, which then hold it no more."""
    wide = widened(SPACE, GIVEN, np.array([6.0, best]), np.array([0.0, 0.4]))
    assert wide.ends[0].tolist() == [2.0, 5.0]
    assert wide.ends[1] == pytest.approx(ends)


@pytest.mark.parametrize("mesh", ["finer", "own"])
def test_where_a_simulation_blows_up_no_size_has_an_interval(monkeypatch, mesh):
    """On the finer mesh; or that of another parameter, so that nothing tells what it imitates of the sizes."""
    world = World()
    in_world(monkeypatch, world)
    recording = prepare(a_take("a", world, TRUE))
    observer = observed([recording])
    best, _ = solved(observer)
    usual = LinearCloth.run

    def run(self, materials, *given, **options):
        found = usual(self, materials, *given, **options)
        damping = materials[:, OF_VECTOR[-1]]
        is_broken = self.mesh.spacing < 0.09 if mesh == "finer" else damping > damping[0]
        found.points[np.broadcast_to(is_broken, len(materials))] = np.nan
        return found

    monkeypatch.setattr(LinearCloth, "run", run)
    found = half_widths(observer, REQUEST, best)
    assert np.isinf(found[5:]).all()
    assert not found[:5].any()


@pytest.mark.parametrize("end", ["maximum", "minimum"])
def test_each_component_of_an_effect_has_its_own_half_width_and_no_step_leaves_the_range(monkeypatch, end):
    """Motions of 1 and 2 thousandths of a mm and of 3 mm a unit; a mesh off by 0.5 / (1 - 1 / 1.5^2) = 0.9 mm."""
    request = dataclasses.replace(REQUEST, effects=find_effects(["gravity_tilt", "hem"]))
    space, asked = request.space, []
    best, slopes = getattr(space, end).copy(), space.slope(getattr(space, end))
    rows = np.diag([*np.ones(5), *np.array([0.001, 0.002, 3.0]) * slopes[5:]])
    fine = SimpleNamespace(in_mm=np.linalg.norm, off=np.array([0.3, 0.4, *np.zeros(6)]))
    coarse = SimpleNamespace(in_mm=np.linalg.norm, off=np.zeros(8))

    def sound(observer, vectors, count):
        asked.extend(vectors)
        return space.to_unit(vectors) @ rows + observer.off

    monkeypatch.setattr(effect_sizes, "_sound", sound)
    monkeypatch.setattr(effect_sizes, "finer", lambda given: (fine, None, 1.5))
    monkeypatch.setattr(effect_sizes, "with_solver_mm", lambda mesh_mm, given: mesh_mm)
    found = half_widths(coarse, request, best)
    spreads = np.array([effect.law_spread for effect in request.effects])[[0, 0, 1]]
    wrong = NORMAL_90 * 0.9 / 3 / np.array([0.001, 0.002, 3.0])
    assert found[5:] == pytest.approx(np.hypot(wrong, NORMAL_90 * spreads * np.abs(best[5:])))
    assert not found[:5].any()
    assert (np.array(asked) <= space.maximum * (1 + 1e-9)).all()


def test_what_other_parameters_imitate_is_limited_by_their_prior():
    """A row of one over the prior's deviation takes half of what is along it, 1.5 of 3."""
    rows = np.array([[1 / PRIOR_SD, 0.0], [3.0, 4.0]])
    assert _beyond_others(rows, 1) == pytest.approx([1.5, 4.0])


def test_sizes_are_widened_on_the_mesh_of_the_request(monkeypatch):
    world = World()
    in_world(monkeypatch, world)
    seen = []
    monkeypatch.setattr(
        effect_sizes, "half_widths", lambda observer, *given: seen.append(observer.resolution) or np.zeros(2)
    )
    monkeypatch.setattr(effect_sizes, "widened", lambda *given: GIVEN)
    other = Resolution(spacing=0.123)
    asked = dataclasses.replace(REQUEST, resolution=other)
    with_sizes([prepare(a_take("a", world, TRUE))], asked, np.ones(7), GIVEN)
    assert seen == [other]
