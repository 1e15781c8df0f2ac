"""Named parameter vectors and how each maps to the solver's SI material.

`kinect-skirt` is the six-parameter vector of Blender's cloth as in "Estimating the clothes characteristics with the
image and depth sensors for developing virtual fitting room", Tables 1 and 2. Blender's numbers have no SI meaning of
their own; ours are tied to the solver like this (rho_w is the garment's weighed density):

    areal density            rho = Mass rho_w                     Mass 1 is the garment as weighed
    stretch stiffness        k   = 10 Struct          [N/m]       5 to 80 -> 50 to 800 N/m
    shear stiffness          G   = k / 10             [N/m]
    bending stiffness        B   = 1e-6 Bend          [N m]       0.1 to 150 -> 1e-7 to 1.5e-4, as measured on fabrics
    bending damping time     tau = 4e-4 Spring        [s]
    membrane damping time          1e-6 Spring        [s]
    velocity damping         c   = 0.02 Air / rho - 25 ln(Velocity)   [1/s]

Air is a linear drag per area [0.02 N s/m^3 each], Velocity the factor that is left of each velocity after one frame of
1/25 s. Multiplying rho, k, G, B and the drag by the same number changes no motion, so Mass alone is not identified.

`si` is the diagnosis' base model: the weighed density is taken as known, so every parameter is identified in principle.
`lean` is `si` without shear stiffness and bending viscosity, which are effects of the diagnosis' library then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth import material as mat
from fit.errors import FitError

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: its range, its standard step for annealing, and whether it is searched on a log scale."""

    name: str
    unit: str
    initial: float
    minimum: float
    maximum: float
    interval: float
    is_log: bool = False
    meaning: str = ""


@dataclass(frozen=True, kw_only=True)
class Parameterisation:
    """A named parameter vector and its map to material rows."""

    name: str
    parameters: tuple[Parameter, ...]
    to_materials: Callable[[Floats, float], Floats]
    not_identified: str
    scale: str = ""  # the parameter that only scales all others and that no motion can tell

    @property
    def initial(self) -> Floats:
        """Initial values, (parameters,)."""
        return np.array([p.initial for p in self.parameters])

    @property
    def minimum(self) -> Floats:
        """Lower bounds, (parameters,)."""
        return np.array([p.minimum for p in self.parameters])

    @property
    def maximum(self) -> Floats:
        """Upper bounds, (parameters,)."""
        return np.array([p.maximum for p in self.parameters])

    @property
    def interval(self) -> Floats:
        """Standard steps theta_s of the annealing, (parameters,)."""
        return np.array([p.interval for p in self.parameters])

    @property
    def is_log(self) -> NDArray[np.bool_]:
        """Which parameters are searched on a log scale, (parameters,)."""
        return np.array([p.is_log for p in self.parameters])


def _kinect_materials(vectors: Floats, weighed_density: float) -> Floats:
    mass, struct, bend, spring, air, velocity = vectors.T
    density = mass * weighed_density
    rows = np.zeros((len(vectors), len(mat.NAMES)))
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
        "Only ratios to the density are; `--method si` takes the garment's weight as known."
    ),
    scale="mass",
)  # fmt: skip


def _si_materials(vectors: Floats, weighed_density: float) -> Floats:
    stretch, shear, bending, bending_time, velocity = vectors.T
    rows = np.zeros((len(vectors), len(mat.NAMES)))
    rows[:, mat.DENSITY] = weighed_density
    rows[:, mat.STRETCH] = stretch
    rows[:, mat.SHEAR] = shear
    rows[:, mat.BENDING] = bending
    rows[:, mat.MEMBRANE_TIME] = 2e-5
    rows[:, mat.BENDING_TIME] = bending_time
    rows[:, mat.VELOCITY] = velocity
    return rows


# Ranges: stretch is capped where strain under the cloth's own weight falls below what a depth sensor sees;
# shear 11-84 (220) N/m (KES, 0.2-4 gf/(cm deg)); bending 1e-6 to 1.1e-4 N m (618 fabrics).
SI = Parameterisation(
    name="si",
    parameters=(
        Parameter(name="stretch_stiffness", unit="N/m", initial=300.0, minimum=30.0, maximum=1000.0, interval=100.0,
                  is_log=True, meaning="tension per strain, warp and weft"),
        Parameter(name="shear_stiffness", unit="N/m", initial=30.0, minimum=3.0, maximum=220.0, interval=10.0,
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


def _lean_materials(vectors: Floats, weighed_density: float) -> Floats:
    stretch, bending, velocity = vectors.T
    rows = np.zeros((len(vectors), len(mat.NAMES)))
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

METHODS = {p.name: p for p in (KINECT_SKIRT, SI, LEAN)}


def find_method(name: str) -> Parameterisation:
    """Return the parameterisation of this name.

    Raises:
        FitError: there is none.
    """
    if name not in METHODS:
        raise FitError(f"there is no method named {name!r}", advice=f"known methods: {', '.join(METHODS)}")
    return METHODS[name]
