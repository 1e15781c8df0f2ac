"""One sync process with a fixed clock, and the content of its server."""

from __future__ import annotations

import hashlib
import random
from datetime import UTC, datetime

from capture.sync.rounds import Sync
from capture.sync.settings import SyncSettings, SyncSetup
from tests.capture.sync.servers import CREDENTIALS

NOW = datetime(2026, 11, 25, 12, tzinfo=UTC)  # a Wednesday


def sync_of(setup, credentials=CREDENTIALS, now=NOW):
    waits: list[float] = []
    made = Sync(setup, credentials, clock=lambda: now, sleep=waits.append, chance=random.Random(1))
    return made, waits


def folder_of(tmp_path, spool, **named):
    return SyncSetup(SyncSettings(url=f"file://{tmp_path}/server", device="box", **named), spool.folder)


def on_server(tmp_path):
    top = tmp_path / "server"
    return {str(path.relative_to(top)): path.read_bytes() for path in top.rglob("*") if path.is_file()}


def check_server(objects, takes):
    """One object a take, named after its content."""
    assert sorted(objects) == [
        f"box/2026-11-20/{take.sequence:06d}-{take.facts['sha256']}.mcap"
        for take in sorted(takes, key=lambda t: t.sequence)
    ]
    for key, content in objects.items():
        assert hashlib.sha256(content).hexdigest() == key.split("-")[-1].removesuffix(".mcap")
