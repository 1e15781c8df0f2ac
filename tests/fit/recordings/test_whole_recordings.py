"""Complete recordings of takes: kinds of rigs, lost hangers, bodies, and kinds of points."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.recordings import point_kind
from fit.recordings.point_kind import describe_contradiction, describe_steady
from fit.recordings.recording import MARKER_OFFSET, SILHOUETTE_OFFSET, prepare
from formats.rig import Calibration, Hanger, Rig, Sensor
from formats.take import LONGEST_GAP
from tests.fit.scenes import hung, sheet, swing, take_of

TIME = np.arange(90) / 30
SENSOR = Sensor(width=640, height=480, fx=575.0, fy=575.0, cx=320.0, cy=240.0)
HANGER = Hanger(marker_size_m=0.05, marker_distance_m=0.3, held_m=((-0.2, 0.1, 0.0), (0.2, 0.1, 0.0)))
HELD_SD = ((0.003, 0.004, 0.0), (0.0, 0.004, 0.003))


def a_take(points_are=None, *, frames=90, **rig):
    """A sheet that swings 1 m away from a sensor that looks along the world's y, with x as its x and y down."""
    time = TIME[:frames]
    garment, path = sheet(grid=5), swing(time, amplitude=0.05, hz=0.7)
    if points_are:
        garment = msgspec.structs.replace(garment, format="hangtime-garment/2", points_are=points_are)
    take = take_of(garment, time, path, hung(garment, time) + path[:, None])
    seen = {
        name: getattr(take, name)[..., [0, 2, 1]] * [1.0, -1.0, 1.0] + [0.0, 0.0, 1.0] for name in ("points", "held")
    }
    described = Rig(format="hangtime-rig/2", name="test", gravity=(0.0, 1.0, 0.0), **rig)
    return dataclasses.replace(take, rig=described, markers=seen["held"], **seen)


