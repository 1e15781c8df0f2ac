"""Depth of a surface at one pixel of the image, from noisy, quantised and partly missing pixels.

A plane seen by a pinhole camera is linear in inverse depth, which is also what the sensor measures:

    1/z = a + b (u - u0) + c (v - v0)                     fitted by least squares, outliers removed twice
    sd(a)^2 = sd_pixel^2 [(A^T A)^-1]_00 * correlated pixels,   sd(z) = z^2 sd(a)
    sd_axial(z) = 0.0012 + 0.0019 (z - 0.4)^2             [m]
    step(z) = z^2 / (8 * 0.075 f),    sd_pixel^2 = (sd_axial^2 + step^2 / 12) / z^4

Source of sd_axial and of the lateral noise: Nguyen, Izadi, Lovell, "Modeling Kinect Sensor Noise for
Improved 3D Reconstruction and Tracking", 3DIMPVT 2012, section 3. Disparity in steps of 1/8 pixel over a
75 mm baseline: Khoshelham, Elberink, "Accuracy and Resolution of Kinect Depth Data", Sensors 12 (2012),
section 3. A mean of quantised pixels is finer than a step because the noise dithers it; a median is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from firmware_host.depth_sensor import BASELINE
from formats.arrays import Booleans, Floats

DISPARITY_STEPS = 8.0  # steps per pixel of disparity (same source)
LATERAL_SD = 0.8  # px, position of a depth edge (Nguyen et al. 2012, section 3.2, below 60 degrees)
# temporal noise of a real Kinect v1 at 0.8-2.6 m, 12 frames: pixels 1, 2 and 3 apart correlate so, mean of u and v.
# Then 0.19, 0.13, 0.08.
NEIGHBOURS_ALIKE = (0.58, 0.38, 0.27)
MEASURED_LAGS = len(NEIGHBOURS_ALIKE)
FARTHEST_ALIKE = 8  # px: beyond, the correlation of the same noise is below 0.02
MOST_ALIKE = 0.8  # correlation, above a Kinect's 0.6: a plate that is not flat has 1, which is no noise
# pixels of a plate, at least, for the share that its plane takes up; 22 x 22. With fewer the iteration may run away.
# Plates of 18 x 18 pixels were simulated, with first-order noise of 16 pixels: at 380 they gave 34, at 250 149.
FEWEST_TOLD = 500
ITERATIONS = 8  # of the number of pixels: its error falls at least to half with each, so to half a per cent
# standard deviations of a pixel from the surface, beyond which the pixel is an outlier. Of Gaussian noise, one pixel
# in 16 000 lies beyond. On nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`) half puts markers at
# rest off by 0.65 mm in place of 0.59. Double leaves them, and the corners, as near.
OUTLIER_SD = 4.0
FLATTEST_SPREAD = 1e-6  # determinant of the pixels' scaled scatter: below, they lie on one line of the image
# fewer noisy pixels do not determine a plane. Our choice: four for each of a plane's three numbers. Half and double
# move no corner of `benchmarks/tracking.py --set development-11` by more than 0.02 mm (95 % of nine scenes at 1.6 m).
FEWEST_PIXELS = 12


@dataclass(frozen=True)
class SurfaceDepth:
    """Depth [m] of a surface at one pixel, its standard deviation [m], and the fit behind it.

    - `residuals` [m], (pixels,) in depth
    - `used`, (pixels,): which of the given pixels lie on the surface
    - `slope` [m/px], (2,): how depth changes along u and v
    - `height` [px]: root of the sum of squares of the fitted pixels' distances along v from their middle. A large
      height makes the slope along v certain.
    """

    depth: float
    sd: float
    slope: Floats
    height: float
    residuals: Floats
    used: Booleans


def pixel_sd(depth: float, focal_length: float) -> float:
    """Return the standard deviation [m] of one depth pixel at `depth` [m]; `focal_length` in pixels."""
    axial = 0.0012 + 0.0019 * (depth - 0.4) ** 2
    step = depth**2 / (DISPARITY_STEPS * BASELINE * focal_length)
    return math.sqrt(axial**2 + step**2 / 12.0)


def fit_surface(
    u: Floats, v: Floats, z: Floats, *, focal_length: float, spread: float, correlated_pixels: float
) -> SurfaceDepth | None:
    """Fit a plane through pixels and return its depth at u = v = 0.

    u, v [px], (pixels,): positions relative to the wanted pixel; z [m], (pixels,), all positive.
    `spread` [m]: how far in depth the surface may reach over these pixels. None where too few pixels agree.
    """
    if z.size < FEWEST_PIXELS:
        return None
    middle = float(np.partition(z, z.size // 2)[z.size // 2])
    noise = pixel_sd(middle, focal_length)
    used = np.abs(z - middle) < spread + OUTLIER_SD * noise
    rows = np.empty((4, z.size))
    rows[0], rows[1], rows[2] = 1.0, u, v
    np.divide(1.0, z, out=rows[3])
    plane: _Plane | None = None
    for _ in range(2):
        count = int(np.count_nonzero(used))
        if count < FEWEST_PIXELS:
            return None
        chosen = rows if count == z.size else rows[:, used]
        plane = _plane(chosen @ chosen.T)
        if plane is None:
            return None
        residuals = (np.array([plane.a, plane.b, plane.c, -1.0]) @ rows) * z * middle
        before, used = used, np.abs(residuals) < OUTLIER_SD * noise
        if np.array_equal(before, used):
            break
    if plane is None or plane.a <= 0.0:
        return None
    depth = 1.0 / plane.a
    sd = depth**2 * noise / middle**2 * math.sqrt(plane.variance * correlated_pixels)
    return SurfaceDepth(depth, sd, np.array([plane.b, plane.c]) * -(depth**2), plane.height, residuals, used)


class _Plane(NamedTuple):
    """w = a + b u + c v; variance of a for a unit variance of w; height as in `SurfaceDepth`."""

    a: float
    b: float
    c: float
    variance: float
    height: float


def _plane(moments: Floats) -> _Plane | None:
    """Solve for the plane from the sums of products of (1, u, v, w), (4, 4); None where the pixels lie on a line.

    It uses scalars, because the overhead of a library's solver is longer than this computation.
    """
    (n, u, v, w), (_, uu, uv, uw), (_, _, vv, vw), _ = moments.tolist()
    u, v, w = u / n, v / n, w / n
    scatter_u, scatter_v, scatter_uv = uu - n * u * u, vv - n * v * v, uv - n * u * v
    determinant = scatter_u * scatter_v - scatter_uv**2
    if determinant <= FLATTEST_SPREAD * uu * vv:
        return None
    with_u, with_v = uw - n * u * w, vw - n * v * w
    b = (scatter_v * with_u - scatter_uv * with_v) / determinant
    c = (scatter_u * with_v - scatter_uv * with_u) / determinant
    variance = 1.0 / n + (u * u * scatter_v - 2.0 * u * v * scatter_uv + v * v * scatter_u) / determinant
    return _Plane(w - b * u - c * v, b, c, variance, math.sqrt(scatter_v))


def _reach(rho: Sequence[float]) -> float:
    """Return 1 + 2 sum rho_k along one axis, from the first three correlations."""
    first, second, third = rho
    onwards = min(third / second, MOST_ALIKE) if second > 0.0 else 0.0
    further = sum(onwards**k for k in range(FARTHEST_ALIKE - MEASURED_LAGS + 1))
    return 1.0 + 2.0 * (first + second + third * further)


# of a Kinect's noise by the meter's equation, 20.7. Its correlations up to 8 px add up to 19 along u and v: the
# equation is 4 % too careful in a deviation.
CORRELATED_PIXELS = _reach(NEIGHBOURS_ALIKE) ** 2


class CorrelationMeter:
    """Estimates over how many pixels this sensor's noise is correlated, from flat plates of known outline.

        pixels = prod over u and v of (1 + 2 (rho_1 + rho_2 + rho_3 (1 + q + ... + q^5))),    q = rho_3 / rho_2

    rho_k is the correlation of pixels k apart; beyond three, q continues it up to eight. A mean of n pixels has the
    variance of n / pixels independent ones (G. E. P. Box, G. M. Jenkins, "Time series analysis", 1976, section 2.1).
    One neighbour does not tell how far noise reaches: a mean over 3 x 3 pixels ends after two, a real Kinect's noise
    after eight.

    A plane fitted through N pixels takes up a share b of their variance. It lowers the products of near pixels by as
    much as the squares:

        E r(x)^2 = s^2 (1 - b),   E r(x) r(x + k) = s^2 (rho_k - b),   b = 3 pixels / N

    So rho_k = b + (1 - b) r_k, where r_k are the residuals' own correlations, and pixels follow by iteration. The
    estimate starts from a Kinect's values and approaches the sensor's own with every plate.
    """

    PRIOR_WEIGHT = 200.0  # pixels: weight of the starting value, less than one marker plate

    def __init__(self, pixels: float = CORRELATED_PIXELS) -> None:
        start = np.array(NEIGHBOURS_ALIKE) * ((math.sqrt(pixels) - 1.0) / (math.sqrt(CORRELATED_PIXELS) - 1.0))
        self._products = np.tile(start * self.PRIOR_WEIGHT, (2, 1))
        self._squares = np.full((2, MEASURED_LAGS), self.PRIOR_WEIGHT)
        self._taken = np.zeros((2, MEASURED_LAGS))  # what the planes took up, for each of their `pixels`
        self.pixels = pixels

    def add(self, residuals: Floats, used: Booleans) -> None:
        """Add one plate's residuals in units of the pixel noise, (rows, columns), where `used` is true."""
        count = max(int(np.count_nonzero(used)), FEWEST_TOLD)
        for axis, (rows, marks) in enumerate(((residuals.T, used.T), (residuals, used))):
            for lag in range(1, MEASURED_LAGS + 1):
                both = marks[lag:] & marks[:-lag]
                a, b = rows[lag:][both], rows[:-lag][both]
                product, square = float(a @ b), 0.5 * float(a @ a + b @ b)
                self._products[axis, lag - 1] += product
                self._squares[axis, lag - 1] += square
                self._taken[axis, lag - 1] += 3.0 * (square - product) / count
        pixels = 1.0
        for _ in range(ITERATIONS):
            rho = (self._products + pixels * self._taken) / self._squares
            pixels = math.prod(_reach(one) for one in np.clip(rho, 0.0, MOST_ALIKE).tolist())
        self.pixels = pixels
