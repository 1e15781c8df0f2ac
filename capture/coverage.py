"""How far a corner of the garment lies beyond the cloth that is seen, told by ways along the cloth.

Cloth hardly stretches, so a place q on it is as far from the two held ends along the seen surface as on the flat
garment. The corner i, which on the flat garment is D_ei away from the held end e, is therefore

    beyond_i = min over q of sqrt(1/2 sum_e (d_e(q) - D_ei)^2)        [m]

beyond the nearest place q of the cloth that is seen: nearly 0 for a corner in view, wherever the outline has it, and
the depth of the fold for one that is folded away. Only places near the rim of the silhouette are looked at, pixel by
pixel: there cloth that turns away steeply is lost in the block means of `capture.geodesic`. A pixel's way leads over
the nearest nodes,

    d_e(q) = min over nodes n near q of d_e(n) + |q - n|
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.geodesic import geodesic_distances
from capture.silhouette import Silhouette
from formats.rig import Sensor

Floats = NDArray[np.float64]

RIM = 6  # px inwards from the outline: two fifths of a node's block at 1.6 m
STRIDE = 2  # every so many pixels along both axes
NEAR = 2  # nodes to every side whose ways are taken on to a pixel
RIM_KERNEL = np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)
NOWHERE = 9.0  # m, more than any garment: no way leads to any place


def beyond_the_seen(
    silhouette: Silhouette, surface: Floats, cell: int, held: Floats, wanted: Floats, sensor: Sensor
) -> Floats:
    """Return how far each corner lies beyond the visible cloth [m], (corners,).

    surface [m], (rows, columns, 3): grid of the seen surface, a node every `cell` pixels; held [m], (2, 3): ends of the
    held edge; wanted [m], (2, corners): ways from these ends to the corners on the flat garment.
    """
    ways = geodesic_distances(surface, held)[0].astype(np.float64)
    places, rows, columns = _rim_places(silhouette, sensor)
    grid_rows, grid_columns = surface.shape[:2]
    if places.size == 0 or min(grid_rows, grid_columns) == 0:
        return np.full(wanted.shape[1], NOWHERE)
    steps = np.arange(-NEAR, NEAR + 1)
    down, across = (part.reshape(-1, 1) for part in np.meshgrid(steps, steps, indexing="ij"))
    node_rows = np.clip(rows // cell + down, 0, grid_rows - 1)
    node_columns = np.clip(columns // cell + across, 0, grid_columns - 1)
    last = np.sqrt(((surface[node_rows, node_columns] - places) ** 2).sum(-1))
    last[~np.isfinite(last)] = np.inf
    reached = (ways[:, node_rows, node_columns] + last).min(1)
    off = np.sqrt(((reached[:, None] - wanted[:, :, None]) ** 2).mean(0)).min(1)
    return np.asarray(np.minimum(off, NOWHERE))


def _rim_places(silhouette: Silhouette, sensor: Sensor) -> tuple[Floats, NDArray[np.intp], NDArray[np.intp]]:
    """Return cloth near the rim [m], (places, 3), and its rows and columns [px of the window]."""
    inner = cv2.erode(silhouette.mask, RIM_KERNEL, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    part = (slice(None, None, STRIDE), slice(None, None, STRIDE))
    rows, columns = np.nonzero((silhouette.depth[part] > 0) & (inner[part] == 0))
    rows, columns = STRIDE * rows, STRIDE * columns
    z = silhouette.depth[rows, columns].astype(np.float64)
    x = z * (columns + silhouette.window.left - sensor.cx) / sensor.fx
    y = z * (rows + silhouette.window.top - sensor.cy) / sensor.fy
    return np.stack([x, y, z], axis=-1), rows, columns
