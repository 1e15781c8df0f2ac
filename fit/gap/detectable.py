"""Smallest detectable amplitude of each effect's components in given takes.

A component is detectable from the larger of two amplitudes on. The score test finds the first with power 0.8 beside the
noise (`fit.gap.screening`). The second moves the points by as much as the rules of the verdict require. A component
that moves the tracked held edge may show there at a smaller amplitude (`fit.gap.edge_fit`).
"""

from __future__ import annotations

import numpy as np

from fit.cloth.effect import Effect
from fit.gap.closure import SIGNIFICANT_GAP
from fit.gap.correlation import correlation_of
from fit.gap.edge_fit import detectable_on_edge
from fit.gap.evidence import Evidence, per_millimetre
from formats.arrays import Floats

# Share of the squared error of mesh and solver that an effect must remove. Our choice: at 0, an error of the mesh alone
# could be named. The smallest nameable amplitude grows with the root: at half it is 0.7 times, at twice 1.4 times.
MESH_SHARE = 0.5
# The same for effects by which sound solvers differ, which must remove more than all of it. Our choice: at the eighth
# look at sealed cases `anisotropy`, then under `MESH_SHARE`, was named twice without a cause. Half,
# 1.5, held before for `stretch_viscosity` alone. Double was not tried.
SOLVER_TIMES = 3.0


def mesh_share(effect: Effect) -> float:
    """Return the share of mesh and solver error, squared, that an effect must remove to be named."""
    return SOLVER_TIMES if effect.differs_by_solver else MESH_SHARE


def needed_mm2(evidence: Evidence, effect: str) -> float:
    """Return the mean squared motion [mm^2] by which an effect must move the points by the verdict's rules.

    An effect is named only if it removes more than a share of mesh and solver error. The gap must also be clearly above
    the noise (`fit.gap.passing`).
    """
    share = mesh_share(evidence.observer.library[effect])
    return max(share * evidence.numerics_mm**2, (SIGNIFICANT_GAP - 1) * evidence.floor_mm**2)


def resolvable(evidence: Evidence, effect: str) -> float:
    """Return the amplitude at which a screened effect moves the points as far as the verdict's rules require.

    A smaller amplitude cannot be named, even without noise.
    """
    needed = needed_mm2(evidence, effect)
    return float(np.sqrt(needed)) * per_millimetre(evidence.observer, evidence.screened[effect])


def smallest_detectable(evidence: Evidence) -> dict[str, Floats]:
    """Return the smallest detectable amplitude of each screened effect's components, (components,).

    The amplitude is infinite if a component moves nothing.
    """
    observer, screened = evidence.observer, evidence.screened
    least = min([evidence.base, *evidence.singles.values()], key=lambda h: h.fitted.cost).fitted.residual
    correlation, block = correlation_of(observer, least), observer.layout.block
    on_edge = detectable_on_edge(observer, evidence.judge, screened)
    return {
        name: np.minimum(
            np.maximum(one.minimum_detectable(least, block, correlation), resolvable(evidence, name)), on_edge[name]
        )
        for name, one in screened.items()
    }


def unseen(library: dict[str, Effect], smallest: dict[str, Floats]) -> list[str]:
    """Name the effects that are undetectable at their typical sizes, with their smallest detectable amplitudes.

    smallest: as `smallest_detectable` returns it; effects that move nothing in these takes are left out
    """
    found = []
    for name, sizes in smallest.items():
        effect = library[name]
        for component, size in zip(effect.components, sizes, strict=True):
            if np.isfinite(size) and size > effect.typical:
                of = f" ({component})" if component else ""
                found.append((size / effect.typical, f"{effect.title}{of} below {in_words(float(size), effect.unit)}"))
    return [said for _, said in sorted(found)]


def in_words(size: float, unit: str) -> str:
    """Return a size with its unit; angles in degrees."""
    if unit == "rad":
        return f"{np.degrees(size):.2g} degrees"
    return f"{size:.2g}" + ("" if unit == "1" else f" {unit}")
