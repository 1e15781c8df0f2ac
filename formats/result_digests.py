"""State the digest of a result's content in its file, and refuse a file that was changed after it was written.

A digest is the SHA-256 of the content as JSON without the digest and without spaces. Fields stand in the order of their
names, and every number is a double, as in 1.0. So a result may pass through any program that keeps its content. Results
of older versions state no digest, and are read as they are.
"""

from __future__ import annotations

import hashlib
import re
from codecs import BOM_UTF8
from collections import Counter

import msgspec

from formats.errors import ResultError

KEY = "digest"  # of the field
WRITTEN_NUMBER = re.compile(rb"[:\[,\s]-?(\d+(?:\.\d+)?)(?=[eE,\]}\s])")  # the digits of each number of a JSON text
DIGITS_OF_DOUBLES = 17  # digits that the shortest decimal of a double needs at most (IEEE 754)
FEWEST_DIGITS = 4  # our choice: numbers of fewer may all be round, such as limits
# Numbers with the most digits. Our choice: of 10 doubles that are not rounded, one in 1000 times none has 17 digits.
FEWEST_ROUNDED = 10


def with_digest(raw: bytes) -> bytes:
    """Return the JSON of a result with its digest, behind its first field, the format."""
    fields: dict[str, msgspec.Raw] = msgspec.json.decode(raw, type=dict[str, msgspec.Raw])
    first, *others = (name for name in fields if name != KEY)
    named = msgspec.Raw(msgspec.json.encode(_digest_of(raw)))
    return msgspec.json.encode({first: fields[first], KEY: named, **{name: fields[name] for name in others}})


def check_digest(raw: bytes, stated: str, where: object, again: str) -> None:
    """Refuse the JSON of a result whose content has another digest than it states.

    again: the command that makes it again, such as "fit again"

    Raises:
        ResultError: it was changed after it was written.
    """
    if _digest_of(raw.removeprefix(BOM_UTF8)) == stated:
        return
    if digits := _rounded_to(raw):
        raise ResultError(
            f"was rounded or changed after it was written: all its numbers have {digits} digits at most, as a program "
            "leaves them that rounds", where=where,
            advice=f"read the file that Hangtime wrote, or {again}; or remove its field {KEY!r}, and it is read as it "
            "is",
        )  # fmt: skip
    raise ResultError(
        "was changed after it was written: its content has another digest than it states", where=where,
        advice=f"{again}; or remove its field {KEY!r}, and it is read as it is",
    )  # fmt: skip


def _rounded_to(raw: bytes) -> int:
    """Return the number of digits to which a program has rounded the numbers of a result, 0 if none has.

    Of the doubles that Hangtime writes, most have 16 or 17 digits.
    """
    counts = Counter(
        len(found[1].replace(b".", b"").strip(b"0"))
        for found in WRITTEN_NUMBER.finditer(raw.removeprefix(BOM_UTF8)) if b"." in found[1]
    )  # fmt: skip
    most = max(counts, default=0)
    return most if FEWEST_DIGITS <= most < DIGITS_OF_DOUBLES and counts[most] >= FEWEST_ROUNDED else 0


def _digest_of(raw: bytes) -> str:
    content: dict[str, object] = msgspec.json.decode(raw, type=dict[str, object])
    content.pop(KEY, None)
    return hashlib.sha256(msgspec.json.encode(_in_doubles(content), order="sorted")).hexdigest()


def _in_doubles(value: object) -> object:
    """Return a value with each number as a double, if this is exact; some programs write 1.0 as 1, and -0.0 as 0."""
    if isinstance(value, dict):
        return {name: _in_doubles(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_in_doubles(one) for one in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            double = float(value) + 0.0  # -0.0 + 0.0 is 0.0
        except OverflowError:
            return value
        return double if double == value else value
    return value
