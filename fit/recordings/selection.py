"""Sort takes into fitted and held-out ones: one garment, no take twice, each take known by its content."""

from __future__ import annotations

import hashlib
from collections.abc import Collection

import msgspec
import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.recordings.held_edge import is_held
from formats.garment import Garment
from formats.motion import MOTION_KINDS, kind_of
from formats.take import Take

# Of the places of points. Sixteen recordings of one cloth share 0.1 % at most. Two recordings of cloth at rest with
# noise of 0.02 mm share 23 %, as archives keep whole steps of 0.02 mm.
MOST_SHARED = 0.5
Uint64s = NDArray[np.uint64]


def content_of(take: Take) -> str:
    """Return the sha256, in hexadecimal, of all that a fit sees of a take: two recordings may have one name."""
    whole = hashlib.sha256(msgspec.json.encode([take.take_id, take.rig, take.garment]))
    arrays = (take.time, take.held, take.held_valid, take.held_sd, take.points, take.points_valid, take.points_sd)
    for array in arrays:
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def content_of_garment(garment: Garment) -> str:
    """Return the sha256, in hexadecimal, of a garment's description."""
    return hashlib.sha256(msgspec.json.encode(garment)).hexdigest()


def check_together(training: list[Take], held_out: list[Take]) -> list[str]:
    """Check that takes can be fitted to, and judged on, together, and return their contents, in their order.

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
    contents = [content_of(take) for take in every]
    places = [places_of(take) for take in every]
    for place, take in enumerate(every):
        for before in range(place):
            if contents[before] != contents[place] and shared_places(places[before], places[place]) < MOST_SHARED:
                continue
            is_shared = before < len(training) <= place
            raise FitError(
                "this take is both fitted to and held out" if is_shared else "this take is given twice",
                where=take.take_id,
                advice="judge on takes that are not fitted to" if is_shared else "name every take once",
            )
    return contents


def places_of(take: Take) -> Uint64s:
    """Return a number for each place, (n,), ascending, that a free point of the take has in one frame alone.

    Places that come again, as at rest without noise, tell nothing. The held points tell of the hanger alone. The
    number stands for the point and its exact coordinates: two places have one by a chance of 2^-64.
    """
    flat = np.array([point.at_m for point in take.garment.points]).reshape(-1, 2)
    seen = take.points_valid & np.isfinite(take.points).all(2) & ~is_held(take.garment, flat)
    bits = np.ascontiguousarray(take.points, float).view(np.uint64)
    point = np.broadcast_to(np.arange(bits.shape[1], dtype=np.uint64)[None, :, None], (*bits.shape[:2], 1))
    mixed = np.concatenate([bits, point], 2)[seen]
    numbers = np.zeros(len(mixed), np.uint64)
    for column in mixed.T:  # one multiplication and shift for each, as in splitmix64 (Steele, Lea, Flood, 2014)
        numbers = (numbers ^ column) * np.uint64(0xBF58476D1CE4E5B9)
        numbers ^= numbers >> np.uint64(31)
    unique, count = np.unique(numbers, return_counts=True)
    return np.asarray(unique[count == 1])


def shared_places(one: Uint64s, other: Uint64s) -> float:
    """Return the share of the places of the take that has fewer (`places_of`) which the other take has too.

    A copy of a recording that is cut, damaged or edited, or whose clock begins anew, shares nearly all of them.
    """
    shared = np.intersect1d(one, other, assume_unique=True)
    return len(shared) / max(min(len(one), len(other)), 1)


def split_by_motion(takes: list[Take], kinds: Collection[str]) -> tuple[list[Take], list[Take]]:
    """Return the takes to fit to and those of the given kinds of motion, in their order.

    Raises:
        FitError: an unknown kind, a kind that no take is of, or nothing left to fit to.
    """
    for kind in kinds:
        if kind not in MOTION_KINDS:
            raise FitError(
                f"there is no kind of motion named {kind!r}", advice=f"choose among {', '.join(MOTION_KINDS)}"
            )
    by_take = [kind_of(take) for take in takes]
    there = ", ".join(f"{take.take_id} {kind}" for take, kind in zip(takes, by_take, strict=True))
    for kind in kinds:
        if kind not in by_take:
            raise FitError(f"no take moves {kind!r}", advice=f"the takes move like this: {there}")
    if kinds and set(by_take) <= set(kinds):
        raise FitError("every take is held out and none is left to fit to", advice=f"the takes move like this: {there}")
    both = list(zip(takes, by_take, strict=True))
    return [t for t, kind in both if kind not in kinds], [t for t, kind in both if kind in kinds]
