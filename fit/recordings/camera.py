"""Correct a camera's faults before any simulation: late time stamps, skewed grids, points that slide over the cloth.

No step needs a cloth model. The steps are taken in this order:

- stamps: the held row shows their delay (`fit.recordings.timing`). They are corrected for silhouettes, and for material
  points beyond `LATEST_LEFT`. Up to this delay the effect `time_offset` is valid.
- skew: frames of a silhouette with a skewed grid are left out (`fit.recordings.grids`)
- edge: a clamped edge is as long as on the flat cloth. It lies at the middle of a silhouette's top row at rest.
- frames: the error of a silhouette's held row is subtracted from the whole frame (`fit.recordings.frame_offsets`)
- positions: points of a silhouette's grid move to the material position given by their path from the held edge

Then the erosion of the outline (`fit.recordings.outline`), the remaining error of the held row, and the lean of the
cloth at rest (`fit.recordings.row_and_rest`) are estimated.

The garment file states whether points are a silhouette's (`points_are`). Older files are treated as before. Points and
hanger from the same pictures have one clock, and its stamps are not examined.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fit.recordings.frame_offsets import FrameOffsets, find_frame_offsets
from fit.recordings.grids import SKEWED, Grid, grid_of, length_seen, placed, skew_degrees
from fit.recordings.hanger_path import Curve, hanger_axes, in_hanger_frame
from fit.recordings.outline import Outline, find_outline
from fit.recordings.row_and_rest import Lean, find_lean, row_off
from fit.recordings.timing import CLOSEST, Timing, find_timing, in_order, row_middle
from formats.arrays import Booleans, Floats
from formats.garment import Garment

LATEST_LEFT = 0.08  # s: a larger offset could end at the bound of 0.1 s of the effect `time_offset`
# m/s of the hanger: below, the hanger is at rest. Of the 16 public recordings of swung cloth it reports a lean at rest
# in 10. Half reports 11, and double 6.
STILL_SPEED = 0.03
# frames: the deviation of five has a relative error of a third. Three and ten change no finding on those recordings.
FEWEST_RESTING_FRAMES = 5
TOP_ROW = 0.02  # of the grid's height: a first row within this distance of the held edge lies on the edge
NARROWEST_ROW = 0.85  # of the flat held edge: a shorter row has another cause than eroded corners


@dataclass(frozen=True, kw_only=True)
class CameraSteps:
    """Selection of the camera's faults to correct: all of them, except in benchmarks of single corrections.

    stamps: a constant latency and a share of the interval before; frames: offsets of whole frames
    """

    stamps: bool = True
    skew: bool = True
    edge: bool = True
    frames: bool = True
    places: bool = True


EVERY_STEP = CameraSteps()


@dataclass(frozen=True)
class Edge:
    """Position of a held edge in the hanger's frame, down and out [m], and its length [m]."""

    down: float
    out: float
    width: float

    def of(self, ends: Floats) -> Floats:
        """Return the corrected ends of the edge [m], (n, 6), from those of the hanger's path; NaN is kept."""
        found = np.full(ends.shape, np.nan)
        known = np.isfinite(ends).all(1)
        axes = hanger_axes(ends[known])
        centre = ends[known].reshape(-1, 2, 3).mean(1) + axes @ np.array([0.0, self.down, self.out])
        half = self.width / 2 * axes[:, :, 0]
        found[known] = np.concatenate([centre - half, centre + half], 1)
        return found


@dataclass(frozen=True)
class Camera:
    """Camera faults of one take, and their corrections.

    - `timing`: from the held row; None if the row gives no estimate
    - `is_retimed`: whether the stamps were corrected by `timing`
    - `skewed`: number of frames left out for a skewed grid
    - `frames`: number of frames with a grid
    - `edge`: corrected position of the held edge; None if unchanged
    - `is_placed`: whether the points were moved to their material positions
    - `outline`: erosion of the outline; None for other points than a silhouette's grid
    - `row_off` [m]: remaining error of the held row across the cloth after all corrections, root mean square
    - `lean`: of the cloth while the hanger is at rest; None if not seen
    - `offsets`: subtracted errors of whole frames; None if there are none
    """

    timing: Timing | None = None
    is_retimed: bool = False
    skewed: int = 0
    frames: int = 0
    edge: Edge | None = None
    is_placed: bool = False
    outline: Outline | None = None
    row_off: float = 0.0
    lean: Lean | None = None
    offsets: FrameOffsets | None = None


@dataclass(frozen=True)
class Seen:
    """Frames on the hanger's clock: time [s], (frames,); points [m], (frames, points, 3)."""

    time: Floats
    points: Floats
    camera: Camera = field(default_factory=Camera)


