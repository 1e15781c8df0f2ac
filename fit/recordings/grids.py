"""Grids of silhouette points: detection of skewed grids, and the material position of each point in each frame.

A grid is skewed if its rows and columns do not meet at a right angle. With the medians r and c of the steps along rows
and columns of a frame,

    skew = arcsin (r . c / (|r| |c|))

Cloth at rest is not sheared. At rest, 623 frames of sixteen real takes (github Alados5/tfm_matlab) form two clusters.
One has a mean of 0.5 degrees and a deviation of 1.2, the other a mean of 5 degrees. `SKEWED` keeps the first cluster
whole.

A point's material position consists of two lengths along the cloth from the held edge. The length u runs along the
edge, to the foot of the point's perpendicular. The length w runs down the cloth from that foot, along the point's
column, without the part of each step along the edge:

    w_0 = (x_0 - foot_0) . down,   w_k = w_k-1 + |q_k - q_k-1|,   q = x less its part along the edge

The cloth is then interpolated at the nominal positions, linearly over triangles of these points. A position that the
silhouette does not cover is not seen. Errors along a column, in the plane of the cloth, are no longer visible after
this step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.runtime import one_thread_of_algebra
from formats.arrays import Floats, Integers
from formats.garment import Garment

# degrees: three deviations of an unskewed grid at rest. On the 16 public recordings of swung cloth this leaves 18 % of
# the frames out. Half leaves 33 % out and calls two silhouettes material; double leaves 3 % out.
SKEWED = 4.0
# rows, and columns; our choice: two of them are inner ones. Half and double read the public grids, of 8 by 8 points.
FEWEST_LINES = 4
# of the cloth's extent: positions within this distance share a row or column. Half and double find the same rows and
# columns in the public recordings.
SAME_LINE_SHARE = 0.02
FEWEST_IN_COLUMN = 3  # points of a column, or columns of a row; our choice: any two are in line
FEWEST_PLACED = 12  # points, or steps between neighbours; our choice: four lines of three


@dataclass(frozen=True)
class Grid:
    """A complete grid of tracked points; at, (rows, columns): point indices, the row nearest to the held edge first.

    across [m], (columns,): positions along the held edge from its left end; down [m], (rows,): below the edge
    """

    at: Integers
    across: Floats
    down: Floats


def grid_of(garment: Garment) -> Grid | None:
    """Return the grid that a garment's points form; None if it is incomplete or the held edge is not level."""
    places = np.array([p.at_m for p in garment.points])
    ends = np.asarray(garment.outline_m[:2], float)
    if len(places) < FEWEST_LINES**2 or abs(ends[1, 1] - ends[0, 1]) > 1e-6:
        return None
    extent = float(np.ptp(places, axis=0).max())
    column, across = _lines(places[:, 0] - ends[0, 0], SAME_LINE_SHARE * extent)
    row, down = _lines(ends[0, 1] - places[:, 1], SAME_LINE_SHARE * extent)
    if min(len(across), len(down)) < FEWEST_LINES or len(across) * len(down) != len(places):
        return None
    at = np.full((len(down), len(across)), -1)
    at[row, column] = np.arange(len(places))
    return Grid(at, across, down) if (at >= 0).all() else None


def skew_degrees(points: Floats, grid: Grid) -> Floats:
    """Return the grid's skew in each frame [degrees], (frames,), NaN where hardly any grid point is seen."""
    laid = points[:, grid.at]
    steps = [np.diff(laid, axis=axis).reshape(len(points), -1, 3) for axis in (2, 1)]
    seen = [np.isfinite(step).all(2).sum(1) >= FEWEST_PLACED for step in steps]
    usable = seen[0] & seen[1]
    skew = np.full(len(points), np.nan)
    row, column = (np.nanmedian(step[usable], axis=1) for step in steps)
    cosine = (row * column).sum(1) / np.maximum(np.linalg.norm(row, axis=1) * np.linalg.norm(column, axis=1), 1e-12)
    skew[usable] = np.degrees(np.arcsin(np.clip(cosine, -1, 1)))
    return skew


def placed(points: Floats, ends: Floats, grid: Grid) -> Floats:
    """Return the cloth at the grid's nominal positions [m], (frames, points, 3), NaN where not covered.

    points [m], (frames, points, 3); ends [m], (frames, 6), of the held edge, as long as it is on the flat cloth
    """
    found = np.full(points.shape, np.nan)
    with one_thread_of_algebra():  # on a busy machine, several threads would wait for each other at every triangle
        for frame, laid in enumerate(points[:, grid.at]):
            found[frame, grid.at] = _placed(laid, ends[frame].reshape(2, 3), grid)
    return found


def length_seen(points: Floats, ends: Floats, grid: Grid) -> Floats:
    """Return the length down the cloth to the grid's last row in each frame [m], (frames,), NaN where unseen."""
    found = np.full(len(points), np.nan)
    for frame, laid in enumerate(points[:, grid.at]):
        last = _ways(laid, ends[frame].reshape(2, 3))[1][-1]
        if np.isfinite(last).sum() >= FEWEST_IN_COLUMN:
            found[frame] = np.nanmedian(last)
    return found


def _placed(laid: Floats, ends: Floats, grid: Grid) -> Floats:
    """Return `placed` for one frame, (rows, columns, 3)."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    across, down = _ways(laid, ends)
    usable = np.isfinite(down)
    read = np.full(laid.shape, np.nan)
    if usable.sum() >= FEWEST_PLACED:
        wanted = np.stack(np.meshgrid(grid.across, grid.down), 2)
        try:
            read = LinearNDInterpolator(np.stack([across[usable], down[usable]], 1), laid[usable])(wanted)
        except QhullError:  # all of them on a line
            return read
    return np.asarray(read)


def _ways(laid: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """Return lengths along edge and cloth [m], (rows, columns) each, NaN where a column is hardly seen."""
    bar = ends[1] - ends[0]
    bar = bar / np.linalg.norm(bar)
    across = (laid - ends[0]) @ bar
    square = laid - across[..., None] * bar
    down = np.full(laid.shape[:2], np.nan)
    for column in range(laid.shape[1]):
        seen = np.flatnonzero(np.isfinite(laid[:, column]).all(1))
        if len(seen) < FEWEST_IN_COLUMN:
            continue
        path = square[seen, column]
        way = path[-1] - path[0]
        first = (laid[seen[0], column] - ends[0]) @ way / max(float(np.linalg.norm(way)), 1e-9)  # square to the bar
        down[seen, column] = first + np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return across, down


def _lines(values: Floats, apart: float) -> tuple[Integers, Floats]:
    """Cluster values into lines, smallest first; return each value's line number and each line's position."""
    order = np.argsort(values, kind="stable")
    number = np.concatenate([[0], np.cumsum(np.diff(values[order]) > apart)])
    line = np.empty(len(values), np.int64)
    line[order] = number
    return line, np.array([values[line == k].mean() for k in range(int(number[-1]) + 1)])
