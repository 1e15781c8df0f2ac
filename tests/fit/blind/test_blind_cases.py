"""Content of blind cases: planted effects checked by hand, nulls without effects, looks without information."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from fit.blind import boundary, hands, sensing
from fit.blind.cases import FILES, draw_truth, make_takes, plan, write_case
from fit.blind.engine import SAMPLES_A_SECOND, Cloth
from fit.blind.foreign.engines import OWN_GENERATOR
from fit.blind.plants import PLANTS, UNKNOWNS, Planted, with_plants
from fit.errors import FitError
from fit.recordings.recording import prepare
from formats.archive import read_take, verify_take

COARSE = 0.1  # m of a triangle: quick
LIBRARY = {
    "bending_hysteresis", "rest_curvature", "hem", "anisotropy", "strain_stiffening", "bending_viscosity",
    "stretch_viscosity", "mass_distribution", "hanger_compliance", "hanger_rotation", "attachment_offset", "clip_slip",
    "clip_slack", "air_drag", "added_mass", "draught", "air_lift", "time_offset", "gravity_tilt", "depth_scale",
    "filter_lag", "corner_erosion", "clock_drift", "tracker_smoothing",
}  # fmt: skip


def planted(name, amplitude, **components):
    return Planted(id=name, amplitude=amplitude, unit="", components=components or {"": amplitude})


def still_bar(samples=401, width=0.4):
    ends = np.zeros((samples, 6))
    ends[:, 0], ends[:, 3] = -width / 2, width / 2
    return ends


def a_truth(*plants, kind="single", seed=3):
    return draw_truth("case", kind, plants, (seed, 0))


def without_noise(truth, *plants):
    look = replace(truth.look, noise=1e-9, away=0.0, grid=0)
    return replace(truth, look=look, planted=tuple(plants))


def test_the_plants_are_the_librarys_effects_without_shear_and_self_contact():
    assert {p.id for p in PLANTS} == LIBRARY
    assert not LIBRARY & {p.id for p in UNKNOWNS}


def test_a_time_offset_of_30_ms_shows_every_point_as_it_was_30_ms_before():
    """Points of a ramp of 1 m/s are 30 mm behind."""
    time = np.arange(401) / SAMPLES_A_SECOND
    points = np.zeros((401, 1, 3))
    points[:, 0, 0] = time
    frames = np.array([0.5, 1.0, 1.5])
    flat = np.zeros((1, 2))
    late = sensing.reported_points(points, frames, flat, (planted("time_offset", 0.03),))
    assert late[:, 0, 0] == pytest.approx(frames - 0.030, abs=1e-9)
    early = sensing.reported_points(points, frames, flat, (planted("time_offset", 0.03, **{"": -0.03}),))
    assert early[:, 0, 0] == pytest.approx(frames + 0.030, abs=1e-9)


@pytest.mark.slow
def test_a_planted_time_offset_of_50_ms_shows_the_cloth_of_three_frames_before_and_leaves_the_hanger():
    """At 60 frames a second, to a micrometre: 1000 times the noise that is left. One frame beside it is 9 mm off."""
    truth = a_truth(kind="null")
    truth = replace(truth, look=replace(truth.look, rate=60.0))
    plain = make_takes(without_noise(truth), side=COARSE)[0]
    late = make_takes(without_noise(truth, planted("time_offset", 0.05)), side=COARSE)[0]
    assert np.isfinite(late.points).all()
    assert late.points[10:] == pytest.approx(plain.points[7:-3], abs=1e-6)
    assert np.abs(late.points[10:] - plain.points[8:-2]).max() > 5e-3
    assert np.array_equal(late.held, plain.held)


def test_a_lag_of_two_low_passes_delays_a_ramp_by_its_whole_delay():
    """Long after the start a ramp of 1 m/s is 40 mm behind."""
    points = np.zeros((801, 1, 3))
    points[:, 0, 2] = np.arange(801) / SAMPLES_A_SECOND
    behind = points - sensing.lagged(points, 0.04)
    assert behind[-1, 0, 2] == pytest.approx(0.04, abs=1e-6)
    assert behind[0, 0, 2] == 0.0


def test_clock_drift_grows_with_time():
    """1 % after 2 s is 20 ms: a ramp of 1 m/s is 20 mm behind."""
    points = np.zeros((401, 1, 3))
    points[:, 0, 0] = np.arange(401) / SAMPLES_A_SECOND
    seen = sensing.reported_points(points, np.array([1.0, 2.0]), np.zeros((1, 2)), (planted("clock_drift", 0.01),))
    assert seen[:, 0, 0] == pytest.approx([0.99, 1.98], abs=1e-9)


def test_smoothing_keeps_a_tilted_plane_and_flattens_a_wrinkle():
    flat = np.array([(x, y) for y in range(5) for x in range(5)], float)
    mixing = sensing.smoothing_matrix(flat)
    assert mixing @ (2 * flat[:, 0] - 3 * flat[:, 1] + 1) == pytest.approx(2 * flat[:, 0] - 3 * flat[:, 1] + 1)
    wrinkle = (-1.0) ** (flat[:, 0] + flat[:, 1])
    assert np.abs(mixing @ wrinkle).max() < 0.7


def test_erosion_pulls_the_free_corners_inwards_and_leaves_the_rest():
    flat = np.array([(-0.2, 0), (0.2, 0), (0.2, -0.4), (-0.2, -0.4), (0, -0.2)])
    points = np.column_stack([flat[:, 0], 0 * flat[:, 0], flat[:, 1]])[None]
    moved = sensing.reported_points(
        np.repeat(points, 3, 0), np.array([0.0]), flat, (planted("corner_erosion", 0.01),)
    ) - points  # fmt: skip
    assert np.linalg.norm(moved[0], axis=1) == pytest.approx([0, 0, 0.01, 0.01, 0], abs=1e-6)
    assert moved[0, 2, 0] < 0 < moved[0, 2, 2]


def test_a_scale_of_2_percent_about_the_sensor():
    """At the reference distance of 1.5 m exactly 2 %: 30 mm."""
    assert sensing.scaled(np.array([[0.3, 0.0, 1.5]]), 0.02, 1.5)[0] == pytest.approx([0.306, 0.0, 1.53])
    # The error grows with the distance: at twice the distance 3 %.
    assert sensing.scaled(np.array([[0.3, 0.0, 3.0]]), 0.02, 1.5)[0] == pytest.approx([0.309, 0.0, 3.09])


def test_slow_noise_has_deviation_one_and_forgets_within_its_time():
    drawn = sensing.slow_noise(np.random.default_rng(0), (60000, 2), 60.0)
    assert drawn.std() == pytest.approx(1.0, abs=0.03)
    assert (drawn[18:] * drawn[:-18]).mean() == pytest.approx(np.exp(-1), abs=0.05)


def test_dropouts_come_to_their_share():
    seen = sensing.gaps(np.random.default_rng(0), (20000, 4), 0.06)
    assert 1 - seen.mean() == pytest.approx(0.06, abs=0.01)


def test_the_sensor_frame_is_right_handed_and_gravity_points_down_in_it():
    level = sensing.sensor_frame((0.0, 0.0))
    assert level @ [0, 0, -1.0] == pytest.approx([0, 1, 0])
    tilted = sensing.sensor_frame((0.1, 0.05))
    assert np.linalg.det(tilted) == pytest.approx(1.0)
    assert tilted @ tilted.T == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize(
    ("one", "left", "right"),
    [
        (planted("attachment_offset", 0.01, along=0.01, down=0.0, out=0.0), (0.01, 0, 0), (0.01, 0, 0)),
        (planted("attachment_offset", 0.01, along=0.0, down=0.01, out=0.0), (0, 0, -0.01), (0, 0, -0.01)),
        (planted("clip_slack", 0.008), (0.004, 0, 0), (-0.004, 0, 0)),
    ],
)
def test_faults_of_the_boundary_move_the_ends(one, left, right):
    ends = still_bar()
    moved = boundary.real_ends(ends, (one,), 0) - ends
    assert moved[5] == pytest.approx([*left, *right], abs=1e-12)


def test_a_compliant_rod_lags_by_c_times_a_in_slow_motion():
    """A steady 1 m/s^2 along y deflects a compliance of 7e-4 s^2 by 0.7 mm backwards; vertical motion does not."""
    ends = still_bar(801)
    time = np.arange(801) / SAMPLES_A_SECOND
    # the jerk is switched on over 2 s so that the rod does not ring
    rise = np.clip(time / 2, 0, 1)
    speed = np.cumsum(rise**3 * (10 - 15 * rise + 6 * rise**2)) / SAMPLES_A_SECOND
    ends[:, [1, 4]] += (np.cumsum(speed) / SAMPLES_A_SECOND)[:, None]
    bent = boundary.real_ends(ends, (planted("hanger_compliance", 7e-4),), 0) - ends
    assert bent[700, 1] == pytest.approx(-7e-4, rel=0.03)
    lifted = still_bar(801)
    lifted[:, [2, 5]] += (np.cumsum(speed) / SAMPLES_A_SECOND)[:, None]
    assert np.abs(boundary.real_ends(lifted, (planted("hanger_compliance", 7e-4),), 0) - lifted).max() < 1e-12


def test_a_clip_slips_once_at_the_hardest_jerk_and_stays():
    ends = still_bar(801)
    ends[:, [1, 4]] += (0.1 * hands.step(np.arange(801) / SAMPLES_A_SECOND, 2.0, 0.3))[:, None]
    moved = boundary.real_ends(ends, (planted("clip_slip", 0.005, left=0.005, right=0.0),), 0) - ends
    assert moved[399, 2] == 0.0
    begin = int(np.flatnonzero(moved[:, 2])[0]) - 1
    later = begin + round(0.04 * SAMPLES_A_SECOND)
    assert moved[later, 2] == pytest.approx(-0.005 * (1 - np.exp(-1)))  # after 40 ms
    assert moved[-1, 2] == pytest.approx(-0.005, rel=1e-3)
    assert not moved[:, 5].any()


def test_a_hidden_rotation_has_its_rms_and_leaves_the_middle():
    one = planted("hanger_rotation", 0.05, yaw=0.05, roll=0.0)
    ends = still_bar(2001)
    moved = boundary.real_ends(ends, (one,), 1)
    arm = moved[:, 3:] - moved[:, :3]
    assert np.sqrt(np.mean(np.arctan2(arm[:, 1], arm[:, 0]) ** 2)) == pytest.approx(0.05, rel=1e-6)
    assert (moved[:, :3] + moved[:, 3:]) == pytest.approx(ends[:, :3] + ends[:, 3:], abs=1e-12)


def test_a_bar_that_lies_to_the_sensor_rolls_in_the_upright_plane_too():
    arm = np.tile([0.0, 0.2, 0.0], (3, 1))
    moved = boundary.turned(0 * arm, arm, np.zeros(3), np.full(3, 0.05))
    assert moved[0] == pytest.approx(0.2 * np.array([0, -np.cos(0.05), -np.sin(0.05), 0, np.cos(0.05), np.sin(0.05)]))


def test_a_null_has_stiffness_and_linear_damping_and_nothing_else():
    truth = a_truth(kind="null")
    cloth = with_plants(Cloth(width=0.4, height=0.4), truth.planted)
    plain = {
        "width",
        "height",
        "density",
        "stretch",
        "shear",
        "bending",
        "damping",
        "wake_time",
        "bob_length",
        "corner",
    }
    for field in dataclasses.fields(cloth):
        value = getattr(cloth, field.name)
        assert field.name in plain or not np.any(value), field.name
    assert 100 <= truth.stretch <= 600
    assert 10 <= truth.shear <= 80
    assert 3e-6 <= truth.bending <= 1e-4
    assert 0.3 <= truth.damping <= 1.5


def test_a_hem_moves_mass_and_does_not_add_any():
    cloth = Cloth(width=0.4, height=0.4, density=0.2)
    hemmed = with_plants(cloth, (planted("hem", 0.01),))
    assert hemmed.density == pytest.approx(0.175)
    assert hemmed.mass == pytest.approx(cloth.mass)


def test_amplitudes_lie_between_half_and_three_times_the_typical_size():
    rng, cloth = np.random.default_rng(1), Cloth(width=0.4, height=0.4)
    for plant in PLANTS + UNKNOWNS:
        for _ in range(20):
            one = plant.draw(rng, cloth)
            assert 0.5 * plant.typical <= one.amplitude <= min(3 * plant.typical, plant.most)
            assert np.linalg.norm(list(one.components.values())) == pytest.approx(one.amplitude)


def test_effects_are_planted_equally_often_in_random_order():
    truths = plan({"single": 48, "null": 5, "pair": 4, "unknown": 8}, PLANTS, 1)
    single = [t.planted[0].id for t in truths if t.kind == "single"]
    assert all(single.count(name) == 2 for name in LIBRARY)
    assert all(len({p.id for p in t.planted}) == 2 for t in truths if t.kind == "pair")
    assert len({t.id for t in truths}) == 65
    assert [t.kind for t in truths] != sorted(t.kind for t in truths)


@pytest.mark.parametrize("kind", hands.TRAINING + hands.HELD_OUT)
def test_motions_start_and_end_at_rest_and_stay_gentle(kind):
    for seed in range(5):
        ends = hands.move(np.random.default_rng(seed), kind, 3.5, 0.4, 0.4, 0.5)
        speed = np.abs(np.diff(ends, axis=0)) * SAMPLES_A_SECOND
        assert speed[:40].max() < 0.01
        assert speed[-20:].max() < 0.01
        assert np.ptp(ends, axis=0).max() > 0.03
        assert np.abs(boundary.acceleration(ends)).max() < 8.0
        assert np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1) == pytest.approx(0.4)


@pytest.mark.slow  # `test_blind_sets.py` reads the cases of a set
def test_a_case_is_five_sound_takes_that_the_tool_can_read(tmp_path):
    truth = a_truth(OWN_GENERATOR.plants(["draught"])[0])
    paths = write_case(tmp_path / "case", truth, side=COARSE)
    assert [p.name for p in paths] == list(FILES)
    for path in paths:
        assert verify_take(path).is_sound
        recording = prepare(read_take(path))
        tips = recording.points[:, np.array([p.at_m[1] for p in recording.garment.points]).argmin()]
        below = recording.held(recording.time).reshape(-1, 2, 3).mean(1)[:, 2] - tips[:, 2]
        assert np.nanmin(below) > 0.3 * truth.look.height
    assert not list(tmp_path.glob(".*"))
    again = make_takes(truth, side=COARSE)[0]
    assert np.allclose(again.points, read_take(paths[0]).points, atol=1e-4, equal_nan=True)


def test_effects_that_cannot_be_planted_are_refused():
    with pytest.raises(FitError, match="no effect named 'self_contact' can be planted"):
        OWN_GENERATOR.plants(["self_contact"])


def test_appearances_do_not_reveal_the_label():
    """Nearest centroid on every look and the case's place, in ten folds: two classes of 300, chance is 50 %.

    The share of right guesses of 600 has a deviation of 2 %; 57 % would be 3.4 of them.
    """
    truths = plan({"single": 300, "null": 300, "pair": 0, "unknown": 0}, PLANTS, 7)
    features = np.array([[*t.look.features(), k, int(t.id, 16)] for k, t in enumerate(truths)])
    features = (features - features.mean(0)) / features.std(0)
    kinds = np.array([t.kind == "null" for t in truths])
    assert guessed(features, kinds) < 0.57
    # The test itself sees a leak: a look that tells one deviation of the label is found.
    leaking = features.copy()
    leaking[:, 6] += 1.0 * kinds
    assert guessed(leaking, kinds) > 0.6


def test_appearances_do_not_reveal_the_effect():
    """24 effects, 20 cases each: chance is 4.2 %, its deviation for 480 guesses 0.9 %."""
    truths = plan({"single": 480, "null": 0, "pair": 0, "unknown": 0}, PLANTS, 8)
    features = np.array([[*t.look.features(), k] for k, t in enumerate(truths)])
    features = (features - features.mean(0)) / features.std(0)
    assert guessed(features, np.array([t.planted[0].id for t in truths])) < 0.075


def guessed(features, labels, folds=10):
    """Share of labels that the nearest class centroid of the other folds gives."""
    fold = np.arange(len(labels)) % folds
    right = 0
    for k in range(folds):
        classes = np.unique(labels[fold != k])
        centres = np.array([features[(fold != k) & (labels == c)].mean(0) for c in classes])
        apart = np.linalg.norm(features[fold == k][:, None] - centres, axis=2)
        right += int((classes[apart.argmin(1)] == labels[fold == k]).sum())
    return right / len(labels)


def test_the_swing_is_what_the_first_mode_predicts():
    """A slow push of 1 m/s^2 leans the sheet by 1.602 / 1.2024^2 x 0.4 / g: 6.45 degrees for the first mode alone."""
    time = np.arange(1601) / SAMPLES_A_SECOND
    rise = np.clip(time / 4, 0, 1)
    speed = np.cumsum(rise**3 * (10 - 15 * rise + 6 * rise**2)) / SAMPLES_A_SECOND
    angle = hands.swing_angle(np.cumsum(speed) / SAMPLES_A_SECOND, 0.4, 2.0)
    assert np.degrees(angle) == pytest.approx(np.degrees(np.arctan(1.602 / 1.2024**2 / 9.80665)), rel=0.03)


def test_swings_stay_below_fifty_degrees():
    for seed in (3, 4):
        truth = without_noise(a_truth(kind="null", seed=seed))
        for take in make_takes(truth, side=COARSE):
            hanging = take.points[:, 2:4].mean(1) - take.held.mean(1)
            level = np.linalg.norm(np.cross(hanging, take.rig.gravity), axis=1)
            assert np.degrees(np.arctan2(level, hanging @ take.rig.gravity)).max() < 50.0


@pytest.mark.slow
def test_takes_of_ordinary_cloth_are_predictable():
    """A change of a thousandth in bending moves no point by half a millimetre."""
    truth = without_noise(a_truth(kind="null"))
    first = make_takes(replace(truth, bending=3e-5, damping=0.8), side=0.05)
    second = make_takes(replace(truth, bending=3.003e-5, damping=0.8), side=0.05)
    for one, other in zip(first, second, strict=True):
        assert np.abs(one.points - other.points).max() < 0.5e-3


def test_two_low_passes_delay_a_ramp_from_rest_as_their_law_says():
    """Two of T = 40 ms: y = t - 2 T + (t + 2 T) e^(-t/T); samples add less than a hundredth of T."""
    time = np.arange(200) / SAMPLES_A_SECOND
    found = sensing.lagged(np.tile(time[:, None, None], (1, 1, 3)), 0.08)
    assert found[:, 0, 0] == pytest.approx(time - 0.08 + (time + 0.08) * np.exp(-time / 0.04), abs=4e-4)


def test_a_pendulum_at_a_corner_weighs_a_share_of_the_cloth():
    cloth = Cloth(width=0.4, height=0.5)
    hung = with_plants(cloth, (planted("corner_pendulum", 0.1, **{"": -0.1}),))
    assert (hung.bob, hung.corner) == (pytest.approx(0.1 * cloth.mass), -1)
