"""Material parameters of the base model in SI units, independent of the mesh."""

from __future__ import annotations

from dataclasses import dataclass, fields

# s: theta of viscous stretch (`fit.effects.stretch_viscosity`). Our choice: at 10 Hz the viscosity is 1.6 % less than
# without relaxation. At half it is nearer to that and takes twice the steps; at twice it is 6 % less (decision 10).
RELAXATION_TIME = 2e-3
# 1/m: change of curvature over which friction builds up (`fit.effects.bending_hysteresis`). Our choice: KES bends to
# 100 1/m. After a reversal, 20 1/m bring the moment to 96 % of the largest. At half 99.9 %, at twice 73 %.
REFERENCE_CURVATURE = 5.0


@dataclass(frozen=True, kw_only=True)
class Material:
    """Orthotropic membrane with bending and damping.

    - `areal_density` [kg/m^2]
    - `stretch_stiffness` [N/m] along warp and weft
    - `shear_stiffness` [N/m] per radian
    - `bending_stiffness` [N m]
    - `membrane_damping_time` [s], `bending_damping_time` [s]: Kelvin-Voigt; tension and moment follow stiffness x
      (strain + time x strain rate)
    - `velocity_damping` [1/s]: linear, of every node against still air

    Effects switch these on; they are zero in every base model:

    - `stretch_ratio`, `bending_ratio`: logarithms of warp over weft
    - `stiffening` [1]: relative growth of stretch stiffness per strain
    - `tilt_x`, `tilt_y` [rad]: gravity's angles
    - `viscosity_time` [s]: viscosity of stretch and shear over their stiffness (`fit.effects.stretch_viscosity`)
    - `gravity_log`: logarithm of gravity's acceleration over the standard one, for a clock at another rate
    """

    areal_density: float = 0.2  # our choice: near 0.197, the median of the same fabrics
    stretch_stiffness: float = 300.0  # our choice: within the 37 to 1000 N/m of `fit.methods.fabrics`
    shear_stiffness: float = 30.0  # our choice: within the 11 to 220 N/m of KES shear tests
    bending_stiffness: float = 1.4e-5  # median of 618 fabrics, ClothDrapeTester (SIGGRAPH Asia 2022)
    membrane_damping_time: float = 2e-5  # our choice: so short that it hardly shortens the step
    bending_damping_time: float = 1e-3  # our choice: within the base models' range, up to 0.02 s
    velocity_damping: float = 0.5  # our choice: a swing's amplitude falls by a fifth in a second
    stretch_ratio: float = 0.0
    bending_ratio: float = 0.0
    stiffening: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    viscosity_time: float = 0.0
    gravity_log: float = 0.0


MATERIAL_NAMES = tuple(f.name for f in fields(Material))
(
    DENSITY, STRETCH, SHEAR, BENDING, MEMBRANE_TIME, BENDING_TIME, VELOCITY,
    STRETCH_RATIO, BENDING_RATIO, STIFFENING, TILT_X, TILT_Y, VISCOSITY, GRAVITY_LOG,
) = range(len(MATERIAL_NAMES))  # fmt: skip
