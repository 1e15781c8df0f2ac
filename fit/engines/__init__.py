"""Simulators behind one contract, by name."""

from __future__ import annotations

from fit.engines.blender import BlenderEngine
from fit.engines.contract import Engine, EngineMaker, OwnEngine
from fit.errors import FitError

__all__ = ["ENGINES", "OWN_ENGINE", "BlenderEngine", "Engine", "EngineMaker", "OwnEngine", "find_engine"]

OWN_ENGINE = "own"
ENGINES: dict[str, EngineMaker] = {OWN_ENGINE: OwnEngine, "blender": BlenderEngine}


def find_engine(name: str) -> EngineMaker:
    """Return the maker of the engine of this name.

    Raises:
        FitError: there is none.
    """
    if name not in ENGINES:
        raise FitError(f"there is no engine named {name!r}", advice=f"known engines: {', '.join(ENGINES)}")
    return ENGINES[name]
