"""Errors of whole frames are estimated, shrunk by their noise, and absent without errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.recordings.camera import CameraSteps
from fit.recordings.camera_findings import describe_camera
from fit.recordings.frame_offsets import LOST, find_frame_offsets
from fit.recordings.hanger_path import held_curve
from fit.recordings.recording import prepare
from fit.recordings.robust_line import robust_line, seconds_apart
from fit.recordings.timing import STILL
from tests.fit.recordings.silhouettes import path, silhouette_sheet, swung, uneven

TIME = np.arange(0, 12, 1 / 9)
NOISE = 0.0017  # m of the row's middle across the cloth, the median of the real recordings at rest
LATE = 0.02  # s: the hanger goes at 0.36 m/s, rms, and frames are off by 7 mm as real ones are


def held():
    half = np.array([0.15, 0.0, 0.0])
    return held_curve(TIME, np.concatenate([path(TIME) - half, path(TIME) + half], 1), 4.0)


def speed():
    return np.linalg.norm(path(TIME + 2e-3) - path(TIME - 2e-3), axis=1) / 4e-3


def found_of(across, seed, scale=1.0):
    """The offsets of frames that are off by `across` [m], (frames,), along y, with noise on all axes."""
    row = scale * path(TIME) + np.array([0.004, 0.003, -0.012])
    row = row + across[:, None] * np.array([0.0, 1.0, 0.0])
    return find_frame_offsets(TIME, row + NOISE * np.random.default_rng(seed).standard_normal(row.shape), held())


def test_offsets_that_grow_with_speed_are_taken_out_and_their_deviation_is_stated():
    """The mean of the normal number errs by what it states; over 20 recordings of 108 frames that is sure to 5 %."""
    errors, stated, sizes = [], [], []
    for seed in range(20):
        true = LATE * speed() * np.random.default_rng(100 + seed).standard_normal(len(TIME))
        found = found_of(true, seed)
        errors.append(((found.moved[:, 1] - true) ** 2).mean())
        stated.append(found.left**2)
        sizes.append(found.rms / np.sqrt((true[speed() > 0.03] ** 2).mean()))
        assert np.abs(found.moved[:, [0, 2]]).max() == pytest.approx(0.0, abs=1e-6)
    assert np.mean(stated) == pytest.approx(np.mean(errors), rel=0.5)  # the line is known better than by least squares
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean(errors)) < 1.2 * NOISE


def test_offsets_are_found_in_each_of_20_recordings_with_and_without_a_scale():
    """The same recordings as below, with frames that are off."""
    off = LATE * speed() * np.random.default_rng(100).standard_normal((20, len(TIME)))
    for scale in (1.0, 1.05):
        assert all(found_of(one, seed, scale) is not None for seed, one in enumerate(off))


def test_a_row_that_is_lost_in_one_frame_is_not_moved_and_moves_no_other():
    """Half a metre off while the hanger moves: more than five deviations of any frame."""
    true = LATE * speed() * np.random.default_rng(100).standard_normal(len(TIME))
    lost = int(np.argmax(speed()))
    plain, found = found_of(true, 0), found_of(np.where(np.arange(len(TIME)) == lost, 0.5, true), 0)
    assert not found.moved[lost].any()
    others = np.arange(len(TIME)) != lost
    assert found.moved[others] == pytest.approx(plain.moved[others], abs=2e-3)
    assert found.rms == pytest.approx(plain.rms, rel=0.1)


def test_noise_alone_is_no_offset():
    """It passes in 7 of 300 recordings, 2 %; more than 4 of 60 would come once in a hundred times."""
    assert sum(found_of(np.zeros(len(TIME)), seed) is not None for seed in range(60)) <= 4


def test_a_scale_is_left_for_the_diagnosis():
    """Depths 5 % too long move the row by 5 % of the hanger's way, which a line through its position explains."""
    assert sum(found_of(np.zeros(len(TIME)), seed, scale=1.05) is not None for seed in range(60)) <= 4


@pytest.mark.slow
def test_frames_of_a_take_are_moved_back_and_named():
    time = uneven()
    take = swung(silhouette_sheet(), time, time, noise=0.001)
    assert prepare(take).camera.offsets is None
    going = np.linalg.norm(path(time + 2e-3) - path(time - 2e-3), axis=1) / 4e-3
    off = LATE * going * np.random.default_rng(3).standard_normal(len(time))
    shaken = dataclasses.replace(take, points=take.points + off[:, None, None] * np.array([0.0, 1.0, 0.0]))
    whole, moved, left = prepare(take), prepare(shaken), prepare(shaken, CameraSteps(frames=False))
    assert len(whole.time) == len(moved.time) == len(left.time)
    away = [np.sqrt(np.nanmean((one.points - whole.points) ** 2)) for one in (moved, left)]
    assert away[0] < 0.5 * away[1]
    named = {one.name: one for one in describe_camera([moved])}
    assert named["frame_offsets"].figure == pytest.approx(np.sqrt((off[going > 0.03] ** 2).mean()), rel=0.15)
    assert "whole frames are off across the cloth by" in named["frame_offsets"].sentence
    assert "frame_offsets" not in {one.name for one in describe_camera([whole])}


def test_offsets_are_by_the_equations_of_their_module():
    """Each number by hand, of the error beside the line: k^2, the gain of each frame, and what is left."""
    along = held()
    true = LATE * speed() * np.random.default_rng(105).standard_normal(len(TIME))
    found = found_of(true, 5)
    row = path(TIME) + np.array([0.004, 0.003, -0.012]) + true[:, None] * np.array([0.0, 1.0, 0.0])
    row = row + NOISE * np.random.default_rng(5).standard_normal(row.shape)
    middle = along(TIME).reshape(-1, 2, 3).mean(1)
    across = row[:, 1] - middle[:, 1]
    line = np.column_stack([np.ones(len(TIME)), middle - middle.mean(0)])
    error = across - line @ robust_line(line, across, seconds_apart(TIME))[0]
    step = 1e-4
    fast = np.linalg.norm((along(TIME + step) - along(TIME - step))[:, :3], axis=1) / (2 * step)
    rests = fast < STILL
    noise = 1.4826 * np.median(np.abs(error[rests] - np.median(error[rests])))
    usual = np.hypot(noise, 1.4826 * np.median(np.abs(error[~rests]) / fast[~rests]) * fast)
    kept = np.abs(error) <= LOST * usual
    used = kept & ~rests
    own = (error[used] ** 2 - noise**2).sum() / (fast[used] ** 2).sum() * fast**2
    gain = np.where(kept, own / (own + noise**2), 0.0)
    assert np.abs(found.moved[:, 1]) == pytest.approx(np.abs(gain * error), rel=0.02, abs=1e-6)
    assert found.rms == pytest.approx(np.sqrt(((gain * error)[used] ** 2).mean()), rel=0.01)
    of_line = (1.4826 * np.median(np.abs(error[used]))) ** 2 * 4 / used.sum()
    assert found.left == pytest.approx(np.sqrt(noise**2 * gain[kept].mean() + of_line), rel=0.01)
