"""Numbers of the blind check by hand: parameters of the generator, draws of cases, and rates of groups."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from fit.blind import judging
from fit.blind.boundary import real_ends
from fit.blind.cases import _cloth, _garment, _take, draw_look, draw_truth
from fit.blind.cli import CountLine
from fit.blind.engine import Cloth, Engine
from fit.blind.foreign.engines import find_generator
from fit.blind.judging import Judged, conditions_of, judge, named_by
from fit.blind.making import open_labels
from fit.blind.page import _marks
from fit.blind.plants import PLANTS, Planted, with_plants
from fit.blind.running import DIAGNOSIS
from fit.blind.scoring import rates_of, summarise
from fit.errors import BlowUpError
from formats.results import save_diagnosis
from tests.fit.blind.blind_answers import NUMBERS, diagnosis, finding
from tests.fit.blind.test_blind_foreign import outside
from tests.fit.here import hangtime_here


def engine(**changes):
    return Engine(Cloth(width=0.3, height=0.3, **changes), side=0.05)


def test_fibres_and_ground_share_the_stretch_stiffness_and_poissons_ratio_couples_the_ground():
    """Of 300 N/m the ground has 2 x 1.3 x 30 = 78; lambda of a sheet in plane stress is 2 nu mu / (1 - nu)."""
    plain, uneven = engine(), engine(stretch_ratio=np.log(4.0))
    assert plain.fibres == pytest.approx((222.0, 222.0))
    assert uneven.fibres == pytest.approx((444.0, 111.0))
    assert plain.lam == pytest.approx(2 * 0.3 * 30.0 / 0.7)


def test_bending_of_warp_and_weft_is_that_of_level_and_slanting_hinges_together():
    """B_warp = B_level and B_weft = (B_level + 8 B_slanting) / 9, in a ratio of 1.44 here."""
    made = engine(bending=1e-5, bending_ratio=np.log(1.44))
    level = made.sheet.hinge_across[:, 1] ** 2 > 0.7
    (warp,), (slanting,) = np.unique(made.hinge_bending[level]), np.unique(made.hinge_bending[~level])
    assert warp == pytest.approx(1.2e-5)
    assert (warp + 8 * slanting) / 9 == pytest.approx(1e-5 / 1.2)


def test_a_hem_is_three_times_as_stiff_over_its_twenty_millimetres():
    plain, hemmed = (Engine(Cloth(width=0.3, height=0.3, hem=hem), side=0.02) for hem in (0.0, 0.01))
    place = plain.sheet.rest[plain.sheet.hinges[:, :2]].mean(1)[:, 1]
    assert hemmed.hinge_bending / plain.hinge_bending == pytest.approx(np.where(place < -0.28, 3.0, 1.0))
    assert (place < -0.28).any()


def test_a_tilted_gravity_has_its_whole_size():
    numbers = engine(gravity_tilt=(0.05, -0.04)).numbers()
    down = [numbers[f"gravity_{axis}"] for axis in "xyz"]
    assert down[:2] == pytest.approx([9.80665 * np.sin(0.05), -9.80665 * np.sin(0.04)])
    assert np.linalg.norm(down) == pytest.approx(9.80665)
    assert down[2] < 0.0


def test_cases_are_drawn_over_the_ranges_of_sensors_and_apparel():
    """Noise of 0.5 to 3 mm and 100 to 350 g/m^2, both even in their logarithms; a tenth of the time away at most."""
    looks = [draw_look(np.random.default_rng(seed)) for seed in range(400)]
    noise = np.array([look.noise for look in looks])
    density = np.array([look.mass / (look.width * look.height) for look in looks])
    for drawn, low, high in ((noise, 5e-4, 3e-3), (density, 0.1, 0.35)):
        assert low <= drawn.min() < 1.05 * low
        assert 0.95 * high < drawn.max() <= high
        assert np.median(drawn) == pytest.approx(np.sqrt(low * high), rel=0.1)
    assert max(look.away for look in looks) <= 0.1


def test_amplitudes_are_even_in_their_logarithms():
    """Between 0.5 and 3 typical sizes half of them lie below sqrt(1.5) = 1.22, and not below 1.75."""
    lag = next(plant for plant in PLANTS if plant.id == "filter_lag")
    rng = np.random.default_rng(0)
    sizes = [lag.draw(rng, Cloth(width=0.3, height=0.3)).amplitude / lag.typical for _ in range(500)]
    assert np.median(sizes) == pytest.approx(np.sqrt(0.5 * 3.0), rel=0.1)


def test_a_hidden_rotation_is_another_one_in_every_take():
    ends = np.tile([-0.2, 0.0, 0.0, 0.2, 0.0, 0.0], (800, 1))
    one = Planted(id="hanger_rotation", amplitude=0.05, unit="rad", components={"yaw": 0.04, "roll": 0.03}, seed=7)
    takes = [real_ends(ends, (one,), take) for take in (0, 1, 0)]
    assert takes[0] == pytest.approx(takes[2])
    assert np.abs(takes[0] - takes[1]).max() > 0.005


def judged(kind, right, **more):
    return Judged(
        id=kind, kind=kind, planted=("hem",), amplitude=1.0, ratio=3.0, bin="2 to 4", verdict="effect", named=("hem",),
        is_tested=True, right_first=right, **more,
    )  # fmt: skip


def test_rates_of_pairs_and_of_single_effects_are_kept_apart():
    """Of two single effects one is right first; of three pairs all name one of theirs, and one both."""
    cases = [judged("single", True), judged("single", False)]
    cases += [judged("pair", True, both_named=both) for both in (True, False, False)]
    found = rates_of(cases)
    counts = {name: (getattr(found, name).k, getattr(found, name).n)
              for name in ("right_first", "pair_one_named", "pair_both_named")}  # fmt: skip
    assert counts == {"right_first": (1, 2), "pair_one_named": (3, 3), "pair_both_named": (1, 3)}


def test_chance_names_one_of_two_dozen_effects():
    assert summarise((judged("single", True),)).chance == pytest.approx(1 / 24)


@pytest.mark.parametrize(("verdict", "named"), [("effect", ("hem",)), ("unknown", ()), ("inconclusive", ())])
def test_an_answer_names_effects_only_by_a_verdict_that_does(verdict, named):
    assert named_by(diagnosis(verdict, ["hem"], [finding("hem")])) == named


def test_the_curve_of_probabilities_shows_how_many_names_were_right():
    """Of three names of 90 % two are right: 33.3 below the top, with a radius of 1 + sqrt(3)."""
    cases = [SimpleNamespace(probability=0.9, named=(name,), planted=("hem",)) for name in ("hem", "hem", "air_drag")]
    cases.append(SimpleNamespace(probability=0.3, named=("hem",), planted=()))
    assert _marks(SimpleNamespace(cases=cases)) == [("30.0", "100.0", "2.0"), ("90.0", "33.3", "2.7")]


def test_a_take_states_the_noise_that_its_points_have():
    """White noise, and slow noise of a third of it: a hypotenuse, in the points of a cloth at rest as well."""
    truth = draw_truth("a", "null", (), (1, 2), {"noise": 0.002, "away": 0.0, "rate": 60.0, "duration": 3.5, "grid": 9})
    ends = np.tile([-0.15, 0.0, 0.0, 0.15, 0.0, 0.0], (701, 1))
    take = _take(truth, _garment(truth.look), "a", ends, np.zeros((740, 81, 3)), np.random.default_rng(0))
    assert np.unique(take.points_sd) == pytest.approx([0.002 * np.sqrt(1 + 1 / 9)])
    assert (take.points - take.points.mean((0, 1))).std() == pytest.approx(take.points_sd[0, 0, 0], rel=0.02)


@pytest.mark.parametrize(("share", "is_covered"), [(0.85, False), (0.95, True), (1.05, True), (1.15, False)])
def test_a_true_amplitude_is_covered_between_both_ends_of_the_interval(monkeypatch, tmp_path, share, is_covered):
    """An estimate of so much of the true amplitude, a tenth of it to either side."""
    lag = next(plant for plant in PLANTS if plant.id == "filter_lag")
    truth = draw_truth("a", "single", (lag,), (1, 2))
    true = truth.planted[0].amplitude
    said = diagnosis("effect", ["filter_lag"], [finding("filter_lag", share * true, true / 3)])
    monkeypatch.setattr(judging, "answer_of", lambda answers, case: said)
    found = judge(truth, tmp_path)
    assert found.amplitude_covered == is_covered
    assert found.amplitude_error == pytest.approx(abs(share - 1.0))


@pytest.mark.parametrize(("unit", "verdict"), [("s", "effect"), ("ms", "inconclusive")])
def test_an_answer_in_another_unit_than_the_effects_counts_as_none(tmp_path, unit, verdict):
    lag = next(plant for plant in PLANTS if plant.id == "filter_lag")
    truth = draw_truth("a", "single", (lag,), (1, 2))
    said = diagnosis("effect", ["filter_lag"], [finding("filter_lag", truth.planted[0].amplitude, 0.01, unit=unit)])
    save_diagnosis(tmp_path / "a" / DIAGNOSIS, said)
    assert judge(truth, tmp_path).verdict == verdict


def test_the_swatch_of_a_case_has_its_planted_cloth_and_a_point_in_its_middle():
    hem = Planted(id="hem", amplitude=0.02, unit="kg/m", components={"": 0.02})
    truth = replace(draw_truth("a", "null", (), (1, 2), {"grid": 0}), planted=(hem,))
    assert _cloth(truth) == with_plants(_cloth(replace(truth, planted=())), (hem,))
    assert _cloth(truth) != _cloth(replace(truth, planted=()))
    look = truth.look
    assert {p.name: p.at_m for p in _garment(look).points}["centre"] == (0.0, pytest.approx(-look.height / 2))


def test_a_progress_line_says_how_many_cases_ended_without_a_diagnosis_if_any_did(monkeypatch):
    line, shown = CountLine("diagnosing"), []
    monkeypatch.setattr(line, "_line", SimpleNamespace(show=lambda share, text: shown.append((share, text))))
    line.show(1, 4)
    line.show(3, 4, 2)
    assert shown == [(0.25, "1/4 cases"), (0.75, "3/4 cases, 2 without a diagnosis")]


def test_answers_go_where_the_help_text_says_and_effects_of_any_size_may_be_struck(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("fit.blind.running.run_set", lambda folder, answers, **more: asked.append(answers) or 0)
    assert hangtime_here("blind", "run", "DIR", folder=tmp_path).returncode == 0
    assert [str(one) for one in asked] == ["DIR/answers"]
    assert "[default: (DIR/answers)]" in " ".join(
        hangtime_here("blind", "run", "--help", folder=tmp_path).stdout.split()
    )
    done = hangtime_here("blind", "strike", "DIR", "A", "--out", "B", "--least", "0.5", folder=tmp_path)
    assert "--least" not in done.stderr


@pytest.mark.parametrize(("noise", "says"), [(0.9, "below 1 mm"), (1.9, "1 to 2 mm"), (2.1, "above 2 mm")])
def test_cases_are_grouped_by_their_noise(noise, says):
    look = replace(draw_look(np.random.default_rng(0)), noise=1e-3 * noise)
    assert conditions_of(look)["noise"] == says


def test_labels_keep_how_many_cases_of_each_kind_were_asked_for(a_set):
    assert open_labels(a_set).numbers == NUMBERS


def test_a_third_party_simulates_the_mesh_that_is_asked_for_and_no_cloth_may_fly_apart(monkeypatch):
    """A sheet of 0.2 m has 3 x 3 nodes at a side of 0.1 m; one node at infinity is enough."""
    jobs, farthest = [], [0.0]

    class Answering:
        def __init__(self, foreign):
            pass

        def answer(self, **arrays):
            jobs.append(arrays)
            nodes = np.zeros((1, 2, len(arrays["rest"]), 3))
            nodes[0, 1, 0, 2] = farthest[0]
            return {"nodes": nodes}

        def close(self):
            pass

    monkeypatch.setattr("fit.blind.foreign.engines.ForeignProcess", Answering)
    ends = np.tile([-0.1, 0.0, 0.0, 0.1, 0.0, 0.0], (1, 3, 1))

    def points():
        cloth = Cloth(width=0.2, height=0.2)
        return find_generator("mujoco").points(cloth, ends, 0.1, np.array([(0.0, -0.1)]), side=0.1)

    assert points().shape == (1, 2, 1, 3)
    assert len(jobs[0]["rest"]) == 9
    farthest[0] = 1e9
    with pytest.raises(BlowUpError, match="flew apart"):
        points()


def test_lift_on_an_inclined_square_metre_and_a_magnets_pull_by_hand():
    """At 2 m/s across and along: half rho c v_n v_t^2 / v; a pole at its reach pulls with a quarter of its force."""
    forces, x = outside(lift=1.5)
    total = forces.at(0.0, x, np.tile([2.0, 2.0, 0.0], (4, 1))).sum(0)
    assert total == pytest.approx([0.0, -0.5 * 1.2041 * 1.5 * 2.0 * 4.0 / np.sqrt(8.0), 0.0], rel=1e-3)
    forces, x = outside(magnet=0.8, magnet_reach=0.1, magnet_x=1.0, magnet_y=0.1, magnet_z=-1.0)
    assert forces.at(0.0, x, 0 * x)[3] == pytest.approx([0.0, 0.2, 0.0])
