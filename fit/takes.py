"""Several takes of one garment: none of them twice, and known by what is in them rather than by their names."""

from __future__ import annotations

import hashlib

import msgspec
import numpy as np

from fit.errors import FitError
from formats.results import Diagnosis, FitResult
from formats.take import Take


def content_of(take: Take) -> str:
    """Return the sha256, in hexadecimal, of all that a fit sees of a take: two recordings may have one name."""
    whole = hashlib.sha256(msgspec.json.encode([take.take_id, take.rig, take.garment]))
    arrays = (take.time, take.held, take.held_valid, take.held_sd, take.points, take.points_valid, take.points_sd)
    for array in arrays:
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def is_of(result: FitResult | Diagnosis, takes: list[Take]) -> bool:
    """Return whether a result is of these takes; by their names alone where it is so old that it says no more."""
    if not result.take_contents:
        return result.take_ids == [take.take_id for take in takes]
    return result.take_contents == [content_of(take) for take in takes]


def check_together(training: list[Take], held_out: list[Take]) -> None:
    """Check that takes can be fitted to, and judged on, together.

    Raises:
        FitError: no take, takes of different garments, or one that is given twice.
    """
    if not training:
        raise FitError("no take was given", advice="name at least one take archive")
    every = training + held_out
    for take in every[1:]:
        if take.garment != every[0].garment:
            raise FitError(
                f"takes of different garments: {every[0].garment.name!r} and {take.garment.name!r}",
                where=take.take_id,
                advice="fit and diagnose one garment at a time",
            )
    seen: dict[str, int] = {}
    for place, take in enumerate(every):
        before = seen.setdefault(content_of(take), place)
        if before != place:
            is_shared = before < len(training) <= place
            raise FitError(
                "this take is both fitted to and held out" if is_shared else "this take is given twice",
                where=take.take_id,
                advice="judge on takes that are not fitted to" if is_shared else "name every take once",
            )
