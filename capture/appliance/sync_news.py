"""The daemon's view of `hangtime sync`, a separate process: its latest status and faults."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from capture.appliance.sync_status import FILE, SyncStatus, is_syncing, proved, read_status, sentences
from capture.errors import SyncError
from formats.errors import HangtimeError


class SyncNews:
    """The latest status of sync, and whether it is sending; empty if sync never ran."""

    def __init__(self, spool: Path) -> None:
        self._spool = spool
        self._read_at = 0
        self._status: SyncStatus | None = None
        self.is_sending = False

    def look(self) -> None:
        """Read the status file that sync writes."""
        self.is_sending = is_syncing(self._spool)
        changed_at = 0
        with contextlib.suppress(OSError):
            changed_at = (self._spool / FILE).stat().st_mtime_ns
        if changed_at != self._read_at:
            self._read_at, self._status = changed_at, read_status(self._spool)

    @property
    def error(self) -> HangtimeError | None:
        """The reason why takes are not safe on the server, as sync reports it; None if there is none."""
        status = self._status
        if status is None:
            return None
        if status.fault is not None:
            return SyncError(
                f"takes are not sent: {status.fault.sentence}", where=self._spool, advice=status.fault.advice
            )
        if status.proof is not None and status.proof.is_bad:
            what = f"the server's copy of take {status.proof.sequence} is {status.proof.outcome}"
            return SyncError(what, where=status.url, advice="check the server's disk; see `hangtime sync status`")
        if status.damaged:
            names = ", ".join(str(number) for number in status.damaged)
            return SyncError(
                f"this device's disk changed takes after they were kept: {names}",
                where=self._spool,
                advice="replace the disk",
            )
        return None

    def for_status(self) -> dict[str, Any]:
        """Return the part of `status` on sync: its sentences, and the times of the last upload and the last proof."""
        now = datetime.now(UTC).astimezone()
        return {
            "is_sending": self.is_sending,
            "says": sentences(self._status, now),
            "last_sync": None if self._status is None else self._status.last_sync,
            "last_proof": None if self._status is None else proved(self._status.proof, now),
            "status": None if self._status is None else msgspec.to_builtins(self._status),
        }
