"""Errors of fitting and diagnosis.

HangtimeError
  +-- FitError            the request cannot be fitted
        +-- MismatchError a take that contradicts its garment, its rig or its other clock
        +-- DriveError    a hanger path that no cloth can follow (gaps, jumps)
              +-- ImpossiblePathError   one with jumps, or with exchanged ends
        +-- BlowUpError     a simulation that did not stay finite
        +-- BatchError    a folder, bucket or cluster that a batch cannot work with
              +-- UnreachableError   one that is unreachable or full for a while; exit code 75
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from formats.errors import HangtimeError
from formats.meant_units import meant

NEAR_NAMES = 2  # names that an error suggests; our choice: a suggestion is read at a glance
# Of a word that stands for a whole name: its letters at least, and its likeness (difflib's ratio). Our choice: two
# letters that changed places leave 0.88 of eight, and shorter words resemble too many others.
LEAST_LETTERS, NEAR_WORD = 4, 0.75
NEAR_WHOLE = 0.6  # likeness of a whole name; difflib's own choice
AS_LIKELY = 0.15  # likeness below the best one's, of a second suggestion; our choice: `drg` is 0.86 drag, 0.6 draught
INCONCLUSIVE = 4  # exit code of a finished `hangtime diagnose` whose takes cannot decide


class FitError(HangtimeError):
    """A fit or diagnosis that cannot be started or finished as requested."""


def out_of_range(
    value: float, least: float, most: float, what: str, *, where: str, unit: str, units: Sequence[tuple[str, float]]
) -> FitError:
    """Return the error of a number outside its range, with the unit that was probably meant.

    - `what`: what is wrong with the number; `where`: its option
    - `unit`: of the range, for the next step
    - `units`: others, as for `meant`
    """
    return FitError(
        f"{what}{meant(value, least, most, units)}", where=where, advice=f"give {least:g} to {most:g} {unit}"
    )


def unknown_name(
    kind: str, name: str, known: Iterable[str], *, where: str | None = None, listed: str = "",
    titles: Mapping[str, str] | None = None,
) -> FitError:  # fmt: skip
    """Return the error of a name that is not known, with the nearest known names first.

    - `kind`: the name's noun, as in "effect"
    - `where`: the option that names it
    - `listed`: words before all known names, "known" and the noun's plural if empty
    - `titles`: what known names stand for, in words that the wrong name may mean
    """
    advice = nearest_first(name, list(known), listed or f"known {kind}s", titles)
    return FitError(f"there is no {kind} named {name!r}", where=where, advice=advice)


def nearest_first(name: str, known: Sequence[str], listed: str, titles: Mapping[str, str] | None = None) -> str:
    """Return the advice on a name that is not known: all known names, after the question whether a near one was meant.

    listed: words before all known names where none is near; titles: as for `near_names`
    """
    near = near_names(name, known, titles)
    if not near:
        return f"{listed}: {', '.join(known)}"
    others = ", ".join(one for one in known if one not in near)
    return f"did you mean {' or '.join(near)}?" + (f" The others: {others}" if others else "")


def near_names(name: str, known: Sequence[str], titles: Mapping[str, str] | None = None) -> list[str]:
    """Return the known names that a wrong one probably means, likeliest first.

    These are names of the same words in any order, else those that have it as a word. Else they are the most similar
    ones. Names are compared as a whole, with their words in order, and by single words of a name or title (`titles`).
    """
    asked = _plain(str(name))  # calls from Python may name anything
    if not asked:
        return []
    plain = {one: _plain(one) for one in known}
    same = [one for one, words in plain.items() if _in_order(words) == _in_order(asked)]
    parts = [one for one, words in plain.items() if f"_{asked}_" in f"_{words}_"]
    if same or parts:
        return (same or parts)[:NEAR_NAMES]
    found = {one: _likeness(asked, words, _plain((titles or {}).get(one, ""))) for one, words in plain.items()}
    best = sorted((one for one in known if found[one] > 0.0), key=lambda one: -found[one])
    return [one for one in best if found[one] >= found[best[0]] - AS_LIKELY][:NEAR_NAMES]


def _likeness(asked: str, words: str, title: str) -> float:
    """Return how like a known name is to one that was asked for, up to 1. A name too unlike to be meant has 0."""
    from difflib import SequenceMatcher  # here: no right name needs it

    def ratio(one: str, other: str) -> float:
        return SequenceMatcher(None, one, other).ratio()

    whole = max(ratio(asked, words), ratio(_in_order(asked), _in_order(words)))
    single = [word for word in f"{words}_{title}".split("_") if len(word) >= LEAST_LETTERS]
    of_words = [max((ratio(part, word) for word in single), default=0.0) for part in asked.split("_")]
    by_word = min(of_words)
    return max(whole if whole >= NEAR_WHOLE else 0.0, by_word if by_word >= NEAR_WORD else 0.0)


def _in_order(words: str) -> str:
    return "_".join(sorted(words.split("_")))


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "_").replace(" ", "_")


class DriveError(FitError):
    """A hanger path with gaps or jumps that no simulation can be driven by."""


class MismatchError(FitError):
    """A take that contradicts its garment, its rig or its other clock, which lost frames do not cause."""


class ImpossiblePathError(DriveError):
    """A hanger path with jumps or exchanged ends, which lost frames do not cause."""


class BlowUpError(FitError):
    """Every candidate of a batch became infinite or not a number."""


class BatchError(FitError):
    """A folder, bucket or cluster that a batch cannot work with."""


class UnreachableError(BatchError):
    """A temporary failure: a bucket or cluster that cannot be reached, or a full disk."""

    exit_code = 75  # EX_TEMPFAIL of sysexits.h: a service manager may try again
