"""The interface of garment trackers: the result for one frame, and the choice of the corner finder.

A garment file's `kind` chooses a `CornerFinder` (`capture.garment.corners`), listed in `FINDERS`; a further kind of
garment is one class there and one line here. `capture.garment.tracker` treats the corners of all kinds alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from capture.garment.corners import CornerFinder, PanelCorners, ShirtCorners
from formats.arrays import Booleans, Floats, Unsigned
from formats.surface import SurfaceScan

# m, the target error of a corner. Half and double change no figure of nine scenes at 1.6 m (`benchmarks/tracking.py
# --set development-11`).
WELL_KNOWN = 8e-3
FINDERS: dict[str, type[CornerFinder]] = {"skirt": PanelCorners, "swatch": PanelCorners, "t-shirt": ShirtCorners}


@dataclass(frozen=True, kw_only=True)
class GarmentSight:
    """The tracked points of the garment in one frame, in the order of `garment.points`; NaN if missing.

    - `points` [m], (points, 3), sensor frame
    - `sd` [m], (points, 3)
    - `valid`, (points,): detected, with a plausible position
    - `hidden`, (points,): an object in front, a fold or the border of the image hides it. A point that is neither
      valid nor hidden was not detected, or its position is not plausible.
    - `pixels` [px], (points, 2)
    - `outline` [px], (n, 2): the silhouette, empty where the garment was not found
    - `quality`, 0 to 1: the points' mean certainty, times the share of the silhouette that has depth. A valid point's
      certainty is min(1, `WELL_KNOWN` / |sd|), and an invalid point's is 0.
    """

    points: Floats
    sd: Floats
    valid: Booleans
    hidden: Booleans
    pixels: Floats
    outline: Floats
    quality: float = 0.0

    @property
    def is_found(self) -> bool:
        """The garment's silhouette was found, with or without its points."""
        return len(self.outline) > 0


class GarmentTracker(Protocol):
    """Tracks one garment through a recording."""

    def track(self, depth: Unsigned, held: Floats, time: float, held_sd: Floats | None = None) -> GarmentSight:
        """Find the garment's points in one frame.

        - `depth` [mm], (H, W), 0 where missing
        - `held` [m], (2, 3): ends of the held edge, left first, sensor frame
        - `time` [s], increasing
        - `held_sd` [m], (2, 3): standard deviations of the markers that the held edge is attached to, if known
        """
        ...

    def scan(self, time: float, *, grid: int, contour: int) -> SurfaceScan | None:
        """Scan the visible surface of the last tracked frame; None if the garment was not found in it."""
        ...


def frame_quality(valid: Booleans, sd: Floats, filled: float) -> float:
    """Return a frame's quality, see `GarmentSight`; sd [m], (points, 3); filled: share of pixels with depth."""
    known = np.zeros(len(valid))
    known[valid] = np.minimum(1.0, WELL_KNOWN / np.maximum(np.linalg.norm(sd[valid], axis=1), 1e-9))
    return float(known.mean() * filled) if len(valid) else 0.0


def nothing_found(points: int) -> GarmentSight:
    """Return the result for a frame in which the garment was not found."""
    nowhere = np.full((points, 3), np.nan)
    return GarmentSight(
        points=nowhere,
        sd=nowhere.copy(),
        valid=np.zeros(points, dtype=bool),
        hidden=np.zeros(points, dtype=bool),
        pixels=np.full((points, 2), np.nan),
        outline=np.empty((0, 2)),
    )
