"""State the digest of a result's content in its file, and refuse a file that was changed after it was written.

A digest is the SHA-256 of the content as JSON without the digest and without spaces. Fields stand in the order of their
names, and every number is a double, as in 1.0. So a result may pass through any program that keeps its content. Results
of older versions state no digest, and are read as they are.
"""

from __future__ import annotations

import hashlib
from codecs import BOM_UTF8

import msgspec

from formats.errors import ResultError

KEY = "digest"  # of the field


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
    if _digest_of(raw.removeprefix(BOM_UTF8)) != stated:
        raise ResultError(
            "was changed after it was written: its content has another digest than it states", where=where,
            advice=f"{again}; or remove its field {KEY!r}, and it is read as it is",
        )  # fmt: skip


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
