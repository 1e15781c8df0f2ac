"""Upload one take: look for it on the server, send it, verify it, and only then write its receipt.

This order is safe against a kill at any moment. Without a receipt the next run checks the server first. The key comes
from the take's content, so a repeated upload replaces itself. A receipt certifies that the content was read back with
the SHA-256 that was sent. Keys may permit writing only. Then the store's own checksum of the received content stands
in, and the receipt says so.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from capture.appliance.receipts import READ_BACK, STORE_CHECKSUM, Receipt, write_receipt
from capture.appliance.spool import KeptTake
from capture.errors import SyncError
from capture.sync.encryption import encrypt
from capture.sync.server import ReadRefusedError, Server, ServerError, Sums, sums_of
from formats.archive import read_take
from formats.errors import HangtimeError
from formats.store_address import without_secrets

UNDATED = "undated"  # stands for the day of a take that is unreadable


@dataclass(frozen=True)
class Target:
    """The destination of takes.

    - `device`: this device's name on the server
    - `recipients`: of age; without any, takes are sent unencrypted
    """

    server: Server
    url: str
    device: str
    recipients: Sequence[Any] = ()


def key_of(take: KeptTake, device: str, sha256: str, *, is_encrypted: bool) -> str:
    """Return the key of a take on the server, a function of its device, day, sequence and content alone."""
    ending = "mcap.age" if is_encrypted else "mcap"
    return f"{device}/{_day_of(take)}/{take.sequence:06d}-{sha256}.{ending}"


def bring(take: KeptTake, spool: Path, target: Target, *, now: datetime) -> Receipt:
    """Upload a take and write its receipt.

    Raises:
        ServerError: the server does not accept or return it; nothing is lost, and the next attempt continues.
        SyncError: the take cannot be read on this device.
        OSError: the receipt cannot be written.
    """
    try:
        file = take.path.open("rb")
    except OSError as error:
        raise SyncError(
            f"the take cannot be read ({error.strerror})", where=take.path, advice="check the disk of this device"
        ) from error
    with file:
        plain = _sums(file, take)
        key = key_of(take, target.device, plain.sha256, is_encrypted=bool(target.recipients))
        with _as_sent(file, spool, target.recipients) as sent:
            sums = plain if sent is file else sums_of(sent)
            # Every encrypted copy differs, so an earlier copy on the server cannot be distinguished from a damaged one.
            verified = READ_BACK if sent is file and _is_there(target.server, key, sums) else None
            if verified is None:
                tag = target.server.send(key, sent, sums.size)
                verified = _verified(target.server, key, sums, tag, take.stem)
    receipt = Receipt(
        sequence=take.sequence, url=without_secrets(target.url), key=key, sha256=plain.sha256, bytes=plain.size,
        stored_sha256=sums.sha256, stored_bytes=sums.size, is_encrypted=bool(target.recipients), verified=verified,
        at=now.isoformat(timespec="seconds"),
    )  # fmt: skip
    write_receipt(spool, take.stem, receipt)
    return receipt


def has_changed(take: KeptTake, sha256: str) -> bool:
    """Return whether a take's content has changed since it was kept."""
    return bool(take.facts.get("sha256", sha256) != sha256)


def read_back(server: Server, key: str) -> Sums | None:
    """Fetch an object and return its checksums, None if there is no object.

    Raises:
        ServerError: it cannot be fetched.
    """
    sums = Sums()
    try:
        for piece in server.fetch(key):
            sums.add(piece)
    except FileNotFoundError:
        return None
    return sums


def _sums(file: IO[bytes], take: KeptTake) -> Sums:
    try:
        return sums_of(file)
    except OSError as error:
        raise SyncError(
            f"the take cannot be read ({error.strerror})", where=take.path, advice="check the disk of this device"
        ) from error


def _is_there(server: Server, key: str, sums: Sums) -> bool:
    """Return whether an earlier run has uploaded the object completely and with the right content."""
    try:
        if server.size(key) != sums.size:
            return False
        found = read_back(server, key)
    except ReadRefusedError:
        return False
    return found is not None and found.sha256 == sums.sha256


def _verified(server: Server, key: str, sums: Sums, tag: str | None, stem: str) -> str:
    try:
        found = read_back(server, key)
    except ReadRefusedError as refused:
        if tag is not None and tag.lower() == sums.tag:
            return STORE_CHECKSUM
        raise ServerError(
            f"{refused.what}, and the store gives no checksum that can be compared", where=refused.where, kind="person",
            advice="allow the keys of this device to read its uploads: sync cannot verify them otherwise",
        ) from refused  # fmt: skip
    if found is None:
        raise ServerError(
            "the server took a take and does not have it", kind="passing", where=stem,
            advice="sync sends it again; if it lasts, check the server",
        )  # fmt: skip
    if found.sha256 != sums.sha256:
        raise ServerError(
            "the server holds something else than was sent", kind="passing", where=stem,
            advice="sync sends it again; if it lasts, check the server's disk and memory",
        )  # fmt: skip
    return READ_BACK


@contextmanager
def _as_sent(file: IO[bytes], spool: Path, recipients: Sequence[Any]) -> Iterator[IO[bytes]]:
    """Yield the file to upload: the take itself, or an encrypted copy in an unnamed temporary file."""
    if not recipients:
        yield file
        return
    with tempfile.TemporaryFile(dir=spool) as copy:
        encrypt(file, copy, recipients)
        yield copy


def _day_of(take: KeptTake) -> str:
    """Return the day in a take's header; if the clock was wrong, the sequence still gives the order."""
    try:
        created = read_take(take.path).created
    except HangtimeError:
        return UNDATED
    return created[:10] if re.match(r"\d{4}-\d\d-\d\d", created) else UNDATED
