"""Find the rig and garment files that an interrupted import left beside a take under their unfinished names."""

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

RIG_FILE, GARMENT_FILE = DESCRIBED_BESIDE = "rig.toml", "garment.toml"  # beside an imported take


def named(rig: Rig, garment: Garment) -> dict[str, Garment | Rig]:
    """Return the rig and the garment of a take, keyed by the names of `DESCRIBED_BESIDE`."""
    return {RIG_FILE: rig, GARMENT_FILE: garment}


def prepared_name(take: Path, description: str) -> Path:
    """Return the unfinished name of a rig or garment file, which the file has until the take has its own name.

    description: one of `DESCRIBED_BESIDE`
    """
    return unfinished_name(take.with_name(f"{take.stem}.{description}"))


def left_beside(take: Path, rig: Rig, garment: Garment) -> dict[str, LeftState]:
    """Return which of `DESCRIBED_BESIDE` an import left under unfinished names after its take had got its name.

    Before that moment the old files are unchanged, and the import left the unfinished take itself. A left file whose
    final name has a file with the same values needs no action. A left file with other values belongs to another import,
    or to a person.

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
    """Return whether a file holds the same values as a description; False for a missing or unreadable file."""
    with contextlib.suppress(DescriptionError):
        return says(path, description)
    return False
