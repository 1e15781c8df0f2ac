"""Takes that are judged on instead of fitted to, chosen by how their hanger moves."""

from __future__ import annotations

from collections.abc import Collection

from fit.errors import FitError
from formats.motion import KINDS, kind_of
from formats.take import Take


def split_by_motion(takes: list[Take], kinds: Collection[str]) -> tuple[list[Take], list[Take]]:
    """Return the takes to fit to and those of the given kinds of motion (`formats.motion.KINDS`), in their order.

    Raises:
        FitError: an unknown kind, a kind that no take is of, or nothing left to fit to.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise FitError(f"there is no kind of motion named {kind!r}", advice=f"choose among {', '.join(KINDS)}")
    by_take = [kind_of(take) for take in takes]
    there = ", ".join(f"{take.take_id} {kind}" for take, kind in zip(takes, by_take, strict=True))
    for kind in kinds:
        if kind not in by_take:
            raise FitError(f"no take moves {kind!r}", advice=f"the takes move like this: {there}")
    if kinds and set(by_take) <= set(kinds):
        raise FitError("every take is held out and none is left to fit to", advice=f"the takes move like this: {there}")
    both = list(zip(takes, by_take, strict=True))
    return [t for t, kind in both if kind not in kinds], [t for t, kind in both if kind in kinds]
