"""Four fabrics as starts of a fit: values set by hand from tables, each with its source.

The motion capture paper used silk, denim, cotton and polyester/rayon 65/35 ("Optimization of Cloth Simulation
Parameters by Considering Static and Dynamic Features", section 2). The paper does not print their properties. These
tables stand in:

    [W] H. Wang, J. O'Brien, R. Ramamoorthi, "Data-Driven Elastic Models for Cloth", SIGGRAPH 2011, ten fabrics, as
        published with ARCSim: density; stretching at zero strain, root of warp x weft; bending at zero curvature, mean
        of warp, bias and weft
    [F] X. Feng et al., "Learning-Based Bending Stiffness Parameter Estimation by a Drape Tester", SIGGRAPH Asia 2022,
        618 fabrics, median
    [U] Unreal Engine documentation, Chaos Cloth, "Density": silk 0.1, cotton 0.2, denim 0.4 kg/m^2
    [M] W. E. Morton, J. W. S. Hearle, "Physical Properties of Textile Fibres", chapter 5, fibre densities: silk 1340,
        cotton 1540, polyester 1390, viscose rayon 1490 kg/m^3. Nominal thickness = density / (0.35 x fibre density);
        the packing of 0.35 is our choice: it makes cotton of 0.2 kg/m^2 0.37 mm thick

None of these tables has damping. The 1 /s is our choice: a swing's amplitude falls by two fifths in a second.
"""

from __future__ import annotations

from dataclasses import dataclass

from fit.errors import unknown_name

FIBRE_VOLUME_SHARE = 0.35  # share of a fabric's volume that is fibre; our choice: as the docstring states
MANUAL_DAMPING = 1.0  # 1/s; our choice: as the docstring states


@dataclass(frozen=True, kw_only=True)
class Fabric:
    """A fabric as tables describe it: SI, isotropic."""

    name: str
    composition: str
    density: float  # kg/m^2
    stretching_stiffness: float  # N/m
    bending_stiffness: float  # N m
    fibre_density: float  # kg/m^3
    source: str

    @property
    def thickness(self) -> float:
        """Nominal thickness [m] from the packing of its fibres."""
        return self.density / (FIBRE_VOLUME_SHARE * self.fibre_density)

    @property
    def start(self) -> dict[str, float]:
        """Values for the parameters of the methods in physical units, by name."""
        return {
            "density": self.density,
            "stretching_stiffness": self.stretching_stiffness,
            "stretch_stiffness": self.stretching_stiffness,
            "bending_stiffness": self.bending_stiffness,
            "damping_coefficient": MANUAL_DAMPING,
            "velocity_damping": MANUAL_DAMPING,
        }


FABRICS = {
    fabric.name: fabric
    for fabric in (
        Fabric(
            name="silk", composition="silk, light filament weave", density=0.1, stretching_stiffness=86.0,
            bending_stiffness=1.9e-5, fibre_density=1340.0,
            source="density [U]; stiffnesses of the nearest measured fabric, a light polyester jacket cloth of "
            "0.113 kg/m2 (`tango-red-jet-set` [W]). No measured silk was found in the open",
        ),
        Fabric(
            name="denim", composition="11 oz denim, 99 % cotton, 1 % spandex", density=0.324,
            stretching_stiffness=456.0, bending_stiffness=7.8e-5, fibre_density=1540.0,
            source="measured: `11oz-black-denim` [W]",
        ),
        Fabric(
            name="cotton", composition="cotton, medium weave", density=0.197, stretching_stiffness=1000.0,
            bending_stiffness=1.4e-5, fibre_density=1540.0,
            source="density and bending: the median fabric [F], near cotton's 0.2 kg/m2 [U]. Stretching: 65/35 "
            "cotton/polyester trousers have 2026 N/m (`royal-target` [W]), cut to the method's 1000 N/m",
        ),
        Fabric(
            name="polyester-rayon", composition="polyester 65 %, rayon 35 %", density=0.284,
            stretching_stiffness=37.0, bending_stiffness=3.6e-5, fibre_density=1425.0,
            source="measured on a 60/40 jacket cloth: `camel-ponte-roma` [W]",
        ),
    )
}  # fmt: skip


# Words by which people may look for a fabric: of the table's four, the one whose composition or weave comes nearest.
WORDS_FOR = {"silk": "satin chiffon", "denim": "jeans", "cotton": "calico", "polyester-rayon": "viscose jersey"}


def find_fabric(name: str, where: str | None = None) -> Fabric:
    """Return the fabric of this name; where: the option that names it, for errors.

    Raises:
        FitError: there is none.
    """
    if name not in FABRICS:
        titles = {one.name: f"{one.composition} {WORDS_FOR[one.name]}" for one in FABRICS.values()}
        raise unknown_name("fabric", name, FABRICS, where=where, titles=titles)
    return FABRICS[name]
