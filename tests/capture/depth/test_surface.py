"""Planes through depth pixels and their deviations, worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.depth.surface import CORRELATED_PIXELS, CorrelationMeter, _reach, fit_surface, pixel_sd

FOCAL = 575.8
A, B, C = 0.625, 4e-4, -3e-4  # 1/m and 1/(m px): 1.6 m at u = v = 0, inverse depth rising to the right


def grid():
    """Return a patch of 9 x 13 pixels to the right of and above the requested pixel."""
    v, u = np.mgrid[-8:1, 2:15].astype(float)
    return u.ravel(), v.ravel()


def fitted(u, v, z, *, spread=0.06, correlated=1.0):
    return fit_surface(u, v, z, focal_length=FOCAL, spread=spread, correlated_pixels=correlated)


@pytest.mark.parametrize(("depth", "sd"), [(0.4, 1.2074e-3), (2.0, 6.9242e-3)])
def test_the_deviation_of_a_pixel_by_hand(depth, sd):
    """At 2 m: 1.2 + 1.9 x 1.6^2 = 6.064 mm; a step of 4 / (0.6 x 575.8) = 11.578 mm, by sqrt 12: 3.342 mm."""
    assert pixel_sd(depth, FOCAL) == pytest.approx(sd, rel=1e-4)


def test_an_exact_plane_is_found_with_its_slope_its_height_and_its_deviation():
    u, v = grid()
    z = 1.0 / (A + B * u + C * v)
    plane = fitted(u, v, z)
    assert plane.depth == pytest.approx(1.6, rel=1e-9)
    assert plane.slope == pytest.approx([-B * 1.6**2, -C * 1.6**2], rel=1e-7)
    # Rows -8 to 0 of 13 pixels each: the squares of -4 to 4 add up to 60.
    assert plane.height == pytest.approx(math.sqrt(13 * 60))
    assert np.abs(plane.residuals).max() < 1e-9
    assert plane.used.all()
    design = np.stack([np.ones_like(u), u, v], axis=1)
    middle = np.sort(z)[z.size // 2]
    of_inverse = pixel_sd(middle, FOCAL) / middle**2 * math.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    assert plane.sd == pytest.approx(1.6**2 * of_inverse, rel=1e-6)
    assert fitted(u, v, z, correlated=9.0).sd == pytest.approx(3 * plane.sd)


def test_the_deviation_of_a_slanted_patch_is_that_of_its_least_squares():
    """Rows 0 to 8 begin a pixel farther right each, so that u and v are correlated: their terms do not vanish."""
    v, u = np.mgrid[3:12, 2:15].astype(float)
    u, v = (u + v).ravel(), v.ravel()
    design = np.stack([np.ones_like(u), u, v], axis=1)
    of_inverse = pixel_sd(1.6, FOCAL) / 1.6**2 * math.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    assert fitted(u, v, np.full(u.size, 1.6)).sd == pytest.approx(1.6**2 * of_inverse, rel=1e-6)


@pytest.mark.parametrize("behind", [0.04, -0.04])
def test_pixels_of_another_surface_are_cut_and_reported_with_how_far_they_are_behind(behind):
    """Forty millimetres are eight pixel noises at 1.6 m, and within the spread of the first cut."""
    u, v = grid()
    z = 1.0 / (A + B * u + C * v)
    z[::10] += behind
    plane = fitted(u, v, z)
    assert plane.depth == pytest.approx(1.6, rel=1e-9)
    assert plane.used.tolist() == [k % 10 != 0 for k in range(z.size)]
    assert plane.residuals[::10] == pytest.approx(behind, rel=0.02)


@pytest.mark.parametrize("order", [1, -1])
def test_the_surface_of_most_pixels_is_found_also_where_the_nearer_ones_come_first(order):
    """70 of 117 pixels are 1.6 m away, and 47 are 2.2 m, each a little farther than the one before."""
    u, v = grid()
    z = (np.where(np.arange(117) < 70, 1.6, 2.2) + 1e-6 * np.arange(117))[::order]
    plane = fitted(u, v, z)
    assert plane.depth == pytest.approx(1.6, abs=1e-3)
    assert plane.used.sum() == 70


def test_a_surface_farther_than_the_spread_does_not_take_part_in_the_first_plane():
    """Forty per cent of the pixels, in the last columns, lie 100 mm behind: beyond 60 mm and four noises of 5 mm."""
    u, v = grid()
    behind = u > 9
    plane = fitted(u, v, np.where(behind, 1.7, 1.6))
    assert plane.depth == pytest.approx(1.6, rel=1e-12)
    assert (plane.used == ~behind).all()


def test_a_steep_surface_within_the_spread_is_used_whole():
    """It reaches 70 mm to either side: within 60 mm and four noises of 5 mm, but only five pixels lie within 20."""
    u, v = (part.ravel().astype(float) for part in np.meshgrid([-6, 0, 6], np.arange(5)))
    z = 1.6 + 0.07 * u / 6
    assert fitted(u, v, z, spread=0.06).used.all()
    assert fitted(u, v, z, spread=0.0) is None


def test_outliers_are_removed_twice_and_no_third_time():
    """Errors of a heavy tail, so that each plane shows other outliers: the plane of the first cut is the answer."""
    u, v = grid()
    design = np.stack([np.ones_like(u), u, v], axis=1)
    z = 1.6 + 0.004 * np.random.default_rng(9).standard_t(1.5, u.size)
    middle = np.sort(z)[z.size // 2]
    noise = pixel_sd(middle, FOCAL)
    used, planes = np.abs(z - middle) < 0.06 + 4 * noise, []
    for _ in range(3):
        planes.append(np.linalg.lstsq(design[used], 1 / z[used], rcond=None)[0])
        used = np.abs(design @ planes[-1] - 1 / z) * z * middle < 4 * noise
    assert abs(1 / planes[2][0] - 1 / planes[1][0]) > 1e-5
    assert abs(1 / planes[1][0] - 1 / planes[0][0]) > 1e-5
    assert fitted(u, v, z).depth == pytest.approx(1 / planes[1][0], rel=1e-9)


def test_twelve_pixels_make_a_plane_and_eleven_or_a_line_make_none():
    u, v = grid()
    z = np.full(u.size, 1.6)
    assert fitted(u[:26:2], v[:26:2], z[:26:2]) is not None
    two_rows = np.r_[0:6, 13:19]
    assert fitted(u[two_rows], v[two_rows], z[two_rows]) is not None
    assert fitted(u[two_rows[:11]], v[two_rows[:11]], z[:11]) is None
    line = np.arange(40.0)
    assert fitted(line, np.zeros(40), np.full(40, 1.6)) is None
    assert fitted(line, 0.5 * line, np.full(40, 1.6)) is None


def test_too_few_pixels_that_agree_make_no_plane():
    """Ten at the middle's depth, five nearer and five farther by a decimetre."""
    u, v = np.mgrid[0:4, 0:5].astype(float)
    z = np.full(20, 1.6)
    z[:5], z[5:10] = 1.5, 1.7
    assert fitted(u.ravel(), v.ravel(), z) is None


