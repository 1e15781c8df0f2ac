"""Receipts: each certifies that a take is on the server, and states how its content was verified there.

A receipt is one JSON file of `receipts/` in the spool folder, written atomically after the verification and never
before. Receipts stay when their takes leave the device: the weekly proof draws from them.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import msgspec

from formats.whole_files import make_folders, read_bounded, write_whole

DEFAULT_URL = "file:///var/lib/hangtime/server"  # the address if `[sync]` names no server
READ_BACK = "read back"  # the object was fetched and its SHA-256 is that of what was sent
STORE_CHECKSUM = "store's checksum"  # the store answered with the checksum of what was sent; the device may not read


class Receipt(msgspec.Struct, frozen=True, kw_only=True):
    """The place of a take on the server, and the verification of its content there.

    - `sequence`: the take's number on this device
    - `url`, `key`: the server folder or bucket, and the object's name in it
    - `sha256`, `bytes`: of the take archive
    - `stored_sha256`, `stored_bytes`: of the object; they differ from the take's where it was encrypted before upload
    - `is_encrypted`: whether the object is the take encrypted with age
    - `verified`: READ_BACK or CHECKSUM
    - `at`: wall clock of the verification, ISO 8601 with its offset
    """

    sequence: int
    url: str
    key: str
    sha256: str
    bytes: int
    stored_sha256: str
    stored_bytes: int
    is_encrypted: bool
    verified: str
    at: str


def receipt_path(spool: Path, stem: str) -> Path:
    """Return the path of a take's receipt."""
    return spool / "receipts" / f"{stem}.json"


def write_receipt(spool: Path, stem: str, receipt: Receipt) -> None:
    """Write a receipt; it is on the disk when this returns.

    Raises:
        OSError: it cannot be written.
    """
    path = receipt_path(spool, stem)
    make_folders(path.parent)
    write_whole(path, msgspec.json.format(msgspec.json.encode(receipt), indent=2) + b"\n")


def read_receipt(spool: Path, stem: str) -> Receipt | None:
    """Return a take's receipt, None if it is missing or unreadable; the take is then verified again."""
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode(read_bounded(receipt_path(spool, stem)), type=Receipt)
    return None


def receipts(spool: Path) -> list[Receipt]:
    """Return all receipts that can be read, those of takes that left the device too, in the order of sequence."""
    stems = [path.stem for path in (spool / "receipts").glob("*.json")]
    return sorted((found for stem in stems if (found := read_receipt(spool, stem))), key=lambda one: one.sequence)
