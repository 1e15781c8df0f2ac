"""A camera's faults are corrected before any simulation and reported with their sizes."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from firmware_host.synthetic.silhouette import CameraFaults, make_silhouette_take
from fit.errors import DriveError
from fit.recordings.camera_findings import camera_clause, describe_camera
from fit.recordings.intact import describe_missing
from fit.recordings.point_kind import kind_shown
from fit.recordings.recording import prepare, prepare_together
from formats.importers.swung_cloth import import_swung_cloth
from formats.rig import Hanger
from formats.sights import SETTLING
from formats.take import FrameState
from tests.fit.here import hangtime_here
from tests.fit.recordings.silhouettes import path, silhouette_sheet, swung, uneven
from tests.shared_data import SHARED_DATA


def named_in(recordings):
    found = describe_camera(recordings)
    msgspec.to_builtins(found)  # holds no number of numpy, which no file of results takes
    return {one.name: one for one in found}


def found_of(*takes):
    return named_in(prepare_together(takes)[0])


@pytest.mark.parametrize("late", [0.1, *(pytest.param(late, marks=pytest.mark.slow) for late in (0.05, 0.2, 0.33))])
def test_a_silhouettes_latency_is_taken_out_and_named(late):
    time = uneven()
    take = swung(silhouette_sheet(), time, time - late, noise=0.002)
    recording = prepare(take)
    found = named_in([recording])["latency"]
    assert found.figure == pytest.approx(late, abs=0.008)
    assert f"stamps are {found.figure:.3f} s late" in found.sentence
    assert f"stamps {found.figure:.3f} s late" in camera_clause([found])
    on_row = recording.raw_points[:, :8].mean(1)
    apart = on_row - recording.held(recording.time).reshape(-1, 2, 3).mean(1)
    assert np.nanstd(apart[:, 1]) < 0.004
    assert recording.duration < time[-1] - late + 0.12


def test_material_points_keep_an_offset_that_the_effect_can_reach_and_lose_a_larger_one():
    time = np.arange(0, 8, 1 / 30)
    garment = silhouette_sheet("material")
    left, out = (found_of(swung(garment, time, time - late, noise=0.001))["latency"] for late in (0.05, 0.2))
    assert left.is_left
    assert left.figure == pytest.approx(0.05, abs=0.004)
    assert not out.is_left
    assert out.figure == pytest.approx(0.2, abs=0.004)
    assert "This was left in" in left.sentence
    assert camera_clause([left]) == ""


def test_points_and_hanger_of_the_same_pictures_have_one_clock():
    time = uneven()
    take = swung(silhouette_sheet(), time, time - 0.2, noise=0.002)
    hanger = Hanger(marker_size_m=0.04, marker_distance_m=0.3, held_m=((-0.15, 0.0, 0.0), (0.15, 0.0, 0.0)))
    seen_together = dataclasses.replace(take, rig=replace(take.rig, hanger=hanger))
    assert prepare(seen_together).camera.timing is None


def test_skewed_grids_are_left_out_and_counted():
    time = uneven()
    angle = np.where(np.arange(len(time)) % 5 == 0, 6.0, 0.5)
    take = swung(silhouette_sheet(), time, time, angle=angle, noise=0.001)
    recording = prepare(take)
    found = named_in([recording])["skewed_grids"]
    assert recording.camera.skewed == pytest.approx((angle > 4).sum(), abs=1)
    assert f"{recording.camera.skewed} of {recording.camera.frames} grids" in found.sentence
    assert (~recording.valid.any(1)).sum() == recording.camera.skewed
    assert "skewed_grids" not in found_of(swung(silhouette_sheet("material"), time, time, angle=angle))


def test_sliding_points_get_their_material_positions():
    """The grid is laid over 82 to 98 % of the cloth: in the plane its last row is off by up to 54 mm."""
    time = uneven()
    share = 0.9 + 0.08 * np.sin(2 * np.pi * 0.9 * time)
    slides = swung(silhouette_sheet(), time, time, seen_length=share)
    recording, true = prepare(slides), prepare(swung(silhouette_sheet("material"), time, time))
    same = np.searchsorted(true.time, recording.time + 1e-9) - 1
    where = recording.valid & (np.abs(true.time[same] - recording.time) < 1e-6)[:, None]
    assert where.mean() > 0.6
    off = np.linalg.norm(recording.points - true.points[same], axis=2)
    raw = np.linalg.norm(recording.raw_points - true.points[same], axis=2)
    assert off[where].max() < 0.004
    assert raw[where].max() > 0.03
    assert recording.has_material_points
    assert named_in([recording])["sliding_points"].figure > 0.01


def test_points_that_slide_though_they_are_said_to_stay_are_a_fault_and_the_other_way_round_is_none():
    """A camera that sees all of the cloth lays the same grid over it in every frame."""
    time = uneven()
    share = 0.9 + 0.08 * np.sin(2 * np.pi * 0.9 * time)
    slides = swung(silhouette_sheet("material"), time, time, seen_length=share, noise=0.002)
    stays = swung(silhouette_sheet("silhouette"), time, time, noise=0.002)
    wrong = found_of(slides)["points_are"]
    assert wrong.is_fault
    assert "states material points" in wrong.sentence
    assert 'State points_are = "silhouette"' in wrong.sentence
    steady = found_of(stays)["points_are"]
    assert not steady.is_fault
    assert "neighbours keep their distance" in steady.sentence
    assert 'State points_are = "material"' in steady.sentence
    right = [swung(silhouette_sheet(), time, time, seen_length=share), swung(silhouette_sheet("material"), time, time)]
    assert not any("points_are" in found_of(take) for take in right)


def test_advice_on_a_description_is_to_make_the_take_again_and_is_given_once():
    """A take keeps the description that it was made with: a changed garment file alone changes nothing."""
    time = uneven()
    share = 0.9 + 0.08 * np.sin(2 * np.pi * 0.9 * time)
    take = swung(silhouette_sheet("material"), time, time, seen_length=share)
    recording = prepare(take)
    imported = dataclasses.replace(recording, is_imported=True)
    (wrong,) = [f for f in describe_camera([imported]) if f.name == "points_are"]
    assert "in the garment file and import the takes again with --garment" in wrong.sentence
    (wrong,) = [f for f in describe_camera([dataclasses.replace(recording, is_imported=False)]) if f.is_fault]
    assert "in the garment file and record the takes again: a take keeps" in wrong.sentence
    assert wrong.sentence in camera_clause([wrong])
    assert wrong.sentence not in camera_clause([wrong], f"No diagnosis: {wrong.sentence}")


@pytest.mark.slow
def test_the_command_makes_a_silhouette_that_slides_as_recordings_do(tmp_path):
    """From 2.2 % on; and one whose outline is never lost is no fault, for it is a silhouette as well."""
    made = hangtime_here("sensor", "synthesise-silhouette", ".", folder=tmp_path)
    assert made.returncode == 0, made.stderr
    recording = prepare(import_swung_cloth(tmp_path / "silhouette.npz"))
    kind, change = kind_shown(recording)
    assert kind == "silhouette"
    assert change > 0.022
    assert not any(found.name == "points_are" for found in describe_camera([recording]))


def test_noise_is_not_mistaken_for_sliding():
    """7 mm of white noise change the median length of pairs of 43 mm by 4 % each, and together by 2.9 %."""
    time = np.arange(0, 8, 1 / 20)
    found = [
        kind_shown(prepare(swung(silhouette_sheet("material"), time, time, noise=0.007, seed=s))) for s in range(5)
    ]
    assert not any(one is not None and one[0] == "silhouette" for one in found)


@pytest.mark.parametrize("lost", [0.7, pytest.param(3.0, marks=pytest.mark.slow)])
def test_a_take_with_a_gap_is_used_on_both_sides_of_it(lost):
    """Nothing is judged in the gap and until the cloth has forgotten it; the path is interpolated without a jump."""
    time = np.arange(0, 14, 1 / 20)
    gap = (time > 5.0) & (time < 5.0 + lost)
    whole = swung(silhouette_sheet("material"), time, time)
    for take in (
        dataclasses.replace(whole, held_valid=whole.held_valid & ~gap[:, None]),
        dataclasses.replace(
            whole,
            **{name: getattr(whole, name)[~gap] for name in (
                "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers")},
        ),
    ):  # fmt: skip
        recording = prepare(take)
        judged = recording.valid.any(1)
        assert recording.duration == pytest.approx(13.95, abs=0.06)
        assert judged[recording.time < 4.9].all()
        assert judged[recording.time > 5.1 + lost + SETTLING].all()
        assert not judged[(recording.time > 5.05) & (recording.time < 4.9 + lost + SETTLING)].any()
        across = recording.held(np.linspace(5.0, 5.0 + lost, 400))[:, 1]
        ends = path(time)[[np.flatnonzero(gap)[0] - 1, np.flatnonzero(gap)[-1] + 1], 1]
        assert min(ends) - 0.01 < across.min() <= across.max() < max(ends) + 0.01
        sentence = found_of(take)["hanger_gap"].sentence
        assert "Both sides are used" in sentence


def test_seconds_count_from_the_first_frame_whatever_is_seen_in_it():
    """The hanger is seen from 0.5 s on, the points from 0.8 s on; the camera's finding and the warning agree."""
    time = np.arange(0, 14, 1 / 20) + 100.0
    whole = swung(silhouette_sheet("material"), time - 100.0, time - 100.0)
    gap = (time > 105.0) & (time < 106.0)
    unseen = gap | (time < 100.49)
    take = dataclasses.replace(
        whole,
        time=time,
        held_valid=whole.held_valid & ~unseen[:, None],
        is_complete=False,
        missing=((105.0, 105.9),),
        state=np.where(time < 100.79, whole.state | FrameState.HANGER_ALONE, whole.state),
    )
    assert prepare(take).begin == pytest.approx(0.8, abs=0.01)
    assert ", first at 5.00 s. Both sides" in found_of(take)["hanger_gap"].sentence
    assert "missing: 5.00 to 5.90 s" in describe_missing([take])[0]
    jumping = dataclasses.replace(take, held=take.held + 5.0 * (time > 108.01)[:, None, None])
    with pytest.raises(DriveError, match=r"the hanger jumps at 8\.0[05] s"):
        prepare(jumping)


