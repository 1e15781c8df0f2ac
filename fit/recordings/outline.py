"""Erosion of a silhouette's outline, at rest and by pose, from lengths of its grid along the cloth.

A silhouette's grid ends at the outermost cloth that the camera sees. Its last row then lies nearer to the held edge
than on the flat cloth, and its sides lie nearer to each other:

    length_f = l - b - a (g_f - median at rest),   width = w - 2 s

with the flat cloth's length l and width w, the erosion b at the bottom, and s at each side. The lean g_f is the mean of
the unit steps down the grid along n = up x bar. The loss by pose a is positive if cloth that leans along n is eroded,
as in the effect `eroded_outline`. Length and slope come from a robust line (`fit.recordings.robust_line`). The estimate
needs no simulation.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from fit.recordings.grids import Grid
from fit.recordings.hanger_path import level_normal
from fit.recordings.robust_line import FEWEST_BLOCKS_ON_A_LINE, interval_of, robust_line, seconds_apart
from formats.arrays import Floats

# Standard deviation of the lean [1], a swing of 2 degrees, from which a slope is estimated. Our choice: beyond the
# 0.004 that noise of 2 mm makes on 0.45 m. Half and double change no finding on the public recordings.
LEAST_SWING = 0.02
# between neighbours down the grid, that a frame must show. Our choice: four columns of three. Half and double change no
# finding on the 16 public recordings of swung cloth.
FEWEST_SEGMENTS = 12


@dataclass(frozen=True)
class Outline:
    """Erosion of an outline at its borders, with 90 % intervals.

    - `bottom` [m]: of the border opposite to the held edge
    - `side` [m]: of each border beside it
    - `by_pose` [m]: loss of the bottom border per unit of lean; None for cloth that hardly leans
    """

    bottom: float
    bottom_interval: tuple[float, float]
    side: float
    side_interval: tuple[float, float]
    by_pose: float | None = None
    by_pose_interval: tuple[float, float] | None = None


def find_outline(time: Floats, points: Floats, ends: Floats, length: Floats, grid: Grid) -> Outline | None:
    """Return the erosion of a grid's outline; None if too few frames show the grid.

    - `time` [s], (frames,)
    - `points` [m], (frames, points, 3): as tracked, NaN where not seen
    - `ends` [m], (frames, 6): of the held edge
    - `length` [m], (frames,): down to the grid's last row (`fit.recordings.grids.length_seen`)
    """
    lean, width = lean_of(points, ends, grid), _width(points, ends, grid)
    seen = np.isfinite(lean) & np.isfinite(length) & np.isfinite(width)
    block = seconds_apart(time[seen])
    if len(np.unique(block)) < FEWEST_BLOCKS_ON_A_LINE:
        return None
    leans = lean[seen] - np.median(lean[seen])
    columns = [np.ones(int(seen.sum()))]
    if has_slope := bool(leans.std() > LEAST_SWING):
        columns.append(leans)
    design = np.stack(columns, 1)
    short = grid.down[-1] - length[seen]
    bottom, spread = robust_line(design, short, block)
    side, side_spread = robust_line(design[:, :1], (np.ptp(grid.across) - width[seen]) / 2, block)
    found = Outline(
        float(bottom[0]), interval_of(bottom[0], spread[0]), float(side[0]), interval_of(side[0], side_spread[0])
    )
    if not has_slope:
        return found
    return Outline(
        found.bottom, found.bottom_interval, found.side, found.side_interval,
        float(bottom[1]), interval_of(bottom[1], spread[1]),
    )  # fmt: skip


def lean_of(points: Floats, ends: Floats, grid: Grid) -> Floats:
    """Return the lean of the cloth along the held edge's level normal, (frames,), NaN where little cloth is seen."""
    down = np.diff(points[:, grid.at], axis=1)
    with np.errstate(invalid="ignore"):
        down = down / np.linalg.norm(down, axis=3, keepdims=True)
    along = np.einsum("frcx,fx->frc", down, level_normal(ends)).reshape(len(points), -1)
    known = np.isfinite(along).sum(1) >= FEWEST_SEGMENTS
    lean = np.full(len(points), np.nan)
    lean[known] = np.nanmean(along[known], axis=1)
    return lean


def _width(points: Floats, ends: Floats, grid: Grid) -> Floats:
    """Return the distance of the outermost columns along the held edge [m], (frames,), the median over rows."""
    bar = ends[:, 3:] - ends[:, :3]
    bar = bar / np.linalg.norm(bar, axis=1, keepdims=True)
    apart = np.einsum("frx,fx->fr", points[:, grid.at[:, -1]] - points[:, grid.at[:, 0]], bar)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without a grid
        return np.asarray(np.nanmedian(apart, axis=1))
