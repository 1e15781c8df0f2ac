"""The gates that use simulations, on observers with closed-form answers."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.gates import (
    PULL_FREQUENCIES,
    choose_frequency,
    convergence_gate,
    data_gates,
    disagreement,
    numerics_gate,
    predictability_gate,
)
from fit.methods import SI
from fit.recordings.recording import prepare
from formats.impossible_points import describe_impossible
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.test_diagnosis_parts import a_take
from tests.fit.recordings.silhouettes import silhouette_sheet, swung, uneven
from tests.fit.scenes import recording_of, sheet


class Chaotic(LinearObserver):
    """A thousandth in every parameter moves the points by so many mm, depending on the pull."""

    def __init__(self, apart, frequency=0.0):
        numbers = len(layout_of().take)
        super().__init__(np.zeros(numbers), np.zeros((numbers, len(SI.initial))), {})
        self.apart, self.frequency = apart, frequency

    def with_frequency(self, frequency):
        return Chaotic(self.apart, frequency)

    def residuals(self, vectors, amplitudes):
        moved = (vectors[:, 0] / SI.initial[0] - 1.0) / 1e-3
        return moved[:, None] * self.apart(self.frequency) / np.sqrt(3) * np.ones((1, len(self.missed)))


# The noise of 1 mm per axis is 1.73 mm; a fifth of it 0.35 mm.
@pytest.mark.parametrize(
    ("apart", "frequency", "passed"),
    [
        (lambda hz: 0.34, 0.0, True),
        (lambda hz: 0.36 if hz < 1.0 else 0.34, 1.0, True),
        (lambda hz: 5.0 - hz if hz < 4 else 1.5 + hz / 100, 4.5, True),
        (lambda hz: 2.0 + abs(hz - 2.0), 2.0, False),
    ],
    ids=["free", "weakly pulled", "never forgotten, yet within the noise", "never within the noise"],
)
def test_the_weakest_pull_is_chosen_under_which_a_nudge_is_forgotten(apart, frequency, passed):
    found, gate = choose_frequency(Chaotic(apart), SI.initial)
    assert (found, gate.passed) == (frequency, passed)
    assert found in PULL_FREQUENCIES
    assert gate.limit == pytest.approx(np.sqrt(3.0))
    assert gate.figure == pytest.approx(apart(frequency), rel=1e-6)
    assert ("free rollout" in gate.sentence) == (frequency == 0.0)


@pytest.mark.parametrize(("mm", "passed"), [(1.7, True), (1.75, False)])
def test_takes_are_predictable_where_a_nudge_stays_within_the_noise(mm, passed):
    observer = Chaotic(lambda hz: mm, 2.0)
    gate = predictability_gate(observer, SI.initial, observer.off)
    assert gate.passed == passed
    assert "under a pull of 2 Hz" in gate.sentence


def test_a_nudge_is_of_the_parameters_alone_beside_the_same_effects(monkeypatch):
    """Effects that move the points by 7 deviations of the noise move them so in both simulations."""
    observer = Chaotic(lambda hz: 0.5, 2.0)
    alone = observer.residuals
    monkeypatch.setattr(observer, "residuals", lambda vectors, rows: alone(vectors, rows) + 7.0 * rows[:, :1])
    gate = predictability_gate(observer, SI.initial, observer.off + 1.0)
    assert gate.figure == pytest.approx(0.5, rel=1e-6)


def test_fits_disagree_by_the_second_best_cost_over_the_best():
    observer = Chaotic(lambda hz: 0.0)
    fits = [dataclasses.replace(observer.fitted(), residual=np.array([np.sqrt(cost)])) for cost in (30.0, 10.0, 12.0)]
    assert disagreement(fits) == pytest.approx(0.2)
    assert disagreement(fits[:1]) == 0.0


@pytest.mark.parametrize(
    ("closed", "figure", "passed"), [(0.39, 39.0, True), (0.41, 41.0, False), (-0.2, 0.0, True), (None, 0.0, True)]
)
def test_a_finer_mesh_may_close_two_fifths_of_the_gap(closed, figure, passed):
    gate = numerics_gate(closed, 1.2, 1.5)
    assert (gate.figure, gate.passed, gate.limit) == (pytest.approx(figure), passed, pytest.approx(40.0))
    assert "1.2 mm" in gate.sentence
    assert ("hardly a gap" in gate.sentence) == (closed is None)


@pytest.mark.parametrize(
    ("best_effect", "second", "passed", "limit"),
    [(10.0, 11.4, True, 15.0), (10.0, 11.6, False, 15.0), (10.0 / 1.69, 12.9, True, 30.0),
     (10.0 / 1.69, 13.1, False, 30.0)],
)  # fmt: skip
def test_starts_of_the_base_fit_end_near_each_other_beside_what_an_effect_saves(best_effect, second, passed, limit):
    """15 %, or the square root of what the best effect makes of the cost: of 1.69, 30 %."""
    observer = Chaotic(lambda hz: 0.0)
    fits = [dataclasses.replace(observer.fitted(), residual=np.array([np.sqrt(cost)])) for cost in (second, 10.0)]
    gate = convergence_gate(fits, best_effect)
    assert (gate.passed, gate.limit) == (passed, pytest.approx(limit))
    assert gate.figure == pytest.approx(100 * (second / 10 - 1))


def recorded(
    *,
    seconds=4.0,
    travel=0.1,
    own=0.01,
    noise=0.001,
    impossible=0.0,
    is_calibrated=True,
    turn=0.0,
    is_imported=False,
    timing=None,
):
    """A hanger that goes to and fro from frame to frame, with two points that move by `own` against it, and one aside.

    turn [rad]: of hanger and points together, frame by frame, about the vertical through the hanger's middle
    """
    time = np.linspace(0.0, seconds, 9)
    sign = np.tile([1.0, -1.0], 5)[:9]
    angle = turn * np.arange(9)
    level = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    middle = np.stack([0 * time, travel / 2 * sign, 0 * time], 1)
    ends = np.concatenate([middle - 0.2 * level, middle + 0.2 * level], 1)
    down = np.array([0.0, 0.0, -0.3])
    across = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.15, 0.0, 0.0]])
    balance = sign - sign.mean()
    balance /= np.sqrt((balance**2).mean())
    points = middle[:, None] + down + across[:, :1] * level[:, None] + own * balance[:, None, None] * [0, 0, 1.0]
    points[:, 2] += sign[:, None]  # far more, and not judged
    return SimpleNamespace(
        duration=seconds, time=time, held=lambda instants: ends, points=points, valid=np.ones((9, 3), bool),
        judged=np.array([True, True, False]), point_sd=np.array([noise, noise, noise]), impossible=impossible,
        is_calibrated=is_calibrated, is_imported=is_imported, garment=sheet(), seen_points=points,
        camera=SimpleNamespace(timing=timing), take_id="shown",
    )  # fmt: skip


def test_points_on_a_clock_that_is_not_the_hangers_say_nothing_of_the_cloth():
    foreign = SimpleNamespace(is_of_hanger=False, explained=0.64)
    gate = gate_of("clocks", [recorded(), recorded(timing=foreign)])
    assert not gate.passed
    assert "(best: 64 %)" in gate.sentence
    assert gate_of("clocks", [recorded(timing=SimpleNamespace(is_of_hanger=True, explained=0.98))]).passed


def gate_of(name, training, held_out=()):
    return next(gate for gate in data_gates(list(training), list(held_out)) if gate.name == name)


SLIPPED = recorded(travel=0.02, own=0.001, is_calibrated=False, impossible=0.2)
CHAOS = Chaotic(lambda hz: 2.0, 2.0)
FITS = [dataclasses.replace(CHAOS.fitted(), residual=np.array([np.sqrt(cost)])) for cost in (11.4, 10.0)]
GATES = [
    (
        lambda: data_gates([SLIPPED], [recorded(seconds=2.0)]),
        [
            ("calibration", False, 1, 0.0, "takes", "The rig of 1 takes was never measured, so a wrong number in "
             "it would pass for an effect. Run `hangtime calibrate` and record with the rig that it writes."),
            ("length", False, 2.0, 2.5, "s", "The shortest take lasts 2.0 s; at least 2.5 s are needed. Record "
             "longer."),
            ("motion", False, 20.0, 30.0, "mm", "The hanger's smoothed path spans 20 mm in the liveliest take "
             "fitted to; at least "
             "30 mm are needed. Swing it wider."),
            ("cloth motion", False, 1.0, 2e3 * np.sqrt(3e-6), "mm", "The points move by 1.0 mm against the hanger in "
             "the liveliest take fitted to. At least 3.5 mm are needed, 2 times their noise. Swing faster, or "
             "come nearer to the sensor."),
            ("repeated frames", True, 0.0, 10.0, "%", "0 % of the frames repeat the one before; at most 10 % may."),
            ("impossible points", False, 20.0, 5.0, "%", describe_impossible(0.2)),
            ("clocks", True, 0, 0.0, "takes", "Points and hanger can have one clock in every take."),
            ("kind of points", True, None, None, "", "Nothing contradicts material points."),
        ],
    ),
    (
        lambda: data_gates([recorded(timing=SimpleNamespace(is_of_hanger=False, explained=0.6))], [])[6:7],
        [("clocks", False, 1, 0.0, "takes", None)],
    ),
    (
        lambda: [predictability_gate(CHAOS, SI.initial, CHAOS.off)],
        [("predictability", False, 2.0, np.sqrt(3), "mm", "A change of 0.001 in the parameters moves the points by "
          "2.00 mm under a pull of 2 Hz; at most their noise, 1.7 mm, is allowed.")],
    ),
    (
        lambda: [choose_frequency(Chaotic(lambda hz: 0.1), SI.initial)[1]],
        [("predictability", True, 0.1, np.sqrt(3), "mm", "A change of 0.001 in the parameters moves the points by "
          "0.10 mm in a free rollout; at most their noise, 1.7 mm, is allowed.")],
    ),
    (
        lambda: [convergence_gate(FITS, 10.0)],
        [("base fit", True, 14.0, 15.0, "%", "Of 2 starts of the base fit, the second best ends 14.0 % above the "
          "best in cost. At most 15 % above is allowed; this limit grows with what the best effect saves. Ends near in "
          "cost may still differ in their parameters.")],
    ),
    (
        lambda: [numerics_gate(0.41, 1.2, 1.5), numerics_gate(None, 1.2, 1.5)],
        [
            ("mesh and step", False, 41.0, 40.0, "%", "A mesh 1.5 times finer with its smaller step, refitted, removes "
             "41 % of the squared error above the noise. At most 40 % is allowed. The mesh moves the points by about "
             "1.2 mm."),
            ("mesh and step", True, 0.0, 40.0, "%", "There is hardly a gap; the mesh moves the points by about 1.2 "
             "mm."),
        ],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("gates", "expected"), GATES)
def test_every_gate_says_its_name_figure_limit_and_unit(gates, expected):
    for gate, (name, passed, figure, limit, unit, sentence) in zip(gates(), expected, strict=True):
        assert (gate.name, gate.passed, gate.unit) == (name, passed, unit)
        assert (gate.figure, gate.limit) == (figure and pytest.approx(figure), limit and pytest.approx(limit))
        assert sentence in (None, gate.sentence)


def test_every_take_is_long_enough():
    assert gate_of("length", [recorded(seconds=2.5)]).passed
    short = gate_of("length", [recorded()], [recorded(seconds=2.4), recorded(seconds=3.0)])
    assert (short.passed, short.figure, short.limit) == (False, pytest.approx(2.4), 2.5)
    nearly = gate_of("length", [recorded(seconds=2.467)])
    assert nearly.sentence.startswith("The shortest take lasts 2.4 s; at least 2.5 s are needed")
    enough = gate_of("length", [recorded(seconds=5.967)])
    assert enough.sentence == "The shortest take lasts 6.0 s; at least 2.5 s are needed."


@pytest.mark.parametrize(("travel", "passed"), [(0.029, False), (0.031, True)])
def test_a_hanger_moves_in_the_liveliest_take_that_is_fitted_to_and_in_that_judged_on(travel, passed):
    still, lively = recorded(travel=0.001), recorded(travel=travel)
    for groups, of in (
        (([still, recorded()], [lively, still]), " judged on"), (([lively, still], [recorded()]), " fitted to"),
        (([lively], []), ""),
    ):  # fmt: skip
        gate = gate_of("motion", *groups)
        assert f"{1e3 * travel:.0f} mm in the liveliest take{of}; at" in gate.sentence
        assert (gate.passed, gate.figure, gate.limit) == (passed, pytest.approx(1e3 * travel), pytest.approx(30.0))


@pytest.mark.parametrize(("own", "passed"), [(0.0034, False), (0.0035, True)])
def test_points_move_against_the_hanger_by_twice_their_noise(own, passed):
    """1 mm an axis is 1.73 mm, twice that 3.46; the take that moves most counts, with its own noise."""
    lively, still = recorded(own=own), recorded(own=0.001, noise=0.0001)
    for groups, of in (
        (([lively, still], [recorded(own=0.02)]), "fitted to"), (([recorded(own=0.02)], [still, lively]), "judged on"),
    ):  # fmt: skip
        gate = gate_of("cloth motion", *groups)
        assert f"in the liveliest take {of}. At" in gate.sentence
        assert (gate.passed, gate.figure) == (passed, pytest.approx(1e3 * own))
        assert gate.limit == pytest.approx(2 * np.sqrt(3))


def test_a_board_that_turns_with_its_hanger_has_no_motion_of_its_own():
    assert gate_of("cloth motion", [recorded(own=0.0, turn=0.2)]).figure == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("share", "passed"), [(0.049, True), (0.051, False)])
def test_at_most_a_twentieth_of_the_sightings_are_impossible(share, passed):
    gate = gate_of("impossible points", [recorded()], [recorded(impossible=share), recorded()])
    assert (gate.passed, gate.figure, gate.limit) == (passed, pytest.approx(100 * share), pytest.approx(5.0))


def test_every_rig_was_measured():
    assert gate_of("calibration", [recorded()]).passed
    gate = gate_of("calibration", [recorded(is_calibrated=False), recorded()], [recorded(is_calibrated=False)])
    assert (gate.passed, gate.figure) == (False, 2)


@pytest.mark.parametrize(("repeated", "passed"), [(1, False), (0, True)])
def test_a_tenth_of_the_frames_may_repeat(repeated, passed):
    """One of eight changes is none: 12.5 %."""
    take = recorded()
    take.points[8] = take.points[7 if repeated else 8]
    gate = gate_of("repeated frames", [recorded(), take])
    assert (gate.passed, gate.figure, gate.limit) == (passed, pytest.approx(12.5 * repeated), pytest.approx(10.0))


def test_nobody_claims_to_have_measured_what_imported_takes_state():
    passed = gate_of("calibration", [recorded(is_imported=True), recorded()])
    assert passed.passed
    assert passed.sentence.endswith("as 1 imported takes state them; nobody measured them here.")
    assert "are measured" in gate_of("calibration", [recorded(), recorded()]).sentence


def test_points_that_slide_though_they_are_said_to_stay_fail_a_gate():
    time = uneven()
    share = 0.9 + 0.08 * np.sin(2 * np.pi * 0.9 * time)
    wrong = recording_of(swung(silhouette_sheet("material"), time, time, seen_length=share))
    gate = gate_of("kind of points", [wrong])
    assert not gate.passed
    assert 'State points_are = "silhouette"' in gate.sentence
    assert gate_of("kind of points", [recorded()]).passed


@pytest.mark.parametrize("hidden", ["nothing", "one point", "a tenth"])
@pytest.mark.parametrize("times", [1, 3])
def test_frames_that_repeat_are_found_whatever_is_hidden(hidden, times):
    take = a_take(grid=5)
    valid = take.points_valid.copy()
    if hidden == "one point":
        valid[:, 12] = False
    if hidden == "a tenth":
        valid &= np.random.default_rng(0).uniform(size=valid.shape) > 0.1
    first = np.arange(len(take.time)) // times * times  # which frame each one shows
    held = dataclasses.replace(take, points=take.points[first], points_valid=valid)
    gate = gate_of("repeated frames", [prepare(held)])
    assert gate.passed == (times == 1)
    assert gate.figure == pytest.approx(100 * (1 - 1 / times), abs=1.0)


def test_the_noise_that_a_nudge_may_reach_is_that_of_the_varying_part_of_the_judged_points():
    """1 mm per axis; what else the residual holds, here known to 2 cm, is no noise."""
    observer = Chaotic(lambda hz: 0.34)
    judged = np.arange(len(observer.layout.sd)) < 900
    observer.layout = dataclasses.replace(observer.layout, is_judged=judged, sd=np.where(judged, 1e-3, 0.02))
    assert predictability_gate(observer, SI.initial, observer.off).limit == pytest.approx(np.sqrt(3.0))
