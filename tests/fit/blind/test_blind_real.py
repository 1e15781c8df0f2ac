"""Faults planted in recorded takes, against hand calculation and the generator, and the comparison of answers."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from fit.blind.cases import FILES, draw_truth, make_takes
from fit.blind.engine import Cloth
from fit.blind.making import make_real_set, open_labels
from fit.blind.plants import PLANTS, Planted
from fit.blind.real import (
    PLANTING,
    TIME_MARGIN,
    RealTruth,
    case_take,
    plan_real,
    planted_take,
    real_plants,
    turned_take,
    without_ends,
    world_of,
)
from fit.blind.real_scoring import judge_real, score_real
from fit.blind.scoring import score_set
from fit.errors import FitError
from formats.archive import read_take, write_take
from formats.results import save_diagnosis
from tests.fit.blind.blind_answers import diagnosis, finding
from tests.fit.blind.test_blind_cases import guessed, planted
from tests.fit.here import hangtime_here
from tests.shared_data import SHARED_DATA

DATA = SHARED_DATA / "swung-cloth"
SWUNG = ("time_offset", "clock_drift", "attachment_offset", "filter_lag", "corner_erosion", "tracker_smoothing")


@pytest.fixture(scope="module")
def null_truth():
    truth = draw_truth("case", "null", (), (3, 0))
    return msgspec.structs.replace(truth, look=msgspec.structs.replace(truth.look, noise=1e-8, away=0.0, grid=8))


@pytest.fixture(scope="module")
def untouched(null_truth):
    return make_takes(null_truth, side=0.1)[1]


@pytest.fixture
def folder(untouched, tmp_path):
    rng = np.random.default_rng(0)
    for k in range(6):
        noisy = replace(untouched, take_id=f"swing{k}", points=untouched.points + 1e-3 * rng.normal(size=(1, 1, 3)))
        (tmp_path / "takes").mkdir(exist_ok=True)
        write_take(tmp_path / "takes" / f"swing{k}.mcap", noisy)
    return tmp_path / "takes"


def hangtime_blind(*words):
    return hangtime_here("blind", *words, folder=".")


def between(take, other_time):
    """Points of a take [m] below the middle of its held edge, at other instants."""
    below = (take.points - take.held.mean(1, keepdims=True)).reshape(len(take.time), -1)
    return np.stack([np.interp(other_time, take.time, column) for column in below.T], 1)


@pytest.mark.parametrize("name", SWUNG)
def test_a_fault_planted_in_a_take_is_the_one_that_the_generator_plants(name, null_truth, untouched):
    """The generator moves points, this moves the path or the stamps: cloth against hanger comes out the same.

    Within a tenth of what the fault does; the takes are noise-free, splines between frames are what is left.
    """
    plant = next(p for p in PLANTS if p.id == name)
    rng = np.random.default_rng(1)
    one = plant.draw(rng, Cloth(width=0.3, height=0.3))
    generated = make_takes(msgspec.structs.replace(null_truth, planted=(one,)), side=0.1)[1]
    ours = planted_take(untouched, one)
    if name == "time_offset":  # a frame that shows the cloth at t is stamped t + tau; a take starts where it likes
        ours = replace(ours, time=ours.time + one.components[""])
    instants = np.linspace(0.3, untouched.time[-1] - 0.3, 60)
    wanted, found = between(generated, instants), between(ours, instants)
    plain = between(untouched, instants)
    did = np.sqrt(((wanted - plain) ** 2).mean())
    assert did > 1e-4
    assert np.sqrt(((found - wanted) ** 2).mean()) < 0.1 * did


def test_points_stay_as_recorded_where_the_fault_is_the_hangers_or_the_clocks(untouched):
    for name, one in (
        ("time_offset", planted("time_offset", 0.03)),
        ("attachment_offset", planted("attachment_offset", 0.01, along=0.0, down=0.01, out=0.0)),
        ("gravity_tilt", planted("gravity_tilt", 0.03, x=0.0, y=0.03)),
    ):
        assert np.array_equal(planted_take(untouched, one).points, untouched.points, equal_nan=True), name


def test_a_clock_that_runs_1_percent_ahead_stamps_the_second_second_at_2_02(untouched):
    drifted = planted_take(untouched, planted("clock_drift", 0.01))
    at = int(np.argmin(np.abs(untouched.time - 2.0)))
    assert drifted.time[at] == pytest.approx(untouched.time[at] / 0.99)


def test_turned_gravity_tilts_the_cloth_by_the_planted_angles_in_the_world_of_the_rig(untouched):
    true = np.asarray(untouched.rig.gravity)
    tilted = planted_take(untouched, planted("gravity_tilt", 0.03, x=0.02, y=-0.02))
    assert (world_of(tilted.rig) @ true)[:2] == pytest.approx([0.02, -0.02], abs=2e-4)


def test_a_scale_of_2_percent_at_the_mean_distance(untouched):
    far = planted_take(untouched, planted("depth_scale", 0.02, points=0.02, scene=0.0))
    grown = np.nanmean(np.linalg.norm(far.points, axis=2)) / np.nanmean(np.linalg.norm(untouched.points, axis=2))
    assert grown == pytest.approx(1.02, abs=2e-4)
    assert np.array_equal(far.held, untouched.held)
    whole = planted_take(untouched, planted("depth_scale", 0.02, points=0.0, scene=0.02))
    assert np.linalg.norm(whole.held[0, 0]) > 1.015 * np.linalg.norm(untouched.held[0, 0])


def test_gaps_stay_gaps(untouched):
    valid = untouched.points_valid.copy()
    valid[10:14, 5] = False
    holed = replace(untouched, points_valid=valid, points=np.where(valid[..., None], untouched.points, np.nan))
    for name in ("filter_lag", "tracker_smoothing", "corner_erosion"):
        seen = planted_take(holed, planted(name, 0.01)).points
        assert np.array_equal(np.isfinite(seen).all(2), valid), name


def test_a_turned_take_is_the_same_scene(untouched):
    turned = turned_take(untouched, (0.05, -0.02))
    assert np.linalg.norm(turned.points - turned.held[:, :1], axis=2) == pytest.approx(
        np.linalg.norm(untouched.points - untouched.held[:, :1], axis=2)
    )
    before = (untouched.points - untouched.held[:, :1]) @ np.asarray(untouched.rig.gravity)
    assert (turned.points - turned.held[:, :1]) @ np.asarray(turned.rig.gravity) == pytest.approx(before)


def test_the_ends_are_left_out_of_every_take(untouched):
    kept = without_ends(untouched)
    assert kept.time[0] == 0.0
    assert untouched.time[-1] - kept.time[-1] == pytest.approx(2 * TIME_MARGIN, abs=2 / 30)


def test_frames_and_gravity_do_not_reveal_the_label(untouched):
    """Nearest centroid on length, gravity and the first place: 120 cases, chance 50 %, its deviation 4.6 %.

    64 % would be three of them. Clocks that drift change the stamps, which is their fault, and are left out.
    """
    plants = real_plants([name for name in PLANTING if name != "clock_drift"])
    truths = plan_real([f"t{k}" for k in range(8)], {"single": 60, "null": 60, "pair": 0, "unknown": 0}, plants, 9)
    features = []
    for truth in truths:
        take = case_take(untouched, truth)
        features.append([len(take.time), take.time[-1], *take.rig.gravity, np.isfinite(take.points).mean()])
    features = np.array(features)
    features = (features - features.mean(0)) / np.maximum(features.std(0), 1e-9)
    assert guessed(features, np.array([t.kind == "null" for t in truths])) < 0.64


def test_a_planned_case_shares_the_takes_of_its_untouched_one():
    takes = [f"t{k}" for k in range(16)]
    truths = plan_real(takes, {"single": 16, "null": 2, "pair": 0, "unknown": 0}, real_plants([]), 5)
    assert len({t.id for t in truths}) == 18
    by_name = {t.id: t for t in truths}
    for truth in truths:
        assert truth.takes == by_name[truth.reference].takes
        assert len(set(truth.takes)) == len(FILES)
        assert bool(truth.planted) == (truth.kind == "single")
    assert sorted(t.planted[0].id for t in truths if t.planted) == sorted(2 * [*PLANTING])


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"single": 4, "null": 0, "pair": 0, "unknown": 0}, "give --nulls 1 or more"),
        ({"single": 4, "null": 1, "pair": 1, "unknown": 0}, "leave out --pairs"),
    ],
)
def test_numbers_that_cannot_be_compared_are_refused(numbers, said):
    with pytest.raises(FitError, match=said):
        plan_real([f"t{k}" for k in range(8)], numbers, real_plants([]), 5)


def test_effects_and_folders_that_do_not_serve_are_refused(tmp_path):
    with pytest.raises(FitError, match="no effect named 'air_drag' can be planted in real takes; known: attachment"):
        real_plants(["air_drag"])
    with pytest.raises(FitError, match="holds 0 takes, a case needs 5"):
        make_real_set(tmp_path / "set", tmp_path, {"single": 1, "null": 1, "pair": 0, "unknown": 0}, (), 1)
    refused = hangtime_blind("make", tmp_path / "set", "--real", tmp_path, "--nulls", 1, "--generator", "mujoco")
    assert refused.returncode == 2
    assert "real takes are not simulated; leave out --generator" in refused.stderr
    too_few = hangtime_blind("make", tmp_path / "set", "--real", tmp_path, "--nulls", 1)
    assert (too_few.returncode, too_few.stdout) == (2, "")
    assert not (tmp_path / "set").exists()


def answered(folder, answers, share=1.0):
    """Answers that find a gap of their own in all takes, and `share` of what is planted on top of it."""
    for truth in open_labels(folder).real:
        findings = []
        for name in PLANTING:
            own = 0.02 if name == "attachment_offset" else 0.001
            parts = {"attachment_offset": {"along": 0.0, "down": -own, "out": 0.0},
                     "corner_erosion": {"corners": 0.0, "border": own}}.get(name, {})  # fmt: skip
            size = own
            for one in truth.planted:
                if one.id == name == "corner_erosion":
                    parts["corners"] += share * one.amplitude
                elif one.id == name and set(one.components) == {""}:
                    size += share * one.components[""]
                elif one.id == name:
                    parts = {k: parts.get(k, 0.0) + share * v for k, v in one.components.items()}
            one = finding(name, size, 0.004)
            findings.append(msgspec.structs.replace(one, components=parts))
        save_diagnosis(answers / truth.id / "diagnosis.json", diagnosis("effect", ["attachment_offset"], findings))


def test_a_set_of_real_takes_is_sealed_and_scored_by_what_the_plant_changes(folder, tmp_path):
    numbers = {"single": 8, "null": 1, "pair": 0, "unknown": 0}
    manifest = make_real_set(tmp_path / "set", folder, numbers, real_plants([]), 3)
    assert manifest.complete
    assert len(manifest.files) == 9 * len(FILES)
    assert open_labels(tmp_path / "set").generator == "real"
    first = read_take(tmp_path / "set" / "cases" / manifest.cases[0] / FILES[0])
    assert (first.source, first.notes, first.scans) == ("", {}, ())
    again = make_real_set(tmp_path / "set", folder, numbers, real_plants([]), 3)
    assert again.files == manifest.files
    answered(tmp_path / "set", tmp_path / "answers")
    score = score_set(tmp_path / "set", tmp_path / "answers")
    assert (score.right_size.k, score.right_size.n) == (8, 8)
    assert score.error == pytest.approx(0.0, abs=0.2)
    assert score.newly_named.k == 0
    assert score.format == "hangtime-blind-real-score/1"
    said = hangtime_blind("score", tmp_path / "set", tmp_path / "answers").stdout
    assert "8 planted cases, opening 2 of this seal" in said
    assert "untouched takes" in said
    refused = hangtime_blind("report", tmp_path / "set", tmp_path / "answers")
    assert refused.returncode == 2
    assert "is of real takes, which are scored by pairs of answers" in refused.stderr


def test_the_labels_of_a_set_of_real_takes_state_what_was_asked_for(folder, tmp_path):
    plants = real_plants(["time_offset", "gravity_tilt"])
    counted = []
    numbers = {"single": 1, "null": 1, "pair": 0, "unknown": 0}
    manifest = make_real_set(tmp_path / "set", folder, numbers, plants, 3, progress=lambda *done: counted.append(done))
    labels = open_labels(tmp_path / "set")
    assert (labels.numbers, labels.plants, labels.seed) == (numbers, ("time_offset", "gravity_tilt"), 3)
    assert (labels.generator, labels.side, labels.truths, len(labels.real)) == ("real", 0.0, (), 2)
    assert labels.cases == manifest.cases == tuple(sorted(truth.id for truth in labels.real))
    assert counted == [(0, 2), (1, 2), (2, 2)]
    for other in ({"single": 2, "null": 1, "pair": 0, "unknown": 0}, {"single": 1, "null": 2, "pair": 0, "unknown": 0}):
        with pytest.raises(FitError, match="the folder holds another set of cases"):
            make_real_set(tmp_path / "set", folder, other, plants, 3)


def a_truth(one):
    return RealTruth(id="b", kind="single", planted=(one,), takes=(), reference="a", turn=(0.0, 0.0))


def of(*findings, named=()):
    return diagnosis("effect" if named else "unknown", list(named), findings)


def with_parts(found, **parts):
    return msgspec.structs.replace(found, components=parts)


def test_what_was_there_before_is_taken_off():
    """Down -20 mm untouched and -11 mm with 10 mm planted: 9 mm of 10, wrong by a tenth; 2 mm is what could be seen."""
    one = planted("attachment_offset", 0.01, along=0.0, down=0.01, out=0.0)
    before = of(with_parts(finding("attachment_offset", 0.02, 0.002), down=-0.02), named=["attachment_offset"])
    after = of(with_parts(finding("attachment_offset", 0.011, 0.002), down=-0.011), named=["attachment_offset"])
    judged = judge_real(a_truth(one), before, after)
    assert judged.error == pytest.approx(0.1)
    assert judged.is_right_size
    assert judged.is_moved_most
    assert judged.ratio == pytest.approx(5.0)
    assert judged.newly_named is None  # it was named before


def test_an_effect_that_moves_more_is_the_one_that_moved_most():
    one = planted("time_offset", 0.02)
    before = of(finding("time_offset", 0.0, 0.01), finding("filter_lag", 0.0, 0.01))
    after = of(finding("time_offset", 0.005, 0.01), finding("filter_lag", 0.02, 0.01), named=["filter_lag"])
    judged = judge_real(a_truth(one), before, after)
    assert judged.moved_most == "filter_lag"
    assert not judged.is_moved_most
    assert judged.error == pytest.approx(0.75)
    assert not judged.is_right_size
    assert judged.newly_named is False


def test_a_case_without_a_diagnosis_counts_in_no_rate_of_sizes(tmp_path):
    untouched = RealTruth(id="a", kind="null", planted=(), takes=(), reference="a", turn=(0.0, 0.0))
    score = score_real((a_truth(planted("time_offset", 0.02)), untouched), tmp_path)
    assert score.without_answer == 1
    assert score.right_size.n == 0
    assert score.untouched == {"a": "inconclusive"}


@pytest.mark.shared_data
@pytest.mark.skipif(not DATA.exists(), reason=f"no real recordings at {DATA}")
def test_the_arms_path_between_frames_is_known_well_enough_to_be_read_late():
    """Every other frame left out and interpolated: twice as coarse as what a planted offset in time asks for."""
    from scipy.interpolate import CubicSpline

    from formats.importers.swung_cloth import import_swung_cloth

    missed = []
    for path in sorted(DATA.glob("*.npz")):
        take = import_swung_cloth(path)
        held = take.held[take.held_valid.all(1)]
        time = take.time[take.held_valid.all(1)]
        inside = slice(3, -3)
        missed.append(np.sqrt(((CubicSpline(time[::2], held[::2])(time) - held)[inside] ** 2).mean()))
    assert np.median(missed) < 3e-3


def test_planted_components_are_those_that_the_diagnosis_reports():
    from fit.effects import LIBRARY

    known = {effect.name: effect.components for effect in LIBRARY}
    for plant in real_plants([]):
        if plant.components != ("",):
            assert set(plant.components) == set(known[plant.id])


def test_only_faults_are_planted_in_real_takes(untouched):
    with pytest.raises(FitError, match="air_drag cannot be planted in a real take"):
        planted_take(untouched, Planted(id="air_drag", amplitude=1.0, unit="1", components={"": 1.0}))
