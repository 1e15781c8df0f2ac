"""Measure self-contact of the cloth: penetrations, the influence of the thickness, and the cost.

Run: python benchmarks/contact.py. Two scenes:

    fold     a sheet of 0.3 m on a floor, one edge carried over to the other side, where it then lies on itself
    tube     a skirt of 0.35 m x 0.45 m, front and back sewn together at the sides, swung for five seconds by 80 mm

"Height" is that of the upper layer over the lower one at the end, 30 mm from the carried edge. "Crossings" are edges of
quads that pierce the surface elsewhere, summed over ten samples a second. They are counted on the quads of contact,
and on quads 20 mm wide. The smaller quads also count pieces that are too near along the cloth for contact.

Distances are against cloth 5 mm thick, rms over the nodes or points. The fold's nodes count at the end, the tube's
tracked points in seconds 0 to 1 and 1 to 5. Cost is the processor time of 16 candidates in the lanes of one thread, the
least of three, over that without contact.
"""

from __future__ import annotations

import sys
import time as clock
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.clamps import Clamp, clamps
from formats.arrays import Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.cloth.contact import Contact, surface_of
from fit.cloth.crossings import crossings
from fit.cloth.simulator import Simulator
from fit.recordings.bodies import half_space
from fit.recordings.recording import prepare
from formats.garment import Garment
from tests.fit.scenes import hung, material, sheet, swing, take_of

SIDE, DENSITY = 0.3, 0.2  # m and kg/m^2 of the folded sheet
THICKNESSES = (0.0, 0.002, 0.004, 0.005, 0.006, 0.008)  # m
FINE = 0.02  # m between the samples of the finer count


def turned_over(thickness: float) -> tuple[Simulator, Floats]:
    """Fold a sheet on a floor by moving one edge to the other side; return simulator and nodes, frame by frame."""
    garment = sheet(width=SIDE, height=SIDE, mass=DENSITY * SIDE**2)
    time = np.arange(0, 3.0, 1 / 30)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    level = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])

    def carried(instants: Floats) -> Floats:
        share = np.clip(instants / 2.2, 0, 1)
        share = share**3 * (10 - 15 * share + 6 * share**2)
        frame = np.repeat(level[None], len(instants), 0)
        frame[:, 1] = 0.13 * (np.cos(np.pi * share) - 1)
        frame[:, 2] = 0.13 * np.sin(np.pi * share) + 0.01 * share
        return frame

    support = clamps(
        Clamp(lambda p: p[:, 1] > -1e-9, carried),
        Clamp(lambda p: p[:, 1] < 1e-9 - SIDE, lambda t: np.repeat(level[None], len(t), 0)),
        start=level,
    )
    floor = half_space((0.0, 0.0, -0.002), (0.0, 0.0, 1.0))
    contact = Contact(thickness=thickness, bodies=(floor,), spacing=0.03)
    simulator = Simulator(recording, support=support, contact=contact)
    run = simulator.run(material(garment, velocity_damping=3.0, bending_stiffness=2e-5), shapes=True)
    assert run.shapes is not None
    return simulator, run.shapes[0].astype(float)


def height_of_upper_layer(simulator: Simulator, shape: Floats) -> Floats:
    """Return the heights [m] of the row of samples 30 mm from the moved edge."""
    samples = simulator.surface.samples
    return np.asarray(samples.apply(shape)[np.abs(samples.apply(simulator.mesh.rest)[:, 1] + 0.03) < 1e-6, 2])


def garment_of(kind: str) -> Garment:
    """Return a swatch, or a tube of the same outline with a back."""
    flat = sheet(width=0.35, height=0.45, mass=0.03)
    if kind == "swatch":
        return flat
    return msgspec.structs.replace(flat, format="hangtime-garment/2", mass_kg=0.06, seams=((1, 2), (3, 0)))


def swung(kind: str, thickness: float, seconds: float) -> tuple[Simulator, Floats]:
    """Return the simulator of a garment that is swung face-on, and its material."""
    garment = garment_of(kind)
    time = np.arange(0, seconds, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, hz=0.9))).with_points(hung(garment, time))
    return Simulator(recording, contact=Contact(thickness=thickness)), material(garment)


def cost(kind: str, thickness: float) -> float:
    """Processor time [s] of 16 candidates for three seconds."""
    simulator, row = swung(kind, thickness, 3.0)
    rows = np.repeat(row, 16, axis=0)
    simulator.run(rows)
    spent = []
    for _ in range(3):
        begun = clock.process_time()
        simulator.run(rows)
        spent.append(clock.process_time() - begun)
    return min(spent)


def rms_mm(difference: Floats) -> float:
    """Root mean square length [mm]."""
    return 1e3 * float(np.sqrt((difference**2).sum(-1).mean()))


def main() -> None:
    """Print both scenes and the cost."""
    print("thickness   fold: height, moved by   tube: crossings of quads, of 20 mm, moved by in second 1, 2 to 5")
    heights, folds, counts, tubes = {}, {}, {}, {}
    for d in THICKNESSES:
        simulator, shapes = turned_over(d)
        heights[d], folds[d] = float(height_of_upper_layer(simulator, shapes[-1]).mean()), shapes[-1]
        tube, row = swung("tube", d, 5.0)
        run = tube.run(row, shapes=True)
        assert run.shapes is not None
        seen = [s.astype(float) for s in run.shapes[0, ::3]]
        counts[d] = [sum(crossings(f, s) for s in seen) for f in (tube.surface, surface_of(tube.mesh, FINE))]
        tubes[d] = run.points[0]
    for d in THICKNESSES:
        moved = tubes[d] - tubes[0.005]
        print(
            f"{1e3 * d:6.0f} mm   {1e3 * heights[d]:9.2f} mm {rms_mm(folds[d] - folds[0.005]):6.1f} mm"
            f"   {counts[d][0]:18d} {counts[d][1]:9d} {rms_mm(moved[:30]):9.1f} mm {rms_mm(moved[30:]):9.1f} mm"
        )
    for kind in ("swatch", "tube"):
        without, touching = cost(kind, 0.0), cost(kind, 0.005)
        print(f"cost of a {kind}: {touching / without:.1f} times that without contact ({without / 48:.4f} s a second)")


if __name__ == "__main__":
    main()
