"""The last valid configuration: its copy stays in force while the file, its rig or its garment is invalid.

The copy lies in the folder of state that systemd gives the unit (`man 5 systemd.exec`, StateDirectory=), else beside
the file. The invalid file is not needed to find the copy. If this folder cannot be written, the copy lies in the
spool; older versions put every copy there.

A configuration replaces the copy once the recorder is ready with it: sensor, spool and socket then agree with the
file. The first configuration is copied at once.
"""

from __future__ import annotations

import contextlib
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from capture.appliance.config import InForce, converted, load
from capture.appliance.config_tables import SpoolPart
from formats.descriptions import check_garment, check_rig
from formats.errors import DescriptionError, HangtimeError
from formats.garment import Garment
from formats.outputs import holds
from formats.results import LARGEST_RESULT
from formats.rig import Rig
from formats.toml_files import LARGEST_TOML
from formats.whole_files import make_folders, read_bounded, write_whole

IN_SPOOL = "last-good.json"


def load_or_last_good(path: Path) -> InForce:
    """Read a configuration; if it is invalid, return the last valid one.

    Raises:
        DescriptionError: the file is invalid and there is no earlier configuration.
    """
    try:
        found = load(path)
    except DescriptionError as refused:
        return last_good(path, refused)
    if _read(copy_of(path)) is None:
        keep(found, path)
    return found


def last_good(path: Path, refused: HangtimeError) -> InForce:
    """Return the last valid configuration; refused: the error that ruled the file out.

    Raises:
        HangtimeError: `refused`, where there is no earlier configuration.
    """
    for copy in (copy_of(path), *(spool / IN_SPOOL for spool in possible_spools(path))):
        if (found := _read(copy)) is not None:
            return replace(found, refused=refused)
    raise refused


def keep(found: InForce, path: Path) -> None:
    """Copy a valid configuration; if the disk is full, the earlier copy stays."""
    content = msgspec.json.encode(
        {"config": found.config, "rig": found.rig, "garment": found.garment}, enc_hook=lambda path: str(path)
    )
    for copy in (copy_of(path), found.config.spool.folder / IN_SPOOL):
        with contextlib.suppress(OSError):
            if not holds(copy, content):
                make_folders(copy.parent)
                write_whole(copy, content)
            for litter in copy.parent.glob(f"{copy.name}*.partial"):  # a partial file that a power cut left
                litter.unlink(missing_ok=True)
            return


def copy_of(path: Path) -> Path:
    """Return where the copy of a configuration file lies."""
    state = os.environ.get("STATE_DIRECTORY", "").split(":")[0]  # several are separated by colons
    return (Path(state) if state else path.absolute().parent) / f"{path.stem}.last-good.json"


def possible_spools(path: Path) -> list[Path]:
    """Return the possible spool folders, likeliest first: the folder in the file, then the default one.

    If the file is not valid TOML, its text is searched for the line of the folder.
    """
    usual = SpoolPart().folder
    try:
        with path.open("rb") as file:  # another file given by mistake may be larger than the memory
            text = file.read(LARGEST_TOML).decode()
        found = re.search(r"^\s*folder\s*=\s*(?:\"([^\"\0]+)\"|'([^'\0]+)')", text, re.MULTILINE)
    except (OSError, ValueError):
        return [usual]
    return [path.absolute().parent / (found[1] or found[2]), usual] if found else [usual]


def _read(copy: Path) -> InForce | None:
    """Return the configuration of a copy, None if the copy is missing or damaged."""
    try:
        whole = msgspec.json.decode(read_bounded(copy, LARGEST_RESULT), type=dict[str, Any])
        config = converted(whole["config"], copy.parent)
        rig, garment = msgspec.convert(whole["rig"], Rig), msgspec.convert(whole["garment"], Garment)
        check_rig(rig, copy)
        check_garment(garment, copy)
    except (OSError, msgspec.MsgspecError, KeyError, RecursionError, DescriptionError):
        return None
    return InForce(config, rig, garment)
