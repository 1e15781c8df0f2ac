"""Rest curvature: the cloth was rolled or folded and wants to stay curved.

    E = B/2 integral of (kappa - kappa_0)^2,    force = -B W (W x - kappa_0 sqrt(area) n)

kappa_0 is uniform over the garment. Its two components curl the cloth about the horizontal (up or down) and about the
vertical (the sides). A positive value bends the cloth towards the outer normal n. `fit.cloth.bends` defines W.

The amplitude is kappa_0 about the horizontal and about the vertical; positive curls towards the outer normal.

Believe it when the cloth curls at rest, in every take to the same side of the cloth. Turn the cloth round: a curl
turns with it, a draught does not.

Source: E. Grinspun et al., "Discrete Shells" (SCA 2003), section 3 (rest angles); creases reach 1 to 40 1/m.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.bends import COLUMN_BEND, ROW_BEND
from fit.cloth.effect import Effect
from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats


@dataclass(frozen=True)
class RestCurvature(Effect):
    """Curvature of the unloaded cloth about the horizontal and about the vertical."""

    name: ClassVar[str] = "rest_curvature"
    title: ClassVar[str] = "cloth that is curved at rest"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "1/m"
    low: ClassVar[float] = -40.0  # our choice: as far as `high`
    high: ClassVar[float] = 40.0  # the sharpest creases, as the module states
    typical: ClassVar[float] = 5.0  # our choice: within the 1 to 40 1/m of creases
    # A curl is rarely uniform: half as strong again at one end, half as strong at the other. Such a curl differs by
    # 0.29 rms from its mean. Our choice: a little less. From 0.26 on laws may leave all that any effect
    # may, 0.6 of a gap.
    law_spread: ClassVar[float] = 0.25
    components: ClassVar[tuple[str, ...]] = ("horizontal", "vertical")
    bends: ClassVar[bool] = True

    def rest_curvature(self, mesh: ClothMesh, amplitude: Floats) -> Floats:
        """Return the curvature at which each bend rests [1/m], (bends,)."""
        return np.where(
            mesh.bends.kind == COLUMN_BEND, amplitude[0], np.where(mesh.bends.kind == ROW_BEND, amplitude[1], 0.0)
        )
