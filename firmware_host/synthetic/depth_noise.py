"""The noise model of a structured-light depth camera.

    lateral     every pixel measures at a normal offset of sigma_L = 0.8 px
    axial       sigma_z = 0.0012 + 0.0019 (z - 0.4)^2  [m], correlated over about three pixels
    disparity   d = f b / z rounded to 1/8 px, baseline b = 75 mm
    shadow      the projector, b aside, does not reach f b (1/z_near - 1/z_far) px of the background beside an edge
    edges       pixels beside a jump in depth are missing in a third of all cases
Sources: C. V. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking"
(3DIMPVT 2012), section 3; K. Khoshelham, S. O. Elberink, Sensors 12 (2012) (disparity).
"""

from __future__ import annotations

import numpy as np

from firmware_host.depth_sensor import BASELINE
from formats.arrays import Booleans, Floats, Unsigned
from formats.rig import Sensor

LATERAL_PX = 0.8  # px, Nguyen et al. 2012, section 3
DISPARITY_STEP = 1 / 8  # px, same source
EDGE_JUMP = 0.05  # m between neighbours; our choice: half and double were not tried
EDGE_MISSING = 1 / 3  # share of the pixels beside a jump, see the module; our choice: half and double were not tried
# m; our choice: the axial law begins at 0.4 m, and a room is less than 8 m deep. Half and double were not tried.
SEEN_FROM, SEEN_TO = 0.4, 8.0


def axial_deviation(depth: Floats) -> Floats:
    """Standard deviation of depth [m] at a depth [m] (Nguyen et al. 2012, eq. 3, at angles below 60 degrees)."""
    return np.asarray(0.0012 + 0.0019 * (depth - 0.4) ** 2)


def spoil(truth: Floats, camera: Sensor, rng: np.random.Generator) -> Unsigned:
    """Return the depth image [mm], (height, width), that the camera gives for true depth [m], 0 where unknown."""
    height, width = truth.shape
    rows = _beside(np.arange(height, dtype=float)[:, None], height, rng.normal(0, LATERAL_PX, truth.shape))
    columns = _beside(np.arange(width, dtype=float), width, rng.normal(0, LATERAL_PX, truth.shape))
    rows *= width
    rows += columns
    depth = truth.take(rows.astype(np.intp))
    noise = _alike_over_three_pixels(rng.normal(size=truth.shape))
    noise *= axial_deviation(depth)
    depth += noise
    scale = camera.fx * BASELINE
    # Whole steps of disparity. All in one array: this runs for every drawn frame.
    np.maximum(depth, 1e-3, out=depth)
    np.divide(scale, depth, out=depth)
    depth /= DISPARITY_STEP
    np.rint(depth, out=depth)
    depth *= DISPARITY_STEP
    np.maximum(depth, DISPARITY_STEP, out=depth)
    np.divide(scale, depth, out=depth)
    missing = in_shadow(truth, camera)
    jump = np.zeros(truth.shape, bool)
    across, down = np.abs(np.diff(truth, axis=1)) > EDGE_JUMP, np.abs(np.diff(truth, axis=0)) > EDGE_JUMP
    jump[:, 1:] |= across
    jump[:, :-1] |= across
    jump[1:] |= down
    jump[:-1] |= down
    missing |= jump & (rng.random(truth.shape) < EDGE_MISSING)
    missing |= (depth < SEEN_FROM) | (depth > SEEN_TO)
    depth *= 1000
    np.rint(depth, out=depth)
    depth[missing] = 0
    return depth.astype(np.uint16)


def _beside(places: Floats, count: int, aside: Floats) -> Floats:
    """Return the integer positions, clipped to 0 to `count` - 1, at offsets `aside` [px]; overwrites `aside`."""
    np.rint(aside, out=aside)
    aside += places
    return np.asarray(np.clip(aside, 0, count - 1, out=aside))


def _alike_over_three_pixels(noise: Floats) -> Floats:
    """Average over 3 x 3 pixels, scaled back to unit variance."""
    padded = np.pad(noise, 1, mode="wrap")
    height, width = noise.shape
    total = padded[:height, :width].copy()
    for i, j in list(np.ndindex(3, 3))[1:]:
        total += padded[i : i + height, j : j + width]
    total /= 3.0
    return total


def in_shadow(truth: Floats, camera: Sensor) -> Booleans:
    """Return which pixels of true depth [m], (height, width), the projector does not reach: they have no depth.

    The projector stands to the right of the camera, so an object to their right casts the shadow.
    """
    height, width = truth.shape
    scale = camera.fx * BASELINE
    # The projector sees a point at column u - scale / z (its own image column, up to a constant).
    column = np.arange(width)[None] - scale / truth
    hidden = np.zeros((height, width), bool)
    nearest_right = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    # Seen from the projector, a pixel to the right with a smaller column hides this pixel.
    hidden[:, :-1] = nearest_right[:, 1:] < column[:, :-1] - 1.0
    return hidden
