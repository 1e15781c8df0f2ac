"""How far our cloth is from synthetic recordings when it is told their true parameters: what no fit can be blamed for.

Without arguments: the four synthetic swatches, mesh 21 mm. With takes recorded from `hangtime sensor synthesise`
(each NAME.mcap beside its NAME.truth.npz): these, mesh 50 mm, and how far the tracked points are from the true ones.
The other cloth's diagonals pull too when it is stretched, so its membrane stiffness counts with its shear stiffness
added. With --causes: where these fabrics' distances come from, each by two motions that differ in one thing alone; mean
distance of the markers below the top row over the whole take, and over its first half second.
With --air-drag the swatches are swung in air, and our cloth is told that too.
Run: python benchmarks/true_parameters.py [--air-drag 1.2] [--causes FABRIC ...] [TAKE.mcap ...]
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_host.synthetic.cloth import ClothPhysics
from firmware_host.synthetic.swatch import (
    CELLS,
    FABRICS,
    FPS,
    FRAMES,
    MOTIONS,
    make_swatch_take,
    measured,
    swung_markers,
)
from firmware_host.synthetic.world import PHYSICS
from fit import objective
from fit.cloth import material as mat
from fit.cloth.simulator import Resolution, Simulator
from fit.cloth.support import Supporting, hanger
from fit.effects import find_effects
from fit.parameterisations.mocap_swatch import SPACING
from fit.recording import Recording, prepare
from formats.archive import read_take
from formats.descriptions import load_garment
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.swatch_mocap import import_marker_take
from formats.swatch import MARKERS, SIDE, swatch
from formats.take import Take

Floats = NDArray[np.float64]

TIME = np.arange(FRAMES) / FPS


def true_material(take: Take, physics: ClothPhysics) -> mat.Material:
    """Return what is ours of another cloth's physics."""
    return mat.Material(
        areal_density=take.garment.areal_density,
        stretch_stiffness=physics.stretch_stiffness + physics.shear_stiffness,
        shear_stiffness=physics.shear_stiffness,
        bending_stiffness=physics.bending_stiffness,
        bending_damping_time=1e-4,
        velocity_damping=physics.linear_damping,
    )


def distance_at_truth(take: Take, physics: ClothPhysics, spacing: float, air_drag: float = 0.0) -> tuple[float, float]:
    """Return mean and maximum over the frames of the mean distance of the points [m]."""
    recording, row = prepare(take), mat.as_rows([true_material(take, physics)])
    simulator = Simulator(recording, find_effects(["air_drag"]), resolution=Resolution(spacing=spacing))
    points = simulator.run(row, np.array([[air_drag]])).points[0]
    return mean_and_maximum(objective.per_frame(recording.points, points))


def swatch_take(folder: Path, fabric: str, nodes: Floats, seed: int = 1) -> Take:
    """Return the take of a swatch whose markers were at `nodes` [m], (frames, 81, 3); each seed has other noise."""
    garment = swatch(FABRICS[fabric].density * SIDE**2)
    tracks = MarkerTracks(garment.point_names, TIME, measured(nodes, np.random.default_rng(seed)))
    write_marker_csv(folder / "take.csv", tracks)
    return import_marker_take(folder / "take.csv", garment)


def flat_start(recording: Recording) -> Supporting:
    """The recording's hanger, from which the cloth begins flat whatever its markers show."""
    bare = dataclasses.replace(recording, valid=np.zeros_like(recording.valid))
    return hanger(bare)


