"""Rates with Wilson intervals, medians and Brier scores, each with its number of cases.

    p_W = (k + z^2/2) / (n + z^2),   half = z / (n + z^2) sqrt(k (n - k) / n + z^2 / 4),   z = 1.96 for 95 %

Source: E. B. Wilson, JASA 22 (1927); the interval as in L. D. Brown, T. T. Cai, A. DasGupta, Statist. Sci. 16 (2001),
section 3.1.1. Brier: G. W. Brier, Mon. Wea. Rev. 78 (1950), the sum over classes.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np

Z = 1.959964  # 95 %; quantile of the standard normal distribution at 97.5 %


class Rate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rate k of n with its 95 % Wilson interval; None without cases."""

    k: int
    n: int
    rate: float | None
    low: float | None
    high: float | None

    def __str__(self) -> str:
        """Return the rate, its interval and its counts as text for a terminal."""
        if self.rate is None or self.low is None or self.high is None:
            return "no case"
        return f"{100 * self.rate:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]  {self.k}/{self.n}"


def wilson(k: int, n: int) -> tuple[float, float]:
    """Return the 95 % Wilson interval of k of n."""
    middle, half = (k + Z**2 / 2) / (n + Z**2), Z / (n + Z**2) * np.sqrt(k * (n - k) / n + Z**2 / 4)
    return max(float(middle - half), 0.0), min(float(middle + half), 1.0)


def rate_of(claims: Iterable[bool]) -> Rate:
    """Return the rate of true claims."""
    held = list(claims)
    k, n = sum(held), len(held)
    if not n:
        return Rate(k=0, n=0, rate=None, low=None, high=None)
    low, high = wilson(k, n)
    return Rate(k=k, n=n, rate=k / n, low=low, high=high)


def median(values: list[float]) -> float | None:
    """Return the median, or None without values."""
    return float(np.median(values)) if values else None


def mean(values: list[float]) -> float | None:
    """Return the mean, or None without values."""
    return float(np.mean(values)) if values else None


def brier(probabilities: dict[str, float], truth: str) -> float:
    """Return the squared distance of probabilities from what was true, summed over classes; `` is all that is left."""
    shares = {**probabilities, "": max(1 - sum(probabilities.values()), 0.0)}
    truth = truth if truth in shares else ""
    return sum((p - (name == truth)) ** 2 for name, p in shares.items())