@pytest.mark.parametrize(
    ("rig", "kind", "held_error", "offset_sd", "is_calibrated", "is_imported", "viewpoint"),
    [
        ({}, "material", 0.0, MARKER_OFFSET, True, True, (0.0, 0.0, 0.0)),
        ({"camera_at_m": (0.1, 0.2, -0.3)}, "silhouette", 0.0, SILHOUETTE_OFFSET, True, True, (0.1, -0.3, -0.2)),
        ({"sensor": SENSOR, "hanger": HANGER}, "material", 0.0, SILHOUETTE_OFFSET, False, False, (0.0, 0.0, 0.0)),
        ({"sensor": SENSOR, "hanger": HANGER, "calibration": Calibration()}, "material", 0.0, SILHOUETTE_OFFSET, True,
         False, (0.0, 0.0, 0.0)),
        ({"sensor": SENSOR, "hanger": HANGER, "calibration": Calibration(held_sd_m=HELD_SD)}, "silhouette",
         np.sqrt(50e-6 / 6), SILHOUETTE_OFFSET, True, False, (0.0, 0.0, 0.0)),
        ({"calibration": Calibration()}, "material", 0.0, MARKER_OFFSET, True, False, (0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_a_recording_knows_what_its_rig_states(rig, kind, held_error, offset_sd, is_calibrated, is_imported, viewpoint):
    take = a_take(kind, frames=24, **rig)
    found = prepare(take)
    assert (found.take_id, found.garment) == ("scene", take.garment)
    assert (found.is_calibrated, found.is_imported) == (is_calibrated, is_imported)
    assert found.held_error == pytest.approx(held_error)
    assert found.offset_sd == offset_sd
    assert found.viewpoint == pytest.approx(viewpoint)
    assert found.held_sd == pytest.approx(1e-4)
    assert found.point_sd == pytest.approx(np.full(25, 1e-3))
    assert (found.gaps, found.bodies, found.impossible, found.windows) == ((), (), 0.0, None)
    assert found.judged.tolist() == [False] * 5 + [True] * 20
    assert found.valid.all()
    assert found.held_time == pytest.approx(TIME[:24])
    world = take.held[..., [0, 2]]  # y of the world is the way away from the sensor
    assert found.held_seen.reshape(-1, 2, 3)[..., :2] == pytest.approx(world, abs=5e-3)
    assert (found.raw_points is not None) == (kind == "silhouette" and found.camera.is_placed)


def test_a_hanger_that_is_lost_for_long_leaves_a_gap_and_points_unjudged_within():
    """Frames 30 to 59 of 30 a second are lost: from 29 / 30 to 2 s, counted from the first sight, frame 3."""
    take = a_take()
    valid = take.held_valid.copy()
    valid[:3] = valid[30:60] = False
    found = prepare(dataclasses.replace(take, held_valid=valid, time=TIME + 5.0))
    (gap,) = found.gaps
    assert gap == pytest.approx((26 / 30, 57 / 30))
    assert gap[1] - gap[0] > LONGEST_GAP
    assert found.held_time == pytest.approx(TIME[:87])
    assert np.isfinite(found.held_seen[:, 0]).tolist() == valid[3:, 0].tolist()
    inside = (found.time > gap[0]) & (found.time < gap[1])
    assert not found.valid[inside].any()
    assert found.valid[found.time < gap[0] - 0.05].all()
    assert (found.time[0], found.duration) == (0.0, pytest.approx(86 / 30))


def test_a_rigs_point_that_cannot_be_is_counted_and_left_out():
    """Of 90 x 25 sightings 9 lie a metre beside the cloth: 0.4 %."""
    take = a_take()
    points = take.points.copy()
    points[::10, 12] += 1.0
    found = prepare(dataclasses.replace(take, points=points))
    assert found.impossible == pytest.approx(9 / (90 * 25))
    assert np.flatnonzero(~found.valid[:, 12]).tolist() == list(range(0, 90, 10))
    assert found.valid.sum() == 90 * 25 - 9


@pytest.mark.parametrize(
    ("stated", "shown", "fault", "hint"),
    [
        ("material", [("silhouette", 0.05)], "in the take a", ""),
        ("material", [("silhouette", 0.05), ("silhouette", 0.08), ("material", 0.001)], "in 2 of 3 takes", ""),
        ("material", [("silhouette", 0.05), ("material", 0.001)], "", ""),
        ("material", [("silhouette", 0.05), None], "in 1 of 2 takes", ""),
        ("material", [None, None], "", ""),
        ("silhouette", [("material", 0.002), ("material", 0.001)], "", "in 2 of 2 takes"),
        ("silhouette", [("silhouette", 0.05)], "", ""),
    ],
)  # fmt: skip
def test_most_takes_decide_what_their_points_are_and_the_clearest_gives_the_figure(
    monkeypatch, stated, shown, fault, hint
):
    """The largest change of what slides, the smallest of what stays."""
    recordings = [SimpleNamespace(take_id="abc"[k], is_imported=False, found=one) for k, one in enumerate(shown)]
    monkeypatch.setattr(point_kind, "kind_shown", lambda recording: recording.found)
    garment = SimpleNamespace(point_kind=stated, points_are=stated)
    told = describe_contradiction(garment, recordings), describe_steady(garment, recordings)
    changes = [one[1] for one in shown if one and one[0] != stated]
    for sentence, of, least in zip(told, (fault, hint), (max, min), strict=True):
        assert (sentence != "") == (of != "")
        if of:
            assert of in sentence
            assert f"{100 * least(changes):.1f} %" in sentence


@pytest.mark.parametrize(("stated", "word"), [("material", "states"), (None, "means")])
def test_a_garment_file_without_the_kind_of_points_means_material_points(monkeypatch, stated, word):
    monkeypatch.setattr(point_kind, "kind_shown", lambda recording: ("silhouette", 0.05))
    recordings = [SimpleNamespace(take_id="a", is_imported=False), SimpleNamespace(take_id="b", is_imported=True)]
    assert describe_contradiction(SimpleNamespace(point_kind="material", points_are=stated), recordings) == (
        f"The garment file {word} material points, but in 2 of 2 takes the lengths between neighbours shrink and "
        "stretch together, by up to 5.0 %. A silhouette's points do so, as they slide over the cloth. State points_are "
        '= "silhouette" in the garment file and import the takes again with --garment: a take keeps the description '
        "that it was made with."
    )


def test_other_ends_were_measured_when_the_takes_own_were_unless_it_is_said_when():
    """The take's own at 45 instants; moved by 0.1 m, and every second one of them half a second later."""
    found = prepare(a_take(frames=45))
    aside = found.held_seen + 0.1
    moved = found.with_held(aside)
    np.testing.assert_array_equal(moved.held_time, found.held_time)
    assert moved.held(found.held_time) == pytest.approx(found.held(found.held_time) + 0.1, abs=1e-9)
    later = found.with_held(aside[::2], found.held_time[::2] + 0.5)
    np.testing.assert_array_equal(later.held_time, found.held_time[::2] + 0.5)
    np.testing.assert_array_equal(later.held_seen, aside[::2])
    assert later.held(found.held_time[2:40] + 0.5) == pytest.approx(moved.held(found.held_time[2:40]), abs=2e-3)
    bare = dataclasses.replace(found, held_time=None)  # of a recording that was made of frames alone
    assert bare.with_held(aside).held_time is None
    assert bare.with_held(aside).held(found.time) == pytest.approx(moved.held(found.time), abs=1e-9)


def test_targets_go_from_the_first_sight_to_the_last_and_stay_there():
    """A sheet that moves by 0.3 m/s along its bar: 10 mm a frame, of which a point's last one counts."""
    garment = sheet(grid=5)
    time = TIME[:40]
    path = 0.3 * time[:, None] * np.array([1.0, 0.0, 0.0])
    points = hung(garment, time) + path[:, None]
    points[:4, 12] = points[-6:, 12] = np.nan
    found = prepare(take_of(garment, time, path, points))
    instants = np.array([-1.0, 0.0, time[3], time[20], time[-7], time[-1], 9.0])
    wanted, trust = found.targets(instants)
    ends = np.clip(instants, time[0], time[-1])
    assert wanted[:, 7, 0] == pytest.approx(found.points[0, 7, 0] + 0.3 * ends, abs=1e-3)
    assert wanted[1:-1, 7, 3] == pytest.approx(np.full(5, 0.3), abs=0.02)
    assert wanted[:, 12, 0] == pytest.approx(found.points[20, 12, 0] + 0.3 * (np.clip(instants, time[4], time[-7])
                                                                             - time[20]), abs=1e-3)  # fmt: skip
    assert trust[:, 7].tolist() == [0, 1, 1, 1, 1, 1, 0]
