"""Measure how rough a marker's path is, and how much of it is noise.

The roughness of four positions in a row, seen at the times `t_i`, is the part of them that no constant acceleration
explains:

    c = |sum_i w_i z_i|,    w_i ~ 1 / prod_{j != i} (t_i - t_j),    sum_i w_i^2 = 1

So noise makes `c` as large in every row of four, however the times lie. Motion makes it `g` times larger behind a gap.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats, Integers, Singles

POSITIONS_BESIDE = 3  # positions on either side that are weighed: a row of four then reaches across with one at least
# m: the least roughness that counts as usual. Optical systems keep 0.1 to 0.5 mm, and files round to 1 mm.
LEAST_ROUGHNESS = 4e-4
ROUGH_SHARE = 0.3  # of a marker's rows; our choice: one exchange in seven frames spoils four rows of seven
# The median of 3-dimensional normal noise over its quantile ROUGH_SHARE: 1.538 / 1.193.
MEDIAN_OVER_SHARE = 1.29
WIDE_MOTION = 64.0  # times; constant change of acceleration is 2^3 as rough over twice the time
BLOCK_FRAMES = 16  # frames of a block that has its own usual roughness; our choice: 0.16 s at 100 frames a second
ROWS_AT_ONCE = 1 << 12  # our choice: bounds memory, and no result depends on it
FEWEST_ROWS = 4  # in a block; our choice: fewer show no usual roughness


def roughness(time: Floats, path: Floats) -> tuple[Integers, Singles]:
    """Return the last frame and the roughness [m] of each row of four of one path, (frames, 3), NaN where not seen."""
    seen = np.flatnonzero(np.isfinite(path[:, 0]))
    return seen[POSITIONS_BESIDE:], roughness_of(time, path, seen)


def is_smooth(time: Floats, path: Floats, least: float) -> bool:
    """Return whether all rows of four of a path are less rough than this [m], those across gaps too."""
    return bool((roughness_of(time, path, np.flatnonzero(np.isfinite(path[:, 0])), is_grown=True) < least).all())


def roughness_of(time: Floats, path: Floats, seen: Integers, *, is_grown: bool = False) -> Singles:
    """Return the roughness [m] of each row of four of the frames `seen`, divided by `g` if not `is_grown`."""
    rough = np.zeros(max(len(seen) - POSITIONS_BESIDE, 0), np.float32)
    for begin in range(0, len(rough), ROWS_AT_ONCE):
        rows = seen[np.arange(begin, min(begin + ROWS_AT_ONCE, len(rough)))[:, None] + np.arange(POSITIONS_BESIDE + 1)]
        weights, grown = weights_of(time[rows])
        total = np.linalg.norm(np.einsum("rp,rpd->rd", weights, path[rows]), axis=1)
        rough[begin : begin + ROWS_AT_ONCE] = total if is_grown else total / np.maximum(grown, 1.0)
    return rough


def weights_of(times: Floats) -> tuple[Floats, Floats]:
    """Return the weights of rows of four, (rows, 4), and `g`, (rows,), from their times in usual steps."""
    apart = times[:, :, None] - times[:, None, :]
    apart[:, range(POSITIONS_BESIDE + 1), range(POSITIONS_BESIDE + 1)] = 1.0
    weights = 1.0 / apart.prod(2)
    size = np.linalg.norm(weights, axis=1)
    return weights / size[:, None], np.sqrt(20.0) / 6.0 / size


def noise_of(time: Floats, path: Floats, whole: float) -> float:
    """Return the part of a path's usual roughness [m] that is noise: the rest grows with the time between positions.

    - `time` [usual steps], `path` [m], (frames, 3), NaN where not seen; `whole` [m]: the usual roughness
    """
    seen = np.flatnonzero(np.isfinite(path[:, 0]))
    wide = np.concatenate([roughness_of(time, path, seen[k::2], is_grown=True) for k in range(2)])
    if not len(wide):
        return 0.0
    both = (MEDIAN_OVER_SHARE * np.quantile(wide, ROUGH_SHARE)) ** 2
    moved = max(both - whole**2, 0.0) / (WIDE_MOTION - 1)
    return float(np.sqrt(max(whole**2 - moved, 0.0)))


def usual_roughness(frames: int, rows: tuple[Integers, Singles]) -> Singles:
    """Return a marker's usual roughness [m] in each frame: of the whole path, or of the frames around if more.

    `rows`: the last frame of each row, and its roughness [m]
    """
    last, rough = rows
    if not len(rough):
        return np.full(frames, np.inf, np.float32)
    whole = MEDIAN_OVER_SHARE * np.quantile(rough, ROUGH_SHARE)
    block = (last // BLOCK_FRAMES).astype(np.int32)
    order = np.lexsort((rough, block))
    count = np.bincount(block, minlength=-(-frames // BLOCK_FRAMES))
    first = np.cumsum(count) - count
    place = np.minimum(first + (ROUGH_SHARE * count).astype(int), len(rough) - 1)
    near = np.where(count >= FEWEST_ROWS, MEDIAN_OVER_SHARE * rough[order][place], 0.0)
    wide = np.maximum(near, np.maximum(np.append(near[1:], 0.0), np.append(0.0, near[:-1])))
    found = np.maximum(np.repeat(np.maximum(wide, whole), BLOCK_FRAMES)[:frames], LEAST_ROUGHNESS)
    return np.asarray(found, np.float32)
