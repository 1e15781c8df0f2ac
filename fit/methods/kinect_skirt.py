"""Methods of the Kinect-skirt paper: the six parameters of Blender's cloth, and a variant with known weight.

Source: "Estimating the clothes characteristics with the image and depth sensors for developing virtual fitting room",
Tables 1 and 2. Blender's numbers have no SI meaning. This table ties our numbers to the solver, with the garment's
weighed density rho_w:

    areal density            rho = Mass rho_w                     Mass 1 is the garment as weighed
    stretch stiffness        k   = 10 Struct          [N/m]       5 to 80 -> 50 to 800 N/m
    shear stiffness          G   = k / 10             [N/m]
    bending stiffness        B   = 1e-6 Bend          [N m]       0.1 to 150 -> 1e-7 to 1.5e-4, as measured on fabrics
    bending damping time     tau = 4e-4 Spring        [s]
    membrane damping time          1e-6 Spring        [s]
    velocity damping         c   = 0.02 Air / rho - 25 ln(Velocity)   [1/s]

Air is a linear drag per area, in units of 0.02 N s/m^3. Velocity is the factor by which each velocity is multiplied per
frame of 1/25 s. Multiplying rho, k, G, B and the drag by one number changes no motion. So Mass, Struct and Bend are not
identifiable, but their ratios are. Of Air and Velocity only the damping c is identifiable. `kinect-skirt-weighed` sets
Mass to 1, the weight that the garment's description states. Struct and Bend are then identifiable, and still only c of
Air and Velocity.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from fit.cloth import material as mat
from fit.methods.method import Parameter, Parameterisation
from formats.arrays import Floats


def _kinect_materials(vectors: Floats, weighed_density: float) -> Floats:
    mass, struct, bend, spring, air, velocity = vectors.T
    density = mass * weighed_density
    rows = np.zeros((len(vectors), len(mat.MATERIAL_NAMES)))
    rows[:, mat.DENSITY] = density
    rows[:, mat.STRETCH] = 10.0 * struct
    rows[:, mat.SHEAR] = struct
    rows[:, mat.BENDING] = 1e-6 * bend
    rows[:, mat.MEMBRANE_TIME] = 1e-6 * spring
    rows[:, mat.BENDING_TIME] = 4e-4 * spring
    rows[:, mat.VELOCITY] = 0.02 * air / density - 25.0 * np.log(velocity)
    return rows


KINECT_SKIRT = Parameterisation(
    name="kinect-skirt",
    parameters=(
        Parameter(name="mass", unit="x weighed", initial=1.0, minimum=0.15, maximum=10.0, interval=0.5,
                  meaning="mass of the cloth material"),
        Parameter(name="struct", unit="Blender", initial=30.0, minimum=5.0, maximum=80.0, interval=15.0,
                  meaning="overall stiffness of the cloth"),
        Parameter(name="bend", unit="Blender", initial=20.0, minimum=0.1, maximum=150.0, interval=10.0,
                  meaning="wrinkle coefficient"),
        Parameter(name="spring", unit="Blender", initial=3.0, minimum=0.0, maximum=25.0, interval=4.0,
                  meaning="damping of cloth velocity"),
        Parameter(name="air", unit="Blender", initial=5.0, minimum=1.0, maximum=10.0, interval=5.0,
                  meaning="slows falling things down"),
        Parameter(name="velocity", unit="per frame", initial=0.95, minimum=0.9, maximum=1.0, interval=0.01,
                  meaning="share of velocity kept per frame"),
    ),
    to_materials=_kinect_materials,
    not_identified=(
        "Mass is not identified: density, stiffnesses and drag times the same factor give the same motion. "
        "Only ratios to the density are; `--method kinect-skirt-weighed` takes the garment's weight as known. "
        "Motion does not distinguish Air from Velocity."
    ),
    degenerate=("mass", "struct", "bend", "air", "velocity"),
    search="annealing",
)  # fmt: skip


def _weighed_materials(vectors: Floats, weighed_density: float) -> Floats:
    return _kinect_materials(np.insert(vectors, 0, 1.0, axis=1), weighed_density)


KINECT_SKIRT_WEIGHED = dataclasses.replace(
    KINECT_SKIRT,
    name="kinect-skirt-weighed",
    parameters=KINECT_SKIRT.parameters[1:],
    to_materials=_weighed_materials,
    not_identified="The weight is taken from the garment's description. Motion does not distinguish Air from Velocity.",
    degenerate=("air", "velocity"),
)
