"""Virtual tests of a fitted material by the Kawabata Evaluation System (KES): tension, shear and bending.

The material is the solver's (`fit.cloth.rollout`): tensions S11 = k E (1 + a |E|) of the Green strain E, S12 = G
Fu . Fv, moment B kappa, and Dahl friction M_max where a fit switched it on. Per direction, forces per width of the
unstrained specimen:

    tension    up to F_m = 500 gf/cm with the width held: lambda S11(E) = F_m, E = (lambda^2 - 1) / 2
               EMT = lambda - 1,  WT = k (E^2 / 2 + a E^3 / 3), the stored energy,  LT = WT / (F_m EMT / 2),
               RT = 100 % as the law stores all of it;  first slope = k
    shear      threads keep their lengths, so Fu . Fv = sin phi and the force is G sin phi;
               G = its slope between 0.5 and 5 degrees, 0.14 % below the tangent at 0;  2HG = 0, no friction in shear
    bending    B = slope of the moment between 0.5 and 1.5 1/cm;  2HB = 2 M_max, the friction is saturated at 1 1/cm

Sources: S. Kawabata, "The Standardization and Analysis of Hand Evaluation" (2nd edition 1980), chapter 2, for loads,
angles, curvatures and quantities; J. Bonet, R. D. Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis",
section 6.4, for the law. Units: 1 gf = 9.80665e-3 N.

Motion loads cloth with its own weight, about 1 N/m. The tensile tester pulls with 490 N/m. So EMT, WT and LT are the
law's extrapolation; the first slope is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth.material import REFERENCE_CURVATURE

GRAM_FORCE = 9.80665e-3  # N: a gram at the standard acceleration of free fall (ISO 80000-3)
TENSION_UNIT = GRAM_FORCE / 1e-2  # N/m per gf/cm; also J/m^2 per gf cm/cm^2
SHEAR_UNIT = TENSION_UNIT / np.radians(1.0)  # N/m per gf/(cm degree)
BENDING_UNIT = GRAM_FORCE * 1e-2  # N m per gf cm^2/cm
HYSTERESIS_UNIT = GRAM_FORCE  # N per gf cm/cm
WEIGHT_UNIT = 1e-2  # kg/m^2 per mg/cm^2
LARGEST_TENSION = 500.0 * TENSION_UNIT  # N/m, the standard condition
SHEAR_ANGLES = np.radians([0.5, 5.0])  # rad, between which KES reads G
BENDING_CURVATURE = 100.0  # 1/m, where 2HB is read


@dataclass(frozen=True, kw_only=True)
class DirectionSheet:
    """One direction: first slope gf/cm, EMT %, WT gf cm/cm^2, LT, B gf cm^2/cm, 2HB gf cm/cm."""

    first_slope: float
    extension: float
    tensile_energy: float
    linearity: float
    bending: float
    bending_hysteresis: float


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A KES-style sheet: weight mg/cm^2, shear gf/(cm degree), and each direction."""

    weight: float
    shear: float
    warp: DirectionSheet
    weft: DirectionSheet


def tension(extension: float, stiffness: float, stiffening: float = 0.0) -> float:
    """Return the force per width [N/m] at an extension (lambda - 1) of cloth of this stretch stiffness [N/m]."""
    strain = ((1 + extension) ** 2 - 1) / 2
    return (1 + extension) * stiffness * strain * (1 + stiffening * abs(strain))


def stretch_test(stiffness: float, stiffening: float = 0.0, load: float = LARGEST_TENSION) -> tuple[float, float]:
    """Return extension [1] and stored energy [J/m^2] of cloth pulled with a load per width [N/m]."""
    from scipy.optimize import brentq

    beyond = 1.0
    while tension(beyond, stiffness, stiffening) < load:
        beyond *= 2
    extension = float(brentq(lambda e: tension(e, stiffness, stiffening) - load, 0.0, beyond, xtol=1e-12))
    strain = ((1 + extension) ** 2 - 1) / 2
    return extension, stiffness * (strain**2 / 2 + stiffening * strain**3 / 3)


def shear_test(stiffness: float) -> float:
    """Return the mean slope [N/m per radian] of the shear force between 0.5 and 5 degrees."""
    low, high = SHEAR_ANGLES
    return float(stiffness * (np.sin(high) - np.sin(low)) / (high - low))


def make_sheet(material: dict[str, float], friction_moment: float = 0.0) -> Sheet:
    """Return the sheet of a material (`fit.cloth.material.MATERIAL_NAMES` by name) with a friction in bending [N]."""
    halves = {"warp": 0.5, "weft": -0.5}
    loop = 2 * friction_moment * (1 - np.exp(-BENDING_CURVATURE / REFERENCE_CURVATURE))
    directions = {}
    for name, half in halves.items():
        stiffness = material["stretch_stiffness"] * np.exp(half * material["stretch_ratio"])
        extension, energy = stretch_test(stiffness, material["stiffening"])
        directions[name] = DirectionSheet(
            first_slope=float(stiffness / TENSION_UNIT),
            extension=100 * extension,
            tensile_energy=energy / TENSION_UNIT,
            linearity=energy / (0.5 * LARGEST_TENSION * extension),
            bending=float(material["bending_stiffness"] * np.exp(half * material["bending_ratio"]) / BENDING_UNIT),
            bending_hysteresis=float(loop / HYSTERESIS_UNIT),
        )
    return Sheet(
        weight=material["areal_density"] / WEIGHT_UNIT,
        shear=shear_test(material["shear_stiffness"]) / SHEAR_UNIT,
        warp=directions["warp"],
        weft=directions["weft"],
    )
