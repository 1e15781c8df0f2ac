"""Erosion of a silhouette, wrong depths and a lean at rest are found with their size, without a simulation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from fit.recordings.camera_findings import describe_camera
from fit.recordings.recording import prepare
from fit.recordings.robust_line import robust_line
from tests.fit.recordings.silhouettes import path, silhouette_sheet, swung, uneven
from tests.fit.scenes import take_of


def named_in(take):
    return named_of(prepare(take))


def named_of(recording):
    return {one.name: one for one in describe_camera([recording])}


def test_an_eroded_border_is_named_with_its_size():
    """The grid is laid over 290 of 300 mm down the cloth: 10 mm at the bottom, none at the sides, 3.3 on average."""
    time = uneven()
    take = swung(silhouette_sheet(), time, time, seen_length=np.full(len(time), 29 / 30), noise=0.001)
    recording = prepare(take)
    outline = recording.camera.outline
    assert outline.bottom == pytest.approx(0.01, abs=5e-4)
    assert outline.side == pytest.approx(0.0, abs=5e-4)
    assert named_of(recording)["eaten_border"].figure == pytest.approx(0.01 / 3, abs=5e-4)
    assert "eaten_border" not in named_in(swung(silhouette_sheet(), time, time, noise=0.001))


@pytest.mark.slow
def test_erosion_by_pose_is_the_loss_per_unit_of_tilt():
    """The sheet of `swung` leans by sin(0.5 sin(2 pi 0.9 t)) along y, which is the level normal."""
    time = uneven()
    lean = np.sin(0.5 * np.sin(2 * np.pi * 0.9 * time))
    take = swung(silhouette_sheet(), time, time, seen_length=1 - 0.06 * lean / 0.3, noise=0.001)
    found = named_in(take)["eaten_by_pose"]
    assert found.figure == pytest.approx(0.06, abs=0.006)
    assert found.interval[0] < 0.061
    assert found.interval[1] > 0.059
    assert "eaten_by_pose" not in named_in(swung(silhouette_sheet(), time, time, noise=0.001))


def hanging(time, lean=0.0):
    """A rigid sheet that hangs below the moving hanger, out of the vertical by an angle [rad]."""
    garment = silhouette_sheet()
    places = np.array([p.at_m for p in garment.points])
    points = path(time)[:, None] + np.stack(
        [np.tile(places[:, 0], (len(time), 1)),
         np.tile(-places[:, 1] * np.sin(lean), (len(time), 1)),
         np.tile(places[:, 1] * np.cos(lean), (len(time), 1))], 2,
    )  # fmt: skip
    points = points + 1e-3 * np.random.default_rng(0).standard_normal(points.shape)
    return take_of(garment, time, path(time), points, sd=1e-3)


@pytest.fixture(scope="module")
def straight():
    """The recording of the sheet that hangs in the vertical."""
    return prepare(hanging(uneven()))


def test_a_tilt_at_rest_is_named_with_its_angle_and_left_in(straight):
    found = named_in(hanging(uneven(), np.radians(2.0)))["lean"]
    assert np.degrees(found.figure) == pytest.approx(2.0, abs=0.1)
    assert found.is_left
    assert "degrees [" in found.sentence
    assert "lean" not in named_of(straight)


def test_depths_that_are_read_too_long_show_in_the_path_of_the_held_row(straight):
    take = hanging(uneven())
    deep = dataclasses.replace(take, points=1.03 * take.points)
    found = named_in(deep)["depth_scale"]
    assert found.figure == pytest.approx(0.03, abs=0.006)
    assert "travels 3." in found.sentence or "travels 2." in found.sentence
    assert "depth_scale" not in named_of(straight)


def test_the_held_row_of_a_silhouette_says_how_far_all_its_points_are_off(straight):
    """A frame's own error across the cloth of 6 mm while the hanger rests, where no shift in time explains it."""
    time = uneven()
    take = hanging(time)
    off = 6e-3 * np.random.default_rng(1).standard_normal(len(time))
    shaken = dataclasses.replace(take, points=take.points + off[:, None, None] * np.array([0.0, 1.0, 0.0]))
    assert straight.camera.row_off < 1e-3
    assert 2e-3 < prepare(shaken).camera.row_off < 8e-3
    material = replace(take.garment, points_are="material")
    assert prepare(dataclasses.replace(shaken, garment=material)).camera.row_off == 0.0


def test_a_few_frames_far_off_do_not_move_a_line():
    rng = np.random.default_rng(0)
    x = np.linspace(-1, 1, 120)
    values = 0.3 + 2.0 * x + 0.05 * rng.standard_normal(120)
    values[::17] += 5.0
    line, half = robust_line(np.stack([np.ones(120), x], 1), values, np.arange(120) // 6)
    assert line == pytest.approx([0.3, 2.0], abs=0.05)
    assert (half < 0.1).all()
