"""The area of the garment that is visible behind its own edge near one point, where a folded corner may show.

    peeking [m^2]   surfaces off the silhouette, separated by a jump in depth, that may belong to the garment

around the place, as far as the missing cloth reaches. These things lie below the held edge. They are no farther from
either of its ends than the corner on the flat garment.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.garment.silhouette import Silhouette, square_around
from formats.arrays import Booleans, Floats, Unsigned
from formats.rig import Sensor

# m: bound on the missing cloth that is searched for, and its tolerance. Half and double change no figure of nine scenes
# at 1.6 m (`benchmarks/tracking.py --set development-11`).
FARTHEST_MISSING, MORE = 0.25, 0.03
# times the search radius, in depth: a fold may lie elsewhere. On the same scenes 97 % of the corners
# called hidden are hidden. Half gives 94 %, and double changes nothing.
DEEPER = 1.5
# px, bounds on the search radius. Our choice: for a focal length of 576 px the least radius is 6 px at 2.9 m. The
# largest radius is 90 px at 1.8 m. Half and double change no figure of the same scenes.
LEAST_AROUND, MOST_AROUND = 6, 90
# m below the held edge: above are bar, plates and hand. Half and double change no figure of the same scenes.
BELOW = 0.04
# Of a distance on the flat garment, and m: bound on the cloth's distance to a held end.
STRETCH_BOUND, SLACK = 1.03, 0.02
LEAST_SHARE_OUTSIDE = 4 / 9  # of 3 x 3 pixels off the silhouette; fewer are noise of the edge
DEPTH_AROUND = 4  # px whose median is the depth of a point; half and double change no figure of the same scenes


def peeking_area(
    silhouette: Silhouette, pixel: Floats, missing: float, held: Floats, ways: Floats, sensor: Sensor
) -> float:
    """Return the area [m^2] that peeks out around a point on the outline.

    - `pixel` [px of the image], (2,)
    - `missing` [m]: length of the missing cloth
    - `held` [m], (2, 3): ends of the held edge
    - `ways` [m], (2,): distances from these ends to the corner on the flat garment
    """
    u, v = int(pixel[0]) - silhouette.window.left, int(pixel[1]) - silhouette.window.top
    z = _depth_around(silhouette, pixel, float(held[:, 2].mean()))
    reach = min(missing, FARTHEST_MISSING) + MORE
    far = int(np.clip(reach * sensor.fx / z, LEAST_AROUND, MOST_AROUND))
    around = square_around(silhouette, pixel, far)
    raw = silhouette.raw[around]
    if raw.size == 0:
        return 0.0
    rows, columns = np.arange(raw.shape[0])[:, None], np.arange(raw.shape[1])
    off = cv2.inRange(raw, max(1, int(1e3 * (z - DEEPER * reach))), int(1e3 * (z + DEEPER * reach))) > 0
    off &= (rows + (around[0].start - v)) ** 2 + (columns + (around[1].start - u)) ** 2 <= far**2
    window = silhouette.window
    first = np.array([around[1].start + window.left, around[0].start + window.top], float)
    off &= _below(first, rows, columns, held, sensor, z) & (silhouette.depth[around] == 0)
    off &= cv2.blur(off.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT) > LEAST_SHARE_OUTSIDE - 0.01
    return _count_within(raw, off, first, held, ways, sensor) * z**2 / (sensor.fx * sensor.fy)


def _depth_around(silhouette: Silhouette, pixel: Floats, otherwise: float) -> float:
    depth = silhouette.depth[square_around(silhouette, pixel, DEPTH_AROUND)]
    depth = depth[depth > 0]
    return float(np.median(depth)) if depth.size else otherwise


def _below(
    first: Floats, rows: NDArray[np.intp], columns: NDArray[np.intp], held: Floats, sensor: Sensor, z: float
) -> Booleans:
    """Mark the pixels below the held edge; first [px of the image], (2,): the patch's first column and row."""
    (x0, y0), (x1, y1) = held[:, :2] / held[:, 2:] * [sensor.fx, sensor.fy] + [sensor.cx, sensor.cy]
    slope = (y1 - y0) / (x1 - x0) if abs(x1 - x0) > 1e-6 else 0.0
    return np.asarray(rows + first[1] > y0 + slope * (columns + first[0] - x0) + BELOW * sensor.fx / z)


def _count_within(raw: Unsigned, chosen: Booleans, first: Floats, held: Floats, ways: Floats, sensor: Sensor) -> int:
    """Count the chosen pixels that are no farther from the held ends than the corner can be."""
    rows, columns = np.nonzero(chosen)
    z = raw[rows, columns] * 1e-3
    x, y = z * (columns + first[0] - sensor.cx) / sensor.fx, z * (rows + first[1] - sensor.cy) / sensor.fy
    away = np.sqrt(((np.stack([x, y, z], axis=1)[:, None] - held) ** 2).sum(-1))
    return int(np.count_nonzero((away < STRETCH_BOUND * ways + SLACK).all(1)))
