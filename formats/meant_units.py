"""Guess what a person meant who typed a number that nothing has: another unit, or a point in another place."""

from __future__ import annotations

NEAR_A_RANGE = 2.0  # times the longest: so near a length is meant as it is; a wrong unit is wrong by 25 times and more
UNITS = (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254))


def unit_of(value: float, least: float, most: float) -> str:
    """Return a question for the unit in which a length would fit, nothing where none does or none is needed."""
    if least <= value <= NEAR_A_RANGE * most:
        return ""
    fitting = [name for name, metres in UNITS if least <= value * metres <= most]
    return f"; were {' or '.join(fitting)} meant?" if fitting else ""


def step_or_anyway(step: str, offers_anyway: bool) -> str:
    """Return the next step, with the option that accepts the number where the command has it."""
    return f"{step}, or --anyway to accept it" if offers_anyway else step
