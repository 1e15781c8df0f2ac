"""Effects that the generator can plant: those of the diagnosis' library, by other laws, and unknown ones.

Amplitudes are drawn log-uniformly over 0.5 to 3 times a typical size, cut off at the limits of apparel and sensors. The
amplitude of a vector of components is its length. The effects act by kind:

    cloth, air    fields of `fit.blind.engine.Cloth`
    boundary      `fit.blind.boundary`: the held edge is not where the markers say
    measurement   `fit.blind.sensing`: the points are not where or when the cloth was; gravity is a field of `Cloth`

Typical sizes and ranges: S. Kawabata's KES figures for apparel (2HB 1e-4 to 1e-3 N), H. Wang et al., "Data-driven
elastic models for cloth" (SIGGRAPH 2011), S. F. Hoerner, "Fluid-Dynamic Drag" (1965), K. Khoshelham & S. Oude Elberink,
Sensors 12 (2012); docs/reference/blind-check.md has the table. Self-contact is not generated. The default base model
has shear stiffness, so it is no effect. A clamped sheet shears by about a degree, which does not show stiffening in
shear. The points are material, so faults of silhouettes are not planted.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from dataclasses import dataclass

import msgspec
import numpy as np

from fit.blind.engine import Cloth
from fit.errors import FitError, nearest_first

# times the typical size. Our choice: from below to well above what a take can show. Half and double were not tried.
SMALLEST_PLANT, LARGEST_PLANT = 0.5, 3.0

BOTTOM_PLACES = ("bottom left", "bottom centre", "bottom right")


class Planted(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One planted effect: amplitude in `unit`, signed components, and the cloth's affected regions, if local."""

    id: str
    amplitude: float
    unit: str
    components: dict[str, float]
    place: tuple[str, ...] = ()
    in_library: bool = True
    seed: int = 0


@dataclass(frozen=True)
class Plant:
    """A kind of effect: unit, typical and largest amplitude, components, and distribution of their direction.

    - `direction`: `sign` one component of either sign, `positive`, `any` a random direction, `axis` one component
      alone, `equal` all components alike; `on_cloth` changes the cloth
    - `place`: regions by sign or component
    """

    id: str
    acts_on: str
    unit: str
    typical: float
    most: float
    components: tuple[str, ...] = ("",)
    direction: str = "positive"
    on_cloth: Callable[[Cloth, Planted], Cloth] | None = None
    place: tuple[str, ...] = ()
    in_library: bool = True

    def draw(self, rng: np.random.Generator, cloth: Cloth) -> Planted:
        """Draw an amplitude and a direction for this cloth."""
        least, most = SMALLEST_PLANT * self.typical, min(LARGEST_PLANT * self.typical, self.most)
        amplitude = float(np.exp(rng.uniform(np.log(least), np.log(most))))
        turn, sign, axis = rng.normal(size=len(self.components)), rng.choice([-1.0, 1.0]), rng.integers(8)
        seed = int(rng.integers(2**31))
        if self.id == "hem":
            amplitude = min(amplitude, 0.5 * cloth.density * cloth.height)
        direction = {
            "positive": np.ones(1),
            "sign": np.array([sign]),
            "any": turn / np.linalg.norm(turn),
            "axis": np.eye(len(self.components))[axis % len(self.components)] * sign,
            "positive axis": np.eye(len(self.components))[axis % len(self.components)],
            "equal": np.full(len(self.components), sign / np.sqrt(len(self.components))),
            "towards": np.array([np.sin(0.6 * np.tanh(turn[0])), sign * np.cos(0.6 * np.tanh(turn[0]))]),
        }[self.direction]
        parts = dict(zip(self.components, (amplitude * direction).tolist(), strict=True))
        place = self.place
        if self.id == "clip_slip":
            place = ("top left",) if parts["left"] > 0 else ("top right",)
        if self.id in {"corner_pendulum", "loose_thread"}:
            place = ("bottom left",) if sign < 0 else ("bottom right",)
            parts = {"": float(sign * amplitude)}
        return Planted(
            id=self.id, amplitude=amplitude, unit=self.unit, components=parts, place=place, in_library=self.in_library,
            seed=seed,
        )  # fmt: skip


def _field(*names: str) -> Callable[[Cloth, Planted], Cloth]:
    """Return a planter that sets one field per component of the amount."""

    def change(cloth: Cloth, planted: Planted) -> Cloth:
        values = dict(zip(names, planted.components.values(), strict=True))
        return dataclasses.replace(cloth, **values)  # type: ignore[arg-type]

    return change


def _pair(name: str) -> Callable[[Cloth, Planted], Cloth]:
    """Return a planter that sets one field that holds all components."""

    def change(cloth: Cloth, planted: Planted) -> Cloth:
        return dataclasses.replace(cloth, **{name: tuple(planted.components.values())})  # type: ignore[arg-type]

    return change


def _hem(cloth: Cloth, planted: Planted) -> Cloth:
    """Move mass to the hem at constant total mass."""
    return dataclasses.replace(cloth, hem=planted.amplitude, density=cloth.density - planted.amplitude / cloth.height)


