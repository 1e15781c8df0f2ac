"""A scan of the visible surface: a grid of positions and the silhouette's contour, at one instant of a take.

The positions are no material points, since an untextured garment does not show its threads. Cell (i, j) of the grid
lies at fixed fractions of the silhouette's sides. Contour position k lies at a fixed fraction of the silhouette's
perimeter (`capture.garment.surface_scan`). They follow the cloth only as far as the silhouette does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE, LATEST, TICKS, as_arrays
from formats.errors import TakeError
from formats.integers import decode_tables, encode_tables

PLACE_STEP = 1e-4  # m; our choice: a tenth of the millimetre of a depth image
LARGEST_GRID = 512  # positions along a side: more than a depth sensor has on a garment
# around the silhouette. Our choice: above the border of an image of 640 x 480, so that only a damaged file has more.
MOST_OUTLINE_PLACES = 65536


@dataclass(frozen=True, kw_only=True, repr=False)
class SurfaceScan:
    """The visible surface at `time` [s], sensor frame; NaN where it was not seen.

    - `grid` [m], (n, n, 3): rows from the top side to the bottom, columns from left to right
    - `contour` [m], (k, 3): clockwise as the sensor sees it, from the top left corner
    """

    time: float
    grid: Floats
    contour: Floats

    def __repr__(self) -> str:
        """Return the instant and the number of places."""
        return (
            f"SurfaceScan(at {self.time:.2f} s, {len(self.grid)} x {len(self.grid)} places, {len(self.contour)} around)"
        )


def encode_scan(scan: SurfaceScan) -> dict[str, Any]:
    """Return a scan as the content of a `/surface` message.

    Raises:
        TakeError: the scan has another shape or other values, too many positions, or a position that is too far away.
    """
    arrays = as_arrays({"time": scan.time, "grid": scan.grid, "contour": scan.contour}, "a scan")
    grid, contour = arrays["grid"], arrays["contour"]
    if arrays["time"].ndim or grid.shape[2:] != (3,) or contour.shape[1:] != (3,):
        raise TakeError(
            f"time, grid and contour have shapes {arrays['time'].shape}, {grid.shape} and {contour.shape}",
            where="a scan", advice="give a number, a square of places, (n, n, 3), and a row of places, (k, 3)",
        )  # fmt: skip
    time, size, count = float(arrays["time"]), len(grid), len(contour)
    where = f"scan at {time:g} s"
    if size > LARGEST_GRID or count > MOST_OUTLINE_PLACES or grid.shape[:2] != (size, size):
        raise TakeError(
            f"has {grid.shape[:2]} places and {count} around them", where=where,
            advice=f"give a square of at most {LARGEST_GRID} a side and at most {MOST_OUTLINE_PLACES} around it",
        )  # fmt: skip
    if not abs(time) <= LATEST / TICKS:
        raise TakeError("lies centuries away", where=where, advice="give its time in seconds")
    return {
        "surface": round(time * TICKS),
        "grid_size": size,
        "contour_size": count,
        "grid": _coded(grid.reshape(-1, 3), where),
        "contour": _coded(contour, where),
    }


def _coded(places: Floats, where: str) -> bytes:
    """Return positions as the bytes of a table: x, y, z in steps, and whether the position was seen."""
    if not len(places):
        return b""
    if np.isinf(places).any():
        raise TakeError("a place is infinite", where=where, advice="give NaN where nothing was seen")
    seen = np.asarray(np.isfinite(places).all(1))
    if (np.isfinite(places).any(1) & ~seen).any():
        raise TakeError("a place lacks a coordinate", where=where, advice="give NaN for all three where it is unseen")
    shown = np.where(seen[:, None], places, 0.0)
    if np.abs(shown).max() > FARTHEST_PLACE:
        raise TakeError(f"a place lies {np.abs(shown).max():g} m away", where=where, advice="give metres")
    last = np.maximum.accumulate(np.where(seen, np.arange(len(places)), 0))
    whole = np.rint(shown[last] / PLACE_STEP).astype(np.int64)
    return encode_tables(np.column_stack([whole, seen]), np.array([len(places)]))[0]


def places_of(content: dict[str, Any]) -> int:
    """Return the number of positions that a `/surface` message states.

    Raises:
        ValueError, KeyError: the number is missing or impossible.
    """
    size, count = content["grid_size"], content["contour_size"]
    if (
        type(size) is not int
        or type(count) is not int
        or not (0 <= size <= LARGEST_GRID and 0 <= count <= MOST_OUTLINE_PLACES)
    ):
        raise ValueError(f"{size!r} x {size!r} places and {count!r} around them cannot be")
    return size * size + count


def decode_scan(content: dict[str, Any]) -> SurfaceScan:
    """Return the scan of a `/surface` message.

    Raises:
        ValueError, KeyError, TypeError: the content is malformed.
    """
    places_of(content)  # raises if the sizes are impossible
    size, count, time = content["grid_size"], content["contour_size"], content["surface"]
    if type(time) is not int or abs(time) > LATEST:
        raise ValueError(f"{time!r} is no time")
    grid = _places(content["grid"], size * size)
    return SurfaceScan(time=time / TICKS, grid=grid.reshape(size, size, 3), contour=_places(content["contour"], count))


def _places(raw: object, count: int) -> Floats:
    """Return `count` positions, NaN where not seen."""
    if not isinstance(raw, bytes):
        raise TypeError("places are bytes")
    if not count:
        return np.empty((0, 3))
    table, sound = decode_tables([raw], np.array([count]), 4)
    if not sound.all():
        raise ValueError(f"{len(raw)} bytes do not hold {count} places")
    places = np.asarray(table[:, :3] * PLACE_STEP, float)
    places[table[:, 3] == 0] = np.nan
    return places