REAL = sorted((SHARED_DATA / "swung-cloth").glob("*.npz"))


@pytest.mark.skipif(not REAL, reason="the real recordings are not here")
@pytest.mark.parametrize("planted", [0.2, *(pytest.param(late, marks=pytest.mark.slow) for late in (0.05, 0.1, 0.33))])
def test_a_latency_planted_in_a_real_take_is_found(planted):
    """Its own latency was taken out by others, to 20 ms; what is planted comes on top, to the frame."""
    take = import_swung_cloth(REAL[-4])
    own = prepare(take).camera.timing
    late = dataclasses.replace(take, held=_later(take.time, take.held, planted))
    found = prepare(late).camera.timing
    assert found.latency - own.latency == pytest.approx(planted, abs=0.012)
    assert found.is_late
    assert abs(own.latency) < 0.02
    assert own.share == pytest.approx(0.9, abs=0.4)


def _later(time, held, late):
    """The ends' path as a hanger clock that is ahead shows it: at each stamp where they are `late` s later."""
    flat = held.reshape(len(time), -1)
    return np.stack([np.interp(time + late, time, axis) for axis in flat.T], 1).reshape(held.shape)


@pytest.mark.slow
def test_a_synthetic_cameras_faults_are_found_with_their_sizes(tmp_path):
    """The cloth is another program's; seen are 12 s at 9 frames a second with 2 mm of noise."""
    faults = CameraFaults(noise=0.002, latency=0.2, publish_share=0.9, skewed_share=0.2, eaten_by_pose=0.06)
    made = make_silhouette_take(tmp_path, "a", faults)
    take = import_swung_cloth(made[0])
    found = found_of(take)
    with np.load(made[1]) as truth:
        askew = truth["is_skewed"].mean()
    assert found["latency"].figure == pytest.approx(0.2, abs=0.01)
    assert found["publish_time"].figure == pytest.approx(0.9, abs=0.12)
    assert found["skewed_grids"].figure == pytest.approx(askew, abs=0.03)
    assert found["sliding_points"].figure > 0.005
    assert found["eaten_by_pose"].figure == pytest.approx(0.06, abs=0.012)
    more = {"frame_shifts", "held_edge"}
    assert set(found) - more == {"latency", "publish_time", "skewed_grids", "sliding_points", "eaten_by_pose"}
    low, high = found["latency"].interval
    assert low - 0.003 < 0.2 < high + 0.003
