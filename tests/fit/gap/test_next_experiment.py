"""The proposed next recording: simulated motions, and the explanations that they distinguish."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.cloth.effect import amplitudes_of
from fit.effects import LIBRARY
from fit.gap.hypotheses import Hypothesis
from fit.gap.next_experiment import (
    MENU,
    _apart,
    _changes,
    _imagined,
    _inflation,
    _pairs,
    _rows,
    followed,
    imagine,
    propose,
)
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, fitted_at, truth_vector


@pytest.mark.slow
def test_turning_cloth_or_rig_separates_a_draught_from_tilted_gravity():
    """Both only lean the cloth; a twist of the hanger, or a turned rig, puts the wind on another side of it."""
    observer = Observer([prepare(a_take())], SI, LIBRARY, frequency=0.0, resolution=COARSE)
    base = fitted_at(observer, truth_vector())
    alive = []
    for name, size in (("gravity_tilt", (0.0, 0.02)), ("draught", (0.0, 0.35))):
        row = amplitudes_of(LIBRARY, **{name: size})
        assert row[observer.columns[name]].any()
        alive.append(Hypothesis((name,), dataclasses.replace(base, amplitudes=row, active=(name,)), None))
    found = propose(observer, base, alive, [0.5, 0.5])
    assert found is not None
    assert found.id in {"S7", "S9"}
    assert found.separates == ["gravity_tilt", "draught"]
    assert found.sigmas_next > 2 * found.sigmas_now


def test_every_motion_of_the_menu_can_be_imagined():
    recording = prepare(a_take())
    for motion in MENU:
        imagined = imagine(recording, motion)
        path = imagined.held(imagined.time)
        assert np.isfinite(path).all(), motion.id
        gap = np.linalg.norm(path[:, 3:] - path[:, :3], axis=1)
        assert gap == pytest.approx(np.full(len(gap), 0.4), abs=2e-3), motion.id


def test_the_next_recording_is_imagined_of_cloth_that_follows_the_hanger():
    """Under a pull to where the base model has it; pulled to a cloth that stands still it would hardly move."""
    observer = Observer([prepare(a_take())], SI, (), frequency=2.0, resolution=COARSE)
    swung = next(m for m in MENU if m.id == "S3")
    base = SimpleNamespace(vector=truth_vector())
    (imagined,) = followed(observer, [imagine(observer.recordings[0], swung)], base)
    under = observer.of([imagined])
    (pulled,) = under.trajectories(truth_vector()[None], observer.off[None])
    assert np.abs(pulled[0] - imagined.points).max() < 5e-3
    assert np.ptp(imagined.points[:, -1, 1]) > 0.2


def test_an_outline_may_begin_anywhere():
    """Moved by 0.3 m in its own plane, the garment hangs from the same place."""
    recording = prepare(a_take())
    garment = recording.garment
    aside = msgspec.structs.replace(
        garment, outline_m=tuple((x + 0.3, y - 0.1) for x, y in garment.outline_m),
        points=tuple(msgspec.structs.replace(p, at_m=(p.at_m[0] + 0.3, p.at_m[1] - 0.1)) for p in garment.points),
    )  # fmt: skip
    moved = dataclasses.replace(recording, garment=aside, offset_sd=0.002, held_error=0.004)
    one, other = (imagine(r, MENU[3]) for r in (recording, moved))
    assert other.points == pytest.approx(one.points)
    assert (other.offset_sd, other.held_error) == (0.002, 0.004)


def test_an_imagined_recording_has_garment_hanger_and_sensor_of_the_given_one():
    """A flick lasts from 0.5 to 0.75 s. Its deceleration peaks at 0.7 s; a slip follows three hundredths later."""
    recording = prepare(a_take())
    count = recording.points.shape[1]
    like = dataclasses.replace(
        recording, point_sd=np.linspace(1e-3, 2e-3, count), held_sd=0.003, held_cut_off=7.5,
        turn_rms=np.array([0.1, 0.2]), offset_sd=0.002, held_error=0.004,
    )  # fmt: skip
    found = imagine(like, MENU[6])
    assert (found.take_id, found.garment) == ("S6", like.garment)
    for name in ("point_sd", "held_sd", "held_cut_off", "turn_rms", "judged", "offset_sd", "held_error"):
        assert np.array_equal(getattr(found, name), getattr(like, name)), name
    assert found.time == pytest.approx(np.arange(120) / 30)
    assert found.points.shape == (120, count, 3)
    assert np.ptp(found.points, axis=0) == pytest.approx(0.0)
    assert found.valid.all()
    assert found.valid.shape == (120, count)
    assert found.held_seen == pytest.approx(found.held(found.time))
    wanted, trust = found.targets(np.array([0.1, 2.0]))
    assert wanted[..., :3] == pytest.approx(found.points[:2])
    assert not wanted[..., 3:].any()
    assert trust.all()
    assert found.edge_turn(np.array([0.1, 2.0])) == pytest.approx(np.zeros((2, 2)))
    assert found.slip_at == pytest.approx(0.73, abs=0.01)


def test_an_imagined_garment_hangs_flat_and_upright_at_its_size_below_the_bar():
    """Where it lies on a table, its upper edge at the middle of the bar."""
    recording = prepare(a_take())
    ((left, right),) = recording.held(np.zeros(1)).reshape(1, 2, 3)
    top = np.mean(recording.garment.outline_m[:2], axis=0)
    along = (right - left) / np.linalg.norm(right - left)
    hung = imagine(recording, MENU[0]).points[0] - (left + right) / 2
    lying = np.array([p.at_m for p in recording.garment.points]) - top
    assert lying[:, 1].min() < -0.1
    assert hung @ along == pytest.approx(lying[:, 0], abs=1e-3)
    assert hung[:, 2] == pytest.approx(lying[:, 1])
    apart, apart_lying = (np.linalg.norm(one[:, None] - one, axis=2) for one in (hung, lying))
    assert apart == pytest.approx(apart_lying)


def test_explanations_are_apart_by_what_parameters_and_the_other_one_cannot_imitate():
    """Of (3, 4, 12) the parameter along the first axis imitates 3, and the other effect along the second 4."""
    numbers = 3
    observer = LinearObserver(np.zeros(numbers), np.zeros((numbers, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    jacobian = np.zeros((numbers, len(SI.initial)))
    jacobian[0, 0] = 1e6
    changes = [np.array([3.0, 4.0, 12.0]), np.array([0.0, 1e3, 0.0])]
    assert _apart(observer, 0 * jacobian, changes, 0, None) == pytest.approx(13.0)
    assert _apart(observer, jacobian, changes, 0, None) == pytest.approx(np.hypot(4, 12), rel=1e-6)
    assert _apart(observer, jacobian, changes, 0, 1) == pytest.approx(12.0, rel=1e-6)
    # Where a parameter is as well known before as by the data, half of what it could imitate is left.
    weak = np.zeros((numbers, len(SI.initial)))
    weak[0, 0] = 1 / 1.5
    assert _apart(observer, weak, changes, 0, None) == pytest.approx(np.sqrt(1.5**2 + 4**2 + 12**2), rel=1e-6)
    # An explanation that changes nothing imitates nothing, and one of the size of its own weak prior half.
    for size, left in ((0.0, 4.0), (1e-3, 2.0)):
        changes[1] = np.array([0.0, size, 0.0])
        assert _apart(observer, 0 * jacobian, changes, 0, 1) == pytest.approx(np.sqrt(3**2 + left**2 + 12**2))
    assert _pairs(1) == [(0, None)]
    assert _pairs(3) == [(0, 1), (0, 2), (1, 2)]


def test_standard_deviations_are_larger_by_what_blocks_have_in_common():
    """A residual and a change of five equal numbers a block: block scores of 5 where white noise makes sqrt(5)."""
    rng = np.random.default_rng(0)
    blocks = layout_of(400, 6, 5).block
    observer = LinearObserver(
        np.zeros(len(blocks)), np.zeros((len(blocks), len(SI.initial))), {}, layout=layout_of(400)
    )
    change = np.ones(len(blocks))
    alike = rng.normal(size=80)[blocks]
    base = dataclasses.replace(observer.fitted(), residual=alike - alike.mean())
    assert _inflation(observer, base, [change]) == pytest.approx(90.0, rel=0.3)  # five frames of 18 numbers
    white = dataclasses.replace(observer.fitted(), residual=rng.normal(size=len(blocks)))
    assert 1.0 <= _inflation(observer, white, [change]) < 1.5
    explained = dataclasses.replace(observer.fitted(), residual=7.0 * change)
    assert _inflation(observer, explained, [change]) == 1.0


@pytest.mark.parametrize(("scores", "inflation"), [((2, 5, 3), 9.0), ((2, 7, 5, 3), 17.0)])
def test_of_several_changes_the_median_inflation_counts(scores, inflation):
    """Each change is 1 in two blocks of one number, and the residual a and -a: 2 a^2 / 2 are its ratio."""
    changes = list(np.kron(np.eye(len(scores)), [1.0, 1.0]))
    residual = np.kron(np.array(scores, float), [1.0, -1.0])
    observer = SimpleNamespace(layout=SimpleNamespace(block=np.arange(len(residual))))
    assert _inflation(observer, SimpleNamespace(residual=residual), changes) == pytest.approx(inflation)


def test_what_any_of_several_changes_explains_is_not_inflation():
    """One block of 18 equal numbers, wholly explained by the first change: without that its ratio would be 9 x 18."""
    same, other = np.ones(18), np.tile([1.0, -1.0], 9)
    observer = SimpleNamespace(layout=SimpleNamespace(block=np.zeros(18, int)))
    for changes in ([same, other], [other, same]):
        assert _inflation(observer, SimpleNamespace(residual=3.0 * same + 2.0 * other), changes) == 1.0


def path_of(name, *instants):
    motion = next(m for m in MENU if m.id == name)
    return motion.path(np.array(instants))


def test_the_motions_of_the_menu_go_where_their_sentences_say():
    """Quarter turns: of 0.8 Hz at 0.9375, 2.1875 and 3.4375 s the third of four, of 1.5 Hz at 1.5 s the first."""
    swung = path_of("S3", 0.3, 0.9375, 2.1875, 3.4375)
    assert swung == pytest.approx(np.array([[0, 0, 0], [0, -0.02, 0], [0, -0.06, 0], [0, -0.12, 0]]), abs=1e-9)
    assert path_of("S4", 0.9375, 3.4375) == pytest.approx(swung[[1, 3]][:, [1, 0, 2]], abs=1e-9)
    # 0.4 Hz that grow by 0.65 Hz a second: 0.725 turns after one second, 4.125 after three.
    turns = np.array([0.725, 4.125])
    face_on, upwards = np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    assert path_of("S5", 1.0, 3.0) == pytest.approx(0.015 * np.sin(2 * np.pi * turns)[:, None] * face_on)
    flicked = np.array([0.0, 0.06, 0.12, 0.12])[:, None] * face_on
    assert path_of("S6", 0.5, 0.625, 0.75, 4.0) == pytest.approx(flicked)
    assert path_of("S8", 0.2, 1.5) == pytest.approx(np.array([0.0, 0.05])[:, None] * upwards)
    assert path_of("S0", 0.0, 2.0) == pytest.approx(np.zeros((2, 3)))
    twisted = next(m for m in MENU if m.id == "S7").yaw(np.array([0.0, 1.25 / 0.7, 1.75 / 0.7]))
    assert np.degrees(twisted) == pytest.approx([0.0, 30.0, -30.0], abs=1e-9)
    # A start without a jerk: half the way after 0.6 s.
    assert path_of("S8", 0.6)[0, 2] == pytest.approx(0.05 * np.sin(2 * np.pi * 0.9) / 2)


def test_a_motion_is_imagined_in_the_hangers_frame_whichever_way_it_hangs():
    """Face-on is square to the bar and level; half of the bar's length stays on either side, turned by the yaw."""
    recording = prepare(a_take())
    (ends,) = recording.held(np.zeros(1))
    centre, angle = ends.reshape(2, 3).mean(0), np.radians(30.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    aside = ((ends.reshape(2, 3) - centre) @ turn.T + centre).ravel()
    turned = dataclasses.replace(recording, held=lambda instants: np.tile(aside, (len(instants), 1)))
    for motion in (MENU[3], MENU[4], MENU[7], MENU[8]):
        straight, found = (imagine(one, motion) for one in (recording, turned))
        instants = np.array([1.0, 2.1875, 3.0])
        expected = (straight.held(instants).reshape(-1, 2, 3) - centre) @ turn.T + centre
        assert found.held(instants).reshape(-1, 2, 3) == pytest.approx(expected, abs=1e-9), motion.id
        assert straight.held(instants).reshape(-1, 2, 3).mean(1) == pytest.approx(centre + motion.path(instants))
        assert len(found.time) == 120
        assert found.points[0] == pytest.approx((straight.points[0] - centre) @ turn.T + centre)


def alive_of(*names):
    return [Hypothesis((name,), SimpleNamespace(), None) for name in names]


def proposed(monkeypatch, now, after, alive, weights, inflation=4.0):
    """What is proposed where contributions are these now, and beside them in each motion of a menu of three."""
    monkeypatch.setattr("fit.gap.next_experiment.MENU", MENU[:3])
    numbers = len(now[0])
    observer = LinearObserver(np.zeros(numbers), np.zeros((numbers, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    none = np.zeros((numbers, len(SI.initial)))
    for name, value in (
        ("_changes", list(now)), ("_rows", []), ("_inflation", inflation), ("followed", []),
        ("_imagined", [(none[: len(c[0])], list(c)) for c in after]),
    ):  # fmt: skip
        monkeypatch.setattr(f"fit.gap.next_experiment.{name}", lambda *given, value=value: value)
    monkeypatch.setattr("fit.gap.next_experiment.imagine", lambda like, motion: None)
    return propose(observer, observer.fitted(), alive_of(*alive), list(weights))


X, Y, Z = np.eye(3)


def test_the_motion_that_separates_two_explanations_most_is_proposed(monkeypatch):
    """6 apart at right angles now, 3 deviations of an inflation of 4; beside (0, 8, 0) 10, or 5 deviations."""
    now = [6.0 * X, 1e3 * Y]
    after = [[2.0 * X, 0 * X], [8.0 * X, 0 * X], [7.0 * X, 0 * X]]
    found = proposed(monkeypatch, now, after, ["hem", "air_drag"], [0.5, 0.5])
    assert (found.id, found.separates) == ("S1", ["hem", "air_drag"])
    assert (found.sigmas_now, found.sigmas_next) == pytest.approx((3.0, 5.0))
    assert found.sentence == (
        f"Next, {MENU[1].sentence}: with such a take, a heavier hem would differ from air drag by 5.0 "
        "standard deviations. The present takes alone give 3.0."
    )


@pytest.mark.parametrize(("more", "is_worth_it"), [(2.9, True), (2.7, False)])
def test_a_recording_that_adds_less_than_a_standard_deviation_is_not_proposed(monkeypatch, more, is_worth_it):
    """(sqrt(1 + 2.9^2) - 1) / 2 is 1.03, and of 2.7 0.94; how probable the effect is does not matter to that."""
    found = proposed(monkeypatch, [X], [[more * Y]] * 3, ["hem"], [0.7])
    assert (found is not None) == is_worth_it
    if found:
        assert found.separates == ["hem"]
        assert "from no effect by" in found.sentence


def test_of_motions_that_separate_alike_the_first_is_proposed_from_a_whole_deviation_on(monkeypatch):
    """3 now and 5 then, of an inflation of 4: exactly one deviation more."""
    found = proposed(monkeypatch, [3.0 * X], [[4.0 * Y]] * 3, ["hem"], [0.7])
    assert (found.id, found.sigmas_now, found.sigmas_next) == ("S0", 1.5, 2.5)


def test_a_more_probable_effect_weighs_more(monkeypatch):
    """The first motion separates the second and the third by 4 more, the second motion the first from both."""
    now = [X, Y, Z]
    far = [[0 * X, 4.9 * X, 0 * X], [4.9 * X, 0 * X, 0 * X], [0 * X] * 3]
    names = ["hem", "air_drag", "draught"]
    found = proposed(monkeypatch, now, far, names, [0.1, 0.45, 0.45], inflation=1.0)
    assert (found.id, found.separates) == ("S0", ["air_drag", "draught"])
    found = proposed(monkeypatch, now, far, names, [0.8, 0.15, 0.05], inflation=1.0)
    assert (found.id, found.separates) == ("S1", ["hem", "air_drag"])


def test_of_several_pairs_the_one_that_gains_most_is_named(monkeypatch):
    """The first two are ten apart with or without the recording, the second and the third one, and then five."""
    now = [10 * X, Y, Z]
    far = [[0 * X, 4.9 * X, 0 * X]] * 3
    found = proposed(monkeypatch, now, far, ["hem", "air_drag", "draught"], [0.4, 0.3, 0.3], inflation=1.0)
    assert found.separates == ["air_drag", "draught"]
    assert (found.sigmas_now, found.sigmas_next) == pytest.approx((1.0, np.hypot(1.0, 4.9)))


def test_nothing_is_proposed_where_nothing_is_alive_and_no_more_than_four_are_compared(monkeypatch):
    assert proposed(monkeypatch, [X], [[X]] * 3, [], []) is None
    now = [X, Y, Z, 0.1 * X, 0 * X]
    far = [[0 * X] * 4 + [50 * X]] * 3
    names = ["hem", "air_drag", "draught", "clip_slack", "anisotropy"]
    assert proposed(monkeypatch, now, far, names, [0.2] * 5) is None


def test_explanations_that_turn_with_the_cloth_change_their_sign_and_a_hem_below_is_none():
    """Of a cloth hung back to front a curl is the other way round, and of one upside down a hem is nothing."""
    observer = LinearObserver(np.zeros(3), np.zeros((3, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    amplitudes = observer.off.copy()
    amplitudes[observer.columns["rest_curvature"]] = (2.0, 3.0)
    amplitudes[observer.columns["hem"]] = 0.5
    curl, hem = (
        Hypothesis((name,), dataclasses.replace(observer.fitted(), amplitudes=amplitudes), None)
        for name in ("rest_curvature", "hem")
    )
    for motion, signs, left in ((MENU[1], (-1, -1), 1.0), (MENU[2], (1, 1), 0.0), (MENU[3], (1, 1), 1.0)):
        rows = _rows(observer, [curl, hem], motion.turned)
        assert rows[0][observer.columns["rest_curvature"]] == pytest.approx(np.array([2.0, 3.0]) * signs)
        assert rows[1][observer.columns["hem"]] == pytest.approx(0.5 * left)
        assert np.count_nonzero(rows[0]) == 2


def test_a_change_is_that_of_the_residual_beside_the_base_parameters():
    rows = {"hem": np.full((1, 4), 2.0)}
    observer = LinearObserver(np.ones(4), np.zeros((4, len(SI.initial))), rows, layout=layout_of(1, 1, 1))
    row = observer.off.copy()
    row[observer.columns["hem"]] = 3.0
    (change,) = _changes(observer, observer.fitted(), [row])
    assert change == pytest.approx(np.full(4, 6.0))


def test_of_two_effects_the_one_that_was_added_last_is_imagined():
    observer = LinearObserver(np.zeros(3), np.zeros((3, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    pair = Hypothesis(
        ("air_drag", "hem"), dataclasses.replace(observer.fitted(), amplitudes=np.full(len(observer.off), 0.5)), None
    )
    (row,) = _rows(observer, [pair], {})
    assert row[observer.columns["hem"]] == pytest.approx(0.5)
    assert row[observer.columns["air_drag"]] == pytest.approx(observer.off[observer.columns["air_drag"]])


def test_each_motion_of_the_menu_has_its_own_answer(monkeypatch):
    """The k-th recording shows k times what the first does of the parameters and of a hem."""
    numbers = np.arange(1.0, 4.0)

    def shown(times):
        steep = times * np.outer(numbers, np.arange(1.0, 1 + len(SI.initial)))
        rows = {"hem": times * numbers[None]}
        return LinearObserver(np.zeros(3), steep, rows, layout=layout_of(1, 1, 1))

    monkeypatch.setattr("fit.gap.next_experiment.MENU", MENU[1:2] * 3)
    monkeypatch.setattr(
        "fit.gap.next_experiment.residuals_together",
        lambda asked: [one.residuals(vectors, amplitudes) for one, vectors, amplitudes in asked],
    )
    observer = shown(1.0)
    observer.of = lambda recordings: shown(recordings[0])
    row = observer.off.copy()
    row[observer.columns["hem"]] = 0.5
    hem = Hypothesis(("hem",), dataclasses.replace(observer.fitted(), amplitudes=row), None)
    found = _imagined(observer, [1.0, 2.0, 3.0], observer.fitted(), [hem])
    for times, (jacobian, (change,)) in zip((1.0, 2.0, 3.0), found, strict=True):
        assert change == pytest.approx(0.5 * times * numbers)
        assert jacobian == pytest.approx(times * found[0][0])


def test_changes_that_are_alike_explain_a_residual_once():
    """The second change has nothing left of it; three times as much again would be a ratio of 9 x 18."""
    same = np.ones(18)
    observer = SimpleNamespace(layout=SimpleNamespace(block=np.zeros(18, int)))
    assert _inflation(observer, SimpleNamespace(residual=3.0 * same), [same, same]) == 1.0
