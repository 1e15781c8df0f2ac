"""Registry of the methods: named parameter vectors with their objective, one file per method."""

from __future__ import annotations

from fit.errors import unknown_name
from fit.methods.kinect_skirt import KINECT_SKIRT, KINECT_SKIRT_WEIGHED
from fit.methods.method import Parameter, Parameterisation
from fit.methods.mocap_swatch import MOCAP_SWATCH, MOCAP_SWATCH_WEIGHED
from fit.methods.physical_units import LEAN, SI, SI_OUTLINE, SI_SEWN
from formats.garment import Garment

__all__ = [
    "BASE_MODELS",
    "KINECT_SKIRT",
    "KINECT_SKIRT_WEIGHED",
    "LEAN",
    "METHODS",
    "MOCAP_SWATCH",
    "MOCAP_SWATCH_WEIGHED",
    "SI",
    "SI_OUTLINE",
    "SI_SEWN",
    "Parameter",
    "Parameterisation",
    "base_model_of",
    "find_base_model",
    "find_method",
]

METHODS = {
    p.name: p
    for p in (KINECT_SKIRT, KINECT_SKIRT_WEIGHED, MOCAP_SWATCH, MOCAP_SWATCH_WEIGHED, SI, SI_OUTLINE, SI_SEWN, LEAN)
}
# A diagnosis needs an SI material with the weight known, and points fitted as points. The published six may fit the
# weight as well: their diagnosis says what this model lacks.
BASE_MODELS = (SI.name, SI_SEWN.name, LEAN.name, KINECT_SKIRT.name)


def find_method(name: str, where: str | None = None) -> Parameterisation:
    """Return the parameterisation of this name; where: the option that names it, for errors.

    Raises:
        FitError: there is none.
    """
    if name not in METHODS:
        raise unknown_name("method", name, METHODS, where=where)
    return METHODS[name]


def find_base_model(name: str) -> Parameterisation:
    """Return the base model of a diagnosis that has this name.

    Raises:
        FitError: there is none.
    """
    if name not in BASE_MODELS:
        raise unknown_name("base model", name, BASE_MODELS, where="--model")
    return METHODS[name]


def base_model_of(garment: Garment) -> Parameterisation:
    """Return the default base model of a garment's diagnosis; a T-shirt's sleeves and hems are sewn layers."""
    return SI_SEWN if garment.kind == "t-shirt" else SI