def test_a_plane_that_goes_through_the_sensor_has_no_depth():
    """1/z = -0.1 + 0.007 u from u = 100 on is positive there and negative at u = 0."""
    v, u = np.mgrid[0:5, 100:121].astype(float)
    z = 1.0 / (-0.1 + 0.007 * u)
    assert fitted(u.ravel(), v.ravel(), z.ravel(), spread=0.3) is None


def test_correlation_starts_from_a_kinects_pixels():
    """The tail from 0.27 on is 0.27 (1 - q^6) / (1 - q), q = 0.27 / 0.38: 0.813."""
    assert CorrelationMeter().pixels == pytest.approx((1 + 2 * (0.58 + 0.38 + 0.81271)) ** 2, rel=1e-5)
    assert CorrelationMeter(4.0).pixels == pytest.approx(4.0)


def test_a_kinects_own_correlations_give_its_pixels_to_a_twelfth():
    """Those up to 8 px, of which 0.045 and 0.02 are the last, add up to 19.3; one more continues to 22.9."""
    summed = (1 + 2 * sum((0.58, 0.38, 0.27, 0.19, 0.13, 0.08, 0.045, 0.02))) ** 2
    assert summed == pytest.approx(19.3, abs=0.05)
    assert CorrelationMeter().pixels == pytest.approx(summed, rel=1 / 12)


