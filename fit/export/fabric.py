"""The fabric of a fit: its SI quantities with intervals and their status, such as identified or constant.

`fit.virtual_tests.fitted_rows` determines which parameters decide a quantity, and its interval.

Layers that slide on one another share weight, tension, shear and bending (`fit.virtual_tests.sheet`); the quantities
are of one layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from fit.cloth import material as mat
from fit.engines import OWN_ENGINE
from fit.errors import FitError
from fit.folders import notes_of_diagnosis, own_warnings
from fit.virtual_tests.fitted_rows import FittedRows, Read
from formats.fit_records import Combination, FitParameter, FitResult, warnings_in

Measured = Literal["measured", "measured, in doubt", "measured by a model that lacks an effect"]
Status = Measured | Literal["not identified", "no interval", "weighed", "tied to stretch", "assumed"]

MEANING_OF_STATUS: dict[Status, str] = {
    "measured": "the takes identify it; 90 % interval",
    "measured, in doubt": "the takes identify it, but the fit warns of all its numbers; 90 % interval",
    "measured by a model that lacks an effect": "the takes identify it, but the value may make up for the missing "
    "effect; 90 % interval",
    "not identified": "the takes do not identify it: the whole interval stays possible",
    "no interval": "fitted, without a computed interval",
    "weighed": "from the garment's weight and area, not from its motion",
    "tied to stretch": "the method ties it to the stretch stiffness; not measured by itself",
    "assumed": "a constant of the method; not measured",
}


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One quantity of a fabric in SI units; low and high are a 90 % interval, None without an interval."""

    name: str
    value: float
    unit: str
    meaning: str
    status: Status
    low: float | None = None
    high: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether the value is known: identified or weighed."""
        return self.status in (*get_args(Measured), "weighed")


@dataclass(frozen=True, kw_only=True)
class Fabric:
    """One layer of a fitted fabric; the garment's sheet has `layers` of them."""

    quantities: tuple[Quantity, ...]
    layers: int

    def __getitem__(self, name: str) -> Quantity:
        """Return the quantity of this name."""
        return next(q for q in self.quantities if q.name == name)

    def get(self, name: str) -> float:
        """Return a quantity's value, 0 if the fabric does not have it."""
        return next((q.value for q in self.quantities if q.name == name), 0.0)

    def mean_of_ways(self, name: str) -> float:
        """Return the geometric mean of warp and weft, for a format with one direction."""
        return float(np.sqrt(self[f"{name}_warp"].value * self[f"{name}_weft"].value))

    @property
    def not_identified(self) -> tuple[Quantity, ...]:
        """Return the quantities that the takes do not identify."""
        return tuple(q for q in self.quantities if q.status in ("not identified", "no interval"))

    @property
    def whole(self) -> Fabric:
        """Return all layers as one sheet, as the fit simulated them."""
        if self.layers == 1:
            return self
        return Fabric(
            quantities=tuple(_times(q, self.layers) if q.name in SHARED_NUMBERS else q for q in self.quantities),
            layers=1,
        )


SHARED_NUMBERS = (
    "areal_density", "stretch_warp", "stretch_weft", "shear", "bending_warp", "bending_weft", "bending_friction",
    "added_mass",
)  # fmt: skip
# Name, unit, meaning, and function of a material row.
_FROM_MATERIAL: tuple[tuple[str, str, str, Read], ...] = (
    ("areal_density", "kg/m^2", "mass per area", lambda r: r[mat.DENSITY]),
    ("stretch_warp", "N/m", "tension per strain along the warp, which runs down the cloth",
     lambda r: r[mat.STRETCH] * np.exp(r[mat.STRETCH_RATIO] / 2)),
    ("stretch_weft", "N/m", "tension per strain along the weft, which runs across the cloth",
     lambda r: r[mat.STRETCH] * np.exp(-r[mat.STRETCH_RATIO] / 2)),
    ("shear", "N/m", "shear force per width and radian", lambda r: r[mat.SHEAR]),
    ("bending_warp", "N m", "moment per width and curvature, of a bend that runs down the cloth",
     lambda r: r[mat.BENDING] * np.exp(r[mat.BENDING_RATIO] / 2)),
    ("bending_weft", "N m", "moment per width and curvature, of a bend that runs across the cloth",
     lambda r: r[mat.BENDING] * np.exp(-r[mat.BENDING_RATIO] / 2)),
    ("stretch_damping_time", "s", "membrane viscosity over membrane stiffness",
     lambda r: r[mat.MEMBRANE_TIME] + r[mat.VISCOSITY]),
    ("bending_damping_time", "s", "bending viscosity over bending stiffness", lambda r: r[mat.BENDING_TIME]),
    ("velocity_damping", "1/s", "linear damping of all motion against still air", lambda r: r[mat.VELOCITY]),
    ("stiffening", "1", "relative growth of the stretch stiffness per strain", lambda r: r[mat.STIFFENING]),
)  # fmt: skip
_FROM_EFFECTS = {
    "air_drag": ("drag_coefficient", "1", "times a face's area and half the air's density and speed squared"),
    "added_mass": ("added_mass", "kg/m^2", "mass of air that moves along in the middle of the cloth"),
    "bending_hysteresis": ("bending_friction", "N", "largest frictional moment per width"),
}


