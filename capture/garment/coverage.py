"""The geodesic distance of a garment's corner from the visible cloth: how much cloth is hidden at the corner.

Cloth hardly stretches. So a point q on the cloth has the same geodesic distance to an anchor on the seen surface as on
the flat garment. Anchors are the two held ends and every detected corner. Corner i is D_ai away from anchor a on the
flat garment, and is

    beyond_i = min over q of sqrt(mean over a of (d_a(q) - D_ai)^2)        [m]

beyond the nearest point q of the seen cloth. The result is nearly 0 for a corner in view, anywhere on the outline. For
a corner that is folded away, the result is the length of the folded cloth. Only points near the silhouette's edge
count, pixel by pixel. The block means of `capture.garment.geodesic` lose cloth that turns away steeply there. A pixel's
distance follows from the nearest nodes,

    d_a(q) = min over nodes n near q of d_a(n) + |q - n|
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.garment.geodesic import geodesic_distances
from capture.garment.silhouette import Silhouette
from formats.arrays import Booleans, Floats, Singles
from formats.rig import Sensor

# px inwards from the outline: two fifths of a node's block at 1.6 m. Our choice: half and double change no figure of
# the nine scenes that `NEIGHBOUR_NODES` names.
INNER_RIM = 6
PIXEL_STRIDE = 2  # px along both axes between those considered; our choice: a quarter of the cost; the rim is 6 px wide
# nodes to every side from which a distance is extended to a pixel. Our choice: 25 nodes, as of the parabolas of
# `geodesic`. On nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`) 97 % of the corners called hidden
# are hidden, and 91 % of the hidden ones are found. Half gives 99 and 91 %, double 95 and 96 %.
NEIGHBOUR_NODES = 2
INNER_RIM_KERNEL = np.ones((2 * INNER_RIM + 1, 2 * INNER_RIM + 1), np.uint8)  # px: erodes by INNER_RIM
NOWHERE = 9.0  # m, more than any garment: marks an unreachable point


@dataclass(frozen=True)
class SeenWays:
    """The visible surface and the geodesic distances along it.

    - `surface` [m], (rows, columns, 3): a node every `cell` pixels
    - `held` [m], (2, 3): ends of the held edge
    - `from_corners` [m], (4, rows, columns): distances from the corners to the nodes
    - `found`, (4,): whether a corner is detected and trusted
    """

    surface: Floats
    cell: int
    held: Floats
    from_corners: Singles
    found: Booleans


@dataclass(frozen=True)
class Beyond:
    """Each corner's distance beyond the visible cloth [m], (4,), by the held ends alone and by all trusted anchors.

    - `pixels` [px of the image], (4, 2): the visible point nearest to the corner by the held ends
    - `places` [m], (4, 3): the visible point nearest to it by all trusted anchors; NaN if no cloth is visible
    """

    by_ends: Floats
    by_all: Floats
    pixels: Floats
    places: Floats


def beyond_the_seen(
    silhouette: Silhouette, ways: SeenWays, from_ends: Floats, distances: Floats, sensor: Sensor
) -> Beyond:
    """Return each corner's distance beyond the visible cloth.

    On the flat garment: from_ends [m], (2, 4), distances from the held ends to the corners; distances [m], (4, 4),
    between the corners.
    """
    places, rows, columns = _rim_places(silhouette, sensor)
    if places.size == 0 or min(ways.surface.shape[:2]) == 0:
        return Beyond(np.full(4, NOWHERE), np.full(4, NOWHERE), np.full((4, 2), np.nan), np.full((4, 3), np.nan))
    maps = np.concatenate([geodesic_distances(ways.surface, ways.held)[0], ways.from_corners[ways.found]])
    wanted = np.concatenate([from_ends, distances[ways.found]])
    reached = _ways_to(places, rows, columns, maps, ways)
    squares = np.minimum((reached[:, None] - wanted[:, :, None]) ** 2, NOWHERE**2)
    by_ends = np.sqrt(squares[:2].mean(0))
    # A detected corner is not its own anchor.
    own = np.zeros(wanted.shape)
    own[2 + np.arange(np.count_nonzero(ways.found)), np.flatnonzero(ways.found)] = 1.0
    by_all = np.sqrt((squares * (1.0 - own)[:, :, None]).sum(0) / (1.0 - own).sum(0)[:, None])
    nearest = by_ends.argmin(1)
    pixels = np.stack([columns[nearest] + silhouette.window.left, rows[nearest] + silhouette.window.top], axis=1)
    return Beyond(by_ends.min(1), by_all.min(1), pixels.astype(np.float64), places[by_all.argmin(1)])


def _ways_to(
    places: Floats, rows: NDArray[np.intp], columns: NDArray[np.intp], maps: Singles, ways: SeenWays
) -> Floats:
    """Return the distances [m], (maps, points), to points between the nodes; `NOWHERE` if unreachable."""
    steps = np.arange(-NEIGHBOUR_NODES, NEIGHBOUR_NODES + 1)
    down, across = (part.reshape(-1, 1) for part in np.meshgrid(steps, steps, indexing="ij"))
    node_rows = np.clip(rows // ways.cell + down, 0, ways.surface.shape[0] - 1)
    node_columns = np.clip(columns // ways.cell + across, 0, ways.surface.shape[1] - 1)
    last = np.sqrt(((ways.surface[node_rows, node_columns] - places) ** 2).sum(-1)).astype(np.float32)
    last[~np.isfinite(last)] = NOWHERE
    return np.asarray(np.minimum((maps[:, node_rows, node_columns] + last).min(1), NOWHERE), np.float64)


def _rim_places(silhouette: Silhouette, sensor: Sensor) -> tuple[Floats, NDArray[np.intp], NDArray[np.intp]]:
    """Return points of the cloth near its edge [m], (points, 3), and their rows and columns [px of the window]."""
    inner = cv2.erode(silhouette.mask, INNER_RIM_KERNEL, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    part = (slice(None, None, PIXEL_STRIDE), slice(None, None, PIXEL_STRIDE))
    rows, columns = np.nonzero((silhouette.depth[part] > 0) & (inner[part] == 0))
    rows, columns = PIXEL_STRIDE * rows, PIXEL_STRIDE * columns
    z = silhouette.depth[rows, columns].astype(np.float64)
    x = z * (columns + silhouette.window.left - sensor.cx) / sensor.fx
    y = z * (rows + silhouette.window.top - sensor.cy) / sensor.fy
    return np.stack([x, y, z], axis=-1), rows, columns
