"""Ranges of published fabric measurements in KES units, for comparison with a fitted fabric.

[W] ten fabrics, H. Wang, J. O'Brien, R. Ramamoorthi, "Data-Driven Elastic Models for Cloth", SIGGRAPH 2011, as
    published with ARCSim. Stretching at zero strain, C11 and C22. Its shear constant acts on half of Fu . Fv, so it is
    four times our G. Bending at the least curvature, warp and weft.
[F] 618 fabrics, X. Feng et al., "Learning-Based Bending Stiffness Parameter Estimation by a Drape Tester", SIGGRAPH
    Asia 2022, cantilever: quantiles at 5, 25, 50, 75 and 95 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.virtual_tests.kes import BENDING_UNIT, SHEAR_UNIT, TENSION_UNIT, WEIGHT_UNIT

PERCENTILES = (
    5.0,
    25.0,
    50.0,
    75.0,
    95.0,
)  # per cent; our choice: quartiles, and one fabric in twenty beyond either end


@dataclass(frozen=True)
class MeasuredFabric:
    """One of the ten [W]: kg/m^2; N/m; N/m (the published shear constant); N m."""

    name: str
    composition: str
    density: float
    stretch: tuple[float, float]
    shear_constant: float
    bending: tuple[float, float]


TEN = (
    MeasuredFabric("ivory-rib-knit", "95 % cotton, 5 % spandex", 0.276, (42.9, 65.2), 83.2, (46.2e-6, 32.2e-6)),
    MeasuredFabric("pink-ribbon-brown", "polyester", 0.228, (151.5, 244.8), 30.3, (117.1e-6, 59.8e-6)),
    MeasuredFabric("white-dots-on-blk", "polyester", 0.128, (2002.1, 2027.5), 19.2, (51.7e-6, 31.3e-6)),
    MeasuredFabric("navy-sparkle-sweat", "96 % polyester, 4 % spandex", 0.224, (12.5, 3.3), 17.6, (59.5e-6, 45.6e-6)),
    MeasuredFabric("camel-ponte-roma", "60 % polyester, 40 % rayon", 0.284, (31.1, 44.0), 31.9, (36.3e-6, 37.2e-6)),
    MeasuredFabric("gray-interlock", "60 % cotton, 40 % polyester", 0.187, (16.6, 34.5), 36.9, (23.2e-6, 14.3e-6)),
    MeasuredFabric("11oz-black-denim", "99 % cotton, 1 % spandex", 0.324, (205.4, 1013.9), 53.4, (64.2e-6, 97.0e-6)),
    MeasuredFabric("white-swim-solid", "87 % nylon, 13 % spandex", 0.204, (48.0, 104.6), 60.8, (60.2e-6, 51.0e-6)),
    MeasuredFabric("tango-red-jet-set", "polyester", 0.113, (43.1, 171.4), 14.3, (14.3e-6, 20.3e-6)),
    MeasuredFabric("royal-target", "65 % cotton, 35 % polyester", 0.220, (2016.6, 2035.0), 104.8, (125.4e-6, 125.4e-6)),
)

QUANTILES = {
    "weight": tuple(value / WEIGHT_UNIT for value in (0.031, 0.104, 0.197, 0.294, 0.488)),
    "bending warp": tuple(value / BENDING_UNIT for value in (1.1e-6, 4.1e-6, 1.4e-5, 3.6e-5, 1.1e-4)),
    "bending weft": tuple(value / BENDING_UNIT for value in (0.9e-6, 3.3e-6, 0.9e-5, 2.4e-5, 5.0e-5)),
}


def range_of_ten(quantity: str) -> tuple[float, float]:
    """Return the least and the largest of the ten in KES units: weight, slope, shear or bending."""
    values = {
        "weight": [f.density / WEIGHT_UNIT for f in TEN],
        "slope": [k / TENSION_UNIT for f in TEN for k in f.stretch],
        "shear": [f.shear_constant / 4 / SHEAR_UNIT for f in TEN],
        "bending": [b / BENDING_UNIT for f in TEN for b in f.bending],
    }[quantity]
    return float(min(values)), float(max(values))


def share_below(quantity: str, value: float) -> str:
    """Return in words the share of the 618 fabrics with a smaller value, by log-linear interpolation of quantiles."""
    marks = QUANTILES[quantity]
    if value < marks[0]:
        return "less than 95 % of them"
    if value > marks[-1]:
        return "more than 95 % of them"
    return f"more than {float(np.interp(np.log(value), np.log(marks), PERCENTILES)):.0f} % of them"