def causes(folder: Path, fabric: str, motion: str) -> dict[str, tuple[float, float]]:
    """Return distances [m], of the whole take and of its first half second, by what the two motions differ in."""
    garment, true = swatch(FABRICS[fabric].density * SIDE**2), FABRICS[fabric]
    coarse, fine = (swung_markers(garment, TIME, motion, true, cells=cells) for cells in (CELLS, 2 * CELLS))
    take, noisy, finer = (swatch_take(folder, fabric, n, s) for n, s in ((coarse, 1), (coarse, 2), (fine, 1)))
    row = mat.as_rows([true_material(take, true.physics)])

    def ours(take: Take, spacing: float = SPACING, *, flat: bool = False) -> Floats:
        recording = prepare(take)
        support = flat_start(recording) if flat else None
        return Simulator(recording, resolution=Resolution(spacing=spacing), support=support).run(row).points[0]

    usual = ours(take)
    pairs = {
        "the recordings' cloth on grids of 21 and 10 mm": (coarse, fine),
        "ours, two recordings that differ in the markers' noise": (usual, ours(noisy)),
        "ours on meshes of 21 and 16 mm": (usual, ours(take, 0.0156)),
        "ours against the recording": (usual, coarse),
        "the same on a mesh of 31 mm": (ours(take, 0.03125), coarse),
        "the same on 21 mm, started flat": (ours(take, flat=True), coarse),
        "ours against the recording on a grid of 10 mm": (ours(finer), fine),
    }
    below = slice(MARKERS, None)
    found = {name: np.linalg.norm(one[:, below] - other[:, below], axis=2) for name, (one, other) in pairs.items()}
    return {name: (float(apart.mean()), float(apart[TIME < 0.5].mean())) for name, apart in found.items()}


def print_causes(folder: Path, fabrics: Sequence[str]) -> None:
    """Print the causes of every motion of some fabrics, and their means."""
    cases = {f"{f}-{m}": causes(folder, f, m) for f in fabrics for m in MOTIONS}
    print(f"mm, whole take (first half second), of {', '.join(cases)}")
    for name in next(iter(cases.values())):
        rows = 1e3 * np.array([case[name] for case in cases.values()])
        whole, early = rows.mean(0)
        print(f"{name:56} {whole:5.1f} ({early:4.1f}): " + " ".join(f"{r:.1f}" for r in rows[:, 0]))


def mean_and_maximum(by_frame: NDArray[np.float64]) -> tuple[float, float]:
    """Return both over the frames in which anything was seen."""
    return float(np.nanmean(by_frame)), float(np.nanmax(by_frame))


def main(takes: Sequence[str], causes_of: Sequence[str] = (), air_drag: float = 0.0) -> None:
    """Print a line a take, in millimetres, or the causes."""
    for name in map(Path, takes):
        take = read_take(name)
        with np.load(name.with_suffix(".truth.npz")) as truth:
            path = truth["points"].reshape(len(truth["time"]), -1)
            there = np.stack([np.interp(take.time, truth["time"], column) for column in path.T], 1)
        seen = np.where(take.points_valid[..., None], take.points, np.nan)
        tracked = mean_and_maximum(objective.per_frame(seen, there.reshape(seen.shape)))
        found = distance_at_truth(take, PHYSICS.get(take.garment.kind, ClothPhysics()), 0.05)
        print(
            f"{name.name:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}; tracking {1e3 * tracked[0]:.1f}"
        )
    with tempfile.TemporaryDirectory() as folder:
        if causes_of:
            print_causes(Path(folder), causes_of)
        for fabric in FABRICS if not (takes or causes_of) else ():
            for motion in MOTIONS:
                csv, _, garment = make_swatch_take(Path(folder), fabric=fabric, motion=motion, air_drag=air_drag)
                take = import_marker_take(csv, load_garment(garment))
                found = distance_at_truth(take, FABRICS[fabric].physics, SPACING, air_drag)
                print(f"{take.take_id:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("takes", nargs="*", metavar="TAKE.mcap")
    parser.add_argument(
        "--causes", nargs="+", choices=FABRICS, default=[], metavar="FABRIC", help="where theirs come from"
    )
    parser.add_argument("--air-drag", type=float, default=0.0, help="drag coefficient of the synthetic swatches' air")
    chosen = parser.parse_args()
    main(chosen.takes, chosen.causes, chosen.air_drag)
