"""Guess the unit or position that a person meant by an implausible number."""

from __future__ import annotations

NEAR_A_RANGE = 2.0  # times the longest: a nearer length has the right unit; a wrong unit is off 25 times or more
UNITS = (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254))


def unit_of(value: float, least: float, most: float) -> str:
    """Return a question that names the unit in which a length would fit the range.

    Return '' where the length fits already, or no unit fits.
    """
    if least <= value <= NEAR_A_RANGE * most:
        return ""
    fitting = [name for name, metres in UNITS if least <= value * metres <= most]
    return f"; were {' or '.join(fitting)} meant?" if fitting else ""


def step_or_anyway(step: str, offers_anyway: bool) -> str:
    """Return the next step, followed by the option --anyway where the command has it."""
    return f"{step}, or --anyway to accept it" if offers_anyway else step
