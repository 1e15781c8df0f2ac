"""Measure the error of our cloth with the true parameters on synthetic recordings: the model-form error.

Without arguments: the four synthetic swatches, mesh 21 mm. With takes recorded from `hangtime sensor synthesise` (each
NAME.mcap beside its NAME.truth.npz): these, mesh 50 mm, and how far the tracked points are from the true ones. The
other cloth's diagonals also resist stretch, so its effective membrane stiffness includes its shear stiffness. With
--causes the script prints the causes of these fabrics' distances, each by two motions that differ in one thing alone.
The figure is the mean distance of the markers below the top row, over the whole take and over its first half second.
With --near one true parameter is made a third smaller or half larger. The markers of the top row, which hangs slack
between the two held corners, are then shown alone too. With --air-drag the swatches swing in air, as given takes did,
and our cloth has the same air. With --fit the held-out error of a fit stands beside it. Its excess is the quotient of
the two. Run: python benchmarks/true_parameters.py [--air-drag 1.2] [--causes FABRIC ...] [--near FABRIC ...] [--fit
fit.json] [TAKE.mcap ...]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firmware_host.synthetic.cloth import ClothPhysics
from firmware_host.synthetic.swatch import (
    CELLS_BETWEEN_MARKERS,
    SWATCH_FPS,
    SWATCH_FRAMES,
    TRUE_FABRICS,
    make_swatch_take,
    measured,
    swung_markers,
)
from firmware_host.synthetic.world import GARMENT_PHYSICS
from firmware_host.synthetic.world import SKIRT_FABRICS as SKIRTS
from fit.cloth import material as mat
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.cloth.support import Supporting, hanger
from fit.effects import find_effects
from fit.methods import distance as objective
from fit.methods.mocap_swatch import NODE_SPACING
from fit.recordings.recording import Recording, prepare
from formats.archive import read_take
from formats.arrays import Floats
from formats.descriptions import load_garment
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.swatch_mocap import import_marker_take
from formats.results import load_fit_result
from formats.swatch import MARKERS, SWATCH_SIDE, swatch
from formats.take import Take

TIME = np.arange(SWATCH_FRAMES) / SWATCH_FPS
COMPARED = ("swing", "other")  # the motions that the tables are of
VARIED = ("stretch_stiffness", "shear_stiffness", "bending_stiffness", "velocity_damping")
FACTORS = (2 / 3, 3 / 2)


def true_material(take: Take, physics: ClothPhysics) -> mat.Material:
    """Return our parameters for another cloth's physics."""
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
    points = simulated(take, [true_material(take, physics)], spacing, air_drag)[0]
    return mean_and_maximum(objective.per_frame(prepare(take).points, points))


def simulated(take: Take, materials: Sequence[mat.Material], spacing: float, air_drag: float) -> Floats:
    """Return our cloth's simulated points [m], (materials, frames, points, 3)."""
    simulator = Simulator(prepare(take), find_effects(["air_drag"]), resolution=Resolution(spacing=spacing))
    return simulator.run(
        np.array([dataclasses.astuple(one) for one in materials]), np.full((len(materials), 1), air_drag)
    ).points


def synthetic_take(folder: Path, fabric: str, motion: str, air_drag: float) -> Take:
    """Return the take of a synthetic swatch."""
    csv, _, garment = make_swatch_take(folder, fabric=fabric, motion=motion, air_drag=air_drag)
    return import_marker_take(csv, load_garment(garment))


def near(take: Take, physics: ClothPhysics, air_drag: float) -> dict[str, tuple[float, float]]:
    """Return mean distances [m], of all markers and of the top row's, for each change of a true parameter."""
    true = true_material(take, physics)
    changed = {"true": true} | {
        f"{name} x {factor:.2f}": dataclasses.replace(true, **{name: factor * getattr(true, name)})
        for name in VARIED
        for factor in FACTORS
    }
    seen = prepare(take).points
    apart = np.linalg.norm(simulated(take, list(changed.values()), NODE_SPACING, air_drag) - seen, axis=3)
    return {
        name: (float(np.nanmean(one)), float(np.nanmean(one[:, :MARKERS])))
        for name, one in zip(changed, apart, strict=True)
    }


def print_near(folder: Path, fabrics: Sequence[str], air_drag: float) -> None:
    """Print these distances of every motion of some fabrics."""
    for fabric in fabrics:
        for motion in COMPARED:
            take = synthetic_take(folder, fabric, motion, air_drag)
            for name, (whole, top) in near(take, TRUE_FABRICS[fabric].physics, air_drag).items():
                print(f"{take.take_id:28} {name:28} {1e3 * whole:6.1f} mm, top row {1e3 * top:6.1f}", flush=True)


