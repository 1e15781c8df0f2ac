"""Parse a take's header: its rig, garment and texts. See `formats/SPEC.md`."""

from __future__ import annotations

import re
from typing import Any

import msgspec

from formats.descriptions import PARTS, check_garment, check_rig
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.plain_text import shortened
from formats.rig import Rig
from formats.take_writer import PROFILE, VERSION, Words
from formats.wrong_fields import wrong_field


def described(header: dict[str, Any], path: object) -> tuple[Rig, Garment, Words]:
    """Return the rig, the garment and the texts of a header; path: the take's file.

    Raises:
        TakeError: the header is of a newer version, or malformed; names the field.
    """
    if not isinstance(header["format"], str):
        raise TakeError("its header is invalid: format must be text", where=path, advice="give a take archive")
    name, _, version = header["format"].partition("/")
    if name != PROFILE.partition("/")[0]:
        what = f"is a {shortened(header['format'])!r}, not a take"
        raise TakeError(what, where=path, advice="give a take archive")
    if (other := of_another_version(version, path)) is not None:
        raise other
    held: str = "rig"
    kind: type[Rig] | type[Garment] = Rig
    try:
        rig = msgspec.convert(header.get("rig"), Rig)
        check_rig(rig, path)
        held, kind = "garment", Garment
        garment = msgspec.convert(header.get("garment"), Garment)
        check_garment(garment, path)
    except (msgspec.ValidationError, DescriptionError) as error:
        words = error.what if isinstance(error, DescriptionError) else wrong_field(error, (kind, *PARTS[kind]))
        words = re.sub("^the file must be", f"the {held} must be", words)
        raise TakeError(f"its {held} is invalid: {words}", where=path, advice="record it again") from error
    try:
        return rig, garment, msgspec.convert(header, Words)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (Words,))
        raise TakeError(f"its header is invalid: {words}", where=path, advice="record it again") from error


def of_another_version(version: str, path: object) -> TakeError | None:
    """Return the error of a take in a version that this Hangtime does not read, None for a known version."""
    number = int(version) if version.isdecimal() and len(version) < 9 else 0
    if 1 <= number <= VERSION:
        return None
    detail = f"is of format version {shortened(version)}; this Hangtime reads 1 to {VERSION}"
    advice = "update Hangtime" if number else "copy it again from where it was recorded"
    return TakeError(detail, where=path, advice=advice)