@pytest.mark.parametrize("pixels", [1.0, 4.0, CORRELATED_PIXELS, 30.0])
def test_a_plate_that_tells_nothing_leaves_the_start_as_it_is(pixels):
    """Residuals of 0 add neither products nor squares."""
    meter = CorrelationMeter(pixels)
    meter.add(np.zeros((30, 30)), np.ones((30, 30), bool))
    assert meter.pixels == pytest.approx(pixels)


@pytest.mark.parametrize("reach", [1, 2, 3])
@pytest.mark.parametrize("side", [14, 24])
def test_correlation_of_noise_that_a_mean_of_pixels_makes(reach, side):
    """A mean over r x r pixels ends after r, and r^2 pixels hold the information of one, whatever the plate's size."""
    random, meter = np.random.default_rng(3), CorrelationMeter()
    v, u = np.mgrid[:side, :side].astype(float)
    terms = np.stack([np.ones(side * side), u.ravel(), v.ravel()], axis=1)
    for _ in range(150):
        white = random.normal(size=(side + reach, side + reach))
        noise = sum(white[i : i + side, j : j + side] for i in range(reach) for j in range(reach)) / reach
        plane = terms @ np.linalg.lstsq(terms, noise.ravel(), rcond=None)[0]
        meter.add(noise - plane.reshape(noise.shape), np.ones(noise.shape, bool))
    assert meter.pixels == pytest.approx(reach**2, rel=0.25)


@pytest.mark.parametrize("turned", [lambda image: image, np.fliplr, np.transpose, lambda image: np.flipud(image.T)])
def test_correlation_counts_pairs_of_used_pixels_only(turned):
    meter, same = CorrelationMeter(), CorrelationMeter()
    residuals, used = np.ones((4, 6)), np.zeros((4, 6), bool)
    residuals[:, 3:], used[:, :3] = 1e3, True
    same.add(turned(residuals[:, :3]), turned(used[:, :3]))
    meter.add(turned(residuals), turned(used))
    assert meter.pixels == pytest.approx(same.pixels)


def test_correlation_stays_between_none_and_four_fifths():
    """A bias correlates by 1, taken for 0.8 at three lags and 0.8 of the one before on: 1 + 2 (1.6 + 4 (1 - 0.8^6))."""
    rows, columns = np.indices((90, 90))
    chess = (-1.0) ** (rows + columns)
    for residuals, low, high in ((chess, 1.0, 7.0), (np.ones((90, 90)), 102.0675377, 102.0675377)):
        meter = CorrelationMeter()
        meter.add(residuals, np.ones((90, 90), bool))
        assert low - 1e-6 <= meter.pixels <= high + 1e-6


@pytest.mark.parametrize(
    ("rho", "reach"),
    [([0.5, 0.4, 0.2], 3.5875), ([0.5, 0.0, 0.25], 2.5), ([0.0, 0.1, 0.2], 2.675712), ([0.0, 0.0, 0.0], 1.0)],
)
def test_correlation_goes_on_from_three_to_eight_pixels_as_from_the_second_to_the_third(rho, reach):
    """The six from the third on: 0.2 (1 - 0.5^6) / 0.5 = 0.39375.

    Nothing goes on from a second of 0. The ratio is 0.8 at most: 0.2 (1 - 0.8^6) / 0.2 = 0.737856.
    """
    assert _reach(rho) == pytest.approx(reach)


