"""Registry of the simulators that implement the common engine interface."""

from __future__ import annotations

from fit.cloth.effect import Effect
from fit.engines.blender import BlenderEngine, check_blender
from fit.engines.contract import Engine, EngineMaker, OwnEngine
from fit.errors import unknown_name
from fit.methods.method import Parameterisation

__all__ = [
    "ENGINES",
    "OWN_ENGINE",
    "BlenderEngine",
    "Engine",
    "EngineMaker",
    "OwnEngine",
    "check_engine",
    "find_engine",
]

OWN_ENGINE = "own"
ENGINES: dict[str, EngineMaker] = {OWN_ENGINE: OwnEngine, "blender": BlenderEngine}


def find_engine(name: str, where: str | None = None) -> EngineMaker:
    """Return the maker of the engine of this name; where: the option that names it, for errors.

    Raises:
        FitError: there is none.
    """
    if name not in ENGINES:
        raise unknown_name("engine", name, ENGINES, where=where)
    return ENGINES[name]


def check_engine(name: str, method: Parameterisation, effects: tuple[Effect, ...]) -> None:
    """Refuse an engine that is not installed or lacks these parameters and effects, before takes are read.

    Raises:
        FitError: the engine cannot be used; the error advises on installation or another choice.
    """
    if find_engine(name, "--engine") is BlenderEngine:
        check_blender(method, effects)
