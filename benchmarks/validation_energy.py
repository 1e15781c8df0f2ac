"""Check that the energy of an undamped swinging sheet is constant; a part of `validation.py`.

    E = sum m v^2 / 2 + sum m g z + integral of k/2 (E11^2 + E22^2) + G/2 E12^2,
    E11 = (|Fu|^2 - 1)/2, E12 = Fu.Fv, less the same at rest; without bending

The velocities v are central differences of 2000 samples a second. At 250 Hz these lose a fifth of the kinetic energy,
and less in slower motion. Means over 0.9 s, nearly a period of the first swing, ten seconds apart. Rounding to single
precision heats the cloth, by 1e-7 to 3e-7 W here; the swing has 1.8e-3 J.
"""

from __future__ import annotations

import numpy as np

from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.recordings.recording import prepare
from formats.arrays import Floats
from formats.nature import GRAVITY
from tests.fit.scenes import hung, material, sheet, swing, take_of

LENGTH, WIDTH, DENSITY = 0.45, 0.4, 0.2  # m, m, kg/m^2: the sheet of `validation.py` too
STRETCH, SHEAR = 2000.0, 100.0  # N/m
NUDGE, HERTZ = 0.01, 0.89  # m, 1/s: of the hanger, at about the first swing
RATE, MEAN_OVER, SECONDS = 2000, 0.9, 10.0


def energy_drift(resolution: Resolution, damping: float = 0.0) -> float:
    """Return the relative change of the energy over 10 s, at a velocity damping [1/s]."""
    stop = 0.5 + 2.0 / HERTZ
    begin = stop + 0.35
    time = np.arange(0, begin + SECONDS + MEAN_OVER, 1 / RATE)
    garment = sheet(width=WIDTH, height=LENGTH, mass=DENSITY * WIDTH * LENGTH)
    row = material(
        garment, stretch_stiffness=STRETCH, shear_stiffness=SHEAR, bending_stiffness=1e-9, velocity_damping=damping,
        bending_damping_time=0.0, membrane_damping_time=0.0,
    )  # fmt: skip
    path = swing(time, amplitude=NUDGE, hz=HERTZ, start=0.3, stop=stop)
    simulator = Simulator(
        prepare(take_of(garment, time, path)).with_points(hung(garment, time)), resolution=resolution
    )  # fmt: skip
    shapes = simulator.run(row, shapes=True).shapes
    assert shapes is not None
    rest = potential(simulator, shapes[0, :2].astype(float)).mean()
    span = round(RATE * MEAN_OVER)
    first, last = round(RATE * begin), round(RATE * (begin + SECONDS))
    early, late = (whole(simulator, shapes[0, at : at + span].astype(float)) for at in (first, last))
    return float((late - rest) / (early - rest) - 1)


def whole(simulator: Simulator, shapes: Floats) -> float:
    """Return mean kinetic and potential energy [J] from positions of the nodes [m], (samples, nodes, 3)."""
    speed = (shapes[2:] - shapes[:-2]) * RATE / 2
    kinetic = 0.5 * DENSITY * np.einsum("n,pnc->p", simulator.mesh.node_area, speed**2)
    return float((kinetic + potential(simulator, shapes[1:-1])).mean())


def potential(simulator: Simulator, shapes: Floats) -> Floats:
    """Return the energy of height, fibres and shear [J], (samples,), from nodes [m], (samples, nodes, 3)."""
    mesh = simulator.mesh
    slopes = mesh.fibres.stencils.apply(shapes.transpose(1, 0, 2))
    fibres = mesh.fibres.area @ (((slopes**2).sum(2) - 1) / 2) ** 2
    across = np.einsum("sk,skpc->spc", mesh.shear_weights[:, :4], slopes[mesh.shear_across])
    down = np.einsum("sk,skpc->spc", mesh.shear_weights[:, 4:], slopes[mesh.shear_down])
    shear = mesh.shear_area @ (across * down).sum(2) ** 2
    height = DENSITY * GRAVITY * shapes[:, :, 2] @ mesh.node_area
    return np.asarray(STRETCH / 2 * fibres + SHEAR / 2 * shear + height)
