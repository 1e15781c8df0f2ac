"""How far our cloth is from synthetic recordings when it is told their true parameters: what no fit can be blamed for.

Without arguments: the four synthetic swatches, mesh 31 mm. With takes recorded from `hangtime sensor synthesise`
(each NAME.mcap beside its NAME.truth.npz): these, mesh 50 mm, and how far the tracked points are from the true ones.
The other cloth's diagonals pull too when it is stretched, so its membrane stiffness counts with its shear stiffness
added. Run: python benchmarks/true_parameters.py [TAKE.mcap ...]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_host.synthetic.cloth import ClothPhysics
from firmware_host.synthetic.swatch import FABRICS, MOTIONS, make_swatch_take
from fit import objective
from fit.cloth import material as mat
from fit.cloth.simulator import Resolution, Simulator
from fit.recording import prepare
from formats.archive import read_take
from formats.descriptions import load_garment
from formats.importers.swatch_mocap import import_marker_take
from formats.take import Take


def distance_at_truth(take: Take, physics: ClothPhysics, spacing: float) -> tuple[float, float]:
    """Return mean and maximum over the frames of the mean distance of the points [m]."""
    true = mat.Material(
        areal_density=take.garment.areal_density,
        stretch_stiffness=physics.stretch_stiffness + physics.shear_stiffness,
        shear_stiffness=physics.shear_stiffness,
        bending_stiffness=physics.bending_stiffness,
        bending_damping_time=1e-4,
        velocity_damping=physics.linear_damping,
    )
    recording = prepare(take)
    points = Simulator(recording, resolution=Resolution(spacing=spacing)).run(mat.as_rows([true])).points[0]
    return mean_and_maximum(objective.per_frame(recording.points, points))


def mean_and_maximum(by_frame: NDArray[np.float64]) -> tuple[float, float]:
    """Return both over the frames in which anything was seen."""
    return float(np.nanmean(by_frame)), float(np.nanmax(by_frame))


def main(takes: list[str]) -> None:
    """Print a line a take, in millimetres."""
    for name in map(Path, takes):
        take = read_take(name)
        with np.load(name.with_suffix(".truth.npz")) as truth:
            path = truth["points"].reshape(len(truth["time"]), -1)
            there = np.stack([np.interp(take.time, truth["time"], column) for column in path.T], 1)
        seen = np.where(take.points_valid[..., None], take.points, np.nan)
        tracked = mean_and_maximum(objective.per_frame(seen, there.reshape(seen.shape)))
        found = distance_at_truth(take, ClothPhysics(), 0.05)
        print(
            f"{name.name:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}; tracking {1e3 * tracked[0]:.1f}"
        )
    with tempfile.TemporaryDirectory() as folder:
        for fabric in FABRICS if not takes else ():
            for motion in MOTIONS:
                csv, _, garment = make_swatch_take(Path(folder), fabric=fabric, motion=motion)
                take = import_marker_take(csv, load_garment(garment))
                found = distance_at_truth(take, FABRICS[fabric].physics, 0.03125)
                print(f"{take.take_id:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
