"""The hanger's pitch from the planes of its marker plates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from capture.depth.surface import fit_surface
from capture.hanger.fiducial_tracker import MarkerTracker
from capture.hanger.pose import hanger_pitch, plate_slope
from formats.archive import read_take, write_take
from tests.capture.recording.test_conditions import RIG
from tests.capture.stage import CAMERA, marker_plate, pictures
from tests.formats.test_archive import a_take

MIDDLE = np.array([0.1, -0.2, 1.6])
SIDES = np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]])


def turned(pitch):
    """About x, lower edge towards the sensor."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def test_pitch_of_exact_planes_by_hand():
    """Plates through (x, 0, 1.6) whose depth falls by 0.5 m per metre downwards: atan 0.5."""
    v, u = np.mgrid[200:221, 300:321].astype(float)
    u, v = u.ravel(), v.ravel()
    # z = 1.6 - 0.5 y and y = z (v - cy) / fy.
    z = 1.6 / (1 + 0.5 * (v - CAMERA.cy) / CAMERA.fy)
    at = np.array([310.0, 205.0])
    plate = fit_surface(u - at[0], v - at[1], z, focal_length=CAMERA.fx, spread=0.1, correlated_pixels=1.0)
    slope = plate_slope(plate, at, CAMERA, 1.0)
    pitch, sd = hanger_pitch(MIDDLE + SIDES, [slope, None], RIG)
    assert pitch == pytest.approx(np.arctan(0.5), abs=1e-9)
    assert hanger_pitch(MIDDLE + SIDES, [slope, slope], RIG)[1] == pytest.approx(sd / np.sqrt(2))


@pytest.mark.parametrize("degrees", [15.0, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.0, -10.0))])
def test_a_pitched_hanger_is_seen_to_a_degree_over_twelve_frames_and_as_well_as_it_says(degrees):
    rng = np.random.default_rng(7)
    plates = [marker_plate(i, MIDDLE + SIDES[i], rotation=turned(np.radians(degrees))) for i in range(2)]
    tracker = MarkerTracker(RIG)
    sights = [tracker.track(colour, depth, k / 30) for k, (depth, colour) in enumerate(
        pictures(plates, rng) for _ in range(12)
    )]  # fmt: skip
    off = np.array([sight.pitch for sight in sights]) - np.radians(degrees)
    sd = np.array([sight.pitch_sd for sight in sights])
    assert abs(off.mean()) < np.radians(1.5)
    assert np.degrees(sd.max()) < 4.0
    assert 0.3 < np.sqrt((off**2).mean() / (sd**2).mean()) < 1.7


def test_pitch_is_not_a_number_where_a_marker_is_lost():
    assert np.isnan(hanger_pitch(np.full((2, 3), np.nan), [None, None], RIG)).all()


def test_pitch_comes_back_from_a_take_to_half_a_step(tmp_path):
    take = a_take()
    pitch = 0.3 * np.sin(take.time)
    pitch[5] = np.nan
    write_take(tmp_path / "a.mcap", dataclasses.replace(take, pitch=pitch, pitch_sd=np.full_like(pitch, 0.03)))
    back = read_take(tmp_path / "a.mcap")
    assert back.pitch == pytest.approx(pitch, abs=0.51e-4, nan_ok=True)
    assert np.isnan(back.pitch_sd[5])
    without = read_take(write_take(tmp_path / "b.mcap", take))
    assert np.isnan(without.pitch).all()
