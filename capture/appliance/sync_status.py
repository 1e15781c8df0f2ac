"""The state of sync: `sync-status.json` in the spool folder, and its sentences in `hangtime status`."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

import msgspec

from capture.appliance.receipts import STORE_CHECKSUM
from capture.errors import SyncError
from formats.plain_text import counted
from formats.whole_files import read_bounded, write_whole

FILE, LOCK = "sync-status.json", "sync.lock"
WEEK = timedelta(days=7)
MOMENT, MOMENTS = 0.02, 25  # s, and how many of them: half a second
DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """A fault that stops uploads: one sentence, the next action, the time since when, and the number of attempts."""

    sentence: str
    advice: str
    since: str
    tries: int
    next_try: str | None = None


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a proof: one take was fetched from the server and checked.

    outcome: "sound": its hash is right and it opens; "whole": its hash is right, and it is encrypted; "damaged" and
        "missing" are of the server; "refused": these keys may not read
    """

    at: str
    sequence: int
    outcome: Literal["sound", "whole", "damaged", "missing", "refused"]

    @property
    def is_bad(self) -> bool:
        """Return whether the server's copy is missing or damaged."""
        return self.outcome in ("damaged", "missing")


class SyncStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The state of sync.

    - `at`: when this was written, as all times here: wall clock, ISO 8601 with its offset
    - `waiting`, `waiting_bytes`: takes without a receipt
    - `safe`: takes with a receipt of this address, those that left the device too
    - `elsewhere`: takes whose receipt is of another address
    - `last_sync`: when a take was last verified on the server
    - `verified`: how the last one was: READ_BACK or CHECKSUM of `capture.appliance.receipts`
    - `fault`: the fault that stops uploads, or None
    - `damaged`: takes that changed on this device's disk after they were kept
    - `notes`: remarks that require no action
    """

    at: str
    url: str
    device: str
    waiting: int
    waiting_bytes: int
    safe: int
    is_encrypted: bool
    elsewhere: int = 0
    last_sync: str | None = None
    verified: str | None = None
    fault: Fault | None = None
    proof: Proof | None = None
    damaged: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()


def write_status(spool: Path, status: SyncStatus) -> None:
    """Write the status; on a full disk the earlier one stays, which is harmless: receipts alone certify takes."""
    content = msgspec.json.format(msgspec.json.encode(status), indent=2) + b"\n"
    with contextlib.suppress(OSError):
        write_whole(spool / FILE, content)


def read_status(spool: Path) -> SyncStatus | None:
    """Return the status of sync; None if it never ran or its file is unreadable."""
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode(read_bounded(spool / FILE), type=SyncStatus)
    return None


@contextmanager
def only_sync(spool: Path) -> Iterator[None]:
    """Hold the lock by which only one process syncs this folder.

    Raises:
        SyncError: another process holds the lock.
        OSError: the folder cannot be written.
    """
    handle = os.open(spool / LOCK, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)  # another user may own the file
    try:
        _lock(handle, spool)
        yield
    finally:
        os.close(handle)


def _lock(handle: int, spool: Path) -> None:
    """Lock a file; retry for a moment, because `is_syncing` holds the lock briefly to test it."""
    for attempt in range(MOMENTS):
        try:
            return fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if attempt == MOMENTS - 1:
                raise SyncError(
                    "another process syncs these takes", where=spool, advice="wait until it ends"
                ) from error
            time.sleep(MOMENT)
    return None


def is_syncing(spool: Path) -> bool:
    """Return whether a process syncs this folder now."""
    try:
        handle = os.open(spool / LOCK, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def _ended(words: str) -> str:
    """Return words with an end: a full stop, unless they have one."""
    return words if words.endswith(("?", "!", ".")) else f"{words}."


def sentences(status: SyncStatus | None, now: datetime) -> list[str]:
    """Return the status of sync as sentences, the most urgent first; now: wall-clock time with its UTC offset."""
    if status is None:
        return ["Sync has not run yet. Next: `hangtime sync now`, or wait for its timer."]
    said = []
    if status.fault is not None:
        said.append(f"Sync fails: {_ended(status.fault.sentence)} Next: {_ended(status.fault.advice)}")
    if status.damaged:
        names = ", ".join(str(number) for number in status.damaged)
        said.append(f"The disk of this device changed takes after they were kept: {names}. Next: replace the disk.")
    if status.proof is not None and status.proof.is_bad:
        said.append(
            f"The server's copy of take {status.proof.sequence} is {status.proof.outcome}. "
            "Next: check the server's disk; this device sends the take again if it still has it."
        )
    count = f"{status.waiting} {'take waits' if status.waiting == 1 else 'takes wait'}"
    last = f"last sync: {day_of(status.last_sync, now)}" if status.last_sync else "nothing was synced yet"
    said.append(f"{count}, {status.safe} safe on the server, {last}.")
    if status.elsewhere:
        said.append(f"{counted(status.elsewhere, 'take')} went to another address before, and counted there as safe.")
    said.append(f"Last proved: {proved(status.proof, now)}.")
    if status.verified == STORE_CHECKSUM:
        said.append(
            "The keys of this device may only write: takes are verified by the store's checksum, not read back."
        )
    if status.is_encrypted:
        said.append("Takes are encrypted before upload; this device cannot open what it sent.")
    return [*said, *status.notes]


def day_of(at: str | None, now: datetime) -> str:
    """Return a time in words: today, a day of the last week, or the date."""
    try:
        then = datetime.fromisoformat(at or "").astimezone(now.tzinfo)
    except (ValueError, OverflowError):
        return "at an unknown time"
    if then.date() == now.date():
        return f"today at {then:%H:%M}"
    return DAYS[then.weekday()] if timedelta(0) < now - then < WEEK else f"{then:%Y-%m-%d}"


def proved(proof: Proof | None, now: datetime) -> str:
    """Return the time and the result of the last proof, in words."""
    if proof is None:
        return "never"
    words = {
        "sound": "sound", "whole": "its hash is right; the encrypted take was not opened", "damaged": "DAMAGED",
        "missing": "MISSING", "refused": "not possible, the keys of this device may not read",
    }  # fmt: skip
    return f"{day_of(proof.at, now)}, {words[proof.outcome]}"
