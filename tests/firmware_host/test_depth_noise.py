"""The depth camera's noise has the sizes of its sources."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.synthetic.depth_noise import axial_deviation, spoil
from firmware_host.synthetic.scene import CAMERA


def wall(distance: float) -> np.ndarray:
    return np.full((CAMERA.height, CAMERA.width), distance)


@pytest.mark.parametrize(("distance", "expected"), [(0.4, 1.2e-3), (1.4, 3.1e-3), (2.4, 8.8e-3)])
def test_axial_noise_follows_nguyen(distance: float, expected: float) -> None:
    assert axial_deviation(np.array(distance)) == pytest.approx(expected)


@pytest.mark.parametrize("distance", [1.2, 1.6, 2.6])
def test_a_wall_has_the_mean_and_spread_of_noise_and_quantisation(distance: float) -> None:
    seen = spoil(wall(distance), CAMERA, np.random.default_rng(1)) / 1000
    step = distance**2 / (8 * 575.8 * 0.075)  # one eighth of a pixel of disparity, in depth
    noise = 0.0012 + 0.0019 * (distance - 0.4) ** 2
    # Whole millimetres make steps of 4.2 mm into 4 or 5 mm: up to 8 % of spread and 0.3 mm of mean, by where they fall.
    assert seen.std() == pytest.approx(np.hypot(noise, step / 12**0.5), rel=0.08)
    assert seen.mean() == pytest.approx(distance, abs=4e-4)


def test_depth_comes_in_eighths_of_a_pixel_of_disparity() -> None:
    seen = np.unique(spoil(wall(1.6), CAMERA, np.random.default_rng(2)))
    eighths = 8 * 575.8 * 0.075 / (seen / 1000)
    # Rounding to whole millimetres moves a disparity by up to 0.5 mm of a step of 7.4 mm.
    assert np.abs(eighths - np.rint(eighths)).max() < 0.5 / 7.4 * 1.2
    assert 4 <= len(seen) <= 12


def test_neighbouring_pixels_are_alike_and_distant_ones_are_not() -> None:
    seen = spoil(wall(1.6), CAMERA, np.random.default_rng(3)) / 1000 - 1.6
    variance = (seen**2).mean()
    # A mean over 3 pixels has neighbour correlation 2/3, here diluted by independent quantisation.
    assert 0.4 < (seen[:, 1:] * seen[:, :-1]).mean() / variance < 0.67
    assert abs((seen[:, 5:] * seen[:, :-5]).mean() / variance) < 0.03


def test_the_shadow_beside_an_edge_is_as_wide_as_the_jump_in_disparity() -> None:
    scene = wall(2.6)
    scene[100:300, 250:400] = 1.6
    seen = spoil(scene, CAMERA, np.random.default_rng(4))
    # 575.8 * 0.075 * (1/1.6 - 1/2.6) = 10.4 px of wall on the left of the near board, none on the right; the model
    # gives away one pixel so that a surface never shades itself.
    holes_left = (seen[120:280, 230:250] == 0).sum(axis=1).mean()
    holes_right = (seen[120:280, 405:425] == 0).sum(axis=1).mean()
    assert holes_left == pytest.approx(9.4, abs=0.6)
    assert holes_right == 0


def test_an_edge_is_frayed_by_about_eight_tenths_of_a_pixel() -> None:
    scene = wall(2.6)
    scene[:, :320] = 1.6
    seen = spoil(scene, CAMERA, np.random.default_rng(5))
    measured = seen > 0
    near = (seen < 2100) & measured
    columns = np.arange(310, 330)
    share = near[:, columns].sum(axis=0) / measured[:, columns].sum(axis=0)
    # Shares across the edge follow the normal distribution of the lateral offsets, rounded to whole pixels.
    looks = np.rint(np.random.default_rng(6).normal(0, 0.8, 200_000))
    expected = [(column + looks < 320).mean() for column in columns]
    np.testing.assert_allclose(share, expected, atol=0.08)


def test_the_same_seed_gives_the_same_picture_and_another_does_not() -> None:
    one, same, other = (spoil(wall(1.6), CAMERA, np.random.default_rng(seed)) for seed in (7, 7, 8))
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.3


def test_surfaces_too_near_or_too_far_are_missing() -> None:
    scene = wall(0.2)
    scene[:240] = 9.0
    assert not spoil(scene, CAMERA, np.random.default_rng(9)).any()
