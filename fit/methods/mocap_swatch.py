"""The five parameters of the motion capture method: stretching, bending, damping, density, thickness.

Source: "Optimization of Cloth Simulation Parameters by Considering Static and Dynamic Features", section 4. The paper
tuned PhysX' five parameters, and PhysX had no shear stiffness to tune. PhysX' numbers run from 0 to 1 and mean no
physical quantity. Ours are SI quantities at the fabric's nominal thickness, and t is the thickness as a multiple of the
nominal one. For a plate of one bulk material, D = E h^3 / (12 (1 - nu^2)) (S. Timoshenko, S. Woinowsky-Krieger, "Theory
of Plates and Shells", section 4). Hence

    areal density        rho = Density t             [kg/m^2]
    stretch stiffness    k   = Stretching t          [N/m]
    bending stiffness    B   = Bending t^3           [N m]
    shear stiffness      G   = k / 10                [N/m]    no parameter: diagonals stretch with the rest
    velocity damping     c   = Damping               [1/s]

Motion identifies k / rho = Stretching / Density, B / rho = Bending t^2 / Density and c, no other combination of the
five. `mocap-swatch-weighed` takes density (weighed) and thickness (nominal) as known. Its three parameters are all
identifiable. gamma is 1e4 per unit of E/N. The kinect skirt's gamma is 1e5 per metre of D, and E/N of a swatch is about
ten times D.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from fit.cloth import material as mat
from fit.methods.method import Parameter, Parameterisation
from fit.methods.swatch_error import SwatchError
from formats.arrays import Floats

MEMBRANE_DAMPING_TIME = 2e-5  # s, as in `si`: settles ringing threads, far below what markers see
BENDING_DAMPING_TIME = 1e-4  # s, as in `lean`
NODE_SPACING = (
    0.0208  # m, a third of the markers' distance: one element between two; a coarser mesh determines the folds
)
# Of the stretch stiffness, as in the kinect skirt's map. Our choice: fabrics have 11 to 220 N/m of shear (KES) and 37
# to 1000 N/m of stretch. Half and double were not tried.
SHEAR_SHARE = 0.1


def _materials(vectors: Floats, weighed_density: float) -> Floats:
    stretching, bending, damping, density, thickness = vectors.T
    rows = np.zeros((len(vectors), len(mat.MATERIAL_NAMES)))
    rows[:, mat.DENSITY] = density * thickness
    rows[:, mat.STRETCH] = stretching * thickness
    rows[:, mat.SHEAR] = SHEAR_SHARE * stretching * thickness
    rows[:, mat.BENDING] = bending * thickness**3
    rows[:, mat.MEMBRANE_TIME] = MEMBRANE_DAMPING_TIME
    rows[:, mat.BENDING_TIME] = BENDING_DAMPING_TIME
    rows[:, mat.VELOCITY] = damping
    return rows


# Ranges of stretch, bending and damping are those of `si`; density from voile to heavy denim (618 fabrics, 5 to 95 %).
MOCAP_SWATCH = Parameterisation(
    name="mocap-swatch",
    parameters=(
        Parameter(name="stretching_stiffness", unit="N/m", initial=300.0, minimum=30.0, maximum=1000.0, interval=100.0,
                  meaning="tension per strain at nominal thickness"),
        Parameter(name="bending_stiffness", unit="N m", initial=1.4e-5, minimum=1e-6, maximum=2e-4, interval=1e-5,
                  meaning="moment per width and curvature at nominal thickness"),
        Parameter(name="damping_coefficient", unit="1/s", initial=1.0, minimum=0.02, maximum=8.0, interval=0.5,
                  meaning="linear damping of all motion"),
        Parameter(name="density", unit="kg/m2", initial=0.197, minimum=0.03, maximum=0.5, interval=0.05,
                  meaning="areal density at nominal thickness"),
        Parameter(name="thickness", unit="x nominal", initial=1.0, minimum=0.5, maximum=2.0, interval=0.2,
                  meaning="multiple of the fabric's nominal thickness"),
    ),
    search="annealing",
    to_materials=_materials,
    not_identified=(
        "Motion tells stretching / density, bending x thickness^2 / density and the damping coefficient; density and "
        "thickness themselves have to be measured: `--method mocap-swatch-weighed` takes both as known."
    ),
    degenerate=("stretching_stiffness", "bending_stiffness", "density", "thickness"),
    objective=SwatchError,
    gamma=1e4,
    is_in_metres=False,
    spacing=NODE_SPACING,
)  # fmt: skip


def _weighed_materials(vectors: Floats, weighed_density: float) -> Floats:
    known = np.broadcast_to([weighed_density, 1.0], (len(vectors), 2))
    return _materials(np.concatenate([vectors, known], axis=1), weighed_density)


MOCAP_SWATCH_WEIGHED = dataclasses.replace(
    MOCAP_SWATCH,
    name="mocap-swatch-weighed",
    parameters=MOCAP_SWATCH.parameters[:3],
    to_materials=_weighed_materials,
    not_identified="",
    degenerate=(),
)
