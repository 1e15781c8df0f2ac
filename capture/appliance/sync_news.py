"""What `hangtime sync`, a process of its own, says of itself: it writes a file beside the takes."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from capture.appliance.sync_status import FILE, SyncStatus, is_syncing, proved, read_status, sentences
from formats.errors import HangtimeError, OutputError


class SyncNews:
    """The last that sync has said, and whether it sends takes right now."""

    def __init__(self, spool: Path) -> None:
        self._spool = spool
        self._read_at = 0
        self._status: SyncStatus | None = None
        self.is_sending = False

    def look(self) -> None:
        """Read the file if it has changed, and ask whether sync runs: one that was killed sends nothing."""
        self.is_sending = is_syncing(self._spool)
        try:
            changed_at = (self._spool / FILE).stat().st_mtime_ns
        except OSError:
            return
        if changed_at != self._read_at:
            self._read_at = changed_at
            self._status = read_status(self._spool) or self._status

    @property
    def told(self) -> dict[str, Any]:
        """How sync stands; empty where it never ran. `last_proof` and `says` are words."""
        if self._status is None:
            return {}
        now = datetime.now(UTC).astimezone()
        return {
            **msgspec.to_builtins(self._status), "last_proof": proved(self._status.proof, now),
            "says": sentences(self._status, now),
        }  # fmt: skip

    @property
    def error(self) -> HangtimeError | None:
        """Why it cannot send, in the server's own words."""
        if self._status is None or self._status.fault is None:
            return None
        fault = self._status.fault
        return OutputError(f"takes are not sent: {fault.sentence}", advice=fault.advice)
