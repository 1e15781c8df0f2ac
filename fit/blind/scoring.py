"""The score of answers against labels: every rate with its Wilson interval, in bins of effect size.

    p = (k + z^2/2) / (n + z^2) ± z sqrt(k (n - k) / n + z^2/4) / (n + z^2),   z = 1.96

The size of an effect is its true amplitude over the smallest that the diagnosis says this data could have shown. A
named group counts as right where the truth is in it.
Source: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927); G. W. Brier, Monthly Weather Review 78 (1950).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from fit.blind.cases import Label
from fit.blind.plants import PLANTS, STRANGERS
from formats.results import Diagnosis, EffectFinding

BINS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, math.inf))
HEADLINE = (2.0, 4.0)
CONFIDENT = 0.8


@dataclass(frozen=True)
class Rate:
    """So many of so many, with a 95 % Wilson interval."""

    hits: int
    total: int

    @property
    def value(self) -> float:
        """Share, or NaN of none."""
        return self.hits / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval."""
        if not self.total:
            return 0.0, 1.0
        k, n, z = self.hits, self.total, 1.96
        middle, half = (k + z * z / 2) / (n + z * z), z * math.sqrt(k * (n - k) / n + z * z / 4) / (n + z * z)
        return max(middle - half, 0.0), min(middle + half, 1.0)

    def __str__(self) -> str:
        low, high = self.interval
        share = f"{100 * self.value:.0f} %" if self.total else "–"
        return f"{share} ({self.hits}/{self.total}) [{100 * low:.0f} to {100 * high:.0f} %]"


@dataclass(frozen=True)
class Answer:
    """One case: its label and what was said; a failed diagnosis has none."""

    case: str
    label: Label
    diagnosis: Diagnosis | None

    @property
    def verdict(self) -> str:
        """The verdict; `inconclusive` where the diagnosis failed."""
        return self.diagnosis.verdict if self.diagnosis else "inconclusive"

    @property
    def named(self) -> list[str]:
        """Effects that the verdict names."""
        return self.diagnosis.named if self.diagnosis else []

    def ranked(self) -> list[str]:
        """Effects in the order of the diagnosis, best first."""
        return [f.id for f in self.diagnosis.effects if f.tested and f.closure is not None] if self.diagnosis else []

    def finding(self, name: str) -> EffectFinding | None:
        """What was found of an effect."""
        found = self.diagnosis.effects if self.diagnosis else []
        return next((f for f in found if f.id == name), None)

    @property
    def size(self) -> float:
        """True amplitude over the minimum detectable one; infinite where there is no effect."""
        found = self.finding(self.label.names[0]) if self.label.names else None
        if found is None or not found.minimum_detectable:
            return math.nan
        return self.label.amplitudes[0] / found.minimum_detectable


@dataclass
class Score:
    """All rates by name, other figures by name, and the confusion of planted against first-named."""

    rates: dict[str, Rate] = field(default_factory=dict)
    figures: dict[str, float] = field(default_factory=dict)
    confusion: dict[tuple[str, str], int] = field(default_factory=dict)
    misses: list[str] = field(default_factory=list)


def score(answers: Sequence[Answer]) -> Score:
    """Score answers."""
    found = Score()
    kinds = {k: [a for a in answers if a.label.kind == k] for k in ("null", "single", "pair", "stranger")}
    nulls, singles, strangers = kinds["null"], kinds["single"], kinds["stranger"]
    found.rates["false alarms on nulls (an effect named)"] = _rate(bool(a.named) for a in nulls)
    found.rates["nulls called none"] = _rate(a.verdict == "none" for a in nulls)
    found.rates["single effects: right one or its group named"] = _rate(_is_right(a) for a in singles)
    found.rates["single effects: right where anything was named"] = _rate(_is_right(a) for a in singles if a.named)
    for low, high in BINS:
        chosen = [a for a in singles if low <= a.size < high]
        span = f"{low:g} to {high:g} times detectable" if math.isfinite(high) else f"above {low:g} times detectable"
        found.rates[f"  named right, {span}"] = _rate(_is_right(a) for a in chosen)
        found.rates[f"  in the first three, {span}"] = _rate(a.label.names[0] in a.ranked()[:3] for a in chosen)
    found.rates["unknown where no library has it"] = _rate(a.verdict == "unknown" for a in strangers)
    found.rates["not misnamed where no library has it"] = _rate(not a.named for a in strangers)
    found.rates["pairs: both named"] = _rate(set(a.label.names) <= set(a.named) for a in kinds["pair"])
    found.rates["pairs: at least one named, none wrong"] = _rate(
        bool(a.named) and set(a.named) <= set(a.label.names) for a in kinds["pair"]
    )
    given = [(a, p) for a in answers for p in [_probability(a)] if p is not None]
    found.rates["confident (0.8 and above) and wrong"] = _rate(p >= CONFIDENT and not _is_right(a) for a, p in given)
    if given:
        found.figures["Brier score of the named effect"] = float(np.mean([(p - _is_right(a)) ** 2 for a, p in given]))
    errors, covered = [], []
    for a in singles:
        f = a.finding(a.label.names[0])
        if f is not None and _is_right(a) and f.amplitude_interval is not None:
            errors.append(abs(abs(f.amplitude) - a.label.amplitudes[0]) / a.label.amplitudes[0])
            low, high = f.amplitude_interval
            low, high = (-high, -low) if f.amplitude < 0 else (low, high)
            covered.append(low <= a.label.amplitudes[0] <= high)
    if errors:
        found.figures["amplitude, median relative error where named right"] = float(np.median(errors))
    found.rates["amplitude: 90 % interval covers"] = _rate(covered)
    local = [a for a in (*singles, *strangers) if _place(a) and a.diagnosis is not None and a.verdict != "none"]
    found.rates["place found, local effects"] = _rate(_found_place(a) for a in local)
    for a in answers:
        planted = "+".join(a.label.names) or "nothing"
        said = a.named[0] if a.named else a.verdict
        found.confusion[planted, said] = found.confusion.get((planted, said), 0) + 1
        wanted = "none" if a.label.kind == "null" else "unknown" if a.label.kind == "stranger" else ""
        right = a.verdict == wanted if wanted else _is_right(a)
        if not right:
            found.misses.append(f"{a.case}: {planted} ({_sizes(a)}) -> {a.verdict} {' '.join(a.named)}".rstrip())
    return found


def _sizes(answer: Answer) -> str:
    sizes = ", ".join(f"{v:.3g}" for v in answer.label.amplitudes)
    return f"{sizes}; {answer.size:.1f} times detectable" if math.isfinite(answer.size) else sizes


def _rate(hits: Iterable[bool]) -> Rate:
    listed = [bool(h) for h in hits]
    return Rate(sum(listed), len(listed))


def _is_right(answer: Answer) -> bool:
    """Whether the planted effects are named: one of a group that was not told apart, or exactly those of `several`."""
    wanted, named = set(answer.label.names), set(answer.named)
    if not wanted or not named:
        return False
    if answer.verdict == "ambiguous":
        return bool(wanted & named)
    return named == wanted


def _probability(answer: Answer) -> float | None:
    found = answer.finding(answer.named[0]) if answer.named else None
    return found.probability if found else None


def _place(answer: Answer) -> str:
    known = {**PLANTS, **STRANGERS}
    return known[answer.label.names[0]].place if len(answer.label.names) == 1 else ""


def _found_place(answer: Answer) -> bool:
    assert answer.diagnosis is not None
    worst = max(answer.diagnosis.where.space, key=lambda b: b.value_mm, default=None)
    return worst is not None and worst.name.startswith(_place(answer))
