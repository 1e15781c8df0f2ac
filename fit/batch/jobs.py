"""Name the jobs of a batch, and the key under which each result is kept.

    key = sha256( sha256(take's bytes) | method, effects, bounds, search ... | physics )

A take's bytes hold its garment and rig; the physics is `fit.provenance.physics_version`. So a result is found again
exactly as long as it would come out the same.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

from fit.identification.request import Plan


@dataclass(frozen=True, kw_only=True)
class Job:
    """One take to fit, as it travels to a worker."""

    key: str
    take: str  # its name in the store of takes
    digest: str  # sha256 of its bytes
    takes_url: str
    results_url: str
    plan: Plan
    physics: str
    patience: float = 0.0  # s for which a finished fit waits for a bucket that is gone


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a job: `fitted`, `failed` (would fail again) or `refused` (this worker cannot do it)."""

    key: str
    state: str
    sentence: str = ""
    seconds: float = 0.0


def digest_of(content: bytes) -> str:
    """Return the sha256 of some bytes in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def key_of(digest: str, plan: Plan, physics: str) -> str:
    """Return the key of a fit of the take with this digest."""
    text = json.dumps([digest, asdict(plan), physics], sort_keys=True)
    return digest_of(text.encode())


def result_name(key: str) -> str:
    """Return the name of a result in the store of results."""
    return f"fits/{key}.json"


def failure_name(key: str) -> str:
    """Return the name under which it is kept that a job fails."""
    return f"failed/{key}.json"


def search_name(key: str) -> str:
    """Return the name of an unfinished search."""
    return f"unfinished/{key}.json"
