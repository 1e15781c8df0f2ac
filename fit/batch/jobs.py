"""Jobs of a batch, and the storage key of each result.

    key = sha256( sha256(take's bytes) | method, effects, bounds, search ... | physics )

A take's bytes hold its garment and rig; the physics is `fit.provenance.physics_version`. So a stored result is reused
exactly as long as a new run would give the same result.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

from fit.identification.request import Plan


@dataclass(frozen=True, kw_only=True)
class Task:
    """Work for a worker, with the stores of takes and results; anyway: accept implausible takes."""

    key: str
    takes_url: str
    results_url: str
    physics: str
    anyway: bool = False
    patience: float = 0.0  # s of waiting to store a finished result in an unreachable bucket


@dataclass(frozen=True, kw_only=True)
class Job(Task):
    """One take to fit."""

    take: str  # its name in the store of takes
    digest: str  # sha256 of its bytes
    plan: Plan


@dataclass(frozen=True, kw_only=True)
class DiagnosisJob(Task):
    """Takes of one garment to diagnose.

    training, held_out: names in the store of takes; digests: sha256 of the bytes of each, training first
    """

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    digests: tuple[str, ...]
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The end of a job.

    state: `fitted`, `diagnosed`, `failed` (it would again), `refused` (by this worker) or `newer` (the stored result is
    of a newer format)
    """

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


def diagnosis_key(training: list[str], held_out: list[str], seed: int, physics: str) -> str:
    """Return the key of a diagnosis of the takes with these digests."""
    text = json.dumps(["diagnosis", training, held_out, seed, physics])
    return digest_of(text.encode())


def diagnosis_name(key: str) -> str:
    """Return the name of a diagnosis in the store of results."""
    return f"diagnoses/{key}.json"


def report_name(key: str) -> str:
    """Return the name of the report of a diagnosis in the store of results."""
    return f"diagnoses/{key}.html"


def result_name(key: str) -> str:
    """Return the name of a result in the store of results."""
    return f"fits/{key}.json"


def failure_name(key: str) -> str:
    """Return the name of the record of a job's failure."""
    return f"failed/{key}.json"


def search_name(key: str) -> str:
    """Return the name of an unfinished search."""
    return f"unfinished/{key}.json"


def unfinished_diagnosis(key: str) -> str:
    """Return the name of the folder with the finished fits of an unfinished diagnosis."""
    return f"unfinished/{key}"
