"""The rig and the garment beside an imported take: their first names, and those that an import left under these."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from formats.descriptions import says
from formats.errors import DescriptionError
from formats.garment import Garment
from formats.rig import Rig
from formats.take_report import LeftState
from formats.unfinished import unfinished_name

RIG, GARMENT = DESCRIBED_BESIDE = "rig.toml", "garment.toml"  # beside an imported take


def named(rig: Rig, garment: Garment) -> dict[str, Garment | Rig]:
    """Return the rig and the garment of a take by their names of `DESCRIBED_BESIDE`."""
    return {RIG: rig, GARMENT: garment}


def prepared_name(take: Path, description: str) -> Path:
    """Return the name under which the rig or garment of an imported take waits until the take has its own.

    description: one of `DESCRIBED_BESIDE`
    """
    return unfinished_name(take.with_name(f"{take.stem}.{description}"))


def left_beside(take: Path, rig: Rig, garment: Garment) -> dict[str, LeftState]:
    """Return those of `DESCRIBED_BESIDE` that an import left under their first names after its take had got its own.

    Before that moment they are as they were, and the unfinished take itself is what the import left. One whose place
    is taken by the same has nothing left to do. A left file that says otherwise is of another import, or of a person.

    rig, garment: those that the take holds
    """
    if take.suffix != ".mcap" or os.path.lexists(unfinished_name(take)):
        return {}
    states = {name: _state_of(take, name, own) for name, own in named(rig, garment).items()}
    return {name: state for name, state in states.items() if state is not None}


def _state_of(take: Path, name: str, own: Garment | Rig) -> LeftState | None:
    path, prepared = take.with_name(name), prepared_name(take, name)
    if not os.path.lexists(prepared) or is_said(path, own):
        return None
    try:
        if not says(prepared, own):
            return None
    except DescriptionError as error:
        return "unreadable" if isinstance(error.__cause__, PermissionError) else None
    return "waiting"


def is_said(path: Path, description: Garment | Rig) -> bool:
    """Return whether a file says what a description says; False of one that is not there or cannot be read."""
    with contextlib.suppress(DescriptionError):
        return says(path, description)
    return False