def retimed(
    time: Floats, points: Floats, path: Curve, garment: Garment, on_edge: Booleans
) -> Seen:  # fmt: skip
    """Return frames with corrected time stamps: the exposure times on the clock of the held ends' path.

    - `time` [s], (frames,)
    - `points` [m], (frames, points, 3), NaN where not seen
    - `on_edge`, (points,): the held row
    """
    if on_edge.sum() < 2:
        return Seen(time, points)
    is_silhouette = garment.points_are == "silhouette"
    across = np.array([p.at_m[0] for p in garment.points])[on_edge]
    row = row_middle(points[:, on_edge], across - across.mean())
    if (grid := _grid_of_silhouette(garment)) is not None:
        row[~_is_straight(points, grid)] = np.nan
    timing = find_timing(time, row, path, is_per_frame=is_silhouette)
    if timing is None or not timing.is_of_hanger:
        return Seen(time, points, Camera(timing=timing))
    if not (is_silhouette and timing.is_off) and abs(timing.latency) <= LATEST_LEFT:
        return Seen(time, points, Camera(timing=timing))
    true = time - (timing.shifts if is_silhouette else timing.latency)
    kept = (true >= time[0]) & (true <= time[-1])
    kept[kept] = in_order(true[kept])
    return Seen(true[kept], points[kept], Camera(timing=timing, is_retimed=True))


def straightened(seen: Seen, garment: Garment) -> Seen:
    """Return frames without the points of skewed silhouette grids."""
    grid = _grid_of_silhouette(garment)
    if grid is None:
        return seen
    skew = skew_degrees(seen.points, grid)
    askew = np.abs(skew) > SKEWED
    camera = replace(seen.camera, skewed=int(askew.sum()), frames=int(np.isfinite(skew).sum()))
    return replace(seen, points=np.where(askew[:, None, None], np.nan, seen.points), camera=camera)


def edge_shown(seen: Seen, path: Curve, garment: Garment) -> Edge | None:
    """Return the held edge's position relative to the hanger's path, from a silhouette's top row.

    The result is None unless the points are a silhouette's grid with a row at a clamped edge. It is also None if the
    distance of the ends differs much from that on the flat cloth.
    """
    grid = _grid_of_silhouette(garment)
    if grid is None or garment.held != "edge" or grid.down[0] > TOP_ROW * grid.down[-1]:
        return None
    ends = path(seen.time)
    width = float(np.linalg.norm(np.subtract(garment.outline_m[1], garment.outline_m[0])))
    apart = float(np.median(np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)))
    if not NARROWEST_ROW * width <= apart <= width / NARROWEST_ROW:
        return None
    row = row_middle(seen.points[:, grid.at[0]], grid.across - grid.across.mean())
    still = is_still(seen.time, path) & np.isfinite(row).all(1)
    if still.sum() < FEWEST_RESTING_FRAMES:
        return Edge(0.0, 0.0, width)
    local = in_hanger_frame(row, ends)[still]
    _, down, out = np.median(local, axis=0)  # along the bar both corners are eroded alike
    return Edge(float(down), float(out), width)


def steadied(seen: Seen, held: Curve, garment: Garment) -> Seen:
    """Return frames of a silhouette corrected by the error of their held row, and the corrections."""
    grid = _grid_of_silhouette(garment)
    if grid is None or garment.held != "edge" or grid.down[0] > TOP_ROW * grid.down[-1]:
        return seen
    row = row_middle(seen.points[:, grid.at[0]], grid.across - grid.across.mean())
    offsets = find_frame_offsets(seen.time, row, held)
    if offsets is None:
        return seen
    return replace(seen, points=seen.points - offsets.moved[:, None], camera=replace(seen.camera, offsets=offsets))


def in_place(seen: Seen, held: Curve, garment: Garment) -> Floats | None:
    """Return a silhouette's grid points at their material positions [m], (frames, points, 3); None for other points."""
    grid = _grid_of_silhouette(garment)
    return None if grid is None or garment.held != "edge" else placed(seen.points, held(seen.time), grid)


def examined(seen: Seen, held: Curve, garment: Garment) -> Camera:
    """Return the faults that remain after the corrections: eroded outline, error of the row, lean of the cloth."""
    grid = _grid_of_silhouette(garment)
    if grid is None or garment.held != "edge":
        return seen.camera
    ends = held(seen.time)
    outline = find_outline(seen.time, seen.points, ends, length_seen(seen.points, ends, grid), grid)
    off = 0.0 if grid.down[0] > TOP_ROW * grid.down[-1] else row_off(seen.points, ends, grid)
    if seen.camera.offsets is not None:
        off = float(np.hypot(off, seen.camera.offsets.left))
    still = is_still(seen.time, held)
    lean = find_lean(seen.time[still], seen.points[still], ends[still], grid)
    return replace(seen.camera, is_placed=True, outline=outline, row_off=off, lean=lean)


def is_still(time: Floats, path: Curve) -> Booleans:
    """Return which frames show the hanger at rest, (frames,)."""
    speed = np.linalg.norm(path(time + CLOSEST) - path(time - CLOSEST), axis=1) / (2 * CLOSEST * np.sqrt(2))
    return np.asarray(speed < STILL_SPEED)


def _grid_of_silhouette(garment: Garment) -> Grid | None:
    return grid_of(garment) if garment.points_are == "silhouette" else None


def _is_straight(points: Floats, grid: Grid) -> Booleans:
    return np.asarray(~(np.abs(skew_degrees(points, grid)) > SKEWED))
