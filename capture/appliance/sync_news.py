"""What `hangtime sync`, a process of its own, says of itself: it writes a file beside the takes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from formats.errors import HangtimeError, OutputError

FILE = "sync-status.json"


class SyncNews:
    """The last that sync has said; `told` is empty where it never ran."""

    def __init__(self, spool: Path) -> None:
        self._path = spool / FILE
        self._read_at = 0
        self.told: dict[str, Any] = {}

    def look(self) -> None:
        """Read the file if it has changed."""
        try:
            changed_at = self._path.stat().st_mtime_ns
            if changed_at == self._read_at:
                return
            said = json.loads(self._path.read_bytes())
            self._read_at = changed_at
        except (OSError, ValueError):
            return
        self.told = said if isinstance(said, dict) else {}

    @property
    def is_sending(self) -> bool:
        """Whether it sends takes right now."""
        return self.told.get("state") == "sending"

    @property
    def error(self) -> HangtimeError | None:
        """Why it cannot send, in the server's own words."""
        words = self.told.get("error")
        if not words:
            return None
        advice = str(self.told.get("advice") or "see `hangtime sync status`")
        return OutputError(f"takes are not sent: {words}", advice=advice)