def test_the_start_of_correlation_weighs_two_hundred_pixels():
    """Two pixels of the square 200 correlate by 1: from white noise 200 of 400, and 1 + 2 x 0.5 along u alone.

    A Kinect's 0.58 becomes (116 + 20) / 220 by two of the square 20. The rest, 0.38 and on from 0.27, stays.
    """
    for way in (np.asarray, np.transpose):
        white, kinect = CorrelationMeter(1.0), CorrelationMeter()
        white.add(way(np.full((1, 2), math.sqrt(200))), way(np.ones((1, 2), bool)))
        assert white.pixels == pytest.approx(2.0)
        kinect.add(way(np.full((1, 2), math.sqrt(20))), way(np.ones((1, 2), bool)))
        rest = 0.38 + 0.27 * (1 - (0.27 / 0.38) ** 6) / (1 - 0.27 / 0.38)
        assert kinect.pixels == pytest.approx((1 + 2 * (136 / 220 + rest)) * (1 + 2 * (0.58 + rest)))


@pytest.mark.parametrize("plates", [1, 2])
def test_correlation_gives_back_what_the_plane_took_up(plates):
    """A row of 1000 used pixels whose residuals are 2, 1 and then 0: products 2, 0 and 0, squares 3, 2.5 and 2.5.

    The plane took up b = 3 p / 1000: rho = 2 / 3 + b / 3, b and b, and q is 0.8. Then
    p = 1 + 2 (2 / 3 + b / 3 + b + 5 (1 - 0.8^6) b) = 7 / 3 + 10.0452 b.
    """
    for way in (np.asarray, np.transpose):
        meter = CorrelationMeter(1.0)
        residuals, used = np.zeros((1, 1200)), np.arange(1200)[None] < 1000
        residuals[0, :2] = 2e6, 1e6  # beside these the start weighs nothing
        for _ in range(plates):
            meter.add(way(residuals), way(used))
        assert meter.pixels == pytest.approx((7 / 3) / (1 - 0.0301357), rel=1e-6)


@pytest.mark.parametrize("start", [1.0, 200.0])
@pytest.mark.parametrize("shape", [(20, 25), (12, 9)])
def test_correlation_is_found_by_iteration_whatever_it_was_before(start, shape):
    """One residual in a corner: rho is b = 3 p / 500 at each lag, also on a plate of 108 pixels.

    So p = (1 + 2 (2 + 5 (1 - 0.8^6)) b)^2 = (1 + 0.0682714 p)^2, whose smaller root is 1.1655.
    From above the other, 184.1, the iteration runs away.
    """
    meter, residuals = CorrelationMeter(start), np.zeros(shape)
    residuals[0, 0] = 1e6
    meter.add(residuals, np.ones(shape, bool))
    share = 0.006 * (4 + 10 * (1 - 0.8**6))
    root = (1 - 2 * share - math.sqrt((1 - 2 * share) ** 2 - 4 * share**2)) / (2 * share**2)
    assert root == pytest.approx(1.1655, abs=1e-4)
    assert meter.pixels == pytest.approx(root, rel=1e-5)


@pytest.mark.parametrize("size", [1.0, 100.0])
@pytest.mark.parametrize(("aside", "is_plane"), [(9.0e-3, True), (5.0e-3, False)])
def test_pixels_within_a_thousandth_of_a_line_make_no_plane_however_long_it_is(size, aside, is_plane):
    """Twenty pixels in a diagonal, each `aside` of it by turns: a share of 0.0298 of the square of that."""
    along = np.arange(20) - 9.5
    u, v = size * along, size * (along + aside * np.tile([1.0, -1.0], 10))
    found = fitted(u, v, np.full(20, 1.6))
    assert (found is not None) == is_plane
    if found:
        assert found.depth == pytest.approx(1.6)
