"""The appliance's configuration: one TOML file, and the rig and the garment that it names."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import msgspec

from capture.appliance.config_tables import Config, read_tables, wrong_in_tables
from formats.descriptions import load_garment, load_rig
from formats.errors import DescriptionError, HangtimeError
from formats.garment import Garment
from formats.plausible_rig import check_plausible_hold
from formats.rig import Rig
from formats.toml_files import place_in
from formats.whole_files import loop_words

DEFAULT = Path("/etc/hangtime/appliance.toml")


@dataclass(frozen=True)
class InForce:
    """A configuration with its rig and garment; `refused`: the error that ruled the file out, or None."""

    config: Config
    rig: Rig
    garment: Garment
    refused: HangtimeError | None = None


def load(path: Path) -> InForce:
    """Read a configuration, its rig and its garment.

    Raises:
        DescriptionError: one of the three files is missing or invalid, or the spool's path is no folder.
    """
    plain = read_tables(path)
    try:
        config = converted(plain, path.absolute().parent)
    except msgspec.ValidationError as error:
        words = wrong_in_tables(error, plain)
        raise DescriptionError(
            words, where=place_in(path, plain, words),
            advice="mend that setting; docs/reference/appliance.md explains each",
        ) from error  # fmt: skip
    _check_spool(config.spool.folder, path)
    rig, garment = load_rig(config.sensor.rig), load_garment(config.sensor.garment)
    check_plausible_hold(rig, garment, config.sensor.rig)
    return InForce(config, rig, garment)


def _check_spool(folder: Path, path: Path) -> None:
    """Check that no file has the spool's path; a missing folder passes, since its disk may be mounted later."""
    there = next(one for one in (folder, *folder.parents) if os.path.lexists(one))
    if not there.is_dir():
        fault = loop_words(there, "is no folder")
        raise DescriptionError(
            f"spool.folder is {folder}, but {there} {fault}", where=path,
            advice="give another folder, or remove what has this name",
        )  # fmt: skip


def converted(plain: object, folder: Path) -> Config:
    """Return the configuration that a file's tables hold; folder: where relative paths start.

    Raises:
        msgspec.ValidationError: a key or a value is invalid.
    """

    def path_from(kind: type, value: object) -> object:
        if kind is not Path or not isinstance(value, str) or not value or "\0" in value:
            raise ValueError("a path must be a text that is not empty")
        return folder / value

    return msgspec.convert(plain, Config, dec_hook=path_from)
