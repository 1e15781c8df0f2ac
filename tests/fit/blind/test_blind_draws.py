"""Draws of blind cases that every version repeats, and laws of the simulated tracker and its hidden rotation."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fit.blind import making
from fit.blind.boundary import real_ends
from fit.blind.cases import _cloth, _garment, _take, draw_truth, plan
from fit.blind.engine import SAMPLES_A_SECOND, Cloth
from fit.blind.foreign.engines import find_generator
from fit.blind.hands import HELD_OUT, TRAINING, move
from fit.blind.making import make_real_set, make_set
from fit.blind.plants import PLANTS, UNKNOWNS, Planted, with_plants
from fit.blind.real import _turn, plan_real, real_plants
from fit.blind.sensing import smoothing_matrix
from fit.effects import LIBRARY
from fit.errors import FitError
from formats.archive import write_take
from tests.fit.blind.blind_answers import COARSE, PLANTED
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take

# Of NumPy's generator PCG64, whose streams every version keeps; a set that was begun goes on with them.
CASES = [
    ("fc8c4ce7", "pair", {"hem": 0.006047075389040797, "hanger_rotation": 0.04185995932881171}),
    ("33da7d45", "single", {"gravity_tilt": 0.030502778966731998}),
    ("97758c5c", "single", {"tracker_smoothing": 0.4946631501940245}),
    ("bdd130e1", "null", {}),
    ("47d9d82f", "unknown", {"loose_thread": 0.7066086594755789}),
]
FIRST = {
    "stretch": 224.84914175062295, "shear": 20.80866120858384, "bending": 6.311048091743172e-06,
    "damping": 0.31681771048022156, "seed": 808309045,
}  # fmt: skip
LOOK = [
    0.41139871731481925, 0.3586520888692912, 0.03481270003740852, 8, 45.0, 3.97, 0.002233176660887692,
    0.042517322376500626, -0.05936733789860861, 0.0068588082301771006, 1.6085183684915736,
]  # fmt: skip
# Sums over samples and coordinates [m] of motions of 5 s, and both ends at 3 s.
MOTIONS = {
    "chirp": (314.58371817951127, [-0.148300833, -0.003271317, 0.000858856, 0.151693812, -0.004040448, 0.00247786]),
    "sideways": (339.1887498819941, [-0.155007163, -0.0078009, 0.001748983, 0.14498782, -0.009366677, 0.002496245]),
    "twist": (397.7929418071749, [-0.149359683, -0.098428745, 0.002714335, 0.150507725, -0.089549789, 0.003552155]),
    "ellipse": (327.81434859612193, [-0.123068262, -0.004413076, 0.000858856, 0.176926383, -0.005182208, 0.00247786]),
    "oblique": (347.4472452945123, [-0.154754814, 0.000349822, 0.013502933, 0.145235206, -0.001971534, 0.012728804]),
}  # fmt: skip


def test_a_seed_draws_the_same_cases_in_every_version():
    truths = plan({"single": 2, "null": 1, "pair": 1, "unknown": 1}, PLANTS, 5)
    assert [(t.id, t.kind, {p.id: pytest.approx(p.amplitude) for p in t.planted}) for t in truths] == CASES
    first = truths[0]
    assert {name: getattr(first, name) for name in FIRST} == pytest.approx(FIRST)
    assert first.look.features() == pytest.approx(LOOK)
    hem, rotation = first.planted
    assert (hem.seed, rotation.seed) == (1908861211, 1833906074)
    assert rotation.components == pytest.approx({"yaw": -0.030111385488455655, "roll": 0.029078525735934283})


@pytest.mark.parametrize("kind", [*TRAINING, *HELD_OUT])
def test_a_seed_draws_the_same_motions_in_every_version(kind):
    total, there = MOTIONS[kind]
    motion = move(np.random.default_rng(3), kind, 5.0, 0.3, 0.35, 0.6)
    assert np.abs(motion).sum() == pytest.approx(total)
    assert motion[600] == pytest.approx(there, abs=1e-8)


def test_a_seed_plants_the_same_faults_in_the_same_real_takes_in_every_version():
    numbers = {"single": 1, "null": 1, "pair": 0, "unknown": 0}
    untouched_case, case = plan_real([f"t{k}" for k in range(8)], numbers, real_plants([]), 5)
    assert (untouched_case.id, untouched_case.takes) == ("a8e5b8ab", ("t5", "t2", "t0", "t3", "t4"))
    assert untouched_case.turn == pytest.approx((-0.014644287132800221, -0.02728348836585329))
    assert (case.id, case.reference, case.takes) == ("eeab14ce", "a8e5b8ab", untouched_case.takes)
    (one,) = case.planted
    assert (one.id, one.seed) == ("clock_drift", 381654049)
    assert one.amplitude == pytest.approx(0.0038056111892823233)


def test_sensors_of_real_cases_turn_by_five_and_two_degrees_at_most_to_either_side():
    turns = np.array([_turn(np.random.default_rng(seed)) for seed in range(300)])
    for drawn, most in zip(turns.T, (0.08, 0.03), strict=True):
        assert 0.95 * most < drawn.max() <= most
        assert 0.95 * most < -drawn.min() <= most


FIELDS = {
    "bending_hysteresis": {"friction": 3.0}, "hem": {"hem": 3.0}, "strain_stiffening": {"stiffening": 3.0},
    "anisotropy": {"stretch_ratio": 4.0, "bending_ratio": 5.0}, "rest_curvature": {"curl": (4.0, 5.0)},
    "bending_viscosity": {"bend_viscosity": 3.0}, "stretch_viscosity": {"stretch_time": 3.0},
    "mass_distribution": {"mass_slope": (4.0, 5.0)}, "air_drag": {"drag": 3.0}, "added_mass": {"added_mass": 3.0},
    "air_lift": {"lift": 3.0}, "gravity_tilt": {"gravity_tilt": (4.0, 5.0)}, "wake_memory": {"wake": 3.0},
    "hidden_magnet": {"magnet": 3.0}, "corner_pendulum": {"bob": pytest.approx(3.0 * 0.3**2 * 0.2), "corner": 1},
    "loose_thread": {"thread": 3.0, "corner": 1},
}  # fmt: skip


@pytest.mark.parametrize("plant", [plant for plant in PLANTS + UNKNOWNS if plant.id != "draught"], ids=lambda p: p.id)
def test_an_effect_sets_its_own_fields_of_the_cloth_and_no_others(plant):
    """An amplitude of 3, in components of 4 and 5."""
    parts = {"": 3.0} if plant.components == ("",) else dict(zip(plant.components, (4.0, 5.0, 6.0), strict=False))
    cloth = Cloth(width=0.3, height=0.3)
    changed = with_plants(cloth, (Planted(id=plant.id, amplitude=3.0, unit=plant.unit, components=parts),))
    expected = FIELDS.get(plant.id, {})
    if plant.id == "hem":  # the weighed mass stays
        expected = {**expected, "density": pytest.approx(0.2 - 3.0 / 0.3)}
    assert {field: value for field, value in vars(changed).items() if value != getattr(cloth, field)} == {
        field: value for field, value in expected.items() if value != getattr(cloth, field)
    }


def test_what_is_drawn_can_be_planted_and_only_the_librarys_effects_count_as_known():
    cloth, rng = Cloth(width=0.3, height=0.3), np.random.default_rng(0)
    for plant in PLANTS + UNKNOWNS:
        drawn = plant.draw(rng, cloth)
        assert tuple(drawn.components) == plant.components
        assert drawn.in_library == (plant in PLANTS)
        assert (with_plants(cloth, (drawn,)) != cloth) == (plant.on_cloth is not None)


def test_a_null_has_the_cloth_that_was_drawn_for_it():
    truth = draw_truth("a", "null", (), (1, 2))
    made, look = _cloth(truth), truth.look
    for name in ("stretch", "shear", "bending", "damping"):
        assert getattr(made, name) == getattr(truth, name)
    assert (made.width, made.height) == (look.width, look.height)
    assert made.mass == pytest.approx(look.mass)


def test_a_draught_has_its_direction_and_a_gust_of_its_own_and_corners_are_on_either_side():
    cloth = Cloth(width=0.3, height=0.3)
    wind = Planted(id="draught", amplitude=0.5, unit="m/s", components={"x": 0.3, "y": -0.4}, seed=5250)
    windy = with_plants(cloth, (wind,))
    assert windy.wind == (0.3, -0.4, 0.0)
    assert windy.gust_phase == pytest.approx(np.pi / 2)
    thread = Planted(id="loose_thread", amplitude=0.5, unit="N/m", components={"": -0.5})
    left = with_plants(cloth, (thread,))
    assert (left.corner, left.thread) == (-1, 0.5)


def test_the_page_on_the_blind_check_states_the_programs_sizes():
    """Amplitudes are drawn up to three typical sizes, or to the limit of apparel and sensors below that."""
    page = (Path(__file__).parents[3] / "docs/reference/blind-check.md").read_text()
    rows = [[cell.strip() for cell in line.split("|")[1:5]] for line in page.splitlines() if line.startswith("| `")]
    stated = {name.strip("`"): (unit.replace("²", "^2"), typical, most) for name, unit, typical, most in
              (row for row in rows if len(row) == 4)}  # fmt: skip
    for plant in PLANTS:
        unit, typical, most = stated[plant.id]
        assert unit == plant.unit.replace("²", "^2")
        assert float(typical) == plant.typical, plant.id
        assert float(most) == pytest.approx(min(3 * plant.typical, plant.most)), plant.id
    assert "equilateral triangles, 16 mm" in page
    assert "squares of 20 mm" in page
    assert [find_generator(name).side for name in ("own", "mujoco", "newton")] == [0.016, 0.02, 0.02]


def test_the_page_on_the_blind_check_names_every_effect_that_no_case_has():
    """Every effect of the library is planted, or the page says why not."""
    page = (Path(__file__).parents[3] / "docs/reference/blind-check.md").read_text()
    reasons = re.search(r"\n(\w+) effects of the library are left out\.\n((?:.+\n)+)", page)
    assert reasons is not None
    planted, known = {plant.id for plant in PLANTS}, {effect.name for effect in LIBRARY}
    named = set(re.findall(r"`(\w+)`", reasons[2])) & known
    assert named == known - planted
    assert reasons[1] == ("No", "One", "Two", "Three", "Four", "Five", "Six")[len(named)]


# --- the boundary and the tracker -----------------------------------------------------------------


def test_a_hidden_rotation_begins_after_a_tenth_of_a_second_and_is_slow():
    """Of 0.3 to 1.5 Hz: a fifth of its power lies below 0.55 and a sixth above 1.3 Hz, in the mean over draws."""
    ends = np.tile([-0.2, 0.0, 0.0, 0.2, 0.0, 0.0], (20 * SAMPLES_A_SECOND, 1))
    power = 0.0
    for seed in range(30):
        one = Planted(id="hanger_rotation", amplitude=0.05, unit="rad", components={"yaw": 0.05, "roll": 0.0},
                      seed=seed)  # fmt: skip
        yaw = np.arcsin(real_ends(ends, (one,), 0)[:, 4] / 0.2)
        assert not yaw[: SAMPLES_A_SECOND // 10].any()
        assert np.sqrt((yaw**2).mean()) == pytest.approx(0.05)
        power = power + np.abs(np.fft.rfft(yaw * np.hanning(len(yaw)))) ** 2
    hertz = np.fft.rfftfreq(len(ends), 1 / SAMPLES_A_SECOND)
    share = [power[(hertz >= low) & (hertz < high)].sum() / power.sum() for low, high in ((0, 0.55), (1.3, 1.6))]
    assert share == pytest.approx([0.25 / 1.2, 0.2 / 1.2], abs=0.06)
    assert power[hertz > 1.7].sum() < 0.01 * power.sum()


@pytest.mark.parametrize(("points", "scene"), [(0.02, 0.0), (0.0, 0.03)])
def test_a_scale_of_the_points_leaves_the_hanger_and_one_of_the_scene_does_not(points, scene):
    """At the sensor's own distance it is the planted share."""
    one = Planted(id="depth_scale", amplitude=0.02, unit="1", components={"points": points, "scene": scene})
    still = {"noise": 0.0, "away": 0.0, "rate": 30.0, "duration": 3.5, "grid": 0, "tilt": (0.0, 0.0)}
    truth = draw_truth("a", "null", (), (1, 2), still)
    ends = np.tile([-0.15, 0.0, 0.0, 0.15, 0.0, 0.0], (701, 1))
    flat = np.tile([0.0, 0.0, -truth.look.height / 2], (740, 5, 1))

    def take(*planted):
        case = SimpleNamespace(look=truth.look, planted=planted)
        return _take(case, _garment(truth.look), "a", ends, flat, np.random.default_rng(0))

    plain, scaled = take(), take(one)
    share = points or scene
    assert scaled.points == pytest.approx((1 + share) * plain.points)
    assert scaled.held == pytest.approx((1 + scene) * plain.held)


