"""Anisotropy: warp (down the cloth) and weft (across it) differ in stiffness.

    k_warp = k e^(a/2),  k_weft = k e^(-a/2);   B_warp, B_weft alike

The amplitude is a: positive where warp, which runs down the cloth, is stiffer than weft.

Believe it when the takes bend and load the cloth both ways. Cloth that hangs from one edge loads mostly the threads
that run down.

Source: orthotropic plate; warp over weft bending of 618 fabrics is 0.39 to 4.6 (5 to 95 %), median 1.48
(ClothDrapeTester, SIGGRAPH Asia 2022).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class Anisotropy(Effect):
    """Logarithm of warp over weft, of stretch and of bending stiffness."""

    name: ClassVar[str] = "anisotropy"
    title: ClassVar[str] = "warp and weft of different stiffness"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -3.0  # our choice: as far as `high`
    high: ClassVar[float] = 3.0  # our choice: a ratio of 20; 95 % of the 618 fabrics stay below 4.6 in bending
    typical: ClassVar[float] = 0.7  # our choice: a ratio of 2, within those fabrics' range
    differs_by_solver: ClassVar[bool] = True  # a mesh's diagonals, and how fibres share the tension with the ground
    components: ClassVar[tuple[str, ...]] = ("stretch", "bending")

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with different warp and weft."""
        changed = row.copy()
        changed[mat.STRETCH_RATIO] += amplitude[0]
        changed[mat.BENDING_RATIO] += amplitude[1]
        return np.asarray(changed)
