"""Outline distance O between simulated and tracked cloth, which is insensitive to sliding along the edge.

Seen from the front, the tracked points on the garment's edge make a polygon in every frame. With points p of the one
and the polygon P of the other,

    O = 1/2 (mean of |p_seen, P_simulated| + mean of |p_simulated, P_seen|)        [m]

So a point may slide along the edge at no cost, because an image does not identify points along an edge. Frames in which
a point of the edge is not seen are left out. Held points count too; they agree in any case.

Sources: K. S. Bhat et al., "Estimating cloth simulation parameters from video" (SCA 2003); N. Hasler et al.,
"Physically based tracking of cloth" (VMV 2006). Both compare the fabric's silhouette in pictures. We compare polygons
of tracked points, which are the silhouette of cloth without deep folds.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from fit.errors import FitError
from fit.recordings.held_edge import place_along
from fit.recordings.recording import Recording
from formats.arrays import Floats, Integers

FEWEST_CORNERS_SEEN = 4  # points of an outline; our choice: the corners of a panel
FRONT_AXES = [0, 2]  # axes of the world frame in a view from the front
DISTANCES_AT_ONCE = 2_000_000  # in one batch; our choice: 16 MB an array, and no result depends on it


class OutlineDistance:
    """O against one recording."""

    name: ClassVar[str] = "O"
    unit: ClassVar[str] = "m"
    parts: ClassVar[tuple[str, ...]] = ("outline",)

    def __init__(self, recording: Recording) -> None:
        """Find the tracked points on the garment's outline.

        Raises:
            FitError: the garment has too few of them, or they are never seen together.
        """
        self._edge = _on_edge(recording)
        seen = recording.points[:, self._edge]
        self._frames = np.flatnonzero(np.isfinite(seen).all((1, 2)))
        if len(self._edge) < FEWEST_CORNERS_SEEN or not len(self._frames):
            raise FitError(
                f"{len(self._edge)} tracked points are on the garment's edge, and in {len(self._frames)} frames all of "
                "them are seen", where=recording.take_id, advice="fit to the points: --method si",
            )  # fmt: skip
        self._seen = seen[self._frames][..., FRONT_AXES]
        self.remark = ""

    def terms(self, simulated: Floats) -> Floats:
        """Return O [m], (candidates, 1)."""
        edge = simulated[:, self._frames][:, :, self._edge][..., FRONT_AXES]
        return np.array([[self._between(one)] for one in edge])

    def _between(self, edge: Floats) -> float:
        if not np.isfinite(edge).all():
            return np.inf
        return 0.5 * float(to_polygon(self._seen, edge).mean() + to_polygon(edge, self._seen).mean())


def _on_edge(recording: Recording) -> Integers:
    """Return the tracked points on the garment's outline, in their order along it."""
    outline = np.array(recording.garment.outline_m)
    places = np.array([p.at_m for p in recording.garment.points])
    order: list[int] = []
    for side in np.stack([outline, np.roll(outline, -1, 0)], 1):
        share, is_on = place_along(places, side)
        found = np.flatnonzero(is_on)
        order += [int(k) for k in found[np.argsort(share[found])] if k not in order]
    return np.array(order, dtype=int)  # also without any


def to_polygon(points: Floats, corners: Floats) -> Floats:
    """Return distances [m], (frames, points), of points, (frames, points, 2), from closed polygons of corners."""
    found = []
    some = max(DISTANCES_AT_ONCE // (points.shape[1] * corners.shape[1]), 1)
    for first in range(0, len(points), some):
        p, a = points[first : first + some, :, None], corners[first : first + some, None]
        way = np.roll(a, -1, 2) - a
        square = np.maximum((way**2).sum(-1), 1e-18)
        share = np.clip(((p - a) * way).sum(-1) / square, 0.0, 1.0)
        found.append(np.linalg.norm(p - a - share[..., None] * way, axis=-1).min(-1))
    return np.concatenate(found)
