"""What is to be fitted, how, and the key under which its result is kept.

    key = sha256( sha256(take's bytes) | method, effects, bounds, search ... | physics )

A take's bytes hold its garment and rig; the physics is `fit.provenance.physics_version`. So a result is found again
exactly as long as it would come out the same.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

from fit.identification.request import Request, request_of
from fit.methods import find_method
from fit.methods.fabrics import find_fabric


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How every take is fitted; the options of `hangtime fit`."""

    method: str = "kinect-skirt"
    effects: tuple[str, ...] = ()
    bounds: tuple[str, ...] = ()
    search: str = "annealing"
    iterations: int = 350
    gamma: float | None = None
    spacing: float | None = None  # m; the method's own where None
    seed: int = 0
    fabric: str | None = None

    def request(self) -> Request:
        """Return the request for the fitter.

        Raises:
            FitError: an unknown method, fabric, effect or search, or bounds that do not hold.
        """
        method = find_method(self.method)
        if self.fabric is not None:
            method = method.starting_from(find_fabric(self.fabric).start, f"the fabric {self.fabric}")
        return request_of(
            method, list(self.effects), iterations=self.iterations, seed=self.seed, gamma=self.gamma,
            spacing=method.spacing if self.spacing is None else self.spacing, bounds=list(self.bounds),
            search=self.search,
        )  # fmt: skip


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
