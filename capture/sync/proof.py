"""The proof: a random take is fetched from the server, hashed and opened, as in a recovery.

Takes that were removed from this device come first, because their only copy is on the server.
"""

from __future__ import annotations

import hashlib
import random
import tempfile
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

from capture.appliance.receipts import Receipt
from capture.appliance.sync_status import Proof
from capture.sync.server import ReadRefusedError, Server
from formats.archive import verify_take
from formats.errors import HangtimeError


def is_due(last: Proof | None, days: float, now: datetime) -> bool:
    """Return whether a proof is due; a proof dated in the future is ignored, since the clock was wrong then."""
    if last is None:
        return True
    try:
        age = now - datetime.fromisoformat(last.at)
    except (ValueError, TypeError):
        return True
    return not timedelta(0) <= age < timedelta(days=days)


def prove(server: Server, candidates: Sequence[Receipt], *, now: datetime, chance: random.Random) -> Proof | None:
    """Fetch one take of these receipts, check its hash and open it; None without receipts.

    Raises:
        ServerError: the server is unreachable.
    """
    if not candidates:
        return None
    receipt = chance.choice(candidates)

    def outcome(word: str) -> Proof:
        return Proof(at=now.isoformat(timespec="seconds"), sequence=receipt.sequence, outcome=word)  # type: ignore[arg-type]

    with tempfile.TemporaryDirectory(prefix="hangtime-proof") as folder:
        file, total = Path(folder) / "take.mcap", hashlib.sha256()
        try:
            with file.open("wb") as copy:
                for piece in server.fetch(receipt.key):
                    total.update(piece)
                    copy.write(piece)
        except FileNotFoundError:
            return outcome("missing")
        except ReadRefusedError:
            return outcome("refused")
        if total.hexdigest() != receipt.stored_sha256:
            return outcome("damaged")
        return outcome("whole" if receipt.is_encrypted else "sound" if _opens(file) else "damaged")


def _opens(file: Path) -> bool:
    """Return whether a take can be read and has no more faults than when it was recorded."""
    try:
        return verify_take(file).damaged_blocks == 0
    except HangtimeError:
        return False