def fabric_of(result: FitResult) -> Fabric:
    """Return the fabric of a fit.

    Raises:
        FitError: the fit has no SI values: another engine's, one that fitted the weight, or an older version's. Or its
        method is unknown.
    """
    if reason := why_no_fabric(result):
        kinds = [k for k in WITHOUT_FABRIC if k != "blender" or result.method == "kinect-skirt"]
        if result.engine != OWN_ENGINE:  # its cloth keeps no shapes
            kinds = [k for k in kinds if k in ("csv", "parquet", "blender")]
        raise FitError(reason, where=result.label, advice=f"this fit can be exported as {', '.join(kinds)}")
    rows = FittedRows(result)
    found = [
        quantity
        for name, unit, meaning, read in _FROM_MATERIAL
        for quantity in [_quantity(name, unit, meaning, rows, read, result)]
        if quantity.value != 0.0 or name not in ("stiffening",)
    ]
    stretch = rows.parameters_behind(lambda r: r[mat.STRETCH])
    found = [_tied(q, rows, stretch) if q.name == "shear" else q for q in found]
    for effect, (name, unit, meaning) in _FROM_EFFECTS.items():
        parameter = next((p for p in result.parameters if p.name == effect), None)
        if parameter is not None:
            found.append(
                Quantity(
                    name=name, value=parameter.fitted, unit=unit, meaning=meaning,
                    status=status_of([parameter], result), low=parameter.interval_low, high=parameter.interval_high,
                )
            )  # fmt: skip
    share = 1 / result.layers
    return Fabric(
        quantities=tuple(_times(q, share) if q.name in SHARED_NUMBERS else q for q in found), layers=result.layers
    )


WITHOUT_FABRIC = ("csv", "parquet", "blender", "usd", "gltf", "pc2", "abc")


def why_no_fabric(result: FitResult) -> str:
    """Return the reason why a fit has no fabric in SI units, or nothing if it has one."""
    if result.engine != OWN_ENGINE:
        return f"the fit is of {result.engine}'s cloth, whose numbers have no SI values"
    names = {p.name for p in result.parameters}
    if fitted := sorted(names & {"mass", "density"}):
        return (
            f"the method {result.method} fits the {fitted[0]}, which motion does not tell; none of its numbers has an "
            f"SI value. Fit with si or {result.method}-weighed for those"
        )
    if not set(mat.MATERIAL_NAMES) <= result.material.keys():
        return "the fit does not hold its material; its version is older"
    return ""


def _quantity(name: str, unit: str, meaning: str, rows: FittedRows, read: Read, result: FitResult) -> Quantity:
    behind = rows.parameters_behind(read)
    ends = rows.ends(read, behind)
    status: Status = status_of(behind, result) if behind else "weighed" if name == "areal_density" else "assumed"
    same = [c for c in result.combinations if c.name == name.replace("_", " ")]
    if same and len(behind) > 1:  # the takes may identify the quantity without identifying any of its parameters
        status, ends = status_of(same, result), (same[0].interval_low, same[0].interval_high)
    low, high = ends if ends is not None else (None, None)
    return Quantity(
        name=name, value=float(read(rows.fitted)), unit=unit, meaning=meaning, status=status, low=low, high=high
    )


def status_of(behind: Sequence[FitParameter | Combination], result: FitResult) -> Status:
    """Return the status of a quantity of a fit that depends on these fitted parameters."""
    if any(p.is_identified is False for p in behind):
        return "not identified"
    return "no interval" if any(p.is_identified is None for p in behind) else _measured(result)


def _measured(result: FitResult) -> Measured:
    """Return the status of identified numbers of a fit, which may warn of all of them or lack an effect."""
    if notes_of_diagnosis(result.notes):
        return "measured by a model that lacks an effect"
    return "measured, in doubt" if warnings_in(own_warnings(result.notes)) else "measured"


def _tied(shear: Quantity, rows: FittedRows, stretch: list[FitParameter]) -> Quantity:
    """Return shear with its status for a method that makes it a share of the stretch stiffness."""
    behind = rows.parameters_behind(lambda r: r[mat.SHEAR])
    if behind and [p.name for p in behind] == [p.name for p in stretch] and shear.status in get_args(Measured):
        return replace(shear, status="tied to stretch")
    return shear


def _times(quantity: Quantity, share: float) -> Quantity:
    return replace(
        quantity, value=quantity.value * share,
        low=None if quantity.low is None else quantity.low * share,
        high=None if quantity.high is None else quantity.high * share,
    )  # fmt: skip
