"""The description of the missing force, in words and for known forces."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.missing_force import _pull, find_missing_force, sentence_of
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, truth_vector


@pytest.mark.parametrize(
    ("normal", "words"),
    [(0.8, "mostly along the cloth's normal (80 %)"), (0.3, "in all directions, also along the cloth's normal (30 %)"),
     (0.08, "within the cloth and hardly along the cloth's normal (8 %)")],
)  # fmt: skip
def test_the_missing_forces_direction_is_stated_in_words(normal, words):
    said = sentence_of(normal, 0.03, 0.6, None, {"top": 0.1, "bottom": 0.9}, power=-1.0)
    assert words in said
    assert "acts like inertia or a constant load" in said
    assert "the bottom third" in said


@pytest.mark.parametrize(("damping", "words"), [(0.3, "opposes motion"), (5.0, "drives motion")])
def test_the_missing_force_opposes_motion_that_is_damped_too_little_and_else_drives_it(damping, words):
    """The cloth is damped by 1.5 1/s: the missing force is -(1.5 - damping) v, along the velocity."""
    recording = prepare(a_take(noise=1e-4))
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    vector = truth_vector()
    vector[[p.name for p in SI.parameters].index("velocity_damping")] = damping
    found = find_missing_force(observer, vector)
    assert words in found.sentence
    assert found.power == pytest.approx(-abs(found.power) if damping < 1.5 else abs(found.power))
    assert found.odd_share > 0.6
    assert found.amplitude_exponent == pytest.approx(1.0, abs=0.5)


def test_struck_drag_is_along_the_normal_and_grows_with_the_square_of_speed():
    recording = prepare(a_take("a", "air_drag", 2.5, noise=1e-4))
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    found = find_missing_force(observer, truth_vector())
    assert found.power < 0
    assert found.odd_share > 2 * found.even_share
    assert found.normal_share > 0.8
    assert found.amplitude_exponent == pytest.approx(2.0, abs=0.3)


def test_the_missing_force_is_seen_in_the_top_third_as_well():
    """Of 25 points the 5 on the edge cannot be pulled; the top third has 5 more."""
    recording = prepare(a_take())
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    found = find_missing_force(observer, truth_vector())
    assert found.spatial_share["top"] > 0.0
    assert len(found.places) == 20


GARMENT = SimpleNamespace(points=[SimpleNamespace(at_m=(0.1 * k, -0.1 * k)) for k in range(4)])


def described(monkeypatch, *parts):
    """The missing force of takes whose rows are given: pull, normal, third, odd, even, powers, point."""
    given = iter(parts)
    monkeypatch.setattr("fit.gap.missing_force._pull", lambda simulator, material, amplitudes: next(given))
    observer = SimpleNamespace(
        off=np.zeros(1),
        asked=lambda vectors, rows: ([0] * len(parts),) * 3,
        recordings=[SimpleNamespace(garment=GARMENT)],
    )
    return find_missing_force(observer, np.zeros(5))


def rows_of(rng, count, pull_of, *, point, third, cosine=0.0):
    """Rows of random velocity, acceleration and upright normals, with the pull that a law makes of them.

    cosine: the correlation of velocity and acceleration
    """
    velocity, acceleration = rng.normal(size=(2, count, 3))
    acceleration = cosine * velocity + np.sqrt(1 - cosine**2) * acceleration
    normal = np.tile([0.0, 0.0, 1.0], (count, 1))
    speed = velocity[:, 2:]
    odd = np.stack([velocity, np.abs(speed) * speed * normal], 1)
    even = np.concatenate(
        [np.stack([acceleration, acceleration[:, 2:] * normal], 1), np.tile(np.eye(3), (count, 1, 1))], 1
    )
    powers = np.abs(speed) ** np.arange(0, 3.01, 0.25) * np.sign(speed)
    pull = pull_of(velocity, acceleration)
    return pull, normal, np.full(count, third), odd, even, powers, np.full(count, point)


def test_a_force_is_split_by_what_it_goes_with_and_where_it_is(monkeypatch):
    """-2 v on 3000 rows in the top third, a and v together on 1000 in the bottom one, all as large as each other."""
    rng = np.random.default_rng(0)
    found = described(
        monkeypatch, rows_of(rng, 3000, lambda v, a: -2.0 * v, point=1, third=0),
        rows_of(rng, 1000, lambda v, a: -2.0 * v, point=3, third=2),
    )  # fmt: skip
    assert found.odd_share == pytest.approx(1.0, abs=0.01)
    assert found.even_share == pytest.approx(0.0, abs=0.01)
    assert found.normal_share == pytest.approx(1 / 3, abs=0.02)
    assert found.power == pytest.approx(-2.0 * 3.0, rel=0.05)  # of three axes of velocity 1
    assert found.amplitude_exponent == 1.0
    assert found.spatial_share == pytest.approx({"top": 0.75, "middle": 0.0, "bottom": 0.25}, abs=0.02)
    assert [place.at_m for place in found.places] == [GARMENT.points[1].at_m, GARMENT.points[3].at_m]
    assert [place.normal for place in found.places] == pytest.approx([2.0, 2.0], rel=0.05)
    assert [place.in_plane for place in found.places] == pytest.approx([np.sqrt(8)] * 2, rel=0.05)


def test_shares_are_what_one_kind_of_feature_explains_beyond_the_other(monkeypatch):
    """3 v and 4 a of independent axes: 9/25 and 16/25; noise of 5 makes half of both."""
    rng = np.random.default_rng(1)
    found = described(monkeypatch, rows_of(rng, 4000, lambda v, a: 3.0 * v + 4.0 * a, point=0, third=1))
    assert (found.odd_share, found.even_share) == pytest.approx((9 / 25, 16 / 25), abs=0.02)
    assert found.power == pytest.approx(9.0, rel=0.1)
    assert found.spatial_share["middle"] == pytest.approx(1.0)
    noisy = described(
        monkeypatch,
        rows_of(rng, 4000, lambda v, a: 3.0 * v + 4.0 * a + rng.normal(0, 5.0, v.shape), point=0, third=1),
    )
    assert (noisy.odd_share, noisy.even_share) == pytest.approx((9 / 50, 16 / 50), abs=0.02)


@pytest.mark.parametrize("power", [0.5, 2.0])
def test_the_exponent_is_that_of_the_normal_speed_which_explains_most(monkeypatch, power):
    def drag(v, a):
        return -(np.abs(v[:, 2:]) ** power) * np.sign(v[:, 2:]) * [0.0, 0.0, 1.0]

    found = described(monkeypatch, rows_of(np.random.default_rng(2), 2000, drag, point=0, third=0))
    assert found.amplitude_exponent == power
    assert found.normal_share == pytest.approx(1.0)
    assert [place.in_plane for place in found.places] == pytest.approx([0.0], abs=1e-9)


def test_a_force_that_no_power_of_the_speed_explains_has_no_exponent(monkeypatch):
    """White noise of 1: powers explain less than a twentieth; features less than a fifth, and words say so."""
    rng = np.random.default_rng(3)
    found = described(monkeypatch, rows_of(rng, 2000, lambda v, a: rng.normal(size=v.shape), point=0, third=0))
    assert found.amplitude_exponent is None
    assert "The sensor's noise hides the missing force" in found.sentence


@pytest.mark.parametrize(
    ("odd", "even", "exponent", "words"),
    [
        (0.6, 0.29, 2.0, "opposes motion and grows with speed to the power 2: features that change sign with velocity "
         "explain 60 %, others 29 %. The"),
        (0.6, 0.31, 2.0, "The force is mixed and grows with speed to the power 2: features that change sign with "
         "velocity explain 60 %, others 31 %."),
        (0.31, 0.6, 2.0, "is mixed: features that change sign with velocity explain 31 %, others 60 %."),
        (0.29, 0.6, 2.0, "acts like inertia or a constant load"),
        (0.6, 0.1, None, "others 10 %. The force is strongest in the top third of the cloth (70 %)."),
        (0.15, 0.04, 2.0, "features of the motion explain 19 % of the pull"),
        (0.15, 0.06, 2.0, "opposes motion"),
    ],
)  # fmt: skip
def test_the_quantity_that_the_force_follows_is_stated_in_words(odd, even, exponent, words):
    assert words in sentence_of(0.5, odd, even, exponent, {"top": 0.7, "bottom": 0.3}, power=-1.0)


@pytest.mark.parametrize(
    ("normal", "words"), [(0.61, "mostly along"), (0.59, "in all directions"), (0.21, "in all directions"),
                          (0.19, "hardly along")],
)  # fmt: skip
def test_a_force_is_mostly_along_the_normal_from_three_fifths_and_hardly_below_a_fifth(normal, words):
    assert words in sentence_of(normal, 0.6, 0.1, None, {"top": 1.0}, power=1.0)


def test_the_pull_is_that_of_a_critically_damped_spring_of_three_hertz():
    """1 mm and 10 mm/s aside: w^2 0.001 and 2 w 0.01 with w = 2 pi 3 Hz, of judged, seen, trusted points."""
    time = np.arange(90) / 30
    speed = 0.1 * np.pi * np.cos(np.pi * time)
    places = np.tile([[0.0, 0.0, z] for z in (0.0, -0.1, -0.2, -0.3)], (90, 1, 1))
    places[..., 1] += 0.1 * np.sin(np.pi * time)[:, None]
    velocity = np.gradient(places, time, axis=0)
    wanted = np.concatenate([places + np.array([0.0, 0.001, 0.0]), velocity + np.array([0.0, 0.0, 0.01])], 2)
    trust = np.ones((90, 4))
    trust[40, 2] = 0.0
    valid = np.ones((90, 4), bool)
    valid[50, 3] = False
    recording = SimpleNamespace(
        time=time, targets=lambda instants: (wanted, trust), valid=valid, judged=np.array([False, True, True, True]),
        garment=SimpleNamespace(points=[SimpleNamespace(at_m=(0.0, -0.1 * k)) for k in range(4)]),
    )  # fmt: skip
    sides = {1: np.array([0.0, 0.0, 2.0]), 2: np.array([3.0, 0.0, 0.0])}  # z x x = y
    asked = []
    simulator = SimpleNamespace(
        run=lambda *given, **options: (
            asked.append((given, options)) or SimpleNamespace(points=places[None], shapes=np.zeros((1, 90, 4)))
        ),
        recording=recording,
        mesh=SimpleNamespace(points=SimpleNamespace(apply=lambda shapes, k: np.tile(sides[k], (4, 90, 1)))),
    )
    pull, normal, third, odd, even, powers, point = _pull(simulator, "cloth", "effects")
    assert asked == [(("cloth", "effects"), {"observer_hz": 3.0, "shapes": True})]
    count = 84 * 3 - 2
    assert len(pull) == len(point) == count  # three frames at either end have one-sided differences
    omega = 2 * np.pi * 3.0
    assert pull == pytest.approx(np.tile([0.0, omega**2 * 0.001, 2 * omega * 0.01], (count, 1)), abs=1e-6)
    assert normal == pytest.approx(np.tile([0.0, 1.0, 0.0], (count, 1)))
    assert [int(third[point == k][0]) for k in (1, 2, 3)] == [1, 2, 2]
    moving = np.abs(np.arange(90) - 45) < 20
    mine = np.flatnonzero(point == 1)[moving[3:-3]]
    assert odd[mine, 0, 1] == pytest.approx(speed[moving], abs=0.004)
    squares = np.abs(speed) * speed
    assert odd[mine, 1, 1] == pytest.approx(squares[moving], abs=0.008)  # a kink passes 2 Hz rounded
    assert even[mine, 0, 1] == pytest.approx(-0.1 * np.pi**2 * np.sin(np.pi * time)[moving], abs=0.02)
    assert even[mine, 1] == pytest.approx(even[mine, 0], abs=1e-9)  # all of it is along the normal
    assert even[mine, 2:] == pytest.approx(np.tile(np.eye(3), (len(mine), 1, 1)))
    assert powers[mine, 4] == pytest.approx(speed[moving], abs=0.004)
    assert powers[mine, 8] == pytest.approx(squares[moving], abs=0.008)  # a kink passes 2 Hz rounded


def test_motion_that_either_kind_of_feature_explains_is_no_share_of_one_of_them(monkeypatch):
    """v + a that correlate by 0.6: either alone explains (1 + 0.6) / 2 of it, and beyond the other (1 - 0.6) / 2."""
    rng = np.random.default_rng(2)
    rows = rows_of(rng, 20000, lambda v, a: v + a, point=0, third=1, cosine=0.6)
    found = described(monkeypatch, rows)
    assert (found.odd_share, found.even_share) == pytest.approx((0.2, 0.2), abs=0.02)  # 0.01 is sqrt(1 / 20000)


@pytest.mark.parametrize(
    ("normal", "odd", "even", "words"),
    [
        (0.5, 0.6, 0.3, "The force is mixed"), (0.5, 0.3, 0.6, "The force is mixed"),
        (0.6, 0.6, 0.1, "in all directions"), (0.2, 0.6, 0.1, "in all directions"),
        (0.5, 0.125, 0.075, "The force is mixed"),
    ],
)  # fmt: skip
def test_a_force_exactly_at_a_limit_of_the_words_has_the_more_careful_ones(normal, odd, even, words):
    """Twice the other share, three fifths or a fifth along the normal, a fifth of the pull that is explained."""
    assert words in sentence_of(normal, odd, even, None, {"top": 1.0}, power=1.0)
