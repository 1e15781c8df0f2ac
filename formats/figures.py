"""Write numbers for people: few digits, no exponent where none is needed, the unit behind, round steps of an axis."""

from __future__ import annotations

import math

# steps of an axis, times a power of ten. Our choice: round numbers that divide ten or its multiples, at most 2.5
# times apart; a scale in sevenths is hard to read.
AXIS_STEPS = (1, 2, 2.5, 5, 10)

NOISELESS_DIGITS = (
    12  # significant digits; our choice: more than any typed bound has, and fewer than double precision holds
)
# ulp, units in the last place. A logarithm and its exponential miss the bounds of all methods by 6 at most.
# Our choice: more than twice as much, which still changes no digit that a person reads.
ROUNDINGS = 16

# Decimals that a number gets beyond its usual ones, so that it reads as on its side of a limit. Our choice: six more
# tell apart whatever differs by more than rounding.
MOST_MORE_DECIMALS = 6


def short(value: float, digits: int = 3) -> str:  # our choice: no fit knows a parameter to more
    """Return a number with this many significant digits; below a million, whole numbers stay in full.

    The text is plain ASCII, which terminals show and people copy; `fit.report.text.number` sets numbers for a page.
    """
    if 10**digits <= abs(float(f"{value:.{digits}g}")) and abs(value) < 999_999.5:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def without_noise(value: float) -> float:
    """Return a number without the rounding noise of a sum or a logarithm: 0.3 for 0.30000000000000004.

    A number that `NOISELESS_DIGITS` digits do not give within a few roundings stays as it is, with every digit.
    """
    plain = float(f"{value:.{NOISELESS_DIGITS}g}")
    return plain if abs(plain - value) <= ROUNDINGS * math.ulp(value) else value


def beside(value: float, limit: float, decimals: int = 0, of_limit: int | None = None) -> tuple[str, str]:
    """Return a number and the limit that it is compared with, both with as many decimals as show which is larger.

    24.8 beside 25 is `24.8` and not `25`. A limit that its usual decimals state exactly keeps them.

    - `decimals`: of the number, if these suffice; `of_limit`: of the limit, those of the number if None
    """
    usual = decimals if of_limit is None else of_limit
    is_exact = float(f"{limit:.{usual}f}") == limit
    for more in range(MOST_MORE_DECIMALS + 1):
        many = usual if is_exact or not more else max(usual, decimals + more)
        left, right = f"{value:z.{decimals + more}f}", f"{limit:.{many}f}"
        if (float(left) < float(right), float(left) > float(right)) == (value < limit, value > limit):
            return left, right
    return f"{value:z.{decimals}f}", f"{limit:.{usual}f}"  # they differ by rounding alone


def short_beside(value: float, limit: float, digits: int = 3) -> tuple[str, str]:  # our choice: as above
    """Return a number and another one that it differs from, both with as many significant digits as show this."""
    for more in range(digits, digits + MOST_MORE_DECIMALS + 1):
        if short(value, more) != short(limit, more):
            return short(value, more), short(limit, more)
    return short(value, digits), short(limit, digits)


def span_of(ends: tuple[float, float], digits: int = 3) -> str:  # our choice: as above
    """Return an interval as `low to high`."""
    return f"{short(ends[0], digits)} to {short(ends[1], digits)}"


def with_unit(text: str, unit: str) -> str:
    """Return a written number with its unit: none behind a pure number, and `2 per s` for 2 of the unit 1/s."""
    if not text or unit in ("", "1"):
        return text
    return f"{text} per {unit.removeprefix('1/')}" if unit.startswith("1/") else f"{text} {unit}"


def head_of(name: str, unit: str) -> str:
    """Return a name with its unit in brackets; the name alone for a pure number."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def round_step(least: float) -> float:
    """Return the least round step of an axis that is no shorter than this, which is above 0."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(round(power * nice, 12) for nice in AXIS_STEPS if power * nice >= least * (1 - 1e-9))