def swatch_take(folder: Path, fabric: str, nodes: Floats, seed: int = 1) -> Take:
    """Return the take of a swatch with markers at `nodes` [m], (frames, 81, 3); the noise depends on the seed."""
    garment = swatch(TRUE_FABRICS[fabric].density * SWATCH_SIDE**2)
    tracks = MarkerTracks(garment.point_names, TIME, measured(nodes, np.random.default_rng(seed)))
    write_marker_csv(folder / "take.csv", tracks)
    return import_marker_take(folder / "take.csv", garment)


def flat_start(recording: Recording) -> Supporting:
    """Return the recording with a flat initial cloth, regardless of its markers."""
    bare = dataclasses.replace(recording, valid=np.zeros_like(recording.valid))
    return hanger(bare)


def causes(folder: Path, fabric: str, motion: str) -> dict[str, tuple[float, float]]:
    """Return distances [m], of the whole take and of its first half second, for each difference of two motions."""
    garment, true = swatch(TRUE_FABRICS[fabric].density * SWATCH_SIDE**2), TRUE_FABRICS[fabric]
    coarse, fine = (
        swung_markers(garment, TIME, motion, true, cells=cells)
        for cells in (CELLS_BETWEEN_MARKERS, 2 * CELLS_BETWEEN_MARKERS)
    )
    take, noisy, finer = (swatch_take(folder, fabric, n, s) for n, s in ((coarse, 1), (coarse, 2), (fine, 1)))
    row = np.array([dataclasses.astuple(true_material(take, true.physics))])

    def ours(take: Take, spacing: float = NODE_SPACING, *, flat: bool = False) -> Floats:
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
    cases = {f"{f}-{m}": causes(folder, f, m) for f in fabrics for m in COMPARED}
    print(f"mm, whole take (first half second), of {', '.join(cases)}")
    for name in next(iter(cases.values())):
        rows = 1e3 * np.array([case[name] for case in cases.values()])
        whole, early = rows.mean(0)
        print(f"{name:56} {whole:5.1f} ({early:4.1f}): " + " ".join(f"{r:.1f}" for r in rows[:, 0]))


def mean_and_maximum(by_frame: Floats) -> tuple[float, float]:
    """Return mean and maximum over the frames with at least one valid point."""
    return float(np.nanmean(by_frame)), float(np.nanmax(by_frame))


def main(
    takes: Sequence[str], causes_of: Sequence[str] = (), air_drag: float = 0.0, near_to: Sequence[str] = (),
    fit: Path | None = None,
) -> None:  # fmt: skip
    """Print a line a take, in millimetres, or the causes, or the distances for nearby parameters."""
    for name in map(Path, takes):
        take = read_take(name)
        with np.load(name.with_suffix(".truth.npz")) as truth:
            path = truth["points"].reshape(len(truth["time"]), -1)
            there = np.stack([np.interp(take.time, truth["time"], column) for column in path.T], 1)
            fabric = json.loads(str(truth["meta"])).get("fabric", "plain")
        seen = np.where(take.points_valid[..., None], take.points, np.nan)
        tracked = mean_and_maximum(objective.per_frame(seen, there.reshape(seen.shape)))
        found = distance_at_truth(take, GARMENT_PHYSICS.get(take.garment.kind, SKIRTS[fabric]), 0.05, air_drag)
        print(
            f"{name.name:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}; tracking {1e3 * tracked[0]:.1f}"
        )
        if fit is not None and (error := load_fit_result(fit).error.held_out_after) is not None:
            print(f"{'':28} {1e3 * error.mean_m:6.1f} mm by {fit}, excess {error.mean_m / found[0]:.2f}")
    with tempfile.TemporaryDirectory() as folder:
        if causes_of:
            print_causes(Path(folder), causes_of)
        if near_to:
            print_near(Path(folder), near_to, air_drag)
        for fabric in TRUE_FABRICS if not (takes or causes_of or near_to) else ():
            for motion in COMPARED:
                take = synthetic_take(Path(folder), fabric, motion, air_drag)
                found = distance_at_truth(take, TRUE_FABRICS[fabric].physics, NODE_SPACING, air_drag)
                print(f"{take.take_id:28} {1e3 * found[0]:6.1f} mm, maximum {1e3 * found[1]:6.1f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("takes", nargs="*", metavar="TAKE.mcap")
    parser.add_argument(
        "--causes", nargs="+", choices=TRUE_FABRICS, default=[], metavar="FABRIC", help="print the distances' causes"
    )
    parser.add_argument(
        "--near",
        nargs="+",
        choices=TRUE_FABRICS,
        default=[],
        metavar="FABRIC",
        help="print the distances of nearly true parameters",
    )
    parser.add_argument("--air-drag", type=float, default=0.0, help="drag coefficient of the recordings' air")
    parser.add_argument("--fit", type=Path, help="a fit that was judged on the take")
    chosen = parser.parse_args()
    main(chosen.takes, chosen.causes, chosen.air_drag, chosen.near, chosen.fit)
