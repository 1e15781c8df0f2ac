"""Methods in physical units, with the garment's weight taken as known.

`si` is the diagnosis' base model; every parameter is identifiable in principle. `lean` is `si` without shear stiffness
and bending viscosity. With `lean` both are effects of the diagnosis' library.

`si-outline` is `si` fitted to the cloth's outline alone (`fit.methods.outline`).

`si-sewn` is `si` for a garment whose flat sheet stands for several layers. Take two layers of membrane stiffness k and
bending stiffness B, sewn together at a distance d. They bend about the middle between them. One layer is stretched by
kappa d/2, and the other is compressed by the same strain:
    B' = 2 B + k d^2 / 2,  with k = 300 N/m 1.5e-4 N m at d = 1 mm, 1.4e-3 at 3 mm, 3.8e-3 at 5 mm
This is the parallel axis theorem (H. G. Allen, "Analysis and Design of Structural Sandwich Panels" (1969), chapter 2).
A single layer of the stiffest fabric has 1.1e-4 N m. Sleeves and hems are sewn layers of this kind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.cloth import material as mat
from fit.methods.method import Parameter, Parameterisation
from fit.methods.outline import OutlineDistance
from formats.arrays import Floats


def _si_materials(vectors: Floats, weighed_density: float) -> Floats:
    stretch, shear, bending, bending_time, velocity = vectors.T
    rows = np.zeros((len(vectors), len(mat.MATERIAL_NAMES)))
    rows[:, mat.DENSITY] = weighed_density
    rows[:, mat.STRETCH] = stretch
    rows[:, mat.SHEAR] = shear
    rows[:, mat.BENDING] = bending
    rows[:, mat.MEMBRANE_TIME] = 2e-5
    rows[:, mat.BENDING_TIME] = bending_time
    rows[:, mat.VELOCITY] = velocity
    return rows


# The upper limit of stretch is where strain under the cloth's own weight falls below a depth sensor's resolution. Shear
# is 11 to 84 (220) N/m (KES, 0.2 to 4 gf/(cm deg)). A sheet with less shear stiffness than any fabric could imitate air
# drag. Bending is 1e-6 to 1.1e-4 N m (618 fabrics).
SI = Parameterisation(
    name="si",
    parameters=(
        Parameter(name="stretch_stiffness", unit="N/m", initial=300.0, minimum=30.0, maximum=1000.0, interval=100.0,
                  is_log=True, meaning="tension per strain, warp and weft"),
        Parameter(name="shear_stiffness", unit="N/m", initial=30.0, minimum=10.0, maximum=220.0, interval=10.0,
                  is_log=True, meaning="shear force per width and angle"),
        Parameter(name="bending_stiffness", unit="N m", initial=1.4e-5, minimum=1e-6, maximum=2e-4, interval=1e-5,
                  is_log=True, meaning="moment per width and curvature"),
        Parameter(name="bending_damping_time", unit="s", initial=2e-3, minimum=1e-4, maximum=2e-2, interval=1e-3,
                  is_log=True, meaning="bending viscosity over bending stiffness"),
        Parameter(name="velocity_damping", unit="1/s", initial=1.0, minimum=0.02, maximum=8.0, interval=0.5,
                  is_log=True, meaning="linear damping of all motion"),
    ),
    to_materials=_si_materials,
    not_identified="",
)  # fmt: skip

SI_OUTLINE = replace(SI, name="si-outline", objective=OutlineDistance, search="cma-es")

TWO_LAYERS = 3e-4  # N m: those of 300 N/m, 1.4 mm apart
FAR_LAYERS = 5e-3  # N m: 6 mm apart

SI_SEWN = replace(
    SI,
    name="si-sewn",
    parameters=tuple(
        replace(p, initial=TWO_LAYERS, maximum=FAR_LAYERS) if p.name == "bending_stiffness" else p
        for p in SI.parameters
    ),
    knows_layers=True,
)


def _lean_materials(vectors: Floats, weighed_density: float) -> Floats:
    stretch, bending, velocity = vectors.T
    rows = np.zeros((len(vectors), len(mat.MATERIAL_NAMES)))
    rows[:, mat.DENSITY] = weighed_density
    rows[:, mat.STRETCH] = stretch
    rows[:, mat.SHEAR] = 1e-3 * stretch
    rows[:, mat.BENDING] = bending
    rows[:, mat.MEMBRANE_TIME] = 2e-5
    rows[:, mat.BENDING_TIME] = 1e-4
    rows[:, mat.VELOCITY] = velocity
    return rows


# Warp and weft springs, bending and linear damping, as simple engines have them; shear is a trace that keeps it stable.
LEAN = Parameterisation(
    name="lean",
    parameters=tuple(
        p for p in SI.parameters if p.name in {"stretch_stiffness", "bending_stiffness", "velocity_damping"}
    ),
    to_materials=_lean_materials,
    not_identified="",
)
