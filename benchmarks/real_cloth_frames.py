"""Test on real recordings, without a cloth model, whether the points of one frame share an error.

    benchmarks/real_cloth_frames.py FOLDER

FOLDER holds the `.npz` recordings (docs/notebook/real-cloth.md). Each line is one take with corrected timestamps and
without skewed grids. The mean distance of the lower half of the points across the cloth is a smooth curve over time.
A Gaussian process of Matern's kernel 5/2 predicts each frame from all others. Printed are the root mean square error
[mm], and the log density of a frame, for three treatments of the points:

- `path`: about the hanger's path
- `moved`: frames shifted back by the held row's offset (`fit.recordings.frame_offsets`)
- `row`: about the held row of the same frame, with its noise

A wrong assumption about frames makes the curve rougher. Length, noise and size of the process are the likeliest of a
grid, for each variant separately.
Source: C. E. Rasmussen & C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006), equations 5.10 to 5.12.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np

from fit.recordings.camera import CameraSteps
from fit.recordings.grids import grid_of
from fit.recordings.hanger_path import in_hanger_frame
from fit.recordings.recording import Recording, prepare
from fit.recordings.timing import row_middle
from formats.arrays import Floats
from formats.importers.swung_cloth import import_swung_cloth

LENGTHS = (0.15, 0.2, 0.3, 0.45, 0.6)  # s
NOISES = (2e-3, 4e-3, 8e-3, 15e-3)  # m
SIZES = (1.0, 2.0)  # standard deviations of the curve


def predicted(time: Floats, curve: Floats) -> tuple[float, float]:
    """Return the root mean square error [m] and the mean log density of frames predicted from all others.

    time [s], (frames,); curve [m], (frames,)
    """
    found = []
    for length, noise, size in itertools.product(LENGTHS, NOISES, curve.std() * np.array(SIZES)):
        apart = np.sqrt(5) * np.abs(time[:, None] - time) / length
        kernel = size**2 * (1 + apart + apart**2 / 3) * np.exp(-apart)
        inverse = np.linalg.inv(kernel + noise**2 * np.eye(len(time)))
        variance = 1 / np.diag(inverse)
        error = variance * (inverse @ curve)
        density = -0.5 * (error**2 / variance + np.log(2 * np.pi * variance)).mean()
        found.append((float(density), float(np.sqrt((error**2).mean()))))
    density, error = max(found)
    return error, density


def curves(recording: Recording) -> tuple[Floats, Floats, Floats]:
    """Return times [s] and the mean of the lower points about the path, and the row, across the cloth [m]."""
    grid = grid_of(recording.garment)
    assert grid is not None
    ends = recording.held(recording.time)
    lower = recording.points[:, grid.at[len(grid.at) // 2 :].ravel()]
    seen = np.isfinite(lower).all(2).mean(1) > 0.5
    below = in_hanger_frame(np.nanmean(lower[seen], axis=1), ends[seen])[:, 2]
    row = row_middle(recording.seen_points[:, grid.at[0]], grid.across - grid.across.mean())
    held = in_hanger_frame(row, ends)[seen, 2]
    there = np.isfinite(held)
    return recording.time[seen][there], below[there], held[there]


def main(folder: Path) -> None:
    """Print a line for each take, the mean of all, and in how many takes moved frames are better."""
    print(f"{'':16s} {'path':>14s} {'moved':>14s} {'row':>14s}   mm, log density")
    every = []
    for path in sorted(folder.glob("*.npz")):
        take = import_swung_cloth(path)
        time, below, held = curves(prepare(take, CameraSteps(frames=False)))
        moved_time, moved, _ = curves(prepare(take))
        seen = [predicted(t, c - c.mean()) for t, c in ((time, below), (moved_time, moved), (time, below - held))]
        every.append(seen)
        print(f"{path.stem:16s} " + " ".join(f"{1e3 * error:6.1f} {density:7.2f}" for error, density in seen))
    middle = np.mean(every, axis=0)
    print(f"{'mean':16s} " + " ".join(f"{1e3 * error:6.1f} {density:7.2f}" for error, density in middle))
    path, moved, _ = np.moveaxis(np.array(every), 1, 0)
    print(f"moved: smaller error in {(moved[:, 0] < path[:, 0]).sum()} of {len(path)} takes, ", end="")
    print(f"larger density in {(moved[:, 1] > path[:, 1]).sum()} takes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
