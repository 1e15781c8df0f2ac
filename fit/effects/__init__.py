"""The library of effects. A new effect is one file and one line in `LIBRARY`."""

from fit.effects.air_drag import AirDrag
from fit.effects.base import Effect
from fit.effects.hem import Hem
from fit.effects.time_offset import TimeOffset
from fit.errors import FitError

LIBRARY: tuple[Effect, ...] = (AirDrag(), Hem(), TimeOffset())


def find_effects(names: list[str]) -> tuple[Effect, ...]:
    """Return the effects of these names.

    Raises:
        FitError: a name is not in the library.
    """
    known = {effect.name: effect for effect in LIBRARY}
    for name in names:
        if name not in known:
            raise FitError(f"there is no effect named {name!r}", advice=f"known effects: {', '.join(sorted(known))}")
    return tuple(known[name] for name in names)
