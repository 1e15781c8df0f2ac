"""State the digest of a result's content in its file, and refuse a file that was changed after it was written.

A digest is the SHA-256 of the file's JSON without spaces and without the digest. How numbers are written does
not count. Results of older versions state no digest, and are read as they are.
"""

from __future__ import annotations

import hashlib
from codecs import BOM_UTF8

import msgspec

from formats.errors import ResultError

KEY = "digest"  # of the field


def with_digest(raw: bytes) -> bytes:
    """Return the JSON of a result with its digest, behind its first field, the format."""
    compact = msgspec.json.format(raw, indent=-1)
    fields: dict[str, msgspec.Raw] = msgspec.json.decode(compact, type=dict[str, msgspec.Raw])
    first, *others = fields
    named = msgspec.Raw(msgspec.json.encode(_digest_of(compact)))
    return msgspec.json.encode({first: fields[first], KEY: named, **{name: fields[name] for name in others}})


def check_digest(raw: bytes, stated: str, typed: bytes, where: object, again: str) -> None:
    """Refuse the JSON of a result whose content has another digest than it states.

    - `typed`: the JSON of what was read, without a digest
    - `again`: the command that makes it again, such as "fit again"

    Raises:
        ResultError: it was changed after it was written.
    """
    raw = raw.removeprefix(BOM_UTF8)
    compact = msgspec.json.format(raw, indent=-1)
    own = b'"%s":%s,' % (KEY.encode(), msgspec.json.encode(stated))
    if _digest_of(compact.replace(own, b"", 1)) == stated:
        return
    # Another program may have written the same numbers in other words, or the fields in another order.
    plain = msgspec.json.decode(compact, type=dict[str, object])
    plain.pop(KEY, None)
    if stated not in (_digest_of(msgspec.json.encode(plain)), _digest_of(typed)):
        raise ResultError(
            "was changed after it was written: its content has another digest than it states", where=where,
            advice=f"{again}; or remove its line {KEY!r}, and it is read as it is",
        )  # fmt: skip


def _digest_of(compact: bytes) -> str:
    return hashlib.sha256(compact).hexdigest()
