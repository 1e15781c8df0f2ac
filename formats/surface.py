"""A scan of the visible surface: a grid of places on it and its silhouette's contour, at one instant of a take.

Neither are material points: an untextured garment does not show which thread is where. Cell (i, j) of the grid lies at
fixed fractions of the way along the silhouette's sides, and contour place k at a fixed fraction of the way around it
(`capture.garment.surface_scan`); what is fixed on the cloth only follows that as far as the silhouette does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from formats.arrays import Floats
from formats.columns import pack, pack_flags, unpack, unpack_flags

STEP = 1e-4  # m, as the other positions of a take
TIME_STEP = 1e-6  # s


@dataclass(frozen=True, kw_only=True)
class SurfaceScan:
    """The visible surface at `time` [s], sensor frame; NaN where it was not seen.

    grid [m], (n, n, 3): rows from the top side to the bottom, columns from left to right; contour [m], (k, 3):
    clockwise as the sensor sees it, from the top left corner
    """

    time: float
    grid: Floats
    contour: Floats


def encode_scan(scan: SurfaceScan) -> dict[str, Any]:
    """Return a scan as the content of a `/surface` message."""
    grid = scan.grid.reshape(-1, 3)
    return {
        "surface": round(scan.time / TIME_STEP),
        "grid_size": len(scan.grid),
        "contour_size": len(scan.contour),
        "grid": pack(grid, STEP),
        "grid_valid": pack_flags(np.asarray(np.isfinite(grid).all(1))),
        "contour": pack(scan.contour, STEP),
        "contour_valid": pack_flags(np.asarray(np.isfinite(scan.contour).all(1))),
    }


def decode_scan(content: dict[str, Any]) -> SurfaceScan:
    """Return the scan of a `/surface` message.

    Raises:
        ValueError, KeyError, TypeError: the content does not hold together.
    """
    size, count, time = content["grid_size"], content["contour_size"], content["surface"]
    if not all(type(number) is int for number in (size, count, time)) or min(size, count) < 0:
        raise ValueError(f"sizes {size!r} and {count!r} at {time!r} are not whole numbers")
    grid = unpack(content["grid"], (size * size, 3), STEP)
    grid[~unpack_flags(content["grid_valid"], (size * size,))] = np.nan
    contour = unpack(content["contour"], (count, 3), STEP)
    contour[~unpack_flags(content["contour_valid"], (count,))] = np.nan
    return SurfaceScan(time=time * TIME_STEP, grid=grid.reshape(size, size, 3), contour=contour)