def test_smoothing_weighs_neighbours_by_a_gaussian_of_one_and_a_half_spacings():
    """In the middle of an even grid all slopes cancel: what is left are the weights themselves."""
    across = np.arange(5) * 0.04
    flat = np.stack(np.meshgrid(across, across), 2).reshape(-1, 2)
    away = np.linalg.norm(flat - flat[12], axis=1)
    weights = np.exp(-0.5 * (away / 0.06) ** 2)
    assert smoothing_matrix(flat)[12] == pytest.approx(weights / weights.sum())


# --- sets -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("numbers", "plants", "words"),
    [
        ({"single": 0, "null": 0, "pair": 0, "unknown": 0}, PLANTED, "there is no case to make"),
        ({"single": 2, "null": -1, "pair": 0, "unknown": 0}, PLANTED, "there is no case to make"),
        ({"single": 0, "null": 0, "pair": 1, "unknown": 0}, PLANTED[:1], "a pair needs two effects to choose from"),
    ],
)
def test_a_set_of_nothing_or_of_pairs_of_one_effect_is_refused(tmp_path, numbers, plants, words):
    with pytest.raises(FitError, match=words):
        make_set(tmp_path, numbers, plants, 5, side=COARSE)
    assert list(tmp_path.iterdir()) == []


def test_a_real_take_that_is_gone_or_too_short_is_named(tmp_path):
    for k in range(5):
        write_take(tmp_path / f"t{k}.mcap", a_take(5))
    with pytest.raises(FitError, match="too short to plant anything in it"):
        make_real_set(tmp_path / "set", tmp_path, {"single": 0, "null": 1, "pair": 0, "unknown": 0}, (), 1)


def test_the_command_counts_the_cases_it_makes_and_hands_on_what_it_was_given(monkeypatch, tmp_path):
    asked = {}

    def make(folder, numbers, plants, seed, *, progress, **more):
        asked.update(more, numbers=numbers, plants=[plant.id for plant in plants], seed=seed)
        progress(1, 2)
        return SimpleNamespace(cases=("a", "b"), sealed="0f")

    monkeypatch.setattr(making, "make_set", make)
    words = ("--cases", 3, "--nulls", 2, "--pairs", 1, "--unknowns", 4, "--effect", "hem", "--effect", "time_offset")
    done = hangtime_here("blind", "make", "set", *words, "--seed", 7, "--noise", 0.002, "--missing", 0.05,
                         "--workers", 2, "--side", 0.03, folder=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert asked["numbers"] == {"single": 3, "null": 2, "pair": 1, "unknown": 4}
    assert (asked["plants"], asked["seed"]) == (["hem", "time_offset"], 7)
    assert (asked["sensor"], asked["workers"], asked["side"]) == ({"noise": 0.002, "away": 0.05}, 2, 0.03)
    assert "making: 50 %, 1/2 cases\n" in done.stderr
    assert done.stdout == "2 cases in set/cases; labels sealed as 0f\n"
