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
from formats.near_names import near_names

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