def _draught(cloth: Cloth, planted: Planted) -> Cloth:
    wind = (planted.components["x"], planted.components["y"], 0.0)
    return dataclasses.replace(cloth, wind=wind, gust_phase=2 * np.pi * (planted.seed % 1000) / 1000)


def _at_corner(name: str) -> Callable[[Cloth, Planted], Cloth]:
    def change(cloth: Cloth, planted: Planted) -> Cloth:
        corner = 1 if planted.components[""] > 0 else -1
        amount = planted.amplitude
        if name == "bob":  # of the cloth's mass
            amount *= cloth.mass
        return dataclasses.replace(cloth, corner=corner, **{name: amount})  # type: ignore[arg-type]

    return change


PLANTS: tuple[Plant, ...] = (
    Plant("bending_hysteresis", "cloth", "N", 2e-4, 1e-3, on_cloth=_field("friction")),
    Plant("rest_curvature", "cloth", "1/m", 5.0, 40.0, ("horizontal", "vertical"), "axis", _pair("curl")),
    Plant("hem", "cloth", "kg/m", 0.01, 0.05, on_cloth=_hem, place=BOTTOM_PLACES),
    Plant("anisotropy", "cloth", "1", 0.7, 2.0, ("stretch", "bending"), "equal",
          _field("stretch_ratio", "bending_ratio")),
    Plant("strain_stiffening", "cloth", "1", 40.0, 120.0, on_cloth=_field("stiffening")),
    Plant("bending_viscosity", "cloth", "N m s", 1e-6, 1e-5, on_cloth=_field("bend_viscosity")),
    Plant("stretch_viscosity", "cloth", "s", 3e-4, 1e-3, on_cloth=_field("stretch_time")),
    Plant("mass_distribution", "cloth", "1", 0.3, 0.7, ("across", "down"), "any", _pair("mass_slope")),
    Plant("hanger_compliance", "boundary", "s^2", 7e-4, 2e-3),
    Plant("hanger_rotation", "boundary", "rad", 0.03, 0.1, ("yaw", "roll"), "any"),
    Plant("attachment_offset", "boundary", "m", 0.01, 0.03, ("along", "down", "out"), "any"),
    Plant("clip_slip", "boundary", "m", 0.005, 0.015, ("left", "right"), "positive axis"),
    Plant("clip_slack", "boundary", "m", 0.008, 0.02, direction="sign"),
    Plant("air_drag", "air", "1", 1.2, 2.5, on_cloth=_field("drag")),
    Plant("added_mass", "air", "kg/m^2", 0.1, 0.4, on_cloth=_field("added_mass")),
    Plant("draught", "air", "m/s", 0.3, 0.6, ("x", "y"), "towards", _draught),
    Plant("air_lift", "air", "1", 2.0, 6.0, on_cloth=_field("lift")),
    Plant("time_offset", "measurement", "s", 0.02, 0.06, direction="sign"),
    Plant("gravity_tilt", "measurement", "rad", 0.02, 0.052, ("x", "y"), "any", _pair("gravity_tilt")),
    Plant("depth_scale", "measurement", "1", 0.01, 0.03, ("points", "scene"), "axis"),
    Plant("filter_lag", "measurement", "s", 0.02, 0.06),
    Plant("corner_erosion", "measurement", "m", 0.008, 0.02, place=("bottom left", "bottom right")),
    Plant("clock_drift", "measurement", "1", 0.005, 0.015, direction="sign"),
    Plant("tracker_smoothing", "measurement", "1", 0.4, 1.0),
)  # fmt: skip

UNKNOWNS: tuple[Plant, ...] = (
    Plant("wake_memory", "air", "N s/m^3", 0.8, 2.4, on_cloth=_field("wake"), in_library=False),
    Plant("corner_pendulum", "cloth", "1", 0.1, 0.3, on_cloth=_at_corner("bob"), in_library=False),
    Plant("loose_thread", "boundary", "N/m", 0.5, 1.5, on_cloth=_at_corner("thread"), in_library=False),
    Plant("hidden_magnet", "air", "N", 0.05, 0.15, on_cloth=_field("magnet"), in_library=False,
          place=("middle centre", "bottom centre")),
)  # fmt: skip


def choose_plants(names: list[str], offered: Collection[str], how: str) -> tuple[Plant, ...]:
    """Return the effects of these names, or all `offered` ones without names; how: phrase for the error.

    Raises:
        FitError: a name that cannot be planted.
    """
    known = {plant.id: plant for plant in PLANTS if plant.id in offered}
    for name in names:
        if name not in known:
            raise FitError(
                f"no effect named {name!r} can be planted {how}",
                where="--effect",
                advice=nearest_first(name, sorted(known), "known"),
            )
    return tuple(known[name] for name in names) or tuple(known.values())


def with_plants(cloth: Cloth, planted: tuple[Planted, ...]) -> Cloth:
    """Return the cloth with the planted effects of cloth and air."""
    kinds = {plant.id: plant for plant in PLANTS + UNKNOWNS}
    for one in planted:
        change = kinds[one.id].on_cloth
        if change is not None:
            cloth = change(cloth, one)
    return cloth
