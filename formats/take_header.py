"""Turn a take's header into its rig, garment and texts. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from formats.arrays import Floats
from formats.blocks import LATEST, TICKS
from formats.descriptions import check_garment, check_rig
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.rig import Rig
from formats.take_report import Span
from formats.take_writer import PROFILE, VERSION
from formats.wrong_fields import wrong_field


class Words(msgspec.Struct, frozen=True, kw_only=True):
    """The texts of a header besides its rig and garment."""

    take_id: str
    created: str
    source: str
    notes: dict[str, str]
    missing: tuple[Span, ...] = ()


def described(header: dict[str, Any], path: object) -> tuple[Rig, Garment, Words]:
    """Return the rig, the garment and the texts of a header; path: whence it is.

    Raises:
        TakeError: it is of a newer version, or does not hold; names the field.
    """
    name, _, version = str(header["format"]).partition("/")
    if name != PROFILE.partition("/")[0]:
        raise TakeError(f"is a {header['format']!r}, not a take", where=path, advice="give a take archive")
    if not version.isdecimal() or not 1 <= int(version) <= VERSION:
        raise TakeError(
            f"is of format version {version}; this Hangtime reads up to {VERSION}", where=path, advice="update Hangtime"
        )
    try:
        rig, garment = msgspec.convert(header.get("rig"), Rig), msgspec.convert(header.get("garment"), Garment)
        check_rig(rig, path)
        check_garment(garment, path)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (Rig, Garment))
        raise TakeError(f"its rig or garment does not hold: {words}", where=path, advice="record it again") from error
    except DescriptionError as error:
        raise TakeError(f"its rig or garment does not hold: {error}", where=path, advice="record it again") from error
    try:
        return rig, garment, msgspec.convert(header, Words)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (Words,))
        raise TakeError(f"its header does not hold: {words}", where=path, advice="record it again") from error


def possible_spans(spans: Sequence[Span], time: Floats) -> list[Span]:
    """Return the spans [s] in which frames can be missing: each is a beginning and a later end, without a frame within.

    time [s], (frames,): of the frames that are there
    """
    begin, end = np.array(spans, float).reshape(-1, 2).T
    are_times = [(np.abs(at) <= LATEST / TICKS) | np.isinf(at) for at in (begin, end)]
    is_free = np.searchsorted(time, begin + 1 / TICKS) >= np.searchsorted(time, end - 1 / TICKS)
    can_be = (begin < end) & np.all(are_times, axis=0) & is_free
    return [span for span, is_span in zip(spans, can_be, strict=True) if is_span]
