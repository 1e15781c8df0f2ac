"""Selection of fitted and held-out takes: checks for one garment and for repeated recordings, and content digests."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from typing import Any

import msgspec
import numpy as np

from fit.errors import FitError, unknown_name
from fit.recordings.copies import Track, are_copies
from fit.recordings.intact import naming_damage
from formats.garment import Garment
from formats.motion import MOTION_KINDS, kind_of
from formats.plain_text import counted, shortened
from formats.take import Take, told_apart

# differing fields of a garment that one sentence names. Our choice: more would hide the sentence's advice.
MOST_FIELDS = 2


def content_of(take: Take) -> str:
    """Return the sha256, in hexadecimal, of a take's content that a fit uses, because two takes may have one name."""
    whole = hashlib.sha256(msgspec.json.encode([take.take_id, take.rig, take.garment]))
    arrays = (take.time, take.held, take.held_valid, take.held_sd, take.points, take.points_valid, take.points_sd)
    for array in arrays:
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def content_of_garment(garment: Garment) -> str:
    """Return the sha256, in hexadecimal, of a garment's description."""
    return hashlib.sha256(msgspec.json.encode(garment)).hexdigest()


def _differences(one: Take, other: Take) -> str:
    """Return `mass_kg is 0.04 in 'a' and 0.041 in 'b'` for up to two differing fields, and the number of others.

    Values are compared by meaning, whatever the version of the format.
    """
    names = told_apart([one, other])
    fields = [field.name for field in msgspec.structs.fields(Garment)]
    found = []
    for name in sorted(fields, key=lambda field: field != "name"):
        here, there = (msgspec.to_builtins(getattr(take.garment.as_meant, name)) for take in (one, other))
        if here != there:
            found.append(_first_difference(name, here, there, names))
    rest = len(found) - MOST_FIELDS
    return "; ".join(found[:MOST_FIELDS]) + (f"; and {counted(rest, 'more field')}" if rest > 0 else "")


def _first_difference(place: str, one: Any, other: Any, ids: Sequence[str]) -> str:
    """Return the path of the first difference between two plain values, and both values there."""
    if isinstance(one, dict) and isinstance(other, dict):
        key = next(key for key in one if one[key] != other.get(key))
        return _first_difference(f"{place}.{key}", one[key], other.get(key), ids)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        if len(one) != len(other):
            return f"{place} has the length {len(one)} in {ids[0]!r} and {len(other)} in {ids[1]!r}"
        k = next(k for k in range(len(one)) if one[k] != other[k])
        return _first_difference(f"{place}[{k}]", one[k], other[k], ids)
    here, there = ("left out" if v is None else repr(shortened(v) if isinstance(v, str) else v) for v in (one, other))
    return f"{place} is {here} in {ids[0]!r} and {there} in {ids[1]!r}"


def check_together(training: list[Take], held_out: list[Take]) -> list[str]:
    """Check that takes form a valid set of fitted and held-out takes; return their content digests in order.

    Raises:
        FitError: no take, takes of different garments, or two that hold frames of one recording.
    """
    if not training:
        raise FitError("no take was given", where=None, advice="name at least one take archive")
    every = training + held_out
    for take in every[1:]:
        if take.garment.as_meant != every[0].garment.as_meant:
            raise FitError(
                f"takes of different garments: {_differences(every[0], take)}", where=told_apart([take, every[0]])[0],
                advice="fit and diagnose one garment at a time, and give all its takes one description",
            )  # fmt: skip
    contents = [content_of(take) for take in every]
    tracks = [Track(take) for take in every]
    for place, take in enumerate(every):
        for before in range(place):
            is_same = contents[before] == contents[place]
            if not is_same and not are_copies(tracks[before], tracks[place]):
                continue
            is_shared = before < len(training) <= place
            own, other = told_apart([take, every[before]])
            if is_same:
                what = "this take is both fitted to and held out" if is_shared else "this take is given twice"
            else:
                other = "another take of its name" if other == own else repr(other)
                what = f"this take holds frames of the recording that {other} holds"
                what += ", which is fitted to" if is_shared else ""
            raise FitError(
                what, where=own,
                advice="judge on takes that are not fitted to" if is_shared else "give every recording once",
            )  # fmt: skip
    return contents


def split_by_motion(takes: list[Take], kinds: Collection[str]) -> tuple[list[Take], list[Take]]:
    """Split takes into those to fit to and held-out ones of the given kinds of motion, in their order.

    Raises:
        FitError: an unknown kind, a kind that no take is of, or nothing left to fit to.
    """
    for kind in kinds:
        if kind not in MOTION_KINDS:
            raise unknown_name("kind of motion", kind, MOTION_KINDS, where="--held-out-motion", listed="choose among")
    by_take = [kind_of(take) for take in takes]
    there = ", ".join(f"{name} {kind}" for name, kind in zip(told_apart(takes), by_take, strict=True))
    with naming_damage(takes):
        for kind in kinds:
            if kind not in by_take:
                raise FitError(
                    f"no take moves {kind!r}",
                    where=None,
                    advice=f"hold out another kind, or add a take of this one; the takes move like this: {there}",
                )
        if kinds and set(by_take) <= set(kinds):
            raise FitError(
                "every take is held out and none is left to fit to",
                where=None,
                advice=f"add a take of another kind; the takes move like this: {there}",
            )
    both = list(zip(takes, by_take, strict=True))
    return [t for t, kind in both if kind not in kinds], [t for t, kind in both if kind in kinds]
