"""The base fit of linear takes with known truth: starts, pulls and the choice of the pull."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.gap import base_fit, gates
from fit.gap.base_fit import MOST_STARTS, coarsened, fit_base, middle
from fit.gap.fitting import Pinned, Problem, Task, fit
from fit.methods import SI
from formats.diagnosis_records import Gate
from tests.fit.gap.linear_takes import MESH, LinearTakes
from tests.fit.gap.named_fits import Named

FIRST_SAMPLES, CARRIED, SAMPLES = 18, 8, 2  # few, for each batch after the first sixteen trains an emulator
SHIFT = np.array([0.5, -0.4, 0.3, 0.2, -0.3])  # of the logarithms of the parameters


class Pulled(LinearTakes):
    """Takes that may be pulled and put on other meshes, whose points are parameters and amplitudes themselves."""

    def __init__(self):
        super().__init__(5)
        self.looked = []
        self.missed = self.noisy() + self.moved(1e-3 * MESH) - SHIFT @ self.sensitivity

    def with_frequency(self, frequency):
        other = copy.copy(self)
        other.frequency = frequency
        return other

    def at_resolution(self, resolution):
        other = copy.copy(self)
        other.resolution = resolution
        return other

    def trajectories(self, vectors, amplitudes, *, frequency=None):
        self.looked += [(self.frequency, self.resolution.spacing, vector) for vector in vectors]
        return [vectors, amplitudes]

    def sound_residuals_of(self, points):
        return self.residuals(*points)


@pytest.fixture
def world(monkeypatch):
    for name, count in (("FIRST_SAMPLES", FIRST_SAMPLES), ("CARRIED", CARRIED), ("SAMPLES", SAMPLES)):
        monkeypatch.setattr(base_fit, name, count)
    return Pulled()


def gate_at(frequency):
    return Gate(name="predictability", passed=True, figure=frequency, limit=1.0, unit="mm", sentence="")


def pulls(monkeypatch, *asked):
    """Let the pulls be chosen so, one after another; return the vectors that they were chosen at."""
    at, left = [], list(asked)

    def choose(observer, vector):
        at.append(vector)
        frequency = left.pop(0) if len(left) > 1 else left[0]
        return frequency, gate_at(frequency)

    monkeypatch.setattr(gates, "choose_frequency", choose)
    return at


def ended(world, told=lambda *_: None):
    return fit_base(world, told, Named(), 0)


def test_the_base_fit_ends_where_the_parameters_are(world, monkeypatch):
    told, names, begun, kept = [], [], [], Named()
    recall, places = kept.recall, kept.recall_vectors

    def recalled(wanted, go):
        names.extend(wanted)
        begun.append([task.vector for task in go.args[1]])
        return recall(wanted, go)

    across, across_valleys = [], base_fit.across_valleys
    monkeypatch.setattr(base_fit, "across_valleys", lambda *given: across.append(across_valleys(*given)) or across[-1])
    monkeypatch.setattr(kept, "recall", recalled)
    monkeypatch.setattr(kept, "recall_vectors", lambda name, go: names.append(name) or places(name, go))
    fits, chosen, gate = fit_base(world, lambda *said: told.append(said), kept, 0)
    assert np.log(fits[0].vector / SI.initial) == pytest.approx(SHIFT, abs=0.1)
    assert [f.cost for f in fits] == sorted(f.cost for f in fits)
    assert len(fits) >= 2
    assert fits[0].active == ()
    assert gate.passed
    assert (chosen.frequency, gate.name) == (0.0, "predictability")
    # Of the samples 16 of 18, and then 8 of 10, come at once; both are 6 % of the work each.
    assert [(stage, pytest.approx(share)) for stage, share in told] == [
        ("simulating candidates under a pull of 1 Hz", 0.02),
        ("simulating candidates under a pull of 1 Hz", 0.02 + 0.06 * 16 / 18),
        ("simulating candidates without a pull", 0.08),
        ("simulating candidates without a pull", 0.08 + 0.06 * 8 / 10),
        ("base fit from 2 candidates without a pull", 0.14), ("base fit in further valleys without a pull", 0.29),
    ]  # fmt: skip
    beyond = [f"base-0-beyond-{k}" for k in range(len(fits) - 2)]
    assert len(beyond) == len(begun[-1]) == len(across[-1]) > 1  # every valley that promises less is fitted
    assert names == ["looks-1-60-18", "looks-0-50-10", "base-0-0", "base-0-1", *beyond]
    one, other = Problem(world).space.to_unit(np.array(begun[0]))
    assert np.abs(one - other).max() > 0.15  # of the box, in one parameter at least


def test_candidates_are_simulated_on_the_coarse_mesh_under_a_pull_and_then_on_the_fine_one(world, monkeypatch):
    """18 candidates under 1 Hz; the best eight of them and two more under the pull that was chosen at the best."""
    at = pulls(monkeypatch, 0.5)
    _, chosen, _ = ended(world)
    first = [vector for frequency, spacing, vector in world.looked if frequency == 1.0]
    later = [vector for frequency, spacing, vector in world.looked if frequency == 0.5]
    assert (len(first), len(later)) == (FIRST_SAMPLES, CARRIED + SAMPLES)
    assert {s for f, s, _ in world.looked if f == 1.0} == {coarsened(world).resolution.spacing}
    assert {s for f, s, _ in world.looked if f == 0.5} == {world.resolution.spacing}
    assert chosen.frequency == 0.5
    costs = (world.residuals(np.array(first), np.tile(world.off, (len(first), 1))) ** 2).sum(1)
    order = np.argsort(costs)
    assert at[0] == pytest.approx(first[order[0]])  # the prior hardly weighs beside the residual
    carried = {tuple(np.round(vector, 9)) for vector in later[:CARRIED]}
    assert len(carried & {tuple(np.round(first[n], 9)) for n in order[:CARRIED]}) >= CARRIED - 1


@pytest.mark.parametrize(("spacing", "coarse"), [(0.03, 0.045), (0.05, 0.06), (0.08, 0.08)])
def test_the_coarse_mesh_is_half_as_coarse_again_up_to_six_centimetres(world, spacing, coarse):
    found = coarsened(world.at_resolution(Resolution(spacing=spacing, step_share=0.7))).resolution
    assert (found.spacing, found.step_share) == (pytest.approx(coarse), 0.7)


def test_a_pull_that_the_end_of_the_fit_needs_is_tried_from_there(world, monkeypatch):
    at = pulls(monkeypatch, 0.5, 2.0, 2.0)
    told = []
    fits, chosen, gate = ended(world, lambda stage, share: told.append(stage))
    assert chosen.frequency == 2.0
    assert gate.figure == 2.0
    assert [s.rsplit("pull of ")[1] for s in told if s.startswith("base fit from 2")] == ["0.5 Hz", "2 Hz"]
    assert at[-1] == pytest.approx(fits[0].vector)


def test_no_pull_is_tried_twice_and_the_gate_is_that_of_the_pull_that_was_used(world, monkeypatch):
    pulls(monkeypatch, 0.5, 2.0, 0.5)
    monkeypatch.setattr(gates, "predictability_gate", lambda observer, vector, off: gate_at(100 + observer.frequency))
    _, chosen, gate = ended(world)
    assert (chosen.frequency, gate.figure) == (2.0, 102.0)


def test_while_the_best_two_disagree_another_start_is_spent_up_to_four(world, monkeypatch):
    monkeypatch.setattr(base_fit, "across_valleys", lambda observer, best: [])
    pulls(monkeypatch, 0.0)
    assert len(ended(world)[0]) == 2
    monkeypatch.setattr(gates, "disagreement", lambda fits: gates.CONVERGED + 1e-6)
    told = []
    fits, *_ = ended(world, lambda *said: told.append(said))
    assert len(fits) == MOST_STARTS == 4
    # A twentieth of the work each, up to where the search across valleys begins.
    assert [(stage, pytest.approx(share)) for stage, share in told if "candidates without a pull" in stage][-3:] == [
        ("base fit from 2 candidates without a pull", 0.14), ("base fit from 3 candidates without a pull", 0.24),
        ("base fit from 4 candidates without a pull", 0.28),
    ]  # fmt: skip
    monkeypatch.setattr(gates, "disagreement", lambda fits: gates.CONVERGED)
    assert len(ended(world)[0]) == 2
    monkeypatch.setattr(gates, "disagreement", lambda fits: 1.0 if len(fits) < 3 else 0.0)
    assert len(ended(world)[0]) == 3


def test_starts_lie_apart_in_one_parameter_at_least(world):
    space = Problem(world).space
    units = np.array(
        [np.full(5, 0.5), [0.6, 0.6, 0.6, 0.4, 0.4], [0.5, 0.5, 0.66, 0.5, 0.5], [0.5, 0.34, 0.5, 0.5, 0.5]]
    )
    found = space.to_unit(np.array(base_fit._lying_apart(world, space.from_unit(units))))
    assert found == pytest.approx(units[[0, 2, 3]], abs=1e-9)
    near = space.to_unit(np.array(base_fit._lying_apart(world, space.from_unit(units[:2]))))
    assert near == pytest.approx(units[:2], abs=1e-9)
    many = np.array([[n / 6, *[0.5] * 4] for n in range(7)])
    assert len(base_fit._lying_apart(world, space.from_unit(many))) == MOST_STARTS


def test_the_middle_of_the_best_two_is_that_of_their_logarithms(world):
    first = world.base()
    far, near, low = (copy.copy(first) for _ in range(3))
    for one, factor, size in ((low, 1.0, 1.0), (near, 4.0, 2.0), (far, 9.0, 3.0)):
        object.__setattr__(one, "vector", SI.initial * np.sqrt(factor))
        object.__setattr__(one, "residual", np.array([size]))
    assert middle(world, [far, near, low]) == pytest.approx(SI.initial * np.sqrt(2.0))


def test_fits_across_valleys_begin_there_with_the_cost_and_the_effects_of_the_best(world, monkeypatch):
    """The search across valleys is handed the end in shares of the box, and its cost."""
    best = world.base()
    space, given = Problem(world).space, {}

    def across(unit, jacobian, precision, cost, own, costs):
        given.update(unit=unit, jacobian=jacobian, precision=precision, cost=cost, own=own, costs=costs)
        return np.stack([unit + 0.01, unit - 0.01])

    monkeypatch.setattr(base_fit.valleys, "across", across)
    tasks = base_fit.across_valleys(world, best)
    assert given["unit"] == pytest.approx(space.to_unit(best.vector))
    assert given["jacobian"] == pytest.approx(best.jacobian * space.scale)
    assert given["precision"] == pytest.approx(np.diag((space.scale / 1.5) ** 2))
    assert (given["cost"], given["own"]) == (best.cost, 5)
    two = np.stack([given["unit"], given["unit"] + 0.02])
    at = world.residuals(space.from_unit(two), np.tile(world.off, (2, 1)))
    assert given["costs"](two) == pytest.approx((at**2).sum(1))
    assert [space.to_unit(t.vector) - given["unit"] for t in tasks] == [
        pytest.approx(np.full(5, 0.01)), pytest.approx(np.full(5, -0.01))
    ]  # fmt: skip
    assert all((t.known_cost, t.active, t.pinned) == (best.cost, (), None) for t in tasks)
    assert all(not t.amplitudes.any() for t in tasks)


def test_fits_across_valleys_have_the_effects_of_the_best_and_what_is_known_of_them(world, monkeypatch):
    monkeypatch.setattr(base_fit.valleys, "across", lambda unit, *_: unit[None])
    amplitudes = world.off.copy()
    amplitudes[world.columns["hem"]] = 0.7 * world.library["hem"].typical
    world.missed = world.missed - world.rows["hem"][0]
    known = Pinned(amplitudes, np.full(len(amplitudes), np.inf), 2.0)
    (best,) = fit(world, [Task(SI.initial, amplitudes, ("hem",), iterations=1, pinned=known)])
    (task,) = base_fit.across_valleys(world, best)
    assert (task.active, task.known_cost, task.pinned) == (("hem",), best.cost, known)
    assert task.vector == pytest.approx(best.vector)
    assert task.amplitudes == pytest.approx(best.amplitudes)
    assert task.amplitudes.any()
