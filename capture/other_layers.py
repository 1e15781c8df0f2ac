"""Other layers of the garment beside one place of it: what peeks out behind its rim, and what lies folded before it.

A corner that is folded away from the sensor is hidden, unless it reaches out again beyond the fold. One that is folded
towards the sensor lies before the garment and is seen, but not on the outline. Both leave traces around the place:

    peeking [m^2]   things off the silhouette, cut away from it by a jump in depth, that can be the garment's
    before [m]      length of the steps in depth inside the silhouette whose nearer side lies towards the outline

"Around" is as far as the missing cloth reaches. What can be the garment's lies below the held edge and no farther from
either of its ends than the corner on the flat garment.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.depth_surface import pixel_sd
from capture.silhouette import SQUARE_5, Silhouette
from formats.rig import Sensor

Floats = NDArray[np.float64]

FARTHEST, MORE = 0.25, 0.03  # m: missing cloth that is looked for, and what its measure may be short of
DEEPER = 1.5  # of that, in depth: the fold need not lie where it is looked for
LEAST_AROUND, MOST_AROUND = 6, 90  # px
BELOW = 0.04  # m below the held edge: above are bar, plates and hand
STRETCH, SLACK = 1.03, 0.02  # of a way on the flat garment, and m: the farthest that cloth can be from a held end
FEWEST_NEIGHBOURS = 4 / 9  # of 3 x 3 pixels off the silhouette; fewer are noise of the rim
STEP, STEP_NOISE = 0.015, 3.0  # m and pixel noises that are a step between two layers
HIGHEST_STEP = 0.3  # m, from cloth to cloth
REACH = 2  # px to the nearer side of a step, as `SQUARE_5` reaches
DEPTH_AROUND = 4  # px whose median is the depth of a place


class Layers(NamedTuple):
    """What else of the garment is seen around a place: see above."""

    peeking: float
    before: float


def other_layers(
    silhouette: Silhouette, pixel: Floats, missing: float, held: Floats, ways: Floats, sensor: Sensor
) -> Layers:
    """Return the other layers around a place on the outline.

    pixel [px of the image], (2,); missing [m]: how much cloth is; held [m], (2, 3): ends of the held edge; ways [m],
    (2,): from these to the corner on the flat garment.
    """
    u, v = int(pixel[0]) - silhouette.window.left, int(pixel[1]) - silhouette.window.top
    z = _depth_around(silhouette, u, v, float(held[:, 2].mean()))
    reach = min(missing, FARTHEST) + MORE
    far = int(np.clip(reach * sensor.fx / z, LEAST_AROUND, MOST_AROUND))
    around = slice(max(0, v - far), max(0, v + far + 1)), slice(max(0, u - far), max(0, u + far + 1))
    raw = silhouette.raw[around]
    if raw.size == 0:
        return Layers(0.0, 0.0)
    rows, columns = np.arange(raw.shape[0])[:, None], np.arange(raw.shape[1])
    allowed = cv2.inRange(raw, max(1, int(1e3 * (z - DEEPER * reach))), int(1e3 * (z + DEEPER * reach))) > 0
    allowed &= (rows + (around[0].start - v)) ** 2 + (columns + (around[1].start - u)) ** 2 <= far**2
    window = silhouette.window
    first = np.array([around[1].start + window.left, around[0].start + window.top], float)
    allowed &= _below(first, rows, columns, held, sensor, z)
    off = allowed & (silhouette.depth[around] == 0)
    off &= cv2.blur(off.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT) > FEWEST_NEIGHBOURS - 0.01
    peeking = _within(raw, off, first, held, ways, sensor)
    deep = raw - np.uint16(1)  # missing pixels wrap round to the farthest
    step = cv2.subtract(deep, cv2.erode(deep, SQUARE_5))
    least = 1e3 * (STEP + STEP_NOISE * pixel_sd(z, sensor.fx))
    mask = silhouette.mask[around]
    edge = allowed & (mask > 0) & (cv2.inRange(step, int(least) + 1, int(1e3 * HIGHEST_STEP)) > 0)
    edge = _within(raw, edge, first, held, ways, sensor)
    return Layers(
        float(np.count_nonzero(peeking)) * z**2 / (sensor.fx * sensor.fy),
        _nearer_outwards(deep, mask, edge) * z / sensor.fx,
    )


def _depth_around(silhouette: Silhouette, u: int, v: int, otherwise: float) -> float:
    near = slice(max(0, v - DEPTH_AROUND), max(0, v + DEPTH_AROUND + 1))
    depth = silhouette.depth[near, max(0, u - DEPTH_AROUND) : max(0, u + DEPTH_AROUND + 1)]
    depth = depth[depth > 0]
    return float(np.median(depth)) if depth.size else otherwise


def _below(
    first: Floats, rows: NDArray[np.intp], columns: NDArray[np.intp], held: Floats, sensor: Sensor, z: float
) -> NDArray[np.bool_]:
    """Mark what lies below the held edge; first [px of the image], (2,): the patch's first column and row."""
    (x0, y0), (x1, y1) = held[:, :2] / held[:, 2:] * [sensor.fx, sensor.fy] + [sensor.cx, sensor.cy]
    slope = (y1 - y0) / (x1 - x0) if abs(x1 - x0) > 1e-6 else 0.0
    return np.asarray(rows + first[1] > y0 + slope * (columns + first[0] - x0) + BELOW * sensor.fx / z)


def _within(
    raw: NDArray[np.uint16], chosen: NDArray[np.bool_], first: Floats, held: Floats, ways: Floats, sensor: Sensor
) -> NDArray[np.bool_]:
    """Leave of the chosen pixels those that are no farther from the held ends than the corner can be."""
    rows, columns = np.nonzero(chosen)
    z = raw[rows, columns] * 1e-3
    x, y = z * (columns + first[0] - sensor.cx) / sensor.fx, z * (rows + first[1] - sensor.cy) / sensor.fy
    away = np.sqrt(((np.stack([x, y, z], axis=1)[:, None] - held) ** 2).sum(-1))
    out = np.zeros(chosen.shape, bool)
    keep = (away < STRETCH * ways + SLACK).all(1)
    out[rows[keep], columns[keep]] = True
    return out


def _nearer_outwards(deep: NDArray[np.uint16], mask: NDArray[np.uint8], edge: NDArray[np.bool_]) -> int:
    """Count the pixels behind a step whose nearer side, within `REACH`, lies nearer to the outline than they."""
    rows, columns = np.nonzero(edge)
    if rows.size == 0:
        return 0
    inwards = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    steps = np.arange(-REACH, REACH + 1)
    down, across = (part.reshape(-1, 1) for part in np.meshgrid(steps, steps, indexing="ij"))
    near_rows = np.clip(rows + down, 0, deep.shape[0] - 1)
    near_columns = np.clip(columns + across, 0, deep.shape[1] - 1)
    nearest = deep[near_rows, near_columns].argmin(0)
    there = np.arange(rows.size)
    outer = inwards[near_rows[nearest, there], near_columns[nearest, there]]
    return int(np.count_nonzero(outer < inwards[rows, columns]))
