"""Sort takes into fitted and held-out ones: one garment, no take twice, each take known by its content."""

from __future__ import annotations

import hashlib
from collections.abc import Collection

import msgspec
import numpy as np

from fit.errors import FitError
from fit.recordings.copies import Track, are_copies
from formats.garment import Garment
from formats.motion import MOTION_KINDS, kind_of
from formats.take import Take


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
        FitError: no take, takes of different garments, or two that hold frames of one recording.
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
    tracks = [Track(take) for take in every]
    for place, take in enumerate(every):
        for before in range(place):
            is_same = contents[before] == contents[place]
            if not is_same and not are_copies(tracks[before], tracks[place]):
                continue
            is_shared = before < len(training) <= place
            if is_same:
                what = "this take is both fitted to and held out" if is_shared else "this take is given twice"
            else:
                other = every[before].take_id
                other = "another take of its name" if other == take.take_id else repr(other)
                what = f"this take holds frames of the recording that {other} holds"
                what += ", which is fitted to" if is_shared else ""
            raise FitError(
                what, where=take.take_id,
                advice="judge on takes that are not fitted to" if is_shared else "give every recording once",
            )  # fmt: skip
    return contents


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
